//! Twelve participants under two conditions, from trials to statistics and to a table of all their
//! figures.

use std::collections::HashMap;
use std::path::Path;

use plumbline_trial::Manifest;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::finished::{Finished, plumb};
use crate::common::trial::{self, Frame};

const PARTICIPANTS: u64 = 12;
const CONDITIONS: [&str; 2] = ["calm", "wild"];

const RATE_HZ: u32 = 50;
const SECONDS: u32 = 30;

/// From the lower to the upper trunk.
const ABOVE_MM: f64 = 400.0;

/// Of all figures of a trunk with three times: path length and mean velocity in six directions,
/// for each time and the whole; RMS in six; the range along three axes; four figures of an
/// ellipse in three planes; four frequencies along three axes; three of sway density; seven of
/// diffusion along three axes and in a plane.
const ROWS_OF_TRUNK: usize = 2 * 6 * 4 + 6 + 3 + 4 * 3 + 4 * 3 + 3 + 7 * 4;

/// A trial whose points are pulled back to where they stand and pushed at random, as sway is.
pub fn record(folder: &Path, participant: &str, condition: &str, seconds: u32, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let push_mm = if condition == "wild" { 1.5 } else { 1.0 };
    let mut now_mm = [[0.0; 3]; 2];
    let frame = |at: u32| {
        for axis in now_mm.iter_mut().flatten() {
            let random: f64 = StandardNormal.sample(&mut random);
            *axis = 0.98 * *axis + push_mm * random;
        }
        let [lower_mm, [ap_mm, ml_mm, si_mm]] = now_mm;
        Frame {
            sequence: at,
            time_s: f64::from(at) / f64::from(RATE_HZ),
            lower_mm: Some(lower_mm),
            upper_mm: Some([ap_mm, ml_mm, si_mm + ABOVE_MM]),
        }
    };
    let frames: Vec<Frame> = (0..=seconds * RATE_HZ).map(frame).collect();
    trial::write(folder, &frames, &[(0.0, "zero")]);
    let manifest = Manifest::read(folder).unwrap();
    let (participant, condition) = (Some(participant.to_owned()), Some(condition.to_owned()));
    Manifest { participant, condition, ..manifest }.write(folder).unwrap();
}

/// The trials in `trials`, and beside them what is none.
pub fn setting() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let trials = folder.path().join("trials");
    std::fs::create_dir_all(trials.join("notes")).unwrap();
    std::fs::write(trials.join("readme.txt"), "").unwrap();
    for participant in 1..=PARTICIPANTS {
        for (condition, seed) in CONDITIONS.into_iter().zip(2 * participant..) {
            let path = trials.join(format!("p{participant:02}-{condition}"));
            record(&path, &format!("P{participant:02}"), condition, SECONDS, seed);
        }
    }
    folder
}

pub const STUDY: &str = "title = \"Cohort\"\ntrials = [\"trials/*\"]\nconditions = [\"calm\", \"wild\"]\n\
                     bins_s = [[0, 10], [10, 20], [20, 30]]\n";

fn study(folder: &TempDir, more: &str) -> Finished {
    std::fs::write(folder.path().join("study.toml"), format!("{STUDY}{more}")).unwrap();
    plumb(folder.path(), &["study", "study.toml", "--json", "study.json", "--force"])
}

pub fn json(folder: &TempDir, name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(folder.path().join(name)).unwrap()).unwrap()
}

#[test]
fn all_figures_of_all_trials_are_compared_and_each_says_how_many_are_in_it() {
    let folder = setting();
    let finished = study(&folder, "figures = \"all\"\ndrop_incomplete = true\n");
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stderr.contains("trials/notes: there is no trial in"), "{}", finished.stderr);
    for part in [
        "Cohort: 12 participants",
        "n = 12 of 12 participants",
        "Total path length (mm)",
        "Mean velocity (mm/s)",
        "From 0 to 30 s",
        "RMS (mm) AP",
        "p Holm",
        "adjusted for the",
    ] {
        assert!(finished.stdout.contains(part), "no {part}: {}", finished.stdout);
    }
    let found = json(&folder, "study.json");
    assert_eq!(found["participants"].as_array().unwrap().len(), 12);
    let sway = found["sway"].as_array().unwrap();
    // All figures but the ellipses' angles, of two trunks, by time in one response.
    let not_compared = found["not_compared"].as_array().unwrap();
    let figures = ROWS_OF_TRUNK - 3 * 2 * 6 - 3;
    assert_eq!(sway.len() + not_compared.len(), 2 * figures);
    for it in sway {
        let (n, left_out) = (&it["n"], it["left_out"].as_array().unwrap());
        assert_eq!(n.as_u64().unwrap() + left_out.len() as u64, PARTICIPANTS, "{it}");
        assert_eq!(
            n.as_u64().unwrap(),
            it["inference"]["subjects"].as_array().unwrap().len() as u64
        );
        let of_condition = &it["adjusted"][0];
        assert_eq!(of_condition["effect"], "condition");
        let p = |name: &str| of_condition[name].as_f64().unwrap();
        assert!(p("p") <= p("p_benjamini_hochberg"), "{it}");
        assert!(p("p_benjamini_hochberg") <= p("p_holm"), "{it}");
        let of_response = |other: &&Value| other["adjusted"][0]["effect"] == "condition";
        let tests = sway.iter().filter(of_response).count();
        assert_eq!(of_condition["tests"].as_u64().unwrap() as usize, tests);
    }
    // What cannot fail to be known: who is wild sways more, half as far again.
    for it in sway.iter().filter(|it| it["figure"] == "RMS" || it["figure"] == "path length") {
        assert_eq!(it["n"].as_u64().unwrap(), PARTICIPANTS);
        assert!(it["adjusted"][0]["p_holm"].as_f64().unwrap() < 0.01, "{it}");
    }
}

#[test]
fn the_table_has_every_figure_as_analyze_has_it() {
    let folder = setting();
    let list = std::fs::read_dir(folder.path().join("trials")).unwrap();
    let mut trials: Vec<String> =
        list.map(|it| format!("trials/{}", it.unwrap().file_name().display())).collect();
    trials.retain(|it| it.contains("/p"));
    trials.sort();
    let mut arguments = vec!["figures"];
    arguments.extend(trials.iter().map(String::as_str));
    let bins = ["--bins", "0-10,10-20,20-30", "--span", "0-30"];
    arguments.extend(bins);
    arguments.extend(["--out", "figures.csv"]);
    let finished = plumb(folder.path(), &arguments);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let mut reader = csv::Reader::from_path(folder.path().join("figures.csv")).unwrap();
    let rows: Vec<HashMap<String, String>> =
        reader.deserialize().collect::<Result<_, _>>().unwrap();
    assert_eq!(rows.len(), 24 * 2 * ROWS_OF_TRUNK);
    assert!(rows.iter().all(|it| it["value"].is_empty() != it["reason"].is_empty()));

    let name = "trials/p07-wild";
    let analyzed = [&["analyze", name, "--json", "one.json"][..], &bins].concat();
    assert_eq!(plumb(folder.path(), &analyzed).code, Some(0));
    let one = json(&folder, "one.json");
    let row = |trunk: &str, figure: &str, direction: &str, segment: &str| {
        let mut found = rows.iter().filter(|it| {
            it["trial"] == name
                && it["trunk"] == trunk
                && it["figure"] == figure
                && it["direction"] == direction
                && it["segment"] == segment
        });
        let row = found.next().unwrap_or_else(|| panic!("no {trunk} {figure} {direction}"));
        assert!(found.next().is_none(), "{figure} {direction} {segment} stands twice");
        row
    };
    for (figure, direction, segment, place) in [
        ("path length", "AP", "T1", "bins/0/length_mm/ap"),
        ("path length", "MLSI", "T3", "bins/2/length_mm/coronal"),
        ("path length", "APML", "whole", "path/length_mm/transverse"),
        ("mean velocity", "SI", "T2", "bins/1/mean_velocity_mm_s/si"),
        ("RMS", "APSI", "whole", "rms_mm/sagittal"),
        ("range", "ML", "whole", "range_mm/ml"),
        ("ellipse area", "APML", "whole", "ellipse/transverse/area_mm2"),
        ("ellipse long semi-axis", "APSI", "whole", "ellipse/sagittal/major_mm"),
        ("ellipse short semi-axis", "MLSI", "whole", "ellipse/coronal/minor_mm"),
        ("ellipse angle", "APML", "whole", "ellipse/transverse/angle_rad"),
        ("mean frequency", "AP", "whole", "spectrum/ap/mean_hz"),
        ("centroidal frequency", "ML", "whole", "spectrum/ml/centroidal_hz"),
        ("median frequency", "SI", "whole", "spectrum/si/median_hz"),
        ("F95", "AP", "whole", "spectrum/ap/f95_hz"),
        ("sway density peak", "APML", "whole", "density/peak_s"),
        ("sway density interval", "APML", "whole", "density/interval_s"),
        ("sway density distance", "APML", "whole", "density/distance_mm"),
        ("diffusion short term", "AP", "whole", "diffusion/ap/short_mm2_s"),
        ("diffusion long term", "APML", "whole", "diffusion/transverse/long_mm2_s"),
        ("diffusion critical time", "ML", "whole", "diffusion/ml/critical_s"),
        ("diffusion critical displacement", "SI", "whole", "diffusion/si/critical_mm2"),
        ("diffusion split", "AP", "whole", "diffusion/ap/split_s"),
        ("Hurst exponent short term", "APML", "whole", "diffusion/transverse/hurst_short"),
        ("Hurst exponent long term", "AP", "whole", "diffusion/ap/hurst_long"),
    ] {
        for (at, trunk) in ["lower", "upper"].into_iter().enumerate() {
            let row = row(trunk, figure, direction, segment);
            let expected = one.pointer(&format!("/points/{at}/filtered/{place}")).unwrap();
            match expected["value"].as_f64() {
                Some(value) => {
                    let found: f64 = row["value"].parse().unwrap();
                    // serde_json reads a number to within a unit in its last place.
                    assert!((found - value).abs() <= f64::EPSILON * value.abs(), "{figure}");
                }
                None => assert_eq!(row["reason"], expected["absent"].as_str().unwrap(), "{figure}"),
            }
            let about = ["participant", "condition", "filter"].map(|it| row[it].as_str());
            assert_eq!(about, ["P07", "wild", "Savitzky-Golay, second order, 0.5 s"]);
        }
    }
    let second = row("upper", "path length", "AP", "T2");
    let numbers = ["start_s", "end_s", "measured_s", "rate_hz"];
    let numbers = numbers.map(|it| second[it].parse::<f64>().unwrap());
    for (number, expected) in numbers.into_iter().zip([10.0, 20.0, 10.0, 50.0]) {
        // Times of packets are whole nanoseconds.
        assert!((number - expected).abs() < 1e-6, "{number} {expected}");
    }

    // A study's means are those of the table.
    assert_eq!(study(&folder, "figures = [\"RMS AP\", \"path length\"]\n").code, Some(0));
    let sway = json(&folder, "study.json")["sway"].clone();
    for (figure, direction, segment, cell) in [
        ("RMS", "AP", "whole", 0),
        ("path length", "APML", "T2", 1),
        ("path length", "SI", "T3", 2),
    ] {
        let of_cell: Vec<f64> = rows
            .iter()
            .filter(|it| {
                it["condition"] == "calm" && it["trunk"] == "upper" && it["segment"] == segment
            })
            .filter(|it| it["figure"] == figure && it["direction"] == direction)
            .map(|it| it["value"].parse().unwrap())
            .collect();
        assert_eq!(of_cell.len(), 12);
        let mean = of_cell.iter().sum::<f64>() / 12.0;
        let mut responses = sway.as_array().unwrap().iter().filter(|it| {
            it["point"] == "upper" && it["figure"] == figure && it["direction"] == direction
        });
        let found = &responses.next().unwrap()["inference"]["cells"][cell]["raw"]["mean"];
        let found = found.as_f64().unwrap();
        // The study's filter and spans are the same; only the order of a sum may differ.
        assert!((found / mean - 1.0).abs() < 1e-12, "{figure} {direction}: {found} {mean}");
    }
}

#[test]
fn a_trial_that_cannot_be_read_is_named_and_the_others_are_written() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        record(&folder.path().join(name), "=P1", "calm", 2, 1);
    }
    std::fs::write(folder.path().join("b/packets.bin"), "not a recording").unwrap();
    let run = |arguments: &str| {
        let words: Vec<&str> = arguments.split_whitespace().collect();
        plumb(folder.path(), &words)
    };
    let finished = run("figures a b --bins 0-1,1-2,2-3 --out -");
    assert_eq!(finished.code, Some(1), "{}", finished.stderr);
    assert!(finished.stderr.contains("error: b/packets.bin"), "{}", finished.stderr);
    assert_eq!(finished.stdout.lines().count(), 1 + 2 * ROWS_OF_TRUNK);
    // A code is no formula; what two seconds are too short for has its reason.
    assert!(finished.stdout.lines().skip(1).all(|it| it.starts_with("'=P1,calm,a,")));
    assert!(finished.stdout.contains("but 10.0 s are needed"), "{}", finished.stdout);

    std::fs::write(folder.path().join("there.csv"), "kept").unwrap();
    for (arguments, parts) in [
        ("figures b c --out new.csv", &["c: it is not the folder", "none of them can be read"][..]),
        ("figures a --out there.csv", &["there.csv", "--force"]),
        ("figures a ./a --out new.csv", &["./a: this trial is given twice"]),
        ("figures --out new.csv", &["<TRIAL>"]),
    ] {
        let finished = run(arguments);
        assert_eq!(finished.code, Some(2), "{arguments}: {}", finished.stderr);
        for part in parts {
            assert!(finished.stderr.contains(part), "no {part}: {}", finished.stderr);
        }
    }
    assert_eq!(std::fs::read(folder.path().join("there.csv")).unwrap(), b"kept");
    assert!(!folder.path().join("new.csv").exists());
    assert_eq!(run("figures a --out new.parquet").code, Some(0));
    assert!(std::fs::read(folder.path().join("new.parquet")).unwrap().starts_with(b"PAR1"));
}

#[test]
fn whoever_lacks_a_value_is_named_with_the_reason_and_counted_out() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("trials")).unwrap();
    for (who, seed) in ["P1", "P2", "P3", "P4"].into_iter().zip(1..) {
        for condition in CONDITIONS {
            // 8 s of the last ten.
            let seconds = if who == "P3" && condition == "calm" { 28 } else { SECONDS };
            let path = folder.path().join(format!("trials/{who}-{condition}"));
            record(&path, who, condition, seconds, seed);
        }
    }
    let finished = study(&folder, "");
    assert_eq!(finished.code, Some(2), "{}", finished.stderr);
    for part in [
        "participant P3 has no value in calm, T3: ",
        "trials/P3-calm, lower trunk: 20 to 30 s: 8.0 of 10 s measured (80 %); at least 90 % are needed",
        "drop_incomplete = true",
    ] {
        assert!(finished.stderr.contains(part), "no {part}: {}", finished.stderr);
    }

    let more = "drop_incomplete = true\nfigures = [\"path length\", \"RMS AP\"]\n";
    let finished = study(&folder, more);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    for part in ["4 participants, 3 in every response (not: P3)", "n = 3 of 4 participants"] {
        assert!(finished.stdout.contains(part), "no {part}: {}", finished.stdout);
    }
    let few = "3 participants: with so few, p values mean little";
    assert!(finished.stderr.contains(few), "{}", finished.stderr);
    let found = json(&folder, "study.json");
    assert_eq!(found["participants"].to_string(), r#"["P1","P2","P3","P4"]"#);
    for it in found["sway"].as_array().unwrap() {
        // 28 of 30 s are enough for what is of all times together.
        let n = if it["figure"] == "RMS" { 4 } else { 3 };
        assert_eq!(it["n"], n, "{it}");
        if n == 3 {
            assert_eq!(it["left_out"][0]["participant"], "P3");
            let reason = it["left_out"][0]["reason"].as_str().unwrap();
            assert!(reason.contains("20 to 30 s: 8.0 of 10 s measured (80 %)"), "{reason}");
        }
    }
    // A page says the same.
    assert_eq!(plumb(folder.path(), &["report", "study.toml"]).code, Some(0));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(
        page.contains("3 in every response (not: P3)") && page.contains("n = 3 of 4"),
        "{page}"
    );

    // A condition that somebody lacks, and a second trial, are found before.
    std::fs::rename(folder.path().join("trials/P2-wild"), folder.path().join("P2-wild")).unwrap();
    record(&folder.path().join("trials/P4-again"), "P4", "calm", SECONDS, 9);
    let finished = study(&folder, "");
    for part in ["P4 has 2 trials in calm: ", "trials/P4-again, ", "repeats = \"mean\""] {
        assert!(finished.stderr.contains(part), "no {part}: {}", finished.stderr);
    }
    let finished = study(&folder, "repeats = \"mean\"\n");
    assert!(finished.stderr.contains("participant P2 has no trial in wild"), "{}", finished.stderr);
    let finished = study(&folder, "repeats = \"mean\"\ndrop_incomplete = true\n");
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stdout.contains("2 in every response (not: P2, P3)"), "{}", finished.stdout);
}
