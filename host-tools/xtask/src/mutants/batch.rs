//! Tries mutants, as many together as can be compiled together.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use anyhow::{Context, Result, bail, ensure};

use super::arms::{self, Choice};
use super::build::{Built, CompilerError, build};
use super::ledger::{Ledger, Outcome};
use super::list::Mutant;
use super::survey::Survey;
use super::tree::Tree;
use super::trial::{Tests, Verdict};
use super::{Area, Package, Suite};
use crate::command::root;

/// The lines of functions that are compiled together: as many as the compiler takes a minute for.
const LINES_MAX: usize = 12_000;

// A mutant takes a line at least.
const _: () = assert!(LINES_MAX < arms::TOGETHER_MAX);

/// Where mutants are tried.
pub struct Workshop<'a> {
    pub tree: &'a Tree,
    /// Set by Ctrl-C.
    pub is_over: &'a AtomicBool,
    pub jobs: u32,
}

/// Mutants that are compiled together, and their numbers: their places here, from 1.
struct Batch<'a> {
    package: &'a Package,
    mutants: Vec<&'a Mutant>,
}

/// A batch whose tests can be run.
struct Compiled {
    program: PathBuf,
    /// The number of each mutant's function.
    functions: BTreeMap<u32, u32>,
    /// The numbers of those that do not compile.
    unviable: BTreeSet<u32>,
    /// The numbers of those that do not compile with others.
    alone: BTreeSet<u32>,
}

impl Workshop<'_> {
    /// Tries them, and writes down each outcome.
    pub fn try_all(
        &self,
        area: &Area,
        mutants: &[&Mutant],
        progress: &mut Progress<'_>,
    ) -> Result<()> {
        let mut alone = Vec::new();
        for package in area.packages {
            let mut together = Vec::new();
            for mutant in mutants.iter().copied().filter(|it| it.package == package.name) {
                if arms::is_chosen_at_start(&source(&mutant.file)?, mutant) {
                    together.push(mutant);
                } else {
                    alone.push((package, mutant));
                }
            }
            for batch in batches(package, together) {
                let rest = self.try_together(&batch, progress)?;
                alone.extend(rest.into_iter().map(|mutant| (package, mutant)));
                if self.is_over() {
                    return Ok(());
                }
            }
        }
        for (package, mutant) in alone {
            self.try_alone(&Batch { package, mutants: vec![mutant] }, progress)?;
            if self.is_over() {
                break;
            }
        }
        Ok(())
    }

    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Tries a batch whose mutants are chosen when the tests start. Returns those that have to be compiled
    /// alone.
    fn try_together<'b>(
        &self,
        batch: &Batch<'b>,
        progress: &mut Progress<'_>,
    ) -> Result<Vec<&'b Mutant>> {
        let (first, last) = (batch.mutants[0], batch.mutants[batch.mutants.len() - 1]);
        println!("compiling {} mutants, {} to {}", batch.mutants.len(), first.file, last.file);
        let Some(compiled) = self.compile(batch)? else { return Ok(Vec::new()) };
        let mut numbers = Vec::new();
        for (number, mutant) in batch.numbered() {
            if compiled.unviable.contains(&number) {
                progress.add(mutant, Outcome::Unviable)?;
            } else if !compiled.alone.contains(&number) {
                numbers.push(number);
            }
        }
        self.try_program(
            batch,
            compiled.program,
            numbers,
            &Reach::Known(compiled.functions),
            progress,
        )?;
        self.restore(batch)?;
        Ok(compiled.alone.iter().map(|number| batch.mutant(*number)).collect())
    }

    /// Tries the one mutant of a batch in its place.
    fn try_alone(&self, batch: &Batch<'_>, progress: &mut Progress<'_>) -> Result<()> {
        let mutant = batch.mutants[0];
        let text = arms::with_one(&source(&mutant.file)?, mutant)?;
        self.tree.write(&mutant.file, text.as_bytes())?;
        match build(self.tree, &batch.package.own_suite())? {
            Built::Program(program) => {
                self.try_program(batch, program, vec![1], &Reach::Unknown, progress)?;
            }
            Built::Errors(_) if self.is_over() => {}
            Built::Errors(_) => progress.add(mutant, Outcome::Unviable)?,
        }
        self.restore(batch)
    }

    /// Compiles a batch, leaving out what the compiler does not accept. `None` when the run was ended.
    fn compile(&self, batch: &Batch<'_>) -> Result<Option<Compiled>> {
        let (mut unviable, mut alone) = (BTreeSet::new(), BTreeSet::new());
        loop {
            let is_left = |number: &u32| !unviable.contains(number) && !alone.contains(number);
            let choices = self.write(batch, is_left)?;
            let errors = match build(self.tree, &batch.package.own_suite())? {
                Built::Program(program) => {
                    let choices = choices.values().flatten();
                    let functions = choices
                        .flat_map(|it| it.arms.iter().map(|(number, _)| (*number, it.function())))
                        .collect();
                    return Ok(Some(Compiled { program, functions, unviable, alone }));
                }
                Built::Errors(_) if self.is_over() => return Ok(None),
                Built::Errors(errors) => errors,
            };
            let before = unviable.len() + alone.len();
            for error in &errors {
                match blamed(error, &choices) {
                    Some(Blamed::Mutant(number)) => {
                        unviable.insert(number);
                    }
                    Some(Blamed::Function(numbers)) => alone.extend(numbers),
                    None => {}
                }
            }
            let is_better = unviable.len() + alone.len() > before;
            let CompilerError { text, places } = &errors[0];
            let name = batch.package.name;
            ensure!(is_better, "{name} cannot be compiled with mutants: {text} ({places:?})");
        }
    }

    /// Writes the files of a batch with the mutants that are left.
    fn write(
        &self,
        batch: &Batch<'_>,
        is_left: impl Fn(&u32) -> bool,
    ) -> Result<BTreeMap<String, Vec<Choice>>> {
        let crate_root = batch.package.crate_root();
        let mut files = BTreeMap::from([(crate_root.clone(), Vec::new())]);
        for (number, mutant) in batch.numbered() {
            let members = files.entry(mutant.file.clone()).or_default();
            if is_left(&number) {
                members.push((number, mutant));
            }
        }
        let mut choices = BTreeMap::new();
        for (file, members) in files {
            let (mut text, of_file) = arms::with_all(&source(&file)?, &members)?;
            if file == crate_root {
                text += arms::CHOICE;
            }
            self.tree.write(&file, text.as_bytes())?;
            choices.insert(file, of_file);
        }
        Ok(choices)
    }

    /// Brings the files of a batch back to what they were.
    fn restore(&self, batch: &Batch<'_>) -> Result<()> {
        let crate_root = batch.package.crate_root();
        let files: BTreeSet<&str> = batch.mutants.iter().map(|it| it.file.as_str()).collect();
        for file in files.into_iter().chain([crate_root.as_str()]) {
            self.tree.write(file, source(file)?.as_bytes())?;
        }
        Ok(())
    }

    /// Takes these mutants of a batch through their tests, each to its outcome before the next begins: a run
    /// that is ended leaves out the last ones, and not those that are hard to catch.
    fn try_program(
        &self,
        batch: &Batch<'_>,
        program: PathBuf,
        numbers: Vec<u32>,
        reach: &Reach,
        progress: &mut Progress<'_>,
    ) -> Result<()> {
        let course = Course {
            workshop: self,
            batch,
            reach,
            programs: Mutex::new(vec![program]),
            surveys: Mutex::new(Vec::new()),
        };
        let queue = Mutex::new(numbers.into_iter());
        let next = || queue.lock().expect("nobody panics with it").next();
        let shared = Mutex::new((progress, Ok(())));
        thread::scope(|scope| {
            for _ in 0..self.jobs {
                scope.spawn(|| {
                    while !self.is_over()
                        && let Some(number) = next()
                    {
                        let outcome = course.outcome(number);
                        let mut shared = shared.lock().expect("nobody panics with it");
                        let (progress, failure) = &mut *shared;
                        let written = outcome.and_then(|outcome| match outcome {
                            Some(outcome) => progress.add(batch.mutant(number), outcome),
                            None => Ok(()),
                        });
                        if written.is_err() {
                            *failure = written;
                            break;
                        }
                    }
                });
            }
        });
        shared.into_inner().expect("nobody panicked with it").1
    }
}

/// The tests that a mutant of a batch meets until one fails: the crate's own, then those beyond it. What is
/// compiled and surveyed waits until a mutant comes that far.
struct Course<'a> {
    workshop: &'a Workshop<'a>,
    batch: &'a Batch<'a>,
    reach: &'a Reach,
    /// The crate's own tests, and as many of those beyond it as have been compiled.
    programs: Mutex<Vec<PathBuf>>,
    /// Of these programs, as many as have been surveyed.
    surveys: Mutex<Vec<Arc<Survey>>>,
}

/// Which tests a mutant meets.
enum Reach {
    /// Those that reach its function, whose number this tells.
    Known(BTreeMap<u32, u32>),
    /// Those of its own part of the crate, then all: a program that has its mutant in place cannot be run
    /// without it.
    Unknown,
}

impl Course<'_> {
    /// What becomes of a mutant; `None` when the run was ended meanwhile.
    fn outcome(&self, number: u32) -> Result<Option<Outcome>> {
        for place in 0..=self.batch.package.beyond.len() {
            let Some(tests) = self.tests(place, number)? else { return Ok(None) };
            for tests in tests {
                match tests.run(number, self.workshop.is_over)? {
                    Verdict::Passed => {}
                    Verdict::Failed => return Ok(Some(Outcome::Caught)),
                    Verdict::TimedOut => return Ok(Some(Outcome::TimedOut)),
                    Verdict::Interrupted => return Ok(None),
                }
            }
        }
        Ok(Some(Outcome::Survived))
    }

    /// The tests of the program at this place that a mutant meets, stage by stage; `None` when the run was
    /// ended meanwhile.
    fn tests(&self, place: usize, number: u32) -> Result<Option<Vec<Tests>>> {
        match self.reach {
            Reach::Known(functions) => {
                let survey = self.survey(place)?;
                Ok(survey.map(|survey| survey.reaching(functions[&number])))
            }
            Reach::Unknown => {
                let Some(program) = self.program(place)? else { return Ok(None) };
                let part = if place == 0 { part(self.batch.mutant(number)) } else { String::new() };
                let mut parts = vec![part, String::new()];
                parts.dedup();
                let tests = |part: &String| Tests::with(&program, &self.directory(place), part);
                Ok(Some(parts.iter().map(tests).collect()))
            }
        }
    }

    fn survey(&self, place: usize) -> Result<Option<Arc<Survey>>> {
        let mut surveys = self.surveys.lock().expect("nobody panics with it");
        while surveys.len() <= place {
            let next = surveys.len();
            let Some(program) = self.program(next)? else { return Ok(None) };
            let Workshop { jobs, is_over, .. } = *self.workshop;
            match Survey::of(&program, &self.directory(next), jobs, is_over)? {
                Some(survey) => surveys.push(Arc::new(survey)),
                None => return Ok(None),
            }
        }
        Ok(Some(Arc::clone(&surveys[place])))
    }

    /// The directory of the package whose tests are at this place.
    fn directory(&self, place: usize) -> PathBuf {
        self.workshop.tree.place().join(self.suite(place).directory)
    }

    fn program(&self, place: usize) -> Result<Option<PathBuf>> {
        let mut programs = self.programs.lock().expect("nobody panics with it");
        while programs.len() <= place {
            let suite = self.suite(programs.len());
            match build(self.workshop.tree, &suite)? {
                Built::Program(program) => programs.push(program),
                Built::Errors(_) if self.workshop.is_over() => return Ok(None),
                Built::Errors(errors) => bail!("{}: {}", suite.package, errors[0].text),
            }
        }
        Ok(Some(programs[place].clone()))
    }

    fn suite(&self, place: usize) -> Suite {
        match place.checked_sub(1) {
            None => self.batch.package.own_suite(),
            Some(beyond) => self.batch.package.beyond[beyond],
        }
    }
}

/// Where outcomes are written down, and how far the run is.
pub struct Progress<'a> {
    ledger: &'a mut Ledger,
    done: usize,
    of: usize,
}

impl<'a> Progress<'a> {
    /// So many mutants will be tried.
    pub fn new(ledger: &'a mut Ledger, of: usize) -> Self {
        Self { ledger, done: 0, of }
    }

    /// How many were tried.
    pub fn done(&self) -> usize {
        self.done
    }

    fn add(&mut self, mutant: &Mutant, outcome: Outcome) -> Result<()> {
        self.ledger.add(mutant, outcome)?;
        self.done += 1;
        if outcome == Outcome::Survived {
            println!("survived: {}", mutant.name);
        } else if self.done.is_multiple_of(50) || self.done == self.of {
            println!("{} of {} tried", self.done, self.of);
        }
        Ok(())
    }
}

impl Package {
    /// The tests beside its code.
    fn own_suite(&self) -> Suite {
        Suite { package: self.name, directory: self.directory, target: &["--lib"] }
    }

    /// The file of its crate's root.
    fn crate_root(&self) -> String {
        format!("{}src/lib.rs", self.directory)
    }
}

impl<'a> Batch<'a> {
    fn mutant(&self, number: u32) -> &'a Mutant {
        self.mutants[number as usize - 1]
    }

    fn numbered(&self) -> impl Iterator<Item = (u32, &'a Mutant)> {
        (1..).zip(self.mutants.iter().copied())
    }
}

/// Parts mutants into batches, in their order.
fn batches<'a>(package: &'a Package, mutants: Vec<&'a Mutant>) -> Vec<Batch<'a>> {
    let (mut batches, mut lines): (Vec<Batch<'_>>, usize) = (Vec::new(), 0);
    for mutant in mutants {
        let span = mutant.function.as_ref().map_or(mutant.span, |it| it.span);
        let own = span.end.line - span.start.line + 1;
        lines += own;
        match batches.last_mut().filter(|_| lines <= LINES_MAX) {
            Some(batch) => batch.mutants.push(mutant),
            None => {
                lines = own;
                batches.push(Batch { package, mutants: vec![mutant] });
            }
        }
    }
    batches
}

/// What makes the compiler refuse.
#[derive(Debug, PartialEq, Eq)]
enum Blamed {
    /// The mutant of this number.
    Mutant(u32),
    /// A function: that it has all these mutants.
    Function(Vec<u32>),
}

/// Whom an error is laid to: the first place of it that is in an arm, or else in a function with arms.
fn blamed(error: &CompilerError, choices: &BTreeMap<String, Vec<Choice>>) -> Option<Blamed> {
    let functions = error.places.iter().filter_map(|(file, line)| {
        let choice = choices.get(file)?.iter().find(|choice| choice.lines.contains(line))?;
        Some((choice, line))
    });
    let mutant = functions.clone().find_map(|(choice, line)| {
        let (number, _) = choice.arms.iter().find(|(_, lines)| lines.contains(line))?;
        Some(Blamed::Mutant(*number))
    });
    let function = |(choice, _): (&Choice, &usize)| {
        Blamed::Function(choice.arms.iter().map(|(number, _)| *number).collect())
    };
    mutant.or_else(|| functions.map(function).next())
}

/// The part of the crate that a mutant is in, as the names of its tests begin: `tell::seal::` for
/// `src/tell/seal/window.rs`, `pipeline::` for `src/pipeline.rs`.
fn part(mutant: &Mutant) -> String {
    let path = mutant.file.rsplit_once("src/").map_or("", |(_, path)| path);
    let path = path.trim_end_matches(".rs");
    let names = path.rsplit_once('/').map_or(path, |(directory, _)| directory);
    if names == "lib" { String::new() } else { names.replace('/', "::") + "::" }
}

/// The text of a file as it is checked out.
fn source(file: &str) -> Result<String> {
    fs::read_to_string(root().join(file)).with_context(|| file.to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::list::{Function, Place, Span};
    use super::*;
    use crate::command::Task;

    fn mutant(file: &str, lines: usize) -> Mutant {
        let [start, end] = [1, lines].map(|line| Place { line, column: 1 });
        let span = Span { start, end };
        Mutant {
            name: String::new(),
            package: String::new(),
            file: file.to_owned(),
            function: Some(Function { return_type: String::new(), span }),
            replacement: String::new(),
            span,
        }
    }

    #[test]
    fn a_batch_is_not_longer_than_the_compiler_can_bear() {
        let mutants = [9000, 3000, 1, 20_000, 5].map(|lines| mutant("a.rs", lines));
        let sizes: Vec<usize> = batches(&super::super::CORE, mutants.iter().collect())
            .iter()
            .map(|batch| batch.mutants.len())
            .collect();
        assert_eq!(sizes, [2, 1, 1, 1]);
    }

    /// A run may be ended at any time: what it has not tried must not be what is hard to catch.
    #[test]
    fn a_mutant_has_met_all_its_tests_before_the_next_one_begins() {
        let folder = tempfile::tempdir().unwrap();
        let [program, calls] = ["program", "calls"].map(|name| folder.path().join(name));
        // Tests that tell a mutant only when all are run. Another process writes them: what this one has open
        // for writing cannot be started by any of its threads.
        let text = "#!/bin/sh\n\
             echo \"$PLUMBLINE_MUTANT $2\" >> \"$(dirname \"$0\")/calls\"\n\
             [ -n \"$2\" ] || echo 'test a_law ... FAILED'\n";
        Task::new("sh")
            .args(["-c", "printf %s \"$0\" > \"$1\" && chmod +x \"$1\"", text])
            .args([&program])
            .run()
            .unwrap();
        let is_over = AtomicBool::new(false);
        // Of the copy only the directories are used, in which the tests are started.
        let tree = Tree::locked(folder.path().join("tree")).unwrap();
        fs::create_dir_all(tree.place().join(super::super::UPDATE.directory)).unwrap();
        let workshop = Workshop { tree: &tree, is_over: &is_over, jobs: 1 };
        let mutants =
            [mutant("board/update/src/card.rs", 1), mutant("board/update/src/sign.rs", 1)];
        let batch = Batch { package: &super::super::UPDATE, mutants: mutants.iter().collect() };
        let mut ledger = Ledger::at(folder.path().join("outcomes")).unwrap();
        let mut progress = Progress::new(&mut ledger, mutants.len());
        workshop.try_program(&batch, program, vec![1, 2], &Reach::Unknown, &mut progress).unwrap();
        assert_eq!(progress.done(), mutants.len());
        assert_eq!(fs::read_to_string(calls).unwrap(), "1 card::\n1 \n2 sign::\n2 \n");
        for mutant in &mutants {
            assert_eq!(ledger.outcome(mutant).unwrap(), Some(Outcome::Caught));
        }
    }

    #[test]
    fn an_error_is_laid_to_the_mutant_or_else_to_its_function() {
        let choices = vec![Choice { lines: 10..30, arms: vec![(1, 10..15), (2, 15..20)] }];
        let choices = BTreeMap::from([("a.rs".to_owned(), choices)]);
        let of = |places: &[(&str, usize)]| {
            let places = places.iter().map(|(file, line)| ((*file).to_owned(), *line)).collect();
            blamed(&CompilerError { text: String::new(), places }, &choices)
        };
        assert_eq!(of(&[("a.rs", 14)]), Some(Blamed::Mutant(1)));
        assert_eq!(of(&[("b.rs", 14), ("a.rs", 25), ("a.rs", 15)]), Some(Blamed::Mutant(2)));
        assert_eq!(of(&[("b.rs", 1), ("a.rs", 29)]), Some(Blamed::Function(vec![1, 2])));
        assert_eq!(of(&[("a.rs", 30), ("b.rs", 14)]), None);
    }

    #[test]
    fn the_part_of_a_mutant_is_its_files_directory() {
        let part = |file: &str| part(&mutant(file, 1));
        assert_eq!(part("src/tell/seal/window.rs"), "tell::seal::");
        assert_eq!(part("src/tell/packet/mod.rs"), "tell::packet::");
        assert_eq!(part("src/pipeline.rs"), "pipeline::");
        assert_eq!(part("board/src/update/slots.rs"), "update::");
        assert_eq!(part("board/update/src/card.rs"), "card::");
        assert_eq!(part("src/lib.rs"), "");
    }
}
