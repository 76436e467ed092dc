//! The Coordinate 3D file: see [`crate::c3d`].
//!
//! Counts and types are the header's. Where parameters repeat them they must agree, or the file is
//! damaged; and all frames that are promised must be there.

use std::path::Path;

use plumbline_files::BadInput;
use plumbline_files::bytes_of;

use super::{Marker, Markers, VALUES_MAX, unit_of};
use crate::c3d::{FRAMES_MAX, Header, Parameters, Value, decode};

const REMEDY: &str = "write it again with the motion capture program, or as TRC";

pub fn read(path: &Path) -> Result<Markers, BadInput> {
    let place = path.display().to_string();
    let bytes = bytes_of(path)?;
    parse(&bytes, &place).map_err(|found| BadInput::whole(&place, found, REMEDY))
}

fn parse(bytes: &[u8], place: &str) -> Result<Markers, String> {
    let (header, parameters, data) = decode(bytes)?;
    let points = usize::from(header.points);
    if points == 0 {
        return Err("it has no points".to_owned());
    }
    let frames = frames(&header, &parameters)?;
    let number_bytes = header.number_bytes();
    let point_bytes = 4 * number_bytes;
    let frame_bytes = points * point_bytes + usize::from(header.analog) * number_bytes;
    let there = data.len() / frame_bytes;
    if there < frames {
        return Err(format!("it is cut off: {there} of {frames} frames are there"));
    }
    if frames.saturating_mul(points) > VALUES_MAX / 3 {
        return Err("no recording is so long".to_owned());
    }
    let rate_hz = f64::from(header.rate_hz);
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err(format!("its rate is {rate_hz} Hz"));
    }
    let names = labels(&parameters);
    let markers = (0..points).map(|point| {
        let frames = data.chunks_exact(frame_bytes).take(frames);
        let position = frames
            .map(|frame| position(&frame[point * point_bytes..][..point_bytes], header.scale))
            .collect();
        let name = names.get(point).filter(|it| !it.is_empty());
        let name = name.map_or_else(|| format!("point {}", point + 1), |it| (*it).to_owned());
        Marker { name, position }
    });
    Ok(Markers {
        place: place.to_owned(),
        rate_hz,
        first_s: 0.0,
        unit: parameters.texts("POINT", "UNITS").first().and_then(|it| unit_of(it)),
        markers: markers.collect(),
    })
}

/// The number of frames, on which all that the file says must agree.
fn frames(header: &Header, parameters: &Parameters) -> Result<usize, String> {
    let (first, last) = (header.first_frame, header.last_frame);
    if first == 0 || last < first {
        return Err(format!("its header says that it has the frames {first} to {last}"));
    }
    let frames = usize::from(last - first) + 1;
    let is_long = last == FRAMES_MAX;
    let said_twice = [
        ("USED", f32::from(header.points)),
        ("RATE", header.rate_hz),
        // The sign says whether numbers are floating-point: some programs write it once.
        ("SCALE", header.scale.abs()),
        ("FRAMES", frames as f32),
    ];
    for (name, by_header) in said_twice {
        let Some(said) = parameters.number("POINT", name).map(f32::abs) else { continue };
        if said != by_header && !(name == "FRAMES" && is_long) {
            return Err(format!(
                "its parameter POINT:{name} is {said}, and its header says {by_header}"
            ));
        }
    }
    let of_trial = |name: &str| match parameters.get("TRIAL", name) {
        Some(Value::Integers(words)) => match words[..] {
            [low, high] => Some(usize::from(low) | usize::from(high) << 16),
            _ => None,
        },
        _ => None,
    };
    let by_trial = of_trial("ACTUAL_START_FIELD")
        .zip(of_trial("ACTUAL_END_FIELD"))
        .and_then(|(first, last)| Some(last.checked_sub(first)? + 1));
    match by_trial {
        Some(long) if is_long => Ok(long),
        Some(other) if other != frames => {
            Err(format!("its TRIAL parameters say {other} frames, and its header {frames}"))
        }
        None if is_long => Err(format!("it does not say how many frames follow {FRAMES_MAX}")),
        Some(_) | None => Ok(frames),
    }
}

/// The points' names. A parameter has room for 255; more follow in LABELS2, LABELS3 ...
fn labels(parameters: &Parameters) -> Vec<&str> {
    let more = (2..).map(|at| format!("LABELS{at}"));
    std::iter::once("LABELS".to_owned())
        .chain(more)
        .map(|name| parameters.texts("POINT", &name))
        .take_while(|texts| !texts.is_empty())
        .flatten()
        .map(|it| it.trim())
        .collect()
}

/// Where a point was, of its four numbers; `None` where it was not seen, which the sign of the
/// fourth says. All zero is how some programs say it as well.
fn position(bytes: &[u8], scale: f32) -> Option<[f64; 3]> {
    let (floats, integers) = (bytes.as_chunks().0, bytes.as_chunks().0);
    let [x, y, z, residual] = match (floats, integers) {
        (&[x, y, z, residual], _) => [x, y, z, residual].map(f32::from_le_bytes),
        (_, &[x, y, z, residual]) => {
            let [x, y, z, residual] = [x, y, z, residual].map(i16::from_le_bytes).map(f32::from);
            [x * scale, y * scale, z * scale, residual]
        }
        _ => return None,
    };
    let position = [x, y, z].map(f64::from);
    let is_seen =
        residual >= 0.0 && position.iter().all(|it| it.is_finite()) && position != [0.0; 3];
    is_seen.then_some(position)
}

#[cfg(test)]
mod tests {
    use super::super::Unit;
    use super::*;
    use crate::c3d::encode;

    fn header(scale: f32) -> Header {
        Header { points: 2, analog: 1, first_frame: 5, last_frame: 7, scale, rate_hz: 50.0 }
    }

    fn file(header: &Header, parameters: &[(&str, &str, Value)], frames: &[i16]) -> Vec<u8> {
        let mut all = Parameters::default();
        for (group, name, value) in parameters.iter().cloned() {
            all.set(group, name, value);
        }
        let floats = frames.iter().flat_map(|it| f32::from(*it).to_le_bytes());
        let integers = frames.iter().flat_map(|it| it.to_le_bytes());
        let is_float = header.scale < 0.0;
        let bytes: Vec<u8> = if is_float { floats.collect() } else { integers.collect() };
        encode(header, all, &bytes)
    }

    /// Two points and an analog measurement in each of three frames.
    #[rustfmt::skip]
    const FRAMES: [i16; 27] = [
        1, 2, 3, 0,   4, 5, 6, 0x0302,   99,
        1, 2, 3, -1,  0, 0, 0, 0,        99,
        -7, 2, 3, 1,  4, 5, 6, -0x7fff,  99,
    ];

    #[test]
    fn integers_are_scaled_and_negative_residuals_are_gaps() {
        let text = |texts: &[&str]| Value::Texts(texts.iter().map(|it| (*it).to_owned()).collect());
        let parameters = [
            ("POINT", "LABELS", text(&["heel"])),
            ("POINT", "LABELS2", text(&["toe"])),
            ("POINT", "UNITS", Value::Text("m".to_owned())),
        ];
        for (scale, unit) in [(-1.0, 1.0), (0.5, 0.5)] {
            let found = parse(&file(&header(scale), &parameters, &FRAMES), "a.c3d").unwrap();
            assert_eq!((found.rate_hz, found.unit), (50.0, Some(Unit::M)));
            let at = |position: [f64; 3]| Some(position.map(|it| it * unit));
            let [heel, toe] = &found.markers[..] else { panic!("{found:?}") };
            assert_eq!((heel.name.as_str(), toe.name.as_str()), ("heel", "toe"));
            assert_eq!(heel.position, [at([1.0, 2.0, 3.0]), None, at([-7.0, 2.0, 3.0])]);
            assert_eq!(toe.position, [at([4.0, 5.0, 6.0]), None, None]);
        }
        // Without names and unit.
        let found = parse(&file(&header(-1.0), &[], &FRAMES), "a.c3d").unwrap();
        assert_eq!((found.markers[1].name.as_str(), found.unit), ("point 2", None));
    }

    #[test]
    fn what_contradicts_itself_or_is_cut_off_is_refused() {
        let good = header(-1.0);
        let refused = |header: &Header, parameters: &[(&str, &str, Value)]| {
            parse(&file(header, parameters, &FRAMES), "a.c3d").unwrap_err()
        };
        let one = |name: &'static str, value: f32| [("POINT", name, Value::Floats(vec![value]))];
        for (name, value) in [("USED", 3.0), ("RATE", 60.0), ("SCALE", -2.0), ("FRAMES", 4.0)] {
            let error = refused(&good, &one(name, value));
            assert!(error.contains(&format!("POINT:{name} is")), "{error}");
        }
        let words = |low: u16| Value::Integers(vec![low, 1]);
        let trial =
            [("TRIAL", "ACTUAL_START_FIELD", words(5)), ("TRIAL", "ACTUAL_END_FIELD", words(8))];
        assert!(refused(&good, &trial).contains("TRIAL parameters say 4 frames"));
        let cases = [
            (Header { points: 0, ..good }, "no points"),
            (Header { last_frame: 4, ..good }, "frames 5 to 4"),
            (Header { last_frame: 400, ..good }, "cut off: 14 of 396 frames"),
            (Header { last_frame: FRAMES_MAX, ..good }, "how many frames follow 65535"),
            (Header { rate_hz: 0.0, ..good }, "its rate is 0 Hz"),
            (Header { rate_hz: f32::NAN, ..good }, "its rate is NaN Hz"),
        ];
        for (header, part) in cases {
            let error = refused(&header, &[]);
            assert!(error.contains(part), "{error}");
        }
        assert!(parse(b"no", "a.c3d").unwrap_err().contains("cut off"));
        assert!(parse(&[7; 2000], "a.c3d").unwrap_err().contains("not a C3D file"));
    }
}
