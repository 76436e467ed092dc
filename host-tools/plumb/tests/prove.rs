//! `plumb prove` over rendered recordings whose errors are known: what it says agrees with the
//! truth, and what is no proof is refused.

use std::path::Path;

use nalgebra::{Vector3, Vector6};
use plumbline::lens::{Distortion, Lens};
use plumbline::packet::{MarkedInstant, MeasuredPose, Message, PosePacket, TargetPacket};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::TargetState;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_render::simulate::render::{Board, Ink, Picture, PlacedBoard, render_targets};
use plumbline_render::simulate::sensor::Sensor;
use plumbline_stream::fixture::adversity::hello_of;
use plumbline_stream::fixture::{START, packet};
use plumbline_trial::journal::{Entry, Writer};
use plumbline_trial::manifest::{Manifest, Zero};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::Value;

use crate::common::browser::Browser;
use crate::common::finished::{Finished, plumb};
use crate::common::trial;
use crate::report_in_browser::assert_shown;

const SIZE: [usize; 2] = [800, 600];
const RATE_HZ: usize = 30;
pub const CAMERA: &str = "width_px = 800\nheight_px = 600\nfx_px = 1000.0\nfy_px = 1000.0\n\
    cx_px = 399.5\ncy_px = 299.5\nmodel = \"radial2\"\ndistortion = [-0.10, 0.0]\n";
pub const TARGETS: &str = "\
    [[target]]\nname = \"lumbar\"\nrole = \"lower\"\ncolumns = 6\nrows = 5\npitch_mm = 12.0\n\
    [[target]]\nname = \"shoulder\"\nrole = \"upper\"\ncolumns = 5\nrows = 4\npitch_mm = 12.0\n";

/// The distance between the first inner corners of both boards on the sheet of `plumb target
/// --standard`, mm.
pub const LENGTH_MM: f64 = 109.0;

pub fn lens() -> Lens {
    let [width_px, height_px] = SIZE.map(|side| side as u16);
    Lens {
        width_px,
        height_px,
        fx_px: 1000.0,
        fy_px: 1000.0,
        cx_px: 399.5,
        cy_px: 299.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([-0.10, 0.0]),
    }
}

/// The sheet of the standard pair, printed so many times as large as it should be.
pub struct Plate {
    scale: f64,
    /// Whether the shoulder board is on it too.
    is_whole: bool,
}

impl Plate {
    /// The boards, with their places on the plate.
    pub fn boards(&self) -> Vec<(Board, Pose<Target, Target>)> {
        let board = |columns, rows, first_corner_y_mm: f64| {
            let origin = Origin::FirstCorner;
            let pitch_mm = 12.0 * self.scale;
            let checker =
                TargetGeometry::checker(columns, rows, pitch_mm, origin, Role::Scene, [0.0; 3]);
            let print = Board::new(&checker.unwrap(), pitch_mm, Ink { black: 25.0, white: 210.0 });
            let place_mm = Vector3::new(0.0, self.scale * first_corner_y_mm, 0.0);
            (print, Pose::new(Pose::<Target, Target>::identity().rotation, place_mm))
        };
        let boards = [board(6, 5, 0.0), board(5, 4, LENGTH_MM)];
        boards.into_iter().take(if self.is_whole { 2 } else { 1 }).collect()
    }

    fn picture(&self, cam_from_plate: &Pose<Cam, Target>) -> Picture {
        let boards = self.boards();
        let placed: Vec<PlacedBoard<'_>> = boards
            .iter()
            .map(|(board, plate_from_board)| PlacedBoard {
                board,
                cam_from_target: *cam_from_plate * *plate_from_board,
            })
            .collect();
        let mut picture = Picture::uniform(SIZE[0], SIZE[1], 110.0);
        render_targets(&lens(), 0.6, &placed, &|_, _| 1.0, &mut picture);
        picture
    }
}

pub const GOOD: Plate = Plate { scale: 1.0, is_whole: true };

/// A recording of a plate that is held at these poses, for a number of frames each.
pub fn record(path: &Path, plate: &Plate, poses: &[Pose<Cam, Target>], frames: usize) {
    let mut bytes = Vec::new();
    let mut encoder = y4m::encode(SIZE[0], SIZE[1], y4m::Ratio::new(RATE_HZ, 1))
        .with_colorspace(y4m::Colorspace::Cmono)
        .write_header(&mut bytes)
        .unwrap();
    let mut samples = vec![0_u8; SIZE[0] * SIZE[1]];
    for (at, pose) in poses.iter().enumerate() {
        let picture = plate.picture(pose);
        for frame in 0..frames {
            let number = (at * frames + frame) as u64;
            Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, 1, number, &mut samples);
            encoder.write_frame(&y4m::Frame::new([&samples, &[], &[]], None)).unwrap();
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// A directory with the descriptions of camera and targets.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("camera.toml"), CAMERA).unwrap();
    std::fs::write(folder.path().join("targets.toml"), TARGETS).unwrap();
    folder
}

fn prove(folder: &Path, arguments: &str) -> Finished {
    let files = ["--camera", "camera.toml", "--targets", "targets.toml", "--force"];
    let words: Vec<&str> = arguments.split_whitespace().collect();
    plumb(folder, &[&["prove", words[0]], &files[..], &words[1..]].concat())
}

pub fn figures(folder: &Path, name: &str) -> Value {
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()["figures"].clone()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// A value and its expanded uncertainty.
fn estimate(value: &Value) -> (f64, f64) {
    (number(&value["value"]), number(&value["expanded_uncertainty_k2"]))
}

#[track_caller]
pub fn assert_covers(value: &Value, truth: f64) {
    let (found, expanded) = estimate(value);
    assert!((found - truth).abs() <= expanded, "{found} +- {expanded}, and not {truth}");
}

#[track_caller]
fn assert_refused(done: &Finished, parts: &[&str]) {
    assert_eq!(done.code, Some(2), "{} {}", done.stdout, done.stderr);
    for part in parts {
        assert!(done.stderr.contains(part), "no {part:?} in {}", done.stderr);
    }
}

/// A plate upright in front of the camera, this far away.
pub fn upright(z_mm: f64) -> Pose<Cam, Target> {
    Pose::from_theta([0.02, 0.25, -0.2, -30.0, -55.0, z_mm])
}

/// Positions all over the volume, in all directions.
fn positions() -> Vec<Pose<Cam, Target>> {
    let mut poses = Vec::new();
    for (at, z_mm) in [460.0, 560.0, 680.0].into_iter().enumerate() {
        for (x, y) in [(-0.22, -0.12), (0.15, -0.12), (-0.02, -0.08), (-0.2, 0.02), (0.12, -0.02)] {
            // Upright, lying and tilted ones.
            let tilt_rad = [-0.6, 0.1, 0.5][(at + poses.len()) % 3];
            let is_lying = poses.len() % 4 == 3;
            let (turn_rad, aside_mm) = if is_lying { (-1.5, -0.05 * z_mm) } else { (0.05, 0.0) };
            let place_mm = [x * z_mm + aside_mm, y * z_mm, z_mm];
            poses.push(Pose::from_theta([
                turn_rad,
                0.3,
                tilt_rad,
                place_mm[0],
                place_mm[1],
                place_mm[2],
            ]));
        }
    }
    poses
}

#[test]
fn a_board_that_stands_still_shows_the_noise_that_its_poses_state() {
    let folder = folder();
    record(&folder.path().join("still.y4m"), &GOOD, &[upright(600.0)], 300);
    let done = prove(folder.path(), "repeatability still.y4m");
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert!(done.stdout.contains("Noise of one frame") && done.stdout.contains("Next: "));
    let found = figures(folder.path(), "repeatability.json");
    assert_eq!((&found["board"], &found["frames_in_all"]), (&"lumbar".into(), &300.into()));
    for coordinate in found["coordinates"].as_array().unwrap() {
        // 300 frames give it to 5 %, and the frames' noise is not all that there is: the core
        // promises its covariance to a fifth.
        let ratio = number(&coordinate["noise_over_stated"]["sd"]);
        assert!((0.8..1.25).contains(&ratio), "{coordinate}");
        let (drift, expanded) = estimate(&coordinate["drift_in_all"]);
        // One of six may be beyond U by chance, but none by half of it.
        assert!(drift.abs() < 1.5 * expanded, "{coordinate}");
    }
    let page = std::fs::read_to_string(folder.path().join("repeatability.html")).unwrap();
    // Three positions over time, two plots of the deviations.
    assert_eq!(page.matches("<figure").count(), 5);
}

/// Of the depth from frame to frame: just below a millimetre per minute.
const DRIFT_MM: f64 = 0.0005;

#[test]
fn a_drift_is_measured() {
    let folder = folder();
    let poses: Vec<_> = (0..120).map(|at| upright(600.0 + DRIFT_MM * f64::from(at))).collect();
    record(&folder.path().join("drift.y4m"), &GOOD, &poses, 1);
    let done = prove(folder.path(), "repeatability drift.y4m");
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert!(done.stdout.contains("Next: there is a drift in z (depth): "), "{}", done.stdout);
    let found = figures(folder.path(), "repeatability.json");
    let depth = &found["coordinates"][2];
    assert_covers(&depth["drift_in_all"], DRIFT_MM * 119.0);
    assert_covers(&depth["drift_per_min"], DRIFT_MM * 60.0 * RATE_HZ as f64);
}

#[test]
fn a_board_that_moved_is_refused_and_a_part_without_movement_is_offered() {
    let folder = folder();
    record(&folder.path().join("moved.y4m"), &GOOD, &[upright(600.0), upright(601.0)], 90);
    let done = prove(folder.path(), "repeatability moved.y4m");
    assert_refused(&done, &["moved.y4m: the board moved at 3.0 s, by ", "--from 0.0 --to 2."]);
    let by_mm = done.stderr.split("by ").nth(1).unwrap().split(' ').next().unwrap();
    assert!((by_mm.parse::<f64>().unwrap() - 1.0).abs() < 0.05, "{by_mm}");
    let part = done.stderr.split("--from").nth(1).unwrap().trim();
    let done = prove(folder.path(), &format!("repeatability moved.y4m --from {part}"));
    assert_eq!(done.code, Some(0), "{}", done.stderr);
}

#[test]
fn a_known_length_shows_a_print_of_the_wrong_scale_and_a_wrong_lens() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    record(&at("good.y4m"), &GOOD, &positions(), 3);
    let large = Plate { scale: 1.003, is_whole: true };
    record(&at("large.y4m"), &large, &positions(), 1);

    let good = "distance --independent --length-mm 109 --length-max-error-mm 0.05 --limit-mm 0.3";
    let done = prove(folder.path(), &format!("{good} good.y4m"));
    assert_eq!(done.code, Some(0), "{} {}", done.stdout, done.stderr);
    let found = figures(folder.path(), "distance.json");
    assert_eq!(found["verdict"], "within");
    assert_covers(&found["against"]["mean_error_mm"], 0.0);
    let scatter_mm = number(&found["scatter_mm"]["sd"]);
    assert!(found["positions"].as_array().unwrap().len() >= 12);

    let wrong =
        "distance --independent --length-mm 109.327 --length-max-error-mm 0.05 --limit-mm 0.2";
    let done = prove(folder.path(), &format!("{wrong} large.y4m"));
    assert_eq!(done.code, Some(1), "{} {}", done.stdout, done.stderr);
    assert!(done.stdout.contains("beyond the limit of 0.2 mm"), "{}", done.stdout);
    let found = figures(folder.path(), "distance.json");
    assert_covers(&found["against"]["mean_error_mm"], -0.327);
    assert_covers(&found["against"]["scale_error_percent"], -0.2991);

    // A lens whose distortion is wrong errs from one position to the next.
    std::fs::write(at("camera.toml"), CAMERA.replace("-0.10", "-0.06")).unwrap();
    let done = prove(folder.path(), "distance --independent good.y4m");
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert!(done.stderr.contains("the length is not known"), "{}", done.stderr);
    let found = figures(folder.path(), "distance.json");
    let lowest_mm = number(&found["scatter_mm"]["interval_95"][0]);
    assert!(lowest_mm > 2.0 * scatter_mm, "{lowest_mm} {scatter_mm}");
}

#[test]
fn a_length_that_is_no_proof_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    record(&at("one.y4m"), &GOOD, &[upright(600.0)], 40);
    let done = prove(folder.path(), "distance one.y4m");
    assert_refused(&done, &["the plate was at 1 position", "at least 10 are needed"]);
    let half = Plate { scale: 1.0, is_whole: false };
    record(&at("half.y4m"), &half, &[upright(600.0)], 40);
    let said = ["\"shoulder\" is seen in none of 40 frames", "only lumbar is seen"];
    assert_refused(&prove(folder.path(), "distance half.y4m"), &said);
    assert_refused(&prove(folder.path(), "distance none.y4m"), &["none.y4m: no such file"]);
    let done = prove(folder.path(), "distance --boards lumbar,sacrum one.y4m");
    assert_refused(&done, &["no board is called \"sacrum\"", "give one of lumbar, shoulder"]);
    let done = plumb(folder.path(), &["prove", "distance", "one.y4m"]);
    assert_refused(&done, &["one.y4m: frames need --camera and --targets", "a trial"]);
    record(&at("good.y4m"), &GOOD, &positions(), 1);
    let far = "distance --independent --length-mm 150 --length-max-error-mm 1 good.y4m";
    assert_refused(&prove(folder.path(), far), &["--length-mm: 150 mm, where", "109.0 mm apart"]);
}

/// Lifted along its normal, and each time a little beside the last place.
pub fn rests(thickness_mm: f64, places: usize) -> Vec<Pose<Cam, Target>> {
    let place = |at: usize| {
        let height_mm = if at % 2 == 1 { thickness_mm } else { 0.0 };
        let aside_mm = 0.3 * (7.0 * at as f64).sin();
        let pose = upright(620.0);
        let moved_mm = pose.rotation * Vector3::new(aside_mm, -aside_mm, -height_mm);
        Pose::new(pose.rotation, pose.translation_mm + moved_mm)
    };
    (0..places).map(place).collect()
}

#[test]
fn a_step_is_the_thickness_of_the_block() {
    let folder = folder();
    record(&folder.path().join("block.y4m"), &GOOD, &rests(5.0, 6), 60);
    let block = "step --thickness-mm 5 --thickness-max-error-mm 0.005 --limit-mm 0.05 block.y4m";
    let done = prove(folder.path(), block);
    assert_eq!(done.code, Some(0), "{} {}", done.stdout, done.stderr);
    let found = figures(folder.path(), "step.json");
    assert_covers(&found["error_mm"], 0.0);
    assert_eq!((&found["verdict"], &found["is_placing_known"]), (&"within".into(), &true.into()));
    assert_eq!(found["places"].as_array().unwrap().len(), 6);
    let (_, expanded_mm) = estimate(&found["along_normal_mm"]);
    assert!((0.001..0.03).contains(&expanded_mm), "{expanded_mm}");
}

#[test]
fn what_is_no_step_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    record(&at("still.y4m"), &GOOD, &[upright(600.0)], 60);
    let said = ["rested at 1 place for 15 frames", "a few times the noise of one frame"];
    assert_refused(&prove(folder.path(), "step still.y4m"), &said);
    // The same place in two recordings.
    let done = prove(folder.path(), "step still.y4m still.y4m");
    assert_refused(&done, &["is not larger than its uncertainty", "take a thicker block"]);
}

#[test]
fn no_input_is_overwritten_and_no_page_without_being_asked() {
    let folder = folder();
    record(&folder.path().join("still.y4m"), &GOOD, &[upright(600.0)], 90);
    let files = ["--camera", "camera.toml", "--targets", "targets.toml", "still.y4m"];
    let run = |more: &[&str]| {
        plumb(folder.path(), &[&["prove", "repeatability"], &files[..], more].concat())
    };
    assert_eq!(run(&[]).code, Some(0));
    assert_refused(&run(&[]), &["repeatability.html: exists already", "--force"]);
    assert_eq!(run(&["--force"]).code, Some(0));
    assert_refused(
        &run(&["--force", "--out", "camera.toml"]),
        &["camera.toml is one of the inputs"],
    );
    assert_refused(&run(&["--out", "figures.json"]), &["figures.json names the figures", ".html"]);
}

#[test]
fn pages_are_shown_on_screens_and_on_paper() {
    let Some(browser) = Browser::new() else { return };
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    record(&at("rests.y4m"), &GOOD, &rests(5.0, 2), 90);
    record(&at("moved.y4m"), &GOOD, &positions(), 1);
    let proofs = [
        ("repeatability --to 2.2 rests.y4m", 5, &["fitted drift", "averaging helps up to"][..]),
        ("distance --independent moved.y4m", 4, &["never visited say so", "into the depth"]),
        ("step rests.y4m", 1, &["grey where the board rested", "step, combined"]),
    ];
    for (arguments, figures, words) in proofs {
        let done = prove(folder.path(), arguments);
        assert_eq!(done.code, Some(0), "{}", done.stderr);
        let name = arguments.split(' ').next().unwrap();
        assert_shown(&browser, &at(&format!("{name}.html")), figures, 1..=4, words);
    }
}

const FRAMES: usize = 600;

/// A trial of a board that stands still, as `plumb receive --out` leaves it: 20 s of it.
fn write_trial(folder: &Path) {
    let provision = "provision --camera camera.toml --targets targets.toml --udp 127.0.0.1:4210 \
                     --out still/config.plb";
    std::fs::create_dir(folder.join("still")).unwrap();
    let done = plumb(folder, &provision.split_whitespace().collect::<Vec<_>>());
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    let manifest = Manifest::begin("2026-01-01T00:00:00Z".into(), None, None, None, Zero::Mark);
    manifest.write(&folder.join("still")).unwrap();
    let mut journal = Writer::create(&folder.join("still/packets.bin")).unwrap();
    let hello = trial::content(&hello_of("ward 3", START));
    journal.write(&Entry { host_ns: 0, content: hello }).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut noise = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut random);
    for frame in 0..FRAMES {
        let time_ns = (1e9 * frame as f64 / RATE_HZ as f64) as u64;
        let off = Vector6::from_fn(|axis, _| noise(if axis < 3 { 2e-4 } else { 0.01 }));
        let theta = upright(600.0).moved_by(&off).theta().map(|it| it as f32);
        let pose = MeasuredPose {
            theta_rad: [theta[0], theta[1], theta[2]],
            translation_mm: [theta[3], theta[4], theta[5]],
            delay_ns: 0,
            sd_mm: [0.01; 3],
            sd_rad: [2e-4; 3],
            correlations: [0.0; 15],
            rms_px: 0.05,
            corners: 30,
        };
        let target =
            TargetPacket { role: Role::Lower, state: TargetState::Tracking, pose: Ok(pose) };
        let message = Message::Pose(PosePacket {
            sequence: frame as u32,
            capture_time_ns: time_ns,
            instant: MarkedInstant::Recording,
            latency_us: 4000,
            targets: [target].into_iter().collect(),
            upper_trunk: None,
            lower_trunk: None,
        });
        // Each comes twice, as over a bad link.
        for _ in 0..2 {
            let content = trial::content(&packet(START, message.clone()));
            journal.write(&Entry { host_ns: time_ns, content }).unwrap();
        }
    }
}

#[test]
fn the_trial_of_a_box_is_a_recording_too() {
    let folder = folder();
    write_trial(folder.path());
    let done = plumb(folder.path(), &["prove", "repeatability", "still"]);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    let found = figures(folder.path(), "repeatability.json");
    assert_eq!((&found["frames"], &found["frames_in_all"]), (&FRAMES.into(), &FRAMES.into()));
    for coordinate in found["coordinates"].as_array().unwrap() {
        // Five standard deviations of what 600 frames give.
        let ratio = number(&coordinate["noise_over_stated"]["sd"]);
        assert!((ratio - 1.0).abs() < 5.0 * 0.5 * (3.0 / FRAMES as f64).sqrt(), "{coordinate}");
    }
    let done = plumb(folder.path(), &["prove", "distance", "still"]);
    assert_refused(&done, &["\"shoulder\" is seen in none of 600 frames", "only lumbar is seen"]);
    let at = |name: &str| folder.path().join(name);
    std::fs::rename(at("still"), at("first")).unwrap();
    std::fs::write(at("camera.toml"), CAMERA.replace("1000.0", "1010.0")).unwrap();
    write_trial(folder.path());
    let done = plumb(folder.path(), &["prove", "step", "first", "still"]);
    assert_refused(&done, &["still: its camera is not that of first"]);
    std::fs::remove_file(folder.path().join("still/config.plb")).unwrap();
    let done = plumb(folder.path(), &["prove", "repeatability", "--force", "still"]);
    assert_refused(&done, &["still/config.plb: the box's configuration", "is not known"]);
}
