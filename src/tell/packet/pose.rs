//! The pose packet: one frame's result in as few bytes as its precision needs.

use heapless::Vec;
use nalgebra::Matrix6;
use postcard_schema::Schema;
use postcard_schema::schema::NamedType;
use serde::{Deserialize, Serialize};

use crate::limits::TARGETS_MAX;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::Role;
use crate::tell::report::{NoPose, TargetState};

/// Steps of a standard deviation on the wire, per millimetre.
pub(super) const SD_STEPS_PER_MM: u16 = 10_000;

/// Steps of an angle's standard deviation on the wire, per radian: 65 mrad at most.
pub(super) const SD_STEPS_PER_RAD: f32 = 1e6;

/// Steps of a correlation on the wire.
pub(super) const CORRELATION_STEPS: i8 = 127;

/// No room is larger: a position further from the camera, or from the scene's origin, along any
/// axis is no measurement.
pub const POSITION_MM_MAX: f32 = 100_000.0;

/// The largest angle that is sent: pi, and its rounding to single precision.
const ANGLE_RAD_MAX: f32 = core::f32::consts::PI + 1e-6;

/// Correlations between six numbers.
pub const CORRELATIONS: usize = 15;

/// Steps of a reprojection error on the wire, per pixel.
pub(super) const RMS_STEPS_PER_PX: u16 = 10_000;

/// A standard deviation arrives rounded to this; the largest, 6.5535 mm, also
/// stands for everything above it.
pub const SD_STEP_MM: f64 = 1.0 / SD_STEPS_PER_MM as f64;

/// A reprojection error arrives rounded to this; the largest, 6.5535 px, also
/// stands for everything above it.
pub const RMS_STEP_PX: f64 = 1.0 / RMS_STEPS_PER_PX as f64;

/// Which instant of a frame its capture time marks. Where a camera reads its rows one after the
/// other, it is that instant of the row that is read first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum MarkedInstant {
    /// Half of the exposure was over.
    ExposureMiddle,
    /// The sensor started to collect light.
    ExposureStart,
    /// The sensor stopped collecting light.
    ExposureEnd,
    /// The frame reached the computer: exposure, readout and transport later.
    FrameArrival,
    /// The frame's time in a recording that is replayed.
    Recording,
}

/// A point along the body's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct AnatomicalPoint {
    /// Forward.
    pub ap_mm: f32,
    /// To the person's right.
    pub ml_mm: f32,
    /// Up.
    pub si_mm: f32,
}

/// A target's pose, `cam_from_target`, and how good it is.
///
/// f32 is fine enough: at 1,000 mm its step is 0.00006 mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "MeasuredPoseWire", into = "MeasuredPoseWire")]
pub struct MeasuredPose {
    /// How much later than the frame's capture time the target was exposed: the middle row of its
    /// picture. The pose, and the trunk point that follows from it, are of that instant.
    pub delay_ns: u32,
    /// theta1..3 of R = Rz(theta1) Ry(theta2) Rx(theta3).
    pub theta_rad: [f32; 3],
    /// The target's origin in the camera frame: x, y, z.
    pub translation_mm: [f32; 3],
    /// Standard deviations of x, y, z; sent in steps of [`SD_STEP_MM`].
    pub sd_mm: [f32; 3],
    /// Standard deviations of small turns about the target's x, y and z axes; sent in
    /// steps of a microradian.
    pub sd_rad: [f32; 3],
    /// Correlations of the three turns and x, y, z, in this order: the upper triangle of
    /// their matrix, row by row; sent in steps of 1/127.
    pub correlations: [f32; CORRELATIONS],
    /// Reprojection error, root mean square of the residuals' lengths; sent in
    /// steps of [`RMS_STEP_PX`].
    pub rms_px: f32,
    /// Corners used; the target's total is in the [`Hello`](super::Hello).
    pub corners: u8,
}

impl MeasuredPose {
    /// When the target was exposed, in a frame of this capture time.
    #[must_use]
    pub fn own_time_ns(&self, capture_time_ns: u64) -> u64 {
        capture_time_ns.saturating_add(self.delay_ns.into())
    }

    /// The pose as the core's type, from single precision.
    #[must_use]
    pub fn cam_from_target(&self) -> Pose<Cam, Target> {
        let [theta1, theta2, theta3] = self.theta_rad.map(f64::from);
        let [x, y, z] = self.translation_mm.map(f64::from);
        Pose::from_theta([theta1, theta2, theta3, x, y, z])
    }

    /// Covariance of `[omega_rad (target axes), delta_mm (camera axes)]`, the increments of
    /// [`crate::model::pose::Pose::moved_by`].
    #[must_use]
    pub fn covariance(&self) -> Matrix6<f64> {
        let sd = |axis: usize| match axis {
            0..3 => f64::from(self.sd_rad[axis]),
            _ => f64::from(self.sd_mm[axis - 3]),
        };
        let mut covariance = Matrix6::from_fn(|i, j| if i == j { sd(i) * sd(i) } else { 0.0 });
        for ((i, j), &correlation) in pairs().zip(&self.correlations) {
            covariance[(i, j)] = f64::from(correlation) * sd(i) * sd(j);
            covariance[(j, i)] = covariance[(i, j)];
        }
        covariance
    }
}

/// Indices of the upper triangle of a 6 x 6 matrix, row by row, without the diagonal.
pub(super) fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i + 1..6).map(move |j| (i, j)))
}

/// One target in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct TargetPacket {
    /// Which target.
    pub role: Role,
    /// Its state after this frame.
    pub state: TargetState,
    /// Its pose, or why there is none.
    pub pose: Result<MeasuredPose, NoPose>,
}

/// One frame's result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "PosePacketWire", into = "PosePacketWire")]
pub struct PosePacket {
    /// Counts the frames since the box's start, including those whose packets were lost.
    pub sequence: u32,
    /// When the frame was taken, on the capture clock; each target's own time is later by its
    /// [`delay_ns`](MeasuredPose::delay_ns).
    pub capture_time_ns: u64,
    /// Which instant of the frame that is.
    pub instant: MarkedInstant,
    /// Time from the marked instant until this packet is handed to the links.
    pub latency_us: u32,
    /// One entry per configured target.
    pub targets: Vec<TargetPacket, TARGETS_MAX>,
    /// The upper trunk point in the scene's axes, at its target's own time; `None` without a pose or
    /// a scene.
    pub upper_trunk: Option<AnatomicalPoint>,
    /// The lower trunk point likewise.
    pub lower_trunk: Option<AnatomicalPoint>,
}

impl PosePacket {
    /// The pose of the target with a role; `None` where it has none in this frame.
    #[must_use]
    pub fn pose(&self, role: Role) -> Option<&MeasuredPose> {
        self.targets.iter().find(|target| target.role == role)?.pose.as_ref().ok()
    }

    /// When this packet was handed to the links, on the capture clock. It wraps, as a clock that a stranger
    /// makes up may do.
    #[must_use]
    pub const fn handed_over_ns(&self) -> u64 {
        self.capture_time_ns.wrapping_add(1000 * self.latency_us as u64)
    }

    /// Whether each number can be that of a measurement in a room. The deviations can: their fixed
    /// point is neither negative nor infinite.
    pub(super) fn is_measurable(&self) -> bool {
        let mut poses = self.targets.iter().filter_map(|target| target.pose.as_ref().ok());
        let mut trunk = [self.upper_trunk, self.lower_trunk].into_iter().flatten();
        let are_measurable = |pose: &MeasuredPose| {
            pose.theta_rad.iter().all(|angle| angle.abs() <= ANGLE_RAD_MAX)
                && pose.translation_mm.into_iter().all(is_in_a_room)
        };
        let is_near =
            |it: AnatomicalPoint| [it.ap_mm, it.ml_mm, it.si_mm].into_iter().all(is_in_a_room);
        poses.all(are_measurable) && trunk.all(is_near)
    }
}

/// [`MeasuredPose`] as sent: fixed-point numbers, each of a fixed width.
#[derive(Clone, Copy, Serialize, Deserialize, Schema)]
struct MeasuredPoseWire {
    delay_ns: [u8; 4],
    theta_rad: [f32; 3],
    translation_mm: [f32; 3],
    sd_steps: [[u8; 2]; 3],
    sd_turn_steps: [[u8; 2]; 3],
    correlation_steps: [i8; CORRELATIONS],
    rms_steps: [u8; 2],
    corners: u8,
}

/// [`PosePacket`] as sent. The integers have a fixed width: postcard's varints would be shorter for
/// small values, but longer in the worst case, which is what counts.
#[derive(Clone, Serialize, Deserialize, Schema)]
struct PosePacketWire {
    sequence: [u8; 4],
    capture_time_ns: [u8; 8],
    instant: MarkedInstant,
    latency_us: [u8; 4],
    targets: Vec<TargetPacket, TARGETS_MAX>,
    upper_trunk: Option<AnatomicalPoint>,
    lower_trunk: Option<AnatomicalPoint>,
}

impl Schema for MeasuredPose {
    const SCHEMA: &'static NamedType = MeasuredPoseWire::SCHEMA;
}

impl Schema for PosePacket {
    const SCHEMA: &'static NamedType = PosePacketWire::SCHEMA;
}

/// False for what is not finite, too.
fn is_in_a_room(coordinate_mm: f32) -> bool {
    coordinate_mm.abs() <= POSITION_MM_MAX
}

/// Fixed point, rounded; a value that is too large, or NaN, becomes the largest.
fn steps(value: f32, steps_per_unit: f32) -> [u8; 2] {
    let scaled = value * steps_per_unit + 0.5;
    // `as` saturates at both ends; it would turn NaN into 0, which becomes the largest here.
    let steps = if scaled.is_nan() { u16::MAX } else { scaled as u16 };
    steps.to_le_bytes()
}

fn from_steps(steps: [u8; 2], steps_per_unit: f32) -> f32 {
    f32::from(u16::from_le_bytes(steps)) / steps_per_unit
}

impl From<MeasuredPose> for MeasuredPoseWire {
    fn from(pose: MeasuredPose) -> Self {
        Self {
            delay_ns: pose.delay_ns.to_le_bytes(),
            theta_rad: pose.theta_rad,
            translation_mm: pose.translation_mm,
            sd_steps: pose.sd_mm.map(|sd_mm| steps(sd_mm, SD_STEPS_PER_MM.into())),
            sd_turn_steps: pose.sd_rad.map(|sd_rad| steps(sd_rad, SD_STEPS_PER_RAD)),
            // Rounded, half steps away from 0; `as` saturates, and turns NaN into 0.
            correlation_steps: pose.correlations.map(|correlation| {
                let scaled = correlation * f32::from(CORRELATION_STEPS);
                (scaled + libm::copysignf(0.5, scaled)) as i8
            }),
            rms_steps: steps(pose.rms_px, RMS_STEPS_PER_PX.into()),
            corners: pose.corners,
        }
    }
}

impl From<MeasuredPoseWire> for MeasuredPose {
    fn from(wire: MeasuredPoseWire) -> Self {
        Self {
            delay_ns: u32::from_le_bytes(wire.delay_ns),
            theta_rad: wire.theta_rad,
            translation_mm: wire.translation_mm,
            sd_mm: wire.sd_steps.map(|sd| from_steps(sd, SD_STEPS_PER_MM.into())),
            sd_rad: wire.sd_turn_steps.map(|sd| from_steps(sd, SD_STEPS_PER_RAD)),
            correlations: wire
                .correlation_steps
                .map(|steps| f32::from(steps) / f32::from(CORRELATION_STEPS)),
            rms_px: from_steps(wire.rms_steps, RMS_STEPS_PER_PX.into()),
            corners: wire.corners,
        }
    }
}

impl From<PosePacket> for PosePacketWire {
    fn from(packet: PosePacket) -> Self {
        Self {
            sequence: packet.sequence.to_le_bytes(),
            capture_time_ns: packet.capture_time_ns.to_le_bytes(),
            instant: packet.instant,
            latency_us: packet.latency_us.to_le_bytes(),
            targets: packet.targets,
            upper_trunk: packet.upper_trunk,
            lower_trunk: packet.lower_trunk,
        }
    }
}

impl From<PosePacketWire> for PosePacket {
    fn from(wire: PosePacketWire) -> Self {
        Self {
            sequence: u32::from_le_bytes(wire.sequence),
            capture_time_ns: u64::from_le_bytes(wire.capture_time_ns),
            instant: wire.instant,
            latency_us: u32::from_le_bytes(wire.latency_us),
            targets: wire.targets,
            upper_trunk: wire.upper_trunk,
            lower_trunk: wire.lower_trunk,
        }
    }
}
