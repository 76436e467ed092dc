//! `box.toml`: the box's name, its camera's settings, its links, its computer.
//!
//! ```toml
//! device = "ward 3"
//! serial_number = "PL-0001"
//!
//! [capture]
//! driver = "v4l2"                # or "libcamera"
//! device = "/dev/video0"         # left out: the first camera that can do this
//! pixel_format = "grey"          # "grey", "y10", "y16", "yuyv", "nv12", "rgb24", "bayer8", "mjpeg"
//! rate_hz = 60.0
//! exposure_us = 4000             # left out: as the camera has it
//! gain = 2.0                     # the driver's steps (v4l2) or a factor (libcamera)
//!
//! [links]
//! udp = "192.168.1.20:4210"
//! serial = "/dev/ttyS0:115200"
//! serial_one_way = false         # true: nothing comes back on the line, not even requests
//!
//! [network]                      # left out: an address by DHCP
//! address = "192.168.1.30/24"
//! gateway = "192.168.1.1"
//!
//! [machine]
//! realtime_priority = 50         # 0: none
//! cpu = 3                        # left out: any core
//! watchdog_s = 15                # 0: none
//!
//! [trigger]                      # left out: no wires to other devices
//! chip = "pinctrl-bcm2711"       # the GPIO chip's label, or a device such as "/dev/gpiochip0"
//! line = 17                      # edges here are marks; left out: none
//! edge = "rising"                # "falling" or "both"
//! debounce_us = 0                # for a contact that bounces, such as 5000
//! output_line = 27               # left out: nothing is marked
//! output_marks = "exposures"     # a pulse for each frame; or "recording": high during a trial
//! ```
//!
//! Everything may be left out but `driver`, `pixel_format` and `rate_hz` of a capture, and the `chip`
//! of a trigger.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::Path;

use plumbline::config::{
    Capture, CaptureDriver, Config, Links, Machine, MachineError, Network, PixelFormat, SerialLink,
};
use plumbline_files::BadInput;
use plumbline_files::{from_toml, read_text};
use serde::{Deserialize, Serialize};

mod network;
mod trigger;

use network::NetworkFields;
use trigger::TriggerFields;

/// A box file with every setting explained, to be edited.
pub const NEW_BOX: &str = include_str!("box_settings/box.toml");

const REMEDY: &str = "a box file has device, serial_number and the tables [capture] (driver, device, pixel_format, rate_hz, exposure_us, gain), [links] (udp, serial, serial_one_way), [network] (address, gateway), [machine] (realtime_priority, cpu, watchdog_s) and [trigger] (chip, line, edge, debounce_us, output_line, output_marks)";

/// Above the computer's other programs, below the kernel's own threads.
const REALTIME_PRIORITY: u8 = 50;

/// The Raspberry Pi's watchdog waits at most this long.
const WATCHDOG_S: u16 = 15;

/// The name of a box that has not been named.
const DEVICE: &str = "plumbline";
const SERIAL_NUMBER: &str = "0";

const REALTIME_PRIORITY_WANTED: &str = "give 1 to 99, or 0 for none";

const WATCHDOG_WANTED: &str = "give 1 to 600 seconds, or 0 for none";

/// The settings of one box, as its file gives them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSettings {
    #[serde(default = "default_device")]
    device: String,
    #[serde(default = "default_serial_number")]
    serial_number: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    capture: Option<CaptureFields>,
    #[serde(default)]
    links: LinkFields,
    #[serde(skip_serializing_if = "Option::is_none")]
    network: Option<NetworkFields>,
    #[serde(default)]
    machine: MachineFields,
    #[serde(skip_serializing_if = "Option::is_none")]
    trigger: Option<TriggerFields>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CaptureFields {
    #[serde(with = "DriverName")]
    driver: CaptureDriver,
    #[serde(default)]
    device: String,
    #[serde(with = "PixelFormatName")]
    pixel_format: PixelFormat,
    rate_hz: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    exposure_us: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gain: Option<f32>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "CaptureDriver", rename_all = "snake_case")]
enum DriverName {
    V4l2,
    Libcamera,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "PixelFormat", rename_all = "snake_case")]
enum PixelFormatName {
    Grey,
    Y10,
    Y16,
    Yuyv,
    Nv12,
    Rgb24,
    Bayer8,
    Mjpeg,
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LinkFields {
    #[serde(skip_serializing_if = "Option::is_none")]
    udp: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    serial: Option<String>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    serial_one_way: bool,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MachineFields {
    #[serde(default = "default_realtime_priority")]
    realtime_priority: u8,
    #[serde(skip_serializing_if = "Option::is_none")]
    cpu: Option<u8>,
    #[serde(default = "default_watchdog_s")]
    watchdog_s: u16,
}

impl Default for MachineFields {
    fn default() -> Self {
        Self { realtime_priority: REALTIME_PRIORITY, cpu: None, watchdog_s: WATCHDOG_S }
    }
}

impl Default for BoxSettings {
    fn default() -> Self {
        Self {
            device: default_device(),
            serial_number: default_serial_number(),
            capture: None,
            links: LinkFields::default(),
            network: None,
            machine: MachineFields::default(),
            trigger: None,
        }
    }
}

fn default_device() -> String {
    DEVICE.into()
}

fn default_serial_number() -> String {
    SERIAL_NUMBER.into()
}

fn default_realtime_priority() -> u8 {
    REALTIME_PRIORITY
}

fn default_watchdog_s() -> u16 {
    WATCHDOG_S
}

/// Whether a box has not been named yet.
#[must_use]
pub fn is_unnamed(device: &str, serial_number: &str) -> bool {
    (device, serial_number) == (DEVICE, SERIAL_NUMBER)
}

/// Whether a box has a serial number of its own.
#[must_use]
pub fn is_serial_number(serial_number: &str) -> bool {
    !["", SERIAL_NUMBER].contains(&serial_number)
}

/// The settings of a file.
///
/// # Errors
/// When the file cannot be read, or a field is missing, unknown or of another type.
pub fn read(path: &Path) -> Result<BoxSettings, BadInput> {
    parse(&read_text(path)?, &path.display().to_string())
}

/// The settings of a file's text; `place` names it in errors.
///
/// # Errors
/// When a field is missing, unknown or of another type.
pub fn parse(text: &str, place: &str) -> Result<BoxSettings, BadInput> {
    from_toml(text, place, REMEDY).map_err(|mut error| {
        let name = error.field.split(' ').next().unwrap_or_default();
        if let Some(wanted) = wanted(name) {
            error.remedy = wanted.into();
        }
        error
    })
}

/// What a field takes, for whoever gave it something of another kind.
fn wanted(name: &str) -> Option<&'static str> {
    Some(match name {
        "driver" => "give \"v4l2\" or \"libcamera\"",
        "pixel_format" => {
            "give \"grey\", \"y10\", \"y16\", \"yuyv\", \"nv12\", \"rgb24\", \"bayer8\" or \"mjpeg\""
        }
        "rate_hz" => "give frames per second, for example 60.0",
        "exposure_us" => {
            "give whole microseconds above 0, for example 4000; left out, it is as the camera has it"
        }
        "gain" => "give a number of 0 or more; left out, it is as the camera has it",
        "realtime_priority" => REALTIME_PRIORITY_WANTED,
        "cpu" => "give the number of a core, from 0; left out, it is any",
        "watchdog_s" => WATCHDOG_WANTED,
        name => return network::wanted(name).or_else(|| trigger::wanted(name)),
    })
}

impl BoxSettings {
    /// The settings that a configuration has.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        Self {
            device: config.device.to_string(),
            serial_number: config.serial_number.to_string(),
            capture: config.capture.as_ref().map(|capture| CaptureFields {
                driver: capture.driver,
                device: capture.device.to_string(),
                pixel_format: capture.pixel_format,
                rate_hz: capture.rate_hz,
                exposure_us: capture.exposure_us,
                gain: capture.gain,
            }),
            links: LinkFields {
                udp: config.links.udp.map(|address| address.to_string()),
                serial: config.links.serial.as_ref().map(|it| format!("{}:{}", it.path, it.baud)),
                serial_one_way: config.links.serial.as_ref().is_some_and(|it| it.one_way),
            },
            network: NetworkFields::of(config.machine.network),
            machine: MachineFields {
                realtime_priority: config.machine.realtime_priority.unwrap_or(0),
                cpu: config.machine.cpu,
                watchdog_s: config.machine.watchdog_s.unwrap_or(0),
            },
            trigger: config.trigger.as_ref().map(TriggerFields::of),
        }
    }

    /// The box's name.
    #[must_use]
    pub fn device(&self) -> &str {
        &self.device
    }

    /// The box's number, by which its key is kept.
    #[must_use]
    pub fn serial_number(&self) -> &str {
        &self.serial_number
    }

    /// The file's text.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers and texts are TOML")
    }

    /// Puts the settings into a configuration; `place` names the file in errors.
    ///
    /// # Errors
    /// When a text is too long, an address cannot be understood, or the computer's
    /// settings are out of range. Other ranges are the configuration's own check.
    pub fn apply(&self, config: &mut Config, place: &str) -> Result<(), BadInput> {
        config.device = text(place, "device", &self.device)?;
        config.serial_number = text(place, "serial_number", &self.serial_number)?;
        config.capture = match &self.capture {
            Some(fields) => Some(Capture {
                driver: fields.driver,
                device: text(place, "capture.device", &fields.device)?,
                pixel_format: fields.pixel_format,
                rate_hz: fields.rate_hz,
                exposure_us: fields.exposure_us,
                gain: fields.gain,
            }),
            None => None,
        };
        config.links = Links {
            udp: self.links.udp.as_deref().map(|it| udp(place, "links.udp", it)).transpose()?,
            serial: match self.links.serial.as_deref() {
                Some(value) => {
                    let line = serial(place, "links.serial", value)?;
                    Some(SerialLink { one_way: self.links.serial_one_way, ..line })
                }
                None if self.links.serial_one_way => {
                    let remedy = "give links.serial as well, or leave it out";
                    let found = "true, without a serial line";
                    return Err(BadInput::new(place, "links.serial_one_way", found, remedy));
                }
                None => None,
            },
        };
        config.trigger = self.trigger.as_ref().map(|it| it.lines(place)).transpose()?;
        config.machine = Machine {
            network: match &self.network {
                Some(fields) => fields.network(place)?,
                None => Network::Dhcp,
            },
            realtime_priority: Some(self.machine.realtime_priority).filter(|it| *it > 0),
            cpu: self.machine.cpu,
            watchdog_s: Some(self.machine.watchdog_s).filter(|it| *it > 0),
        };
        // The check's own words know neither the file's zeros nor its tables.
        config.machine.check().map_err(|error| match error {
            MachineError::Network => network::fault(place, config.machine.network),
            MachineError::RealtimePriority => {
                let found = self.machine.realtime_priority;
                let field = "machine.realtime_priority";
                BadInput::new(place, field, found, REALTIME_PRIORITY_WANTED)
            }
            MachineError::Watchdog => {
                let found = self.machine.watchdog_s;
                BadInput::new(place, "machine.watchdog_s", found, WATCHDOG_WANTED)
            }
        })
    }
}

fn text<const N: usize>(
    place: &str,
    field: &str,
    value: &str,
) -> Result<heapless::String<N>, BadInput> {
    value.try_into().map_err(|_| {
        let found = format!("{value:?} has {} bytes", value.len());
        BadInput::new(place, field, found, format!("give at most {N} bytes"))
    })
}

/// A UDP destination; `place` and `field` name it in errors.
///
/// # Errors
/// When it is not `HOST:PORT`, or the host has no address.
pub fn udp(place: &str, field: &str, value: &str) -> Result<SocketAddr, BadInput> {
    let bad = |found: String| {
        BadInput::new(place, field, found, "give HOST:PORT, for example 192.168.1.20:4210")
    };
    let mut addresses =
        value.to_socket_addrs().map_err(|error| bad(format!("{value:?}: {error}")))?;
    addresses.next().ok_or_else(|| bad(format!("{value:?} has no address")))
}

/// A serial line; `place` and `field` name it in errors.
///
/// # Errors
/// When it is not `DEVICE:BAUD`, or the device's name is too long.
pub fn serial(place: &str, field: &str, value: &str) -> Result<SerialLink, BadInput> {
    let parts = value.rsplit_once(':').and_then(|(path, baud)| Some((path, baud.parse().ok()?)));
    let Some((path, baud)) = parts else {
        let remedy = "give DEVICE:BAUD, for example /dev/ttyS0:115200";
        return Err(BadInput::new(place, field, format!("{value:?}"), remedy));
    };
    Ok(SerialLink { path: text(place, field, path)?, baud, one_way: false })
}

#[cfg(test)]
mod tests;
