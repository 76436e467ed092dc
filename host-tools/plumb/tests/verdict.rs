//! Every trial ends with a verdict: trials that are spoiled in one way each are caught and named by
//! every command that shows or uses them, and a person may overrule.

use crate::common::finished::{Finished, plumb};
use crate::common::trial::{self, Frame};
use std::path::Path;

use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::lens::Lens;
use plumbline::packet::{Message, PACKET_BYTES_MAX, Start, encode_datagram};
use plumbline_files::lens_id::LensId;
use plumbline_files::scene::{self, SceneFile};
use plumbline_stream::fixture;
use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Entry, Writer};
use plumbline_trial::manifest::{Manifest, State, Zero};
use plumbline_trial::names;
use tempfile::TempDir;

/// Forty seconds at 60 Hz of a person whose upper trunk is 400 mm above the lower.
fn standing() -> Vec<Frame> {
    let frame = |at: u32| {
        let time_s = f64::from(at) / 60.0;
        let angle = std::f64::consts::TAU * 0.3 * time_s;
        let [ap_mm, ml_mm] = [5.0 * angle.cos(), 4.0 * angle.sin()];
        let lower_mm = Some([ap_mm, ml_mm, 900.0]);
        Frame { sequence: at, time_s, lower_mm, upper_mm: Some([ap_mm, ml_mm, 1300.0]) }
    };
    (0..2400).map(frame).collect()
}

#[track_caller]
fn done(folder: &Path, arguments: &str) -> Finished {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    let finished = plumb(folder, &words);
    assert_eq!(finished.code, Some(0), "{arguments}: {}{}", finished.stdout, finished.stderr);
    finished
}

#[track_caller]
fn refused(folder: &Path, arguments: &str, parts: &[&str]) {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    let finished = plumb(folder, &words);
    assert_eq!(finished.code, Some(2), "{arguments}: {}", finished.stdout);
    for part in parts {
        assert!(finished.stderr.contains(part), "{arguments}: no {part} in {}", finished.stderr);
    }
}

type Spoil = fn(&mut Vec<Frame>);

#[test]
fn a_trial_spoiled_in_each_of_eight_ways_is_caught_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let whole: Spoil = |_| {};
    let cases: [(&str, Spoil, &str, &str); 8] = [
        ("marked", whole, "doubtful", "the box's configuration is not in the trial"),
        (
            "exchanged",
            |frames| {
                frames.iter_mut().for_each(|it| std::mem::swap(&mut it.lower_mm, &mut it.upper_mm));
            },
            "unusable",
            "upper trunk above the lower: -400 mm (at least 0)",
        ),
        ("short", |frames| frames.truncate(1200), "doubtful", "19 s (at least 25)"),
        (
            "covered",
            |frames| {
                frames[600..1860].iter_mut().for_each(|it| it.upper_mm = None);
            },
            "unusable",
            "upper trunk, frames in which it is seen: 47.5 % (at least 50)",
        ),
        (
            "lossy",
            |frames| frames.retain(|it| it.sequence % 60 < 45),
            "unusable",
            "frames lost on the way: 24.5 % (at most 20)",
        ),
        (
            "slow",
            |frames| {
                frames.retain(|it| it.sequence % 6 == 0);
                frames.iter_mut().for_each(|it| it.sequence /= 6);
            },
            "doubtful",
            "frames per second of the camera, on average: 10 (at least 49.5)",
        ),
        (
            "stalled",
            |frames| {
                frames.iter_mut().skip(1200).for_each(|it| it.time_s += 3.0);
            },
            "doubtful",
            "lower trunk, longest gap: 3.02 s (at most 0.5)",
        ),
        (
            "blind",
            |frames| {
                frames.iter_mut().for_each(|it| (it.lower_mm, it.upper_mm) = (None, None));
            },
            "unusable",
            "neither trunk's target was seen in any frame",
        ),
    ];
    for (name, spoil, grade, words) in cases {
        let mut frames = standing();
        spoil(&mut frames);
        trial::write(&folder.path().join(name), &frames, &[(0.98, "zero")]);
        let said = done(folder.path(), &format!("replay {name} --tables")).stdout;
        assert!(said.contains(&format!("verdict: {grade}")), "{name}: {said}");
        assert!(said.contains(words), "{name}: {said}");
        let manifest = std::fs::read_to_string(folder.path().join(name).join("trial.toml"));
        let manifest: toml::Table = manifest.unwrap().parse().unwrap();
        assert_eq!(manifest["verdict"]["is"].as_str(), Some(grade), "{name}");
        assert!(manifest["criteria"]["doubtful"]["duration_s_min"].as_float() == Some(25.0));
        if name == "blind" {
            refused(folder.path(), "analyze blind", &[words, "`plumb doctor`"]);
            continue;
        }
        let analyze = format!("analyze {name} --bins 0-10 --json {name}.json");
        let said = done(folder.path(), &analyze).stdout;
        assert!(said.contains(&format!("\nverdict: {grade}")) && said.contains(words), "{said}");
        let json = std::fs::read(folder.path().join(format!("{name}.json"))).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(json["verdict"]["is"], grade);
        done(folder.path(), &format!("report {name} --bins 0-10"));
        let page = std::fs::read_to_string(folder.path().join(name).join("report.html")).unwrap();
        assert!(page.contains(&format!("<section class=\"verdict {grade}\">")), "{name}");
    }
}

fn study(folder: &TempDir, unusable: &str) -> std::path::PathBuf {
    let trials: String = ["P1", "P2", "P3"]
        .iter()
        .flat_map(|who| ["calm", "hypo"].map(|condition| (who, condition)))
        .map(|(who, condition)| {
            format!(
                "[[trial]]\nfolder = \"{who}-{condition}\"\nparticipant = \"{who}\"\n\
                 condition = \"{condition}\"\n"
            )
        })
        .collect();
    let text = format!(
        "title = \"Spoiled\"\nconditions = [\"calm\", \"hypo\"]\nbins_s = [[0, 10], [10, 20]]\n\
         drop_incomplete = true\n{unusable}\n{trials}"
    );
    let path = folder.path().join("study.toml");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_study_refuses_an_unusable_trial_or_leaves_it_out_and_names_the_doubtful() {
    let folder = tempfile::tempdir().unwrap();
    for who in ["P1", "P2", "P3"] {
        for condition in ["calm", "hypo"] {
            let mut frames = standing();
            let number: f64 = who[1..].parse().unwrap();
            let scale = number + f64::from(u8::from(condition == "hypo")) * 0.5 * number;
            for frame in &mut frames {
                for point in [&mut frame.lower_mm, &mut frame.upper_mm].into_iter().flatten() {
                    (point[0], point[1]) = (scale * point[0], scale * point[1]);
                }
                if (who, condition) == ("P2", "hypo") {
                    std::mem::swap(&mut frame.lower_mm, &mut frame.upper_mm);
                }
                if (who, condition) == ("P3", "calm") && frame.sequence % 4 > 0 {
                    frame.lower_mm = None;
                }
            }
            let path = folder.path().join(format!("{who}-{condition}"));
            trial::write(&path, &frames, &[(1.0, "zero")]);
        }
    }
    study(&folder, "");
    let parts =
        ["P2-hypo: verdict: unusable: upper trunk above the lower", "unusable = \"leave_out\""];
    refused(folder.path(), "study study.toml", &parts);
    let parts = ["2 trials unusable", "P3-calm: verdict: unusable: lower trunk, frames in which"];
    refused(folder.path(), "study study.toml", &parts);
    // The others take part with all of their frames.
    let calm = folder.path().join("P3-calm");
    std::fs::remove_dir_all(&calm).unwrap();
    let scale = |mut frame: Frame| {
        for point in [&mut frame.lower_mm, &mut frame.upper_mm].into_iter().flatten() {
            (point[0], point[1]) = (3.0 * point[0], 3.0 * point[1]);
        }
        frame
    };
    trial::write(&calm, &standing().into_iter().map(scale).collect::<Vec<_>>(), &[(1.0, "zero")]);

    study(&folder, "unusable = \"leave_out\"");
    let said = done(folder.path(), "study study.toml --json study.json").stderr;
    assert!(said.contains("P2-hypo is left out: unusable: upper trunk above the lower"), "{said}");
    assert!(said.contains("P1-calm is doubtful: the box's configuration"), "{said}");
    assert!(said.contains("participant P2 is left out"), "{said}");

    // Somebody has looked at it, and says so in trial.toml.
    let path = folder.path().join("P2-hypo/trial.toml");
    done(folder.path(), "replay P2-hypo --tables");
    let text = std::fs::read_to_string(&path).unwrap();
    let by = "is = \"unusable\"\noverruled = \"good\"\nby = \"A. Smith\"\nwhy = \"a handstand\"\n";
    let text = text.replacen("is = \"unusable\"\n", by, 1);
    std::fs::write(&path, text).unwrap();
    study(&folder, "");
    let said = done(folder.path(), "study study.toml").stderr;
    assert!(said.contains("P2-hypo is good, overruled by A. Smith: a handstand"), "{said}");
    let said = done(folder.path(), "replay P2-hypo --tables").stdout;
    assert!(said.contains("overruled by A. Smith"), "{said}");
    assert!(std::fs::read_to_string(&path).unwrap().contains("why = \"a handstand\""));
    let said = done(folder.path(), "report P2-hypo --bins 0-10").stdout;
    assert!(said.contains("report.html"), "{said}");
    let page = std::fs::read_to_string(folder.path().join("P2-hypo/report.html")).unwrap();
    assert!(page.contains("A. Smith") && page.contains("the trial is unusable"));
}

#[test]
fn the_verdict_goes_with_every_export_that_has_room_for_it() {
    let folder = tempfile::tempdir().unwrap();
    trial::write(&folder.path().join("t1"), &standing(), &[(1.0, "zero")]);
    let words = "the box's configuration is not in the trial";
    let read = |name: &str| {
        let bytes = std::fs::read(folder.path().join(name)).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    for format in ["c3d", "parquet", "bids", "csv", "trc"] {
        let said = done(folder.path(), &format!("export t1 --format {format} --out t.{format}"));
        assert!(said.stderr.contains(words), "{format}: {}", said.stderr);
    }
    for name in [
        "t.c3d",
        "t.parquet",
        "t.bids/sub-p01/motion/sub-p01_task-control_tracksys-plumbline_run-1_motion.json",
    ] {
        assert!(read(name).contains(words), "{name}");
    }
    done(folder.path(), "replay t1 --tables");
    assert!(read("t1/samples.parquet").contains(words));
}

#[test]
fn a_laboratory_s_own_criteria_are_used_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    trial::write(&folder.path().join("t1"), &standing(), &[(1.0, "zero")]);
    done(folder.path(), "replay --new-criteria criteria.toml");
    refused(folder.path(), "replay --new-criteria criteria.toml", &["criteria.toml", "--force"]);
    let path = folder.path().join("criteria.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("duration_s_min = 25 ", "duration_s_min = 60 ")).unwrap();
    let said = done(folder.path(), "replay t1 --tables --criteria criteria.toml").stdout;
    assert!(said.contains("39 s (at least 60)"), "{said}");
    // From now on, without being said again.
    assert!(done(folder.path(), "replay t1 --tables").stdout.contains("39 s (at least 60)"));
    let said = done(folder.path(), "analyze t1 --bins 0-10").stdout;
    assert!(said.contains("39 s (at least 60)"), "{said}");
    std::fs::write(&path, "[doubtful]\nspeed = 3\n[unusable]\n").unwrap();
    let parts = ["criteria.toml", "speed", "--new-criteria"];
    refused(folder.path(), "replay t1 --tables --criteria criteria.toml", &parts);
    refused(folder.path(), "receive --udp 127.0.0.1:0 --out t2 --criteria criteria.toml", &parts);
}

#[test]
fn a_lost_manifest_is_made_again() {
    let folder = tempfile::tempdir().unwrap();
    trial::write(&folder.path().join("t1"), &standing(), &[(1.0, "zero")]);
    let path = folder.path().join("t1/trial.toml");
    std::fs::remove_file(&path).unwrap();
    refused(folder.path(), "analyze t1", &["trial.toml", "plumb replay TRIAL --tables"]);
    let said = done(folder.path(), "replay t1 --tables");
    // This one's packets do not say whose they are.
    assert!(said.stderr.contains("do not tell participant, condition"), "{}", said.stderr);
    done(folder.path(), "analyze t1 --bins 0-10");
    std::fs::write(&path, "format = \n").unwrap();
    let said = done(folder.path(), "replay t1 --tables");
    assert!(said.stderr.contains("the file is now t1/trial.toml.bad"), "{}", said.stderr);
    done(folder.path(), "analyze t1 --bins 0-10");
}

/// Thirty seconds of a box that was not told which way is forward: poses, and no trunk points.
fn without_a_scene(folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let begun = "2026-01-01T00:00:00Z".to_owned();
    let manifest = Manifest::begin(begun, None, None, None, Zero::Start);
    Manifest { state: State::Finished, ..manifest }.write(folder).unwrap();
    let config = Config { cam_from_scene_theta: None, ..fixture::config() };
    let mut blob = [0; BLOB_BYTES_MAX];
    std::fs::write(folder.join(names::CONFIG), config.encode(&mut blob).unwrap()).unwrap();
    let mut journal = Writer::create(&folder.join(names::JOURNAL)).unwrap();
    let mut write = |host_ns, message: &Message| {
        let mut buffer = [0; PACKET_BYTES_MAX];
        let start = Start::new(fixture::START);
        let datagram = encode_datagram(start, message, &mut buffer).unwrap().to_vec();
        journal.write(&Entry { host_ns, content: Content::Raw(Raw::Datagram(datagram)) }).unwrap();
    };
    write(0, &Message::Hello(fixture::hello(&config)));
    for sequence in 0..1800 {
        let mut packet = fixture::pose_packet(sequence);
        for target in &mut packet.targets {
            let pose = target.pose.as_mut().unwrap();
            let angle = 0.03 * sequence as f32;
            pose.translation_mm = [5.0 * angle.sin(), 3.0 * angle.cos(), 900.0 + angle.cos()];
        }
        write(packet.capture_time_ns, &Message::Pose(packet));
    }
}

#[test]
fn a_trial_without_a_scene_is_given_one() {
    let folder = tempfile::tempdir().unwrap();
    without_a_scene(&folder.path().join("p01"));
    let analyze = "analyze p01 --bins 0-10";
    refused(folder.path(), analyze, &["plumb replay TRIAL --tables --scene scene.toml"]);
    let said = done(folder.path(), "replay p01 --tables").stdout;
    assert!(said.contains("verdict: unusable") && said.contains("--scene scene.toml"), "{said}");

    let cam_from_scene_theta = fixture::config().cam_from_scene_theta.unwrap();
    let of = |lens: Lens| {
        let (source, camera) = ("measured later".to_owned(), Some(LensId::of(&lens)));
        scene::to_toml(&SceneFile { cam_from_scene_theta, source, camera })
    };
    let path = folder.path().join("scene.toml");
    let replace = "replay p01 --tables --scene scene.toml";
    let lens = fixture::config().lens;
    std::fs::write(&path, of(Lens { fx_px: lens.fx_px + 1.0, ..lens })).unwrap();
    refused(folder.path(), replace, &["scene.toml: camera: ", "another lens", "`plumb scene`"]);
    std::fs::write(&path, of(lens)).unwrap();
    done(folder.path(), replace);
    let analysed = done(folder.path(), analyze);
    assert!(analysed.stdout.contains("noise alone"), "{}", analysed.stdout);
    assert!(analysed.stderr.contains("scene by scene.toml"), "{}", analysed.stderr);
    done(folder.path(), "report p01 --bins 0-10");
    let said = done(folder.path(), "export p01 --format csv --out p01.csv").stdout;
    assert!(said.contains("1800 rows"), "{said}");
    // What is shown is what the figures are by.
    let shown = done(folder.path(), "show p01");
    assert!(shown.stdout.contains("# scene.toml") && shown.stderr.contains("verdict: "));
    let crc = format!("{:08x}", fixture::config().crc());
    assert!(shown.stderr.contains(&crc), "{}", shown.stderr);

    refused(
        folder.path(),
        "replay p01 --tables --scene scene.toml --as-recorded",
        &["--as-recorded", "--scene"],
    );
    done(folder.path(), "replay p01 --tables --as-recorded");
    refused(folder.path(), analyze, &["--scene scene.toml"]);
}
