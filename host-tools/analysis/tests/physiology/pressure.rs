//! The pressures of cycles, and cycles from a pressure.

use std::f64::consts::TAU;

use plumbline_analysis::physiology::cycles::Beats;
use plumbline_analysis::physiology::ecg::r_waves;
use plumbline_analysis::physiology::pressure::{BeatWise, pulse_cycles};
use plumbline_analysis::physiology::signal::Signal;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::heart::{Recording, beats, compare};

/// A pulse: from its foot, at this time, up to the systolic pressure within 0.15 s, and down to the
/// diastolic pressure of the next foot, with a dicrotic wave.
struct Pulse {
    foot_s: f64,
    systolic: f64,
    diastolic: f64,
}

/// Pulses whose feet come 0.2 s after these beats, with systolic and diastolic pressures that
/// change with each breath; nothing before the first foot or after the last.
fn pulses(beats_s: &[f64]) -> Vec<Pulse> {
    let pulse = |beat_s: &f64| {
        let breath = (TAU * 0.25 * beat_s).sin();
        Pulse {
            foot_s: beat_s + 0.2,
            systolic: 120.0 + 8.0 * breath,
            diastolic: 75.0 + 4.0 * breath,
        }
    };
    beats_s.iter().map(pulse).collect()
}

fn pressure(pulses: &[Pulse], time_s: f64) -> f64 {
    let at = pulses.partition_point(|pulse| pulse.foot_s <= time_s);
    let (Some(pulse), Some(next)) = (pulses.get(at.wrapping_sub(1)), pulses.get(at)) else {
        // The end of a pulse precedes the first foot; nothing follows the last.
        return pulses[0].diastolic + 40.0 * (pulses[0].foot_s - time_s).max(0.0);
    };
    let after_s = time_s - pulse.foot_s;
    if after_s < 0.15 {
        let part = 0.5 - 0.5 * (TAU * after_s / 0.3).cos();
        return pulse.diastolic + part * (pulse.systolic - pulse.diastolic);
    }
    let part = (after_s - 0.15) / (next.foot_s - pulse.foot_s - 0.15);
    let dicrotic = 6.0 * (-0.5 * ((after_s - 0.38) / 0.03).powi(2)).exp();
    pulse.systolic + part * (next.diastolic - pulse.systolic) + dicrotic * (1.0 - part)
}

/// Beats at whole milliseconds, so that samples at 1 kHz contain the extremes.
fn beats_on_samples(rate_bpm: f64) -> Vec<f64> {
    beats(rate_bpm, 0.5..58.0).into_iter().map(|beat_s| (beat_s * 1e3).round() / 1e3).collect()
}

#[test]
fn pressures_of_cycles_from_r_waves_are_exact() {
    for rate_bpm in [50.0, 75.0, 110.0] {
        let beats_s = beats_on_samples(rate_bpm);
        let pulses = pulses(&beats_s);
        let recording = Recording { noise_mv: 0.02, ..Recording::default() };
        let cycles = r_waves(&recording.signal(recording.of(&beats_s))).unwrap().cycles();
        let wave = recording.signal(recording.times().map(|it| pressure(&pulses, it)).collect());
        let figures = BeatWise::new(&wave, &cycles).unwrap();
        assert_eq!(figures.beats, Beats::RWaves);
        let known = (figures.mean.present().count(), figures.mean.values().len());
        assert_eq!(known, (beats_s.len() - 1, beats_s.len() - 1));
        for (at, pulse) in pulses[..beats_s.len() - 1].iter().enumerate() {
            let found = [&figures.systolic, &figures.diastolic].map(|it| it.values()[at]);
            let expected = [pulse.systolic, pulse.diastolic];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-9, "{rate_bpm} {at}: {found} {expected}");
            }
            let span = (beats_s[at] * 1e3).round() as i32..(beats_s[at + 1] * 1e3).round() as i32;
            let count = f64::from(span.end - span.start);
            let mean = span.map(|it| pressure(&pulses, f64::from(it) / 1e3)).sum::<f64>() / count;
            // A beat that is off by one sample costs one sample of 500, up to 45 mmHg from the
            // mean.
            let found = figures.mean.values()[at];
            assert!((found - mean).abs() < 0.1, "{rate_bpm} {at}: {found} {mean}");
            let middle_s = 0.5 * (beats_s[at] + beats_s[at + 1]);
            assert!((figures.mean.time_s()[at] - middle_s).abs() < 1e-3);
        }
    }
}

#[test]
fn a_cycle_in_which_a_sample_is_missing_has_no_pressures() {
    let beats_s = [1.0, 1.8, 2.6, 3.4, 4.2, 5.0];
    let ecg = Recording { duration_s: 6.0, ..Recording::default() };
    let cycles = r_waves(&ecg.signal(ecg.of(&beats_s))).unwrap().cycles();
    assert_eq!(cycles.cycles.len(), 5);
    let mut samples: Vec<(f64, f64)> =
        (0..1200).map(|at| f64::from(at) / 200.0).map(|it| (it, 80.0 + it)).collect();
    samples[400].1 = f64::NAN; // 2 s
    samples.retain(|(time_s, _)| !(2.9..2.92).contains(time_s) && *time_s < 4.9);
    let (time_s, values) = samples.into_iter().unzip();
    let figures = BeatWise::new(&Signal::new(time_s, values).unwrap(), &cycles).unwrap();
    let known: Vec<bool> = figures.mean.values().iter().map(|it| !it.is_nan()).collect();
    assert_eq!(known, [true, false, false, true, false]);
}

#[test]
fn without_an_ecg_cycles_are_those_of_the_wave() {
    for rate_hz in [50.0, 100.0, 200.0, 1000.0] {
        for rate_bpm in [50.0, 75.0, 110.0, 150.0] {
            // At 150 per minute the next foot comes before the dicrotic wave.
            let beats_s = beats_on_samples(rate_bpm);
            let pulses = pulses(&beats_s);
            let recording = Recording { rate_hz, ..Recording::default() };
            let mut random = ChaCha8Rng::seed_from_u64(8);
            let noise = Normal::new(0.0, 0.5).unwrap();
            let wave: Vec<f64> = recording
                .times()
                .map(|it| pressure(&pulses, it) + noise.sample(&mut random))
                .collect();
            let cycles = pulse_cycles(&recording.signal(wave)).unwrap();
            assert_eq!(cycles.beats, Beats::PulseFeet);
            let feet_s: Vec<f64> = pulses[..pulses.len() - 1].iter().map(|it| it.foot_s).collect();
            let found_s: Vec<f64> = cycles
                .cycles
                .iter()
                .map(|it| it.start_s)
                .chain(cycles.cycles.last().map(|it| it.end_s))
                .collect();
            let (falsely, missed, worst_s) = compare(&found_s, &feet_s);
            assert_eq!((falsely, missed), (0, 0), "{rate_hz} Hz, {rate_bpm} bpm");
            // The wave falls to its foot at about 40 mmHg/s and rises from it as slowly: noise of
            // 0.5 mmHg, averaged over 40 ms, moves the foot by some hundredths of a second.
            assert!(worst_s < 0.04, "{rate_hz} Hz, {rate_bpm} bpm: {worst_s}");
        }
    }
    for rate_hz in [50.0, 200.0, 1000.0] {
        let noise = Recording { rate_hz, noise_mv: 1.0, ..Recording::default() };
        assert!(pulse_cycles(&noise.signal(noise.of(&[]))).unwrap().cycles.is_empty());
    }
    let flat = Recording { duration_s: 20.0, ..Recording::default() };
    for constant in [80.0, f64::NAN] {
        let wave = flat.signal(vec![constant; 20_000]);
        assert!(pulse_cycles(&wave).unwrap().cycles.is_empty());
    }
}
