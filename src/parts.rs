//! The individual parts of the measurement.
//!
//! A program that measures frames needs none of them: [`Pipeline`](crate::pipeline::Pipeline)
//! contains them all. They are public for other uses: cameras are calibrated with them, benchmarks
//! time each one, and tests examine them one at a time. They change whenever the measurement does.

pub use crate::find::corner::{Corner, CornerList, Detector, refined};
pub use crate::find::grid::{FrameBorder, Grid, GridFinder};
pub use crate::find::search::{Area, Goal, Grids, Search};
pub use crate::fit::edge::{
    Appearance, Batch, Light, PixelFit, SeenEdge, SeenEdges, fit_edge, locate_edge,
};
pub use crate::fit::measure::{Fitted, MeasureFailure, Rolling, View, Workspace, mirror_image};
pub use crate::fit::nodes::{Chord, Direction, Edge, Node, Nodes, Square, points_mm};
pub use crate::fit::planar::SeenCorner;
pub use crate::fit::solve::{
    Inliers, Observations, Solution, SolveFailure, robust_cost_after_step, solve,
};
pub use crate::follow::track::State as TrackState;
pub use crate::model::motion::Motion;
pub use crate::model::shutter::Shutter;
