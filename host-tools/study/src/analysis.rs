//! The sway figures of one trial.

pub mod standard;
pub mod tables;

use plumbline_analysis::filter::Design;
use plumbline_analysis::sway::{self, Settings, Sway};
use plumbline_files::BadInput;
use plumbline_trial::Verdict;
use plumbline_trial::manifest::EventSeen;
use plumbline_trial::points::{Point, Points};
use rayon::prelude::*;
use serde::Serialize;

/// The figures of one trial, as written to JSON.
#[derive(Debug, Clone, Serialize)]
pub struct Analysis {
    /// The program that computed them.
    pub program: &'static str,
    /// Where the positions come from.
    pub source: String,
    /// The event at t = 0.
    pub zero: String,
    /// The time that was analysed, in words; its start and end are those of each point.
    pub span: String,
    /// The filter.
    pub filter: Design,
    /// The fraction of a time bin that must have been measured for it to have a path.
    pub covered_min: f64,
    /// What the uncertainty of each figure contains: nothing where the noise is not known.
    pub uncertainty_contains: &'static [&'static str],
    /// The verdict on the trial; absent of a table.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The points of the body.
    pub points: Vec<PointFigures>,
    /// The events, on the same clock.
    pub events: Vec<EventSeen>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
}

/// The figures of one point.
#[derive(Debug, Clone, Serialize)]
pub struct PointFigures {
    /// `lower`, `upper`, or `point` of a table.
    pub point: String,
    /// The figures of the filtered positions.
    pub filtered: Sway,
    /// The figures of the positions as measured.
    pub unfiltered: Sway,
}

impl Analysis {
    /// The figures of the points of a trial: filtered, and as measured.
    ///
    /// # Errors
    /// When the settings do not suit the trial.
    pub fn of(points: &Points, settings: &Settings) -> Result<Self, BadInput> {
        let figures = |point: &Point| {
            let sway = |settings: &Settings| {
                sway::analyze(&point.series, point.noise.as_ref(), settings).map_err(|error| {
                    BadInput::new(
                        &points.place,
                        &point.name,
                        error,
                        "give other settings (--filter, --span, --bins, --radius), or a longer trial",
                    )
                })
            };
            let filtered = sway(settings)?;
            let unfiltered = match settings.filter {
                Design::None => filtered.clone(),
                _ => sway(&Settings { filter: Design::None, ..settings.clone() })?,
            };
            Ok(PointFigures { point: point.name.clone(), filtered, unfiltered })
        };
        let figures: Vec<PointFigures> =
            points.points.par_iter().map(figures).collect::<Result<_, BadInput>>()?;
        let mut warnings = points.warnings.clone();
        warnings.extend(standard::below(figures.iter().map(|it| &it.filtered)));
        Ok(Self {
            program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
            source: points.place.clone(),
            zero: points.zero.clone(),
            span: span(settings),
            filter: settings.filter,
            covered_min: settings.covered_min,
            uncertainty_contains: if points.points.iter().any(|it| it.noise.is_some()) {
                &["noise"]
            } else {
                &[]
            },
            verdict: points.verdict.clone(),
            points: figures,
            events: points.events.clone(),
            warnings,
        })
    }
}

/// The time that is analysed, in words.
fn span(settings: &Settings) -> String {
    match &settings.span_s {
        None => "all".to_owned(),
        Some(span_s) if span_s.end.is_finite() => format!("{} to {} s", span_s.start, span_s.end),
        Some(span_s) if span_s.start == 0.0 => "from t = 0 on".to_owned(),
        Some(span_s) => format!("from {} s on", span_s.start),
    }
}
