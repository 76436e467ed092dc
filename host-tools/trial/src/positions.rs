//! A plain table of positions over time, such as a force plate's export: a text with columns of
//! numbers below a line that names them, after a preamble of any kind.

use std::path::PathBuf;

use plumbline_analysis::series::{Axis, Series};
use plumbline_files::BadInput;
use plumbline_files::columns::{Delimiter, TextTable};
use plumbline_files::counting::counted;
use plumbline_files::room;
use serde::Deserialize;

/// A row of zeros counts as dropped by the measuring system where its distance to the neighbours is
/// this multiple of the usual step: a force plate that measures nothing writes 0.
const DROP_STEPS: f64 = 10.0;

/// The number of lines that a message names.
const LINES_NAMED: usize = 5;

/// A standing person does not move this far; positions that do are in another unit.
const RANGE_MAX_MM: f64 = 2000.0;

/// Nor this little, except within a second.
const RANGE_MIN_MM: f64 = 0.5;

/// Sway is sampled several times a second: times that are further apart are in another unit.
const STEP_MAX_S: f64 = 1.0;

/// The length in which positions are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Millimetres.
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
}

impl Unit {
    /// Its length in millimetres.
    pub(crate) fn mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
        }
    }

    /// Its abbreviation.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
        }
    }

    /// The unit with this abbreviation.
    #[must_use]
    pub fn of_word(word: &str) -> Option<Self> {
        [Self::Mm, Self::Cm, Self::M].into_iter().find(|unit| unit.word() == word)
    }

    /// The unit in a column's name: `COPx[cm]`, `x (mm)`, `ap_mm`.
    fn of_name(name: &str) -> Option<Self> {
        let name = name.trim().to_lowercase();
        [Self::Mm, Self::Cm, Self::M].into_iter().find(|unit| {
            let unit = unit.word();
            [format!("[{unit}]"), format!("({unit})"), format!("_{unit}")]
                .iter()
                .any(|end| name.ends_with(end))
        })
    }
}

/// Which columns are what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Columns {
    /// Time, seconds.
    pub time: String,
    /// AP, ML, SI; `None` for an axis that the table does not have.
    pub axes: [Option<String>; 3],
}

impl Columns {
    /// Parses `time=t,ap=x,ml=y,si=z`.
    ///
    /// # Errors
    /// What to give instead.
    pub fn parse(text: &str) -> Result<Self, String> {
        const REMEDY: &str =
            "give them as time=NAME,ap=NAME,ml=NAME and si=NAME where there is one";
        let mut time = None;
        let mut axes: [Option<String>; 3] = Default::default();
        for part in text.split(',') {
            let (what, name) = part.split_once('=').ok_or_else(|| REMEDY.to_owned())?;
            let place = match what.trim().to_lowercase().as_str() {
                "time" => &mut time,
                "ap" => &mut axes[0],
                "ml" => &mut axes[1],
                "si" => &mut axes[2],
                other => return Err(format!("{other:?} is not a column of a trial: {REMEDY}")),
            };
            let name = name.trim();
            if name.is_empty() || place.replace(name.to_owned()).is_some() {
                return Err(format!("{what} is named twice, or without a name: {REMEDY}"));
            }
        }
        match (time, axes.iter().any(Option::is_some)) {
            (Some(time), true) => Ok(Self { time, axes }),
            _ => Err(REMEDY.to_owned()),
        }
    }

    fn named(&self) -> impl Iterator<Item = &str> {
        [Some(&self.time)]
            .into_iter()
            .chain(self.axes.iter().map(Option::as_ref))
            .flatten()
            .map(String::as_str)
    }
}

/// A table, and how to read it.
#[derive(Debug, Clone)]
pub struct Table {
    /// The file; if its name ends with .gz, it is unpacked.
    pub path: PathBuf,
    /// Its columns.
    pub columns: Columns,
    /// The unit of its positions.
    pub unit: Unit,
    /// What separates its columns; `None` for the one with which the columns are found.
    pub delimiter: Option<Delimiter>,
}

/// What was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// Millimetres along the body's axes.
    pub series: Series,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// One row with a position on every axis that the table has.
struct Row {
    line: usize,
    time_s: f64,
    position_mm: [f64; 3],
}

impl Table {
    /// Reads it. Rows without a position (empty, not a number, dropped by the measuring system)
    /// become gaps, and are warned of with their lines.
    ///
    /// # Errors
    /// When the file cannot be read, columns are missing, a cell is not a number, units contradict
    /// each other, or time does not increase: with the line.
    pub fn read(&self) -> Result<Positions, BadInput> {
        let place = self.path.display().to_string();
        let named: Vec<&str> = self.columns.named().collect();
        let remedy = "name them with --columns as they stand in the file, and what separates \
                      them with --delimiter";
        let text = TextTable::open(&self.path, &named, self.delimiter, remedy)?;
        self.check_units(&place)?;
        let time = text.column(&self.columns.time);
        let axes = self.columns.axes.each_ref().map(|name| Some(text.column(name.as_deref()?)));

        let (mut rows, mut without) = (Vec::new(), Vec::new());
        for row in text.rows() {
            let row = row?;
            let line = row.line;
            let time_s = time.number(&row)?.ok_or_else(|| {
                time.wrong(&row, "there is no time", "remove that line: its time is not known")
            })?;
            let mut position_mm = [0.0; 3];
            let mut is_whole = true;
            for (position_mm, column) in position_mm.iter_mut().zip(axes) {
                let Some(column) = column else { continue };
                match column.number(&row)? {
                    Some(value) => {
                        *position_mm = value * self.unit.mm();
                        let field = format_args!("{} (line {line})", column.name());
                        room::check_mm(&place, field, *position_mm)?;
                    }
                    None => is_whole = false,
                }
            }
            if is_whole {
                rows.push(Row { line, time_s, position_mm });
            } else {
                without.push(line);
            }
        }
        let mut warnings = Vec::new();
        warnings.extend(gap_words("no value", &without));
        warnings.extend(gap_words(
            "all positions exactly 0, as of dropped rows",
            &remove_dropped(&mut rows),
        ));
        if rows.len() < 2 && !warnings.is_empty() {
            let found = format!("fewer than two samples: {}", warnings.join("; "));
            let remedy = "name columns that hold positions";
            return Err(BadInput::whole(place, found, remedy));
        }
        self.series(&place, &rows, warnings)
    }

    fn series(
        &self,
        place: &str,
        rows: &[Row],
        mut warnings: Vec<String>,
    ) -> Result<Positions, BadInput> {
        if let Some(pair) = rows.windows(2).find(|pair| pair[1].time_s <= pair[0].time_s) {
            return Err(BadInput::new(
                place,
                format!("{} (line {})", self.columns.time, pair[1].line),
                // As short as it can be: a damaged time may have hundreds of digits.
                format!("{:?} s comes after {:?} s", pair[1].time_s, pair[0].time_s),
                "time must increase: give a table of one trial, in its order",
            ));
        }
        let time_s = rows.iter().map(|row| row.time_s).collect();
        let along = |axis: usize| match &self.columns.axes[axis] {
            Some(_) => rows.iter().map(|row| row.position_mm[axis]).collect(),
            None => Vec::new(),
        };
        let series = Series::new(time_s, [along(0), along(1), along(2)]).map_err(|error| {
            BadInput::whole(place, error, "give a table with the positions of a trial")
        })?;
        if series.rate_hz() < 1.0 / STEP_MAX_S {
            return Err(BadInput::new(
                place,
                &self.columns.time,
                format!("{:.3} samples in a second: is the time in seconds?", series.rate_hz()),
                "give a column with seconds",
            ));
        }
        for axis in Axis::ALL {
            let Some(values) = series.along(axis) else { continue };
            let (low, high) = values
                .iter()
                .fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(*it), high.max(*it)));
            let range_mm = high - low;
            if !(RANGE_MIN_MM..RANGE_MAX_MM).contains(&range_mm) {
                warnings.push(format!(
                    "{} ranges over {range_mm:.3} mm: check that the positions are in {}",
                    axis.word(),
                    self.unit.word()
                ));
            }
        }
        Ok(Positions { series, warnings })
    }

    /// Checks the unit against those in the columns' names.
    fn check_units(&self, place: &str) -> Result<(), BadInput> {
        for name in self.columns.axes.iter().flatten() {
            if let Some(unit) = Unit::of_name(name).filter(|unit| *unit != self.unit) {
                return Err(BadInput::new(
                    place,
                    name,
                    format!("its name says {}, and --unit says {}", unit.word(), self.unit.word()),
                    format!("give --unit {}", unit.word()),
                ));
            }
        }
        Ok(())
    }
}

/// Removes the rows that the measuring system has dropped, and returns their lines.
fn remove_dropped(rows: &mut Vec<Row>) -> Vec<usize> {
    let is_zero = |row: &Row| row.position_mm == [0.0; 3];
    let distance = |a: &Row, b: &Row| {
        a.position_mm.iter().zip(b.position_mm).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let mut steps: Vec<f64> = rows
        .windows(2)
        .filter(|pair| !pair.iter().any(is_zero))
        .map(|pair| distance(&pair[0], &pair[1]))
        .collect();
    if steps.is_empty() {
        return Vec::new();
    }
    let middle = steps.len() / 2;
    let usual = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut dropped = Vec::new();
    let mut start = 0;
    while start < rows.len() {
        let end = start + rows[start..].iter().take_while(|row| is_zero(row)).count();
        if end > start {
            let before = start.checked_sub(1).map(|at| distance(&rows[at], &rows[start]));
            let after = rows.get(end).map(|row| distance(row, &rows[start]));
            if before.into_iter().chain(after).all(|step| step > DROP_STEPS * usual) {
                dropped.extend(start..end);
            }
        }
        start = end.max(start + 1);
    }
    let lines = dropped.iter().map(|at| rows[*at].line).collect();
    let mut at = 0;
    rows.retain(|_| {
        at += 1;
        dropped.binary_search(&(at - 1)).is_err()
    });
    lines
}

/// The warning about rows that became gaps.
fn gap_words(what: &str, lines: &[usize]) -> Option<String> {
    let (first, _) = lines.split_first()?;
    let mut named: Vec<String> = lines.iter().take(LINES_NAMED).map(usize::to_string).collect();
    if lines.len() > LINES_NAMED {
        named.push("...".to_owned());
    }
    let lines_word = if lines.len() == 1 {
        format!("line {first}")
    } else {
        format!("lines {}", named.join(", "))
    };
    let became = if lines.len() == 1 { "became a gap" } else { "became gaps" };
    Some(format!("{} {became} ({what}): {lines_word}", counted(lines.len(), "row")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, unit: Unit) -> Result<Positions, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plate.csv");
        std::fs::write(&path, text).unwrap();
        let columns = Columns::parse("time=t,ap=x,ml=y").unwrap();
        let table = Table { path, columns, unit, delimiter: None };
        table.read().map_err(|error| error.to_string())
    }

    #[test]
    fn a_table_is_read_behind_its_preamble_in_its_unit() {
        let text = "Plate, 5\r\n\r\nframe, t, x, y\r\n1, 0.00, 1.0, 2.0\r\n2, 0.01, 1.1, 2.2\r\n";
        let found = read(text, Unit::Cm).unwrap();
        assert_eq!(found.series.time_s(), [0.0, 0.01]);
        assert_eq!(found.series.along(Axis::Ap).unwrap(), [10.0, 11.0]);
        assert_eq!(found.series.along(Axis::Si), None);
        assert_eq!(found.warnings, [""; 0]);
    }

    #[test]
    fn what_is_missing_becomes_a_gap_with_its_lines() {
        let rows: String = (0..100)
            .map(|at| match at {
                10 => "0.10,,2.0\n".to_owned(),
                20 => "0.20,NaN,2.0\n".to_owned(),
                30..33 => format!("0.{at},0,0\n"),
                _ => format!("0.{at:02},{},{}\n", 100.0 + 0.1 * f64::from(at), 50.0),
            })
            .collect();
        let found = read(&format!("t,x,y\n{rows}"), Unit::Mm).unwrap();
        assert_eq!(found.series.samples(), 95);
        assert_eq!(found.series.gaps_s().count(), 3);
        let text = found.warnings.join("; ");
        assert!(text.contains("2 rows became gaps (no value): lines 12, 22"), "{text}");
        assert!(text.contains("3 rows became gaps (all positions exactly 0"), "{text}");
        assert!(text.contains("lines 32, 33, 34"), "{text}");
    }

    #[test]
    fn one_row_is_one_gap() {
        let found = read("t,x,y\n0,1,2\n0.1,NaN,2\n0.2,2,3\n0.3,1,1\n", Unit::Mm).unwrap();
        assert_eq!(found.warnings[0], "1 row became a gap (no value): line 3");
    }

    #[test]
    fn a_walk_from_zero_begins_there() {
        let text = "t,x,y\n0,0,0\n0.1,1,3\n0.2,3,2\n0.3,0,0\n0.4,2,1\n0.5,1,2\n";
        let found = read(text, Unit::Mm).unwrap();
        assert_eq!((found.series.samples(), found.warnings.len()), (6, 0));
    }

    #[test]
    fn what_cannot_be_used_is_named_with_its_line() {
        let cases = [
            ("t,x,z\n0,1,2\n", "y: no such column; it has the columns t, x, z"),
            ("", "it has no columns"),
            ("t,x,y\n0,1,2\n0.1,one,2\n", "x (line 3): \"one\" is not a number"),
            ("t,x,y\n0,1,2\n0.1,1,-1e30\n", "y (line 3): a position of -1e30 mm"),
            ("t,x,y\n0,1,2\n,1,2\n", "t (line 3): there is no time"),
            ("t,x,y\n0,1,2\n0.2,1,2\n0.1,1,2\n", "t (line 4): 0.1 s comes after 0.2 s"),
            ("t,x,y\n0,1,2\n", "fewer than two samples"),
            (
                "t,x,y\n0,,2\n0.1,,2\n0.2,,3\n",
                "fewer than two samples: 3 rows became gaps (no value): lines 2, 3, 4",
            ),
            ("t,x,y\n0,1,2\n1e160,1,2\n0.2,1,2\n", "t (line 4): 0.2 s comes after 1e160 s"),
            ("t,x,y\n0,1,2\n17,1,3\n33,2,2\n", "is the time in seconds?"),
            (
                "t;x;y\n0;1,5;2\n",
                "x (line 2): \"1,5\" is not a number; write the table with decimal",
            ),
        ];
        for (text, part) in cases {
            let error = read(text, Unit::Mm).unwrap_err();
            assert!(error.contains("plate.csv") && error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_unit_that_cannot_be_right_is_refused_or_doubted() {
        let columns = Columns::parse("time=Time[s],ap=COPx[cm],ml=COPy[cm]").unwrap();
        let table = Table { path: "x".into(), columns, unit: Unit::M, delimiter: None };
        let error = table.check_units("x").unwrap_err().to_string();
        assert!(error.contains("COPx[cm]") && error.contains("--unit cm"), "{error}");
        let found = read("t,x,y\n0,1,2\n0.1,9,3\n", Unit::M).unwrap();
        assert!(found.warnings[0].contains("AP ranges over 8000.000 mm"), "{:?}", found.warnings);
        assert!(Columns::parse("time=t").is_err() && Columns::parse("ap=x,ml=y").is_err());
        assert!(Columns::parse("time=t,ap=x,ap=y").is_err() && Columns::parse("up=x").is_err());
    }
}
