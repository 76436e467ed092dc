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

/// Nodes of the undistortion table, 8 bytes each, whatever the frame size. On a
/// 1456 x 1088 frame they lie 11.4 px apart.
pub const UNDISTORTION_NODES_MAX: usize = 12_288;

// The narrowest frame still gets the four nodes that one interpolation needs.
const _: () =
    assert!(UNDISTORTION_NODES_MAX * FRAME_SIDE_PX_MIN as usize / FRAME_SIDE_PX_MAX as usize >= 16);

// A solution flags its inliers in the bits of a u128.
const _: () = assert!(TARGET_CORNERS_MAX <= 128);

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
