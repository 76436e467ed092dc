//! How good the measurements of a user's own camera, lens and light are, shown with nothing but a
//! printed sheet.
//!
//! | proof | the user needs | it shows |
//! |---|---|---|
//! | [`repeatability`] | a board that stands still | noise, drift, and whether the poses' own covariance is right |
//! | [`distance`] | two boards on one plate, and a ruler | the error of a known length all over the volume |
//! | [`step`] | a board, and a block of known thickness | the error of a known displacement |
//!
//! ```text
//! sightings ─▶ stillness ─▶ repeatability
//!                   └─────▶ step
//! pairs of sightings ─▶ distance, volume
//! ```
//!
//! A [`Sighting`](sighting::Sighting) is one board's pose in one frame. Whatever is measured is an
//! [`Estimate`](uncertainty::Estimate): a value with its standard uncertainty, in the terms of the
//! GUM (JCGM 100:2008), or a [`Spread`](uncertainty::Spread): a standard deviation with its
//! confidence interval. Uncertainties are those of what the user did; what no repetition can show,
//! such as a wrong pitch of the print, is found by comparison with the known length only.
//!
//! Nothing here reads a file, prints, draws or looks at a clock. Lengths are millimetres, times
//! seconds, turns degrees.

pub mod distance;
pub mod repeatability;
pub mod sighting;
pub mod step;
pub mod stillness;
pub mod uncertainty;
pub mod volume;

#[cfg(test)]
mod testing;
