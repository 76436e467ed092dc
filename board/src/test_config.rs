//! A configuration that a box can run with.

use plumbline::config::{
    Capture, CaptureDriver, Config, Links, Machine, PixelFormat, TargetConfig,
};
use plumbline::lens::{Distortion, Lens};
use plumbline::target::{Origin, Role, TargetGeometry};

pub fn config() -> Config {
    let geometry =
        TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Lower, [0.0; 3]).unwrap();
    let target = TargetConfig { name: "lumbar".try_into().unwrap(), geometry };
    Config {
        device: "ward 3".try_into().unwrap(),
        serial_number: heapless::String::new(),
        lens: Lens {
            width_px: 640,
            height_px: 480,
            fx_px: 500.0,
            fy_px: 500.0,
            cx_px: 319.5,
            cy_px: 239.5,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        },
        readout_ns: 0,
        targets: [target].into_iter().collect(),
        cam_from_scene_theta: None,
        links: Links { udp: Some("127.0.0.1:4210".parse().unwrap()), serial: None },
        capture: Some(Capture {
            driver: CaptureDriver::V4l2,
            device: heapless::String::new(),
            pixel_format: PixelFormat::Grey,
            rate_hz: 60.0,
            exposure_us: None,
            gain: None,
        }),
        machine: Machine::default(),
        trigger: None,
    }
}
