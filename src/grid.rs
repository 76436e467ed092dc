//! Corners to indexed grids.
use crate::corner::Corner;
use crate::limits::TARGET_CORNERS_MAX;
/// Inner corners.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridShape {
    /// Columns.
    pub columns: u8,
    /// Rows.
    pub rows: u8,
}
/// A grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grid {
    /// Corners.
    pub corners: heapless::Vec<Option<u16>, TARGET_CORNERS_MAX>,
}
/// Reasons.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridRejection {
    /// None.
    NotFound,
    /// Two.
    Ambiguous,
}
/// Finder.
pub struct GridFinder {}
impl GridFinder {
    /// New.
    pub const fn new() -> Self {
        Self {}
    }
    /// Find.
    pub fn find(&mut self, _: &[Corner], _: &[GridShape], _: &mut [Result<Grid, GridRejection>]) {}
}
