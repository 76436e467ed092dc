//! Reference bands of a cohort, and a trial's report beside them.

use super::{add, plumb, record};

#[test]
fn a_trials_report_shows_where_its_figures_lie_among_those_of_a_cohort() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("trials")).unwrap();
    let mut table = "participant_id\tage\n".to_owned();
    for at in 0..26 {
        let name = format!("P{at:02}");
        record(&folder.path().join("trials").join(&name), &name, "calm", 6, at);
        // The last has no age, and the one before it is the only old one.
        table += &match at {
            25 => format!("sub-{name}\tn/a\n"),
            24 => format!("sub-{name}\t71\n"),
            _ => format!("sub-{name}\t{}\n", 40 + at % 20),
        };
    }
    // A person who was measured twice counts once.
    record(&folder.path().join("trials/P00-again"), "P00", "calm", 6, 99);
    std::fs::write(folder.path().join("participants.tsv"), table).unwrap();
    let finished = add(folder.path(), &["--number-runs"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let run = |arguments: &str| {
        let words: Vec<&str> = arguments.split_whitespace().collect();
        plumb(folder.path(), &words)
    };
    let made = run("cohort reference cohort --ages 40-60,60-80 --out bands.parquet");
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    for line in [
        "bands.parquet: 26 trials\n",
        "  calm, aged 40 to below 60: 24 participants: few, 120 are recommended\n",
        "  calm, aged 60 to below 80: 1 participant: too few, at least 20 are needed\n",
    ] {
        assert!(made.stdout.contains(line), "no {line}: {}", made.stdout);
    }
    assert!(made.stderr.contains("1 trial left out since the age is not known"), "{}", made.stderr);

    let page = |arguments: &str| {
        let finished = run(&format!("report {arguments} --bands bands.parquet --force"));
        assert_eq!(finished.code, Some(0), "{}", finished.stderr);
        std::fs::read_to_string(folder.path().join("page.html")).unwrap()
    };
    // The age is the participants' file's.
    let found = page("trials/P03 --out page.html");
    for part in [
        "Beside a reference",
        "24 participants aged 40 to below 60, calm, one value for each",
        "24 participants are few: 120 are recommended",
        "lower trunk, RMS AP (mm)",
        "upper trunk, ellipse area APML (mm²)",
        "percentile",
        "<polygon",
    ] {
        assert!(found.contains(part), "no {part}");
    }
    for (arguments, part) in [
        ("trials/P24 --out page.html", "the reference has 1 participant aged 60 to below 80"),
        (
            "trials/P25 --out page.html",
            "age is not known, and the reference is by age (--age says it)",
        ),
        ("trials/P25 --out page.html --age 30", "the reference has no band for 30 years"),
        (
            "trials/P03 --out page.html --filter none",
            "the reference's figures are of another filter",
        ),
    ] {
        let found = page(arguments);
        assert!(found.contains(part) && !found.contains("<polygon"), "no {part}");
    }
    for (arguments, part) in [
        ("cohort reference cohort --ages 40-60,50-80 --out b.parquet", "overlap"),
        (
            "cohort reference cohort --ages 90-99 --out b.parquet",
            "none of its 27 trials can be used",
        ),
        ("cohort reference cohort --out bands.parquet", "--force to replace it"),
        ("report trials/P03 --bands trials/P03/packets.bin --out b.html", "packets.bin: "),
        ("report trials/P03 --age 40 --out b.html", "--bands"),
    ] {
        let finished = run(arguments);
        assert_eq!(finished.code, Some(2), "{arguments}: {}", finished.stderr);
        assert!(finished.stderr.contains(part), "no {part}: {}", finished.stderr);
    }
}
