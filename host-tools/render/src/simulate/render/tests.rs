//! Verifies the renderer against a brute-force reference that uses neither the affine approximation
//! nor the normal CDF.

use plumbline::lens::Distortion;
use plumbline::target::{Origin, Role};

use super::*;

const INK: Ink = Ink { black: 60.0, white: 180.0 };
const BACKGROUND: f64 = 30.0;

/// Sub-samples per pixel and axis.
const FINE: usize = 64;

/// A sub-sample whose corners differ contains an edge and is computed as the mean of this many
/// points per axis: an edge parallel to the pixels is then accurate to 1/64/16/2 = 0.0005 px, 0.04
/// levels of 120, and a slanted one far better.
const FINER: usize = 16;

/// Half the width of the brute-force blur, in px: 6 sigma and the pixel itself.
fn blur_half_px(sigma_px: f64) -> usize {
    (6.0 * sigma_px + 1.0).ceil() as usize
}

fn mild() -> Lens {
    Lens {
        width_px: 1456,
        height_px: 1088,
        fx_px: 1740.0,
        fy_px: 1740.0,
        cx_px: 731.3,
        cy_px: 540.6,
        skew_px: 0.0,
        distortion: Distortion::Radial2([-0.12, 0.05]),
    }
}

fn wide() -> Lens {
    let distortion = Distortion::Brown5([-0.28, 0.09, 0.001, -0.0008, -0.008]);
    Lens { fx_px: 800.0, fy_px: 805.0, skew_px: 0.7, distortion, ..mild() }
}

fn board() -> Board {
    let geometry =
        TargetGeometry::checker(5, 4, 12.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap();
    Board::new(&geometry, 12.0, INK)
}

/// A pose whose origin is seen at this raw pixel, at this depth, with these Euler angles.
fn pose_at(lens: &Lens, raw_px: [f64; 2], z_mm: f64, angles_rad: [f64; 3]) -> Pose<Cam, Target> {
    let ray = lens.ray_from_raw(&Vector2::from(raw_px)).unwrap();
    let [a, b, c] = angles_rad;
    Pose::from_theta([a, b, c, ray.x * z_mm, ray.y * z_mm, z_mm])
}

/// The patch's pixels by brute force: samples the unblurred scene at 64 x 64 points per pixel (1024
/// x 1024 at the edges) through the exact lens and plane, and sums them with Gaussian weights
/// integrated over the pixel's square.
fn brute_force(
    lens: &Lens,
    sigma_px: f64,
    board: &Board,
    cam_from_target: &Pose<Cam, Target>,
    corner: [usize; 2],
    side: usize,
) -> Vec<f64> {
    let half = blur_half_px(sigma_px);
    let fine_side = (side + 2 * half) * FINE;
    let map = PlaneMap::new(cam_from_target).unwrap();
    let sample = |fine_x: f64, fine_y: f64| {
        let at = |fine: f64, start: usize| start as f64 - half as f64 - 0.5 + fine / FINE as f64;
        let raw_px = Vector2::new(at(fine_x, corner[0]), at(fine_y, corner[1]));
        let (point, _) = map.point_with_jacobian(&lens.ray_from_raw(&raw_px).unwrap());
        board.grey_at(point.x, point.y).unwrap_or(BACKGROUND)
    };
    // The weight of a sub-sample at distance d: the blurred square of the pixel, times the width of
    // a sub-sample.
    let cdf = |x: f64| 0.5 * libm::erfc(-x * std::f64::consts::FRAC_1_SQRT_2);
    let weights: Vec<f64> = (0..(2 * half + 1) * FINE)
        .map(|index| {
            let d = (index as f64 + 0.5) / FINE as f64 - (half as f64 + 0.5);
            (cdf((d + 0.5) / sigma_px) - cdf((d - 0.5) / sigma_px)) / FINE as f64
        })
        .collect();
    let corners: Vec<Vec<f64>> = (0..=fine_side)
        .into_par_iter()
        .map(|y| (0..=fine_side).map(|x| sample(x as f64, y as f64)).collect())
        .collect();
    let across: Vec<Vec<f64>> = (0..fine_side)
        .into_par_iter()
        .map(|fine_y| {
            let mean = |fine_x: usize| {
                let (above, below) = (&corners[fine_y][fine_x..], &corners[fine_y + 1][fine_x..]);
                if [above[1], below[0], below[1]].iter().all(|other| *other == above[0]) {
                    return above[0];
                }
                let finer = |index: usize| (index as f64 + 0.5) / FINER as f64;
                let points = (0..FINER * FINER).map(|index| {
                    let (x, y) = (finer(index % FINER), finer(index / FINER));
                    sample(fine_x as f64 + x, fine_y as f64 + y)
                });
                points.sum::<f64>() / (FINER * FINER) as f64
            };
            let samples: Vec<f64> = (0..fine_side).map(mean).collect();
            (0..side)
                .map(|x| weights.iter().zip(&samples[x * FINE..]).map(|(w, s)| w * s).sum())
                .collect()
        })
        .collect();
    let mut patch = Vec::new();
    for y in 0..side {
        for x in 0..side {
            patch.push(weights.iter().zip(&across[y * FINE..]).map(|(w, row)| w * row[x]).sum());
        }
    }
    patch
}

struct Difference {
    grey_max: f64,
    /// The shift that best explains the difference, by least squares.
    shift_px: Vector2<f64>,
}

fn compare(
    lens: &Lens,
    sigma_px: f64,
    cam_from_target: Pose<Cam, Target>,
    centre: [usize; 2],
) -> Difference {
    const SIDE: usize = 14;
    let board = board();
    let mut picture = Picture::uniform(1456, 1088, BACKGROUND as f32);
    let placed = PlacedBoard { board: &board, cam_from_target };
    render_targets(lens, sigma_px, &[placed], &|_, _| 1.0, &mut picture);
    let corner = centre.map(|value| value - SIDE / 2);
    let brute = brute_force(lens, sigma_px, &board, &cam_from_target, corner, SIDE);
    let drawn =
        |x: usize, y: usize| f64::from(picture.grey[(corner[1] + y) * 1456 + corner[0] + x]);
    let mut difference = Difference { grey_max: 0.0, shift_px: Vector2::zeros() };
    let mut normal = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for y in 1..SIDE - 1 {
        for x in 1..SIDE - 1 {
            let slope =
                Vector2::new(drawn(x + 1, y) - drawn(x - 1, y), drawn(x, y + 1) - drawn(x, y - 1))
                    * 0.5;
            let error = drawn(x, y) - brute[y * SIDE + x];
            difference.grey_max = difference.grey_max.max(error.abs());
            normal += slope * slope.transpose();
            right -= slope * error;
        }
    }
    difference.shift_px = normal.try_inverse().expect("edges in two directions") * right;
    difference
}

/// Levels of 120: a tenth of a level is 0.001 px at the steepest edge, and the brute-force
/// reference itself is accurate to 0.04.
const GREY_ERROR_MAX: f64 = 0.1;

/// A sixth of a corner's noise bound (0.0062 px) squared away, and five times
/// below the 0.01 px that the scene asks for.
const SHIFT_PX_MAX: f64 = 0.002;

fn assert_same(name: &str, difference: &Difference) {
    println!("{name}: {:.4} levels, {:.6} px", difference.grey_max, difference.shift_px.norm());
    assert!(difference.grey_max < GREY_ERROR_MAX, "{name}: {}", difference.grey_max);
    assert!(difference.shift_px.norm() < SHIFT_PX_MAX, "{name}: {}", difference.shift_px.norm());
}

/// The raw pixel, rounded, at which a point of the target's plane is seen.
fn pixel_of(lens: &Lens, pose: &Pose<Cam, Target>, x_mm: f64, y_mm: f64) -> [usize; 2] {
    let raw_px = lens.project(&pose.transform(&Vector3::new(x_mm, y_mm, 0.0))).unwrap();
    [raw_px.x.round() as usize, raw_px.y.round() as usize]
}

#[test]
fn an_inner_corner_is_the_brute_force() {
    let lens = mild();
    let pose = pose_at(&lens, [430.3, 280.8], 1000.0, [0.11, 0.35, -0.17]);
    let centre = pixel_of(&lens, &pose, 0.0, 6.0);
    assert_same("inner corner", &compare(&lens, 0.6, pose, centre));
}

#[test]
fn a_strongly_tilted_corner_is_the_brute_force() {
    let lens = mild();
    // Tilted by 55 degrees about a diagonal: the blur's correlation is 0.5.
    let pose = pose_at(&lens, [1000.3, 700.8], 700.0, [0.13, 0.75, -0.7]);
    let centre = pixel_of(&lens, &pose, 0.0, -6.0);
    assert_same("tilted corner", &compare(&lens, 0.6, pose, centre));
}

#[test]
fn the_papers_corner_and_the_margin_are_the_brute_force() {
    let lens = mild();
    let pose = pose_at(&lens, [900.7, 800.2], 1000.0, [-0.1, -0.2, 0.3]);
    let [left, top, ..] = board().paper_mm();
    let centre = pixel_of(&lens, &pose, left, top);
    assert_same("paper's corner", &compare(&lens, 0.6, pose, centre));
    let centre = pixel_of(&lens, &pose, left + 12.0, top + 12.0);
    assert_same("checker's outer corner", &compare(&lens, 0.6, pose, centre));
}

#[test]
fn squares_smaller_than_the_blur_are_the_brute_force() {
    let lens = wide();
    // 12 mm at 4 m and f 800 px: 2.4 px per square, several lines within one blur.
    let pose = pose_at(&lens, [600.3, 500.8], 4000.0, [0.2, 0.3, -0.4]);
    let centre = pixel_of(&lens, &pose, 0.0, 6.0);
    assert_same("small squares", &compare(&lens, 1.3, pose, centre));
}

#[test]
fn sharp_and_wide_blurs_are_the_brute_force() {
    let lens = mild();
    let pose = pose_at(&lens, [430.3, 280.8], 1000.0, [0.11, 0.35, -0.17]);
    let centre = pixel_of(&lens, &pose, 0.0, 6.0);
    for sigma_px in [PSF_SIGMA_PX_MIN, 0.45, 1.5] {
        assert_same(&format!("PSF {sigma_px}"), &compare(&lens, sigma_px, pose, centre));
    }
}

#[test]
fn the_corner_of_a_wide_angle_picture_bends_less_than_can_be_seen() {
    let lens = wide();
    let pose = pose_at(&lens, [90.3, 80.8], 500.0, [0.15, -0.4, 0.5]);
    let centre = pixel_of(&lens, &pose, 0.0, 6.0);
    let difference = compare(&lens, 0.6, pose, centre);
    assert_same("wide angle", &difference);
    // The bound promised in the module's documentation.
    assert!(difference.shift_px.norm() < 0.001, "{}", difference.shift_px);
}

#[test]
fn the_comparison_sees_a_shift_of_a_few_thousandths() {
    let lens = mild();
    let pose = pose_at(&lens, [430.3, 280.8], 1000.0, [0.11, 0.35, -0.17]);
    let centre = pixel_of(&lens, &pose, 0.0, 6.0);
    // The principal point is moved: to first order, everything appears 0.003 px further right.
    let moved = Lens { cx_px: lens.cx_px + 0.003, ..lens };
    let board = board();
    let mut picture = Picture::uniform(1456, 1088, BACKGROUND as f32);
    let placed = PlacedBoard { board: &board, cam_from_target: pose };
    render_targets(&moved, 0.6, &[placed], &|_, _| 1.0, &mut picture);
    let brute = brute_force(&lens, 0.6, &board, &pose, centre.map(|value| value - 7), 14);
    let worst = (0..14 * 14)
        .map(|index| {
            let (x, y) = (centre[0] - 7 + index % 14, centre[1] - 7 + index / 14);
            (f64::from(picture.grey[y * 1456 + x]) - brute[index]).abs()
        })
        .fold(0.0, f64::max);
    assert!(worst > GREY_ERROR_MAX, "{worst}");
}

#[test]
fn boards_that_cannot_be_seen_draw_nothing() {
    let lens = mild();
    let board = board();
    let blank = Picture::uniform(1456, 1088, BACKGROUND as f32);
    let behind = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, -500.0]);
    let back = Pose::from_theta([0.0, 3.0, 0.0, 0.0, 0.0, 1000.0]);
    let edge_on = Pose::from_theta([0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0, 1000.0]);
    let aside = Pose::from_theta([0.0, 0.0, 0.0, 5000.0, 0.0, 1000.0]);
    for cam_from_target in [behind, back, edge_on, aside] {
        let mut picture = blank.clone();
        let placed = PlacedBoard { board: &board, cam_from_target };
        render_targets(&lens, 0.6, &[placed], &|_, _| 1.0, &mut picture);
        assert!(picture == blank);
    }
}
