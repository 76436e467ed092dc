//! Cameras that compress their frames, or send colours.
//!
//! For Motion JPEG the kernel's own driver for USB cameras streams from a virtual one, as it does
//! from most that people have; vivid plays the other formats.

use std::path::{Path, PathBuf};

use common::coloured;
use plumbline::config::PixelFormat;
use plumbline::packet::Health;
use plumbline_board::source::Pixels;
use plumbline_board::source::v4l2::luma::Luma;

use crate::machine::{Host, Machine, Parts, image as built, is_measured, logs, poses};
use crate::scene::{self, FRAMES, Grey, Position, RATE_HZ, SCENE, distance_mm};

/// As the virtual USB camera plays them: an emulated machine decodes them slowly.
const USB_RATE_HZ: f32 = 5.0;

/// Of the compressed frames: as USB cameras have it by default.
const QUALITY: u8 = 90;

/// Of the scene's frames, every so many: a third is enough to move by more than the noise.
const EVERY: usize = 3;

/// The frames go by more than twice.
const POSES: usize = 2 * (FRAMES / EVERY) + 8;

/// As in `poses`: a frame seen after another one has its windows a little elsewhere.
const DIFFERENCE_MM_MAX: f64 = 0.1;

/// Of one frame's position: a few times the spread of its depth at this camera's scale (f 1150 px),
/// which is +-0.04 and +-0.09 mm for grey frames; the green samples of a mosaic are half as many.
const ERROR_MM_MAX: [f64; 2] = [0.12, 0.3];

/// What a camera sends.
struct Sent {
    format: PixelFormat,
    code: &'static [u8; 4],
    rate_hz: f32,
    frames: Vec<Vec<u8>>,
    /// Which of them can be read.
    whole: Vec<usize>,
}

impl Sent {
    /// The scene's frames in a format.
    fn new(format: PixelFormat, code: &'static [u8; 4], encode: impl Fn(&[u8]) -> Vec<u8>) -> Self {
        let rendered = |frame: usize| {
            let mut pixels = Vec::new();
            SCENE.simulation.render(frame as u64, &mut pixels);
            encode(&pixels)
        };
        let frames: Vec<_> = (0..FRAMES).step_by(EVERY).map(rendered).collect();
        let whole = (0..frames.len()).collect();
        Self { format, code, rate_hz: RATE_HZ as f32, frames, whole }
    }

    /// Boots with a camera that sends them; the last Health, after enough poses. Each of them is
    /// that of a frame that this machine reads and tracks, at most as far from it as allowed.
    ///
    /// `play` puts the frames into the directory; returns the kernel's options, an archive over the
    /// initramfs and a disk.
    fn boot(
        &self,
        play: impl FnOnce(&Path) -> (String, Option<PathBuf>, Option<PathBuf>),
    ) -> Health {
        let host = Host::new();
        let directory = tempfile::tempdir().unwrap();
        let mut config = scene::config(host.address());
        let capture = config.capture.as_mut().unwrap();
        (capture.pixel_format, capture.rate_hz) = (self.format, self.rate_hz);
        let disk = scene::boot_disk(directory.path(), &scene::blob(&config));
        let (options, archive, frames_disk) = play(directory.path());
        let initramfs = [built("initramfs"), built("overlay.cpio")].into_iter().chain(archive);
        let machine = Machine::start(
            &Parts {
                kernel: built("vmlinuz"),
                initramfs: initramfs.collect(),
                command_line: &format!("rdinit=/test/start {options}"),
                boot_disk: &disk,
                frames_disk: frames_disk.as_deref(),
            },
            &host,
        );
        let health = machine.wait_for("poses and a Health after them", |seen| {
            let enough = poses(&seen.udp).filter(|pose| is_measured(pose)).count() >= POSES;
            seen.health().filter(|health| enough && health.frames >= POSES as u32).cloned()
        });
        let here = self.tracked_here();
        machine.look(|seen| {
            let mut largest_mm = [0.0_f64; 2];
            for pose in poses(&seen.udp).skip_while(|pose| !is_measured(pose)) {
                for (target, largest_mm) in largest_mm.iter_mut().enumerate() {
                    let found = pose.targets[target].pose.expect("once it tracks, it goes on");
                    let found = found.translation_mm.map(f64::from);
                    let distances = here[target].iter().map(|here| distance_mm(here, &found));
                    *largest_mm = largest_mm.max(distances.fold(f64::INFINITY, f64::min));
                }
            }
            let name = self.code.escape_ascii();
            println!("{name}: at most {largest_mm:.4?} mm from the poses of these frames here");
            println!("{}", logs(&seen.udp));
            assert!(largest_mm.iter().all(|&mm| mm < DIFFERENCE_MM_MAX), "{largest_mm:?} mm");
        });
        // Decoding is counted by itself.
        assert_eq!(health.heap_allocations, Some(0));
        health
    }

    /// Per target: where the core sees it in the whole frames, read in the same way.
    fn tracked_here(&self) -> [Vec<Position>; 2] {
        let mut luma = Luma::new(self.code, size_px(), 0).expect("a format that is read");
        let mut read = |&place: &usize| {
            let bytes = &self.frames[place];
            luma.load(bytes).expect("a whole frame");
            match luma.view(bytes, &[]).expect("a whole frame") {
                Pixels::Grey8(image) => Grey::of(&image),
                Pixels::Grey16(image) => Grey::of(&image),
            }
        };
        let read: Vec<Grey> = self.whole.iter().map(&mut read).collect();
        let here = scene::track(&SCENE.simulation, &read);
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

    /// As a disk that vivid plays.
    fn boot_with_vivid(&self) -> Health {
        self.boot(|directory| {
            let disk = directory.join("frames");
            std::fs::write(&disk, self.frames.concat()).unwrap();
            (format!("test.format={}", self.code.escape_ascii()), None, Some(disk))
        })
    }

    /// As files that the virtual USB camera plays.
    fn boot_with_usb(&self) -> Health {
        self.boot(|directory| {
            let files = self.frames.iter().enumerate();
            let files = files.map(|(place, frame)| (format!("frames/{place}"), frame.clone()));
            let archive = directory.join("frames.cpio");
            std::fs::write(&archive, scene::archive(files)).unwrap();
            ("test.usb_camera".to_owned(), Some(archive), None)
        })
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
    sent.rate_hz = USB_RATE_HZ;
    // One is cut off, as by a cable that is bent.
    let cut = sent.whole.remove(sent.frames.len() / 2);
    let length = sent.frames[cut].len() / 2;
    sent.frames[cut].truncate(length);
    let health = sent.boot_with_usb();
    // It came twice on the way there and back.
    assert!(health.frames_missed >= 2, "{} frames missed", health.frames_missed);
}

#[test]
fn a_colour_sensors_own_samples_are_tracked_by_their_green() {
    let mosaic = |grey: &[u8]| coloured::mosaic(b"BA81", grey, size_px().0);
    Sent::new(PixelFormat::Bayer8, b"BA81", mosaic).boot_with_vivid();
}

#[test]
fn colours_are_tracked_by_their_green() {
    Sent::new(PixelFormat::Rgb24, b"BGR3", coloured::bgr).boot_with_vivid();
}
