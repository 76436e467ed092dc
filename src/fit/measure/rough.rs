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
