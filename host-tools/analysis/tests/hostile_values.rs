//! Whatever the values, a statistic is either refused or finite: nothing panics, is infinite or
//! NaN.

use std::fmt::Debug;

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

/// Zeros of both signs, neighbouring numbers, values that underflow or overflow when squared,
/// infinities and NaN.
const VALUES: [f64; 11] =
    [0.0, -0.0, 1.0, 1.0 + f64::EPSILON, 3.0, 1e-308, -1e-160, 9e99, -9e99, 1e200, f64::NAN];

/// Asserts that the result is an error or finite; returns whether it was finite.
fn assert_sound<E>(result: &Result<impl Debug, E>, values: &[f64]) -> bool {
    let Ok(it) = result else { return false };
    let text = format!("{it:?}");
    assert!(!text.contains("NaN") && !text.contains("inf"), "{values:?}: {text}");
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
