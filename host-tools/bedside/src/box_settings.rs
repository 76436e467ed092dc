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

use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::path::Path;

use plumbline::config::{
    Capture, CaptureDriver, Config, Links, Machine, MachineError, Network, PixelFormat, SerialLink,
};
use plumbline_files::BadInput;
use plumbline_files::{from_toml, read_text};
use serde::{Deserialize, Serialize};

mod trigger;

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

const ADDRESS_WANTED: &str =
    "give a host's address with a prefix within 1 to 30, for example 192.168.1.30/24";

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
struct NetworkFields {
    address: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    gateway: Option<Ipv4Addr>,
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
        "address" => ADDRESS_WANTED,
        "gateway" => "give an address, for example 192.168.1.1, or leave it out",
        name => return trigger::wanted(name),
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
            network: match config.machine.network {
                Network::Dhcp => None,
                Network::Static { address, prefix_bits, gateway } => {
                    Some(NetworkFields { address: format!("{address}/{prefix_bits}"), gateway })
                }
            },
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
                Some(fields) => fixed(place, fields)?,
                None => Network::Dhcp,
            },
            realtime_priority: Some(self.machine.realtime_priority).filter(|it| *it > 0),
            cpu: self.machine.cpu,
            watchdog_s: Some(self.machine.watchdog_s).filter(|it| *it > 0),
        };
        // The check's own words know neither the file's zeros nor its tables.
        config.machine.check().map_err(|error| match error {
            MachineError::Network => network_fault(place, config.machine.network),
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

fn fixed(place: &str, fields: &NetworkFields) -> Result<Network, BadInput> {
    let parts = fields.address.split_once('/');
    let parts = parts.and_then(|(address, bits)| Some((address.parse().ok()?, bits.parse().ok()?)));
    let Some((address, prefix_bits)) = parts else {
        let found = format!("{:?}", fields.address);
        return Err(BadInput::new(place, "network.address", found, ADDRESS_WANTED));
    };
    let network = Network::Static { address, prefix_bits, gateway: fields.gateway };
    if let Some(gateway) = fields.gateway
        && !is_within(gateway, address, prefix_bits)
    {
        return Err(BadInput::new(
            place,
            "network.gateway",
            format!("{gateway} is not in the network of {}", fields.address),
            "give the router of that network, or leave it out",
        ));
    }
    Ok(network)
}

/// Both have the same leading bits; a prefix that is none is another fault.
fn is_within(gateway: Ipv4Addr, address: Ipv4Addr, prefix_bits: u8) -> bool {
    let differing = gateway.to_bits() ^ address.to_bits();
    prefix_bits > 32 || differing.leading_zeros() >= u32::from(prefix_bits)
}

/// Which of the two addresses a network is refused for.
fn network_fault(place: &str, network: Network) -> BadInput {
    let Network::Static { address, prefix_bits, gateway } = network else {
        unreachable!("an address by DHCP has nothing to refuse");
    };
    let alone = Network::Static { address, prefix_bits, gateway: None };
    match gateway {
        Some(gateway) if (Machine { network: alone, ..Machine::default() }).check().is_ok() => {
            BadInput::new(place, "network.gateway", gateway, "give the address of a router")
        }
        _ => {
            let found = format!("{address}/{prefix_bits}");
            BadInput::new(place, "network.address", found, ADDRESS_WANTED)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use plumbline::config::{Edges, Marked, TriggerInput, TriggerLines, TriggerOutput};

    use super::*;
    use plumbline_render::simulate::{Simulation, SimulationSettings};

    const WHOLE: &str = r#"
        device = "ward 3"
        serial_number = "PL-0001"
        [capture]
        driver = "libcamera"
        device = "imx296"
        pixel_format = "y10"
        rate_hz = 60
        exposure_us = 4000
        gain = 2.5
        [links]
        udp = "192.168.1.20:4210"
        serial = "/dev/ttyS0:115200"
        serial_one_way = true
        [network]
        address = "192.168.1.30/24"
        gateway = "192.168.1.1"
        [machine]
        realtime_priority = 0
        cpu = 3
        watchdog_s = 0
        [trigger]
        chip = "pinctrl-bcm2711"
        line = 17
        edge = "both"
        debounce_us = 5000
        output_line = 27
        output_marks = "recording"
    "#;

    /// Any configuration will do.
    static CONFIG: LazyLock<Config> =
        LazyLock::new(|| Simulation::new(&SimulationSettings::default()).unwrap().config());

    fn applied(text: &str) -> Result<Config, BadInput> {
        let mut config = CONFIG.clone();
        parse(text, "box.toml")?.apply(&mut config, "box.toml")?;
        Ok(config)
    }

    #[test]
    fn every_field_arrives() {
        let config = applied(WHOLE).unwrap();
        assert_eq!((config.device.as_str(), config.serial_number.as_str()), ("ward 3", "PL-0001"));
        let expected = Capture {
            driver: CaptureDriver::Libcamera,
            device: "imx296".try_into().unwrap(),
            pixel_format: PixelFormat::Y10,
            rate_hz: 60.0,
            exposure_us: Some(4000),
            gain: Some(2.5),
        };
        assert_eq!(config.capture, Some(expected));
        assert_eq!(config.links.udp, Some("192.168.1.20:4210".parse().unwrap()));
        let line = config.links.serial.as_ref().unwrap();
        assert_eq!((line.path.as_str(), line.baud), ("/dev/ttyS0", 115_200));
        assert!(line.one_way);
        let network = Network::Static {
            address: Ipv4Addr::new(192, 168, 1, 30),
            prefix_bits: 24,
            gateway: Some(Ipv4Addr::new(192, 168, 1, 1)),
        };
        let expected = Machine { network, realtime_priority: None, cpu: Some(3), watchdog_s: None };
        assert_eq!(config.machine, expected);
        let expected = TriggerLines {
            chip: "pinctrl-bcm2711".try_into().unwrap(),
            input: Some(TriggerInput { line: 17, edges: Edges::Both, debounce_us: 5000 }),
            output: Some(TriggerOutput { line: 27, marks: Marked::Recording }),
        };
        assert_eq!(config.trigger, Some(expected));
        // And back.
        let again = BoxSettings::of(&config);
        assert_eq!(parse(&again.to_toml(), "box.toml").unwrap(), again);
    }

    #[test]
    fn what_is_left_out_has_a_sensible_value() {
        let config = applied("").unwrap();
        assert_eq!(config.capture, None);
        assert_eq!(config.links, Links::default());
        let expected = Machine {
            network: Network::Dhcp,
            realtime_priority: Some(REALTIME_PRIORITY),
            cpu: None,
            watchdog_s: Some(WATCHDOG_S),
        };
        assert_eq!(config.machine, expected);
        assert_eq!(parse("", "box.toml").unwrap(), BoxSettings::default());
        assert_eq!(config.trigger, None);
        let config = applied("[trigger]\nchip = \"/dev/gpiochip0\"\nline = 4").unwrap();
        let input = TriggerInput { line: 4, edges: Edges::Rising, debounce_us: 0 };
        let lines = config.trigger.unwrap();
        assert_eq!((lines.input, lines.output), (Some(input), None));
    }

    #[test]
    fn a_bad_field_is_named() {
        for (good, bad, field) in [
            ("device = \"ward 3\"", "device = \"a name of more than 24 bytes\"", "device"),
            ("\"libcamera\"", "\"gphoto\"", "driver"),
            ("\"y10\"", "\"rgb\"", "pixel_format"),
            ("rate_hz = 60", "", "rate_hz"),
            ("gain = 2.5", "gains = 2.5", "gains"),
            ("1.20:4210", "1.20", "links.udp"),
            ("ttyS0:115200", "ttyS0", "links.serial"),
            ("serial = \"/dev/ttyS0:115200\"", "", "links.serial_one_way"),
            ("1.30/24", "1.30", "network.address"),
            ("\"192.168.1.1\"", "\"the router\"", "gateway"),
            ("watchdog_s = 0", "watchdog_s = -1", "watchdog_s"),
            ("watchdog_s = 0", "watchdog_s = 601", "machine.watchdog_s"),
            ("realtime_priority = 0", "realtime_priority = 100", "machine.realtime_priority"),
            ("1.30/24", "1.30/33", "network.address"),
            ("192.168.1.30/24", "0.0.0.0/24", "network."),
            ("192.168.1.1\"", "192.168.2.1\"", "network.gateway"),
            ("1.30/24", "1.30/30", "network.gateway"),
            ("chip = \"pinctrl-bcm2711\"", "chip = \"\"", "trigger.chip"),
            ("line = 17", "line = 1024", "trigger.line"),
            ("\"both\"", "\"up\"", "edge"),
            ("debounce_us = 5000", "debounce_us = 1000001", "trigger.debounce_us"),
            ("output_line = 27", "output_line = 17", "trigger.output_line"),
            ("\"recording\"", "\"frames\"", "output_marks"),
            ("output_line = 27", "lines = 27", "lines"),
        ] {
            let text = WHOLE.replacen(good, bad, 1);
            assert_ne!(text, WHOLE);
            let error = applied(&text).unwrap_err();
            assert!(error.field.starts_with(field), "{field}: {error}");
        }
    }

    #[test]
    fn what_a_field_takes_is_said() {
        for (good, bad, wanted) in [
            ("\"y10\"", "3", "\"bayer8\" or \"mjpeg\""),
            ("= 4000", "= -4", "whole microseconds above 0"),
            ("\"libcamera\"", "7", "\"v4l2\""),
            ("cpu = 3", "cpu = \"last\"", "from 0"),
            ("realtime_priority = 0", "realtime_priority = 100", "0 for none"),
            ("watchdog_s = 0", "watchdog_s = 601", "0 for none"),
            ("\"both\"", "7", "\"falling\" or \"both\""),
            ("line = 17", "line = -1", "from 0"),
        ] {
            let error = applied(&WHOLE.replacen(good, bad, 1)).unwrap_err();
            assert!(error.remedy.contains(wanted), "{wanted}: {error}");
        }
    }
}
