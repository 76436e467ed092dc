//! Track row column: see [`crate::export`] for its lines.
//!
//! Times are taken from the rate, since programs round those in the rows to milliseconds; the
//! first row's says when the recording begins.

use std::path::Path;

use plumbline_files::BadInput;
use plumbline_files::text_of;

use super::{Marker, Markers, VALUES_MAX, unit_of};

/// Columns before those of the first marker: frame and time.
const BEFORE: usize = 2;

const REMEDY: &str = "give a TRC file as motion capture programs and OpenSim write it";

pub fn read(path: &Path) -> Result<Markers, BadInput> {
    parse(&text_of(path)?, &path.display().to_string())
}

fn parse(text: &str, place: &str) -> Result<Markers, BadInput> {
    let mut lines = text.lines().zip(1..);
    let mut next = |what: &str| {
        let line = lines.next().map(|(text, _)| text);
        line.ok_or_else(|| BadInput::whole(place, format!("it ends before {what}"), REMEDY))
    };
    if !next("its header")?.trim_start_matches('\u{feff}').starts_with("PathFileType") {
        return Err(BadInput::new(place, "line 1", "it does not begin with PathFileType", REMEDY));
    }
    let keys: Vec<&str> = next("its header")?.split('\t').map(str::trim).collect();
    let values: Vec<&str> = next("its header")?.split('\t').map(str::trim).collect();
    let names: Vec<&str> = next("the markers' names")?.split('\t').map(str::trim).collect();
    next("the markers' axes")?;

    let value = |key: &str| {
        let at = keys.iter().position(|it| it.eq_ignore_ascii_case(key))?;
        values.get(at).copied().filter(|it| !it.is_empty())
    };
    let rate_hz = value("DataRate").and_then(|it| it.parse::<f64>().ok());
    let Some(rate_hz) = rate_hz.filter(|it| it.is_finite() && *it > 0.0) else {
        return Err(BadInput::new(place, "DataRate (line 3)", "it is no rate", REMEDY));
    };
    let frames: Option<usize> = value("NumFrames").and_then(|it| it.parse().ok());
    let unit = value("Units").and_then(unit_of);
    let mut markers: Vec<Marker> = names
        .iter()
        .skip(BEFORE)
        .step_by(3)
        .take_while(|name| !name.is_empty())
        .map(|name| Marker { name: (*name).to_owned(), position: Vec::new() })
        .collect();
    if markers.is_empty() {
        return Err(BadInput::new(place, "line 4", "it names no marker", REMEDY));
    }
    let said: Option<usize> = value("NumMarkers").and_then(|it| it.parse().ok());
    if said.is_some_and(|said| said != markers.len()) {
        let found = format!("{} markers are named, and NumMarkers is {said:?}", markers.len());
        return Err(BadInput::new(place, "line 4", found, "correct the file's header"));
    }

    let mut first: Option<(u64, f64)> = None;
    for (text, line) in lines {
        if text.trim().is_empty() {
            continue;
        }
        let cells: Vec<&str> = text.split('\t').map(str::trim).collect();
        let wrong = |field: &str, found: String| {
            let remedy = "correct or remove that line; a missing value is an empty cell or NaN";
            BadInput::new(place, format!("{field} (line {line})"), found, remedy)
        };
        let frame: u64 = cells[0]
            .parse()
            .map_err(|_| wrong("Frame#", format!("{:?} is no frame's number", cells[0])))?;
        let time = cells.get(1).copied().unwrap_or_default();
        let time_s = time.parse::<f64>().ok().filter(|it| it.is_finite());
        let time_s = time_s.ok_or_else(|| wrong("Time", format!("{time:?} is no time")))?;
        let (first_frame, first_s) = *first.get_or_insert((frame, time_s));
        let at = frame.checked_sub(first_frame).and_then(|it| usize::try_from(it).ok());
        let row = markers[0].position.len();
        let Some(at) = at.filter(|at| *at >= row) else {
            return Err(wrong("Frame#", format!("{frame} comes after a later frame")));
        };
        if at.saturating_mul(3 * markers.len()) > VALUES_MAX {
            return Err(wrong("Frame#", format!("{frame}: no recording is so long")));
        }
        // Before there is room for all that it would leave out.
        if let Some(said) = frames.filter(|said| at >= *said) {
            return Err(wrong("Frame#", format!("{frame} is beyond NumFrames, {said}")));
        }
        // Rounded to milliseconds or not, the time is that of the frame.
        let due_s = first_s + at as f64 / rate_hz;
        if (time_s - due_s).abs() > 0.5 / rate_hz + 1e-3 {
            let found =
                format!("{time_s} s, where {rate_hz} Hz and the frame's number give {due_s:.3} s");
            return Err(wrong("Time", found));
        }
        if cells.len() > BEFORE + 3 * markers.len()
            && cells[BEFORE + 3 * markers.len()..].iter().any(|it| !it.is_empty())
        {
            return Err(wrong("line", format!("{} cells, more than markers have", cells.len())));
        }
        for (index, marker) in markers.iter_mut().enumerate() {
            let mut position = [0.0; 3];
            let mut is_seen = true;
            for (axis, value) in position.iter_mut().enumerate() {
                let cell = cells.get(BEFORE + 3 * index + axis).copied().unwrap_or_default();
                if cell.is_empty() {
                    is_seen = false;
                    continue;
                }
                let number: f64 = cell
                    .parse()
                    .map_err(|_| wrong(&marker.name, format!("{cell:?} is no number")))?;
                is_seen &= number.is_finite();
                *value = number;
            }
            // Frames that the file leaves out were not seen.
            marker.position.resize(at, None);
            marker.position.push(is_seen.then_some(position));
        }
    }
    let Some((_, first_s)) = first else {
        return Err(BadInput::whole(place, "it has no frame", REMEDY));
    };
    let rows = markers[0].position.len();
    if frames.is_some_and(|said| said != rows) {
        return Err(BadInput::whole(
            place,
            format!("it has {rows} frames, and NumFrames is {}", frames.unwrap_or_default()),
            "the file is cut off or changed: write it again",
        ));
    }
    Ok(Markers { place: place.to_owned(), rate_hz, first_s, unit, markers })
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::agreement::axes::Axes;
    use plumbline_analysis::series::Axis;

    use super::super::Unit;
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
    fn what_cannot_be_used_is_named_with_its_line() {
        let row = |frame: u32, time_s: f64| format!("{frame}\t{time_s}\t1\t2\t3\t4\t5\t6\n");
        let good = row(1, 0.0) + &row(2, 0.01);
        let cases = [
            (String::new(), "no frame"),
            (good.clone(), "it has 2 frames, and NumFrames is 3"),
            (good.clone() + "3\t0.02\t1\t2\tx\n", "A (line 9): \"x\" is no number"),
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
