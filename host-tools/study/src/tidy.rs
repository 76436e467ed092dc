//! All figures of trials as a tidy table: one row for each trial, trunk, time, figure and
//! direction, as statistics programs read it.
//!
//! Every trial has the same rows. Where a figure could not be computed, its value is empty and the
//! reason is given.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use plumbline_analysis::sway::figure::Figure;
use plumbline_analysis::sway::path::Path as SwayPath;
use plumbline_analysis::sway::{Prepared, Settings, SwayFigures};
use plumbline_files::BadInput;
use plumbline_files::text::as_cell;
use plumbline_trial::Trial;
use plumbline_trial::frame::Trunk;
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::parquet::{self, Values};
use plumbline_trial::points::{Point, Points};
use plumbline_trial::verdict::Grade;
use serde::Serialize;

use crate::measures::{Direction, MEASURES, Measure};
use crate::time::time_name;

/// The name of the segment that is all of the analysed time.
pub const WHOLE: &str = "whole";

/// Why a trunk has no figures at all.
const NOT_SEEN: &str = "fewer than two frames have its position";

/// One row; its fields are the columns.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Who was measured, as trial.toml says.
    #[serde(serialize_with = "as_cell::serialize")]
    pub participant: String,
    /// Under which condition, likewise.
    #[serde(serialize_with = "as_cell::serialize")]
    pub condition: String,
    /// The trial's folder, as it was given.
    #[serde(serialize_with = "as_cell::serialize")]
    pub trial: String,
    /// The verdict on the trial: `good`, `doubtful` or `unusable`.
    pub verdict: &'static str,
    /// `lower` or `upper`.
    pub trunk: &'static str,
    /// The part of the trial: `T1`, `T2`, ... or `whole`.
    pub segment: String,
    /// Its start, seconds from t = 0.
    pub start_s: Option<f64>,
    /// Its end, likewise.
    pub end_s: Option<f64>,
    /// How much of it the figure is computed from, seconds.
    pub measured_s: Option<f64>,
    /// `AP`, `ML`, `SI`, or the plane `APML`, `APSI`, `MLSI`.
    pub direction: &'static str,
    /// The figure's name.
    pub figure: &'static str,
    /// Its value.
    pub value: Option<f64>,
    /// The standard uncertainty due to the noise of the positions, where that is known.
    pub standard_uncertainty: Option<f64>,
    /// The unit of both; empty for a number without one.
    pub unit: &'static str,
    /// The filter of the positions.
    pub filter: String,
    /// Frames per second.
    pub rate_hz: Option<f64>,
    /// Why there is no value.
    pub reason: String,
}

/// What the rows of a trial say of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct About {
    /// Who was measured.
    pub participant: String,
    /// Under which condition.
    pub condition: String,
    /// The trial's folder, or what stands for it.
    pub trial: String,
    /// The verdict on it.
    pub verdict: Grade,
}

impl About {
    /// A trial's folder.
    fn of(folder: &Path, manifest: &Manifest) -> Self {
        let text = |text: &Option<String>| text.as_deref().unwrap_or_default().trim().to_owned();
        Self {
            participant: text(&manifest.participant),
            condition: text(&manifest.condition),
            trial: folder.display().to_string(),
            verdict: manifest.verdict().grade(),
        }
    }
}

/// What is found in a trial.
#[derive(Debug, Clone)]
pub struct Found {
    /// Its rows.
    pub rows: Vec<Row>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// The rows of a trial; `settings` says how its figures are made.
///
/// # Errors
/// When the trial cannot be read, or no trunk has a position in it.
pub fn of_trial(
    folder: &Path,
    zero: Option<Zero>,
    settings: impl Fn(&Points) -> Settings,
) -> Result<Found, BadInput> {
    let trial = Trial::open(folder)?;
    let points = Points::of(&trial, zero.unwrap_or(trial.manifest.zero))?;
    let settings = settings(&points);
    Ok(of_points(&trial, points, &settings))
}

/// The same of a trial that has been read, and of its points.
#[must_use]
pub fn of_points(trial: &Trial, points: Points, settings: &Settings) -> Found {
    let about = About::of(&trial.folder, &trial.manifest);
    Found { rows: rows(about, &points, settings), warnings: points.warnings }
}

/// The rows of the points of any trial.
#[must_use]
pub fn rows(about: About, points: &Points, settings: &Settings) -> Vec<Row> {
    let of_trial = Row::of(about, settings);
    let rows = Trunk::ALL.into_iter().flat_map(|trunk| {
        let point = points.points.iter().find(|it| it.name == trunk.word());
        let rate_hz = point.map(|it| it.series.rate_hz());
        let of_trunk = Row { trunk: trunk.word(), rate_hz, ..of_trial.clone() };
        let sway = sway_of(point, settings);
        let figures = MEASURES.iter().flat_map(|measure| {
            measure.directions().iter().map(move |direction| (measure, *direction))
        });
        let rows = figures.flat_map(|(measure, direction)| {
            let of_figure = Row {
                figure: measure.name,
                unit: measure.unit,
                direction: direction.word(),
                ..of_trunk.clone()
            };
            let segments = segments(measure, direction, &sway, settings).into_iter();
            segments.map(move |it| it.row(of_figure.clone()))
        });
        rows.collect::<Vec<_>>()
    });
    rows.collect()
}

/// Refuses trials of which one is given twice: it would count twice.
///
/// # Errors
/// When one is; it is named.
pub fn refuse_twice(trials: &[PathBuf]) -> Result<(), BadInput> {
    let real: Vec<PathBuf> =
        trials.iter().map(|it| it.canonicalize().unwrap_or_else(|_| it.clone())).collect();
    let mut seen = HashSet::new();
    match real.iter().position(|it| !seen.insert(it)) {
        None => Ok(()),
        Some(at) => {
            let found = "this trial is given twice";
            Err(BadInput::whole(trials[at].display(), found, "give each trial once"))
        }
    }
}

/// The table as text, with a header.
///
/// # Panics
/// Never: memory takes any number of rows.
#[must_use]
pub fn csv(rows: &[Row]) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).expect("a row is flat");
    }
    writer.into_inner().expect("memory has no end of writing")
}

/// The columns of the table, as statistics programs name them. A text is as it was given: here none
/// is a formula.
#[must_use]
pub fn columns(rows: &[Row]) -> Vec<(String, Values)> {
    let texts =
        |of: fn(&Row) -> &str| Values::Texts(rows.iter().map(|row| of(row).to_owned()).collect());
    let numbers = |of: fn(&Row) -> Option<f64>| Values::SomeNumbers(rows.iter().map(of).collect());
    let columns = [
        ("participant", texts(|it| &it.participant)),
        ("condition", texts(|it| &it.condition)),
        ("trial", texts(|it| &it.trial)),
        ("verdict", texts(|it| it.verdict)),
        ("trunk", texts(|it| it.trunk)),
        ("segment", texts(|it| &it.segment)),
        ("start_s", numbers(|it| it.start_s)),
        ("end_s", numbers(|it| it.end_s)),
        ("measured_s", numbers(|it| it.measured_s)),
        ("direction", texts(|it| it.direction)),
        ("figure", texts(|it| it.figure)),
        ("value", numbers(|it| it.value)),
        ("standard_uncertainty", numbers(|it| it.standard_uncertainty)),
        ("unit", texts(|it| it.unit)),
        ("filter", texts(|it| &it.filter)),
        ("rate_hz", numbers(|it| it.rate_hz)),
        ("reason", texts(|it| &it.reason)),
    ];
    columns.into_iter().map(|(name, values)| (name.to_owned(), values)).collect()
}

/// The table as Parquet, with the same columns.
///
/// # Panics
/// Never: the columns are of one length, with a name each.
#[must_use]
pub fn parquet(rows: &[Row]) -> Vec<u8> {
    parquet::bytes("figures", &columns(rows), Vec::new()).expect("a row is flat")
}

impl Row {
    /// What all rows of a trial have in common.
    fn of(about: About, settings: &Settings) -> Self {
        let About { participant, condition, trial, verdict } = about;
        Self {
            participant,
            condition,
            trial,
            verdict: verdict.word(),
            trunk: "",
            segment: String::new(),
            start_s: None,
            end_s: None,
            measured_s: None,
            direction: "",
            figure: "",
            value: None,
            standard_uncertainty: None,
            unit: "",
            filter: settings.filter.to_string(),
            rate_hz: None,
            reason: String::new(),
        }
    }
}

/// The figures of a point, or why it has none.
fn sway_of(point: Option<&Point>, settings: &Settings) -> Result<SwayFigures, String> {
    let point = point.ok_or(NOT_SEEN)?;
    let prepared = Prepared::of(&point.series, settings);
    let figures = prepared.and_then(|it| it.figures(point.noise.as_ref()));
    figures.map(|(figures, _)| figures).map_err(|error| error.to_string())
}

/// A figure in a part of the trial.
struct Segment<'a> {
    name: String,
    span_s: Option<[f64; 2]>,
    measured_s: Option<f64>,
    figure: Result<&'a Figure, &'a str>,
}

/// A measure's figures in one direction: of each time, if it has them, and of the whole.
fn segments<'a>(
    measure: &Measure,
    direction: Direction,
    sway: &'a Result<SwayFigures, String>,
    settings: &Settings,
) -> Vec<Segment<'a>> {
    let times = if measure.is_by_time() { &settings.bins_s[..] } else { &[] };
    let times = times.iter().enumerate().map(|(at, bin)| {
        let path = sway.as_ref().ok().map(|sway| &sway.bins[at]);
        let figure = path.and_then(|path| measure.of_path(path, direction));
        Segment {
            name: time_name(at),
            span_s: Some([bin.start, bin.end]),
            measured_s: path.map(measured_s),
            figure: figure.ok_or_else(|| reason(sway)),
        }
    });
    let figures = sway.as_ref().ok();
    let path = figures.map(|it| &it.path);
    let given_s = settings.span_s.as_ref().map(|it| [it.start, it.end]);
    let longest_s = figures.map(|it| it.spectrum.to_s - it.spectrum.from_s);
    let whole = Segment {
        name: WHOLE.to_owned(),
        span_s: path.map(|it| [it.from_s, it.to_s]).or(given_s),
        measured_s: longest_s.filter(|_| measure.is_of_longest_part()).or(path.map(measured_s)),
        figure: figures.map(|it| measure.of_span(it, direction)).ok_or_else(|| reason(sway)),
    };
    times.chain([whole]).collect()
}

fn measured_s(path: &SwayPath) -> f64 {
    path.covered * (path.to_s - path.from_s)
}

fn reason(sway: &Result<SwayFigures, String>) -> &str {
    sway.as_ref().err().map_or("", String::as_str)
}

impl Segment<'_> {
    /// Completes a row.
    fn row(self, row: Row) -> Row {
        let figure = self.figure.ok();
        let reason = match self.figure {
            Ok(Figure::Absent { absent }) => absent.to_string(),
            Ok(Figure::Known { .. }) => String::new(),
            Err(reason) => reason.to_owned(),
        };
        Row {
            segment: self.name,
            start_s: self.span_s.map(|[start_s, _]| start_s),
            // Where nothing was seen, an open span has no end.
            end_s: self.span_s.map(|[_, end_s]| end_s).filter(|it| it.is_finite()),
            measured_s: self.measured_s,
            value: figure.and_then(Figure::value),
            standard_uncertainty: figure.and_then(Figure::noise_sd),
            reason,
            ..row
        }
    }
}

#[cfg(test)]
mod tests {
    use ::parquet::file::reader::{FileReader as _, SerializedFileReader};
    use ::parquet::record::Field;
    use plumbline_analysis::sway::figure::Absent;

    use super::*;

    #[test]
    fn a_figure_comes_with_its_uncertainty_or_the_reason_why_there_is_none() {
        let manifest = Manifest::begin(String::new(), None, None, None, Zero::Mark);
        let row = Row::of(About::of(Path::new("t"), &manifest), &Settings::default());
        let segment =
            |figure| Segment { name: "T1".to_owned(), span_s: None, measured_s: None, figure };
        let known = Figure::Known { value: 2.0, noise_sd: Some(0.25) };
        let found = segment(Ok(&known)).row(row.clone());
        assert_eq!((found.value, found.standard_uncertainty), (Some(2.0), Some(0.25)));
        assert_eq!(found.reason, "");
        let absent = Figure::Absent { absent: Absent::NoMovement };
        for (figure, reason) in [(Ok(&absent), "all positions are the same"), (Err("gone"), "gone")]
        {
            let found = segment(figure).row(row.clone());
            assert_eq!((found.value, found.standard_uncertainty), (None, None));
            assert_eq!(found.reason, reason);
        }
    }

    #[test]
    fn a_span_without_an_end_has_none_where_nothing_was_seen() {
        let settings = Settings { span_s: Some(0.0..f64::INFINITY), ..Settings::default() };
        let manifest = Manifest::begin(String::new(), None, None, None, Zero::Mark);
        let row = Row::of(About::of(Path::new("t"), &manifest), &settings);
        let unseen = Err(NOT_SEEN.to_owned());
        let whole = segments(&MEASURES[0], Direction::Ap, &unseen, &settings).pop().unwrap();
        let found = whole.row(row);
        assert_eq!((found.start_s, found.end_s, &*found.reason), (Some(0.0), None, NOT_SEEN));
        assert!(!String::from_utf8(csv(&[found])).unwrap().contains("inf"));
    }

    #[test]
    fn parquet_has_the_columns_of_csv_and_the_texts_as_given() {
        let manifest = Manifest::begin(String::new(), None, None, None, Zero::Mark);
        let absent = Row {
            participant: "=P1".to_owned(),
            reason: "gone".to_owned(),
            ..Row::of(About::of(Path::new("t"), &manifest), &Settings::default())
        };
        let known = Row { value: Some(-1.5e-7), end_s: Some(60.0), unit: "mm²", ..absent.clone() };
        let rows = [absent, known];
        let text = String::from_utf8(csv(&rows)).unwrap();
        let columns: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("figures.parquet");
        std::fs::write(&path, parquet(&rows)).unwrap();
        let reader = SerializedFileReader::try_from(path.as_path()).unwrap();
        let read = reader.get_row_iter(None).unwrap().map(|row| {
            let row = row.unwrap();
            let names: Vec<&str> = row.get_column_iter().map(|(name, _)| name.as_str()).collect();
            assert_eq!(names, columns);
            let named =
                |name: &str| row.get_column_iter().find(|(it, _)| *it == name).unwrap().1.clone();
            ["participant", "value", "end_s", "unit", "reason"].map(named)
        });
        let text = |text: &str| Field::Str(text.to_owned());
        let expected = [
            [text("=P1"), Field::Null, Field::Null, text(""), text("gone")],
            [text("=P1"), Field::Double(-1.5e-7), Field::Double(60.0), text("mm²"), text("gone")],
        ];
        assert_eq!(read.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn no_text_begins_a_formula_and_no_number_is_a_text() {
        let manifest = Manifest::begin(
            String::new(),
            Some("=1+1".to_owned()),
            Some("a, \"b\"".to_owned()),
            None,
            Zero::Mark,
        );
        let row = Row::of(About::of(Path::new("-t"), &manifest), &Settings::default());
        let row = Row { value: Some(-1.5e-7), start_s: Some(-5.0), ..row };
        let text = String::from_utf8(csv(&[row])).unwrap();
        let (header, row) = text.split_once('\n').unwrap();
        assert!(
            header.starts_with("participant,condition,trial,verdict,trunk,segment,start_s"),
            "{header}"
        );
        assert!(row.starts_with("'=1+1,\"a, \"\"b\"\"\",'-t,good,,,-5.0,,,"), "{row}");
        assert!(row.contains(",-1.5e-7,"), "{row}");
    }
}
