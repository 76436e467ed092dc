//! What has been tried: a file to which each outcome is appended as it is known, so that nothing is lost
//! when a run is ended. It is kept with the sources, beside the list that is made of it: hours of trying
//! count on every computer.
//!
//! An outcome counts as long as the code of the mutant's file is the same; the tests at its end may grow. A
//! survivor does not count: it is tried again in each run, since a test may have come that tells.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::ValueEnum;

use super::list::Mutant;
use crate::command::{root, word};
use crate::image::output;
use crate::sums;

/// What became of a mutant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Outcome {
    /// A test failed.
    Caught,
    /// It does not compile.
    Unviable,
    /// The tests did not end within several times the time that they take.
    TimedOut,
    /// All tests passed.
    Survived,
}

/// What has been tried.
pub struct Ledger {
    path: PathBuf,
    /// By sum of the file's code and name of the mutant.
    outcomes: BTreeMap<(String, String), Outcome>,
    /// The sums of the files that were asked about.
    sums: BTreeMap<String, String>,
}

impl Ledger {
    /// Reads the file, if there is one.
    pub fn at(path: PathBuf) -> Result<Self> {
        let mut outcomes = BTreeMap::new();
        // A line that was cut off when a run was killed is no outcome.
        for line in fs::read_to_string(&path).unwrap_or_default().lines() {
            let mut words = line.splitn(3, ' ');
            if let (Some(sum), Some(word), Some(name)) = (words.next(), words.next(), words.next())
                && let Ok(outcome) = Outcome::from_str(word, false)
            {
                outcomes.insert((sum.to_owned(), name.to_owned()), outcome);
            }
        }
        Ok(Self { path, outcomes, sums: BTreeMap::new() })
    }

    /// What became of a mutant of the file as it is now.
    pub fn outcome(&mut self, mutant: &Mutant) -> Result<Option<Outcome>> {
        let key = (self.sum(&mutant.file)?, mutant.name.clone());
        Ok(self.outcomes.get(&key).copied())
    }

    /// Writes down an outcome.
    pub fn add(&mut self, mutant: &Mutant, outcome: Outcome) -> Result<()> {
        let sum = self.sum(&mutant.file)?;
        let said = || self.path.display().to_string();
        let file = OpenOptions::new().create(true).append(true).open(&self.path);
        let mut file = file.with_context(said)?;
        writeln!(file, "{sum} {} {}", word(&outcome), mutant.name).with_context(said)?;
        self.outcomes.insert((sum, mutant.name.clone()), outcome);
        Ok(())
    }

    /// Drops the outcomes of files that have changed or are gone, and sorts the rest.
    pub fn settle(&mut self) -> Result<()> {
        let mut text = String::new();
        for ((sum, name), outcome) in self.outcomes.clone() {
            let file = name.split(':').next().unwrap_or_default();
            if root().join(file).is_file() && self.sum(file)? == sum {
                text += &format!("{sum} {} {name}\n", word(&outcome));
            } else {
                self.outcomes.remove(&(sum, name));
            }
        }
        output::file(&self.path, |path| fs::write(path, text).context("it cannot be written"))
    }

    fn sum(&mut self, file: &str) -> Result<String> {
        if let Some(sum) = self.sums.get(file) {
            return Ok(sum.clone());
        }
        let text = fs::read_to_string(root().join(file)).with_context(|| file.to_owned())?;
        let sum = sums::sha256(code(&text).as_bytes())[..16].to_owned();
        self.sums.insert(file.to_owned(), sum.clone());
        Ok(sum)
    }
}

/// A file's text without the tests at its end.
fn code(text: &str) -> &str {
    const TESTS: &str = "\n#[cfg(test)]\nmod tests";
    let inline = text.find(&format!("{TESTS} {{")).map(|end| &text[..end]);
    inline.or_else(|| text.strip_suffix(&format!("{TESTS};\n"))).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::super::list::{Place, Span};
    use super::*;

    #[test]
    fn outcomes_of_files_that_have_changed_are_dropped_and_the_rest_is_sorted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("outcomes");
        let sum = &sums::sha256(&fs::read(root().join("Cargo.toml")).unwrap())[..16];
        let as_it_is =
            format!("{sum} caught Cargo.toml:2:1: b\n{sum} survived Cargo.toml:1:1: a\n");
        let gone =
            "0123456789abcdef caught Cargo.toml:1:1: a\n0123456789abcdef caught gone.rs:1:1: a\n";
        fs::write(&path, format!("{gone}{as_it_is}{sum} cau")).unwrap();
        Ledger::at(path.clone()).unwrap().settle().unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let [caught, survived] = [0, 1].map(|at| as_it_is.lines().nth(at).unwrap());
        assert_eq!(text, format!("{survived}\n{caught}\n"));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn tests_at_the_end_of_a_file_are_not_its_code() {
        let inside = "fn a() {}\n\n#[cfg(test)]\nfn b() {}\n";
        assert_eq!(code(inside), inside);
        let before = "#[cfg(test)]\nmod tests;\n\nfn a() {}\n";
        assert_eq!(code(before), before);
        // Moved to a file of their own, they are still not its code.
        for tests in ["mod tests;\n", "mod tests {\n}\n"] {
            assert_eq!(code(&format!("fn a() {{}}\n\n#[cfg(test)]\n{tests}")), "fn a() {}\n");
        }
    }

    #[test]
    fn what_was_written_down_is_known_to_the_next_run_and_a_cut_line_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("outcomes");
        let place = Place { line: 1, column: 1 };
        let mutant = |name: &str| Mutant {
            name: name.to_owned(),
            package: String::new(),
            file: "Cargo.toml".to_owned(),
            function: None,
            replacement: String::new(),
            span: Span { start: place, end: place },
        };
        let mut ledger = Ledger::at(path.clone()).unwrap();
        assert_eq!(ledger.outcome(&mutant("a b")).unwrap(), None);
        ledger.add(&mutant("a b"), Outcome::Survived).unwrap();
        ledger.add(&mutant("a b"), Outcome::Caught).unwrap();
        ledger.add(&mutant("c"), Outcome::TimedOut).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let cut = text.rfind("timed").unwrap() + 3;
        for (kept, c) in [(text.len(), Some(Outcome::TimedOut)), (cut, None)] {
            fs::write(&path, &text[..kept]).unwrap();
            let mut ledger = Ledger::at(path.clone()).unwrap();
            assert_eq!(ledger.outcome(&mutant("a b")).unwrap(), Some(Outcome::Caught));
            assert_eq!(ledger.outcome(&mutant("c")).unwrap(), c);
        }
    }
}
