//! How far a trunk has moved since the reference or t = 0, while it goes on.
//!
//! In: the frames in their order. Out: the length of the path in the transverse plane, the root mean
//! square of AP and of ML about their means, the noise of one frame. The path is that of positions
//! filtered as the trial's own figures are ([`Design::PAPER`]), because of raw ones it is mostly noise; it
//! is half a second behind. Cost: the frames of some two seconds are kept, whatever the length.

use plumbline_analysis::filter::Design;
use plumbline_analysis::series::Series;

use crate::wire::{FrameRow, PointRow, TrunkState};

/// So much is filtered at once, seconds.
const CHUNK_S: f64 = 2.0;

/// So much at each end of a chunk is filtered once more with its neighbours, seconds: more than half of
/// the filter's window.
const EDGE_S: f64 = 0.5;

/// The most frames of a chunk: a box whose times hardly rise must not fill the memory.
const CHUNK_FRAMES_MAX: usize = 4096;

/// The noise follows the latest frames by this share of each.
const NOISE_SHARE: f64 = 0.05;

/// Which trunk.
#[derive(Debug, Clone, Copy)]
pub enum Which {
    /// The upper one.
    Upper,
    /// The lower one.
    Lower,
}

/// One trunk since the reference or t = 0.
#[derive(Debug, Default)]
struct Trunk {
    /// Time, AP and ML of frames whose path is not yet counted whole.
    pending: Vec<[f64; 3]>,
    /// Up to when the path is counted.
    counted_s: Option<f64>,
    path_mm: f64,
    count: f64,
    mean_mm: [f64; 2],
    squares_mm2: [f64; 2],
    first_s: Option<f64>,
    last_s: f64,
    variance_mm2: Option<[f64; 3]>,
    is_seen: bool,
}

/// Both trunks since the reference or t = 0.
#[derive(Debug, Default)]
pub struct Figures {
    trunks: [Trunk; 2],
}

impl Figures {
    /// Takes a frame; one that came late is left out.
    pub fn take(&mut self, row: &FrameRow) {
        if row.is_late {
            return;
        }
        for (trunk, point) in self.trunks.iter_mut().zip([row.upper, row.lower]) {
            trunk.is_seen = point.is_some();
            if let Some(point) = point {
                trunk.take(1e-3 * row.at_ms, point);
            }
        }
    }

    /// What is known now; `missing` says why a trunk is not seen.
    #[must_use]
    pub fn state(&self, which: Which, missing: &str) -> TrunkState {
        let trunk = &self.trunks[which as usize];
        let missing = if trunk.is_seen { "" } else { missing };
        let rms = trunk.squares_mm2.map(|it| (it / trunk.count.max(1.0)).sqrt());
        let noise = trunk.variance_mm2.map(|it| it.map(f64::sqrt));
        TrunkState {
            missing: missing.to_owned(),
            path_mm: trunk.counted_s.map(|_| trunk.path_mm),
            rms_mm: (trunk.count >= 2.0).then_some(rms),
            noise_mm: noise,
            span_s: trunk.first_s.map_or(0.0, |first_s| trunk.last_s - first_s),
        }
    }
}

impl Trunk {
    fn take(
        &mut self,
        time_s: f64,
        PointRow { p: [ap, ml, _], c: [ap2, _, ml2], si_mm2 }: PointRow,
    ) {
        if self.first_s.is_some() && time_s <= self.last_s {
            return;
        }
        self.first_s.get_or_insert(time_s);
        self.last_s = time_s;
        self.count += 1.0;
        for (axis, value) in [ap, ml].into_iter().enumerate() {
            // Welford 1962.
            let before = value - self.mean_mm[axis];
            self.mean_mm[axis] += before / self.count;
            self.squares_mm2[axis] += before * (value - self.mean_mm[axis]);
        }
        let latest = [ap2, ml2, si_mm2].map(|it| it.max(0.0));
        let variance = self.variance_mm2.get_or_insert(latest);
        for (known, latest) in variance.iter_mut().zip(latest) {
            *known += NOISE_SHARE * (latest - *known);
        }
        self.pending.push([time_s, ap, ml]);
        let lasts_s = time_s - self.pending[0][0];
        if lasts_s >= CHUNK_S || self.pending.len() >= CHUNK_FRAMES_MAX {
            self.count_path();
        }
    }

    /// Counts the path up to [`EDGE_S`] before the end, and keeps what the next chunk needs.
    fn count_path(&mut self) {
        let until_s = self.last_s - EDGE_S;
        let from_s = self.counted_s.unwrap_or(f64::NEG_INFINITY);
        let column = |at: usize| self.pending.iter().map(|it| it[at]).collect::<Vec<f64>>();
        let filtered = Series::new(column(0), [column(1), column(2), Vec::new()])
            .ok()
            .and_then(|series| Design::PAPER.at(series.rate_hz()).ok()?.apply(&series));
        if let Some(filtered) = filtered {
            use plumbline_analysis::series::Axis::{Ap, Ml};
            let smooth = &filtered.series;
            let (times, ap, ml) = (smooth.time_s(), smooth.along(Ap), smooth.along(Ml));
            for segment in smooth.segments() {
                for at in segment.skip(1) {
                    if times[at] > from_s && times[at] <= until_s {
                        let step = |of: Option<&[f64]>| of.map_or(0.0, |of| of[at] - of[at - 1]);
                        self.path_mm += step(ap).hypot(step(ml));
                    }
                }
            }
        }
        self.counted_s = Some(until_s.max(from_s));
        let keep_from_s = until_s - EDGE_S;
        self.pending.retain(|it| it[0] > keep_from_s);
        let surplus = self.pending.len().saturating_sub(CHUNK_FRAMES_MAX / 2);
        self.pending.drain(..surplus);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A person who goes round a circle of 10 mm once in 4 s, at 60 Hz.
    fn row(number: u64) -> FrameRow {
        let time_s = number as f64 / 60.0;
        let angle = time_s / 4.0 * std::f64::consts::TAU;
        let point = PointRow {
            p: [1000.0 + 10.0 * angle.cos(), 10.0 * angle.sin(), 5.0],
            c: [0.04, 0.0, 0.01],
            si_mm2: 0.09,
        };
        let (upper, lower) = (Some(point), None);
        FrameRow { number, at_ms: 1e3 * time_s, upper, lower, gap: 0, is_late: false }
    }

    #[test]
    fn a_circle_has_its_circumference_and_its_radius() {
        let mut figures = Figures::default();
        // Ten rounds and half a second: the path is half a second behind.
        (0..=60 * 40 + 30).for_each(|number| figures.take(&row(number)));
        let state = figures.state(Which::Upper, "");
        let rounds = state.path_mm.unwrap() / (10.0 * std::f64::consts::TAU);
        // It is counted every second.
        assert!((9.7..=10.01).contains(&rounds), "{rounds} rounds");
        let radius = 10.0 / f64::sqrt(2.0);
        for rms in state.rms_mm.unwrap() {
            assert!((rms - radius).abs() < 0.05, "{rms}");
        }
        assert_eq!(state.noise_mm, Some([0.2, 0.1, 0.3]));
        let lower = figures.state(Which::Lower, "not seen");
        assert_eq!((&*lower.missing, lower.path_mm), ("not seen", None));
        assert!(figures.trunks[0].pending.len() < 200);
    }
}
