//! Tracking and calibration.

use std::fs::{self, File};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::Path;

use plumbline_test_support::{FRAMES_FILE, STANDARD, recording};

use crate::bench::Bench;

/// Frames at the beginning of the recording, and some in which an arm hides the lower target.
const TAKEN: [std::ops::Range<usize>; 2] = [0..5, 56..60];

/// "FRAME", and the end of its line.
const MARKER: &[u8] = b"FRAME\n";

/// The taken frames of a video, as they are and in 12 bits.
fn shorten(from: &Path, grey8: &Path, grey12: &Path) {
    let mut source = BufReader::new(File::open(from).unwrap());
    let mut header = String::new();
    source.read_line(&mut header).unwrap();
    let side = |letter: char| -> usize {
        let side = header.split_whitespace().find_map(|it| it.strip_prefix(letter));
        side.unwrap().parse().unwrap()
    };
    let mut frame = vec![0; side('W') * side('H')];
    let [mut grey8, mut grey12] = [grey8, grey12].map(|path| File::create(path).unwrap());
    grey8.write_all(header.as_bytes()).unwrap();
    assert!(header.contains("Cmono"), "{header}");
    grey12.write_all(header.replace("Cmono", "Cmono12").as_bytes()).unwrap();
    for at in 0..TAKEN[1].end {
        let mut marker = [0; 6];
        source.read_exact(&mut marker).unwrap();
        assert_eq!(marker, MARKER);
        source.read_exact(&mut frame).unwrap();
        if TAKEN.iter().any(|taken| taken.contains(&at)) {
            let wide = frame.iter().flat_map(|&grey| (u16::from(grey) * 16 + 5).to_le_bytes());
            grey8.write_all(&[MARKER, &frame].concat()).unwrap();
            grey12.write_all(&[MARKER, &wide.collect::<Vec<u8>>()].concat()).unwrap();
        }
    }
}

#[test]
fn frames_in_arrays_have_the_poses_of_plumb() {
    let Some(bench) = Bench::new() else { return };
    let recorded = recording(STANDARD);
    let [grey8, grey12] = ["grey8.y4m", "grey12.y4m"].map(|name| bench.path(name));
    shorten(&recorded.join(FRAMES_FILE), &grey8, &grey12);
    for name in ["camera.toml", "targets.toml", "scene.toml"] {
        fs::copy(recorded.join(name), bench.path(name)).unwrap();
    }
    let files = ["track", "--camera", "camera.toml", "--targets", "targets.toml"];
    let scene = ["--scene", "scene.toml"];
    for bits in ["grey8", "grey12"] {
        let (video, out) = (format!("{bits}.y4m"), format!("{bits}.csv"));
        bench.plumb(&[&files[..], &scene, &["--out", &out, &video]].concat());
    }
    bench.plumb(&[&files[..], &["--out", "no_scene.csv", "grey8.y4m"]].concat());
    bench.ran(bench.script("track.py"));
}

#[test]
fn a_camera_is_calibrated_as_by_plumb() {
    let Some(bench) = Bench::new() else { return };
    let board = ["--board", "9x6", "--pitch-mm", "20"];
    let out = ["--photographs", "6", "--lens", "vga", "--out", "dry"];
    bench.plumb(&[&["simulate"], &board[..], &out].concat());
    let photographs: Vec<String> = fs::read_dir(bench.path("dry/photos"))
        .unwrap()
        .map(|it| format!("dry/photos/{}", it.unwrap().file_name().display()))
        .collect();
    let mut photographs: Vec<&str> = photographs.iter().map(String::as_str).collect();
    photographs.sort_unstable();
    assert_eq!(photographs.len(), 6);
    let out = ["--model", "radial2", "--out", "plumb.toml"];
    bench.plumb(&[&["calibrate"], &board[..], &out, &photographs].concat());
    bench.ran(bench.script("calibrate.py"));
}
