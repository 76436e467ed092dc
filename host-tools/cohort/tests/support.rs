//! Trials to add, and what a cohort's folder holds.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use plumbline_cohort::add::{Added, add};
use plumbline_cohort::given::Said;
use plumbline_files::BadInput;
use plumbline_stream::fixture::config;
use plumbline_trial::test_trial::Made;

/// Writes a trial of five seconds.
pub fn record(folder: &Path, participant: &str, condition: &str, started: &str) {
    let mut made = Made::of(&config(), 300);
    made.manifest.participant = Some(participant.to_owned()).filter(|it| !it.is_empty());
    made.manifest.condition = Some(condition.to_owned()).filter(|it| !it.is_empty());
    started.clone_into(&mut made.manifest.started);
    std::fs::create_dir_all(folder.parent().unwrap()).unwrap();
    made.write(folder);
}

/// Trials of these names, `PARTICIPANT-CONDITION`, in a folder.
pub fn trials(folder: &Path, names: &[&str]) -> Vec<PathBuf> {
    let one = |name: &&str| {
        let (participant, condition) = name.split_once('-').unwrap();
        let path = folder.join(name);
        record(&path, participant, condition, "2026-01-01T10:00:00Z");
        path
    };
    names.iter().map(one).collect()
}

pub fn added(cohort: &Path, trials: &[PathBuf], said: &Said) -> Result<Added, BadInput> {
    add(cohort, trials, said, "plumb of a test", &|_| ())
}

/// The content of each file below a folder, by its path there; hidden ones too.
pub fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_owned();
                found.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// Writes files below a folder, as [`tree`] gives them.
pub fn put(folder: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) {
    for (name, content) in files {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }
}
