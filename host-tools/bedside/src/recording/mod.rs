//! What a recording needs beyond the trial that it becomes.
//!
//! ```text
//!  packets ─▶ receiver ─▶ live: times, judgement, movement, counts ◀─ course: t = 0, the end
//!        └─▶ recorded: the trial, its verdict so far, the checks ◀─ marks
//! ```
//!
//! [`Recorded`] is the tap of a reception ([`plumbline_stream::reception`]); after each packet
//! [`Live`] takes note, and [`Live::seen`] gives what is to be shown.

mod checks;
mod course;
mod figures;
mod judgement;
mod live;
pub mod marks;
pub mod modem_line;
mod silence;
mod sway;
mod trail;

pub use checks::{Recorded, amiss};
pub use course::{Course, Zeroing};
pub use figures::{Figures, NotYet, TrunkFigures};
pub use judgement::{Judgement, Why, Word};
pub use live::{Live, Seen};
pub use silence::{Here, check_heard, silence};
pub use sway::{AXES, Along, Movement};
pub use trail::{TRAIL_S, TrailPoint};
