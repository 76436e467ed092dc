//! The pose of a target from what was seen of it: robust Levenberg-Marquardt on (t, R).
//!
//! In: a pose to start from and the [`Observations`]: edges ([`crate::fit::edge::SeenEdges`]) or
//! corners ([`crate::fit::planar::SeenCorner`]). Out: the pose that minimises the paper's sum of
//! squared reprojection errors (section "Kinematic Model Fitting"), each weighted by its precision,
//! with a covariance and the observations that were accepted.
//!
//! *Steps* turn the target about its own origin and move that origin, see [`Pose::moved_by`]. A
//! step that does not lower the cost is undone and its damping raised. The iteration ends when a
//! step would be too short to matter. The caller bounds the number of steps, and so the time.
//!
//! *Robust weights* are Tukey's biweight with a flat top: 1 for residuals up to 2.4 scales, 0
//! beyond 5, so that a wrong observation has no influence at all, and correct ones almost always
//! have their full weight (which keeps the covariance honest). The scale comes from the residuals'
//! median, or is what the observations promise where that is more; it is computed again after every
//! accepted step, so that a distant start, which makes all residuals large, rejects nothing. After
//! some iterations it may only fall: the cost would otherwise change with the scale, and the steps
//! could go to and fro for ever. Fewer than half of the observations may be wrong.
//!
//! *Covariance* is the inverse of the weighted normal equations, times a factor where the observed
//! variance of the residuals differs from the predicted one by more than chance explains. A larger
//! variance shows errors that the observations do not account for (a bent target, a poor
//! calibration), and the result is less certain. A smaller one shows observations that are better
//! than they promise: after lossy compression the errors of neighbouring pixels have opposite signs
//! and partly cancel. The result is then more certain, but only up to a bound, because residuals
//! cannot show an error that is common to all observations.

use heapless::Vec;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::common::statistics::{median, order_of_positive};
use crate::limits::OBSERVATIONS_MAX;
use crate::model::pose::{Cam, Pose, Target};

/// Three observations of two numbers each determine a pose, but leave nothing by which to recognise
/// a wrong one.
pub const OBSERVATIONS_MIN: usize = 4;

/// Square of the residual, in scales, up to which an observation has full weight: 95 % of correct
/// ones lie below (the square of a 2-D normal's length is exponential with mean 2).
const FULL_WEIGHT_SQUARE: f64 = 6.0;

/// Square of the residual, in scales, from which an observation has no weight: 4 correct ones in a
/// million lie beyond.
const NO_WEIGHT_SQUARE: f64 = 25.0;

/// Median of the squared length of a 2-D normal: 2 ln 2.
const MEDIAN_SQUARE: f64 = 2.0 * core::f64::consts::LN_2;

/// First damping, as a share of the normal equations' diagonal: small enough for a
/// warm start to converge as fast as Gauss and Newton's method.
const DAMPING_START: f64 = 1e-4;
/// An accepted step divides the damping by this, a rejected one multiplies it.
const DAMPING_FACTOR: f64 = 10.0;
/// Bounds within which the damping has an effect.
const DAMPING_MIN: f64 = 1e-12;
const DAMPING_MAX: f64 = 1e6;

/// Smallest pivot of the normal equations, scaled to a diagonal of ones, for which the observations
/// determine the pose. Rounding leaves 1e-16 for a singular system; a 10 mm target at 10 m has
/// 1e-7.
const PIVOT_MIN: f64 = 1e-11;

/// The first iterations, which use whatever scale follows from the residuals; in later ones it may only
/// fall. A lower scale lowers the cost of every pose: every later step then lowers the cost, and none
/// leads back.
const FREE_SCALE_ITERATIONS: usize = 10;

/// Squared length, in standard deviations of the pose, below which a step is not taken: a
/// ten-thousandth of one standard deviation.
const STEP_SQUARE_MIN: f64 = 1e-8;

/// Squared length, in standard deviations of the pose, of a step so short that the normal equations
/// before it give the covariance after it: one standard deviation changes the lines of sight, and so
/// the derivatives, by some hundred-thousandths, and an edge's residual by a small part of its own
/// standard deviation, and so its robust weight by little.
const SHORT_STEP_SQUARE: f64 = 1.0;

/// Smallest observed variance, relative to the predicted one, that is believed. Lossy compression
/// makes residuals smaller; but errors common to all observations do not show in them, and small
/// residuals do not prove that there are none.
const MISFIT_MIN: f64 = 0.5;

/// Everything that was seen of the target: observations of two numbers each, which depend on its
/// pose.
///
/// Residuals are whitened: independent numbers of standard deviation 1, which are 0 on average at
/// the true pose. Observations are identified by their places, from 0.
pub trait Observations {
    /// How many there are.
    fn count(&self) -> usize;

    /// True when every number is finite and the standard deviations positive.
    fn are_finite(&self) -> bool;

    /// Visits each residual at a pose; `None` when a point would lie behind the camera.
    fn residuals(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        visit: impl FnMut(usize, [f64; 2]),
    ) -> Option<()>;

    /// Visits each residual, and the gradients of its numbers with respect to a motion of the target:
    /// a turn about its origin and a displacement, both along the camera's axes.
    fn residuals_with_jacobian(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        visit: impl FnMut(usize, &[f64; 2], &[[f64; 6]; 2]),
    ) -> Option<()>;
}

/// The gradient of a quantity with respect to a motion of the target: a turn about the target's
/// origin and a displacement, both along the camera's axes. `by_point` is the quantity's gradient
/// with respect to a point in the camera frame, and `arm_cam_mm` leads from the target's origin to
/// that point.
#[inline]
pub(crate) fn by_motion(by_point: &Vector3<f64>, arm_cam_mm: &Vector3<f64>) -> [f64; 6] {
    // a . (omega x r) = omega . (r x a).
    let turned = arm_cam_mm.cross(by_point);
    [turned.x, turned.y, turned.z, by_point.x, by_point.y, by_point.z]
}

/// Why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolveFailure {
    /// Fewer than 4 observations, or fewer than 4 without the wrong ones.
    TooFew,
    /// The observations leave a direction of the pose undetermined.
    Degenerate,
    /// A number that came in is not finite, or a standard deviation not positive.
    NotFinite,
    /// The start puts a point behind the camera.
    BehindCamera,
}

impl core::fmt::Display for SolveFailure {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::TooFew => "fewer than 4 usable observations",
            Self::Degenerate => "the observations do not fix the pose",
            Self::NotFinite => "a number is not finite, or a standard deviation is not positive",
            Self::BehindCamera => "a point would lie behind the camera",
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
    /// The observations that have weight.
    pub inliers: Inliers,
    /// The robust scale: 1 when the residuals are what the observations promise, more
    /// when they are larger.
    pub scale: f64,
    /// The robust cost at that scale, by which the poses of one set of
    /// observations are compared.
    pub cost: f64,
}

/// A set of observations, by their places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inliers([u32; OBSERVATIONS_MAX.div_ceil(32)]);

impl Default for Inliers {
    fn default() -> Self {
        Self::new()
    }
}

impl Inliers {
    /// The empty set.
    #[must_use]
    pub const fn new() -> Self {
        Self([0; OBSERVATIONS_MAX.div_ceil(32)])
    }

    /// Whether the set contains the observation at a place.
    #[must_use]
    pub fn contains(&self, place: usize) -> bool {
        self.0.get(place / 32).is_some_and(|word| word >> (place % 32) & 1 == 1)
    }

    /// How many there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    fn insert(&mut self, place: usize) {
        self.0[place / 32] |= 1 << (place % 32);
    }
}

/// Refines a pose with a bounded number of iterations. The closed form needs 15, because the
/// residuals of its second pose slow the convergence; from a pose good to a pixel 2 are enough for
/// edges, and 4 to 6 for corners, of which some may be wrong.
///
/// # Errors
/// [`SolveFailure`].
///
/// # Panics
/// When there are more than [`OBSERVATIONS_MAX`]: a caller's bug.
pub fn solve<O: Observations + ?Sized>(
    start: &Pose<Cam, Target>,
    observations: &O,
    iterations: usize,
) -> Result<Solution, SolveFailure> {
    let mut descent = Descent::new(start);
    descent.take_steps(observations, iterations)?;
    descent.conclude(observations)
}

/// The robust cost after one step from a start, at a given scale; `None` when there is none.
///
/// That is enough to see that a start is not worth following, at a fraction of the cost of a
/// solution.
#[must_use]
pub fn robust_cost_after_step<O: Observations + ?Sized>(
    start: &Pose<Cam, Target>,
    observations: &O,
    scale: f64,
) -> Option<f64> {
    let variance = scale * scale;
    let mut descent = Descent::new(start);
    descent.take_steps(observations, 1).ok()?;
    Some(descent.squares.cost(variance) / variance)
}

/// The robust cost of a pose at a given scale: the sum of the squared residuals, in scales, with
/// those of wrong observations capped. `None` when a point lies behind the camera.
///
/// Poses of one set of observations are compared by it; the difference of two costs
/// is twice the logarithm of their likelihood ratio.
#[must_use]
pub fn robust_cost<O: Observations + ?Sized>(
    cam_from_target: &Pose<Cam, Target>,
    observations: &O,
    scale: f64,
) -> Option<f64> {
    let per_variance = 1.0 / (scale * scale);
    let mut cost = 0.0;
    observations.residuals(cam_from_target, |_, residual| {
        cost += robust_square(square(&residual) * per_variance);
    })?;
    Some(cost)
}

/// A descent from a start.
struct Descent {
    pose: Pose<Cam, Target>,
    squares: Squares,
    /// The normal equations at the pose, or a short step before it, where they have been computed.
    normal: Option<NormalEquations>,
}

impl Descent {
    fn new(start: &Pose<Cam, Target>) -> Self {
        Self { pose: *start, squares: Squares::new(), normal: None }
    }

    /// Takes at most this many steps.
    fn take_steps<O: Observations + ?Sized>(
        &mut self,
        observations: &O,
        iterations: usize,
    ) -> Result<(), SolveFailure> {
        let count = observations.count();
        assert!(count <= OBSERVATIONS_MAX, "{count} observations");
        if count < OBSERVATIONS_MIN {
            return Err(SolveFailure::TooFew);
        }
        let Self { pose, squares, normal } = self;
        let sums = [pose.rotation.sum(), pose.translation_mm.sum()];
        if !sums.into_iter().all(f64::is_finite) || !observations.are_finite() {
            return Err(SolveFailure::NotFinite);
        }

        squares.measure(pose, observations).ok_or(SolveFailure::BehindCamera)?;
        let mut next_squares = Squares::new();
        let mut damping = DAMPING_START;
        let mut has_stepped = false;
        let mut variance = f64::INFINITY;
        for iteration in 0..iterations {
            if has_stepped {
                *normal = None;
                has_stepped = false;
            }
            // The same scale is used before and after a step; the next step has its own.
            let own = squares.robust_variance();
            variance = if iteration < FREE_SCALE_ITERATIONS { own } else { own.min(variance) };
            // A rejected step changes only the damping.
            let current =
                normal.get_or_insert_with(|| NormalEquations::new(pose, observations, variance));
            let step = current.step(damping);
            let step_square = step.map_or(f64::INFINITY, |step| current.square(&step) / variance);
            if step_square < STEP_SQUARE_MIN {
                break;
            }
            let next_pose = step.map(|step| pose.moved_by(&step));
            let lower = next_pose.filter(|next_pose| {
                let seen = next_squares.measure(next_pose, observations);
                // A NaN is not lower.
                seen.is_some() && next_squares.cost(variance) < squares.cost(variance)
            });
            if let Some(next_pose) = lower {
                *pose = next_pose;
                squares.copy_from(&next_squares);
                has_stepped = true;
                if step_square >= SHORT_STEP_SQUARE {
                    *normal = None;
                }
                damping = (damping / DAMPING_FACTOR).max(DAMPING_MIN);
            } else {
                damping = (damping * DAMPING_FACTOR).min(DAMPING_MAX);
            }
        }
        Ok(())
    }

    /// The solution at the pose that was reached.
    fn conclude<O: Observations + ?Sized>(
        &self,
        observations: &O,
    ) -> Result<Solution, SolveFailure> {
        let Self { mut pose, ref squares, ref normal } = *self;
        // A product of many frames' increments drifts away from SO(3): one Newton
        // step of the polar decomposition.
        let gram = pose.rotation.tr_mul(&pose.rotation);
        pose.rotation *= (Matrix3::identity() * 3.0 - gram) * 0.5;
        let variance = squares.robust_variance();
        let covariance = match normal {
            Some(normal) => normal.inverse(),
            None => NormalEquations::new(&pose, observations, variance).inverse(),
        };
        let per_variance = 1.0 / variance;
        let mut inliers = Inliers::new();
        let [mut weights, mut weighted_squares] = [0.0; 2];
        for (place, square) in squares.0.iter().enumerate() {
            let weight = weight(square * per_variance);
            weights += weight;
            weighted_squares += weight * square;
            if weight > 0.0 {
                inliers.insert(place);
            }
        }
        if inliers.count() < OBSERVATIONS_MIN {
            return Err(SolveFailure::TooFew);
        }
        // Two numbers each, less the six that were fitted. With soft weights the
        // divisor could fall below that of the fewest observations.
        let degrees_of_freedom = (2.0 * weights - 6.0).max(1.0);
        let observed_variance = weighted_squares / degrees_of_freedom;
        // The value nearest to 1 within the standard deviation that it has by chance.
        let by_chance = libm::sqrt(2.0 / degrees_of_freedom);
        let [least, most] = [observed_variance - by_chance, observed_variance + by_chance];
        let misfit = 1.0_f64.max(least).min(most).max(MISFIT_MIN);
        let covariance = covariance.ok_or(SolveFailure::Degenerate)? * misfit;
        let sums = [covariance.sum(), pose.rotation.sum(), pose.translation_mm.sum()];
        // The input was finite, so that only a nearly singular system overflows.
        if !sums.into_iter().all(f64::is_finite) {
            return Err(SolveFailure::Degenerate);
        }
        let scale = libm::sqrt(variance);
        let cost = squares.cost(variance) * per_variance;
        Ok(Solution { cam_from_target: pose, covariance, inliers, scale, cost })
    }
}

#[inline]
fn square(residual: &[f64; 2]) -> f64 {
    residual[0] * residual[0] + residual[1] * residual[1]
}

/// Weight of an observation by the square of its residual in scales.
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

/// The squared length of each observation's residual.
struct Squares(Vec<f64, OBSERVATIONS_MAX>);

impl Squares {
    const fn new() -> Self {
        Self(Vec::new())
    }

    /// Copies only the numbers in use; a swap would move the whole capacity.
    fn copy_from(&mut self, other: &Self) {
        self.0.clear();
        // The capacity is the same.
        let _ = self.0.extend_from_slice(&other.0);
    }

    /// Computes them at a pose; `None` when a point lies behind the camera.
    fn measure<O: Observations + ?Sized>(
        &mut self,
        pose: &Pose<Cam, Target>,
        observations: &O,
    ) -> Option<()> {
        self.0.clear();
        observations.residuals(pose, |_, residual| {
            // There are no more than there is room for.
            let _ = self.0.push(square(&residual));
        })
    }

    /// The variance that follows from the squares' median, relative to the promised one, and not
    /// less than 1. The fit has made the residuals smaller than the noise; dividing by the share of
    /// the degrees of freedom that is left makes up for that.
    fn robust_variance(&self) -> f64 {
        let mut sorted: Vec<f64, OBSERVATIONS_MAX> = self.0.iter().copied().collect();
        let count = sorted.len() as f64;
        // There are more than three: see `OBSERVATIONS_MIN`.
        let median = median(&mut sorted, order_of_positive).unwrap_or(0.0);
        (median / MEDIAN_SQUARE * count / (count - 3.0)).max(1.0)
    }

    fn cost(&self, variance: f64) -> f64 {
        let per_variance = 1.0 / variance;
        self.0.iter().map(|square| robust_square(square * per_variance)).sum::<f64>() * variance
    }
}

/// Weighted normal equations `matrix * step = -gradient`, for an increment of [`Pose::moved_by`].
struct NormalEquations {
    matrix: Matrix6<f64>,
    gradient: Vector6<f64>,
}

impl NormalEquations {
    /// At a pose that has every point in front of the camera.
    fn new<O: Observations + ?Sized>(
        pose: &Pose<Cam, Target>,
        observations: &O,
        variance: f64,
    ) -> Self {
        let per_variance = 1.0 / variance;
        let mut sums = Sums { matrix: [[0.0; 6]; 6], gradient: [0.0; 6] };
        let seen = observations.residuals_with_jacobian(pose, |_, residual, rows| {
            sums.add(residual, rows, weight(square(residual) * per_variance));
        });
        debug_assert!(seen.is_some(), "a point lies behind the camera");
        sums.about_target_axes(&pose.rotation)
    }

    /// The step under Marquardt's damping, `None` when the system is singular.
    fn step(&self, damping: f64) -> Option<Vector6<f64>> {
        let mut matrix = self.matrix;
        for axis in 0..6 {
            matrix[(axis, axis)] *= 1.0 + damping;
        }
        let step = matrix.cholesky()?.solve(&-self.gradient);
        step.sum().is_finite().then_some(step)
    }

    /// The square of a step's length, in standard deviations of the pose, times the variance of
    /// the residuals.
    fn square(&self, step: &Vector6<f64>) -> f64 {
        step.dot(&(self.matrix * step))
    }

    /// The inverse, `None` when the system is nearly singular. It is first scaled to a diagonal of
    /// ones, since radians and millimetres have no common scale.
    fn inverse(&self) -> Option<Matrix6<f64>> {
        let matrix = &self.matrix;
        let scale = matrix.diagonal().map(|value| 1.0 / libm::sqrt(value));
        let scaled = Matrix6::from_fn(|i, j| matrix[(i, j)] * scale[i] * scale[j]);
        let cholesky = scaled.cholesky()?;
        // The factor's diagonal holds the square roots of the pivots, which are positive.
        let pivot = cholesky.l_dirty().diagonal().min();
        if pivot * pivot < PIVOT_MIN {
            return None;
        }
        let inverse = cholesky.inverse();
        Some(Matrix6::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]))
    }
}

/// The sums of the normal equations, with respect to the motions of [`by_motion`].
struct Sums {
    /// Upper triangle, and some of the elements below it.
    matrix: [[f64; 6]; 6],
    gradient: [f64; 6],
}

impl Sums {
    /// Never inlined: where a row comes from memory, its elements are processed in pairs, in their
    /// order; the compiler would otherwise pair them up differently, at twice the cost.
    #[inline(never)]
    fn add(&mut self, residual: &[f64; 2], rows: &[[f64; 6]; 2], weight: f64) {
        let [first, second] = rows;
        for i in 0..6 {
            let (weighted_first, weighted_second) = (weight * first[i], weight * second[i]);
            // From an even column on: two elements fill a register.
            for j in i / 2 * 2..6 {
                self.matrix[i][j] += weighted_first * first[j] + weighted_second * second[j];
            }
            self.gradient[i] += weighted_first * residual[0] + weighted_second * residual[1];
        }
    }

    /// The normal equations for an increment, which turns about the target's axes: omega of a motion
    /// is `rotation` times that of the increment.
    fn about_target_axes(&self, rotation: &Matrix3<f64>) -> NormalEquations {
        let sums = &self.matrix;
        let mut matrix = Matrix6::from_fn(|i, j| if i <= j { sums[i][j] } else { sums[j][i] });
        let turned = rotation.tr_mul(&matrix.fixed_rows::<3>(0));
        matrix.fixed_rows_mut::<3>(0).copy_from(&turned);
        let turned = matrix.fixed_columns::<3>(0) * rotation;
        matrix.fixed_columns_mut::<3>(0).copy_from(&turned);
        let mut gradient = Vector6::from(self.gradient);
        let turned = rotation.tr_mul(&gradient.fixed_rows::<3>(0));
        gradient.fixed_rows_mut::<3>(0).copy_from(&turned);
        NormalEquations { matrix, gradient }
    }
}

#[cfg(test)]
mod tests;
