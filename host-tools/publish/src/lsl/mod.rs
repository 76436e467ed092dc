//! The [Lab Streaming Layer](https://labstreaminglayer.org): streams of samples with times of a
//! common clock, which programs of one network find by name and record together.
//!
//! The official library, liblsl, is loaded when it is wanted, and only then: [`Lsl::load`].
//! [`outlet`] has the streams, [`markers`] takes marks from another program's.
//!
//! The library's clock is this computer's monotonic one on all systems that it knows; it is compared
//! with ours all the same ([`LslClock`]).

mod description;
mod library;
pub mod markers;
pub mod outlet;

use std::time::{Duration, Instant};

pub use library::{LIBRARY, Lsl};

/// The name of the streams, if nobody gives another.
pub const NAME: &str = "Plumbline";

/// The clocks are compared by the closest of so many readings.
const READINGS: u32 = 16;

/// The comparison is made anew this often: nothing promises that both are one clock.
const COMPARED_EVERY: Duration = Duration::from_secs(10);

/// This computer's clock and the library's.
#[derive(Debug, Clone, Copy)]
pub struct LslClock {
    library: Lsl,
    /// The library's time at this moment.
    at: (Instant, f64),
}

impl LslClock {
    /// Compares the clocks.
    #[must_use]
    pub fn new(library: Lsl) -> Self {
        Self { library, at: compared(library) }
    }

    /// Compares them anew, if that was not done lately.
    pub fn keep(&mut self) {
        if self.at.0.elapsed() >= COMPARED_EVERY {
            self.at = compared(self.library);
        }
    }

    /// The library's time of a moment.
    #[must_use]
    pub fn lsl_s(&self, at: Instant) -> f64 {
        let (then, lsl_s) = self.at;
        match at.checked_duration_since(then) {
            Some(since) => lsl_s + since.as_secs_f64(),
            None => lsl_s - then.duration_since(at).as_secs_f64(),
        }
    }

    /// The moment of a time of the library's; `None` where this computer has no such moment.
    #[must_use]
    pub fn instant(&self, lsl_s: f64) -> Option<Instant> {
        let (then, then_s) = self.at;
        let since = Duration::try_from_secs_f64((lsl_s - then_s).abs()).ok()?;
        if lsl_s >= then_s { then.checked_add(since) } else { then.checked_sub(since) }
    }
}

/// One moment by both clocks: the library's is read between two readings of ours.
fn compared(library: Lsl) -> (Instant, f64) {
    let reading = |_| {
        let before = Instant::now();
        let lsl_s = library.local_clock();
        let took = before.elapsed();
        (took, before + took / 2, lsl_s)
    };
    let closest = (0..READINGS).map(reading).min_by_key(|(took, ..)| *took);
    let (_, at, lsl_s) = closest.unwrap_or_else(|| reading(0));
    (at, lsl_s)
}
