//! The default: a blurred corner fitted to the raw pixels.
//!
//! # Model
//!
//! An ideal corner is sign(d0) sign(d1), with d0 and d1 the signed distances to
//! its two edges. Seen through a Gaussian blur of standard deviation s, with
//! a = d0 / s and b = d1 / s, it is an orthant probability of the bivariate
//! normal distribution whose correlation is the cosine of the angle between the
//! edges, rho = sin(Theta). By Plackett (1954), with E(x) = erf(x / sqrt 2):
//!
//! ```text
//! f(a, b) = E(a) E(b) + 2/pi ∫_0^Theta exp(-(a² + b² - 2ab sin t) / (2 cos² t)) dt
//! I       = offset + half_contrast * f
//! ```
//!
//! The product alone is exact for edges at right angles; the integral, by two
//! Gauss-Legendre nodes (error of f below 2e-4 for edges 53 degrees apart),
//! makes it so for a tilted target's. The pixel's own box is part of s: its
//! variance, 1/12 px², is the same in every direction.
//!
//! # Fit
//!
//! Seven parameters: position, the two edge angles, ln s, half contrast and
//! offset, by Levenberg-Marquardt. The last two enter linearly, so that each
//! evaluation regresses the pixels themselves on (f and 1) and on the
//! derivatives of f by the other five: their values come out directly and need
//! no start. The derivatives are those of the formula as implemented, quadrature
//! included, and cost no further exponential.
//!
//! # Precision
//!
//! The pixels' noise, from the residual, gives the position's covariance through
//! the normal equations, which is also the Cramer-Rao bound.

use nalgebra::{SMatrix, SVector};

use super::RefineFailure;
use super::fast_math::{SLOPE_AT_ZERO, exp, normal_between};
use super::patch::{CHUNKS_MAX, Coordinates, LANES, Lanes, Patch};

/// Evaluations of the model at most; from the saddle and true edges two, from
/// edges 15 degrees off four.
const EVALUATIONS_MAX: usize = 7;

/// A step that moves the corner less than this is the last: the steps shrink by
/// ten and more each, so that what is left is below a thousandth of a pixel.
const LAST_STEP_PX: f32 = 0.01;
/// The same for the edges, rad, and for ln s.
const LAST_TURN_RAD: f32 = 0.03;
const LAST_LN_BLUR: f32 = 0.1;
/// So is one that promises to lower the sum of squares by less than this many
/// times the pixels' variance: it is a step of less than a third of the standard
/// deviation in whichever direction it goes, and what is left after it is far less.
const LAST_GAIN: f64 = 0.1;

/// One step's bounds: the model is far from linear beyond them.
const STEP_PX_MAX: f32 = 1.0;
const STEP_RAD_MAX: f32 = 0.25;
const STEP_LN_BLUR_MAX: f32 = 0.5;

/// The blur fitted, box included. Below the first the samples cannot tell: only
/// pictures sharpened by the camera ask for less, and get the first. Above the
/// second the corner is out of focus beyond use.
const BLUR_PX_MIN: f32 = 0.45;
const BLUR_PX_MAX: f32 = 3.0;
/// The first guess: a good lens in focus and the pixel's box.
const BLUR_PX_START: f32 = 0.85;

/// Farthest the fit may end from the window's middle, px: the middle is the
/// saddle, rounded.
const OFFSET_PX_MAX: f32 = 1.75;

/// Farthest the fit may turn an edge away from the seed, rad.
const TURN_RAD_MAX: f32 = 0.6;

/// Structure allowed in the residual, root mean square as a part of the half
/// contrast. Photographs sharpened by the camera give up to 0.07.
const STRUCTURE_MAX: f32 = 0.1;
/// Structure allowed in the residual's odd part; those photographs give 0.02 in
/// 99 of 100 corners.
const ODD_STRUCTURE_MAX: f32 = 0.05;
/// Neighbours in white noise correlate by chance: their mean correlation stays
/// below this in the smallest window (49 pixels, three standard deviations).
const CHANCE_CORRELATION: f32 = 0.43;

/// Angle between the edges at least, as a sine.
pub(super) const EDGES_SINE_MIN: f32 = 0.34;

/// Columns of the regression: derivatives by the two edges' shifts (in units of
/// s), by the two edges' angles, by ln s; f itself; 1.
const COLUMNS: usize = 7;
const NONLINEAR: usize = 5;
const LN_BLUR: usize = 4;
const PROFILE: usize = 5;
const ONE: usize = 6;

type Normal = SMatrix<f64, COLUMNS, COLUMNS>;
type Coefficients = SVector<f64, COLUMNS>;

/// The parameters that enter non-linearly; the position is relative to the
/// window's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    pub(super) offset_px: [f32; 2],
    /// The second within (0, pi) above the first; the sector between is dark.
    pub(super) edges_rad: [f32; 2],
    /// Blur and pixel box together.
    pub(super) blur_px: f32,
}

/// A fitted corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fitted {
    pub(super) shape: Shape,
    pub(super) half_contrast: f32,
    pub(super) sigma_px: f32,
    /// Evaluations of the model.
    #[cfg_attr(not(test), expect(dead_code, reason = "the tests bound it"))]
    pub(super) evaluations: usize,
}

/// f and its derivatives over a window.
struct Design {
    columns: [[Lanes; CHUNKS_MAX]; COLUMNS],
}

impl Design {
    const fn new() -> Self {
        Self { columns: [[[0.0; LANES]; CHUNKS_MAX]; COLUMNS] }
    }

    /// Fills the columns for a window of `count` pixels.
    fn evaluate(&mut self, coordinates: &Coordinates, count: usize, shape: &Shape) {
        let profile = Profile::new(shape);
        let chunks = count.div_ceil(LANES);
        let [shift0, shift1, turn0, turn1, ln_blur, value, one] = &mut self.columns;
        for chunk in 0..chunks {
            let (x, y) = (&coordinates.x[chunk], &coordinates.y[chunk]);
            for lane in 0..LANES {
                let point = profile.at(x[lane], y[lane]);
                shift0[chunk][lane] = point[0];
                shift1[chunk][lane] = point[1];
                turn0[chunk][lane] = point[2];
                turn1[chunk][lane] = point[3];
                ln_blur[chunk][lane] = point[4];
                value[chunk][lane] = point[PROFILE];
                one[chunk][lane] = 1.0;
            }
        }
        // What lies past the last pixel takes no part.
        for column in &mut self.columns {
            for value in &mut column.as_flattened_mut()[count..chunks * LANES] {
                *value = 0.0;
            }
        }
    }

    /// Inner products of all columns with each other and with the pixels.
    fn normal_equations(&self, patch: &Patch) -> (Normal, Coefficients) {
        let mut normal = Normal::zeros();
        let mut right = Coefficients::zeros();
        let chunks = patch.chunks();
        for row in 0..COLUMNS {
            for column in row..COLUMNS {
                let product = inner_product(&self.columns[row], &self.columns[column], chunks);
                normal[(row, column)] = product;
                normal[(column, row)] = product;
            }
            right[row] = inner_product(&self.columns[row], &patch.value, chunks);
        }
        (normal, right)
    }

    /// The part of the pixels that the columns do not explain, and the structure in it.
    fn residual(
        &self,
        patch: &Patch,
        coefficients: &Coefficients,
        offset_px: [f32; 2],
    ) -> Residual {
        let weights: [f32; COLUMNS] = coefficients.map(|value| value as f32).into();
        let mut left = [[0.0_f32; LANES]; CHUNKS_MAX];
        for chunk in 0..patch.chunks().min(CHUNKS_MAX) {
            let mut rest = patch.value[chunk];
            for (weight, column) in weights.iter().zip(&self.columns) {
                for lane in 0..LANES {
                    rest[lane] -= weight * column[chunk][lane];
                }
            }
            left[chunk] = rest;
        }
        let left = &left.as_flattened()[..patch.count()];
        let squares: f32 = left.iter().map(|value| value * value).sum();

        // Opposite pixels, as seen from the corner to the nearest half pixel.
        let (radius, side) = (patch.radius as isize, patch.side() as isize);
        let [column_sum, row_sum] =
            offset_px.map(|offset_px| 2 * radius + libm::roundf(2.0 * offset_px) as isize);
        let mut odd = [0.0_f32; LANES * CHUNKS_MAX];
        for row in 0..side {
            let opposite_row = row_sum - row;
            if !(0..side).contains(&opposite_row) {
                continue;
            }
            for column in 0..side {
                let opposite_column = column_sum - column;
                if (0..side).contains(&opposite_column) {
                    let index = (row * side + column) as usize;
                    let opposite = (opposite_row * side + opposite_column) as usize;
                    odd[index] = 0.5 * (left[index] - left[opposite]);
                }
            }
        }
        let count = patch.count() as f32;
        Residual {
            variance: squares / (count - COLUMNS as f32),
            structure: structure(left, patch.side()),
            odd_structure: structure(&odd[..patch.count()], patch.side()),
        }
    }
}

/// Mean product of neighbours beyond what chance explains: 0 for white noise,
/// near the mean square for anything with a shape.
fn structure(values: &[f32], side: usize) -> f32 {
    // The few products from one row's end to the next row's start do no harm.
    let beside: f32 = values.iter().zip(&values[1..]).map(|(a, b)| a * b).sum();
    let below: f32 = values.iter().zip(&values[side..]).map(|(a, b)| a * b).sum();
    let squares: f32 = values.iter().map(|value| value * value).sum();
    (0.5 * (beside + below) - CHANCE_CORRELATION * squares).max(0.0) / values.len() as f32
}

/// What is left of the pixels after the fit, grey levels squared.
struct Residual {
    variance: f32,
    /// That of it which has a shape.
    structure: f32,
    /// The same of its odd part: half the difference of opposite pixels. What the
    /// camera does to every corner (sharpening, an imperfect blur model) is even
    /// and does not move the corner; what covers one side is odd as well, and does.
    odd_structure: f32,
}

/// One pair at a time: with several sums side by side the compiler shuffles them
/// among the lanes, three times the instructions.
fn inner_product(a: &[Lanes; CHUNKS_MAX], b: &[Lanes; CHUNKS_MAX], chunks: usize) -> f64 {
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a[..chunks].iter().zip(&b[..chunks]) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().map(|&value| f64::from(value)).sum()
}

/// The model's constants for one shape.
struct Profile {
    offset_px: [f32; 2],
    /// Directions of the two edges over s.
    along: [[f32; 2]; 2],
    theta_rad: f32,
    nodes: [Node; 2],
}

/// A node of the integral over the angle.
#[derive(Clone, Copy)]
struct Node {
    sine: f32,
    /// 1 / cos
    inverse_cosine: f32,
    /// 1 / cos^2
    inverse_square: f32,
    /// Of the integral: 2/pi Theta times the quadrature's weight.
    weight: f32,
    /// Theta times the quadrature's abscissa: how far the node goes with Theta.
    angle_rad: f32,
}

impl Profile {
    fn new(shape: &Shape) -> Self {
        use core::f32::consts::{FRAC_2_PI, FRAC_PI_2};
        let theta_rad = FRAC_PI_2 - (shape.edges_rad[1] - shape.edges_rad[0]);
        let along = shape.edges_rad.map(|edge_rad| {
            let (sine, cosine) = libm::sincosf(edge_rad);
            [cosine / shape.blur_px, sine / shape.blur_px]
        });
        // Gauss-Legendre on [0, 1]: 1/2 -+ 1/sqrt 12, weights 1/2.
        let nodes = [0.211_324_87, 0.788_675_1].map(|abscissa: f32| {
            let angle_rad = theta_rad * abscissa;
            let (sine, cosine) = libm::sincosf(angle_rad);
            Node {
                sine,
                inverse_cosine: 1.0 / cosine,
                inverse_square: 1.0 / (cosine * cosine),
                weight: FRAC_2_PI * 0.5,
                angle_rad,
            }
        });
        Self { offset_px: shape.offset_px, along, theta_rad, nodes }
    }

    /// The derivatives in the columns' order, and f, at one pixel.
    #[inline(always)]
    fn at(&self, x: f32, y: f32) -> [f32; 6] {
        let (x, y) = (x - self.offset_px[0], y - self.offset_px[1]);
        let [[c0, s0], [c1, s1]] = self.along;
        let (a, b) = (c0 * y - s0 * x, c1 * y - s1 * x);
        let (along0, along1) = (c0 * x + s0 * y, c1 * x + s1 * y);
        let (across0, density0) = normal_between(a);
        let (across1, density1) = normal_between(b);
        let mut value = across0 * across1;
        let mut by_a = SLOPE_AT_ZERO * density0 * across1;
        let mut by_b = SLOPE_AT_ZERO * density1 * across0;
        let mut by_theta = 0.0;
        let product = a * b;
        let squares = a * a + b * b;
        for node in &self.nodes {
            let exponent = (product * node.sine - 0.5 * squares) * node.inverse_square;
            let height = node.weight * exp(exponent);
            let part = self.theta_rad * height;
            value += part;
            by_a += part * (b * node.sine - a) * node.inverse_square;
            by_b += part * (a * node.sine - b) * node.inverse_square;
            let growth = (product + 2.0 * exponent * node.sine) * node.inverse_cosine;
            by_theta += height * (1.0 + node.angle_rad * growth);
        }
        [
            by_a,
            by_b,
            by_theta - by_a * along0,
            -by_theta - by_b * along1,
            -(by_a * a + by_b * b),
            value,
        ]
    }
}

impl Shape {
    /// Moved by one step: shifts of the edges in units of s, turns, ln s.
    fn stepped(&self, step: [f32; NONLINEAR]) -> Self {
        let [shift0, shift1, turn0, turn1, ln_blur] = step;
        let [x, y] = self.moved_by_shifts([shift0, shift1]);
        // Scaled as a whole, so that the direction stays.
        let length = libm::sqrtf(x * x + y * y);
        let scale = if length > STEP_PX_MAX { STEP_PX_MAX / length } else { 1.0 };
        let turn = |turn_rad: f32| turn_rad.clamp(-STEP_RAD_MAX, STEP_RAD_MAX);
        let blur = libm::expf(ln_blur.clamp(-STEP_LN_BLUR_MAX, STEP_LN_BLUR_MAX));
        Self {
            offset_px: [self.offset_px[0] + scale * x, self.offset_px[1] + scale * y],
            edges_rad: [self.edges_rad[0] + turn(turn0), self.edges_rad[1] + turn(turn1)],
            blur_px: (self.blur_px * blur).clamp(BLUR_PX_MIN, BLUR_PX_MAX),
        }
    }

    /// The move of the crossing that adds `shifts` to a and b.
    fn moved_by_shifts(&self, shifts: [f32; 2]) -> [f32; 2] {
        let [[n0x, n0y], [n1x, n1y]] = self.normals();
        let determinant = n0x * n1y - n0y * n1x;
        let scale = -self.blur_px / determinant;
        [scale * (n1y * shifts[0] - n0y * shifts[1]), scale * (n0x * shifts[1] - n1x * shifts[0])]
    }

    fn normals(&self) -> [[f32; 2]; 2] {
        self.edges_rad.map(|edge_rad| {
            let (sine, cosine) = libm::sincosf(edge_rad);
            [-sine, cosine]
        })
    }

    /// Whether the angle between the edges still makes a corner.
    fn is_corner(&self) -> bool {
        let gap_rad = self.edges_rad[1] - self.edges_rad[0];
        gap_rad > 0.0 && gap_rad < core::f32::consts::PI && libm::sinf(gap_rad) > EDGES_SINE_MIN
    }
}

/// What the regression at one shape says.
struct Evaluated {
    shape: Shape,
    normal: Normal,
    right: Coefficients,
    /// Sum of squares that the shape itself leaves, less that of the pixels:
    /// only differences count.
    cost: f64,
}

impl Evaluated {
    fn new(design: &mut Design, patch: &Patch, shape: Shape) -> Self {
        design.evaluate(Coordinates::of(patch.radius), patch.count(), &shape);
        let (normal, right) = design.normal_equations(patch);
        // The best offset and half contrast at this very shape.
        let (ff, f1, n) = (normal[(PROFILE, PROFILE)], normal[(PROFILE, ONE)], normal[(ONE, ONE)]);
        let (yf, y1) = (right[PROFILE], right[ONE]);
        let determinant = ff * n - f1 * f1;
        let half_contrast = (n * yf - f1 * y1) / determinant;
        let offset = (ff * y1 - f1 * yf) / determinant;
        let cost = -(half_contrast * yf + offset * y1);
        Self { shape, normal, right, cost }
    }

    /// The damped step and the coefficients that go with it; `None` when the
    /// equations are singular.
    fn solve(&self, damping: f64) -> Option<Solved> {
        let mut normal = self.normal;
        for index in 0..NONLINEAR {
            normal[(index, index)] *= 1.0 + damping;
        }
        let cholesky = normal.cholesky()?;
        let mut coefficients = cholesky.solve(&self.right);
        let is_pinned = self.shape.blur_px <= BLUR_PX_MIN
            && coefficients[LN_BLUR] * coefficients[PROFILE] < 0.0;
        if is_pinned {
            normal[(LN_BLUR, LN_BLUR)] *= 1e6;
            coefficients = normal.cholesky()?.solve(&self.right);
        }
        let half_contrast = coefficients[PROFILE];
        let step = core::array::from_fn(|index| (coefficients[index] / half_contrast) as f32);
        let cost = -coefficients.dot(&self.right);
        Some(Solved { coefficients, step, cost })
    }
}

struct Solved {
    coefficients: Coefficients,
    step: [f32; NONLINEAR],
    /// The cost that the step promises.
    cost: f64,
}

/// Fits the model to a window whose middle is within about a pixel of the corner.
///
/// # Errors
/// [`RefineFailure::Diverged`] when the fit leaves the window's middle, turns
/// away from the seed's edges or does not settle; `WrongPolarity` when light
/// and dark are exchanged; `Obstructed` when something other than a corner is in
/// the window.
pub(super) fn fit(patch: &Patch, start: &Shape) -> Result<Fitted, RefineFailure> {
    let mut design = Design::new();
    let squares: f64 = patch.pixels().iter().map(|&value| f64::from(value * value)).sum();
    let free = (patch.count() - COLUMNS) as f64;
    let mut damping = 1e-3;
    let mut shape = *start;
    let mut best: Option<Evaluated> = None;
    for evaluations in 1..=EVALUATIONS_MAX {
        let evaluated = Evaluated::new(&mut design, patch, shape);
        // Written so that a NaN counts as worse.
        let better = best.as_ref().is_none_or(|best| evaluated.cost <= best.cost);
        if better {
            damping *= 0.1;
            best = Some(evaluated);
        } else {
            damping *= 100.0;
        }
        let Some(current) = &best else { return Err(RefineFailure::Diverged) };
        let solved = current.solve(damping).ok_or(RefineFailure::NotASaddle)?;
        shape = current.shape.stepped(solved.step);
        if !shape.is_corner() {
            return Err(RefineFailure::Diverged);
        }
        let variance = (squares + solved.cost) / free;
        let is_last = is_small(&current.shape, &solved.step)
            || current.cost - solved.cost < LAST_GAIN * variance;
        if better && is_last {
            let fitted = finish(&design, patch, current, &solved, shape, evaluations)?;
            return if is_near(&fitted.shape, start) {
                Ok(fitted)
            } else {
                Err(RefineFailure::Diverged)
            };
        }
    }
    Err(RefineFailure::Diverged)
}

fn is_small(shape: &Shape, step: &[f32; NONLINEAR]) -> bool {
    let [x, y] = shape.moved_by_shifts([step[0], step[1]]);
    x * x + y * y < LAST_STEP_PX * LAST_STEP_PX
        && step[2].abs() < LAST_TURN_RAD
        && step[3].abs() < LAST_TURN_RAD
        && step[4].abs() < LAST_LN_BLUR
}

fn is_near(shape: &Shape, start: &Shape) -> bool {
    let turned = |edge: usize| (shape.edges_rad[edge] - start.edges_rad[edge]).abs() < TURN_RAD_MAX;
    shape.offset_px.iter().all(|offset_px| offset_px.abs() < OFFSET_PX_MAX)
        && turned(0)
        && turned(1)
}

/// Judges the residual and turns the normal equations into a precision.
fn finish(
    design: &Design,
    patch: &Patch,
    current: &Evaluated,
    solved: &Solved,
    shape: Shape,
    evaluations: usize,
) -> Result<Fitted, RefineFailure> {
    let half_contrast = solved.coefficients[PROFILE] as f32;
    if half_contrast <= 0.0 {
        return Err(RefineFailure::WrongPolarity);
    }
    let residual = design.residual(patch, &solved.coefficients, shape.offset_px);
    let power = half_contrast * half_contrast;
    // Written so that a NaN fails.
    let is_clean = residual.structure <= STRUCTURE_MAX * STRUCTURE_MAX * power
        && residual.odd_structure <= ODD_STRUCTURE_MAX * ODD_STRUCTURE_MAX * power
        && residual.variance.is_finite();
    if !is_clean {
        return Err(RefineFailure::Obstructed);
    }
    let cholesky = current.normal.cholesky().ok_or(RefineFailure::NotASaddle)?;
    let covariance_of = |index: usize| {
        let mut unit = Coefficients::zeros();
        unit[index] = 1.0;
        cholesky.solve(&unit)
    };
    let (first, second) = (covariance_of(0), covariance_of(1));
    // The shifts' covariance [p q; q r] goes through the 2 x 2 map from shifts to px.
    let [by0, by1] = [[1.0, 0.0], [0.0, 1.0]].map(|unit| current.shape.moved_by_shifts(unit));
    let (p, q, r) = (first[0] as f32, first[1] as f32, second[1] as f32);
    let trace = p * (by0[0] * by0[0] + by0[1] * by0[1])
        + 2.0 * q * (by0[0] * by1[0] + by0[1] * by1[1])
        + r * (by1[0] * by1[0] + by1[1] * by1[1]);
    let sigma_px = libm::sqrtf(0.5 * trace * residual.variance) / half_contrast;
    Ok(Fitted { shape, half_contrast, sigma_px, evaluations })
}

/// The start at a saddle, with the seed's edges.
pub(super) fn start(offset_px: [f32; 2], edges_rad: [f32; 2]) -> Shape {
    Shape { offset_px, edges_rad, blur_px: BLUR_PX_START }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest difference between the columns, scaled, and central differences of f.
    fn derivative_error(shape: &Shape, scale: f32) -> f32 {
        const STEP: f32 = 0.003;
        let mut worst = 0.0_f32;
        for index in 0..NONLINEAR {
            let moved = |sign: f32| {
                let mut step = [0.0; NONLINEAR];
                step[index] = sign * STEP;
                Profile::new(&shape.stepped(step))
            };
            let (ahead, behind, here) = (moved(1.0), moved(-1.0), Profile::new(shape));
            for pixel in 0..81 {
                let (x, y) = ((pixel % 9) as f32 - 4.0, (pixel / 9) as f32 - 4.0);
                let difference =
                    (ahead.at(x, y)[PROFILE] - behind.at(x, y)[PROFILE]) / (2.0 * STEP);
                worst = worst.max((scale * here.at(x, y)[index] - difference).abs());
            }
        }
        worst
    }

    #[test]
    fn derivatives_match_differences_and_wrong_ones_do_not() {
        for gap_rad in [1.0_f32, 1.570_796_4, 2.1] {
            let shape =
                Shape { offset_px: [0.3, -0.2], edges_rad: [0.4, 0.4 + gap_rad], blur_px: 0.8 };
            // The differences' own error: 0.003^2 / 6 times a third derivative of up
            // to 300 (an edge's turn acts over 6 blurs), and rounding of 3e-7 / 0.003.
            let error = derivative_error(&shape, 1.0);
            assert!(error < 2e-3, "{error} at {gap_rad}");
            let error = derivative_error(&shape, 1.01);
            assert!(error > 1e-2, "{error} at {gap_rad}");
        }
    }

    #[test]
    fn profile_is_an_orthant_probability() {
        // In the middle of a corner f is 1 - 2 gap / pi whatever the blur, by symmetry.
        for gap_rad in [0.93_f32, 1.2, 1.570_796_4, 2.2] {
            let shape =
                Shape { offset_px: [0.0; 2], edges_rad: [0.3, 0.3 + gap_rad], blur_px: 0.8 };
            let value = Profile::new(&shape).at(0.0, 0.0)[PROFILE];
            let expected = 1.0 - 2.0 * gap_rad / core::f32::consts::PI;
            assert!((value - expected).abs() < 2e-4, "{value} {expected}");
        }
    }
}
