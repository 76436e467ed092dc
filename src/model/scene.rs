//! From the camera to the body: positions along the anatomical axes.
//!
//! A board that stands upright and faces the camera behind the person defines
//! the scene frame; its pose in the camera is the paper's E. A point z of the
//! camera frame lies at z' = E^-1 z in the scene, and its coordinates there,
//! with the signs of the ISPGR, are the measurement:
//!
//! ```text
//! AP (anterior-posterior) = +z': forward      ML (medial-lateral) = +x': to the person's right
//! SI (superior-inferior)  = -y': up
//! ```
//!
//! The camera stands behind the person, so that its right is the person's right and away from it is
//! forward. Millimetres; the zero is the board's origin. The axes are only as true as the board is
//! upright: if it leans by 1 degree, 1.7 % of the vertical motion leaks into AP.

use nalgebra::{Matrix3, Vector3};

use crate::model::pose::{Cam, Pose, Scene, Target};

/// A position along the body's axes, ISPGR signs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anatomical {
    /// Anterior-posterior, + forward.
    pub ap_mm: f64,
    /// Medial-lateral, + to the person's right.
    pub ml_mm: f64,
    /// Superior-inferior, + up.
    pub si_mm: f64,
}

/// The scene board's pose, the paper's E, and what it is for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneFrame {
    cam_from_scene: Pose<Cam, Scene>,
}

impl SceneFrame {
    /// The scene frame of a board at this pose.
    #[must_use]
    pub const fn new(cam_from_scene: Pose<Cam, Scene>) -> Self {
        Self { cam_from_scene }
    }

    /// The board's pose.
    #[must_use]
    pub fn cam_from_scene(&self) -> &Pose<Cam, Scene> {
        &self.cam_from_scene
    }

    /// A point of the camera frame along the anatomical axes: z' = E^-1 z.
    #[must_use]
    pub fn anatomical(&self, point_cam_mm: &Vector3<f64>) -> Anatomical {
        let from_board_mm = point_cam_mm - self.cam_from_scene.translation_mm;
        let point_scene_mm = self.cam_from_scene.rotation.tr_mul(&from_board_mm);
        Anatomical { ap_mm: point_scene_mm.z, ml_mm: point_scene_mm.x, si_mm: -point_scene_mm.y }
    }

    /// The rotation that takes a direction of the camera frame to the anatomical axes: AP, ML and
    /// SI, in this order. It transforms covariances as well.
    #[must_use]
    pub fn anatomical_from_cam(&self) -> Matrix3<f64> {
        // AP is the scene's z, ML its x, SI its -y.
        let anatomical_from_scene = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        anatomical_from_scene * self.cam_from_scene.rotation.transpose()
    }

    /// The upper trunk, the paper's z_u: the origin of the target on the shoulder.
    #[must_use]
    pub fn upper_trunk(&self, cam_from_upper: &Pose<Cam, Target>) -> Anatomical {
        self.anatomical(&cam_from_upper.translation_mm)
    }

    /// The lower trunk, the paper's z_l = M(Theta) Delta_l: a point deep in the
    /// body, fixed in the frame of the target on the lower back.
    #[must_use]
    pub fn lower_trunk(
        &self,
        cam_from_lower: &Pose<Cam, Target>,
        virtual_point_mm: &Vector3<f64>,
    ) -> Anatomical {
        self.anatomical(&cam_from_lower.transform(virtual_point_mm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::pose::rotation_from_vector;

    /// A camera on a shelf to the person's right: it looks down by 15 degrees,
    /// 10 degrees to the left, and has rolled by 3 degrees.
    fn tilted_camera() -> SceneFrame {
        let rotation = rotation_from_vector(&Vector3::new(0.0, 0.0, 3_f64.to_radians()))
            * rotation_from_vector(&Vector3::new(0.0, 10_f64.to_radians(), 0.0))
            * rotation_from_vector(&Vector3::new(15_f64.to_radians(), 0.0, 0.0));
        SceneFrame::new(Pose::new(rotation, Vector3::new(-30.0, 40.0, 1500.0)))
    }

    fn difference(after: Anatomical, before: Anatomical) -> [f64; 3] {
        [after.ap_mm - before.ap_mm, after.ml_mm - before.ml_mm, after.si_mm - before.si_mm]
    }

    fn assert_near(found: [f64; 3], wanted: [f64; 3]) {
        for (found, wanted) in found.iter().zip(wanted) {
            // Coordinates near 1,500 mm are rounded at 2e-13 mm.
            assert!((found - wanted).abs() < 1e-11, "{found} is not {wanted}");
        }
    }

    #[test]
    fn a_level_camera_behind_the_person_sees_forward_right_and_up() {
        let scene = SceneFrame::new(Pose::new(Matrix3::identity(), Vector3::new(0.0, 0.0, 2000.0)));
        let stands = scene.anatomical(&Vector3::new(0.0, 0.0, 1000.0));
        // Away from the camera behind the back: forward.
        let leaned = scene.anatomical(&Vector3::new(0.0, 0.0, 1007.0));
        assert_near(difference(leaned, stands), [7.0, 0.0, 0.0]);
        // To the right in the picture of a back: to the person's right.
        let shifted = scene.anatomical(&Vector3::new(7.0, 0.0, 1000.0));
        assert_near(difference(shifted, stands), [0.0, 7.0, 0.0]);
        // Up is towards smaller y.
        let risen = scene.anatomical(&Vector3::new(0.0, -7.0, 1000.0));
        assert_near(difference(risen, stands), [0.0, 0.0, 7.0]);
        // The zero is the board: the person stands 1 m behind it.
        assert_near([stands.ap_mm, stands.ml_mm, stands.si_mm], [-1000.0, 0.0, 0.0]);
    }

    #[test]
    fn the_cameras_attitude_does_not_matter() {
        let scene = tilted_camera();
        let cam_from_scene = *scene.cam_from_scene();
        let scene_from_target =
            Pose::<Scene, Target>::from_theta([0.1, 0.2, -0.1, 50.0, -60.0, -500.0]);
        let stands = scene.upper_trunk(&(cam_from_scene * scene_from_target));
        assert_near([stands.ap_mm, stands.ml_mm, stands.si_mm], [-500.0, 50.0, 60.0]);
        // 3 mm forward, 4 mm to the right, 5 mm up, in the scene's axes.
        let mut moved = scene_from_target;
        moved.translation_mm += Vector3::new(4.0, -5.0, 3.0);
        let moved = scene.upper_trunk(&(cam_from_scene * moved));
        assert_near(difference(moved, stands), [3.0, 4.0, 5.0]);
    }

    #[test]
    fn directions_have_the_same_axes_as_positions() {
        let scene = tilted_camera();
        let (from, to) = (Vector3::new(10.0, -20.0, 900.0), Vector3::new(13.0, -15.0, 902.0));
        let turned = scene.anatomical_from_cam() * (to - from);
        assert_near(turned.into(), difference(scene.anatomical(&to), scene.anatomical(&from)));
    }

    #[test]
    fn the_lower_trunk_lies_inside_the_body_and_swings_with_the_target() {
        let scene = tilted_camera();
        let delta_mm = Vector3::new(0.0, 0.0, 100.0);
        let lower = |rotation_scene: Matrix3<f64>| {
            let scene_from_target =
                Pose::<Scene, Target>::new(rotation_scene, Vector3::new(0.0, 0.0, -500.0));
            let cam_from_target = *scene.cam_from_scene() * scene_from_target;
            let upper = scene.upper_trunk(&cam_from_target);
            difference(scene.lower_trunk(&cam_from_target, &delta_mm), upper)
        };
        // Straight: 100 mm in front of the skin.
        assert_near(lower(Matrix3::identity()), [100.0, 0.0, 0.0]);
        // The back turns to face the person's left (z swings to the right: a
        // turn of +30 degrees about y, which points down).
        let turned = rotation_from_vector(&Vector3::new(0.0, 30_f64.to_radians(), 0.0));
        assert_near(lower(turned), [100.0 * 30_f64.to_radians().cos(), 50.0, 0.0]);
        // The pelvis tilts so that z swings up: +30 degrees about x.
        let tilted = rotation_from_vector(&Vector3::new(30_f64.to_radians(), 0.0, 0.0));
        assert_near(lower(tilted), [100.0 * 30_f64.to_radians().cos(), 0.0, 50.0]);
    }
}
