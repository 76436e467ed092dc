//! The sway of a trial: the chosen figures of each point, by time where a figure is of a path, and
//! of all times together.

use plumbline_analysis::sway::figure::{Absent, Figure};
use plumbline_analysis::sway::path::Path;
use plumbline_analysis::sway::{self, Settings, Sway};
use plumbline_trial::points::{Points, point_name};
use serde::Serialize;

use crate::measures::Chosen;
use crate::values::Value;

/// A figure of one point of the body.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SwayFigure {
    /// Its name.
    pub figure: &'static str,
    /// Its unit; empty for a number without one.
    pub unit: &'static str,
    /// `lower`, `upper`, or `point` of a table.
    pub point: String,
    /// `AP`, `ML`, `SI`; `APML`, `APSI`, `MLSI` for the planes.
    pub direction: &'static str,
    /// Whether it has a value for each time; otherwise it has one for all times together.
    #[serde(skip)]
    pub is_by_time: bool,
}

impl SwayFigure {
    /// The figure of a point.
    #[must_use]
    pub fn new(Chosen { measure, direction }: Chosen, point: &str) -> Self {
        Self {
            figure: measure.name,
            unit: measure.unit,
            point: point.to_owned(),
            direction: direction.word(),
            is_by_time: measure.is_by_time(),
        }
    }

    /// Its name in messages, without its point.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{} {}", self.figure, self.direction)
    }
}

/// The values of a trial.
#[derive(Debug, Default)]
pub struct Found {
    /// Each figure's value at each time, or the one of all times together.
    pub responses: Vec<(SwayFigure, Vec<Value>)>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// The chosen figures of one trial.
#[must_use]
pub fn of_trial(points: &Points, settings: &Settings, chosen: &[Chosen]) -> Found {
    let mut found = Found::default();
    for point in &points.points {
        let place = format!("{}, {}", points.place, point_name(&point.name).to_lowercase());
        let sway = sway::analyze(&point.series, None, settings);
        let sway = sway.map_err(|error| format!("{place}: {error}"));
        if let Ok(sway) = &sway {
            let short =
                sway.figures.bins.iter().filter_map(|bin| bin.shortfall(settings.covered_min));
            found.warnings.extend(short.map(|short| format!("{place}: {short}: no value")));
        }
        found.responses.extend(chosen.iter().map(|chosen| {
            let values = values(&place, sway.as_ref(), settings, *chosen);
            (SwayFigure::new(*chosen, &point.name), values)
        }));
    }
    found
}

/// The values of one figure; the reasons for absent ones begin with their `place`.
fn values(
    place: &str,
    sway: Result<&Sway, &String>,
    settings: &Settings,
    Chosen { measure, direction }: Chosen,
) -> Vec<Value> {
    let times = if measure.is_by_time() { settings.bins_s.len() } else { 1 };
    let sway = match sway {
        Ok(sway) => sway,
        Err(reason) => return vec![Err(reason.clone()); times],
    };
    // That an axis was not measured at all says more than how much of a time was.
    let short = |path: &Path| path.shortfall(settings.covered_min);
    let value = |path: &Path, figure: &Figure| match (figure, short(path)) {
        (Figure::Absent { absent: absent @ Absent::NotMeasured(_) }, _) => {
            Err(format!("{place}: {absent}"))
        }
        (_, Some(short)) => Err(format!("{place}: {short}")),
        (Figure::Absent { absent }, None) => Err(format!("{place}: {absent}")),
        (Figure::Known { value, .. }, None) => Ok(*value),
    };
    let figures = &sway.figures;
    let by_time = figures.bins.iter();
    let by_time = by_time.filter_map(|bin| Some(value(bin, measure.of_path(bin, direction)?)));
    if measure.is_by_time() {
        by_time.collect()
    } else {
        vec![value(&figures.path, measure.of_span(figures, direction))]
    }
}
