//! Compared with NeuroKit: see `generate.py`, which made the ECGs and `oracles.json`.

use plumbline_analysis::physiology::cycles::Verdict;
use plumbline_analysis::physiology::ecg::r_waves;
use plumbline_analysis::physiology::signal::Signal;
use serde_json::Value;

#[test]
fn r_waves_are_those_of_neurokit() {
    let oracles: Value = serde_json::from_str(include_str!("oracles.json")).unwrap();
    let ecgs = oracles["ecgs"].as_array().unwrap();
    for (oracle, ecg) in ecgs.iter().zip([include_str!("rest.csv"), include_str!("standing.csv")]) {
        let rate_hz = oracle["rate_hz"].as_f64().unwrap();
        let mut reader = csv::Reader::from_reader(ecg.as_bytes());
        let values: Vec<f64> = reader.deserialize().map(Result::unwrap).collect();
        let times = (0..values.len()).map(|at| at as f64 / rate_hz).collect();
        let waves = r_waves(&Signal::new(times, values).unwrap()).unwrap();
        let expected: Vec<f64> =
            oracle["r_samples"].as_array().unwrap().iter().map(|it| it.as_f64().unwrap()).collect();
        let found: Vec<f64> = waves.time_s().map(|time_s| time_s * rate_hz).collect();
        let differences: Vec<f64> = found.iter().zip(&expected).map(|(a, b)| a - b).collect();
        println!("{}: {differences:.2?}", oracle["name"]);
        assert_eq!(found.len(), expected.len(), "{found:.1?} {expected:?}");
        // NeuroKit's peaks are whole samples of a differently filtered signal.
        assert!(differences.iter().all(|it| it.abs() < 1.5), "{differences:.2?}");
        let cycles = waves.cycles();
        assert_eq!(cycles.count(Verdict::Normal), found.len() - 1);
    }
}
