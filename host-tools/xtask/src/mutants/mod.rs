//! `cargo xtask mutants`: changes the sources a little, thousands of times, and sees whether a test notices.
//!
//! cargo-mutants finds the mutants: what it makes of each function and operator. To compile each by itself
//! would take it days, nearly all of them the compiler's. So the mutants of many functions are compiled
//! together, each as an arm of its function, and a variable of the environment says which one runs: to try
//! one takes as long as its tests. Only what is computed while compiling is compiled for each mutant. See
//! [`arms`].
//!
//! A mutant is tried against the tests of its crate that reach its function, the quickest first; one that
//! survives also against those of other packages that are named here: see [`survey`]. One that is compiled by
//! itself meets the tests of its own part of the crate, and then all. A survivor is either killed by a test
//! that was missing, or argued away in `.cargo/mutants.toml`: by a reason why no test can or should tell.
//!
//! ```text
//! target/mutants/tree         a copy of the sources, with mutants
//! tests/mutants.outcomes      what has been tried: see [`ledger`]
//! tests/mutants.md            the list that is made of it: what was tried of each file, and what survived
//! ```

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};
use clap::ValueEnum;

use crate::command::{root, target_directory};
use crate::setup::{self, CargoTool};
use crate::sums;

mod arms;
mod batch;
mod build;
mod ledger;
mod list;
mod survey;
mod tally;
mod tree;
mod trial;

use batch::{Progress, Workshop};
use ledger::{Ledger, Outcome};
use list::{List, Mutant};
use tally::Tally;
use tree::Tree;

/// Finds the mutants.
const CARGO_MUTANTS: CargoTool = CargoTool {
    name: "cargo-mutants",
    version: "27.1.0",
    why: "finds what can be changed in a source file",
};

/// What a run writes beside the sources, none of which is tried.
pub const WRITTEN: [&str; 2] = [tally::PAGE, OUTCOMES];

/// What has been tried.
const OUTCOMES: &str = "tests/mutants.outcomes";

/// What the copy and what is compiled of it may take: an estimate.
const DISK_MB: u64 = 4000;

/// The arguments of `cargo xtask mutants`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cargo xtask mutants update              # every mutant of the update that has not been tried
  cargo xtask mutants core --sample 500   # 500 more of the core, drawn from all its files
  cargo xtask mutants core --file src/fit # every mutant of these files

What has been tried is known to the next run as long as the file is the same, so a run can be ended with
Ctrl-C at any time and gone on with. Survivors are tried again by each run. Kill one with a test that tells
it from the code, or argue in .cargo/mutants.toml why no test can or should.")]
pub struct Arguments {
    /// Whose mutants are tried; those of all when left out.
    #[arg(value_enum)]
    areas: Vec<Word>,
    /// Try only the mutants of files whose path begins so, such as src/tell/seal.
    #[arg(long, value_name = "PATH")]
    file: Option<String>,
    /// Try at most so many of each area that have not been tried: drawn at random, of each file in
    /// proportion to its mutants.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    sample: Option<u32>,
    /// Another number draws another sample.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// How many mutants are tried at a time; each keeps a processor core busy.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    jobs: u32,
}

/// An area's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Word {
    /// An update: its file and signature, the slots of the card, and how the box writes, tries and commits
    /// one.
    Update,
    /// What goes over the link: packets, and how they are sealed.
    Packets,
    /// The core: from the picture to the pose, and the packets.
    Core,
}

/// Sources whose mutants are tried.
struct Area {
    word: Word,
    /// For the page of evidence.
    what: &'static str,
    packages: &'static [Package],
    /// How the paths of its files begin.
    files: &'static [&'static str],
}

/// A package with mutants.
#[derive(Debug, Clone, Copy)]
struct Package {
    name: &'static str,
    /// Where it is, with a slash at the end; nothing for the root.
    directory: &'static str,
    /// Tests of other packages that try what survives its own.
    beyond: &'static [Suite],
}

/// A program with tests.
#[derive(Debug, Clone, Copy)]
struct Suite {
    package: &'static str,
    /// Its directory, as that of a [`Package`].
    directory: &'static str,
    /// Which of the package's targets it is, as cargo wants to be told.
    target: &'static [&'static str],
}

const CORE: Package = Package {
    name: "plumbline",
    directory: "",
    beyond: &[Suite {
        package: "plumbline-core-tests",
        directory: "tests/core/",
        target: &["--test", "core"],
    }],
};

const UPDATE: Package =
    Package { name: "plumbline-update", directory: "board/update/", beyond: &[] };

const BOARD: Package = Package { name: "plumbline-board", directory: "board/", beyond: &[] };

const AREAS: [Area; 3] = [
    Area {
        word: Word::Update,
        what: "the update: its file, its signature, the box's slots",
        packages: &[UPDATE, BOARD],
        files: &["board/update/src/", "board/src/update/"],
    },
    Area {
        word: Word::Packets,
        what: "the packets of the link and how they are sealed",
        packages: &[CORE],
        files: &["src/tell/"],
    },
    Area {
        word: Word::Core,
        what: "the core, from the picture to the packet",
        packages: &[CORE],
        files: &["src/"],
    },
];

/// Where everything is kept.
fn home() -> PathBuf {
    target_directory().join("mutants")
}

/// Tries mutants, and says what survived.
pub fn run(arguments: &Arguments) -> Result<()> {
    setup::ensure(&[setup::LINKER, setup::VIDEO])?;
    setup::ensure_disk(&home(), DISK_MB)?;
    CARGO_MUTANTS.ensure()?;
    let is_over = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&is_over))?;
    }
    let mut ledger = Ledger::at(root().join(OUTCOMES))?;
    let mut survivors = 0;
    let is_wanted =
        |area: &&Area| arguments.areas.is_empty() || arguments.areas.contains(&area.word);
    for area in AREAS.iter().filter(is_wanted) {
        let list = list::read(area)?;
        let chosen = chosen(&list, &mut ledger, arguments)?;
        let mut progress = Progress::new(&mut ledger, chosen.len());
        if !chosen.is_empty() {
            let tree = Tree::at(home().join("tree"))?;
            let workshop = Workshop { tree: &tree, is_over: &is_over, jobs: arguments.jobs };
            workshop.try_all(area, &chosen, &mut progress)?;
        }
        let done = progress.done();
        ledger.settle()?;
        let tally = Tally::of(&list, &mut ledger)?;
        tally.report(area, done, arguments.sample.map(|_| arguments.seed))?;
        survivors += tally.survivors().count();
        if is_over.load(Ordering::Relaxed) {
            bail!("ended before all were tried; the next run goes on");
        }
    }
    if survivors > 0 {
        bail!(
            "survivors: {survivors}; each is above. Write the test that tells it from the code, or argue \
             in .cargo/mutants.toml why none can or should"
        );
    }
    Ok(())
}

/// The mutants to try now: those that have not been tried, or a sample of them, and the survivors.
fn chosen<'a>(
    list: &'a List,
    ledger: &mut Ledger,
    arguments: &Arguments,
) -> Result<Vec<&'a Mutant>> {
    let (mut again, mut new) = (Vec::new(), Vec::new());
    let is_wanted = |mutant: &&Mutant| {
        arguments.file.as_ref().is_none_or(|begin| mutant.file.starts_with(begin))
    };
    for mutant in list.mutants.iter().filter(is_wanted) {
        match ledger.outcome(mutant)? {
            Some(Outcome::Survived) => again.push(mutant),
            None => new.push(mutant),
            Some(_) => {}
        }
    }
    if let Some(count) = arguments.sample {
        new = sample(new, count as usize, arguments.seed);
    }
    again.append(&mut new);
    again.sort_by_key(|mutant| (&mutant.file, mutant.span.start));
    Ok(again)
}

/// Draws so many, of each file in proportion. The sum of seed and name puts the mutants of a file in a random
/// order, and where each file's order is stretched over the same length, the first ones are the sample.
fn sample(mutants: Vec<&Mutant>, count: usize, seed: u64) -> Vec<&Mutant> {
    let mut drawn: Vec<(&Mutant, String)> = mutants
        .into_iter()
        .map(|mutant| (mutant, sums::sha256(format!("{seed} {}", mutant.name).as_bytes())))
        .collect();
    drawn.sort_by(|a, b| (&a.0.file, &a.1).cmp(&(&b.0.file, &b.1)));
    let mut placed = Vec::new();
    for file in drawn.chunk_by(|a, b| a.0.file == b.0.file) {
        let places = file.iter().enumerate();
        placed.extend(places.map(|(at, (mutant, sum))| {
            // Millionths of the file; a random part of a step keeps small files from all coming late.
            let part = u64::from_str_radix(&sum[..8], 16).unwrap_or_default() >> 12;
            (((at as u64) * (1 << 20) + part) / file.len() as u64, *mutant)
        }));
    }
    placed.sort_by(|a, b| (a.0, &a.1.name).cmp(&(b.0, &b.1.name)));
    placed.into_iter().take(count).map(|(_, mutant)| mutant).collect()
}

#[cfg(test)]
mod tests {
    use super::list::{Place, Span};
    use super::*;

    #[test]
    fn a_sample_is_of_all_files_in_proportion_and_another_seed_draws_another() {
        let place = Place { line: 1, column: 1 };
        let mutant = |file: &str, number: usize| Mutant {
            name: format!("{file} {number}"),
            package: String::new(),
            file: file.to_owned(),
            function: None,
            replacement: String::new(),
            span: Span { start: place, end: place },
        };
        let mut all: Vec<Mutant> = (0..300).map(|number| mutant("large", number)).collect();
        all.extend((0..100).map(|number| mutant("small", number)));
        let names = |seed: u64, count: usize| {
            let drawn = sample(all.iter().collect(), count, seed);
            let names: Vec<&str> = drawn.iter().map(|it| it.name.as_str()).collect();
            let large = drawn.iter().filter(|it| it.file == "large").count();
            (names.join(","), large)
        };
        let (first, large) = names(1, 40);
        assert!((29..=31).contains(&large), "{large}");
        assert_eq!(first, names(1, 40).0);
        assert_ne!(first, names(2, 40).0);
        assert!(names(1, 41).0.starts_with(&first));
        assert_eq!(sample(all.iter().collect(), 1000, 1).len(), 400);
    }

    #[test]
    fn each_area_has_its_files() {
        for area in AREAS {
            for file in area.files {
                assert!(crate::command::root().join(file).is_dir(), "{file}");
            }
            for package in area.packages {
                let root = crate::command::root().join(package.directory).join("src/lib.rs");
                assert!(root.is_file(), "{}", root.display());
            }
        }
    }
}
