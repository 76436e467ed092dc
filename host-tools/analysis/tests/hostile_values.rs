//! Whatever the values, a statistic or a figure is either refused or finite: nothing panics, is
//! infinite or NaN.

use std::fmt::Debug;

use nalgebra::Matrix3;
use plumbline_analysis::agreement::agreement;
use plumbline_analysis::agreement::lag::lag;
use plumbline_analysis::agreement::pairs::Paired;
use plumbline_analysis::filter::Design;
use plumbline_analysis::onset::stand_onset_s;
use plumbline_analysis::series::{Axis, Series};
use plumbline_analysis::statistics::anova::anova;
use plumbline_analysis::statistics::bland_altman::bland_altman;
use plumbline_analysis::statistics::describe::{
    Description, cohens_d, cohens_d_z, cousineau_morey,
};
use plumbline_analysis::statistics::paired::{Family, paired_t};
use plumbline_analysis::statistics::ranks::rank_analysis;
use plumbline_analysis::statistics::regression::line;
use plumbline_analysis::statistics::shapiro_wilk::shapiro_wilk;
use plumbline_analysis::statistics::within::{Observation, WithinDesign};
use plumbline_analysis::sway::noise::Noise;
use plumbline_analysis::sway::spectrum::power_density;
use plumbline_analysis::sway::{Settings, analyze};

/// Zeros of both signs, neighbouring numbers, values that underflow or overflow when squared,
/// infinities and NaN.
const VALUES: [f64; 11] =
    [0.0, -0.0, 1.0, 1.0 + f64::EPSILON, 3.0, 1e-308, -1e-160, 9e99, -9e99, 1e200, f64::NAN];

/// Asserts that the result is an error or finite; returns whether it was finite.
fn assert_sound<E>(result: &Result<impl Debug, E>, values: &[f64]) -> bool {
    let Ok(it) = result else { return false };
    let text = format!("{it:?}");
    let mut words = text.split(|it: char| !it.is_alphanumeric());
    assert!(!words.any(|it| ["NaN", "inf"].contains(&it)), "{values:?}: {text}");
    true
}

/// Every 59th of all sequences of six of the values: 59 does not divide their number, so every
/// value occurs at every position.
fn sequences() -> impl Iterator<Item = [f64; 6]> {
    let count = VALUES.len();
    (0..count.pow(6)).step_by(59).map(move |index| {
        let mut rest = index;
        [0; 6].map(|_| {
            let value = VALUES[rest % count];
            rest /= count;
            value
        })
    })
}

#[test]
fn statistics_of_pairs() {
    let family = Family { name: "one".to_owned(), tests: 2 };
    let mut sound = [0; 6];
    for values in sequences() {
        let (x, y) = values.split_at(3);
        let (from, to) = (Description::new(x), Description::new(y));
        let d = from.clone().and_then(|from| cohens_d(&from, &to?));
        let results = [
            assert_sound(&from, &values),
            assert_sound(&d, &values),
            assert_sound(&cohens_d_z(x, y), &values),
            assert_sound(&paired_t(x, y, &family), &values),
            assert_sound(&line(x, y, 3.0), &values),
            assert_sound(&shapiro_wilk(&values), &values),
        ];
        for (sound, result) in sound.iter_mut().zip(results) {
            *sound += u32::from(result);
        }
    }
    // Most sequences contain a value that is refused; many of the others are computed.
    assert!(sound.iter().all(|&count| count > 1000), "{sound:?}");
}

#[test]
fn limits_of_agreement() {
    // The exact intervals take some time.
    let mut sound = 0;
    for values in sequences().step_by(50) {
        let (x, y) = values.split_at(3);
        sound += u32::from(assert_sound(&bland_altman(x, y, 2.5), &values));
    }
    assert!(sound > 50, "{sound}");
}

#[test]
fn statistics_of_tables() {
    let mut sound = [0; 3];
    for values in sequences() {
        // Three subjects, two cells; two subjects, three cells.
        for (subjects, cells) in [(["A", "B", "C"].as_slice(), 2), (&["A", "B"], 3)] {
            let levels = ["1", "2", "3"];
            let rows: Vec<Observation<'_>> = values
                .iter()
                .enumerate()
                .map(|(at, &value)| Observation {
                    subject: subjects[at / cells],
                    levels: vec![levels[at % cells]],
                    value,
                })
                .collect();
            let Ok(table) = WithinDesign::new(&["time"], &rows) else { continue };
            let results = [
                assert_sound(&cousineau_morey(&table), &values),
                assert_sound(&anova(&table), &values),
                assert_sound(&rank_analysis(&table), &values),
            ];
            for (sound, result) in sound.iter_mut().zip(results) {
                *sound += u32::from(result);
            }
        }
    }
    assert!(sound.iter().all(|&count| count > 1000), "{sound:?}");
}

/// Sequences of times, seconds: usual ones, and rates and durations that nothing has.
fn times() -> Vec<Vec<f64>> {
    let evenly = |samples: u32, period_s: f64| -> Vec<f64> {
        (0..samples).map(|at| f64::from(at) * period_s).collect()
    };
    let mut pause = evenly(640, 1.0 / 60.0);
    pause.extend((0..100).map(|at| 1e12 + f64::from(at)));
    vec![
        Vec::new(),
        evenly(1, 1.0),
        evenly(2, 1.0 / 60.0),
        evenly(3, 1.0 / 60.0),
        evenly(640, 1.0 / 60.0),
        evenly(20, 1e-160),
        evenly(20, 1e-300),
        evenly(20, 1e160),
        evenly(20, 1e300),
        vec![0.0; 20],
        vec![-f64::MAX, 0.0, f64::MAX],
        vec![0.0, f64::MIN_POSITIVE, 1.0, f64::MAX],
        vec![0.0, 1.0, f64::NAN],
        vec![0.0, 1.0, f64::INFINITY],
        pause,
    ]
}

/// Positions of a number of samples, mm.
fn positions(samples: usize) -> Vec<Vec<f64>> {
    let wave = |size: f64| -> Vec<f64> {
        (0..samples).map(|at| size * (0.37 * at as f64).sin() + 0.1 * size).collect()
    };
    let sizes = [0.0, 1.0, 1e-160, 1e-320, 1e100, 1e160, 1e300, f64::MAX];
    let mut all: Vec<Vec<f64>> = sizes.map(wave).into();
    all.push(vec![5.0; samples]);
    all.push(vec![f64::MAX; samples]);
    // One wrong value among good ones, and hostile values in turn.
    for wrong in [1e160, -1e300, f64::MAX, f64::NAN, f64::NEG_INFINITY] {
        let mut one = wave(1.0);
        one.iter_mut().skip(samples / 2).take(1).for_each(|it| *it = wrong);
        all.push(one);
    }
    all.push((0..samples).map(|at| VALUES[at % 10]).collect());
    all.push((0..samples).map(|at| if at % 2 == 0 { f64::MAX } else { f64::MIN }).collect());
    all
}

/// Each of the positions over each of the times.
fn series() -> Vec<Series> {
    let of = |time_s: Vec<f64>| {
        positions(time_s.len()).into_iter().filter_map(move |values| {
            let axes = [values.clone(), values.iter().rev().copied().collect(), values];
            Series::new(time_s.clone(), axes).ok()
        })
    };
    times().into_iter().flat_map(of).collect()
}

#[test]
fn figures_of_a_trial() {
    let mut sound = 0;
    let all = series();
    for series in &all {
        let covariances = vec![Matrix3::from_diagonal_element(1e-4); series.samples()];
        // The noisy copies of long series take long.
        let noise =
            (series.samples() <= 20).then(|| Noise::per_sample(series, &covariances).unwrap());
        let all = None;
        let open = Some(0.0..f64::INFINITY);
        for (filter, span_s) in [
            (Design::None, all.clone()),
            (Design::None, Some(-1e300..1e300)),
            (Design::PAPER, open.clone()),
            (Design::Butterworth { cutoff_hz: 5.0, order: 2 }, open),
            (Design::SavitzkyGolay { window_s: f64::MAX }, all.clone()),
            (Design::Butterworth { cutoff_hz: 1e-300, order: 8 }, all),
        ] {
            let settings = Settings { filter, span_s, ..Default::default() };
            let figures = analyze(series, noise.as_ref(), &settings);
            sound += u32::from(assert_sound(&figures, series.along(Axis::Ap).unwrap()));
        }
        let onset = stand_onset_s(series).ok_or(());
        assert_sound(&onset, series.time_s());
        for part_s in [1e-300, 20.0, 1e300] {
            // Drawn on a logarithmic scale, on which only a finite density has a place.
            let _ = power_density(series, Axis::Ap, part_s);
        }
    }
    assert!(all.len() > 80 && sound > 150, "{} {sound}", all.len());
}

#[test]
fn agreement_of_a_trial_with_a_reference() {
    let all = series();
    // Among them a constant, a usual one, huge ones, and one with a wrong value.
    let usual = all.iter().filter(|it| it.samples() == 640).step_by(3);
    let usual: Vec<&Series> = usual.collect();
    let mut sound = [0; 2];
    for one in &all {
        for other in usual.iter().copied().chain([one]) {
            for (measured, reference) in [(one, other), (other, one)] {
                let values = measured.along(Axis::Ap).unwrap();
                let found = lag(measured, reference, 10.0);
                sound[0] += u32::from(assert_sound(&found, values));
                let lag_s = found.map_or(0.0, |it| it.lag_s);
                let Ok(paired) = Paired::new(measured, reference, lag_s, true) else { continue };
                sound[1] += u32::from(assert_sound(&agreement(&[paired]), values));
            }
        }
    }
    assert!(sound.iter().all(|&count| count > 20), "{sound:?}");
}
