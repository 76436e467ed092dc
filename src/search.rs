//! The search for targets that are not being tracked, in slices.
//!
//! A sweep works through an area of the frame in bands from top to bottom, as
//! many rows in one step as the step's share of pixels allows, and gathers
//! corners. When it has reached the bottom, the corners are turned into grids.
//! While other targets are tracked a step's share is small, so that a lost
//! target does not slow them; the bands then come from consecutive frames, and
//! what the sweep finds is measured afresh in the frame in which it ends.

use core::ops::Range;

use heapless::Vec;

use crate::corner::{CornerList, Detector};
use crate::grid::{Grid, GridFinder, GridRejection, GridShape};
use crate::image::{GreyImage, Pixel};
use crate::limits::{SEARCH_PIXELS_PER_STEP, TARGETS_MAX};

/// What a sweep is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Goal {
    /// Any missing target, anywhere.
    WholeFrame,
    /// One target, near where it was.
    Region {
        /// Index of the target.
        target: usize,
    },
}

/// A part of the frame, in pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Area {
    /// Columns.
    pub columns: Range<usize>,
    /// Rows.
    pub rows: Range<usize>,
}

/// A sweep under way.
struct Sweep {
    goal: Goal,
    /// The row with which its next band begins.
    next_row: usize,
}

/// The searcher: the detector, the grid finder, and the sweep under way.
pub struct Search {
    detector: Detector,
    finder: GridFinder,
    corners: CornerList,
    /// What the last sweep searched, or the one under way is to search.
    area: Area,
    sweep: Option<Sweep>,
}

/// One result per wanted shape.
pub type Grids = Vec<Result<Grid, GridRejection>, TARGETS_MAX>;

impl Search {
    /// A searcher at rest.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            detector: Detector::new(),
            finder: GridFinder::new(),
            corners: CornerList::new(),
            area: Area { columns: 0..0, rows: 0..0 },
            sweep: None,
        }
    }

    /// What is being searched for.
    #[must_use]
    pub fn goal(&self) -> Option<Goal> {
        self.sweep.as_ref().map(|sweep| sweep.goal)
    }

    /// Drops the sweep under way.
    pub fn stop(&mut self) {
        self.sweep = None;
    }

    /// Begins a sweep of an area (its bounds must lie in the frames to come).
    pub fn begin(&mut self, goal: Goal, area: Area) {
        self.corners.clear();
        self.sweep = Some(Sweep { goal, next_row: area.rows.start });
        self.area = area;
    }

    /// Works on the sweep: all of it, or one step's share of it. True when it
    /// has come to its end; the corners are then complete.
    pub fn advance<P: Pixel>(&mut self, image: &GreyImage<'_, P>, all_at_once: bool) -> bool {
        let Some(sweep) = &mut self.sweep else { return false };
        let Area { columns, rows } = &self.area;
        let share = if all_at_once {
            rows.len()
        } else {
            (SEARCH_PIXELS_PER_STEP / columns.len().max(1)).max(1)
        };
        let end = rows.end.min(sweep.next_row + share);
        self.detector.detect(image, columns.clone(), sweep.next_row..end, &mut self.corners);
        sweep.next_row = end;
        let complete = end == rows.end;
        if complete {
            self.sweep = None;
        }
        complete
    }

    /// The corners gathered by the last sweep.
    #[must_use]
    pub fn corners(&self) -> &CornerList {
        &self.corners
    }

    /// The grids of these shapes among the gathered corners. `image` is the frame in
    /// which the sweep came to its end.
    pub fn grids<P: Pixel>(&mut self, image: &GreyImage<'_, P>, wanted: &[GridShape]) -> Grids {
        let mut grids = Grids::new();
        for _ in wanted.iter().take(TARGETS_MAX) {
            let _ = grids.push(Err(GridRejection::NoLattice));
        }
        let wanted = &wanted[..grids.len()];
        self.finder.find(image, self.corners.as_slice(), wanted, &mut grids);
        grids
    }
}

impl Default for Search {
    fn default() -> Self {
        Self::new()
    }
}
