//! What clinical stabilometry asks of a recording, whatever the instrument.
//!
//! Scoppa, Capra, Gallamini & Shiffer 2013, "Clinical stabilometry standardization: basic
//! definitions - acquisition interval - sampling frequency", Gait Posture 37:290, for the
//! International Society for Posture and Gait Research (ISPGR): at least 25 s, at 50 Hz or more.

/// The shortest recording, seconds.
pub const DURATION_MIN_S: f64 = 25.0;

/// The lowest rate, Hz.
pub const RATE_MIN_HZ: f64 = 50.0;

/// A camera that is set to the lowest rate may be slower by this share: clocks differ a little.
const RATE_TOLERANCE: f64 = 0.01;

/// A rate below this misses the standard, Hz.
pub const RATE_ACCEPTED_HZ: f64 = (1.0 - RATE_TOLERANCE) * RATE_MIN_HZ;
