//! The search against an obviously right twin that convolves at every pixel, on rendered boards.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::*;
use crate::limits::CORNERS_MAX;
use crate::model::image::{GreyImage, Pixel};
use crate::test_support::repetitions;

pub(super) mod plain;

/// Small and fast; the sequence does not matter.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Mean 0, standard deviation 1, near enough to normal.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() - 6.0
    }
}

/// A board of inner corners (0, 0) to (columns - 1, rows - 1), its squares around
/// them, and a white margin of half a square, under a homography to pixels.
pub(crate) struct Board {
    pub(crate) columns: i32,
    pub(crate) rows: i32,
    pub(crate) picture_from_board: nalgebra::Matrix3<f64>,
}

impl Board {
    /// Turned by `turn_rad`, then tilted about the picture's y axis with a perspective of
    /// `depth` (per square).
    pub(crate) fn new(
        [columns, rows]: [i32; 2],
        centre: [f64; 2],
        square_px: f64,
        turn_rad: f64,
        tilt_rad: f64,
        depth: f64,
    ) -> Self {
        use nalgebra::Matrix3;
        let to_middle = Matrix3::new(
            1.0,
            0.0,
            -0.5 * f64::from(columns - 1),
            0.0,
            1.0,
            -0.5 * f64::from(rows - 1),
            0.0,
            0.0,
            1.0,
        );
        let (sin, cos) = turn_rad.sin_cos();
        let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let tilt =
            Matrix3::new(tilt_rad.cos(), 0.0, 0.0, 0.0, 1.0, 0.0, depth * tilt_rad.sin(), 0.0, 1.0);
        let place =
            Matrix3::new(square_px, 0.0, centre[0], 0.0, square_px, centre[1], 0.0, 0.0, 1.0);
        Self { columns, rows, picture_from_board: place * tilt * turn * to_middle }
    }

    pub(crate) fn corner_px(&self, column: i32, row: i32) -> [f64; 2] {
        let point = self.picture_from_board
            * nalgebra::Vector3::new(f64::from(column), f64::from(row), 1.0);
        [point.x / point.z, point.y / point.z]
    }
}

/// A picture of boards in front of clutter, 0 to 1: 5 x 5 samples per pixel, and
/// a 3 x 3 binomial blur. The square up and left of corner (0, 0) is dark.
pub(crate) fn render(
    [width, height]: [usize; 2],
    boards: &[Board],
    contrast: f64,
    noise: f64,
    seed: u64,
) -> Vec<f64> {
    const FINE: usize = 5;
    let mut random = Random(seed);
    let mut clutter = Vec::new();
    for _ in 0..30 {
        let [x, y] = [random.next() * width as f64, random.next() * height as f64];
        let [w, h] = [10.0 + 80.0 * random.next(), 10.0 + 80.0 * random.next()];
        clutter.push(([x, y, x + w, y + h], 0.3 + 0.4 * random.next()));
    }
    let inverses: Vec<_> =
        boards.iter().map(|board| board.picture_from_board.try_inverse().unwrap()).collect();
    // The brightness of a point, and the number of the part that it is in: a square, a side of a board's
    // margin, or a side beyond it and a piece of clutter. All parts are convex, but for the clutter, whose
    // pieces are larger than a pixel.
    let part = |x: f64, y: f64| {
        let mut number = 0_u64;
        for (board, inverse) in boards.iter().zip(&inverses) {
            let point = inverse * nalgebra::Vector3::new(x, y, 1.0);
            let (u, v) = (point.x / point.z, point.y / point.z);
            let outs = [-u, u - f64::from(board.columns - 1), -v, v - f64::from(board.rows - 1)];
            let side = (0..4).max_by(|&a, &b| outs[a].total_cmp(&outs[b])).unwrap();
            number = 4096 * number + side as u64;
            if outs[side] < 1.0 {
                let dark = (u.floor() + v.floor()).rem_euclid(2.0) == 0.0;
                let square = 8 + 32 * (u.floor() + 1.0) as u64 + (v.floor() + 1.0) as u64;
                let value = if dark { 0.5 - 0.5 * contrast } else { 0.5 + 0.5 * contrast };
                return (number - side as u64 + square, value);
            }
            if outs[side] < 1.5 {
                return (number + 4, 0.5 + 0.5 * contrast);
            }
        }
        let inside = |[x0, y0, x1, y1]: [f64; 4]| x >= x0 && x < x1 && y >= y0 && y < y1;
        let piece = clutter.iter().rposition(|(area, _)| inside(*area));
        let value = piece.map_or(0.5, |piece| clutter[piece].1);
        (4096 * number + piece.map_or(0, |piece| piece as u64 + 1), value)
    };
    let mut sharp = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let sample = |column: usize, row: usize| {
                let offset = |n: usize| (n as f64 + 0.5) / FINE as f64 - 0.5;
                part(x as f64 + offset(column), y as f64 + offset(row))
            };
            // Where the outermost samples are of one part, so are all between them.
            let [(one, value), others @ ..] =
                [(0, 0), (FINE - 1, 0), (0, FINE - 1), (FINE - 1, FINE - 1)]
                    .map(|(column, row)| sample(column, row));
            if others.iter().all(|(other, _)| *other == one) {
                sharp.push(value);
                continue;
            }
            let all = (0..FINE * FINE).map(|index| sample(index % FINE, index / FINE).1);
            sharp.push(all.sum::<f64>() / (FINE * FINE) as f64);
        }
    }
    let mut blurred = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let mut sum = 0.0;
            for (dy, wy) in [(0, 1.0), (1, 2.0), (2, 1.0)] {
                for (dx, wx) in [(0, 1.0), (1, 2.0), (2, 1.0)] {
                    let column = (x + dx).saturating_sub(1).min(width - 1);
                    let row = (y + dy).saturating_sub(1).min(height - 1);
                    sum += wx * wy * sharp[row * width + column];
                }
            }
            blurred.push((sum / 16.0 + noise * random.normal()).clamp(0.0, 1.0));
        }
    }
    blurred
}

/// The same as samples, white = `white`, each row followed by `padding` bright samples.
pub(crate) fn samples<P: TryFrom<u32>>(
    picture: &[f64],
    width: usize,
    padding: usize,
    white: u32,
) -> Vec<P> {
    let mut samples = Vec::new();
    for row in picture.chunks(width) {
        let own = row.iter().map(|value| (value * f64::from(white) + 0.5) as u32);
        for value in own.chain(core::iter::repeat_n(white, padding)) {
            samples.push(P::try_from(value).ok().unwrap());
        }
    }
    samples
}

pub(crate) fn detect<P: Pixel>(image: &GreyImage<'_, P>) -> Box<CornerList> {
    let mut corners = Box::new(CornerList::new());
    let (width, height) = (image.width(), image.height());
    let mut detector = Box::new(Detector::new());
    detector.detect(image, 0..width, 0..height, &mut corners);
    corners
}

/// A size of the kernels by the definition: each as a mask.
struct PlainKernels {
    radius: usize,
    /// Offset from the pixel, weight, and which of A, B, C, D of prototype 1, then of prototype 2, it
    /// belongs to.
    taps: Vec<([isize; 2], f64, [bool; 8])>,
    /// The sum of each mask's weights.
    norms: [f64; 8],
}

impl PlainKernels {
    fn all() -> Vec<Self> {
        kernel::RADII_PX.into_iter().map(Self::new).collect()
    }

    fn new(radius: usize) -> Self {
        let mut kernels = Self { radius, taps: Vec::new(), norms: [0.0; 8] };
        let reach = radius as isize;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let sigma = radius as f64 / 2.0;
                let weight = (-((dx * dx + dy * dy) as f64) / (2.0 * sigma * sigma)).exp();
                let masks = [
                    dx < 0 && dy < 0,
                    dx > 0 && dy > 0,
                    dx > 0 && dy < 0,
                    dx < 0 && dy > 0,
                    dy < 0 && dx.abs() < -dy,
                    dy > 0 && dx.abs() < dy,
                    dx < 0 && dy.abs() < -dx,
                    dx > 0 && dy.abs() < dx,
                ];
                for (norm, _) in kernels.norms.iter_mut().zip(masks).filter(|(_, inside)| *inside) {
                    *norm += weight;
                }
                kernels.taps.push(([dx, dy], weight, masks));
            }
        }
        kernels
    }
}

/// The likelihood by the definition: each mask normed by its own sum.
fn plain_likelihood<P: Pixel>(
    kernels: &[PlainKernels],
    image: &GreyImage<'_, P>,
    x: usize,
    y: usize,
) -> Option<f64> {
    let mut best: Option<f64> = None;
    for PlainKernels { radius, taps, norms } in kernels {
        let inside = |value: usize, side: usize| value >= *radius && value + radius < side;
        if !inside(x, image.width()) || !inside(y, image.height()) {
            continue;
        }
        let mut sums = [0.0_f64; 8];
        for ([dx, dy], weight, masks) in taps {
            let value: f32 =
                image.row(y.wrapping_add_signed(*dy))[x.wrapping_add_signed(*dx)].into();
            let weighted = weight * f64::from(value);
            for (sum, _) in sums.iter_mut().zip(masks).filter(|(_, inside)| **inside) {
                *sum += weighted;
            }
        }
        let mut answers = [0.0; 8];
        for ((answer, sum), norm) in answers.iter_mut().zip(sums).zip(norms) {
            *answer = sum / norm;
        }
        for prototype in answers.chunks(4) {
            let [a, b, c, d] = prototype.try_into().unwrap();
            let mean = 0.25 * (a + b + c + d);
            let one = (f64::min(a, b) - mean).min(mean - f64::max(c, d));
            let two = (mean - f64::max(a, b)).min(f64::min(c, d) - mean);
            best = Some(one.max(two).max(best.unwrap_or(f64::MIN)));
        }
    }
    best
}

/// Every pixel by the definition, non-maxima suppressed within 3 pixels, then described
/// as the search does.
fn plain_detect<P: Pixel>(image: &GreyImage<'_, P>) -> Vec<Corner> {
    let (width, height) = (image.width(), image.height());
    let least = 0.01 * f64::from(image.white_level());
    let kernels = PlainKernels::all();
    let likelihood = |x, y| plain_likelihood(&kernels, image, x, y).unwrap_or(0.0);
    let likelihoods: Vec<Vec<f64>> =
        (0..height).map(|y| (0..width).map(|x| likelihood(x, y)).collect()).collect();
    let mut corners: Vec<Corner> = Vec::new();
    for y in 3..height - 3 {
        for x in 3..width - 3 {
            let own = likelihoods[y][x];
            let is_maximum = likelihoods[y - 3..=y + 3]
                .iter()
                .all(|row| row[x - 3..=x + 3].iter().all(|&other| other <= own));
            if own >= least && is_maximum {
                let kernels = kernel::Kernels::new();
                let (_, size) = kernels.best(image, x, y, 0..kernel::RADII_PX.len()).unwrap();
                corners.extend(direction::describe(image, [x, y], kernel::RADII_PX[size]));
            }
        }
    }
    corners
}

fn nearest(corners: &[Corner], to: [f64; 2]) -> Option<(f64, Corner)> {
    corners
        .iter()
        .map(|corner| {
            let [x, y] = corner.position_px.map(f64::from);
            ((x - to[0]).hypot(y - to[1]), *corner)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

fn noise_picture(width: usize, height: usize, seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    (0..width * height).map(|_| random.next()).collect()
}

#[test]
fn the_kernels_are_their_definition_at_every_place() {
    let (width, height) = (64, 70);
    let picture = noise_picture(width, height, 1);
    let bytes: Vec<u8> = samples(&picture, width, 5, 255);
    let words: Vec<u16> = samples(&picture, width, 3, 1023);
    let image = GreyImage::new(&bytes, width, height, width + 5).unwrap();
    let deep = GreyImage::with_white_level(&words, width, height, width + 3, 1023).unwrap();
    let kernels = kernel::Kernels::new();
    let masks = PlainKernels::all();
    let sizes = 0..kernel::RADII_PX.len();
    for y in 0..height {
        for x in 0..width {
            let check =
                |fast: Option<(f32, usize)>, plain: Option<f64>, white: f64| match (fast, plain) {
                    // 625 products in single precision.
                    (Some((fast, _)), Some(plain)) => {
                        assert!(
                            (f64::from(fast) - plain).abs() < 2e-6 * white,
                            "{x} {y}: {fast} {plain}"
                        );
                    }
                    (fast, plain) => assert!(fast.is_none() && plain.is_none(), "{x} {y}"),
                };
            let plain = plain_likelihood(&masks, &image, x, y);
            check(kernels.best(&image, x, y, sizes.clone()), plain, 255.0);
            for size in sizes.clone() {
                let plain = plain_likelihood(&masks[size..=size], &image, x, y);
                check(kernels.best(&image, x, y, size..size + 1), plain, 255.0);
            }
            let plain = plain_likelihood(&masks, &deep, x, y);
            check(kernels.best(&deep, x, y, sizes.clone()), plain, 1023.0);
        }
    }
}

/// Boards over clutter, some extending beyond the frame's border, in frames of different widths. Each
/// is rendered when it is taken.
fn scenes() -> impl Iterator<Item = (Vec<f64>, usize, usize)> {
    let mut random = Random(7);
    let boards: Vec<_> = (0..8)
        .map(|n| {
            let (width, height) = (230 + 17 * n, 210);
            let board = Board::new(
                [6, 5],
                [width as f64 * (0.2 + 0.6 * random.next()), 60.0 + 90.0 * random.next()],
                14.0 + 12.0 * random.next(),
                6.3 * random.next(),
                1.0 * random.next(),
                0.02,
            );
            (board, width, height)
        })
        .collect();
    (0..boards.len()).map(move |n| {
        let (board, width, height) = &boards[n];
        let noise = [0.0, 0.008, 0.02][n % 3];
        let boards = core::slice::from_ref(board);
        (render([*width, *height], boards, 0.5, noise, n as u64), *width, *height)
    })
}

#[test]
fn the_search_finds_what_the_plain_one_finds() {
    /// Corners this good must agree. Weaker ones are clutter that barely counts as a corner.
    const CLEAR: f32 = 0.05;
    let mut compared = 0;
    let scenes_used = repetitions(8);
    for (n, (picture, width, height)) in scenes().take(scenes_used).enumerate() {
        let words: Vec<u16> = samples(&picture, width, n, 1023);
        let image = GreyImage::with_white_level(&words, width, height, width + n, 1023).unwrap();
        let fast = detect(&image);
        let plain = plain_detect(&image);
        for (ours, theirs) in [(fast.as_slice(), &plain[..]), (&plain[..], fast.as_slice())] {
            // At the frame's very border one window fits and the next does not.
            let is_compared = |corner: &&Corner| {
                let [x, y] = corner.position_px;
                let room = x.min(y).min(width as f32 - x).min(height as f32 - y);
                corner.score > CLEAR && room > 8.0
            };
            for corner in ours.iter().filter(is_compared) {
                let (distance, twin) = nearest(theirs, corner.position_px.map(f64::from)).unwrap();
                // The same corner seen from a pixel beside it moves by much less than a pixel.
                assert!(distance < 0.4, "scene {n}: {corner:?} and {twin:?}");
                compared += 1;
            }
        }
    }
    assert!(compared > 2 * scenes_used * 15, "{compared}");
}

#[test]
fn corners_are_where_they_were_drawn_with_dark_from_edge_0_to_edge_1() {
    let turns_deg = (0..360_u32).step_by(360 / repetitions(24));
    for (n, turn_deg) in turns_deg.enumerate() {
        let tilt_rad = [0.0, 0.5, 1.0][n % 3];
        let board = Board::new(
            [6, 5],
            [120.3, 109.6],
            22.0,
            f64::from(turn_deg).to_radians(),
            tilt_rad,
            0.02,
        );
        let boards = core::slice::from_ref(&board);
        let picture = render([240, 220], boards, 0.5, 0.008, n as u64);
        let bytes: Vec<u8> = samples(&picture, 240, 0, 255);
        let corners = detect(&GreyImage::new(&bytes, 240, 220, 240).unwrap());
        for row in 0..5 {
            for column in 0..6 {
                let truth = board.corner_px(column, row);
                let (distance, corner) = nearest(corners.as_slice(), truth).unwrap();
                // Good to a quarter of a pixel, to half of one at the sharpest wedges.
                assert!(distance < 0.5, "turn {turn_deg} tilt {tilt_rad}: {distance} {corner:?}");
                let ahead = |dc, dr| {
                    let next = board.corner_px(column + dc, row + dr);
                    (next[1] - truth[1]).atan2(next[0] - truth[0])
                };
                // The square up and left of (0, 0) is dark, and with it the one from x to y.
                let (x_rad, y_rad) = (ahead(1, 0), ahead(0, 1));
                let expected =
                    if (column + row) % 2 == 0 { [x_rad, y_rad] } else { [y_rad, x_rad] };
                for (edge, expected) in corner.edges_rad.into_iter().zip(expected) {
                    let apart = f64::from(edge) - expected;
                    // 8 degrees: far less than half of the narrowest wedge.
                    assert!(
                        apart.sin().abs() < 0.14,
                        "turn {turn_deg} tilt {tilt_rad}: {corner:?}, {expected}"
                    );
                    assert!((0.0..core::f32::consts::PI).contains(&edge));
                }
            }
        }
    }
}

#[test]
fn parts_of_a_picture_hold_the_same_corners_as_the_whole() {
    let (picture, width, height) = scenes().nth(3).unwrap();
    let bytes: Vec<u8> = samples(&picture, width, 0, 255);
    let image = GreyImage::new(&bytes, width, height, width).unwrap();
    let whole = detect(&image);
    let mut parts = Box::new(CornerList::new());
    let mut detector = Box::new(Detector::new());
    for columns in [0..101, 101..width + 50] {
        for rows in [0..77, 77..height] {
            detector.detect(&image, columns.clone(), rows, &mut parts);
        }
    }
    // Nothing asked for, nothing found, and no panic.
    detector.detect(&image, width + 3..width + 9, 0..height, &mut parts);
    detector.detect(&image, 5..5, 0..height, &mut parts);
    for (ours, theirs) in [(&whole, &parts), (&parts, &whole)] {
        for corner in ours.as_slice().iter().filter(|corner| corner.score > 0.05) {
            let (distance, _) =
                nearest(theirs.as_slice(), corner.position_px.map(f64::from)).unwrap();
            assert!(distance < 0.4, "{corner:?}");
        }
    }
}

#[test]
fn wherever_a_picture_is_split_no_corner_is_lost_or_found_twice() {
    let [width, height] = [120, 100];
    // Rows of corners at all sub-pixel phases: 11.3 px apart, and slightly turned.
    let board = Board::new([5, 4], [60.2, 50.4], 11.3, 0.02, 0.0, 0.0);
    let picture = render([width, height], &[board], 0.5, 0.01, 5);
    let bytes: Vec<u8> = samples(&picture, width, 0, 255);
    let image = GreyImage::new(&bytes, width, height, width).unwrap();
    let count = detect(&image).as_slice().len();
    assert!(count >= 20, "{count}");
    let mut detector = Box::new(Detector::new());
    let mut parts = Box::new(CornerList::new());
    for split in 20..80 {
        for [first, second] in [
            [(0..width, 0..split), (0..width, split..height)],
            [(0..split, 0..height), (split..width, 0..height)],
        ] {
            parts.clear();
            detector.detect(&image, first.0, first.1, &mut parts);
            detector.detect(&image, second.0, second.1, &mut parts);
            assert_eq!(parts.as_slice().len(), count, "split at {split}");
        }
    }
}

#[test]
fn a_corner_is_located_again_from_a_pixel_away_unless_it_is_another() {
    let board = Board::new([4, 3], [80.3, 60.6], 20.0, 0.3, 0.5, 0.02);
    let picture = render([160, 120], &[board], 0.5, 0.005, 9);
    let bytes: Vec<u8> = samples(&picture, 160, 0, 255);
    let image = GreyImage::new(&bytes, 160, 120, 160).unwrap();
    let corners = detect(&image);
    assert_eq!(corners.as_slice().len(), 12);
    for corner in corners.as_slice() {
        let [x, y] = corner.position_px;
        for [dx, dy] in [[0.0, 0.0], [1.0, 0.0], [-0.7, 0.7], [0.0, -1.0], [0.7, 0.7]] {
            let near = Corner { position_px: [x + dx, y + dy], ..*corner };
            let again = refined(&image, &near).expect("it is there");
            let apart = again.position_px.map(f64::from);
            let apart = (apart[0] - f64::from(x)).hypot(apart[1] - f64::from(y));
            // Both are good to a quarter of a pixel.
            assert!(apart < 0.5, "{dx} {dy}: {apart} {corner:?} {again:?}");
        }
        for edge in 0..2 {
            // Their sines are 0.14 and 0.48; up to 0.26 counts as the same, and a direction is good to 0.09.
            for (turn_rad, is_the_same) in
                [(0.14, true), (-0.14, true), (0.5, false), (-0.5, false)]
            {
                let mut turned = *corner;
                turned.edges_rad[edge] += turn_rad;
                assert_eq!(
                    refined(&image, &turned).is_some(),
                    is_the_same,
                    "{turn_rad} {corner:?}"
                );
            }
        }
        for place in [[-0.6, y], [x, -0.6], [159.5, y], [x, 119.5], [f32::NAN, y], [x, f32::NAN]] {
            let outside = Corner { position_px: place, ..*corner };
            assert!(refined(&image, &outside).is_none(), "{place:?}");
        }
    }
}

/// What lies beyond the frame does not matter: a window that touches its border shows the same
/// corner as one inside a larger frame.
#[test]
fn a_corner_beside_the_border_is_described_as_in_a_larger_frame() {
    let board = Board::new([2, 2], [60.3, 50.6], 25.0, 0.3, 0.0, 0.0);
    let picture = render([130, 110], &[board], 0.5, 0.01, 6);
    let bytes: Vec<u8> = samples(&picture, 130, 0, 255);
    let whole = GreyImage::new(&bytes, 130, 110, 130).unwrap();
    let found = detect(&whole);
    assert_eq!(found.as_slice().len(), 4);
    for corner in found.as_slice() {
        let [x, y] = corner.position_px.map(|value| (value + 0.5) as usize);
        for radius in kernel::RADII_PX {
            let described = direction::describe(&whole, [x, y], radius);
            assert!(described.is_some(), "{x} {y}");
            // The last column and row that the window needs, and a few more.
            for more in 0..4 {
                let reach = (radius + 3).min(9) + 1 + more;
                let [width, height] = [x + reach + 1, y + reach + 1];
                let cut = GreyImage::new(&bytes, width.max(64), height.max(64), 130).unwrap();
                assert_eq!(direction::describe(&cut, [x, y], radius), described, "{width}");
            }
        }
    }
}

#[test]
fn empty_and_noisy_frames_give_finite_corners_or_none() {
    for value in [0_u8, 1, 128, 255] {
        let flat = [value; 64 * 80];
        assert!(detect(&GreyImage::new(&flat, 64, 80, 64).unwrap()).as_slice().is_empty());
    }
    let noise: Vec<u8> = samples(&noise_picture(300, 301, 5), 300, 0, 255);
    let corners = detect(&GreyImage::new(&noise, 300, 301, 300).unwrap());
    for corner in corners.as_slice() {
        assert!(corner.position_px.iter().all(|value| value.is_finite()), "{corner:?}");
        assert!(corner.score > 0.0 && corner.score <= 0.5, "{corner:?}");
    }
    // Black or white at random, in the brightest samples there are.
    let mut random = Random(11);
    let words: Vec<u16> =
        (0..128 * 128).map(|_| if random.next() < 0.5 { 0 } else { u16::MAX }).collect();
    detect(&GreyImage::with_white_level(&words, 128, 128, 128, u16::MAX).unwrap());
    // Samples above white: a broken driver, not a panic.
    detect(&GreyImage::with_white_level(&words, 128, 128, 128, 1).unwrap());
}

#[test]
fn a_full_list_keeps_the_strongest_and_counts_the_rest() {
    let mut list = Box::new(CornerList::new());
    let corner = |n: usize| Corner {
        position_px: [10.0 * (n % 64) as f32, 10.0 * (n / 64) as f32],
        score: 0.0001 * (1 + n) as f32,
        edges_rad: [0.0, 1.5],
    };
    for n in 0..CORNERS_MAX + 100 {
        list.push(corner(n));
    }
    assert_eq!((list.as_slice().len(), list.dropped()), (CORNERS_MAX, 100));
    assert!(list.as_slice().iter().all(|kept| kept.score > 0.0001 * 100.5));
    // The same place again: no second corner.
    list.push(Corner { score: 0.4, ..corner(CORNERS_MAX / 2) });
    assert_eq!((list.as_slice().len(), list.dropped()), (CORNERS_MAX, 100));
    list.clear();
    assert_eq!((list.as_slice().len(), list.dropped()), (0, 0));
}
