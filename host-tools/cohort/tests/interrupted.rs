//! An addition that ends at any moment is in the cohort as a whole or not at all.

use std::fs::File;

use plumbline_cohort::check::check;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::given::Said;

use crate::support::{added, tree, trials};

/// The moves of an addition are undone from the last one on, which leaves the folder as it is after
/// each of them; then it is opened.
#[test]
fn moves_that_were_interrupted_are_completed_after_each_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P01-b", "P02-a", "P02-b"]);
    added(&path, &given[..1], &Said::default()).unwrap();
    let before = tree(&path);
    added(&path, &given, &Said::default()).unwrap();
    let whole = tree(&path);
    let order = |name: &std::path::Path| {
        ["points", "figures", "trials"].iter().position(|part| name.starts_with(part))
    };
    let mut moved: Vec<_> = whole.keys().filter(|it| !before.contains_key(*it)).collect();
    moved.sort_by_key(|it| order(it));
    assert_eq!(moved.len(), 3 + 2);
    for done in 0..moved.len() {
        for name in &moved[done..] {
            let back = path.join(".added").join(name);
            std::fs::create_dir_all(back.parent().unwrap()).unwrap();
            std::fs::rename(path.join(name), back).unwrap();
        }
        // Whoever reads the files as they are sees no trial without its points.
        let cohort = Cohort::open(&path).unwrap();
        assert_eq!(tree(&path), whole, "after {done} moves");
        assert_eq!(check(&cohort, &cohort.rows().unwrap(), &|| ()).unwrap(), [""; 0]);
    }
}

#[test]
fn what_was_only_begun_is_deleted_by_the_next_addition() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P02-a"]);
    // So far an addition comes before there is a cohort.
    std::fs::create_dir_all(path.join(".adding/points")).unwrap();
    std::fs::write(path.join(".lock"), "").unwrap();
    added(&path, &given[..1], &Said::default()).unwrap();
    let whole = tree(&path);
    std::fs::create_dir_all(path.join(".adding/points/participant=P02")).unwrap();
    std::fs::write(path.join(".adding/points/participant=P02/points.parquet"), "half").unwrap();
    // Reading changes nothing: another program may be writing it.
    assert_eq!(Cohort::open(&path).unwrap().rows().unwrap().len(), 1);
    assert!(path.join(".adding").exists());
    added(&path, &given[..1], &Said::default()).unwrap();
    assert_eq!(tree(&path), whole);
}

#[test]
fn two_additions_at_once_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P02-a"]);
    added(&path, &given[..1], &Said::default()).unwrap();
    let lock = File::open(path.join(".lock")).unwrap();
    lock.lock().unwrap();
    let error = added(&path, &given, &Said::default()).unwrap_err().to_string();
    assert!(error.contains("another program is adding to this cohort; try again"), "{error}");
    assert_eq!(Cohort::open(&path).unwrap().rows().unwrap().len(), 1);
    // What is on its way is neither half read nor moved by two.
    std::fs::create_dir(path.join(".added")).unwrap();
    assert!(Cohort::open(&path).is_err());
    drop(lock);
    added(&path, &given, &Said::default()).unwrap();
    assert_eq!(Cohort::open(&path).unwrap().rows().unwrap().len(), 2);
    assert!(!path.join(".added").exists());
}
