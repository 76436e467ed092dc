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
