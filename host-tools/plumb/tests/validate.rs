//! What `plumb validate` finds in recordings whose differences are known, and what it says of
//! those that do not belong together.

use crate::common::trial;
use plumbline_test_support::data;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;

use crate::common::finished::{Finished, plumb};
use crate::common::trial::Frame;
use plumbline_trial::markers::Markers;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use serde_json::Value;

const RATE_HZ: f64 = 60.0;
const SECONDS: f64 = 60.0;

/// The camera shows a movement so much later than the reference.
const LAG_S: f64 = 1.2345;

/// Of the camera, along each axis.
const NOISE_MM: f64 = 0.3;

/// What the camera makes of a millimetre along AP; along the others it is right.
const SCALE_AP: f64 = 1.02;

/// Origin of the camera less that of the reference.
const OFFSET_MM: [f64; 3] = [120.0, -35.0, 900.0];

/// A person's sway along AP, ML, SI: sums of sines up to 1.3 Hz, RMS 7, 3.8 and 0.4 mm.
fn sway_mm(time_s: f64) -> [f64; 3] {
    let sum = |parts: [(f64, f64); 3]| -> f64 {
        parts.iter().map(|(hz, mm)| mm * (TAU * hz * time_s).sin()).sum()
    };
    [
        sum([(0.11, 9.0), (0.37, 4.0), (1.30, 0.7)]),
        sum([(0.17, 5.0), (0.53, 2.0), (0.90, 0.5)]),
        sum([(0.23, 0.5), (0.71, 0.2), (1.10, 0.1)]),
    ]
}

/// The trial as the camera measures it.
fn write_trial(folder: &Path, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, NOISE_MM).unwrap();
    let frames: Vec<Frame> = (0..(RATE_HZ * SECONDS) as usize)
        .map(|frame| {
            let time_s = frame as f64 / RATE_HZ;
            let [ap, ml, si] = sway_mm(time_s - LAG_S);
            let exact = [SCALE_AP * ap, ml, si];
            let lower = [0, 1, 2].map(|it| exact[it] + OFFSET_MM[it] + normal.sample(&mut random));
            Frame { sequence: frame as u32, time_s, lower_mm: Some(lower), upper_mm: None }
        })
        .collect();
    trial::write(folder, &frames, &[]);
}

/// The reference: 150 Hz, metres, forward along Z, left along X, up along Y, and a marker that
/// does not move. Between the samples a line is off by less than 1e-3 mm.
fn trc(span_s: Range<f64>, unit: &str) -> String {
    let frames = ((span_s.end - span_s.start) * 150.0) as usize;
    let mut text = format!(
        "PathFileType\t4\t(X/Y/Z)\tp01.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n\
         150\t150\t{frames}\t2\t{unit}\nFrame#\tTime\tsacrum\t\t\tfloor\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    );
    for frame in 0..frames {
        let time_s = span_s.start + frame as f64 / 150.0;
        let [ap, ml, si] = sway_mm(time_s).map(|it| 1e-3 * it);
        writeln!(text, "{}\t{time_s:.3}\t{}\t{si}\t{ap}\t0.1\t0.2\t0.3", frame + 1, -ml).unwrap();
    }
    text
}

const AXES: &str = "ap=Z,ml=-X,si=Y";

/// A trial and its reference in a new directory.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_trial(&folder.path().join("trial"), 1);
    std::fs::write(folder.path().join("p01.trc"), trc(0.0..58.0, "m")).unwrap();
    folder
}

fn validate(folder: &Path, more: &[&str]) -> Finished {
    let arguments: Vec<&str> = ["validate"].into_iter().chain(more.iter().copied()).collect();
    plumb(folder, &arguments)
}

const PAIR: [&str; 8] =
    ["--trial", "trial", "--reference", "p01.trc", "--marker", "sacrum", "--axes", AXES];

/// The JSON of a run that must succeed.
fn found(folder: &Path, more: &[&str]) -> (Value, Finished) {
    let json = ["--json", "found.json", "--force"];
    let arguments: Vec<&str> = more.iter().chain(&json).copied().collect();
    let done = validate(folder, &arguments);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    let text = std::fs::read_to_string(folder.join("found.json")).unwrap();
    (serde_json::from_str(&text).unwrap(), done)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// With n = 3480 pairs (58 s): sd within 1.2 % (1 / sqrt(2 n)), slopes within NOISE / (RMS sqrt n)
/// = 7e-4 for AP, 1.4e-3 for ML, lag within NOISE / (velocity's RMS sqrt n) = 4e-4 s. Bounds are 4
/// times that; along AP the camera's scale adds 0.14 mm to the differences.
#[test]
fn a_known_difference_is_found() {
    let folder = bench();
    let (json, done) = found(folder.path(), &PAIR);
    assert!(done.stdout.contains("the bias is 0 by construction"), "{}", done.stdout);
    assert!(done.stdout.contains("lag 1.23"), "{}", done.stdout);
    let pair = &json["pairs"][0];
    assert!((number(&pair["lag_s"]) - LAG_S).abs() < 1.6e-3, "{pair}");
    assert!(number(&pair["correlation"]) > 0.99, "{pair}");
    // All 58 s of the reference are in the trial's minute.
    assert!((number(&pair["samples"]) - 3480.0).abs() <= 1.0, "{pair}");
    for (axis, (scale, rms_mm)) in [(SCALE_AP, 7.0), (1.0, 3.8), (1.0, 0.39)].iter().enumerate() {
        let it = &json["axes"][axis];
        let agreement = &it["bland_altman"];
        assert!(number(&agreement["bias"]).abs() < 1e-9, "{it}");
        let sd_mm = NOISE_MM.hypot((scale - 1.0) * rms_mm);
        assert!((number(&agreement["sd"]) / sd_mm - 1.0).abs() < 0.05, "{axis}: {it}");
        let upper = number(&agreement["upper_limit"]["value"]);
        assert!((upper - 1.96 * number(&agreement["sd"])).abs() < 1e-9, "{it}");
        let slope = number(&it["regression"]["slope"]);
        let within = 4.0 * NOISE_MM / (rms_mm * 3480.0_f64.sqrt());
        assert!((slope - scale).abs() < within, "{axis}: {slope}");
        let offset_mm = number(&pair["offset_mm"][axis]);
        assert!((offset_mm - OFFSET_MM[axis]).abs() < 0.1, "{offset_mm}");
    }
    // White noise is independent; what is left of the movement along AP is not.
    let effective = |axis: usize| number(&json["axes"][axis]["bland_altman"]["effective_samples"]);
    assert!(effective(1) > 2000.0 && effective(0) < 0.5 * effective(1));
}

#[test]
fn positions_that_are_kept_have_their_bias() {
    let folder = bench();
    let more: Vec<&str> = PAIR.into_iter().chain(["--keep-origins"]).collect();
    let (json, done) = found(folder.path(), &more);
    assert!(!done.stdout.contains("by construction"), "{}", done.stdout);
    for (axis, offset_mm) in OFFSET_MM.iter().enumerate() {
        let bias = number(&json["axes"][axis]["bland_altman"]["bias"]);
        // The mean of the noise, and of the scale's share of the movement.
        assert!((bias - offset_mm).abs() < 0.05, "{bias}");
    }
}

#[test]
fn an_event_that_both_have_aligns_the_clocks() {
    let folder = bench();
    let event = format!("{}", -LAG_S);
    let more: Vec<&str> =
        PAIR.into_iter().chain(["--align", "events", "--event", &event]).collect();
    let (json, _) = found(folder.path(), &more);
    assert_eq!(json["pairs"][0]["lag_s"], LAG_S);
    assert_eq!(json["pairs"][0]["correlation"], Value::Null);
    // The event says it all.
    let more: Vec<&str> = PAIR.into_iter().chain(["--event", &event]).collect();
    let (by_event, _) = found(folder.path(), &more);
    assert_eq!(by_event, json);
    // Without any alignment the movement itself is the difference.
    let more: Vec<&str> = PAIR.into_iter().chain(["--align", "none"]).collect();
    let (unaligned, _) = found(folder.path(), &more);
    let sd = |json: &Value| number(&json["axes"][0]["bland_altman"]["sd"]);
    assert!(sd(&unaligned) > 10.0 * sd(&json));
}

#[test]
fn the_trials_of_a_manifest_are_joined_and_drawn() {
    let folder = bench();
    write_trial(&folder.path().join("second"), 2);
    let table: String = (0..6000)
        .map(|at| {
            let time_s = f64::from(at) / 100.0;
            let [ap, ml, si] = sway_mm(time_s);
            format!("{time_s},{ap},{ml},{si}\n")
        })
        .collect();
    std::fs::write(folder.path().join("p02.csv"), format!("t,x,y,z\n{table}")).unwrap();
    let manifest = format!(
        "[[pair]]\ntrial = \"trial\"\nreference = \"p01.trc\"\nmarkers = [\"sacrum\"]\naxes = \"{AXES}\"\n\
         [[pair]]\ntrial = \"second\"\nreference = \"p02.csv\"\ncolumns = \"time=t,ap=x,ml=y,si=z\"\n\
         unit = \"mm\"\n"
    );
    std::fs::write(folder.path().join("validate.toml"), manifest).unwrap();
    let more = ["--manifest", "validate.toml", "--plot", "agreement.svg"];
    let (json, _) = found(folder.path(), &more);
    let samples: f64 = (0..2).map(|pair| number(&json["pairs"][pair]["samples"])).sum();
    assert_eq!(number(&json["axes"][0]["bland_altman"]["n"]), samples);
    assert!(samples > 6900.0);
    let svg = std::fs::read_to_string(folder.path().join("agreement.svg")).unwrap();
    for words in ["AP: bias", "origins aligned", "SI: y = ", "prefers-color-scheme: dark"] {
        assert!(svg.contains(words), "{words}");
    }
    std::fs::write(folder.path().join("validate.toml"), "[[pair]]\ntrail = \"x\"\n").unwrap();
    let refused = validate(folder.path(), &more[..2]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("validate.toml: trail (line 2)"), "{}", refused.stderr);
}

#[test]
fn a_pair_of_a_manifest_is_aligned_by_its_event_and_says_nothing_in_vain() {
    let folder = bench();
    let pair = |more: &str| {
        let pair = format!(
            "[[pair]]\ntrial = \"trial\"\nreference = \"p01.trc\"\nmarkers = [\"sacrum\"]\n\
             axes = \"{AXES}\"\n{more}\n"
        );
        std::fs::write(folder.path().join("validate.toml"), pair).unwrap();
    };
    pair(&format!("event = {}", -LAG_S));
    let (json, _) = found(folder.path(), &["--manifest", "validate.toml"]);
    assert_eq!(
        (&json["pairs"][0]["align"], number(&json["pairs"][0]["lag_s"])),
        (&"events".into(), LAG_S)
    );
    for (more, part) in [
        ("event = 1.0\nalign = \"lag\"", "--event: "),
        ("lag_max = 5.0\nalign = \"none\"", "--lag-max: "),
        ("columns = \"time=t,ap=x\"", "p01.trc: --columns: "),
        ("delimiter = \"tab\"", "p01.trc: --delimiter: "),
    ] {
        pair(more);
        let refused = validate(folder.path(), &["--manifest", "validate.toml"]);
        assert_eq!(refused.code, Some(2), "{more}: {}", refused.stdout);
        assert!(refused.stderr.contains(part), "{more}: {}", refused.stderr);
    }
    let table = "[[pair]]\ntrial = \"trial\"\nreference = \"p02.csv\"\nunit = \"mm\"\n\
                 columns = \"time=t,ap=x\"\naxes = \"ap=X\"\n";
    std::fs::write(folder.path().join("validate.toml"), table).unwrap();
    let refused = validate(folder.path(), &["--manifest", "validate.toml"]);
    assert!(refused.stderr.contains("p02.csv: --axes: "), "{}", refused.stderr);
}

#[test]
fn what_does_not_belong_together_is_said() {
    let folder = bench();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    write("short.trc", trc(0.0..0.05, "m"));
    write("later.trc", trc(500.0..530.0, "m"));
    write("cut.trc", trc(0.0..58.0, "m").chars().take(100_000).collect());
    write("p01.txt", trc(0.0..1.0, "m"));
    let pair = |reference: &'static str, more: &[&'static str]| {
        let both = ["--trial", "trial", "--reference", reference];
        let done = validate(folder.path(), &[&both[..], more].concat());
        assert_eq!(done.code, Some(2), "{}{}", done.stdout, done.stderr);
        done.stderr
    };
    let with = |parts: &[&'static str]| -> Vec<&'static str> {
        ["--axes", AXES].into_iter().chain(parts.iter().copied()).collect()
    };
    let marker = with(&["--marker", "sacrum"]);
    let cases = [
        (
            pair("p01.trc", &with(&["--marker", "C7"])),
            "C7: no such marker; there are sacrum, floor",
        ),
        (pair("p01.trc", &with(&[])), "no marker is named; there are sacrum, floor"),
        (pair("p01.trc", &with(&["--marker", "floor"])), "the reference does not move"),
        (
            pair("p01.trc", &[&marker[..], &["--unit", "mm"]].concat()),
            "the file says m, and --unit",
        ),
        (pair("p01.trc", &["--marker", "sacrum", "--axes", "ap=Q"]), "\"Q\" is not X, Y or Z"),
        (pair("p01.trc", &[&marker[..], &["--align", "events"]].concat()), "--event SECONDS"),
        (pair("p01.trc", &[&marker[..], &["--point", "upper"]].concat()), "no frame has the upper"),
        (pair("later.trc", &marker), "at only 0 times: the measurement is from 0.00"),
        (pair("short.trc", &[&marker[..], &["--align", "none"]].concat()), "at only 3 times"),
        (pair("cut.trc", &marker), "cut.trc: "),
        (pair("absent.trc", &marker), "no such file"),
        (pair("p01.txt", &[]), "neither TRC nor C3D by its name"),
    ];
    for (said, part) in cases {
        assert!(said.contains(part), "{said} without {part}");
    }
    // Axes that run the other way are warned of. (Sines have other lags at which they fit.)
    let mirrored = ["--marker", "sacrum", "--axes", "ap=Z,ml=X,si=Y", "--lag-max", "2"];
    let both = ["--trial", "trial", "--reference", "p01.trc"];
    let done = validate(folder.path(), &[&both[..], &mirrored].concat());
    assert!(done.stderr.contains("correlation with the reference is only 0.5"), "{}", done.stderr);
    assert!(done.stderr.contains("ML of the reference runs the other way"), "{}", done.stderr);
}

#[test]
fn the_report_of_a_trial_shows_what_validate_finds() {
    let folder = bench();
    let (_, done) = found(folder.path(), &PAIR);
    let report = |more: &[&str]| {
        let arguments: Vec<&str> = ["report"].into_iter().chain(more.iter().copied()).collect();
        plumb(folder.path(), &arguments)
    };
    // The pair's options but for --trial, which is the report's subject.
    let more: Vec<&str> =
        ["trial", "--out", "p01.html"].into_iter().chain(PAIR[2..].iter().copied()).collect();
    let reported = report(&more);
    assert_eq!(reported.code, Some(0), "{}", reported.stderr);
    let page = std::fs::read_to_string(folder.path().join("p01.html")).unwrap();
    let lines = done.stdout.lines().filter(|line| line.contains("limit (mm)"));
    let limits: Vec<&str> = lines.flat_map(|line| line.split("  ")).map(str::trim).collect();
    let limits: Vec<&&str> = limits.iter().filter(|it| it.contains('[')).collect();
    assert_eq!(limits.len(), 2 * 3, "{}", done.stdout);
    for limit in limits {
        let limit = limit.trim_end_matches([' ', '│']);
        assert!(page.contains(&format!("<td>{limit}</td>")), "no {limit}");
    }
    assert!(page.contains("lag 1.23") && page.contains("p01.trc"));
    // The figures' spectra are not those of the plots.
    assert!(page.contains("F95: of the periodogram") && page.contains("spectra alone: Welch"));
    // Three axes of one trunk, three planes, the spectra, and two of each axis' agreement.
    assert_eq!(page.matches("<figure").count(), 3 + 3 + 1 + 2 * 3);
    let event = format!("{}", -LAG_S);
    let by_event = ["--align", "events", "--event", &event, "--force"];
    assert_eq!(report(&[&more[..], &by_event].concat()).code, Some(0));
    let page = std::fs::read_to_string(folder.path().join("p01.html")).unwrap();
    assert!(page.contains("lag 1.2345 s, by an event that both have"));

    std::fs::write(folder.path().join("study.toml"), "").unwrap();
    for (more, part) in [
        (&["trial", "--marker", "sacrum"][..], "trial: --marker: an option of a reference"),
        (&["trial", "--keep-origins"], "trial: --keep-origins: an option of a reference"),
        (&["trial", "--reference", "absent.trc"], "no such file"),
        (
            &["study.toml", "--reference", "p01.trc"],
            "study.toml: --reference: an option of a trial",
        ),
    ] {
        let refused = report(more);
        assert_eq!(refused.code, Some(2), "{more:?}");
        assert!(refused.stderr.contains(part), "{more:?}: {}", refused.stderr);
    }
    let both = validate(folder.path(), &["--manifest", "x.toml", "--reference", "p01.trc"]);
    assert!(both.stderr.contains("cannot be used with"), "{}", both.stderr);
}

/// A trial's own C3D is a perfect reference: but for single precision nothing differs.
#[test]
fn an_exported_c3d_agrees_with_its_trial() {
    let folder = bench();
    let export = ["export", "trial", "--format", "c3d", "--out", "own.c3d"];
    assert_eq!(plumb(folder.path(), &export).code, Some(0));
    let more = ["--trial", "trial", "--reference", "own.c3d", "--marker", "lower_trunk"];
    let (json, _) = found(folder.path(), &more);
    // The rate is in single precision: after a minute 2e-6 s.
    assert!(number(&json["pairs"][0]["lag_s"]).abs() < 1e-5, "{json}");
    for axis in 0..3 {
        assert!(number(&json["axes"][axis]["rms_mm"]) < 1e-3, "{json}");
        assert!((number(&json["axes"][axis]["regression"]["slope"]) - 1.0).abs() < 1e-4);
    }
}

#[test]
fn a_c3d_that_is_damaged_is_refused_or_read_and_never_panics() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Frame> = (0..40)
        .map(|frame| Frame {
            sequence: frame,
            time_s: f64::from(frame) / RATE_HZ,
            lower_mm: (frame != 7).then_some([f64::from(frame), 2.0, 3.0]),
            upper_mm: Some([4.0, 5.0, 6.0]),
        })
        .collect();
    trial::write(&folder.path().join("trial"), &frames, &[]);
    let export = ["export", "trial", "--format", "c3d", "--out", "own.c3d"];
    assert_eq!(plumb(folder.path(), &export).code, Some(0));
    let path = folder.path().join("own.c3d");
    let good = std::fs::read(&path).unwrap();
    let whole = Markers::read(&path).unwrap();
    assert_eq!(whole.markers[0].name, "lower_trunk");
    let at = |frame: usize| whole.markers[0].position[frame];
    assert_eq!((at(6), at(7), at(8)), (Some([6.0, -2.0, 3.0]), None, Some([8.0, -2.0, 3.0])));
    let damaged = folder.path().join("damaged.c3d");
    let read = |bytes: &[u8]| {
        std::fs::write(&damaged, bytes).unwrap();
        Markers::read(&damaged)
    };
    let data = 512 * (usize::from(u16::from_le_bytes([good[16], good[17]])) - 1);
    // What is cut off within the data is refused, at every length.
    for length in (0..data + 40 * 32).step_by(37) {
        let error = read(&good[..length]).unwrap_err().to_string();
        assert!(error.contains("damaged.c3d: "), "{length}: {error}");
    }
    // One byte changed: whatever is read has all the frames.
    let mut refused = 0;
    for place in 0..data {
        for flip in [0x41, 0xff] {
            let mut bytes = good.clone();
            bytes[place] ^= flip;
            match read(&bytes) {
                Ok(markers) => assert_eq!(markers.markers[0].position.len(), 40, "{place}"),
                Err(_) => refused += 1,
            }
        }
    }
    // At least the bytes that say how many, and of what kind.
    assert!(refused > 40, "{refused}");
}

/// A real recording; the numbers are those of its text.
#[test]
fn a_recording_of_motion_capture_is_read() {
    let Some(path) = data("sway/static_run.trc.gz") else { return };
    let markers = Markers::read(&path).unwrap();
    assert_eq!((markers.markers.len(), markers.rate_hz, markers.first_s), (78, 150.0, 0.0));
    assert!(markers.markers.iter().all(|it| it.position.len() == 1500));
    assert!(markers.markers.iter().all(|it| it.position.iter().all(Option::is_some)));
    let marker = markers.markers.iter().find(|it| it.name == "LACR").unwrap();
    assert_eq!(marker.position[0], Some([713.7804, 1395.9895, 1047.50989]));
    assert_eq!(marker.position[1], Some([713.81598, 1396.00439, 1047.5166]));
}

#[test]
fn a_number_beyond_any_room_is_no_panic() {
    let folder = bench();
    let path = folder.path().join("p01.trc");
    let text = std::fs::read_to_string(&path).unwrap();
    // Fields of the first marker in the hundredth frame.
    let lines: Vec<&str> = text.lines().collect();
    for wrong in ["1e160", "1e300", "-1.7e308"] {
        let mut fields: Vec<&str> = lines[105].split('\t').collect();
        fields[2] = wrong;
        let line = fields.join("\t");
        let mut lines = lines.clone();
        lines[105] = &line;
        std::fs::write(&path, lines.join("\n")).unwrap();
        // `plumb` itself looks for a panic's message.
        let done = validate(folder.path(), &PAIR);
        let says_so = done.code == Some(2) || done.stderr.contains("correlation");
        assert!(says_so, "{:?} {} {}", done.code, done.stdout, done.stderr);
    }
}
