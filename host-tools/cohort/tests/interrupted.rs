//! A change that ends at any moment is made as a whole or not at all.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use plumbline_cohort::check::check;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::given::Said;
use plumbline_cohort::remove::{Chosen, remove};

use crate::support::{added, put, tree, trials};

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
    let order = |name: &Path| {
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

/// The moves of a removal are interrupted after each of them; then the cohort is opened. Where a file
/// is deleted, its mark may still be there, and so may folders that are empty by now.
#[test]
fn a_removal_that_was_interrupted_is_completed_after_each_of_its_moves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P01-b", "P02-a", "P02-b"]);
    added(&path, &given[..1], &Said::default()).unwrap();
    added(&path, &given, &Said::default()).unwrap();
    let before = tree(&path);
    let chosen = Chosen { participants: vec!["P01".to_owned()], ..Chosen::default() };
    remove(&path, &chosen).unwrap();
    let whole = tree(&path);
    // Two tables of the first addition and two files of points go; two tables are replaced.
    let changed = before.keys().filter(|it| before.get(*it) != whole.get(*it));
    let order = |name: &Path| {
        ["trials", "figures", "points"].iter().position(|part| name.starts_with(part))
    };
    let mut moved: Vec<_> = changed.collect();
    moved.sort_by_key(|it| order(it));
    assert_eq!(moved.len(), 2 * 2 + 2);
    for done in 0..=moved.len() {
        std::fs::remove_dir_all(&path).unwrap();
        put(&path, &before);
        for (at, name) in moved.iter().enumerate() {
            let content = whole.get(*name);
            match content {
                _ if at >= done => {}
                Some(content) => std::fs::write(path.join(name), content).unwrap(),
                None => std::fs::remove_file(path.join(name)).unwrap(),
            }
            // The last deletion was not followed by that of its mark.
            if at >= done || at + 1 == done && content.is_none() {
                let content = content.cloned().unwrap_or_default();
                put(&path.join(".removed"), &BTreeMap::from([((*name).clone(), content)]));
            }
        }
        // There is something to complete, if only to delete an empty folder.
        std::fs::create_dir_all(path.join(".removed")).unwrap();
        let cohort = Cohort::open(&path).unwrap();
        assert_eq!(tree(&path), whole, "after {done} moves");
        assert!(!path.join(".removed").exists());
        let rows = cohort.rows().unwrap();
        assert!(rows.iter().all(|it| it.key.participant == "P02") && rows.len() == 2);
        assert_eq!(check(&cohort, &rows, &|| ()).unwrap(), [""; 0]);
    }
}

#[test]
fn a_removal_that_was_only_begun_is_deleted_by_the_next_change() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P02-a"]);
    added(&path, &given, &Said::default()).unwrap();
    let whole = tree(&path);
    std::fs::create_dir_all(path.join(".removing/trials")).unwrap();
    for name in whole.keys().filter(|it| it.starts_with("trials")) {
        std::fs::write(path.join(".removing").join(name), "").unwrap();
    }
    assert_eq!(Cohort::open(&path).unwrap().rows().unwrap().len(), 2);
    // A removal of something that is not there, too, begins by cleaning up.
    let none = Chosen { keys: vec!["P03/1/a/1".to_owned()], ..Chosen::default() };
    assert!(remove(&path, &none).is_err());
    assert_eq!(tree(&path), whole);
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
    assert!(error.contains("another program is changing this cohort; try again"), "{error}");
    assert_eq!(Cohort::open(&path).unwrap().rows().unwrap().len(), 1);
    // What is on its way is neither half read nor moved by two.
    std::fs::create_dir(path.join(".added")).unwrap();
    assert!(Cohort::open(&path).is_err());
    drop(lock);
    added(&path, &given, &Said::default()).unwrap();
    assert_eq!(Cohort::open(&path).unwrap().rows().unwrap().len(), 2);
    assert!(!path.join(".added").exists());
}
