//! Measures what photographs show of the board.
//!
//! The board is found by [`Search`]; its edges are then fitted as a tracker fits
//! them, starting from the best lens known so far. Each edge is measured from its own pixels only,
//! so edges are independent of each other, unlike corners, since two neighbouring corners share an
//! edge. The refinement's standard deviations rely on that.

use nalgebra::Vector2;
use plumbline::image::GreyImage;
use plumbline::lens_table::LensTable;
use plumbline::parts::{Appearance, SeenEdge};
use plumbline::parts::{View, Workspace};
use plumbline::report::GridRejection;
use plumbline::report::Measurement;
use plumbline::target::TargetGeometry;

use super::model::Seen;
use super::search::{Found, Search};

/// The precision of the detector's corners, raw pixels.
const FOUND_SIGMA_PX: f64 = 0.25;

/// The number of poses tracked after a board was acquired, each starting from the one before.
const PASSES: usize = 2;

/// The large buffers of the search, one for each thread.
pub struct Finder {
    search: Search,
    workspace: Box<Workspace>,
}

impl Default for Finder {
    fn default() -> Self {
        Self::new()
    }
}

impl Finder {
    /// A finder with empty buffers.
    #[must_use]
    pub fn new() -> Self {
        Self { search: Search::new(), workspace: Box::new(Workspace::new()) }
    }

    /// Finds the board. Photographs for a calibration have 8 bits.
    ///
    /// # Errors
    /// When no board is found.
    pub fn find(
        &mut self,
        image: &GreyImage<'_, u8>,
        board: &TargetGeometry,
    ) -> Result<Found, GridRejection> {
        let mut found = self.search.find(image, &[board.shape()]);
        found.pop().unwrap_or(Err(GridRejection::NoLattice))
    }

    /// Measures a board that was found, through the best lens known so far; `None` when its edges
    /// do not support a pose.
    pub(crate) fn measure(
        &mut self,
        image: &GreyImage<'_, u8>,
        board: &TargetGeometry,
        lens: &LensTable,
        found: &Found,
    ) -> Option<Measured> {
        let first_square_dark = found.grid.first_square_dark;
        let view = View { image, lens, target: board, first_square_dark, rolling: None };
        let workspace = &mut self.workspace;
        let mut fitted = workspace.acquire(&view, &found.grid, &found.corners).ok()?;
        for _ in 0..PASSES {
            // The board's margin is not required here: it may be cut off.
            let appearance = Appearance { has_border: false, ..fitted.appearance };
            fitted =
                workspace.track(&view, &fitted.measurement.cam_from_target, appearance).ok()?;
        }
        let (nodes, edges) = workspace.used_edges();
        // Beyond the outermost corners, the board is only assumed to continue in a straight line.
        let is_inside =
            |edge: &&SeenEdge| edge.edge.nodes.iter().all(|&node| nodes.corner(node).is_some());
        let seen = edges
            .filter(is_inside)
            .map(|edge| {
                let right = nodes.chord(&edge.edge).right;
                let points = edge.edge.nodes.map(usize::from);
                let middle_px =
                    points.map(|point| nodes.as_slice()[point].raw_px).iter().sum::<Vector2<f64>>()
                        * 0.5;
                let (shift_px, sigma_px) = edge.shift_px();
                Seen {
                    points,
                    by_px: [right * 0.5; 2],
                    value_px: right.dot(&middle_px) + shift_px,
                    sigma_px,
                }
            })
            .collect();
        Some(Measured { seen, measurement: fitted.measurement })
    }
}

/// The measurements of a photograph through a lens.
pub(crate) struct Measured {
    pub seen: Vec<Seen>,
    pub measurement: Measurement,
}

impl Found {
    /// Each corner found: its index and its raw pixel.
    pub fn corners_px(&self) -> impl Iterator<Item = (usize, Vector2<f64>)> + '_ {
        self.grid.corners.iter().enumerate().filter_map(|(corner, found)| {
            let found = self.corners.get(usize::from((*found)?))?;
            Some((corner, Vector2::from(found.position_px.map(f64::from))))
        })
    }

    /// The corners as measured quantities.
    pub(crate) fn seen(&self, board: &TargetGeometry) -> Vec<Seen> {
        self.corners_px()
            .flat_map(|(corner, px)| {
                [Vector2::x(), Vector2::y()].map(|axis| Seen {
                    points: [node_of(board, corner); 2],
                    by_px: [axis * 0.5; 2],
                    value_px: axis.dot(&px),
                    sigma_px: FOUND_SIGMA_PX,
                })
            })
            .collect()
    }
}

/// The node of the board that a corner is.
pub(crate) fn node_of(board: &TargetGeometry, corner: usize) -> usize {
    let (row, column) = (corner / board.columns(), corner % board.columns());
    (row + 1) * (board.columns() + 2) + column + 1
}
