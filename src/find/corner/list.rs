//! A corner, and the list of the strongest corners.

use heapless::Vec;

use crate::limits::CORNERS_MAX;

/// Two corners nearer than this are one: the radius of Geiger's non-maxima suppression.
const SEPARATION_PX: f32 = 3.0;

/// A checkerboard corner, located to about a quarter of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Its position, x and y.
    pub position_px: [f32; 2],
    /// Its quality, above 0 and at most 0.5: the correlation of the gradient with the two edges (at
    /// most 1) times the likelihood along these edges (half the contrast, white level = 1).
    pub score: f32,
    /// Directions of the two edges through the corner, `[0, pi)`, from x towards
    /// y. The sector swept from edge 0 to edge 1 by INCREASING angle (mod pi) is
    /// DARK, so that neighbours on a checkerboard have the roles of their two
    /// edges exchanged.
    pub edges_rad: [f32; 2],
}

/// The strongest corners of a search, and how many did not fit.
#[derive(Debug)]
pub struct CornerList {
    corners: Vec<Corner, CORNERS_MAX>,
    dropped: u32,
}

impl Default for CornerList {
    fn default() -> Self {
        Self::new()
    }
}

impl CornerList {
    /// An empty list.
    #[must_use]
    pub const fn new() -> Self {
        Self { corners: Vec::new(), dropped: 0 }
    }

    /// Removes all corners, and resets the count of dropped ones.
    pub fn clear(&mut self) {
        self.corners.clear();
        self.dropped = 0;
    }

    /// The corners, in no particular order.
    #[must_use]
    pub fn as_slice(&self) -> &[Corner] {
        &self.corners
    }

    /// Corners and candidates lost because a buffer was full. 0 means that the search was complete.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Whether there is a corner within [`SEPARATION_PX`].
    pub(super) fn has_near(&self, position_px: [f32; 2]) -> bool {
        self.corners.iter().any(|corner| is_near(corner.position_px, position_px))
    }

    /// Adds a corner. Of two within 3 px of each other the stronger is kept; when the list is full
    /// the weakest is dropped.
    pub fn push(&mut self, corner: Corner) {
        let mut others = self.corners.iter_mut();
        if let Some(twin) = others.find(|other| is_near(other.position_px, corner.position_px)) {
            if corner.score > twin.score {
                *twin = corner;
            }
            return;
        }
        if let Err(corner) = self.corners.push(corner) {
            self.dropped = self.dropped.saturating_add(1);
            let weakest = self.corners.iter_mut().min_by(|a, b| a.score.total_cmp(&b.score));
            if let Some(weakest) = weakest.filter(|weakest| weakest.score < corner.score) {
                *weakest = corner;
            }
        }
    }

    /// Counts candidates that were lost to a full buffer before they were examined.
    pub(super) fn count_dropped(&mut self, dropped: u32) {
        self.dropped = self.dropped.saturating_add(dropped);
    }
}

fn is_near(a: [f32; 2], b: [f32; 2]) -> bool {
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    dx * dx + dy * dy < SEPARATION_PX * SEPARATION_PX
}
