//! What a box is provisioned with: its camera, its targets, the scene, its links
//! and its computer's settings, as one blob of bytes.
//!
//! | bytes | what |
//! |---|---|
//! | 4 | `PLMB` |
//! | 2 | [`FORMAT_VERSION`], little endian |
//! | 4 | number of bytes of the body, little endian |
//! | n | the [`Config`], postcard |
//! | 4 | CRC-32 (ISO-HDLC) of all of the above, little endian |
//!
//! Bytes with a correct checksum still come from outside: [`decode`](Config::decode) checks every
//! value, and so does [`encode`](Config::encode), so that no blob is written that a box would
//! refuse.

use core::net::SocketAddr;

use heapless::{String, Vec};
use postcard::ser_flavors::{Flavor, Size};
use serde::{Deserialize, Serialize};

use crate::common::checksum::{CRC_BYTES, CRC32, checked};
use crate::limits::{DEVICE_TEXT_BYTES_MAX, NAME_BYTES_MAX, TARGET_CORNERS_MAX, TARGETS_MAX};
use crate::model::lens::{Lens, LensError};
use crate::model::pose::{Cam, Pose, Scene};
use crate::model::target::{Role, TargetGeometry};

mod capture;
mod machine;
mod text;
mod trigger;

pub use capture::{Capture, CaptureDriver, CaptureError, PixelFormat};
pub use machine::{Machine, MachineError, Network, WATCHDOG_S_MAX};
pub use text::is_visible;
pub use trigger::{
    DEBOUNCE_US_MAX, Edge, Edges, LINE_MAX, Marked, TriggerError, TriggerInput, TriggerLines,
    TriggerOutput,
};

/// Changes when the blob's content changes.
pub const FORMAT_VERSION: u16 = 6;

/// The blob's name on a box's card.
pub const FILE_NAME: &str = "config.plb";

/// The name that a new blob has on the card until it has replaced the old one.
pub const NEW_FILE_NAME: &str = "config.new";

/// Why a configuration without any link is refused.
pub const NO_LINK: &str = "neither udp nor serial is given, and packets would have nowhere to go";

/// Longest path or name of a serial line or a camera, in bytes.
pub const DEVICE_PATH_BYTES_MAX: usize = 64;

const MAGIC: [u8; 4] = *b"PLMB";

/// Magic, version, length.
const HEADER_BYTES: usize = 10;

/// Longest readout, from the first row to the last: no slower camera is of use.
pub const READOUT_NS_MAX: i32 = 1_000_000_000;

/// Longest readout as a share of the frame's interval. A sensor cannot take longer, but both are
/// rounded or measured.
const READOUT_OF_INTERVAL_MAX: f64 = 1.02;

/// Everything in a blob except the targets: header, checksum, texts, lens (143), readout (5),
/// scene (49), links (92), capture (82), machine (18), trigger (81), rounded up.
const FIXED_BYTES_MAX: usize = 560;

/// A buffer of this size holds every blob: each target is a name, columns,
/// rows, role, a virtual point, and its corners of three f64.
pub const BLOB_BYTES_MAX: usize =
    FIXED_BYTES_MAX + TARGETS_MAX * (1 + NAME_BYTES_MAX + 3 + 24 + 2 + TARGET_CORNERS_MAX * 24);

/// One target and its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TargetConfig {
    /// Its name in targets.toml; no other target has it.
    pub name: String<NAME_BYTES_MAX>,
    /// Its corners and its role.
    pub geometry: TargetGeometry,
}

/// A serial line that the box sends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SerialLink {
    /// The device, such as `/dev/ttyS0`.
    pub path: String<DEVICE_PATH_BYTES_MAX>,
    /// Bits per second.
    pub baud: u32,
    /// Whether nothing comes back on it: the box then sends without having been asked to, and takes
    /// nothing from it.
    pub one_way: bool,
}

/// Where the box sends its packets.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Links {
    /// The host, by UDP.
    pub udp: Option<SocketAddr>,
    /// The host, by a serial line.
    pub serial: Option<SerialLink>,
}

/// Everything that one box needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// The box's name, for people.
    pub device: String<DEVICE_TEXT_BYTES_MAX>,
    /// The box's serial number.
    pub serial_number: String<DEVICE_TEXT_BYTES_MAX>,
    /// The camera's lens.
    pub lens: Lens,
    /// How long the camera takes to read a frame row by row: the delay from one row to the next
    /// times the number of rows. 0 for a global shutter; negative where the last row is read first,
    /// as in a camera that is mounted upside down and turns its picture.
    pub readout_ns: i32,
    /// The targets, at most one per role.
    pub targets: Vec<TargetConfig, TARGETS_MAX>,
    /// Where the scene is, as theta1..6 of `cam_from_scene`; `None` until it has been measured;
    /// until then there are no trunk points.
    pub cam_from_scene_theta: Option<[f64; 6]>,
    /// Where the packets go.
    pub links: Links,
    /// How frames are taken; `None` for a box that only replays recordings.
    pub capture: Option<Capture>,
    /// How the box's computer runs the measurement.
    pub machine: Machine,
    /// The wires to other devices; `None` without any.
    pub trigger: Option<TriggerLines>,
}

/// Why a configuration cannot be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ConfigError {
    /// The bytes do not start like a blob.
    NotAConfig,
    /// The blob was cut, or something follows it.
    Length {
        /// The number of bytes that the blob states.
        expected: usize,
        /// The number of bytes that there are.
        found: usize,
    },
    /// The checksum does not agree.
    Checksum,
    /// The blob is of another format.
    Version {
        /// The blob's format.
        found: u16,
    },
    /// The checksum agrees, but the body is not a configuration.
    Body,
    /// The buffer is too small for the blob.
    BufferTooSmall,
    /// The lens.
    Lens(LensError),
    /// The readout is longer than a second, or than the interval between two frames.
    Readout,
    /// There is no target.
    NoTarget,
    /// A text has a character that [cannot be seen](is_visible).
    Text {
        /// The field.
        field: &'static str,
    },
    /// A target's name is empty, or has a character that [cannot be seen](is_visible).
    TargetName {
        /// Position in the list of targets.
        index: usize,
    },
    /// Two targets have the same name.
    SameName {
        /// Position of the first.
        first: usize,
        /// Position of the second.
        second: usize,
    },
    /// Two targets have the same role.
    SameRole {
        /// Position of the first.
        first: usize,
        /// Position of the second.
        second: usize,
    },
    /// Two targets have grids of the same size, and cannot be told apart.
    SameShape {
        /// Position of the first.
        first: usize,
        /// Position of the second.
        second: usize,
    },
    /// The scene's theta: not finite, an angle above 2 pi, or a distance of 100 m or more.
    Scene,
    /// The UDP address or port is 0.
    Udp,
    /// The serial path is empty, or the baud rate is not within 1,200 to 12,000,000.
    Serial,
    /// The camera's settings.
    Capture(CaptureError),
    /// The computer's settings.
    Machine(MachineError),
    /// The wires to other devices.
    Trigger(TriggerError),
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotAConfig => {
                formatter.write_str("these bytes are not a Plumbline configuration")
            }
            Self::Length { expected, found } => {
                write!(formatter, "the configuration has {found} bytes and should have {expected}")
            }
            Self::Checksum => formatter
                .write_str("the configuration's checksum does not agree: provision the box again"),
            Self::Version { found } => write!(
                formatter,
                "the configuration's format is {found}, this program reads {FORMAT_VERSION}: \
                 provision the box again"
            ),
            Self::Body => formatter.write_str(
                "the configuration's checksum agrees, but its body is inconsistent \
                 (such as a target whose points are not columns x rows)",
            ),
            Self::BufferTooSmall => {
                write!(formatter, "a configuration needs a buffer of {BLOB_BYTES_MAX} bytes")
            }
            Self::Lens(error) => write!(formatter, "lens: {error}"),
            Self::Readout => formatter.write_str(
                "readout_ms: must lie within -1,000 to 1,000, and be no longer than the interval \
                 between two frames at the capture's rate_hz",
            ),
            Self::NoTarget => formatter.write_str("targets: there must be at least one"),
            Self::Text { field } => {
                write!(formatter, "{field}: must not contain characters that cannot be seen")
            }
            Self::TargetName { index } => write!(
                formatter,
                "targets[{index}].name: must not be empty, or contain characters that cannot be \
                 seen"
            ),
            Self::SameName { first, second } => {
                write!(formatter, "targets[{first}].name and targets[{second}].name are the same")
            }
            Self::SameRole { first, second } => {
                write!(formatter, "targets[{first}].role and targets[{second}].role are the same")
            }
            Self::SameShape { first, second } => write!(
                formatter,
                "targets[{first}] and targets[{second}] have grids of the same size, \
                 and could not be told apart: change the columns or the rows of one"
            ),
            Self::Scene => formatter.write_str(
                "cam_from_scene_theta: angles must lie within 2 pi, distances within 100 m",
            ),
            Self::Udp => formatter.write_str("links.udp: neither address nor port may be 0"),
            Self::Serial => formatter.write_str(
                "links.serial: needs a path, and a baud rate within 1,200 to 12,000,000",
            ),
            Self::Capture(error) => write!(formatter, "capture.{error}"),
            Self::Machine(error) => write!(formatter, "machine.{error}"),
            Self::Trigger(error) => write!(formatter, "trigger.{error}"),
        }
    }
}

impl core::error::Error for ConfigError {}

impl From<LensError> for ConfigError {
    fn from(error: LensError) -> Self {
        Self::Lens(error)
    }
}

impl From<CaptureError> for ConfigError {
    fn from(error: CaptureError) -> Self {
        Self::Capture(error)
    }
}

impl From<TriggerError> for ConfigError {
    fn from(error: TriggerError) -> Self {
        Self::Trigger(error)
    }
}

impl From<MachineError> for ConfigError {
    fn from(error: MachineError) -> Self {
        Self::Machine(error)
    }
}

impl Config {
    /// The scene's pose, when it has been measured.
    #[must_use]
    pub fn cam_from_scene(&self) -> Option<Pose<Cam, Scene>> {
        self.cam_from_scene_theta.map(Pose::from_theta)
    }

    /// Checks every value, and that they are consistent.
    ///
    /// # Errors
    /// The first [`ConfigError`] found.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.check_texts()?;
        self.lens.check()?;
        self.check_readout()?;
        self.check_targets()?;
        if let Some(theta) = &self.cam_from_scene_theta {
            let (angles_rad, distances_mm) = theta.split_at(3);
            let turns = angles_rad.iter().all(|angle| angle.abs() <= core::f64::consts::TAU);
            if !turns || !distances_mm.iter().all(|distance| distance.abs() < 100_000.0) {
                return Err(ConfigError::Scene);
            }
        }
        if let Some(address) = &self.links.udp
            && (address.port() == 0 || address.ip().is_unspecified())
        {
            return Err(ConfigError::Udp);
        }
        if let Some(serial) = &self.links.serial
            && (serial.path.is_empty() || !(1_200..=12_000_000).contains(&serial.baud))
        {
            return Err(ConfigError::Serial);
        }
        if let Some(capture) = &self.capture {
            capture.check()?;
        }
        self.machine.check()?;
        if let Some(trigger) = &self.trigger {
            trigger.check()?;
        }
        Ok(())
    }

    fn check_texts(&self) -> Result<(), ConfigError> {
        let camera = self.capture.as_ref().map_or("", |capture| &capture.device);
        let line = self.links.serial.as_ref().map_or("", |serial| &serial.path);
        let chip = self.trigger.as_ref().map_or("", |trigger| &trigger.chip);
        let texts = [
            ("device", self.device.as_str()),
            ("serial_number", &self.serial_number),
            ("capture.device", camera),
            ("links.serial", line),
            ("trigger.chip", chip),
        ];
        match texts.into_iter().find(|(_, text)| !is_readable(text)) {
            Some((field, _)) => Err(ConfigError::Text { field }),
            None => Ok(()),
        }
    }

    fn check_readout(&self) -> Result<(), ConfigError> {
        let readout_ns = self.readout_ns.unsigned_abs();
        let interval_ns = self.capture.as_ref().map(|capture| 1e9 / f64::from(capture.rate_hz));
        let is_longer = |interval_ns| f64::from(readout_ns) > READOUT_OF_INTERVAL_MAX * interval_ns;
        if readout_ns > READOUT_NS_MAX.unsigned_abs() || interval_ns.is_some_and(is_longer) {
            return Err(ConfigError::Readout);
        }
        Ok(())
    }

    fn check_targets(&self) -> Result<(), ConfigError> {
        if self.targets.is_empty() {
            return Err(ConfigError::NoTarget);
        }
        for (second, target) in self.targets.iter().enumerate() {
            if target.name.is_empty() || !is_readable(&target.name) {
                return Err(ConfigError::TargetName { index: second });
            }
            for (first, earlier) in self.targets[..second].iter().enumerate() {
                if earlier.name == target.name {
                    return Err(ConfigError::SameName { first, second });
                }
                if earlier.geometry.role() == target.geometry.role() {
                    return Err(ConfigError::SameRole { first, second });
                }
                if sides(&earlier.geometry) == sides(&target.geometry) {
                    return Err(ConfigError::SameShape { first, second });
                }
            }
        }
        Ok(())
    }

    /// The target with a role.
    #[must_use]
    pub fn target(&self, role: Role) -> Option<&TargetConfig> {
        self.targets.iter().find(|target| target.geometry.role() == role)
    }

    /// Writes the blob. A buffer of [`BLOB_BYTES_MAX`] is large enough for any.
    ///
    /// # Errors
    /// What [`check`](Self::check) finds, or [`ConfigError::BufferTooSmall`].
    pub fn encode<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], ConfigError> {
        self.check()?;
        let small = ConfigError::BufferTooSmall;
        let (header, rest) = buffer.split_first_chunk_mut::<HEADER_BYTES>().ok_or(small)?;
        let body_bytes = postcard::to_slice(self, rest).map_err(|_| small)?.len();
        *header = self::header(body_bytes);
        let covered = HEADER_BYTES + body_bytes;
        let blob = buffer.get_mut(..covered + CRC_BYTES).ok_or(small)?;
        let checksum = CRC32.checksum(&blob[..covered]);
        blob[covered..].copy_from_slice(&checksum.to_le_bytes());
        Ok(blob)
    }

    /// Reads a blob.
    ///
    /// # Errors
    /// Any [`ConfigError`]: the blob, its body, or what [`check`](Self::check) finds.
    pub fn decode(blob: &[u8]) -> Result<Self, ConfigError> {
        let Some((header, _)) = blob.split_first_chunk::<HEADER_BYTES>() else {
            return Err(ConfigError::NotAConfig);
        };
        let [m0, m1, m2, m3, v0, v1, l0, l1, l2, l3] = *header;
        if [m0, m1, m2, m3] != MAGIC {
            return Err(ConfigError::NotAConfig);
        }
        let body_bytes = u32::from_le_bytes([l0, l1, l2, l3]) as usize;
        let expected = body_bytes.saturating_add(HEADER_BYTES + CRC_BYTES);
        if blob.len() != expected {
            return Err(ConfigError::Length { expected, found: blob.len() });
        }
        let Some((covered, true)) = checked(blob) else {
            return Err(ConfigError::Checksum);
        };
        let found = u16::from_le_bytes([v0, v1]);
        if found != FORMAT_VERSION {
            return Err(ConfigError::Version { found });
        }
        let Ok((config, [])) = postcard::take_from_bytes::<Self>(&covered[HEADER_BYTES..]) else {
            return Err(ConfigError::Body);
        };
        config.check()?;
        Ok(config)
    }

    /// The blob's checksum, by which a host recognises which configuration a box runs.
    #[must_use]
    pub fn crc(&self) -> u32 {
        // Neither pass can fail: both sinks take every byte, and every type here
        // knows its length.
        let body_bytes = postcard::serialize_with_flavor(self, Size::default()).unwrap_or(0);
        let mut digest = CRC32.digest();
        digest.update(&header(body_bytes));
        postcard::serialize_with_flavor(self, Digested(digest)).unwrap_or(0)
    }
}

fn is_readable(text: &str) -> bool {
    text.chars().all(is_visible)
}

fn header(body_bytes: usize) -> [u8; HEADER_BYTES] {
    let [m0, m1, m2, m3] = MAGIC;
    let [v0, v1] = FORMAT_VERSION.to_le_bytes();
    let [l0, l1, l2, l3] = (body_bytes as u32).to_le_bytes();
    [m0, m1, m2, m3, v0, v1, l0, l1, l2, l3]
}

/// The two sides of a grid, the longer first: to a camera, a grid rotated by a quarter turn is the
/// same grid.
fn sides(geometry: &TargetGeometry) -> (usize, usize) {
    let (columns, rows) = (geometry.columns(), geometry.rows());
    (columns.max(rows), columns.min(rows))
}

/// A sink that only computes the checksum.
struct Digested(crc::Digest<'static, u32>);

impl Flavor for Digested {
    type Output = u32;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.0.update(&[byte]);
        Ok(())
    }

    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.0.update(bytes);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<u32> {
        Ok(self.0.finalize())
    }
}

#[cfg(test)]
mod tests;
