//! What the libraries know, as pages have it.

use std::time::Instant;

use plumbline::target::Role;
use plumbline_bedside::recording::{self, NotYet, TrunkFigures};
use plumbline_session::session::{Outcome, Session, State, Status};
use plumbline_trial::manifest::Zero;
use plumbline_trial::verdict;

use super::session::{OnDisk, Open, ended_words};
use crate::hub::Hub;
use crate::wire::{
    ConditionState, EventWord, FiguresState, Grade, Judged, PlannedRow, Reason, SessionAt,
    SessionState, TrunkState,
};
use crate::words::on_page;

/// A trunk: why it is not seen, and its figures so far.
pub fn trunk(missing: String, figures: Result<TrunkFigures, NotYet>) -> TrunkState {
    let rounded = |mm: f64| (1e3 * mm).round() / 1e3;
    let not_yet = figures.as_ref().err().map(NotYet::to_string).unwrap_or_default();
    let figures = figures.ok().map(|it| FiguresState {
        path_mm: rounded(it.path_mm),
        noise_path_mm: it.noise_path_mm.map(rounded),
        rms_mm: it.rms_mm.map(rounded),
        gaps: it.gaps,
        span_s: rounded(it.seconds),
    });
    TrunkState { missing, figures, not_yet }
}

/// A target's role in a word.
pub fn role(role: Role) -> &'static str {
    match role {
        Role::Upper => "upper",
        Role::Lower => "lower",
        Role::Scene => "scene",
    }
}

/// A reason for a verdict.
pub fn reason(words: &str, remedy: &str) -> Reason {
    Reason { words: on_page(words), remedy: on_page(remedy) }
}

/// What a recording is worth.
pub fn grade(grade: verdict::Grade) -> Grade {
    match grade {
        verdict::Grade::Good => Grade::Good,
        verdict::Grade::Doubtful => Grade::Doubtful,
        verdict::Grade::Unusable => Grade::Unusable,
    }
}

/// What a trial is worth so far.
pub fn judged(word: recording::Word) -> Judged {
    match word {
        recording::Word::Wait => Judged::Wait,
        recording::Word::Good => Judged::Good,
        recording::Word::Look => Judged::Look,
        recording::Word::Stop => Judged::Stop,
    }
}

/// A session; whether its box could record now.
pub fn session(open: &mut Open, hub: &Hub, now: Instant, can_record: bool) -> SessionState {
    let mut can = possible(open.open.session(), &open.warnings());
    can.retain(|event| can_record || *event != EventWord::Ready);
    let OnDisk { trials, reasons } = open.on_disk();
    let session = open.open.session();
    let name = open.open.name().to_owned();
    let now_at = (hub.ms(now), open.open.now_ms(now));
    SessionState {
        study: open.study.clone(),
        title: open.title.clone(),
        name,
        participant: session.participant.clone(),
        operator: session.operator.clone(),
        step: session.step,
        at: at(session, now_at, reasons),
        can,
        plan: plan(session),
        trials,
        condition: session.condition().map(|it| ConditionState {
            name: it.name.clone(),
            label: it.label.clone(),
            instruction: it.instruction.clone(),
            baseline_s: it.baseline_s,
            duration_s: it.duration_s,
            zero: match session.protocol.zero {
                Zero::Mark => "mark",
                Zero::Start => "start",
                Zero::Onset => "onset",
            }
            .to_owned(),
        }),
        marks: session.protocol.marks.clone(),
        marked: open.marked.clone(),
        warnings: open.warnings(),
    }
}

/// What goes on; `now_at` is the desk's clock and the session's at one moment.
fn at(session: &Session, (desk_ms, session_ms): (f64, u64), reasons: Vec<Reason>) -> SessionAt {
    // Rounded, so that the state does not change by the clocks' noise.
    let at_ms = |ms: u64| ((desk_ms + (ms as f64 - session_ms as f64)) / 10.0).round() * 10.0;
    match &session.state {
        State::Resting { place, until_ms } => {
            SessionAt::Resting { place: *place, until_at_ms: at_ms(*until_ms) }
        }
        State::Instruct { place } => SessionAt::Instruct { place: *place },
        State::Countdown { place, until_ms } => {
            SessionAt::Countdown { place: *place, until_at_ms: at_ms(*until_ms) }
        }
        State::Recording { place, begun_ms, first_frame_ms, zero } => SessionAt::Recording {
            place: *place,
            begun_at_ms: at_ms(*begun_ms),
            first_frame_at_ms: first_frame_ms.map(at_ms),
            zero_at_ms: zero.map(|it| at_ms(it.at_ms)),
            mark_due_at_ms: session.mark_due_ms().map(at_ms),
            ends_at_ms: session.ends_ms().map(|(ms, _)| at_ms(ms)),
        },
        State::Judging { place, .. } => SessionAt::Judging { place: *place },
        State::Deciding { place, ended, judged, .. } => SessionAt::Deciding {
            place: *place,
            trial: session.attempt().map(|it| it.folder.clone()).unwrap_or_default(),
            grade: grade(judged.grade),
            is_zeroed: judged.is_zeroed,
            ended: ended_words(ended),
            reasons,
            needs_reason: judged.grade == verdict::Grade::Unusable,
        },
        State::Stopped { place, .. } => SessionAt::Stopped { place: *place },
        State::Over => SessionAt::Over,
    }
}

/// The events that are possible.
fn possible(session: &Session, warnings: &[String]) -> Vec<EventWord> {
    match &session.state {
        State::Resting { .. } => vec![EventWord::EndRest, EventWord::Skip, EventWord::Stop],
        State::Instruct { .. } => vec![EventWord::Ready, EventWord::Skip, EventWord::Stop],
        State::Countdown { .. } => vec![EventWord::Cancel, EventWord::Stop],
        State::Recording { .. } => vec![EventWord::End],
        State::Judging { .. } if warnings.is_empty() => Vec::new(),
        State::Judging { .. } => vec![EventWord::Judge, EventWord::GiveUp],
        State::Deciding { judged, .. } => {
            let accept = judged.is_zeroed.then_some(EventWord::Accept);
            let others = [EventWord::Repeat, EventWord::Skip, EventWord::Stop];
            accept.into_iter().chain(others).collect()
        }
        State::Stopped { .. } => vec![EventWord::Continue],
        State::Over => Vec::new(),
    }
}

fn plan(session: &Session) -> Vec<PlannedRow> {
    let now = session.place();
    let row = |(at, planned): (usize, &plumbline_session::session::Planned)| {
        let place = at + 1;
        let (status, why) = match session.status(place) {
            Status::Accepted(_) => ("accepted", None),
            Status::Skipped(why) => ("skipped", Some(why.to_owned())),
            Status::Open if now == Some(place) => ("now", None),
            Status::Open => ("open", None),
        };
        let condition = session.protocol.condition(&planned.condition);
        PlannedRow {
            place,
            condition: planned.condition.clone(),
            label: condition.map_or_else(|| planned.condition.clone(), |it| it.label.clone()),
            repeat: planned.repeat,
            status: status.to_owned(),
            why,
        }
    };
    session.plan.iter().enumerate().map(row).collect()
}

/// What has become of a recording, in a word, and why.
pub fn outcome(outcome: &Outcome) -> (&'static str, Option<String>) {
    match outcome {
        Outcome::Open => ("open", None),
        Outcome::Accepted { why } => ("accepted", why.clone()),
        Outcome::Rejected { why } => ("rejected", Some(why.clone())),
        Outcome::Nothing { why } => ("nothing", Some(why.clone())),
    }
}
