//! What the boards and this machine have in common: one stored frame is measured again and again,
//! and the poses are written as rows of a table.
//!
//! First the whole frame is searched, then the targets are tracked in it. A number is written
//! with as many digits as it takes to read the very same bits again, so that two tables can be
//! compared exactly.
//!
//! The same poses are also sealed, as by a box on a line without a way back: lines of `packet`, a
//! tab and the packet's bytes, of which the first announces the start.
#![no_std]

use core::fmt::{self, Write};

use plumbline::config::{Config, ConfigError};
use plumbline::image::GreyImage;
use plumbline::packet::{EncodeError, MarkedInstant, Message, PosePacket, SCHEMA_HASH, Start};
use plumbline::pipeline::Pipeline;
use plumbline::report::Report;
use plumbline::scene::Anatomical;
use plumbline::seal::{Key, OneWay, SEALED_BYTES_MAX, StreamSealer};
use plumbline::target::Role;

/// The blob of `plumb provision`, in the directory of stored files.
pub const CONFIG_FILE: &str = "box.plb";

/// The recording of `plumb simulate`: one frame.
pub const RECORDING_FILE: &str = "frames.y4m";

/// One search, and enough tracking to trust an expected pose.
pub const STEPS: u32 = 5;

/// The frame interval of a camera with 60 frames per second.
const STEP_NS: u64 = 16_666_667;

const COLUMNS: &str = "frame,target,state,points,theta1_rad,theta2_rad,theta3_rad,\
                       x_mm,y_mm,z_mm,ap_mm,ml_mm,si_mm";

/// Why there is no table.
#[derive(Debug)]
pub enum NoTable {
    /// The configuration.
    Config(ConfigError),
    /// The recording is shorter than a frame of the camera's size.
    Recording,
    /// The table cannot be written.
    Output,
    /// A packet cannot be sealed.
    Sealing,
}

impl From<ConfigError> for NoTable {
    fn from(error: ConfigError) -> Self {
        Self::Config(error)
    }
}

impl From<fmt::Error> for NoTable {
    fn from(_: fmt::Error) -> Self {
        Self::Output
    }
}

impl From<EncodeError> for NoTable {
    fn from(_: EncodeError) -> Self {
        Self::Sealing
    }
}

/// The key of the boards, for which nothing is secret.
///
/// # Panics
/// Never: these bytes are a key.
#[must_use]
pub fn key() -> Key {
    Key::new([7; 32]).expect("a key")
}

/// The only start of a board, which has no random numbers.
fn only_start(key: &Key) -> OneWay {
    OneWay {
        key_id: key.id(),
        start: Start::MIN,
        start_count: 1,
        schema_hash: SCHEMA_HASH,
        salt: [9; 16],
        next: 0,
    }
}

/// What the line of a packet begins with.
pub const PACKET: &str = "packet\t";

fn write_packet(out: &mut impl Write, packet: &[u8]) -> fmt::Result {
    write!(out, "{PACKET}")?;
    packet.iter().try_for_each(|byte| write!(out, "{byte:02x}"))?;
    writeln!(out)
}

/// Measures the frame of a recording [`STEPS`] times and writes a row per step and target, and the
/// packets.
///
/// `step` must call [`Pipeline::step`] with the arguments it is given; this lets the caller measure
/// the call.
///
/// # Errors
/// What cannot be read or written.
pub fn measure(
    pipeline: &mut Pipeline,
    config: &Config,
    recording: &[u8],
    out: &mut impl Write,
    mut step: impl FnMut(&mut Pipeline, &GreyImage<'_>, u64) -> Report,
) -> Result<(), NoTable> {
    pipeline.configure(config)?;
    let [width, height] = [config.lens.width_px, config.lens.height_px].map(usize::from);
    // A recording ends with its last frame.
    let start = recording.len().checked_sub(width * height).ok_or(NoTable::Recording)?;
    let frame = GreyImage::new(&recording[start..], width, height, width)
        .map_err(|_| NoTable::Recording)?;
    write_header(out)?;
    let (key, mut buffer) = (key(), [0; SEALED_BYTES_MAX]);
    let announcement = only_start(&key);
    write_packet(out, announcement.packet(&key, &mut buffer))?;
    let mut stream = StreamSealer::one_way(&key, &announcement);
    for number in 0..STEPS {
        let report = step(pipeline, &frame, u64::from(number) * STEP_NS);
        write_rows(out, number, config, &report)?;
        let pose = PosePacket::from_report(&report, MarkedInstant::FrameArrival, 0);
        write_packet(out, stream.seal(&Message::Pose(pose), &mut buffer)?)?;
    }
    Ok(())
}

/// [`Pipeline::step`] as a function of its own, at which the count of its stack begins: otherwise
/// it could be inlined into its caller.
#[inline(never)]
pub fn step(pipeline: &mut Pipeline, frame: &GreyImage<'_>, time_ns: u64) -> Report {
    pipeline.step(frame, time_ns)
}

/// The names of the columns.
///
/// # Errors
/// What cannot be written.
pub fn write_header(out: &mut impl Write) -> fmt::Result {
    writeln!(out, "{COLUMNS}")
}

/// One row per target, with the columns of `poses.csv`.
///
/// # Errors
/// What cannot be written.
pub fn write_rows(
    out: &mut impl Write,
    number: u32,
    config: &Config,
    report: &Report,
) -> fmt::Result {
    for (target, seen) in config.targets.iter().zip(&report.targets) {
        write!(out, "{number},{},{}", target.name, seen.state.word())?;
        let Ok(measured) = &seen.measurement else {
            writeln!(out, ",0,,,,,,,,,")?;
            continue;
        };
        write!(out, ",{}", measured.corners)?;
        for value in measured.cam_from_target.theta() {
            write!(out, ",{value}")?;
        }
        let trunk = match seen.role {
            Role::Upper => report.upper_trunk,
            Role::Lower => report.lower_trunk,
            Role::Scene => None,
        };
        match trunk {
            Some(Anatomical { ap_mm, ml_mm, si_mm }) => writeln!(out, ",{ap_mm},{ml_mm},{si_mm}")?,
            None => writeln!(out, ",,,")?,
        }
    }
    Ok(())
}
