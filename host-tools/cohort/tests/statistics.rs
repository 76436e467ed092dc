//! The statistics of ten thousand short trials take ten times as long as those of a thousand.

use std::fs;

use plumbline_analysis::series::Series;
use plumbline_files::BadInput;
use plumbline_study::candidate::{Candidate, Measured};
use plumbline_study::figures::analyze_trials;
use plumbline_study::manifest::{self, Recordings};
use plumbline_trial::{Verdict, test_trial};

/// Were anything quadratic, it would be a hundred; the shared computer may add its part.
const GROWS_MAX: f64 = 16.0;

/// A person of whom two trials of half a minute at 10 Hz are made up, one under each condition.
struct MadeUp(usize);

impl Candidate for MadeUp {
    fn verdict(&self) -> Result<Option<(String, Verdict)>, BadInput> {
        Ok(None)
    }

    fn read(&self) -> Result<Measured, BadInput> {
        let time_s: Vec<f64> = (0..=300).map(|at| f64::from(at) / 10.0).collect();
        let phase = self.0 as f64;
        let along = |factor: f64| -> Vec<f64> {
            let at = |time_s: &f64| {
                (factor * time_s + phase).sin() + 0.3 * (7.0 * factor * time_s + 2.0 * phase).cos()
            };
            time_s.iter().map(at).collect()
        };
        let position_mm = [along(1.1), along(0.7), along(0.3)];
        let series = Series::new(time_s, position_mm).expect("times increase");
        let points = test_trial::points(&format!("made up {}", self.0), series);
        let condition = ["a", "b"][self.0 % 2].to_owned();
        let participant = Some(format!("P{:05}", self.0 / 2));
        Ok(Measured { points, participant, condition: Some(condition) })
    }

    fn recordings(&self) -> Option<&Recordings> {
        None
    }
}

/// Seconds of the processor that this program has taken.
fn busy_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    [11, 12].map(|at| fields[at].parse::<f64>().unwrap()).iter().sum::<f64>() / 100.0
}

#[test]
#[ignore = "takes a minute: `cargo xtask test cohort`"]
fn ten_times_the_trials_take_ten_times_as_long() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study.toml");
    let text = "title = \"t\"\ntrials = [\"t\"]\nconditions = [\"a\", \"b\"]\nfigures = \"all\"\n\
                bins_s = [[0, 10], [10, 20], [20, 30]]\ndrop_incomplete = true\n";
    fs::create_dir(folder.path().join("t")).unwrap();
    fs::write(folder.path().join("t/trial.toml"), "").unwrap();
    fs::write(&path, text).unwrap();
    let study = manifest::read(&path).unwrap();
    let seconds = [1000, 10_000].map(|trials| {
        let all: Vec<MadeUp> = (0..trials).map(MadeUp).collect();
        let begun_s = busy_s();
        let figures = analyze_trials(&study, &all, &|| ()).unwrap();
        assert_eq!(figures.participants.len(), trials / 2);
        assert!(figures.sway.len() > 40, "{}", figures.sway.len());
        let took_s = busy_s() - begun_s;
        println!("{trials} trials, {} responses: {took_s:.1} s", figures.sway.len());
        took_s
    });
    assert!(seconds[1] < GROWS_MAX * seconds[0], "{seconds:?}");
}
