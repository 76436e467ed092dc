//! `poses.csv`: one row per frame and target, with the columns [`COLUMNS`].
//!
//! `time_s` is when the target was exposed. A camera with a rolling shutter sees each target at its
//! own time, later than the frame's; a row without a pose has the frame's.
//!
//! `x_mm, y_mm, z_mm` is the target's origin in the camera frame; the angles are the
//! paper's. Without a pose the numbers are empty and `state` says why. `ap_mm,
//! ml_mm, si_mm` is the trunk point that the target carries (upper or lower), along the
//! anatomical axes; empty without a scene. Numbers are written in full: reading
//! them back gives the same value. No text begins a formula: see [`cell`](crate::text::cell).
//!
//! The reader takes any file that has `frame, time_s, target` and the six columns of
//! a pose, in any order: also the simulator's `truth.csv`.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use nalgebra::Matrix3;
use plumbline::config::Config;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::{NoPose, Report, TargetState};
use plumbline::scene::Anatomical;
use plumbline::target::Role;
use serde::{Deserialize, Serialize};

use crate::{BadInput, room};

/// All columns, in the order of the file: the fields of [`PoseRow`].
pub const COLUMNS: [&str; 18] = [
    "frame",
    "time_s",
    "target",
    "state",
    "theta1_rad",
    "theta2_rad",
    "theta3_rad",
    "x_mm",
    "y_mm",
    "z_mm",
    "sd_x_mm",
    "sd_y_mm",
    "sd_z_mm",
    "rms_px",
    "points",
    "ap_mm",
    "ml_mm",
    "si_mm",
];

/// How many of the columns have numbers that may be absent.
pub const NUMBERS: usize = 14;

/// How many of those are the pose; they come first.
const POSE_NUMBERS: usize = 6;

/// Those that are positions.
const POSITIONS: [&str; 6] = ["x_mm", "y_mm", "z_mm", "ap_mm", "ml_mm", "si_mm"];

/// The columns of [`PoseRow::numbers`].
#[must_use]
pub fn number_columns() -> &'static [&'static str] {
    &COLUMNS[COLUMNS.len() - NUMBERS..]
}

/// What the column `state` says of a target: its state and, without a pose, the reason.
#[must_use]
pub fn state_words(state: TargetState, no_pose: Option<NoPose>) -> String {
    match no_pose {
        None => state.word().to_owned(),
        Some(reason) => format!("{}: {}", state.word(), reason.words()),
    }
}

/// One frame and target.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PoseRow {
    /// Number of the frame in the input, from 0.
    pub frame: u64,
    /// When the target was exposed; without a pose, the frame's time.
    pub time_s: f64,
    /// The target's name.
    #[serde(with = "crate::text::as_cell")]
    pub target: String,
    /// `tracking` and the like; without a pose, the reason.
    #[serde(default, with = "crate::text::as_cell")]
    pub state: String,
    /// Euler angle about z.
    pub theta1_rad: Option<f64>,
    /// Euler angle about y.
    pub theta2_rad: Option<f64>,
    /// Euler angle about x.
    pub theta3_rad: Option<f64>,
    /// Origin, x.
    pub x_mm: Option<f64>,
    /// Origin, y.
    pub y_mm: Option<f64>,
    /// Origin, z: the depth.
    pub z_mm: Option<f64>,
    /// Standard deviation of `x_mm`, from the solution's covariance.
    #[serde(default)]
    pub sd_x_mm: Option<f64>,
    /// Standard deviation of `y_mm`.
    #[serde(default)]
    pub sd_y_mm: Option<f64>,
    /// Standard deviation of `z_mm`.
    #[serde(default)]
    pub sd_z_mm: Option<f64>,
    /// Root mean square reprojection error.
    #[serde(default)]
    pub rms_px: Option<f64>,
    /// Corners used.
    #[serde(default)]
    pub points: Option<u32>,
    /// Trunk point, forward.
    #[serde(default)]
    pub ap_mm: Option<f64>,
    /// Trunk point, to the person's right.
    #[serde(default)]
    pub ml_mm: Option<f64>,
    /// Trunk point, up.
    #[serde(default)]
    pub si_mm: Option<f64>,
}

impl PoseRow {
    /// The numbers, in the order of [`number_columns`].
    #[must_use]
    pub fn numbers(&self) -> [Option<f64>; NUMBERS] {
        [
            self.theta1_rad,
            self.theta2_rad,
            self.theta3_rad,
            self.x_mm,
            self.y_mm,
            self.z_mm,
            self.sd_x_mm,
            self.sd_y_mm,
            self.sd_z_mm,
            self.rms_px,
            self.points.map(f64::from),
            self.ap_mm,
            self.ml_mm,
            self.si_mm,
        ]
    }

    /// A row without a pose.
    #[must_use]
    pub fn without_pose(frame: u64, time_s: f64, target: &str, state: &str) -> Self {
        Self {
            frame,
            time_s,
            target: target.to_owned(),
            state: state.to_owned(),
            ..Self::default()
        }
    }

    /// The same row with this pose.
    #[must_use]
    pub fn with_pose(mut self, cam_from_target: &Pose<Cam, Target>) -> Self {
        let angles = cam_from_target.euler();
        let position_mm = cam_from_target.translation_mm;
        self.theta1_rad = Some(angles.theta1_rad);
        self.theta2_rad = Some(angles.theta2_rad);
        self.theta3_rad = Some(angles.theta3_rad);
        self.x_mm = Some(position_mm.x);
        self.y_mm = Some(position_mm.y);
        self.z_mm = Some(position_mm.z);
        self
    }

    /// The same row with what the solution says about itself: the 3 x 3
    /// covariance of the translation, the reprojection error, the corners used.
    #[must_use]
    pub fn with_quality(mut self, covariance_mm2: &Matrix3<f64>, rms_px: f64, points: u32) -> Self {
        let sd_mm = |axis: usize| Some(covariance_mm2[(axis, axis)].sqrt());
        (self.sd_x_mm, self.sd_y_mm, self.sd_z_mm) = (sd_mm(0), sd_mm(1), sd_mm(2));
        self.rms_px = Some(rms_px);
        self.points = Some(points);
        self
    }

    /// The same row with its trunk point.
    #[must_use]
    pub fn with_trunk(mut self, point: &Anatomical) -> Self {
        self.ap_mm = Some(point.ap_mm);
        self.ml_mm = Some(point.ml_mm);
        self.si_mm = Some(point.si_mm);
        self
    }

    /// The rows of a frame's results, one for each target in the order of the configuration.
    pub fn of_report(
        config: &Config,
        frame: u64,
        report: &Report,
    ) -> impl Iterator<Item = PoseRow> {
        let seconds = |time_ns: u64| time_ns as f64 / 1e9;
        config.targets.iter().zip(&report.targets).map(move |(target, found)| {
            let frame_ns = report.capture_time_ns;
            let state = state_words(found.state, found.measurement.as_ref().err().copied());
            let Ok(measured) = &found.measurement else {
                return Self::without_pose(frame, seconds(frame_ns), &target.name, &state);
            };
            let covariance_mm2 = measured.covariance.fixed_view::<3, 3>(3, 3).into_owned();
            let time_s = seconds(measured.own_time_ns(frame_ns));
            let row = Self::without_pose(frame, time_s, &target.name, &state)
                .with_pose(&measured.cam_from_target)
                .with_quality(&covariance_mm2, measured.rms_px, u32::from(measured.corners));
            let trunk = match found.role {
                Role::Upper => report.upper_trunk,
                Role::Lower => report.lower_trunk,
                Role::Scene => None,
            };
            match trunk {
                Some(point) => row.with_trunk(&point),
                None => row,
            }
        })
    }

    /// The pose, if the row has one.
    #[must_use]
    pub fn cam_from_target(&self) -> Option<Pose<Cam, Target>> {
        let mut theta = [0.0; POSE_NUMBERS];
        for (value, number) in theta.iter_mut().zip(self.numbers()) {
            *value = number?;
        }
        Some(Pose::from_theta(theta))
    }
}

/// Writes rows. What [`Writer::flush`] has passed on survives the end of the program.
pub struct Writer<W: Write> {
    rows: csv::Writer<W>,
    place: String,
}

impl Writer<File> {
    /// A new file, in place of an old one.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn create(path: &Path) -> Result<Self, BadInput> {
        let place = path.display().to_string();
        Ok(Self::new(crate::create(path, true)?, place))
    }
}

impl<W: Write> Writer<W> {
    /// Rows into any sink; `place` names it in errors.
    pub fn new(sink: W, place: impl Into<String>) -> Self {
        Self { rows: csv::Writer::from_writer(sink), place: place.into() }
    }

    /// Appends a row, after the header if it is the first one.
    ///
    /// # Errors
    /// When the sink refuses.
    pub fn write(&mut self, row: &PoseRow) -> Result<(), BadInput> {
        self.rows.serialize(row).map_err(|error| match error.into_kind() {
            csv::ErrorKind::Io(error) => BadInput::io(&self.place, &error),
            other => {
                BadInput::whole(&self.place, format!("{other:?}"), "this row cannot be written")
            }
        })
    }

    /// Passes all rows on to the sink.
    ///
    /// # Errors
    /// When the sink refuses.
    pub fn flush(&mut self) -> Result<(), BadInput> {
        self.rows.flush().map_err(|error| BadInput::io(&self.place, &error))
    }
}

/// All rows of a file.
///
/// # Errors
/// When it cannot be read, a needed column is missing, or a row is not as the
/// header says; the row's line is named.
pub fn read(path: &Path) -> Result<Vec<PoseRow>, BadInput> {
    let place = path.display().to_string();
    let file = File::open(path).map_err(|error| BadInput::io(&place, &error))?;
    parse(std::io::BufReader::new(file), &place)
}

/// All rows of a CSV; `place` names it in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(source: impl Read, place: &str) -> Result<Vec<PoseRow>, BadInput> {
    const REMEDY: &str = "give a file that plumb track or plumb simulate wrote";
    // Lines end with \n for the reader, and are trimmed: it counts \r\n late.
    let mut reader = csv::ReaderBuilder::new()
        .terminator(csv::Terminator::Any(b'\n'))
        .trim(csv::Trim::All)
        .from_reader(source);
    let header =
        reader.headers().map_err(|error| BadInput::new(place, "header", error, REMEDY))?.clone();
    let pose = &number_columns()[..POSE_NUMBERS];
    for column in ["frame", "time_s", "target"].iter().chain(pose) {
        if !header.iter().any(|name| name == *column) {
            return Err(BadInput::new(place, column, "no such column", REMEDY));
        }
    }
    let mut rows = Vec::new();
    let mut record = csv::StringRecord::new();
    loop {
        let line = reader.position().line();
        let at = |found: String| BadInput::new(place, format!("line {line}"), found, REMEDY);
        if !reader.read_record(&mut record).map_err(|error| at(row_error(&error, &header)))? {
            return Ok(rows);
        }
        let row: PoseRow =
            record.deserialize(Some(&header)).map_err(|error| at(row_error(&error, &header)))?;
        let numbers = &row.numbers()[..POSE_NUMBERS];
        let given = numbers.iter().flatten().count();
        if given != 0 && given != numbers.len() {
            return Err(at(format!("{given} of the 6 numbers of a pose")));
        }
        if numbers.iter().flatten().any(|value| !value.is_finite()) {
            return Err(at("a number of the pose is not finite".to_owned()));
        }
        for (column, value) in number_columns().iter().zip(row.numbers()) {
            if let Some(mm) = value.filter(|_| POSITIONS.contains(column)) {
                room::check_mm(place, format_args!("{column} (line {line})"), mm)?;
            }
        }
        rows.push(row);
    }
}

/// What is wrong with a row, without the csv crate's byte positions.
fn row_error(error: &csv::Error, header: &csv::StringRecord) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} columns where the header has {expected_len}")
        }
        csv::ErrorKind::Deserialize { err, .. } => {
            let column = err.field().and_then(|field| header.get(usize::try_from(field).ok()?));
            format!("{}: {}", column.unwrap_or("row"), err.kind())
        }
        other => format!("{other:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(rows: &[PoseRow]) -> String {
        let mut bytes = Vec::new();
        let mut writer = Writer::new(&mut bytes, "poses.csv");
        for row in rows {
            writer.write(row).unwrap();
        }
        writer.flush().unwrap();
        drop(writer);
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn a_position_that_no_room_holds_is_refused_with_its_line() {
        for (old, new, column) in [("12.5", "1e30", "x_mm"), ("1400.0", "-2e5", "si_mm")] {
            let row = PoseRow {
                x_mm: Some(12.5),
                si_mm: Some(1400.0),
                ..PoseRow::without_pose(0, 0.0, "lumbar", "tracking").with_pose(&Pose::identity())
            };
            let text = written(&[row]).replace(old, new);
            let error = parse(text.as_bytes(), "poses.csv").unwrap_err().to_string();
            assert!(error.contains(&format!("{column} (line 2): a position of")), "{error}");
        }
    }

    #[test]
    fn rows_come_back_bit_for_bit() {
        let pose = Pose::from_theta([0.1, -0.2, 1.0 / 3.0, 1e-9, -2.5, 1000.0 / 7.0]);
        let with_pose = PoseRow::without_pose(3, 0.05, "lumbar, back", "tracking")
            .with_pose(&pose)
            .with_quality(&Matrix3::from_diagonal_element(0.01), 0.1, 28)
            .with_trunk(&Anatomical { ap_mm: 1.0, ml_mm: -2.0, si_mm: 0.3 });
        let without = PoseRow::without_pose(3, 0.05, "shoulder", "acquiring: no grid");
        // A spreadsheet would compute it.
        let formula = PoseRow::without_pose(4, -0.05, "=1+1", "-");
        let text = written(&[with_pose.clone(), without.clone(), formula.clone()]);
        assert_eq!(
            text.lines().next().unwrap(),
            "frame,time_s,target,state,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm,sd_x_mm,sd_y_mm,sd_z_mm,rms_px,points,ap_mm,ml_mm,si_mm"
        );
        let end =
            "3,0.05,shoulder,acquiring: no grid,,,,,,,,,,,,,,\n4,-0.05,'=1+1,'-,,,,,,,,,,,,,,\n";
        assert!(text.ends_with(end), "{text}");
        let rows = parse(text.as_bytes(), "poses.csv").unwrap();
        assert_eq!(rows, [with_pose, without, formula]);
        assert_eq!(rows[1].cam_from_target(), None);
        let back = rows[0].cam_from_target().unwrap();
        assert_eq!(back.translation_mm, pose.translation_mm);
    }

    #[test]
    fn columns_and_numbers_are_those_of_the_fields() {
        let row = PoseRow {
            frame: 1,
            time_s: 2.0,
            target: "a".to_owned(),
            state: "tracking".to_owned(),
            theta1_rad: Some(5.0),
            theta2_rad: Some(6.0),
            theta3_rad: Some(7.0),
            x_mm: Some(8.0),
            y_mm: Some(9.0),
            z_mm: Some(10.0),
            sd_x_mm: Some(11.0),
            sd_y_mm: Some(12.0),
            sd_z_mm: Some(13.0),
            rms_px: Some(14.0),
            points: Some(15),
            ap_mm: Some(16.0),
            ml_mm: Some(17.0),
            si_mm: Some(18.0),
        };
        assert_eq!(written(std::slice::from_ref(&row)).lines().next(), Some(&*COLUMNS.join(",")));
        for (at, number) in row.numbers().into_iter().enumerate() {
            assert_eq!(number, Some((5 + at) as f64), "{}", number_columns()[at]);
        }
        assert_eq!(number_columns()[0], "theta1_rad");
    }

    #[test]
    fn a_truth_file_is_read_too() {
        let text = "frame,time_s,target,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm,ap_mm,ml_mm,si_mm\n0,0,a,0,0,0,1,2,3,4,5,6\n";
        let rows = parse(text.as_bytes(), "truth.csv").unwrap();
        assert_eq!((rows[0].z_mm, rows[0].ap_mm, rows[0].points), (Some(3.0), Some(4.0), None));
    }

    #[test]
    fn bad_rows_are_named_by_line() {
        let head = "frame,time_s,target,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm\n";
        let cases = [
            ("0,0,a,0,0,0,1,2\n", "line 2", "8 columns where the header has 9"),
            ("0,0,a,0,0,0,1,2,3\n1,0,a,0,0,0,1,x,3\n", "line 3", "y_mm"),
            ("0,0,a,0,0,0,1,2,\n", "line 2", "5 of the 6 numbers"),
            ("0,0,a,0,0,0,1,2,inf\n", "line 2", "not finite"),
            ("-1,0,a,0,0,0,1,2,3\n", "line 2", "frame"),
        ];
        for (rows, field, found) in cases {
            for end in ["\n", "\r\n"] {
                let text = format!("{head}{rows}").replace('\n', end);
                let error = parse(text.as_bytes(), "p.csv").unwrap_err();
                assert_eq!(error.field, field, "{error}");
                assert!(error.found.contains(found), "{error}");
            }
        }
        let error = parse("frame,time_s\n".as_bytes(), "p.csv").unwrap_err();
        assert_eq!((error.field.as_str(), error.found.as_str()), ("target", "no such column"));
    }
}
