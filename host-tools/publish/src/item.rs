//! What is published.
//!
//! Times called `host_ns` are of this computer's monotonic clock, since the publisher's zero.

use std::sync::Arc;

use plumbline::packet::{AnatomicalPoint, Hello, MarkedInstant, PosePacket, TargetPacket};
use plumbline::target::Role;

/// One thing that is published.
#[derive(Debug, Clone)]
pub enum Item {
    /// What the frames from now on are of.
    Stream(Arc<Stream>),
    /// A frame.
    Frame(Arc<Sample>),
    /// Frames that did not come in their place.
    Gap(Gap),
    /// A mark of the recording.
    Mark(Arc<Marked>),
    /// Something to be said to people.
    Notice(Arc<str>),
}

/// A session of a box: from one of its starts to the next.
#[derive(Debug, Clone, PartialEq)]
pub struct Stream {
    /// The number of the session, from 1.
    pub session: u32,
    /// Who the box is, and its targets.
    pub hello: Hello,
    /// Which instant of a frame its time marks.
    pub instant: MarkedInstant,
    /// The largest error of the times of the first frames, against this computer's clock.
    pub error_s: f64,
    /// The wall clock of this computer at the zero of `host_ns`.
    pub zero_unix_s: f64,
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The number of its session.
    pub session: u32,
    /// Its time in the trial's tables: seconds since the first frame of all.
    pub time_s: f64,
    /// When it was captured; of frames in their place, no earlier than the one before.
    pub host_ns: f64,
    /// The largest error of `host_ns`.
    pub error_s: f64,
    /// It came after a later one.
    pub is_late: bool,
    /// What the box sent.
    pub packet: PosePacket,
}

impl Sample {
    /// What the box says of the target with this role.
    #[must_use]
    pub fn target(&self, role: Role) -> Option<&TargetPacket> {
        self.packet.targets.iter().find(|target| target.role == role)
    }

    /// The trunk point that the target with this role gives.
    #[must_use]
    pub fn trunk(&self, role: Role) -> Option<AnatomicalPoint> {
        match role {
            Role::Lower => self.packet.lower_trunk,
            Role::Upper => self.packet.upper_trunk,
            Role::Scene => None,
        }
    }
}

/// Frames that did not come in their place, between two that did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// The number of the session.
    pub session: u32,
    /// The number of the first missing frame.
    pub first: u32,
    /// How many frames are missing.
    pub count: u32,
    /// When the frame before it was captured.
    pub before_ns: f64,
    /// When the frame after it was captured.
    pub after_ns: f64,
}

impl Gap {
    /// When a missing frame, counted from 0, was captured, if the camera kept its pace.
    #[must_use]
    pub fn host_ns(&self, index: u32) -> f64 {
        let share = f64::from(index + 1) / f64::from(self.count + 1);
        self.before_ns + share * (self.after_ns - self.before_ns)
    }
}

/// A mark of the recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Marked {
    /// Its label.
    pub label: String,
    /// Where it comes from, in a word.
    pub source: String,
    /// When it was.
    pub host_ns: f64,
    /// The same in the trial's tables; `None` before the first frame.
    pub time_s: Option<f64>,
}
