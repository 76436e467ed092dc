//! A heart whose beats are known, and ECGs of it.

use std::f64::consts::TAU;

use plumbline_analysis::physiology::signal::Signal;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// A wave of the ECG: its delay after the R wave, its height in mV, and its width (one sigma).
type Wave = (f64, f64, f64);

/// The delay of the T wave of a sinus beat after the R wave.
const T_S: f64 = 0.28;

/// P, Q, R, S and T.
const SINUS: [Wave; 5] = [
    (-0.17, 0.12, 0.025),
    (-0.03, -0.12, 0.008),
    (0.0, 1.0, 0.010),
    (0.03, -0.2, 0.008),
    (T_S, 0.3, 0.05),
];

/// From a ventricle: wide, without a P wave, and with an inverted T wave.
const ECTOPIC: [Wave; 2] = [(0.0, 1.4, 0.028), (0.3, -0.5, 0.06)];

/// How an ECG is recorded.
#[derive(Clone, Copy)]
pub struct Recording {
    pub rate_hz: f64,
    pub duration_s: f64,
    /// A constant, mV.
    pub offset_mv: f64,
    /// The amplitude of the baseline wander at 0.3 Hz.
    pub wander_mv: f64,
    /// The noise of each sample.
    pub noise_mv: f64,
    /// The mains hum at 50 Hz.
    pub mains_mv: f64,
    /// The factor on the height of the T wave, normally 0.3 mV.
    pub t_wave: f64,
    /// The number of units per mV.
    pub gain: f64,
    /// The factor on the amplitude at a time.
    pub amplitude: fn(f64) -> f64,
}

impl Default for Recording {
    fn default() -> Self {
        Self {
            rate_hz: 1000.0,
            duration_s: 60.0,
            offset_mv: 0.0,
            wander_mv: 0.0,
            noise_mv: 0.0,
            mains_mv: 0.0,
            t_wave: 1.0,
            gain: 1.0,
            amplitude: |_| 1.0,
        }
    }
}

impl Recording {
    pub fn times(&self) -> impl Iterator<Item = f64> {
        let rate_hz = self.rate_hz;
        (0..(self.duration_s * rate_hz) as usize).map(move |at| at as f64 / rate_hz)
    }

    pub fn of(&self, beats_s: &[f64]) -> Vec<f64> {
        self.with_ectopic(beats_s, &[])
    }

    /// The ECG of these beats; those with these indices are ectopic.
    pub fn with_ectopic(&self, beats_s: &[f64], ectopic: &[usize]) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let noise = Normal::new(0.0, self.noise_mv).unwrap();
        let value = |time_s: f64| {
            let first = beats_s.partition_point(|beat_s| *beat_s < time_s - 1.0);
            let near = beats_s.iter().enumerate().skip(first).take_while(|it| *it.1 < time_s + 1.0);
            let beats: f64 = near
                .map(|(index, beat_s)| {
                    let waves = if ectopic.contains(&index) { &ECTOPIC[..] } else { &SINUS };
                    let wave = |(after_s, mv, width_s): &Wave| {
                        let mv = if *after_s == T_S { self.t_wave * mv } else { *mv };
                        mv * (-0.5 * ((time_s - beat_s - after_s) / width_s).powi(2)).exp()
                    };
                    (self.amplitude)(*beat_s) * waves.iter().map(wave).sum::<f64>()
                })
                .sum();
            beats
                + self.offset_mv
                + self.wander_mv * (TAU * 0.3 * time_s).sin()
                + self.mains_mv * (TAU * 50.0 * time_s).sin()
        };
        self.times().map(|time_s| self.gain * (value(time_s) + noise.sample(&mut random))).collect()
    }

    pub fn signal(&self, values: Vec<f64>) -> Signal {
        Signal::new(self.times().collect(), values).unwrap()
    }
}

/// The beats of a heart whose rate varies by a tenth with each breath.
pub fn beats(rate_bpm: f64, span_s: std::ops::Range<f64>) -> Vec<f64> {
    let next = |beat_s: &f64| {
        let interval_s = 60.0 / rate_bpm * (1.0 + 0.1 * (TAU * 0.25 * beat_s).sin());
        Some(beat_s + interval_s)
    };
    std::iter::successors(Some(span_s.start), next).take_while(|it| *it < span_s.end).collect()
}

/// The number of false beats, the number of missed beats, and the worst error of the beats that
/// were found, seconds.
pub fn compare(found_s: &[f64], beats_s: &[f64]) -> (usize, usize, f64) {
    let error_s = |one: f64, others: &[f64]| {
        others.iter().map(|it| (it - one).abs()).fold(f64::INFINITY, f64::min)
    };
    let is_beat = |error_s: f64| error_s < 0.1;
    let errors_s: Vec<f64> = beats_s.iter().map(|it| error_s(*it, found_s)).collect();
    let falsely = found_s.iter().filter(|it| !is_beat(error_s(**it, beats_s))).count();
    let missed = errors_s.iter().filter(|it| !is_beat(**it)).count();
    let worst_s = errors_s.into_iter().filter(|it| is_beat(*it)).fold(0.0, f64::max);
    (falsely, missed, worst_s)
}
