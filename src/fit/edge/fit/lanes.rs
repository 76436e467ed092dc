//! Numbers that are worked on together, so that the compiler makes vector code of loops over them.

/// How many: what one SSE2 or NEON register holds.
pub(super) const LANES: usize = 4;

/// One number for each lane.
pub(super) type Lanes = [f32; LANES];
