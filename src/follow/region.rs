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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::lens::{Distortion, Lens};
    use crate::model::target::{Origin, Role};
    use crate::test_support::table;

    /// Where a target of 6 x 5 corners is expected whose middle is at this pixel, and whose pitch is
    /// 12 pixels.
    fn around([x_px, y_px]: [f64; 2], z_mm: f64) -> Option<Area> {
        let lens = Lens {
            width_px: 1456,
            height_px: 1088,
            fx_px: 1000.0,
            fy_px: 1000.0,
            cx_px: 700.0,
            cy_px: 500.0,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        };
        let target =
            TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Lower, [0.0; 3]).unwrap();
        let pose = Pose::from_theta([0.0, 0.0, 0.0, x_px - 700.0, y_px - 500.0, z_mm]);
        region(&table(&lens), &target, &pose)
    }

    /// The grid has 4 squares along its shorter side, so that three are three quarters of each side:
    /// 45 px beyond the 30 px from the middle to the left and to the right, 36 beyond 24 above and
    /// below.
    #[test]
    fn a_region_has_three_squares_around_the_target() {
        let area = around([700.5, 500.5], 1000.0);
        assert_eq!(area, Some(Area { columns: 625..775, rows: 440..560 }));
    }

    #[test]
    fn a_region_ends_at_the_frame() {
        let upper_left = around([10.5, 8.5], 1000.0);
        assert_eq!(upper_left, Some(Area { columns: 0..85, rows: 0..68 }));
        let lower_right = around([1450.5, 1080.5], 1000.0);
        assert_eq!(lower_right, Some(Area { columns: 1375..1456, rows: 1020..1088 }));
    }

    #[test]
    fn outside_the_frame_there_is_no_region() {
        for place_px in [[-110.5, 500.0], [700.0, -80.5], [1540.5, 500.0], [700.0, 1150.5]] {
            assert_eq!(around(place_px, 1000.0), None, "{place_px:?}");
        }
        assert_eq!(around([700.0, 500.0], -1000.0), None);
    }
}
