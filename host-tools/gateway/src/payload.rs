//! What is published: JSON, with units in the names of fields. No pose, no name of a person, and no code
//! of a participant is in any of these.

use std::collections::BTreeMap;

use plumbline_desk::wire::{CheckState, HealthState};
use plumbline_study::method::Choice;
use plumbline_study::tidy;
use plumbline_trial::Trial;
use plumbline_trial::manifest::CheckSeen;
use plumbline_trial::points::Points;
use serde::Serialize;

use crate::overview::{BoxNow, Doing, Hearing, Overview};

/// Whether the gateway is there.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GatewayState<'a> {
    /// `online` or `offline`.
    pub is: &'a str,
    /// Version of the program.
    pub version: &'a str,
    /// Since when, UTC; absent in the last will.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub since: Option<&'a str>,
    /// The boxes whose keys it knows, as topics call them.
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    pub boxes: &'a [String],
}

/// What the gateway hears, records and loses, since it was started.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GatewayHealth<'a> {
    at: &'a str,
    boxes_known: usize,
    boxes_heard: usize,
    boxes_recording: usize,
    frames: u64,
    frames_lost: u64,
    trials_begun: u64,
    trials_judged: u64,
    trials_waiting: usize,
    messages_published: u64,
    messages_waiting: usize,
    messages_kept: usize,
    messages_kept_dropped: u64,
    messages_refused: u64,
    answers_dropped: u64,
    datagrams_unknown: u64,
    datagrams_dropped: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    datagrams_dropped_by_system: Option<u64>,
}

impl<'a> GatewayHealth<'a> {
    /// As it is now.
    #[must_use]
    pub fn of(overview: &Overview, at: &'a str) -> Self {
        let broker = overview.broker;
        Self {
            at,
            boxes_known: overview.boxes.len(),
            boxes_heard: overview.heard(),
            boxes_recording: overview.recording(),
            frames: overview.frames(),
            frames_lost: overview.lost(),
            trials_begun: overview.trials_begun,
            trials_judged: overview.trials_judged,
            trials_waiting: overview.trials_waiting,
            messages_published: broker.published,
            messages_waiting: overview.waiting.0,
            messages_kept: overview.waiting.1,
            messages_kept_dropped: broker.kept_dropped,
            messages_refused: broker.refused,
            answers_dropped: broker.answers_dropped,
            datagrams_unknown: overview.datagrams_unknown,
            datagrams_dropped: overview.datagrams_dropped,
            datagrams_dropped_by_system: overview.datagrams_dropped_by_system,
        }
    }
}

/// Whether a box is heard, and what is done with it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct State<'a> {
    /// `searching`, `heard` or `silent`; `unknown` once the gateway has ended.
    is: &'a str,
    /// Since when, UTC.
    since: &'a str,
    name: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    serial_number: Option<&'a str>,
    /// `watching`, `recording`, or `ending` while what was lost on the way still comes.
    doing: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    trial: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<&'a str>,
}

impl<'a> State<'a> {
    /// As it is now.
    #[must_use]
    pub fn of(it: &'a BoxNow) -> Self {
        Self {
            is: match it.hearing {
                Hearing::Searching => "searching",
                Hearing::Heard => "heard",
                Hearing::Silent => "silent",
                Hearing::Unknown => "unknown",
            },
            since: &it.since,
            name: &it.name,
            serial_number: it.serial_number.as_deref(),
            doing: match it.doing {
                Doing::Watching => "watching",
                Doing::Recording => "recording",
                Doing::Ending => "ending",
            },
            trial: it.trial.as_deref(),
            found: it.problem.as_ref().map(|(found, _)| found.as_str()),
            remedy: it.problem.as_ref().map(|(_, remedy)| remedy.as_str()),
        }
    }
}

/// How a box is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Health<'a> {
    at: &'a str,
    rate_hz: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    latency_ms: Option<f64>,
    /// Frames that have come since the gateway was started.
    frames: u64,
    frames_lost: u64,
    frames_late: u64,
    not_authentic: u64,
    #[serde(flatten)]
    health: &'a HealthState,
}

impl<'a> Health<'a> {
    /// As it is now, if the box has told.
    #[must_use]
    pub fn of(it: &'a BoxNow, at: &'a str) -> Option<Self> {
        Some(Self {
            at,
            rate_hz: it.rate_hz,
            latency_ms: it.latency_ms,
            frames: it.counts.frames,
            frames_lost: it.counts.lost,
            frames_late: it.counts.late,
            not_authentic: it.counts.not_authentic,
            health: it.health.as_ref()?,
        })
    }
}

/// What the doctor found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Examination<'a> {
    /// When, UTC.
    pub at: &'a str,
    /// What is not good, the worst first.
    pub amiss: Vec<&'a CheckState>,
    /// The number of checks that are good.
    pub good: usize,
}

/// Which trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrialSaid {
    /// Its number: when it began, UTC, or in which folder of the box it is.
    pub trial: String,
    /// What it was called, where names are published.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// A reason for a verdict, or a check of the box.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Reason {
    is: &'static str,
    words: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    remedy: String,
}

/// What a trial is worth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    #[serde(flatten)]
    said: TrialSaid,
    started: String,
    is: &'static str,
    reasons: Vec<Reason>,
    /// The gateway was ended while it was recorded.
    was_cut_off: bool,
}

impl Verdict {
    /// On a trial.
    #[must_use]
    pub fn on(trial: &Trial, said: TrialSaid, was_cut_off: bool) -> Self {
        let verdict = trial.manifest.verdict();
        let reasons = verdict.reasons.iter().map(|it| Reason {
            is: it.is.word(),
            words: it.words.clone(),
            remedy: it.remedy.clone(),
        });
        Self {
            said,
            started: trial.manifest.started.clone(),
            is: verdict.grade().word(),
            reasons: reasons.collect(),
            was_cut_off,
        }
    }

    /// The verdict in a word.
    #[must_use]
    pub fn grade(&self) -> &'static str {
        self.is
    }
}

/// What is in a trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    #[serde(flatten)]
    said: TrialSaid,
    started: String,
    length_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
    frames: usize,
    frames_lost: u64,
    frames_late: u64,
    not_authentic: u64,
    /// How often the box started.
    sessions: u32,
    /// The noise of each trunk point along each axis.
    noise: BTreeMap<String, BTreeMap<&'static str, f64>>,
    checks: Vec<CheckSaid>,
    /// By trunk, figure with its unit, and direction.
    figures: BTreeMap<&'static str, BTreeMap<String, BTreeMap<&'static str, f64>>>,
    /// Why there are no figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    no_figures: Option<String>,
}

/// A check that was not passed when the trial began.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct CheckSaid {
    subject: String,
    is: plumbline_trial::manifest::CheckVerdict,
    seen: String,
}

impl Summary {
    /// Of a trial; the figures are those of `plumb figures`, of all of its time.
    #[must_use]
    pub fn of(trial: &Trial, said: TrialSaid) -> Self {
        let packets = trial.manifest.packets;
        let noise = trial.manifest.noise.iter().map(|it| {
            let axes = [("ap_mm", it.ap_mm), ("ml_mm", it.ml_mm), ("si_mm", it.si_mm)];
            (it.trunk.clone(), axes.into_iter().collect())
        });
        let checks = trial.manifest.checks.iter().map(|CheckSeen { subject, verdict, seen }| {
            CheckSaid { subject: subject.clone(), is: *verdict, seen: seen.clone() }
        });
        let (figures, no_figures) = match Points::of(trial, trial.manifest.zero) {
            Ok(points) => (figures(trial, points), None),
            Err(error) => (BTreeMap::new(), Some(error.found)),
        };
        Self {
            said,
            started: trial.manifest.started.clone(),
            length_s: trial.length_s(),
            rate_hz: trial.rate_hz(),
            frames: trial.frames.len(),
            frames_lost: packets.map_or(0, |it| it.lost),
            frames_late: packets.map_or(0, |it| it.late),
            not_authentic: packets.map_or(0, |it| it.not_authentic),
            sessions: packets.map_or(0, |it| it.sessions),
            noise: noise.collect(),
            checks: checks.collect(),
            figures,
            no_figures,
        }
    }
}

/// The figures of all of a trial's time that have a value.
fn figures(
    trial: &Trial,
    points: Points,
) -> BTreeMap<&'static str, BTreeMap<String, BTreeMap<&'static str, f64>>> {
    let settings = Choice::default().settings(&points);
    let mut figures: BTreeMap<_, BTreeMap<_, BTreeMap<_, _>>> = BTreeMap::new();
    let rows = tidy::of_points(trial, points, &settings).rows;
    for row in rows.iter().filter(|row| row.segment == tidy::WHOLE) {
        if let Some(value) = row.value {
            let of_trunk = figures.entry(row.trunk).or_default();
            of_trunk.entry(name(row.figure, row.unit)).or_default().insert(row.direction, value);
        }
    }
    figures
}

/// A figure's name with its unit: `path_length_mm`.
fn name(figure: &str, unit: &str) -> String {
    let figure = figure.to_lowercase().replace([' ', '-'], "_");
    let unit = unit.to_lowercase().replace('²', "2").replace('/', "_");
    if unit.is_empty() { figure } else { format!("{figure}_{unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_their_units_in_their_names() {
        assert_eq!(name("path length", "mm"), "path_length_mm");
        assert_eq!(name("ellipse long semi-axis", "mm"), "ellipse_long_semi_axis_mm");
        assert_eq!(name("diffusion short term", "mm²/s"), "diffusion_short_term_mm2_s");
        assert_eq!(name("Hurst exponent long term", ""), "hurst_exponent_long_term");
    }
}
