//! The pages for R, MATLAB and Octave. Their languages are large: these tests run when they are asked
//! for, as the part `languages` of `cargo xtask test`, which installs them.

use std::fs;
use std::path::Path;
use std::process::Command;

use plumbline_test_support::{Absent, python, root, skip};
use serde_json::Value;

use crate::bench::Bench;
use crate::trials::{EVERYBODY, write_all};

const PAGES: &str = "host-tools/elsewhere";

/// The trials, what `plumb` writes of them, and what it says of the figure that the examples compare.
fn prepared() -> Option<(Bench, Compared)> {
    let bench = Bench::new()?;
    write_all(&bench);
    for format in ["csv", "parquet"] {
        let [trial, figures] = ["p01-foam", "figures"].map(|name| format!("{name}.{format}"));
        bench.plumb(&["export", "trials/p01-foam", "--format", format, "--out", &trial]);
        let bins = ["--bins", "0-10,10-20", "--out", &figures];
        bench.plumb(&[&["figures"], &EVERYBODY[..], &bins].concat());
    }
    bench.plumb(&["study", "study.toml", "--json", "study.json"]);
    let study: Value =
        serde_json::from_slice(&fs::read(bench.path("study.json")).unwrap()).unwrap();
    Some((bench, Compared::of(&study)))
}

/// What `plumb study` says.
struct Compared {
    means: Vec<(String, f64)>,
    t: f64,
    df: u64,
    p: f64,
}

impl Compared {
    fn of(study: &Value) -> Self {
        let is = |it: &Value, name: &str, text: &str| it[name] == text;
        let sway = study["sway"].as_array().unwrap().iter().find(|it| {
            is(it, "figure", "path length")
                && is(it, "direction", "APML")
                && is(it, "point", "upper")
        });
        let inference = &sway.unwrap()["inference"];
        let cells = inference["cells"].as_array().unwrap().iter();
        let cells = cells.filter(|it| it["levels"][1] == "T1");
        let mean = |cell: &Value| {
            let condition = cell["levels"][0].as_str().unwrap().to_owned();
            (condition, cell["raw"]["mean"].as_f64().unwrap())
        };
        let comparisons = inference["comparisons"].as_array().unwrap();
        let test = comparisons.iter().find(|it| is(it, "under", "T1")).unwrap()["t_test"].clone();
        Self {
            means: cells.map(mean).collect(),
            t: test["t"].as_f64().unwrap(),
            df: test["df"].as_u64().unwrap(),
            p: test["p"].as_f64().unwrap(),
        }
    }

    /// Checks what an example has printed, in as many digits as it prints.
    fn check(&self, printed: &str) {
        let is_near = |text: &str, value: f64| {
            let found: f64 = text.trim().parse().unwrap();
            assert!((found - value).abs() < 1e-9 * value.abs(), "{found}, {value}: {printed}");
        };
        let mut lines = printed.lines();
        // Those that never came, and those in which an arm hid the target.
        assert_eq!(lines.next(), Some("1800 frames, 25 without the lower trunk"));
        for (condition, mean_mm) in &self.means {
            let line = lines.next().unwrap();
            let (name, mean) = line.split_once(": ").unwrap();
            assert_eq!(name, condition);
            is_near(mean.trim_end_matches("mm"), *mean_mm);
        }
        let test = lines.next().unwrap().strip_prefix(&format!("t({}) = ", self.df)).unwrap();
        let (t, p) = test.split_once(", p = ").unwrap();
        is_near(t, self.t);
        is_near(p, self.p);
        assert_eq!(lines.next(), None);
    }
}

/// A picture with something in it.
fn check_picture(path: &Path) {
    let bytes = fs::read(path).unwrap();
    assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 10_000, "{} bytes", bytes.len());
}

fn is_here(program: &str) -> bool {
    let is_here = Command::new(program).arg("--version").output().is_ok();
    if !is_here {
        skip(Absent::Tool, &format!("{program} is not installed"));
    }
    is_here
}

#[test]
#[ignore = "needs R: cargo xtask test languages"]
fn r_reads_a_trial_and_the_figures_and_says_what_plumb_does() {
    if !is_here("Rscript") {
        return;
    }
    let Some((bench, compared)) = prepared() else { return };
    for format in ["csv", "parquet"] {
        let mut r = Command::new("Rscript");
        r.arg(root().join(PAGES).join("sway.R"));
        r.args([&format!("p01-foam.{format}"), &format!("figures.{format}"), "sway.png"]);
        r.env("RETICULATE_PYTHON", python().unwrap());
        compared.check(&bench.ran(r));
        check_picture(&bench.path("sway.png"));
        fs::remove_file(bench.path("sway.png")).unwrap();
    }
}

#[test]
#[ignore = "needs Octave: cargo xtask test languages"]
fn octave_reads_a_trial_and_the_figures_and_says_what_plumb_does() {
    if !is_here("octave-cli") {
        return;
    }
    let Some((bench, compared)) = prepared() else { return };
    fs::copy(root().join(PAGES).join("sway.m"), bench.path("sway.m")).unwrap();
    let mut octave = Command::new("octave-cli");
    // It warns that other toolkits, which need a screen, are preferred.
    octave.args(["--no-init-file", "--eval"]).arg(
        "warning('off', 'all'); graphics_toolkit('gnuplot'); \
         sway('p01-foam.csv', 'figures.csv', 'sway.png')",
    );
    compared.check(&bench.ran(octave));
    check_picture(&bench.path("sway.png"));
}
