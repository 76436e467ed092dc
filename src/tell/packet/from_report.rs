//! Converts a report into a packet: from f64 to the numbers on the wire.

use super::pose::{
    AnatomicalPoint, CORRELATIONS, MarkedInstant, MeasuredPose, PosePacket, TargetPacket, pairs,
};
use crate::fit::measure::Measurement;
use crate::model::scene::Anatomical;
use crate::tell::report::{Report, TargetReport};

impl PosePacket {
    /// The packet of one frame. `instant` is what the report's capture time marks; `latency_us`
    /// counts until this packet is handed over.
    #[must_use]
    pub fn from_report(report: &Report, instant: MarkedInstant, latency_us: u32) -> Self {
        Self {
            sequence: report.sequence,
            capture_time_ns: report.capture_time_ns,
            instant,
            latency_us,
            targets: report.targets.iter().map(TargetPacket::from).collect(),
            upper_trunk: report.upper_trunk.as_ref().map(AnatomicalPoint::from),
            lower_trunk: report.lower_trunk.as_ref().map(AnatomicalPoint::from),
        }
    }
}

impl From<&TargetReport> for TargetPacket {
    fn from(report: &TargetReport) -> Self {
        Self {
            role: report.role,
            state: report.state,
            pose: report.measurement.as_ref().map(MeasuredPose::from).map_err(|&reason| reason),
        }
    }
}

impl From<&Measurement> for MeasuredPose {
    fn from(measurement: &Measurement) -> Self {
        let angles = measurement.cam_from_target.euler();
        let rad = [angles.theta1_rad, angles.theta2_rad, angles.theta3_rad];
        let covariance = &measurement.covariance;
        let sd = |axis: usize| libm::sqrt(covariance[(axis, axis)]);
        let mut correlations = [0.0; CORRELATIONS];
        for ((i, j), correlation) in pairs().zip(&mut correlations) {
            *correlation = (covariance[(i, j)] / (sd(i) * sd(j))) as f32;
        }
        Self {
            delay_ns: measurement.delay_ns,
            theta_rad: rad.map(|angle| angle as f32),
            translation_mm: measurement.cam_from_target.translation_mm.map(|mm| mm as f32).into(),
            sd_mm: measurement.sd_mm().map(|mm| mm as f32).into(),
            sd_rad: [0, 1, 2].map(|axis| sd(axis) as f32),
            correlations,
            rms_px: measurement.rms_px as f32,
            corners: measurement.corners,
        }
    }
}

impl From<&Anatomical> for AnatomicalPoint {
    fn from(point: &Anatomical) -> Self {
        Self { ap_mm: point.ap_mm as f32, ml_mm: point.ml_mm as f32, si_mm: point.si_mm as f32 }
    }
}
