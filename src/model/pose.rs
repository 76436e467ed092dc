//! Rigid transforms that carry their frames in their type, and the paper's
//! Euler angles.
//!
//! `Pose<Cam, Target>` is `cam_from_target`: it takes target coordinates to
//! camera coordinates. A product compiles only when the inner frames agree, so
//! that a wrong chain is a compile error and costs nothing at run time.

use core::marker::PhantomData;
use core::ops::Mul;

use nalgebra::{Matrix3, Matrix3x6, Vector3, Vector6};

/// The camera's frame: x right, y down, z forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cam;

/// The frame of one printed target: x along its columns, y along its rows, z away from the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Target;

/// The frame of the scene board: x to the person's right, y down, z forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scene;

/// A rigid transform from frame `From` to frame `To`, millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose<To, From> {
    /// Rotation: columns are the axes of `From`, in `To`.
    pub rotation: Matrix3<f64>,
    /// The origin of `From`, in `To`.
    pub translation_mm: Vector3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Pose<To, From> {
    /// The transform of this rotation and this translation.
    #[must_use]
    pub const fn new(rotation: Matrix3<f64>, translation_mm: Vector3<f64>) -> Self {
        Self { rotation, translation_mm, frames: PhantomData }
    }

    /// The identity transform.
    #[must_use]
    pub fn identity() -> Self {
        Self::new(Matrix3::identity(), Vector3::zeros())
    }

    /// The paper's kinematic matrix: theta1..3 are Euler angles in radians
    /// (R = Rz Ry Rx), theta4..6 the translation in millimetres.
    #[must_use]
    pub fn from_theta(theta: [f64; 6]) -> Self {
        let angles =
            EulerAngles { theta1_rad: theta[0], theta2_rad: theta[1], theta3_rad: theta[2] };
        Self::new(angles.rotation(), Vector3::new(theta[3], theta[4], theta[5]))
    }

    /// theta1..6, from which [`from_theta`](Self::from_theta) rebuilds this transform.
    #[must_use]
    pub fn theta(&self) -> [f64; 6] {
        let EulerAngles { theta1_rad, theta2_rad, theta3_rad } = self.euler();
        let position_mm = &self.translation_mm;
        [theta1_rad, theta2_rad, theta3_rad, position_mm.x, position_mm.y, position_mm.z]
    }

    /// A point of `From`, in `To`.
    #[must_use]
    pub fn transform(&self, point_mm: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point_mm + self.translation_mm
    }

    /// The inverse transform.
    #[must_use]
    pub fn inverse(&self) -> Pose<From, To> {
        let rotation = self.rotation.transpose();
        Pose::new(rotation, -(rotation * self.translation_mm))
    }

    /// The paper's Euler angles of the rotation.
    #[must_use]
    pub fn euler(&self) -> EulerAngles {
        EulerAngles::from_rotation(&self.rotation)
    }

    /// Moved by an increment `[omega_rad, delta_mm]`: the rotation turns by
    /// `omega` about the axes of `From`, the translation moves by `delta` in `To`.
    ///
    /// Rotating about the target's own origin keeps the six parameters nearly
    /// independent of each other, which a rotation about the far camera would not.
    #[must_use]
    pub fn moved_by(&self, increment: &Vector6<f64>) -> Self {
        let omega_rad = increment.fixed_rows::<3>(0).into_owned();
        let delta_mm = increment.fixed_rows::<3>(3).into_owned();
        Self::new(self.rotation * rotation_from_vector(&omega_rad), self.translation_mm + delta_mm)
    }

    /// The increment by which this transform is [moved](Self::moved_by) to another.
    #[must_use]
    pub fn increment_to(&self, other: &Self) -> Vector6<f64> {
        let turn_rad = vector_from_rotation(&(self.rotation.transpose() * other.rotation));
        let moved_mm = other.translation_mm - self.translation_mm;
        Vector6::from_iterator(turn_rad.iter().chain(moved_mm.iter()).copied())
    }

    /// How a point that is fixed to `From` moves in `To` with such an increment: `[-R [p]x, I]`.
    #[must_use]
    pub fn point_by_increment(&self, point_mm: &Vector3<f64>) -> Matrix3x6<f64> {
        let mut by_increment = Matrix3x6::zeros();
        let by_turn = -self.rotation * point_mm.cross_matrix();
        by_increment.fixed_columns_mut::<3>(0).copy_from(&by_turn);
        by_increment.fixed_columns_mut::<3>(3).copy_from(&Matrix3::identity());
        by_increment
    }
}

impl<A, B, C> Mul<Pose<B, C>> for Pose<A, B> {
    type Output = Pose<A, C>;

    fn mul(self, b_from_c: Pose<B, C>) -> Pose<A, C> {
        Pose::new(self.rotation * b_from_c.rotation, self.transform(&b_from_c.translation_mm))
    }
}

/// The paper's Euler angles: R = Rz(theta1) Ry(theta2) Rx(theta3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerAngles {
    /// About z, the outermost rotation, -pi to pi.
    pub theta1_rad: f64,
    /// About y, -pi/2 to pi/2.
    pub theta2_rad: f64,
    /// About x, -pi to pi.
    pub theta3_rad: f64,
}

impl EulerAngles {
    /// The rotation matrix: the upper left 3 x 3 of the paper's `M_Theta`.
    #[must_use]
    pub fn rotation(&self) -> Matrix3<f64> {
        let (s1, c1) = libm::sincos(self.theta1_rad);
        let (s2, c2) = libm::sincos(self.theta2_rad);
        let (s3, c3) = libm::sincos(self.theta3_rad);
        Matrix3::new(
            c1 * c2,
            c1 * s2 * s3 - s1 * c3,
            c1 * s2 * c3 + s1 * s3,
            s1 * c2,
            s1 * s2 * s3 + c1 * c3,
            s1 * s2 * c3 - c1 * s3,
            -s2,
            c2 * s3,
            c2 * c3,
        )
    }

    /// The angles of a rotation matrix. At theta2 = +-90 degrees theta1 and
    /// theta3 turn about the same axis; theta3 is then 0.
    #[must_use]
    pub fn from_rotation(rotation: &Matrix3<f64>) -> Self {
        let cos_theta2 = libm::hypot(rotation[(0, 0)], rotation[(1, 0)]);
        let theta2_rad = libm::atan2(-rotation[(2, 0)], cos_theta2);
        // Below this the two remaining axes are parallel to within rounding.
        if cos_theta2 < 1e-9 {
            let theta1_rad = libm::atan2(-rotation[(0, 1)], rotation[(1, 1)]);
            return Self { theta1_rad, theta2_rad, theta3_rad: 0.0 };
        }
        Self {
            theta1_rad: libm::atan2(rotation[(1, 0)], rotation[(0, 0)]),
            theta2_rad,
            theta3_rad: libm::atan2(rotation[(2, 1)], rotation[(2, 2)]),
        }
    }
}

/// The rotation by the angle |v| about the axis v (Rodrigues' formula).
#[must_use]
pub fn rotation_from_vector(rotation_rad: &Vector3<f64>) -> Matrix3<f64> {
    let angle_rad = rotation_rad.norm();
    let cross = rotation_rad.cross_matrix();
    // sin(a)/a and (1 - cos a)/a^2, by their series where the quotient loses digits.
    let (sine, versine) = if angle_rad < 1e-4 {
        let square = angle_rad * angle_rad;
        (1.0 - square / 6.0, 0.5 - square / 24.0)
    } else {
        let (sin, cos) = libm::sincos(angle_rad);
        (sin / angle_rad, (1.0 - cos) / (angle_rad * angle_rad))
    };
    Matrix3::identity() + cross * sine + cross * cross * versine
}

/// The rotation vector of a rotation matrix: the inverse of
/// [`rotation_from_vector`] for angles below pi.
#[must_use]
pub(crate) fn vector_from_rotation(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let axis_times_sine = Vector3::new(
        rotation[(2, 1)] - rotation[(1, 2)],
        rotation[(0, 2)] - rotation[(2, 0)],
        rotation[(1, 0)] - rotation[(0, 1)],
    ) * 0.5;
    let sine = axis_times_sine.norm();
    let cosine = (rotation.trace() - 1.0) * 0.5;
    let angle_rad = libm::atan2(sine, cosine);
    if sine < 1e-9 { axis_times_sine } else { axis_times_sine * (angle_rad / sine) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_are_the_papers_matrix_and_come_back() {
        let angles = EulerAngles { theta1_rad: 0.3, theta2_rad: -0.7, theta3_rad: 2.1 };
        let z = rotation_from_vector(&Vector3::new(0.0, 0.0, 0.3));
        let y = rotation_from_vector(&Vector3::new(0.0, -0.7, 0.0));
        let x = rotation_from_vector(&Vector3::new(2.1, 0.0, 0.0));
        assert!((angles.rotation() - z * y * x).norm() < 1e-15);
        let back = EulerAngles::from_rotation(&angles.rotation());
        assert!((back.theta1_rad - 0.3).abs() < 1e-15);
        assert!((back.theta2_rad + 0.7).abs() < 1e-15);
        assert!((back.theta3_rad - 2.1).abs() < 1e-15);
    }

    #[test]
    fn euler_angles_at_the_pole_still_give_the_rotation() {
        let pole = core::f64::consts::FRAC_PI_2;
        let angles = EulerAngles { theta1_rad: 0.4, theta2_rad: pole, theta3_rad: 0.1 };
        let back = EulerAngles::from_rotation(&angles.rotation());
        assert!((back.rotation() - angles.rotation()).norm() < 1e-12);
    }

    #[test]
    fn a_points_derivatives_are_central_differences() {
        const STEP: f64 = 1e-4;
        let pose = Pose::<Cam, Target>::from_theta([0.4, -0.3, 0.2, 10.0, -20.0, 900.0]);
        let point_mm = Vector3::new(40.0, -30.0, 100.0);
        let by_increment = pose.point_by_increment(&point_mm);
        for axis in 0..6 {
            let moved = |step: f64| {
                let mut increment = nalgebra::Vector6::zeros();
                increment[axis] = step;
                pose.moved_by(&increment).transform(&point_mm)
            };
            let difference = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
            // Of a turn by 1e-4 at 100 mm a sixth of the cube is 2e-7 mm per radian.
            assert!((difference - by_increment.column(axis)).norm() < 1e-6, "{axis}");
        }
    }

    #[test]
    fn theta_comes_back() {
        let theta = [0.1, -0.2, 0.3, 10.0, -20.0, 1000.0];
        let back = Pose::<Cam, Target>::from_theta(theta).theta();
        // The angles go through a rotation matrix, the translation is kept as it is.
        assert!(theta.iter().zip(back).all(|(from, to)| (from - to).abs() < 1e-14), "{back:?}");
    }

    #[test]
    fn a_pose_and_its_inverse_cancel() {
        let pose = Pose::<Cam, Target>::from_theta([0.1, -0.2, 0.3, 10.0, -20.0, 1000.0]);
        let round = pose * pose.inverse();
        assert!((round.rotation - Matrix3::identity()).norm() < 1e-14);
        assert!(round.translation_mm.norm() < 1e-12);
    }

    #[test]
    fn an_increment_comes_back() {
        let pose = Pose::<Cam, Target>::from_theta([0.1, -0.2, 0.3, 10.0, -20.0, 1000.0]);
        let increment = Vector6::new(0.02, -0.01, 0.3, 4.0, -5.0, 60.0);
        let back = pose.increment_to(&pose.moved_by(&increment));
        assert!((back - increment).norm() < 1e-12, "{back}");
    }

    #[test]
    fn rotation_vectors_come_back() {
        for size in [1e-12, 1e-5, 0.3, 3.0] {
            let vector = Vector3::new(0.48, -0.6, 0.64) * size;
            let back = vector_from_rotation(&rotation_from_vector(&vector));
            assert!((back - vector).norm() < 1e-14 + 1e-9 * size, "{size}");
        }
    }

    /// Only the difference of theta1 and theta3 counts at +90 degrees, only their sum at -90.
    #[test]
    fn at_the_pole_all_that_turns_about_one_axis_is_theta1() {
        let pole = core::f64::consts::FRAC_PI_2;
        for (theta2_rad, theta1_rad) in [(pole, 0.3), (-pole, 0.5)] {
            let angles = EulerAngles { theta1_rad: 0.4, theta2_rad, theta3_rad: 0.1 };
            let back = EulerAngles::from_rotation(&angles.rotation());
            assert!((back.theta1_rad - theta1_rad).abs() < 1e-15, "{back:?}");
            assert_eq!((back.theta2_rad, back.theta3_rad), (theta2_rad, 0.0));
            // A millionth before the pole, the axes differ; a matrix is good to 1e-16 in 1e-6.
            let near = EulerAngles { theta2_rad: theta2_rad * (1.0 - 1e-6), ..angles };
            let back = EulerAngles::from_rotation(&near.rotation());
            assert!((back.theta1_rad - 0.4).abs() < 1e-9, "{back:?}");
            assert!((back.theta3_rad - 0.1).abs() < 1e-9, "{back:?}");
        }
    }

    /// About the axis (0.6, 0.8, 0) by a: the last row is (-0.8 sin a, 0.6 sin a, cos a), and the
    /// product of x and y in the first is 0.48 (1 - cos a), which is 0.96 sin^2 (a/2).
    #[test]
    fn small_turns_keep_their_digits() {
        for angle_rad in [0.0, 1e-12, 1e-7, 1e-5, 3e-5, 9.9e-5] {
            let turn = rotation_from_vector(&(Vector3::new(0.6, 0.8, 0.0) * angle_rad));
            let sine = libm::sin(angle_rad);
            let half_sine = libm::sin(0.5 * angle_rad);
            for (place, expected) in [
                ((2, 0), -0.8 * sine),
                ((2, 1), 0.6 * sine),
                ((0, 1), 0.96 * half_sine * half_sine),
                ((1, 0), 0.96 * half_sine * half_sine),
            ] {
                // Rounding of some four products.
                let error = (turn[place] - expected).abs();
                assert!(error <= 1e-15 * expected.abs(), "{angle_rad} {place:?}: {error}");
            }
        }
    }

    #[test]
    fn no_turn_has_the_vector_zero() {
        assert_eq!(vector_from_rotation(&Matrix3::identity()), Vector3::zeros());
    }
}
