//! The Coordinate 3D file of motion capture, through the crate `c3dio`.
//!
//! What version 0.8.0 of that crate writes no other program opens. Each repair below names what
//! it mends; those on bytes look for exactly what that version writes, and fail where they do
//! not find it. The tests open the file in two other readers.

use std::path::Path;

use c3dio::prelude::*;
use c3dio::{MarkerPoint, Parameter};
use plumbline_files::BadInput;

use super::rows::Rows;
use super::{RIGHT_HANDED, right_handed};

/// The crate indexes these without asking whether they are there.
const GROUPS: [&str; 8] =
    ["POINT", "ANALOG", "FORCE_PLATFORM", "EVENT", "EVENT_CONTEXT", "MANUFACTURER", "SEG", "TRIAL"];

/// Our own group.
const OWN: &str = "PLUMBLINE";

const BLOCK_BYTES: usize = 512;
/// Four numbers of four bytes.
const POINT_BYTES: usize = 16;

/// A count in the header has 16 bits. What is longer says so in TRIAL.
const FRAMES_MAX: usize = 0xffff;

/// The file.
///
/// # Errors
/// When the crate fails, or does not write what is to be repaired.
pub fn bytes(rows: &Rows, place: &Path) -> Result<Vec<u8>, BadInput> {
    write(rows).and_then(|bytes| repaired(bytes, rows)).map_err(|found| {
        let remedy = "make room on the disk with the temporary files; if there is, report it";
        BadInput::whole(place.display(), found, remedy)
    })
}

fn write(rows: &Rows) -> Result<Vec<u8>, String> {
    let mut c3d = C3d::new();
    for group in GROUPS.into_iter().chain([OWN]) {
        // The crate forgets the byte with the description's length. A description of one NUL
        // is that byte.
        c3d.parameters.insert_group(group, "\0".to_owned());
    }
    let frames = rows.time_s.len();
    let (words, short) =
        (|it: usize| [it as u16 as i16, (it >> 16) as i16], frames.min(FRAMES_MAX));
    let points = &mut c3d.points;
    for row in 0..frames {
        let of = |position_mm: Option<[f64; 3]>| {
            let [x, y, z] = right_handed(position_mm.unwrap_or_default()).map(|it| it as f32);
            MarkerPoint::new(x, y, z)
        };
        points.push_row(rows.points.iter().map(|point| of(point.position_mm[row])).collect());
    }
    points.labels = rows.points.iter().map(|point| format!("{}_trunk", point.name)).collect();
    let description = |name: &str| format!("{name} trunk: {RIGHT_HANDED}");
    points.descriptions = rows.points.iter().map(|point| description(&point.name)).collect();
    points.units = ['m', 'm', ' ', ' '];
    points.frame_rate = rows.rate_hz as f32;
    points.scale_factor = 1.0;
    (points.first_frame, points.last_frame) = (1, short as u16);

    let failed = |error: C3dWriteError| error.to_string();
    let integers = |it: [i16; 2]| Parameter::integers(it.to_vec()).map_err(failed);
    let parameters = &mut c3d.parameters;
    // The crate leaves out what every reader asks for. Coordinates are floating-point where
    // SCALE is negative.
    parameters.insert("POINT", "RATE", Parameter::float(rows.rate_hz as f32));
    parameters.insert("POINT", "SCALE", Parameter::float(-1.0));
    parameters.insert("POINT", "DATA_START", Parameter::integer(0));
    if frames > FRAMES_MAX {
        parameters.insert("TRIAL", "ACTUAL_START_FIELD", integers(words(1))?);
        parameters.insert("TRIAL", "ACTUAL_END_FIELD", integers(words(frames))?);
    }
    let zero_s = -rows.first_s();
    parameters.insert(OWN, "T_ZERO", Parameter::float(zero_s as f32));
    let axes = Parameter::string(RIGHT_HANDED.to_owned()).map_err(failed)?;
    parameters.insert(OWN, "AXES", axes);

    // The crate writes to a path alone, and only if it ends so.
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let path = folder.path().join("trial.c3d");
    c3d.write_path(path.clone()).map_err(failed)?;
    std::fs::read(path).map_err(|error| error.to_string())
}

/// The bytes as the format has them.
fn repaired(mut bytes: Vec<u8>, rows: &Rows) -> Result<Vec<u8>, String> {
    let frames = rows.time_s.len();
    let data_block = u16::from_le_bytes([bytes[16], bytes[17]]);
    // The first two bytes of the parameters.
    bytes[BLOCK_BYTES..BLOCK_BYTES + 2].copy_from_slice(&[1, 0x50]);
    let data = (usize::from(data_block) - 1) * BLOCK_BYTES;
    let (parameters, data) = bytes.split_at_mut_checked(data).ok_or("data begin late")?;
    // After a name: the way to the next parameter in two bytes, the type, and one dimension of
    // one. FRAMES is a floating-point number and belongs into an integer: of its bytes, two are
    // left for a description of two spaces.
    let frames_at = after(parameters, b"FRAMES", &[0x0a, 0, 4, 1, 1])?;
    let [low, high] = (frames.min(FRAMES_MAX) as u16).to_le_bytes();
    parameters[frames_at - 3] = 2;
    parameters[frames_at..frames_at + 5].copy_from_slice(&[low, high, 2, b' ', b' ']);
    // Where the data begin is known only now. The way to the next is 0 in the last parameter,
    // and which one that is differs from run to run.
    let start_at = after(parameters, b"DATA_START", &[8, 0, 2, 1, 1])
        .or_else(|_| after(parameters, b"DATA_START", &[0, 0, 2, 1, 1]))?;
    parameters[start_at..start_at + 2].copy_from_slice(&data_block.to_le_bytes());
    // A point that was not seen has the residual -1, for which the crate writes 255.
    for row in 0..frames {
        for (at, point) in rows.points.iter().enumerate() {
            if point.position_mm[row].is_none() {
                let residual = (row * rows.points.len() + at) * POINT_BYTES + 12;
                let cell = data.get_mut(residual..residual + 4).ok_or("data end early")?;
                cell.copy_from_slice(&(-1.0_f32).to_le_bytes());
            }
        }
    }
    bytes.resize(bytes.len().next_multiple_of(BLOCK_BYTES), 0);
    Ok(bytes)
}

/// The place after the only one that has this name with this behind it.
fn after(bytes: &[u8], name: &[u8], behind: &[u8]) -> Result<usize, String> {
    let wanted = [name, behind].concat();
    let mut places = bytes.windows(wanted.len()).enumerate().filter(|(_, it)| *it == wanted);
    match (places.next(), places.next()) {
        (Some((at, _)), None) => Ok(at + wanted.len()),
        _ => Err(format!("no one place for {}", name.escape_ascii())),
    }
}
