//! The motion of the board through a frame, from the poses in the frames around it.
//!
//! The position is the polynomial through the positions of [`WINDOW`] successive frames, and the
//! rotation that through their rotation vectors with respect to the frame's own. At a motion of
//! f Hz and F frames per second, the velocity is then wrong by a fraction of (2 pi f / F)^6 / 140:
//! 4e-4 at 3 Hz and 30 frames per second, 7e-6 at 60.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use plumbline::pose::{Cam, Pose, Target, rotation_from_vector};

/// The number of frames whose poses make the motion through one of them.
pub const WINDOW: usize = 7;

/// The motion through one frame. Time is counted in frames, from the frame's own middle.
pub struct Motion {
    /// The place of the frame in the window.
    own: usize,
    polynomials: Polynomials,
    rotation: Matrix3<f64>,
    /// The rotation vectors from the frame's rotation to those of the window.
    turns_rad: [Vector3<f64>; WINDOW],
    translations_mm: [Vector3<f64>; WINDOW],
}

/// The board at one instant.
pub struct Instant {
    pub cam_from_board: Pose<Cam, Target>,
    /// The velocity, per frame: a rotation in the board's own frame, and a translation in the
    /// camera's, as in [`Pose::moved_by`].
    pub turn_rad: Vector3<f64>,
    pub shift_mm: Vector3<f64>,
    /// Weight of each frame's translation.
    pub weights: [f64; WINDOW],
    /// From the rotation vector with respect to the frame's rotation.
    angle_rad: Vector3<f64>,
}

impl Motion {
    /// The motion through frame `own` of these.
    pub fn new(poses: [Pose<Cam, Target>; WINDOW], own: usize) -> Self {
        let rotation = poses[own].rotation;
        let turn = |pose: &Pose<Cam, Target>| turn_between(&rotation, &pose.rotation);
        Self {
            own,
            polynomials: Polynomials::new(own),
            rotation,
            turns_rad: std::array::from_fn(|place| turn(&poses[place])),
            translations_mm: poses.map(|pose| pose.translation_mm),
        }
    }

    /// The board so many frames after the middle of this one.
    pub fn at(&self, frames: f64) -> Instant {
        let (weights, slopes) = self.polynomials.at(frames);
        let sum = |weights: &[f64; WINDOW], vectors: &[Vector3<f64>; WINDOW]| {
            weights
                .iter()
                .zip(vectors)
                .map(|(weight, vector)| vector * *weight)
                .sum::<Vector3<f64>>()
        };
        let angle_rad = sum(&weights, &self.turns_rad);
        let rotation = self.rotation * rotation_from_vector(&angle_rad);
        Instant {
            cam_from_board: Pose::new(rotation, sum(&weights, &self.translations_mm)),
            turn_rad: right_jacobian(&angle_rad) * sum(&slopes, &self.turns_rad),
            shift_mm: sum(&slopes, &self.translations_mm),
            weights,
            angle_rad,
        }
    }

    /// How a turn of each frame's pose turns the board at that instant, both in the board's own
    /// frame.
    pub fn turns_by_turns(&self, instant: &Instant) -> [Matrix3<f64>; WINDOW] {
        let jacobian = right_jacobian(&instant.angle_rad);
        let mut by_turns = [Matrix3::zeros(); WINDOW];
        // The rotation vectors count from the frame's own rotation, which turns them all.
        let mut by_own = rotation_from_vector(&-instant.angle_rad);
        for (place, turn_rad) in self.turns_rad.iter().enumerate() {
            if place == self.own {
                continue;
            }
            let weighted = jacobian * instant.weights[place];
            by_turns[place] = weighted * right_jacobian_inverse(turn_rad);
            by_own -= weighted * right_jacobian_inverse(&-turn_rad);
        }
        by_turns[self.own] = by_own;
        by_turns
    }
}

/// What turns the first rotation into the second, in the frame of the first.
fn turn_between(first: &Matrix3<f64>, second: &Matrix3<f64>) -> Vector3<f64> {
    let between = Rotation3::from_matrix_unchecked(first.tr_mul(second));
    // Exact for small angles too, unlike the arc cosine of the trace.
    UnitQuaternion::from_rotation_matrix(&between).scaled_axis()
}

/// The polynomials through the frames of a window.
struct Polynomials {
    /// Lagrange's polynomial of each frame: the coefficients of 1, t, t^2 ...
    coefficients: [[f64; WINDOW]; WINDOW],
}

impl Polynomials {
    /// Time is counted from frame `own`.
    fn new(own: usize) -> Self {
        let at = |place: usize| place as f64 - own as f64;
        let of_frame = |place: usize| {
            let mut product = [0.0; WINDOW];
            product[0] = 1.0;
            for other in (0..WINDOW).filter(|other| *other != place) {
                // Times (t - other) / (place - other).
                let scale = 1.0 / (at(place) - at(other));
                for power in (0..WINDOW).rev() {
                    let lower = if power == 0 { 0.0 } else { product[power - 1] };
                    product[power] = (lower - at(other) * product[power]) * scale;
                }
            }
            product
        };
        Self { coefficients: std::array::from_fn(of_frame) }
    }

    /// The weight of each frame at an instant, and its derivative.
    fn at(&self, frames: f64) -> ([f64; WINDOW], [f64; WINDOW]) {
        let weight = |coefficients: &[f64; WINDOW]| {
            coefficients.iter().rev().fold((0.0, 0.0), |(value, slope), coefficient| {
                (value * frames + coefficient, slope * frames + value)
            })
        };
        let both = self.coefficients.each_ref().map(weight);
        (both.map(|(value, _)| value), both.map(|(_, slope)| slope))
    }
}

/// How a change of a rotation vector turns, in the turned frame.
fn right_jacobian(angle_rad: &Vector3<f64>) -> Matrix3<f64> {
    let angle = angle_rad.norm();
    let (linear, square) = if angle < 1e-4 {
        (0.5, 1.0 / 6.0)
    } else {
        ((1.0 - angle.cos()) / angle.powi(2), (angle - angle.sin()) / angle.powi(3))
    };
    let cross = angle_rad.cross_matrix();
    Matrix3::identity() - cross * linear + cross * cross * square
}

fn right_jacobian_inverse(angle_rad: &Vector3<f64>) -> Matrix3<f64> {
    let angle = angle_rad.norm();
    let square = if angle < 1e-4 {
        1.0 / 12.0
    } else {
        1.0 / angle.powi(2) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    let cross = angle_rad.cross_matrix();
    Matrix3::identity() + cross * 0.5 + cross * cross * square
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;

    fn poses() -> [Pose<Cam, Target>; WINDOW] {
        std::array::from_fn(|place| {
            let t = place as f64 * 0.2;
            let angles = [0.4 * t.sin(), 0.3 * (1.3 * t).cos(), 0.2 * t];
            Pose::from_theta([angles[0], angles[1], angles[2], 40.0 * t, 30.0 * t * t, 700.0])
        })
    }

    #[test]
    fn the_motion_passes_through_the_poses_and_is_a_polynomial() {
        for own in [0, 3, 6] {
            let motion = Motion::new(poses(), own);
            for (place, pose) in poses().iter().enumerate() {
                let found = motion.at(place as f64 - own as f64).cam_from_board;
                assert!((found.rotation - pose.rotation).norm() < 1e-12);
                assert!((found.translation_mm - pose.translation_mm).norm() < 1e-8);
            }
            // 40 t mm and 30 t^2 mm, between the frames too.
            let t = 0.2 * (own as f64 + 0.3);
            let instant = motion.at(0.3);
            let expected = Vector3::new(40.0 * t, 30.0 * t * t, 700.0);
            assert!((instant.cam_from_board.translation_mm - expected).norm() < 1e-10);
            let expected = Vector3::new(40.0, 60.0 * t, 0.0) * 0.2;
            assert!((instant.shift_mm - expected).norm() < 1e-10);
        }
    }

    #[test]
    fn derivatives_are_central_differences() {
        const STEP: f64 = 1e-5;
        let turn = |from: &Instant, to: &Instant| {
            let [from, to] = [from, to].map(|instant| instant.cam_from_board.rotation);
            turn_between(&from, &to) / (2.0 * STEP)
        };
        for (own, frames) in [(3, 0.4), (3, -0.3), (0, 0.2), (6, 0.5)] {
            let motion = Motion::new(poses(), own);
            let instant = motion.at(frames);
            let by_time = turn(&motion.at(frames - STEP), &motion.at(frames + STEP));
            assert!((by_time - instant.turn_rad).norm() < 1e-9);
            let by_turns = motion.turns_by_turns(&instant);
            for (place, by_turn) in by_turns.iter().enumerate() {
                for axis in 0..3 {
                    let moved = |step: f64| {
                        let mut poses = poses();
                        let mut increment = Vector6::zeros();
                        increment[axis] = step;
                        poses[place] = poses[place].moved_by(&increment);
                        Motion::new(poses, own).at(frames)
                    };
                    let difference = turn(&moved(-STEP), &moved(STEP));
                    let error = (difference - by_turn.column(axis)).norm();
                    assert!(error < 1e-9, "own {own}, place {place}, axis {axis}: {error}");
                }
            }
        }
    }
}
