//! A study with ECGs, pressures and the like, of which every value is known, by the program
//! itself.

use crate::common::trial;
use plumbline_test_support::command;
use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::process::Output;

use crate::common::trial::Frame;
use plumbline_trial::Trial;
use serde_json::Value;
use tempfile::TempDir;

/// When the trials' t = 0 is on the monitor's clock.
const ZERO_S: f64 = 60.0;

/// The recording's length: 70 s after t = 0.
const DURATION_S: f64 = 130.0;

/// Each gets up 4 s before t = 0.
const TRANSITION_S: f64 = -4.0;

/// Whoever breathes so has 4 s for a breath.
const BREATH_S: f64 = 4.0;

/// What somebody has in the baseline and at T1, T2 and T3.
#[derive(Clone, Copy)]
struct Person {
    rate_bpm: [f64; 4],
    systolic_mmhg: [f64; 4],
    end_tidal_mmhg: [f64; 4],
}

/// Which of the four a time on the monitor's clock belongs to; they change between the parts
/// that are looked at.
fn part(time_s: f64) -> usize {
    [ZERO_S - 2.0, ZERO_S + 15.0, ZERO_S + 35.0].iter().filter(|it| time_s >= **it).count()
}

const DIASTOLIC_MMHG: f64 = 70.0;

impl Person {
    /// Number `who` of some, with more of everything under the second condition.
    fn new(who: f64, more: f64) -> Self {
        let odd = (7.0 * who) % 3.0;
        let rates = [60.0, 90.0, 72.0, 74.0];
        let pressures = [130.0, 110.0, 140.0, 135.0];
        let end_tidals = [40.0, 38.0, 39.0, 38.5];
        Self {
            rate_bpm: rates.map(|it| it + who + more * (10.0 + odd)),
            systolic_mmhg: pressures.map(|it| it + 2.0 * who - more * (5.0 + odd)),
            end_tidal_mmhg: end_tidals.map(|it| it + 0.5 * who - more * (8.0 + 0.3 * odd)),
        }
    }

    /// When the heart beats: an interval is that of its beginning's rate.
    fn beats_s(&self) -> Vec<f64> {
        let next = |beat_s: &f64| Some(beat_s + 60.0 / self.rate_bpm[part(*beat_s)]);
        std::iter::successors(Some(0.3), next).take_while(|it| *it < DURATION_S + 2.0).collect()
    }

    /// The monitor's file: 250 Hz, R and T waves, and a pressure between diastolic and systolic.
    fn monitor(&self, kpa: bool) -> String {
        let beats_s = self.beats_s();
        let mut text = String::from("Monitor 5\ntime,ECG,ABP\n");
        for at in 0..(250.0 * DURATION_S) as u32 {
            let time_s = f64::from(at) / 250.0;
            let next = beats_s.partition_point(|it| *it <= time_s);
            let wave = |beat_s: f64, mv: f64, width_s: f64| {
                mv * (-0.5 * ((time_s - beat_s) / width_s).powi(2)).exp()
            };
            let near = &beats_s[next.saturating_sub(1)..(next + 1).min(beats_s.len())];
            let ecg: f64 =
                near.iter().map(|it| wave(*it, 1.0, 0.01) + wave(it + 0.28, 0.3, 0.05)).sum();
            let pressure = match next.checked_sub(1) {
                Some(last) => {
                    let phase = (time_s - beats_s[last]) / (beats_s[next] - beats_s[last]);
                    let pulse = self.systolic_mmhg[part(beats_s[last])] - DIASTOLIC_MMHG;
                    DIASTOLIC_MMHG + pulse * (PI * phase).sin().powi(2)
                }
                None => DIASTOLIC_MMHG,
            };
            let pressure = if kpa { pressure / 7.500_616_8 } else { pressure };
            writeln!(text, "{time_s:.3},{ecg:.5},{pressure:.5}").unwrap();
        }
        text
    }

    /// The gas analyser's: 20 Hz, late by a second.
    fn gas(&self) -> String {
        let mut text = String::from("s;CO2\n");
        for at in 0..(20.0 * DURATION_S) as u32 {
            let time_s = f64::from(at) / 20.0;
            let end_tidal = self.end_tidal_mmhg[part(time_s)];
            let breathing_out = time_s % BREATH_S > 0.5 * BREATH_S;
            let value = if breathing_out { end_tidal } else { 0.5 };
            writeln!(text, "{:.2};{value:.4}", time_s + 1.0).unwrap();
        }
        text
    }

    /// Beat by beat: 80 mL.
    fn volumes(&self) -> String {
        self.beats_s().iter().fold(String::from("t,SV\n"), |text, it| format!("{text}{it:.3},80\n"))
    }

    /// 50 Hz: a fraction that swings about 0.7 with each breath.
    fn oxygenation(&self) -> String {
        let mut text = String::from("t,TSI\n");
        for at in 0..(50.0 * DURATION_S) as u32 {
            let time_s = f64::from(at) / 50.0;
            writeln!(text, "{time_s:.2},{:.6}", 0.7 + 0.01 * (TAU * time_s).sin()).unwrap();
        }
        text
    }
}

const PHYSIOLOGY: &str = r#"
[physiology]
baseline_s = [-45, -15]
[[physiology.signal]]
kind = "ecg"
file = "monitor.csv"
time = "time"
column = "ECG"
unit = "mV"
[[physiology.signal]]
kind = "pressure"
file = "monitor.csv"
time = "time"
column = "ABP"
unit = "mmHg"
[[physiology.signal]]
kind = "stroke_volume"
file = "beats.csv"
time = "t"
column = "SV"
unit = "mL"
[[physiology.signal]]
kind = "oxygenation"
file = "nirs.csv"
time = "t"
column = "TSI"
unit = "fraction"
[[physiology.signal]]
kind = "co2"
file = "gas.csv"
time = "s"
column = "CO2"
unit = "mmHg"
delay_s = 1
"#;

const PEOPLE: usize = 4;

/// Four people under two conditions, each with a folder of files.
fn study(folder: &TempDir) -> String {
    let mut study = format!("title = \"Stands\"\nconditions = [\"calm\", \"hypo\"]\n{PHYSIOLOGY}");
    let mut plate = String::from("t,x,y\n");
    for at in 0..=1200 {
        let angle = TAU * 0.2 * f64::from(at) / 20.0;
        writeln!(plate, "{},{},{}", f64::from(at) / 20.0, 5.0 * angle.cos(), 4.0 * angle.sin())
            .unwrap();
    }
    for who in 0..PEOPLE {
        for (more, condition) in [(0.0, "calm"), (1.0, "hypo")] {
            let name = format!("P{who}-{condition}");
            let person = Person::new(who as f64, more);
            let own = folder.path().join(&name);
            std::fs::create_dir(&own).unwrap();
            for (file, text) in [
                ("monitor.csv", person.monitor(false)),
                ("gas.csv", person.gas()),
                ("beats.csv", person.volumes()),
                ("nirs.csv", person.oxygenation()),
                ("plate.csv", plate.clone()),
            ] {
                std::fs::write(own.join(file), text).unwrap();
            }
            study += &format!(
                "[[trial]]\ntable = \"{name}/plate.csv\"\ncolumns = \"time=t,ap=x,ml=y\"\nunit = \"mm\"\n\
                 participant = \"P{who}\"\ncondition = \"{condition}\"\n\
                 physiology = {{ folder = \"{name}\", zero_s = {ZERO_S}, \
                 transition_s = {TRANSITION_S} }}\n"
            );
        }
    }
    study
}

fn plumb(folder: &TempDir, arguments: &[&str]) -> Output {
    let mut command = command(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments).current_dir(folder.path()).output().unwrap()
}

fn text(output: &Output) -> String {
    String::from_utf8([&output.stdout[..], &output.stderr].concat()).unwrap()
}

/// The mean of a figure of all people in a cell.
fn mean(more: f64, of: impl Fn(&Person) -> f64) -> f64 {
    let people = (0..PEOPLE).map(|who| of(&Person::new(who as f64, more)));
    people.sum::<f64>() / PEOPLE as f64
}

#[test]
fn table_1_has_the_values_that_its_signals_were_made_of() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("study.toml"), study(&folder)).unwrap();
    let output = plumb(&folder, &["study", "study.toml", "--json", "out.json"]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(!said.replace("warning: 4 participants", "").contains("warning"), "{said}");
    let json: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("out.json")).unwrap()).unwrap();
    let quantities = json["physiology"].as_array().unwrap();
    let names: Vec<&str> = quantities.iter().map(|it| it["quantity"].as_str().unwrap()).collect();
    assert_eq!(
        names,
        [
            "heart_rate",
            "mean_pressure",
            "systolic_pressure",
            "diastolic_pressure",
            "stroke_volume",
            "cardiac_output",
            "oxygenation",
            "end_tidal_co2"
        ]
    );
    let check = |name: &str, within: f64, expected: &dyn Fn(&Person, usize) -> f64| {
        let at = names.iter().position(|it| *it == name).unwrap();
        let cells = quantities[at]["inference"]["cells"].as_array().unwrap();
        assert_eq!(cells.len(), 8);
        assert_eq!(cells[4]["levels"].to_string(), r#"["hypo","baseline"]"#);
        for (cell, found) in cells.iter().enumerate() {
            let expected = mean((cell / 4) as f64, |person| expected(person, cell % 4));
            let found = found["raw"]["mean"].as_f64().unwrap();
            assert!((found - expected).abs() < within, "{name} {cell}: {found} {expected}");
        }
    };
    // R waves are found within a tenth of a sample of 4 ms, in intervals of 0.6 s or more.
    check("heart_rate", 0.02, &|it, part| it.rate_bpm[part]);
    // A sample lies within 2 ms of a wave's crest and foot: (pi 2 ms / 0.55 s)^2 of 70 mmHg.
    check("systolic_pressure", 0.01, &|it, part| it.systolic_mmhg[part]);
    check("diastolic_pressure", 0.01, &|_, _| DIASTOLIC_MMHG);
    // The mean of a cycle has one sample more or less of 140: of the foot, 35 mmHg from it.
    check("mean_pressure", 0.3, &|it, part| 0.5 * (it.systolic_mmhg[part] + DIASTOLIC_MMHG));
    check("stroke_volume", 1e-9, &|_, _| 80.0);
    check("cardiac_output", 0.002, &|it, part| 0.08 * it.rate_bpm[part]);
    // Whole periods, in each second.
    check("oxygenation", 1e-4, &|_, _| 70.0);
    check("end_tidal_co2", 1e-3, &|it, part| it.end_tidal_mmhg[part]);

    for part in [
        "HR (bpm)",
        "baseline, -45 to -15 s (a)",
        "T3, 40 to 50 s (d)",
        "*bcd",
        "Total path length",
    ] {
        assert!(said.contains(part), "no {part}: {said}");
    }
    assert_eq!(plumb(&folder, &["report", "study.toml"]).status.code(), Some(0));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    // Eight quantities, and AP, ML and APML of the plate.
    assert_eq!(page.matches("<svg").count(), 8 + 3);
    assert!(page.contains("PETCO2 (mmHg)") && page.contains("Total path length"));
}

#[test]
fn recordings_that_cannot_be_used_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let whole = study(&folder);
    let monitor = folder.path().join("P1-calm/monitor.csv");
    let good = std::fs::read_to_string(&monitor).unwrap();
    let kpa = Person::new(1.0, 0.0).monitor(true);
    let twice = good.replacen("50.000,", "49.000,", 1);
    let word = good.replacen("\n50.000,", "\n50.000,loose", 1);
    let slow: String = good
        .lines()
        .take(2)
        .chain(good.lines().skip(2).step_by(5))
        .fold(String::new(), |text, line| text + line + "\n");
    let cut: String = good.lines().take(250 * 70).fold(String::new(), |text, it| text + it + "\n");
    let faults = [
        (kpa, "P1-calm: MAP: its median is"),
        (twice, "ECG (line 12503): its time is not later"),
        (word, "ECG (line 12503): \"loose"),
        (slow, "monitor.csv: ECG: 50.0 samples per second instead of 100"),
        (good.replacen("ABP", "ART", 1), "ABP: no such column; it has the columns time, ECG, ART"),
        (cut, "HR: participant P1 has no value in calm, T2"),
    ];
    let study_toml = folder.path().join("study.toml");
    std::fs::write(&study_toml, &whole).unwrap();
    let refused = |part: &str| {
        let output = plumb(&folder, &["study", "study.toml"]);
        let said = text(&output);
        assert_eq!(output.status.code(), Some(2), "{part}: {said}");
        assert!(said.contains(part), "no {part}: {said}");
    };
    for (text, part) in faults {
        std::fs::write(&monitor, text).unwrap();
        refused(part);
    }
    std::fs::remove_file(&monitor).unwrap();
    refused("P1-calm/monitor.csv");
    let flat: String = good
        .lines()
        .take(2)
        .map(|it| format!("{it}\n"))
        .chain((0..30_000).map(|at| format!("{},0.2,90\n", f64::from(at) / 250.0)))
        .collect();
    std::fs::write(&monitor, flat).unwrap();
    refused("monitor.csv: ECG: no two R waves follow each other");
    // Zeros while the cuff calibrates itself, here to the end: no pressure, and no other time's.
    let off: String = good.lines().fold(String::new(), |text, line| match line.rsplit_once(',') {
        Some((rest, abp)) if abp != "ABP" => text + rest + ",0\n",
        _ => text + line + "\n",
    });
    std::fs::write(&monitor, off).unwrap();
    refused("MAP: participant P1 has no value in calm, baseline");
    std::fs::remove_file(&monitor).unwrap();
    // The study may go on without who has no such recording.
    std::fs::write(&study_toml, format!("drop_incomplete = true\n{whole}")).unwrap();
    let output = plumb(&folder, &["study", "study.toml"]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("monitor.csv: not recorded"), "{said}");
    let left_out = "participant P1 is left out: no value in calm, baseline: ./P1-calm has none";
    assert!(said.contains("HR, and 4 other responses: "), "{said}");
    assert!(said.contains(left_out), "{said}");
    assert!(said.contains("4 participants, 3 in every response (not: P1)"), "{said}");
    std::fs::write(&monitor, good).unwrap();
    for (from, to, part) in [
        (", transition_s = -4", "", "the baseline is counted from it"),
        ("transition_s = -4", "transition_s = 4", "4 s is not within the ten minutes before"),
        ("zero_s = 60, ", "", "it is not known when the trial's t = 0 is"),
        ("zero_s = 60, ", "zero_s = 600, ", "HR: it lasts from -59"),
        ("unit = \"mmHg\"", "unit = \"bar\"", "pressure, unit: \"bar\"; give one of mmHg, kPa"),
        (
            "time = \"time\"\ncolumn = \"ECG\"",
            "time = \"time\"\nclock = \"utc\"\ncolumn = \"ECG\"",
            "the time of day of its recording is not known",
        ),
        ("kind = \"co2\"", "kind = \"pressure\"", "two of the kind \"pressure\""),
    ] {
        std::fs::write(&study_toml, whole.replacen(from, to, 1)).unwrap();
        refused(part);
    }
}

/// A minute on an ellipse, recorded as a trial is; who is measured begins to rise 4 s before
/// t = 0, which is 8 s after the first frame.
fn record(folder: &TempDir, name: &str) -> Trial {
    let frame = |at: u32| {
        let time_s = f64::from(at) / 20.0;
        let angle = TAU * 0.2 * time_s;
        let position_mm = Some([5.0 * angle.cos(), 4.0 * angle.sin(), 900.0]);
        Frame { sequence: at, time_s, lower_mm: position_mm, upper_mm: position_mm }
    };
    let frames: Vec<Frame> = (0..20 * 69).map(frame).collect();
    let path = folder.path().join(name);
    trial::write(&path, &frames, &[(4.0, "rises"), (8.0, "zero")]);
    Trial::open(&path).unwrap()
}

#[test]
fn times_of_day_are_joined_by_the_clock_of_the_recording_computer() {
    let folder = tempfile::tempdir().unwrap();
    let mut study = String::from(
        "title = \"Clocks\"\nbins_s = [[0, 20], [20, 40], [40, 60]]\n\
         conditions = [\"calm\", \"hypo\"]\n[physiology]\nbaseline_s = [-45, -15]\n\
         transition = \"rises\"\n[[physiology.signal]]\nkind = \"oxygenation\"\n\
         file = \"nirs.csv\"\ntime = \"when\"\ncolumn = \"TSI\"\nunit = \"%\"\nclock = \"utc\"\n",
    );
    for (who, condition) in [(0, "calm"), (0, "hypo"), (1, "calm"), (1, "hypo")] {
        let name = format!("P{who}-{condition}");
        let trial = record(&folder, &name);
        let zero_s = trial.first_frame_utc_s.unwrap() + 8.0;
        // The value is the time since t = 0, and 61.
        let mut text = String::from("when,TSI\n");
        for at in -600..700 {
            let time_s = f64::from(at) / 10.0;
            let when = jiff::Timestamp::from_nanosecond(((zero_s + time_s) * 1e9) as i128);
            writeln!(text, "{},{}", when.unwrap(), 61.0 + time_s + 0.1 * f64::from(who)).unwrap();
        }
        std::fs::write(folder.path().join(&name).join("nirs.csv"), text).unwrap();
        study += &format!(
            "[[trial]]\nfolder = \"{name}\"\nparticipant = \"P{who}\"\ncondition = \"{condition}\"\n\
             physiology = {{ folder = \"{name}\" }}\n"
        );
    }
    std::fs::write(folder.path().join("study.toml"), study).unwrap();
    let output = plumb(&folder, &["study", "study.toml", "--json", "out.json"]);
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let json: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("out.json")).unwrap()).unwrap();
    let cells = json["physiology"][0]["inference"]["cells"].as_array().unwrap();
    // From -49 to -19 s: who takes 4 s begins the baseline 49 s before t = 0. Then from 0 to 10,
    // 20 to 30, 40 to 50 s.
    for (cell, expected) in cells.iter().zip([-34.0, 5.0, 25.0, 45.0]) {
        let found = cell["raw"]["mean"].as_f64().unwrap();
        // The ten samples' mean is 0.05 s early, and the second person's value 0.1 higher. A time of
        // day has 0.24 us as a double, so that a sample at a second's edge may be the next one's.
        assert!((found - 61.0 - expected).abs() < 0.06, "{found} {expected}");
    }
}
