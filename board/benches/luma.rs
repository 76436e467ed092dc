//! What each pixel format costs before a frame can be tracked: time and heap allocations, one line
//! `name, tab, value` per figure, for `cargo xtask bench`.

use std::hint::black_box;
use std::time::Instant;

use image::codecs::jpeg::JpegEncoder;
use plumbline_board::allocation::{CountingAllocator, apart};
use plumbline_board::source::v4l2::luma::Luma;
use rand::{RngExt, SeedableRng};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const SIZE_PX: (usize, usize) = (1280, 720);
const FRAMES: usize = 100;

fn main() {
    for (code, name) in
        [(b"YUYV", "yuyv"), (b"Y10P", "y10p"), (b"RGB3", "rgb24"), (b"RGGB", "bayer8")]
    {
        let luma = Luma::new(code, SIZE_PX, 0).expect("a format that is read");
        let bytes = random(luma.bytes_min());
        measure(name, luma, &bytes);
    }
    let luma = Luma::new(b"MJPG", SIZE_PX, 0).expect("a format that is read");
    let frame = compressed();
    println!("luma_mjpeg_kib\t{}", frame.len() / 1024);
    measure("mjpeg", luma, &frame);
}

fn measure(name: &str, mut luma: Luma, frame: &[u8]) {
    let mut times_us = Vec::with_capacity(FRAMES);
    let mut allocations_max = 0;
    for _ in 0..FRAMES {
        let started = Instant::now();
        let (loaded, allocations) = apart(|| luma.load(black_box(frame)));
        times_us.push(started.elapsed().as_secs_f64() * 1e6);
        loaded.expect("a whole frame");
        allocations_max = allocations_max.max(allocations);
    }
    times_us.sort_by(f64::total_cmp);
    println!("luma_{name}_median_us\t{:.1}", times_us[FRAMES / 2]);
    println!("luma_{name}_worst_us\t{:.1}", times_us[FRAMES - 1]);
    println!("luma_{name}_allocations\t{allocations_max}");
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
    JpegEncoder::new_with_quality(&mut file, 90)
        .encode(&pixels, width as u32, height as u32, image::ExtendedColorType::Rgb8)
        .expect("memory takes it");
    file
}
