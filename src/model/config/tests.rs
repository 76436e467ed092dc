extern crate std;

use core::net::Ipv4Addr;
use std::string::ToString;
use std::vec::Vec as StdVec;

use super::*;
use crate::model::lens::Distortion;
use crate::model::target::Origin;
use crate::test_support::repetitions;

mod bounds;
mod words;

fn target(name: &str, columns: u8, rows: u8, role: Role) -> TargetConfig {
    let geometry =
        TargetGeometry::checker(columns, rows, 12.0, Origin::Center, role, [0.0, 0.0, 100.0]);
    TargetConfig { name: name.try_into().unwrap(), geometry: geometry.unwrap() }
}

const FIXED: Network = Network::Static {
    address: Ipv4Addr::new(192, 168, 7, 2),
    prefix_bits: 24,
    gateway: Some(Ipv4Addr::new(192, 168, 7, 1)),
};

fn config() -> Config {
    Config {
        device: "ward 3".try_into().unwrap(),
        serial_number: "PL-0001".try_into().unwrap(),
        lens: Lens {
            width_px: 1456,
            height_px: 1088,
            fx_px: 1740.0,
            fy_px: 1741.0,
            cx_px: 727.5,
            cy_px: 543.5,
            skew_px: 0.0,
            distortion: Distortion::Brown5([-0.1, 0.02, 0.0, 0.0, 0.0]),
        },
        readout_ns: 16_000_000,
        targets: [target("shoulder", 5, 4, Role::Upper), target("lumbar", 6, 5, Role::Lower)]
            .into_iter()
            .collect(),
        cam_from_scene_theta: Some([0.0, 0.1, -0.2, 10.0, 400.0, 1500.0]),
        links: Links {
            udp: Some("192.168.7.1:4210".parse().unwrap()),
            serial: Some(SerialLink {
                path: "/dev/ttyS0".try_into().unwrap(),
                baud: 115_200,
                one_way: false,
            }),
        },
        capture: Some(Capture {
            driver: CaptureDriver::V4l2,
            device: "/dev/video0".try_into().unwrap(),
            pixel_format: PixelFormat::Grey,
            rate_hz: 60.0,
            exposure_us: Some(4_000),
            gain: Some(2.0),
        }),
        machine: Machine {
            network: FIXED,
            realtime_priority: Some(50),
            cpu: Some(3),
            watchdog_s: Some(15),
        },
        trigger: Some(TriggerLines {
            chip: "pinctrl-bcm2711".try_into().unwrap(),
            input: Some(TriggerInput { line: 17, edges: Edges::Rising, debounce_us: 5_000 }),
            output: Some(TriggerOutput { line: 27, marks: Marked::Exposures }),
        }),
    }
}

fn trigger(config: &mut Config) -> &mut TriggerLines {
    config.trigger.as_mut().unwrap()
}

fn capture(config: &mut Config) -> &mut Capture {
    config.capture.as_mut().unwrap()
}

fn fixed(address: Ipv4Addr, prefix_bits: u8) -> Network {
    Network::Static { address, prefix_bits, gateway: None }
}

fn blob(config: &Config) -> StdVec<u8> {
    config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec()
}

/// A body with its header and a correct checksum.
fn sealed(version: u16, body: &[u8]) -> StdVec<u8> {
    let mut blob = header(body.len()).to_vec();
    blob[4..6].copy_from_slice(&version.to_le_bytes());
    blob.extend(body);
    blob.extend(CRC32.checksum(&blob).to_le_bytes());
    blob
}

#[test]
fn a_config_comes_back_and_its_checksum_names_it() {
    let config = config();
    let blob = blob(&config);
    assert_eq!(Config::decode(&blob), Ok(config.clone()));
    assert_eq!(config.crc().to_le_bytes(), blob[blob.len() - 4..]);
    let mut other = config.clone();
    other.lens.fx_px += 1e-9;
    assert_ne!(other.crc(), config.crc());
    assert_eq!(config.target(Role::Lower).unwrap().name, "lumbar");
    assert_eq!(config.target(Role::Scene), None);
}

#[test]
fn the_scenes_pose_is_that_of_its_six_numbers() {
    let mut config = config();
    let theta = config.cam_from_scene().unwrap().theta();
    // The angles go through a rotation matrix.
    let is_near = |(is, from): (f64, f64)| (is - from).abs() < 1e-15;
    assert!(theta.into_iter().zip([0.0, 0.1, -0.2]).all(is_near), "{theta:?}");
    assert_eq!(theta[3..], [10.0, 400.0, 1500.0]);
    config.cam_from_scene_theta = None;
    assert_eq!(config.cam_from_scene(), None);
}

/// A format's number is its place in the enumeration: new ones go to the end, and the blobs on
/// boxes keep their meaning and their version.
#[test]
fn pixel_formats_keep_their_numbers() {
    use PixelFormat::{Bayer8, Grey, Mjpeg, Nv12, Rgb24, Y10, Y16, Yuyv};
    for (number, format) in (0_u8..).zip([Grey, Y10, Y16, Yuyv, Nv12, Rgb24, Bayer8, Mjpeg]) {
        assert_eq!(postcard::to_slice(&format, &mut [0; 8]).unwrap(), [number], "{format:?}");
    }
    assert!(postcard::from_bytes::<PixelFormat>(&[8]).is_err());
}

#[test]
fn the_largest_config_fits_its_buffer() {
    let mut config = config();
    let most = TARGET_CORNERS_MAX as u8;
    config.targets = [
        target("0123456789abcdef", most / 8, 8, Role::Upper),
        target("123456789abcdef0", most / 4, 4, Role::Lower),
        target("23456789abcdef01", most / 3, 3, Role::Scene),
    ]
    .into_iter()
    .collect();
    config.lens.distortion = Distortion::ThinPrism12([1e-9; 12]);
    config.readout_ns = -1_000_000_000;
    config.device = "012345678901234567890123".try_into().unwrap();
    config.serial_number = config.device.clone();
    let path: String<DEVICE_PATH_BYTES_MAX> =
        core::iter::repeat_n('x', DEVICE_PATH_BYTES_MAX).collect();
    let capture = config.capture.as_mut().unwrap();
    capture.device = path.clone();
    capture.rate_hz = 1.0;
    capture.exposure_us = Some(1_000_000);
    config.links.serial = Some(SerialLink { path, baud: 12_000_000, one_way: true });
    config.machine.watchdog_s = Some(WATCHDOG_S_MAX);
    *trigger(&mut config) = TriggerLines {
        chip: core::iter::repeat_n('x', DEVICE_PATH_BYTES_MAX).collect(),
        input: Some(TriggerInput {
            line: LINE_MAX,
            edges: Edges::Both,
            debounce_us: DEBOUNCE_US_MAX,
        }),
        output: Some(TriggerOutput { line: LINE_MAX - 1, marks: Marked::Recording }),
    };
    config.links.udp = Some("[1:2:3:4:5:6:7:8]:65535".parse().unwrap());
    let length = blob(&config).len();
    // Within a few bytes of the formula: neither too small nor idly large.
    assert!(length <= BLOB_BYTES_MAX && BLOB_BYTES_MAX - length < 64, "{length}");
    for target in &config.targets {
        let bytes = postcard::to_slice(target, &mut [0; BLOB_BYTES_MAX]).unwrap().len();
        // The number of corners has one byte, and might have two.
        assert_eq!(FIXED_BYTES_MAX + TARGETS_MAX * (bytes + 1), BLOB_BYTES_MAX);
    }
    for short in 0..length {
        let mut buffer = std::vec![0; short];
        // Checking the lens each time is slow; the ends tell enough.
        if short < 40 || short > length - 10 {
            assert_eq!(config.encode(&mut buffer), Err(ConfigError::BufferTooSmall), "{short}");
        }
    }
}

#[test]
fn every_fault_of_a_value_is_named() {
    type Change = fn(&mut Config);
    let table: [(Change, ConfigError); 38] = [
        (|c| c.device.push('\u{1b}').unwrap(), ConfigError::Text { field: "device" }),
        (
            |c| c.serial_number.push('\u{202e}').unwrap(),
            ConfigError::Text { field: "serial_number" },
        ),
        (
            |c| c.capture.as_mut().unwrap().device.push('\n').unwrap(),
            ConfigError::Text { field: "capture.device" },
        ),
        (
            |c| c.links.serial.as_mut().unwrap().path.push('\u{2028}').unwrap(),
            ConfigError::Text { field: "links.serial" },
        ),
        (|c| c.lens.fx_px = f64::NAN, ConfigError::Lens(LensError::FocalLength)),
        (|c| (c.readout_ns, c.capture) = (1_000_000_001, None), ConfigError::Readout),
        (|c| (c.readout_ns, c.capture) = (i32::MIN, None), ConfigError::Readout),
        // At 60 Hz a frame is there every 16.67 ms.
        (|c| c.readout_ns = -17_010_000, ConfigError::Readout),
        (|c| c.targets.clear(), ConfigError::NoTarget),
        (|c| c.targets[1].name.clear(), ConfigError::TargetName { index: 1 }),
        (|c| c.targets[0].name.push('\n').unwrap(), ConfigError::TargetName { index: 0 }),
        (|c| c.targets[0].name.push('\u{200b}').unwrap(), ConfigError::TargetName { index: 0 }),
        (
            |c| c.targets[1].name = c.targets[0].name.clone(),
            ConfigError::SameName { first: 0, second: 1 },
        ),
        (
            |c| c.targets[1] = target("a", 6, 5, Role::Upper),
            ConfigError::SameRole { first: 0, second: 1 },
        ),
        (
            |c| c.targets[1] = target("a", 5, 4, Role::Lower),
            ConfigError::SameShape { first: 0, second: 1 },
        ),
        // The same grid, turned by a quarter.
        (
            |c| c.targets[1] = target("a", 4, 5, Role::Lower),
            ConfigError::SameShape { first: 0, second: 1 },
        ),
        (|c| c.cam_from_scene_theta = Some([f64::NAN; 6]), ConfigError::Scene),
        (|c| c.cam_from_scene_theta = Some([7.0, 0.0, 0.0, 0.0, 0.0, 0.0]), ConfigError::Scene),
        (|c| c.links.udp = Some("1.2.3.4:0".parse().unwrap()), ConfigError::Udp),
        (|c| c.links.udp = Some("0.0.0.0:4210".parse().unwrap()), ConfigError::Udp),
        (|c| c.links.serial.as_mut().unwrap().baud = 0, ConfigError::Serial),
        (|c| c.links.serial.as_mut().unwrap().path.clear(), ConfigError::Serial),
        (
            |c| {
                capture(c).driver = CaptureDriver::Libcamera;
                capture(c).pixel_format = PixelFormat::Mjpeg;
            },
            ConfigError::Capture(CaptureError::PixelFormat),
        ),
        (|c| capture(c).rate_hz = f32::NAN, ConfigError::Capture(CaptureError::Rate)),
        (|c| capture(c).exposure_us = Some(0), ConfigError::Capture(CaptureError::Exposure)),
        // At 60 Hz a frame lasts 16,667 us.
        (|c| capture(c).exposure_us = Some(16_700), ConfigError::Capture(CaptureError::Exposure)),
        (|c| capture(c).gain = Some(-1.0), ConfigError::Capture(CaptureError::Gain)),
        (
            |c| c.machine.network = fixed(Ipv4Addr::UNSPECIFIED, 24),
            ConfigError::Machine(MachineError::Network),
        ),
        (
            |c| c.machine.network = fixed(Ipv4Addr::new(10, 0, 0, 1), 31),
            ConfigError::Machine(MachineError::Network),
        ),
        (
            |c| c.machine.realtime_priority = Some(100),
            ConfigError::Machine(MachineError::RealtimePriority),
        ),
        (|c| c.machine.watchdog_s = Some(0), ConfigError::Machine(MachineError::Watchdog)),
        (|c| trigger(c).chip.push('\u{7f}').unwrap(), ConfigError::Text { field: "trigger.chip" }),
        (|c| trigger(c).chip.clear(), ConfigError::Trigger(TriggerError::Chip)),
        (
            |c| (trigger(c).input, trigger(c).output) = (None, None),
            ConfigError::Trigger(TriggerError::NoLine),
        ),
        (
            |c| trigger(c).input.as_mut().unwrap().line = LINE_MAX + 1,
            ConfigError::Trigger(TriggerError::Line),
        ),
        (
            |c| trigger(c).input.as_mut().unwrap().debounce_us = DEBOUNCE_US_MAX + 1,
            ConfigError::Trigger(TriggerError::Debounce),
        ),
        (
            |c| trigger(c).output.as_mut().unwrap().line = LINE_MAX + 1,
            ConfigError::Trigger(TriggerError::OutputLine),
        ),
        // The line that is listened to.
        (
            |c| trigger(c).output.as_mut().unwrap().line = 17,
            ConfigError::Trigger(TriggerError::OutputLine),
        ),
    ];
    for (change, error) in table {
        let mut wrong = config();
        change(&mut wrong);
        assert_eq!(wrong.encode(&mut [0; BLOB_BYTES_MAX]), Err(error));
        // And a blob made by other means, with a correct checksum.
        let body = postcard::to_slice(&wrong, &mut [0; BLOB_BYTES_MAX]).unwrap().to_vec();
        assert_eq!(Config::decode(&sealed(FORMAT_VERSION, &body)), Err(error));
        assert!(!error.to_string().is_empty());
    }
}

#[test]
fn faults_of_the_blob_are_named() {
    let blob = blob(&config());
    let found = blob.len() - 1;
    assert_eq!(Config::decode(&[]), Err(ConfigError::NotAConfig));
    assert_eq!(Config::decode(&[0xff; 4096]), Err(ConfigError::NotAConfig));
    let cut = ConfigError::Length { expected: found + 1, found };
    assert_eq!(Config::decode(&blob[..found]), Err(cut));
    let body = &blob[HEADER_BYTES..blob.len() - CRC_BYTES];
    let newer = ConfigError::Version { found: FORMAT_VERSION + 1 };
    assert_eq!(Config::decode(&sealed(FORMAT_VERSION + 1, body)), Err(newer));
    let longer = [body, &[0]].concat();
    assert_eq!(Config::decode(&sealed(FORMAT_VERSION, &longer)), Err(ConfigError::Body));
    let all_ones = sealed(FORMAT_VERSION, &[0xff; 200]);
    assert_eq!(Config::decode(&all_ones), Err(ConfigError::Body));
}

#[test]
fn every_single_wrong_bit_of_a_blob_is_found() {
    let blob = blob(&config());
    for bit in 0..blob.len() * 8 {
        let mut wrong = blob.clone();
        wrong[bit / 8] ^= 1 << (bit % 8);
        assert!(Config::decode(&wrong).is_err(), "bit {bit}");
    }
}

#[test]
fn a_grid_that_contradicts_itself_is_refused_under_a_right_checksum() {
    let config = config();
    let blob = blob(&config);
    let body = &blob[HEADER_BYTES..blob.len() - CRC_BYTES];
    // The name ends where the geometry begins: columns, rows.
    let name = b"shoulder";
    let columns = body.windows(name.len()).position(|at| at == name).unwrap() + name.len();
    assert_eq!(body[columns..columns + 2], [5, 4]);
    for lie in [[5, 5], [6, 5], [10, 2], [0, 4], [255, 255]] {
        let mut wrong = body.to_vec();
        wrong[columns..columns + 2].copy_from_slice(&lie);
        assert_eq!(Config::decode(&sealed(FORMAT_VERSION, &wrong)), Err(ConfigError::Body));
    }
}

#[test]
fn no_blob_panics() {
    let blob = blob(&config());
    let body = &blob[HEADER_BYTES..blob.len() - CRC_BYTES];
    let mut state = 1_u64;
    let mut random = move |end: usize| {
        // The generator of Knuth's MMIX; the high bits are the good ones.
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % end
    };
    for _ in 0..repetitions(20_000) {
        let mut wrong = body.to_vec();
        for _ in 0..=random(3) {
            let at = random(wrong.len());
            wrong[at] = random(256) as u8;
        }
        wrong.truncate(wrong.len() - random(4) * random(2));
        if let Ok(config) = Config::decode(&sealed(FORMAT_VERSION, &wrong)) {
            assert_eq!(config.check(), Ok(()));
        }
    }
}
