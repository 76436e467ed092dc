//! What each pixel format of a camera costs before a frame can be tracked: time, and what decoding
//! allocates. One line `name, tab, value` per figure, for `cargo xtask bench`.
//!
//! `cargo bench --package plumbline-board --bench luma -- FORMAT` runs one format, for a profiler.

use std::hint::black_box;
use std::time::Instant;

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use plumbline_board::allocation::{Allocated, CountingAllocator, apart};
use plumbline_board::source::v4l2::luma::Luma;
use rand::{RngExt, SeedableRng};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const SIZE_PX: (usize, usize) = (1280, 720);
const FRAMES: usize = 100;

/// Of the compressed frame: as USB cameras have it by default.
const QUALITY: u8 = 90;

fn main() {
    // Cargo adds an option of its own.
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    for (code, name) in [
        (b"YUYV", "yuyv"),
        (b"Y10P", "y10p"),
        (b"RGB3", "rgb24"),
        (b"RGGB", "bayer8"),
        (b"MJPG", "mjpeg"),
    ] {
        if wanted.as_ref().is_none_or(|wanted| wanted == name) {
            let luma = Luma::new(code, SIZE_PX, 0).expect("a format that is read");
            let frame = if code == b"MJPG" { compressed() } else { random(luma.bytes_min()) };
            measure(name, luma, &frame);
        }
    }
}

fn measure(name: &str, mut luma: Luma, frame: &[u8]) {
    let mut times_us = Vec::with_capacity(FRAMES);
    let mut most = Allocated::default();
    for _ in 0..FRAMES {
        let started = Instant::now();
        let (loaded, allocated) = apart(|| luma.load(black_box(frame)));
        times_us.push(started.elapsed().as_secs_f64() * 1e6);
        loaded.expect("a whole frame");
        most.count = most.count.max(allocated.count);
        most.bytes = most.bytes.max(allocated.bytes);
    }
    times_us.sort_by(f64::total_cmp);
    println!("luma_{name}_frame_kib\t{}", frame.len().div_ceil(1024));
    println!("luma_{name}_median_us\t{:.1}", times_us[FRAMES / 2]);
    println!("luma_{name}_worst_us\t{:.1}", times_us[FRAMES - 1]);
    println!("luma_{name}_allocations\t{}", most.count);
    println!("luma_{name}_allocated_kib\t{}", most.bytes.div_ceil(1024));
}

fn random(count: usize) -> Vec<u8> {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    (0..count).map(|_| random.random()).collect()
}

/// A frame as a colour camera compresses a room: smooth walls, a part full of edges, and noise.
fn compressed() -> Vec<u8> {
    let (width, height) = SIZE_PX;
    let noise = random(width * height);
    let pixel = |place: usize| {
        let (x, y) = (place % width, place / width);
        let wall = 60 + x / 16 + y / 12;
        let checks = if x < width / 4 && (x / 16 + y / 16).is_multiple_of(2) { 90 } else { 0 };
        [(wall + checks) as u8 + noise[place] % 8; 3]
    };
    let pixels: Vec<u8> = (0..width * height).flat_map(pixel).collect();
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, QUALITY);
    encoder.set_sampling_factor(SamplingFactor::R_4_2_2);
    encoder
        .encode(&pixels, width as u16, height as u16, ColorType::Rgb)
        .expect("a frame of this size");
    file
}
