//! The Coordinate 3D file of motion capture: see [`crate::c3d`].

use plumbline_files::counting::counted;

use super::events::Event;
use super::rows::Rows;
use super::{RIGHT_HANDED, right_handed};
use crate::Verdict;
use crate::c3d::{FRAMES_MAX, Header, Parameters, Value, encode};

/// Our own group.
const OWN: &str = "PLUMBLINE";

/// A length has one byte.
const TEXT_BYTES_MAX: usize = 255;

/// Negative: coordinates are floating-point, and in the unit that the file names.
const SCALE: f32 = -1.0;

/// The fourth number of a point that was not seen: its residual.
const NOT_SEEN: f32 = -1.0;

/// A parameter has room for this number of events; no trial has as many marks.
const EVENTS_MAX: usize = 255;

/// The longest label; those of marks are shorter unless they are in another alphabet.
const LABEL_BYTES_MAX: usize = 120;

/// The file, and what a user should know. It has those events that lie within its frames.
pub fn bytes(rows: &Rows, events: &[Event], verdict: &Verdict) -> (Vec<u8>, Vec<String>) {
    let end_s = rows.time_s.last().map_or(0.0, |last_s| last_s - rows.first_s());
    // An event between two frames at the end belongs to the last one.
    let is_within = |event: &&Event| (0.0..=end_s + 1.0 / rows.rate_hz).contains(&event.time_s);
    let mut within: Vec<&Event> = events.iter().filter(is_within).collect();
    let outside = events.len() - within.len();
    let beyond = within.len().saturating_sub(EVENTS_MAX);
    within.truncate(EVENTS_MAX);
    let reasons = [
        (outside, "before the first or after the last frame"),
        (beyond, "for which the format has no room"),
    ];
    let left_out = reasons.into_iter().filter(|(count, _)| *count > 0);
    let warnings =
        left_out.map(|(count, why)| format!("not in the file: {} {why}", counted(count, "event")));
    (file(rows, &within, verdict), warnings.collect())
}

fn file(rows: &Rows, events: &[&Event], verdict: &Verdict) -> Vec<u8> {
    let header = Header {
        points: rows.points.len() as u16,
        analog: 0,
        first_frame: 1,
        last_frame: u16::try_from(rows.time_s.len()).unwrap_or(FRAMES_MAX),
        scale: SCALE,
        rate_hz: rows.rate_hz as f32,
    };
    let mut parameters = parameters(&header, rows, verdict);
    put_events(&mut parameters, events);
    encode(&header, parameters, &frames(rows))
}

fn parameters(header: &Header, rows: &Rows, verdict: &Verdict) -> Parameters {
    let integer = |value: u16| Value::Integers(vec![value]);
    let float = |value: f32| Value::Floats(vec![value]);
    let of_points = |text: fn(&str) -> String| {
        Value::Texts(rows.points.iter().map(|point| text(&point.name)).collect())
    };
    let mut parameters = Parameters::default();
    for (group, name, value) in [
        ("POINT", "USED", integer(header.points)),
        ("POINT", "FRAMES", integer(header.last_frame)),
        ("POINT", "RATE", float(header.rate_hz)),
        ("POINT", "SCALE", float(header.scale)),
        ("POINT", "UNITS", Value::Text("mm".to_owned())),
        ("POINT", "LABELS", of_points(|name| format!("{name}_trunk"))),
        ("POINT", "DESCRIPTIONS", of_points(|name| format!("{name} trunk: {RIGHT_HANDED}"))),
        // The format requires these two groups. They say that there is nothing of the kind.
        ("ANALOG", "USED", integer(0)),
        ("ANALOG", "RATE", float(0.0)),
        ("ANALOG", "GEN_SCALE", float(1.0)),
        ("FORCE_PLATFORM", "USED", integer(0)),
        (OWN, "T_ZERO", float(-rows.first_s() as f32)),
        (OWN, "AXES", Value::Text(RIGHT_HANDED.to_owned())),
        (OWN, "VERDICT", verdict_texts(verdict)),
    ] {
        parameters.set(group, name, value);
    }
    if let Some(moved) = rows.moved() {
        parameters.set(OWN, "TIMES", Value::Text(moved));
    }
    if header.last_frame == FRAMES_MAX {
        let words = |it: usize| Value::Integers(vec![it as u16, (it >> 16) as u16]);
        parameters.set("TRIAL", "ACTUAL_START_FIELD", words(1));
        parameters.set("TRIAL", "ACTUAL_END_FIELD", words(rows.time_s.len()));
    }
    parameters
}

/// The group EVENT. Times are minutes and seconds from the first frame.
fn put_events(parameters: &mut Parameters, events: &[&Event]) {
    let time = |event: &&Event| {
        let minutes = (event.time_s / 60.0).floor();
        [minutes as f32, (event.time_s - 60.0 * minutes) as f32]
    };
    let texts =
        |text: fn(&Event) -> String| Value::Texts(events.iter().map(|event| text(event)).collect());
    parameters.set("EVENT", "USED", Value::Integers(vec![events.len() as u16]));
    if events.is_empty() {
        return;
    }
    for (name, value) in [
        ("CONTEXTS", texts(|_| "General".to_owned())),
        ("LABELS", texts(|event| event.label[..label_bytes(&event.label)].to_owned())),
        ("TIMES", Value::Pairs(events.iter().map(time).collect())),
        ("ICON_IDS", Value::Integers(vec![0; events.len()])),
    ] {
        parameters.set("EVENT", name, value);
    }
}

/// How much of a label has room, in whole characters.
fn label_bytes(label: &str) -> usize {
    let boundaries = label.char_indices().map(|(at, letter)| at + letter.len_utf8());
    boundaries.take_while(|end| *end <= LABEL_BYTES_MAX).last().unwrap_or_default()
}

/// The grade, and each reason; the format takes texts of at most 255 bytes.
fn verdict_texts(verdict: &Verdict) -> Value {
    let grade = verdict.overruled_words().unwrap_or_else(|| verdict.is.word().to_owned());
    let reasons = verdict.reasons.iter().map(|reason| reason.words.clone());
    let cut = |text: String| {
        let mut ends = (0..=text.len().min(TEXT_BYTES_MAX)).rev();
        text[..ends.find(|end| text.is_char_boundary(*end)).unwrap_or(0)].to_owned()
    };
    Value::Texts([grade].into_iter().chain(reasons).map(cut).collect())
}

fn frames(rows: &Rows) -> Vec<u8> {
    let mut bytes = Vec::new();
    for row in 0..rows.time_s.len() {
        for point in &rows.points {
            let numbers = match point.position_mm[row].map(right_handed) {
                Some([x, y, z]) => [x as f32, y as f32, z as f32, 0.0],
                None => [0.0, 0.0, 0.0, NOT_SEEN],
            };
            bytes.extend(numbers.into_iter().flat_map(f32::to_le_bytes));
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::super::rows::Track;
    use super::*;
    use crate::markers::Markers;
    use crate::positions::Unit;

    fn rows(frames: usize) -> Rows {
        let track = |name: &str, gap: usize| Track {
            name: name.to_owned(),
            position_mm: (0..frames)
                .map(|frame| (frame != gap).then_some([frame as f64, 0.5, -3.5]))
                .collect(),
            orientation: vec![None; frames],
        };
        Rows {
            rate_hz: 60.0,
            time_s: (0..frames).map(|frame| frame as f64 / 60.0 - 0.5).collect(),
            moved_s: 0.0,
            points: vec![track("lower", 3), track("upper", 7)],
        }
    }

    fn event(time_s: f64, label: &str) -> Event {
        Event { time_s, label: label.to_owned() }
    }

    #[test]
    fn events_are_minutes_and_seconds_from_the_first_frame() {
        // 100 s at 60 Hz.
        let rows = rows(6001);
        let long = "\u{e9}".repeat(64);
        let events = [
            event(-0.5, "before"),
            event(0.0, "t_zero"),
            event(61.25, "turns"),
            event(100.0, &long),
            event(101.0, "after"),
        ];
        let (bytes, warnings) = bytes(&rows, &events, &Verdict::default());
        let wanted = "not in the file: 2 events before the first or after the last frame";
        assert_eq!(warnings, [wanted]);
        let (_, parameters, _) = crate::c3d::decode(&bytes).unwrap();
        let (times, used) = (parameters.get("EVENT", "TIMES"), parameters.number("EVENT", "USED"));
        assert_eq!(times, Some(&Value::Pairs(vec![[0.0, 0.0], [1.0, 1.25], [1.0, 40.0]])));
        assert_eq!(used, Some(3.0));
        // 64 letters of two bytes each; 120 bytes have room.
        let labels = ["t_zero", "turns", &long[..120]];
        assert_eq!(parameters.texts("EVENT", "LABELS"), labels);
        assert_eq!(parameters.texts("EVENT", "CONTEXTS"), ["General"; 3]);
    }

    /// More marks than a parameter can have are left out, and no file is spoiled.
    #[test]
    fn more_events_than_have_room_are_told() {
        let rows = rows(6001);
        let events: Vec<Event> = (0..300).map(|at| event(f64::from(at) / 4.0, "mark")).collect();
        let (bytes, warnings) = bytes(&rows, &events, &Verdict::default());
        assert_eq!(warnings, ["not in the file: 45 events for which the format has no room"]);
        let (_, parameters, _) = crate::c3d::decode(&bytes).unwrap();
        assert_eq!(parameters.texts("EVENT", "LABELS").len(), 255);
    }

    /// Twenty minutes have more frames than the header can count.
    #[test]
    fn what_is_exported_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        for frames in [180, 65_534, 65_535, 65_536, 70_000] {
            let path = folder.path().join("trial.c3d");
            std::fs::write(&path, file(&rows(frames), &[], &Verdict::default())).unwrap();
            let found = Markers::read(&path).unwrap();
            assert_eq!((found.rate_hz, found.unit), (60.0, Some(Unit::Mm)));
            for (marker, (name, gap)) in
                found.markers.iter().zip([("lower_trunk", 3), ("upper_trunk", 7)])
            {
                assert_eq!((marker.name.as_str(), marker.position.len()), (name, frames));
                for (frame, position) in marker.position.iter().enumerate() {
                    let wanted = (frame != gap).then_some([frame as f64, -0.5, -3.5]);
                    assert_eq!(*position, wanted, "{name}, frame {frame}");
                }
            }
        }
    }
}
