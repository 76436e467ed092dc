//! Trials are taken out of a cohort, and the others stay as they were.

use std::path::Path;

use plumbline_cohort::check::check;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::given::Said;
use plumbline_cohort::remove::{Chosen, remove};
use plumbline_trial::parquet::Reader;

use crate::support::{added, tree, trials};

fn keys(keys: &[&str]) -> Chosen {
    Chosen { keys: keys.iter().map(|it| (*it).to_owned()).collect(), ..Chosen::default() }
}

fn of_participant(participant: &str) -> Chosen {
    Chosen { participants: vec![participant.to_owned()], ..Chosen::default() }
}

/// All names and contents below a folder, as one text.
fn all_that_is_there(folder: &Path) -> String {
    let files = tree(folder).into_iter();
    files
        .map(|(name, bytes)| name.display().to_string() + &String::from_utf8_lossy(&bytes))
        .collect()
}

#[test]
fn nothing_of_a_removed_participant_is_left_and_the_others_are_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P01-b", "Withdrawn-a", "Withdrawn-b", "P02-a"]);
    added(&path, &given[..3], &Said::default()).unwrap();
    added(&path, &given[3..4], &Said::default()).unwrap();
    let cohort = Cohort::open(&path).unwrap();
    let before = cohort.rows().unwrap();
    let (gone, stay) = remove(&path, &of_participant("Withdrawn")).unwrap();
    assert_eq!(gone.len(), 2);
    assert_eq!(stay, 2);

    let rows = cohort.rows().unwrap();
    let expected: Vec<_> =
        before.iter().filter(|it| it.key.participant == "P01").cloned().collect();
    assert_eq!(rows, expected);
    assert_eq!(check(&cohort, &rows, &|| ()).unwrap(), [""; 0]);
    let text = all_that_is_there(&path);
    assert!(!text.contains("Withdrawn"));
    for row in before.iter().filter(|it| it.key.participant == "Withdrawn") {
        assert!(!text.contains(&row.trial));
    }
    let points = std::fs::read_dir(path.join("points")).unwrap().count();
    assert_eq!(points, 1, "an empty folder is left");
    // The second addition has no trial any more, and so no file.
    assert_eq!(
        (cohort.tables("trials").unwrap().len(), cohort.tables("figures").unwrap().len()),
        (1, 1)
    );

    // The table of figures of the others is that of a cohort to which only they were added.
    let other = folder.path().join("other");
    added(&other, &given[..2], &Said::default()).unwrap();
    let figures = |cohort: &Path| {
        let [table] = &Cohort::open(cohort).unwrap().tables("figures").unwrap()[..] else {
            panic!()
        };
        Reader::open(table, 1 << 20).unwrap().all().unwrap().columns().to_vec()
    };
    assert_eq!(figures(&path), figures(&other));

    // It can be filled again, also with what was removed.
    let done = added(&path, &given, &Said::default()).unwrap();
    assert_eq!((done.added.len(), done.already.len()), (3, 2));
    // And emptied.
    for participant in ["P01", "P02", "Withdrawn"] {
        remove(&path, &of_participant(participant)).unwrap();
    }
    assert_eq!(cohort.rows().unwrap(), []);
    let left: Vec<_> = tree(&path).into_keys().map(|it| it.display().to_string()).collect();
    assert_eq!(left, [".lock", "cohort.toml"]);
}

#[test]
fn a_trial_is_named_by_its_key_or_its_content() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cohort");
    let given = trials(folder.path(), &["P01-a", "P01-b", "P02-a", "P03-a"]);
    added(&path, &given, &Said::default()).unwrap();
    let rows = Cohort::open(&path).unwrap().rows().unwrap();
    let digits = &rows[2].trial[..8];
    let all = tree(&path);
    for (chosen, part) in [
        (keys(&["P01/1/a/1", "P01/1/a/2"]), "no trial is \"P01/1/a/2\"; nothing was removed; give"),
        (keys(&["P01"]), "no trial is \"P01\""),
        (keys(&[&digits[..7]]), "no trial is"),
        (of_participant("P0"), "no trial is of the participant \"P0\""),
    ] {
        let error = remove(&path, &chosen).unwrap_err().to_string();
        assert!(error.contains(part), "no {part}: {error}");
        assert_eq!(tree(&path), all);
    }
    let chosen = Chosen { participants: vec!["P03".to_owned()], ..keys(&["P01/1/b/1", digits]) };
    let (gone, stay) = remove(&path, &chosen).unwrap();
    let gone: Vec<String> = gone.iter().map(ToString::to_string).collect();
    let expected =
        ["P01, session 1, b, run 1", "P02, session 1, a, run 1", "P03, session 1, a, run 1"];
    assert_eq!((&gone[..], stay), (&expected.map(str::to_owned)[..], 1));
    let cohort = Cohort::open(&path).unwrap();
    assert_eq!(check(&cohort, &cohort.rows().unwrap(), &|| ()).unwrap(), [""; 0]);
    let error = remove(&folder.path().join("none"), &keys(&["P01/1/a/1"])).unwrap_err().to_string();
    assert!(error.contains("it is no cohort"), "{error}");
}
