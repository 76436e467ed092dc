//! What is analysed: points of the body over time, from a trial or a table.

use std::ops::Range;
use std::path::Path;

use nalgebra::Matrix3;
use plumbline_analysis::onset::stand_onset_s;
use plumbline_analysis::series::Series;
use plumbline_analysis::sway::noise::Noise;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;

use crate::frame::{Frame, Point as TrunkPoint, Trunk};
use crate::manifest::Zero;
use crate::positions::Table;
use crate::{Trial, Verdict, manifest::EventSeen};

/// One point over time, its t = 0 where the trial's is.
#[derive(Debug, Clone)]
pub struct Point {
    /// `lower`, `upper`, or `point` of a table.
    pub name: String,
    /// Its positions, each at its own time.
    pub series: Series,
    /// The time of each sample's frame, which all points in it have in common; with a rolling
    /// shutter the samples themselves are later.
    pub frame_time_s: Vec<f64>,
    /// Their noise, where it is known.
    pub noise: Option<Noise>,
}

/// A point by its name, for people.
#[must_use]
pub fn point_name(point: &str) -> &'static str {
    match point {
        "upper" => "Upper trunk",
        "lower" => "Lower trunk",
        _ => "Positions",
    }
}

/// The points of one trial.
#[derive(Debug, Clone)]
pub struct Points {
    /// The trial or the table, for messages.
    pub place: String,
    /// The points.
    pub points: Vec<Point>,
    /// What t = 0 is, in words.
    pub zero: String,
    /// The same on the trial's clock, seconds since the first frame; 0 for a table.
    pub zero_s: f64,
    /// Whether a mark or the stand onset has set t = 0, which is the first frame otherwise.
    pub is_zero_set: bool,
    /// The time of day of t = 0, seconds since 1970 by the clock of the computer that recorded
    /// the trial; a table has none.
    pub zero_utc_s: Option<f64>,
    /// The verdict on the trial; a table has none.
    pub verdict: Option<Verdict>,
    /// The trial's events; t = 0 is the same.
    pub events: Vec<EventSeen>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

impl Points {
    /// The point of a table.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of_table(table: &Table) -> Result<Self, BadInput> {
        let positions = table.read()?;
        let point = Point {
            name: "point".to_owned(),
            frame_time_s: positions.series.time_s().to_vec(),
            series: positions.series,
            noise: None,
        };
        Ok(Self {
            place: table.path.display().to_string(),
            points: vec![point],
            zero: "as in the table".to_owned(),
            zero_s: 0.0,
            is_zero_set: false,
            zero_utc_s: None,
            verdict: None,
            events: Vec::new(),
            warnings: positions.warnings,
        })
    }

    /// The points of a recorded trial; `zero` or, without it, the manifest says what t = 0 is.
    ///
    /// # Errors
    /// When it cannot be read, or has no trunk points.
    pub fn of_trial(folder: &Path, zero: Option<Zero>) -> Result<Self, BadInput> {
        let trial = Trial::open(folder)?;
        let zero = zero.unwrap_or(trial.manifest.zero);
        Self::of(&trial, zero)
    }

    /// The points of a trial that has been read.
    ///
    /// # Errors
    /// When it has no trunk points, or its t = 0 cannot be found.
    pub fn of(trial: &Trial, zero: Zero) -> Result<Self, BadInput> {
        let place = trial.folder.display().to_string();
        let mut warnings = trial.warnings.clone();
        let mut points = Vec::new();
        for trunk in Trunk::ALL {
            match point(&trial.frames, trunk) {
                Some((point, doubts)) => {
                    let doubts = doubts.into_iter();
                    warnings.extend(doubts.map(|doubt| format!("{} trunk: {doubt}", trunk.word())));
                    points.push(point);
                }
                None => warnings.push(format!(
                    "{} trunk: fewer than two frames have its position",
                    trunk.word()
                )),
            }
        }
        if points.is_empty() {
            let (found, remedy) = if trial.sees_a_target() {
                (
                    "no frame has a position along the body's axes",
                    "the box did not know which way is forward: measure it while the camera stands \
                     where it stood, `plumb scene --out scene.toml`, then `plumb replay TRIAL \
                     --tables --scene scene.toml`",
                )
            } else {
                (
                    "neither trunk's target was seen in any frame",
                    "find out why with `plumb doctor`, and record again",
                )
            };
            return Err(BadInput::whole(place, found, remedy));
        }
        let (zero_s, zero, is_zero_set) = zero_of(trial, &points, zero, &place)?;
        let mut shifted = Vec::new();
        for point in points {
            let since_zero =
                |time_s: &[f64]| time_s.iter().map(|time_s| time_s - zero_s).collect::<Vec<_>>();
            let own_s = since_zero(point.series.time_s());
            let series = point.series.at_times(own_s);
            shifted.push(Point {
                series: series.map_err(|error| BadInput::whole(&place, error, "report it"))?,
                frame_time_s: since_zero(&point.frame_time_s),
                ..point
            });
        }
        let mut events = trial.manifest.events.clone();
        events.iter_mut().for_each(|event| event.time_s -= zero_s);
        let zero_utc_s = trial.first_frame_utc_s.map(|first_s| first_s + zero_s);
        let verdict = trial.manifest.verdict.clone();
        Ok(Self {
            place,
            points: shifted,
            zero,
            zero_s,
            is_zero_set,
            zero_utc_s,
            verdict,
            events,
            warnings,
        })
    }

    /// The time that figures are of unless another is asked for, seconds: from t = 0 on where it
    /// was set, since what comes before is preparation; otherwise all (`None`). An infinite end is
    /// that of the recording.
    #[must_use]
    pub fn usual_span_s(&self) -> Option<Range<f64>> {
        self.is_zero_set.then_some(0.0..f64::INFINITY)
    }
}

/// t = 0 on the trial's clock, in words, and whether anything set it.
fn zero_of(
    trial: &Trial,
    points: &[Point],
    zero: Zero,
    place: &str,
) -> Result<(f64, String, bool), BadInput> {
    match zero {
        Zero::Start => Ok((0.0, "the first frame".to_owned(), false)),
        Zero::Mark => Ok(match trial.manifest.zero_mark() {
            Some(event) => (event.time_s, format!("the mark \"{}\"", event.label), true),
            None => (0.0, "the first frame: there is no mark".to_owned(), false),
        }),
        Zero::Onset => {
            let onset = points.iter().rev().find_map(|point| stand_onset_s(&point.series));
            onset
                .map(|onset_s| (onset_s, "stand onset, by the trunk's height".to_owned(), true))
                .ok_or_else(|| {
                    BadInput::whole(
                        place,
                        "nobody rises in this trial",
                        "give --zero mark or --zero start",
                    )
                })
        }
    }
}

/// When the person stands up, on the trial's clock: [`Zero::Onset`].
pub(crate) fn stand_onset_of(trial: &Trial) -> Option<f64> {
    let series = Trunk::ALL.into_iter().rev().filter_map(|trunk| point(&trial.frames, trunk));
    series.into_iter().find_map(|(point, _)| stand_onset_s(&point.series))
}

/// The frames that have a trunk's position, each measured later than the one before: those of the
/// samples of its [`Point`].
pub fn frames_of(frames: &[Frame], trunk: Trunk) -> impl Iterator<Item = (&Frame, &TrunkPoint)> {
    let mut last_s = f64::NEG_INFINITY;
    with_point(frames, trunk).filter(move |(_, point)| {
        let is_later = point.time_s > last_s;
        last_s = last_s.max(point.time_s);
        is_later
    })
}

fn with_point(frames: &[Frame], trunk: Trunk) -> impl Iterator<Item = (&Frame, &TrunkPoint)> {
    frames.iter().filter_map(move |frame| Some((frame, frame.point(trunk)?)))
}

/// A trunk's positions, and warnings about them.
fn point(frames: &[Frame], trunk: Trunk) -> Option<(Point, Vec<String>)> {
    let [mut time_s, mut frame_time_s] = [const { Vec::<f64>::new() }; 2];
    let mut position_mm: [Vec<f64>; 3] = Default::default();
    let mut covariances: Vec<Option<Matrix3<f64>>> = Vec::new();
    for (frame, point) in frames_of(frames, trunk) {
        time_s.push(point.time_s);
        frame_time_s.push(frame.time_s);
        for (values, position) in position_mm.iter_mut().zip(point.position_mm) {
            values.push(position);
        }
        covariances.push(point.covariance_mm2);
    }
    let repeated = with_point(frames, trunk).count() - time_s.len();
    let series = Series::new(time_s, position_mm).ok()?;
    let mut doubts = Vec::new();
    if repeated > 0 {
        let frames = counted(repeated, "frame");
        doubts.push(format!("{frames} at a time that an earlier one has are left out"));
    }
    let covariances: Option<Vec<Matrix3<f64>>> = covariances.into_iter().collect();
    // Without a configuration it is not known; reading the trial has already warned of that.
    let noise = covariances.map(|all| Noise::per_sample(&series, &all)).transpose();
    let noise = noise.unwrap_or_else(|error| {
        doubts.push(format!("its uncertainty is not known: {error}"));
        None
    });
    Some((Point { name: trunk.word().to_owned(), series, frame_time_s, noise }, doubts))
}
