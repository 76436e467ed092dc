//! What is seen at the sides of a lattice: whether the board ends there, or is covered.
//!
//! A board ends at a side where its squares do, and paper follows: a margin. Each of the squares
//! just outside of the border corners, which belong to the board, says what follows where it ends.
//! Squares farther out that are seen beyond a cover belong to the board too, though no corner of
//! theirs is seen.
//!
//! A cover that looks like paper is recognised where it cuts dark squares. One whose edge follows
//! the edges of the squares is not: it ends the board.

use super::lattice::{Bounds, Line};
use super::view::View;
use crate::model::image::Pixel;

/// Where squares are sampled, in steps outwards from the corners.
const INSIDE: f32 = -0.5;
const OUTSIDE: f32 = 0.5;
const FARTHER: f32 = 1.3;
/// And beside that, in steps across.
const BESIDE: f32 = 0.25;
/// A square is seen if it has this share of the board's contrast to its neighbour.
const SEEN_SHARE: f32 = 0.5;
/// A square ends where it should within this part of a step, and this many pixels.
const END_ERROR: f32 = 0.07;
const END_ERROR_PX: f32 = 0.5;
/// About where it should: within this part of a step.
const MAYBE_END_ERROR: f32 = 0.2;
/// Most lines of corners that a cover may hide before squares that are seen.
const HIDDEN_LINES_MAX: i32 = 4;

/// What is seen at one side of a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// The squares around the corners, and the margin.
    Ends,
    /// Some squares that end where they should, with paper behind; the others are covered.
    EndsInPart,
    /// Nothing that says whether the board ends there, or something that covers its squares.
    Hidden,
    /// Squares that end where they should, or something like a margin: a board of other columns and
    /// rows may end there.
    MayEnd,
    /// More squares.
    GoesOn,
}

/// What the squares just outside of a border line, and what follows them, say about a side.
#[derive(Debug, Default)]
pub(super) struct Votes {
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
    /// Those that end where they should, in something nearly as bright as paper.
    dark_exact: u32,
    /// Squares that end much too early, light and dark ones: no margin does that.
    early: [u32; 2],
    /// Dark ones among these that end in something like paper: it is a cover.
    cut_by_paper: u32,
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
    pub(super) fn is_complete(&self) -> bool {
        5 * self.seen >= 4 * self.possible && !self.is_cut_short()
    }

    /// Whether what looks like paper is a cover: it cuts as many dark squares as end at it.
    pub(super) fn is_covered_by_paper(&self) -> bool {
        self.cut_by_paper > 0 && (self.dark_ends < 2 || self.dark_ends <= self.cut_by_paper)
    }

    /// What they say. `is_margin_known` if the board's margin is seen at its three other sides: then
    /// it is as wide here, unless something covers it.
    pub(super) fn side(&self, is_margin_known: bool) -> Side {
        let &Self { margins, more, dark_ends, covered, dark, possible, .. } = self;
        let on_board = margins + dark_ends;
        let may_be_narrow = if is_margin_known {
            dark > 0 && 2 * self.dark_exact >= dark
        } else {
            more >= 2 || (dark > 0 && 2 * self.dark_maybe >= dark)
        };
        if self.is_covered_by_paper() {
            Side::Hidden
        } else if margins > 2 * more && dark_ends > 0 && on_board >= 3 && on_board > 2 * covered {
            Side::Ends
        } else if more > margins && dark_ends > 0 && more + dark_ends > covered {
            Side::GoesOn
        } else if dark_ends > 0 && on_board >= 2 && more == 0 {
            Side::EndsInPart
        } else if self.is_partly_covered() {
            Side::Hidden
        } else if 2 * on_board > possible || may_be_narrow {
            Side::MayEnd
        } else {
            Side::Hidden
        }
    }
}

/// What is seen at the four sides, by axis, and first those against its direction.
pub(super) type Sides = [[Side; 2]; 2];

/// What the squares at the four sides say together.
pub(super) fn sides(votes: &[[Votes; 2]; 2]) -> Sides {
    let apart = |is_margin_known: bool| {
        votes.each_ref().map(|ends| ends.each_ref().map(|votes| votes.side(is_margin_known)))
    };
    let sides = apart(false);
    let ends = sides.as_flattened().iter().filter(|side| **side == Side::Ends).count();
    if ends == 3 { apart(true) } else { sides }
}

/// What the squares at the four sides say.
pub(super) fn all_votes<P: Pixel>(view: &View<'_, P>, bounds: Bounds) -> [[Votes; 2]; 2] {
    let mut all = <[[Votes; 2]; 2]>::default();
    for line in bounds.borders() {
        let axis = usize::from(line.outwards[0] == 0);
        let end = usize::from(line.outwards[axis] > 0);
        all[axis][end] = votes(view, &line);
    }
    all
}

/// What is seen at one side: the squares just inside, those just outside, and what follows.
pub(super) fn votes<P: Pixel>(view: &View<'_, P>, line: &Line) -> Votes {
    let mut votes = Votes::default();
    // Each square between two corners of the line, and those before and after them.
    for number in -1..line.length() as i32 {
        votes.possible += 1;
        let square = Square::new(line, number, 0);
        let place = |out: f32| square.place(out);
        let level = |out: f32| view.level(place(out));
        let (Some(inside), Some(outside)) = (level(INSIDE), level(OUTSIDE)) else { continue };
        let Some(error) = end_error(view, &square) else { continue };
        let outside_dark = view.is_dark(square.cell);
        // Where the square on their other side is covered, though the corners are seen, one is seen
        // by its difference from what would be there.
        let are_corners_seen = (number.max(0)..=(number + 1).min(line.length() as i32 - 1))
            .all(|number| view.is_seen(line.cell(number)));
        let uncovered = || view.square_level(place(INSIDE), !outside_dark);
        let is_seen = |inside: &f32| {
            let difference = if outside_dark { inside - outside } else { outside - inside };
            difference >= SEEN_SHARE * view.contrast
        };
        let inside = [Some(inside), are_corners_seen.then(uncovered)];
        let Some(inside) = inside.into_iter().flatten().find(is_seen) else { continue };
        votes.seen += 1;
        votes.dark += u32::from(outside_dark);
        let is_paper = view.is_paper(place(FARTHER));
        let end = end_of_square(level, 0.5 * (inside + outside), OUTSIDE);
        let ends_there = end.is_some_and(|end| (end - 1.0).abs() < error);
        let ends_about_there = end.is_some_and(|end| (end - 1.0).abs() < MAYBE_END_ERROR);
        let early = end.filter(|&end| end < 1.0 - MAYBE_END_ERROR);
        // Between its end and where it should end, and behind that.
        let ends_in_paper = early.is_some_and(|end| view.is_paper(place(0.5 * (end + 1.0))));
        votes.early[usize::from(outside_dark)] += u32::from(early.is_some());
        votes.cut_by_paper += u32::from(outside_dark && ends_in_paper && is_paper);
        votes.dark_maybe += u32::from(outside_dark && ends_about_there);
        votes.dark_exact +=
            u32::from(outside_dark && ends_there && view.is_nearly_paper(place(FARTHER)));
        match (outside_dark, end) {
            (true, Some(_)) if ends_there && is_paper => votes.dark_ends += 1,
            (false, None) if is_paper && is_plain(view, &square) => votes.margins += 1,
            (false, Some(_)) if ends_there => votes.more += 1,
            _ => votes.covered += 1,
        }
    }
    votes
}

/// Whether what follows a light square is paper all over: hair and folds are as bright as paper here
/// and there.
fn is_plain<P: Pixel>(view: &View<'_, P>, square: &Square) -> bool {
    [-BESIDE, BESIDE].into_iter().all(|beside| view.is_paper(square.place_beside(FARTHER, beside)))
}

/// The bounds, with the lines of corners that a cover hides before squares that are seen.
pub(super) fn with_squares_beyond<P: Pixel>(view: &View<'_, P>, bounds: Bounds) -> Bounds {
    let mut all = bounds;
    for line in bounds.borders() {
        let farthest = (1..=HIDDEN_LINES_MAX).rev().find(|&gap| squares_end(view, &line, gap));
        for axis in 0..2 {
            let lines = farthest.unwrap_or(0) * line.outwards[axis];
            all.first[axis] += lines.min(0);
            all.last[axis] += lines.max(0);
        }
    }
    all
}

/// Whether a line of squares is seen this many steps outwards of those just outside of a border
/// line: at least two more sides of dark ones end where they should than of light ones. At a straight
/// edge of something dark every square ends, and at most one more of them is a dark one. The first
/// and the last square, at the board's corners, end at two sides.
fn squares_end<P: Pixel>(view: &View<'_, P>, line: &Line, gap: i32) -> bool {
    let mut ends = [0; 2];
    let last = line.length() as i32 - 1;
    for number in -1..=last {
        let square = Square::new(line, number, gap);
        let [before, after] = [(-1, -1), (last, 1)].map(|(at_corner, sign)| {
            let outwards = line.step.map(|step| sign * step);
            (number == at_corner).then_some(Square { outwards, ..square })
        });
        let seen = [Some(square), before, after]
            .iter()
            .flatten()
            .filter(|square| is_end_seen(view, square))
            .count();
        ends[usize::from(view.is_dark(square.cell))] += seen;
    }
    ends[1] >= ends[0] + 2
}

/// Whether something dark is seen to end where a square should, with paper behind.
fn is_end_seen<P: Pixel>(view: &View<'_, P>, square: &Square) -> bool {
    if !view.is_paper_beside_edge(square.place(FARTHER)) {
        return false;
    }
    let Some(error) = end_error(view, square) else { return false };
    let middle = view.paper_level(square.place(1.0)) - 0.5 * view.contrast;
    // Inwards, because a cover may have left a sliver of the square.
    let level = |inwards: f32| view.level(square.place(2.0 - inwards));
    end_of_square(level, middle, 2.0 - FARTHER).is_some_and(|end| (end - 1.0).abs() < error)
}

/// The area of paper, in squares, that is seen where a board with these bounds has dark squares
/// which one with the smaller bounds does not have.
pub(super) fn paper_within<P: Pixel>(view: &View<'_, P>, bounds: Bounds, smaller: Bounds) -> f32 {
    let inside = smaller.squares();
    let added = bounds.squares().cells().filter(|&cell| !inside.contains(cell));
    added.filter(|&cell| view.is_dark(cell)).map(|cell| paper_in_square(view, cell)).sum()
}

/// The share of a square in which paper is seen, without what is as thin as hair or folds: four
/// samples beside each other are paper.
fn paper_in_square<P: Pixel>(view: &View<'_, P>, [u, v]: [i32; 2]) -> f32 {
    const SAMPLES: [f32; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
    const LAST: usize = SAMPLES.len() - 1;
    let paper = SAMPLES.map(|dv| SAMPLES.map(|du| view.is_paper([u as f32 + du, v as f32 + dv])));
    let mut even = [[false; SAMPLES.len()]; SAMPLES.len()];
    for (row, column) in (0..LAST).flat_map(|row| (0..LAST).map(move |column| (row, column))) {
        let four = || [row, row + 1].into_iter().flat_map(|i| [[i, column], [i, column + 1]]);
        if four().all(|[i, j]| paper[i][j]) {
            four().for_each(|[i, j]| even[i][j] = true);
        }
    }
    let count = even.as_flattened().iter().filter(|is_even| **is_even).count();
    count as f32 / (SAMPLES.len() * SAMPLES.len()) as f32
}

/// A square of the lattice, seen along one of its directions.
#[derive(Clone, Copy)]
struct Square {
    /// The place from which it lies along u and v.
    cell: [i32; 2],
    outwards: [i32; 2],
}

impl Square {
    /// The square after the corner of a border line with this number, as many steps outwards of
    /// those just outside.
    fn new(line: &Line, number: i32, gap: i32) -> Self {
        Self { cell: line.square(number, gap), outwards: line.outwards }
    }

    /// A place in the middle across its direction, in steps outwards from its inner side.
    fn place(&self, out: f32) -> [f32; 2] {
        self.place_beside(out, 0.0)
    }

    /// A place beside the middle across its direction, in steps.
    fn place_beside(&self, out: f32, beside: f32) -> [f32; 2] {
        let from_middle = out - 0.5;
        [0, 1].map(|axis| {
            let across = beside * self.outwards[1 - axis] as f32;
            self.cell[axis] as f32 + 0.5 + from_middle * self.outwards[axis] as f32 + across
        })
    }
}

/// How far from its place a square may end, in steps.
fn end_error<P: Pixel>(view: &View<'_, P>, square: &Square) -> Option<f32> {
    Some(END_ERROR + END_ERROR_PX / view.step_px(square.place(1.0), square.outwards)?)
}

/// Where the level crosses `middle` first, in steps, from `first`, within a square, to shortly
/// before 1.5, the middle of the next one.
fn end_of_square(level: impl Fn(f32) -> Option<f32>, middle: f32, first: f32) -> Option<f32> {
    const STEP: f32 = 0.1;
    const LAST: f32 = 1.4;
    let mut before = level(first)? - middle;
    for number in 1..=((LAST - first) / STEP + 0.5) as usize {
        let out = first + number as f32 * STEP;
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

#[cfg(test)]
mod tests;
