//! The folders of trials that patterns such as `trials/*` match.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use glob::{MatchOptions, Pattern};
use plumbline_files::BadInput;
use plumbline_trial::names;

/// As a shell matches: `*` neither crosses a separator nor begins a hidden name.
const AS_A_SHELL: MatchOptions = MatchOptions {
    case_sensitive: true,
    require_literal_separator: true,
    require_literal_leading_dot: true,
};

/// What patterns match.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Matched {
    /// The folders of trials: in the order of the patterns, for each by name, each once.
    pub folders: Vec<PathBuf>,
    /// The folders in which there is no trial.
    pub skipped: Vec<PathBuf>,
}

/// What the patterns of a study match; they are relative to `base`. Files are passed over, folders
/// without a trial are listed. A folder with either file of a trial counts as one: a trial that has
/// lost the other must not be passed over.
///
/// # Errors
/// When a pattern is not one, cannot be followed, or matches no trial.
pub fn matched(patterns: &[String], base: &Path, place: &str) -> Result<Matched, BadInput> {
    let mut matched = Matched::default();
    let mut seen = HashSet::new();
    for pattern in patterns {
        let wrong = |found: String, remedy: &str| {
            BadInput::new(place, format!("trials, {pattern:?}"), found, remedy)
        };
        let base = base.to_str().ok_or_else(|| {
            wrong("the study's folder has no name in Unicode".to_owned(), "rename that folder")
        })?;
        let whole = Path::new(&Pattern::escape(base)).join(pattern);
        // Both parts are UTF-8.
        let paths = glob::glob_with(&whole.to_string_lossy(), AS_A_SHELL).map_err(|error| {
            wrong(error.to_string(), "* stands for any part of a name, ? for a character")
        })?;
        let (mut trials, mut others) = (0, Vec::new());
        for path in paths {
            let path = path.map_err(|error| BadInput::io(error.path().display(), error.error()))?;
            let is_trial =
                [names::MANIFEST, names::JOURNAL].iter().any(|it| path.join(it).exists());
            if is_trial {
                trials += 1;
                // By another name, too, it is the same trial.
                let is_new = seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone()));
                if is_new {
                    matched.folders.push(path);
                }
            } else if path.is_dir() {
                others.push(path);
            }
        }
        if trials == 0 {
            let found = match others.first() {
                Some(first) => {
                    format!(
                        "it matches no folder of a trial: {} has no trial in it",
                        first.display()
                    )
                }
                None => "it matches nothing".to_owned(),
            };
            let remedy = "correct it; it is relative to the study's own folder, and a trial's \
                          folder is what `plumb receive --out` has made";
            return Err(wrong(found, remedy));
        }
        others.retain(|it| !matched.skipped.contains(it));
        matched.skipped.extend(others);
    }
    Ok(matched)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Trials, a folder of something else, a hidden one, and a file.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let file = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        };
        // A name in brackets is no pattern where it stands in the study's own path.
        for path in ["b/trial.toml", "a10/packets.bin", "a9/trial.toml", "notes/x", ".z/trial.toml"]
        {
            file(&format!("lab [1]/trials/{path}"));
        }
        file("lab [1]/trials/readme.txt");
        folder
    }

    fn names(patterns: &[&str]) -> Result<[Vec<String>; 2], String> {
        let folder = folder();
        let patterns: Vec<String> = patterns.iter().map(|it| (*it).to_owned()).collect();
        let base = folder.path().join("lab [1]");
        let found = matched(&patterns, &base, "study.toml").map_err(|error| error.to_string())?;
        let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
        Ok([found.folders, found.skipped].map(|paths| paths.iter().map(name).collect()))
    }

    #[test]
    fn trials_are_found_by_name_and_each_once() {
        let [folders, skipped] = names(&["trials/*"]).unwrap();
        assert_eq!(
            (folders, skipped),
            (vec!["a10".into(), "a9".into(), "b".into()], vec!["notes".into()])
        );
        let [folders, skipped] = names(&["trials/b", "trials/?*", "*/b"]).unwrap();
        assert_eq!(folders, ["b", "a10", "a9"]);
        assert_eq!(skipped, ["notes"]);
        let [folders, _] = names(&["trials/*", "./trials/b", "trials/../trials/*"]).unwrap();
        assert_eq!(folders, ["a10", "a9", "b"]);
    }

    #[test]
    fn a_pattern_that_matches_no_trial_is_named() {
        for (pattern, part) in [
            ("trails/*", "trials, \"trails/*\": it matches nothing"),
            ("trials/n*", "it matches no folder of a trial"),
            ("trials/r*", "it matches nothing"),
            ("trials/[", "study.toml: trials, \"trials/[\": "),
        ] {
            let error = names(&["trials/*", pattern]).unwrap_err();
            assert!(error.contains(part), "{pattern}: {error}");
        }
    }
}
