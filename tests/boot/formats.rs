//! Cameras that compress their frames, or send colours.
//!
//! The kernel's own driver for USB cameras streams from a virtual one, as it does from most that
//! people have.

use std::path::Path;

use common::coloured;
use plumbline::config::PixelFormat;
use plumbline::packet::Health;
use plumbline_board::source::Pixels;
use plumbline_board::source::v4l2::luma::Luma;

use crate::machine::{Host, Machine, Parts, image as built, in_order, is_measured, poses, read};
use crate::scene::{self, Grey, Position, SCENE, distance_mm};

/// As the virtual camera plays them: an emulated machine decodes them slowly.
const RATE_HZ: f32 = 5.0;

/// Of the compressed frames: as USB cameras have it by default.
const QUALITY: u8 = 90;

/// Of the scene's frames, every third one: the person sways at a little more than half the real speed,
/// and where one frame is missed, the target is not lost before the next.
const EVERY: usize = 3;

/// The number of frames that are played, there and back, in three seconds.
const FRAMES: usize = 8;

/// They go by there and back once, while the estimates of the blur and of the print's growth settle.
const SETTLING: usize = 2 * FRAMES;

/// And once more.
const POSES: usize = SETTLING + 2 * FRAMES;

/// How far a position may be from the truth, per target: some four standard deviations of its depth
/// for a mosaic, whose frames are the noisiest.
const ERROR_MM_MAX: [f64; 2] = [0.12, 0.28];

/// How far it may be from that of the same frame tracked here, after other ones: the blur and the
/// growth are then known from other frames. Other seeds, with frames missed, differ by up to 0.044.
const DIFFERENCE_MM_MAX: f64 = 0.05;

/// What a camera sends.
pub struct Sent {
    format: PixelFormat,
    code: &'static [u8; 4],
    frames: Vec<Vec<u8>>,
    /// Which of them can be read.
    whole: Vec<usize>,
}

impl Sent {
    /// The scene's frames in a format.
    fn new(format: PixelFormat, code: &'static [u8; 4], encode: impl Fn(&[u8]) -> Vec<u8>) -> Self {
        let (width, height) = size_px();
        let rendered = read(&SCENE.frames_disk);
        let frames = rendered.chunks_exact(width * height).step_by(EVERY).take(FRAMES);
        let frames: Vec<_> = frames.map(encode).collect();
        let whole = (0..frames.len()).collect();
        Self { format, code, frames, whole }
    }

    /// Boots with a camera that sends them; `more` goes to the kernel's command line.
    pub fn start(&self, host: &Host, directory: &Path, more: &str) -> Machine {
        let mut config = scene::config(host.address());
        let capture = config.capture.as_mut().unwrap();
        (capture.pixel_format, capture.rate_hz) = (self.format, RATE_HZ);
        let disk = scene::boot_disk(directory, &scene::blob(&config));
        let files = self.frames.iter().enumerate();
        let files = files.map(|(place, frame)| (format!("frames/{place}"), frame.clone()));
        let frames = directory.join("frames.cpio");
        std::fs::write(&frames, scene::archive(files)).unwrap();
        let parts = Parts {
            kernel: built("vmlinuz"),
            initramfs: vec![built("initramfs"), built("overlay.cpio"), frames],
            command_line: &format!("rdinit=/test/start test.usb_camera={} {more}", self.name()),
            boot_disk: &disk,
            boot_disk_options: "",
            frames_disk: None,
            device_tree: None,
        };
        Machine::start(&parts, host)
    }

    /// Boots with a camera that sends them; the last Health, after enough poses. Each of them is
    /// that of a frame that this machine reads and tracks, at most as far from it as allowed.
    fn boot(&self) -> Health {
        let host = Host::new();
        let directory = tempfile::tempdir().unwrap();
        let machine = self.start(&host, directory.path(), "");
        let health = machine.wait_for("poses and a Health after them", |seen| {
            let enough = poses(&seen.udp).filter(|pose| is_measured(pose)).count() >= POSES;
            seen.health().filter(|health| enough && health.frames >= POSES as u32).cloned()
        });
        let here = self.tracked_here();
        machine.look(|seen| {
            let mut largest_mm = [0.0_f64; 2];
            let messages = in_order(&seen.udp);
            for pose in poses(&messages).skip_while(|pose| !is_measured(pose)).skip(SETTLING) {
                for (target, largest_mm) in largest_mm.iter_mut().enumerate() {
                    let found = pose.targets[target].pose.expect("once it tracks, it goes on");
                    let found = found.translation_mm.map(f64::from);
                    let distances = here[target].iter().map(|here| distance_mm(here, &found));
                    *largest_mm = largest_mm.max(distances.fold(f64::INFINITY, f64::min));
                }
            }
            let name = self.name();
            println!("{name}: at most {largest_mm:.4?} mm from the poses of these frames here");
            let said: Vec<_> =
                seen.console.lines().filter(|line| line.contains("camera: ")).collect();
            println!("{}", said.join("\n"));
            // Decoding is counted by itself, and said.
            let allocates = said.iter().any(|line| line.contains("heap allocations"));
            assert_eq!(allocates, self.format == PixelFormat::Mjpeg);
            assert_eq!(health.heap_allocations, Some(0));
            let agree = largest_mm.iter().all(|&mm| mm < DIFFERENCE_MM_MAX);
            assert!(agree, "{name}: {largest_mm:?} mm");
        });
        health
    }

    /// Per target: where the core sees it in the whole frames, read in the same way.
    fn tracked_here(&self) -> [Vec<Position>; 2] {
        let mut luma = Luma::new(self.code, size_px(), 0).expect("a format that is read");
        let mut seen = |&place: &usize| {
            let bytes = &self.frames[place];
            luma.load(bytes).expect("a whole frame");
            match luma.view(bytes, &[]).expect("a whole frame") {
                Pixels::Grey8(image) => Grey::of(&image),
                Pixels::Grey16(image) => Grey::of(&image),
            }
        };
        let seen: Vec<Grey> = self.whole.iter().map(&mut seen).collect();
        let here = scene::track(&SCENE.simulation, &seen, RATE_HZ.into());
        // That they are right, and not only the same.
        for (target, here) in here.iter().enumerate() {
            let truth = self.whole.iter().map(|place| &SCENE.truth_mm[target][EVERY * place]);
            let worst_mm =
                here.iter().zip(truth).map(|(a, b)| distance_mm(a, b)).fold(0.0, f64::max);
            println!("target {target}: at most {worst_mm:.3} mm from the truth");
            assert!(worst_mm < ERROR_MM_MAX[target], "{worst_mm} mm");
        }
        here
    }

    fn name(&self) -> std::slice::EscapeAscii<'_> {
        self.code.escape_ascii()
    }
}

fn size_px() -> (usize, usize) {
    let camera = SCENE.simulation.camera();
    (camera.width_px.into(), camera.height_px.into())
}

#[test]
fn motion_jpeg_is_decoded_and_a_damaged_frame_is_missed() {
    let mut sent = Sent::new(PixelFormat::Mjpeg, b"MJPG", |grey| {
        coloured::motion_jpeg(grey, size_px(), QUALITY)
    });
    // One is cut off, as by a cable that is bent.
    let cut = sent.whole.remove(sent.frames.len() / 2);
    let length = sent.frames[cut].len() / 2;
    sent.frames[cut].truncate(length);
    let health = sent.boot();
    // It came twice on the way there and back.
    assert!(health.frames_missed >= 2, "{} frames missed", health.frames_missed);
}

#[test]
fn a_colour_sensors_own_samples_are_tracked_by_their_green() {
    mosaic().boot();
}

/// As a colour sensor sends its samples.
pub fn mosaic() -> Sent {
    let mosaic = |grey: &[u8]| coloured::mosaic(b"BA81", grey, size_px().0);
    Sent::new(PixelFormat::Bayer8, b"BA81", mosaic)
}

#[test]
fn colours_are_tracked_by_their_green() {
    Sent::new(PixelFormat::Rgb24, b"BGR3", coloured::bgr).boot();
}
