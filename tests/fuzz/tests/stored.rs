//! The laws hold for every stored input, for every seed, and for damaged versions of the seeds. This is
//! what `cargo xtask fuzz` does for hours with inputs of its own; here it takes seconds and needs no
//! fuzzer.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{env, fs};

use plumbline_laws::{TARGETS, directory, target};
use plumbline_test_support::{command, fuzz, mutations, root};

/// Damaged versions of each seed.
const VERSIONS: usize = 12;

/// A larger input costs every later run its time.
const STORED_BYTES_MAX: usize = 8 << 10;

/// Of all stored inputs together.
const ALL_BYTES_MAX: usize = 400 << 10;

/// The files below a directory; none where there is none.
fn files(directory: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(directory) else { return Vec::new() };
    let mut files: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files
}

/// The stored inputs of a target, each with where it is.
fn stored(name: &str) -> Vec<(String, Vec<u8>)> {
    let mut stored = Vec::new();
    let corpus = directory().join("corpus").join(name).with_extension("txt");
    // Each target has one, be it empty: a lost one would be no test, and no failure.
    let text = fs::read_to_string(&corpus).expect("a file of stored inputs");
    let inputs = fuzz::inputs_of(&text).expect("lines of hexadecimal digits");
    let place = |line| format!("{}:{line}", corpus.display());
    stored.extend((1..).zip(inputs).map(|(line, input)| (place(line), input)));
    for path in files(&directory().join("finds").join(name)) {
        stored.push((path.display().to_string(), fs::read(&path).expect("a stored input")));
    }
    stored
}

fn holds(name: &str) {
    let target = target(name);
    let seeds = (target.seeds)();
    for seed in &seeds {
        (target.check)(seed);
        for damaged in mutations(seed, VERSIONS) {
            (target.check)(&damaged);
        }
    }
    let stored = stored(name);
    for (place, input) in &stored {
        // A panic below is told with the last place that was named.
        println!("{place}");
        (target.check)(input);
    }
    println!("{name}: {} seeds and {} stored inputs", seeds.len(), stored.len());
}

macro_rules! targets {
    ($($name:ident),*) => {
        $(#[test]
        fn $name() {
            holds(stringify!($name));
        })*

        /// Those that have a test here.
        const TESTED: &[&str] = &[$(stringify!($name)),*];
    };
}

targets!(packets, link, config, trials, pictures, tables, frames, camera);

/// Names a folder to the tests of `requests`, which is another than the user's.
const INSIDE: &str = "PLUMBLINE_REQUESTS";

/// The desk keeps what it remembers among the user's data, so that this test runs in a process that has
/// others.
#[test]
fn requests() {
    if env::var_os(INSIDE).is_some() {
        return holds("requests");
    }
    let home = tempfile::tempdir().expect("a temporary folder");
    let own = env::current_exe().expect("this program");
    let output = command(own)
        .args(["--exact", "requests", "--nocapture"])
        .env("XDG_DATA_HOME", home.path())
        .env(INSIDE, "1")
        .output()
        .expect("it runs");
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}\n{errors}");
}

#[test]
fn every_target_is_known_everywhere() {
    let of = |names: &[&str]| names.iter().map(|it| (*it).to_owned()).collect::<BTreeSet<_>>();
    let laws = of(&TARGETS.map(|target| target.name));
    assert_eq!(laws, of(&fuzz::TARGETS.map(|target| target.name)), "in the command's help");
    assert_eq!(laws, of(&[TESTED, &["requests"]].concat()), "here");
    let manifest = fs::read_to_string(directory().join("runner/Cargo.toml")).expect("a manifest");
    let programs = manifest.lines().filter_map(|line| line.strip_prefix("path = \"src/"));
    let programs = programs.filter_map(|it| it.strip_suffix(".rs\"")).map(str::to_owned);
    assert_eq!(laws, programs.collect(), "as programs");
    for kind in ["corpus", "finds"] {
        for path in files(&directory().join(kind)) {
            let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
            assert!(laws.contains(&name), "{kind}/{name} belongs to no target");
        }
    }
}

/// The programs have a lock of their own, since they are a workspace of their own.
#[test]
fn what_is_fuzzed_is_what_is_used() {
    let versions = |lock: &Path| -> BTreeSet<(String, String)> {
        let text = fs::read_to_string(lock).expect("a lock");
        let lock: toml::Table = text.parse().expect("TOML");
        let packages = lock["package"].as_array().expect("packages").iter();
        let word = |package: &toml::Value, field: &str| {
            package[field].as_str().expect("a word").to_owned()
        };
        packages.map(|it| (word(it, "name"), word(it, "version"))).collect()
    };
    let used = versions(&root().join("Cargo.lock"));
    let own = ["arbitrary", "jobserver", "libfuzzer-sys", "plumbline-fuzz"];
    for (name, version) in versions(&directory().join("runner/Cargo.lock")).difference(&used) {
        assert!(
            own.contains(&&**name),
            "tests/fuzz/runner/Cargo.lock has {name} {version}, and Cargo.lock has not: cp Cargo.lock \
             tests/fuzz/runner/ && cargo fetch --manifest-path tests/fuzz/runner/Cargo.toml"
        );
    }
}

#[test]
fn what_is_stored_is_small() {
    let mut all = 0;
    for (place, input) in TARGETS.iter().flat_map(|target| stored(target.name)) {
        assert!(input.len() <= STORED_BYTES_MAX, "{place}: {} bytes", input.len());
        all += input.len();
    }
    assert!(all <= ALL_BYTES_MAX, "{all} bytes are stored");
}
