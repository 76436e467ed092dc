//! What the camera of a box sees: for framing, focus and exposure, and whole frames to calibrate it
//! with.
//!
//! ```text
//!  session: set-up mode, views, pictures ─┬▶ reading: numbers, advice
//!                                         ├▶ stills: files; where to hold the board next
//!                                         └▶ expose ◀─ exposure: the controller
//! ```
//!
//! A picture leaves a box in set-up mode only, which a [`Session`] keeps up.

mod expose;
mod exposure;
mod picture;
mod reading;
mod session;
mod stills;

pub use expose::{Follower, find as find_exposure, store as store_exposure};
pub use exposure::Setting;
pub use picture::{Progress, Taken};
pub use reading::{BestFocus, FrameReading, Reading, TargetFigures, TargetReading};
pub use session::{Session, SilenceLines, silence_words};
pub use stills::{Kept, Looked, Stills, Wanted};
