//! Box files that are read, written and refused.

use std::net::Ipv4Addr;
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
