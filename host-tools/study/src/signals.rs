//! Reads a physiological signal from its file.

use std::path::Path;

use jiff::Timestamp;
use plumbline_analysis::physiology::signal::{Signal, SignalError};
use plumbline_files::BadInput;
use plumbline_files::columns::{Column, Row, TextTable};
use plumbline_files::counting::counted;

use crate::protocol::{Clock, SignalFile};

/// 1990 and 2100, in seconds since 1970: a value outside this range is not a time of day.
const UTC_S: std::ops::Range<f64> = 631_152_000.0..4_102_444_800.0;

/// A signal on the trial's clock.
#[derive(Debug)]
pub struct Read {
    /// The signal; its times are seconds from t = 0.
    pub signal: Signal,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Reads the signal that `file` describes from `path`; `zero_s` is the time on the file's clock at
/// which the trial's t is 0, seconds.
///
/// Empty cells, NaN, and zeros of quantities that cannot be zero are missing values.
///
/// # Errors
/// When it cannot be read, a column is missing, a cell is not a number, or times do not increase.
/// The error names the line.
pub fn read(path: &Path, file: &SignalFile, zero_s: f64) -> Result<Read, BadInput> {
    let remedy = "name the columns in study.toml as they stand in the file";
    let text = TextTable::open(path, &[&file.time, &file.column], file.delimiter, remedy)?;
    let (time, column) = (text.column(&file.time), text.column(&file.column));
    let (mut times_s, mut values, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    let mut off = 0;
    for row in text.rows() {
        let row = row?;
        let value = column.number(&row)?;
        let is_off = file.kind.is_positive() && value.is_some_and(|it| it <= 0.0);
        off += usize::from(is_off);
        times_s.push(time_s(time, &row, file.clock)? - zero_s - file.delay_s);
        values.push(value.filter(|_| !is_off).map_or(f64::NAN, |it| it * file.scale));
        lines.push(row.line);
    }
    let place = path.display().to_string();
    let signal = Signal::new(times_s, values).map_err(|error| {
        let (at, found) = match error {
            SignalError::TimeNotIncreasing(at) => {
                (lines.get(at), "its time is not later than that of the line before".to_owned())
            }
            SignalError::Time(at) | SignalError::Value(at) => (lines.get(at), error.to_string()),
            SignalError::Lengths(..) => (None, error.to_string()),
        };
        let line = at.map(|line| format!(" (line {line})")).unwrap_or_default();
        BadInput::new(
            &place,
            format!("{}{line}", file.column),
            found,
            "give one recording, in its order",
        )
    })?;
    let mut warnings = Vec::new();
    if off > 0 {
        let samples = counted(off, "sample");
        let column = &file.column;
        warnings.push(format!("{place}: {samples} of {column} at or below 0 count as missing"));
    }
    Ok(Read { signal, warnings })
}

fn time_s(time: Column<'_>, row: &Row, clock: Clock) -> Result<f64, BadInput> {
    match clock {
        Clock::Seconds => time.number(row)?.ok_or_else(|| {
            time.wrong(row, "there is no time", "remove that line: its time is not known")
        }),
        Clock::Utc => {
            let text = time.text(row);
            let of_day = text.parse::<Timestamp>().map(|it| 1e-9 * it.as_nanosecond() as f64);
            let time_s = of_day.ok().or(text.parse().ok()).filter(|it| UTC_S.contains(it));
            time_s.ok_or_else(|| {
                let remedy = "a time of day is in seconds since 1970, or with its zone, as \
                              2026-11-22T10:15:00.250Z; write clock = \"seconds\" for other times";
                time.wrong(row, format!("{text:?} is not a time of day"), remedy)
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Kind;

    fn read_text(text: &str, clock: Clock, zero_s: f64) -> Result<Read, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("finger.csv");
        std::fs::write(&path, text).unwrap();
        let file = SignalFile {
            kind: Kind::Pressure,
            file: "finger.csv".to_owned(),
            time: "t".to_owned(),
            column: "P".to_owned(),
            scale: 7.5,
            clock,
            delay_s: 0.5,
            delimiter: None,
        };
        read(&path, &file, zero_s).map_err(|error| error.to_string())
    }

    #[test]
    fn a_signal_has_the_trials_clock_and_the_kinds_unit() {
        let text = "Device 7\nt;P\n100.5;10\n100.6;\n100.7;0\n100.8;12\n";
        let read = read_text(text, Clock::Seconds, 100.0).unwrap();
        let present: Vec<(f64, f64)> = read.signal.present().collect();
        assert!((present[1].0 - 0.3).abs() < 1e-12 && present[0].0.abs() < 1e-12, "{present:?}");
        assert_eq!(present.iter().map(|it| it.1).collect::<Vec<_>>(), [75.0, 90.0]);
        assert_eq!(read.signal.values().len(), 4);
        assert!(read.warnings[0].contains("1 sample of P at or below 0"), "{:?}", read.warnings);
    }

    #[test]
    fn a_time_of_day_is_a_number_or_a_text() {
        let zero_s = 1_795_342_500.0;
        for text in [
            "t,P\n1795342501.25,1\n1795342501.5,2\n",
            "t,P\n2026-11-22T10:15:01.25Z,1\n2026-11-22T11:15:01.5+01:00,2\n",
        ] {
            let read = read_text(text, Clock::Utc, zero_s).unwrap();
            // The resolution of a double of this size is 0.24 us.
            for (found, expected) in read.signal.time_s().iter().zip([0.75, 1.0]) {
                assert!((found - expected).abs() < 5e-7, "{found}");
            }
        }
    }

    #[test]
    fn what_cannot_be_read_is_named_with_its_line() {
        let cases = [
            ("t,Q\n0,1\n", Clock::Seconds, "P: no such column; it has the columns t, Q"),
            ("t,P\n0,1\n1,high\n", Clock::Seconds, "P (line 3): \"high\" is not a number"),
            ("t,P\n0,1\n,1\n", Clock::Seconds, "t (line 3): there is no time"),
            ("t,P\n0,1\n2,1\n1,1\n", Clock::Seconds, "P (line 4): its time is not later"),
            ("t,P\n0,1\n", Clock::Utc, "t (line 2): \"0\" is not a time of day"),
            ("t,P\nnoon,1\n", Clock::Utc, "t (line 2): \"noon\" is not a time of day"),
        ];
        for (text, clock, part) in cases {
            let error = read_text(text, clock, 0.0).unwrap_err();
            assert!(error.contains("finger.csv") && error.contains(part), "{error}");
        }
    }
}
