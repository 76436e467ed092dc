//! `plumb aim --expose` and a box that is played here: its camera is linear, with a black level,
//! and its lamp is known.

use std::net::{SocketAddr, UdpSocket};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::common::finished::{Finished, plumb};
use crate::common::keys;
use plumbline::config::{
    BLOB_BYTES_MAX, Capture, CaptureDriver, Config, Links, Machine, PixelFormat, TargetConfig,
};
use plumbline::lens::{Distortion, Lens};
use plumbline::packet::{
    Action, CameraState, Command, Document, Health, Hello, Message, PART_BYTES_MAX, Part, Refusal,
    ReplyOutcome, ResetReason, View,
};
use plumbline::seal::ListenerId;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline::view::FrameView;
use plumbline::view::TargetView;
use plumbline_stream::fixture::SealedBox;

const NAME: &str = "played";
const BLACK: f32 = 0.03;

/// A box without a sensor: it answers as a real one does, and believes its lamp.
struct PlayedBox {
    sealed: SealedBox,
    host: SocketAddr,
    config: Config,
    /// Level of the light squares per microsecond at gain 1.
    light_per_us: f32,
    takes_gain: bool,
    exposure_us: Option<u32>,
    gain: Option<f32>,
    is_asked: bool,
    is_aiming: bool,
    sequence: u32,
    boot_id: u32,
    /// So often it restarts as soon as it exposes as it is told, then by this name.
    restarts: u32,
    restarts_as: &'static str,
    incoming: Vec<u8>,
    stored: Option<Config>,
}

/// What a played box was left with.
struct Left {
    stored: Option<Config>,
    is_aiming: bool,
    starts: u32,
}

impl PlayedBox {
    fn new(light_per_us: f32, takes_gain: bool) -> (Self, String) {
        let address = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let host = address.to_string();
        let played = Self {
            sealed: SealedBox::new(address, 1),
            host: address,
            config: config(&host),
            light_per_us,
            takes_gain,
            exposure_us: None,
            gain: None,
            is_asked: false,
            is_aiming: false,
            sequence: 0,
            boot_id: 1,
            restarts: 0,
            restarts_as: NAME,
            incoming: vec![0; BLOB_BYTES_MAX],
            stored: None,
        };
        (played, host)
    }

    /// Plays until the host has not been there for a while, having been there.
    fn play(mut self) -> JoinHandle<Left> {
        std::thread::spawn(move || {
            let mut quiet = 0;
            // Two seconds, or twenty before anybody comes.
            while quiet < if self.is_asked { 20 } else { 200 } {
                let asked = self.sealed.wait();
                if asked.is_empty() {
                    quiet += 1;
                    self.send(&Message::Hello(self.hello()));
                    self.send(&Message::Health(self.health()));
                } else {
                    (self.is_asked, quiet) = (true, 0);
                }
                for (listener, message) in asked {
                    self.take(listener, message);
                }
            }
            Left { stored: self.stored, is_aiming: self.is_aiming, starts: self.boot_id }
        })
    }

    fn send(&mut self, message: &Message) {
        self.sealed.send(message);
    }

    fn take(&mut self, listener: ListenerId, message: Message) {
        match message {
            Message::Command(Command { id, action, .. }) => {
                let outcome = self.carry_out(listener, action);
                self.sealed.answer(listener, id, outcome);
                if action == Action::Reboot {
                    self.start_anew();
                }
            }
            Message::Part(part) => {
                self.incoming[part.offset as usize..][..part.bytes.len()]
                    .copy_from_slice(&part.bytes);
            }
            other => panic!("{other:?}"),
        }
    }

    fn carry_out(&mut self, listener: ListenerId, action: Action) -> ReplyOutcome {
        let refused = |refusal| ReplyOutcome::Refused { refusal, reason: "so".try_into().unwrap() };
        match action {
            Action::SendHello => self.send(&Message::Hello(self.hello())),
            Action::QueryConfig => {
                let bytes = blob(&self.config).len() as u32;
                let crc = self.config.crc();
                return ReplyOutcome::Config { crc, bytes, next_crc: crc };
            }
            Action::SendParts { document: Document::Config, .. } => self.send_config(listener),
            Action::SendView if self.restarts > 0 && self.exposure_us.is_some() => self.restart(),
            Action::SendView => {
                let view = self.view();
                self.sealed.send_to(listener, &Message::View(view));
            }
            Action::Aim { seconds } => self.is_aiming = seconds > 0,
            Action::Expose { .. } if !self.is_aiming => return refused(Refusal::NotAiming),
            Action::Expose { gain: Some(_), .. } if !self.takes_gain => {
                return refused(Refusal::NotSupported);
            }
            Action::Expose { exposure_us, gain } => {
                (self.exposure_us, self.gain) = (exposure_us, gain);
            }
            Action::StoreConfig { bytes, crc } => {
                let config = Config::decode(&self.incoming[..bytes as usize]).unwrap();
                assert_eq!(config.crc(), crc);
                self.stored = Some(config);
                return ReplyOutcome::Stored { crc };
            }
            Action::Reboot => {
                self.config = self.stored.clone().expect("restarted with what was stored");
            }
            other => panic!("{other:?}"),
        }
        ReplyOutcome::Accepted
    }

    /// Another start of a real box has another port.
    fn start_anew(&mut self) {
        self.sealed.live(Duration::from_millis(50));
        self.boot_id += 1;
        self.sealed = SealedBox::new(self.host, self.boot_id);
    }

    /// As another start of a real box: its own exposure, no set-up mode.
    fn restart(&mut self) {
        self.restarts -= 1;
        (self.exposure_us, self.gain, self.is_aiming) = (None, None, false);
        self.config.device = self.restarts_as.try_into().unwrap();
        self.start_anew();
        // Another box is not heard at once.
        self.is_asked = false;
        self.send(&Message::Hello(self.hello()));
    }

    fn send_config(&mut self, listener: ListenerId) {
        for (index, bytes) in blob(&self.config).chunks(PART_BYTES_MAX).enumerate() {
            let offset = (index * PART_BYTES_MAX) as u32;
            let bytes = bytes.iter().copied().collect();
            let part = Part { document: Document::Config, offset, bytes };
            self.sealed.send_to(listener, &Message::Part(part));
        }
    }

    fn view(&mut self) -> View {
        self.sequence += 1;
        let exposure_us = self.exposure_us.unwrap_or(1000) as f32;
        let level = BLACK + self.light_per_us * exposure_us * self.gain.unwrap_or(1.0);
        let is_found = (0.15..1.0).contains(&level);
        let target = TargetView {
            role: Role::Lower,
            light: level,
            dark: BLACK + 0.1 * level,
            saturated: 0.0,
            blur_px: [0.7; 2],
            pitch_px: 20.0,
        };
        View {
            sequence: self.sequence,
            exposure_us: self.exposure_us,
            gain: self.gain,
            frame: FrameView { level: (0.5 * level).min(1.0), saturated: 0.0, blur_px: None },
            targets: is_found.then_some(target).into_iter().collect(),
        }
    }

    fn hello(&self) -> Hello {
        Hello {
            device: self.config.device.clone(),
            serial_number: self.config.serial_number.clone(),
            firmware: "played".try_into().unwrap(),
            config_crc: self.config.crc(),
            boot_id: self.boot_id,
            boot_count: None,
            reset_reason: ResetReason::Unknown,
            width_px: self.config.lens.width_px,
            height_px: self.config.lens.height_px,
            targets: heapless::Vec::new(),
        }
    }

    fn health(&self) -> Health {
        Health {
            uptime_ms: u64::from(self.sequence),
            frames: self.sequence,
            frames_dropped: 0,
            frames_missed: 0,
            camera_losses: 0,
            corners_dropped: 0,
            heap_allocations: None,
            temperature_decicelsius: None,
            undervoltage: None,
            throttled: None,
            camera: CameraState::Running,
            aiming_s: if self.is_aiming { 9 } else { 0 },
            latency_us_max: 1,
            logs_dropped: 0,
            trigger: Default::default(),
            links: heapless::Vec::new(),
        }
    }
}

fn config(host: &str) -> Config {
    let geometry = TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Lower, [0.0; 3]);
    let name = "lumbar".try_into().unwrap();
    Config {
        device: NAME.try_into().unwrap(),
        serial_number: "0".try_into().unwrap(),
        lens: Lens {
            width_px: 640,
            height_px: 480,
            fx_px: 760.0,
            fy_px: 760.0,
            cx_px: 319.5,
            cy_px: 239.5,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        },
        readout_ns: 0,
        targets: [TargetConfig { name, geometry: geometry.unwrap() }].into_iter().collect(),
        cam_from_scene_theta: None,
        links: Links { udp: Some(host.parse().unwrap()), serial: None },
        capture: Some(Capture {
            driver: CaptureDriver::V4l2,
            device: "/dev/video0".try_into().unwrap(),
            pixel_format: PixelFormat::Grey,
            rate_hz: 60.0,
            exposure_us: None,
            gain: None,
        }),
        machine: Machine::default(),
        trigger: None,
    }
}

fn blob(config: &Config) -> Vec<u8> {
    config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec()
}

fn expose(light_per_us: f32, takes_gain: bool, more: &[&str]) -> (Finished, Left) {
    let (played, host) = PlayedBox::new(light_per_us, takes_gain);
    expose_with(played, &host, more)
}

fn expose_with(played: PlayedBox, host: &str, more: &[&str]) -> (Finished, Left) {
    let playing = played.play();
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    let finished = plumb(folder.path(), &[&["aim", "--udp", host, "--expose"], more].concat());
    (finished, playing.join().expect("the played box plays on"))
}

#[test]
fn what_is_found_is_stored_and_the_box_starts_with_it() {
    let (finished, left) = expose(3e-4, true, &["--store"]);
    assert_eq!(finished.code, Some(0), "{} {}", finished.stdout, finished.stderr);
    let capture = left.stored.expect("a stored configuration").capture.unwrap();
    let exposure_us = capture.exposure_us.unwrap();
    let light = BLACK + 3e-4 * exposure_us as f32;
    assert!((0.7..=0.8).contains(&light), "{exposure_us} us: {light}");
    assert_eq!((capture.gain, left.starts, left.is_aiming), (None, 2, false));
    let found = format!("found: exposure {exposure_us} us\n");
    assert!(finished.stdout.ends_with(&found), "{}", finished.stdout);
    assert!(finished.stderr.contains("the box has restarted with it"), "{}", finished.stderr);
}

#[test]
fn little_light_takes_gain_and_without_one_it_is_said_to_be_too_little() {
    let (finished, left) = expose(3e-5, true, &[]);
    assert_eq!(finished.code, Some(0), "{} {}", finished.stdout, finished.stderr);
    assert!(finished.stdout.contains("found: exposure 8333 us, gain 3\n"), "{}", finished.stdout);
    assert!(finished.stdout.contains("half a frame is 8333 us"), "{}", finished.stdout);
    assert_eq!(left.stored, None);

    let (finished, left) = expose(1e-5, false, &["--store"]);
    assert_eq!(finished.code, Some(2), "{} {}", finished.stdout, finished.stderr);
    assert!(
        finished.stdout.contains("gain 1: the camera does not accept it"),
        "{}",
        finished.stdout
    );
    for part in ["too dark even with exposure 16666 us", "open the aperture, or add light"] {
        assert!(finished.stderr.contains(part), "{part:?} is not in: {}", finished.stderr);
    }
    assert_eq!((left.stored, left.starts, left.is_aiming), (None, 1, false));
}

/// A box of which `restarts` starts come in between, then by this name.
fn expose_through(restarts: u32, restarts_as: &'static str) -> (Finished, Left) {
    let (played, host) = PlayedBox::new(3e-4, true);
    expose_with(PlayedBox { restarts, restarts_as, ..played }, &host, &["--store"])
}

#[test]
fn a_box_that_restarts_meanwhile_is_noticed() {
    let (finished, left) = expose_through(2, NAME);
    assert_eq!(finished.code, Some(0), "{} {}", finished.stdout, finished.stderr);
    let told = finished.stdout.matches("the box has restarted; the same setting again").count();
    // The third is the one with what was stored.
    assert_eq!((told, left.starts, left.is_aiming), (2, 4, false));
    assert!(finished.stdout.contains("found: exposure "), "{}", finished.stdout);
    let exposure_us = left.stored.unwrap().capture.unwrap().exposure_us.unwrap();
    let light = BLACK + 3e-4 * exposure_us as f32;
    assert!((0.7..=0.8).contains(&light), "its own exposure is not judged: {exposure_us} us");
}

#[test]
fn a_box_that_restarts_again_and_again_is_given_up() {
    let (finished, left) = expose_through(100, NAME);
    assert_eq!((finished.code, left.stored), (Some(2), None), "{}", finished.stdout);
    for part in ["the box has restarted 4 times meanwhile", "`plumb doctor`"] {
        assert!(finished.stderr.contains(part), "{part:?} is not in: {}", finished.stderr);
    }
}

#[test]
fn another_box_in_its_place_is_refused() {
    let (finished, left) = expose_through(1, "other");
    assert_eq!((finished.code, left.stored), (Some(2), None), "{}", finished.stdout);
    let refused = "another box is heard now: other (0), no longer played (0)";
    assert!(finished.stderr.contains(refused), "{}", finished.stderr);
}
