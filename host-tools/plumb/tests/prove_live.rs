//! `plumb prove` with a live box: the box's real program plays a rendered session, and `plumb prove`
//! guides through it, from its first word to the page.

use std::io::{BufRead, BufReader};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use plumbline::pose::{Cam, Pose, Target};
use plumbline_evidence::volume::{Coverage, Volume};
use plumbline_test_support::command;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::common::keys;
use crate::live_box::{Bench, Running, Said, board};
use crate::prove::{CAMERA, GOOD, LENGTH_MM, TARGETS, assert_covers, figures, lens, record};
use crate::prove::{rests, upright};

/// Between these the plate is moved.
const DEPTH_MM: [f64; 2] = [460.0, 700.0];

/// A box that plays a plate at these poses, for a number of frames each, over and over. `None` where
/// the box's program is not built.
fn playing(poses: &[Pose<Cam, Target>], frames: usize) -> Option<(Bench, Running)> {
    let board = board()?;
    let bench = Bench::new(TARGETS);
    bench.write("camera.toml", CAMERA);
    bench.provision("--box box.toml --out box.plb").exits(0);
    record(&bench.path("trial.y4m"), &GOOD, poses, frames);
    let running = Running::start(&board, bench.folder.path(), true);
    Some((bench, running))
}

/// Positions of the plate that visit every part of the volume and every direction: drawn at random,
/// and kept if both boards are wholly in the picture and both ends visit a new part; or one of them,
/// where no such position is found. Of few positions the recording is short.
fn everywhere() -> Vec<Pose<Cam, Target>> {
    let volume = Volume { lens: lens(), depth_mm: DEPTH_MM };
    let boards = GOOD.boards();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut poses, mut ends_mm) = (Vec::new(), Vec::<[Vector3<f64>; 2]>::new());
    let mut in_vain = 0;
    while ends_mm.is_empty() || volume.coverage(&ends_mm).next().is_some() {
        let mut within = |half: f64| random.random_range(-half..half);
        let z_mm = 0.5 * (DEPTH_MM[0] + DEPTH_MM[1]) + within(115.0);
        let [turn_1, turn_2, turn_3] = [within(3.1), within(0.5), within(0.5)];
        let [x_mm, y_mm] = [within(0.4) * z_mm, within(0.3) * z_mm];
        let pose = Pose::from_theta([turn_1, turn_2, turn_3, x_mm, y_mm, z_mm]);
        // A rectangle around both boards with their white margins.
        let corners = [[-30.0, -30.0], [100.0, -30.0], [-30.0, 180.0], [100.0, 180.0]];
        let is_inside = corners.iter().all(|[x, y]| {
            let pixel = volume.lens.project(&pose.transform(&Vector3::new(*x, *y, 0.0)));
            pixel.is_some_and(|it| (0.0..799.0).contains(&it.x) && (0.0..599.0).contains(&it.y))
        });
        let own_mm = [0, 1].map(|at| (pose * boards[at].1).translation_mm);
        let with = [&ends_mm[..], &[own_mm]].concat();
        let [before, after] = [&ends_mm, &with].map(|it| volume.coverage(it));
        let wanted = if in_vain < 5000 { 2 } else { 1 };
        let is_new = after.visited() >= before.visited() + wanted;
        in_vain += 1;
        if is_inside && (is_new || before.visited() == Coverage::ZONES) {
            (ends_mm, poses, in_vain) = (with, [&poses[..], &[pose]].concat(), 0);
        }
    }
    poses
}

#[test]
fn a_length_is_proven_all_over_the_volume_until_it_is_enough() {
    // For a second after each jump the box expects the boards where they were.
    let Some((bench, _running)) = playing(&everywhere(), 42) else { return };
    let said = bench.plumb(&format!(
        "prove distance --udp UDP --seconds 120 --depth-mm {}-{} --length-mm {LENGTH_MM} \
         --length-max-error-mm 0.05 --limit-mm 0.3",
        DEPTH_MM[0], DEPTH_MM[1]
    ));
    said.exits(0).says(&[
        "ward 3 (PL-0001)",
        "120 s left: bring the plate to another place, and hold it still for a moment (0 of 10)",
        " mm from the camera (",
        " of 27)",
        "that is enough",
        "within the limit of 0.3 mm",
        "Next: go on with `plumb prove step`.",
        "distance.html: open it in a browser",
    ]);
    let found = figures(bench.folder.path(), "distance.json");
    assert_eq!(found["verdict"], "within");
    assert_covers(&found["against"]["mean_error_mm"], 0.0);
    assert!(std::fs::read_to_string(bench.path("distance.html")).unwrap().contains("PL-0001"));
}

#[test]
fn a_step_is_proven_rest_by_rest() {
    let Some((bench, _running)) = playing(&rests(5.0, 6), 120) else { return };
    let arguments = "prove step --udp UDP --seconds 90 --thickness-mm 5 \
                     --thickness-max-error-mm 0.005 --limit-mm 0.1";
    bench.plumb(arguments).exits(0).says(&[
        "let the board rest (0 of 6)",
        "put the board down with the block, and let it rest (1 of 6)",
        "put the board down without the block, and let it rest (2 of 6)",
        "put the board down with the block, and let it rest (5 of 6)",
        "that is enough",
        "within the limit of 0.1 mm",
        "Next: the step agrees with the block",
    ]);
    let found = figures(bench.folder.path(), "step.json");
    assert_covers(&found["error_mm"], 0.0);
    assert!(found["places"].as_array().unwrap().len() >= 6);
}

#[test]
fn a_board_that_stands_still_is_proven_until_the_user_ends_it() {
    let Some((bench, running)) = playing(&[upright(600.0)], 300) else { return };
    let udp = bench.udp.to_string();
    let begun = Instant::now();
    let mut child = command(env!("CARGO_BIN_EXE_plumb"))
        .args(["prove", "repeatability", "--udp", &udp, "--seconds", "60"])
        .env("XDG_DATA_HOME", keys::data(bench.folder.path()))
        .current_dir(bench.folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let mut said = String::new();
    let mut wait_until_said = |part: &str| {
        while !said.contains(part) {
            said +=
                &(lines.next().unwrap_or_else(|| panic!("no {part:?} in {said}")).unwrap() + "\n");
        }
    };
    wait_until_said("s left: keep away");
    std::thread::sleep(Duration::from_secs(4));
    // The box stops, and then the user.
    drop(running);
    wait_until_said("s left: no frame comes");
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    said.extend(lines.map(|line| line.unwrap() + "\n"));
    let output = Output { stderr: said.into_bytes(), ..child.wait_with_output().unwrap() };
    assert!(begun.elapsed() < Duration::from_secs(40));
    Said::of("prove repeatability", &output).exits(0).says(&[
        "s left: keep away from board and camera",
        "s left: no frame comes from the box: check its power",
        "Drift per minute",
        "repeatability.html: open it in a browser",
    ]);
    let found = figures(bench.folder.path(), "repeatability.json");
    assert_eq!(found["board"], "lumbar");
}

#[test]
fn a_session_that_can_come_to_nothing_ends_at_once() {
    let Some((bench, _running)) = playing(&[upright(600.0), upright(603.0)], 90) else { return };
    let begun = Instant::now();
    let prove =
        |arguments: &str| bench.plumb(&format!("prove {arguments} --udp UDP --seconds 300"));
    prove("repeatability").exits(2).says(&["the board moved at ", " mm and ", "record again"]);
    prove("repeatability --board sacrum")
        .exits(2)
        .says(&["no board is called \"sacrum\"; give one of lumbar, shoulder"]);
    prove("distance --boards lumbar,sacrum").exits(2).says(&["no board is called \"sacrum\""]);
    prove("step --board sacrum").exits(2).says(&["no board is called \"sacrum\""]);
    prove("distance --length-mm 190 --length-max-error-mm 1")
        .exits(2)
        .says(&["--length-mm: 190 mm, where", "inner corners are 109.0 mm apart"]);
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
}

#[test]
fn what_is_not_seen_is_said_with_what_to_do() {
    // The upper board's half is beside the picture.
    let beside = Pose::from_theta([0.0, 0.0, 0.0, -30.0, 60.0, 500.0]);
    let Some((bench, _running)) = playing(&[beside], 300) else { return };
    let distance = bench.plumb("prove distance --udp UDP --seconds 5").exits(2);
    distance.says(&[
        "s left: shoulder is not seen (",
        "): hold the plate so that both boards are wholly in the picture",
        "\"shoulder\" is seen in none of",
    ]);
    let step = bench.plumb("prove step --board shoulder --udp UDP --seconds 5").exits(2);
    step.says(&["s left: shoulder is not seen (", "\"shoulder\" is seen in none of"]);
}
