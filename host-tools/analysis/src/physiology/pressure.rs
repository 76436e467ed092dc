//! Systolic, diastolic and mean pressure of each cardiac cycle; also for blood flow velocity, which
//! has the same figures.
//!
//! As in the paper, these are the maximum, minimum and mean within each cycle. Cycles run from R
//! wave to R wave or, without an ECG, from foot to foot of the pressure wave itself;
//! [`Cycles::beats`] says which. A cycle that is not plausible, or in which a sample is missing,
//! has no figures: the missing sample may be the highest or the lowest. Figures are in the wave's
//! own unit.
//!
//! # Cycles from the wave
//! Upstrokes are found in the slope sum of Zong et al. (2003), "An open-source algorithm to detect
//! onset of arterial blood pressure pulses", Computers in Cardiology 30:259: how far the wave has
//! risen within 128 ms. The foot is the minimum in the 0.2 s before the middle of that rise. A foot
//! is blunter than an R wave, so intervals between feet vary more than RR.

use super::cycles::{Beats, Cycle, Cycles};
use super::detector::{Rules, detect};
use super::running;
use super::signal::{SamplingError, Signal};

/// At lower rates the extremes of a pulse fall too far between samples.
const RATE_HZ: [f64; 2] = [40.0, 20_000.0];

/// A cycle with fewer samples has no reliable mean.
const SAMPLES_MIN: usize = 10;

/// The time over which the rise of a pulse is summed.
const RISE_S: f64 = 0.128;

/// Noise above about 10 Hz does not count as a rise.
const LOW_PASS_S: f64 = 0.04;

/// How long before the middle of the rise the foot is searched for: twice what the slowest upstroke
/// needs, but not so long that noise on the late, flat part of the previous wave is taken for it.
const FOOT_S: f64 = 0.2;

/// Dicrotic waves follow the upstroke by up to 0.45 s and rise by less than half of it. Noise
/// alone, with the few samples at 50 Hz, reaches four times its first quartile.
const RULES: Rules = Rules { apart_s: 0.25, echo_s: 0.45, threshold: 0.45, contrast: 6.0 };

/// The figures of a wave by cycle, each at the middle of its cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct BeatWise {
    /// What the beats of the cycles are.
    pub beats: Beats,
    /// Maximum.
    pub systolic: Signal,
    /// Minimum.
    pub diastolic: Signal,
    /// Mean.
    pub mean: Signal,
}

impl BeatWise {
    /// The figures of a wave in these cycles.
    ///
    /// # Errors
    /// When the wave is not evenly sampled at 40 to 20 000 Hz.
    pub fn new(wave: &Signal, cycles: &Cycles) -> Result<Self, SamplingError> {
        let rate_hz = wave.rate_hz(RATE_HZ[0], RATE_HZ[1])?;
        let parts = wave.parts();
        let whole = |cycle: &Cycle| {
            let range = wave.within(cycle.start_s..cycle.end_s);
            let part = parts[parts.partition_point(|part| part.end <= range.start)..].first()?;
            let (first_s, last_s) =
                (wave.time_s().get(range.start)?, wave.time_s()[..range.end].last()?);
            let ends_s = (first_s - cycle.start_s).max(cycle.end_s - last_s);
            let covered = part.start <= range.start && range.end <= part.end;
            let values = &wave.values()[range];
            (covered && ends_s * rate_hz <= 1.5 && values.len() >= SAMPLES_MIN).then_some(values)
        };
        let figures =
            |figure: fn(&[f64]) -> f64| cycles.figures(|cycle| Some(figure(whole(cycle)?)));
        Ok(Self {
            beats: cycles.beats,
            systolic: figures(|values| values.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            diastolic: figures(|values| values.iter().copied().fold(f64::INFINITY, f64::min)),
            mean: figures(|values| values.iter().sum::<f64>() / values.len() as f64),
        })
    }
}

/// The cardiac cycles of a pressure or velocity wave, from foot to foot.
///
/// # Errors
/// When the wave is not evenly sampled at 40 to 20 000 Hz.
pub fn pulse_cycles(wave: &Signal) -> Result<Cycles, SamplingError> {
    let rate_hz = wave.rate_hz(RATE_HZ[0], RATE_HZ[1])?;
    let parts = wave.parts().into_iter();
    let parts_s: Vec<Vec<f64>> = parts
        .map(|part| {
            let (time_s, values) = (&wave.time_s()[part.clone()], &wave.values()[part]);
            feet(values, rate_hz).into_iter().map(|at| time_s[at]).collect()
        })
        .collect();
    Ok(Cycles::new(Beats::PulseFeet, &parts_s))
}

/// The samples of the minima before upstrokes, except those that may lie before the first sample.
fn feet(wave: &[f64], rate_hz: f64) -> Vec<usize> {
    let window = |duration_s: f64| running::window(duration_s, rate_hz);
    let from_first: Vec<f64> = wave.iter().map(|value| value - wave[0]).collect();
    let smooth = running::mean(&from_first, window(LOW_PASS_S));
    let rises = (0..smooth.len()).map(|at| (smooth[at] - smooth[at.saturating_sub(1)]).max(0.0));
    let rise = running::mean(&rises.collect::<Vec<_>>(), window(RISE_S));
    let reach = (FOOT_S * rate_hz).round() as usize;
    let found = detect(&rise, rate_hz, &RULES).into_iter();
    found
        .filter_map(|at| {
            let start = at.checked_sub(reach)?;
            (start..=at).min_by(|&left, &right| smooth[left].total_cmp(&smooth[right]))
        })
        .collect()
}
