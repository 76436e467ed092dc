//! The Coordinate 3D file, through the crate `c3dio`.
//!
//! That crate panics on some damaged files, takes one that was cut off for a shorter recording,
//! and miscounts more than 65,535 frames. So the header is read here first, by the manual's
//! bytes: what the file promises must be in it. Whatever still panics is an error, and the number
//! of frames is then compared. Whether a point was seen is read here as well: the crate loses the
//! sign that says it.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;
use std::sync::Once;

use c3dio::C3d;
use plumbline_files::BadInput;
use plumbline_files::bytes_of;

use super::{Marker, Markers, VALUES_MAX, unit_of};

const BLOCK_BYTES: usize = 512;

/// The second byte of every such file.
const KEY: u8 = 0x50;

/// Bytes of processors: little endian, and two that are no longer made.
const INTEL: u8 = 84;

/// A count in the header has 16 bits; this one says "or more".
const FRAMES_MAX: usize = 0xffff;

const REMEDY: &str = "write it again with the motion capture program, or as TRC";

pub fn read(path: &Path) -> Result<Markers, BadInput> {
    let place = path.display().to_string();
    let bytes = bytes_of(path)?;
    parse(&bytes, &place).map_err(|found| BadInput::whole(&place, found, REMEDY))
}

/// What the header says of the data.
struct Header {
    points: usize,
    frames: usize,
    data: usize,
    /// Of a number: 4 for floating-point, 2 for integers.
    number_bytes: usize,
    frame_bytes: usize,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        let short = || "it is cut off in its header".to_owned();
        let header = bytes.first_chunk::<BLOCK_BYTES>().ok_or_else(short)?;
        let word =
            |at: usize| usize::from(u16::from_le_bytes([header[2 * at - 2], header[2 * at - 1]]));
        if header[1] != KEY {
            return Err("it is no C3D file".to_owned());
        }
        let parameters = usize::from(header[0]);
        // The crate expects the parameters in the second block.
        if parameters != 2 {
            return Err(format!("its parameters are in block {parameters}, and 2 is expected"));
        }
        let processor = bytes.get(BLOCK_BYTES + 3).ok_or_else(short)?;
        if *processor != INTEL {
            return Err("its numbers are those of a DEC or MIPS processor".to_owned());
        }
        let (points, analog) = (word(2), word(3));
        let (first, last) = (word(4), word(5));
        let scale = f32::from_le_bytes([header[12], header[13], header[14], header[15]]);
        let number_bytes = if scale < 0.0 { 4 } else { 2 };
        let data_block = word(9);
        if points == 0 || last < first || first == 0 || data_block <= parameters {
            return Err("its header contradicts itself, or names no points".to_owned());
        }
        Ok(Self {
            points,
            frames: last - first + 1,
            data: (data_block - 1) * BLOCK_BYTES,
            number_bytes,
            frame_bytes: number_bytes * (4 * points + analog),
        })
    }

    /// Frames for which there are bytes.
    fn frames_there(&self, bytes: &[u8]) -> usize {
        bytes.len().saturating_sub(self.data) / self.frame_bytes
    }

    /// Of a point's four numbers the last: the cameras that saw it and its residual, and negative
    /// where none did.
    fn is_seen(&self, bytes: &[u8], frame: usize, point: usize) -> bool {
        let at = self.data + frame * self.frame_bytes + (4 * point + 3) * self.number_bytes;
        match bytes.get(at..at + self.number_bytes) {
            Some(&[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]) >= 0.0,
            Some(&[a, b]) => i16::from_le_bytes([a, b]) >= 0,
            _ => false,
        }
    }
}

fn parse(bytes: &[u8], place: &str) -> Result<Markers, String> {
    let header = Header::read(bytes)?;
    let there = header.frames_there(bytes);
    if there < header.frames {
        return Err(format!("it is cut off: {there} of {} frames are there", header.frames));
    }
    if there.saturating_mul(header.points) > VALUES_MAX / 3 {
        return Err("no recording is so long".to_owned());
    }
    let c3d = without_panic(bytes).ok_or("its parameters are damaged")?;
    let (frames, points) = c3d.points.size();
    // The crate's count of a long recording is off by one for each 65,536 frames.
    let is_long = header.frames >= FRAMES_MAX - 1 || frames > FRAMES_MAX;
    if is_long {
        return Err(format!(
            "{} frames or more, which this program cannot read as C3D",
            FRAMES_MAX - 1
        ));
    }
    if frames != header.frames || points != header.points {
        return Err(format!(
            "its parameters say {frames} frames of {points} points, and its header {} of {}",
            header.frames, header.points
        ));
    }
    let rate_hz = f64::from(c3d.points.frame_rate);
    if !(rate_hz.is_finite() && rate_hz > 0.0) {
        return Err(format!("{rate_hz} is no rate"));
    }
    let name = |at: usize| c3d.points.labels.get(at).map(|it| it.trim().to_owned());
    let markers = (0..points).map(|at| {
        let position = (0..frames).map(|frame| {
            let point = c3d.points.get(frame, at)?;
            let position = point.point.map(f64::from);
            // All zero is how some programs say it as well.
            let is_seen = header.is_seen(bytes, frame, at)
                && position.iter().all(|it| it.is_finite())
                && position != [0.0; 3];
            is_seen.then_some(position)
        });
        let name =
            name(at).filter(|it| !it.is_empty()).unwrap_or_else(|| format!("point {}", at + 1));
        Marker { name, position: position.collect() }
    });
    let unit: String = c3d.points.units.iter().collect();
    Ok(Markers {
        place: place.to_owned(),
        rate_hz,
        first_s: 0.0,
        unit: unit_of(&unit),
        markers: markers.collect(),
    })
}

thread_local! {
    /// While the crate reads. What a panic prints helps nobody who has a damaged file.
    static IS_SILENT: Cell<bool> = const { Cell::new(false) };
}

/// The crate's reading, if it comes to an end.
fn without_panic(bytes: &[u8]) -> Option<C3d> {
    static HOOKED: Once = Once::new();
    HOOKED.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_SILENT.get() {
                others(panic);
            }
        }));
    });
    IS_SILENT.set(true);
    let read = catch_unwind(AssertUnwindSafe(|| C3d::from_bytes(bytes).ok()));
    IS_SILENT.set(false);
    read.ok()?
}
