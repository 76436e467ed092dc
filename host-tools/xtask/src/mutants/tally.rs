//! What has been tried, and what survived: on the terminal, for the page of evidence, and as the list.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::Result;

use super::Area;
use super::ledger::{Ledger, Outcome};
use super::list::List;
use crate::command::word;
use crate::generated::Part;

/// The list.
pub const PAGE: &str = "tests/mutants.md";

/// The counts of a file.
#[derive(Debug, Default, PartialEq, Eq)]
struct Counts {
    /// Mutants that are not argued away.
    mutants: usize,
    argued: usize,
    caught: usize,
    unviable: usize,
    timed_out: usize,
    survivors: Vec<String>,
}

impl Counts {
    fn tried(&self) -> usize {
        self.caught + self.unviable + self.timed_out + self.survivors.len()
    }

    fn add(&mut self, other: &Self) {
        self.mutants += other.mutants;
        self.argued += other.argued;
        self.caught += other.caught;
        self.unviable += other.unviable;
        self.timed_out += other.timed_out;
        self.survivors.extend_from_slice(&other.survivors);
    }
}

/// The counts of an area.
pub struct Tally {
    files: BTreeMap<String, Counts>,
}

impl Tally {
    /// Counts what is known of the files as they are now.
    pub fn of(list: &List, ledger: &mut Ledger) -> Result<Self> {
        let mut files: BTreeMap<String, Counts> = BTreeMap::new();
        for mutant in &list.mutants {
            let counts = files.entry(mutant.file.clone()).or_default();
            counts.mutants += 1;
            match ledger.outcome(mutant)? {
                None => {}
                Some(Outcome::Caught) => counts.caught += 1,
                Some(Outcome::Unviable) => counts.unviable += 1,
                Some(Outcome::TimedOut) => counts.timed_out += 1,
                Some(Outcome::Survived) => counts.survivors.push(mutant.name.clone()),
            }
        }
        for (file, argued) in &list.argued {
            files.entry(file.clone()).or_default().argued += argued;
        }
        Ok(Self { files })
    }

    /// Those that no test tells from the code.
    pub fn survivors(&self) -> impl Iterator<Item = &String> {
        self.files.values().flat_map(|counts| &counts.survivors)
    }

    /// Prints it, and writes the list. `done` were tried in this run; `seed` is that of a sample.
    pub fn report(&self, area: &Area, done: usize, seed: Option<u64>) -> Result<()> {
        Part { document: PAGE, name: &word(&area.word) }.write(&self.page())?;
        println!("\n{}\n", self.page());
        println!("{}", self.evidence(area.what, done, seed));
        Ok(())
    }

    fn total(&self) -> Counts {
        let mut total = Counts::default();
        self.files.values().for_each(|counts| total.add(counts));
        total
    }

    /// The line for the page of evidence.
    fn evidence(&self, what: &str, done: usize, seed: Option<u64>) -> String {
        let total = self.total();
        let drawn = seed.map_or_else(String::new, |seed| {
            format!(", a sample drawn at random of each file (seed {seed})")
        });
        format!(
            "evidence | mutants of {what} | {} of {} tried{drawn}; {done} of them in this run | {} survive; \
             {} caught by a test, {} without an end, {} that do not compile; {} more argued away",
            total.tried(),
            total.mutants,
            total.survivors.len(),
            total.caught,
            total.timed_out,
            total.unviable,
            total.argued
        )
    }

    /// The part of the list.
    fn page(&self) -> String {
        let mut text = String::from(
            "| file | mutants | tried | caught | without an end | do not compile | survive | argued away |\n\
             |---|---|---|---|---|---|---|---|\n",
        );
        let mut row = |name: &str, counts: &Counts| {
            // Writing to a string never fails.
            let _ = writeln!(
                text,
                "| {name} | {} | {} | {} | {} | {} | {} | {} |",
                counts.mutants,
                counts.tried(),
                counts.caught,
                counts.timed_out,
                counts.unviable,
                counts.survivors.len(),
                counts.argued
            );
        };
        for (file, counts) in &self.files {
            row(&format!("`{file}`"), counts);
        }
        row("all", &self.total());
        let mut survivors = self.survivors().peekable();
        if survivors.peek().is_some() {
            text += "\nNo test tells these from the code:\n\n";
        }
        for name in survivors {
            let _ = writeln!(text, "- `{name}`");
        }
        text.trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum as _;

    use super::*;

    fn tally() -> Tally {
        let counts = Counts {
            mutants: 20,
            argued: 1,
            caught: 7,
            unviable: 2,
            timed_out: 1,
            survivors: vec!["a.rs:1:2: replace + with *".to_owned()],
        };
        let none = Counts { mutants: 3, argued: 2, ..Counts::default() };
        Tally { files: BTreeMap::from([("a.rs".to_owned(), counts), ("b.rs".to_owned(), none)]) }
    }

    #[test]
    fn the_list_has_the_counts_of_each_file_and_names_every_survivor() {
        assert_eq!(
            tally().page(),
            "| file | mutants | tried | caught | without an end | do not compile | survive | argued away |\n\
             |---|---|---|---|---|---|---|---|\n\
             | `a.rs` | 20 | 11 | 7 | 1 | 2 | 1 | 1 |\n\
             | `b.rs` | 3 | 0 | 0 | 0 | 0 | 0 | 2 |\n\
             | all | 23 | 11 | 7 | 1 | 2 | 1 | 3 |\n\n\
             No test tells these from the code:\n\n\
             - `a.rs:1:2: replace + with *`"
        );
    }

    #[test]
    fn the_list_has_a_place_for_each_area() {
        for area in super::super::Word::value_variants() {
            Part { document: PAGE, name: &word(area) }.read().unwrap();
        }
    }

    #[test]
    fn the_evidence_says_how_many_of_how_many_and_that_they_were_drawn() {
        let line = tally().evidence("the core", 5, Some(7));
        assert_eq!(
            line,
            "evidence | mutants of the core | 11 of 23 tried, a sample drawn at random of each file (seed 7); \
             5 of them in this run | 1 survive; 7 caught by a test, 1 without an end, 2 that do not compile; \
             3 more argued away"
        );
        assert!(tally().evidence("it", 11, None).contains("| 11 of 23 tried; 11 of them"));
    }
}
