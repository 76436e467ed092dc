//! Passes frames through until something has failed. Then the loop that asks for
//! frames blocks here, and nothing feeds the watchdog any more.
//!
//! With the feature `fault-injection` it also blocks, panics or restarts the box after a number of
//! frames, to test the watchdog and the way to the other slot.

use std::time::Instant;

use super::failure;
use super::kernel_command_line::Options;
#[cfg(feature = "fault-injection")]
use super::restart;
use crate::source::{Condition, Exposure, FrameSource, Next};

/// A source behind the gate.
#[derive(Debug)]
pub struct Gate<S> {
    source: S,
    #[cfg(feature = "fault-injection")]
    faults: Faults,
}

impl<S: FrameSource> Gate<S> {
    /// Puts a source behind the gate.
    #[cfg_attr(not(feature = "fault-injection"), expect(unused_variables))]
    pub fn new(source: S, options: &Options) -> Self {
        Self {
            source,
            #[cfg(feature = "fault-injection")]
            faults: Faults {
                frames: 0,
                hang_after: options.hang_after,
                panic_after: options.panic_after,
                try_after: options.try_after,
            },
        }
    }
}

impl<S: FrameSource> FrameSource for Gate<S> {
    fn size_px(&self) -> (usize, usize) {
        self.source.size_px()
    }

    fn next(&mut self, until: Instant) -> Next<'_> {
        if failure::failed() {
            failure::stand_still();
        }
        let next = self.source.next(until);
        #[cfg(feature = "fault-injection")]
        if matches!(next, Next::Frame(_)) {
            self.faults.next_frame();
        }
        next
    }

    fn expose(&mut self, exposure: Exposure) -> bool {
        self.source.expose(exposure)
    }

    fn exposure(&self) -> Exposure {
        self.source.exposure()
    }

    fn condition(&self) -> Condition {
        self.source.condition()
    }
}

/// Faults to inject.
#[cfg(feature = "fault-injection")]
#[derive(Debug)]
struct Faults {
    frames: u64,
    hang_after: Option<u64>,
    panic_after: Option<u64>,
    try_after: Option<u64>,
}

#[cfg(feature = "fault-injection")]
impl Faults {
    fn next_frame(&mut self) {
        if self.hang_after == Some(self.frames) {
            failure::stand_still();
        }
        if self.try_after == Some(self.frames) {
            restart::to_try(None);
        }
        assert!(self.panic_after != Some(self.frames), "a panic was asked for");
        self.frames += 1;
    }
}
