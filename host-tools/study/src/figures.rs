//! All figures of a study.

use std::collections::{HashMap, HashSet};

use plumbline_analysis::physiology::bins::{Event, Window};
use plumbline_analysis::sway::Settings;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_trial::points::point_name;
use rayon::prelude::*;
use serde::Serialize;

use crate::candidate::{Candidate, Measured};
use crate::complete;
use crate::manifest::Study;
use crate::physiology::{self, Quantity};
use crate::sway::{self, SwayFigure};
use crate::time::{time_name, whole};
use crate::values::{self, LeftOut, Response, TrialValues};
use crate::verdict;

/// The figures of a study.
#[derive(Debug, Clone, Serialize)]
pub struct StudyFigures {
    /// The program that computed them.
    pub program: &'static str,
    /// The study's name.
    pub title: String,
    /// In the order of the tables.
    pub conditions: Vec<String>,
    /// From t = 0, seconds.
    pub bins_s: Vec<[f64; 2]>,
    /// All these times together: what a figure that is not of a path is computed from.
    pub span_s: [f64; 2],
    /// Everybody who has a trial, in the order of their first ones; each response says how many of
    /// them are in it.
    pub participants: Vec<String>,
    /// The chosen figures of each point: condition by T1, T2, ..., or condition alone.
    pub sway: Vec<SwayResponse>,
    /// The time windows of the physiological values.
    pub windows: Vec<TimeWindow>,
    /// Each quantity of the paper's Table I: condition by time window.
    pub physiology: Vec<Physiological>,
    /// What was to be compared, and could not be.
    pub not_compared: Vec<NotCompared>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
}

/// A part of a trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TimeWindow {
    /// Its name.
    pub name: String,
    /// The event from which its seconds are counted.
    pub from: Event,
    /// Its start and its end (exclusive), seconds.
    pub span_s: [f64; 2],
}

/// A figure of sway.
#[derive(Debug, Clone, Serialize)]
pub struct SwayResponse {
    /// Which, of which point, in which direction.
    #[serde(flatten)]
    pub figure: SwayFigure,
    /// Its statistics.
    #[serde(flatten)]
    pub response: Response,
}

/// A physiological quantity.
#[derive(Debug, Clone, Serialize)]
pub struct Physiological {
    /// The quantity.
    pub quantity: Quantity,
    /// Its unit.
    pub unit: &'static str,
    /// Its statistics.
    #[serde(flatten)]
    pub response: Response,
}

/// A response without statistics.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct NotCompared {
    /// Its name.
    pub name: String,
    /// Why there are none.
    pub reason: String,
}

/// With fewer participants, the distributions assumed by the tests are only a guess.
const PARTICIPANTS_MIN: usize = 7;

/// So many names stand in a message; of more, only the number.
const NAMES_MAX: usize = 3;

/// The values of one trial.
struct OneTrial {
    sway: TrialValues<SwayFigure>,
    physiology: TrialValues<Quantity>,
    warnings: Vec<String>,
}

/// Analyses all trials of a study.
///
/// # Errors
/// When a trial cannot be used, has no participant or condition, or data are missing.
pub fn analyze(study: &Study) -> Result<StudyFigures, BadInput> {
    if let Some(cohort) = &study.cohort {
        return Err(BadInput::new(
            &study.place,
            "cohort",
            format!("its trials are in {}, which is not read here", cohort.display()),
            "use `plumb study` or `plumb report`",
        ));
    }
    analyze_trials(study, &study.trials, &|| ())
}

/// How the sway figures of a study's trials are made.
#[must_use]
pub fn settings(study: &Study) -> Settings {
    Settings { bins_s: study.bins_s.clone(), span_s: whole(&study.bins_s), ..Settings::default() }
}

/// The same of these trials, whatever the study names; `advance` is called after each.
///
/// Memory holds the values of all trials, and the points of those that are being read.
///
/// # Errors
/// As [`analyze`].
pub fn analyze_trials<C: Candidate>(
    study: &Study,
    trials: &[C],
    advance: &(dyn Fn() + Sync),
) -> Result<StudyFigures, BadInput> {
    let settings = settings(study);
    let windows = study.physiology.as_ref().map(|it| it.windows(&study.bins_s));
    let windows = windows.unwrap_or_default();
    let (entries, mut warnings) = verdict::admitted(study, trials)?;
    let trials: Vec<OneTrial> = entries
        .par_iter()
        .map(|entry| {
            let found = one_trial(study, *entry, &settings, &windows);
            advance();
            found
        })
        .collect::<Vec<_>>()
        .into_iter()
        // Of several errors, always the first is reported.
        .collect::<Result<_, _>>()?;
    let skipped = study.skipped.iter();
    warnings.extend(skipped.map(|it| {
        format!("{}: there is no trial in this folder: it is passed over", it.display())
    }));
    let (mut sways, mut physiologies) = (Vec::new(), Vec::new());
    for trial in trials {
        sways.push(trial.sway);
        physiologies.push(trial.physiology);
        warnings.extend(trial.warnings);
    }
    complete::check(study, &sways)?;
    StudyFigures::of(study, &windows, &sways, &physiologies, warnings)
}

impl StudyFigures {
    /// The figures from the values of a study's trials.
    ///
    /// # Errors
    /// When data are missing.
    pub fn of(
        study: &Study,
        windows: &[Window],
        sways: &[TrialValues<SwayFigure>],
        physiologies: &[TrialValues<Quantity>],
        mut warnings: Vec<String>,
    ) -> Result<Self, BadInput> {
        let mut seen = Seen::default();
        let mut sway = Vec::new();
        for figure in values::responses(sways) {
            let response = seen.note(compare_sway(study, sways, &figure)?);
            sway.extend(response.map(|response| SwayResponse { figure, response }));
        }
        let times: Vec<String> = windows.iter().map(|it| it.name.clone()).collect();
        let mut physiology = Vec::new();
        let measured = values::responses(physiologies);
        for quantity in Quantity::ALL.into_iter().filter(|it| measured.contains(it)) {
            let (name, unit) = quantity.name_and_unit();
            let response = seen.note(compare(study, &times, physiologies, &quantity, name)?);
            physiology.extend(response.map(|response| Physiological { quantity, unit, response }));
        }
        // What the paper's two tables ask are two questions.
        values::adjust(&mut sway.iter_mut().map(|it| &mut it.response).collect::<Vec<_>>());
        values::adjust(&mut physiology.iter_mut().map(|it| &mut it.response).collect::<Vec<_>>());

        let all = sway.iter().map(|it| &it.response);
        let all = all.chain(physiology.iter().map(|it| &it.response));
        let Some(fewest) = all.map(|it| it.n).min() else {
            return Err(seen.nothing(&study.place));
        };
        warnings.extend(seen.warnings());
        if fewest < PARTICIPANTS_MIN {
            warnings.push(format!(
                "{}: with so few, p values mean little, least of all those of rank tests",
                counted(fewest, "participant")
            ));
        }
        let participants = values::participants(sways).into_iter();
        let span_s = whole(&study.bins_s).unwrap_or(0.0..0.0);
        Ok(Self {
            program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
            title: study.title.clone(),
            conditions: study.conditions.clone(),
            bins_s: study.bins_s.iter().map(|bin| [bin.start, bin.end]).collect(),
            span_s: [span_s.start, span_s.end],
            participants: participants.map(str::to_owned).collect(),
            sway,
            windows: windows
                .iter()
                .map(|Window { name, from, span_s }| TimeWindow {
                    name: name.clone(),
                    from: *from,
                    span_s: [span_s.start, span_s.end],
                })
                .collect(),
            physiology,
            not_compared: seen.not_compared,
            warnings,
        })
    }

    /// The number of participants, and of those in every response, in words.
    #[must_use]
    pub fn participants_text(&self) -> String {
        let all = self.participants.len();
        let incomplete: HashSet<&str> = self.left_out().map(|it| &*it.participant).collect();
        let everybody = self.participants.iter().map(String::as_str);
        let left_out: Vec<&str> = everybody.filter(|who| incomplete.contains(who)).collect();
        let counted = counted(all, "participant");
        if left_out.is_empty() {
            return counted;
        }
        let complete = all - left_out.len();
        format!("{counted}, {complete} in every response (not: {})", left_out.join(", "))
    }

    /// What could not be compared, in one line for each reason.
    #[must_use]
    pub fn not_compared_lines(&self) -> Vec<String> {
        let mut by_reason: Vec<(&str, Vec<String>)> = Vec::new();
        for NotCompared { name, reason } in &self.not_compared {
            match by_reason.iter_mut().find(|(it, _)| it == reason) {
                Some((_, names)) => names.push(name.clone()),
                None => by_reason.push((reason, vec![name.clone()])),
            }
        }
        let by_reason = by_reason.into_iter();
        by_reason
            .map(|(reason, names)| format!("Not compared: {}: {reason}", short(&names)))
            .collect()
    }

    /// Everybody who is left out of a response, once for each.
    fn left_out(&self) -> impl Iterator<Item = &LeftOut> {
        let sway = self.sway.iter().map(|it| &it.response);
        sway.chain(self.physiology.iter().map(|it| &it.response)).flat_map(|it| &it.left_out)
    }
}

/// The name of a response and its statistics, or why there are none.
pub type Compared = Result<(String, Response), NotCompared>;

/// The statistics of a figure of sway.
///
/// # Errors
/// When data are missing, and the study does not leave out whoever is incomplete.
pub fn compare_sway(
    study: &Study,
    trials: &[TrialValues<SwayFigure>],
    figure: &SwayFigure,
) -> Result<Compared, BadInput> {
    let name = format!("{}, {}", point_name(&figure.point), figure.name());
    let times: Vec<String> = match figure.is_by_time {
        true => (0..study.bins_s.len()).map(time_name).collect(),
        false => Vec::new(),
    };
    compare(study, &times, trials, figure, &name)
}

/// The statistics of a response; none where nobody has a value at all or, if the study leaves out
/// whoever is incomplete, where too few remain.
fn compare<M: PartialEq>(
    study: &Study,
    times: &[String],
    trials: &[TrialValues<M>],
    response: &M,
    name: &str,
) -> Result<Compared, BadInput> {
    let name = name.to_owned();
    if let Some(reason) = values::never_measured(trials, response) {
        return Ok(Err(NotCompared { name, reason }));
    }
    match values::analyse(study, times, trials, response, &name) {
        Ok(response) => Ok(Ok((name, response))),
        Err(error) if study.drop_incomplete => Ok(Err(NotCompared { name, reason: error.found })),
        Err(error) => Err(error),
    }
}

/// What is seen while a study's responses are compared one by one.
#[derive(Default)]
struct Seen {
    /// With the names of the responses that lack them.
    left_out: Vec<(LeftOut, Vec<String>)>,
    /// Where in that list each is.
    places: HashMap<LeftOut, usize>,
    not_compared: Vec<NotCompared>,
}

impl Seen {
    /// Keeps what is to be said of a response; gives its statistics.
    fn note(&mut self, compared: Compared) -> Option<Response> {
        match compared {
            Ok((name, response)) => {
                for it in &response.left_out {
                    match self.places.get(it) {
                        Some(at) => self.left_out[*at].1.push(name.clone()),
                        None => {
                            self.places.insert(it.clone(), self.left_out.len());
                            self.left_out.push((it.clone(), vec![name.clone()]));
                        }
                    }
                }
                Some(response)
            }
            Err(not_compared) => {
                self.not_compared.push(not_compared);
                None
            }
        }
    }

    /// One line for each participant and reason.
    fn warnings(&self) -> impl Iterator<Item = String> {
        self.left_out.iter().map(|(it, names)| {
            let LeftOut { participant, cell, reason } = it;
            let (names, cell) = (short(names), cell.join(", "));
            format!("{names}: participant {participant} is left out: no value in {cell}: {reason}")
        })
    }

    /// The error when nothing at all was compared.
    fn nothing(self, place: &str) -> BadInput {
        let first = self.not_compared.into_iter().next();
        let found = first.map_or_else(
            || "no trial has a figure to compare".to_owned(),
            |it| format!("nothing can be compared; {}: {}", it.name, it.reason),
        );
        BadInput::whole(
            place,
            found,
            "record what is missing, or change conditions, bins_s or figures",
        )
    }
}

/// Names in a message: the first, and how many others there are.
fn short(names: &[String]) -> String {
    match names {
        [first, others @ ..] if names.len() > NAMES_MAX => {
            format!("{first}, and {}", counted(others.len(), "other response"))
        }
        _ => names.join("; "),
    }
}

fn one_trial<C: Candidate>(
    study: &Study,
    entry: &C,
    settings: &Settings,
    windows: &[Window],
) -> Result<OneTrial, BadInput> {
    let Measured { points, participant, condition } = entry.read()?;
    let place = &points.place;
    let named = |what: &str, name: Option<String>| {
        name.ok_or_else(|| {
            BadInput::new(
                place,
                what,
                "neither the trial nor the study gives it",
                format!(
                    "write {what} = \"...\" in its trial.toml, or in a [[trial]] of {}",
                    study.place
                ),
            )
        })
    };
    let participant = named("participant", participant)?;
    let condition = named("condition", condition)?;
    let mut warnings: Vec<String> =
        points.warnings.iter().map(|warning| format!("{place}: {warning}")).collect();
    let sway = sway::of_trial(&points, settings, &study.figures);
    warnings.extend(sway.warnings);
    let recordings = entry.recordings();
    let physiology = match study.physiology.as_ref().zip(recordings) {
        Some((plan, recordings)) => {
            physiology::of_trial(study, plan, recordings, &points, windows)?
        }
        None => physiology::Found::default(),
    };
    warnings.extend(physiology.warnings);
    let sway = TrialValues {
        place: place.clone(),
        participant: participant.clone(),
        condition: condition.clone(),
        responses: sway.responses,
    };
    let responses = physiology.responses;
    let place = recordings.map_or_else(|| place.clone(), |it| it.folder.display().to_string());
    let physiology = TrialValues { place, participant, condition, responses };
    Ok(OneTrial { sway, physiology, warnings })
}
