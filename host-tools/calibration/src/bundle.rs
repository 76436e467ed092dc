//! The joint refinement: camera and all boards at once, the paper's second step.
//!
//! Input: the quantities measured in each photograph ([`Seen`]), and a starting point. Output: the
//! lens, each board's pose, the shape of the board if requested, and the covariance of the
//! parameters that all photographs share.
//!
//! The Levenberg-Marquardt method minimises the sum of squared residuals, each divided by its
//! variance `sigma^2 + tau^2`: sigma is the precision expected from the pixels, and tau stands for
//! everything else (a bent board, a poor print, a lens that fits no model) and is the same for all.
//! tau is chosen so that the residuals have the expected size on average (Paule and Mandel 1982);
//! the covariance is then the inverse of the normal equations. Boards are coupled only by the
//! shared parameters, so each board's six are eliminated first (Schur complement).

use nalgebra::{DMatrix, DVector, Matrix2x6, Matrix6, Vector2, Vector3, Vector6};
use plumbline::lens::{Lens, ray_by_point, ray_of};
use plumbline::pose::{Cam, Pose, Target};

use super::model::{Photograph, Residual, Seen, Shape};

/// The number of parameters of a shape.
const SHAPE: usize = 4;

/// The number of parameters of a lens before its distortion: fx fy cx cy skew.
const PINHOLE: usize = 5;

/// The state and result of the fit.
#[derive(Debug, Clone)]
pub struct Bundle {
    pub lens: Lens,
    pub photographs: Vec<Photograph>,
    pub shape: Shape,
    /// Standard deviations of fx fy cx cy skew, then of the distortion, then, if fitted, of the
    /// shape.
    pub sd: Vec<f64>,
    /// The correlations of the same parameters.
    pub correlations: DMatrix<f64>,
    /// Standard deviation of each measured quantity beyond the pixels' noise.
    tau_px: f64,
    /// Whether the shape was fitted.
    has_shape: bool,
}

const ITERATIONS_MAX: usize = 60;
const DAMPING_START: f64 = 1e-3;
const DAMPING_FACTOR: f64 = 10.0;
const DAMPING_MAX: f64 = 1e12;
/// The iteration ends at a step that lowers the cost by less than this fraction of a variance.
const DECREASE_MIN: f64 = 1e-6;
/// The number of rounds of fitting and estimating tau.
const ROUNDS: usize = 4;

impl Bundle {
    /// Refines from a start.
    ///
    /// `None` where the photographs leave a parameter undetermined.
    #[must_use]
    pub fn refine(
        lens: &Lens,
        points_mm: &[Vector3<f64>],
        photographs: Vec<Photograph>,
        has_shape: bool,
    ) -> Option<Self> {
        let mut bundle = Self {
            lens: *lens,
            photographs,
            shape: Shape::default(),
            sd: Vec::new(),
            correlations: DMatrix::zeros(0, 0),
            tau_px: 0.0,
            has_shape,
        };
        for _ in 0..ROUNDS {
            bundle.descend(points_mm)?;
            bundle.tau_px = bundle.excess(points_mm)?;
        }
        let normal = bundle.normal(points_mm)?;
        let covariance = normal.reduced(0.0)?.0.try_inverse()?;
        bundle.sd = covariance.diagonal().iter().map(|variance| variance.sqrt()).collect();
        let sd = &bundle.sd;
        bundle.correlations = DMatrix::from_fn(sd.len(), sd.len(), |row, column| {
            // An inverse is symmetric only up to rounding.
            let both = 0.5 * (covariance[(row, column)] + covariance[(column, row)]);
            both / (sd[row] * sd[column])
        });
        bundle.sd.iter().all(|sd| sd.is_finite()).then_some(bundle)
    }

    /// Degrees of freedom: the number of measured quantities less that of the unknowns, which are
    /// the shared parameters and a pose of each photograph; 0 when there are not enough.
    #[must_use]
    pub fn freedom(&self) -> usize {
        let measured: usize = self.photographs.iter().map(|it| it.seen.len()).sum();
        measured.saturating_sub(self.shared() + 6 * self.photographs.len())
    }

    /// The number of parameters that all photographs share.
    fn shared(&self) -> usize {
        PINHOLE + self.lens.distortion.coefficients().len() + if self.has_shape { SHAPE } else { 0 }
    }

    /// The residuals of one photograph, raw pixels; `None` when a point lies behind the camera.
    #[must_use]
    fn residuals_px(
        &self,
        points_mm: &[Vector3<f64>],
        photograph: &Photograph,
    ) -> Option<Vec<f64>> {
        let raw_px: Vec<Vector2<f64>> = points_mm
            .iter()
            .map(|point| {
                let point = self.shape.apply(point);
                self.lens.project(&photograph.cam_from_board.transform(&point))
            })
            .collect::<Option<_>>()?;
        Some(photograph.seen.iter().map(|seen| seen.residual_px(&raw_px)).collect())
    }

    /// The same residuals, each with its position and direction.
    #[must_use]
    pub fn residuals(
        &self,
        points_mm: &[Vector3<f64>],
        photograph: &Photograph,
    ) -> Option<Vec<Residual>> {
        let residuals_px = self.residuals_px(points_mm, photograph)?;
        photograph
            .seen
            .iter()
            .zip(residuals_px)
            .map(|(seen, residual_px)| {
                let [first, second] = seen.points.map(|point| {
                    let point_mm = self.shape.apply(&points_mm[point]);
                    self.lens.project(&photograph.cam_from_board.transform(&point_mm))
                });
                // The midpoint is the mean of both ends.
                let right = seen.by_px[0] + seen.by_px[1];
                Some(Residual { at_px: (first? + second?) * 0.5, off_px: right * residual_px })
            })
            .collect()
    }

    /// The root mean square of the residuals of a photograph that was not used, raw pixels, at the
    /// pose of the board that makes it smallest; `None` when there is no such pose.
    #[must_use]
    pub fn held_out_px(&self, points_mm: &[Vector3<f64>], photograph: &Photograph) -> Option<f64> {
        const STEPS: usize = 10;
        let mut alone = Self { photographs: vec![photograph.clone()], ..self.clone() };
        for _ in 0..STEPS {
            let normal = alone.normal(points_mm)?;
            let [board] = &normal.boards[..] else { return None };
            let step = board.own.try_inverse()? * -board.gradient;
            let [photograph] = &mut alone.photographs[..] else { return None };
            photograph.cam_from_board = photograph.cam_from_board.moved_by(&step);
        }
        let residuals = alone.residuals_px(points_mm, &alone.photographs[0])?;
        let squares: f64 = residuals.iter().map(|residual| residual * residual).sum();
        let rms_px = (squares / residuals.len() as f64).sqrt();
        rms_px.is_finite().then_some(rms_px)
    }

    fn variance(&self, seen: &Seen) -> f64 {
        seen.sigma_px * seen.sigma_px + self.tau_px * self.tau_px
    }

    fn cost(&self, points_mm: &[Vector3<f64>]) -> Option<f64> {
        let mut cost = 0.0;
        for photograph in &self.photographs {
            let residuals = self.residuals_px(points_mm, photograph)?;
            for (residual, seen) in residuals.iter().zip(photograph.seen.iter()) {
                cost += residual * residual / self.variance(seen);
            }
        }
        Some(cost)
    }

    /// [`tau_px`] of the residuals.
    fn excess(&self, points_mm: &[Vector3<f64>]) -> Option<f64> {
        let mut squares = Vec::new();
        for photograph in &self.photographs {
            let residuals = self.residuals_px(points_mm, photograph)?;
            let sigmas = photograph.seen.iter().map(|seen| seen.sigma_px * seen.sigma_px);
            squares.extend(residuals.iter().map(|residual| residual * residual).zip(sigmas));
        }
        tau_px(&squares, self.freedom())
    }

    fn descend(&mut self, points_mm: &[Vector3<f64>]) -> Option<()> {
        let mut damping = DAMPING_START;
        let mut cost = self.cost(points_mm)?;
        for _ in 0..ITERATIONS_MAX {
            let normal = self.normal(points_mm)?;
            let decrease = loop {
                let moved = normal.step(damping).map(|step| self.moved_by(&step));
                let lower = moved.and_then(|moved| {
                    let next = moved.cost(points_mm).filter(|&next| next < cost)?;
                    Some((moved, next))
                });
                if let Some((moved, next)) = lower {
                    let decrease = cost - next;
                    (*self, cost) = (moved, next);
                    damping /= DAMPING_FACTOR;
                    break decrease;
                }
                damping *= DAMPING_FACTOR;
                if damping > DAMPING_MAX {
                    break 0.0;
                }
            };
            if decrease < DECREASE_MIN {
                break;
            }
        }
        Some(())
    }

    fn moved_by(&self, (shared, own): &(DVector<f64>, Vec<Vector6<f64>>)) -> Self {
        let mut moved = self.clone();
        let lens = &mut moved.lens;
        for (place, value) in
            [&mut lens.fx_px, &mut lens.fy_px, &mut lens.cx_px, &mut lens.cy_px, &mut lens.skew_px]
                .into_iter()
                .enumerate()
        {
            *value += shared[place];
        }
        let distortion = lens.distortion.coefficients_mut();
        let count = distortion.len();
        for (place, value) in distortion.iter_mut().enumerate() {
            *value += shared[PINHOLE + place];
        }
        if self.has_shape {
            let at = PINHOLE + count;
            for (place, value) in moved.shape.bend_per_mm.iter_mut().enumerate() {
                *value += shared[at + place];
            }
            moved.shape.stretch += shared[at + SHAPE - 1];
        }
        for (photograph, step) in moved.photographs.iter_mut().zip(own) {
            photograph.cam_from_board = photograph.cam_from_board.moved_by(step);
        }
        moved
    }

    fn normal(&self, points_mm: &[Vector3<f64>]) -> Option<Normal> {
        let count = self.shared();
        let mut normal = Normal {
            shared: DMatrix::zeros(count, count),
            shared_gradient: DVector::zeros(count),
            boards: Vec::new(),
        };
        for photograph in &self.photographs {
            let points: Vec<Projected> = points_mm
                .iter()
                .map(|point| self.project(&photograph.cam_from_board, point))
                .collect::<Option<_>>()?;
            let mut board = Board {
                own: Matrix6::zeros(),
                mixed: DMatrix::zeros(count, 6),
                gradient: Vector6::zeros(),
            };
            for seen in photograph.seen.iter() {
                let mut residual = -seen.value_px;
                let mut by_shared = DVector::zeros(count);
                let mut by_own = Vector6::zeros();
                for (point, by_px) in seen.points.iter().zip(&seen.by_px) {
                    let point = &points[*point];
                    residual += by_px.dot(&point.raw_px);
                    by_shared += point.by_shared.tr_mul(by_px);
                    by_own += point.by_own.tr_mul(by_px);
                }
                let weight = 1.0 / self.variance(seen);
                normal.shared.syger(weight, &by_shared, &by_shared, 1.0);
                normal.shared_gradient.axpy(weight * residual, &by_shared, 1.0);
                board.own += by_own * by_own.transpose() * weight;
                board.mixed.ger(weight, &by_shared, &by_own, 1.0);
                board.gradient += by_own * (weight * residual);
            }
            normal.boards.push(board);
        }
        // Only the lower triangle was accumulated.
        normal.shared.fill_upper_triangle_with_lower_triangle();
        Some(normal)
    }

    /// A point's raw pixel and its derivatives.
    fn project(
        &self,
        cam_from_board: &Pose<Cam, Target>,
        flat_mm: &Vector3<f64>,
    ) -> Option<Projected> {
        let point_mm = self.shape.apply(flat_mm);
        let point_cam_mm = cam_from_board.transform(&point_mm);
        let ray = ray_of(&point_cam_mm)?;
        let (distorted, by_ray) = self.lens.distortion.distort_with_jacobian(&ray);
        let raw_by_point = self.lens.pixel_by_ray() * by_ray * ray_by_point(&point_cam_mm, &ray);
        let mut by_shared = DMatrix::zeros(2, self.shared());
        for (place, column) in self.lens.pixel_by_numbers(&ray, &distorted).enumerate() {
            by_shared.set_column(place, &column);
        }
        if self.has_shape {
            let at = self.shared() - SHAPE;
            let by_point = raw_by_point * cam_from_board.rotation;
            let (x, y) = (flat_mm.x, flat_mm.y);
            for (place, height) in [x * x, x * y, y * y].into_iter().enumerate() {
                by_shared.set_column(at + place, &(by_point.column(2) * height));
            }
            by_shared.set_column(at + SHAPE - 1, &(by_point.column(1) * y));
        }
        Some(Projected {
            raw_px: self.lens.pixel_from_ray(&distorted),
            by_shared,
            by_own: raw_by_point * cam_from_board.point_by_increment(&point_mm),
        })
    }
}

/// Finds by bisection the standard deviation beyond the pixels' noise with which the squared
/// residuals, each given with the variance expected from the pixels, add up to their degrees of
/// freedom; `None` when there are none.
pub fn tau_px(squares: &[(f64, f64)], freedom: usize) -> Option<f64> {
    if freedom == 0 {
        return None;
    }
    let freedom = freedom as f64;
    let cost = |tau: f64| -> f64 {
        squares.iter().map(|(square, variance)| square / (variance + tau * tau)).sum()
    };
    if cost(0.0) <= freedom {
        return Some(0.0);
    }
    // No residual is larger than a frame.
    let (mut low, mut high) = (0.0, 1e4);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if cost(middle) > freedom { low = middle } else { high = middle }
    }
    Some(high)
}

struct Projected {
    raw_px: Vector2<f64>,
    by_shared: DMatrix<f64>,
    by_own: Matrix2x6<f64>,
}

/// The normal equations: the shared part, and each board's own part.
struct Normal {
    shared: DMatrix<f64>,
    shared_gradient: DVector<f64>,
    boards: Vec<Board>,
}

struct Board {
    own: Matrix6<f64>,
    /// The mixed block: shared parameters by the board's own.
    mixed: DMatrix<f64>,
    gradient: Vector6<f64>,
}

impl Normal {
    /// The system of the shared parameters after eliminating the boards, with Marquardt's damping.
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let mut matrix = self.shared.clone();
        let mut right = -&self.shared_gradient;
        for place in 0..matrix.nrows() {
            matrix[(place, place)] *= 1.0 + damping;
        }
        for board in &self.boards {
            let inverse = board.damped(damping).try_inverse()?;
            let eliminated = &board.mixed * inverse;
            matrix -= &eliminated * board.mixed.transpose();
            right += eliminated * board.gradient;
        }
        Some((matrix, right))
    }

    fn step(&self, damping: f64) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
        let (matrix, right) = self.reduced(damping)?;
        // Scaled, because pixels, coefficients and 1/mm have no common unit.
        let scale = matrix.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |row, column| {
            matrix[(row, column)] * scale[row] * scale[column]
        });
        let shared = scaled.cholesky()?.solve(&right.component_mul(&scale)).component_mul(&scale);
        let own = self
            .boards
            .iter()
            .map(|board| {
                let right = -board.gradient - board.mixed.tr_mul(&shared);
                Some(board.damped(damping).try_inverse()? * right)
            })
            .collect::<Option<Vec<_>>>()?;
        Some((shared, own))
    }
}

impl Board {
    fn damped(&self, damping: f64) -> Matrix6<f64> {
        let mut matrix = self.own;
        for place in 0..6 {
            matrix[(place, place)] *= 1.0 + damping;
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use plumbline::lens::Distortion;

    use super::super::verdict::bend_mm;
    use super::*;

    const LENS: Lens = Lens {
        width_px: 1456,
        height_px: 1088,
        fx_px: 1740.0,
        fy_px: 1738.0,
        cx_px: 735.0,
        cy_px: 540.0,
        skew_px: 0.5,
        distortion: Distortion::Brown5([-0.1, 0.05, 1e-3, -5e-4, 0.01]),
    };

    /// The points of a board of 9 x 7 corners, 20 mm apart.
    fn points_mm() -> Vec<Vector3<f64>> {
        let point = |place: usize| {
            let (column, row) = ((place % 9) as f64 - 4.0, (place / 9) as f64 - 3.0);
            Vector3::new(column * 20.0, row * 20.0, 0.0)
        };
        (0..63).map(point).collect()
    }

    /// Exact photographs of a board of this shape, with initial poses off by 1 mm and 0.01 rad per
    /// axis.
    fn photographs(shape: &Shape) -> Vec<Photograph> {
        let tilts = [[0.0, 0.5], [0.5, 0.0], [-0.4, 0.3], [0.3, -0.4], [-0.5, -0.2], [0.1, 0.1]];
        let photograph = |(place, [yaw, pitch]): (usize, [f64; 2])| {
            let side = (place as f64 - 2.5) * 40.0;
            let pose = Pose::from_theta([0.1, yaw, pitch, side, -side * 0.6, 700.0]);
            let seen = points_mm().into_iter().enumerate().flat_map(|(point, at)| {
                let px = LENS.project(&pose.transform(&shape.apply(&at))).unwrap();
                [Vector2::x(), Vector2::y()].map(|axis| Seen {
                    points: [point; 2],
                    by_px: [axis * 0.5; 2],
                    value_px: axis.dot(&px),
                    sigma_px: 0.05,
                })
            });
            let start = pose.moved_by(&Vector6::new(0.01, -0.01, 0.01, 1.0, 1.0, -1.0));
            Photograph { seen: seen.collect(), cam_from_board: start }
        };
        tilts.into_iter().enumerate().map(photograph).collect()
    }

    #[test]
    fn exact_numbers_give_the_exact_camera_from_a_poor_start() {
        let start = Lens {
            fx_px: 1700.0,
            fy_px: 1700.0,
            cx_px: 727.5,
            cy_px: 543.5,
            skew_px: 0.0,
            distortion: Distortion::Brown5([0.0; 5]),
            ..LENS
        };
        let photographs = photographs(&Shape::default());
        let found = Bundle::refine(&start, &points_mm(), photographs, false).unwrap();
        // A thousandth of the uncertainty from the standard deviations of the measurements.
        let errors = [found.lens.fx_px - LENS.fx_px, found.lens.cy_px - LENS.cy_px];
        assert!(errors.iter().all(|error| error.abs() < 1e-3 * found.sd[0]), "{errors:?}");
        assert_eq!(found.tau_px, 0.0);
    }

    #[test]
    fn a_bent_and_stretched_board_is_told_from_a_camera() {
        let bent = Shape { bend_per_mm: [6e-5, -2e-5, 0.0], stretch: 0.003 };
        let found = Bundle::refine(&LENS, &points_mm(), photographs(&bent), true).unwrap();
        assert!((found.shape.stretch - bent.stretch).abs() < 1e-6, "{:?}", found.shape);
        for (found, bent) in found.shape.bend_per_mm.iter().zip(&bent.bend_per_mm) {
            assert!((found - bent).abs() < 1e-8, "{found}");
        }
        // 80 mm from the centre, 6e-5 per mm bends by 0.38 mm, and -2e-5 over 80 x 60 mm adds
        // another 0.1 at the corners.
        let (mm, sd_mm) = bend_mm(&found.shape, &found.sd[10..], &points_mm());
        assert!((0.38..0.6).contains(&mm) && sd_mm < 0.1, "{mm} +- {sd_mm}");
        // If the bent board is taken to be flat, the camera comes out wrong.
        let flat = Bundle::refine(&LENS, &points_mm(), photographs(&bent), false).unwrap();
        assert!((flat.lens.fy_px - LENS.fy_px).abs() > 1.0, "{}", flat.lens.fy_px);
    }
}
