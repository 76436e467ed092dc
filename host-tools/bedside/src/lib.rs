//! What is done with a box at the bedside.
//!
//! ```text
//!  keys ─▶ link ─▶ a box ─┬▶ doctor: is everything as it should be?
//!                         ├▶ aim: its picture, focus, exposure; stills of a board
//!                         ├▶ scene: which way is forward
//!                         ├▶ setup ─▶ delivery: another configuration
//!                         ├▶ update: another system
//!                         └▶ recording: what a trial needs while it is recorded
//!  photographs ─▶ calibration: a camera file, and what is to be known about it
//! ```
//!
//! Nothing here prints, or reads a command line. A step that takes long says what it waits for, and
//! what it notices, as [`Told`], when it does. Errors name options of `plumb` where these are the
//! remedy. What belongs neither to a box nor to a trial is kept on this computer, in the user's data
//! (`XDG_DATA_HOME`): keys, pictures of backgrounds, comparisons with a tape.

pub mod aim;
mod background;
pub mod bounds;
pub mod box_settings;
pub mod calibration;
pub mod delivery;
pub mod doctor;
pub mod draw;
mod identity;
pub mod kept;
pub mod keys;
pub mod link;
pub mod missing;
pub mod recording;
mod scale;
pub mod scene;
pub mod setup;
mod snapshot;
mod told;
pub mod update;

pub use told::{Tell, Told};
