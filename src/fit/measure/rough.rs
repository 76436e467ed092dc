//! A first pose, from the corners of a grid that a search has found.

use heapless::Vec;
use nalgebra::Vector2;

use super::measurement::{CORNERS_MIN, MeasureFailure, View};
use super::minima::better;
use crate::find::corner::Corner;
use crate::find::grid::Grid;
use crate::fit::planar::{SeenCorner, planar_poses};
use crate::fit::solve::solve;
use crate::limits::TARGET_CORNERS_MAX;
use crate::model::image::Pixel;
use crate::model::pose::{Cam, Pose, Target};

/// Levenberg-Marquardt iterations from the closed form.
pub(super) const ITERATIONS_FOUND: usize = 15;

/// Accuracy of the detector's corners.
const FOUND_SIGMA_PX: f64 = 0.25;

/// The pose of the corners that a search has found.
///
/// Never inlined: its corners would stay on the stack while the edges are fitted.
#[inline(never)]
pub(super) fn rough_pose<P: Pixel>(
    view: &View<'_, P>,
    grid: &Grid,
    corners: &[Corner],
) -> Result<Pose<Cam, Target>, MeasureFailure> {
    let found = seen_corners(view, grid, corners);
    if found.len() < CORNERS_MIN {
        return Err(MeasureFailure::TooFewCorners);
    }
    let closed = planar_poses(&found).map_err(|_| MeasureFailure::PoorFit)?;
    let refined = |place: usize| {
        solve(&closed.get(place)?.cam_from_target, &found[..], ITERATIONS_FOUND).ok()
    };
    let rough = better(refined(0), refined(1), &found[..], 0.0).ok_or(MeasureFailure::PoorFit)?;
    Ok(rough.cam_from_target)
}

/// The corners of a grid that the search found.
fn seen_corners<P: Pixel>(
    view: &View<'_, P>,
    grid: &Grid,
    corners: &[Corner],
) -> Vec<SeenCorner, TARGET_CORNERS_MAX> {
    (0..view.target.corner_count())
        .filter_map(|index| {
            let corner = corners.get(usize::from((*grid.corners.get(index)?)?))?;
            let raw_px = Vector2::from(corner.position_px.map(f64::from));
            let point_mm = view.target.corner_mm(index);
            SeenCorner::new(point_mm, view.lens, &raw_px, FOUND_SIGMA_PX)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::image::GreyImage;
    use crate::model::target::{Origin, Role, TargetGeometry};
    use crate::test_support::{bedside_lens, table};

    /// The pose of these corners of a target of 6 x 5, each seen where it is; their list has another order.
    fn pose_of(found: impl Fn(usize) -> bool) -> Result<Pose<Cam, Target>, MeasureFailure> {
        let target =
            TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap();
        let mut corners: Vec<Corner, TARGET_CORNERS_MAX> = Vec::new();
        let mut grid = Grid { shape: target.shape(), corners: Vec::new(), first_square_dark: true };
        for index in 0..30 {
            // 7 and 30 have no common factor: each corner once.
            let position_px = seen_px(&target, index * 7 % 30);
            corners.push(Corner { position_px, score: 0.4, edges_rad: [0.0, 1.5] }).unwrap();
            let place = (index * 13 % 30) as u16;
            grid.corners.push(found(index).then_some(place)).unwrap();
        }
        let pixels = [0_u8; 64 * 64];
        let view = View {
            image: &GreyImage::new(&pixels, 64, 64, 64).unwrap(),
            lens: &table(&bedside_lens()),
            target: &target,
            first_square_dark: true,
            rolling: None,
        };
        rough_pose(&view, &grid, &corners)
    }

    fn pose() -> Pose<Cam, Target> {
        Pose::from_theta([0.1, 0.3, -0.2, 50.0, -80.0, 1000.0])
    }

    fn seen_px(target: &TargetGeometry, index: usize) -> [f32; 2] {
        let px = bedside_lens().project(&pose().transform(&target.corner_mm(index))).unwrap();
        [px.x as f32, px.y as f32]
    }

    #[test]
    fn six_corners_have_a_pose_and_five_do_not() {
        let is_near = |found: &dyn Fn(usize) -> bool| {
            let moved = pose().increment_to(&pose_of(found).unwrap());
            // A position in single precision is good to 3e-5 px: 1e-5 of a square of 24.
            moved.fixed_rows::<3>(3).norm() < 0.1 && moved.fixed_rows::<3>(0).norm() < 0.01
        };
        assert!(is_near(&|_| true));
        let of_first = |count: usize| move |index: usize| index % 6 < 2 && index / 6 < count;
        assert!(is_near(&of_first(3)));
        let five = |index: usize| of_first(3)(index) && index != 13;
        assert_eq!(pose_of(five), Err(MeasureFailure::TooFewCorners));
        assert_eq!(pose_of(|_| false), Err(MeasureFailure::TooFewCorners));
        // On one line.
        assert_eq!(pose_of(|index| index < 6), Err(MeasureFailure::PoorFit));
    }
}
