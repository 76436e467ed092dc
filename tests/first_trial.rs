//! The whole way of a technician, with the programs that a technician has: a board is
//! photographed, the camera calibrated, the scene measured, the box's configuration made, and a
//! person tracked through it. Only the photographs and the person are rendered.

use std::f64::consts::PI;
use std::path::Path;
use std::process::Output;

use common::binary;
use common::photographer::{posed, save};
use nalgebra::{Rotation3, Vector3};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_files::{camera, poses, scene};

const BOARD: &str = "[[target]]
name = \"board\"
role = \"scene\"
columns = 9
rows = 6
pitch_mm = 20.0
";

fn board() -> TargetGeometry {
    TargetGeometry::checker(9, 6, 20.0, Origin::Center, Role::Scene, [0.0; 3]).unwrap()
}

fn run(directory: &Path, arguments: &[&str]) -> Output {
    binary::plumb().args(arguments).current_dir(directory).output().expect("plumb runs")
}

#[track_caller]
fn done(directory: &Path, arguments: &[&str]) -> String {
    let output = run(directory, arguments);
    let text = binary::messages(&output);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {text}");
    text
}

/// The trunk points of a target, frame by frame, about their mean.
fn sway_mm(path: &Path, target: &str) -> Vec<Vector3<f64>> {
    let rows = poses::read(path).unwrap();
    let of_target = rows.iter().filter(|row| row.target == target);
    let points: Vec<_> = of_target
        .map(|row| {
            let axes = [row.ap_mm, row.ml_mm, row.si_mm];
            Vector3::from(axes.map(|value| value.expect("a trunk point in every frame")))
        })
        .collect();
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    points.iter().map(|point| point - mean).collect()
}

#[test]
fn from_photographs_of_a_board_to_the_sway_of_a_person() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    // The person and the board, seen by a camera and in a scene that nobody is told of.
    done(directory, &["simulate", "--frames", "90", "--out", "trial"]);
    let truth = directory.join("trial");
    let board = ["--board", "9x6", "--pitch-mm", "20"];
    let with_board =
        |command: &'static str, more: &[&'static str]| [&[command], &board[..], more].concat();
    done(directory, &with_board("simulate", &["--out", "dry"]));

    let mut calibrate = with_board("calibrate", &["--out", "camera.toml"]);
    let names: Vec<String> =
        (1..=15).map(|number| format!("dry/photos/board-{number:02}.png")).collect();
    calibrate.extend(names.iter().map(String::as_str));
    let text = done(directory, &calibrate);
    // Photographs that are taken with care give no cause for a warning.
    assert!(!text.contains("warning"), "{text}");

    std::fs::write(directory.join("board.toml"), BOARD).unwrap();
    let measure = ["scene", "--camera", "camera.toml", "--targets", "board.toml"];
    let text = done(directory, &[&measure[..], &["--out", "scene.toml", "dry/scene.y4m"]].concat());
    assert!(!text.contains("warning"), "{text}");
    let measured = scene::read(&directory.join("scene.toml")).unwrap();
    let lens = camera::read(&directory.join("camera.toml")).unwrap().lens;
    assert_eq!(measured.check_lens(&lens, ""), Ok(None));
    let measured = measured.cam_from_scene();
    let known = scene::read(&directory.join("dry/truth/scene.toml")).unwrap().cam_from_scene();
    // The axes along which sway is measured are right to a twentieth of a degree.
    let off = Rotation3::from_matrix_unchecked(measured.rotation.transpose() * known.rotation);
    assert!(off.angle().to_degrees() < 0.05, "{} degrees", off.angle().to_degrees());

    let described =
        ["--camera", "camera.toml", "--targets", "trial/targets.toml", "--scene", "scene.toml"];
    let with = |command: &'static str, more: &[&'static str]| {
        let mut arguments = vec![command];
        arguments.extend(described);
        arguments.extend(more);
        arguments
    };
    done(directory, &with("provision", &["--udp", "127.0.0.1:4210", "--out", "box.plb"]));
    // What the box was given is what is tracked with.
    done(directory, &["show", "box.plb", "--out", "shown"]);
    let shown = ["camera.toml", "targets.toml", "scene.toml"].map(|name| format!("shown/{name}"));
    let mut track = vec!["track", "--camera", &shown[0], "--targets", &shown[1]];
    track.extend(["--scene", &shown[2], "--out", "poses.csv", "trial/frames.y4m"]);
    done(directory, &track);

    for target in ["lumbar", "shoulder"] {
        let found = sway_mm(&directory.join("poses.csv"), target);
        let known = sway_mm(&truth.join("truth.csv"), target);
        assert_eq!(found.len(), 90);
        let errors = found.iter().zip(&known).map(|(found, known)| (found - known).amax());
        let worst_mm = errors.fold(0.0, f64::max);
        println!("{target}: worst error of a frame's sway {worst_mm:.3} mm");
        // The design asks for 0.3. The worst of 90 unfiltered frames, whose depth has a standard
        // deviation of up to 0.026 mm, is within five of them.
        assert!(worst_mm < 0.13, "{target}: {worst_mm} mm");
    }
}

#[test]
fn a_scene_that_cannot_be_trusted_is_refused_or_warned_of() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    done(directory, &["simulate", "--frames", "2", "--out", "trial"]);
    let lens = camera::read(&directory.join("trial/camera.toml")).unwrap().lens;
    std::fs::write(directory.join("board.toml"), BOARD).unwrap();
    let record = |name: &str, poses: &[Pose<Cam, Target>]| -> Vec<String> {
        let names = (0..poses.len()).map(|index| format!("{name}{index:02}.png"));
        let names: Vec<String> = names.collect();
        for (photograph, name) in posed(&lens, &board(), poses, 3).iter().zip(&names) {
            save(photograph, &directory.join(name));
        }
        names
    };
    let scene = |targets: &str, frames: &[String]| {
        let mut arguments = vec!["scene", "--camera", "trial/camera.toml", "--targets", targets];
        arguments.extend(["--force", "--out", "scene.toml"]);
        arguments.extend(frames.iter().map(String::as_str));
        let output = run(directory, &arguments);
        (output.status.code(), binary::messages(&output))
    };
    let upright = Pose::from_theta([0.0, 0.1, 0.0, 20.0, 10.0, 900.0]);
    let few = record("few", &[upright; 3]);
    let (code, text) = scene("board.toml", &few);
    assert!(code == Some(2) && text.contains("seen in 3 of 3 frames; 10 are needed"), "{text}");
    let (code, text) = scene("trial/targets.toml", &few);
    assert!(code == Some(2) && text.contains("no target has the role \"scene\""), "{text}");
    assert!(!directory.join("scene.toml").exists());

    let leaning = Pose::from_theta([0.14, 0.1, 0.0, 20.0, 10.0, 900.0]);
    let (code, text) = scene("board.toml", &record("leaning", &[leaning; 10]));
    assert!(code == Some(0) && text.contains("the board leans by 8.0 degrees"), "{text}");

    for (turn, degrees) in [(PI, "180.0"), (PI / 2.0, "90.0")] {
        let overturned = Pose::from_theta([turn, 0.0, 0.0, 20.0, 10.0, 900.0]);
        let (code, text) = scene("board.toml", &record("overturned", &[overturned; 10]));
        let words = format!("leans by {degrees} degrees from upright");
        assert!(code == Some(0) && text.contains(&words), "{text}");
        assert!(text.contains("on its side or upside down"), "{text}");
    }

    let moving: Vec<_> = (0..10)
        .map(|frame| Pose::from_theta([0.0, 0.1, 0.0, 20.0 + f64::from(frame), 10.0, 900.0]))
        .collect();
    let (code, text) = scene("board.toml", &record("moving", &moving));
    assert!(code == Some(0) && text.contains("board or camera moved"), "{text}");
}
