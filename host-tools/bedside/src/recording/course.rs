//! How far a recording has come: its t = 0, its marks, and when it is over.
//!
//! Times here are those of arrival; the trial's own come from the box's clock. They differ by the
//! delay of a frame, some milliseconds, which the end allows for.

use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline_trial::body::Body;
use plumbline_trial::mark::Mark;
use plumbline_trial::verdict::Verdict;

/// A mark is waited for no longer than this.
const AWAITED_MAX: Duration = Duration::from_secs(600);

/// The last frame of the duration has come by then.
const FRAME_DELAY_MAX: Duration = Duration::from_millis(250);

/// The trial is not judged before its first frame is so long past: the box searches for its targets,
/// and of a few frames a single one is a large share. As long as the checks before a recording last.
pub(crate) const SETTLING: Duration = Duration::from_secs(3);

/// What t = 0 is, as far as it can be known while the recording goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zeroing {
    /// A mark, which can come.
    Mark,
    /// The first frame.
    Start,
    /// The moment of standing up, which is found afterwards.
    Onset,
}

/// The course of a recording.
#[derive(Debug)]
pub struct Course {
    begun: Instant,
    duration: Option<Duration>,
    zeroing: Zeroing,
    first_frame: Option<Instant>,
    /// The mark that is t = 0, and whether it is called so.
    zero: Option<(Instant, bool)>,
    /// The marks that wait to be shown, in words.
    news: Vec<String>,
    /// What the trial is worth, as far as it has come.
    verdict: Option<Verdict>,
    /// The rate that the box was asked for.
    asked_hz: Option<f32>,
    /// What relates the box's targets to the body.
    body: Option<Body>,
}

impl Course {
    /// A recording that began at this moment, and goes on for `duration` after its t = 0; without
    /// one it has no end.
    #[must_use]
    pub fn new(begun: Instant, duration: Option<Duration>, zeroing: Zeroing) -> Self {
        Self {
            begun,
            duration,
            zeroing,
            first_frame: None,
            zero: None,
            news: Vec::new(),
            verdict: None,
            asked_hz: None,
            body: None,
        }
    }

    /// A mark can come after all: the box has a trigger. To be called only where a mark is to be
    /// t = 0.
    pub fn can_be_marked(&mut self) {
        if self.zeroing == Zeroing::Start {
            self.zeroing = Zeroing::Mark;
        }
    }

    /// Frames have come.
    pub fn frame(&mut self, now: Instant) {
        self.first_frame.get_or_insert(now);
    }

    /// A mark is in the recording, so long after its beginning. The one called zero is t = 0,
    /// otherwise the first.
    pub fn mark(&mut self, mark: &Mark, since_begun_s: f64) {
        let at = self.begun + Duration::from_secs_f64(since_begun_s);
        let is_named = mark.label.eq_ignore_ascii_case("zero");
        let is_zero = match self.zero {
            None => true,
            Some((_, was_named)) => is_named && !was_named,
        };
        let is_zero = is_zero && self.zeroing == Zeroing::Mark;
        let since = at.saturating_duration_since(self.start()).as_secs_f64();
        let mut text = format!("mark \"{}\" at {since:.2} s", mark.label);
        if is_zero {
            self.zero = Some((at, is_named));
            text += ": t = 0";
        } else if let Some((zero, _)) = self.zero {
            let since = at.saturating_duration_since(zero).as_secs_f64();
            text += &format!(", {since:.2} s after t = 0");
        }
        self.news.push(text);
    }

    /// Whether the trial can be judged.
    pub fn is_settled(&self, now: Instant) -> bool {
        self.first_frame.is_some_and(|first| now.saturating_duration_since(first) >= SETTLING)
    }

    /// The trial has been judged as far as it has come.
    pub fn judged(&mut self, verdict: Verdict) {
        self.verdict = Some(verdict);
    }

    /// The box's configuration has come.
    pub fn told(&mut self, config: &Config) {
        self.asked_hz = config.capture.as_ref().map(|capture| capture.rate_hz);
        self.body = Body::of(config);
    }

    /// What relates the box's targets to the body, once it is known.
    pub fn body(&self) -> Option<&Body> {
        self.body.as_ref()
    }

    /// The verdict so far.
    pub fn verdict(&self) -> Option<&Verdict> {
        self.verdict.as_ref()
    }

    /// The rate that the box was asked for, once it is known.
    pub fn asked_hz(&self) -> Option<f32> {
        self.asked_hz
    }

    /// The marks since the last call.
    pub fn news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }

    /// When the mark came that is t = 0, so far.
    pub fn zero(&self) -> Option<Instant> {
        self.zero.map(|(at, _)| at)
    }

    /// Whether the mark that is t = 0 has not come.
    pub fn awaits_mark(&self) -> bool {
        self.zeroing == Zeroing::Mark && self.zero.is_none()
    }

    /// Since when time counts: t = 0, or until it comes the start.
    fn counts_from(&self) -> Instant {
        self.zero().unwrap_or(self.start())
    }

    /// The first frame, or until it comes the beginning of the recording.
    fn start(&self) -> Instant {
        self.first_frame.unwrap_or(self.begun)
    }

    /// How long it has been going on, and since when, in words.
    pub fn elapsed(&self, now: Instant) -> (Duration, &'static str) {
        let since = match (self.zero, self.zeroing) {
            (Some(_), _) => "since t = 0",
            (None, Zeroing::Mark | Zeroing::Onset) => "since the start",
            (None, Zeroing::Start) => "since the first frame",
        };
        (now.saturating_duration_since(self.counts_from()), since)
    }

    /// From where movement counts, in words.
    pub fn movement_since(&self) -> &'static str {
        match self.zeroing {
            Zeroing::Mark if self.awaits_mark() => "from the last second",
            Zeroing::Mark | Zeroing::Start => "since t = 0",
            // Its t = 0 is not known yet.
            Zeroing::Onset => "since the start",
        }
    }

    /// How long it still goes on, and until what, in words; `None` without an end.
    pub fn remaining(&self, now: Instant) -> Option<(Duration, String)> {
        let duration = self.duration?;
        let (end, until) = if self.awaits_mark() {
            let minutes = AWAITED_MAX.as_secs() / 60;
            let until =
                format!("to go without a mark: {} s and {minutes} min", duration.as_secs_f64());
            (self.start() + duration + AWAITED_MAX, until)
        } else {
            (self.counts_from() + duration, format!("to go of {} s", duration.as_secs_f64()))
        };
        Some((end.saturating_duration_since(now), until))
    }

    /// Whether everything that was wanted has come.
    pub fn is_over(&self, now: Instant) -> bool {
        let Some(duration) = self.duration else { return false };
        let longest = if self.awaits_mark() { duration + AWAITED_MAX } else { duration };
        now.saturating_duration_since(self.counts_from()) >= longest + FRAME_DELAY_MAX
    }

    /// What the user has to know of t = 0.
    pub fn note(&self) -> Option<&'static str> {
        match self.zeroing {
            Zeroing::Mark if self.awaits_mark() => Some("waiting for the mark: Enter sets t = 0"),
            Zeroing::Onset => Some("t = 0 is found afterwards; the time counts from the start"),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline_trial::mark::Source;

    use super::*;

    fn s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    /// A recording of 60 s whose first frame comes after a second.
    fn course(zeroing: Zeroing) -> (Course, Instant) {
        let begun = Instant::now();
        let mut course = Course::new(begun, Some(s(60.0)), zeroing);
        course.frame(begun + s(1.0));
        (course, begun)
    }

    #[test]
    fn the_duration_counts_from_the_mark() {
        let (mut course, begun) = course(Zeroing::Mark);
        assert!(!course.is_over(begun + s(62.0)) && course.awaits_mark());
        course.mark(&Mark::new(Source::Key, ""), 5.5);
        assert!(!course.is_over(begun + s(65.6)));
        assert!(course.is_over(begun + s(65.8)));
        assert_eq!(course.elapsed(begun + s(7.5)), (s(2.0), "since t = 0"));
        assert_eq!(course.remaining(begun + s(7.5)).unwrap(), (s(58.0), "to go of 60 s".into()));
        assert_eq!(course.news(), ["mark \"mark\" at 4.50 s: t = 0"]);
        // The one called zero is t = 0, whichever came before.
        course.mark(&Mark::new(Source::Key, "turn"), 8.0);
        course.mark(&Mark::new(Source::Key, "Zero"), 10.0);
        course.mark(&Mark::new(Source::Key, "zero"), 11.0);
        assert!(!course.is_over(begun + s(70.1)) && course.is_over(begun + s(70.3)));
        let wanted = [
            "mark \"turn\" at 7.00 s, 2.50 s after t = 0",
            "mark \"Zero\" at 9.00 s: t = 0",
            "mark \"zero\" at 10.00 s, 1.00 s after t = 0",
        ];
        assert_eq!(course.news(), wanted);
        assert!(course.news().is_empty());
    }

    #[test]
    fn a_box_with_a_trigger_is_waited_for() {
        let (mut course, begun) = course(Zeroing::Start);
        assert!(!course.awaits_mark());
        course.can_be_marked();
        assert!(course.awaits_mark() && !course.is_over(begun + s(62.0)));
        course.mark(&Mark::new(Source::Trigger, "rising edge"), 11.0);
        assert_eq!(course.news(), ["mark \"rising edge\" at 10.00 s: t = 0"]);
        assert!(!course.is_over(begun + s(71.2)) && course.is_over(begun + s(71.3)));
        // What stands up by itself is not marked.
        let mut onset = Course::new(begun, None, Zeroing::Onset);
        onset.can_be_marked();
        assert!(!onset.awaits_mark());
    }

    #[test]
    fn without_a_mark_it_ends_at_a_stated_time() {
        let (course, begun) = course(Zeroing::Mark);
        let (to_go, until) = course.remaining(begun + s(1.0)).unwrap();
        assert_eq!((to_go, &*until), (s(660.0), "to go without a mark: 60 s and 10 min"));
        assert!(!course.is_over(begun + s(659.0)) && course.is_over(begun + s(661.5)));
        assert!(course.note().unwrap().contains("Enter"));
    }

    #[test]
    fn where_no_mark_counts_the_duration_does_from_the_first_frame() {
        for zeroing in [Zeroing::Start, Zeroing::Onset] {
            let (mut course, begun) = course(zeroing);
            course.mark(&Mark::new(Source::Udp, "turn"), 30.0);
            assert_eq!(course.news(), ["mark \"turn\" at 29.00 s"]);
            // A t = 0 that is found afterwards is not said to be there.
            assert_eq!(course.movement_since() == "since t = 0", zeroing == Zeroing::Start);
            assert!(!course.is_over(begun + s(61.2)) && course.is_over(begun + s(61.3)));
        }
        // Without a frame it ends, too.
        let course = Course::new(Instant::now(), Some(s(60.0)), Zeroing::Start);
        assert!(course.is_over(course.begun + s(61.0)));
    }
}
