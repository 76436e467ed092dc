//! R waves.

use plumbline_analysis::physiology::cycles::{Cycle, Verdict};
use plumbline_analysis::physiology::ecg::r_waves;
use plumbline_analysis::physiology::signal::{SamplingError, Signal};

use super::heart::{Recording, beats, compare};

/// The worst error of the R waves, seconds; asserts that all of them and nothing else were found.
fn worst_s(recording: &Recording, beats_s: &[f64]) -> f64 {
    let found = r_waves(&recording.signal(recording.of(beats_s))).unwrap();
    assert_eq!(found.downwards, recording.gain < 0.0);
    let found_s: Vec<f64> = found.time_s().collect();
    let (falsely, missed, worst_s) = compare(&found_s, beats_s);
    let rate_hz = recording.rate_hz;
    assert_eq!((falsely, missed), (0, 0), "of {} beats at {rate_hz} Hz", beats_s.len());
    worst_s
}

const RATES_HZ: [f64; 7] = [100.0, 125.0, 250.0, 360.0, 500.0, 1000.0, 2000.0];
const RATES_BPM: [f64; 6] = [40.0, 60.0, 75.0, 100.0, 140.0, 180.0];

/// Rates at which a beat comes too late to be taken for the T wave of a far larger one, or to be
/// hidden by it.
const SLOWER_BPM: [f64; 4] = [40.0, 60.0, 75.0, 100.0];

#[test]
fn every_beat_is_found_and_timed_between_the_samples() {
    for rate_hz in RATES_HZ {
        for rate_bpm in RATES_BPM {
            let recording = Recording { rate_hz, ..Recording::default() };
            let worst_s = worst_s(&recording, &beats(rate_bpm, 0.4..59.5));
            // Below 250 Hz, a parabola through three samples is wider than the peak, which lasts 10
            // ms; from 140 per minute on, the T wave runs into the next beat and tilts it.
            let bound_s = match rate_bpm {
                _ if rate_hz < 250.0 => 1e-3,
                ..140.0 => 5e-5,
                _ => 5e-4,
            };
            assert!(worst_s < bound_s, "{rate_hz} Hz, {rate_bpm} bpm: {worst_s}");
        }
    }
}

#[test]
fn every_beat_is_found_in_a_poor_ecg() {
    let clean = Recording::default();
    let poor = Recording { wander_mv: 1.0, noise_mv: 0.05, mains_mv: 0.05, ..clean };
    for rate_hz in RATES_HZ {
        for rate_bpm in RATES_BPM {
            let beats_s = beats(rate_bpm, 0.4..59.5);
            let of = |it: Recording| worst_s(&Recording { rate_hz, ..it }, &beats_s);
            // At 1 kHz the noise alone moves a peak by 0.2 ms (one sigma, 21 samples), the mains
            // hum by up to 0.9 ms; below 250 Hz nothing is smoothed.
            let (noisy_s, poor_s) = if rate_hz < 1000.0 { (3.0e-3, 4e-3) } else { (2.0e-3, 3e-3) };
            let noisy = of(Recording { noise_mv: 0.05, ..clean });
            assert!(noisy < noisy_s, "{rate_hz} Hz, {rate_bpm} bpm: {noisy}");
            let upright = of(poor);
            assert!(upright < poor_s, "{rate_hz} Hz, {rate_bpm} bpm: {upright}");
            // Inverted, in other units and with an offset, the result is the same.
            let inverted = of(Recording { gain: -1e3, offset_mv: 10.0, ..poor });
            assert!((inverted - upright).abs() < 1e-9, "{inverted} {upright}");
        }
    }
}

#[test]
fn amplitudes_may_change() {
    let clean = Recording { noise_mv: 0.01, ..Recording::default() };
    for rate_hz in [250.0, 1000.0] {
        for rate_bpm in SLOWER_BPM {
            let beats_s = beats(rate_bpm, 0.4..59.5);
            for amplitude in [
                |time_s| 1.0 - time_s / 80.0,
                // An electrode that comes off and is pressed on again.
                |time_s| if time_s < 30.0 { 1.0 } else { 0.2 },
                |time_s| if time_s < 30.0 { 0.1 } else { 1.0 },
            ] {
                let worst_s = worst_s(&Recording { rate_hz, amplitude, ..clean }, &beats_s);
                // Relative to the amplitude, ten times the noise, for a peak 10 ms wide.
                assert!(worst_s < 4e-3, "{rate_hz} Hz, {rate_bpm} bpm: {worst_s}");
            }
        }
    }
}

#[test]
fn an_amplitude_that_falls_to_a_twentieth_loses_no_beat() {
    // Too small for the search for an overdue beat: levels are learned again.
    let amplitude = |time_s| if time_s < 30.0 { 1.0 } else { 0.05 };
    for rate_hz in [250.0, 1000.0] {
        for rate_bpm in SLOWER_BPM {
            let recording =
                Recording { rate_hz, amplitude, noise_mv: 0.001, ..Recording::default() };
            worst_s(&recording, &beats(rate_bpm, 0.4..59.5));
        }
    }
}

#[test]
fn ectopic_beats_are_found_and_their_intervals_left_out() {
    let recording = Recording { noise_mv: 0.02, wander_mv: 0.3, ..Recording::default() };
    let mut beats_s = beats(70.0, 0.5..59.5);
    // Each comes at 60 % of its interval; the next beat comes when it would have come anyway.
    let ectopic = [10, 25, 40, 52];
    for index in ectopic {
        beats_s[index] -= 0.4 * (beats_s[index] - beats_s[index - 1]);
    }
    let ecg = recording.signal(recording.with_ectopic(&beats_s, &ectopic));
    let cycles = r_waves(&ecg).unwrap().cycles();
    let (falsely, missed, _) =
        compare(&cycles.cycles.iter().map(|it| it.start_s).collect::<Vec<_>>(), &beats_s);
    assert_eq!((falsely, missed), (0, 1), "the last beat begins no cycle");
    for (index, cycle) in cycles.cycles.iter().enumerate() {
        let expected = match index {
            _ if ectopic.contains(&(index + 1)) => Verdict::Short,
            _ if ectopic.contains(&index) => Verdict::Long,
            _ => Verdict::Normal,
        };
        assert_eq!(cycle.verdict, expected, "{cycle:?}");
    }
    let rate = cycles.heart_rate_bpm();
    assert_eq!(rate.present().count(), beats_s.len() - 1 - 2 * ectopic.len());
    for ((_, rate_bpm), pair) in rate.values().iter().enumerate().zip(beats_s.windows(2)) {
        let expected = 60.0 / (pair[1] - pair[0]);
        // Two peaks, each off by at most 0.5 ms, change an interval of 0.77 s by 0.13 %.
        let error = (rate_bpm / expected - 1.0).abs();
        assert!(rate_bpm.is_nan() || error < 1.3e-3, "{rate_bpm} {expected}");
    }
}

#[test]
fn a_gap_is_a_cycle_without_a_rate_and_the_rest_stays() {
    let recording = Recording { noise_mv: 0.02, ..Recording::default() };
    let beats_s = beats(70.0, 0.5..59.5);
    let mut ecg = recording.of(&beats_s);
    // Missing values, and missing samples.
    ecg[20_000..23_000].fill(f64::NAN);
    let samples = recording.times().zip(ecg).filter(|(time_s, _)| !(40.0..41.5).contains(time_s));
    let (time_s, ecg) = samples.unzip();
    let cycles = r_waves(&Signal::new(time_s, ecg).unwrap()).unwrap().cycles();
    let across: Vec<&Cycle> =
        cycles.cycles.iter().filter(|it| it.verdict == Verdict::Gap).collect();
    assert_eq!((across.len(), cycles.count(Verdict::Normal)), (2, cycles.cycles.len() - 2));
    for (cycle, gap_s) in across.iter().zip([20.0..23.0, 40.0..41.5]) {
        assert!(cycle.start_s < gap_s.start && cycle.end_s > gap_s.end, "{cycle:?}");
        // No beat is lost except those within 0.1 s of the gap, whose waves are cut.
        let lost =
            beats_s.iter().filter(|it| (cycle.start_s + 0.01..cycle.end_s - 0.01).contains(*it));
        for beat_s in lost {
            assert!((gap_s.start - 0.11..gap_s.end + 0.11).contains(beat_s), "{beat_s}");
        }
    }
}

#[test]
fn where_there_is_no_beat_none_is_found() {
    let found = |rate_hz: f64, values: Vec<f64>| {
        let times = (0..values.len()).map(|at| at as f64 / rate_hz).collect();
        r_waves(&Signal::new(times, values).unwrap()).map(|it| it.time_s().count())
    };
    for rate_hz in [100.0, 250.0, 1000.0] {
        let recording = Recording { rate_hz, ..Recording::default() };
        let length = (60.0 * rate_hz) as usize;
        for constant in [0.0, 0.1, f64::NAN] {
            assert_eq!(found(rate_hz, vec![constant; length]), Ok(0), "{constant}");
        }
        // Electrodes that are off: noise of any size, mains hum, wander.
        for noise_mv in [1e-6, 0.01, 1.0] {
            assert_eq!(found(rate_hz, Recording { noise_mv, ..recording }.of(&[])), Ok(0));
        }
        let wander = Recording { wander_mv: 1.0, offset_mv: 0.1, ..recording };
        assert_eq!(found(rate_hz, wander.of(&[])), Ok(0));
    }
    let mains = Recording { mains_mv: 1.0, ..Recording::default() };
    assert_eq!(found(1000.0, mains.of(&[])), Ok(0));
    // One beat does not make an interval.
    let one = Recording { noise_mv: 0.01, duration_s: 3.0, ..Recording::default() };
    let waves = r_waves(&one.signal(one.of(&[1.5]))).unwrap();
    assert_eq!((waves.time_s().count(), waves.cycles().cycles.len()), (1, 0));
    // Too short to contain one.
    assert_eq!(found(1000.0, one.of(&[0.5])[..900].to_vec()), Ok(0));
}

#[test]
fn rates_that_are_none_are_refused() {
    let result = |rate_hz: f64| {
        let times = (0..1000).map(|at| f64::from(at) / rate_hz).collect();
        r_waves(&Signal::new(times, vec![0.0; 1000]).unwrap()).map(|_| ())
    };
    assert_eq!((result(100.0), result(20_000.0)), (Ok(()), Ok(())));
    // Milliseconds taken for seconds, and vice versa.
    for rate_hz in [1.0, 50.0, 1e6] {
        assert!(matches!(result(rate_hz), Err(SamplingError::Rate { .. })), "{rate_hz}");
    }
    let empty = Signal::new(Vec::new(), Vec::new()).unwrap();
    assert_eq!(r_waves(&empty).map(|_| ()), Err(SamplingError::TooFew));
}

#[test]
fn tall_t_waves_are_no_beats() {
    for rate_hz in [125.0, 250.0, 1000.0] {
        for rate_bpm in RATES_BPM {
            // Flat, nearly as high as the R wave, higher, and inverted.
            for t_wave in [0.0, 3.0, 5.0, -3.0] {
                let recording =
                    Recording { rate_hz, t_wave, noise_mv: 0.02, ..Recording::default() };
                worst_s(&recording, &beats(rate_bpm, 0.4..59.5));
            }
        }
    }
}

#[test]
fn muscle_noise_gives_no_false_rate() {
    // Noise of half the R wave (one sigma) for 4 s, as when a person gets up.
    let quiet = Recording { noise_mv: 0.02, ..Recording::default() };
    let loud = Recording { noise_mv: 0.5, ..quiet };
    let beats_s = beats(70.0, 0.4..59.5);
    let mut ecg = quiet.of(&beats_s);
    ecg[30_000..34_000].copy_from_slice(&loud.of(&beats_s)[30_000..34_000]);
    let cycles = r_waves(&quiet.signal(ecg)).unwrap().cycles();
    assert_eq!(cycles.count(Verdict::Normal), beats_s.len() - 1);
    for (time_s, rate_bpm) in cycles.heart_rate_bpm().present() {
        let next = beats_s.partition_point(|it| *it < time_s);
        let expected = 60.0 / (beats_s[next] - beats_s[next - 1]);
        // The noise moves peaks by 5 ms, in intervals of 770 ms.
        let bound = if (29.0..35.0).contains(&time_s) { 0.013 } else { 0.0015 };
        assert!((rate_bpm / expected - 1.0).abs() < bound, "{time_s}: {rate_bpm} {expected}");
    }
}
