//! Where in the frame to search for a target that was seen not long ago.

use crate::find::search::Area;
use crate::model::lens_table::LensTable;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::TargetGeometry;

/// The part of the frame in which a target may be: its outline where it is
/// expected, and at least three squares more on every side. `None` when it is outside.
pub(crate) fn region(
    lens: &LensTable,
    target: &TargetGeometry,
    cam_from_target: &Pose<Cam, Target>,
) -> Option<Area> {
    const MARGIN_SQUARES: f64 = 3.0;
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for index in 0..target.corner_count() {
        let raw_px = lens.project(&cam_from_target.transform(&target.corner_mm(index)))?;
        for axis in 0..2 {
            low[axis] = low[axis].min(raw_px[axis]);
            high[axis] = high[axis].max(raw_px[axis]);
        }
    }
    let squares = target.columns().min(target.rows()) as f64 - 1.0;
    let side = |axis: usize, length: u16| {
        let margin_px = MARGIN_SQUARES * (high[axis] - low[axis]) / squares;
        let start = (low[axis] - margin_px).max(0.0) as usize;
        let end = ((high[axis] + margin_px).max(0.0) as usize).min(usize::from(length));
        (start < end).then_some(start..end)
    };
    Some(Area { columns: side(0, lens.width_px())?, rows: side(1, lens.height_px())? })
}
