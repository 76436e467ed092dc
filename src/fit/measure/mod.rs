//! One target in one frame: from where it is expected, or was found, to its pose.
//!
//! ```text
//!  expected pose ─┬────────────────────────────┬▶ edges fitted ─▶ solved ─▶ judged
//!                 │ moved too far?             │         ▲          │
//!                 └▶ edges located ─▶ solved ──┤         └──────────┘ moved too far?
//!  found corners ──▶ both closed forms ────────┘
//! ```
//!
//! A body sways so evenly that the edges are where they are expected to a tenth of a pixel in
//! nearly every frame: one pass of the fit is enough. Where they are not, they are located first,
//! which makes the start good to a few hundredths. A pose that the last pass still moved too far is
//! none.

mod corners;
mod margin;
mod measurement;
mod minima;
mod rough;
mod workspace;

pub use corners::extent_is_certain;
pub use measurement::{Fitted, MeasureFailure, Measurement, Rolling, View, delay_ns};
pub use minima::mirror_image;
pub use workspace::Workspace;
