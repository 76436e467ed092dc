//! Numbers that are processed together, so that the compiler vectorises loops over them.

/// The number of lanes: what one SSE2 or NEON register holds.
pub(super) const LANES: usize = 4;

/// One number for each lane.
pub(super) type Lanes = [f32; LANES];
