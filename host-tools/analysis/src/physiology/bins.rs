//! Values at whole seconds, and their means over the parts of a stand trial.
//!
//! As in the paper, quantities that come once a beat or a breath are interpolated linearly to one
//! value per second, and quantities sampled faster (oxygenation at 50 Hz) are averaged over bins of
//! one second. All then have the same times and are averaged over parts of the trial. Second k runs
//! from k to k + 1 and is interpolated at its middle, so that a part from 0 to 10 s contains
//! nothing of what came before.
//!
//! There is no extrapolation, no interpolation across gaps longer than a bound, and no average
//! where most samples are missing. Such seconds are missing, and each mean reports how many it had.

use std::ops::Range;

use serde::Serialize;

use super::signal::{SamplingError, Signal};

/// A bin needs at least this fraction of the samples that the rate promises.
const BIN_COVERAGE_MIN: f64 = 0.5;

/// A quantity averaged over seconds must be sampled several times a second.
const RATE_HZ: [f64; 2] = [2.0, 20_000.0];

/// Slow breaths are 10 s apart; a longer gap would hide changes within a part of the stand.
pub const GAP_MAX_S: f64 = 10.0;

/// A quantity at whole seconds after t = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Seconds {
    /// The first second.
    pub first_s: i64,
    /// At each second from the first on; `None` where it is missing.
    pub values: Vec<Option<f64>>,
}

impl Seconds {
    /// Interpolates a quantity that comes once a beat or a breath at the middle of each second,
    /// linearly between values that are no further apart than the bound.
    ///
    /// `zero_s` is t = 0 on the signal's clock; `span` is the range of seconds, which take 16 bytes
    /// each.
    #[must_use]
    pub fn interpolated(signal: &Signal, zero_s: f64, span: Range<i64>, gap_max_s: f64) -> Self {
        let first_s = span.start;
        let values =
            span.map(|second| signal.at(zero_s + second as f64 + 0.5, gap_max_s)).collect();
        Self { first_s, values }
    }

    /// Averages a continuously sampled quantity over each second.
    ///
    /// # Errors
    /// When the signal is not evenly sampled at 2 to 20 000 Hz.
    pub fn averaged(signal: &Signal, zero_s: f64, span: Range<i64>) -> Result<Self, SamplingError> {
        let needed = BIN_COVERAGE_MIN * signal.rate_hz(RATE_HZ[0], RATE_HZ[1])?;
        let first_s = span.start;
        let average = |second: i64| {
            let start_s = zero_s + second as f64;
            let bin = signal.within(start_s..start_s + 1.0);
            let known = signal.values()[bin].iter().filter(|value| !value.is_nan());
            let (count, sum) = known.fold((0.0, 0.0), |(count, sum), it| (count + 1.0, sum + it));
            (count >= needed).then(|| sum / count)
        };
        Ok(Self { first_s, values: span.map(average).collect() })
    }

    /// The value at a second.
    #[must_use]
    pub fn at(&self, second: i64) -> Option<f64> {
        let index = usize::try_from(second.checked_sub(self.first_s)?).ok()?;
        self.values.get(index).copied().flatten()
    }
}

/// The event from which a part of a trial is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// The person begins to rise.
    Transition,
    /// The person stands: t = 0.
    Stance,
}

/// A part of a trial. The paper's are a supine baseline from 45 to 15 s before the transition, and
/// the first 10 s of early, mid and late stance. (The paper's words, "the first 10 s of stance
/// time", could mean something else; but its three values differ, so each must have its own 10 s.)
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Its name in the tables.
    pub name: String,
    /// The event it is counted from.
    pub from: Event,
    /// Its start and its end (exclusive), seconds after the event.
    pub span_s: Range<f64>,
}

impl Window {
    /// The whole seconds after t = 0 that it covers, given the time of the transition.
    #[must_use]
    pub fn seconds(&self, transition_s: f64) -> Range<i64> {
        let event_s = match self.from {
            Event::Transition => transition_s,
            Event::Stance => 0.0,
        };
        (event_s + self.span_s.start).ceil() as i64..(event_s + self.span_s.end).ceil() as i64
    }
}

/// The mean over a part of a trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WindowMean {
    /// The part's name.
    pub name: String,
    /// `None` where too much is missing.
    pub mean: Option<f64>,
    /// The number of seconds in the part.
    pub seconds: usize,
    /// The number of those that have a value.
    pub known: usize,
}

/// The means over parts of a trial in which at least this fraction of the seconds has a value.
///
/// `transition_s`: when the transition begins, seconds after t = 0, so it is negative.
#[must_use]
pub fn window_means(
    seconds: &Seconds,
    windows: &[Window],
    transition_s: f64,
    coverage_min: f64,
) -> Vec<WindowMean> {
    let mean = |window: &Window| {
        let span = window.seconds(transition_s);
        let count = usize::try_from(span.end.saturating_sub(span.start)).unwrap_or(0);
        let end_s = seconds.first_s.saturating_add_unsigned(seconds.values.len() as u64);
        let inside = span.start.max(seconds.first_s)..span.end.min(end_s);
        let known: Vec<f64> = inside.filter_map(|second| seconds.at(second)).collect();
        let enough = !known.is_empty() && known.len() as f64 >= coverage_min * count as f64;
        WindowMean {
            name: window.name.clone(),
            mean: enough.then(|| known.iter().sum::<f64>() / known.len() as f64),
            seconds: count,
            known: known.len(),
        }
    };
    windows.iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows_of_the_paper() -> [Window; 4] {
        let window = |name: &str, from, span_s| Window { name: name.to_owned(), from, span_s };
        [
            window("baseline", Event::Transition, -45.0..-15.0),
            window("early", Event::Stance, 0.0..10.0),
            window("mid", Event::Stance, 20.0..30.0),
            window("late", Event::Stance, 40.0..50.0),
        ]
    }

    fn evenly(rate_hz: f64, span_s: Range<f64>, value: impl Fn(f64) -> f64) -> Signal {
        let count = ((span_s.end - span_s.start) * rate_hz).round() as usize;
        let times = (0..count).map(|at| span_s.start + at as f64 / rate_hz);
        Signal::of(times.map(|time_s| (time_s, value(time_s))))
    }

    #[test]
    fn beats_are_interpolated_to_seconds_and_no_further() {
        // A value equal to its own time, every 0.8 s from 100.4 to 106, except from 102.8 to 104.4.
        let beats = [100.4, 101.2, 102.0, 102.8, 104.4, 105.2, 106.0];
        let signal = Signal::of(beats.map(|it| (it, it)));
        // Middles from 99 s on belong to seconds that begin half a second earlier.
        let it = Seconds::interpolated(&signal, 99.5, -1..8, 1.5);
        let expected =
            [None, None, Some(101.0), Some(102.0), None, None, Some(105.0), Some(106.0), None];
        for (at, (found, expected)) in it.values.iter().zip(expected).enumerate() {
            match (found, expected) {
                (Some(found), Some(expected)) => assert!((found - expected).abs() < 1e-12),
                _ => assert_eq!(*found, expected, "{at}"),
            }
        }
        assert_eq!(
            Seconds::interpolated(&signal, 99.5, -1..8, 2.0).values[4].map(f64::round),
            Some(103.0)
        );
    }

    #[test]
    fn a_second_is_the_mean_of_what_lies_about_it() {
        // At 50 Hz, second k has the samples k to k + 0.98: the mean of a ramp is k + 0.49.
        let ramp = evenly(50.0, -10.0..10.0, |time_s| time_s);
        let it = Seconds::averaged(&ramp, 0.0, -11..12).unwrap();
        for second in -10..10 {
            let found = it.at(second).unwrap();
            assert!((found - second as f64 - 0.49).abs() < 1e-9, "{second}: {found}");
        }
        // Beyond the recording there is nothing.
        assert_eq!((it.at(-11), it.at(10), it.at(99), it.at(i64::MIN)), (None, None, None, None));
        let holes =
            evenly(
                50.0,
                0.0..4.0,
                |time_s| if (1.4..1.8).contains(&time_s) { f64::NAN } else { 2.0 },
            );
        assert_eq!(Seconds::averaged(&holes, 0.0, 1..3).unwrap().values, [Some(2.0), Some(2.0)]);
        let more =
            evenly(
                50.0,
                0.0..4.0,
                |time_s| if (1.25..1.8).contains(&time_s) { f64::NAN } else { 2.0 },
            );
        assert_eq!(Seconds::averaged(&more, 0.0, 1..3).unwrap().values, [None, Some(2.0)]);
        assert!(Seconds::averaged(&evenly(1.0, 0.0..9.0, |_| 1.0), 0.0, 0..3).is_err());
    }

    #[test]
    fn the_papers_windows_are_counted_from_their_own_events() {
        let [baseline, early, mid, late] = windows_of_the_paper();
        // A person who takes 4.6 s to stand up: -49.6 to -19.6.
        assert_eq!(baseline.seconds(-4.6), -49..-19);
        assert_eq!([early, mid, late].map(|it| it.seconds(-4.6)), [0..10, 20..30, 40..50]);
    }

    #[test]
    fn a_mean_says_what_it_is_of() {
        // A value equal to its own second, from -60 to 44.
        let signal = Signal::of((-60..45).map(|it| (f64::from(it), f64::from(it))));
        let it = Seconds::interpolated(&signal, -0.5, -60..60, GAP_MAX_S);
        let means = window_means(&it, &windows_of_the_paper(), -5.0, 0.6);
        let of = |at: usize| (means[at].mean, means[at].seconds, means[at].known);
        // -50 to -21.
        assert_eq!((means[0].name.as_str(), of(0)), ("baseline", (Some(-35.5), 30, 30)));
        assert_eq!((of(1), of(2)), ((Some(4.5), 10, 10), (Some(24.5), 10, 10)));
        // 40 to 44: half of the part, where 60 % are needed.
        assert_eq!(of(3), (None, 10, 5));
        assert_eq!(window_means(&it, &windows_of_the_paper(), -5.0, 0.5)[3].mean, Some(42.0));
        let empty = Window { name: String::new(), from: Event::Stance, span_s: 3.0..-3.0 };
        assert_eq!(window_means(&it, &[empty], 0.0, 0.0)[0].mean, None);
        let endless = Window { name: String::new(), from: Event::Stance, span_s: 43.0..1e300 };
        assert_eq!(window_means(&it, &[endless], 0.0, 0.0)[0].mean, Some(43.5));
        let nowhere = window_means(&it, &windows_of_the_paper(), f64::NAN, 0.5);
        assert_eq!((nowhere[0].mean, nowhere[0].seconds), (None, 0));
    }
}
