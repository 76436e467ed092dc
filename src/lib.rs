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
//! [`pipeline::Pipeline::step`] takes a frame and its time, and returns a report. The left column
//! names the folders of `src/`, each of which is described in its `mod.rs`; to the right of each
//! are its modules, in the order in which they work.
//!
//! ```text
//!  model     image, lens, lens_table, shutter, target, pose, motion, scene, config: what is given
//!
//!                        frame, time
//!                             │
//!                             ▼
//!                   is the target tracked?
//!                no │                    │ yes
//!                   ▼                    │
//!  find      search: slice by slice      │
//!            corner: its corners         │
//!            grid: numbered grids        │
//!                   │                    ▼
//!  follow           │            track: the pose expected when its rows are read
//!                   ▼                    │
//!  fit       measure::rough, planar:     │
//!            a first pose                │
//!                   └─────────┬──────────┘
//!                             ▼
//!            measure::workspace: from that pose to an accepted one, by
//!              nodes          where it puts the grid's lines in the frame, row by row
//!              edge::locate   each edge, coarsely, where the target may have moved far
//!              edge::fit      each edge, fitted to all pixels beside it
//!              solve          the pose and its covariance, fitted to all edges
//!                             │
//!                             ▼ the pose, or why there is none
//!                   ┌─────────┴──────────┐
//!                   ▼                    ▼
//!  follow    track: where to     scene (of model): along the body's axes
//!            look next                   │
//!                                        ▼
//!  tell                          report, and packet: the same as bytes
//! ```
//!
//! A single edge is fitted by `fit_edge` in `src/fit/edge/fit/mod.rs`. Each folder uses only those
//! before it in the list `common`, `model`, `find`, `fit`, `follow`, `tell`; all of them use
//! [`limits`], and only [`pipeline`] uses all of them.
//!
//! # What is public
//!
//! Only the modules listed below, under the names given there: `plumbline::lens::Lens`, for
//! example, is defined in `src/model/lens.rs`. A program that measures frames needs nothing from
//! [`parts`], which serves calibration, benchmarks and tests.
//!
//! # Example
//!
//! ```
//! use heapless::{String, Vec};
//! use plumbline::config::{Config, Links, Machine, TargetConfig};
//! use plumbline::image::GreyImage;
//! use plumbline::lens::{Distortion, Lens};
//! use plumbline::pipeline::Pipeline;
//! use plumbline::target::{Origin, Role, TargetGeometry};
//!
//! let lens = Lens {
//!     width_px: 640,
//!     height_px: 480,
//!     fx_px: 760.0,
//!     fy_px: 760.0,
//!     cx_px: 319.5,
//!     cy_px: 239.5,
//!     skew_px: 0.0,
//!     distortion: Distortion::Radial2([-0.12, 0.05]),
//! };
//! let lumbar =
//!     TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Lower, [0.0, 0.0, 100.0])?;
//! let mut targets = Vec::new();
//! let _ = targets.push(TargetConfig { name: String::try_from("lumbar")?, geometry: lumbar });
//!
//! // On a box the pipeline lives in a static; it is too large for a small stack.
//! let mut pipeline = Box::new(Pipeline::new());
//! pipeline.configure(&Config {
//!     device: String::new(),
//!     serial_number: String::new(),
//!     lens,
//!     readout_ns: 0,
//!     targets,
//!     cam_from_scene_theta: None,
//!     links: Links::default(),
//!     capture: None,
//!     machine: Machine::default(),
//!     trigger: None,
//! })?;
//!
//! let pixels = [90_u8; 640 * 480];
//! let report = pipeline.step(&GreyImage::new(&pixels, 640, 480, 640)?, 0);
//! match &report.targets[0].measurement {
//!     Ok(found) => println!("{} mm away", found.cam_from_target.translation_mm.z),
//!     // A grey wall: the pipeline says why there is no pose.
//!     Err(reason) => assert_eq!(reason.words(), "no checkerboard"),
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
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
//! | time stamp | nanoseconds of the capture clock: the middle of the exposure of the row that is read first, where the camera tells it; each packet says which instant it is |
//! | a target's own time | later than that by the delay of the middle row of its picture (`delay_ns`; 0 with a global shutter); its pose, and the trunk point that follows from it, are of this instant |
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

mod common;
mod find;
mod fit;
mod follow;
pub mod limits;
mod model;
pub mod parts;
pub mod pipeline;
mod tell;

pub use model::{config, image, lens, lens_table, pose, scene, target};
pub use tell::{packet, report, seal, view};

#[cfg(test)]
mod test_support;
