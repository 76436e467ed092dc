//! `cargo xtask evidence`: runs what is tried long and often, and writes down what was found.
//!
//! Whatever it runs prints a line for each thing that it has tried:
//!
//! ```text
//! evidence | what was tried | how often | what was found
//! ```
//!
//! Each of these lines is a row of the page `tests/evidence.md`, with its own date, commit and machine;
//! nothing in it is written by hand. A row is known by what was tried: a run replaces the rows of what it
//! has tried, and leaves the others, so that what takes a night can be tried in parts.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::{env, fs};

use anyhow::{Context, Result, bail, ensure};

use crate::command::{Task, word};
use crate::commit::Commit;
use crate::generated::Part;
use crate::tests::Ordeal;
use crate::{fuzz, mutants};

/// The page.
const PAGE: &str = "tests/evidence.md";

/// How the lines begin that go onto the page.
const MARK: &str = "evidence | ";

/// What stands above the rows.
const HEAD: &str =
    "| tried | how often | found | date | commit | machine |\n|---|---|---|---|---|---|";

/// The arguments of `cargo xtask evidence`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cargo xtask evidence                                  # everything; a night
  cargo xtask evidence fuzz packets link --minutes 60   # these targets; other rows stay as they are
  cargo xtask evidence endurance
  cargo xtask evidence endurance storing unplugged      # these things of it, in an hour and a quarter
  cargo xtask evidence mutants update --jobs 2          # mutants of the update alone")]
pub struct Arguments {
    /// What to try; everything when left out.
    #[command(subcommand)]
    what: Option<What>,
}

/// What is tried.
#[derive(Debug, Clone, clap::Subcommand)]
enum What {
    /// Whatever bytes may come from outside: `cargo xtask fuzz`.
    Fuzz(Fuzz),
    /// A million frames, what goes wrong meanwhile, and power cuts while a box is updated: `cargo xtask
    /// test endurance`.
    Endurance(Endurance),
    /// The sources, changed a little in thousands of ways, against the tests: `cargo xtask mutants`.
    Mutants(Mutants),
}

/// Which targets are tried, and for how long.
#[derive(Debug, Clone, clap::Args)]
struct Fuzz {
    /// The targets; all when left out.
    #[arg(value_parser = fuzz::names())]
    targets: Vec<String>,
    /// Minutes for each.
    #[arg(long, default_value_t = MINUTES, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    minutes: u32,
    /// How many are tried at a time; each keeps a processor core busy.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    jobs: u32,
}

/// What of it is tried.
#[derive(Debug, Clone, clap::Args)]
struct Endurance {
    /// These things; all when left out.
    #[arg(value_enum)]
    ordeals: Vec<Ordeal>,
}

/// Whose mutants are tried.
#[derive(Debug, Clone, clap::Args)]
struct Mutants {
    /// These areas; all when left out.
    #[arg(value_enum)]
    areas: Vec<mutants::Word>,
    /// How many are tried at a time; each keeps a processor core busy.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    jobs: u32,
}

/// For each target, where nothing else is said.
const MINUTES: u32 = 60;

impl What {
    fn everything() -> [Self; 3] {
        let fuzz = Fuzz { targets: Vec::new(), minutes: MINUTES, jobs: 1 };
        let endurance = Endurance { ordeals: Vec::new() };
        let mutants = Mutants { areas: Vec::new(), jobs: 1 };
        [Self::Fuzz(fuzz), Self::Endurance(endurance), Self::Mutants(mutants)]
    }

    /// The name of its part of the page.
    fn part(&self) -> &'static str {
        match self {
            Self::Fuzz(_) => "fuzz",
            Self::Endurance(_) => "endurance",
            Self::Mutants(_) => "mutants",
        }
    }

    /// The words of `cargo xtask` that try it.
    fn words(&self) -> Vec<String> {
        match self {
            Self::Fuzz(Fuzz { targets, minutes, jobs }) => {
                let bounds = ["--minutes".to_owned(), minutes.to_string()];
                let jobs = ["--jobs".to_owned(), jobs.to_string()];
                [&["fuzz".to_owned()], &targets[..], &bounds, &jobs].concat()
            }
            Self::Endurance(Endurance { ordeals }) => {
                let names: Vec<String> = ordeals.iter().map(word).collect();
                let only = (!names.is_empty()).then(|| format!("--only={}", names.join(",")));
                ["test".to_owned(), "endurance".to_owned()].into_iter().chain(only).collect()
            }
            Self::Mutants(Mutants { areas, jobs }) => {
                let areas: Vec<String> = areas.iter().map(word).collect();
                let jobs = ["--jobs".to_owned(), jobs.to_string()];
                [&["mutants".to_owned()], &areas[..], &jobs].concat()
            }
        }
    }

    /// Whether it tries all that its part of the page has rows of.
    fn is_whole(&self) -> bool {
        match self {
            Self::Fuzz(fuzz) => fuzz.targets.is_empty(),
            Self::Endurance(Endurance { ordeals }) => ordeals.is_empty(),
            Self::Mutants(mutants) => mutants.areas.is_empty(),
        }
    }

    /// The row that says that it has failed, where its other rows would not. Why is said by the run: its
    /// error names directories of this computer.
    fn failure(&self) -> Option<Row> {
        match self {
            // Its rows say how many failures were found; without one nothing was tried.
            Self::Fuzz(_) => None,
            Self::Endurance(_) | Self::Mutants(_) => {
                Some(Row::new(&format!("cargo xtask {}", self.words().join(" ")), "", "**failed**"))
            }
        }
    }

    /// Its rows of earlier runs, but for the one that says that it failed: now it runs again.
    fn without_failure(&self, mut old: Vec<Row>) -> Vec<Row> {
        let failure = self.failure();
        old.retain(|row| failure.as_ref().is_none_or(|failure| failure.tried() != row.tried()));
        old
    }
}

/// Tries it, and writes the page. Ctrl-C ends what is being tried; what was tried until then is written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let what = arguments.what.clone().map_or(What::everything().to_vec(), |what| vec![what]);
    let is_over = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&is_over))?;
    }
    // What is tried is built now, whatever is committed meanwhile. What is written is not tried.
    let own = [&[PAGE][..], &mutants::WRITTEN].concat();
    let (commit, machine) = (Commit::read_but(&own)?.mark(), machine());
    for what in what {
        let words = what.words().join(" ");
        let mut rows = Vec::new();
        let program = env::current_exe().context("this program")?;
        let done =
            Task::new(program).args(what.words()).run_and_read(|line| rows.extend(row(line)));
        let is_interrupted = is_over.load(Ordering::Relaxed);
        // What was tried before something failed was tried; and that it failed is a finding.
        if done.is_err() && !is_interrupted {
            rows.extend(what.failure());
        }
        let of = [today()?, commit.clone(), machine.clone()];
        let rows: VecDeque<Row> = rows.into_iter().map(|row| row.with(&of)).collect();
        if !rows.is_empty() {
            let part = Part { document: PAGE, name: what.part() };
            let is_complete = what.is_whole() && done.is_ok() && !is_interrupted;
            let old = if is_complete { Vec::new() } else { read(&part.read()?) };
            part.write(&written(&merged(what.without_failure(old), rows)))?;
        } else {
            ensure!(done.is_err(), "`cargo xtask {words}` has tried nothing");
        }
        if is_interrupted {
            bail!("`cargo xtask {words}` was interrupted");
        }
        done?;
    }
    Ok(())
}

/// The cells of a row of the page; the first one says what was tried.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Row(Vec<String>);

impl Row {
    fn new(tried: &str, times: &str, found: &str) -> Self {
        Self([tried, times, found].map(cell).to_vec())
    }

    /// With further cells.
    fn with(mut self, cells: &[String]) -> Self {
        self.0.extend(cells.iter().map(|text| cell(text)));
        self
    }

    fn tried(&self) -> &str {
        &self.0[0]
    }
}

/// The row that a line of a run is, if it is one.
fn row(line: &str) -> Option<Row> {
    let cells = line.trim().strip_prefix(MARK)?;
    let cells: Vec<&str> = cells.splitn(3, " | ").collect();
    let [tried, times, found] = cells[..] else { return None };
    Some(Row::new(tried, times, found))
}

/// A text that stays in its cell.
fn cell(text: &str) -> String {
    text.trim().replace('|', "/").replace(['\n', '\r'], " ")
}

/// The rows of a part of the page.
fn read(part: &str) -> Vec<Row> {
    let lines = part.strip_prefix(HEAD).unwrap_or_default().lines();
    let cells = lines.filter_map(|line| line.strip_prefix('|')?.strip_suffix('|'));
    cells.map(|cells| Row(cells.split('|').map(cell).collect())).collect()
}

/// The old rows, each in its place replaced by the new one of what was tried again; then those of what
/// was never tried before.
fn merged(old: Vec<Row>, mut new: VecDeque<Row>) -> Vec<Row> {
    let replace = |row: Row| match new.iter().position(|it| it.tried() == row.tried()) {
        Some(at) => new.remove(at).expect("it is there"),
        None => row,
    };
    let mut rows: Vec<Row> = old.into_iter().map(replace).collect();
    rows.extend(new);
    rows
}

/// The part of the page with these rows.
fn written(rows: &[Row]) -> String {
    let rows = rows.iter().map(|Row(cells)| format!("\n| {} |", cells.join(" | ")));
    HEAD.to_owned() + &rows.collect::<String>()
}

fn today() -> Result<String> {
    Ok(Task::new("date").args(["--utc", "+%Y-%m-%d"]).output()?.trim().to_owned())
}

/// The processor, its cores and the kernel.
fn machine() -> String {
    let information = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model =
        information.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or(env::consts::ARCH, |(_, model)| model);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let kernel = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    format!("{cores} cores of {model}, Linux {}", kernel.trim())
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    /// A row that was found on a day.
    fn found(tried: &str, found: &str, date: &str) -> Row {
        Row::new(tried, "9", found).with(&[date, "1a2b3c4d", "2 cores"].map(str::to_owned))
    }

    #[test]
    fn lines_become_rows_and_nothing_else_does() {
        assert_eq!(
            row("evidence | power cuts while updating | 100 | none led elsewhere"),
            Some(Row::new("power cuts while updating", "100", "none led elsewhere"))
        );
        // Whatever a row says, the table keeps its shape.
        assert_eq!(row("evidence | a | 1 | b | c"), Some(Row::new("a", "1", "b / c")));
        for other in ["evidence |", "evidence | a | b", "test a ... ok", ""] {
            assert_eq!(row(other), None, "{other}");
        }
    }

    #[test]
    fn a_page_that_was_written_is_read_again() {
        let rows = [found("a", "", "2026-01-02"), found("b", "nothing", "2026-01-03")];
        let page = written(&rows);
        assert_eq!(page.lines().nth(2), Some("| a | 9 |  | 2026-01-02 | 1a2b3c4d | 2 cores |"));
        assert_eq!(read(&page), rows);
        for other in ["Not run yet.", HEAD, ""] {
            assert_eq!(read(other), [], "{other}");
        }
    }

    #[test]
    fn a_run_replaces_the_rows_of_what_it_has_tried_and_leaves_the_others() {
        let old = [("a", "1"), ("b", "2"), ("c", "3")];
        let old = old.map(|(tried, day)| found(tried, "nothing", day)).to_vec();
        let new = [found("d", "1 failure", "9"), found("b", "nothing", "9")];
        let merged = merged(old, new.into());
        let days: Vec<_> = merged.iter().map(|row| (row.tried(), &*row.0[3])).collect();
        assert_eq!(days, [("a", "1"), ("b", "9"), ("c", "3"), ("d", "9")]);
    }

    #[test]
    fn a_failure_is_on_the_page_until_the_same_is_tried_again() {
        let models = What::Endurance(Endurance { ordeals: vec![Ordeal::Models] });
        let failed = "cargo xtask test endurance --only=models";
        assert_eq!(models.failure(), Some(Row::new(failed, "", "**failed**")));
        let old = ["a", failed].map(|tried| found(tried, "", "1")).to_vec();
        assert_eq!(models.without_failure(old.clone()), old[..1]);
        let card = What::Endurance(Endurance { ordeals: vec![Ordeal::Card] });
        assert_eq!(card.without_failure(old.clone()), old);
    }

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    #[test]
    fn the_words_of_what_is_tried_are_those_of_the_other_commands() {
        let words = |line: &str| -> Vec<String> {
            let line = Line::try_parse_from(line.split(' ')).unwrap_or_else(|it| panic!("{it}"));
            let what = line.arguments.what.map_or(What::everything().to_vec(), |it| vec![it]);
            what.iter().map(|what| what.words().join(" ")).collect()
        };
        assert_eq!(
            words("evidence"),
            ["fuzz --minutes 60 --jobs 1", "test endurance", "mutants --jobs 1"]
        );
        assert_eq!(
            words("evidence fuzz packets link --minutes 5 --jobs 2"),
            ["fuzz packets link --minutes 5 --jobs 2"]
        );
        assert_eq!(
            words("evidence endurance storing unplugged"),
            ["test endurance --only=storing,unplugged"]
        );
        assert_eq!(
            words("evidence mutants update packets --jobs 2"),
            ["mutants update packets --jobs 2"]
        );
        for wrong in ["fuzz", "endurance", "mutants"].map(|what| [what, "nothing"]) {
            assert!(Line::try_parse_from([&["evidence"], &wrong[..]].concat()).is_err());
        }
    }

    #[test]
    fn only_what_tries_everything_again_removes_rows_of_other_things() {
        assert!(What::everything().iter().all(What::is_whole));
        let some = Fuzz { targets: vec!["link".to_owned()], minutes: 1, jobs: 1 };
        assert!(!What::Fuzz(some).is_whole());
        assert!(!What::Endurance(Endurance { ordeals: vec![Ordeal::Card] }).is_whole());
        let some = Mutants { areas: vec![mutants::Word::Update], jobs: 1 };
        assert!(!What::Mutants(some).is_whole());
    }

    #[test]
    fn the_page_has_a_place_for_each() {
        for what in What::everything() {
            let part = Part { document: PAGE, name: what.part() }.read().unwrap();
            let rows = read(&part);
            assert!(part == "Not run yet." || written(&rows) == part, "{part}");
        }
    }
}
