//! What contradicts the place of a board of which something covers a part.
//!
//! A place says where each square lies, those included that no corner of the lattice shows. Beside
//! the cover, the picture can contradict it in two ways:
//!
//! - A square is seen outside of the board. Its corner shows it: ink there, and paper along both of
//!   the edges that meet. Hair, and the edge of a cover or of the sheet, are dark on one side of a
//!   line.
//! - What must be hidden could not be hidden by one thing. Where dark squares should be and paper is
//!   seen, there is either none of them, or a cover that looks like paper. Its outline cannot be
//!   seen, so it is asked to be simple: a sleeve or a strap has straight edges, and no print is seen
//!   between two places that it hides.

use heapless::Vec;

use super::lattice::Bounds;
use super::sides;
use super::view::View;
use crate::limits::TARGET_CORNERS_MAX;
use crate::model::image::Pixel;

/// How far around a board squares are looked for: the lines that a cover may hide, and one more.
const REACH: i32 = 5;
/// Where the ink is sampled beside a corner of a square, in steps along both edges: near it, because
/// the cover may have left a sliver only. Blur reaches a step's seventh where squares are small.
const INK: [[f32; 2]; 3] = [[0.15, 0.15], [0.15, 0.25], [0.25, 0.15]];
/// And the paper, across an edge and along it: so far along that no straight line parts the ink from
/// the paper.
const PAPER: [[f32; 2]; 3] = [[0.15, 0.15], [0.15, 0.4], [0.4, 0.15]];
/// How far a corner may lie from its place for each line that it lies outside of the lattice, in
/// steps: places are extrapolated from corners of which a cover's edge may have moved some.
const ERROR_PER_LINE: f32 = 0.1;
/// At most: at half a step it would be as near to the next one.
const ERRORS_MAX: i32 = 5;
/// Where the ink of a square is looked for, along each of its sides.
const IN_SQUARE: [f32; 4] = [0.1, 0.35, 0.65, 0.9];
/// And how finely it is told from paper: the samples along each side, one less than the parts.
const PARTS: i16 = 10;
/// Most places of an outline: two for each line of samples of the longest target.
const OUTLINE_MAX: usize = 2 * (PARTS as usize - 1) * (TARGET_CORNERS_MAX / 3 + 1);

/// Whether a square is seen outside of a board with these bounds, in line with its own and beyond a
/// side that something covers. The places around it are extrapolated from corners within `extent`.
#[inline(never)]
pub(super) fn is_square_outside<P: Pixel>(
    view: &View<'_, P>,
    bounds: Bounds,
    extent: Bounds,
) -> bool {
    bounds.borders().into_iter().any(|line| {
        !sides::votes(view, &line).is_complete()
            && (1..=REACH).any(|gap| {
                (-1..line.length() as i32)
                    .map(|number| line.square(number, gap))
                    .filter(|&cell| view.is_dark(cell) && has_ink(view, cell))
                    .any(|cell| is_square_seen(view, cell, extent))
            })
    })
}

/// Whether one of a dark square's corners is seen.
fn is_square_seen<P: Pixel>(view: &View<'_, P>, cell: [i32; 2], extent: Bounds) -> bool {
    [[-1, -1], [1, -1], [-1, 1], [1, 1]].into_iter().any(|outwards: [i32; 2]| {
        let corner = [0, 1].map(|axis| cell[axis] + i32::from(outwards[axis] > 0));
        let lines = [0, 1]
            .map(|axis| (extent.first[axis] - corner[axis]).max(corner[axis] - extent.last[axis]));
        let errors = lines[0].max(lines[1]).clamp(0, ERRORS_MAX);
        let inwards = outwards.map(|sign| -sign as f32);
        let mut offsets =
            (-errors..=errors).flat_map(|dv| (-errors..=errors).map(move |du| [du, dv]));
        offsets.any(|offset| {
            let off = |axis: usize| offset[axis] as f32 * ERROR_PER_LINE;
            is_corner_of_square(view, [0, 1].map(|axis| corner[axis] as f32 + off(axis)), inwards)
        })
    })
}

/// Whether anything in a square is as dark as ink.
fn has_ink<P: Pixel>(view: &View<'_, P>, [u, v]: [i32; 2]) -> bool {
    let is_ink = |du: f32, dv: f32| view.is_nearly_ink([u as f32 + du, v as f32 + dv]);
    IN_SQUARE.into_iter().any(|dv| IN_SQUARE.into_iter().any(|du| is_ink(du, dv)))
}

/// Whether a dark square is seen to have a corner here, with paper along both edges.
fn is_corner_of_square<P: Pixel>(view: &View<'_, P>, corner: [f32; 2], inwards: [f32; 2]) -> bool {
    let place = |[along_u, along_v]: [f32; 2], side: [f32; 2]| {
        [corner[0] + side[0] * along_u * inwards[0], corner[1] + side[1] * along_v * inwards[1]]
    };
    let is_paper = |side| PAPER.into_iter().all(|along| view.is_nearly_paper(place(along, side)));
    INK.into_iter().all(|along| view.is_nearly_ink(place(along, [1.0, 1.0])))
        && is_paper([-1.0, 1.0])
        && is_paper([1.0, -1.0])
}

/// A sample of a square, in parts of a step.
type Sample = [i16; 2];

/// Whether ink is seen between places at which paper is seen, though a board with these bounds has
/// dark squares there.
///
/// A function of its own in the program too: the outline is not kept while a pose is solved.
#[inline(never)]
pub(super) fn is_ink_between_hidden<P: Pixel>(view: &View<'_, P>, bounds: Bounds) -> bool {
    let place = |sample: Sample| sample.map(|value| f32::from(value) / f32::from(PARTS));
    // Of each line of samples, the first and the last that is paper: these are around all others.
    let mut outline = Vec::<Sample, OUTLINE_MAX>::new();
    for v in lines_of_samples(bounds, 1) {
        let samples = samples_of_line(view, bounds, v);
        let mut hidden = samples.filter(|&sample| view.is_paper(place(sample)));
        if let Some(first) = hidden.next() {
            // Cannot be full: no target has more lines.
            let _ = outline.push(first);
            let _ = hidden.last().map(|last| outline.push(last));
        }
    }
    lines_of_samples(bounds, 1).any(|v| {
        samples_of_line(view, bounds, v)
            .any(|sample| view.is_ink(place(sample)) && is_between(sample, &outline))
    })
}

/// Where the samples of a board's squares lie along an axis.
fn lines_of_samples(bounds: Bounds, axis: usize) -> impl Iterator<Item = i16> {
    let squares = bounds.squares();
    (squares.first[axis]..=squares.last[axis])
        .flat_map(|square| (1..PARTS).map(move |part| square as i16 * PARTS + part))
}

/// The samples with this v that lie in dark squares of a board.
fn samples_of_line<P: Pixel>(
    view: &View<'_, P>,
    bounds: Bounds,
    v: i16,
) -> impl Iterator<Item = Sample> {
    let square = |value: i16| i32::from(value.div_euclid(PARTS));
    lines_of_samples(bounds, 0)
        .filter(move |&u| view.is_dark([square(u), square(v)]))
        .map(move |u| [u, v])
}

/// Whether a sample lies within the convex hull of others: they are seen from it in directions that
/// span more than half a turn.
fn is_between(sample: Sample, others: &[Sample]) -> bool {
    let cross = |a: [i32; 2], b: [i32; 2]| a[0] * b[1] - a[1] * b[0];
    let offset = |other: &Sample| [0, 1].map(|axis| i32::from(other[axis] - sample[axis]));
    let mut directions = others.iter().map(offset);
    let Some(first) = directions.next() else { return false };
    // The directions so far lie between these two, at most half a turn apart.
    let [mut from, mut to] = [first, first];
    for direction in directions {
        match (cross(from, direction) >= 0, cross(direction, to) >= 0) {
            (true, true) => {}
            (true, false) => to = direction,
            (false, true) => from = direction,
            (false, false) => return true,
        }
    }
    false
}

#[cfg(test)]
mod tests;
