//! Where a target lies of which hair, a sleeve or a strap covers a part.
//!
//! The pieces of a lattice on both sides of a cover are joined by the plane of their corners, and
//! squares that are seen beyond a cover are added. Where a strap leaves one line of corners on each
//! side, exactly one number of hidden lines has to fit what is seen. Then the place of the target
//! follows from the [`sides`] at which it is seen to end. Its columns and rows are known, so one end
//! of an axis fixes the place along it. What is demanded is more: one end of each axis, and either
//! both ends of one axis, as far apart as the target's columns or rows are, or squares in all of its
//! columns and rows. No other missing target and no other place may fit what is seen, nor may paper
//! be seen where the hidden squares should be. So a cover may hide one whole side of the target, but
//! not two. A target that the frame's border hides is not accepted.
//!
//! What is seen beside the cover may still [contradict](super::contradiction) the place: squares
//! outside of the board, or print between two places that the cover would have to hide.
//!
//! What it cannot detect: a board that has as many columns as the target, or as many rows, and of
//! which a side is hidden that would show the difference. Nor is it free of errors on smaller boards
//! under a strap as bright as the paper, which cannot be told from the paper beside it: of 7,476
//! boards of other sizes whose difference was seen beside a cover, it took one of these for a target.

use super::lattice::{Bounds, Lattice, Least, Line};
use super::plane::Plane;
use super::sides::{self, Side, Sides, Votes};
use super::view::View;
use super::{
    BEYOND_SCORE_MIN, Grid, agreement, beyond, contradiction, is_detectable, median_score,
    numbered, numbering,
};
use crate::find::corner::Corner;
use crate::limits::TARGET_CORNERS_MAX;
use crate::model::image::{GreyImage, Pixel};
use crate::model::target::GridShape;

/// Most lines of corners that a cover may hide between two pieces, or in one round of joining.
const GAP_MAX: i32 = 3;
/// Most rounds of joining: each uses the plane of all that were joined before.
const ROUNDS_MAX: usize = 4;
/// Fewest corners that are seen, and as a share of the target's.
const SEEN_MIN: usize = 9;
const SEEN_SHARE_MIN: (usize, usize) = (2, 5);
/// Smallest squares: what is seen at the sides is sampled with 3 x 3 pixels.
const STEP_PX_MIN: f32 = 7.0;
/// The area of paper, in squares, that may be seen where hidden squares should be: by chance, a cover
/// is here and there as bright as paper. Less than half a square, of which blur hides the edges.
const PAPER_MAX: f32 = 0.3;
/// Most border lines of clutter that are removed.
const CLUTTER_LINES_MAX: usize = 4;

/// The grid of the one shape that has exactly one place in a lattice around a seed, and its index in
/// `wanted`. If that lattice has none, the line of corners beside the seed may be no neighbour: a
/// strap covers the lines between them. Then one number of hidden lines has to fit what is seen, no
/// other may, and none may join more corners. What was joined belongs to no other lattice.
pub(super) fn place_at<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &mut Lattice,
    corners: &[Corner],
    seed: u16,
    wanted: &[GridShape],
) -> Option<(usize, Grid)> {
    let mut most = (0, 1);
    let mut only: Option<(usize, (usize, Grid))> = None;
    let mut is_ambiguous = false;
    for gap in 1..=GAP_MAX + 1 {
        if lattice.grow(corners, seed, Least::Piece { gap }).is_none() {
            continue;
        }
        let fit = match place(image, lattice, corners, wanted) {
            Some(Fit::Only(placed)) if gap == 1 => return Some(placed),
            fit => fit,
        };
        let joined = lattice.cells().count();
        lattice.release();
        if joined > most.0 {
            most = (joined, gap);
        }
        match fit {
            Some(Fit::Only(placed)) => {
                is_ambiguous |= only.as_ref().is_some_and(|(_, other)| *other != placed);
                only = Some((joined, placed));
            }
            Some(Fit::Several) => is_ambiguous = true,
            None => {}
        }
    }
    // As it was, with all that was joined.
    let (joined, gap) = most;
    if joined > 0 && lattice.grow(corners, seed, Least::Piece { gap }).is_some() {
        let _ = place(image, lattice, corners, wanted);
    }
    only.filter(|(count, _)| !is_ambiguous && *count == joined).map(|(_, placed)| placed)
}

/// Which of the wanted shapes may be where.
#[derive(Debug, PartialEq)]
enum Fit<T> {
    /// One shape, at one place.
    Only(T),
    /// Several, or one at several places.
    Several,
}

/// The grid of the shape that has a place in a lattice, and its index in `wanted`; `None` where none
/// has one. The lattice has just been grown; it is extended over the gaps.
fn place<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &mut Lattice,
    corners: &[Corner],
    wanted: &[GridShape],
) -> Option<Fit<(usize, Grid)>> {
    for _ in 0..ROUNDS_MAX {
        let plane = Plane::fit(lattice, corners)?;
        if lattice.extend(corners, &plane, GAP_MAX) == 0 {
            break;
        }
    }
    // No target has more places: this bounds what follows.
    let is_small = |extent: &Bounds| extent.columns() * extent.rows() <= 2 * TARGET_CORNERS_MAX;
    agreement::remove_disagreeing(lattice, corners, lattice.extent().filter(is_small)?);
    remove_clutter(image, lattice, corners)?;
    let extent = lattice.extent().filter(is_small)?;
    if extent.borders().iter().any(|line| beyond::squares_go_on(image, lattice, corners, line)) {
        return None;
    }
    let view = View::new(image, lattice, corners, extent)?;
    let with_squares = Some(sides::with_squares_beyond(&view, extent)).filter(is_small)?;
    let seen = lattice.cells().count();
    let (index, shape, bounds) = match only_place(&view, [extent, with_squares], seen, wanted)? {
        Fit::Only(only) => only,
        Fit::Several => return Some(Fit::Several),
    };
    // With the squares around it: what the frame cuts may be a part of another board.
    if !bounds.grown(1).cells().all(|cell| is_clear(image, &view.plane, cell)) {
        return None;
    }
    if contradiction::is_square_outside(&view, bounds, extent) {
        return None;
    }
    let (numbering, first_square_dark) = numbering(lattice, corners, bounds, shape).ok()?;
    Some(Fit::Only((index, numbered(lattice, shape, &numbering, first_square_dark))))
}

/// The shape that has a place, its index in `wanted`, and its bounds; `None` where none has one, or
/// nothing proves it. What proves it is that all of it is seen, or both its ends along an axis. The
/// extents are that of the corners that are seen, `seen` in number, and that of the squares.
fn only_place<P: Pixel>(
    view: &View<'_, P>,
    [of_corners, extent]: [Bounds; 2],
    seen: usize,
    wanted: &[GridShape],
) -> Option<Fit<(usize, GridShape, Bounds)>> {
    let votes = sides::all_votes(view, extent);
    let sides = sides::sides(&votes);
    // A cover that looks like paper may hide squares where paper is seen, but not all around others.
    let is_like_paper = votes.as_flattened().iter().any(Votes::is_covered_by_paper);
    let is_whole = sides == [[Side::Ends; 2]; 2];
    let is_axis_seen = sides.iter().any(is_axis_whole);
    let (mut only, mut is_several, mut is_proven) = (None, false, false);
    for (index, shape) in wanted.iter().enumerate() {
        let lines = [usize::from(shape.columns), usize::from(shape.rows)];
        let turned = [lines[1], lines[0]];
        let are_enough =
            is_whole || seen * SEEN_SHARE_MIN.1 >= lines[0] * lines[1] * SEEN_SHARE_MIN.0;
        if seen < SEEN_MIN || !are_enough {
            continue;
        }
        let ways = if lines == turned { &[lines][..] } else { &[lines, turned] };
        for &way in ways {
            let Some(bounds) = placed(extent, way, sides) else { continue };
            let is_contradicted = sides::paper_within(view, bounds, of_corners) > PAPER_MAX
                && (!is_like_paper || contradiction::is_ink_between_hidden(view, bounds));
            if !is_contradicted {
                is_several |= only.replace((index, *shape, bounds)).is_some();
                is_proven |= is_axis_seen || bounds == extent;
            }
        }
    }
    let fit = only.map(|only| if is_several { Fit::Several } else { Fit::Only(only) });
    fit.filter(|_| is_proven)
}

/// Whether a lattice is seen to end at both sides of an axis.
fn is_axis_whole(ends: &[Side; 2]) -> bool {
    ends.contains(&Side::Ends)
        && ends.iter().all(|side| matches!(side, Side::Ends | Side::EndsInPart))
}

/// Whether a corner at a place of the plane could be detected, and the squares beside it be sampled.
fn is_clear<P: Pixel>(image: &GreyImage<'_, P>, plane: &Plane, cell: [i32; 2]) -> bool {
    let cell = cell.map(|value| value as f32);
    let is_large = |[dx, dy]: [f32; 2]| libm::hypotf(dx, dy) >= STEP_PX_MIN;
    plane.at(cell).is_some_and(|place| is_detectable(image, place))
        && plane.steps(cell).is_some_and(|steps| steps.into_iter().all(is_large))
}

/// Whether a lattice that looks whole goes on behind something that covers its next lines: corners
/// or squares are seen beyond.
pub(super) fn goes_on_beyond<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &Lattice,
    corners: &[Corner],
    bounds: Bounds,
) -> bool {
    let Some(view) = View::new(image, lattice, corners, bounds) else { return false };
    let least = BEYOND_SCORE_MIN * median_score(lattice, corners, bounds);
    let beyond = bounds.grown(GAP_MAX).cells().filter(|&cell| {
        !bounds.contains(cell)
            && lattice
                .corner_on_plane(corners, &view.plane, cell)
                .is_some_and(|index| corners[usize::from(index)].score >= least)
    });
    // One may be clutter.
    beyond.take(2).count() == 2
        || sides::with_squares_beyond(&view, bounds) != bounds
        || contradiction::is_square_outside(&view, bounds, bounds)
}

/// What the sides of a whole lattice of a wanted shape say.
pub(super) struct Open {
    /// The axes along which it is not seen to end at both sides.
    pub(super) axes: [bool; 2],
    /// Those among them along which a cover may hide more: the squares around it are not all seen.
    pub(super) hidden: [bool; 2],
}

/// What the sides of a lattice say.
pub(super) fn open<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &Lattice,
    corners: &[Corner],
    bounds: Bounds,
) -> Open {
    let Some(view) = View::new(image, lattice, corners, bounds) else {
        return Open { axes: [true; 2], hidden: [true; 2] };
    };
    let votes = sides::all_votes(&view, bounds);
    let is_open = |votes: &Votes| votes.side(false) != Side::Ends;
    let is_hidden = |votes: &Votes| is_open(votes) && !votes.is_complete();
    Open {
        axes: votes.each_ref().map(|ends| ends.iter().any(is_open)),
        hidden: votes.each_ref().map(|ends| ends.iter().any(is_hidden)),
    }
}

/// The bounds of a target with this many lines along each axis, given what is seen at the sides;
/// `None` where it does not fit, or has no end along an axis.
fn placed(extent: Bounds, lines: [usize; 2], sides: Sides) -> Option<Bounds> {
    let seen = [extent.columns(), extent.rows()];
    let mut bounds = extent;
    for axis in 0..2 {
        let hidden = lines[axis].checked_sub(seen[axis])?;
        match sides[axis] {
            [Side::GoesOn, _] | [_, Side::GoesOn] if hidden == 0 => return None,
            [Side::Ends, _] | [_, Side::Ends] if hidden == 0 => {}
            [Side::Ends, Side::Hidden | Side::GoesOn] => bounds.last[axis] += hidden as i32,
            [Side::Hidden | Side::GoesOn, Side::Ends] => bounds.first[axis] -= hidden as i32,
            _ => return None,
        }
    }
    Some(bounds)
}

/// Removes border lines with few corners which are clutter: because they are weak, or because the
/// board is seen to end before them.
fn remove_clutter<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &mut Lattice,
    corners: &[Corner],
) -> Option<()> {
    for _ in 0..CLUTTER_LINES_MAX {
        let extent = lattice.extent()?;
        let view = View::new(image, lattice, corners, extent)?;
        let least = BEYOND_SCORE_MIN * median_score(lattice, corners, extent);
        let is_clutter = |line: &Line| {
            let seen = || line.cells().filter_map(|cell| lattice.corner(cell));
            3 * seen().count() < line.length()
                && (seen().all(|index| corners[usize::from(index)].score < least)
                    || extent.without(line).is_some_and(|smaller| {
                        let mut borders = smaller.borders().into_iter();
                        let before = borders.find(|before| before.outwards == line.outwards);
                        before.is_some_and(|before| {
                            sides::votes(&view, &before).side(false) == Side::Ends
                        })
                    }))
        };
        let Some(line) = extent.borders().into_iter().find(is_clutter) else { break };
        line.cells().for_each(|cell| lattice.remove(cell));
    }
    Some(())
}

#[cfg(test)]
mod tests;
