//! What is given: frames, a camera, targets, and the scene they stand in.
//!
//! [`image`] is a frame, and [`shutter`] says when each of its rows is exposed. [`lens`] takes points
//! in front of the camera to pixels, and pixels to rays; [`lens_table`] does it faster, whatever the
//! lens. [`target`] says where a target's corners are printed, [`pose`] takes coordinates from one
//! frame of reference to another, and [`motion`] a pose to a later instant. [`scene`] takes a pose to
//! the body's axes. A [`config`] holds what one box needs of this. Nothing here looks at a pixel's
//! value.

pub mod config;
pub mod image;
pub mod lens;
pub mod lens_table;
pub mod motion;
pub mod pose;
pub mod scene;
pub mod shutter;
pub mod target;
