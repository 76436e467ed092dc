//! Growing one lattice of corners.

use super::plane::Plane;
use crate::find::corner::Corner;
use crate::limits::{CORNERS_MAX, TARGET_CORNERS_MAX};

/// Side of the map: the longest target, 3 rows of corners, may lie on any side of the seed.
const SIDE: usize = 2 * (TARGET_CORNERS_MAX / 3) + 16;
const CENTRE: i32 = SIDE as i32 / 2;
const _: () = assert!(CORNERS_MAX < u16::MAX as usize);

/// Most rounds of growing: the first finds nearly all corners, the others those behind gaps.
const ROUNDS_MAX: usize = 4;
/// Largest angle between an edge and the line to the neighbour (sine): 15 degrees. Over one square
/// even a fisheye bends a line by less.
const LINE_SINE_MAX: f32 = 0.26;
/// Largest angle between corresponding edges of neighbours (sine): 25 degrees. The directions at
/// squares of 8 px are accurate to about 5.
const EDGE_SINE_MAX: f32 = 0.42;
/// Largest ratio of opposite sides of the first cell. Tilted by 60 degrees at a distance of 10
/// squares, it is 1.2.
const SIDES_RATIO_MAX: f32 = 1.4;
/// Largest ratio of adjacent sides of the first cell: a square seen at 70 degrees is 1 : 2.9.
const ASPECT_MAX: f32 = 3.0;
/// Largest distance of a corner from its prediction, in steps. In the worst case half of it is due
/// to perspective.
const PREDICTION_ERROR_MAX: f32 = 0.25;
/// Largest distance of a corner from the place that the plane of all corners predicts, in steps.
const PLANE_ERROR_MAX: f32 = 0.2;

/// The smallest lattice that is of use: lines of each family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Least {
    /// 3 x 3 corners: the smallest target.
    Target,
    /// 2 x 3 corners: what a cover may leave of a target on one of its sides, or on both. The first
    /// two lines are `gap` steps apart.
    Piece { gap: i32 },
}

impl Least {
    /// The smaller and the larger number of lines.
    const fn lines(self) -> [usize; 2] {
        match self {
            Self::Target => [3, 3],
            Self::Piece { .. } => [2, 3],
        }
    }

    const fn gap(self) -> i32 {
        match self {
            Self::Target => 1,
            Self::Piece { gap } => gap,
        }
    }
}

/// Extent of a lattice in its own coordinates, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bounds {
    pub(super) first: [i32; 2],
    pub(super) last: [i32; 2],
}

/// One border line of [`Bounds`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    start: [i32; 2],
    /// From one place of the line to the next: +u or +v.
    pub(super) step: [i32; 2],
    length: usize,
    /// The lattice step out of the bounds.
    pub(super) outwards: [i32; 2],
}

impl Line {
    pub(super) fn length(&self) -> usize {
        self.length
    }

    pub(super) fn cells(&self) -> impl Iterator<Item = [i32; 2]> + use<> {
        let line = *self;
        (0..line.length as i32).map(move |number| line.cell(number))
    }

    /// The place with this number; -1 is the one before the first.
    pub(super) fn cell(&self, number: i32) -> [i32; 2] {
        [0, 1].map(|axis| self.start[axis] + number * self.step[axis])
    }

    /// The square after the place with this number, as many steps outwards of those just outside.
    pub(super) fn square(&self, number: i32, gap: i32) -> [i32; 2] {
        let corner = self.cell(number);
        [0, 1].map(|axis| corner[axis] + gap * self.outwards[axis] + self.outwards[axis].min(0))
    }
}

impl Bounds {
    pub(super) fn columns(&self) -> usize {
        (self.last[0] - self.first[0] + 1) as usize
    }

    pub(super) fn rows(&self) -> usize {
        (self.last[1] - self.first[1] + 1) as usize
    }

    pub(super) fn cells(&self) -> impl Iterator<Item = [i32; 2]> + use<> {
        let Self { first, last } = *self;
        (first[1]..=last[1]).flat_map(move |j| (first[0]..=last[0]).map(move |i| [i, j]))
    }

    /// The squares around the corners, each by the place from which it lies along u and v.
    pub(super) fn squares(&self) -> Self {
        Self { first: self.first.map(|value| value - 1), last: self.last }
    }

    pub(super) fn contains(&self, cell: [i32; 2]) -> bool {
        (0..2).all(|axis| (self.first[axis]..=self.last[axis]).contains(&cell[axis]))
    }

    /// With this many more lines on each side.
    pub(super) fn grown(&self, lines: i32) -> Self {
        Self {
            first: self.first.map(|value| value - lines),
            last: self.last.map(|value| value + lines),
        }
    }

    pub(super) fn borders(&self) -> [Line; 4] {
        let (columns, rows) = (self.columns(), self.rows());
        let line = |start, step, length, outwards| Line { start, step, length, outwards };
        [
            line(self.first, [1, 0], columns, [0, -1]),
            line([self.first[0], self.last[1]], [1, 0], columns, [0, 1]),
            line(self.first, [0, 1], rows, [-1, 0]),
            line([self.last[0], self.first[1]], [0, 1], rows, [1, 0]),
        ]
    }

    /// Without one of its border lines; `None` when nothing would be left.
    pub(super) fn without(&self, line: &Line) -> Option<Self> {
        let mut smaller = *self;
        for axis in 0..2 {
            match line.outwards[axis] {
                -1 => smaller.first[axis] += 1,
                1 => smaller.last[axis] -= 1,
                _ => {}
            }
        }
        (0..2).all(|axis| smaller.first[axis] <= smaller.last[axis]).then_some(smaller)
    }
}

/// A lattice: axis u along one family of lines, v along the other, right-handed with y down.
#[derive(Debug)]
pub(super) struct Lattice {
    /// The corner at each place, by v and u, the seed at the centre: its index + 1, and 0 where
    /// there is none, so that an empty map takes no space in a program's file.
    map: [[u16; SIDE]; SIDE],
    /// Which edge of the seed lies along u.
    seed_edge: usize,
    /// Corners that belong to a lattice already.
    used: [bool; CORNERS_MAX],
    /// Unit vectors of both edges of each corner.
    edges: [[[f32; 2]; 2]; CORNERS_MAX],
    /// Places of the lattice's corners in the order they were found.
    queue: [[i8; 2]; CORNERS_MAX],
    count: usize,
}

const _: () = assert!(SIDE / 2 < 127);

impl Lattice {
    pub(super) const fn new() -> Self {
        Self {
            map: [[0; SIDE]; SIDE],
            seed_edge: 0,
            used: [false; CORNERS_MAX],
            edges: [[[0.0; 2]; 2]; CORNERS_MAX],
            queue: [[0; 2]; CORNERS_MAX],
            count: 0,
        }
    }

    /// Prepares for a new set of corners.
    pub(super) fn start(&mut self, corners: &[Corner]) {
        self.used.fill(false);
        for (edges, corner) in self.edges.iter_mut().zip(corners) {
            *edges =
                corner.edges_rad.map(|angle_rad| [libm::cosf(angle_rad), libm::sinf(angle_rad)]);
        }
        self.clear();
    }

    fn clear(&mut self) {
        for row in &mut self.map {
            row.fill(0);
        }
        self.count = 0;
    }

    /// The corner at a place of the lattice.
    pub(super) fn corner(&self, [i, j]: [i32; 2]) -> Option<u16> {
        let row = self.map.get(usize::try_from(j + CENTRE).ok()?)?;
        row.get(usize::try_from(i + CENTRE).ok()?)?.checked_sub(1)
    }

    /// Forgets the corner at a place. It stays used.
    pub(super) fn remove(&mut self, cell: [i32; 2]) {
        if self.corner(cell).is_some() {
            self.map[(cell[1] + CENTRE) as usize][(cell[0] + CENTRE) as usize] = 0;
        }
    }

    /// Which edge, 0 or 1, of the corner at a place lies along u. When it is 0, the sector from u
    /// to v is dark.
    pub(super) fn edge_along_u(&self, [i, j]: [i32; 2]) -> usize {
        (self.seed_edge + (i + j).rem_euclid(2) as usize) % 2
    }

    /// Where the next corner would be, one step from a corner away from the one behind it.
    pub(super) fn beyond(
        &self,
        corners: &[Corner],
        cell: [i32; 2],
        step: [i32; 2],
    ) -> Option<[f32; 2]> {
        let here = corners[usize::from(self.corner(cell)?)].position_px;
        let behind = corners[usize::from(self.corner(minus(cell, step))?)].position_px;
        Some([2.0 * here[0] - behind[0], 2.0 * here[1] - behind[1]])
    }

    /// Grows a lattice from a corner that belongs to none; `None` when it stays smaller than
    /// `least`.
    pub(super) fn grow(&mut self, corners: &[Corner], seed: u16, least: Least) -> Option<Bounds> {
        if self.used[usize::from(seed)] {
            return None;
        }
        self.clear();
        let bounds = self.place_first_cell(corners, seed, least.gap()).and_then(|()| {
            // Beside a gap a corner can often be predicted only once its other neighbours have been
            // placed, so the rounds go on as long as they add something.
            for _ in 0..ROUNDS_MAX {
                let before = self.count;
                let mut next = 0;
                while next < self.count {
                    let cell = self.queue[next].map(i32::from);
                    next += 1;
                    for step in [[1, 0], [0, 1], [-1, 0], [0, -1]] {
                        self.grow_step(corners, cell, step);
                    }
                }
                if self.count == before {
                    break;
                }
            }
            let bounds = self.bounds();
            let (columns, rows) = (bounds.columns(), bounds.rows());
            let [fewer, more] = least.lines();
            let large = self.count >= fewer * more
                && columns.min(rows) >= fewer
                && columns.max(rows) >= more;
            large.then_some(bounds)
        });
        if bounds.is_none() {
            self.release();
        }
        bounds
    }

    /// Lets the corners belong to another lattice.
    pub(super) fn release(&mut self) {
        for n in 0..self.count {
            if let Some(index) = self.corner(self.queue[n].map(i32::from)) {
                self.used[usize::from(index)] = false;
            }
        }
    }

    fn bounds(&self) -> Bounds {
        let mut bounds = Bounds { first: [0; 2], last: [0; 2] };
        for cell in &self.queue[..self.count] {
            for (axis, value) in cell.map(i32::from).into_iter().enumerate() {
                bounds.first[axis] = bounds.first[axis].min(value);
                bounds.last[axis] = bounds.last[axis].max(value);
            }
        }
        bounds
    }

    /// The extent of the corners that were not removed; `None` when there are none.
    pub(super) fn extent(&self) -> Option<Bounds> {
        self.cells().fold(None, |extent: Option<Bounds>, cell| {
            let Bounds { first, last } = extent.unwrap_or(Bounds { first: cell, last: cell });
            Some(Bounds {
                first: [0, 1].map(|axis| first[axis].min(cell[axis])),
                last: [0, 1].map(|axis| last[axis].max(cell[axis])),
            })
        })
    }

    /// The places of the corners that were not removed.
    pub(super) fn cells(&self) -> impl Iterator<Item = [i32; 2]> + '_ {
        let placed = self.queue[..self.count].iter().map(|cell| cell.map(i32::from));
        placed.filter(|&cell| self.corner(cell).is_some())
    }

    /// Marks corners as belonging to a lattice.
    pub(super) fn use_up(&mut self, indices: impl Iterator<Item = u16>) {
        for index in indices {
            if let Some(used) = self.used.get_mut(usize::from(index)) {
                *used = true;
            }
        }
    }

    /// Adds the corners near the places that a plane predicts, in the lattice and up to `reach`
    /// lines around it, so that what lies on the other side of a cover is joined; returns the
    /// number of corners added. A place that a lattice left empty is seldom taken by clutter: the
    /// corner's two edges have to agree with the plane's lines as well.
    pub(super) fn extend(&mut self, corners: &[Corner], plane: &Plane, reach: i32) -> usize {
        let Some(extent) = self.extent() else { return 0 };
        let before = self.count;
        for cell in extent.grown(reach).cells() {
            let on_map = cell.iter().all(|value| (-CENTRE..CENTRE).contains(value));
            if !on_map || self.corner(cell).is_some() {
                continue;
            }
            if let Some(index) = self.corner_on_plane(corners, plane, cell) {
                self.place(cell, index);
            }
        }
        self.count - before
    }

    /// The unused corner nearest to where a plane predicts that of a place.
    pub(super) fn corner_on_plane(
        &self,
        corners: &[Corner],
        plane: &Plane,
        cell: [i32; 2],
    ) -> Option<u16> {
        let at = cell.map(|value| value as f32);
        let expected = plane.at(at)?;
        let steps = plane.steps(at)?;
        let lengths = steps.map(length);
        let tolerance = PLANE_ERROR_MAX * lengths[0].min(lengths[1]);
        let edge_along_u = self.edge_along_u(cell);
        let mut nearest: Option<(f32, u16)> = None;
        for (index, corner) in corners.iter().enumerate() {
            let [x, y] = corner.position_px;
            let error = length([x - expected[0], y - expected[1]]);
            if error > tolerance || nearest.is_some_and(|(least, _)| error >= least) {
                continue;
            }
            let edges = self.edges[index];
            let agrees = |edge: usize, axis: usize| {
                cross(edges[edge], steps[axis]).abs() < EDGE_SINE_MAX * lengths[axis]
            };
            if !self.used[index] && agrees(edge_along_u, 0) && agrees(1 - edge_along_u, 1) {
                nearest = Some((error, index as u16));
            }
        }
        nearest.map(|(_, index)| index)
    }

    /// Places a corner that is not used. None is placed twice, even if it was removed, so the
    /// queue always has room.
    fn place(&mut self, cell: [i32; 2], index: u16) {
        self.map[(cell[1] + CENTRE) as usize][(cell[0] + CENTRE) as usize] = index + 1;
        self.used[usize::from(index)] = true;
        self.queue[self.count] = cell.map(|value| value as i8);
        self.count += 1;
    }

    /// Places the seed and three neighbours around one square, such that both ways to the opposite
    /// corner agree. Of the squares around the seed it takes the smallest: at a board's border the
    /// others extend to whatever lies beyond. Along v its corners are `gap` steps apart: after an
    /// odd number of steps, the roles of a corner's edges are exchanged.
    fn place_first_cell(&mut self, corners: &[Corner], seed: u16, gap: i32) -> Option<()> {
        let gap_is_odd = gap % 2 != 0;
        let [edge0, mut edge1] = self.edges[usize::from(seed)];
        if cross(edge0, edge1) < 0.0 {
            edge1 = edge1.map(|value| -value);
        }
        let opposite = |edge: [f32; 2]| edge.map(|value| -value);
        let turns = [edge0, edge1, opposite(edge0), opposite(edge1)];
        let mut smallest: Option<(f32, usize, [u16; 3])> = None;
        for turn in 0..4 {
            let (along_u, along_v) = (turns[turn], turns[(turn + 1) % 4]);
            let edge_u = turn % 2;
            let square = self.neighbour(corners, seed, along_u, edge_u, true).and_then(|right| {
                let below = self.neighbour(corners, seed, along_v, 1 - edge_u, gap_is_odd)?;
                let far = self.neighbour(corners, right, along_v, edge_u, gap_is_odd)?;
                let edge_below = if gap_is_odd { 1 - edge_u } else { edge_u };
                let also_far = self.neighbour(corners, below, along_u, edge_below, true)?;
                (far == also_far).then_some([right, below, far])
            });
            let Some([right, below, far]) = square else { continue };
            let side = |from: u16, to: u16| length(between(corners, from, to));
            let [u, v] = [side(seed, right), side(seed, below)];
            let [far_u, far_v] = [side(below, far), side(right, far)];
            let within = |ratio: f32, a: f32, b: f32| a < ratio * b && b < ratio * a;
            if within(SIDES_RATIO_MAX, u, far_u)
                && within(SIDES_RATIO_MAX, v, far_v)
                && within(ASPECT_MAX, u, v / gap as f32)
                && smallest.is_none_or(|(least, ..)| u + v < least)
            {
                smallest = Some((u + v, edge_u, [right, below, far]));
            }
        }
        let (_, edge_u, [right, below, far]) = smallest?;
        self.seed_edge = edge_u;
        self.place([0, 0], seed);
        self.place([1, 0], right);
        self.place([0, gap], below);
        self.place([1, gap], far);
        Some(())
    }

    /// The nearest unused corner in a direction, along edge `edge` of corner `from`, an odd or an
    /// even number of steps away.
    fn neighbour(
        &self,
        corners: &[Corner],
        from: u16,
        direction: [f32; 2],
        edge: usize,
        is_odd: bool,
    ) -> Option<u16> {
        let own = self.edges[usize::from(from)];
        // The edge itself, oriented along the direction.
        let sign = if dot(own[edge], direction) < 0.0 { -1.0 } else { 1.0 };
        let line = own[edge].map(|value| sign * value);
        let other_edge = if is_odd { 1 - edge } else { edge };
        let mut nearest: Option<(f32, u16)> = None;
        for index in 0..corners.len() {
            let offset = between(corners, from, index as u16);
            let ahead = dot(line, offset);
            if ahead <= 0.0 || nearest.is_some_and(|(least, _)| ahead >= least) {
                continue;
            }
            let reach = LINE_SINE_MAX * length(offset);
            let other = self.edges[index];
            if cross(line, offset).abs() < reach
                && cross(other[other_edge], offset).abs() < reach
                && cross(other[1 - other_edge], own[1 - edge]).abs() < EDGE_SINE_MAX
                && !self.used[index]
            {
                nearest = Some((ahead, index as u16));
            }
        }
        nearest.map(|(_, index)| index)
    }

    /// Looks for the corner one step from a corner of the lattice.
    fn grow_step(&mut self, corners: &[Corner], cell: [i32; 2], step: [i32; 2]) {
        let target = plus(cell, step);
        let on_map = target.iter().all(|&value| (-CENTRE..CENTRE).contains(&value));
        if !on_map || self.corner(target).is_some() {
            return;
        }
        let Some(from) = self.corner(cell) else { return };
        // Predicted by the step behind, and by the parallel steps on both sides.
        let across = [step[1], step[0]];
        let sides = [plus(cell, across), minus(cell, across)];
        let steps = [
            (self.corner(minus(cell, step)), Some(from)),
            (self.corner(sides[0]), self.corner(plus(sides[0], step))),
            (self.corner(sides[1]), self.corner(plus(sides[1], step))),
        ];
        let (mut sum, mut known) = ([0.0_f32; 2], 0.0_f32);
        for (start, end) in steps {
            if let (Some(start), Some(end)) = (start, end) {
                sum = plus_px(sum, between(corners, start, end));
                known += 1.0;
            }
        }
        if known == 0.0 {
            return;
        }
        let predicted = sum.map(|value| value / known);
        let tolerance = PREDICTION_ERROR_MAX * length(predicted);
        let own = self.edges[usize::from(from)];
        let mut nearest: Option<(f32, u16)> = None;
        for index in 0..corners.len() {
            let offset = between(corners, from, index as u16);
            let error = length([offset[0] - predicted[0], offset[1] - predicted[1]]);
            if error > tolerance || nearest.is_some_and(|(least, _)| error >= least) {
                continue;
            }
            let other = self.edges[index];
            if !self.used[index]
                && cross(own[0], other[1]).abs() < EDGE_SINE_MAX
                && cross(own[1], other[0]).abs() < EDGE_SINE_MAX
            {
                nearest = Some((error, index as u16));
            }
        }
        if let Some((_, index)) = nearest {
            self.place(target, index);
        }
    }
}

fn plus(a: [i32; 2], b: [i32; 2]) -> [i32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn minus(a: [i32; 2], b: [i32; 2]) -> [i32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn plus_px(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn between(corners: &[Corner], from: u16, to: u16) -> [f32; 2] {
    let (from, to) =
        (&corners[usize::from(from)].position_px, &corners[usize::from(to)].position_px);
    [to[0] - from[0], to[1] - from[1]]
}

fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn length(a: [f32; 2]) -> f32 {
    libm::sqrtf(dot(a, a))
}

#[cfg(test)]
mod tests;
