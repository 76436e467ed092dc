//! How the trunk's targets are turned, as unit quaternions.
//!
//! AP, ML and SI are a left-handed frame, in which a quaternion has no meaning. Orientations are in
//! the right-handed one of [`right_handed`](super::right_handed): X forward, Y to the person's left,
//! Z up. A target that is parallel to the scene's board has the identity. A turn about X leans to
//! the person's right, one about Y bends forward, one about Z turns to the left; each is a rotation
//! of the body relative to the scene, `body_from_scene * scene_from_target * scene_from_body`.
//!
//! `q` and `-q` are the same orientation. The first has `w >= 0`, and each later one the sign that
//! is nearer to the one before, so that no component jumps.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use plumbline::config::Config;

use crate::Trial;
use crate::frame::Trunk;
use crate::points::{Points, frames_of};

/// An orientation.
pub type Orientation = UnitQuaternion<f64>;

/// What the components are, for files that have room for it.
pub const QUATERNION: &str = "quat_w, quat_x, quat_y, quat_z: the target's orientation relative to \
                              the scene's board, in the right-handed frame X forward (AP), Y to the \
                              left (-ML), Z up (SI)";

/// The components in the order of the columns.
pub const COMPONENTS: [&str; 4] = ["w", "x", "y", "z"];

/// w, x, y and z.
pub fn components(orientation: &Orientation) -> [f64; 4] {
    [orientation.w, orientation.i, orientation.j, orientation.k]
}

/// The orientation of each point's target in each of the point's samples; `None` everywhere where
/// the trial does not tell the scene's pose.
pub fn of(trial: &Trial, points: &Points) -> Vec<Vec<Option<Orientation>>> {
    let cam_from_scene = trial.config.as_ref().and_then(Config::cam_from_scene);
    let body_from_cam =
        cam_from_scene.map(|cam_from_scene| BODY_FROM_SCENE * cam_from_scene.rotation.transpose());
    let of_trunk = |trunk: Trunk| {
        let frames = frames_of(&trial.frames, trunk);
        let turned = frames.map(|(frame, _)| {
            let body_from_target = body_from_cam? * frame.cam_from_target(trunk)?.rotation;
            Some(quaternion(&(body_from_target * BODY_FROM_SCENE.transpose())))
        });
        continuous(turned)
    };
    let trunk_of = |name: &str| Trunk::ALL.into_iter().find(|trunk| trunk.word() == name);
    let points = points.points.iter();
    points.map(|point| trunk_of(&point.name).map(of_trunk).unwrap_or_default()).collect()
}

/// X is the scene's z, Y its -x, Z its -y.
const BODY_FROM_SCENE: Matrix3<f64> = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);

fn quaternion(rotation: &Matrix3<f64>) -> Orientation {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation))
}

/// Each with the sign that is nearer to the one before.
fn continuous(turned: impl Iterator<Item = Option<Orientation>>) -> Vec<Option<Orientation>> {
    let mut before = Orientation::identity();
    let signed = turned.map(|orientation| {
        let orientation = orientation?;
        let is_near = orientation.coords.dot(&before.coords) >= 0.0;
        before = if is_near { orientation } else { UnitQuaternion::new_unchecked(-*orientation) };
        Some(before)
    });
    signed.collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn about(axis: Vector3<f64>, angle_rad: f64) -> Matrix3<f64> {
        *Rotation3::from_scaled_axis(axis * angle_rad).matrix()
    }

    /// In the scene's axes: x to the person's right, y down, z forward.
    #[test]
    fn each_axis_of_the_body_is_where_it_says() {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        // To the person's right, as seen from behind: clockwise, about the forward axis.
        for (axis_in_scene, axis_in_body) in [(z, x), (-x, y), (-y, z)] {
            let turned = about(axis_in_scene, 0.2);
            let found = quaternion(&(BODY_FROM_SCENE * turned * BODY_FROM_SCENE.transpose()));
            assert!((found.scaled_axis() - 0.2 * axis_in_body).norm() < 1e-12, "{found}");
        }
        assert!((BODY_FROM_SCENE.determinant() - 1.0).abs() < 1e-15);
        // Bending forward takes the upper end, -y in the scene, forward.
        assert!((about(-x, 0.2) * -y).z > 0.19);
    }

    /// Two turns, in steps and with a gap: each component's step is small, also where w is 0.
    #[test]
    fn no_component_jumps() {
        let turned = (0..200).map(|at| {
            let angle_rad = std::f64::consts::TAU * f64::from(at) / 100.0;
            (at % 10 != 7).then(|| quaternion(&about(Vector3::z(), angle_rad)))
        });
        let found: Vec<Orientation> = continuous(turned).into_iter().flatten().collect();
        assert_eq!(found.len(), 180);
        assert!(found[0].w > 0.0);
        for pair in found.windows(2) {
            // Over a gap of one the half angle changes by 0.063 rad.
            assert!((pair[1].coords - pair[0].coords).norm() < 0.063, "{pair:?}");
        }
        assert!(found.iter().any(|it| it.w < -0.99));
    }
}
