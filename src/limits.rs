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

/// Nodes of one target, see [`crate::nodes`]: (columns + 2) x (rows + 2), of which a
/// grid of 40 x 3 corners has the most.
pub const TARGET_NODES_MAX: usize = 210;

/// Edges of one target: two per corner, one more per line, and those of the dark squares at
/// the border, half of twice as many as there are lines and two.
pub const TARGET_EDGES_MAX: usize = 2 * TARGET_CORNERS_MAX + 43 + 45;

/// Squares of one colour of one target: half of (columns + 1) x (rows + 1), of which a grid of
/// 40 x 3 corners has the most.
pub const TARGET_SQUARES_MAX: usize = 82;

/// What one pose is made from, at most: every edge of a target.
pub const OBSERVATIONS_MAX: usize = TARGET_EDGES_MAX;

// A node's index is a byte, and a set of corners the bits of a u128.
const _: () = assert!(TARGET_NODES_MAX <= 256 && TARGET_CORNERS_MAX <= 128);

/// Pixels that a search looks at in one step while another target is tracked:
/// a twelfth of a 1456 x 1088 frame, so that a sweep of all of it takes less than a
/// quarter of a second at 60 Hz.
pub const SEARCH_PIXELS_PER_STEP: usize = 128 * 1024;

/// Longest name of a target, in bytes.
pub const NAME_BYTES_MAX: usize = 16;

/// Longest device name, serial number or firmware version, in bytes.
pub const DEVICE_TEXT_BYTES_MAX: usize = 24;

/// Largest number of corners that a search of a frame keeps, the strongest.
pub const CORNERS_MAX: usize = 1024;
