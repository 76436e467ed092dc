//! A box that is watched: its frames, its health, and orders.

use std::io::Sink;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use plumbline_bedside::recording::{Course, Live as LiveSeen, Zeroing, silence};
use plumbline_files::BadInput;
use plumbline_session::session::State;
use plumbline_stream::link::BoxLink;
use plumbline_stream::receiver::Receiver;
use plumbline_stream::reception::follow;
use plumbline_trial::frame::Trunk;

use super::can::Stage;
use super::orders::{Envelope, Order};
use super::{Job, Next, SHOW_EVERY, Worker, show};
use crate::wire::{FrameRow, HealthState, LinkState, Live, Problem, Reason, Reference};

/// The reference is the mean of this time.
const REFERENCE: Duration = Duration::from_secs(1);

/// After this long without a pose the reference is taken of what there is.
const REFERENCE_WITHIN: Duration = Duration::from_secs(4);

/// Frames of the reference that is being taken.
#[derive(Debug)]
pub struct Referencing {
    begun: Instant,
    sums: [([f64; 3], f64); 2],
    first: Option<f64>,
}

impl Worker {
    /// Movement counts, and is drawn, from now on.
    pub(super) fn refer(&mut self) {
        self.shared.frames.start_figures();
        self.referred = self.shared.frames.newest();
        let sums = [([0.0; 3], 0.0); 2];
        self.reference = Some(Referencing { begun: Instant::now(), sums, first: None });
    }

    /// Takes the frames that have come since the last call into the reference.
    pub(super) fn take_frames(&mut self, now: Instant) {
        let Some(reference) = &mut self.reference else { return };
        let (rows, dropped) = self.shared.frames.after(self.referred);
        self.referred += dropped + rows.len() as u64;
        for row in &rows {
            reference.take(row);
        }
        let is_taken = |it: &Referencing| it.is_whole(rows.last(), now);
        if let Some(taken) = self.reference.take_if(|it| is_taken(it)) {
            let [upper, lower] = taken.means();
            self.shared.update(|state| {
                let number = state.reference.number + 1;
                state.reference = Reference { number, upper, lower };
            });
        }
    }

    /// Watches until something else is to be done.
    pub(super) fn watch(&mut self, link: BoxLink) -> Result<(BoxLink, Next), BadInput> {
        let (place, kind) = (link.place().to_owned(), link.kind());
        let mut transport = link.into_transport();
        let mut receiver: Receiver<Sink> = Receiver::new(None);
        let begun = Instant::now();
        let course = Course::new(begun, None, Zeroing::Start);
        let live = LiveSeen::without_motion(None, begun);
        self.enter(Stage::Watching);
        let mut next = Next::Reopen;
        let mut heard_at = begun;
        let hub = Arc::clone(&self.shared.hub);
        let result =
            follow(&mut *transport, &mut receiver, &mut (), None, &hub.stop, &mut |receiver| {
                let now = Instant::now();
                if let Some(goes_on) = self.turn(now) {
                    next = goes_on;
                    return ControlFlow::Break(());
                }
                if now >= self.show_at {
                    self.show_at = now + SHOW_EVERY;
                    self.take_frames(now);
                    let seen = live.seen(receiver, &course, now);
                    // Where nothing is recorded, the first reason is that.
                    let reasons = seen.judgement.reasons.iter().skip(1);
                    let reasons = reasons.map(|it| show::reason(&it.words, &it.remedy));
                    let shown = self.live(receiver, now, None, reasons.collect(), String::new());
                    self.show_reception(receiver, shown, now);
                    self.show_session(now);
                    self.show_can();
                    if receiver.unheard(now).is_none() && receiver.is_heard() {
                        heard_at = now;
                    }
                    if self.wants_meeting(receiver) {
                        next = Next::Meet;
                        return ControlFlow::Break(());
                    }
                    let is_silent = now - heard_at >= plumbline_stream::link::HEARD_WITHIN;
                    if is_silent && self.has_moved() {
                        return ControlFlow::Break(());
                    }
                }
                ControlFlow::Continue(())
            });
        result?;
        Ok((BoxLink::new(transport, place, kind), next))
    }

    /// What is due while the box is watched; what is to be done next, if it is something else.
    fn turn(&mut self, now: Instant) -> Option<Next> {
        self.poll_fit();
        self.tick(now);
        if self.session_state().is_some_and(|it| matches!(it, State::Recording { .. })) {
            return Some(Next::Record);
        }
        if self.wants_examination(now) {
            return Some(Next::Job(Job::Examine));
        }
        let Envelope { order, answer } = self.next_order()?;
        let next = match order {
            Order::Examine => Next::Job(Job::Examine),
            Order::CalibrationDeliver(deliver) => Next::Job(Job::Deliver(deliver)),
            Order::SceneMeasure(measure) => Next::Job(Job::Measure(measure)),
            Order::SceneStore => Next::Job(Job::StoreScene),
            Order::SettingsSend(settings) => Next::Job(Job::Settings(settings)),
            order @ (Order::AimBegin(_) | Order::PhotographsBegin(_)) => {
                if let Order::PhotographsBegin(begin) = &order
                    && let Err(refusal) = self.begin_photographs(begin)
                {
                    let _ = answer.send(Err(refusal));
                    return None;
                }
                Next::Aim(order)
            }
            order => {
                self.take_without_link(Envelope { order, answer });
                let state = self.session_state();
                return state
                    .is_some_and(|it| matches!(it, State::Recording { .. }))
                    .then_some(Next::Record);
            }
        };
        self.shared.update(|state| state.failed = None);
        let _ = answer.send(Ok(()));
        Some(next)
    }

    /// Whether the box has another configuration than is known here.
    fn wants_meeting(&self, receiver: &Receiver<Sink>) -> bool {
        let hello = receiver.runs().last().and_then(|run| run.hello.as_ref());
        hello.zip(self.hello.as_ref()).is_some_and(|(now, known)| {
            now.config_crc != known.config_crc || now.boot_id != known.boot_id
        })
    }

    /// What is measured now.
    pub(super) fn live<W: std::io::Write>(
        &self,
        receiver: &Receiver<W>,
        now: Instant,
        judgement: Option<crate::wire::Judged>,
        reasons: Vec<Reason>,
        time: String,
    ) -> Live {
        let counts = receiver.counts();
        let latest = receiver.latest(now);
        let missing = |role| {
            let target = latest.and_then(|it| it.targets.iter().find(|it| it.role == role));
            match (target, latest) {
                (_, None) => silence(receiver, now),
                (None, _) => "the box looks for no such target".to_owned(),
                (Some(target), _) => match &target.pose {
                    Ok(_) => "seen; the box has no scene, so no AP, ML and SI".to_owned(),
                    Err(_) => "not seen".to_owned(),
                },
            }
        };
        let trunk = |trunk: Trunk, is_seen: bool| {
            let missing = if is_seen { String::new() } else { missing(trunk.role()) };
            show::trunk(missing, self.shared.frames.figures(trunk))
        };
        let tenth = |value: f64| (10.0 * value).round() / 10.0;
        Live {
            rate_hz: tenth(receiver.rate_hz(now)),
            frames: counts.received,
            lost: counts.lost,
            arrival_ms: latest.map(|it| tenth(f64::from(it.latency_us) / 1000.0)),
            clock_error_ms: self
                .shared
                .frames
                .clock_error_ms()
                .map(|it| (1000.0 * it).round() / 1000.0),
            screen_ms: self.shared.screen_ms(),
            judgement,
            reasons,
            upper: trunk(Trunk::Upper, latest.is_some_and(|it| it.upper_trunk.is_some())),
            lower: trunk(Trunk::Lower, latest.is_some_and(|it| it.lower_trunk.is_some())),
            time,
            counts: Vec::new(),
        }
    }

    /// Shows what is measured, how the box is, and how it is heard.
    pub(super) fn show_reception<W: std::io::Write>(
        &self,
        receiver: &mut Receiver<W>,
        live: Live,
        now: Instant,
    ) {
        for words in receiver.take_notices() {
            let warning = words.strip_prefix("warning: ");
            self.shared.notice(warning.is_some(), warning.unwrap_or(&words));
        }
        let health = receiver.health().map(HealthState::of);
        let unheard = receiver.unheard(now);
        let since_at_ms = unheard.map(|lasts| self.shared.ms(now - lasts).round());
        let by = self.heard_by();
        self.shared.update(|state| {
            state.health = health.or(state.health.take());
            state.live = Some(live);
            match (since_at_ms, &state.link) {
                (Some(since_at_ms), LinkState::Heard { .. }) => {
                    let problem = Problem::new(
                        &state.name,
                        "the box is no longer heard",
                        "check its power and its link",
                    );
                    state.link = LinkState::Silent { since_at_ms, problem };
                }
                (None, LinkState::Silent { .. }) if receiver.is_heard() => {
                    state.link = LinkState::Heard { by };
                }
                _ => {}
            }
        });
    }
}

impl Referencing {
    fn take(&mut self, row: &FrameRow) {
        self.first.get_or_insert(row.at_ms);
        for ((sum, count), point) in self.sums.iter_mut().zip([row.upper, row.lower]) {
            if let Some(point) = point {
                *count += 1.0;
                for (sum, value) in sum.iter_mut().zip(point.p) {
                    *sum += value;
                }
            }
        }
    }

    fn is_whole(&self, latest: Option<&FrameRow>, now: Instant) -> bool {
        let lasts_ms = self.first.zip(latest).map(|(first, latest)| latest.at_ms - first);
        lasts_ms.is_some_and(|it| it >= 1e3 * REFERENCE.as_secs_f64())
            || now.saturating_duration_since(self.begun) >= REFERENCE_WITHIN
    }

    fn means(&self) -> [Option<[f64; 3]>; 2] {
        self.sums.map(|(sum, count)| {
            (count > 0.0).then(|| sum.map(|it| (1e3 * it / count).round() / 1e3))
        })
    }
}
