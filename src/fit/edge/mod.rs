//! The edges of a target's grid, and where their pixels place them.
//!
//! A checkerboard is made of edges, and nearly all that a picture tells about its pose is in the
//! pixels beside them. Each edge between two nodes of the grid can be measured in two ways:
//!
//! 1. [`locate_edge`] finds it up to a third of a square away, in two lines of pixels
//!    across it, to a quarter of a pixel.
//! 2. [`fit_edge`] fits a blurred step to every pixel that is nearer to this edge than to any
//!    other, from a place known to a few tenths of a pixel.
//!
//! The result for an edge is a [`SeenEdge`]: how far it is from where it was expected, and how much
//! it is turned. It keeps all of the pixels' information on these two numbers (their 2 x 2 normal
//! matrix, with offset, contrast and blur eliminated), so that [`crate::fit::solve`], given all
//! edges of a target, in effect fits the pose to all of its pixels, without access to any of them.
//!
//! Each edge has an offset and a contrast of its own, so that changes of the light, slow or abrupt,
//! matter only to the edges that they touch. Something that covers a part of the target spoils only
//! the edges that it covers, and their residuals reveal it.

mod appearance;
mod fit;
mod light;
mod locate;
mod profile;
#[cfg(test)]
mod rendered;
mod seen;
#[cfg(test)]
mod tests;

pub use appearance::Appearance;
pub(crate) use appearance::GROWN_PX_MAX;
pub use fit::{Batch, PixelFit, fit_edge};
pub use light::Light;
pub use locate::locate_edge;
pub use seen::{SeenEdge, SeenEdges};
