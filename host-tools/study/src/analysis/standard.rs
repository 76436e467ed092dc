//! Warnings of figures from less than clinical stabilometry asks for.

use plumbline_analysis::standard::{DURATION_MIN_S, RATE_ACCEPTED_HZ, RATE_MIN_HZ};
use plumbline_analysis::sway::Sway;

/// What falls below it, in words, of the points of one trial.
pub(super) fn below<'a>(points: impl Iterator<Item = &'a Sway>) -> Vec<String> {
    let (mut rate_hz, mut measured_s) = (f64::INFINITY, f64::INFINITY);
    for point in points {
        rate_hz = rate_hz.min(point.rate_hz);
        // Each sample stands for one period, and the last one for none of the time between.
        measured_s = measured_s.min(point.measured_s + point.rate_hz.recip());
    }
    let mut warnings = Vec::new();
    if rate_hz < RATE_ACCEPTED_HZ {
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
