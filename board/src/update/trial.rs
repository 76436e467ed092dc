//! What a new program must show before it stays: that it measures, and that hosts can reach it.
//!
//! | is shown by |  |
//! |---|---|
//! | the processor, its arithmetic, every buffer | a known picture through the pipeline, before the session |
//! | the keys | the box's key has been read from the card |
//! | the camera | [`FRAMES`] frames have been processed |
//! | the link | a host with the box's key has said something |
//!
//! A host of another release cannot listen, because the messages of the new program are other ones; the
//! one that has sent the update asks what becomes of it with messages that are the same in all releases.

use std::fmt;
use std::time::{Duration, Instant};

/// Frames that the camera must give: more than any that a driver has left over.
pub const FRAMES: u64 = 30;

/// How long it may take after the session's start: a host looks for the box every second, and a camera
/// is opened anew as often.
pub const LIMIT: Duration = Duration::from_secs(120);

/// What has been shown so far.
#[derive(Debug)]
pub struct Trial {
    ends: Instant,
    has_key: bool,
    frames: u64,
    is_heard: bool,
}

/// Where a trial stands.
#[derive(Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Something is missing, and there is time.
    Open,
    /// Everything was shown.
    Passed,
    /// Something is missing, and the time is over.
    Failed,
}

impl Trial {
    /// A trial that begins now; `has_key` if the box's key was read.
    pub fn begin(has_key: bool, now: Instant) -> Self {
        Self { ends: now + LIMIT, has_key, frames: 0, is_heard: false }
    }

    /// Takes note of what the session has done so far.
    pub fn see(&mut self, frames: u64, is_heard: bool) {
        self.frames = frames;
        self.is_heard |= is_heard;
    }

    /// Where it stands.
    pub fn verdict(&self, now: Instant) -> Verdict {
        // Without its key it never becomes better.
        if !self.has_key {
            Verdict::Failed
        } else if self.frames >= FRAMES && self.is_heard {
            Verdict::Passed
        } else if now >= self.ends {
            Verdict::Failed
        } else {
            Verdict::Open
        }
    }
}

/// What is missing, in words.
impl fmt::Display for Trial {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let missing = [
            (!self.has_key).then(|| "the box's key could not be read".to_owned()),
            (self.frames < FRAMES)
                .then(|| format!("the camera has given {} of {FRAMES} frames", self.frames)),
            (!self.is_heard).then(|| "no host has reached the box".to_owned()),
        ];
        let missing: Vec<String> = missing.into_iter().flatten().collect();
        formatter.write_str(&missing.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_must_be_shown_in_time() {
        let now = Instant::now();
        let late = now + LIMIT;
        for (has_key, frames, is_heard, in_time, too_late, missing) in [
            (true, FRAMES, true, Verdict::Passed, Verdict::Passed, ""),
            (
                true,
                FRAMES - 1,
                true,
                Verdict::Open,
                Verdict::Failed,
                "the camera has given 29 of 30 frames",
            ),
            (true, FRAMES, false, Verdict::Open, Verdict::Failed, "no host has reached the box"),
            (
                false,
                FRAMES,
                true,
                Verdict::Failed,
                Verdict::Failed,
                "the box's key could not be read",
            ),
        ] {
            let mut trial = Trial::begin(has_key, now);
            trial.see(frames, is_heard);
            assert_eq!(trial.verdict(now), in_time, "{trial:?}");
            assert_eq!(trial.verdict(late), too_late, "{trial:?}");
            assert_eq!(trial.to_string(), missing);
        }
    }

    #[test]
    fn everything_that_is_missing_is_named() {
        let missing = "the box's key could not be read, the camera has given 0 of 30 frames, no host \
                       has reached the box";
        assert_eq!(Trial::begin(false, Instant::now()).to_string(), missing);
    }

    #[test]
    fn a_host_that_has_been_there_counts_when_it_has_gone() {
        let now = Instant::now();
        let mut trial = Trial::begin(true, now);
        trial.see(1, true);
        trial.see(FRAMES, false);
        assert_eq!(trial.verdict(now), Verdict::Passed);
    }
}
