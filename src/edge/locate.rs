//! The coarse step: lines of pixels across an edge.

use nalgebra::Vector2;

use super::{CONTRAST_MIN, SeenEdge};
use crate::image::{GreyImage, Pixel};
use crate::nodes::{Edge, Nodes};

/// Where the lines of pixels cross the edge, from its middle in its own lengths: clear
/// of the crossings at its ends.
const PLACES: [f64; 3] = [-0.25, 0.0, 0.25];

/// Longest way from the expected place, px, and its share of the way to the next line.
const REACH_PX_MAX: f64 = 12.0;
const REACH_SHARE: f64 = 0.42;
/// Shortest line of pixels on each side.
const REACH_PX_MIN: usize = 2;

/// Pixels of the longest line: both sides and the middle; slanted by 45 degrees at most.
const LINE_PX_MAX: usize = 2 * 17 + 1;

/// What is on both sides of an edge must differ by this part of the line's whole range.
const STEP_SHARE_MIN: f32 = 0.4;

/// Standard deviation of a place found; it only weighs edges against each other.
const SIGMA_PX: f64 = 0.2;

/// Finds an edge near the expected one; `None` where there is none of its colours.
///
/// On a line of pixels that a step divides into light and dark, the sum of the pixels
/// says where: neither the blur nor a start far away matters, as long as no other edge
/// comes in.
pub fn locate<P: Pixel>(image: &GreyImage<'_, P>, nodes: &Nodes, edge: &Edge) -> Option<SeenEdge> {
    let chord = nodes.chord(edge);
    let along = chord.end_px - chord.start_px;
    let right = chord.right;
    // The pixels' line: along the picture's axis that is nearer to the normal.
    let is_row = right.x.abs() > right.y.abs();
    let slant = if is_row { right.x } else { right.y };
    let spacing_px = chord.across_px.dot(&right).abs();
    let reach_px = (REACH_SHARE * spacing_px).min(REACH_PX_MAX) / slant.abs();
    let reach = reach_px as usize;
    if !(REACH_PX_MIN..=LINE_PX_MAX / 2).contains(&reach) {
        return None;
    }
    let middle_px = (chord.start_px + chord.end_px) * 0.5;
    let is_rising = edge.is_right_light == (slant > 0.0);
    let mut shifts_px = [0.0; PLACES.len()];
    for (place, shift_px) in PLACES.iter().zip(&mut shifts_px) {
        let expected_px = middle_px + along * *place;
        // Of a move along the pixels' axis only the part across the edge counts.
        *shift_px = step_on_line(image, &expected_px, is_row, reach, is_rising)? * slant;
    }
    let [start, middle, end] = shifts_px;
    // Least squares on three equally spaced places.
    let count = PLACES.len() as f64;
    let spread = 2.0 * PLACES[2] * PLACES[2];
    let (shift, turn) = ((start + middle + end) / count, (end - start) * PLACES[2] / spread);
    let precisions = [count, spread].map(|weight| libm::sqrt(weight) / SIGMA_PX);
    let ends = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
    let whitener = [precisions[0], 0.0, precisions[1]];
    let seen = [precisions[0] * shift, precisions[1] * turn];
    Some(SeenEdge::new(*edge, ends, &right, whitener, seen))
}

/// From the expected place to the step on a row of pixels (else a column), along its axis.
fn step_on_line<P: Pixel>(
    image: &GreyImage<'_, P>,
    expected_px: &Vector2<f64>,
    is_row: bool,
    reach: usize,
    is_rising: bool,
) -> Option<f64> {
    let (x, y) = image.window_centre([expected_px.x, expected_px.y], reach)?;
    let count = 2 * reach + 1;
    let mut line = [0.0_f32; LINE_PX_MAX];
    let line = line.get_mut(..count)?;
    if is_row {
        for (value, &pixel) in line.iter_mut().zip(&image.row(y)[x - reach..]) {
            *value = pixel.into();
        }
    } else {
        for (value, row) in line.iter_mut().zip(y - reach..) {
            *value = image.row(row)[x].into();
        }
    }
    let (mut low, mut high, mut sum) = (f32::INFINITY, f32::NEG_INFINITY, 0.0);
    for &value in line.iter() {
        low = if value < low { value } else { low };
        high = if value > high { value } else { high };
        sum += value;
    }
    let range = high - low;
    if range < CONTRAST_MIN * f32::from(image.white_level()) {
        return None;
    }
    // The outer thirds must be what they should.
    let third = count.div_ceil(3);
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let step = mean(&line[count - third..]) - mean(&line[..third]);
    if (if is_rising { step } else { -step }) < STEP_SHARE_MIN * range {
        return None;
    }
    let light = f64::from((sum - low * count as f32) / range);
    let from_end = if is_rising { count as f64 - light } else { light };
    // The line begins half a pixel before the centre of its first one.
    let start_px = if is_row { x } else { y } as f64 - reach as f64 - 0.5;
    let found_px = start_px + from_end;
    Some(found_px - if is_row { expected_px.x } else { expected_px.y })
}
