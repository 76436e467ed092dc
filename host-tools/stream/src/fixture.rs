//! The messages of a healthy box, for tests that change them.

use std::io::Write;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use plumbline::config::{Capture, CaptureDriver, Config, PixelFormat};
use plumbline::packet::{
    CameraState, Health, Hello, LinkHealth, LinkKind, MarkedInstant, MeasuredPose, Message, Packet,
    PosePacket, ResetReason, Start, TargetInfo, TargetPacket, View,
};
use plumbline::report::TargetState;
use plumbline::target::Role;
use plumbline::view::FrameView;
use plumbline::view::TargetView;
use plumbline_render::simulate::{Simulation, SimulationSettings};

pub mod adversity;
mod cable;
pub mod lit_box;
mod other_release;
mod sealed_box;
mod updated_box;

pub use crate::sealed_box::SealedBox;
pub use cable::Cable;
pub use other_release::OtherRelease;
pub use sealed_box::{key, known_box};
pub use updated_box::{Fate, UpdatedBox};

use crate::receiver::Receiver;
use crate::transport::Event;

/// The period of its frames, 60 Hz.
const PERIOD_NS: u64 = 16_666_667;

/// Five seconds of frames.
pub const FRAMES: u32 = 300;

/// The start that sends what is here.
pub const START: u32 = 7;

/// A message of a start of a box.
pub fn packet(start: u32, message: Message) -> Packet {
    Packet { start: Start::new(start), message }
}

/// What comes when the box sends this.
pub fn event(message: Message) -> Event {
    let start = if let Message::Hello(hello) = &message { hello.boot_id } else { START };
    Event::Packet(packet(start, message))
}

/// A pose of the shoulder.
pub fn pose() -> MeasuredPose {
    MeasuredPose {
        delay_ns: 0,
        theta_rad: [0.1, 0.2, -0.1],
        translation_mm: [1.0, 2.0, 1000.0],
        sd_mm: [0.001, 0.003, 0.02],
        sd_rad: [0.0001; 3],
        correlations: [0.0; 15],
        rms_px: 0.03,
        corners: 20,
    }
}

/// A frame with both targets.
pub fn pose_packet(sequence: u32) -> PosePacket {
    let target = |role| {
        let mut pose = pose();
        pose.corners = if role == Role::Lower { 30 } else { 20 };
        TargetPacket { role, state: TargetState::Tracking, pose: Ok(pose) }
    };
    PosePacket {
        sequence,
        capture_time_ns: 1_000_000_000 + u64::from(sequence) * PERIOD_NS,
        instant: MarkedInstant::FrameArrival,
        latency_us: 1200,
        targets: [target(Role::Lower), target(Role::Upper)].into_iter().collect(),
        upper_trunk: None,
        lower_trunk: None,
    }
}

static SCENE: LazyLock<Config> =
    LazyLock::new(|| Simulation::new(&SimulationSettings::default()).unwrap().config());

/// Its configuration: the standard scene, a camera and a watchdog.
pub fn config() -> Config {
    let mut config = SCENE.clone();
    config.capture = Some(Capture {
        driver: CaptureDriver::V4l2,
        device: heapless::String::new(),
        pixel_format: PixelFormat::Grey,
        rate_hz: 60.0,
        exposure_us: Some(4000),
        gain: Some(1.0),
    });
    config.machine.watchdog_s = Some(15);
    config
}

/// Who it is.
pub fn hello(config: &Config) -> Hello {
    let targets = config.targets.iter().map(|target| TargetInfo {
        name: target.name.clone(),
        role: target.geometry.role(),
        corners: target.geometry.corner_count() as u8,
    });
    Hello {
        device: "ward 3".try_into().unwrap(),
        serial_number: "PL-0001".try_into().unwrap(),
        firmware: concat!(env!("CARGO_PKG_VERSION"), "+5e6f7a8b").try_into().unwrap(),
        config_crc: config.crc(),
        boot_id: START,
        boot_count: Some(3),
        reset_reason: ResetReason::PowerOn,
        width_px: 1456,
        height_px: 1088,
        targets: targets.collect(),
    }
}

/// Its Health: all is well.
pub fn health() -> Health {
    Health {
        uptime_ms: 600_000,
        frames: 36_000,
        frames_dropped: 0,
        frames_missed: 0,
        camera_losses: 0,
        corners_dropped: 0,
        heap_allocations: Some(0),
        temperature_decicelsius: Some(512),
        undervoltage: Some(false),
        throttled: Some(false),
        camera: CameraState::Running,
        aiming_s: 0,
        latency_us_max: 2000,
        logs_dropped: 0,
        trigger: Default::default(),
        links: [LinkHealth { kind: LinkKind::Udp, packets_sent: 36_000, packets_dropped: 0 }]
            .into_iter()
            .collect(),
    }
}

/// What its camera sees.
pub fn view() -> View {
    let target = |role| TargetView {
        role,
        light: 0.8,
        dark: 0.1,
        saturated: 0.0,
        blur_px: [0.7, 0.75],
        pitch_px: 21.0,
    };
    View {
        sequence: 5,
        exposure_us: Some(4000),
        gain: Some(1.0),
        frame: FrameView { level: 0.4, saturated: 0.0, blur_px: Some(0.8) },
        targets: [target(Role::Lower), target(Role::Upper)].into_iter().collect(),
    }
}

/// Hands over the messages, the first at `start` and each 0.1 s after the one before; returns the
/// time of the last.
pub fn take<W: Write>(receiver: &mut Receiver<W>, start: Instant, messages: &[Message]) -> Instant {
    let mut now = start;
    for (index, message) in (0..).zip(messages) {
        now = start + Duration::from_millis(100) * index;
        receiver.handle(event(message.clone()), now).expect("it is recorded");
    }
    now
}
