//! Thousands of simulated trials of a minute: what each costs, in seconds, memory and bytes, and that
//! the ten thousandth costs no more than the hundredth.
//!
//! Sway is simulated as an autoregressive process: each participant's is wider or narrower by a
//! factor, it widens with age, and without sight by half. So the figures have a truth.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use plumbline::pose::{Pose, Scene, Target};
use plumbline::target::Role;
use plumbline_stream::fixture::config;
use plumbline_test_support::{program, python};
use plumbline_trial::test_trial::Made;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use rayon::prelude::*;

/// How many at most, where that is less than the test's own number.
const TRIALS: &str = "PLUMBLINE_COHORT_TRIALS";

/// After so many, what they cost is printed.
const STAGES: [usize; 4] = [10, 100, 1000, 10_000];

/// So many are in folders at once: some 400 MB.
const BATCH: usize = 500;

const CONDITIONS: [(&str, f64); 2] = [("eyes-open", 1.0), ("eyes-closed", WITHOUT_SIGHT)];

/// How much wider sway is without sight.
const WITHOUT_SIGHT: f64 = 1.5;

const HZ: u32 = 60;
const SECONDS: u32 = 61;

/// How fast a sway is forgotten.
const TIME_S: f64 = 0.8;

/// Of sideways, vertical and forward sway.
const SD_MM: [f64; 3] = [2.5, 0.3, 4.0];

/// So many trials are projected to, beyond what is measured.
const PROJECTED: [usize; 2] = [100_000, 1_000_000];

/// A trial at a later stage may take so much more of the processor than one of the hundredth: what
/// else happens on the computer has an effect.
const TIME_GROWS_MAX: f64 = 1.5;

/// A study may need so many more bytes for each trial: its values, and no points, which are 200 kB.
const STUDY_BYTES_MAX: f64 = 20_000.0;

/// Adding some may need so much more memory when there are many already: the table of trials.
const ADDING_BYTES_MAX: f64 = 10_000.0;

/// The program, as its users have it where `cargo xtask test cohort` says where it is.
static PLUMB: LazyLock<PathBuf> = LazyLock::new(|| program("plumb").unwrap());

struct Person {
    code: String,
    age_years: f64,
    factor: f64,
}

impl Person {
    fn of(number: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(number as u64);
        let spread: f64 = StandardNormal.sample(&mut random);
        let age_years = 20.0 + (number * 37 % 60) as f64;
        let factor = (0.25 * spread).exp() * (1.0 + 0.01 * (age_years - 40.0).max(0.0));
        Self { code: format!("S{number:04}"), age_years, factor }
    }
}

/// Writes a trial's folder.
fn simulate(folder: &Path, trial: usize, is_noise_known: bool) {
    let person = Person::of(trial / 2);
    let (condition, wider) = CONDITIONS[trial % 2];
    let mut random = ChaCha8Rng::seed_from_u64(1_000_000 + trial as u64);
    let keeps = (-1.0 / (TIME_S * f64::from(HZ))).exp();
    let pushed = (1.0 - keeps * keeps).sqrt();
    let mut now: [[f64; 3]; 2] =
        std::array::from_fn(|_| std::array::from_fn(|_| StandardNormal.sample(&mut random)));
    let sway: Vec<[[f64; 3]; 2]> = (0..SECONDS * HZ)
        .map(|_| {
            for value in now.iter_mut().flatten() {
                let push: f64 = StandardNormal.sample(&mut random);
                *value = keeps * *value + pushed * push;
            }
            now
        })
        .collect();
    let config = config();
    let scene = config.cam_from_scene().unwrap();
    let mut made = Made::with_poses(&config, SECONDS * HZ, |sequence, role| {
        let (at, rest_mm) = match role {
            Role::Upper => (0, [60.0, -250.0, -150.0]),
            _ => (1, [-20.0, 150.0, -200.0]),
        };
        let sway = sway[sequence as usize][at];
        let [x, y, z] =
            [0, 1, 2].map(|axis| rest_mm[axis] + person.factor * wider * SD_MM[axis] * sway[axis]);
        let pose: Pose<Scene, Target> = Pose::from_theta([0.05, 0.1, -0.08, x, y, z]);
        scene * pose
    });
    let begun = jiff::Timestamp::from_second(1_767_225_600 + 300 * trial as i64).unwrap();
    made.manifest.started = begun.to_string();
    made.manifest.participant = Some(person.code);
    made.manifest.condition = Some(condition.to_owned());
    made.manifest.note = None;
    if !is_noise_known {
        made.config = None;
    }
    made.write(folder);
}

/// What a run of a program took.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    /// Of the processor.
    busy_s: f64,
    /// By the clock.
    s: f64,
    /// At most.
    bytes: f64,
}

/// What so many trials cost: the times are of each, the memory is of all.
#[derive(Debug)]
struct Stage {
    trials: usize,
    adding: Cost,
    study: Cost,
    /// Of each.
    disk_bytes: f64,
}

/// Prints what more trials than were measured would cost, if each costs what it does at the last stage
/// and memory goes on growing as it did since the one before it. Of fewer than a batch, memory says
/// nothing of more.
fn project(fewer: &Stage, more: &Stage) {
    println!("Projected from {} trials, not measured:", more.trials);
    println!("trials | adding: minutes | MB | study: minutes | MB | GB on the disk");
    for trials in PROJECTED {
        let others = (trials - more.trials) as f64;
        let minutes = |cost: Cost| cost.s * trials as f64 / 60.0;
        let mb = |few: Cost, many: Cost| {
            let grows = (many.bytes - few.bytes) / (more.trials - fewer.trials) as f64;
            let mb = (many.bytes + grows.max(0.0) * others) / 1e6;
            if fewer.trials < BATCH { "?".to_owned() } else { format!("{mb:.0}") }
        };
        println!(
            "{trials} | {:.1} | {} | {:.1} | {} | {:.0}",
            minutes(more.adding),
            mb(fewer.adding, more.adding),
            minutes(more.study),
            mb(fewer.study, more.study),
            more.disk_bytes * trials as f64 / 1e9
        );
    }
}

/// Runs `plumb`; it must succeed.
fn plumb(folder: &Path, arguments: &[String]) -> Cost {
    let begun = Instant::now();
    let mut child = Command::new(&*PLUMB)
        .args(arguments)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::from(fs::File::create(folder.join("stderr.txt")).unwrap()))
        .spawn()
        .unwrap();
    let mut cost = Cost::default();
    let status = loop {
        let (stat, status) =
            (format!("/proc/{}/stat", child.id()), format!("/proc/{}/status", child.id()));
        // Both grow only, and both are there until the program's end is asked for.
        if let Ok(stat) = fs::read_to_string(stat) {
            let fields: Vec<&str> =
                stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
            let ticks =
                |at: usize| fields.get(at).and_then(|it| it.parse::<f64>().ok()).unwrap_or(0.0);
            cost.busy_s = (ticks(11) + ticks(12)) / 100.0;
        }
        if let Ok(status) = fs::read_to_string(status) {
            let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
            let kb = peak.and_then(|it| it.trim().trim_end_matches(" kB").parse::<f64>().ok());
            cost.bytes = cost.bytes.max(1024.0 * kb.unwrap_or(0.0));
        }
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    cost.s = begun.elapsed().as_secs_f64();
    let said = fs::read_to_string(folder.join("stderr.txt")).unwrap();
    assert!(status.success(), "{}: {said}", arguments[..2].join(" "));
    cost
}

/// The bytes of all files below a folder.
fn size(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).unwrap().map(|it| it.unwrap());
    entries
        .map(|it| {
            let about = it.metadata().unwrap();
            if about.is_dir() { size(&it.path()) } else { about.len() }
        })
        .sum()
}

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

const STUDY: &str = "title = \"Simulated\"\ncohort = \"cohort\"\nconditions = [\"eyes-open\", \"eyes-closed\"]\n\
                     figures = [\"path length\", \"RMS\", \"ellipse area\"]\n";

/// Nothing is known of the noise: the standard uncertainties of the figures, which take far longer than
/// the figures, are absent.
#[test]
#[ignore = "takes ten minutes: `cargo xtask test cohort`"]
fn a_trial_costs_as_much_whether_there_are_ten_or_ten_thousand() {
    measure(10_000, false);
}

#[test]
#[ignore = "takes minutes: `cargo xtask test cohort`"]
fn so_it_does_with_the_uncertainty_of_every_figure() {
    measure(1000, true);
}

/// Adds and studies more and more trials, up to this number.
fn measure(most: usize, is_noise_known: bool) {
    let less = std::env::var(TRIALS).ok().and_then(|it| it.parse().ok());
    let most = less.unwrap_or(most).min(most);
    // Beside what is built: a temporary folder may be in memory.
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let at = |name: &str| folder.path().join(name);
    let people: String = (0..most.div_ceil(2))
        .map(Person::of)
        .map(|it| format!("sub-{}\t{}\n", it.code, it.age_years))
        .collect();
    fs::write(at("participants.tsv"), format!("participant_id\tage\n{people}")).unwrap();
    fs::write(at("study.toml"), STUDY).unwrap();

    println!("trials | adding: ms busy, ms | MB | study: ms busy, ms | MB | kB on the disk");
    let mut stages: Vec<Stage> = Vec::new();
    let mut there = 0;
    for stage in STAGES.into_iter().filter(|it| *it <= most) {
        let mut adding = Cost::default();
        let begun_at = there;
        while there < stage {
            let batch = there..stage.min(there + BATCH);
            fs::create_dir(at("trials")).unwrap();
            let name = |trial: usize| format!("trials/t{trial:05}");
            batch
                .clone()
                .into_par_iter()
                .for_each(|trial| simulate(&at(&name(trial)), trial, is_noise_known));
            let mut arguments = words("cohort add --to cohort");
            arguments.extend(batch.clone().map(name));
            let cost = plumb(folder.path(), &arguments);
            adding.busy_s += cost.busy_s;
            adding.s += cost.s;
            adding.bytes = adding.bytes.max(cost.bytes);
            there = batch.end;
            if there < stage || stage < most.min(STAGES[STAGES.len() - 1]) {
                fs::remove_dir_all(at("trials")).unwrap();
            }
        }
        let study = plumb(folder.path(), &words("study study.toml --json study.json --force"));
        let added = (there - begun_at) as f64;
        let ms = |cost: &Cost, trials: f64| {
            format!("{:.1}, {:.1}", 1e3 * cost.busy_s / trials, 1e3 * cost.s / trials)
        };
        let disk_bytes = size(&at("cohort")) as f64 / there as f64;
        println!(
            "{there} | {} | {:.0} | {} | {:.0} | {:.1}",
            ms(&adding, added),
            adding.bytes / 1e6,
            ms(&study, there as f64),
            study.bytes / 1e6,
            disk_bytes / 1e3
        );
        let per_trial = |cost: Cost, trials: f64| Cost {
            busy_s: cost.busy_s / trials,
            s: cost.s / trials,
            ..cost
        };
        stages.push(Stage {
            trials: there,
            adding: per_trial(adding, added),
            study: per_trial(study, there as f64),
            disk_bytes,
        });
    }
    for pair in stages.windows(2).filter(|pair| pair[0].trials >= 100) {
        let [fewer, more] = pair else { unreachable!() };
        let others = (more.trials - fewer.trials) as f64;
        assert!(more.adding.busy_s < TIME_GROWS_MAX * fewer.adding.busy_s, "{pair:?}");
        assert!(more.study.busy_s < TIME_GROWS_MAX * fewer.study.busy_s, "{pair:?}");
        let grows = more.study.bytes - fewer.study.bytes;
        assert!(grows < STUDY_BYTES_MAX * others + 2e7, "{pair:?}");
        // The hundred trials were fewer than a batch.
        let grows = more.adding.bytes - fewer.adding.bytes;
        assert!(grows < ADDING_BYTES_MAX * others + 2e7, "{pair:?}");
    }
    if let [.., fewer, more] = &stages[..] {
        project(fewer, more);
    }
    sight_widens_sway_by_half(&at("study.json"), there);
    same_by_sql(folder.path());
}

/// What was simulated is found.
fn sight_widens_sway_by_half(study: &Path, trials: usize) {
    let study: serde_json::Value = serde_json::from_slice(&fs::read(study).unwrap()).unwrap();
    let responses = study["sway"].as_array().unwrap();
    for (figure, expected) in [
        ("RMS", WITHOUT_SIGHT),
        ("path length", WITHOUT_SIGHT),
        ("ellipse area", WITHOUT_SIGHT.powi(2)),
    ] {
        for it in responses.iter().filter(|it| it["figure"] == figure && it["direction"] == "APML")
        {
            let cells = it["inference"]["cells"].as_array().unwrap();
            let mean = |at: usize| cells[at]["raw"]["mean"].as_f64().unwrap();
            let found = mean(cells.len() / 2) / mean(0);
            // A trial's RMS has some 60 s / 2 · 0.8 s independent values.
            let within = 4.0 * (2.0 / (0.5 * trials as f64 * 37.0)).sqrt() * expected;
            println!("{figure}, {}: {found:.4} times, {expected} expected", it["point"]);
            assert!((found - expected).abs() < within.max(0.01), "{figure}: {found}");
        }
    }
}

/// DuckDB finds the same in the Parquet files alone.
fn same_by_sql(folder: &Path) {
    let Some(python) = python() else { return };
    let mut arguments = words("figures --filter none --out none.csv --force");
    let trials = fs::read_dir(folder.join("trials")).unwrap().map(|it| it.unwrap().file_name());
    arguments.extend(trials.map(|it| format!("trials/{}", it.to_str().unwrap())));
    plumb(folder, &arguments);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/many.py");
    let done = Command::new(python).arg(script).current_dir(folder).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{said}");
    println!("{}", String::from_utf8_lossy(&done.stdout));
}
