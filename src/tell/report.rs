//! The results of one frame: for people, files and packets alike.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::fit::measure::MeasureFailure;
use crate::limits::TARGETS_MAX;
use crate::model::scene::Anatomical;
use crate::model::target::Role;

pub use crate::find::grid::GridRejection;
pub use crate::fit::measure::Measurement;

/// The state of a target after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum TargetState {
    /// Its position is not known.
    Acquiring,
    /// Measured in this frame.
    Tracking,
    /// Not measured in this frame, but not long ago.
    Coasting,
}

impl TargetState {
    /// The word used in files and on screens.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Acquiring => "acquiring",
            Self::Tracking => "tracking",
            Self::Coasting => "coasting",
        }
    }
}

/// Why a target has no pose in this frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum NoPose {
    /// The frame is not of the size that the camera was calibrated for.
    FrameSize,
    /// The search of the frame has not ended yet.
    Searching,
    /// The search ended without finding this target's grid.
    NotFound(GridRejection),
    /// Fewer corners visible than a pose needs.
    TooFewCorners,
    /// Out of sight for too long for the visible part to tell which corners it contains.
    ExtentUnknown,
    /// The corners do not fit the target's geometry.
    PoorFit,
}

impl NoPose {
    /// The words used in files and on screens.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::FrameSize => "frame size",
            Self::Searching => "searching",
            Self::NotFound(GridRejection::NoLattice) => "no checkerboard",
            Self::NotFound(GridRejection::OtherDimensions) => "other dimensions",
            Self::NotFound(GridRejection::Cut) => "cut by the frame",
            Self::NotFound(GridRejection::Incomplete) => "incomplete",
            Self::NotFound(GridRejection::GoesOn) => "goes on",
            Self::NotFound(GridRejection::Ambiguous) => "seen twice",
            Self::TooFewCorners => "too few corners",
            Self::ExtentUnknown => "extent unknown",
            Self::PoorFit => "poor fit",
        }
    }
}

impl From<MeasureFailure> for NoPose {
    fn from(failure: MeasureFailure) -> Self {
        match failure {
            MeasureFailure::TooFewCorners => Self::TooFewCorners,
            MeasureFailure::PoorFit => Self::PoorFit,
        }
    }
}

/// One target in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetReport {
    /// What the target is for.
    pub role: Role,
    /// Its state after this frame.
    pub state: TargetState,
    /// Its pose in this frame, or why there is none.
    pub measurement: Result<Measurement, NoPose>,
}

/// The results of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Number of the frame since the pipeline was configured, from 0.
    pub sequence: u32,
    /// The capture time given with the frame; each target's own time is later by its measurement's
    /// `delay_ns`.
    pub capture_time_ns: u64,
    /// One entry per configured target, in the order of the configuration.
    pub targets: Vec<TargetReport, TARGETS_MAX>,
    /// The upper target's origin in anatomical axes (the paper's z_u').
    pub upper_trunk: Option<Anatomical>,
    /// The lower target's virtual point in anatomical axes (the paper's z_l').
    pub lower_trunk: Option<Anatomical>,
    /// Corners that searches have lost since the pipeline was configured because a buffer was full:
    /// 0 unless the scene is full of patterns.
    pub corners_dropped: u32,
}
