//! The uncertainty budget of a trial's figures, after the Guide to the Expression of Uncertainty in
//! Measurement (GUM, JCGM 100:2008): how well a path length, an RMS, a range, an ellipse's area, a
//! velocity and a distance are known, and what each cause contributes.
//!
//! ```text
//! trial, camera.toml ─▶ measured: positions, and how they move with each cause   response, lens
//! budget.toml ────────▶ inputs: how well each cause is known
//!                                     │
//!                                     ▼
//!          figures once more with every position displaced ─▶ budget: terms, combined, expanded
//! ```
//!
//! # Method
//! A **systematic** cause (scale, calibration, flatness, axes) displaces every position of a trial
//! together. The figures are computed again with the whole trial displaced by plus and by minus one
//! standard uncertainty; the root mean square of both changes is the cause's contribution. Where a
//! figure depends linearly on the cause that is the GUM's sensitivity times the standard
//! uncertainty; the mean of both signs keeps effects of second order, such as a tilt's on a short
//! vertical path. Correlated numbers (those of the lens) are taken along the eigenvectors of their
//! correlations, which are independent.
//!
//! A **random** cause (noise, jitter of the time stamps) differs from frame to frame; its
//! contribution is the standard deviation over noisy copies of the trial, see
//! [`plumbline_analysis::sway::noise`].
//!
//! Noise lengthens a path, and the steps between samples shorten it. Both are known, so the
//! estimate is corrected for them, as the GUM asks, and only the uncertainty of the corrections is
//! a term. The measurand is the figure of the true movement seen through the trial's own filter.
//!
//! Contributions add in squares; degrees of freedom after Welch and Satterthwaite (GUM G.4.1);
//! expanded with k = 2.
//!
//! # Limits
//! What is not included is listed in [`Budget::not_included`]. Distributions are taken to be
//! normal. What the calibration's error does to the scene's axes (some 1e-4 rad) is taken to be
//! within their tilt. The tests compare the result with a Monte Carlo propagation through the full
//! projection (GUM supplement 1), and with trials whose errors are known.
//!
//! An error of a rolling shutter's readout is no term. With `d` too much of it, a target that moves up
//! by `v` mm/s is measured `v d fy / height` farther away: 0.8 ms of its movement at the largest
//! deviation of `plumb calibrate --readout`, 0.5 ms. At 1 Hz that is 0.5 % of the vertical movement,
//! a quarter period later, which changes a path by a part of 1e-5 at most. That all times are late by
//! up to `d` matters to no figure.
//!
//! Cost: the figures are computed twice for each systematic cause and once for each noisy copy, shared
//! by all cores. The memory grows with the trial; longer than [`SAMPLES_MAX`] is refused.

mod budget;
mod figures;
pub mod inputs;
mod lens;
mod measured;
mod propagate;
pub mod response;
mod terms;

pub use budget::{Budget, COVERAGE_FACTOR, Contribution, FigureBudget};
pub use figures::Quantity;
pub use lens::LensUncertainty;
pub use measured::{Body, Measured, SAMPLES_MAX};
pub use terms::{Alike, Group, Kind, Term, TermName};
