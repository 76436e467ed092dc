//! Every capacity of the pipeline, in one place, and the relations between
//! them, checked when the crate is compiled.

/// Largest number of targets tracked at once: shoulder, lumbar, scene board.
pub const TARGETS_MAX: usize = 3;

/// Largest number of corners of one target: a 13 x 9 calibration board fits.
pub const TARGET_CORNERS_MAX: usize = 120;

/// Largest frame side. Memory does not depend on it, the time of a full search does.
pub const FRAME_SIDE_PX_MAX: u16 = 4096;

/// Smallest frame side: one detector kernel must fit with room to move.
pub const FRAME_SIDE_PX_MIN: u16 = 64;

/// Largest number of corners that a search of a frame keeps, the strongest.
pub const CORNERS_MAX: usize = 1024;
