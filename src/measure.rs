//! One target measured in one frame: windows around the expected corners, and
//! the pose that explains what was seen in them.
//!
//! Work is bounded by the number of the target's corners: one window each, and
//! two fits of a fixed number of iterations.

use heapless::Vec;
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3};

use crate::corner::Corner;
use crate::corner::refine::{CornerSeed, Refinement, refine};
use crate::grid::Grid;
use crate::image::{GreyImage, Pixel};
use crate::lens::Lens;
use crate::limits::TARGET_CORNERS_MAX;
use crate::planar::planar_poses;
use crate::pose::{Cam, Pose, Target};
use crate::report::NoPose;
use crate::solve::{Observation, Solution, robust_cost, solve};
use crate::target::TargetGeometry;
use crate::undistort::UndistortionLut;

/// Corners seen in one frame, at most one per corner of the target.
pub type Observations = Vec<Observation, TARGET_CORNERS_MAX>;

/// The camera as the measurement needs it.
#[derive(Clone, Copy)]
pub struct Optics<'a> {
    /// The model: from rays to raw pixels.
    pub lens: &'a Lens,
    /// The way back: from raw to undistorted pixels.
    pub lut: &'a UndistortionLut,
}

/// A target's pose in one frame, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// The pose.
    pub cam_from_target: Pose<Cam, Target>,
    /// Covariance of `[omega_rad, delta_mm]`, the increments of [`Pose::moved_by`].
    pub covariance: Matrix6<f64>,
    /// Root mean square length of the raw-pixel residuals of the corners used.
    pub rms_px: f64,
    /// Corners used.
    pub corners: u8,
    /// Corners of the target. Fewer used than it has: a part is hidden.
    pub corners_total: u8,
}

impl Measurement {
    /// Standard deviations of x, y, z of the target's origin in the camera frame.
    #[must_use]
    pub fn sd_mm(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| libm::sqrt(self.covariance[(3 + axis, 3 + axis)]))
    }
}

/// Half width of a corner's window where the squares are large enough. Beyond
/// 6 px a window adds little: the information lies along the two edges, and
/// lens and print distort it more the longer it is.
const WINDOW_RADIUS_PX_MAX: usize = 6;

/// Below this half width a corner's two edges and its blur cannot be told apart.
const WINDOW_RADIUS_PX_MIN: usize = 3;

/// Fewest corners of a pose: six points give twelve equations for six unknowns.
const CORNERS_MIN: usize = 6;

/// Largest residual of an accepted pose. A good print and calibration give 0.02
/// to 0.3 px; a wrongly indexed grid several pixels.
const RMS_PX_MAX: f64 = 1.0;

/// Worst accepted standard deviation of any axis of the translation: a handful
/// of corners in one place can fix a pose formally and still say nothing.
const SD_MM_MAX: f64 = 5.0;

/// A mirrored pose replaces the expected one when its robust cost, in variances,
/// is lower by this: five standard deviations of a likelihood ratio.
const DOUBT_COST: f64 = 25.0;

/// Levenberg-Marquardt iterations of a fit that starts from a prediction.
const ITERATIONS_WARM: usize = 6;

/// Iterations of a fit that starts from the closed form.
const ITERATIONS_COLD: usize = 15;

/// Half width of the window of a corner whose neighbouring lines are this far
/// away; `None` where the squares are too small.
///
/// Half the spacing: the window's own corners, at 1.41 times its half width,
/// then stay clear of the neighbours' blur however the grid is turned.
fn window_radius(line_spacing_px: f64) -> Option<usize> {
    let radius = (0.5 * line_spacing_px) as usize;
    (radius >= WINDOW_RADIUS_PX_MIN).then_some(radius.min(WINDOW_RADIUS_PX_MAX))
}

/// Finds one corner in its window and turns it into an observation.
fn observe_corner<P: Pixel>(
    optics: Optics<'_>,
    image: &GreyImage<'_, P>,
    target: &TargetGeometry,
    index: usize,
    seed: &CornerSeed,
) -> Option<Observation> {
    let corner = refine(image, seed, Refinement::ModelFit).ok()?;
    // A corner that wandered out of its own window is somebody else's.
    let moved_px = libm::hypot(
        corner.position_px[0] - seed.position_px[0],
        corner.position_px[1] - seed.position_px[1],
    );
    if moved_px > seed.radius_px as f64 {
        return None;
    }
    let undistorted = optics.lut.undistort(&Vector2::from(corner.position_px))?;
    Some(Observation::new(
        index as u8,
        target.corner_mm(index),
        optics.lens,
        &undistorted,
        corner.sigma_px,
    ))
}

/// Looks for every corner of the target in a window around the place where the
/// expected pose puts it. `first_square_dark`: see [`Grid`].
pub fn observe<P: Pixel>(
    optics: Optics<'_>,
    image: &GreyImage<'_, P>,
    target: &TargetGeometry,
    first_square_dark: bool,
    expected_cam_from_target: &Pose<Cam, Target>,
    observations: &mut Observations,
) {
    observations.clear();
    let pitch_mm = target.pitch_mm();
    for index in 0..target.corner_count() {
        let point_cam_mm = expected_cam_from_target.transform(&target.corner_mm(index));
        let Some((raw_px, raw_by_point)) = optics.lens.project_with_jacobian(&point_cam_mm) else {
            continue;
        };
        // One square along each of the target's axes, in raw pixels.
        let square_px = raw_by_point * expected_cam_from_target.rotation * pitch_mm;
        let (along_x, along_y) = (square_px.column(0), square_px.column(1));
        let area_px2 = along_x.x * along_y.y - along_x.y * along_y.x;
        // Seen from behind, a printed target is not a target.
        if area_px2 <= 0.0 {
            continue;
        }
        let Some(radius_px) = window_radius(area_px2 / along_x.norm().max(along_y.norm())) else {
            continue;
        };
        let x_rad = line_angle(along_x.x, along_x.y);
        let y_rad = line_angle(along_y.x, along_y.y);
        // The square down and right of a corner has the colour of the one up and
        // left, and its sector runs from x to y.
        let even = (index / target.columns() + index % target.columns()).is_multiple_of(2);
        let dark = even == first_square_dark;
        let edges_rad = if dark { [x_rad, y_rad] } else { [y_rad, x_rad] };
        let seed = CornerSeed { position_px: [raw_px.x, raw_px.y], edges_rad, radius_px };
        if let Some(observation) = observe_corner(optics, image, target, index, &seed) {
            // One per corner of the target: the capacity is never reached.
            let _ = observations.push(observation);
        }
    }
}

/// Refines the corners of a grid that the search found.
pub fn observe_grid<P: Pixel>(
    optics: Optics<'_>,
    image: &GreyImage<'_, P>,
    target: &TargetGeometry,
    grid: &Grid,
    corners: &[Corner],
    observations: &mut Observations,
) {
    observations.clear();
    let columns = target.columns();
    let at = |row: usize, column: usize| -> Option<&Corner> {
        corners.get(usize::from((*grid.corners.get(row * columns + column)?)?))
    };
    for index in 0..target.corner_count() {
        let (row, column) = (index / columns, index % columns);
        let Some(corner) = at(row, column) else { continue };
        let neighbours = [
            (row.checked_sub(1), Some(column)),
            (Some(row + 1).filter(|&row| row < target.rows()), Some(column)),
            (Some(row), column.checked_sub(1)),
            (Some(row), Some(column + 1).filter(|&column| column < columns)),
        ];
        let nearest_px = neighbours
            .into_iter()
            .filter_map(|(row, column)| at(row?, column?))
            .map(|other| {
                libm::hypot(
                    f64::from(other.position_px[0] - corner.position_px[0]),
                    f64::from(other.position_px[1] - corner.position_px[1]),
                )
            })
            .fold(f64::INFINITY, f64::min);
        let edges_rad = corner.edges_rad.map(f64::from);
        let line_spacing_px = nearest_px * libm::sin(edges_rad[1] - edges_rad[0]).abs();
        let Some(radius_px) = window_radius(line_spacing_px) else { continue };
        let position_px = corner.position_px.map(f64::from);
        let seed = CornerSeed { position_px, edges_rad, radius_px };
        if let Some(observation) = observe_corner(optics, image, target, index, &seed) {
            let _ = observations.push(observation);
        }
    }
}

/// Direction of a line, [0, pi]: a tiny negative angle rounds to pi itself.
fn line_angle(x: f64, y: f64) -> f64 {
    let angle_rad = libm::atan2(y, x);
    if angle_rad < 0.0 { angle_rad + core::f64::consts::PI } else { angle_rad }
}

/// The other pose that explains a plane nearly as well: its mirror image in the
/// plane at right angles to the line of sight.
///
/// Seen along the line of sight v the target's outline stays and its depths
/// change sign: R' = (I - 2 v v^T) R diag(1, 1, -1).
#[must_use]
pub fn mirror_image(cam_from_target: &Pose<Cam, Target>) -> Pose<Cam, Target> {
    let sight = cam_from_target.translation_mm.normalize();
    let reflection = Matrix3::identity() - sight * sight.transpose() * 2.0;
    let mut rotation = reflection * cam_from_target.rotation;
    rotation.column_mut(2).neg_mut();
    Pose::new(rotation, cam_from_target.translation_mm)
}

/// A fit that was accepted, and which corners of the target it rests on.
#[derive(Debug, Clone, Copy)]
pub struct Fitted {
    /// The pose and its quality.
    pub measurement: Measurement,
    /// Bit i is set when corner i of the target was used.
    pub used: u128,
}

/// The pose that explains the observations, from the pose predicted by the frames
/// before.
///
/// A plane seen from afar has two poses that explain it nearly equally well, one
/// the other's mirror image (Schweighofer and Pinz 2006). Both are fitted in every
/// frame, and the mirrored one is taken when it is better beyond doubt: a warm
/// start alone would stay in the wrong one for ever once noise had led it there
/// while the target passed through frontal.
///
/// # Errors
/// [`NoPose::TooFewCorners`] and [`NoPose::PoorFit`].
pub fn fit_predicted(
    expected_cam_from_target: &Pose<Cam, Target>,
    target: &TargetGeometry,
    observations: &Observations,
) -> Result<Fitted, NoPose> {
    if observations.len() < CORNERS_MIN {
        return Err(NoPose::TooFewCorners);
    }
    let kept = solve(expected_cam_from_target, observations, ITERATIONS_WARM).ok();
    let other = mirror_image(expected_cam_from_target);
    let mirrored = solve(&other, observations, ITERATIONS_WARM).ok();
    let solution = better(kept, mirrored, observations, DOUBT_COST).ok_or(NoPose::PoorFit)?;
    accept(&solution, target, observations)
}

/// The pose of a target that was just found: both closed forms, refined; the
/// better one. Should they be equally good, the frames to come will tell.
///
/// # Errors
/// [`NoPose::TooFewCorners`] and [`NoPose::PoorFit`].
pub fn fit_found(target: &TargetGeometry, observations: &Observations) -> Result<Fitted, NoPose> {
    if observations.len() < CORNERS_MIN {
        return Err(NoPose::TooFewCorners);
    }
    let closed = planar_poses(observations).map_err(|_| NoPose::PoorFit)?;
    let refined = |place: usize| {
        let start = &closed.get(place)?.cam_from_target;
        solve(start, observations, ITERATIONS_COLD).ok()
    };
    let solution = better(refined(0), refined(1), observations, 0.0).ok_or(NoPose::PoorFit)?;
    accept(&solution, target, observations)
}

/// The second solution when its cost is lower by more than `margin`, else the first.
fn better(
    first: Option<Solution>,
    second: Option<Solution>,
    observations: &Observations,
    margin: f64,
) -> Option<Solution> {
    let (Some(one), Some(two)) = (first, second) else { return first.or(second) };
    // One scale for both: that of the better one, which is nearer the noise.
    let scale = one.scale.min(two.scale);
    let cost = |solution: &Solution| {
        robust_cost(&solution.cam_from_target, observations, scale).unwrap_or(f64::INFINITY)
    };
    Some(if cost(&two) + margin < cost(&one) { two } else { one })
}

/// Refuses what the corners do not really support.
fn accept(
    solution: &Solution,
    target: &TargetGeometry,
    observations: &Observations,
) -> Result<Fitted, NoPose> {
    let corners = solution.inlier_count();
    if corners < CORNERS_MIN {
        return Err(NoPose::TooFewCorners);
    }
    let measurement = Measurement {
        cam_from_target: solution.cam_from_target,
        covariance: solution.covariance,
        rms_px: solution.rms_px,
        corners: corners as u8,
        corners_total: target.corner_count() as u8,
    };
    let plausible = measurement.rms_px <= RMS_PX_MAX
        && 2 * corners >= observations.len()
        && measurement.sd_mm().max() <= SD_MM_MAX;
    if !plausible {
        return Err(NoPose::PoorFit);
    }
    let used = observations
        .iter()
        .enumerate()
        .filter(|(place, _)| solution.inliers >> place & 1 == 1)
        .fold(0, |used, (_, seen)| used | 1 << seen.index);
    Ok(Fitted { measurement, used })
}

/// True when at least half of the corners of each of the grid's four border
/// lines were used: the grid's extent then proves that it was not shifted by a
/// square, whatever was expected.
#[must_use]
pub fn extent_is_certain(target: &TargetGeometry, used: u128) -> bool {
    let (columns, rows) = (target.columns(), target.rows());
    let seen = |row: usize, column: usize| used >> (row * columns + column) & 1 == 1;
    let line = |count: usize, length: usize| 2 * count >= length;
    [0, rows - 1]
        .into_iter()
        .all(|row| line((0..columns).filter(|&column| seen(row, column)).count(), columns))
        && [0, columns - 1]
            .into_iter()
            .all(|column| line((0..rows).filter(|&row| seen(row, column)).count(), rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::target::{Origin, Role};

    #[test]
    fn the_mirror_image_keeps_the_outline_and_turns_the_tilt() {
        let pose = Pose::<Cam, Target>::from_theta([0.2, 0.3, -0.1, 80.0, -60.0, 1000.0]);
        let mirrored = mirror_image(&pose);
        assert!((mirrored.rotation.determinant() - 1.0).abs() < 1e-12);
        let sight = pose.translation_mm.normalize();
        for axis in 0..2 {
            let (was, is) = (pose.rotation.column(axis), mirrored.rotation.column(axis));
            // Depth changes sign, and what is seen at right angles to it stays.
            assert!((was.dot(&sight) + is.dot(&sight)).abs() < 1e-12);
            assert!((was - sight * was.dot(&sight) - is + sight * is.dot(&sight)).norm() < 1e-12);
        }
        assert!((mirror_image(&mirrored).rotation - pose.rotation).norm() < 1e-12);
    }

    #[test]
    fn an_extent_is_certain_only_with_all_four_borders() {
        let target =
            TargetGeometry::checker(5, 4, 12.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap();
        let all = (1_u128 << 20) - 1;
        assert!(extent_is_certain(&target, all));
        // Without the left column, without the bottom row but one corner.
        let left = 1 | 1 << 5 | 1 << 10 | 1 << 15;
        assert!(!extent_is_certain(&target, all & !left));
        assert!(!extent_is_certain(&target, all & !(0b11110 << 15)));
        // A hole in the middle does not matter.
        assert!(extent_is_certain(&target, all & !(0b01110 << 5)));
    }

    #[test]
    fn windows_stay_clear_of_their_neighbours() {
        assert_eq!(window_radius(5.9), None);
        assert_eq!(window_radius(8.0), Some(4));
        assert_eq!(window_radius(28.0), Some(6));
        assert_eq!(window_radius(f64::NAN), None);
    }
}
