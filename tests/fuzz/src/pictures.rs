//! Pictures and videos that are given to the host (Y4M, PNG, JPEG, PGM), and compressed frames of a
//! camera at the box.
//!
//! The first byte chooses who reads; the rest is the file.
//!
//! Laws: all frames of a source have its size, a number that rises by one, and a time that does not fall;
//! a Y4M file has no more frames than its bytes hold; the box and the host read the same frames of a grey
//! video; a camera's frame that is taken has the size that was configured.

use std::cell::OnceCell;
use std::fs;
use std::path::PathBuf;

use image::{GrayImage, ImageFormat, Luma as Grey, RgbImage};
use plumbline_board::source::v4l2::luma::Luma;
use plumbline_files::frames::{FrameSource, Pixels};
use tempfile::TempDir;

/// The host's reader.
const FILE: u8 = 0;
/// The box's reader of a camera's compressed frames; two bytes follow that say the size.
const CAMERA: u8 = 1;

/// Frames that are looked at.
const FRAMES_MAX: u64 = 64;

/// The sides of a camera's frame.
const SIDES_PX: [usize; 4] = [64, 72, 80, 168];

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let Some((way, rest)) = bytes.split_first() else { return };
    match way % 2 {
        FILE => file(rest),
        _ => camera(rest),
    }
}

fn file(bytes: &[u8]) {
    thread_local! {
        static FOLDER: OnceCell<TempDir> = const { OnceCell::new() };
    }
    let path = FOLDER.with(|folder| {
        let make = || tempfile::tempdir().expect("a temporary folder");
        folder.get_or_init(make).path().join("input")
    });
    fs::write(&path, bytes).expect("a temporary file");
    let Ok(mut source) = FrameSource::open(&[PathBuf::from(&path)], None) else { return };
    let (width, height) = (source.width(), source.height());
    assert!(source.rate_hz().is_finite() && source.rate_hz() > 0.0);
    let is_video = bytes.starts_with(b"YUV4MPEG2");
    let (mut frames, mut time_ns) = (0, 0);
    while frames < FRAMES_MAX {
        let Ok(Some(frame)) = source.next_frame() else { break };
        assert_eq!((frame.width, frame.height), (width, height));
        assert_eq!(frame.index, frames);
        assert!(frame.capture_time_ns >= time_ns);
        let samples = match frame.pixels {
            Pixels::Grey8(samples) => samples.len(),
            Pixels::Grey16(samples) => samples.len(),
        };
        assert_eq!(samples, width * height);
        assert!(frame.white_level > 0);
        time_ns = frame.capture_time_ns;
        frames += 1;
        let least = frames as usize * width * height;
        assert!(!is_video || bytes.len() > least, "{frames} frames of {} bytes", bytes.len());
    }
    assert!(is_video || frames <= 1);
}

fn camera(bytes: &[u8]) {
    let [columns, rows, file @ ..] = bytes else { return };
    let side = |byte: &u8| SIDES_PX[usize::from(*byte) % SIDES_PX.len()];
    let size_px = (side(columns), side(rows));
    let mut luma = Luma::new(b"MJPG", size_px, 0).expect("a size that can be tracked");
    if luma.load(file).is_err() {
        return;
    }
    let found = luma.view(&[], &[]).expect("a frame that was loaded is there");
    let plumbline_board::source::Pixels::Grey8(frame) = found else { panic!("8 bits") };
    assert_eq!((frame.width(), frame.height()), size_px);
}

/// A small picture in each format, and small videos.
pub fn seeds() -> Vec<Vec<u8>> {
    let grey =
        GrayImage::from_fn(80, 64, |x, y| Grey([if (x / 8 + y / 8) % 2 == 0 { 30 } else { 220 }]));
    let deep =
        image::ImageBuffer::<Grey<u16>, _>::from_fn(64, 64, |x, y| Grey([(97 * x + y) as u16]));
    let colour = RgbImage::from_fn(72, 64, |x, y| image::Rgb([(x / 9) as u8, (y / 8) as u8, 60]));
    let mut files: Vec<Vec<u8>> = Vec::new();
    let mut add = |picture: image::DynamicImage, formats: &[ImageFormat]| {
        for format in formats {
            let mut file = std::io::Cursor::new(Vec::new());
            picture.write_to(&mut file, *format).expect("it can be written");
            files.push(file.into_inner());
        }
    };
    add(grey.clone().into(), &[ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Pnm]);
    add(deep.into(), &[ImageFormat::Png, ImageFormat::Pnm]);
    add(colour.clone().into(), &[ImageFormat::Png, ImageFormat::Jpeg]);
    for head in ["W64 H64 F30:1 Ip Cmono", "W64 H64 F60:1", "W64 H64 F30000:1001 Ip A1:1 C420p10"] {
        let bytes = if head.contains("mono") { 64 * 64 } else { 3 * 64 * 64 };
        let frame: Vec<u8> = (0..bytes).map(|it| (it / 700) as u8).collect();
        let mut video = format!("YUV4MPEG2 {head}\n").into_bytes();
        for _ in 0..2 {
            video.extend(b"FRAME\n");
            video.extend(&frame[..if head.contains("F60") { 64 * 96 } else { bytes }]);
        }
        files.push(video);
    }
    let mut seeds: Vec<Vec<u8>> =
        files.into_iter().map(|file| [&[FILE], &file[..]].concat()).collect();
    // As cameras send them.
    use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
    for (factor, interval) in
        [(SamplingFactor::R_4_2_2, 0), (SamplingFactor::R_4_2_0, 3), (SamplingFactor::R_4_4_4, 0)]
    {
        let mut file = vec![CAMERA, 1, 0];
        let mut encoder = Encoder::new(&mut file, 60);
        encoder.set_sampling_factor(factor);
        encoder.set_restart_interval(interval);
        encoder.encode(&colour, 72, 64, ColorType::Rgb).expect("it can be written");
        seeds.push(file);
    }
    let mut file = vec![CAMERA, 2, 0];
    Encoder::new(&mut file, 70).encode(&grey, 80, 64, ColorType::Luma).expect("it can be written");
    seeds.push(file);
    seeds
}
