//! Plumbline measures how a standing person sways, in 3D, with one camera and
//! two small printed targets.
//!
//! This crate is the whole measurement: grey frames in, pose packets out. It
//! has no heap, no operating system, no clock, no input or output and no
//! `unsafe`; every buffer has a fixed size (see [`limits`]) and every loop a
//! bound, so that the same code runs on a workstation, in a bedside box and on
//! a microcontroller, and gives the same poses on each.
//!
//! # Data flow
//!
//! ```text
//! frame ─▶ windows around the predicted corners ─▶ corners, raw pixels
//!       ─▶ undistorted pixels (look-up table) ─▶ warm-started Levenberg-Marquardt
//!       ─▶ pose and covariance ─▶ anatomical axes ─▶ packet
//! ```
//!
//! # Conventions
//!
//! | what | convention |
//! |---|---|
//! | pixel (0, 0) | the CENTRE of the top-left pixel; x to the right, y down |
//! | camera frame | origin at the centre of projection, x right, y down, z forward along the optical axis |
//! | target frame | seen from the camera: x right along the columns, y down along the rows, z away from the camera, into the body; the origin is the grid's centre unless its description says otherwise |
//! | scene frame | the frame of a board that stands upright and faces the camera behind the person: x to the person's right, y down, z forward |
//! | anatomical axes | AP + forward, ML + to the person's right, SI + up (ISPGR): AP = z, ML = x, SI = -y of the scene frame |
//! | transforms | destination first: `cam_from_target` takes target coordinates to camera coordinates, and `cam_from_target * target_from_x` chains by adjacent words |
//! | Euler angles | the paper's: R = Rz(theta1) Ry(theta2) Rx(theta3) |
//! | units | millimetres, radians, nanoseconds, pixels; names end in `_mm _rad _ns _px` |
//! | time stamp | nanoseconds of the capture clock; each packet says which instant of the exposure it marks |
//!
//! A target's axes and its indices, drawn for a 3 x 2 grid (INNER corners are
//! counted; the square up and left of corner 0 is black):
//!
//! ```text
//!   ███░░░███░░░
//!   ███0░░1██2░░   ─▶ x (columns)
//!   ░░░███░░░███
//!   ░░░3██4░░5██
//!   ███░░░███░░░
//!     │
//!     ▼ y (rows), z points into the page
//! ```
#![no_std]
#![forbid(unsafe_code)]

mod checksum;
pub mod config;
pub mod corner;
pub mod grid;
pub mod image;
pub mod lens;
pub mod limits;
pub mod measure;
pub mod packet;
pub mod pipeline;
pub mod planar;
pub mod pose;
pub mod report;
pub mod scene;
pub mod search;
pub mod solve;
pub mod target;
pub mod track;
pub mod undistort;

#[cfg(test)]
mod test_support;
