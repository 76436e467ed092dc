//! R waves of an ECG.
//!
//! The detector is that of Hamilton (2002), "Open source ECG analysis", Computers in Cardiology
//! 29:101, after Pan & Tompkins (1985): a band-pass from about 8 to 16 Hz made of running means;
//! the absolute slope in that band, averaged over 80 ms; and rules for its peaks, see
//! `detector.rs`.
//!
//! The time of a wave is that of the extremum of the ECG itself, smoothed over 20 ms by a parabola
//! (Savitzky & Golay) and interpolated between samples. The polarity is decided once per recording,
//! by the majority of beats, so that intervals are always between the same waves; in a lead whose S
//! wave is the larger, the S wave is taken.
//!
//! White noise with a standard deviation of half the R waves' height, lasting some seconds, causes
//! no false beats; noise as high as the R waves does, and some of the false intervals pass as
//! cycles.
//!
//! The unit of the ECG does not matter. At least 100 samples per second are required. Each part
//! without a gap is searched separately; a part shorter than a second is not searched.

use std::ops::Range;

use super::cycles::{Beats, Cycles};
use super::detector::{Rules, detect};
use super::running;
use super::signal::{SamplingError, Signal};
use crate::filter::SavitzkyGolay;

/// Below, an R wave is only one or two samples; above, the times are probably not in seconds.
const RATE_HZ: [f64; 2] = [100.0, 20_000.0];

/// A shorter part may contain no beat.
const PART_MIN_S: f64 = 1.0;

/// The lengths of the running means of the band-pass, seconds: twice the first, minus the second.
const LOW_PASS_S: f64 = 0.025;
const HIGH_PASS_S: f64 = 0.125;

/// The slope is averaged over about the width of a QRS complex.
const AVERAGED_S: f64 = 0.08;

/// T waves follow the R wave by up to 0.36 s. Noise alone reaches twice its first quartile, an R
/// wave in a poor ECG five times.
const RULES: Rules = Rules { apart_s: 0.2, echo_s: 0.36, threshold: 0.3125, contrast: 3.5 };

/// On either side of the strongest slope, the range searched for its wave.
const WAVE_S: f64 = 0.08;

/// On either side of the extremum in the band, the range searched for that of the ECG.
const PEAK_S: f64 = 0.025;

/// The time over which an R wave is smoothed.
const SMOOTHED_S: f64 = 0.02;

/// The R waves of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RWaves {
    /// The times, by part of the recording without a gap.
    parts_s: Vec<Vec<f64>>,
    /// Whether the waves point downwards.
    pub downwards: bool,
}

impl RWaves {
    /// The times of the waves.
    pub fn time_s(&self) -> impl Iterator<Item = f64> + '_ {
        self.parts_s.iter().flatten().copied()
    }

    /// The cardiac cycles between them.
    #[must_use]
    pub fn cycles(&self) -> Cycles {
        Cycles::new(Beats::RWaves, &self.parts_s)
    }
}

/// Finds the R waves of an ECG.
///
/// # Errors
/// When the ECG is not evenly sampled at 100 to 20 000 Hz.
pub fn r_waves(ecg: &Signal) -> Result<RWaves, SamplingError> {
    let rate_hz = ecg.rate_hz(RATE_HZ[0], RATE_HZ[1])?;
    let parts = ecg.parts().into_iter();
    let parts: Vec<Part> = parts
        .filter(|range| range.len() as f64 >= PART_MIN_S * rate_hz)
        .map(|range| Part::new(ecg, range, rate_hz))
        .collect();
    let waves = parts.iter().flat_map(|part| part.found.iter().map(|at| part.is_downwards(*at)));
    let [down, up] = waves.fold(
        [0, 0],
        |[down, up], is_down| {
            if is_down { [down + 1, up] } else { [down, up + 1] }
        },
    );
    let downwards = down > up;
    Ok(RWaves { parts_s: parts.iter().map(|part| part.times_s(downwards)).collect(), downwards })
}

/// A part without a gap.
struct Part<'a> {
    time_s: &'a [f64],
    rate_hz: f64,
    /// The smoothed ECG.
    ecg: Vec<f64>,
    band: Vec<f64>,
    /// The samples at which the slope is strongest.
    found: Vec<usize>,
}

impl<'a> Part<'a> {
    fn new(ecg: &'a Signal, range: Range<usize>, rate_hz: f64) -> Self {
        let window = |duration_s: f64| running::window(duration_s, rate_hz);
        // Subtracts the first sample, so that an offset costs no precision and a flat line is zero.
        let (time_s, values) = (&ecg.time_s()[range.clone()], &ecg.values()[range]);
        let values: Vec<f64> = values.iter().map(|value| value - values[0]).collect();
        let low = running::mean(&values, window(LOW_PASS_S));
        let low = running::mean(&low, window(LOW_PASS_S));
        let base = running::mean(&low, window(HIGH_PASS_S));
        let band: Vec<f64> = low.iter().zip(&base).map(|(low, base)| low - base).collect();
        let slope: Vec<f64> =
            (0..band.len()).map(|at| (band[at] - band[at.saturating_sub(1)]).abs()).collect();
        let found = detect(&running::mean(&slope, window(AVERAGED_S)), rate_hz, &RULES);
        let smooth = SavitzkyGolay::lasting(SMOOTHED_S, rate_hz);
        let smoothed = smooth.and_then(|filter| filter.smooth(&values)).unwrap_or(values);
        Self { time_s, rate_hz, ecg: smoothed, band, found }
    }

    /// The samples within this distance of one, if the part has them all.
    fn around(&self, at: usize, reach_s: f64) -> Option<Range<usize>> {
        let reach = (reach_s * self.rate_hz).round() as usize;
        let start = at.checked_sub(reach)?;
        (at + reach < self.ecg.len()).then_some(start..at + reach + 1)
    }

    fn is_downwards(&self, at: usize) -> bool {
        let wave = self.around(at, WAVE_S).map_or(&[][..], |range| &self.band[range]);
        let [lowest, highest] =
            [wave.iter().copied().fold(0.0, f64::min), wave.iter().copied().fold(0.0, f64::max)];
        -lowest > highest
    }

    /// The times of the waves with this polarity. Incomplete waves at the ends of the part are left
    /// out.
    fn times_s(&self, downwards: bool) -> Vec<f64> {
        let sign = if downwards { -1.0 } else { 1.0 };
        let highest = |samples: &[f64], range: Range<usize>| {
            range.max_by(|&left, &right| (sign * samples[left]).total_cmp(&(sign * samples[right])))
        };
        let time_s = |&at: &usize| {
            let in_band = highest(&self.band, self.around(at, WAVE_S)?)?;
            let near = self.around(in_band, PEAK_S)?;
            let peak = highest(&self.ecg, near.clone())?;
            // A slope, not a peak: the wave is too distorted to have a peak of its own.
            let peak = if near.start < peak && peak + 1 < near.end { peak } else { in_band };
            let three = self.ecg.get(peak.checked_sub(1)?..peak + 2)?;
            let offset = running::vertex([three[0], three[1], three[2]]);
            let neighbour = if offset < 0.0 { peak - 1 } else { peak + 1 };
            let step_s = (self.time_s[neighbour] - self.time_s[peak]).abs();
            Some(self.time_s[peak] + offset * step_s)
        };
        let mut times_s: Vec<f64> = self.found.iter().filter_map(time_s).collect();
        // Two strong slopes of one distorted wave.
        times_s.dedup_by(|later, earlier| *later - *earlier < RULES.apart_s / 2.0);
        times_s
    }
}
