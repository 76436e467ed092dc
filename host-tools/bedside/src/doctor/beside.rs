//! Examining a box beside something else, which does not wait for it.

use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::packet::{Action, Message};
use plumbline_files::BadInput;
use plumbline_stream::link::Configuration;
use plumbline_stream::questions::Questions;
use plumbline_stream::reception::Tap;
use plumbline_stream::transport::Event;

use super::watch::PING_EVERY;
use super::{Background, Check, Findings, LAST_ANSWERS, VIEW_EVERY, judged};
use crate::scale;

/// What is seen of a box meanwhile.
pub(crate) struct Beside {
    findings: Findings,
    /// The zero of its times.
    begun: Instant,
    duration: Duration,
    /// When the first packet came.
    first: Option<Instant>,
    view_at: Instant,
}

impl Beside {
    /// From now on, for this time after the first packet.
    pub fn new(place: &str, is_serial: bool, begun: Instant, duration: Duration) -> Self {
        let findings = Findings { place: place.to_owned(), is_serial, ..Findings::default() };
        Self { findings, begun, duration, first: None, view_at: begun }
    }

    pub fn event(&mut self, event: &Event, now: Instant) {
        if matches!(event, Event::Packet(_)) {
            self.first.get_or_insert(now);
        }
        self.findings.take(event, self.since_ns(now));
    }

    fn since_ns(&self, now: Instant) -> u64 {
        now.saturating_duration_since(self.begun).as_nanos() as u64
    }

    /// How long the box has been heard.
    fn heard_for(&self, now: Instant) -> Option<Duration> {
        self.first.map(|first| now.saturating_duration_since(first))
    }

    /// Whether the box has been heard at all.
    pub fn is_heard(&self) -> bool {
        self.first.is_some()
    }

    pub fn is_over(&self, now: Instant) -> bool {
        self.heard_for(now).is_some_and(|heard| heard >= self.duration + LAST_ANSWERS)
    }

    /// Whether an answer to a question of now is waited for.
    pub fn asks(&self, now: Instant) -> bool {
        self.heard_for(now).is_some_and(|heard| heard < self.duration)
    }

    /// A question for the time has been asked.
    pub fn pinged(&mut self) {
        self.findings.pings += 1;
    }

    pub fn wants_view(&mut self, now: Instant) -> bool {
        let is_due = self.asks(now) && now >= self.view_at;
        if is_due {
            self.view_at = now + VIEW_EVERY;
        }
        is_due
    }

    /// What is to be said of a box with this configuration, and why its background was not looked at.
    pub fn checks(self, config: Option<Config>, no_picture: &str, now: Instant) -> Vec<Check> {
        let since_s = self.since_ns(now) as f64 * 1e-9;
        let mut findings = self.findings;
        findings.silence_s = since_s - findings.heard_ns as f64 * 1e-9;
        findings.config = config.map(Ok);
        findings.compared = findings.config().map(scale::all_kept).unwrap_or_default();
        let has_scene = findings.config().is_some_and(|it| it.cam_from_scene_theta.is_some());
        findings.background = has_scene.then(|| Background::NotCompared(no_picture.into()));
        judged(&findings)
    }
}

/// Why the background is not looked at.
const NO_PICTURE: &str = "beside a reception no picture is taken, so that a camera that was turned since \
                          `plumb scene` would not be noticed; `plumb doctor` takes one";

/// Examines a box beside a reception: the reception's [`Tap`]. It takes no picture.
pub struct Examining {
    beside: Beside,
    questions: Questions,
    configuration: Configuration,
    config: Option<Config>,
    ping_at: Instant,
}

impl Examining {
    /// Begins now, and lasts this long from the box's first packet on. `place` names where it is heard.
    #[must_use]
    pub fn begin(place: &str, is_serial: bool, now: Instant, duration: Duration) -> Self {
        Self {
            beside: Beside::new(place, is_serial, now, duration),
            questions: Questions::of_link(),
            configuration: Configuration::wanted(now),
            config: None,
            ping_at: now,
        }
    }

    /// Whether everything has been seen.
    #[must_use]
    pub fn is_over(&self, now: Instant) -> bool {
        self.beside.is_over(now)
    }

    /// What was found, and the configuration that the box runs with, if it has told.
    #[must_use]
    pub fn end(mut self, now: Instant) -> (Vec<Check>, Option<Config>) {
        self.beside.findings.next_crc = self.configuration.next_crc();
        let checks = self.beside.checks(self.config.clone(), NO_PICTURE, now);
        (checks, self.config)
    }
}

impl Tap for Examining {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        self.beside.event(event, now);
        if let Event::Packet(packet) = event
            && let Some(blob) = self.configuration.take(&packet.message, now)
        {
            self.config = Config::decode(&blob).ok();
        }
        Ok(())
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        if !self.beside.asks(now) {
            return Ok(None);
        }
        if let Some(question) = self.configuration.due(&mut self.questions, now) {
            return Ok(Some(question));
        }
        if now >= self.ping_at {
            self.ping_at = now + PING_EVERY;
            self.beside.pinged();
            let host_sent_ns = self.beside.since_ns(now);
            return Ok(Some(self.questions.ask(Action::Ping { host_sent_ns }).1));
        }
        Ok(self.beside.wants_view(now).then(|| self.questions.ask(Action::SendView).1))
    }
}
