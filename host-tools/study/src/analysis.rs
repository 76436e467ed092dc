//! The sway figures of one trial.

pub mod tables;

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
    /// The window of the filter, seconds.
    pub filter_s: f64,
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
    /// The figures of the filtered positions: the paper's.
    pub filtered: Sway,
    /// The figures of the positions as measured.
    pub unfiltered: Sway,
}

impl Analysis {
    /// The figures of the points of a trial: filtered with a window of `filter_s` seconds, and as
    /// measured.
    ///
    /// # Errors
    /// When the settings do not suit the trial.
    pub fn of(points: &Points, filter_s: f64, settings: &Settings) -> Result<Self, BadInput> {
        let filtered = Settings { filter_s: Some(filter_s), ..settings.clone() };
        let unfiltered = Settings { filter_s: None, ..settings.clone() };
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
            Ok(PointFigures {
                point: point.name.clone(),
                filtered: sway(&filtered)?,
                unfiltered: sway(&unfiltered)?,
            })
        };
        Ok(Self {
            program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
            source: points.place.clone(),
            zero: points.zero.clone(),
            filter_s,
            verdict: points.verdict.clone(),
            points: points.points.par_iter().map(figures).collect::<Result<_, BadInput>>()?,
            events: points.events.clone(),
            warnings: points.warnings.clone(),
        })
    }
}
