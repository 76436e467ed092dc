//! What clinical stabilometry asks of a recording, whatever the instrument.
//!
//! Scoppa, Capra, Gallamini & Shiffer 2013, "Clinical stabilometry standardization: basic
//! definitions - acquisition interval - sampling frequency", Gait Posture 37:290, for the
//! International Society for Posture and Gait Research (ISPGR): at least 25 s, at 50 Hz or more.

use plumbline_analysis::sway::Sway;

/// The shortest recording, seconds.
const DURATION_MIN_S: f64 = 25.0;

/// The lowest rate, Hz.
const RATE_MIN_HZ: f64 = 50.0;

/// A camera that is set to a rate keeps it this well, as a fraction.
const RATE_TOLERANCE: f64 = 0.01;

/// What falls below it, in words, of the points of one trial.
pub(super) fn below<'a>(points: impl Iterator<Item = &'a Sway>) -> Vec<String> {
    let (mut rate_hz, mut measured_s) = (f64::INFINITY, f64::INFINITY);
    for point in points {
        rate_hz = rate_hz.min(point.rate_hz);
        // Each sample stands for one period, and the last one for none of the time between.
        measured_s = measured_s.min(point.measured_s + point.rate_hz.recip());
    }
    let mut warnings = Vec::new();
    if rate_hz < (1.0 - RATE_TOLERANCE) * RATE_MIN_HZ {
        warnings.push(format!(
            "the rate is {rate_hz:.1} Hz; stabilometry asks for at least {RATE_MIN_HZ} Hz (Scoppa \
             et al. 2013)"
        ));
    }
    if measured_s < DURATION_MIN_S {
        warnings.push(format!(
            "the figures are of {measured_s:.1} s; stabilometry asks for at least {DURATION_MIN_S} \
             s (Scoppa et al. 2013)"
        ));
    }
    warnings
}
