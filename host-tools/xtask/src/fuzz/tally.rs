//! What runs have counted and found, and how it is told.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use plumbline_test_support::fuzz::FuzzTarget;

use super::run::Said;
use crate::command::quoted;

/// A failure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Find {
    /// By what it is known again.
    pub key: String,
    /// What failed, and where.
    pub words: String,
    /// The first input with which it did; `None` if libFuzzer has not written one.
    pub path: Option<PathBuf>,
    /// How often it did.
    pub times: usize,
}

/// The counts of a target.
#[derive(Debug, Clone)]
pub struct Tally {
    target: FuzzTarget,
    executions: u64,
    new_inputs: u64,
    coverage: u64,
    took: Duration,
    /// Different failures.
    pub finds: Vec<Find>,
}

impl Tally {
    /// Nothing yet.
    pub fn new(target: &FuzzTarget) -> Self {
        Self {
            target: *target,
            executions: 0,
            new_inputs: 0,
            coverage: 0,
            took: Duration::ZERO,
            finds: Vec::new(),
        }
    }

    /// The same with what a further program has said, this long after the start.
    pub fn with(&self, said: &Said, took: Duration) -> Self {
        Self {
            executions: self.executions + said.executions,
            new_inputs: self.new_inputs + said.new_inputs,
            coverage: self.coverage.max(said.coverage),
            took,
            ..self.clone()
        }
    }

    /// Adds a failure, or notes that it has come again.
    pub fn add(&mut self, find: Find) {
        match self.finds.iter_mut().find(|it| it.key == find.key) {
            Some(known) => known.times += 1,
            None => self.finds.push(find),
        }
    }

    fn per_second(&self) -> f64 {
        self.executions as f64 / self.took.as_secs_f64().max(1.0)
    }

    /// A line while it goes on.
    pub fn progress(&self, limit: Duration) -> String {
        let clock = |time: Duration| format!("{}:{:02}", time.as_secs() / 60, time.as_secs() % 60);
        format!(
            "{:<9} {:>6} of {}: {} executions, {:.0} a second, coverage {}, {} new inputs, {} finds",
            self.target.name,
            clock(self.took),
            clock(limit),
            grouped(self.executions),
            self.per_second(),
            self.coverage,
            self.new_inputs,
            self.finds.len()
        )
    }

    /// What is kept of it while it goes on.
    pub fn text(&self) -> String {
        let mut text = self.evidence() + "\n";
        for find in &self.finds {
            let _ = writeln!(text, "{}", self.told(find));
        }
        text
    }

    /// The line for the page of evidence.
    pub fn evidence(&self) -> String {
        let minutes = self.took.as_secs_f64() / 60.0;
        let found = match self.finds.len() {
            0 => "no failure".to_owned(),
            1 => "1 failure".to_owned(),
            count => format!("{count} failures"),
        };
        format!(
            "evidence | fuzzing {}: {} | {} executions in {minutes:.0} min | {found}; coverage {}",
            self.target.name,
            self.target.what,
            grouped(self.executions),
            self.coverage
        )
    }

    /// A failure, and how to try it again.
    fn told(&self, find: &Find) -> String {
        let name = self.target.name;
        let mut text = format!("{name}: {} ({} times)", find.words, find.times);
        if let Some(path) = &find.path {
            let path = quoted(path.as_os_str());
            let _ = write!(text, "\n  {path}\n  cargo xtask fuzz {name} --input {path}");
        }
        text
    }
}

/// A number with its thousands apart.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Prints what was counted and found.
pub fn report(tallies: &[Tally]) {
    println!("\ntarget       executions   a second  coverage  new inputs  finds");
    for tally in tallies {
        println!(
            "{:<9} {:>13} {:>10.0} {:>9} {:>11} {:>6}",
            tally.target.name,
            grouped(tally.executions),
            tally.per_second(),
            tally.coverage,
            tally.new_inputs,
            tally.finds.len()
        );
    }
    println!();
    for tally in tallies {
        for find in &tally.finds {
            println!("{}", tally.told(find));
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline_test_support::fuzz::TARGETS;

    use super::*;

    #[test]
    fn counts_add_up_over_the_programs_of_a_run() {
        let mut said = Said::default();
        said.take("#1234567 NEW cov: 20 ft: 21 corp: 2/4b lim: 4 exec/s: 0 rss: 26Mb");
        let mut tally = Tally::new(&TARGETS[0]);
        tally = tally.with(&said, Duration::from_secs(60)).with(&said, Duration::from_secs(120));
        assert_eq!((tally.executions, tally.new_inputs, tally.coverage), (2_469_134, 2, 20));
        let find = |key: &str| Find {
            key: key.to_owned(),
            words: "it fails".to_owned(),
            path: Some("/x/crash 1".into()),
            times: 1,
        };
        for key in ["a", "b", "a"] {
            tally.add(find(key));
        }
        assert_eq!(tally.finds.iter().map(|it| it.times).collect::<Vec<_>>(), [2, 1]);
        let text = tally.text();
        let line = text.lines().next().unwrap();
        assert!(line.starts_with("evidence | fuzzing packets: "), "{line}");
        assert!(
            line.ends_with("| 2,469,134 executions in 2 min | 2 failures; coverage 20"),
            "{line}"
        );
        assert_eq!(line.split(" | ").count(), 4);
        assert!(text.contains("cargo xtask fuzz packets --input '/x/crash 1'"), "{text}");
        assert!(tally.progress(Duration::from_secs(600)).contains("2:00 of 10:00: 2,469,134"));
    }

    #[test]
    fn thousands_are_set_apart() {
        let numbers = [0, 12, 123, 1234, 123_456, 1_234_567];
        assert_eq!(
            numbers.map(grouped),
            ["0", "12", "123", "1,234", "123,456", "1,234,567"].map(str::to_owned)
        );
    }
}
