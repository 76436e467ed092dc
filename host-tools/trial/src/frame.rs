//! One frame of a trial, and the two points of the body in it.

use nalgebra::Matrix3;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::{NoPose, TargetState};
use plumbline::target::Role;
use serde::{Deserialize, Serialize};

/// A trunk point in one frame, along the body's axes: AP, ML, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// When its target was exposed, on the clock of [`Frame::time_s`]: later than the frame by as
    /// much as the camera's row was read later than the first one.
    pub time_s: f64,
    /// The position.
    pub position_mm: [f64; 3],
    /// Its covariance, from that of the target's pose. `None` where the trial has no configuration,
    /// which alone relates the target to the body.
    pub covariance_mm2: Option<Matrix3<f64>>,
}

/// One frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The box's run, from 1.
    pub session: u32,
    /// The number that the box gave it.
    pub sequence: u32,
    /// Time since the trial's first frame; [`Manifest::instant`] says of which instant.
    pub time_s: f64,
    /// The upper trunk.
    pub upper: Option<Point>,
    /// The lower trunk.
    pub lower: Option<Point>,
    /// theta1..6 of `cam_from_target`, as the box gave them: of the upper target, and of the
    /// lower.
    pub theta: [Option<[f32; 6]>; 2],
    /// Root mean square reprojection errors, pixels: of the upper target, and of the lower.
    pub rms_px: [Option<f32>; 2],
    /// What the box says of the upper target, and of the lower; `None` where it has none.
    pub seen: [Option<Seen>; 2],
}

/// The state of a target after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seen {
    /// Whether it is being tracked.
    pub state: TargetState,
    /// Why it has no pose in the frame; `None` where it has one.
    pub no_pose: Option<NoPose>,
}

impl Frame {
    /// The point of a trunk.
    #[must_use]
    pub fn point(&self, trunk: Trunk) -> Option<&Point> {
        match trunk {
            Trunk::Upper => self.upper.as_ref(),
            Trunk::Lower => self.lower.as_ref(),
        }
    }

    /// The pose of the target that a trunk's point is fixed to.
    #[must_use]
    pub fn cam_from_target(&self, trunk: Trunk) -> Option<Pose<Cam, Target>> {
        Some(Pose::from_theta(self.theta_of(trunk)?.map(f64::from)))
    }

    /// theta1..6 of that pose.
    #[must_use]
    pub fn theta_of(&self, trunk: Trunk) -> Option<[f32; 6]> {
        self.theta[trunk.place()]
    }

    /// The reprojection error of that target.
    #[must_use]
    pub fn rms_px(&self, trunk: Trunk) -> Option<f32> {
        self.rms_px[trunk.place()]
    }

    /// The state of that target.
    #[must_use]
    pub fn seen(&self, trunk: Trunk) -> Option<Seen> {
        self.seen[trunk.place()]
    }
}

/// One of the two points of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Trunk {
    /// At the shoulder.
    Upper,
    /// In front of the lower back.
    Lower,
}

impl Trunk {
    /// Both, in the order of the paper's tables.
    pub const ALL: [Self; 2] = [Self::Lower, Self::Upper];

    /// Its name in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Upper => "upper",
            Self::Lower => "lower",
        }
    }

    /// Its place in the arrays of a [`Frame`].
    fn place(self) -> usize {
        match self {
            Self::Upper => 0,
            Self::Lower => 1,
        }
    }

    /// The role of the target that its point is fixed to.
    pub fn role(self) -> Role {
        match self {
            Self::Upper => Role::Upper,
            Self::Lower => Role::Lower,
        }
    }
}
