//! The state of one target from frame to frame.
//!
//! ```text
//!              measured
//!  Acquiring ───────────▶ Tracking ◀───────────┐
//!      ▲                     │ missed          │ measured
//!      │                     ▼                 │
//!      └───────────────── Coasting ────────────┘
//!   missed for longer than COASTING_NS_MAX
//! ```
//!
//! Acquiring: nothing is known, and the whole frame must be searched. Tracking and Coasting: a
//! motion is known, and the edges are looked for where it predicts them. Coasting: the target was
//! not seen in the previous frame, and the region around the prediction is searched as well.

use crate::model::motion::Motion;
use crate::model::pose::{Cam, Pose, Target};

/// A target that was not seen for longer than this is searched for in the whole frame.
const COASTING_NS_MAX: u64 = 1_000_000_000;

/// What is known about a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum State {
    /// Nothing: the whole frame must be searched.
    Acquiring,
    /// Seen in the last frame.
    Tracking(Motion),
    /// Not seen in the last frame, but not long ago.
    Coasting(Motion),
}

impl State {
    /// The motion, where one is known.
    #[must_use]
    pub fn motion(&self) -> Option<&Motion> {
        match self {
            Self::Acquiring => None,
            Self::Tracking(motion) | Self::Coasting(motion) => Some(motion),
        }
    }

    /// The state after a frame taken at `time_ns`, in which the target was
    /// measured or missed (`None`).
    #[must_use]
    pub fn next(self, measured: Option<Pose<Cam, Target>>, time_ns: u64) -> Self {
        match (self, measured) {
            (Self::Acquiring, Some(cam_from_target)) => {
                Self::Tracking(Motion::new(cam_from_target, time_ns))
            }
            (Self::Tracking(motion) | Self::Coasting(motion), Some(cam_from_target)) => {
                Self::Tracking(motion.continued(cam_from_target, time_ns))
            }
            (Self::Acquiring, None) => Self::Acquiring,
            (Self::Tracking(motion) | Self::Coasting(motion), None) => {
                let gap_ns = motion.gap_ns(time_ns);
                // A clock that stands still would let a target coast for ever.
                if gap_ns == 0 || gap_ns > COASTING_NS_MAX {
                    Self::Acquiring
                } else {
                    Self::Coasting(motion)
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x_mm: f64) -> Pose<Cam, Target> {
        Pose::from_theta([0.01, -0.02, 0.03, x_mm, 5.0, 1000.0])
    }

    fn motion(time_ns: u64) -> Motion {
        Motion::new(pose(0.0), time_ns)
    }

    #[test]
    fn every_transition_of_the_diagram() {
        let last = motion(1_000);
        let last_moment = 1_000 + COASTING_NS_MAX;
        let late = last_moment + 1;
        let is = |state: State| match state {
            State::Acquiring => "Acquiring",
            State::Tracking(_) => "Tracking",
            State::Coasting(_) => "Coasting",
        };
        for (from, measured, time_ns, to) in [
            (State::Acquiring, None, 2_000, "Acquiring"),
            (State::Acquiring, Some(pose(0.0)), 2_000, "Tracking"),
            (State::Tracking(last), Some(pose(0.0)), 2_000, "Tracking"),
            (State::Tracking(last), None, 2_000, "Coasting"),
            (State::Tracking(last), None, last_moment, "Coasting"),
            (State::Tracking(last), None, late, "Acquiring"),
            (State::Coasting(last), Some(pose(0.0)), 2_000, "Tracking"),
            (State::Coasting(last), None, 2_000, "Coasting"),
            (State::Coasting(last), None, late, "Acquiring"),
            // A clock that stands still.
            (State::Tracking(last), None, 1_000, "Acquiring"),
            // A recording that starts again: time runs backwards.
            (State::Coasting(last), None, 0, "Acquiring"),
        ] {
            assert_eq!(is(from.next(measured, time_ns)), to, "{from:?} {measured:?} {time_ns}");
        }
    }
}
