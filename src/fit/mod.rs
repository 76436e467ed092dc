//! A target's pose, from the pixels of one frame.
//!
//! In: a frame, a lens, a target, and where it is expected or its grid was found. Out: its pose and
//! covariance, a [`measure::Measurement`], or why there is none.
//!
//! [`measure`] runs the steps. [`nodes`] projects the grid into the frame at the expected pose;
//! [`edge`] fits each edge between them to the pixels beside it; [`solve`] fits the pose to the
//! edges. A grid that was just found gets its first pose from [`planar`].

pub mod edge;
pub mod measure;
pub mod nodes;
pub mod planar;
pub mod solve;
