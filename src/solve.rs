//! The pose of a target from its corners: robust Levenberg-Marquardt on (t, R).
//!
//! In: a pose to start from and up to 120 corners. Out: the pose that minimises the
//! paper's sum of squared reprojection errors (section "Kinematic Model Fitting"),
//! with a covariance and the corners that were believed.
//!
//! *Residuals* are raw pixels, although corners arrive as rays: the difference of
//! two rays times `raw_by_ray`, the lens's Jacobian at the corner. Noise is even on
//! the sensor; a wide-angle lens makes it several times larger in undistorted
//! pixels at the frame's edge than in the middle. Dividing by each corner's
//! `sigma_px` makes them numbers of standard deviations.
//!
//! *Steps* turn the target about its own origin and move that origin, see
//! [`Pose::moved_by`]. A step that does not lower the cost is undone and its
//! damping raised. The number of evaluations is fixed by the caller, so that the
//! time is too.
//!
//! *Robust weights* are Tukey's biweight with a flat top: 1 for residuals
//! up to 2.4 scales, 0 beyond 5, so that a wrong corner has no influence at all,
//! and right ones almost always have all of theirs (which keeps the covariance
//! honest). The scale is the residuals' median, or their sigma where that is more;
//! it is found again after every accepted step, so that a far start, which makes all
//! residuals large, rejects nothing. Fewer than half of the corners may be wrong.
//!
//! *Covariance* is the inverse of the weighted normal equations, times the
//! observed variance of the residuals where that is more than predicted: what the
//! sigmas do not know (a bent target, a poor calibration) makes the answer less
//! certain, and luck never makes it more so.
//!
//! Cost: about 2 us per iteration with 30 corners on a workstation.

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector3, Vector6};

use crate::lens::{Lens, ray_by_point, ray_of};
use crate::limits::TARGET_CORNERS_MAX;
use crate::pose::{Cam, Pose, Target};
use crate::undistort::Undistorted;

/// 3 corners fix a pose but leave nothing to tell a wrong one by.
pub const POINTS_MIN: usize = 4;

/// Square of the residual, in scales, up to which a corner has full weight: 95 % of
/// right corners lie below (the square of a 2-D normal's length is exponential
/// with mean 2).
const FULL_WEIGHT_SQUARE: f64 = 6.0;

/// Square of the residual, in scales, from which a corner has no weight: 4 right
/// corners in a million lie beyond.
const NO_WEIGHT_SQUARE: f64 = 25.0;

/// Median of the squared length of a 2-D normal: 2 ln 2.
const MEDIAN_SQUARE: f64 = 2.0 * core::f64::consts::LN_2;

/// First damping, as a share of the normal equations' diagonal: small enough for a
/// warm start to converge as fast as Gauss and Newton's method.
const DAMPING_START: f64 = 1e-4;
/// An accepted step divides the damping by this, a refused one multiplies by it.
const DAMPING_FACTOR: f64 = 10.0;
/// Bounds that keep the damping a number that matters.
const DAMPING_MIN: f64 = 1e-12;
const DAMPING_MAX: f64 = 1e6;

/// Smallest pivot of the normal equations, scaled to a diagonal of ones, of a pose
/// that is fixed by its corners. Rounding leaves 1e-16 of a singular system; a
/// 10 mm target at 10 m has 1e-7.
const PIVOT_MIN: f64 = 1e-11;

/// One corner seen: where it is on the target, along which ray it was seen, and how
/// raw pixels change with the ray there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Which corner of the target, for the caller: the solver does not use it.
    pub index: u8,
    /// The corner in the target frame.
    pub point_target_mm: Vector3<f64>,
    /// The ray seen, undistorted, at z = 1.
    pub ray: Vector2<f64>,
    /// d raw pixel / d ray, there.
    pub raw_by_ray: Matrix2<f64>,
    /// Standard deviation of one raw coordinate.
    pub sigma_px: f64,
}

impl Observation {
    /// The observation of an undistorted corner.
    #[must_use]
    pub fn new(
        index: u8,
        point_target_mm: Vector3<f64>,
        lens: &Lens,
        undistorted: &Undistorted,
        sigma_px: f64,
    ) -> Self {
        let ray = lens.ray_from_pixel(&undistorted.pixel_px);
        let (_, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
        Self { index, point_target_mm, ray, raw_by_ray, sigma_px }
    }

    /// True when every number is finite and the sigma positive.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        // A sum is finite only if its terms are, and no usable term is near overflow.
        let sum = self.point_target_mm.sum() + self.ray.sum() + self.raw_by_ray.sum();
        sum.is_finite() && self.sigma_px > 0.0 && self.sigma_px.is_finite()
    }
}

/// Why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolveFailure {
    /// Fewer than [`POINTS_MIN`] corners, or so few left after the wrong ones.
    TooFewPoints,
    /// The corners leave a direction of the pose open.
    Degenerate,
    /// A number that came in is not finite, or a sigma is not positive.
    NotFinite,
    /// The start puts a corner behind the camera.
    BehindCamera,
}

impl core::fmt::Display for SolveFailure {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::TooFewPoints => "fewer than 4 usable corners",
            Self::Degenerate => "the corners do not fix the pose",
            Self::NotFinite => "a number is not finite, or a sigma is not positive",
            Self::BehindCamera => "a corner would lie behind the camera",
        })
    }
}

impl core::error::Error for SolveFailure {}

/// A pose, how certain it is, and what it rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The pose.
    pub cam_from_target: Pose<Cam, Target>,
    /// Covariance of `[omega_rad (target axes), delta_mm (camera axes)]`, the order
    /// of [`Pose::moved_by`].
    pub covariance: Matrix6<f64>,
    /// Root mean square of the residuals' lengths in raw pixels over the inliers
    /// (what OpenCV calls the reprojection error).
    pub rms_px: f64,
    /// Bit i is set when observation i (its place in the slice) has weight.
    pub inliers: u128,
    /// The robust scale: 1 when the residuals are what the sigmas promise, more when
    /// they are larger.
    pub scale: f64,
}

impl Solution {
    /// Number of inliers.
    #[must_use]
    pub fn inlier_count(&self) -> usize {
        self.inliers.count_ones() as usize
    }

    /// Standard deviations of the origin's x, y and z in the camera frame.
    #[must_use]
    pub fn sd_mm(&self) -> [f64; 3] {
        [3, 4, 5].map(|axis| libm::sqrt(self.covariance[(axis, axis)]))
    }
}

/// Refines a pose with a fixed number of iterations: for a start from the last frame
/// 4 do, or 6 where corners may be wrong; 15 for one from [`crate::planar`], whose
/// second pose has residuals that slow the convergence.
///
/// # Errors
/// [`SolveFailure`].
///
/// # Panics
/// When there are more than [`TARGET_CORNERS_MAX`] observations: a caller's bug.
pub fn solve(
    start: &Pose<Cam, Target>,
    observations: &[Observation],
    iterations: usize,
) -> Result<Solution, SolveFailure> {
    assert!(observations.len() <= TARGET_CORNERS_MAX, "{} observations", observations.len());
    if observations.len() < POINTS_MIN {
        return Err(SolveFailure::TooFewPoints);
    }
    let start_sum = start.rotation.sum() + start.translation_mm.sum();
    if !start_sum.is_finite() || !observations.iter().all(Observation::is_finite) {
        return Err(SolveFailure::NotFinite);
    }

    let mut pose = *start;
    let mut squares = Squares::new(observations.len());
    squares.measure(&pose, observations).ok_or(SolveFailure::BehindCamera)?;
    let mut next_squares = Squares::new(observations.len());
    let mut damping = DAMPING_START;
    // A refused step changes the damping alone.
    let mut normal = None;
    for _ in 0..iterations {
        // Judged by one scale, before and after the step; the next has its own.
        let variance = squares.robust_variance();
        let current =
            normal.get_or_insert_with(|| NormalEquations::new(&pose, observations, variance));
        let next_pose = current.step(damping).map(|step| pose.moved_by(&step));
        let lower = next_pose.filter(|next_pose| {
            let seen = next_squares.measure(next_pose, observations);
            // A NaN is not lower.
            seen.is_some() && next_squares.cost(variance) < squares.cost(variance)
        });
        if let Some(next_pose) = lower {
            pose = next_pose;
            core::mem::swap(&mut squares, &mut next_squares);
            normal = None;
            damping = (damping / DAMPING_FACTOR).max(DAMPING_MIN);
        } else {
            damping = (damping * DAMPING_FACTOR).min(DAMPING_MAX);
        }
    }

    // Products of many frames' increments would drift off the rotations: one Newton
    // step of the polar decomposition.
    let gram = pose.rotation.tr_mul(&pose.rotation);
    pose.rotation *= (Matrix3::identity() * 3.0 - gram) * 0.5;
    let variance = squares.robust_variance();
    let normal = normal.unwrap_or_else(|| NormalEquations::new(&pose, observations, variance));
    conclude(pose, observations, &squares, &normal)
}

/// The robust cost of a pose at a given scale: the sum of the squared residuals in
/// scales, those of wrong corners capped. `None` when a corner lies behind the camera.
///
/// Poses of one set of observations are compared by it; the difference of two costs
/// is twice the logarithm of their likelihood ratio.
#[must_use]
pub fn robust_cost(
    cam_from_target: &Pose<Cam, Target>,
    observations: &[Observation],
    scale: f64,
) -> Option<f64> {
    let mut squares = Squares::new(observations.len());
    squares.measure(cam_from_target, observations)?;
    let variance = scale * scale;
    Some(squares.cost(variance) / variance)
}

/// What a pose that has converged says about itself.
fn conclude(
    pose: Pose<Cam, Target>,
    observations: &[Observation],
    squares: &Squares,
    normal: &NormalEquations,
) -> Result<Solution, SolveFailure> {
    let variance = squares.robust_variance();
    let mut inliers = 0_u128;
    let [mut weights, mut weighted_squares, mut squares_px2] = [0.0; 3];
    for (place, (square, seen)) in squares.iter().zip(observations).enumerate() {
        let weight = weight(square / variance);
        weights += weight;
        weighted_squares += weight * square;
        if weight > 0.0 {
            inliers |= 1 << place;
            squares_px2 += square * seen.sigma_px * seen.sigma_px;
        }
    }
    let count = inliers.count_ones();
    if (count as usize) < POINTS_MIN {
        return Err(SolveFailure::TooFewPoints);
    }
    // Two numbers per corner, less the six that were fitted. With soft weights the
    // divisor could fall below that of the fewest corners.
    let observed_variance = weighted_squares / (2.0 * weights - 6.0).max(1.0);
    let covariance = normal.inverse().ok_or(SolveFailure::Degenerate)? * observed_variance.max(1.0);
    let rms_px = libm::sqrt(squares_px2 / f64::from(count));
    let finite =
        (covariance.sum() + pose.rotation.sum() + pose.translation_mm.sum() + rms_px).is_finite();
    // Finite numbers came in, so that only a nearly singular system overflows.
    if !finite {
        return Err(SolveFailure::Degenerate);
    }
    let scale = libm::sqrt(variance);
    Ok(Solution { cam_from_target: pose, covariance, rms_px, inliers, scale })
}

/// Weight of a corner by the square of its residual in scales.
#[inline]
fn weight(square: f64) -> f64 {
    let beyond = (square - FULL_WEIGHT_SQUARE) * (1.0 / (NO_WEIGHT_SQUARE - FULL_WEIGHT_SQUARE));
    let left = 1.0 - beyond.clamp(0.0, 1.0);
    left * left
}

/// The cost whose derivative by the square is [`weight`].
#[inline]
fn robust_square(square: f64) -> f64 {
    const RANGE: f64 = NO_WEIGHT_SQUARE - FULL_WEIGHT_SQUARE;
    let beyond = (square - FULL_WEIGHT_SQUARE) * (1.0 / RANGE);
    let left = 1.0 - beyond.clamp(0.0, 1.0);
    square.min(FULL_WEIGHT_SQUARE) + RANGE / 3.0 * (1.0 - left * left * left)
}

/// Squared residual of each observation, in its own sigmas.
struct Squares {
    values: [f64; TARGET_CORNERS_MAX],
    count: usize,
}

impl Squares {
    fn new(count: usize) -> Self {
        Self { values: [0.0; TARGET_CORNERS_MAX], count }
    }

    /// Measures the squares alone; `None` when a corner lies behind the camera.
    fn measure(&mut self, pose: &Pose<Cam, Target>, observations: &[Observation]) -> Option<()> {
        for (seen, square) in observations.iter().zip(&mut self.values) {
            let ray = ray_of(&pose.transform(&seen.point_target_mm))?;
            let residual_px = seen.raw_by_ray * (ray - seen.ray);
            *square = residual_px.norm_squared() / (seen.sigma_px * seen.sigma_px);
        }
        Some(())
    }

    fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        self.values[..self.count].iter().copied()
    }

    /// The variance of which the squares' median speaks, in units of the sigmas', at
    /// least 1. The fit has made the residuals smaller than the noise; the share of
    /// degrees of freedom that is left makes up for that.
    fn robust_variance(&self) -> f64 {
        let mut sorted = self.values;
        let (_, median, _) =
            sorted[..self.count].select_nth_unstable_by(self.count / 2, f64::total_cmp);
        let count = self.count as f64;
        (*median / MEDIAN_SQUARE * count / (count - 3.0)).max(1.0)
    }

    fn cost(&self, variance: f64) -> f64 {
        let per_variance = 1.0 / variance;
        self.iter().map(|square| robust_square(square * per_variance)).sum::<f64>() * variance
    }
}

/// The residual of one observation, in sigmas, and its Jacobian by an increment;
/// `None` when the corner lies behind the camera.
#[inline]
fn residual(pose: &Pose<Cam, Target>, seen: &Observation) -> Option<([f64; 2], [[f64; 6]; 2])> {
    let point_cam_mm = pose.transform(&seen.point_target_mm);
    let ray = ray_of(&point_cam_mm)?;
    let per_sigma = 1.0 / seen.sigma_px;
    let whitened_by_ray = seen.raw_by_ray * per_sigma;
    let residual = whitened_by_ray * (ray - seen.ray);
    let by_translation = whitened_by_ray * ray_by_point(&point_cam_mm, &ray);
    // d (R exp(omega) p) = R (omega x p), so that a row a by the point gives
    // a . R (omega x p) = omega . (p x R^T a).
    let by_point = by_translation * pose.rotation;
    let point = &seen.point_target_mm;
    let rows = [0, 1].map(|row| {
        let (x, y, z) = (by_point[(row, 0)], by_point[(row, 1)], by_point[(row, 2)]);
        [
            point.y * z - point.z * y,
            point.z * x - point.x * z,
            point.x * y - point.y * x,
            by_translation[(row, 0)],
            by_translation[(row, 1)],
            by_translation[(row, 2)],
        ]
    });
    Some(([residual.x, residual.y], rows))
}

/// Weighted normal equations `matrix * step = -gradient`.
struct NormalEquations {
    /// Upper triangle.
    matrix: [[f64; 6]; 6],
    gradient: [f64; 6],
}

impl NormalEquations {
    /// At a pose that has every corner in front of the camera.
    fn new(pose: &Pose<Cam, Target>, observations: &[Observation], variance: f64) -> Self {
        let per_variance = 1.0 / variance;
        let mut normal = Self { matrix: [[0.0; 6]; 6], gradient: [0.0; 6] };
        for seen in observations {
            let Some((residual, rows)) = residual(pose, seen) else { continue };
            let square = residual[0] * residual[0] + residual[1] * residual[1];
            normal.add(&residual, &rows, weight(square * per_variance));
        }
        normal
    }

    #[inline]
    fn add(&mut self, residual: &[f64; 2], rows: &[[f64; 6]; 2], weight: f64) {
        let [first, second] = rows;
        for i in 0..6 {
            let (weighted_first, weighted_second) = (weight * first[i], weight * second[i]);
            for j in i..6 {
                self.matrix[i][j] += weighted_first * first[j] + weighted_second * second[j];
            }
            self.gradient[i] += weighted_first * residual[0] + weighted_second * residual[1];
        }
    }

    /// The step under Marquardt's damping, `None` when the system is singular.
    fn step(&self, damping: f64) -> Option<Vector6<f64>> {
        let mut matrix = self.symmetric();
        for axis in 0..6 {
            matrix[(axis, axis)] *= 1.0 + damping;
        }
        let step = matrix.cholesky()?.solve(&-Vector6::from(self.gradient));
        step.sum().is_finite().then_some(step)
    }

    /// The inverse, `None` when the system is nearly singular. Scaled to a diagonal
    /// of ones first: radians and millimetres have no common measure.
    fn inverse(&self) -> Option<Matrix6<f64>> {
        let matrix = self.symmetric();
        let scale = matrix.diagonal().map(|value| 1.0 / libm::sqrt(value));
        let scaled = Matrix6::from_fn(|i, j| matrix[(i, j)] * scale[i] * scale[j]);
        let cholesky = scaled.cholesky()?;
        // The factor's diagonal holds the pivots' roots, positive numbers.
        let pivot = cholesky.l_dirty().diagonal().min();
        if pivot * pivot < PIVOT_MIN {
            return None;
        }
        let inverse = cholesky.inverse();
        Some(Matrix6::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]))
    }

    fn symmetric(&self) -> Matrix6<f64> {
        Matrix6::from_fn(|i, j| if i <= j { self.matrix[i][j] } else { self.matrix[j][i] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planar::planar_poses;
    use crate::pose::vector_from_rotation;
    use crate::test_support::{Observations, Random, bedside_lens, observe};

    const LUMBAR: [u8; 2] = [6, 5];
    const SHOULDER: [u8; 2] = [5, 4];

    fn tilted() -> Pose<Cam, Target> {
        Pose::from_theta([0.1, 0.3, -0.2, 50.0, -80.0, 1000.0])
    }

    /// Where a target lies from where it was a frame ago: 0.5 mm and 2 mrad.
    fn nearby(pose: &Pose<Cam, Target>, random: &mut Random) -> Pose<Cam, Target> {
        let spread = Vector6::new(2e-3, 2e-3, 2e-3, 0.5, 0.5, 0.5);
        pose.moved_by(&spread.map(|spread| spread * random.normal()))
    }

    /// Largest difference between the Jacobian and central differences, relative to
    /// the column's length, with column `spoiled` deliberately 1e-4 too large.
    fn jacobian_error(spoiled: Option<usize>) -> f64 {
        let mut random = Random::new(2);
        let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.5, &mut random);
        let mut worst = 0.0_f64;
        for (seen, axis) in seen.iter().flat_map(|seen| (0..6).map(move |axis| (seen, axis))) {
            // Points off the plane as well, so that z of a bent target counts.
            let mut seen = *seen;
            seen.point_target_mm.z = f64::from(seen.index) - 12.0;
            let step = if axis < 3 { 1e-5 } else { 1e-2 };
            let mut increment = Vector6::zeros();
            increment[axis] = step;
            let (ahead, _) = residual(&tilted().moved_by(&increment), &seen).unwrap();
            let (behind, _) = residual(&tilted().moved_by(&-increment), &seen).unwrap();
            let (_, rows) = residual(&tilted(), &seen).unwrap();
            let scale = if spoiled == Some(axis) { 1.0001 } else { 1.0 };
            let column = Vector2::new(rows[0][axis], rows[1][axis]) * scale;
            let difference =
                Vector2::new(ahead[0] - behind[0], ahead[1] - behind[1]) / (2.0 * step);
            worst = worst.max((column - difference).norm() / column.norm().max(1.0));
        }
        worst
    }

    #[test]
    fn the_jacobian_matches_differences_and_a_wrong_one_does_not() {
        // Third derivatives times the squared step, and rounding over the step: 1e-9.
        assert!(jacobian_error(None) < 1e-8, "{}", jacobian_error(None));
        for axis in 0..6 {
            assert!(jacobian_error(Some(axis)) > 3e-5, "{axis}");
        }
    }

    #[test]
    fn weight_is_the_slope_of_the_robust_square() {
        for square in [0.0, 3.0, 5.9, 6.1, 12.0, 24.9, 25.1, 900.0] {
            const STEP: f64 = 1e-6;
            let slope = (robust_square(square + STEP) - robust_square(square - STEP)) / 2e-6;
            assert!((slope - weight(square)).abs() < 1e-8, "{square}");
        }
        assert_eq!((weight(6.0), weight(25.0)), (1.0, 0.0));
    }

    #[test]
    fn exact_corners_give_the_exact_pose_from_10_mm_and_10_degrees() {
        let mut random = Random::new(4);
        let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.0, &mut random);
        for sign in [1.0, -1.0] {
            // 10 degrees about, and 10 mm along, the diagonals.
            let start = tilted().moved_by(&(Vector6::new(0.1, -0.1, 0.1, 5.8, -5.8, 5.8) * sign));
            let solution = solve(&start, &seen, 6).unwrap();
            let off = solution.cam_from_target.translation_mm - tilted().translation_mm;
            assert!(off.norm() < 1e-6, "{off}");
            assert!(solution.rms_px < 1e-7 && solution.inlier_count() == 30);
            assert_eq!(solution.scale, 1.0);
        }
        let warm = solve(&nearby(&tilted(), &mut random), &seen, 3).unwrap();
        let off = warm.cam_from_target.translation_mm - tilted().translation_mm;
        // A thousandth of the precision of a frame.
        assert!(off.norm() < 1e-4, "{off}");
    }

    /// Standard deviations of the pose's errors over what the covariance says,
    /// `[omega, delta]`.
    fn normalised_sd(
        pose: &Pose<Cam, Target>,
        shape: [u8; 2],
        sigma_px: f64,
        count: usize,
    ) -> [f64; 6] {
        let mut random = Random::new(7);
        let mut squares = [0.0; 6];
        for _ in 0..count {
            let seen = observe(&bedside_lens(), pose, shape, sigma_px, &mut random);
            let found = solve(&nearby(pose, &mut random), &seen, 6).unwrap();
            let turn = pose.rotation.tr_mul(&found.cam_from_target.rotation);
            let omega_rad = vector_from_rotation(&turn);
            let delta_mm = found.cam_from_target.translation_mm - pose.translation_mm;
            for axis in 0..3 {
                let variance = |axis: usize| found.covariance[(axis, axis)];
                squares[axis] += omega_rad[axis] * omega_rad[axis] / variance(axis);
                squares[axis + 3] += delta_mm[axis] * delta_mm[axis] / variance(axis + 3);
            }
        }
        squares.map(|square| libm::sqrt(square / count as f64))
    }

    #[test]
    fn errors_are_as_large_as_the_covariance_says() {
        // The SD of N normals is known to 1 / sqrt(2 N): 0.016 for 2,000. The larger
        // of predicted and observed variance is on average 6 % (30 corners) to 8 %
        // (20) too large, which takes the SD down to 0.97 and 0.96; the weights add
        // 0.01. So 0.93 to 1.07 is two standard errors from the smaller.
        for theta in [
            [0.1, 0.3, -0.2, 50.0, -80.0, 1000.0],
            [0.0, 0.6, 0.3, -150.0, 100.0, 700.0],
            [0.2, -0.4, 0.1, 0.0, 150.0, 1500.0],
        ] {
            for shape in [LUMBAR, SHOULDER] {
                for sigma_px in [0.02, 0.1] {
                    let pose = Pose::from_theta(theta);
                    let sd = normalised_sd(&pose, shape, sigma_px, 2000);
                    let honest = sd.iter().all(|sd| (0.93..1.07).contains(sd));
                    assert!(honest, "{theta:?} {shape:?} {sigma_px}: {sd:?}");
                }
            }
        }
        // Face on, the tilt's effect is of second order and its errors are not
        // normal; where the target is stays known.
        let face_on = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, 1000.0]);
        let sd = normalised_sd(&face_on, LUMBAR, 0.02, 2000);
        assert!(sd[3..].iter().all(|sd| (0.93..1.07).contains(sd)), "{sd:?}");
    }

    #[test]
    fn sigmas_that_promise_too_much_are_not_believed() {
        let mut random = Random::new(8);
        let mut seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
        let honest = solve(&tilted(), &seen, 6).unwrap();
        for seen in &mut seen {
            seen.sigma_px = 0.01;
        }
        let boasting = solve(&tilted(), &seen, 6).unwrap();
        // The observed spread decides: the same answer, as uncertain as before. The
        // honest one is at least as large as predicted, and the soft weights differ
        // by the scale, which is why not exactly.
        let ratio = boasting.sd_mm()[2] / honest.sd_mm()[2];
        assert!((0.8..1.25).contains(&ratio), "{ratio}");
        assert_eq!(boasting.inlier_count(), 30);
        assert!((6.0..15.0).contains(&boasting.scale), "{}", boasting.scale);
        // Sigmas that promise too little make nothing better.
        for seen in &mut seen {
            seen.sigma_px = 1.0;
        }
        let modest = solve(&tilted(), &seen, 6).unwrap();
        assert_eq!(modest.scale, 1.0);
        assert!(modest.sd_mm()[2] > 5.0 * honest.sd_mm()[2]);
    }

    /// Moves the first `count` of the shuffled corners by `size_px`, each its own way.
    fn spoil(seen: &mut Observations, count: usize, size_px: f64, random: &mut Random) {
        for place in (1..seen.len()).rev() {
            seen.swap(place, (random.bits() % (place as u64 + 1)) as usize);
        }
        for seen in &mut seen[..count] {
            let way_px = random.normal2().normalize() * size_px;
            seen.ray += seen.raw_by_ray.try_inverse().unwrap() * way_px;
        }
    }

    /// Largest move of an axis by the wrong corners, in its standard deviations,
    /// against the pose that the right ones give alone.
    fn outlier_influence(shape: [u8; 2], count: usize, size_px: f64) -> f64 {
        let mut random = Random::new(9);
        let mut worst = 0.0_f64;
        for _ in 0..500 {
            let mut seen = observe(&bedside_lens(), &tilted(), shape, 0.1, &mut random);
            spoil(&mut seen, count, size_px, &mut random);
            let start = nearby(&tilted(), &mut random);
            let found = solve(&start, &seen, 10).unwrap();
            let wanted = solve(&start, &seen[count..], 10).unwrap();
            assert_eq!(found.inliers & ((1 << count) - 1), 0, "a wrong corner was believed");
            let moved_mm =
                found.cam_from_target.translation_mm - wanted.cam_from_target.translation_mm;
            for (axis, sd_mm) in wanted.sd_mm().into_iter().enumerate() {
                worst = worst.max(moved_mm[axis].abs() / sd_mm);
            }
        }
        worst
    }

    #[test]
    fn wrong_corners_do_not_move_the_pose() {
        // They have no weight in the end. What is left is that the median, and with it
        // the weights of right corners between 2.4 and 5 scales, differs between n
        // and n + 3 residuals: below one standard deviation in the worst of 500.
        for size_px in [3.0, 30.0] {
            for (shape, count, sds_max) in
                [(LUMBAR, 1, 0.5), (LUMBAR, 3, 0.7), (SHOULDER, 1, 0.9), (SHOULDER, 3, 1.2)]
            {
                let sds = outlier_influence(shape, count, size_px);
                assert!(sds < sds_max, "{shape:?}, {count} by {size_px} px: {sds} SD");
            }
        }
    }

    #[test]
    fn a_wrong_corner_would_move_an_unweighted_fit() {
        // The same corner as above with a sigma that excuses it.
        let mut random = Random::new(9);
        let mut seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
        spoil(&mut seen, 1, 30.0, &mut random);
        let robust = solve(&tilted(), &seen, 10).unwrap();
        for seen in &mut seen {
            seen.sigma_px = 30.0;
        }
        let plain = solve(&tilted(), &seen, 10).unwrap();
        let moved_mm = plain.cam_from_target.translation_mm - robust.cam_from_target.translation_mm;
        assert!(moved_mm.norm() > 5.0, "{moved_mm}");
    }

    #[test]
    fn each_of_a_planes_two_poses_is_a_minimum_of_its_own() {
        let far = Pose::<Cam, Target>::from_theta([0.0, 0.5, 0.3, 300.0, -200.0, 3000.0]);
        let mut random = Random::new(10);
        let seen = observe(&bedside_lens(), &far, LUMBAR, 0.0, &mut random);
        let poses = planar_poses(&seen).unwrap();
        let solutions =
            [0, 1].map(|place| solve(&poses[place].cam_from_target, &seen, 15).unwrap());
        let apart = |a: &Pose<Cam, Target>, b: &Pose<Cam, Target>| {
            vector_from_rotation(&a.rotation.tr_mul(&b.rotation)).norm().to_degrees()
        };
        let [best, second] = solutions.map(|solution| solution.cam_from_target);
        assert!(apart(&best, &far) < 1e-6);
        // Twice the angle between the line of sight and the normal, 26 degrees.
        assert!((45.0..60.0).contains(&apart(&second, &far)), "{}", apart(&second, &far));
        // Further steps stay; and the start was close.
        for (place, solution) in solutions.iter().enumerate() {
            let more = solve(&solution.cam_from_target, &seen, 15).unwrap();
            assert!(apart(&more.cam_from_target, &solution.cam_from_target) < 1e-5);
            assert!(apart(&poses[place].cam_from_target, &solution.cam_from_target) < 0.5);
        }
        // Both look alike: what tells them apart is less than a tenth of a pixel.
        assert!(solutions[0].rms_px < 1e-6);
        assert!((0.05..0.1).contains(&solutions[1].rms_px), "{}", solutions[1].rms_px);
    }

    #[test]
    fn what_cannot_be_solved_has_a_reason() {
        let mut random = Random::new(12);
        let good = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
        let refused = |start: &Pose<Cam, Target>, seen: &[Observation]| {
            solve(start, seen, 10).map(|_| ()).unwrap_err()
        };
        assert_eq!(refused(&tilted(), &[]), SolveFailure::TooFewPoints);
        assert_eq!(refused(&tilted(), &good[..3]), SolveFailure::TooFewPoints);
        // One row of corners: the target may turn about it.
        assert_eq!(refused(&tilted(), &good[..6]), SolveFailure::Degenerate);
        let same = [good[0]; 8];
        assert_eq!(refused(&tilted(), &same), SolveFailure::Degenerate);

        let mut behind = tilted();
        behind.translation_mm.z = -1000.0;
        assert_eq!(refused(&behind, &good), SolveFailure::BehindCamera);
        let mut nowhere = tilted();
        nowhere.translation_mm.x = f64::NAN;
        assert_eq!(refused(&nowhere, &good), SolveFailure::NotFinite);
        let spoilt = |spoil: fn(&mut Observation)| {
            let mut seen = good.clone();
            spoil(&mut seen[7]);
            refused(&tilted(), &seen)
        };
        assert_eq!(spoilt(|seen| seen.ray.y = f64::NAN), SolveFailure::NotFinite);
        assert_eq!(spoilt(|seen| seen.point_target_mm.z = f64::INFINITY), SolveFailure::NotFinite);
        assert_eq!(spoilt(|seen| seen.raw_by_ray[(0, 1)] = f64::NAN), SolveFailure::NotFinite);
        assert_eq!(spoilt(|seen| seen.sigma_px = 0.0), SolveFailure::NotFinite);
        assert_eq!(spoilt(|seen| seen.sigma_px = f64::NAN), SolveFailure::NotFinite);
    }

    #[test]
    fn absurd_but_finite_numbers_give_a_result_or_a_reason() {
        let mut random = Random::new(13);
        let good = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
        let huge = [1e-300, 1e-30, 1e30, 1e150, 1e300];
        for _ in 0..2000 {
            let mut seen = good.clone();
            let mut start = tilted();
            for _ in 0..1 + random.bits() % 40 {
                let value = huge[(random.bits() % 5) as usize];
                let place = (random.bits() % 30) as usize;
                match random.bits() % 5 {
                    0 => seen[place].ray.x = value,
                    1 => seen[place].raw_by_ray[(1, 0)] = value,
                    2 => seen[place].sigma_px = value,
                    3 => seen[place].point_target_mm.y = value,
                    _ => start.translation_mm.z = value,
                }
            }
            if let Ok(solution) = solve(&start, &seen, 6) {
                assert!(solution.covariance.iter().all(|value| value.is_finite()));
                assert!(solution.cam_from_target.rotation.iter().all(|value| value.is_finite()));
                assert!(
                    solution.rms_px.is_finite() && solution.sd_mm().iter().all(|sd| *sd >= 0.0)
                );
            }
        }
    }

    #[test]
    fn a_pose_followed_for_hours_stays_a_rotation() {
        let mut random = Random::new(14);
        let seen = observe(&bedside_lens(), &tilted(), SHOULDER, 0.1, &mut random);
        // What many products would leave behind.
        let mut pose = tilted();
        pose.rotation *= 1.0 + 1e-5;
        pose.rotation[(0, 1)] += 1e-5;
        for _ in 0..3 {
            pose = solve(&pose, &seen, 3).unwrap().cam_from_target;
        }
        let gram = pose.rotation.tr_mul(&pose.rotation);
        assert!((gram - Matrix3::identity()).norm() < 1e-14);
    }
}
