//! One target's run. A program of libFuzzer ends with its first find; it is started again, and goes on
//! with what it had kept, until the time is up.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use plumbline_test_support::fuzz::SEEDS;

use super::tally::{Find, Tally};
use super::{Place, emptied};

/// A program may take this much memory, of which the address sanitizer takes its part.
pub const MEMORY_MB_MAX: u32 = 2560;

/// A failure that comes this often hides all others: the run ends.
const AGAIN_MAX: usize = 3;

/// What a run has counted is shown and kept this often.
const SHOW_EVERY: Duration = Duration::from_secs(20);

/// A program that does not end when its time is up is ended.
const ENDS_WITHIN: Duration = Duration::from_secs(60);

/// Tries a target for this time, or until it is over.
pub fn run(place: &Place, limit: Duration, is_over: &AtomicBool) -> Result<Tally> {
    let (corpus, seeds, finds) = (place.of("corpus"), place.of("seeds"), place.of("finds"));
    let stored = place.unpacked()?;
    for directory in [&corpus, &finds] {
        fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    emptied(&seeds)?;
    let log = kept(place, "log")?;
    let mut log = File::create(&log).with_context(|| log.display().to_string())?;
    let counts = kept(place, "counts")?;
    let mut tally = Tally::new(&place.target);
    let started = Instant::now();
    while !is_over.load(Ordering::Relaxed) {
        let left = limit.saturating_sub(started.elapsed()).as_secs();
        if left == 0 || tally.finds.iter().any(|find| find.times >= AGAIN_MAX) {
            break;
        }
        let task = place
            .task()?
            .args([format!("-max_total_time={left}")])
            .args([format!("-artifact_prefix={}/", finds.display())])
            .args([&corpus, &stored, &seeds])
            .env(SEEDS, &seeds.to_string_lossy())
            // To look up the names of its functions takes so long that a failure would be told as an
            // input that takes too long; `--input` tells them.
            .env("RUST_BACKTRACE", "0")
            .env("ASAN_OPTIONS", "symbolize=0");
        let mut said = Said::default();
        let mut shown = Instant::now();
        let status = task.watch(Duration::from_secs(1), |line| {
            if let Some(line) = line {
                // The log is for people, and the run does not end for want of it.
                let _ = writeln!(log, "{line}");
                said.take(line);
            }
            if shown.elapsed() >= SHOW_EVERY {
                shown = Instant::now();
                let so_far = tally.with(&said, started.elapsed());
                println!("{}", so_far.progress(limit));
                // Likewise.
                let _ = fs::write(&counts, so_far.text());
            }
            started.elapsed() < limit + ENDS_WITHIN && !is_over.load(Ordering::Relaxed)
        })?;
        tally = tally.with(&said, started.elapsed());
        let has_failed = !status.success() && !is_over.load(Ordering::Relaxed);
        if let Some(find) = said.find(has_failed, status) {
            println!("{}: {}", place.target.name, find.words);
            tally.add(find);
        }
        fs::write(&counts, tally.text()).with_context(|| counts.display().to_string())?;
    }
    println!("{}", tally.progress(limit));
    Ok(tally)
}

/// A file of this kind, in a directory that is made.
fn kept(place: &Place, kind: &str) -> Result<PathBuf> {
    let file = place.of(kind).with_extension("txt");
    let directory = file.parent().expect("it lies in a directory");
    fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    Ok(file)
}

/// What a program has said.
#[derive(Debug, Default)]
pub struct Said {
    /// Inputs that were tried.
    pub executions: u64,
    /// Inputs that were kept.
    pub new_inputs: u64,
    /// Places of the code that were reached.
    pub coverage: u64,
    /// Where the input of a find is.
    path: Option<PathBuf>,
    /// The first lines of the failure.
    failure: Vec<String>,
}

impl Said {
    /// Takes a line.
    ///
    /// ```text
    /// #12345  NEW    cov: 1234 ft: 4567 corp: 12/3Kb lim: 100 exec/s: 1234 rss: 60Mb L: 4/5 MS: ...
    /// stat::number_of_executed_units: 12345
    /// artifact_prefix='...'; Test unit written to .../crash-...
    /// ```
    pub fn take(&mut self, line: &str) {
        let mut words = line.split_whitespace();
        if let Some(number) = words.next().and_then(|it| it.strip_prefix('#')) {
            let Ok(number) = number.parse() else { return };
            self.executions = self.executions.max(number);
            let kind = words.next();
            self.new_inputs += u64::from(kind == Some("NEW"));
            let coverage = words.skip_while(|word| *word != "cov:").nth(1);
            self.coverage = coverage.and_then(|it| it.parse().ok()).unwrap_or(self.coverage);
        } else if let Some(number) = line.strip_prefix("stat::number_of_executed_units:") {
            self.executions = number.trim().parse().unwrap_or(self.executions);
        } else if let Some((_, path)) = line.split_once("Test unit written to ") {
            // A slow unit is told of, and is no find.
            if !path.contains("/slow-unit-") {
                self.path = Some(path.trim().into());
            }
        } else {
            let is_place = line.contains(" panicked at ");
            let is_message = self.failure.last().is_some_and(|last| last.contains(" panicked at "));
            if is_place || is_message || line.contains("ERROR: ") {
                self.failure.push(line.trim().to_owned());
            }
        }
    }

    /// The find with which the program ended, if it did.
    fn find(self, has_failed: bool, status: std::process::ExitStatus) -> Option<Find> {
        if !has_failed {
            return None;
        }
        let place = self.failure.first().cloned().unwrap_or_else(|| status.to_string());
        // Of a panic the message, of what the sanitizer found its first line.
        let words: Vec<&str> = self.failure.iter().take(2).map(String::as_str).collect();
        let words = if words.is_empty() { place.clone() } else { words.join(" ") };
        Some(Find { key: key(&place), words, path: self.path, times: 1 })
    }
}

/// What the same failure has in common: the place of a panic, without the thread's number.
fn key(line: &str) -> String {
    let after = line.split_once(" panicked at ").map_or(line, |(_, place)| place);
    // The sanitizer's lines begin with the process.
    let after = after.split_once("ERROR: ").map_or(after, |(_, what)| what);
    after.split(" 0x").next().unwrap_or(after).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_libfuzzer_says_is_counted() {
        let mut said = Said::default();
        for line in [
            "INFO: Running with entropic power schedule (0xFF, 100).",
            "#2\tINITED cov: 12 ft: 13 corp: 1/1b exec/s: 0 rss: 26Mb",
            "#8\tNEW    cov: 20 ft: 21 corp: 2/4b lim: 4 exec/s: 0 rss: 26Mb L: 3/3 MS: 1 CopyPart-",
            "#9\tREDUCE cov: 20 ft: 21 corp: 2/3b lim: 4 exec/s: 0 rss: 26Mb L: 2/2 MS: 1 EraseBytes-",
            "#1024\tpulse  cov: 20 ft: 21 corp: 2/3b lim: 14 exec/s: 512 rss: 27Mb",
            "#abc",
        ] {
            said.take(line);
        }
        assert_eq!((said.executions, said.new_inputs, said.coverage), (1024, 1, 20));
        said.take("stat::number_of_executed_units: 1500");
        assert_eq!(said.executions, 1500);
    }

    #[test]
    fn a_failure_is_known_again_by_its_place() {
        let find = |lines: &[&str]| {
            let mut said = Said::default();
            lines.iter().for_each(|line| said.take(line));
            said.find(true, std::process::ExitStatus::default()).expect("it has failed")
        };
        let one = find(&[
            "thread '<unnamed>' (123) panicked at src/a.rs:1:2:",
            "it is 5",
            "artifact_prefix='/x/'; Test unit written to /x/crash-1",
        ]);
        let other = find(&["thread '<unnamed>' (9) panicked at src/a.rs:1:2:", "it is 6"]);
        assert_eq!(one.key, "src/a.rs:1:2:");
        assert_eq!(one.key, other.key);
        assert!(one.words.ends_with("src/a.rs:1:2: it is 5"), "{}", one.words);
        assert_eq!(one.path, Some("/x/crash-1".into()));
        let late = find(&["==7== ERROR: libFuzzer: timeout after 10 seconds"]);
        assert_eq!(late.key, "libFuzzer: timeout after 10 seconds");
        let slow = find(&["artifact_prefix='/x/'; Test unit written to /x/slow-unit-1"]);
        assert_eq!(slow.path, None);
    }
}
