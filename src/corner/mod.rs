//! Checkerboard corners.

pub mod refine;
