//! The last value that is allowed, and the first that is not.

use core::f64::consts::TAU;

use super::*;

type Change = fn(&mut Config);

const HOST: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 1);

fn pixels(config: &mut Config, driver: CaptureDriver, pixel_format: PixelFormat) {
    (capture(config).driver, capture(config).pixel_format) = (driver, pixel_format);
}

fn exposure_us(config: &mut Config, rate_hz: f32, exposure_us: u32) {
    (capture(config).rate_hz, capture(config).exposure_us) = (rate_hz, Some(exposure_us));
}

fn serial(config: &mut Config) -> &mut SerialLink {
    config.links.serial.as_mut().unwrap()
}

fn gateway(config: &mut Config, gateway: Ipv4Addr) {
    config.machine.network =
        Network::Static { address: HOST, prefix_bits: 24, gateway: Some(gateway) };
}

fn input(line: u16, debounce_us: u32) -> Option<TriggerInput> {
    Some(TriggerInput { line, edges: Edges::Both, debounce_us })
}

fn output(line: u16) -> Option<TriggerOutput> {
    Some(TriggerOutput { line, marks: Marked::Recording })
}

/// Each row: what is allowed, what is not, and why.
fn assert_bounds<const ROWS: usize>(table: [(Change, Change, ConfigError); ROWS]) {
    for (row, (allowed, refused, error)) in table.into_iter().enumerate() {
        let checked = |change: Change| {
            let mut config = config();
            change(&mut config);
            config.check()
        };
        assert_eq!(checked(allowed), Ok(()), "row {row}");
        assert_eq!(checked(refused), Err(error), "row {row}");
    }
}

#[test]
fn readout_scene_and_links_have_bounds() {
    assert_bounds([
        (
            |c| (c.readout_ns, c.capture) = (1_000_000_000, None),
            |c| (c.readout_ns, c.capture) = (1_000_000_001, None),
            ConfigError::Readout,
        ),
        (
            |c| (c.readout_ns, c.capture) = (-1_000_000_000, None),
            |c| (c.readout_ns, c.capture) = (-1_000_000_001, None),
            ConfigError::Readout,
        ),
        // At 50 Hz a frame is there every 20 ms: 2 % more.
        (
            |c| (c.readout_ns, capture(c).rate_hz) = (20_400_000, 50.0),
            |c| (c.readout_ns, capture(c).rate_hz) = (20_400_001, 50.0),
            ConfigError::Readout,
        ),
        (
            |c| c.cam_from_scene_theta = Some([TAU, -TAU, TAU, 0.0, 0.0, 0.0]),
            |c| c.cam_from_scene_theta = Some([0.0, 0.0, TAU.next_up(), 0.0, 0.0, 0.0]),
            ConfigError::Scene,
        ),
        (
            |c| c.cam_from_scene_theta = Some([0.0, 0.0, 0.0, 1e5_f64.next_down(), 0.0, 0.0]),
            |c| c.cam_from_scene_theta = Some([0.0, 0.0, 0.0, 1e5, 0.0, 0.0]),
            ConfigError::Scene,
        ),
        (
            |c| c.cam_from_scene_theta = Some([0.0, 0.0, 0.0, 0.0, 0.0, -1e5_f64.next_down()]),
            |c| c.cam_from_scene_theta = Some([0.0, 0.0, 0.0, 0.0, 0.0, -1e5]),
            ConfigError::Scene,
        ),
        (
            |c| c.links.udp = Some("[::1]:1".parse().unwrap()),
            |c| c.links.udp = Some("[::]:1".parse().unwrap()),
            ConfigError::Udp,
        ),
        (|c| serial(c).baud = 1_200, |c| serial(c).baud = 1_199, ConfigError::Serial),
        (|c| serial(c).baud = 12_000_000, |c| serial(c).baud = 12_000_001, ConfigError::Serial),
    ]);
}

#[test]
fn the_cameras_settings_have_bounds() {
    use CaptureDriver::{Libcamera, V4l2};
    let table: [(Change, Change, CaptureError); 9] = [
        (
            |c| pixels(c, V4l2, PixelFormat::Mjpeg),
            |c| pixels(c, Libcamera, PixelFormat::Mjpeg),
            CaptureError::PixelFormat,
        ),
        (
            |c| pixels(c, V4l2, PixelFormat::Bayer8),
            |c| pixels(c, Libcamera, PixelFormat::Bayer8),
            CaptureError::PixelFormat,
        ),
        (
            |c| pixels(c, Libcamera, PixelFormat::Nv12),
            |c| pixels(c, Libcamera, PixelFormat::Mjpeg),
            CaptureError::PixelFormat,
        ),
        (
            |c| capture(c).rate_hz = 1.0,
            |c| capture(c).rate_hz = 1.0_f32.next_down(),
            CaptureError::Rate,
        ),
        (
            |c| {
                c.readout_ns = 0;
                exposure_us(c, 1000.0, 1000);
            },
            |c| {
                c.readout_ns = 0;
                exposure_us(c, 1000.0_f32.next_up(), 1000);
            },
            CaptureError::Rate,
        ),
        // At 50 Hz a frame lasts 20 ms.
        (
            |c| exposure_us(c, 50.0, 20_000),
            |c| exposure_us(c, 50.0, 20_001),
            CaptureError::Exposure,
        ),
        (|c| exposure_us(c, 50.0, 1), |c| exposure_us(c, 50.0, 0), CaptureError::Exposure),
        (
            |c| capture(c).gain = Some(0.0),
            |c| capture(c).gain = Some(0.0_f32.next_down()),
            CaptureError::Gain,
        ),
        (
            |c| capture(c).gain = Some(f32::MAX),
            |c| capture(c).gain = Some(f32::INFINITY),
            CaptureError::Gain,
        ),
    ];
    assert_bounds(table.map(|(allowed, refused, why)| (allowed, refused, why.into())));
}

#[test]
fn the_computers_settings_have_bounds() {
    let table: [(Change, Change, MachineError); 9] = [
        (
            |c| c.machine.network = fixed(HOST, 1),
            |c| c.machine.network = fixed(HOST, 0),
            MachineError::Network,
        ),
        (
            |c| c.machine.network = fixed(HOST, 30),
            |c| c.machine.network = fixed(HOST, 31),
            MachineError::Network,
        ),
        // From 224.0.0.0 on an address is that of a group of hosts.
        (
            |c| c.machine.network = fixed(Ipv4Addr::new(223, 255, 255, 255), 24),
            |c| c.machine.network = fixed(Ipv4Addr::new(224, 0, 0, 0), 24),
            MachineError::Network,
        ),
        (
            |c| c.machine.network = fixed(Ipv4Addr::new(255, 255, 255, 254), 24),
            |c| c.machine.network = fixed(Ipv4Addr::BROADCAST, 24),
            MachineError::Network,
        ),
        (
            |c| gateway(c, Ipv4Addr::new(10, 0, 0, 254)),
            |c| gateway(c, Ipv4Addr::UNSPECIFIED),
            MachineError::Network,
        ),
        (
            |c| c.machine.realtime_priority = Some(1),
            |c| c.machine.realtime_priority = Some(0),
            MachineError::RealtimePriority,
        ),
        (
            |c| c.machine.realtime_priority = Some(99),
            |c| c.machine.realtime_priority = Some(100),
            MachineError::RealtimePriority,
        ),
        (
            |c| c.machine.watchdog_s = Some(1),
            |c| c.machine.watchdog_s = Some(0),
            MachineError::Watchdog,
        ),
        (
            |c| c.machine.watchdog_s = Some(WATCHDOG_S_MAX),
            |c| c.machine.watchdog_s = Some(WATCHDOG_S_MAX + 1),
            MachineError::Watchdog,
        ),
    ];
    assert_bounds(table.map(|(allowed, refused, why)| (allowed, refused, why.into())));
}

#[test]
fn the_wires_have_bounds() {
    let table: [(Change, Change, TriggerError); 5] = [
        // One of the two lines is enough.
        (
            |c| (trigger(c).input, trigger(c).output) = (input(0, 0), None),
            |c| (trigger(c).input, trigger(c).output) = (None, None),
            TriggerError::NoLine,
        ),
        (
            |c| trigger(c).input = input(LINE_MAX, 0),
            |c| trigger(c).input = input(LINE_MAX + 1, 0),
            TriggerError::Line,
        ),
        (
            |c| trigger(c).input = input(17, DEBOUNCE_US_MAX),
            |c| trigger(c).input = input(17, DEBOUNCE_US_MAX + 1),
            TriggerError::Debounce,
        ),
        (
            |c| (trigger(c).input, trigger(c).output) = (None, output(LINE_MAX)),
            |c| (trigger(c).input, trigger(c).output) = (None, output(LINE_MAX + 1)),
            TriggerError::OutputLine,
        ),
        (
            |c| (trigger(c).input, trigger(c).output) = (input(17, 0), output(18)),
            |c| (trigger(c).input, trigger(c).output) = (input(17, 0), output(17)),
            TriggerError::OutputLine,
        ),
    ];
    assert_bounds(table.map(|(allowed, refused, why)| (allowed, refused, why.into())));
}
