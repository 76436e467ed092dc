//! The end of a wait, for which only the time counts in which the program ran.

use std::time::{Duration, Instant};

/// To look at what came takes less, unless the program, or its machine, was stopped meanwhile.
const STOPPED_AFTER: Duration = Duration::from_millis(500);

/// When a wait ends that consists of short looks.
#[derive(Debug)]
pub struct Deadline(Instant);

impl Deadline {
    /// At this time, if the program is not stopped before.
    #[must_use]
    pub fn at(time: Instant) -> Self {
        Self(time)
    }

    /// After this time, of which nothing counts in which the program was stopped.
    #[must_use]
    pub fn after(time: Duration) -> Self {
        Self(Instant::now() + time)
    }

    /// Looks once for what is waited for; `None` when the wait is over.
    pub fn look<T>(&mut self, look: impl FnOnce() -> T) -> Option<T> {
        let began = Instant::now();
        if began >= self.0 {
            return None;
        }
        let seen = look();
        self.0 += began.elapsed().saturating_sub(STOPPED_AFTER);
        Some(seen)
    }
}
