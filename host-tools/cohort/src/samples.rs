//! `points.parquet`: the two trunk points of a trial over time.

use std::path::Path;

use plumbline_analysis::series::{Axis, Series};
use plumbline_files::BadInput;
use plumbline_trial::frame::Trunk;
use plumbline_trial::parquet::{self, Reader, Table, Values};
use plumbline_trial::points::{Point, Points};

use crate::row::Row;

/// Ten hours at 200 Hz.
const ROWS_MAX: u64 = 7_200_000;

/// What the columns are, in the file's metadata.
const AXES: &str = "ap: forward; ml: to the person's right; si: up; millimetres";

const REMEDY: &str = "it is damaged, or was changed by another program: make the cohort again";

/// One trunk point in each row.
#[derive(Default)]
struct Columns {
    time_s: Vec<Option<f64>>,
    position_mm: [Vec<Option<f64>>; 3],
}

impl Columns {
    fn push(&mut self, time_s: Option<f64>, position_mm: Option<[f64; 3]>) {
        self.time_s.push(time_s);
        for (axis, values) in self.position_mm.iter_mut().enumerate() {
            values.push(position_mm.map(|it| it[axis]));
        }
    }
}

/// The names of a trunk's columns: its time, and its positions along AP, ML and SI.
fn names(trunk: Trunk) -> (String, [String; 3]) {
    let of = |what: &str| format!("{}_{what}", trunk.word());
    let axis = |axis: Axis| of(&format!("{}_mm", axis.word().to_lowercase()));
    (of("time_s"), Axis::ALL.map(axis))
}

/// The file: a row for each frame, at the times `frames_s` from t = 0, which increase or stay the
/// same.
///
/// # Errors
/// When the writer fails.
pub fn bytes(trial: &str, points: &Points, frames_s: &[f64]) -> Result<Vec<u8>, BadInput> {
    let mut tracks = Trunk::ALL.map(|trunk| {
        let point = points.points.iter().find(|it| it.name == trunk.word());
        (point, 0_usize, Columns::default())
    });
    let mut time_s = Vec::with_capacity(frames_s.len());
    for frame_s in frames_s {
        time_s.push(*frame_s);
        for (point, next, columns) in &mut tracks {
            let sample = point.filter(|it| it.frame_time_s.get(*next) == Some(frame_s));
            let Some(point) = sample else {
                columns.push(None, None);
                continue;
            };
            let own_s = point.series.time_s()[*next];
            let at = |axis| point.series.along(axis).map_or(f64::NAN, |values| values[*next]);
            // Only a rolling shutter sees a point later than the frame begins.
            columns.push(Some(own_s).filter(|it| it != frame_s), Some(Axis::ALL.map(at)));
            *next += 1;
        }
    }
    let place = &points.place;
    for (point, written, _) in &tracks {
        if point.is_some_and(|it| it.series.samples() != *written) {
            return Err(BadInput::whole(place, "a sample belongs to no frame", "report it"));
        }
    }
    let rows = time_s.len();
    let mut table = vec![
        ("trial".to_owned(), Values::Texts(vec![trial.to_owned(); rows])),
        ("time_s".to_owned(), Values::Numbers(time_s)),
    ];
    for (trunk, (.., columns)) in Trunk::ALL.into_iter().zip(tracks) {
        let (time, positions) = names(trunk);
        table.push((time, Values::SomeNumbers(columns.time_s)));
        table.extend(positions.into_iter().zip(columns.position_mm.map(Values::SomeNumbers)));
    }
    parquet::bytes("points", &table, vec![("axes", AXES.to_owned()), ("trial", trial.to_owned())])
        .map_err(|error| BadInput::whole(place, error, "report it: rows can be written"))
}

/// The points of a trial, read from its file.
///
/// # Errors
/// When it cannot be read, or is of another trial.
pub fn read(path: &Path, row: &Row) -> Result<Points, BadInput> {
    let place = path.display();
    let reader = Reader::open(path, ROWS_MAX)?;
    if reader.about("trial") != Some(&row.trial) {
        let found = "it is of another trial than the table of trials says";
        return Err(BadInput::new(
            place,
            "trial",
            found,
            "try again: it was being changed, or is damaged",
        ));
    }
    of_table(&reader.all()?, &place.to_string(), row)
}

/// The columns of such a file, without rows.
#[must_use]
pub fn columns() -> Vec<(String, Values)> {
    let mut table = vec![
        ("trial".to_owned(), Values::Texts(Vec::new())),
        ("time_s".to_owned(), Values::Numbers(Vec::new())),
    ];
    for trunk in Trunk::ALL {
        let (time, positions) = names(trunk);
        let all = std::iter::once(time).chain(positions);
        table.extend(all.map(|name| (name, Values::SomeNumbers(Vec::new()))));
    }
    table
}

/// The points of a trial from these columns, in the order of time; `place` is where they are from.
///
/// # Errors
/// When a column is absent, or the times do not increase.
pub fn of_table(table: &Table, place: &str, row: &Row) -> Result<Points, BadInput> {
    let frames_s = table.numbers("time_s")?;
    let mut points = Vec::new();
    for trunk in Trunk::ALL {
        let (time, positions) = names(trunk);
        let own_s = table.some_numbers(&time)?;
        let [ap, ml, si] = positions.each_ref().map(|name| table.some_numbers(name));
        let (ap, ml, si) = (ap?, ml?, si?);
        let (mut frame_time_s, mut time_s) = (Vec::new(), Vec::new());
        let mut position_mm: [Vec<f64>; 3] = Default::default();
        for (at, frame_s) in frames_s.iter().enumerate() {
            let (Some(ap), Some(ml), Some(si)) = (ap[at], ml[at], si[at]) else { continue };
            frame_time_s.push(*frame_s);
            time_s.push(own_s[at].unwrap_or(*frame_s));
            for (values, value) in position_mm.iter_mut().zip([ap, ml, si]) {
                values.push(value);
            }
        }
        if time_s.is_empty() {
            continue;
        }
        let series = Series::new(time_s, position_mm)
            .map_err(|error| BadInput::new(place, trunk.word(), error, REMEDY))?;
        points.push(Point { name: trunk.word().to_owned(), series, frame_time_s, noise: None });
    }
    Ok(row.points(points))
}
