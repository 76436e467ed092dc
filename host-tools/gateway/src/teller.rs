//! Tells the broker, and the desk's list, how boxes and gateway are: what has changed, and healths now and
//! then.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use plumbline_desk::wire::CheckGrade;

use crate::bed::{Around, Bed, utc};
use crate::judge::Counts;
use crate::outbox::Outbox;
use crate::overview::{BoxNow, Doing, Hearing, Overview};
use crate::payload;
use crate::post::Post;
use crate::topics::{About, Topics};

/// The states of boxes are looked at this often.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// What was published of a box.
#[derive(Debug, Clone, Default)]
struct Told {
    state: String,
    examination: String,
    health_at: Option<Instant>,
}

/// Publishes how everything is.
pub(crate) struct Teller {
    told: Vec<Told>,
    topics: Topics,
    outbox: Arc<Outbox>,
    overview: Arc<Mutex<Overview>>,
    every: Duration,
    /// The boxes' levels in topics.
    levels: Vec<String>,
    health_at: Option<Instant>,
    tell_at: Instant,
}

impl Teller {
    /// Nothing was published yet of the boxes at these levels; healths are, this often.
    pub fn new(
        topics: Topics,
        outbox: Arc<Outbox>,
        overview: Arc<Mutex<Overview>>,
        every: Duration,
        levels: Vec<String>,
    ) -> Self {
        let told = vec![Told::default(); levels.len()];
        let tell_at = Instant::now();
        Self { told, topics, outbox, overview, every, levels, health_at: None, tell_at }
    }

    /// The gateway begins.
    pub fn arrive(&self) {
        let state = gateway_state("online", Some(&utc()), &self.levels);
        self.outbox.state(self.topics.gateway_state(), state, None);
    }

    /// A health expires when three of them did not come.
    fn expires_s(&self) -> Option<u32> {
        u32::try_from(3 * self.every.as_secs().max(1)).ok()
    }

    /// Publishes what has changed, if it is time.
    pub fn tell(&mut self, beds: &mut [Bed], post: &Post, around: &Around, now: Instant) {
        if now < self.tell_at {
            return;
        }
        self.tell_at = now + TELL_EVERY;
        let boxes: Vec<BoxNow> = beds.iter_mut().map(|it| it.now(now)).collect();
        let (expires_s, at) = (self.expires_s(), utc());
        for (it, told) in boxes.iter().zip(&mut self.told) {
            let topic = |about| self.topics.of_box(&it.level, about);
            let state = json(&payload::State::of(it));
            if state != told.state {
                self.outbox.state(topic(About::State), state.clone(), None);
                told.state = state;
            }
            if let Some(examination) = examination(it)
                && examination != told.examination
            {
                self.outbox.state(topic(About::Examination), examination.clone(), None);
                told.examination = examination;
            }
            let is_due = told.health_at.is_none_or(|at| now >= at);
            if is_due
                && it.hearing == Hearing::Heard
                && let Some(health) = payload::Health::of(it, &at)
            {
                told.health_at = Some(now + self.every);
                self.outbox.state(topic(About::Health), json(&health), expires_s);
            }
        }
        let counts = &around.judge.counts;
        let (datagrams_unknown, datagrams_dropped) = post.counts();
        let overview = Overview {
            boxes,
            standing: self.outbox.standing(),
            broker: self.outbox.counts(),
            waiting: self.outbox.waiting(),
            trials_begun: counts.begun.load(Ordering::Relaxed),
            trials_judged: counts.judged.load(Ordering::Relaxed),
            trials_waiting: counts.waiting.load(Ordering::Relaxed),
            datagrams_unknown,
            datagrams_dropped,
            datagrams_dropped_by_system: post.dropped_here(),
        };
        if self.health_at.is_none_or(|at| now >= at) {
            self.health_at = Some(now + self.every);
            let health = payload::GatewayHealth::of(&overview, &at);
            self.outbox.state(self.topics.gateway_health(), json(&health), expires_s);
        }
        *self.overview.lock().unwrap_or_else(PoisonError::into_inner) = overview;
    }

    /// The gateway ends, and will not know how boxes are.
    pub fn leave(&self, beds: &mut [Bed]) {
        let at = utc();
        let mut boxes = Vec::with_capacity(beds.len());
        for bed in beds {
            let it = bed.now(Instant::now());
            let problem = ("the gateway was ended".to_owned(), "start it again".to_owned());
            let it = BoxNow {
                hearing: Hearing::Unknown,
                since: at.clone(),
                doing: Doing::Watching,
                trial: None,
                problem: Some(problem),
                ..it
            };
            let topic = self.topics.of_box(&it.level, About::State);
            self.outbox.state(topic, json(&payload::State::of(&it)), None);
            boxes.push(it);
        }
        self.overview.lock().unwrap_or_else(PoisonError::into_inner).boxes = boxes;
        let state = gateway_state("offline", Some(&at), &self.levels);
        self.outbox.state(self.topics.gateway_state(), state, None);
    }

    /// The trials that were judged at the end.
    pub fn judged(&self, counts: &Counts) {
        let mut overview = self.overview.lock().unwrap_or_else(PoisonError::into_inner);
        overview.trials_judged = counts.judged.load(Ordering::Relaxed);
        overview.trials_waiting = counts.waiting.load(Ordering::Relaxed);
        overview.waiting = self.outbox.waiting();
        overview.broker = self.outbox.counts();
    }
}

/// What is published of the gateway itself.
pub(crate) fn gateway_state(is: &str, since: Option<&str>, boxes: &[String]) -> String {
    json(&payload::GatewayState { is, version: env!("CARGO_PKG_VERSION"), since, boxes })
}

fn json(it: &impl serde::Serialize) -> String {
    // Texts and numbers are JSON.
    serde_json::to_string(it).unwrap_or_default()
}

/// What the doctor found, as it is published.
fn examination(it: &BoxNow) -> Option<String> {
    let (at, checks) = it.examination.as_ref()?;
    let is_amiss = |grade| matches!(grade, CheckGrade::Warn | CheckGrade::Fail);
    let amiss = checks.iter().filter(|check| is_amiss(check.verdict)).collect();
    let good = checks.iter().filter(|check| check.verdict == CheckGrade::Good).count();
    Some(json(&payload::Examination { at, amiss, good }))
}
