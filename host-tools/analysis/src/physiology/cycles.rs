//! Cardiac cycles: the intervals between beats, and which of them are plausible.
//!
//! Beats are R waves, or the feet of a pressure wave. An interval is excluded, never repaired, when
//!
//! - the recording has a gap in it: a beat may be in the gap;
//! - it is shorter than 0.3 s or longer than 2 s (200 and 30 beats per minute);
//! - it differs by more than a fifth from the median of the eleven intervals around it. A shorter
//!   one ends in a premature beat or a false detection; a longer one spans a missed beat or the
//!   pause after a premature beat. A fifth is Malik's bound (Malik et al. 1989, Eur. Heart J.
//!   10:1060). Unlike the preceding interval, the median lets a steady rise of the heart rate pass,
//!   as when a person stands up.
//!
//! The median tolerates up to five false beats in a row. Where every second beat is premature,
//! short and long intervals alternate, and nearly all are excluded.

use serde::Serialize;

use super::signal::Signal;

/// The shortest and the longest plausible cardiac cycle, seconds.
const PLAUSIBLE_S: std::ops::RangeInclusive<f64> = 0.3..=2.0;

/// The number of intervals on either side with which an interval is compared.
const AROUND: usize = 5;

/// The largest plausible difference from their median, as a fraction of it.
const DIFFERENCE_MAX: f64 = 0.2;

/// What the beats are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Beats {
    /// R waves of the ECG.
    RWaves,
    /// Feet of the pressure wave itself: the minima before its upstrokes.
    PulseFeet,
}

/// Whether an interval is a single cardiac cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It is one.
    Normal,
    /// The recording has a gap in it.
    Gap,
    /// No heart beats this fast or this slowly.
    Implausible,
    /// Shorter than the intervals around it.
    Short,
    /// Longer than the intervals around it.
    Long,
}

/// The interval from one beat to the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cycle {
    /// The time of the beat that begins it.
    pub start_s: f64,
    /// The time of the next beat.
    pub end_s: f64,
    /// Whether it is plausible.
    pub verdict: Verdict,
}

impl Cycle {
    /// The duration: RR, if the beats are R waves.
    #[must_use]
    pub fn interval_s(&self) -> f64 {
        self.end_s - self.start_s
    }

    /// The time at which its figures are reported.
    #[must_use]
    pub fn middle_s(&self) -> f64 {
        0.5 * (self.start_s + self.end_s)
    }

    /// The time and the figure, which is NaN if the cycle is not plausible.
    fn figure(&self, figure: impl FnOnce(&Self) -> Option<f64>) -> (f64, f64) {
        let known = (self.verdict == Verdict::Normal).then(|| figure(self)).flatten();
        (self.middle_s(), known.unwrap_or(f64::NAN))
    }
}

/// All cycles of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cycles {
    /// What the beats are.
    pub beats: Beats,
    /// In order of time.
    pub cycles: Vec<Cycle>,
}

impl Cycles {
    /// From the beats of each part of a recording; parts are separated by gaps.
    pub(super) fn new(beats: Beats, parts: &[Vec<f64>]) -> Self {
        let beats_s = parts.iter().enumerate();
        let beats_s: Vec<(usize, f64)> =
            beats_s.flat_map(|(part, it)| it.iter().map(move |beat_s| (part, *beat_s))).collect();
        let mut cycles: Vec<Cycle> = beats_s
            .windows(2)
            .map(|pair| {
                let (start_s, end_s) = (pair[0].1, pair[1].1);
                let verdict = match end_s - start_s {
                    _ if pair[0].0 != pair[1].0 => Verdict::Gap,
                    interval_s if !PLAUSIBLE_S.contains(&interval_s) => Verdict::Implausible,
                    _ => Verdict::Normal,
                };
                Cycle { start_s, end_s, verdict }
            })
            .collect();
        let compared: Vec<Verdict> = (0..cycles.len()).map(|at| compare(&cycles, at)).collect();
        for (cycle, verdict) in cycles.iter_mut().zip(compared) {
            cycle.verdict = verdict;
        }
        Self { beats, cycles }
    }

    /// The instantaneous heart rate, 60 / RR, beats per minute: at the middle of each cycle, and
    /// missing where the cycle is not plausible.
    #[must_use]
    pub fn heart_rate_bpm(&self) -> Signal {
        self.figures(|cycle| Some(60.0 / cycle.interval_s()))
    }

    /// One figure per cycle, at its middle.
    pub(super) fn figures(&self, figure: impl Fn(&Cycle) -> Option<f64>) -> Signal {
        Signal::of(self.cycles.iter().map(|cycle| cycle.figure(&figure)))
    }

    /// The number of cycles with this verdict.
    #[must_use]
    pub fn count(&self, verdict: Verdict) -> usize {
        self.cycles.iter().filter(|cycle| cycle.verdict == verdict).count()
    }
}

/// The verdict on a cycle by comparison with those around it.
fn compare(cycles: &[Cycle], at: usize) -> Verdict {
    if cycles[at].verdict != Verdict::Normal {
        return cycles[at].verdict;
    }
    let around = &cycles[at.saturating_sub(AROUND)..cycles.len().min(at + AROUND + 1)];
    let normal = around.iter().filter(|cycle| cycle.verdict == Verdict::Normal);
    let mut intervals_s: Vec<f64> = normal.map(Cycle::interval_s).collect();
    intervals_s.sort_by(f64::total_cmp);
    let (lower, upper) = ((intervals_s.len() - 1) / 2, intervals_s.len() / 2);
    let median_s = 0.5 * (intervals_s[lower] + intervals_s[upper]);
    match cycles[at].interval_s() / median_s - 1.0 {
        difference if difference > DIFFERENCE_MAX => Verdict::Long,
        difference if difference < -DIFFERENCE_MAX => Verdict::Short,
        _ => Verdict::Normal,
    }
}

#[cfg(test)]
mod tests {
    use super::Verdict::*;
    use super::*;

    /// The verdicts on beats with these intervals, starting at 10 s.
    fn verdicts(intervals_s: &[f64]) -> Vec<Verdict> {
        let beats = intervals_s.iter().scan(10.0, |beat_s, interval_s| {
            *beat_s += interval_s;
            Some(*beat_s)
        });
        let beats_s: Vec<f64> = [10.0].into_iter().chain(beats).collect();
        let it = Cycles::new(Beats::RWaves, &[beats_s]);
        it.cycles.iter().map(|cycle| cycle.verdict).collect()
    }

    #[test]
    fn a_premature_beat_and_a_missed_one_are_left_out() {
        let mut intervals_s = [0.8; 12];
        (intervals_s[4], intervals_s[5], intervals_s[9]) = (0.5, 1.1, 1.6);
        let mut expected = [Normal; 12];
        (expected[4], expected[5], expected[9]) = (Short, Long, Long);
        assert_eq!(verdicts(&intervals_s), expected);
        // Two false beats in each of two cycles.
        let mut intervals_s = [0.9; 16];
        intervals_s[6..10].copy_from_slice(&[0.42, 0.48, 0.45, 0.45]);
        let mut expected = [Normal; 16];
        expected[6..10].fill(Short);
        assert_eq!(verdicts(&intervals_s), expected);
        // The bound itself, from both sides.
        let within = verdicts(&[1.0, 1.0, 1.19, 1.0, 0.81, 1.0, 1.0]);
        assert_eq!(within, [Normal; 7]);
        let beyond = verdicts(&[1.0, 1.0, 1.21, 1.0, 0.79, 1.0, 1.0]);
        assert_eq!(beyond, [Normal, Normal, Long, Normal, Short, Normal, Normal]);
    }

    #[test]
    fn a_rise_of_the_heart_rate_passes() {
        // From 60 to 120 per minute within ten beats, each interval a tenth shorter than the one
        // before.
        let rise: Vec<f64> = (0..20).map(|at| 0.9_f64.powi((at - 6).clamp(0, 7))).collect();
        assert_eq!(verdicts(&rise), [Normal; 20]);
        // As on standing up: from 63 to 109 per minute within ten beats, and back within fifteen.
        let stand: Vec<f64> = (0..60)
            .map(f64::from)
            .map(|at| {
                0.95 - 0.04 * (at - 20.0).clamp(0.0, 10.0)
                    + 0.4 / 15.0 * (at - 30.0).clamp(0.0, 15.0)
            })
            .collect();
        assert_eq!(verdicts(&stand), [Normal; 60]);
    }

    #[test]
    fn what_no_heart_does_is_left_out_and_does_not_judge() {
        let found = verdicts(&[0.9, 0.25, 0.29, 0.28, 0.27, 2.1, 0.9]);
        let expected =
            [Normal, Implausible, Implausible, Implausible, Implausible, Implausible, Normal];
        assert_eq!(found, expected);
        // Two intervals that disagree: nothing tells which is right.
        assert_eq!(verdicts(&[0.7, 1.4]), [Short, Long]);
    }

    #[test]
    fn the_heart_rate_is_in_the_middle_and_missing_where_beats_are_doubtful() {
        let parts = [vec![1.0, 2.0, 3.0], vec![], vec![4.0, 5.0], vec![6.0]];
        let it = Cycles::new(Beats::RWaves, &parts);
        assert_eq!((it.count(Normal), it.count(Gap)), (3, 2));
        let rate = it.heart_rate_bpm();
        assert_eq!(rate.time_s(), [1.5, 2.5, 3.5, 4.5, 5.5]);
        assert_eq!(rate.present().collect::<Vec<_>>(), [(1.5, 60.0), (2.5, 60.0), (4.5, 60.0)]);
        for none in [vec![], vec![vec![]], vec![vec![1.0]]] {
            assert!(Cycles::new(Beats::RWaves, &none).heart_rate_bpm().time_s().is_empty());
        }
    }
}
