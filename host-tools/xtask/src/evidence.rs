//! `cargo xtask evidence`: runs what is tried long and often, and writes down what was found.
//!
//! Whatever it runs prints a line for each thing that it has tried:
//!
//! ```text
//! evidence | what was tried | how often | what was found
//! ```
//!
//! These lines, with the date, the commit and the machine, are the page `tests/evidence.md`; nothing in
//! it is written by hand.

use std::fmt::Write as _;
use std::time::Instant;
use std::{env, fs};

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;

use crate::command::Task;
use crate::commit::Commit;
use crate::generated::Part;

/// The page.
const PAGE: &str = "tests/evidence.md";

/// How the lines begin that go onto the page.
const MARK: &str = "evidence | ";

/// The arguments of `cargo xtask evidence`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  cargo xtask evidence                        # everything; a night
  cargo xtask evidence endurance              # one of them
  cargo xtask evidence fuzz --minutes 10      # less than an hour for each target")]
pub struct Arguments {
    /// What to try; everything when left out.
    #[arg(value_enum)]
    what: Vec<What>,
    /// Minutes for each target of `fuzz`.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    minutes: u32,
}

/// What is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// Whatever bytes may come from outside: `cargo xtask fuzz`.
    Fuzz,
    /// A million frames, what goes wrong meanwhile, and power cuts while a box is updated: `cargo xtask
    /// test endurance`.
    Endurance,
    /// The sources, changed a little in thousands of ways, against the tests: `cargo xtask mutants`.
    Mutants,
}

impl What {
    /// Its name on the command line, and on the page.
    fn word(self) -> String {
        self.to_possible_value().expect("none is hidden").get_name().to_owned()
    }

    /// The words of `cargo xtask` that try it.
    fn words(self, minutes: u32) -> Vec<String> {
        match self {
            Self::Fuzz => vec!["fuzz".to_owned(), "--minutes".to_owned(), minutes.to_string()],
            Self::Endurance => vec!["test".to_owned(), self.word()],
            Self::Mutants => vec![self.word()],
        }
    }
}

/// Tries it, and writes the page.
pub fn run(arguments: &Arguments) -> Result<()> {
    let all = What::value_variants();
    let what = if arguments.what.is_empty() { all } else { &arguments.what };
    let (commit, machine) = (Commit::read()?.mark(), machine());
    for what in what {
        let words = what.words(arguments.minutes);
        let began = Instant::now();
        let mut rows = Vec::new();
        let program = env::current_exe().context("this program")?;
        let done = Task::new(program).args(&words).run_and_read(|line| {
            rows.extend(row(line));
        });
        // What was tried before something failed was tried; and that it failed is a finding.
        if let Err(error) = &done {
            rows.push(format!(
                "| {} | | **failed**: {} |",
                words.join(" "),
                cell(&error.to_string())
            ));
        }
        ensure!(!rows.is_empty(), "`cargo xtask {}` has tried nothing", words.join(" "));
        let seconds = began.elapsed().as_secs();
        let text = section(&words.join(" "), &today()?, &commit, &machine, seconds, &rows);
        Part { document: PAGE, name: &what.word() }.write(&text)?;
        done?;
    }
    Ok(())
}

/// The row of the page that a line is, if it is one.
fn row(line: &str) -> Option<String> {
    let cells = line.trim().strip_prefix(MARK)?;
    let cells: Vec<&str> = cells.splitn(3, " | ").map(str::trim).collect();
    let [tried, times, found] = cells[..] else { return None };
    Some(format!("| {} | {} | {} |", cell(tried), cell(times), cell(found)))
}

/// A text that stays in its cell.
fn cell(text: &str) -> String {
    text.replace('|', "/").replace(['\n', '\r'], " ")
}

fn section(
    words: &str,
    date: &str,
    commit: &str,
    machine: &str,
    seconds: u64,
    rows: &[String],
) -> String {
    let mut text = format!(
        "`cargo xtask {words}` on {date}, commit {commit}, {machine}; {} minutes.\n\n\
         | tried | how often | found |\n|---|---|---|\n",
        seconds.div_ceil(60)
    );
    for row in rows {
        // Writing to a string never fails.
        let _ = writeln!(text, "{row}");
    }
    text.trim_end().to_owned()
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
    use super::*;

    #[test]
    fn lines_become_rows_and_nothing_else_does() {
        assert_eq!(
            row("evidence | power cuts while updating | 100 | none led elsewhere").as_deref(),
            Some("| power cuts while updating | 100 | none led elsewhere |")
        );
        // Whatever a row says, the table keeps its shape.
        assert_eq!(row("evidence | a | 1 | b | c").as_deref(), Some("| a | 1 | b / c |"));
        for other in ["evidence |", "evidence | a | b", "test a ... ok", ""] {
            assert_eq!(row(other), None, "{other}");
        }
    }

    #[test]
    fn a_section_says_when_where_and_of_what_it_is() {
        let rows = ["| a | 1 | nothing |".to_owned()];
        let text = section("test update", "2026-01-02", "abc", "2 cores", 61, &rows);
        assert_eq!(
            text,
            "`cargo xtask test update` on 2026-01-02, commit abc, 2 cores; 2 minutes.\n\n\
             | tried | how often | found |\n|---|---|---|\n| a | 1 | nothing |"
        );
    }

    #[test]
    fn the_page_has_a_place_for_each() {
        for what in What::value_variants() {
            Part { document: PAGE, name: &what.word() }.read().unwrap();
        }
    }
}
