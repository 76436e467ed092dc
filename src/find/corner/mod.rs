//! Corners of checkerboards in a grey picture.
//!
//! The detector is that of Geiger, Moosmann, Car and Schuster, "Automatic camera and range sensor
//! calibration using a single shot" (ICRA 2012): a likelihood from two corner prototypes of four
//! kernels each in several sizes, non-maxima suppression, the two edge directions from the
//! histogram of the gradient's orientations, and a score. Only the order of the work differs: a
//! ring test that costs a few instructions per pixel selects the pixels to which the kernels are
//! applied.

mod detect;
mod direction;
mod kernel;
mod lanes;
mod list;
mod ring;
#[cfg(test)]
pub(crate) mod tests;
mod window;

pub use detect::{Detector, refined};
pub use list::{Corner, CornerList};
