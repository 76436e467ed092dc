//! `plumb demo`, with the box's real program and with programs that fail.

use crate::common::finished;
use plumbline_test_support::{RUNNER, board_beside, command};
use std::path::{Path, PathBuf};

use crate::common::finished::Finished;

fn demo(board: Option<&Path>, out: &Path) -> Finished {
    let mut command = command(env!("CARGO_BIN_EXE_plumb"));
    command.args(["demo", "--frames", "60", "--out"]).arg(out);
    match board {
        Some(board) => command.env("PLUMBLINE_BOARD", board),
        None => command.env_remove("PLUMBLINE_BOARD"),
    };
    finished::ended(command)
}

/// The box's program for `plumb` to start: beside it, or through what runs both.
fn real_box(board: &Path, folder: &Path) -> Option<PathBuf> {
    let runner = std::env::var(RUNNER).ok()?;
    Some(impostor(folder, &format!("exec {runner} '{}' \"$@\"", board.display())))
}

/// A program of our own in the box's place.
fn impostor(folder: &Path, script: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join("board.sh");
    std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

#[test]
fn the_real_box_measures_the_simulated_person() {
    let Some(board) = board_beside(env!("CARGO_BIN_EXE_plumb")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/demo");
    let finished = demo(real_box(&board, folder.path()).as_deref(), &out);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let stdout = finished.stdout;
    for part in ["Frames 60", "Packets lost 0, repeated 0, corrupt 0", "first frame: 0."] {
        assert!(stdout.contains(part), "{part:?} is not in: {stdout}");
    }
    let depths_mm: Vec<f64> = stdout
        .lines()
        .filter(|line| line.contains("spread \u{b1}"))
        .map(|line| line.split_whitespace().next_back().unwrap().parse().unwrap())
        .collect();
    // What the project asks of its first version, for the depth of both targets;
    // and no estimate from 600 corners of noisy pixels is better than a micrometre.
    assert_eq!(depths_mm.len(), 2, "{stdout}");
    assert!(depths_mm.iter().all(|depth_mm| (0.001..0.25).contains(depth_mm)), "{stdout}");
    for name in ["poses.csv", "truth.csv"] {
        let lines = std::fs::read_to_string(out.join(name)).unwrap().lines().count();
        assert_eq!(lines, 1 + 2 * 60, "{name}");
    }
    assert!(std::fs::read_to_string(out.join("sway.svg")).unwrap().ends_with("</svg>\n"));
    assert!(std::fs::metadata(out.join("frame.png")).unwrap().len() > 10_000);
}

#[test]
fn an_absent_box_is_named_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let finished = demo(Some(&folder.path().join("no-board")), folder.path());
    assert_eq!(finished.code, Some(2));
    for part in ["no-board", "PLUMBLINE_BOARD"] {
        assert!(finished.stderr.contains(part), "{part:?} is not in: {}", finished.stderr);
    }
}

#[test]
fn what_a_dying_box_says_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let dies = "echo 'no lens today' >&2; exit 3";
    // At once, and in the middle of a frame.
    for script in [dies.to_owned(), format!("head -c 100000 >/dev/null; {dies}")] {
        let board = impostor(folder.path(), &script);
        let finished = demo(Some(&board), folder.path());
        assert_eq!(finished.code, Some(2));
        for part in ["ended before the last frame", "no lens today", "exit status: 3"] {
            assert!(finished.stderr.contains(part), "{part:?} is not in: {}", finished.stderr);
        }
        assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
    }
}
