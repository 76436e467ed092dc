//! Track row column: see [`crate::export`] for its lines.
//!
//! Times are computed from the rate, because programs round those in the rows to milliseconds;
//! only that of the first row is used, as the beginning of the recording.

use std::path::Path;

use plumbline_files::BadInput;
use plumbline_files::text_of;

use super::{Marker, Markers, Unit, VALUES_MAX, unit_of};

/// Columns before those of the first marker: frame and time.
const BEFORE: usize = 2;

const REMEDY: &str = "give a TRC file as motion capture programs and OpenSim write it";

pub fn read(path: &Path) -> Result<Markers, BadInput> {
    parse(&text_of(path)?, &path.display().to_string())
}

fn parse(text: &str, place: &str) -> Result<Markers, BadInput> {
    let mut lines = text.lines().zip(1..);
    let header = Header::read(&mut lines, place)?;
    let mut first = None;
    let mut positions = vec![Vec::new(); header.names.len()];
    for (text, line) in lines {
        if text.trim().is_empty() {
            continue;
        }
        let row = Row { place, line, cells: cells(text) };
        let (frame, time_s) = (row.frame()?, row.time_s()?);
        let first = *first.get_or_insert((frame, time_s));
        let index = header.index(&row, (frame, time_s), first, positions[0].len())?;
        row.check_length(header.names.len())?;
        for (marker, (positions, name)) in positions.iter_mut().zip(&header.names).enumerate() {
            // In frames that the file leaves out the marker was not seen.
            positions.resize(index, None);
            positions.push(row.position(marker, name)?);
        }
    }
    let Some((_, first_s)) = first else {
        return Err(BadInput::whole(place, "it has no frame", REMEDY));
    };
    let rows = positions[0].len();
    if let Some(frames) = header.frames.filter(|frames| *frames != rows) {
        return Err(BadInput::whole(
            place,
            format!("it has {rows} frames, and NumFrames is {frames}"),
            "the file is cut off or changed: write it again",
        ));
    }
    let markers = header.names.into_iter().zip(positions);
    Ok(Markers {
        place: place.to_owned(),
        rate_hz: header.rate_hz,
        first_s,
        unit: header.unit,
        markers: markers.map(|(name, position)| Marker { name, position }).collect(),
    })
}

fn cells(line: &str) -> Vec<&str> {
    line.split('\t').map(str::trim).collect()
}

/// What the first five lines say.
struct Header {
    rate_hz: f64,
    /// The number of frames, if it is given.
    frames: Option<usize>,
    unit: Option<Unit>,
    /// The markers' names; at least one.
    names: Vec<String>,
}

impl Header {
    fn read<'a>(
        lines: &mut impl Iterator<Item = (&'a str, usize)>,
        place: &str,
    ) -> Result<Self, BadInput> {
        let mut next = |what: &str| {
            let line = lines.next().map(|(text, _)| text);
            line.ok_or_else(|| BadInput::whole(place, format!("it ends before {what}"), REMEDY))
        };
        let wrong = |field: &str, found: &str| Err(BadInput::new(place, field, found, REMEDY));
        if !next("its header")?.trim_start_matches('\u{feff}').starts_with("PathFileType") {
            return wrong("line 1", "it does not begin with PathFileType");
        }
        let keys = cells(next("its header")?);
        let values = cells(next("its header")?);
        let value = |key: &str| {
            let at = keys.iter().position(|it| it.eq_ignore_ascii_case(key))?;
            values.get(at).copied().filter(|it| !it.is_empty())
        };
        let count = |key: &str| value(key).and_then(|it| it.parse::<usize>().ok());
        let names = cells(next("the markers' names")?);
        next("the markers' axes")?;

        let rate_hz = value("DataRate").and_then(|it| it.parse::<f64>().ok());
        let Some(rate_hz) = rate_hz.filter(|it| it.is_finite() && *it > 0.0) else {
            return wrong("DataRate (line 3)", "it is not a rate in Hz");
        };
        let names = names.into_iter().skip(BEFORE).step_by(3).take_while(|name| !name.is_empty());
        let names: Vec<String> = names.map(str::to_owned).collect();
        if names.is_empty() {
            return wrong("line 4", "it names no marker");
        }
        if let Some(said) = count("NumMarkers").filter(|said| *said != names.len()) {
            let found = format!("{} markers are named, and NumMarkers is {said}", names.len());
            return Err(BadInput::new(place, "line 4", found, "correct the file's header"));
        }
        let unit = value("Units").and_then(unit_of);
        Ok(Self { rate_hz, frames: count("NumFrames"), unit, names })
    }

    /// The index of a row's frame, from 0: its number and its time must both be those of a frame
    /// after the rows before it. `first` has the number and the time of the first frame, and
    /// `rows` is the number of frames before this one.
    fn index(
        &self,
        row: &Row<'_>,
        (frame, time_s): (u64, f64),
        (first_frame, first_s): (u64, f64),
        rows: usize,
    ) -> Result<usize, BadInput> {
        let index = frame.checked_sub(first_frame).and_then(|it| usize::try_from(it).ok());
        let Some(index) = index.filter(|index| *index >= rows) else {
            return Err(row.wrong("Frame#", format!("{frame} comes after a later frame")));
        };
        if index.saturating_mul(3 * self.names.len()) > VALUES_MAX {
            return Err(row.wrong("Frame#", format!("{frame}: no recording is so long")));
        }
        // Checked before memory is reserved for all the frames that the file leaves out.
        if let Some(said) = self.frames.filter(|said| index >= *said) {
            return Err(row.wrong("Frame#", format!("{frame} is beyond NumFrames, {said}")));
        }
        // Times may be rounded to milliseconds.
        let Self { rate_hz, .. } = self;
        let due_s = first_s + index as f64 / rate_hz;
        if (time_s - due_s).abs() > 0.5 / rate_hz + 1e-3 {
            let found =
                format!("{time_s} s, where {rate_hz} Hz and the frame's number give {due_s:.3} s");
            return Err(row.wrong("Time", found));
        }
        Ok(index)
    }
}

/// One line under the header.
struct Row<'a> {
    place: &'a str,
    /// Its number in the file, from 1.
    line: usize,
    cells: Vec<&'a str>,
}

impl Row<'_> {
    /// The text in a column; empty where the line is too short.
    fn cell(&self, column: usize) -> &str {
        self.cells.get(column).copied().unwrap_or_default()
    }

    fn wrong(&self, field: &str, found: String) -> BadInput {
        let remedy = "correct or remove that line; a missing value is an empty cell or NaN";
        BadInput::new(self.place, format!("{field} (line {})", self.line), found, remedy)
    }

    fn frame(&self) -> Result<u64, BadInput> {
        let cell = self.cell(0);
        cell.parse().map_err(|_| self.wrong("Frame#", format!("{cell:?} is not a frame's number")))
    }

    fn time_s(&self) -> Result<f64, BadInput> {
        let cell = self.cell(1);
        let time_s = cell.parse::<f64>().ok().filter(|it| it.is_finite());
        time_s.ok_or_else(|| self.wrong("Time", format!("{cell:?} is not a time")))
    }

    /// Refuses numbers after those of the last marker.
    fn check_length(&self, markers: usize) -> Result<(), BadInput> {
        if self.cells.iter().skip(BEFORE + 3 * markers).all(|it| it.is_empty()) {
            return Ok(());
        }
        Err(self.wrong("line", format!("{} cells, more than markers have", self.cells.len())))
    }

    /// Where a marker was; `None` where it was not seen.
    fn position(&self, marker: usize, name: &str) -> Result<Option<[f64; 3]>, BadInput> {
        let mut position = [f64::NAN; 3];
        for (axis, value) in position.iter_mut().enumerate() {
            let cell = self.cell(BEFORE + 3 * marker + axis);
            if !cell.is_empty() {
                let wrong = |_| self.wrong(name, format!("{cell:?} is not a number"));
                *value = cell.parse().map_err(wrong)?;
            }
        }
        Ok(Some(position).filter(|it| it.iter().all(|it| it.is_finite())))
    }
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::agreement::axes::Axes;
    use plumbline_analysis::series::Axis;

    use super::*;

    const HEAD: &str = "PathFileType\t4\t(X/Y/Z)\tC:\\a.trc\t\t\nDataRate\tCameraRate\tNumFrames\t\
        NumMarkers\tUnits\n100\t100\t3\t2\tcm\nFrame#\tTime\tA\t\t\tB\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\
        \t\t\t\t\t\t\t\n";

    fn read(rows: &str) -> Result<Markers, String> {
        parse(&format!("{HEAD}{rows}"), "a.trc").map_err(|error| error.to_string())
    }

    #[test]
    fn missing_cells_and_frames_are_gaps() {
        let rows = "5\t2.00\t1\t2\t3\t4\t5\t6\r\n6\t2.01\t1\t2\t\tNaN\t5\t6\r\n7\t2.02\t1\t2\t4\t4\t5\t8\r\n";
        let markers = read(rows).unwrap();
        assert_eq!((markers.rate_hz, markers.first_s, markers.unit), (100.0, 2.0, Some(Unit::Cm)));
        assert_eq!(
            markers.markers[0].position,
            [Some([1.0, 2.0, 3.0]), None, Some([1.0, 2.0, 4.0])]
        );
        let axes = Axes::parse("ap=X,ml=-Y,si=Z").unwrap();
        let both = markers.series(&["A".to_owned(), "B".to_owned()], None, &axes).unwrap();
        assert_eq!(both.time_s(), [2.0, 2.02]);
        assert_eq!(both.along(Axis::Ap).unwrap(), [25.0, 25.0]);
        assert_eq!(both.along(Axis::Ml).unwrap(), [-35.0, -35.0]);
        assert_eq!(both.along(Axis::Si).unwrap(), [45.0, 60.0]);
    }

    #[test]
    fn a_position_that_no_room_holds_is_refused() {
        let rows = "5\t2.00\t1\t2\t3\t4\t5\t6\n6\t2.01\t1\t1e30\t3\t4\t5\t6\n\
                    7\t2.02\t1\t2\t4\t4\t5\t8\n";
        let axes = Axes::parse("ap=X,ml=-Y,si=Z").unwrap();
        let markers = read(rows).unwrap();
        assert!(markers.series(&["B".to_owned()], None, &axes).is_ok());
        let error = markers.series(&["A".to_owned()], None, &axes).unwrap_err().to_string();
        assert!(error.starts_with("a.trc: A (frame 2): a position of 1e31 mm"), "{error}");
    }

    #[test]
    fn what_cannot_be_used_is_named_with_its_line() {
        let row = |frame: u32, time_s: f64| format!("{frame}\t{time_s}\t1\t2\t3\t4\t5\t6\n");
        let good = row(1, 0.0) + &row(2, 0.01);
        let cases = [
            (String::new(), "no frame"),
            (good.clone(), "it has 2 frames, and NumFrames is 3"),
            (good.clone() + "3\t0.02\t1\t2\tx\n", "A (line 9): \"x\" is not a number"),
            (good.clone() + &row(1, 0.02), "Frame# (line 9): 1 comes after"),
            (good.clone() + &row(3, 0.03), "Time (line 9): 0.03 s, where 100 Hz"),
            (good.clone() + "three\t0.02\n", "Frame# (line 9)"),
            (good.clone() + "3\tnan\n", "Time (line 9)"),
            (good.clone() + "4000000000\t0.02\n", "no recording is so long"),
            (good.clone() + &row(1_000_001, 10_000.0), "(line 9): 1000001 is beyond NumFrames, 3"),
            (good + "3\t0.02\t1\t2\t3\t4\t5\t6\t7\n", "more than markers have"),
        ];
        for (rows, part) in cases {
            let error = read(&rows).unwrap_err();
            assert!(error.starts_with("a.trc: ") && error.contains(part), "{error}");
        }
        let bad = |old: &str, new: &str| {
            let text = HEAD.replace(old, new) + "1\t0\t1\t2\t3\t4\t5\t6\n";
            parse(&text, "a.trc").unwrap_err().to_string()
        };
        assert!(bad("100\t100", "0\t100").contains("DataRate"));
        assert!(bad("3\t2\tcm", "1\t3\tcm").contains("2 markers are named, and NumMarkers is"));
        assert!(bad("PathFileType", "Frame").contains("PathFileType"));
        for length in 0..HEAD.len() {
            assert!(parse(&HEAD[..length], "a.trc").is_err());
        }
    }

    #[test]
    fn markers_and_units_that_cannot_be_right_are_refused() {
        let rows = "1\t0\t1\t2\t3\t4\t5\t6\n2\t.01\t1\t2\t3\t4\t5\t6\n3\t.02\t1\t2\t3\t4\t5\t6\n";
        let markers = read(rows).unwrap();
        let axes = Axes::parse("ap=X").unwrap();
        let series = |names: &[&str], unit| {
            let names: Vec<String> = names.iter().map(|it| (*it).to_owned()).collect();
            markers.series(&names, unit, &axes).map(|_| ()).map_err(|error| error.to_string())
        };
        assert!(series(&["C"], None).unwrap_err().contains("C: no such marker; there are A, B;"));
        assert!(series(&[], None).unwrap_err().contains("no marker is named; there are A, B;"));
        let error = series(&["A"], Some(Unit::Mm)).unwrap_err();
        assert!(error.contains("the file says cm, and --unit says mm"), "{error}");
        assert_eq!(series(&["A"], Some(Unit::Cm)), Ok(()));
    }
}
