//! Frames and times that no camera should deliver: they give a reason, never a panic, never a pose.

use plumbline::image::{GreyImage, ImageError};
use plumbline::pipeline::Pipeline;
use plumbline::report::NoPose;
use rand::{Rng, SeedableRng};
use recorded::{FRAME_NS, Recorded};

fn pipeline() -> Box<Pipeline> {
    Recorded::read(0).pipeline()
}

const SIZE: [usize; 2] = [1456, 1088];

#[test]
fn frames_of_nothing_and_of_noise_give_reasons() {
    let [width, height] = SIZE;
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let mut noise = vec![0_u8; width * height];
    random.fill_bytes(&mut noise);
    let stripes: Vec<u8> = (0..width * height).map(|i| (i % width / 7 % 2 * 255) as u8).collect();
    // A wall of checks: corners everywhere, and no target of the right size.
    let checks: Vec<u8> =
        (0..width * height).map(|i| ((i % width / 20 + i / width / 20) % 2 * 255) as u8).collect();
    let mut pipeline = pipeline();
    for (name, pixels) in [
        ("black", vec![0; width * height]),
        ("white", vec![255; width * height]),
        ("noise", noise),
        ("stripes", stripes),
        ("checks", checks),
    ] {
        let frame = GreyImage::new(&pixels, width, height, width).unwrap();
        for step in 0..3 {
            let report = pipeline.step(&frame, step);
            for target in &report.targets {
                assert!(
                    matches!(target.measurement, Err(NoPose::NotFound(_))),
                    "{name}: {:?}",
                    target.measurement
                );
            }
            assert_eq!((report.upper_trunk, report.lower_trunk), (None, None));
        }
    }
}

#[test]
fn sixteen_bit_frames_of_any_white_level_are_taken() {
    let [width, height] = SIZE;
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(2);
    let pixels: Vec<u16> = (0..width * height).map(|_| random.next_u32() as u16).collect();
    let mut pipeline = pipeline();
    // Also samples brighter than white, as a wrong setting gives them.
    for white_level in [1, 1023, 65_535] {
        let frame =
            GreyImage::with_white_level(&pixels, width, height, width, white_level).unwrap();
        let report = pipeline.step(&frame, 0);
        assert!(report.targets.iter().all(|target| target.measurement.is_err()));
    }
}

#[test]
fn frames_of_another_size_are_named() {
    let pixels = vec![128_u8; 4096 * 4096];
    let mut pipeline = pipeline();
    for (width, height, stride) in
        [(64, 64, 64), (1455, 1088, 1456), (4096, 4096, 4096), (64, 4096, 4000)]
    {
        let frame = GreyImage::new(&pixels, width, height, stride).unwrap();
        let report = pipeline.step(&frame, 0);
        assert!(
            report.targets.iter().all(|target| target.measurement == Err(NoPose::FrameSize)),
            "{width} x {height}"
        );
    }
    for (width, height, stride, error) in [
        (0, 0, 0, ImageError::Size),
        (usize::MAX, usize::MAX, usize::MAX, ImageError::Size),
        (1456, 1088, 1455, ImageError::Stride),
        (1456, 1088, usize::MAX / 2, ImageError::TooShort),
        (4096, 4096, 4097, ImageError::TooShort),
    ] {
        assert_eq!(GreyImage::new(&pixels, width, height, stride).err(), Some(error));
    }
}

#[test]
fn a_stride_wider_than_the_frame_gives_the_same_poses() {
    let recorded = Recorded::read(3);
    let [width, height] = SIZE;
    let stride = width + 37;
    let mut packed_pipeline = pipeline();
    let mut padded_pipeline = pipeline();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    for (frame, packed) in recorded.frames.iter().enumerate() {
        // The padding holds noise: nothing may read it.
        let mut padded = vec![0_u8; stride * height];
        random.fill_bytes(&mut padded);
        for (row, from) in packed.chunks(width).enumerate() {
            padded[row * stride..][..width].copy_from_slice(from);
        }
        let time_ns = frame as u64 * FRAME_NS;
        let one = packed_pipeline.step(&recorded.view(packed), time_ns);
        let view = GreyImage::new(&padded, width, height, stride).unwrap();
        let other = padded_pipeline.step(&view, time_ns);
        assert!(one.targets.iter().all(|target| target.measurement.is_ok()));
        assert_eq!(one, other);
    }
}

#[test]
fn time_that_stands_still_jumps_or_runs_back_does_no_harm() {
    let recorded = Recorded::read(2);
    let mut pipeline = pipeline();
    for (step, time_ns) in
        [0, 0, 16_666_667, 5, u64::MAX, u64::MAX, 0, 1 << 63, 3].into_iter().enumerate()
    {
        let report = pipeline.step(&recorded.view(&recorded.frames[step % 2]), time_ns);
        for target in &report.targets {
            assert!(target.measurement.is_ok(), "{time_ns}: {:?}", target.measurement);
        }
    }
}

#[test]
fn a_pipeline_without_a_configuration_reports_no_targets() {
    let pixels = vec![0_u8; 64 * 64];
    let frame = GreyImage::new(&pixels, 64, 64, 64).unwrap();
    assert!(Pipeline::new().step(&frame, 0).targets.is_empty());
}
