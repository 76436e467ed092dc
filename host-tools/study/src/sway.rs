//! The sway of a trial: path lengths of each point by direction and time, as in the paper's Table
//! II.

use plumbline_analysis::sway::figure::{ByDirection, Figure};
use plumbline_analysis::sway::{self, Settings};
use plumbline_files::BadInput;
use plumbline_trial::points::Points;
use serde::Serialize;

/// The directions, as the paper calls them.
pub const DIRECTIONS: [&str; 6] = ["AP", "ML", "SI", "APML", "APSI", "MLSI"];

/// A path, given by its point and its direction.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Path {
    /// `lower`, `upper`, or `point` of a table.
    pub point: String,
    /// One of [`DIRECTIONS`].
    pub direction: &'static str,
}

/// The values of a trial.
#[derive(Debug, Default)]
pub struct Found {
    /// The length of each path at each time, mm.
    pub responses: Vec<(Path, Vec<Option<f64>>)>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// The path lengths of one trial.
///
/// # Errors
/// When no figures can be computed from its positions.
pub fn of_trial(points: &Points, settings: &Settings) -> Result<Found, BadInput> {
    let place = &points.place;
    let mut found = Found::default();
    for point in &points.points {
        let sway = sway::analyze(&point.series, None, settings).map_err(|error| {
            BadInput::new(place, &point.name, error, "leave this trial out, or record it again")
        })?;
        let bins = &sway.figures.bins;
        let is_whole: Vec<bool> =
            bins.iter().map(|bin| bin.covered >= settings.covered_min).collect();
        for (bin, _) in bins.iter().zip(&is_whole).filter(|(_, is_whole)| !**is_whole) {
            found.warnings.push(format!(
                "{place}: {} trunk: only {:.0} % of {} to {} s was measured, so it has no value",
                point.name,
                100.0 * bin.covered,
                bin.from_s,
                bin.to_s
            ));
        }
        let lengths: Vec<[Option<f64>; 6]> =
            bins.iter().map(|bin| lengths_mm(&bin.length_mm)).collect();
        for (at, direction) in DIRECTIONS.into_iter().enumerate() {
            let along = lengths.iter().zip(&is_whole);
            let along = along.map(|(bin, is_whole)| bin[at].filter(|_| *is_whole)).collect();
            let path = Path { point: point.name.clone(), direction };
            found.responses.push((path, along));
        }
    }
    Ok(found)
}

fn lengths_mm(lengths: &ByDirection<Figure>) -> [Option<f64>; 6] {
    let ByDirection { axes, planes } = lengths;
    [&axes.ap, &axes.ml, &axes.si, &planes.transverse, &planes.sagittal, &planes.coronal]
        .map(Figure::value)
}
