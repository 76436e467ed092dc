//! Compared with scipy: see `generate.py`, which made `signal.csv` and `oracles.json`.

use plumbline_analysis::filter::{Butterworth, Design, SavitzkyGolay};
use plumbline_analysis::series::Series;
use plumbline_analysis::sway::diffusion::Plot;
use plumbline_analysis::sway::figure::Figure;
use plumbline_analysis::sway::{Settings, SwayFigures, analyze, density};
use serde_json::Value;

const RATE_HZ: f64 = 60.0;

fn oracles() -> Value {
    serde_json::from_str(include_str!("oracles.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect()
}

/// The signal along AP and ML, mm.
fn signal() -> [Vec<f64>; 2] {
    let mut reader = csv::Reader::from_reader(include_str!("signal.csv").as_bytes());
    reader.deserialize::<(f64, f64)>().map(Result::unwrap).unzip().into()
}

/// The figures of the unfiltered signal.
fn figures(radius_mm: f64) -> SwayFigures {
    let [ap, ml] = signal();
    let time_s = (0..ap.len()).map(|index| index as f64 / RATE_HZ).collect();
    let series = Series::new(time_s, [ap, ml, Vec::new()]).unwrap();
    let density = density::Settings { radius_mm };
    let settings = Settings { filter: Design::None, density, ..Default::default() };
    analyze(&series, None, &settings).unwrap().figures
}

/// Asserts and prints the worst relative difference.
fn compare<'a>(
    name: &str,
    figures: impl IntoIterator<Item = &'a Figure>,
    expected: &Value,
    bound: f64,
) {
    let values: Vec<f64> = figures.into_iter().map(|it| it.value().unwrap()).collect();
    let expected = numbers(expected);
    assert_eq!(values.len(), expected.len());
    let worst = values.iter().zip(&expected).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
    println!("{name}: {worst:.1e} relative");
    assert!(worst < bound, "{name}: {values:?} {expected:?}");
}

#[test]
fn the_filter_is_scipys_also_at_the_ends() {
    let [ap, _] = signal();
    for oracle in oracles()["savgol"].as_array().unwrap() {
        let window = oracle["window"].as_u64().unwrap() as usize;
        let smoothed = SavitzkyGolay::new(window).unwrap().smooth(&ap).unwrap();
        for (at, expected) in numbers(&oracle["at"]).iter().zip(numbers(&oracle["value"])) {
            let value = smoothed[*at as usize];
            // Rounding of numbers of about 10 mm; scipy's own weights are accurate to 1e-14.
            assert!((value - expected).abs() < 1e-12, "{window} {at}: {value} {expected}");
        }
        let path: f64 = smoothed.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        assert!((path / oracle["path"].as_f64().unwrap() - 1.0).abs() < 1e-11, "{path}");
    }
}

#[test]
fn butterworth_is_scipys_also_at_the_ends() {
    let [ap, _] = signal();
    let mut worst_mm: f64 = 0.0;
    let all = oracles()["butterworth"].clone();
    for oracle in all.as_array().unwrap() {
        let order = oracle["order"].as_u64().unwrap() as usize;
        let cutoff_hz = oracle["cutoff_hz"].as_f64().unwrap();
        let filter = Butterworth::new(cutoff_hz, order, RATE_HZ).unwrap();
        let smoothed = filter.smooth(&ap).unwrap();
        let expected = numbers(&oracle["at"]).into_iter().zip(numbers(&oracle["value"]));
        let whole = expected.map(|(at, expected)| smoothed[at as usize] - expected);
        let expected = numbers(&oracle["short"]);
        let short = filter.smooth(&ap[..expected.len()]).unwrap();
        let short = short.iter().zip(&expected).map(|(value, expected)| value - expected);
        worst_mm = whole.chain(short).fold(worst_mm, |worst, it| worst.max(it.abs()));
        let path: f64 = smoothed.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        assert!((path / oracle["path"].as_f64().unwrap() - 1.0).abs() < 1e-10, "{order} {path}");
        // One sample fewer has no neighbour to mirror.
        assert_eq!(filter.smooth(&ap[..expected.len() - 1]), None);
    }
    println!("Butterworth: {worst_mm:.1e} mm");
    assert!(worst_mm < 1e-10, "{worst_mm}");
}

#[test]
fn frequencies_are_those_of_scipys_spectrum() {
    let ap = figures(2.0).spectrum.axes.ap;
    let all = [&ap.mean_hz, &ap.centroidal_hz, &ap.median_hz, &ap.f95_hz];
    // The rate is computed from rounded times, to 1e-13 of a period.
    compare("spectrum", all, &oracles()["spectra"]["periodogram_mean"], 1e-11);
}

#[test]
fn sway_density_is_its_definition_with_scipys_filter_and_peaks() {
    let oracle = &oracles()["density"];
    let radius_mm = oracle["radius_mm"].as_f64().unwrap();
    let density = figures(radius_mm).density;
    let all = [&density.peak_s, &density.interval_s, &density.distance_mm];
    compare("sway density", all, &oracle["means"], 1e-11);
}

#[test]
fn diffusion_is_its_definition() {
    let oracle = &oracles()["diffusion"];
    let diffusion = figures(2.0).diffusion;
    for (name, plot, at_bound) in [
        ("ap", &diffusion.axes.ap, false),
        ("ml", &diffusion.axes.ml, true),
        ("transverse", &diffusion.transverse, false),
    ] {
        let Plot { short_mm2_s, long_mm2_s, critical_s, critical_mm2, .. } = plot;
        let Plot { hurst_short, hurst_long, split_s, .. } = plot;
        let lines = [short_mm2_s, long_mm2_s, critical_s, critical_mm2];
        let all = lines.into_iter().chain([hurst_short, hurst_long, split_s]);
        // Rounding of the sums of squares, which the fits of slopes amplify.
        compare(name, all, &oracle[name], 1e-9);
        assert_eq!(plot.split_at_bound, at_bound, "{name}");
    }
}
