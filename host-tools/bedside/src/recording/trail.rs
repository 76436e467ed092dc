//! Where both trunks have been in the last half minute, for plots.

use std::collections::VecDeque;

/// As far back as it goes, seconds.
pub const TRAIL_S: f64 = 30.0;

/// The points lie at least this far apart: no plot on a screen shows more.
const STEP_S: f64 = 0.05;

/// The points that are kept.
const POINTS_MAX: usize = (TRAIL_S / STEP_S) as usize + 1;

/// A trunk's point at some time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrailPoint {
    /// Before now, seconds.
    pub ago_s: f64,
    /// Along AP, ML and SI from the origin, mm.
    pub position_mm: [f64; 3],
}

/// Follows a trunk.
#[derive(Debug, Default)]
pub(super) struct Trail {
    /// The time of the capture, and the position.
    points: VecDeque<(u64, [f64; 3])>,
}

impl Trail {
    /// Takes a point.
    pub(super) fn take(&mut self, capture_ns: u64, position_mm: [f64; 3]) {
        match self.points.back() {
            // The box has restarted.
            Some((last_ns, _)) if *last_ns > capture_ns => self.points.clear(),
            Some((last_ns, _)) if 1e-9 * ((capture_ns - last_ns) as f64) < STEP_S => return,
            _ => {}
        }
        if self.points.len() == POINTS_MAX {
            self.points.pop_front();
        }
        self.points.push_back((capture_ns, position_mm));
    }

    /// The points of the last [`TRAIL_S`], the oldest first.
    pub(super) fn points(&self, now_ns: u64, origin_mm: [f64; 3]) -> Vec<TrailPoint> {
        let point = |(capture_ns, position_mm): &(u64, [f64; 3])| TrailPoint {
            ago_s: 1e-9 * now_ns.saturating_sub(*capture_ns) as f64,
            position_mm: std::array::from_fn(|axis| position_mm[axis] - origin_mm[axis]),
        };
        self.points.iter().map(point).filter(|point| point.ago_s <= TRAIL_S).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_half_a_minute_long_and_no_denser_than_a_screen() {
        let mut trail = Trail::default();
        for frame in 0..12_000_u32 {
            // A minute at 200 Hz.
            trail.take(u64::from(frame) * 5_000_000, [f64::from(frame), 0.0, 1.0]);
        }
        let points = trail.points(60_000_000_000, [1000.0, 0.0, 1.0]);
        assert!((595..=POINTS_MAX).contains(&points.len()), "{}", points.len());
        assert!(points.windows(2).all(|pair| pair[0].ago_s > pair[1].ago_s));
        assert!(points[0].ago_s <= TRAIL_S && points[0].position_mm[0] >= 4990.0, "{points:?}");
        // The box restarts.
        trail.take(5, [0.0; 3]);
        assert_eq!(trail.points(5, [0.0; 3]).len(), 1);
    }
}
