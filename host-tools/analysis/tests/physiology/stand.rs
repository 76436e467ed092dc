//! A person gets up: the means over the paper's windows.

use plumbline_analysis::physiology::bins::{Event, GAP_MAX_S, Seconds, Window, window_means};
use plumbline_analysis::physiology::cardiac_output::cardiac_output_l_min;
use plumbline_analysis::physiology::cycles::Verdict;
use plumbline_analysis::physiology::ecg::r_waves;
use plumbline_analysis::physiology::signal::Signal;

use super::heart::Recording;

/// Baseline, and the first 10 s of early, mid and late stance.
fn windows_of_the_paper() -> [Window; 4] {
    let window = |name: &str, from, span_s| Window { name: name.to_owned(), from, span_s };
    [
        window("baseline", Event::Transition, -45.0..-15.0),
        window("early", Event::Stance, 0.0..10.0),
        window("mid", Event::Stance, 20.0..30.0),
        window("late", Event::Stance, 40.0..50.0),
    ]
}

#[test]
fn a_stand_comes_out_as_it_was_made() {
    // The paper's control: 63.1 per minute supine, 92.8 in the first 10 s of stance, 70.2 in the
    // middle. The person begins to rise at 100 s of the recording and stands at 104 s.
    const RATES: [(f64, f64); 6] =
        [(0.0, 63.1), (100.0, 63.1), (104.0, 92.8), (114.0, 92.8), (122.0, 70.2), (165.0, 70.2)];
    let rate_bpm =
        Signal::new(RATES.map(|it| it.0).to_vec(), RATES.map(|it| it.1).to_vec()).unwrap();
    let next = |beat_s: &f64| Some(beat_s + 60.0 / rate_bpm.at(*beat_s, 200.0)?);
    let beats_s: Vec<f64> =
        std::iter::successors(Some(0.5), next).take_while(|it| *it < 159.0).collect();
    let recording =
        Recording { rate_hz: 500.0, duration_s: 160.0, noise_mv: 0.02, ..Recording::default() };
    let cycles = r_waves(&recording.signal(recording.of(&beats_s))).unwrap().cycles();
    assert_eq!(cycles.count(Verdict::Normal), beats_s.len() - 1);

    let windows = windows_of_the_paper();
    let means = |signal: &Signal| {
        let seconds = Seconds::interpolated(signal, 104.0, -60..60, GAP_MAX_S);
        window_means(&seconds, &windows, -4.0, 0.8)
    };
    let volume = Signal::new(beats_s.clone(), vec![80.0; beats_s.len()]).unwrap();
    let rates = means(&cycles.heart_rate_bpm());
    let outputs = means(&cardiac_output_l_min(&cycles, &volume));
    let expected = [63.1, 92.8, 70.2, 70.2];
    for ((rate, output), expected) in rates.iter().zip(&outputs).zip(expected) {
        assert_eq!((rate.known, output.known), (rate.seconds, output.seconds));
        let (rate, output) = (rate.mean.unwrap(), output.mean.unwrap());
        // The cycles at the ends of the early part reach into the changes around it: half a cycle
        // of a rate that rises by 30 in 4 s, in one second out of ten.
        let bound = if expected == 92.8 { 0.005 } else { 1e-4 };
        assert!((rate / expected - 1.0).abs() < bound, "{rate} {expected}");
        assert!((output / rate / 0.08 - 1.0).abs() < 1e-9, "{output} {rate}");
    }
}
