//! The readout time and the poses in all frames at once.
//!
//! Gauss-Newton on the sum of squared residuals, each divided by its variance, as in
//! [`bundle`](crate::bundle). Each frame's pose is that in its middle row, and every point of the
//! board is projected where the motion through the frame ([`Motion`]) has it when its own row is
//! read. A residual depends on the poses of [`WINDOW`] frames, so the normal equations of the poses
//! are banded, and are eliminated from those of the readout time.
//!
//! The variance of the readout time is not taken from the normal equations alone, which know of no
//! error but the pixels' noise. It is estimated from the residuals as they are (the sandwich
//! estimate), with neighbouring frames counted as dependent ([`sandwich`](super::sandwich)), and the
//! larger of both is stated.

use nalgebra::{DVector, Matrix2x3, SMatrix, SVector, Vector2, Vector3, Vector6};
use plumbline::lens::Lens;
use rayon::prelude::*;

use super::banded::Banded;
use super::motion::{Motion, WINDOW};
use super::sandwich::variance_of_sum;
use crate::bundle::tau_px;
use crate::model::{Photograph, Seen, raw_by_point};

/// The number of parameters of the poses that a residual depends on.
const POSES: usize = 6 * WINDOW;

/// The number of rounds of fitting and estimating tau.
const ROUNDS: usize = 3;
const ITERATIONS_MAX: usize = 30;
const HALVINGS_MAX: usize = 20;
/// The iteration ends at a step that lowers the cost by less than this fraction of a variance.
const DECREASE_MIN: f64 = 1e-9;

/// A video that is being fitted.
#[derive(Clone)]
pub struct Fit<'a> {
    pub lens: &'a Lens,
    /// The points that are seen, in the board's frame.
    pub points_mm: &'a [Vector3<f64>],
    /// From one frame to the next.
    pub interval_s: f64,
    /// The frames in which the board was seen, in runs without a gap of at least [`WINDOW`] each.
    /// The pose is that in the frame's middle row.
    pub runs: Vec<Vec<Photograph>>,
    /// From the first row to that below the last one.
    pub readout_s: f64,
    /// Standard deviation of each measured quantity beyond the pixels' noise.
    pub tau_px: f64,
}

/// A point of the board in the image.
struct Projected {
    raw_px: Vector2<f64>,
    by_poses: SMatrix<f64, 2, POSES>,
    by_readout: Vector2<f64>,
}

/// The part of the normal equations that one frame contributes.
struct Equations {
    poses: SMatrix<f64, POSES, POSES>,
    mixed: SVector<f64, POSES>,
    readout: f64,
    poses_gradient: SVector<f64, POSES>,
    readout_gradient: f64,
}

/// What a run's equations say once its poses are eliminated.
struct Eliminated {
    /// The steps of the poses, and how much they follow a step of the readout time.
    step: DVector<f64>,
    follow: DVector<f64>,
    /// The readout time's information and gradient.
    information: f64,
    gradient: f64,
    /// What each frame contributes to the gradient.
    scores: Vec<f64>,
}

impl<'a> Fit<'a> {
    /// Minimises from a start, and gives the standard deviation of the readout time; `None` where the
    /// frames do not determine the poses.
    pub fn refine(&mut self) -> Option<f64> {
        for _ in 0..ROUNDS {
            self.descend()?;
            self.tau_px = self.excess_px()?;
        }
        self.deviation_s()
    }

    fn descend(&mut self) -> Option<()> {
        let mut cost = self.cost()?;
        for _ in 0..ITERATIONS_MAX {
            let eliminated = self.eliminated()?;
            let information: f64 = eliminated.iter().map(|run| run.information).sum();
            let gradient: f64 = eliminated.iter().map(|run| run.gradient).sum();
            if information.is_nan() || information <= 0.0 {
                return None;
            }
            let step_s = -gradient / information;
            let mut share = 1.0;
            let lower = (0..HALVINGS_MAX).find_map(|_| {
                let moved = self.moved_by(step_s * share, share, &eliminated);
                share *= 0.5;
                let next = moved.cost().filter(|next| *next <= cost)?;
                Some((moved, next))
            });
            let Some((moved, next)) = lower else { break };
            let decrease = cost - next;
            (*self, cost) = (moved, next);
            if decrease < DECREASE_MIN {
                break;
            }
        }
        Some(())
    }

    fn moved_by(&self, step_s: f64, share: f64, eliminated: &[Eliminated]) -> Self {
        let mut moved = self.clone();
        moved.readout_s += step_s;
        for (run, eliminated) in moved.runs.iter_mut().zip(eliminated) {
            let steps = &eliminated.step * share - &eliminated.follow * step_s;
            for (frame, photograph) in run.iter_mut().enumerate() {
                let step: Vector6<f64> = steps.fixed_rows::<6>(6 * frame).into();
                photograph.cam_from_board = photograph.cam_from_board.moved_by(&step);
            }
        }
        moved
    }

    /// The standard deviation of the readout time at the minimum.
    fn deviation_s(&self) -> Option<f64> {
        let eliminated = self.eliminated()?;
        let information: f64 = eliminated.iter().map(|run| run.information).sum();
        let sum: f64 = eliminated.iter().map(|run| variance_of_sum(&run.scores)).sum();
        // The fit has made the residuals smaller than the errors were.
        let shrunk = self.measured() as f64 / self.freedom() as f64;
        let variance = (1.0 / information).max(shrunk * sum / (information * information));
        Some(variance.sqrt()).filter(|deviation| deviation.is_finite())
    }

    /// The number of measured quantities.
    fn measured(&self) -> usize {
        self.runs.iter().flatten().map(|photograph| photograph.seen.len()).sum()
    }

    /// Degrees of freedom: that number less the readout time and a pose of each frame; 0 when there
    /// are not enough.
    fn freedom(&self) -> usize {
        let frames: usize = self.runs.iter().map(Vec::len).sum();
        self.measured().saturating_sub(6 * frames + 1)
    }

    fn variance(&self, seen: &Seen) -> f64 {
        seen.sigma_px * seen.sigma_px + self.tau_px * self.tau_px
    }

    /// The motion through a frame of a run, and the first frame of its window.
    fn motion(run: &[Photograph], frame: usize) -> (Motion, usize) {
        let first = frame.saturating_sub(WINDOW / 2).min(run.len() - WINDOW);
        let poses = std::array::from_fn(|place| run[first + place].cam_from_board);
        (Motion::new(poses, frame - first), first)
    }

    /// The residuals of one frame, raw pixels; `None` when a point lies behind the camera.
    fn residuals_px(&self, run: &[Photograph], frame: usize) -> Option<Vec<f64>> {
        let (motion, _) = Self::motion(run, frame);
        let raw_px: Vec<Vector2<f64>> = self
            .points_mm
            .iter()
            .map(|point_mm| self.seen_at(&motion, point_mm).map(|(_, raw_px)| raw_px))
            .collect::<Option<_>>()?;
        Some(run[frame].seen.iter().map(|seen| seen.residual_px(&raw_px)).collect())
    }

    fn for_each_frame<T>(
        &self,
        each: impl Fn(&[Photograph], usize) -> Option<T> + Sync,
    ) -> Option<Vec<Vec<T>>>
    where
        T: Send,
    {
        let of_run = |run: &Vec<Photograph>| {
            (0..run.len()).into_par_iter().map(|frame| each(run, frame)).collect()
        };
        self.runs.iter().map(of_run).collect()
    }

    fn cost(&self) -> Option<f64> {
        let of_frame = |run: &[Photograph], frame: usize| {
            let residuals = self.residuals_px(run, frame)?;
            let weighted = residuals.iter().zip(run[frame].seen.iter());
            Some(
                weighted
                    .map(|(residual, seen)| residual.powi(2) / self.variance(seen))
                    .sum::<f64>(),
            )
        };
        let cost: f64 = self.for_each_frame(of_frame)?.iter().flatten().sum();
        cost.is_finite().then_some(cost)
    }

    fn excess_px(&self) -> Option<f64> {
        let of_frame = |run: &[Photograph], frame: usize| {
            let squares =
                self.residuals_px(run, frame)?.into_iter().map(|residual| residual.powi(2));
            let sigmas = run[frame].seen.iter().map(|seen| seen.sigma_px.powi(2));
            Some(squares.zip(sigmas).collect::<Vec<_>>())
        };
        let squares: Vec<_> =
            self.for_each_frame(of_frame)?.into_iter().flatten().flatten().collect();
        tau_px(&squares, self.freedom())
    }

    /// When row `y` is read, in frames from the middle row.
    fn frames_at_row(&self, y_px: f64) -> f64 {
        (y_px / f64::from(self.lens.height_px) - 0.5) * self.readout_s / self.interval_s
    }

    /// The derivative of [`frames_at_row`](Self::frames_at_row).
    fn frames_by_row(&self) -> f64 {
        self.readout_s / (self.interval_s * f64::from(self.lens.height_px))
    }

    /// The instant at which a point is seen, in frames, and its raw pixel then: the point must be in
    /// the row that is being read.
    fn seen_at(&self, motion: &Motion, point_mm: &Vector3<f64>) -> Option<(f64, Vector2<f64>)> {
        let project =
            |frames: f64| self.lens.project(&motion.at(frames).cam_from_board.transform(point_mm));
        let mut frames = 0.0;
        let mut raw_px = project(frames)?;
        // The board moves by a small part of a row while a row is read: each round divides the
        // error by ten at least.
        for _ in 0..12 {
            let next = self.frames_at_row(raw_px.y);
            if (next - frames).abs() < 1e-10 {
                break;
            }
            frames = next;
            raw_px = project(frames)?;
        }
        Some((frames, raw_px))
    }

    /// A point's raw pixel and its derivatives.
    fn project(&self, motion: &Motion, point_mm: &Vector3<f64>) -> Option<Projected> {
        let (frames, raw_px) = self.seen_at(motion, point_mm)?;
        let instant = motion.at(frames);
        let point_cam_mm = instant.cam_from_board.transform(point_mm);
        let raw_by_point = raw_by_point(self.lens, &point_cam_mm)?;
        let by_pose = raw_by_point * instant.cam_from_board.point_by_increment(point_mm);
        let by_turn: Matrix2x3<f64> = by_pose.fixed_columns::<3>(0).into();
        let by_shift: Matrix2x3<f64> = by_pose.fixed_columns::<3>(3).into();
        // Per frame, as are the times below.
        let velocity_px = by_turn * instant.turn_rad + by_shift * instant.shift_mm;
        let mut by_poses = SMatrix::<f64, 2, POSES>::zeros();
        let by_turns = motion.turns_by_turns(&instant);
        for (place, (turn, weight)) in by_turns.iter().zip(instant.weights).enumerate() {
            by_poses.fixed_columns_mut::<3>(6 * place).copy_from(&(by_turn * turn));
            by_poses.fixed_columns_mut::<3>(6 * place + 3).copy_from(&(by_shift * weight));
        }
        // What moves the point by dy rows also moves it in time, by dy * frames_by_row.
        let rows_gained = 1.0 / (1.0 - velocity_px.y * self.frames_by_row());
        let by_row = velocity_px * (self.frames_by_row() * rows_gained);
        by_poses += by_row * by_poses.row(1).into_owned();
        let frames_by_readout = (raw_px.y / f64::from(self.lens.height_px) - 0.5) / self.interval_s;
        let by_readout = velocity_px * (frames_by_readout * rows_gained);
        Some(Projected { raw_px, by_poses, by_readout })
    }

    fn equations(&self, run: &[Photograph], frame: usize) -> Option<Equations> {
        let (motion, _) = Self::motion(run, frame);
        let points: Vec<Projected> = self
            .points_mm
            .iter()
            .map(|point_mm| self.project(&motion, point_mm))
            .collect::<Option<_>>()?;
        let mut equations = Equations {
            poses: SMatrix::zeros(),
            mixed: SVector::zeros(),
            readout: 0.0,
            poses_gradient: SVector::zeros(),
            readout_gradient: 0.0,
        };
        for seen in run[frame].seen.iter() {
            let mut residual = -seen.value_px;
            let mut by_poses = SVector::<f64, POSES>::zeros();
            let mut by_readout = 0.0;
            for (point, by_px) in seen.points.iter().zip(&seen.by_px) {
                let point = &points[*point];
                residual += by_px.dot(&point.raw_px);
                by_poses += point.by_poses.tr_mul(by_px);
                by_readout += point.by_readout.dot(by_px);
            }
            let weight = 1.0 / self.variance(seen);
            // Only the lower triangle is used.
            equations.poses.syger(weight, &by_poses, &by_poses, 1.0);
            equations.mixed.axpy(weight * by_readout, &by_poses, 1.0);
            equations.readout += weight * by_readout * by_readout;
            equations.poses_gradient.axpy(weight * residual, &by_poses, 1.0);
            equations.readout_gradient += weight * residual * by_readout;
        }
        Some(equations)
    }

    fn eliminated(&self) -> Option<Vec<Eliminated>> {
        self.for_each_frame(|run, frame| self.equations(run, frame))?
            .iter()
            .zip(&self.runs)
            .map(|(equations, run)| Eliminated::new(equations, run))
            .collect()
    }
}

impl Eliminated {
    /// From the equations of each frame of a run.
    fn new(frames: &[Equations], run: &[Photograph]) -> Option<Self> {
        let size = 6 * run.len();
        let mut poses = Banded::zeros(size, POSES - 1);
        let mut mixed = DVector::zeros(size);
        let mut gradient = DVector::zeros(size);
        let first = |frame: usize| 6 * Fit::motion(run, frame).1;
        for (frame, equations) in frames.iter().enumerate() {
            let first = first(frame);
            for row in 0..POSES {
                for column in 0..=row {
                    poses.add(first + row, first + column, equations.poses[(row, column)]);
                }
                mixed[first + row] += equations.mixed[row];
                gradient[first + row] += equations.poses_gradient[row];
            }
        }
        let factor = poses.factored()?;
        let follow = factor.solve(&mixed);
        let step = -factor.solve(&gradient);
        let scores: Vec<f64> = frames
            .iter()
            .enumerate()
            .map(|(frame, equations)| {
                let follow = follow.rows(first(frame), POSES);
                equations.readout_gradient - follow.dot(&equations.poses_gradient)
            })
            .collect();
        let readout: f64 = frames.iter().map(|equations| equations.readout).sum();
        Some(Self {
            information: readout - mixed.dot(&follow),
            gradient: scores.iter().sum(),
            scores,
            step,
            follow,
        })
    }
}

#[cfg(test)]
mod tests {
    use plumbline::pose::{Cam, Pose, Target};

    use super::super::tests::{LENS, waved};
    use super::*;

    #[test]
    fn derivatives_are_central_differences() {
        let points_mm = [Vector3::new(-60.0, 40.0, 0.0), Vector3::new(30.0, -50.0, 0.0)];
        let fit = Fit {
            lens: &LENS,
            points_mm: &points_mm,
            interval_s: 1.0 / 30.0,
            runs: Vec::new(),
            readout_s: 25e-3,
            tau_px: 0.0,
        };
        let poses = std::array::from_fn(|place| waved(place as f64 / 30.0));
        let raw_px = |fit: &Fit, poses: &[Pose<Cam, Target>; WINDOW], point_mm: &Vector3<f64>| {
            fit.seen_at(&Motion::new(*poses, 3), point_mm).unwrap().1
        };
        const STEP: f64 = 1e-4;
        for point_mm in &points_mm {
            let projected = fit.project(&Motion::new(poses, 3), point_mm).unwrap();
            let later = |step_s: f64| {
                raw_px(&Fit { readout_s: fit.readout_s + step_s, ..fit.clone() }, &poses, point_mm)
            };
            let difference = (later(STEP) - later(-STEP)) / (2.0 * STEP);
            // Pixels per second: some hundred.
            assert!((difference - projected.by_readout).norm() < 1e-3, "{difference}");
            for place in 0..POSES {
                let moved = |step: f64| {
                    let mut moved = poses;
                    let mut increment = Vector6::zeros();
                    increment[place % 6] = step;
                    moved[place / 6] = moved[place / 6].moved_by(&increment);
                    raw_px(&fit, &moved, point_mm)
                };
                let difference = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
                let error = (difference - projected.by_poses.column(place)).norm();
                // Of up to 1,000 px per radian.
                assert!(error < 1e-4, "{place}: {error}");
            }
        }
    }
}
