//! The search for targets that are not being tracked, in slices.
//!
//! A sweep works through an area of the frame in bands from top to bottom, as many rows per step as
//! the step's share of pixels allows, and collects corners. When it has reached the bottom, the
//! corners are turned into grids. While other targets are tracked a step's share is small, so that
//! a lost target does not slow them; the bands then come from consecutive frames, and what the
//! sweep finds is measured afresh in the frame in which it ends.

use core::ops::Range;

use heapless::Vec;

use crate::find::corner::{CornerList, Detector};
use crate::find::grid::{FrameBorder, Grid, GridFinder, GridRejection};
use crate::limits::{SEARCH_PIXELS_PER_STEP, TARGETS_MAX};
use crate::model::image::{GreyImage, Pixel};
use crate::model::target::GridShape;

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

/// The searcher: the detector, the grid finder, and the current sweep.
pub struct Search {
    detector: Detector,
    finder: GridFinder,
    corners: CornerList,
    /// Whether a sweep is under way. The other fields describe it, or else the last one. (Not an
    /// `Option`: an idle search is all zero, and takes no space in a program's file.)
    under_way: bool,
    goal: Goal,
    area: Area,
    /// The row with which the next band begins.
    next_row: usize,
}

/// One result per wanted shape.
pub type Grids = Vec<Result<Grid, GridRejection>, TARGETS_MAX>;

impl Search {
    /// An idle searcher.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            detector: Detector::new(),
            finder: GridFinder::new(),
            corners: CornerList::new(),
            under_way: false,
            goal: Goal::WholeFrame,
            area: Area { columns: 0..0, rows: 0..0 },
            next_row: 0,
        }
    }

    /// What is being searched for.
    #[must_use]
    pub fn goal(&self) -> Option<Goal> {
        self.under_way.then_some(self.goal)
    }

    /// Abandons the current sweep.
    pub fn stop(&mut self) {
        self.under_way = false;
    }

    /// Begins a sweep of an area. Any part of it outside the frames is skipped.
    pub fn begin(&mut self, goal: Goal, area: Area) {
        self.corners.clear();
        self.under_way = true;
        self.goal = goal;
        self.next_row = area.rows.start;
        self.area = area;
    }

    /// Continues the sweep: all of it, or one step's share. True when it is finished; the corners
    /// are then complete.
    pub fn advance<P: Pixel>(&mut self, image: &GreyImage<'_, P>, all_at_once: bool) -> bool {
        if !self.under_way {
            return false;
        }
        let Area { columns, rows } = &self.area;
        let share = if all_at_once {
            rows.len()
        } else {
            (SEARCH_PIXELS_PER_STEP / columns.len().max(1)).max(1)
        };
        let end = rows.end.min(self.next_row + share);
        self.detector.detect(image, columns.clone(), self.next_row..end, &mut self.corners);
        self.next_row = end;
        self.under_way = end != rows.end;
        !self.under_way
    }

    /// The corners collected by the last sweep.
    #[must_use]
    pub fn corners(&self) -> &CornerList {
        &self.corners
    }

    /// The grids of these shapes among the collected corners. `image` is the frame in which the
    /// sweep ended.
    ///
    /// Never inlined: what it needs would stay on the stack while the targets are measured.
    #[inline(never)]
    pub fn grids<P: Pixel>(&mut self, image: &GreyImage<'_, P>, wanted: &[GridShape]) -> Grids {
        let mut grids = Grids::new();
        for _ in wanted.iter().take(TARGETS_MAX) {
            let _ = grids.push(Err(GridRejection::NoLattice));
        }
        let wanted = &wanted[..grids.len()];
        let border = FrameBorder::OutsideBoard;
        self.finder.find(image, self.corners.as_slice(), wanted, border, &mut grids);
        grids
    }
}

impl Default for Search {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::boxed::Box;
    use std::vec;

    use super::*;

    /// The number of rows that each step of a sweep covers, until its end.
    fn bands(image: &GreyImage<'_, u8>, area: &Area, all_at_once: bool) -> vec::Vec<usize> {
        let mut search = Box::new(Search::new());
        search.begin(Goal::WholeFrame, area.clone());
        let mut bands = vec::Vec::new();
        loop {
            let before = search.next_row;
            let complete = search.advance(image, all_at_once);
            let after = search.next_row;
            bands.push(after - before);
            if complete {
                assert_eq!(search.goal(), None);
                return bands;
            }
            assert!(after > before, "a step without progress");
        }
    }

    #[test]
    fn a_step_beside_a_tracked_target_is_bounded_and_the_sweep_ends() {
        let pixels = vec![90_u8; 4096 * 1088];
        for (width, height) in [(1456, 1088), (4096, 1088), (64, 64), (64, 1088)] {
            let image = GreyImage::new(&pixels, width, height, width).unwrap();
            for area in [
                Area { columns: 0..width, rows: 0..height },
                Area { columns: 7..width - 1, rows: height / 2..height },
                Area { columns: 20..21, rows: 63..64 },
            ] {
                let rows_at_once = bands(&image, &area, true);
                let bands = bands(&image, &area, false);
                assert_eq!(bands.iter().sum::<usize>(), area.rows.len(), "{area:?}");
                for &rows in &bands {
                    assert!(
                        rows * area.columns.len() <= SEARCH_PIXELS_PER_STEP || rows == 1,
                        "{rows} rows of {area:?}"
                    );
                }
                assert_eq!(rows_at_once, [area.rows.len()]);
            }
        }
        // As promised at `SEARCH_PIXELS_PER_STEP`: a quarter of a second at 60 Hz.
        let [width, height] =
            if cfg!(feature = "small-limits") { [640, 480] } else { [1456, 1088] };
        let image = GreyImage::new(&pixels, width, height, width).unwrap();
        let steps = bands(&image, &Area { columns: 0..width, rows: 0..height }, false).len();
        assert!(steps <= 15, "{steps} steps");
    }

    #[test]
    fn an_area_beyond_the_frame_ends_too() {
        let pixels = [90_u8; 64 * 64];
        let image = GreyImage::new(&pixels, 64, 64, 64).unwrap();
        for area in [
            Area { columns: 0..200, rows: 0..200 },
            Area { columns: 100..200, rows: 100..200 },
            Area { columns: 5..5, rows: 9..9 },
        ] {
            for all_at_once in [false, true] {
                let bands = bands(&image, &area, all_at_once);
                assert_eq!(bands.iter().sum::<usize>(), area.rows.len());
            }
        }
    }

    #[test]
    fn a_sweep_is_under_way_until_it_is_finished_or_stopped() {
        let pixels = [90_u8; 64 * 64];
        let image = GreyImage::new(&pixels, 64, 64, 64).unwrap();
        let mut search = Box::new(Search::new());
        assert_eq!(search.goal(), None);
        assert!(!search.advance(&image, true));
        let goal = Goal::Region { target: 1 };
        search.begin(goal, Area { columns: 0..64, rows: 5..64 });
        assert_eq!((search.goal(), search.next_row), (Some(goal), 5));
        search.stop();
        assert_eq!(search.goal(), None);
        assert!(!search.advance(&image, true));
        assert_eq!(search.next_row, 5);
    }

    #[test]
    fn the_grids_of_a_sweep_are_among_its_corners() {
        use crate::find::corner::tests::{Board, render, samples};

        let board = Board::new([6, 5], [110.0, 100.0], 22.0, 0.3, 0.2, 0.02);
        let picture = render([220, 200], core::slice::from_ref(&board), 0.5, 0.008, 1);
        let bytes: vec::Vec<u8> = samples(&picture, 220, 0, 255);
        let image = GreyImage::new(&bytes, 220, 200, 220).unwrap();
        let whole = || Area { columns: 0..220, rows: 0..200 };
        let mut search = Box::new(Search::new());
        search.begin(Goal::WholeFrame, whole());
        assert!(search.advance(&image, true));
        let wanted = [[6, 5], [5, 4]].map(|[columns, rows]| GridShape { columns, rows });
        let grids = search.grids(&image, &wanted);
        assert_eq!(grids.len(), 2);
        assert_eq!(grids[1], Err(GridRejection::OtherDimensions));
        let grid = grids[0].as_ref().unwrap();
        assert_eq!(grid.shape, wanted[0]);
        for (place, corner) in grid.corners.iter().enumerate() {
            let [x, y] = search.corners().as_slice()[usize::from(corner.unwrap())].position_px;
            let [u, v] = board.corner_px(place as i32 % 6, place as i32 / 6);
            // Good to a quarter of a pixel.
            assert!((f64::from(x) - u).hypot(f64::from(y) - v) < 0.25, "{place}: {x} {y}");
        }
        // A new sweep forgets the corners of the last one.
        search.begin(Goal::WholeFrame, whole());
        assert!(search.corners().as_slice().is_empty());
        assert!(
            search.grids(&image, &wanted).iter().all(|grid| grid == &Err(GridRejection::NoLattice))
        );
    }
}
