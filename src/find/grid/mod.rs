//! From corners to indexed grids, in a cluttered room.
//!
//! Corners are joined into lattices, breadth first, starting from a cell of four corners that
//! closes: each further corner lies near the position that its neighbours predict, with the roles
//! of its two edges exchanged. A lattice becomes the grid of a wanted shape only when it has
//! exactly its columns and rows, its four border lines are seen, the board does not go on beyond
//! them, and every corner agrees with its neighbours; otherwise the result is a reason, never a
//! guess. Shapes that are not found that way are looked for once more among targets of which a
//! part is [`covered`].
//!
//! What it cannot detect: a board whose whole border line, with the squares beyond it, is hidden by
//! something looks like a smaller board. A board cut by the frame's border is recognised and
//! rejected, unless the caller allows it ([`FrameBorder`]); so is one with a line too blurred to be
//! detected, because the squares beyond it are still seen to alternate.
//!
//! The work is bounded by the square of [`CORNERS_MAX`]; with the one or two
//! hundred corners of a room it is a fraction of a millisecond.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::common::statistics::median;
use crate::find::corner::Corner;
use crate::limits::{CORNERS_MAX, TARGET_CORNERS_MAX, TARGETS_MAX};
use crate::model::image::{GreyImage, Pixel};
use crate::model::target::GridShape;

mod agreement;
mod beyond;
mod contradiction;
mod covered;
mod lattice;
mod plane;
mod sides;
#[cfg(test)]
mod tests;
mod view;

use lattice::{Bounds, Lattice, Least};

/// What a board may have to do with the border of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameBorder {
    /// A board is whole only if the squares around its corners are seen to end. Where frames
    /// follow each other, one that is cut may be a larger board on its way out.
    OutsideBoard,
    /// It may cut the squares around a board's corners, if all the corners are seen: for
    /// photographs of a board whose number of corners is known.
    MayCutBoard,
}

/// One target's grid as seen in the picture.
///
/// Right-handed as seen (x turns to y as the picture's right turns to its bottom). The square up
/// and left of corner 0 is dark if any of the possible numberings makes it so; of the remaining
/// numberings (two when columns + rows is even) it is the one whose x axis points most nearly to
/// the picture's right.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grid {
    /// Columns and rows, as wanted.
    pub shape: GridShape,
    /// Index into the slice of corners for each corner of the grid, row by row;
    /// `None` where it was not detected, or did not agree with its neighbours.
    pub corners: Vec<Option<u16>, TARGET_CORNERS_MAX>,
    /// Whether the square up and left of corner 0 is dark. A grid that looks the same
    /// after half a turn may be printed either way.
    pub first_square_dark: bool,
}

/// Why there is no grid of a wanted shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
pub enum GridRejection {
    /// Fewer than 3 x 3 corners make a lattice anywhere.
    NoLattice,
    /// There are lattices, but none with these numbers of columns and rows.
    OtherDimensions,
    /// A lattice of this shape is cut by the border of the picture: it may be a part of a larger
    /// one.
    Cut,
    /// A lattice of this shape lacks too many corners, or border corners, for its extent to be
    /// certain.
    Incomplete,
    /// The board seems to go on beyond the border of a lattice of this shape: there are more
    /// corners, or more squares that alternate.
    GoesOn,
    /// Two lattices have this shape.
    Ambiguous,
}

impl core::fmt::Display for GridRejection {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::NoLattice => "no checkerboard is seen",
            Self::OtherDimensions => "only checkerboards with other columns and rows are seen",
            Self::Cut => "the checkerboard touches the border of the picture",
            Self::Incomplete => "too many of the checkerboard's corners are hidden or blurred",
            Self::GoesOn => "the checkerboard seems to go on beyond the wanted columns and rows",
            Self::Ambiguous => "two checkerboards of the same shape are seen",
        })
    }
}

impl core::error::Error for GridRejection {}

/// How many corners of a border line must be seen: all but one.
const fn border_corners_min(length: usize) -> usize {
    length - 1
}

/// How many of all corners must be seen: five sixths.
const fn corners_min(count: usize) -> usize {
    (5 * count).div_ceil(6)
}

/// A corner beyond the border counts as part of the board if its score is at least this fraction of
/// the board's median. The corners of one board differ by less than that unless a shadow's edge
/// lies between them.
const BEYOND_SCORE_MIN: f32 = 0.3;

/// How near to the frame's border a corner can be detected, with one pixel to spare.
const DETECTABLE_PX: f32 = 7.0;

/// Finds grids. Holds the lattice that is being grown.
#[derive(Debug)]
pub struct GridFinder {
    lattice: Lattice,
    order: [u16; CORNERS_MAX],
}

impl Default for GridFinder {
    fn default() -> Self {
        Self::new()
    }
}

impl GridFinder {
    /// A finder, ready for use.
    #[must_use]
    pub const fn new() -> Self {
        Self { lattice: Lattice::new(), order: [0; CORNERS_MAX] }
    }

    /// Writes one entry of `found` per wanted shape, from the corners of a search of the picture,
    /// or of a part of it. The picture itself shows whether a grid goes on beyond its border.
    /// Corners past [`CORNERS_MAX`] are ignored.
    ///
    /// # Panics
    /// When `found` is shorter than `wanted`, or there are more than 16 wanted shapes: a caller's
    /// bug.
    pub fn find<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        corners: &[Corner],
        wanted: &[GridShape],
        border: FrameBorder,
        found: &mut [Result<Grid, GridRejection>],
    ) {
        assert!(found.len() >= wanted.len(), "one entry per wanted shape");
        assert!(wanted.len() <= WANTED_MAX, "at most {WANTED_MAX} wanted shapes");
        let corners = &corners[..corners.len().min(CORNERS_MAX)];
        let found = &mut found[..wanted.len()];
        found.fill(Err(GridRejection::NoLattice));
        // The strongest corners first: the lattices that grow from them are the most reliable.
        let order = &mut self.order[..corners.len()];
        for (index, entry) in order.iter_mut().enumerate() {
            *entry = index as u16;
        }
        order.sort_unstable_by(|&a, &b| {
            corners[usize::from(b)].score.total_cmp(&corners[usize::from(a)].score)
        });
        let mut open_grids: Vec<OpenGrid, SHAPES_MAX> = Vec::new();
        self.lattice.start(corners);
        for &seed in &*order {
            let Some(bounds) = self.lattice.grow(corners, seed, Least::Target) else { continue };
            for (shape, entry) in wanted.iter().zip(&mut *found) {
                if entry == &Err(GridRejection::Ambiguous) || !may_be(bounds, *shape) {
                    note(entry, GridRejection::OtherDimensions);
                    continue;
                }
                let judged = judge(image, &mut self.lattice, corners, bounds, *shape);
                let judged = judged.and_then(|judged| match border {
                    FrameBorder::OutsideBoard if judged.cut != [false; 2] => {
                        Err(GridRejection::Cut)
                    }
                    _ if is_part_of_another(judged.bounds, judged.cut, wanted) => {
                        Err(GridRejection::Cut)
                    }
                    _ => Ok(judged),
                });
                let Judged { grid, bounds, .. } = match judged {
                    Ok(judged) => judged,
                    Err(rejection) => {
                        note(entry, rejection);
                        continue;
                    }
                };
                if is_part_of_another(bounds, [true; 2], wanted) {
                    let open = covered::open(image, &self.lattice, corners, bounds);
                    if is_part_of_another(bounds, open.axes, wanted) {
                        let hidden = open.hidden;
                        if open_grids.push(OpenGrid { grid, bounds, hidden }).is_err() {
                            note(entry, GridRejection::Incomplete);
                        }
                        continue;
                    }
                }
                add(entry, grid);
            }
        }
        settle(open_grids, wanted, found);
        if found.iter().any(may_be_covered) {
            self.find_covered(image, corners, wanted, found);
        }
    }

    /// Looks for the shapes that were not found among covered targets.
    fn find_covered<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        corners: &[Corner],
        wanted: &[GridShape],
        found: &mut [Result<Grid, GridRejection>],
    ) {
        self.lattice.start(corners);
        for grid in found.iter().flatten() {
            self.lattice.use_up(grid.corners.iter().flatten().copied());
        }
        // All shapes that are missing compete for each lattice, even those that were found covered
        // already.
        let mut missing: Vec<GridShape, SHAPES_MAX> = Vec::new();
        for (shape, entry) in wanted.iter().zip(&*found) {
            let is_new = may_be_covered(entry) && !missing.contains(shape);
            if is_new && missing.push(*shape).is_err() {
                return;
            }
        }
        let mut placed: Vec<Option<Grid>, SHAPES_MAX> = missing.iter().map(|_| None).collect();
        let mut ambiguous = [false; SHAPES_MAX];
        for &seed in &self.order[..corners.len()] {
            let at_seed = covered::place_at(image, &mut self.lattice, corners, seed, &missing);
            if let Some((place, grid)) = at_seed {
                ambiguous[place] |= placed[place].replace(grid).is_some();
            }
        }
        for (place, (shape, grid)) in missing.iter().zip(placed).enumerate() {
            let entries = wanted.iter().zip(&mut *found).filter(|(wanted, _)| *wanted == shape);
            for (_, entry) in entries {
                match &grid {
                    _ if ambiguous[place] => *entry = Err(GridRejection::Ambiguous),
                    Some(grid) => *entry = Ok(grid.clone()),
                    None => {}
                }
            }
        }
    }
}

/// A grid with a side at which it is not seen to end: it may be what a cover leaves of another
/// wanted shape.
struct OpenGrid {
    grid: Grid,
    bounds: Bounds,
    /// The axes along which a cover may hide more.
    hidden: [bool; 2],
}

/// Accepts the open grids that are no part of a shape that is still missing. A shape that was found
/// with all its sides is not found again.
fn settle(
    open_grids: Vec<OpenGrid, SHAPES_MAX>,
    wanted: &[GridShape],
    found: &mut [Result<Grid, GridRejection>],
) {
    let mut missing = [false; WANTED_MAX];
    for (missing, entry) in missing.iter_mut().zip(&*found) {
        *missing = entry.is_err();
    }
    for OpenGrid { grid, bounds, hidden } in open_grids {
        let others = wanted.iter().zip(missing).filter(|(_, missing)| *missing);
        let is_part = others
            .into_iter()
            .any(|(shape, _)| is_part_of_another(bounds, hidden, core::slice::from_ref(shape)));
        for ((shape, entry), missing) in wanted.iter().zip(&mut *found).zip(missing) {
            if !missing || *shape != grid.shape {
                continue;
            }
            if is_part {
                note(entry, GridRejection::Incomplete);
            } else {
                add(entry, grid.clone());
            }
        }
    }
}

/// Adds a grid of a shape; two are ambiguous.
fn add(entry: &mut Result<Grid, GridRejection>, grid: Grid) {
    *entry = if entry.is_err() { Ok(grid) } else { Err(GridRejection::Ambiguous) };
}

/// Most shapes that a search can be for.
const WANTED_MAX: usize = 16;

/// Most shapes that are looked for among covered targets; of more, none is.
const SHAPES_MAX: usize = TARGETS_MAX;

/// Whether a shape may yet be found partly covered: not if two of it are seen.
fn may_be_covered(entry: &Result<Grid, GridRejection>) -> bool {
    entry.as_ref().is_err_and(|rejection| *rejection != GridRejection::Ambiguous)
}

/// Whether a lattice whose squares the frame cuts across its columns, or its rows, may be what is
/// seen of another wanted shape: that one has at least as many lines of each family, and more only
/// where the frame hides some.
fn is_part_of_another(bounds: Bounds, cut: [bool; 2], wanted: &[GridShape]) -> bool {
    let seen = [bounds.columns(), bounds.rows()];
    wanted.iter().any(|other| {
        let (columns, rows) = (usize::from(other.columns), usize::from(other.rows));
        [[columns, rows], [rows, columns]].into_iter().any(|whole| {
            whole != seen
                && (0..2).all(|axis| {
                    whole[axis] == seen[axis] || (cut[axis] && whole[axis] > seen[axis])
                })
        })
    })
}

/// Keeps the rejection that came closest to a grid.
fn note(entry: &mut Result<Grid, GridRejection>, rejection: GridRejection) {
    if let Err(known) = entry {
        *known = (*known).max(rejection);
    }
}

/// Whether a lattice of these bounds could have this shape once its weak border lines are removed.
fn may_be(bounds: Bounds, shape: GridShape) -> bool {
    /// Lines that clutter may add, both sides together.
    const EXTRA_MAX: usize = 2;
    let (columns, rows) = (usize::from(shape.columns), usize::from(shape.rows));
    let fits = |columns: usize, rows: usize| {
        (columns..=columns + EXTRA_MAX).contains(&bounds.columns())
            && (rows..=rows + EXTRA_MAX).contains(&bounds.rows())
    };
    columns * rows <= TARGET_CORNERS_MAX && (fits(columns, rows) || fits(rows, columns))
}

/// A lattice that is the grid of a wanted shape.
struct Judged {
    grid: Grid,
    /// Without lines of clutter.
    bounds: Bounds,
    /// Whether the frame cuts the squares around it at an end of the lattice's axis u, and v.
    cut: [bool; 2],
}

/// The grid of this shape, if the lattice is one.
fn judge<P: Pixel>(
    image: &GreyImage<'_, P>,
    lattice: &mut Lattice,
    corners: &[Corner],
    bounds: Bounds,
    shape: GridShape,
) -> Result<Judged, GridRejection> {
    agreement::remove_disagreeing(lattice, corners, bounds);
    let median = median_score(lattice, corners, bounds);
    // Border lines with few and weak corners are clutter beside the board; few but strong ones mean
    // that the board goes on there, mostly hidden.
    let mut bounds = bounds;
    let mut goes_on = false;
    for _ in 0..8 {
        let Some(line) = bounds.borders().into_iter().find(|line| {
            3 * line.cells().filter(|&cell| lattice.corner(cell).is_some()).count() < line.length()
        }) else {
            break;
        };
        goes_on |= line
            .cells()
            .filter_map(|cell| lattice.corner(cell))
            .any(|index| corners[usize::from(index)].score >= BEYOND_SCORE_MIN * median);
        match bounds.without(&line) {
            Some(smaller) => bounds = smaller,
            None => return Err(GridRejection::OtherDimensions),
        }
    }
    let (numbering, first_square_dark) = numbering(lattice, corners, bounds, shape)?;
    if goes_on {
        return Err(GridRejection::GoesOn);
    }
    let mut cut = [false; 2];
    for line in bounds.borders() {
        let seen = line.cells().filter(|&cell| lattice.corner(cell).is_some()).count();
        if seen < border_corners_min(line.length()) {
            return Err(GridRejection::Incomplete);
        }
        // The next line, if there were one, would have to be visible.
        let (mut next, mut next_visible) = (0, 0);
        for cell in line.cells() {
            if let Some(place) = lattice.beyond(corners, cell, line.outwards) {
                next += 1;
                next_visible += usize::from(is_detectable(image, place));
            }
        }
        if 2 * next_visible < next {
            for (axis, cut) in cut.iter_mut().enumerate() {
                *cut |= line.outwards[axis] != 0;
            }
        }
        if beyond::squares_go_on(image, lattice, corners, &line) {
            return Err(GridRejection::GoesOn);
        }
    }
    let grid = numbered(lattice, shape, &numbering, first_square_dark);
    let seen = grid.corners.iter().flatten().count();
    if seen < corners_min(grid.corners.len()) {
        return Err(GridRejection::Incomplete);
    }
    if covered::goes_on_beyond(image, lattice, corners, bounds) {
        return Err(GridRejection::GoesOn);
    }
    Ok(Judged { grid, bounds, cut })
}

/// The grid of a shape, which has at most [`TARGET_CORNERS_MAX`] corners.
fn numbered(
    lattice: &Lattice,
    shape: GridShape,
    numbering: &Numbering,
    first_square_dark: bool,
) -> Grid {
    let mut grid = Grid { shape, corners: Vec::new(), first_square_dark };
    for row in 0..i32::from(shape.rows) {
        for column in 0..i32::from(shape.columns) {
            let _ = grid.corners.push(lattice.corner(numbering.cell(column, row)));
        }
    }
    grid
}

fn is_detectable<P: Pixel>(image: &GreyImage<'_, P>, [x, y]: [f32; 2]) -> bool {
    let inside = |value: f32, side: usize| {
        value >= DETECTABLE_PX && value <= (side - 1) as f32 - DETECTABLE_PX
    };
    inside(x, image.width()) && inside(y, image.height())
}

fn median_score(lattice: &Lattice, corners: &[Corner], bounds: Bounds) -> f32 {
    // At most the shape and the extra lines that `may_be` allows: 3 x 40 corners and 2 lines each.
    let mut scores = Vec::<f32, { 5 * (TARGET_CORNERS_MAX / 3 + 2) }>::new();
    for cell in bounds.cells() {
        if let Some(index) = lattice.corner(cell)
            && scores.push(corners[usize::from(index)].score).is_err()
        {
            break;
        }
    }
    median(&mut scores, f32::total_cmp).unwrap_or(0.0)
}

/// Where corner 0 lies in the lattice, and along which steps columns and rows are counted.
#[derive(Debug, Clone, Copy)]
struct Numbering {
    first: [i32; 2],
    x: [i32; 2],
    y: [i32; 2],
}

impl Numbering {
    fn cell(&self, column: i32, row: i32) -> [i32; 2] {
        [0, 1].map(|axis| self.first[axis] + column * self.x[axis] + row * self.y[axis])
    }
}

/// The numbering by the rule of [`Grid`], and whether its first square is dark.
fn numbering(
    lattice: &Lattice,
    corners: &[Corner],
    bounds: Bounds,
    shape: GridShape,
) -> Result<(Numbering, bool), GridRejection> {
    let mut best: Option<(Numbering, bool, f32)> = None;
    // The four right-handed pairs of axes.
    for (x, y) in [([1, 0], [0, 1]), ([0, 1], [-1, 0]), ([-1, 0], [0, -1]), ([0, -1], [1, 0])] {
        let along_u = x[0] != 0;
        let (columns, rows) = if along_u {
            (bounds.columns(), bounds.rows())
        } else {
            (bounds.rows(), bounds.columns())
        };
        if (columns, rows) != (usize::from(shape.columns), usize::from(shape.rows)) {
            continue;
        }
        let first = [0, 1]
            .map(|axis| if x[axis] + y[axis] > 0 { bounds.first[axis] } else { bounds.last[axis] });
        let numbering = Numbering { first, x, y };
        let edge_along_u = lattice.edge_along_u(first);
        let dark = if along_u { edge_along_u == 0 } else { edge_along_u == 1 };
        let rightwards = rightwards(lattice, corners, bounds, x);
        if best.is_none_or(|(_, best_dark, best_rightwards)| {
            (dark, rightwards) > (best_dark, best_rightwards)
        }) {
            best = Some((numbering, dark, rightwards));
        }
    }
    best.map(|(numbering, dark, _)| (numbering, dark)).ok_or(GridRejection::OtherDimensions)
}

/// Cosine between the mean direction of lattice steps `step` and the picture's x axis.
fn rightwards(lattice: &Lattice, corners: &[Corner], bounds: Bounds, step: [i32; 2]) -> f32 {
    let (mut dx, mut dy) = (0.0, 0.0);
    for cell in bounds.cells() {
        let next = [cell[0] + step[0], cell[1] + step[1]];
        if let (Some(from), Some(to)) = (lattice.corner(cell), lattice.corner(next)) {
            let (from, to) = (corners[usize::from(from)], corners[usize::from(to)]);
            dx += to.position_px[0] - from.position_px[0];
            dy += to.position_px[1] - from.position_px[1];
        }
    }
    dx / libm::hypotf(dx, dy).max(f32::MIN_POSITIVE)
}
