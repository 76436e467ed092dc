//! Where a target lies of which hair, a sleeve or a strap covers a part.
//!
//! The pieces of a lattice on both sides of a cover are joined by the plane of their corners. Then
//! the place of the target follows from the sides at which it is seen to end: the squares around
//! its corners, and a white margin after them. Its columns and rows are known, so one end of an
//! axis fixes the place along it. What is demanded is more: one end of each axis, and either both
//! ends of one axis, as far apart as the target's columns or rows are, or corners in all of its
//! columns and rows; and that no other missing target, and no other place, fits what is seen. So a
//! cover may hide one whole side of the target, but not two. A target that the frame's border hides
//! is not accepted.
//!
//! What it cannot detect: a board that has as many columns as the target, or as many rows, and of
//! which a side is hidden that would show the difference.

use super::lattice::{Bounds, Lattice, Line};
use super::plane::Plane;
use super::{
    BEYOND_SCORE_MIN, Grid, agreement, beyond, is_detectable, median_score, numbered, numbering,
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
/// Most border lines of clutter that are removed.
const CLUTTER_LINES_MAX: usize = 4;

/// What is seen at one side of a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    /// The squares around the corners, and the margin.
    Ends,
    /// Nothing that says whether the board ends there, or something that covers its squares.
    Hidden,
    /// Squares that end where they should, or something like a margin: a board of other columns and
    /// rows may end there.
    MayEnd,
    /// More squares.
    GoesOn,
}

/// The grid of the one shape that has exactly one place in a lattice, and its index in `wanted`.
/// The lattice has just been grown; it is extended over the gaps.
pub(super) fn place<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &mut Lattice,
    corners: &[Corner],
    wanted: &[GridShape],
) -> Option<(usize, Grid)> {
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
    let plane = Plane::fit(lattice, corners)?;
    let extent = lattice.extent().filter(is_small)?;
    if extent.borders().iter().any(|line| beyond::squares_go_on(image, lattice, corners, line)) {
        return None;
    }
    let votes = all_votes(image, lattice, &plane, extent)?;
    let sides = votes.map(|ends| ends.map(|votes| votes.side()));
    if sides.as_flattened().contains(&Side::GoesOn) {
        return None;
    }
    let seen = lattice.cells().count();
    let mut only = None;
    for (index, shape) in wanted.iter().enumerate() {
        let lines = [usize::from(shape.columns), usize::from(shape.rows)];
        let turned = [lines[1], lines[0]];
        let count = lines[0] * lines[1];
        if seen < SEEN_MIN || seen * SEEN_SHARE_MIN.1 < count * SEEN_SHARE_MIN.0 {
            continue;
        }
        let ways = if lines == turned { &[lines][..] } else { &[lines, turned] };
        for &way in ways {
            let Some(bounds) = placed(extent, way, sides) else { continue };
            if only.replace((index, *shape, bounds)).is_some() {
                return None;
            }
        }
    }
    let (index, shape, bounds) = only?;
    if bounds != extent && !sides.contains(&[Side::Ends; 2]) {
        return None;
    }
    let is_clear = |cell: [i32; 2]| {
        let cell = cell.map(|value| value as f32);
        plane.at(cell).is_some_and(|place| is_detectable(image, place))
            && plane.steps(cell).is_some_and(|steps| {
                steps.iter().all(|[dx, dy]| libm::hypotf(*dx, *dy) >= STEP_PX_MIN)
            })
    };
    // With the squares around it: what the frame cuts may be a part of another board.
    if !bounds.grown(1).cells().all(is_clear) {
        return None;
    }
    let (numbering, first_square_dark) = numbering(lattice, corners, bounds, shape).ok()?;
    Some((index, numbered(lattice, shape, &numbering, first_square_dark)))
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
    let votes =
        Plane::fit(lattice, corners).and_then(|plane| all_votes(image, lattice, &plane, bounds));
    let Some(votes) = votes else { return Open { axes: [true; 2], hidden: [true; 2] } };
    let is_open = |votes: &Votes| votes.side() != Side::Ends;
    let is_hidden = |votes: &Votes| is_open(votes) && !votes.is_complete();
    Open {
        axes: votes.each_ref().map(|ends| ends.iter().any(is_open)),
        hidden: votes.each_ref().map(|ends| ends.iter().any(is_hidden)),
    }
}

/// What is seen at the four sides: by axis, and first those against its direction.
fn all_votes<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &Lattice,
    plane: &Plane,
    bounds: Bounds,
) -> Option<[[Votes; 2]; 2]> {
    let contrast = contrast(image, lattice, plane, bounds)?;
    let mut all = <[[Votes; 2]; 2]>::default();
    for line in bounds.borders() {
        let axis = usize::from(line.outwards[0] == 0);
        let end = usize::from(line.outwards[axis] > 0);
        all[axis][end] = votes(image, lattice, plane, &line, contrast);
    }
    Some(all)
}

/// The bounds of a target with this many lines along each axis, given what is seen at the sides;
/// `None` where it does not fit, or has no end along an axis.
fn placed(extent: Bounds, lines: [usize; 2], sides: [[Side; 2]; 2]) -> Option<Bounds> {
    let seen = [extent.columns(), extent.rows()];
    let mut bounds = extent;
    for axis in 0..2 {
        let hidden = lines[axis].checked_sub(seen[axis])?;
        match sides[axis] {
            [Side::Ends, _] | [_, Side::Ends] if hidden == 0 => {}
            [Side::Ends, Side::Hidden] => bounds.last[axis] += hidden as i32,
            [Side::Hidden, Side::Ends] => bounds.first[axis] -= hidden as i32,
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
        let plane = Plane::fit(lattice, corners)?;
        let extent = lattice.extent()?;
        let contrast = contrast(image, lattice, &plane, extent)?;
        let least = BEYOND_SCORE_MIN * median_score(lattice, corners, extent);
        let is_clutter = |line: &Line| {
            let seen = || line.cells().filter_map(|cell| lattice.corner(cell));
            3 * seen().count() < line.length()
                && (seen().all(|index| corners[usize::from(index)].score < least)
                    || extent.without(line).is_some_and(|smaller| {
                        let mut borders = smaller.borders().into_iter();
                        let before = borders.find(|before| before.outwards == line.outwards);
                        before.is_some_and(|before| {
                            votes(image, lattice, &plane, &before, contrast).side() == Side::Ends
                        })
                    }))
        };
        let Some(line) = extent.borders().into_iter().find(is_clutter) else { break };
        line.cells().for_each(|cell| lattice.remove(cell));
    }
    Some(())
}

/// Whether the square from a place along u and v is dark.
fn is_dark(lattice: &Lattice, cell: [i32; 2]) -> bool {
    lattice.edge_along_u(cell) == 0
}

/// The mean difference between light and dark squares of which all four corners are seen.
fn contrast<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &Lattice,
    plane: &Plane,
    extent: Bounds,
) -> Option<f32> {
    let mut sums = [[0.0_f32; 2]; 2];
    for cell in extent.cells() {
        let [u, v] = cell;
        let whole = [[u, v], [u + 1, v], [u, v + 1], [u + 1, v + 1]]
            .into_iter()
            .all(|cell| lattice.corner(cell).is_some());
        let middle = plane.at([u as f32 + 0.5, v as f32 + 0.5]);
        if whole
            && let Some(value) = middle.and_then(|middle| image.mean_around(middle.map(f64::from)))
        {
            let sum = &mut sums[usize::from(is_dark(lattice, cell))];
            sum[0] += value;
            sum[1] += 1.0;
        }
    }
    let [light, dark] = sums.map(|sum| sum[0] / sum[1]);
    (light > dark).then_some(light - dark)
}

/// What the squares just outside of a border line, and what follows them, say about a side.
#[derive(Debug, Default)]
struct Votes {
    /// Light squares after which paper follows: a margin.
    margins: u32,
    /// Light squares after which dark ones begin where they would: the board goes on.
    more: u32,
    /// Dark squares that end where they should, with paper behind: a margin, or a light square.
    dark_ends: u32,
    /// Squares that end too early or too late, or have neither behind: something covers them.
    covered: u32,
    /// Squares that are seen.
    seen: u32,
    /// Dark ones among them.
    dark: u32,
    /// Dark squares that end about where they should, whatever is behind: a narrow margin, or one
    /// in a shadow.
    dark_maybe: u32,
    /// Squares that end much too early, light and dark ones: no margin does that.
    early: [u32; 2],
    /// Squares that there would be without a cover.
    possible: u32,
}

impl Votes {
    /// Whether squares end much too early, as behind a cover.
    fn is_cut_short(&self) -> bool {
        2 * self.early[0] > self.seen - self.dark || 2 * self.early[1] > self.dark
    }

    /// Whether a third of the squares, and at least two, end much too early or are not seen at all.
    fn is_partly_covered(&self) -> bool {
        let hidden = self.early[0] + self.early[1] + self.possible - self.seen;
        hidden >= 2 && 3 * hidden >= self.possible
    }

    /// Whether nearly all squares are seen, and none is cut short.
    fn is_complete(&self) -> bool {
        5 * self.seen >= 4 * self.possible && !self.is_cut_short()
    }

    fn side(&self) -> Side {
        let &Self { margins, more, dark_ends, covered, dark, dark_maybe, possible, .. } = self;
        let on_board = margins + dark_ends;
        if margins > 2 * more && dark_ends > 0 && on_board >= 3 && on_board > 2 * covered {
            Side::Ends
        } else if more > margins && dark_ends > 0 && more + dark_ends > covered {
            Side::GoesOn
        } else if self.is_partly_covered() {
            Side::Hidden
        } else if more >= 2 || 2 * on_board > possible || (dark > 0 && 2 * dark_maybe >= dark) {
            Side::MayEnd
        } else {
            Side::Hidden
        }
    }
}

/// What is seen at one side: the squares just inside, those just outside, and what follows.
fn votes<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &Lattice,
    plane: &Plane,
    line: &Line,
    contrast: f32,
) -> Votes {
    /// Where squares are sampled, in steps outwards from the corners.
    const INSIDE: f32 = -0.5;
    const OUTSIDE: f32 = 0.5;
    const FARTHER: f32 = 1.3;
    /// A square is seen if it has this share of the board's contrast to its neighbour.
    const SEEN_SHARE: f32 = 0.5;
    /// Paper is darker than the light squares by at most this share of their difference to the dark
    /// ones, as most covers are not; it is brighter where blur darkens the squares.
    const DARKER_SHARE: f32 = 0.1;
    const BRIGHTER_SHARE: f32 = 0.3;
    /// A square ends where it should within this part of a step, and this many pixels.
    const END_ERROR: f32 = 0.07;
    const END_ERROR_PX: f32 = 0.5;
    /// About where it should: within this part of a step.
    const MAYBE_END_ERROR: f32 = 0.2;
    let mut votes = Votes::default();
    // Each square between two corners of the line, and those before and after them.
    for number in -1..line.length() as i32 {
        votes.possible += 1;
        let cell = line.cell(number);
        let middle = [0, 1].map(|axis| cell[axis] as f32 + 0.5 * line.step[axis] as f32);
        let at =
            |out: f32| plane.at([0, 1].map(|axis| middle[axis] + out * line.outwards[axis] as f32));
        let level = |out: f32| at(out).and_then(|place| image.mean_around(place.map(f64::from)));
        let (Some(inside), Some(outside)) = (level(INSIDE), level(OUTSIDE)) else { continue };
        let (Some(near), Some(far)) = (at(OUTSIDE), at(OUTSIDE + 1.0)) else { continue };
        let step_px = libm::hypotf(far[0] - near[0], far[1] - near[1]);
        // The square outside begins at the corner, or one step outwards of it.
        let first = [0, 1].map(|axis| cell[axis] + line.outwards[axis].min(0));
        let outside_dark = is_dark(lattice, first);
        let (light, dark) = if outside_dark { (inside, outside) } else { (outside, inside) };
        let span = light - dark;
        if span < SEEN_SHARE * contrast {
            continue;
        }
        votes.seen += 1;
        votes.dark += u32::from(outside_dark);
        let Some(farther) = level(FARTHER) else { continue };
        let is_paper = (-DARKER_SHARE * span..BRIGHTER_SHARE * span).contains(&(farther - light));
        let end = end_of_square(level, 0.5 * (light + dark));
        let ends_there =
            end.is_some_and(|end| (end - 1.0).abs() < END_ERROR + END_ERROR_PX / step_px);
        let ends_about_there = end.is_some_and(|end| (end - 1.0).abs() < MAYBE_END_ERROR);
        let ends_early = end.is_some_and(|end| end < 1.0 - MAYBE_END_ERROR);
        votes.early[usize::from(outside_dark)] += u32::from(ends_early);
        votes.dark_maybe += u32::from(outside_dark && ends_about_there);
        match (outside_dark, end) {
            (true, Some(_)) if ends_there && is_paper => votes.dark_ends += 1,
            (false, None) if is_paper => votes.margins += 1,
            (false, Some(_)) if ends_there => votes.more += 1,
            _ => votes.covered += 1,
        }
    }
    votes
}

/// Where the level crosses `middle` first, in steps outwards from the corners, from the middle of
/// the square outside to shortly before that of the next one.
fn end_of_square(level: impl Fn(f32) -> Option<f32>, middle: f32) -> Option<f32> {
    const FIRST: f32 = 0.5;
    const STEP: f32 = 0.1;
    const STEPS: usize = 9;
    let mut before = level(FIRST)? - middle;
    for number in 1..=STEPS {
        let out = FIRST + number as f32 * STEP;
        let here = level(out)? - middle;
        if before * here <= 0.0 {
            return Some(
                out - STEP * here.abs() / (here.abs() + before.abs()).max(f32::MIN_POSITIVE),
            );
        }
        before = here;
    }
    None
}
