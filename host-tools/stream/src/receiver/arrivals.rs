//! When something of the box came.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// The rate is the average over this time.
const RATE_SPAN: Duration = Duration::from_secs(2);

/// The times at which messages came.
#[derive(Debug, Default)]
pub(super) struct Arrivals {
    /// Any message of the box.
    heard: Option<Instant>,
    /// The latest pose packet of all runs.
    pose: Option<Instant>,
    /// The pose packets of this run in the last [`RATE_SPAN`].
    recent: VecDeque<Instant>,
}

impl Arrivals {
    pub(super) fn message(&mut self, now: Instant) {
        self.heard = Some(now);
    }

    pub(super) fn pose(&mut self, now: Instant) {
        self.pose = Some(now);
        self.recent.push_back(now);
        while self.recent.front().is_some_and(|first| now.duration_since(*first) > RATE_SPAN) {
            self.recent.pop_front();
        }
    }

    pub(super) fn start_run(&mut self) {
        self.recent.clear();
    }

    pub(super) fn has_message(&self) -> bool {
        self.heard.is_some()
    }

    /// The time since the box's latest message.
    pub(super) fn since_message(&self, now: Instant) -> Option<Duration> {
        self.heard.map(|came| now.saturating_duration_since(came))
    }

    /// The time since the latest pose packet.
    pub(super) fn since_pose(&self, now: Instant) -> Option<Duration> {
        self.pose.map(|came| now.saturating_duration_since(came))
    }

    pub(super) fn rate_hz(&self, now: Instant) -> f64 {
        let is_recent = |came: &&Instant| now.saturating_duration_since(**came) <= RATE_SPAN;
        let mut recent = self.recent.iter().filter(is_recent);
        let Some(first) = recent.next() else { return 0.0 };
        // From the first on, each packet came one period after another.
        let (periods, last) = recent.fold((0, first), |(count, _), came| (count + 1, came));
        f64::from(periods) / (*last - *first).as_secs_f64().max(0.1)
    }
}
