//! The coarse step: lines of pixels across an edge.

use nalgebra::Vector2;

use super::seen::{CONTRAST_MIN, SeenEdge};
use crate::fit::nodes::{Edge, Nodes};
use crate::model::image::{GreyImage, Pixel};

/// Where the lines cross the edge, from its middle, in units of its length: clear of the crossings
/// at its ends.
const PLACES: [f64; 2] = [-0.2, 0.2];

/// Largest distance from the expected position, in px, and as a share of the distance to the next
/// line.
const REACH_PX_MAX: f64 = 12.0;
const REACH_SHARE: f64 = 0.42;
/// Shortest line on each side, px.
const REACH_PX_MIN: usize = 2;

/// Pixels of the longest line: both sides and the middle.
const LINE_PX_MAX: usize = 2 * REACH_PX_MAX as usize + 1;

/// One pixel in fixed point; a pixel's coordinates stay below 32,768.
const ONE_PX: i32 = 1 << 16;

/// The two sides of an edge must differ by this share of the line's whole range.
const STEP_SHARE_MIN: f32 = 0.4;

/// Standard deviation of a located position; it only weights edges against each other.
const SIGMA_PX: f64 = 0.2;

/// Finds an edge near the expected one; `None` where there is none with its colours.
///
/// On a line that a step divides into light and dark, the sum of the pixels gives the step's
/// position: neither the blur nor a distant start matters, as long as no other edge intrudes. The
/// lines run at right angles to the edge, however the target is turned, through the nearest pixels.
pub fn locate_edge<P: Pixel>(
    image: &GreyImage<'_, P>,
    nodes: &Nodes,
    edge: &Edge,
) -> Option<SeenEdge> {
    let chord = nodes.chord(edge);
    let along = chord.end_px - chord.start_px;
    let right = chord.right;
    let spacing_px = chord.across_px.dot(&right).abs();
    let reach = (REACH_SHARE * spacing_px).min(REACH_PX_MAX) as usize;
    if reach < REACH_PX_MIN {
        return None;
    }
    let middle_px = (chord.start_px + chord.end_px) * 0.5;
    let mut shifts_px = [0.0; PLACES.len()];
    for (place, shift_px) in PLACES.iter().zip(&mut shifts_px) {
        let expected_px = middle_px + along * *place;
        *shift_px = step_on_line(image, &expected_px, &right, reach, edge.is_right_light)?;
    }
    let [start, end] = shifts_px;
    let (shift, turn) = (0.5 * (start + end), (end - start) / (PLACES[1] - PLACES[0]));
    // The precisions of a mean of two, and of a slope from two.
    let precisions = [libm::sqrt(2.0), libm::sqrt(2.0) * PLACES[1]].map(|root| root / SIGMA_PX);
    let ends = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
    let whitener = [precisions[0], 0.0, precisions[1]];
    let seen = [precisions[0] * shift, precisions[1] * turn];
    Some(SeenEdge::new(*edge, ends, &right, whitener, seen))
}

/// From the expected position to the step, along a line to the right, in px.
fn step_on_line<P: Pixel>(
    image: &GreyImage<'_, P>,
    expected_px: &Vector2<f64>,
    right: &Vector2<f64>,
    reach: usize,
    is_right_light: bool,
) -> Option<f64> {
    // The whole line must be inside the frame.
    image.window_centre((*expected_px).into(), reach)?;
    let count = 2 * reach + 1;
    let mut line = [0.0_f32; LINE_PX_MAX];
    let line = line.get_mut(..count)?;
    // Fixed point: a conversion of a float costs more than all the rest.
    let fixed = |px: f64| (px * f64::from(ONE_PX)) as i32;
    let start_px = expected_px - right * reach as f64;
    let [mut x, mut y] = [fixed(start_px.x), fixed(start_px.y)];
    let step = [fixed(right.x), fixed(right.y)];
    let per_px = right.map(|part| part as f32 / ONE_PX as f32);
    // How far along the line the nearest pixels really lie, from the expected position.
    let mut distances = [0.0_f32; LINE_PX_MAX];
    let distances = distances.get_mut(..count)?;
    // Little but loads, so that the processor waits for many of them at once: these are the first
    // accesses to a frame's pixels.
    for (place, (value, distance)) in line.iter_mut().zip(distances.iter_mut()).enumerate() {
        let [column, row] = [x, y].map(|at| (at + ONE_PX / 2) >> ONE_PX.trailing_zeros());
        *value = image.pixel(column as usize, row as usize).into();
        let beside = [column * ONE_PX - x, row * ONE_PX - y].map(|part| part as f32);
        let on_line = place as f32 - reach as f32;
        *distance = on_line + beside[0] * per_px.x + beside[1] * per_px.y;
        x += step[0];
        y += step[1];
    }
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for &value in line.iter() {
        low = if value < low { value } else { low };
        high = if value > high { value } else { high };
    }
    let range = high - low;
    if range < CONTRAST_MIN * f32::from(image.white_level()) {
        return None;
    }
    // The outer thirds must have the expected colours.
    let third = count.div_ceil(3);
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let step = mean(&line[count - third..]) - mean(&line[..third]);
    if (if is_right_light { step } else { -step }) < STEP_SHARE_MIN * range {
        return None;
    }
    // The area under the pixels' levels, each of which extends halfway to its neighbours; the line
    // begins and ends half a pixel beyond its outermost ones.
    let (start, end) = (distances[0] - 0.5, distances[count - 1] + 0.5);
    let mut light = 0.0;
    for place in 0..count {
        let before =
            if place == 0 { start } else { 0.5 * (distances[place - 1] + distances[place]) };
        let after =
            if place + 1 == count { end } else { 0.5 * (distances[place] + distances[place + 1]) };
        light += (line[place] - low) * (after - before);
    }
    let light = light / range;
    Some(f64::from(if is_right_light { end - light } else { start + light }))
}
