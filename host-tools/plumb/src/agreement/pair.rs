//! A trial and its reference, on one clock.

use std::path::{Path, PathBuf};

use clap::Args;
use plumbline_analysis::agreement::axes::Axes;
use plumbline_analysis::agreement::lag::lag;
use plumbline_analysis::agreement::pairs::{PairError, Paired};
use plumbline_analysis::series::{Axis, Series};
use plumbline_files::BadInput;
use plumbline_files::columns::Delimiter;
use plumbline_files::{directory_of, from_toml, read_text};
use plumbline_report::agreement::{Align, Used};
use plumbline_trial::frame::Trunk;
use plumbline_trial::markers::Markers;
use plumbline_trial::points::Points;
use plumbline_trial::positions::Unit;
use serde::Deserialize;

use crate::arguments::table::TableColumns;

/// A right-handed frame that looks forward along X, with Z up.
const AXES: &str = "ap=X,ml=-Y,si=Z";

const LAG_MAX_S: f64 = 10.0;

/// With less, what is compared is hardly the same movement.
const CORRELATION_MIN: f64 = 0.9;

/// How trial and reference belong together. What a pair of a manifest leaves out is as on the
/// command line.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct How {
    /// Which trunk is compared [default: lower]
    #[arg(long)]
    point: Option<Trunk>,

    /// The reference's marker; of several the mean is taken [default: the only one]
    #[arg(long = "marker", value_name = "NAME")]
    markers: Vec<String>,

    /// The reference's axes, by those of the body [default: ap=X,ml=-Y,si=Z]
    #[arg(long, value_name = "ap=X,ml=-Y,si=Z", conflicts_with = "columns")]
    axes: Option<String>,

    /// What the columns of a reference that is a table are.
    #[command(flatten)]
    pub table: TableColumns,

    /// How the clocks are brought together [default: lag; with --event: events]
    #[arg(long)]
    align: Option<Align>,

    /// The reference's time of the trial's t = 0
    #[arg(long, value_name = "SECONDS")]
    event: Option<f64>,

    /// The largest lag that is searched, for --align lag [default: 10]
    #[arg(long, value_name = "SECONDS")]
    lag_max: Option<f64>,
}

impl How {
    /// The first option that is given but those that a table of any kind has.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let Self { point, markers, axes, table: _, align, event, lag_max } = self;
        let options = [
            ("--point", point.is_some()),
            ("--marker", !markers.is_empty()),
            ("--axes", axes.is_some()),
            ("--align", align.is_some()),
            ("--event", event.is_some()),
            ("--lag-max", lag_max.is_some()),
        ];
        options.into_iter().find_map(|(option, is_given)| is_given.then_some(option))
    }

    /// An event that is given is there to align by; what only another alignment takes is refused.
    fn alignment(&self, place: &Path) -> Result<Align, BadInput> {
        let implied = if self.event.is_some() { Align::Events } else { Align::Lag };
        let align = self.align.unwrap_or(implied);
        let (option, found, remedy) = if self.event.is_some() && align != Align::Events {
            ("--event", "only --align events takes one", "leave it out, or give --align events")
        } else if self.lag_max.is_some() && align != Align::Lag {
            ("--lag-max", "no lag is searched", "leave it out, or align by lag and without --event")
        } else {
            return Ok(align);
        };
        Err(BadInput::new(place.display(), option, found, remedy))
    }

    /// Refuses what a reference of markers, or one that is a table, has not.
    fn suits(&self, reference: &Path, is_table: bool) -> Result<(), BadInput> {
        let (options, found) = if is_table {
            let options = [("--marker", !self.markers.is_empty()), ("--axes", self.axes.is_some())];
            (options, "a table has columns, and neither markers nor axes to choose")
        } else {
            let TableColumns { columns, unit: _, delimiter } = &self.table;
            let options = [("--columns", columns.is_some()), ("--delimiter", delimiter.is_some())];
            (options, "a TRC or C3D file has markers, and no columns to choose")
        };
        match options.into_iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((option, _)) => {
                let remedy = "leave it out; of several pairs, give it in those that it is for";
                Err(BadInput::new(reference.display(), option, found, remedy))
            }
        }
    }
}

/// A trial and its reference.
#[derive(Debug, Clone)]
pub struct Pair {
    /// The trial's folder.
    pub trial: PathBuf,
    /// The reference's file.
    pub reference: PathBuf,
    /// How they belong together.
    pub how: How,
}

/// A manifest's text.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    pair: Vec<Entry>,
}

/// One of its pairs, with the fields of [`How`]: serde cannot refuse unknown fields beside a part
/// that is flattened.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    trial: PathBuf,
    reference: PathBuf,
    point: Option<Trunk>,
    #[serde(default)]
    markers: Vec<String>,
    axes: Option<String>,
    unit: Option<Unit>,
    columns: Option<String>,
    delimiter: Option<Delimiter>,
    align: Option<Align>,
    event: Option<f64>,
    lag_max: Option<f64>,
}

impl Pair {
    /// The pairs of a manifest.
    ///
    /// # Errors
    /// When it cannot be read, or lists none.
    pub fn of_manifest(path: &Path, otherwise: &How) -> Result<Vec<Self>, BadInput> {
        let place = path.display().to_string();
        let remedy = "`plumb validate --help` says what a manifest has";
        let manifest: Manifest = from_toml(&read_text(path)?, &place, remedy)?;
        if manifest.pair.is_empty() {
            return Err(BadInput::whole(place, "it lists no pair", remedy));
        }
        let directory = directory_of(path);
        let pair = |entry: Entry| {
            let or = otherwise.clone();
            let markers = if entry.markers.is_empty() { or.markers } else { entry.markers };
            Self {
                trial: directory.join(entry.trial),
                reference: directory.join(entry.reference),
                how: How {
                    point: entry.point.or(or.point),
                    markers,
                    axes: entry.axes.or(or.axes),
                    table: TableColumns {
                        columns: entry.columns.or(or.table.columns),
                        unit: entry.unit.or(or.table.unit),
                        delimiter: entry.delimiter.or(or.table.delimiter),
                    },
                    align: entry.align.or(or.align),
                    event: entry.event.or(or.event),
                    lag_max: entry.lag_max.or(or.lag_max),
                },
            }
        };
        Ok(manifest.pair.into_iter().map(pair).collect())
    }

    /// Reads the trial.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn points(&self, warnings: &mut Vec<String>) -> Result<Points, BadInput> {
        let points = Points::of_trial(&self.trial, None)?;
        let place = &points.place;
        warnings.extend(points.warnings.iter().map(|warning| format!("{place}: {warning}")));
        Ok(points)
    }

    /// Reads the reference, and brings the trial's points and it together.
    ///
    /// # Errors
    /// When it cannot be read, or they have nothing in common.
    pub fn compare(
        &self,
        points: &Points,
        align_origins: bool,
        warnings: &mut Vec<String>,
    ) -> Result<(Used, Paired), BadInput> {
        let align = self.how.alignment(&self.trial)?;
        let place = &points.place;
        let trunk = self.how.point.unwrap_or(Trunk::Lower);
        let point = points.points.iter().find(|point| point.name == trunk.word());
        let measured = point.map(|point| &point.series).ok_or_else(|| {
            let found = format!("no frame has the {} trunk", trunk.word());
            BadInput::whole(place, found, "compare the other one with --point")
        })?;
        let reference = self.reference(warnings)?;
        let (lag_s, correlation) = self.lag(align, measured, &reference, warnings)?;
        let paired = Paired::new(measured, &reference, lag_s, align_origins)
            .map_err(|error| self.unpaired(error))?;
        let time_s = paired.time_s();
        let used = Used {
            trial: place.clone(),
            reference: self.reference.display().to_string(),
            point: trunk,
            align,
            lag_s,
            correlation,
            samples: time_s.len(),
            length_s: time_s.last().zip(time_s.first()).map_or(0.0, |(last, first)| last - first),
            offset_mm: Axis::ALL.map(|axis| Some(paired.along(axis)?.offset_mm)),
        };
        Ok((used, paired))
    }

    fn reference(&self, warnings: &mut Vec<String>) -> Result<Series, BadInput> {
        let (how, path) = (&self.how, &self.reference);
        let wrong = |option: &str, found: String| {
            BadInput::new(path.display(), option, found, "see --help")
        };
        if Markers::is_one(path) {
            how.suits(path, false)?;
            let axes = how.axes.as_deref().unwrap_or(AXES);
            let axes = Axes::parse(axes).map_err(|found| wrong("axes", found))?;
            return Markers::read(path)?.series(&how.markers, how.table.unit, &axes);
        }
        let Some(table) = how.table.of(path)? else {
            let found = "it is neither TRC nor C3D by its name, and a table needs more".to_owned();
            let remedy = "give its columns with --columns, and their --unit";
            return Err(BadInput::whole(path.display(), found, remedy));
        };
        how.suits(path, true)?;
        let positions = table.read()?;
        let place = path.display();
        warnings.extend(positions.warnings.iter().map(|warning| format!("{place}: {warning}")));
        Ok(positions.series)
    }

    fn lag(
        &self,
        align: Align,
        measured: &Series,
        reference: &Series,
        warnings: &mut Vec<String>,
    ) -> Result<(f64, Option<f64>), BadInput> {
        let place = self.trial.display();
        let finite = |given: Option<f64>, option: &str| match given {
            Some(value) if !value.is_finite() => {
                Err(BadInput::new(&place, option, format!("{value} is not a time"), "give seconds"))
            }
            given => Ok(given),
        };
        match align {
            Align::None => Ok((0.0, None)),
            Align::Events => match finite(self.how.event, "--event")? {
                Some(event_s) => Ok((-event_s, None)),
                None => Err(BadInput::new(
                    &place,
                    "--event",
                    "the reference's time of the trial's t = 0 is not given",
                    "give it with --event SECONDS, or --align lag",
                )),
            },
            Align::Lag => {
                let lag_max_s = finite(self.how.lag_max, "--lag-max")?.unwrap_or(LAG_MAX_S);
                let found = lag(measured, reference, lag_max_s.abs())
                    .map_err(|error| self.unpaired(error))?;
                if found.is_at_bound {
                    warnings.push(format!(
                        "{place}: the correlation is largest at the end of the search, {:.3} s: \
                         search farther with --lag-max",
                        found.lag_s
                    ));
                }
                if found.correlation < CORRELATION_MIN {
                    warnings.push(format!(
                        "{place}: the correlation with the reference is only {:.2}: check trial, \
                         --marker and --axes",
                        found.correlation
                    ));
                }
                Ok((found.lag_s, Some(found.correlation)))
            }
        }
    }

    fn unpaired(&self, error: PairError) -> BadInput {
        let remedy = match error {
            PairError::NoAxis => "name the axes that both have with --axes or --columns",
            PairError::TooLarge(_) => "check the file and its unit",
            PairError::Constant(_) => "check --marker, or give --align events or --align none",
            PairError::Overlap { .. } => {
                "check that both are of the same trial; --lag-max searches farther, and --align \
                 events takes an event that both have"
            }
        };
        let both = format!("{} and {}", self.trial.display(), self.reference.display());
        BadInput::whole(both, error, remedy)
    }
}
