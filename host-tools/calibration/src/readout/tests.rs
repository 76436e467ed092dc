//! Simulated videos whose readout time is known.

use nalgebra::{Vector3, Vector6};
use plumbline::lens::Distortion;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role};

use rayon::prelude::*;

use super::*;
use crate::model::Seen;

pub(super) const LENS: Lens = Lens {
    width_px: 1280,
    height_px: 720,
    fx_px: 1150.0,
    fy_px: 1152.0,
    cx_px: 642.0,
    cy_px: 357.0,
    skew_px: 0.0,
    distortion: Distortion::Radial2([-0.12, 0.05]),
};

const SIGMA_PX: f64 = 0.05;

pub(super) fn board() -> TargetGeometry {
    TargetGeometry::checker(7, 4, 30.0, Origin::Center, Role::Scene, [0.0; 3]).unwrap()
}

/// A board waved by hand: to and fro, up and down, and turned a little, at about 1 Hz.
pub(super) fn waved(time_s: f64) -> Pose<Cam, Target> {
    let wave = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * time_s + phase).sin();
    Pose::from_theta([
        0.1 + 0.05 * wave(0.7, 0.3),
        0.3 + 0.1 * wave(0.9, 1.0),
        -0.2 + 0.1 * wave(0.6, 2.0),
        80.0 * wave(1.1, 0.0),
        40.0 * wave(0.8, 1.5),
        700.0 + 40.0 * wave(0.5, 0.5),
    ])
}

/// A video by a camera that reads its first row at the frame's time.
struct Video {
    readout_s: f64,
    interval_s: f64,
    frames: usize,
    noise_seed: Option<u64>,
    pose: fn(f64) -> Pose<Cam, Target>,
}

impl Default for Video {
    fn default() -> Self {
        Self { readout_s: 16e-3, interval_s: 1.0 / 60.0, frames: 60, noise_seed: None, pose: waved }
    }
}

/// Normal deviates from a seed: the sum of twelve uniform ones of a linear congruential generator.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

impl Video {
    /// The corners as a frame shows them, each where it is when its row is read.
    fn frame(&self, frame: usize, noise: &mut Option<Noise>) -> Observed {
        let time_s = frame as f64 * self.interval_s;
        let mut seen = Vec::new();
        let board = board();
        let points_mm: Vec<Vector3<f64>> = points_mm(&board).collect();
        for corner in 0..board.corner_count() {
            let node = crate::observe::node_of(&board, corner);
            let mut y_px = 360.0;
            let mut raw_px = Vector2::zeros();
            for _ in 0..50 {
                let row_s = time_s + y_px / 720.0 * self.readout_s;
                raw_px = LENS.project(&(self.pose)(row_s).transform(&points_mm[node])).unwrap();
                y_px = raw_px.y;
            }
            seen.extend([Vector2::x(), Vector2::y()].map(|axis| {
                let error_px = noise.as_mut().map_or(0.0, |noise| noise.normal() * SIGMA_PX);
                Seen {
                    points: [node; 2],
                    by_px: [axis * 0.5; 2],
                    value_px: axis.dot(&raw_px) + error_px,
                    sigma_px: SIGMA_PX,
                }
            }));
        }
        // As from a fit that knows of no rolling shutter.
        let off = Vector6::new(2e-3, -3e-3, 1e-3, 0.3, -0.3, 1.0);
        let cam_from_board = (self.pose)(time_s).moved_by(&off);
        Observed(Photograph { seen: seen.into(), cam_from_board })
    }

    fn frames(&self) -> Vec<Option<Observed>> {
        let mut noise = self.noise_seed.map(Noise);
        (0..self.frames).map(|frame| Some(self.frame(frame, &mut noise))).collect()
    }

    fn estimate(&self) -> Result<Readout, Failure> {
        estimate(&LENS, &board(), self.interval_s, &self.frames())
    }
}

/// A frame in which the board is fast, with the pose that it has in the middle row.
pub(super) fn one_frame() -> Photograph {
    let video = Video::default();
    let Observed(photograph) = video.frame(0, &mut None);
    let cam_from_board = waved(0.5 * video.readout_s);
    Photograph { cam_from_board, ..photograph }
}

#[test]
fn exact_corners_give_the_exact_readout_time() {
    for readout_s in [16e-3, -16e-3, 5e-3, 0.0] {
        let found = Video { readout_s, ..Video::default() }.estimate().unwrap();
        println!("{readout_s}: {found:?}");
        assert!((found.readout_s - readout_s).abs() < 1e-8, "{found:?}");
    }
}

#[test]
fn errors_are_as_large_as_they_are_said_to_be() {
    let errors: Vec<f64> = (0..120)
        .into_par_iter()
        .map(|seed| {
            // Every third is a global shutter, every third is read from the bottom.
            let readout_s = [16e-3, 0.0, -12e-3][(seed % 3) as usize];
            let video = Video { readout_s, frames: 40, noise_seed: Some(seed), ..Video::default() };
            let found = video.estimate().unwrap();
            (found.readout_s - readout_s) / found.sd_s
        })
        .collect();
    let count = errors.len() as f64;
    let sd = (errors.iter().map(|error| error * error).sum::<f64>() / count).sqrt();
    let mean = errors.iter().sum::<f64>() / count;
    println!("normalised errors: mean {mean:.3}, SD {sd:.3}");
    assert!((sd - 1.0).abs() < 0.2, "{sd}");
    assert!(mean.abs() < 0.3, "{mean}");
}

#[test]
fn a_global_shutter_is_one_and_a_rolling_one_is_not() {
    let found = |readout_s: f64| {
        Video { readout_s, noise_seed: Some(5), ..Video::default() }.estimate().unwrap()
    };
    assert!(found(0.0).is_global());
    assert!(!found(1e-3).is_global());
    assert!(!found(-1e-3).is_global());
}

#[test]
fn dropped_and_repeated_frames_and_gaps_do_not_spoil_the_readout_time() {
    let video = Video { frames: 140, ..Video::default() };
    let mut frames = video.frames();
    // The board is covered for two frames; where it is fast, a frame is dropped and another shown
    // twice.
    frames[30..32].fill(None);
    frames.remove(54);
    frames[110] = frames[109].clone();
    let found = estimate(&LENS, &board(), video.interval_s, &frames).unwrap();
    assert!(found.irregular >= 2, "{found:?}");
    assert!((found.readout_s - 16e-3).abs() < 1e-6, "{found:?}");
}

#[test]
fn videos_that_do_not_tell_are_refused_with_the_reason() {
    let still = Video { pose: |_| waved(0.0), noise_seed: Some(1), ..Video::default() }.estimate();
    assert!(matches!(still, Err(Failure::AtRest(speed_px_s)) if speed_px_s < 20.0), "{still:?}");

    let one = Video { frames: 1, ..Video::default() }.estimate();
    assert_eq!(one, Err(Failure::TooFew(1)));

    // The board is lost again and again.
    let video = Video::default();
    let mut frames = video.frames();
    frames.iter_mut().step_by(WINDOW).for_each(|frame| *frame = None);
    let gaps = estimate(&LENS, &board(), video.interval_s, &frames);
    assert_eq!(gaps, Err(Failure::TooFew(0)));

    // Of frames without neighbours nobody can say that the board was at rest.
    let mut frames = Video { frames: 2 * FRAMES_MIN, ..Video::default() }.frames();
    frames.iter_mut().step_by(2).for_each(|frame| *frame = None);
    let alone = estimate(&LENS, &board(), video.interval_s, &frames);
    assert_eq!(alone, Err(Failure::TooFew(0)));

    // 60 Hz in a file of 30 Hz, in which every second frame was dropped now and then.
    let frames: Vec<_> = Video { frames: 240, ..Video::default() }
        .frames()
        .into_iter()
        .enumerate()
        .filter(|(place, _)| place % 7 != 0)
        .map(|(_, frame)| frame)
        .collect();
    let varying = estimate(&LENS, &board(), video.interval_s, &frames);
    assert!(matches!(varying, Err(Failure::Irregular(..))), "{varying:?}");
}
