//! Photographs of a printed board, rendered through a lens that is known.

use std::path::Path;

use nalgebra::Vector3;
use plumbline::lens::{Distortion, Lens};
use plumbline::parts::points_mm;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_calibration::Picture;
use plumbline_render::simulate::render::{
    Board, Ink, Picture as Rendered, PlacedBoard, render_targets, render_targets_by_row,
};
use plumbline_render::simulate::sensor::Sensor;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A usual lens.
pub const LENS: Lens = Lens {
    width_px: 800,
    height_px: 600,
    fx_px: 1000.0,
    fy_px: 1002.0,
    cx_px: 408.0,
    cy_px: 293.0,
    skew_px: 0.0,
    distortion: Distortion::Radial2([-0.12, 0.08]),
};

/// The pitch of [`board`].
pub const PITCH_MM: f64 = 20.0;

/// The calibration board.
pub fn board() -> TargetGeometry {
    TargetGeometry::checker(9, 7, PITCH_MM, Origin::Center, Role::Scene, [0.0; 3])
        .expect("a usual board")
}

/// A pose that shows all of the board.
fn random_pose(lens: &Lens, board: &TargetGeometry, random: &mut ChaCha8Rng) -> Pose<Cam, Target> {
    let points: Vec<Vector3<f64>> = points_mm(board).collect();
    loop {
        let mut tilt = || random.random_range(-0.6..0.6);
        let [yaw, pitch] = [tilt(), tilt()];
        let roll = random.random_range(-0.3..0.3);
        let z_mm = random.random_range(0.45..0.9) * lens.fx_px;
        let mut side_mm =
            |side_px: u16| random.random_range(-0.4..0.4) * f64::from(side_px) / lens.fx_px * z_mm;
        let place = [side_mm(lens.width_px), side_mm(lens.height_px)];
        let pose = Pose::from_theta([roll, yaw, pitch, place[0], place[1], z_mm]);
        let inside = |point: &Vector3<f64>| {
            lens.project(&pose.transform(point)).is_some_and(|px| {
                (12.0..f64::from(lens.width_px) - 12.0).contains(&px.x)
                    && (12.0..f64::from(lens.height_px) - 12.0).contains(&px.y)
            })
        };
        if points.iter().all(inside) {
            return pose;
        }
    }
}

/// Photographs of a board at random poses.
pub fn photographs(lens: &Lens, board: &TargetGeometry, count: usize, seed: u64) -> Vec<Picture> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let poses: Vec<_> = (0..count).map(|_| random_pose(lens, board, &mut random)).collect();
    posed(lens, board, &poses, seed)
}

/// A photograph of each pose.
pub fn posed(
    lens: &Lens,
    board: &TargetGeometry,
    poses: &[Pose<Cam, Target>],
    seed: u64,
) -> Vec<Picture> {
    let print = printed(board);
    let (width, height) = (usize::from(lens.width_px), usize::from(lens.height_px));
    let photograph = |(index, &cam_from_target): (usize, &Pose<Cam, Target>)| {
        let mut picture = Rendered::uniform(width, height, 110.0);
        let placed = PlacedBoard { board: &print, cam_from_target };
        render_targets(lens, 0.6, &[placed], &|_, _| 1.0, &mut picture);
        let mut samples = vec![0_u8; width * height];
        Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, seed, index as u64, &mut samples);
        Picture { place: format!("{index}.png"), samples, width, height }
    };
    poses.iter().enumerate().map(photograph).collect()
}

/// A video of a board that moves, by a sensor that reads one row after the other.
pub struct Video<'a> {
    /// The camera.
    pub lens: &'a Lens,
    /// What it films.
    pub board: &'a TargetGeometry,
    /// Where the board is at a time, in seconds.
    pub cam_from_board: fn(f64) -> Pose<Cam, Target>,
    /// Frames per second.
    pub rate_hz: f64,
    /// From the top row to that below the bottom one; negative if the bottom row is read first.
    pub readout_s: f64,
}

impl Video<'_> {
    /// A frame; its top row is read at its time.
    pub fn frame(&self, index: usize) -> Vec<u8> {
        let print = printed(self.board);
        let (width, height) = (usize::from(self.lens.width_px), usize::from(self.lens.height_px));
        let placed = |y: usize| {
            let row_s = y as f64 / height as f64 * self.readout_s;
            let cam_from_target = (self.cam_from_board)(index as f64 / self.rate_hz + row_s);
            [PlacedBoard { board: &print, cam_from_target }]
        };
        let rows: Vec<_> = (0..height).map(placed).collect();
        let mut picture = Rendered::uniform(width, height, 110.0);
        render_targets_by_row(self.lens, 0.6, &|y| &rows[y], &|_, _| 1.0, &mut picture);
        let mut samples = vec![0_u8; width * height];
        Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, 1, index as u64, &mut samples);
        samples
    }
}

/// Grey frames as Y4M.
pub fn y4m(frames: &[Vec<u8>], [width, height]: [u16; 2], rate_hz: u32) -> Vec<u8> {
    let mut file = format!("YUV4MPEG2 W{width} H{height} F{rate_hz}:1 Cmono\n").into_bytes();
    for frame in frames {
        file.extend_from_slice(b"FRAME\n");
        file.extend_from_slice(frame);
    }
    file
}

/// As Y4M.
pub fn save_video(frames: &[Vec<u8>], size_px: [u16; 2], rate_hz: u32, path: &Path) {
    std::fs::write(path, y4m(frames, size_px, rate_hz)).expect("a file in a temporary directory");
}

fn printed(geometry: &TargetGeometry) -> Board {
    Board::new(geometry, 15.0, Ink { black: 30.0, white: 210.0 })
}

/// As PNG.
pub fn save(photograph: &Picture, path: &Path) {
    let (width, height) = (photograph.width as u32, photograph.height as u32);
    image::GrayImage::from_raw(width, height, photograph.samples.clone())
        .expect("as many samples as pixels")
        .save(path)
        .expect("a file in a temporary directory");
}
