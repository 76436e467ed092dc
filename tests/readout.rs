//! `plumb calibrate --readout`, on rendered videos of cameras whose readout is known.

use std::f64::consts::TAU;
use std::path::Path;

use common::binary::{plumb_in, plumb_judges_in};
use common::photographer::{LENS, Video, board, save_video};
use plumbline::pose::{Cam, Pose, Target};
use plumbline_files::camera::{self, Camera, Provenance};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

const SIZE_PX: [u16; 2] = [LENS.width_px, LENS.height_px];

/// A board waved by hand: by a hand's breadth, once a second.
fn waved(time_s: f64) -> Pose<Cam, Target> {
    let wave = |hz: f64, phase: f64| (TAU * hz * time_s + phase).sin();
    Pose::from_theta([
        0.05 * wave(0.7, 0.3),
        0.15 + 0.1 * wave(0.9, 1.0),
        -0.2 + 0.1 * wave(0.6, 2.0),
        50.0 * wave(1.1, 0.0),
        30.0 * wave(0.8, 1.5),
        520.0 + 30.0 * wave(0.5, 0.5),
    ])
}

/// A directory with the file of the calibrated camera.
fn lab() -> tempfile::TempDir {
    let lab = tempfile::tempdir().unwrap();
    let provenance = Provenance { rms_px: Some(0.02), images: Some(15), ..Provenance::default() };
    let camera = Camera { lens: LENS, readout_ns: 0, provenance };
    camera::write(&lab.path().join("camera.toml"), &camera).unwrap();
    lab
}

fn frames(
    count: usize,
    readout_s: f64,
    cam_from_board: fn(f64) -> Pose<Cam, Target>,
) -> Vec<Vec<u8>> {
    let video = Video { lens: &LENS, board: &board(), cam_from_board, rate_hz: 60.0, readout_s };
    (0..count).into_par_iter().map(|index| video.frame(index)).collect()
}

const WITH_BOARD: &str =
    "calibrate --readout --camera camera.toml --board 9x7 --pitch-mm 20 --out measured.toml";

#[test]
fn the_readout_of_a_rendered_camera_is_measured() {
    for (readout_ms, said) in [
        (12.0, "global shutter: no, the top row is read first"),
        (-12.0, "global shutter: no, the bottom row is read first"),
        (0.0, "global shutter: yes"),
    ] {
        let lab = lab();
        let video = frames(60, readout_ms * 1e-3, waved);
        save_video(&video, SIZE_PX, 60, &lab.path().join("waved.y4m"));
        let text = plumb_in(lab.path(), &format!("{WITH_BOARD} waved.y4m"));
        assert!(text.contains(said), "{text}");
        let measured = camera::read(&lab.path().join("measured.toml")).unwrap();
        assert_eq!(measured.lens, LENS);
        assert_eq!(measured.provenance.images, Some(15));
        let sd_ms = measured.provenance.readout_sd_ms.unwrap();
        let error_ms = f64::from(measured.readout_ns) * 1e-6 - readout_ms;
        println!("{readout_ms}: error {error_ms:.4} ms, said {sd_ms} ms");
        assert!(sd_ms < 0.3 && error_ms.abs() < 3.0 * sd_ms, "{error_ms} {sd_ms}");
    }
}

#[track_caller]
fn refused(lab: &Path, arguments: &str) -> String {
    let (code, text) = plumb_judges_in(lab, arguments);
    assert_eq!(code, Some(2), "{text}");
    assert!(!lab.join("measured.toml").exists());
    text
}

#[test]
fn what_does_not_tell_the_readout_is_refused_with_the_reason() {
    let lab = lab();
    let lab = lab.path();
    let still = vec![frames(1, 0.0, waved).remove(0); 40];
    save_video(&still, SIZE_PX, 60, &lab.join("still.y4m"));
    save_video(&still[..1], SIZE_PX, 60, &lab.join("one.y4m"));
    save_video(&vec![vec![90; 640 * 480]; 2], [640, 480], 60, &lab.join("small.y4m"));
    image::GrayImage::from_raw(800, 600, still[0].clone())
        .unwrap()
        .save(lab.join("a.png"))
        .unwrap();

    let text = refused(lab, &format!("{WITH_BOARD} still.y4m"));
    assert!(text.contains("the board moves by 0 px/s only; wave the board"), "{text}");
    let text = refused(lab, &format!("{WITH_BOARD} one.y4m"));
    assert!(text.contains("is seen in 1 of 1 frame without a gap, and 30 are needed"), "{text}");
    let text = refused(lab, &format!("{WITH_BOARD} a.png a.png"));
    assert!(text.contains("do not tell when they were taken; give a Y4M video"), "{text}");
    let text = refused(lab, &format!("{WITH_BOARD} small.y4m"));
    assert!(text.contains("640 x 480 px, but camera.toml"), "{text}");
    let text = refused(lab, &format!("{WITH_BOARD} still.y4m --fps 0"));
    assert!(text.contains("--fps: 0 frames per second"), "{text}");
    let other = WITH_BOARD.replace("9x7", "8x6");
    let text = refused(lab, &format!("{other} still.y4m"));
    assert!(text.contains("of 8 x 6 inner corners is seen in 0 of 40 frames"), "{text}");
    let without = WITH_BOARD.replace("--camera camera.toml", "");
    let text = refused(lab, &format!("{without} still.y4m"));
    assert!(text.contains("--camera <FILE>"), "{text}");
    let without = WITH_BOARD.replace("--board 9x7", "");
    assert!(refused(lab, &format!("{without} still.y4m")).contains("--board"));
}

/// A wall in the light of a lamp, darker to one side, with noise.
fn wall(readout_s: f64, flicker: f64) -> Vec<Vec<u8>> {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut frame = |index: usize| {
        let mut samples = Vec::with_capacity(800 * 600);
        for y in 0..600 {
            let time_s = f64::from(index as u32) / 30.0 + f64::from(y) / 600.0 * readout_s;
            let light = 1.0 + flicker * (TAU * 100.0 * time_s + 1.0).cos();
            for x in 0..800 {
                let grey = (170.0 - 0.02 * f64::from(x)) * light;
                samples.push((grey + random.random_range(-3.0..3.0)).round() as u8);
            }
        }
        samples
    };
    (0..30).map(&mut frame).collect()
}

const WITH_LAMP: &str =
    "calibrate --readout --camera camera.toml --flicker-hz 100 --out measured.toml wall.y4m";

#[test]
fn the_readout_is_measured_by_a_flickering_lamp() {
    let lab = lab();
    let path = lab.path().join("wall.y4m");
    save_video(&wall(0.0, 0.0), SIZE_PX, 30, &path);
    let text = refused(lab.path(), WITH_LAMP);
    assert!(text.contains("no light and dark bands"), "{text}");

    save_video(&wall(-21e-3, 0.05), SIZE_PX, 30, &path);
    let text = plumb_in(lab.path(), WITH_LAMP);
    assert!(text.contains("the bottom row is read first"), "{text}");
    let measured = camera::read(&lab.path().join("measured.toml")).unwrap();
    // A thousandth for the frequency of the mains, which here is exact.
    assert_eq!(measured.provenance.readout_sd_ms, Some(0.021));
    assert!((f64::from(measured.readout_ns) * 1e-6 + 21.0).abs() < 0.01, "{text}");

    // A file is replaced only if that is asked for: the camera's own, too.
    let onto = WITH_LAMP.replace("measured", "camera");
    let (code, text) = plumb_judges_in(lab.path(), &onto);
    assert!(code == Some(2) && text.contains("camera.toml: exists already"), "{text}");
    plumb_in(lab.path(), &format!("{onto} --force"));
    let camera = camera::read(&lab.path().join("camera.toml")).unwrap();
    assert_eq!((camera.readout_ns, camera.lens), (measured.readout_ns, LENS));
}
