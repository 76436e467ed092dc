//! All figures of a study.

use plumbline_analysis::physiology::bins::{Event, Window};
use plumbline_analysis::statistics::inference::Inference;
use plumbline_analysis::statistics::within::Incomplete;
use plumbline_analysis::sway::Settings;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_trial::Trial;
use plumbline_trial::points::Points;
use rayon::prelude::*;
use serde::Serialize;

use crate::manifest::{Entry, Source, Study};
use crate::physiology::{self, Quantity};
use crate::sway::{self, Path};
use crate::time::time_name;
use crate::values::{self, Response, TrialValues};
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
    /// In the order of their first trials.
    pub participants: Vec<String>,
    /// Total path length, mm, of each point in each direction: condition by T1, T2, ...
    pub path_lengths: Vec<PathLength>,
    /// The time windows of the physiological values.
    pub windows: Vec<TimeWindow>,
    /// Each quantity of the paper's Table I: condition by time window.
    pub physiology: Vec<Physiological>,
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

/// The length of a path.
#[derive(Debug, Clone, Serialize)]
pub struct PathLength {
    /// Its point and direction.
    #[serde(flatten)]
    pub path: Path,
    /// Condition by time.
    pub inference: Inference,
    /// Participants without a value in some cell.
    pub left_out: Vec<Incomplete>,
}

/// A physiological quantity.
#[derive(Debug, Clone, Serialize)]
pub struct Physiological {
    /// The quantity.
    pub quantity: Quantity,
    /// Its unit.
    pub unit: &'static str,
    /// Condition by time.
    pub inference: Inference,
    /// Participants without a value in some cell.
    pub left_out: Vec<Incomplete>,
}

/// With fewer participants, the distributions assumed by the tests are only a guess.
const PARTICIPANTS_MIN: usize = 7;

/// The values of one trial.
struct OneTrial {
    sway: TrialValues<Path>,
    physiology: TrialValues<Quantity>,
    warnings: Vec<String>,
}

/// Analyses all trials of a study.
///
/// # Errors
/// When a trial cannot be used, has no participant or condition, or data are missing.
pub fn analyze(study: &Study) -> Result<StudyFigures, BadInput> {
    let settings = Settings { bins_s: study.bins_s.clone(), ..Settings::default() };
    let windows = study.physiology.as_ref().map(|it| it.windows(&study.bins_s));
    let windows = windows.unwrap_or_default();
    let (entries, mut warnings) = verdict::admitted(study)?;
    let trials: Vec<OneTrial> = entries
        .par_iter()
        .map(|entry| one_trial(study, entry, &settings, &windows))
        .collect::<Vec<_>>()
        .into_iter()
        // Of several errors, always the first is reported.
        .collect::<Result<_, _>>()?;
    let (mut sways, mut physiologies) = (Vec::new(), Vec::new());
    for trial in trials {
        sways.push(trial.sway);
        physiologies.push(trial.physiology);
        warnings.extend(trial.warnings);
    }
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
        sways: &[TrialValues<Path>],
        physiologies: &[TrialValues<Quantity>],
        mut warnings: Vec<String>,
    ) -> Result<Self, BadInput> {
        let mut note = |name: &str, response: &Response| {
            warnings.extend(response.left_out.iter().map(|it| {
                let cell = it.cell.join(", ");
                format!("{name}: participant {} is left out: no value in {cell}", it.subject)
            }));
        };
        let times: Vec<String> = (0..study.bins_s.len()).map(time_name).collect();
        let mut path_lengths = Vec::new();
        for path in values::responses(sways) {
            let name = format!("{} trunk, {}", path.point, path.direction);
            if let Some(response) = values::analyse(study, &times, sways, &path, &name)? {
                note(&name, &response);
                let Response { inference, left_out } = response;
                path_lengths.push(PathLength { path, inference, left_out });
            }
        }
        let times: Vec<String> = windows.iter().map(|it| it.name.clone()).collect();
        let mut physiology = Vec::new();
        for quantity in Quantity::ALL {
            let (name, unit) = quantity.name_and_unit();
            if let Some(response) = values::analyse(study, &times, physiologies, &quantity, name)? {
                note(name, &response);
                let Response { inference, left_out } = response;
                physiology.push(Physiological { quantity, unit, inference, left_out });
            }
        }
        let mut participants: Vec<String> = Vec::new();
        for trial in sways {
            if !participants.contains(&trial.participant) {
                participants.push(trial.participant.clone());
            }
        }
        if participants.len() < PARTICIPANTS_MIN {
            warnings.push(format!(
                "{}: with so few, p values mean little, least of all those of rank tests",
                counted(participants.len(), "participant")
            ));
        }
        Ok(Self {
            program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
            title: study.title.clone(),
            conditions: study.conditions.clone(),
            bins_s: study.bins_s.iter().map(|bin| [bin.start, bin.end]).collect(),
            participants,
            path_lengths,
            windows: windows
                .iter()
                .map(|Window { name, from, span_s }| TimeWindow {
                    name: name.clone(),
                    from: *from,
                    span_s: [span_s.start, span_s.end],
                })
                .collect(),
            physiology,
            warnings,
        })
    }
}

fn one_trial(
    study: &Study,
    entry: &Entry,
    settings: &Settings,
    windows: &[Window],
) -> Result<OneTrial, BadInput> {
    let (points, participant, condition) = match &entry.source {
        Source::Table(table) => (Points::of_table(table)?, None, None),
        Source::Trial(folder) => {
            let trial = Trial::open(folder)?;
            let points = Points::of(&trial, trial.manifest.zero)?;
            (points, trial.manifest.participant, trial.manifest.condition)
        }
    };
    let place = &points.place;
    // The study's entry takes precedence over the trial's. As in tables, blanks around a name are
    // ignored.
    let named = |what: &str, names: [Option<&String>; 2]| {
        let mut names = names.into_iter().flatten().map(|it| it.trim());
        names.find(|it| !it.is_empty()).map(str::to_owned).ok_or_else(|| {
            BadInput::new(
                place,
                what,
                "neither the trial nor the study gives it",
                format!("add {what} = \"...\" to its [[trial]] in {}", study.place),
            )
        })
    };
    let participant = named("participant", [entry.participant.as_ref(), participant.as_ref()])?;
    let condition = named("condition", [entry.condition.as_ref(), condition.as_ref()])?;
    if !study.conditions.contains(&condition) {
        return Err(BadInput::new(
            place,
            "condition",
            format!("{condition:?} is not one of {}", study.conditions.join(", ")),
            format!("correct it, or add it to the conditions in {}", study.place),
        ));
    }
    let mut warnings: Vec<String> =
        points.warnings.iter().map(|warning| format!("{place}: {warning}")).collect();
    let sway = sway::of_trial(&points, settings)?;
    warnings.extend(sway.warnings);
    let physiology = match study.physiology.as_ref().zip(entry.physiology.as_ref()) {
        Some((plan, recordings)) => {
            physiology::of_trial(study, plan, recordings, &points, windows)?
        }
        None => physiology::Found::default(),
    };
    warnings.extend(physiology.warnings);
    let sway = TrialValues {
        participant: participant.clone(),
        condition: condition.clone(),
        responses: sway.responses,
    };
    let physiology = TrialValues { participant, condition, responses: physiology.responses };
    Ok(OneTrial { sway, physiology, warnings })
}
