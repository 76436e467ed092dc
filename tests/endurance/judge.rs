//! Holds what the box says against what its camera saw.

use plumbline::packet::{CameraState, Health, Message, PosePacket};
use plumbline::pose::{Cam, Pose, Target};

use crate::script::Script;
use crate::show::RATE_HZ;

/// How far a position may be from the truth. The noise of this camera, in the dimmest light, reaches half
/// of it once in millions; a pose of something else, or of the wrong corners, is off by a centimetre.
const ERROR_MM_MAX: f64 = 1.0;

/// How far each of a pose's six numbers may be from the truth, in the standard deviations that came with
/// it. Chance reaches this in one of 8,000 runs with the twelve million numbers of a million frames.
const DEVIATIONS_MAX: f64 = 6.8;

/// Whose clock the capture times are of.
#[derive(Debug, Clone, Copy)]
pub enum Clock {
    /// The camera's: frames that never came leave a gap.
    Camera,
    /// A recording's: its frames have numbers.
    Recording,
}

/// What the box has said so far, every part of which was right.
pub struct Judge<'a> {
    pub script: Script,
    clock: Clock,
    truth: &'a [Vec<Pose<Cam, Target>>; 2],
    /// Frames.
    pub seen: u64,
    /// Poses of targets.
    pub measured: u64,
    /// The largest distance of one from the truth.
    pub worst_mm: f64,
    /// The largest error of one of their numbers, in its own standard deviations.
    pub worst_deviations: f64,
    /// Frames without a pose of a target that was there, soon after something had happened.
    pub searched: u64,
    /// Frames in which nobody was there.
    pub empty: u64,
    pub healths: u64,
    pub health: Option<Health>,
    /// How often the camera was said to be silent.
    pub stalls: u64,
}

impl<'a> Judge<'a> {
    pub fn new(script: Script, clock: Clock, truth: &'a [Vec<Pose<Cam, Target>>; 2]) -> Self {
        Self {
            script,
            clock,
            truth,
            seen: 0,
            measured: 0,
            worst_mm: 0.0,
            worst_deviations: 0.0,
            searched: 0,
            empty: 0,
            healths: 0,
            health: None,
            stalls: 0,
        }
    }

    /// # Panics
    /// When it is not right.
    pub fn take(&mut self, message: Message) {
        match message {
            Message::Pose(pose) => self.pose(&pose),
            Message::Health(health) => self.health(health),
            _ => {}
        }
    }

    fn pose(&mut self, pose: &PosePacket) {
        let step = self.script.next().expect("the script has no end");
        let frame = self.seen;
        assert_eq!(u64::from(pose.sequence), frame, "a frame is missing, or came twice");
        let time_ns = match self.clock {
            Clock::Camera => step.time_ns,
            Clock::Recording => frame * 1_000_000_000 / RATE_HZ,
        };
        // The recording's is rounded in another way.
        let off_ns = pose.capture_time_ns.abs_diff(time_ns);
        assert!(off_ns <= 1, "frame {frame}: at {}, not {time_ns}", pose.capture_time_ns);
        self.seen += 1;
        self.empty += u64::from(step.person.is_none());
        for (target, truth) in pose.targets.iter().zip(self.truth) {
            match (target.pose, step.person) {
                (Ok(found), Some(person)) => {
                    let error = truth[person].increment_to(&found.cam_from_target());
                    let error_mm = error.fixed_rows::<3>(3).norm();
                    let sd = found.covariance().diagonal().map(f64::sqrt);
                    let deviations = error.component_div(&sd).abs();
                    // A NaN is not within a bound.
                    let is_right =
                        error_mm < ERROR_MM_MAX && deviations.iter().all(|&it| it < DEVIATIONS_MAX);
                    assert!(
                        is_right,
                        "frame {frame}: {error_mm} mm, {deviations:?} deviations off: {found:?}, {step:?}"
                    );
                    self.worst_mm = self.worst_mm.max(error_mm);
                    self.worst_deviations = self.worst_deviations.max(deviations.max());
                    self.measured += 1;
                }
                (Ok(found), None) => panic!("frame {frame}: nobody is there: {found:?}, {step:?}"),
                (Err(why), Some(_)) => {
                    assert!(!step.is_settled, "frame {frame}: {why:?} of a target: {step:?}");
                    self.searched += 1;
                }
                (Err(_), None) => {}
            }
        }
    }

    fn health(&mut self, health: Health) {
        let before = self.health.as_ref().map(|it| it.camera);
        self.stalls += u64::from(
            health.camera == CameraState::Stalled && before != Some(CameraState::Stalled),
        );
        assert_eq!(health.heap_allocations, Some(0), "after {} frames: {health:?}", self.seen);
        assert_eq!(health.corners_dropped, 0, "{health:?}");
        assert_eq!(u64::from(health.frames), self.seen, "{health:?}");
        self.healths += 1;
        self.health = Some(health);
    }
}
