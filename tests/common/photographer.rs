//! Photographs of a printed board, rendered through a lens that is known.

use std::path::Path;

use nalgebra::Vector3;
use plumbline::lens::Lens;
use plumbline::parts::points_mm;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::TargetGeometry;
use plumbline_calibration::Picture;
use plumbline_render::simulate::render::{
    Board, Ink, Picture as Rendered, PlacedBoard, render_targets,
};
use plumbline_render::simulate::sensor::Sensor;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

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
        render_targets(lens, 0.6, &[placed], |_, _| 1.0, &mut picture);
        let mut samples = vec![0_u8; width * height];
        Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, seed, index as u64, &mut samples);
        Picture { place: format!("{index}.png"), samples, width, height }
    };
    poses.iter().enumerate().map(photograph).collect()
}

fn printed(geometry: &TargetGeometry) -> Board {
    Board::new(geometry, 15.0, Ink { black: 30.0, white: 210.0 })
}

/// As PNG.
#[allow(dead_code, reason = "the booted box takes its photographs itself")]
pub fn save(photograph: &Picture, path: &Path) {
    let (width, height) = (photograph.width as u32, photograph.height as u32);
    image::GrayImage::from_raw(width, height, photograph.samples.clone())
        .expect("as many samples as pixels")
        .save(path)
        .expect("a file in a temporary directory");
}
