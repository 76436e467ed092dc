//! How well a trunk point is known along the body's axes, from the covariance of its target's pose.

use nalgebra::{Matrix3, Vector3};
use plumbline::config::Config;
use plumbline::packet::MeasuredPose;
use plumbline::scene::SceneFrame;
use plumbline::target::Role;

use crate::frame::Trunk;

/// What relates the targets to the body.
#[derive(Debug, Clone, Copy)]
pub struct Body {
    scene: SceneFrame,
    /// The lower trunk's point on its target.
    lever_mm: Vector3<f64>,
}

impl Body {
    /// By a box's configuration; `None` where it has no scene.
    #[must_use]
    pub fn of(config: &Config) -> Option<Self> {
        let scene = SceneFrame::new(config.cam_from_scene()?);
        let lower = config.targets.iter().find(|it| it.geometry.role() == Role::Lower);
        let lever_mm = lower.map(|it| it.geometry.virtual_point_mm());
        Some(Self { scene, lever_mm: lever_mm.unwrap_or_default() })
    }

    /// The covariance of a trunk point along AP, ML and SI.
    #[must_use]
    pub fn covariance_mm2(&self, pose: &MeasuredPose, trunk: Trunk) -> Matrix3<f64> {
        let lever_mm = match trunk {
            Trunk::Upper => Vector3::zeros(),
            Trunk::Lower => self.lever_mm,
        };
        let by_increment = pose.cam_from_target().point_by_increment(&lever_mm);
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
