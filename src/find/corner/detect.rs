//! The search of a picture, or of a part of it.

use core::ops::Range;

use super::direction::describe;
use super::kernel::{Kernels, RADII_PX};
use super::list::{Corner, CornerList};
use super::ring::{Candidate, TILE_HEIGHT, TILE_WIDTH, Tile};
use crate::model::image::{GreyImage, Pixel};

/// The frame is searched at its own size and at half of it.
const LEVELS: usize = 2;
/// Smallest likelihood, relative to white: it corresponds to a contrast of 2 %. Geiger's default is
/// a likelihood of 1 % as well.
const LIKELIHOOD_MIN: f32 = 0.01;
/// Most steps from the pixel of the best ring response to that of the best likelihood.
const CLIMB_STEPS_MAX: usize = 4;
/// How far beyond the ranges candidates are looked for. A corner is seldom farther from its
/// candidate; without this, corners between two bands would be missed by both.
const REACH_PX: usize = CLIMB_STEPS_MAX;
/// Largest angle by which an edge may turn when a corner is located again (sine): 15 degrees, three
/// times the accuracy of a direction.
const TURNED_SINE_MAX: f32 = 0.26;

/// Finds checkerboard corners. Holds one tile of the frame; its own size does not depend on the
/// frame's.
#[derive(Debug)]
pub struct Detector {
    tile: Tile,
}

impl Default for Detector {
    fn default() -> Self {
        Self::new()
    }
}

impl Detector {
    /// A detector, ready for use.
    #[must_use]
    pub const fn new() -> Self {
        Self { tile: Tile::new() }
    }

    /// Appends the corners within `columns` and `rows` of the picture to `corners`, each once, with
    /// its score, its directions and its position to about a quarter of a pixel. Nothing is found
    /// within 5 px of the frame's border.
    ///
    /// Parts of the ranges outside the picture are ignored.
    pub fn detect<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        columns: Range<usize>,
        rows: Range<usize>,
        corners: &mut CornerList,
    ) {
        let kernels = Kernels::new();
        for level in 0..LEVELS {
            // Pixels of the level whose candidates may become corners in the ranges.
            let scaled = |range: &Range<usize>, side: usize| {
                if range.is_empty() || range.start >= side {
                    return 0..0;
                }
                let end = range.end.min(side) + REACH_PX;
                range.start.saturating_sub(REACH_PX) >> level
                    ..end.div_ceil(1 << level).min(side >> level)
            };
            let (columns_level, rows_level) =
                (scaled(&columns, image.width()), scaled(&rows, image.height()));
            for y0 in rows_level.clone().step_by(TILE_HEIGHT) {
                let height = TILE_HEIGHT.min(rows_level.end - y0);
                for x0 in columns_level.clone().step_by(TILE_WIDTH) {
                    let width = TILE_WIDTH.min(columns_level.end - x0);
                    let (candidates, dropped) =
                        self.tile.search(image, level, [x0, y0], [width, height]);
                    corners.count_dropped(dropped);
                    for candidate in candidates {
                        // Most corners found at half size are already known from the full size.
                        let place = [candidate.x, candidate.y]
                            .map(|value| f32::from(value << level) + 0.5 * level as f32);
                        if level > 0 && corners.has_near(place) {
                            continue;
                        }
                        let corner = examine(image, &kernels, level, *candidate);
                        if let Some(corner) = corner.filter(|corner| {
                            is_within(corner.position_px[0], &columns)
                                && is_within(corner.position_px[1], &rows)
                        }) {
                            corners.push(corner);
                        }
                    }
                }
            }
        }
    }
}

/// A corner located again in a picture of the same scene: `corner` is good to 1 px, as one is that
/// was found at half the size. `None` where the picture does not show it.
pub fn refined<P: Pixel>(image: &GreyImage<'_, P>, corner: &Corner) -> Option<Corner> {
    let [x, y] = corner.position_px.map(|px| px + 0.5);
    if !(x >= 0.0 && y >= 0.0 && x < image.width() as f32 && y < image.height() as f32) {
        return None;
    }
    let again = describe(image, [x as usize, y as usize], RADII_PX[RADII_PX.len() - 1])?;
    let sine = |edge: usize| libm::sinf(again.edges_rad[edge] - corner.edges_rad[edge]);
    (sine(0).abs() < TURNED_SINE_MAX && sine(1).abs() < TURNED_SINE_MAX).then_some(again)
}

/// Whether the pixel of a coordinate is in the range.
fn is_within(value_px: f32, range: &Range<usize>) -> bool {
    value_px >= range.start as f32 - 0.5 && value_px < range.end as f32 - 0.5
}

/// From a candidate to the corner near it, if there is one.
fn examine<P: Pixel>(
    image: &GreyImage<'_, P>,
    kernels: &Kernels,
    level: usize,
    candidate: Candidate,
) -> Option<Corner> {
    let white = f32::from(image.white_level());
    let least = LIKELIHOOD_MIN * white;
    let mut x = usize::from(candidate.x) << level;
    let mut y = usize::from(candidate.y) << level;
    // A pixel or two away from the corner the likelihood is still half of its maximum.
    if !kernels.reaches(image, x, y, 0.5 * least) {
        return None;
    }
    // Climb with the smallest kernels that are not lost in the blur: their peak is the sharpest.
    let (size, step) = (level, 1 << level);
    let mut likelihood = kernels.of_size(image, x, y, size)?;
    let mut last = (x, y);
    for _ in 0..CLIMB_STEPS_MAX {
        let mut next = (x, y);
        for place in [(x, y - step), (x - step, y), (x + step, y), (x, y + step)] {
            if place != last
                && let Some(value) = kernels.of_size(image, place.0, place.1, size)
                && value > likelihood
            {
                likelihood = value;
                next = place;
            }
        }
        if next == (x, y) {
            break;
        }
        (last, (x, y)) = ((x, y), next);
    }
    // The windows of the two larger sizes are described alike: the largest is needed only where no
    // other suffices.
    let best_of = |sizes| kernels.best(image, x, y, sizes).filter(|(best, _)| *best >= least);
    let (_, size) = best_of(0..2).or_else(|| best_of(2..RADII_PX.len()))?;
    describe(image, [x, y], RADII_PX[size])
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;
    use std::vec::Vec;

    use super::*;

    const SIDE: usize = 64;

    /// A corner of two sharp edges at right angles, at a place, whose dark sides are up and left and down
    /// and right; a pixel on an edge is as bright as the mean.
    fn quadrants([x, y]: [usize; 2], dark: u16, bright: u16) -> Vec<u16> {
        let sign = |n: usize, at: usize| (n as i32 - at as i32).signum();
        (0..SIDE * SIDE)
            .map(|n| match sign(n % SIDE, x) * sign(n / SIDE, y) {
                1 => dark,
                -1 => bright,
                _ => u16::midpoint(dark, bright),
            })
            .collect()
    }

    #[test]
    fn a_place_belongs_to_the_pixel_around_it() {
        for (value_px, is_inside) in
            [(9.49, false), (9.5, true), (10.0, true), (19.49, true), (19.5, false), (20.0, false)]
        {
            assert_eq!(is_within(value_px, &(10..20)), is_inside, "{value_px}");
        }
        assert!(is_within(-0.5, &(0..1)));
    }

    #[test]
    fn from_a_candidate_beside_it_the_corner_is_found() {
        let words = quadrants([31, 33], 200, 800);
        let image = GreyImage::with_white_level(&words, SIDE, SIDE, SIDE, 1023).unwrap();
        let kernels = Kernels::new();
        let from =
            |level: usize, x: u16, y: u16| examine(&image, &kernels, level, Candidate { x, y });
        let there = from(0, 31, 33).expect("a corner");
        assert!((there.position_px[0] - 31.0).abs() < 1e-3, "{there:?}");
        assert!((there.position_px[1] - 33.0).abs() < 1e-3, "{there:?}");
        for (dx, dy) in (-2..=2_i16).flat_map(|dx| (-2..=2_i16).map(move |dy| (dx, dy))) {
            let near = from(0, 31_u16.wrapping_add_signed(dx), 33_u16.wrapping_add_signed(dy));
            assert_eq!(near, Some(there), "{dx} {dy}");
        }
        // A pixel of half the size is two of the picture.
        for (x, y) in [(15, 16), (15, 17), (16, 16), (16, 17), (14, 16), (15, 15)] {
            let near = from(1, x, y).expect("a corner");
            assert!((near.position_px[0] - 31.0).abs() < 0.1, "{x} {y}: {near:?}");
            assert!((near.position_px[1] - 33.0).abs() < 0.1, "{x} {y}: {near:?}");
        }
        assert_eq!(from(0, 45, 45), None);
        assert_eq!(from(0, 2, 2), None);
    }

    /// Half a contrast of 2 % is a likelihood of 1 %.
    #[test]
    fn a_contrast_of_2_percent_is_enough() {
        let kernels = Kernels::new();
        for (bright, is_found) in [(517, false), (519, false), (521, true), (523, true)] {
            let words = quadrants([31, 33], 500, bright);
            let image = GreyImage::with_white_level(&words, SIDE, SIDE, SIDE, 1023).unwrap();
            let found = examine(&image, &kernels, 0, Candidate { x: 31, y: 33 });
            assert_eq!(found.is_some(), is_found, "{bright}: {found:?}");
        }
    }

    /// The sides of squares along one axis, as blurred as this: 1 and -1 in turn, and 0 at the edges.
    fn stripes(at_px: f32, square_px: f32, blur_px: f32) -> f32 {
        let number = libm::roundf(at_px / square_px);
        let sign = if number as i32 % 2 == 0 { 1.0 } else { -1.0 };
        sign * libm::tanhf((at_px - square_px * number) / blur_px)
    }

    /// Sharp corners, and blurred ones of little contrast, which the full size does not show. Half of their
    /// places, and a quarter, are those of sharp ones.
    #[test]
    fn what_only_the_half_size_shows_is_found_in_every_part() {
        const SIDE: usize = 260;
        let bytes: Vec<u8> = (0..SIDE * SIDE)
            .map(|n| {
                let place = [n % SIDE, n / SIDE].map(|at| at as f32);
                let drawn = |contrast: f32, square_px: f32, blur_px: f32| {
                    let [x, y] = place.map(|at| stripes(at, square_px, blur_px));
                    contrast * x * y
                };
                let level = if place.iter().all(|at| *at < 110.0) {
                    drawn(60.0, 20.0, 0.7)
                } else if place.iter().all(|at| *at > 140.0) {
                    drawn(11.0, 40.0, 5.0)
                } else {
                    0.0
                };
                libm::roundf(128.0 + level) as u8
            })
            .collect();
        let image = GreyImage::new(&bytes, SIDE, SIDE, SIDE).unwrap();
        let grid = |from: u8, step: u8, count: u8| {
            (0..count * count)
                .map(move |n| [n % count, n / count].map(|at| f32::from(from + step * at)))
        };
        let (sharp, blurred) = (grid(20, 20, 5), grid(160, 40, 3));
        let is_at = |corner: &Corner, [x, y]: [f32; 2]| {
            let [dx, dy] = [corner.position_px[0] - x, corner.position_px[1] - y];
            // A quarter of a pixel of the half size.
            dx * dx + dy * dy < 0.5 * 0.5
        };
        let mut tile = Box::new(Tile::new());
        for y0 in (0..SIDE).step_by(TILE_HEIGHT) {
            let height = TILE_HEIGHT.min(SIDE - y0);
            let (candidates, _) = tile.search(&image, 0, [0, y0], [SIDE, height]);
            let corners = candidates.iter().map(|it| examine(&image, &Kernels::new(), 0, *it));
            for corner in corners.flatten() {
                assert!(!blurred.clone().any(|place| is_at(&corner, place)), "{corner:?}");
            }
        }
        let expected: Vec<[f32; 2]> = sharp.chain(blurred).collect();
        let mut detector = Box::new(Detector::new());
        let mut parts = Box::new(CornerList::new());
        for split in (12..SIDE).step_by(8) {
            for [first, second] in [
                [(0..SIDE, 0..split), (0..SIDE, split..SIDE)],
                [(0..split, 0..SIDE), (split..SIDE, 0..SIDE)],
            ] {
                parts.clear();
                detector.detect(&image, first.0, first.1, &mut parts);
                detector.detect(&image, second.0, second.1, &mut parts);
                for &place in &expected {
                    let here = parts.as_slice().iter().filter(|corner| is_at(corner, place));
                    assert_eq!(here.count(), 1, "{place:?}, split at {split}");
                }
            }
        }
    }

    #[test]
    fn a_faint_corner_is_found_from_beside_it_and_not_from_afar() {
        let kernels = Kernels::new();
        let found = |bright: u16, [x, y]: [u16; 2]| {
            let words = quadrants([31, 33], 500, bright);
            let image = GreyImage::with_white_level(&words, SIDE, SIDE, SIDE, 1023).unwrap();
            examine(&image, &kernels, 0, Candidate { x, y }).is_some()
        };
        for (away, is_faint_found) in [([0, 0], true), ([1, 0], true), ([2, 2], false)] {
            let place = [31 + away[0], 33 + away[1]];
            assert!(found(800, place), "{away:?}");
            assert_eq!(found(523, place), is_faint_found, "{away:?}");
        }
    }

    #[test]
    fn a_corner_that_has_left_the_picture_is_not_located_again() {
        let words = quadrants([31, 33], 200, 800);
        let image = GreyImage::with_white_level(&words, SIDE, SIDE, SIDE, 1023).unwrap();
        let kernels = Kernels::new();
        let corner = examine(&image, &kernels, 0, Candidate { x: 31, y: 33 }).unwrap();
        assert!(refined(&image, &corner).is_some());
        let end = SIDE as f32 - 0.5;
        for position_px in [[end, 33.0], [31.0, end], [-0.6, 33.0], [31.0, -0.6], [f32::NAN; 2]] {
            let outside = Corner { position_px, ..corner };
            assert_eq!(refined(&image, &outside), None, "{position_px:?}");
        }
    }

    #[test]
    fn where_tiles_meet_each_corner_is_found_once() {
        // More than two tiles wide, and high.
        let (width, height, square_px) = (1100, 150, 24);
        let bytes: Vec<u8> = (0..width * height)
            .map(
                |n| if (n % width / square_px + n / width / square_px) % 2 == 0 { 60 } else { 180 },
            )
            .collect();
        let image = GreyImage::new(&bytes, width, height, width).unwrap();
        let mut corners = Box::new(CornerList::new());
        let mut detector = Box::new(Detector::new());
        detector.detect(&image, 0..width, 0..height, &mut corners);
        // None within 5 px of the border.
        let expected: Vec<[f32; 2]> = (1..=height / square_px)
            .flat_map(|row| (1..=width / square_px).map(move |column| [column, row]))
            .filter(|[column, row]| column * square_px < width - 5 && row * square_px < height - 5)
            .map(|place| place.map(|number| (number * square_px) as f32 - 0.5))
            .collect();
        let found = corners.as_slice();
        assert_eq!((found.len(), corners.dropped()), (expected.len(), 0));
        for [x, y] in expected {
            let is_here = |corner: &Corner| {
                let [dx, dy] = [corner.position_px[0] - x, corner.position_px[1] - y];
                dx * dx + dy * dy < 0.25 * 0.25
            };
            assert_eq!(found.iter().filter(|corner| is_here(corner)).count(), 1, "{x} {y}");
        }
    }
}
