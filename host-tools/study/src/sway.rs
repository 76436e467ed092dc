//! The sway of a trial: the chosen figures of each point, by time where a figure is of a path, and
//! of all times together.

use plumbline_analysis::sway::figure::{Absent, Figure};
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
        if let Ok(Sway { figures, .. }) = &sway {
            // Only times that a chosen figure is of.
            let is_chosen = |by_time| chosen.iter().any(|it| it.measure.is_by_time() == by_time);
            let bins = figures.bins.iter().filter(|_| is_chosen(true));
            let times = bins.chain(Some(&figures.path).filter(|_| is_chosen(false)));
            let short = times.filter_map(|it| it.too_little(settings.covered_min));
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
    let value = |figure: &Figure| match figure {
        Figure::Known { value, .. } => Ok(*value),
        Figure::Absent { absent } => Err(format!("{place}: {absent}")),
    };
    let figures = &sway.figures;
    if measure.is_by_time() {
        let of_bins = figures.bins.iter().filter_map(|bin| measure.of_path(bin, direction));
        return of_bins.map(value).collect();
    }
    // A figure of the whole span has a value however little of it was measured; a study asks as much
    // of it as of a bin. That an axis was not measured at all says more.
    let figure = measure.of_span(figures, direction);
    vec![match (figure, figures.path.too_little(settings.covered_min)) {
        (Figure::Absent { absent: Absent::NotMeasured(_) }, _) | (_, None) => value(figure),
        (_, Some(short)) => Err(format!("{place}: {short}")),
    }]
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::series::Series;
    use plumbline_trial::test_trial;

    use super::*;
    use crate::measures;
    use crate::time::whole;

    /// What is found in this many seconds of a swaying point, of which three bins are 10 s each.
    fn found(seconds: u32, figure: &str) -> Found {
        let time_s: Vec<f64> = (0..=60 * seconds).map(|at| f64::from(at) / 60.0).collect();
        let ap_mm: Vec<f64> = time_s.iter().map(|it| it.sin()).collect();
        let series = Series::new(time_s, [ap_mm.clone(), ap_mm, Vec::new()]).unwrap();
        let points = test_trial::points("t", series);
        let bins_s = vec![0.0..10.0, 10.0..20.0, 20.0..30.0];
        let settings = Settings { span_s: whole(&bins_s), bins_s, ..Settings::default() };
        of_trial(&points, &settings, &measures::choose([figure]).unwrap())
    }

    #[test]
    fn only_times_of_chosen_figures_are_said_to_have_no_value() {
        let late =
            "t, lower trunk: 20 to 30 s: 8.0 of 10 s measured (80 %); at least 90 % are needed";
        let path = found(28, "path length AP");
        assert_eq!(path.warnings, [format!("{late}: no value")]);
        assert_eq!(path.responses[0].1[2], Err(late.to_owned()));
        // 28 of 30 s are enough for what is of all times together, and 20 are not.
        let rms = found(28, "RMS AP");
        assert!(rms.warnings.is_empty() && rms.responses[0].1[0].is_ok(), "{rms:?}");
        let short =
            "t, lower trunk: 0 to 30 s: 20.0 of 30 s measured (66 %); at least 90 % are needed";
        let rms = found(20, "RMS AP");
        assert_eq!(rms.warnings, [format!("{short}: no value")]);
        assert_eq!(rms.responses[0].1, [Err(short.to_owned())]);
        // What was not measured at all says so.
        let si = found(20, "RMS SI").responses;
        assert_eq!(si[0].1, [Err("t, lower trunk: SI was not measured".to_owned())]);
    }
}
