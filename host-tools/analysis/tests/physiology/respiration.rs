//! CO2 at the end of each breath.

use plumbline_analysis::physiology::respiration::{
    Concentration, NoBarometricPressure, end_tidal_mmhg,
};
use plumbline_analysis::physiology::signal::{SamplingError, Signal};

/// Breaths of 4 s at 20 Hz: inspired gas, a rise, a plateau that rises by 2 to these values, and
/// inspired gas again.
fn capnogram(end_tidal: &[f64]) -> Signal {
    let breath = |end: &f64| {
        let end = *end;
        (0..80).map(move |sample| match sample {
            0..32 => 0.3,
            32..36 => end - 2.0 - (end - 2.3) * f64::from(36 - sample) / 5.0,
            36..77 => end - 2.0 * f64::from(76 - sample) / 40.0,
            _ => end * f64::from(79 - sample) / 4.0 + 0.3,
        })
    };
    let values: Vec<f64> = end_tidal.iter().flat_map(breath).collect();
    Signal::new((0..values.len()).map(|at| at as f64 / 20.0).collect(), values).unwrap()
}

#[test]
fn end_tidal_co2_is_the_end_of_each_exhalation() {
    // Half of the breaths are hyperventilation.
    let end_tidal: Vec<f64> =
        (0..30).map(|it| if it < 15 { 40.0 } else { 22.0 } + f64::from(it % 4)).collect();
    let found = end_tidal_mmhg(&capnogram(&end_tidal)).unwrap();
    assert_eq!(found.values().len(), 30);
    for (breath, (time_s, value)) in found.present().enumerate() {
        // Exactly the 77th of 80 samples.
        assert!((time_s - 4.0 * breath as f64 - 3.8).abs() < 1e-9, "{time_s}");
        assert_eq!(value, end_tidal[breath]);
    }
}

#[test]
fn a_concentration_becomes_a_partial_pressure_as_it_was_measured() {
    let percent = capnogram(&[5.0, 5.5]);
    let of = |concentration: Concentration| {
        let mmhg = concentration.mmhg()?;
        let values = percent.values().iter().map(|it| it * mmhg).collect();
        let co2_mmhg = Signal::new(percent.time_s().to_vec(), values).unwrap();
        Ok(end_tidal_mmhg(&co2_mmhg).unwrap().values().to_vec())
    };
    let near = |found: Vec<f64>, expected: [f64; 2]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        assert_eq!(found.len(), 2);
    };
    // 5 % of 760 - 47 mmHg, and of 760 mmHg.
    near(of(Concentration::PercentDry { barometric_mmhg: 760.0 }).unwrap(), [35.65, 39.215]);
    near(of(Concentration::PercentMoist { barometric_mmhg: 760.0 }).unwrap(), [38.0, 41.8]);
    for wrong in [101.3, 1013.0, 0.0, f64::NAN] {
        for unit in [
            Concentration::PercentDry { barometric_mmhg: wrong },
            Concentration::PercentMoist { barometric_mmhg: wrong },
        ] {
            assert!(matches!(of(unit), Err(NoBarometricPressure(_))), "{wrong}");
        }
    }
}

#[test]
fn exhalations_that_are_not_whole_are_no_breaths() {
    let whole = capnogram(&[40.0; 6]);
    let mut values = whole.values().to_vec();
    values[2 * 80 + 50] = f64::NAN; // in the third exhalation
    values[4 * 80 + 10] = 50.0; // a spike while inhaling
    values[5 * 80 + 40] = 60.0; // and one at the beginning of an exhalation
    let of = |range: std::ops::Range<usize>| {
        let part = Signal::new(whole.time_s()[range.clone()].to_vec(), values[range].to_vec());
        let end_tidal = end_tidal_mmhg(&part.unwrap()).unwrap();
        assert!(end_tidal.values().iter().all(|it| *it == 40.0), "{end_tidal:?}");
        end_tidal.time_s().to_vec()
    };
    let near = |found: &[f64], expected: &[f64]| {
        assert_eq!(found.len(), expected.len(), "{found:?}");
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
    };
    near(&of(0..480), &[3.8, 7.8, 15.8, 19.8, 23.8]);
    // Begins in an exhalation, and ends in one.
    near(&of(60..470), &[7.8, 15.8, 19.8]);
    // Nobody breathes.
    for constant in [0.3, f64::NAN] {
        let flat = Signal::new(whole.time_s().to_vec(), vec![constant; 480]).unwrap();
        assert!(end_tidal_mmhg(&flat).unwrap().values().is_empty());
    }
    let slow = Signal::new(vec![0.0, 1.0, 2.0], vec![0.0; 3]).unwrap();
    assert!(matches!(end_tidal_mmhg(&slow), Err(SamplingError::Rate { .. })));
}
