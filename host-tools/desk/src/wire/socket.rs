//! The WebSocket. Every message is one text of JSON, an object whose field `is` names it.
//!
//! A page that connects gets a [`FromDesk::State`] at once, and then one after every change, at most five
//! a second. It says with [`FromPage::Watch`] which box's frames it draws, and gets them some 30 times a
//! second. It answers each batch with [`FromPage::Ack`]: no more than [`BATCHES_MAX`] batches are under
//! way to a page, so that a slow one gets fewer and larger ones, and never an old picture. The desk keeps
//! the last [`HISTORY_FRAMES`] frames of a box. Older ones that a page has not got are dropped for it,
//! and it is told how many; the recording has all of them.
//!
//! A page that says nothing for [`SILENT_S`] s is disconnected: it sends a [`FromPage::Ping`] every
//! few seconds. After a break it connects again, and says with `Watch` what the last frame was that it
//! has drawn.

use serde::{Deserialize, Serialize};

use super::{Reference, State};

/// The most batches that a page has not acknowledged.
pub const BATCHES_MAX: u64 = 4;

/// The frames of a box that are kept for pages: a minute at 200 Hz.
pub const HISTORY_FRAMES: usize = 12_000;

/// The most frames of a batch.
pub const BATCH_FRAMES_MAX: usize = 2_000;

/// A page that is silent for longer is disconnected, seconds.
pub const SILENT_S: u64 = 30;

/// The longest message of a page, bytes.
pub const MESSAGE_BYTES_MAX: usize = 16 * 1024;

/// A message of a page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case", deny_unknown_fields)]
pub enum FromPage {
    /// The frames of this box are wanted, in place of those of another one.
    Watch {
        /// Its id; `null`: no frames.
        #[serde(rename = "box")]
        box_id: Option<String>,
        /// The number ([`FrameRow`]) after which they are wanted: the last one that was drawn. `null`:
        /// from now on.
        #[serde(default)]
        after: Option<u64>,
    },
    /// A batch has come.
    Ack {
        /// Its number.
        batch: u64,
        /// From exposure to pixels, milliseconds, of the latest frame of an animation frame that was
        /// drawn, by the desk's clock; `null` where nothing was drawn.
        #[serde(default)]
        screen_ms: Option<f64>,
    },
    /// What is it now? It is answered with [`FromDesk::Pong`].
    Ping {
        /// The page's own clock, which comes back.
        page_ms: f64,
    },
}

/// A message of the desk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum FromDesk {
    /// The whole state.
    State {
        /// The state.
        state: Box<State>,
    },
    /// Frames of the box that this page watches.
    Frames {
        /// The box's id.
        #[serde(rename = "box")]
        box_id: String,
        /// The number of this batch on this connection, from 1.
        batch: u64,
        /// The frames, in their order; frames that came late stand where they belong in time, with a
        /// later number.
        frames: Vec<FrameRow>,
        /// Frames before these that were dropped for this page, because it was slow or was away for too
        /// long.
        dropped: u64,
        /// From where movement is drawn now: it is taken from all points that are on the screen, the
        /// older ones too.
        reference: Reference,
    },
    /// A tone is to be heard now.
    Tone {
        /// Of which box.
        #[serde(rename = "box")]
        box_id: String,
        /// Which.
        tone: Tone,
        /// When it was due.
        at_ms: f64,
    },
    /// The answer to a ping.
    Pong {
        /// The page's own clock, as it was sent.
        page_ms: f64,
        /// The desk's clock when it was answered.
        desk_ms: f64,
    },
    /// The page's message cannot be understood; nothing was done. After ten of them the connection is
    /// closed.
    Refused {
        /// Why.
        problem: super::Problem,
    },
}

/// A tone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tone {
    /// A second of the countdown: three short ones before the start.
    Count,
    /// The recording begins.
    Start,
    /// It is as long as the protocol says.
    End,
    /// A photograph is taken now.
    Shutter,
}

/// A frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameRow {
    /// Its number on this desk, per box: each is one higher than the one that came before.
    pub number: u64,
    /// When it was exposed, by the desk's clock, milliseconds.
    pub at_ms: f64,
    /// The upper trunk; `null` without a pose.
    pub upper: Option<PointRow>,
    /// The lower trunk; `null` without a pose.
    pub lower: Option<PointRow>,
    /// The number of frames that are missing before this one: a gap in the plot.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub gap: u32,
    /// It came after a later one.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_late: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// A trunk point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PointRow {
    /// AP, ML and SI in the scene's axes, mm, rounded to 0.001. A page subtracts the reference.
    pub p: [f64; 3],
    /// Covariance in the transverse plane, mm²: of AP, of AP and ML, of ML.
    pub c: [f64; 3],
}
