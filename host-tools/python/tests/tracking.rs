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

/// The taken frames of a video: as they are, in 12 bits, and of half the size.
fn shorten(from: &Path, [grey8, grey12, half]: [&Path; 3]) {
    let mut source = BufReader::new(File::open(from).unwrap());
    let mut header = String::new();
    source.read_line(&mut header).unwrap();
    let side = |letter: char| -> usize {
        let side = header.split_whitespace().find_map(|it| it.strip_prefix(letter));
        side.unwrap().parse().unwrap()
    };
    let (width, height) = (side('W'), side('H'));
    let mut frame = vec![0; width * height];
    let [mut grey8, mut grey12, mut half] =
        [grey8, grey12, half].map(|path| File::create(path).unwrap());
    grey8.write_all(header.as_bytes()).unwrap();
    assert!(header.contains("Cmono"), "{header}");
    grey12.write_all(header.replace("Cmono", "Cmono12").as_bytes()).unwrap();
    let sides = |width: usize, height: usize| format!(" W{width} H{height} ");
    assert!(header.contains(&sides(width, height)), "{header}");
    let of_half = header.replace(&sides(width, height), &sides(width / 2, height / 2));
    half.write_all(of_half.as_bytes()).unwrap();
    for at in 0..TAKEN[1].end {
        let mut marker = [0; 6];
        source.read_exact(&mut marker).unwrap();
        assert_eq!(marker, MARKER);
        source.read_exact(&mut frame).unwrap();
        if TAKEN.iter().any(|taken| taken.contains(&at)) {
            let wide = frame.iter().flat_map(|&grey| (u16::from(grey) * 16 + 5).to_le_bytes());
            grey8.write_all(&[MARKER, &frame].concat()).unwrap();
            grey12.write_all(&[MARKER, &wide.collect::<Vec<u8>>()].concat()).unwrap();
            let places = (0..height / 2).flat_map(|row| (0..width / 2).map(move |at| (row, at)));
            let mean = places.map(|(row, at)| {
                let four = [0, 1, width, width + 1].map(|it| frame[2 * (row * width + at) + it]);
                (four.into_iter().map(u16::from).sum::<u16>() / 4) as u8
            });
            half.write_all(&[MARKER, &mean.collect::<Vec<u8>>()].concat()).unwrap();
        }
    }
}

#[test]
fn frames_in_arrays_have_the_poses_of_plumb() {
    let Some(bench) = Bench::new() else { return };
    let recorded = recording(STANDARD);
    let videos = ["grey8.y4m", "grey12.y4m", "half.y4m"].map(|name| bench.path(name));
    shorten(&recorded.join(FRAMES_FILE), videos.each_ref().map(|it| it.as_path()));
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
    for (how, out, video) in [
        ("--independent", "independent.csv", "grey8.y4m"),
        ("--scale-camera", "half.csv", "half.y4m"),
    ] {
        bench.plumb(&[&files[..], &scene, &[how, "--out", out, video]].concat());
    }
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
