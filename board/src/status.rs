//! What the box is doing: set by the part that knows, read by the parts that show it.
//!
//! | status | meaning | LED | colour |
//! |---|---|---|---|
//! | starting | from the kernel's start to the first turn of the main loop | blinks fast | amber |
//! | tracking | every target of the configuration was measured in the last frame | one short flash a second | green |
//! | looking for the targets | frames arrive, but a target was not measured in the last one | two short flashes every 2 s | amber |
//! | no camera | no frames arrive | a long and a short flash every 2 s | red |
//! | no configuration | none was found; the box waits for one | on for 1 s, off for 1 s | red |
//! | configuration refused | it cannot be used; the box waits for another | on, with a short gap every 2 s | red |
//! | failed | a fault of the program or the computer, which is about to restart | steadily on | red |
//!
//! There is one status, as there is one logger, and log messages about it contain its
//! [`words`](Status::words). It is a single atomic number: setting and reading it never waits
//! and does not allocate.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::machine::clock;

/// What the box is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// It has been switched on.
    Starting,
    /// Every target was measured in the last frame.
    Tracking,
    /// A target was not measured in the last frame.
    Searching,
    /// No frames arrive.
    NoCamera,
    /// There is no configuration.
    NoConfiguration,
    /// There is one that cannot be used.
    Refused,
    /// The computer is about to restart, because of a fault.
    Failed,
}

impl Status {
    /// All of them; the number of each is its index.
    pub const ALL: [Self; 7] = [
        Self::Starting,
        Self::Tracking,
        Self::Searching,
        Self::NoCamera,
        Self::NoConfiguration,
        Self::Refused,
        Self::Failed,
    ];

    /// The words for it, in the log and on a screen.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Tracking => "tracking",
            Self::Searching => "looking for the targets",
            Self::NoCamera => "no camera",
            Self::NoConfiguration => "no configuration",
            Self::Refused => "configuration refused",
            Self::Failed => "failed",
        }
    }

    /// Whether it lasts until the computer restarts, for a reason that is logged once, after
    /// its words.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Self::NoConfiguration | Self::Refused | Self::Failed)
    }

    /// Whether it is set by the main loop, which sets it in every iteration.
    #[must_use]
    pub fn is_refreshed(self) -> bool {
        matches!(self, Self::Tracking | Self::Searching | Self::NoCamera)
    }
}

/// The low bits are the status, the rest is the time at which it was set, in milliseconds of
/// [`clock::monotonic_ns`]. Initially the box is starting, since the kernel's start.
static CURRENT: AtomicU64 = AtomicU64::new(0);

const STATUS_BITS: u32 = 3;

/// Sets what the box is doing. [`Status::Failed`] is never replaced: the main loop may not have
/// noticed yet that another thread has failed.
pub fn set(status: Status) {
    // Fails only after a failure.
    let _ = CURRENT.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |packed| {
        (status_of(packed) != Status::Failed).then(|| pack(status, now_ms()))
    });
}

/// The status, and the time since it was last set.
#[must_use]
pub fn current() -> (Status, Duration) {
    let packed = CURRENT.load(Ordering::Relaxed);
    let age_ms = now_ms().saturating_sub(packed >> STATUS_BITS);
    (status_of(packed), Duration::from_millis(age_ms))
}

fn now_ms() -> u64 {
    clock::monotonic_ns() / 1_000_000
}

fn pack(status: Status, at_ms: u64) -> u64 {
    at_ms << STATUS_BITS | status as u64
}

fn status_of(packed: u64) -> Status {
    let number = packed & ((1 << STATUS_BITS) - 1);
    Status::ALL.get(number as usize).copied().unwrap_or(Status::Failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_status_is_kept_with_its_time() {
        assert_eq!(pack(Status::Starting, 0), 0);
        for status in Status::ALL {
            let packed = pack(status, 1 << 50);
            assert_eq!((status_of(packed), packed >> STATUS_BITS), (status, 1 << 50));
        }
    }

    // The only test that sets the status: there is one for the whole process.
    #[test]
    fn the_latest_status_counts_until_a_failure() {
        set(Status::Searching);
        set(Status::Tracking);
        let (status, age) = current();
        assert_eq!(status, Status::Tracking);
        std::thread::sleep(Duration::from_millis(30));
        assert!(current().1 >= age + Duration::from_millis(29), "{:?}", current());
        set(Status::Tracking);
        assert!(current().1 < Duration::from_millis(30), "{:?}", current());
        set(Status::Failed);
        set(Status::Tracking);
        assert_eq!(current().0, Status::Failed);
    }
}
