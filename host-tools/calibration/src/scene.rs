//! The mean pose of a board at rest, how far it is from another, and how far from upright.

use nalgebra::{Matrix3, Vector3};
use plumbline::pose::{Cam, Pose, Scene, Target};

use crate::rotation::mean_pose;

/// The mean pose of a board at rest, and the spread of single poses about it.
pub struct Mean {
    /// The mean.
    pub cam_from_scene: Pose<Cam, Scene>,
    /// Root mean square angle of the poses from the mean.
    pub spread_deg: f64,
    /// Root mean square distance of the poses from the mean.
    pub spread_mm: f64,
}

impl Mean {
    /// The [mean](mean_pose) of poses.
    pub fn of(poses: &[Pose<Cam, Target>]) -> Self {
        let count = poses.len() as f64;
        let Pose { rotation, translation_mm, .. } = mean_pose(poses);
        let squares: f64 =
            poses.iter().map(|pose| angle_rad(&pose.rotation, &rotation).powi(2)).sum();
        let squares_mm2: f64 =
            poses.iter().map(|pose| (pose.translation_mm - translation_mm).norm_squared()).sum();
        Self {
            cam_from_scene: Pose::new(rotation, translation_mm),
            spread_deg: (squares / count).sqrt().to_degrees(),
            spread_mm: (squares_mm2 / count).sqrt(),
        }
    }
}

fn angle_rad(one: &Matrix3<f64>, other: &Matrix3<f64>) -> f64 {
    // The chord of an angle a between two rotations is sqrt(8) sin(a / 2).
    2.0 * ((one - other).norm() / 8.0_f64.sqrt()).min(1.0).asin()
}

/// The angle, in degrees, and the distance, in millimetres, from one pose to another.
#[must_use]
pub fn between(one: &Pose<Cam, Scene>, other: &Pose<Cam, Scene>) -> (f64, f64) {
    let distance_mm = (one.translation_mm - other.translation_mm).norm();
    (angle_rad(&one.rotation, &other.rotation).to_degrees(), distance_mm)
}

/// The angle between the board's downward axis and where gravity is expected to pull.
pub fn lean_deg(cam_from_scene: &Pose<Cam, Scene>, camera_pitch_deg: f64) -> f64 {
    let (sine, cosine) = camera_pitch_deg.to_radians().sin_cos();
    let gravity = Vector3::new(0.0, cosine, sine);
    gravity.dot(&cam_from_scene.rotation.column(1)).clamp(-1.0, 1.0).acos().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_poses_about_one_is_that_one() {
        let middle = Pose::<Cam, Target>::from_theta([0.1, 0.3, -0.2, 10.0, 20.0, 900.0]);
        let off = |sign: f64| {
            middle.moved_by(&(nalgebra::Vector6::new(0.01, -0.02, 0.02, 0.3, 0.4, 0.0) * sign))
        };
        let mean = Mean::of(&[off(1.0), off(-1.0)]);
        assert!((mean.cam_from_scene.rotation - middle.rotation).norm() < 1e-12);
        assert!((mean.cam_from_scene.translation_mm - middle.translation_mm).norm() < 1e-12);
        // Each pose is turned by 0.03 rad and moved by 0.5 mm.
        assert!((mean.spread_deg - 0.03_f64.to_degrees()).abs() < 1e-9);
        assert!((mean.spread_mm - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_board_leans_by_its_angle_to_gravity() {
        let upright = Pose::<Cam, Scene>::from_theta([0.0, 0.4, 0.0, 0.0, 0.0, 900.0]);
        assert!(lean_deg(&upright, 0.0) < 1e-6);
        // A camera that looks down by 10 degrees sees an upright board tilted.
        assert!((lean_deg(&upright, 10.0) - 10.0).abs() < 1e-9);
        let tilt = 10.0_f64.to_radians();
        let seen = Pose::<Cam, Scene>::from_theta([0.0, 0.0, tilt, 0.0, 0.0, 900.0]);
        assert!(lean_deg(&seen, 10.0) < 1e-6, "{}", lean_deg(&seen, 10.0));
    }
}
