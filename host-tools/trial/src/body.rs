//! The trunk points of a frame with their covariances: what relates the poses of the targets to the
//! body.

use nalgebra::{Matrix3, Vector3};
use plumbline::config::Config;
use plumbline::packet::{AnatomicalPoint, MeasuredPose, PosePacket};
use plumbline::scene::SceneFrame;
use plumbline::target::Role;

use crate::frame::{Point, Trunk};

/// The scene, and where the lower trunk lies from its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    scene: SceneFrame,
    lower_mm: Vector3<f64>,
}

impl Body {
    /// As a box was told; `None` until its scene has been measured.
    #[must_use]
    pub fn of(config: &Config) -> Option<Self> {
        let scene = SceneFrame::new(config.cam_from_scene()?);
        let lower = config.target(Role::Lower).map(|it| it.geometry.virtual_point_mm());
        Some(Self { scene, lower_mm: lower.unwrap_or_default() })
    }

    /// The covariance along AP, ML and SI of a trunk's point, mm².
    #[must_use]
    pub fn covariance_mm2(&self, trunk: Trunk, pose: &MeasuredPose) -> Matrix3<f64> {
        let from_target_mm = match trunk {
            Trunk::Upper => Vector3::zeros(),
            Trunk::Lower => self.lower_mm,
        };
        let by_increment = pose.cam_from_target().point_by_increment(&from_target_mm);
        let jacobian = self.scene.anatomical_from_cam() * by_increment;
        let covariance = jacobian * pose.covariance() * jacobian.transpose();
        let covariance = 0.5 * (covariance + covariance.transpose());
        if covariance.cholesky().is_some() {
            return covariance;
        }
        // Correlations come rounded to 1/127, which can leave a variance below 0 in some direction:
        // the nearest covariance has none there.
        let mut eigen = covariance.symmetric_eigen();
        eigen.eigenvalues.apply(|it| *it = it.max(0.0));
        eigen.recompose()
    }
}

/// A trunk's point in a frame; `time_s` gives the time of a capture time. `None` where the frame has
/// none; without `body` the point has no covariance.
#[must_use]
pub fn point(
    packet: &PosePacket,
    trunk: Trunk,
    body: Option<&Body>,
    time_s: impl FnOnce(u64) -> f64,
) -> Option<Point> {
    let point = match trunk {
        Trunk::Upper => packet.upper_trunk,
        Trunk::Lower => packet.lower_trunk,
    };
    let AnatomicalPoint { ap_mm, ml_mm, si_mm } = point?;
    let pose = packet.pose(trunk.role());
    let frame_ns = packet.capture_time_ns;
    Some(Point {
        time_s: time_s(pose.map_or(frame_ns, |pose| pose.own_time_ns(frame_ns))),
        position_mm: [ap_mm, ml_mm, si_mm].map(f64::from),
        covariance_mm2: body.zip(pose).map(|(body, pose)| body.covariance_mm2(trunk, pose)),
    })
}
