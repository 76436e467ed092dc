//! The uncertainty budget by the program itself, of a rendered trial whose truth is known.

use std::path::Path;
use std::sync::LazyLock;

use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::image::GreyImage;
use plumbline::packet::{MarkedInstant, Message, PosePacket};
use plumbline::pipeline::Pipeline;
use plumbline::scene::Anatomical;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_analysis::series::Series;
use plumbline_analysis::sway::{Prepared, Settings};
use plumbline_files::camera::{Camera, Details, Deviations, Provenance, to_toml};
use plumbline_render::simulate::{Simulation, SimulationSettings};
use plumbline_stream::fixture::adversity::hello_of;
use plumbline_stream::fixture::{START, packet};
use plumbline_trial::journal::{Entry, Writer};
use plumbline_trial::manifest::{Manifest, Zero};
use serde_json::Value;
use tempfile::TempDir;

use crate::common::finished::{self, Finished};
use crate::common::trial;

const RATE_HZ: f64 = 20.0;
const FRAMES: u64 = 60;

/// Searching takes some frames: the first one is shown that often before the recording.
const BEFORE: u64 = 40;

/// One standard uncertainty of the focal lengths, and of the print's scale as a part.
const FOCAL_SD_PX: f64 = 1.5;
const SCALE_U: f64 = 0.002;

/// A person, and three seconds of pictures.
static RENDERED: LazyLock<(Simulation, Vec<Vec<u8>>)> = LazyLock::new(|| {
    let settings = SimulationSettings { frame_rate_hz: RATE_HZ, seed: 3, ..Default::default() };
    let simulation = Simulation::new(&settings).unwrap();
    let frames = (0..FRAMES).map(|frame| {
        let mut samples = Vec::new();
        simulation.render(frame, &mut samples);
        samples
    });
    let frames = frames.collect();
    (simulation, frames)
});

/// What the box believes: focal lengths that are too long, and targets that are too large, by so
/// many standard uncertainties.
fn believed(focal: f64, scale: f64) -> Config {
    let mut config = RENDERED.0.config();
    config.lens.fx_px += focal * FOCAL_SD_PX;
    config.lens.fy_px += focal * FOCAL_SD_PX;
    for target in &mut config.targets {
        let it = &target.geometry;
        target.geometry = TargetGeometry::checker(
            it.columns() as u8,
            it.rows() as u8,
            it.pitch_mm() * (1.0 + scale * SCALE_U),
            Origin::Center,
            it.role(),
            it.virtual_point_mm().into(),
        )
        .unwrap();
    }
    config
}

/// The trial that a box with this configuration records.
fn record(folder: &Path, config: &Config) {
    let (simulation, frames) = &*RENDERED;
    let lens = simulation.camera();
    let [width, height] = [lens.width_px, lens.height_px].map(usize::from);
    std::fs::create_dir(folder).unwrap();
    let manifest =
        Manifest::begin("2026-01-01T00:00:00Z".to_owned(), None, None, None, Zero::Start);
    manifest.write(folder).unwrap();
    let mut blob = [0; BLOB_BYTES_MAX];
    std::fs::write(folder.join("config.plb"), config.encode(&mut blob).unwrap()).unwrap();
    let mut journal = Writer::create(&folder.join("packets.bin")).unwrap();
    let hello = trial::content(&hello_of("ward 3", START));
    journal.write(&Entry { host_ns: 0, content: hello }).unwrap();
    let mut pipeline = Box::new(Pipeline::new());
    pipeline.configure(config).unwrap();
    for step in 0..BEFORE + FRAMES {
        let frame = step.saturating_sub(BEFORE);
        let image = GreyImage::new(&frames[frame as usize], width, height, width).unwrap();
        let time_ns = 1_000_000_000 + (step as f64 * 1e9 / RATE_HZ) as u64;
        let report = pipeline.step(&image, time_ns);
        if step < BEFORE {
            continue;
        }
        assert!(report.targets.iter().all(|it| it.measurement.is_ok()), "frame {frame}");
        let pose = PosePacket::from_report(&report, MarkedInstant::Recording, 4000);
        let content = trial::content(&packet(START, Message::Pose(pose)));
        journal.write(&Entry { host_ns: time_ns, content }).unwrap();
    }
    journal.sync().unwrap();
}

/// A camera file in which nothing but the focal lengths is uncertain.
fn camera(config: &Config, correlations: Vec<Vec<f64>>) -> String {
    let coefficients = config.lens.distortion.coefficients().len();
    to_toml(&Camera {
        lens: config.lens,
        readout_ns: 0,
        provenance: Provenance {
            details: Some(Details {
                verdict: Vec::new(),
                coverage: Vec::new(),
                correlations,
                freedom: Some(900),
                sd: Deviations {
                    fx_px: FOCAL_SD_PX,
                    fy_px: FOCAL_SD_PX,
                    cx_px: 1e-4,
                    cy_px: 1e-4,
                    skew_px: 1e-4,
                    distortion: vec![1e-8; coefficients],
                },
                photographs: Vec::new(),
            }),
            ..Provenance::default()
        },
    })
}

/// The focal lengths are wrong together, if at all.
fn correlations(config: &Config) -> Vec<Vec<f64>> {
    let numbers = 5 + config.lens.distortion.coefficients().len();
    (0..numbers)
        .map(|row| (0..row).map(|column| if (row, column) == (1, 0) { 1.0 } else { 0.0 }).collect())
        .collect()
}

fn setting(focal: f64, scale: f64) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let config = believed(focal, scale);
    record(&folder.path().join("p01"), &config);
    let text = camera(&config, correlations(&config));
    std::fs::write(folder.path().join("camera.toml"), text).unwrap();
    folder
}

fn plumb(folder: &TempDir, arguments: &str) -> Finished {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    finished::plumb(folder.path(), &words)
}

/// The figures of a budget, by their names.
fn budget(folder: &TempDir) -> Vec<(String, Value)> {
    let finished = plumb(folder, "budget p01 --camera camera.toml --json out.json --force");
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let json: Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("out.json")).unwrap()).unwrap();
    let figures = json["figures"].as_array().unwrap().iter().map(|it| {
        let part = |field: &str| it[field].as_str().unwrap().to_owned();
        (format!("{} {} {}", part("point"), part("quantity"), part("direction")), it.clone())
    });
    figures.collect()
}

fn number(figure: &Value, field: &str) -> f64 {
    figure[field].as_f64().unwrap_or_else(|| panic!("{field} of {figure}"))
}

/// What each frame's truth is, along AP, ML and SI.
fn true_path_mm(role: Role) -> f64 {
    let (simulation, _) = &*RENDERED;
    let at = simulation.targets().iter().position(|it| it.layout.role == role).unwrap();
    let points: Vec<Anatomical> =
        (0..FRAMES).map(|frame| simulation.truth(frame).targets[at].trunk_point).collect();
    let time_s = (0..FRAMES).map(|frame| frame as f64 / RATE_HZ).collect();
    let along = |of: fn(&Anatomical) -> f64| points.iter().map(of).collect();
    let series =
        Series::new(time_s, [along(|it| it.ap_mm), along(|it| it.ml_mm), along(|it| it.si_mm)]);
    let settings = Settings::default();
    let (figures, _) = Prepared::of(&series.unwrap(), &settings).unwrap().lengths(None).unwrap();
    figures.path.length_mm.planes.transverse.value().unwrap()
}

#[test]
fn a_rendered_trial_is_as_wrong_as_its_budget_says() {
    // Everything as it is believed to be; then wrong by one standard uncertainty each.
    let (right, wrong) = (budget(&setting(0.0, 0.0)), budget(&setting(1.0, 1.0)));
    for (role, point) in [(Role::Lower, "lower"), (Role::Upper, "upper")] {
        let name = format!("{point} path transverse");
        let find = |all: &[(String, Value)]| all.iter().find(|it| it.0 == name).unwrap().1.clone();
        let truth_mm = true_path_mm(role);
        let right = find(&right);
        let error_mm = number(&right, "measured") - number(&right, "noise_adds") - truth_mm;
        let noise_mm = number(&right["contributions"][6], "u");
        println!("{name}: {truth_mm:.3} mm, error {error_mm:.4} mm, noise {noise_mm:.4} mm");
        assert!(error_mm.abs() < 3.0 * noise_mm, "{name}: {error_mm} mm, noise {noise_mm} mm");
        let wrong = find(&wrong);
        let error_mm = number(&wrong, "measured") - number(&wrong, "noise_adds") - truth_mm;
        assert!(error_mm.abs() < number(&wrong, "expanded"), "{name}: {wrong}");
    }
    // The same pictures through two beliefs: their noise is the same, so the figures differ by
    // what the beliefs do. Too large a print makes everything larger; too long a lens, depths.
    let mut compared = 0;
    for ((name, right), (_, wrong)) in right.iter().zip(&wrong) {
        let contributions = &right["contributions"];
        let terms = [&contributions[0]["term"], &contributions[2]["term"]];
        assert_eq!(terms, ["scale", "lens"]);
        let [scale, lens] = [0, 2].map(|at| number(&contributions[at], "u"));
        let change = (number(wrong, "measured") - number(right, "measured")).abs();
        println!("{name}: changes by {change:.5}, scale {scale:.5}, lens {lens:.5}");
        // To first order the effects add, each with its sign. What is left is the second order,
        // edges that the tracker weights by their contrast, and poses of 32 bits (6e-5 mm).
        let off = [scale + lens, (scale - lens).abs()].map(|it| (change - it).abs());
        let slack = 0.04 * (scale + lens) + 0.0003;
        assert!(off.iter().any(|it| *it < slack), "{name}: {change}");
        compared += 1;
    }
    assert_eq!(compared, 33);
}

#[test]
fn a_print_far_too_large_is_not_covered() {
    let folder = setting(0.0, 5.0);
    let (_, path) = budget(&folder).into_iter().find(|it| it.0 == "lower path transverse").unwrap();
    let error_mm = number(&path, "measured") - true_path_mm(Role::Lower);
    assert!(error_mm > number(&path, "expanded"), "{error_mm}: {path}");
}

#[test]
fn the_table_and_the_report_name_every_cause() {
    let folder = setting(0.0, 0.0);
    let said = plumb(&folder, "budget --new budget.toml");
    assert_eq!(said.code, Some(0), "{}", said.stderr);
    let with = "--camera camera.toml --budget budget.toml";
    let table = plumb(&folder, &format!("budget p01 {with} --span 0.5-2.5"));
    assert_eq!(table.code, Some(0), "{}", table.stderr);
    let report = plumb(&folder, &format!("report p01 {with} --out report.html"));
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    println!("{}", table.stdout);
    for text in [&table.stdout, &page] {
        for part in [
            "scale of the print",
            "calibration of the lens",
            "all trials with this calibration",
            "random, from frame to frame",
            "95 % ellipse transverse (mm²)",
            "distance of both points 3D (mm)",
            "rolling shutter",
        ] {
            assert!(text.contains(part), "no {part:?} in {text}");
        }
    }
    assert!(table.stdout.contains("0.5 to 2.5 s; filter: Savitzky-Golay"), "{}", table.stdout);
    // The ± of the figures themselves says what is in it, and what is not.
    let figures = plumb(&folder, "analyze p01 --json p01.json");
    let json = |name: &str| -> Value {
        serde_json::from_slice(&std::fs::read(folder.path().join(name)).unwrap()).unwrap()
    };
    assert_eq!(json("p01.json")["uncertainty_contains"].to_string(), r#"["noise"]"#);
    for text in [&figures.stdout, &page] {
        for part in ["path length (mm) ± noise", "the scale of the print", "`plumb budget` adds"] {
            assert!(text.contains(part), "no {part:?} in {text}");
        }
    }
    plumb(&folder, &format!("budget p01 {with} --json budget.json"));
    let all = r#"["print","lens","flatness","axes","noise","timing","steps"]"#;
    assert_eq!(json("budget.json")["uncertainty_contains"].to_string(), all);
    // A ruler that is off is an error, not an uncertainty.
    let off = "[print]\nmeasured_mm = 99.2\n";
    std::fs::write(folder.path().join("budget.toml"), off).unwrap();
    let warned = plumb(&folder, &format!("budget p01 {with}"));
    let expected = "every length is 0.80 % too long";
    assert!(warned.stderr.contains(expected), "{}", warned.stderr);
}

#[test]
fn what_a_budget_cannot_be_made_of_is_named() {
    let folder = setting(0.0, 0.0);
    let path = |name: &str| folder.path().join(name);
    trial::write(&path("empty"), &[], &[]);
    let frame = |at: u32| {
        let position_mm = Some([f64::from(at % 7), f64::from(at % 5), 900.0]);
        let time_s = f64::from(at) / 60.0;
        trial::Frame { sequence: at, time_s, lower_mm: position_mm, upper_mm: position_mm }
    };
    trial::write(&path("bare"), &(0..100).map(frame).collect::<Vec<_>>(), &[]);
    let config = believed(0.0, 0.0);
    std::fs::write(path("old.toml"), camera(&config, Vec::new())).unwrap();
    let other = believed(1.0, 0.0);
    std::fs::write(path("other.toml"), camera(&other, correlations(&other))).unwrap();
    let rolling =
        camera(&config, correlations(&config)).replace("model =", "readout_ms = 12\nmodel =");
    std::fs::write(path("rolling.toml"), rolling).unwrap();
    std::fs::write(path("negative.toml"), "[print]\nu_mm = -0.1\n").unwrap();
    let cases = [
        ("budget p01", "--camera <FILE>"),
        ("budget", "--new"),
        ("budget empty --camera camera.toml", "neither trunk's target was seen in any frame"),
        ("budget bare --camera camera.toml", "the box's configuration is not known"),
        ("budget nowhere --camera camera.toml", "not the folder of a trial"),
        ("budget p01 --camera old.toml", "calibration.correlations"),
        ("budget p01 --camera other.toml", "not the lens with which p01 was measured"),
        ("budget p01 --camera rolling.toml", "readout_ms: 12 ms, where p01 was measured with 0 ms"),
        ("budget p01 --camera camera.toml --budget negative.toml", "print.u_mm: -0.1"),
        ("budget p01 --camera camera.toml --span 50-60", "fewer than two samples in the span"),
        ("report p01 --camera old.toml", "calibrate again"),
    ];
    for (arguments, part) in cases {
        let finished = plumb(&folder, arguments);
        assert_eq!(finished.code, Some(2), "{arguments}: {}", finished.stderr);
        assert!(finished.stderr.contains(part), "{arguments}: {}", finished.stderr);
    }
}
