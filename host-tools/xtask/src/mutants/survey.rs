//! Which functions each test of a program reaches, and how long it takes: a mutant meets the tests that reach
//! its function, the quickest first.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Result, ensure};

use super::trial::{Passed, Tests, Took};
use crate::command::Task;

/// The tests that are over after so many seconds of a processor are run together, and then the next ones:
/// most mutants are caught by the first.
const STAGES_S: [f64; 3] = [1.0, 10.0, f64::INFINITY];

/// The tests of a program.
#[derive(Debug)]
pub struct Survey {
    program: PathBuf,
    /// The directory of their package.
    directory: PathBuf,
    /// With their names, the quickest first.
    tests: Vec<(String, Passed)>,
}

impl Survey {
    /// Runs each test by itself without a mutant, so many at a time. `None` when the run was ended.
    pub fn of(
        program: &Path,
        directory: &Path,
        jobs: u32,
        is_over: &AtomicBool,
    ) -> Result<Option<Self>> {
        let list = Task::new(program).args(["--list", "--format", "terse"]).quiet().output()?;
        let names: Vec<&str> =
            list.lines().filter_map(|line| line.strip_suffix(": test")).collect();
        ensure!(!names.is_empty(), "{}: it has no tests", program.display());
        let queue = Mutex::new(names.into_iter());
        let next = || queue.lock().expect("nobody panics with it").next();
        let shared = Mutex::new(Ok(Vec::new()));
        thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(|| {
                    while !is_over.load(Ordering::Relaxed)
                        && let Some(name) = next()
                    {
                        let passed = Tests::survey(program, directory, name, is_over);
                        let mut shared = shared.lock().expect("nobody panics with it");
                        match (passed, &mut *shared) {
                            (Ok(Some(passed)), Ok(tests)) => tests.push((name.to_owned(), passed)),
                            (Err(error), Ok(_)) => *shared = Err(error),
                            _ => break,
                        }
                    }
                });
            }
        });
        let mut tests = shared.into_inner().expect("nobody panicked with it")?;
        tests.sort_by(|(_, a), (_, b)| a.took.processor_s.total_cmp(&b.took.processor_s));
        let (program, directory) = (program.to_owned(), directory.to_owned());
        let survey = Self { program, directory, tests };
        Ok((!is_over.load(Ordering::Relaxed)).then_some(survey))
    }

    /// The tests that reach this function, in the stages in which they are to be run.
    pub fn reaching(&self, function: u32) -> Vec<Tests> {
        let stages = self.stages(function).into_iter();
        stages
            .map(|(names, took)| Tests::named(&self.program, &self.directory, &names, took))
            .collect()
    }

    fn stages(&self, function: u32) -> Vec<(Vec<&str>, Took)> {
        let mut stages = STAGES_S.map(|_| (Vec::new(), Took::default()));
        let mut all = Took::default();
        let is_reaching = |(_, passed): &&(String, Passed)| passed.reached.contains(&function);
        for (name, Passed { took, .. }) in self.tests.iter().filter(is_reaching) {
            all += *took;
            let stage = STAGES_S.iter().position(|end| all.processor_s < *end);
            let (names, of_stage) = &mut stages[stage.unwrap_or(STAGES_S.len() - 1)];
            names.push(name.as_str());
            *of_stage += *took;
        }
        stages.into_iter().filter(|(names, _)| !names.is_empty()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mutant_meets_the_tests_that_reach_it_the_quickest_first() {
        let test = |name: &str, processor_s, reached: &[u32]| {
            let took = Took { processor_s, all_s: 2.0 * processor_s };
            (name.to_owned(), Passed { took, reached: reached.iter().copied().collect() })
        };
        let tests = [
            test("a", 0.1, &[1, 2]),
            test("b", 0.2, &[2]),
            test("c", 0.7, &[1]),
            test("d", 1.0, &[1]),
            test("e", 30.0, &[1, 2]),
        ];
        let (program, directory) = (PathBuf::from("program"), PathBuf::from("directory"));
        let survey = Survey { program, directory, tests: tests.into() };
        let names = |function| {
            let names = survey.stages(function).into_iter().map(|(names, _)| names);
            names.collect::<Vec<_>>()
        };
        assert_eq!(names(1), [&["a", "c"][..], &["d"], &["e"]]);
        assert_eq!(names(2), [&["a", "b"][..], &["e"]]);
        assert!(survey.reaching(3).is_empty());
        let (_, took) = survey.stages(1)[0];
        assert!(
            (took.processor_s - 0.8).abs() < 1e-9 && (took.all_s - 1.6).abs() < 1e-9,
            "{took:?}"
        );
    }
}
