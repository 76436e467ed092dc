//! When a person who rises is standing: the t = 0 of a stand trial.
//!
//! The paper takes the time at which the full weight is on a pressure platform, after the first
//! overshoot. A camera sees the same from above: the trunk rises and then holds its height.

use crate::filter::Design;
use crate::series::{Axis, Series};

/// Rising from a chair lifts a person by more than this; nobody sways this far upwards.
const RISE_MIN_MM: f64 = 100.0;

/// A trunk at rest stays within this of its height: the knees give a little at first, then
/// straighten.
const HEIGHT_MM: f64 = 30.0;

/// A trunk at rest moves up and down no faster than this for at least [`REST_S`].
const SPEED_MM_S: f64 = 50.0;

/// Long enough that the turning point of an overshoot is not taken for rest.
const REST_S: f64 = 0.5;

/// The time at which the person is standing; `None` if nobody rises, or SI was not measured.
#[must_use]
pub fn stand_onset_s(series: &Series) -> Option<f64> {
    // Before the speed is computed.
    let smooth = Design::PAPER.at(series.rate_hz()).ok()?.apply(series)?.series;
    let (time_s, height_mm) = (smooth.time_s(), smooth.along(Axis::Si)?);
    // In the second half of a stand trial the person stands.
    let mut later = height_mm[height_mm.len() / 2..].to_vec();
    let middle = later.len() / 2;
    let standing_mm = *later.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Not from the overall lowest point, which comes after the stance if the person sits down
    // again.
    let low = height_mm.iter().position(|it| standing_mm - it >= RISE_MIN_MM)?;
    let rests = |at: usize| {
        let speed_mm_s = (height_mm[at + 1] - height_mm[at]) / (time_s[at + 1] - time_s[at]);
        (height_mm[at] - standing_mm).abs() <= HEIGHT_MM && speed_mm_s.abs() <= SPEED_MM_S
    };
    // Each part without a gap is judged separately: a gap is not known to have been rest.
    smooth.segments().find_map(|segment| {
        let mut since_s: Option<f64> = None;
        (segment.start.max(low)..segment.end - 1).find_map(|at| {
            since_s = rests(at).then(|| since_s.unwrap_or(time_s[at]));
            since_s.filter(|since_s| time_s[at] - since_s >= REST_S)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Height above sitting, mm: rises by 350 mm within a second from 0 s on, overshoots by 60 mm
    /// until 1.8 s, and then stays constant.
    fn risen_mm(time_s: f64) -> f64 {
        let part = time_s.clamp(0.0, 1.0);
        let overshoot_s = (time_s - 1.0).clamp(0.0, 0.8);
        let overshoot_mm = 60.0 * (std::f64::consts::PI * overshoot_s / 0.8).sin();
        350.0 * part * part * (3.0 - 2.0 * part) + overshoot_mm
    }

    /// Half a minute at 60 Hz, with a sway of 2 mm.
    fn trial(height_mm: impl Fn(f64) -> f64) -> Series {
        let time_s: Vec<f64> = (0..1800).map(|at| f64::from(at) / 60.0).collect();
        let height = |time_s: &f64| height_mm(*time_s) + 2.0 * (3.0 * time_s).sin();
        let height_mm = time_s.iter().map(height).collect();
        Series::new(time_s, [Vec::new(), Vec::new(), height_mm]).unwrap()
    }

    /// The onset after the beginning of the rise. At the end of the rise, 1.8 s, the overshoot
    /// falls by `60 pi / 0.8 = 236 mm/s`, and the filter, whose weights over its half window of
    /// 0.25 s are
    /// `(9 - 15 u^2) / 8`, still sees that fall `0.25 x` seconds later:
    /// `236 times the integral from x to 1 of (9 - 15 u^2) / 8 cos(pi 0.25 (u - x) / 0.8) du`.
    /// That is 50 mm/s after 0.069 s.
    const ONSET_S: f64 = 1.8 + 0.069;

    /// Half a sample, 0.0083 s, and the sway's 6 mm/s where the speed falls by 910 mm/s each
    /// second, 0.0066 s.
    const WITHIN_S: f64 = 0.015;

    fn rise(rise_s: f64) -> Series {
        trial(|time_s| risen_mm(time_s - rise_s))
    }

    #[test]
    fn a_person_stands_after_the_overshoot() {
        for rise_s in [2.0, 5.5] {
            let onset_s = stand_onset_s(&rise(rise_s)).unwrap();
            assert!((onset_s - rise_s - ONSET_S).abs() < WITHIN_S, "{rise_s}: {onset_s}");
        }
    }

    #[test]
    fn who_sits_down_again_stood_before() {
        // Lower than before, so that the lowest is at the end.
        let down = |time_s: f64| risen_mm(time_s - 2.0) - 1.2 * risen_mm(time_s - 25.0);
        let onset_s = stand_onset_s(&trial(down)).unwrap();
        assert!((onset_s - 2.0 - ONSET_S).abs() < WITHIN_S, "{onset_s}");
        // A person who stands, sits and rises again is standing once all is over.
        let trial =
            super::tests::trial(|time_s| 350.0 - risen_mm(time_s - 2.0) + risen_mm(time_s - 8.0));
        let onset_s = stand_onset_s(&trial).unwrap();
        assert!((onset_s - 8.0 - ONSET_S).abs() < WITHIN_S, "{onset_s}");
    }

    #[test]
    fn nobody_rests_while_nobody_is_seen() {
        // The point is not seen from the standing height on the way up until the overshoot is over.
        let whole = rise(2.0);
        let unseen = |at_s: f64| whole.time_s().partition_point(|time_s| *time_s < at_s);
        let (from, to) = (unseen(2.9), unseen(4.0));
        let gap = whole.only(&[0..from, to..whole.samples()]).unwrap();
        assert_eq!(stand_onset_s(&gap), Some(whole.time_s()[to]));
    }

    #[test]
    fn nobody_rises_where_nobody_does() {
        let standing = rise(2.0).between(10.0..30.0).unwrap();
        assert_eq!(stand_onset_s(&standing), None);
    }
}
