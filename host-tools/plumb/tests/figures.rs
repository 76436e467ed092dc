//! Figures and statistics by the program itself, against results that others have published.

use plumbline_test_support::{command, data};
use std::f64::consts::TAU;
use std::process::Output;

use crate::common::trial::{self, Frame};

use serde_json::Value;
use tempfile::TempDir;

fn plumb(folder: &TempDir, arguments: &[&str]) -> Output {
    let mut command = command(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments).current_dir(folder.path()).output().unwrap()
}

fn text(output: &Output) -> String {
    String::from_utf8([&output.stdout[..], &output.stderr].concat()).unwrap()
}

/// What the program writes with --json.
#[track_caller]
fn json(folder: &TempDir, arguments: &[&str]) -> Value {
    let output = plumb(folder, &[arguments, &["--json", "out.json", "--force"]].concat());
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output));
    serde_json::from_slice(&std::fs::read(folder.path().join("out.json")).unwrap()).unwrap()
}

#[track_caller]
fn assert_near(found: &Value, expected: f64, relative: f64) {
    let found = found.as_f64().unwrap_or_else(|| panic!("{found} is not a number"));
    let error = (found - expected).abs() / expected.abs();
    assert!(error <= relative, "{found} is not {expected}: {error:e}");
}

#[test]
fn a_force_plate_s_table_gives_its_authors_velocity_and_ellipse() {
    let Some(data) = data("sway") else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut reference = csv::ReaderBuilder::new()
        .delimiter(b'\t')
        .from_path(data.join("BDS_reference.tsv"))
        .unwrap();
    let mut trials = 0;
    for row in reference.records() {
        let row = row.unwrap();
        let path = data.join(format!("{}.txt.gz", &row[0])).display().to_string();
        let columns = "time=Time[s],ap=COPx[cm],ml=COPy[cm]";
        let table = ["analyze", "--table", &path, "--columns", columns, "--unit", "cm"];
        let json = json(&folder, &table);
        let figures = &json["points"][0]["unfiltered"];
        let number = |at: usize| row[at].parse::<f64>().unwrap();
        // The reference is in cm. Theirs are 64-bit numbers with all digits, and so are ours:
        // what is left is rounding, and their quantile of F, good to 1e-12.
        let area = &figures["ellipse"]["transverse"]["area_mm2"]["value"];
        assert_near(area, 100.0 * number(3), 1e-11);
        let velocity = &figures["path"]["mean_velocity_mm_s"]["transverse"]["value"];
        assert_near(velocity, 10.0 * number(4), 1e-12);
        trials += 1;
    }
    assert_eq!(trials, 4);
}

#[test]
fn rows_that_a_plate_has_dropped_are_gaps_and_named() {
    let Some(data) = data("sway") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = data.join("jythen_test.csv.gz").display().to_string();
    let columns = "time=MocapTime,ap=Cx,ml=Cy";
    let table = ["analyze", "--table", &path, "--columns", columns, "--unit", "m"];
    let json = json(&folder, &table);
    let warnings = json["warnings"].to_string();
    // All nine channels are 0 in these lines while time goes on; Cz is 0 in every line.
    assert!(warnings.contains("7 rows became gaps"), "{warnings}");
    assert!(warnings.contains("lines 37, 38, 15636"), "{warnings}");
    // At both ends of the recording: no gap within it. With the zeros it would be 3216.7.
    let length = &json["points"][0]["unfiltered"]["path"]["length_mm"]["transverse"]["value"];
    assert_near(length, 3006.2, 0.1 / 3006.2);
}

#[test]
fn ranks_are_those_of_nparld() {
    let Some(data) = data("nparld") else { return };
    let folder = tempfile::tempdir().unwrap();
    for (name, design, within, effects) in [
        ("amylase", "LDF2", "time1,time2", &["Day", "Time", "Day:Time"][..]),
        ("dental", "LDF1", "time", &["Time"][..]),
    ] {
        let path = data.join(format!("{name}.csv")).display().to_string();
        let table = ["study", "--long", &path, "--response", "resp", "--within", within];
        let json = json(&folder, &[&table[..], &["--subject", "subject"]].concat());
        for (test, field) in [("ANOVA", "anova_type"), ("Wald", "wald_type")] {
            let file = data.join(format!("ref_{name}_{design}_{test}.test.csv"));
            let mut reference =
                csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(file).unwrap();
            let rows: Vec<csv::StringRecord> =
                reference.records().collect::<Result<_, _>>().unwrap();
            assert_eq!(rows.len(), effects.len());
            for (at, row) in rows.iter().enumerate() {
                let found = &json["ranks"]["effects"][at][field];
                for (column, key) in ["statistic", "df", "p"].into_iter().enumerate() {
                    // They give 15 digits of the statistic, of p as well.
                    let expected: f64 = row[column + 1].trim().parse().unwrap();
                    assert_near(&found[key], expected, 1e-11);
                }
            }
        }
    }
}

/// A minute on a circle, in a table.
fn circle(folder: &TempDir, name: &str, radius_mm: f64, turns_per_s: f64) {
    let mut rows = String::from("t,x,y\n");
    for at in 0..=6000 {
        let time_s = f64::from(at) / 100.0;
        let angle = std::f64::consts::TAU * turns_per_s * time_s;
        rows += &format!("{time_s},{},{}\n", radius_mm * angle.cos(), radius_mm * angle.sin());
    }
    std::fs::write(folder.path().join(name), rows).unwrap();
}

/// Three participants on circles: under one condition larger ones.
fn study(folder: &TempDir) -> String {
    let mut study = String::from("title = \"Circles\"\nconditions = [\"calm\", \"wild\"]\n");
    for (participant, radius_mm) in [("P1", 4.0), ("P2", 5.0), ("P3", 7.0)] {
        for (condition, more) in [("calm", 0.0), ("wild", 1.0 + 0.1 * radius_mm)] {
            let name = format!("{participant}-{condition}.csv");
            circle(folder, &name, radius_mm + more, 0.2);
            study += &format!(
                "[[trial]]\ntable = \"{name}\"\ncolumns = \"time=t,ap=x,ml=y\"\nunit = \"mm\"\n\
                 participant = \"{participant}\"\ncondition = \"{condition}\"\n"
            );
        }
    }
    study
}

#[test]
fn a_study_of_circles_has_their_circumferences_in_its_table() {
    let folder = tempfile::tempdir().unwrap();
    let write = |text: &str| std::fs::write(folder.path().join("study.toml"), text).unwrap();
    write(&study(&folder));
    let found = json(&folder, &["study", "study.toml"]);
    assert_eq!(found["participants"].to_string(), r#"["P1","P2","P3"]"#);
    let measures = found["sway"].as_array().unwrap();
    // A plate knows no SI.
    let directions: Vec<&str> =
        measures.iter().map(|it| it["direction"].as_str().unwrap()).collect();
    assert_eq!(directions, ["AP", "ML", "APML"]);
    let cells = measures[2]["inference"]["cells"].as_array().unwrap();
    assert_eq!(cells[0]["levels"].to_string(), r#"["calm","T1"]"#);
    // Four turns in 20 s. The filter's parabola cuts a circle of 31.4 samples' reach: its
    // response at 0.2 Hz over 0.51 s is 1 - 1e-4.
    let mean_radius_mm = (4.0 + 5.0 + 7.0) / 3.0;
    let length_mm = 4.0 * std::f64::consts::TAU * mean_radius_mm;
    assert_near(&cells[0]["raw"]["mean"], length_mm, 3e-4);
    let output = plumb(&folder, &["study", "study.toml"]);
    let table = text(&output);
    for part in ["3 participants", "APML T1", "Positions", "ANOVA-type"] {
        assert!(table.contains(part), "no {part}: {table}");
    }

    // A blank behind a name makes nobody else.
    let whole = study(&folder);
    let blank = whole.replacen("participant = \"P1\"", "participant = \"P1 \"", 1);
    write(&blank.replacen("condition = \"wild\"", "condition = \"wild \"", 1));
    assert_eq!(json(&folder, &["study", "study.toml"]), found);

    assert_eq!(plumb(&folder, &["report", "study.toml"]).status.code(), Some(0));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    // One plot for each direction, and the table's first row.
    assert_eq!(page.matches("<svg").count(), 3);
    assert!(page.contains("Positions") && page.contains("rowspan=\"3\">APML</th>"), "{page}");

    // Every fault is named. Whose trial is cut off at 45 s has no third time.
    let circle = std::fs::read_to_string(folder.path().join("P1-calm.csv")).unwrap();
    let short: Vec<&str> = circle.lines().take(4502).collect();
    std::fs::write(folder.path().join("short.csv"), short.join("\n")).unwrap();
    let cases = [
        (whole.replacen("condition = \"wild\"", "condition = \"mad\"", 1), "\"mad\" is not one of"),
        (whole.replacen("participant = \"P1\"\n", "", 1), "participant = \"...\""),
        (whole.replacen("unit = \"mm\"", "unit = \"inch\"", 1), "\"inch\" is not a unit"),
        (whole.replacen("P2-calm.csv", "absent.csv", 1), "absent.csv"),
        (
            whole.replacen("participant = \"P2\"", "participant = \"P9\"", 1),
            "P9 has no trial in wild",
        ),
        (
            whole.replacen("participant = \"P2\"", "participant = \"P1\"", 1),
            "P1 has 2 trials in calm",
        ),
        (
            format!("figures = [\"paths\"]\n{whole}"),
            "figures: \"paths\" is not a figure; give \"all\"",
        ),
        (format!("figures = 3\n{whole}"), "figures (line 1): figures are \"all\", or a list"),
        (format!("trials = [\"nowhere/*\"]\n{whole}"), "trials, \"nowhere/*\": it matches nothing"),
        (format!("repeats = \"first\"\n{whole}"), "expected `mean`"),
        (whole.replacen("[\"calm\", \"wild\"]", "[\"calm\"]", 1), "fewer than two"),
        (whole.replacen("[\"calm\", \"wild\"]", "[\"calm\", \" \"]", 1), "one without a name"),
        (whole.replacen("participant = \"P1\"", "participant = \" \"", 1), "neither the trial"),
        (whole.replacen("title", "titel", 1), "titel"),
        (
            whole.replacen("P1-calm.csv", "short.csv", 1),
            "participant P1 has no value in calm, T3: ./short.csv, positions: 40 to 60 s: 5.0 of 20 s measured (25 %); at least 90 % are needed",
        ),
        (format!("bins_s = [[0, 1e12]]\n{whole}"), "bins_s"),
        (format!("bins_s = [[0, 9], [9, 18], [0, 9]]\n{whole}"), "bins_s: one is given twice"),
    ];
    for (text_of_study, part) in cases {
        write(&text_of_study);
        let output = plumb(&folder, &["study", "study.toml"]);
        let said = text(&output);
        assert_eq!(output.status.code(), Some(2), "{part}: {said}");
        assert!(said.contains(part), "no {part}: {said}");
    }
}

/// Its factor time has one level: with it, no effect would be tested.
#[test]
fn a_study_with_a_single_time_compares_its_conditions() {
    let folder = tempfile::tempdir().unwrap();
    let whole = format!("bins_s = [[0, 30]]\n{}", study(&folder));
    std::fs::write(folder.path().join("study.toml"), whole).unwrap();
    let found = json(&folder, &["study", "study.toml"]);
    for response in found["sway"].as_array().unwrap() {
        let inference = &response["inference"];
        assert_eq!(inference["factors"].as_array().unwrap().len(), 1, "{inference}");
        assert_eq!(inference["anova"]["effects"][0]["effect"], "condition");
        assert_eq!(response["adjusted"][0]["tests"], 3, "{response}");
    }
    // Six turns in 30 s: the first row of the table has the same means as the statistics.
    let mean = found["sway"][2]["inference"]["cells"][0]["raw"]["mean"].as_f64().unwrap();
    assert!((mean / (6.0 * TAU * 16.0 / 3.0) - 1.0).abs() < 3e-4, "{mean}");
    let said = text(&plumb(&folder, &["study", "study.toml"]));
    for part in
        ["There is a single time, so only conditions are compared.", &format!("{mean:.1} ±")]
    {
        assert!(said.contains(part), "no {part}: {said}");
    }
    assert_eq!(plumb(&folder, &["report", "study.toml"]).status.code(), Some(0));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 3);
    assert!(page.contains("There is a single time"), "{page}");
}

#[test]
fn a_study_of_one_participant_has_its_means_and_no_plot() {
    let folder = tempfile::tempdir().unwrap();
    let whole = study(&folder);
    let alone = whole.split("[[trial]]").take(3).collect::<Vec<_>>().join("[[trial]]");
    std::fs::write(folder.path().join("study.toml"), alone).unwrap();
    let output = plumb(&folder, &["report", "study.toml"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 0);
    assert!(page.contains("only 1, but 2 are needed"), "{page}");
}

/// A trial `p01` of a minute at 60 Hz whose mark comes 5.508 s after its start, between two frames:
/// before, the person moves by 50 mm.
fn marked_trial(folder: &TempDir) {
    let frames: Vec<Frame> = (0..3600)
        .map(|sequence| {
            let time_s = f64::from(sequence) / 60.0;
            let size_mm = if time_s < 5.5 { 50.0 } else { 5.0 };
            let angle = TAU * 0.5 * time_s;
            let at_mm = [size_mm * angle.cos(), size_mm * angle.sin(), 900.0];
            Frame { sequence, time_s, lower_mm: Some(at_mm), upper_mm: None }
        })
        .collect();
    trial::write(&folder.path().join("p01"), &frames, &[(5.508, "zero")]);
}

#[test]
fn what_was_before_a_mark_is_in_no_figure_unless_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    marked_trial(&folder);
    let rms_mm =
        |it: &Value| it["points"][0]["unfiltered"]["rms_mm"]["transverse"]["value"].clone();
    let after = json(&folder, &["analyze", "p01"]);
    let lower = &after["points"][0]["filtered"];
    // 27 and a quarter turns after the mark: less than a percent of a turn is one too many.
    assert_near(&rms_mm(&after), 5.0, 0.01);
    assert_eq!((&after["span"], &lower["from_s"]), (&"from t = 0 on".into(), &0.0.into()));
    // The last frame is at 59.983 s of the recording; the mark's time is good to 0.1 ms.
    assert_near(&lower["to_s"], 3599.0 / 60.0 - 5.508, 1e-4 / 54.0);
    assert_near(&lower["measured_s"], 3599.0 / 60.0 - 5.508, 1e-4 / 54.0);
    assert_eq!(lower["samples"].as_u64().unwrap(), 3600 - 331);
    let all = json(&folder, &["analyze", "p01", "--span", "all"]);
    assert!(rms_mm(&all).as_f64().unwrap() > 15.0, "{}", rms_mm(&all));
    assert_eq!(all["points"][0]["filtered"]["samples"].as_u64().unwrap(), 3600);
    // Without a mark that counts, nothing was before it.
    let start = json(&folder, &["analyze", "p01", "--zero", "start"]);
    assert_eq!(rms_mm(&start), rms_mm(&all));
    let said = text(&plumb(&folder, &["analyze", "p01"]));
    for part in ["span: from t = 0 on", "0.00 to 54.48 s", "3269 frames at 60.00 Hz"] {
        assert!(said.contains(part), "no {part}: {said}");
    }
}

#[test]
fn a_time_bin_with_too_little_says_how_much_it_has_and_needs() {
    let folder = tempfile::tempdir().unwrap();
    marked_trial(&folder);
    let reason = "40 to 60 s: 14.5 of 20 s measured (72 %); at least 90 % are needed";
    let ap = |it: &Value| it["points"][0]["filtered"]["bins"][2]["length_mm"]["ap"].clone();
    let found = json(&folder, &["analyze", "p01"]);
    assert_eq!((&found["covered_min"], &ap(&found)["absent"]), (&0.9.into(), &reason.into()));
    let said = text(&plumb(&folder, &["analyze", "p01"]));
    assert!(said.contains(reason) && said.contains("a bin below 90 % has no path"), "{said}");
    assert_eq!(plumb(&folder, &["report", "p01"]).status.code(), Some(0));
    let page = std::fs::read_to_string(folder.path().join("p01/report.html")).unwrap();
    assert!(page.contains(reason) && page.contains("less than 90 % was measured"), "{page}");
    let enough = json(&folder, &["analyze", "p01", "--covered-min", "72"]);
    assert!(ap(&enough)["value"].as_f64().is_some(), "{enough}");
}

#[test]
fn a_report_begins_with_what_it_is_of() {
    let folder = tempfile::tempdir().unwrap();
    marked_trial(&folder);
    let report = ["report", "p01", "--filter", "butterworth:10", "--out", "p01.html"];
    assert_eq!(plumb(&folder, &report).status.code(), Some(0));
    let page = std::fs::read_to_string(folder.path().join("p01.html")).unwrap();
    let (head, rest) = page.split_once("Lower trunk").unwrap();
    for part in [
        "p-01",
        "control",
        "60.0 s, 3600 frames at 60.00 Hz",
        "from t = 0 on: 0.00 to 54.48 s",
        "Butterworth, 10 Hz, order 2 in each of two passes",
        "20 to 40 s",
    ] {
        assert!(head.contains(part), "no {part}: {head}");
    }
    // Around the path seen from above, of which lines are 1 px wide, is the ellipse.
    let plots: Vec<&str> = rest.split("<figure").collect();
    let plot = |plane: &str| plots.iter().find(|it| it.contains(plane)).unwrap();
    let [transverse, sagittal] = ["transverse plane", "sagittal plane"].map(plot);
    let is_outlined = |plot: &str| plot.contains("stroke-width=\"2\"");
    assert!(is_outlined(transverse) && transverse.contains("95 % prediction ellipse"));
    assert!(!is_outlined(sagittal) && !sagittal.contains("ellipse"));
    // Three bins and what lies before the mark, each in its colour.
    let strokes: std::collections::BTreeSet<&str> = sagittal
        .split("<polyline")
        .filter_map(|it| Some(&it.split_once("stroke=\"")?.1[..7]))
        .collect();
    assert!(strokes.len() >= 4, "{strokes:?}");
}

#[test]
fn filters_are_chosen_by_name_and_stated() {
    let Some(data) = data("sway") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = data.join("BDS00001.txt.gz").display().to_string();
    let columns = "time=Time[s],ap=COPx[cm],ml=COPy[cm]";
    let table = ["analyze", "--table", &path, "--columns", columns, "--unit", "cm", "--filter"];
    let of = |filter: &str| json(&folder, &[&table[..], &[filter]].concat());
    let none = of("none");
    assert_eq!(none["points"][0]["filtered"], none["points"][0]["unfiltered"]);
    assert_eq!(none["filter"]["kind"], "none");
    let length = |it: &Value| {
        it["points"][0]["filtered"]["path"]["length_mm"]["ap"]["value"].as_f64().unwrap()
    };
    let butterworth = of("butterworth:10");
    let stated = &butterworth["points"][0]["filtered"]["filter"];
    assert_eq!((&stated["cutoff_hz"], &stated["order"]), (&10.0.into(), &2.into()));
    // Of a digital filter at a tenth of the rate: `atan(0.8022 tan(pi / 10)) / pi` of it.
    assert_near(&stated["half_power_hz"], 8.124, 1e-3);
    // Its cutoff is above that of the paper's filter, which is near 3 Hz.
    let lengths = [length(&of("paper:0.5")), length(&butterworth), length(&none)];
    assert!(lengths[0] < lengths[1] && lengths[1] < lengths[2], "{lengths:?}");
    let said = text(&plumb(&folder, &[&table[..], &["0"]].concat()));
    assert!(said.contains("paper:0.5 or butterworth:10") && said.contains("none"), "{said}");
}

#[test]
fn a_force_plate_s_table_has_a_report() {
    let folder = tempfile::tempdir().unwrap();
    circle(&folder, "plate.csv", 5.0, 0.2);
    let table = ["report", "--table", "plate.csv", "--columns", "time=t,ap=x,ml=y", "--unit", "mm"];
    let done = plumb(&folder, &table);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done));
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    for part in [
        "plate.csv",
        "60.0 s, 6001 frames at 100.00 Hz",
        "all: 0.00 to 60.00 s",
        "Figures have no ±",
    ] {
        assert!(page.contains(part), "no {part}: {page}");
    }
    // A plane, two axes and the spectra.
    assert_eq!(page.matches("<figure").count(), 4);
    for (option, value) in [("--reference", "plate.csv"), ("--camera", "plate.csv")] {
        let said = text(&plumb(&folder, &[&table[..], &[option, value]].concat()));
        assert!(said.contains(&format!("plate.csv: {option}: an option of a trial")), "{said}");
    }
    let said = text(&plumb(&folder, &["report", "plate.csv"]));
    assert!(said.contains("--table, --columns and --unit"), "{said}");
}

#[test]
fn what_stabilometry_asks_for_is_said() {
    let folder = tempfile::tempdir().unwrap();
    marked_trial(&folder);
    let warned = |arguments: &[&str]| text(&plumb(&folder, arguments));
    assert!(!warned(&["analyze", "p01"]).contains("Scoppa"));
    let short = "the figures are of 20.0 s; stabilometry asks for at least 25 s";
    assert!(warned(&["analyze", "p01", "--span", "0-20"]).contains(short));
    let frames: Vec<Frame> = (0..900)
        .map(|sequence| {
            let time_s = f64::from(sequence) / 30.0;
            let at_mm = [(TAU * 0.3 * time_s).sin(), (TAU * 0.2 * time_s).cos(), 900.0];
            Frame { sequence, time_s, lower_mm: Some(at_mm), upper_mm: None }
        })
        .collect();
    trial::write(&folder.path().join("slow"), &frames, &[]);
    let slow = "the rate is 30.0 Hz; stabilometry asks for at least 50 Hz (Scoppa et al. 2013)";
    let said = warned(&["analyze", "slow"]);
    assert!(said.contains(slow) && !said.contains("25 s"), "{said}");
    assert!(warned(&["report", "slow"]).contains(slow));
    let page = std::fs::read_to_string(folder.path().join("slow/report.html")).unwrap();
    assert!(page.contains(slow), "{page}");
}

#[test]
fn a_new_study_explains_itself_and_is_read() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(plumb(&folder, &["study", "--new", "study.toml"]).status.code(), Some(0));
    let said = text(&plumb(&folder, &["study", "study.toml"]));
    // All of it was understood but that the trials are not there.
    assert!(said.contains("trials, \"trials/*\": it matches nothing"), "{said}");
}
