//! The mutants, as cargo-mutants finds them: which it makes of each function and operator, less those that
//! `.cargo/mutants.toml` argues away.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

use super::{Area, CARGO_MUTANTS};
use crate::command::Task;

/// A place in a file: line and column, both from 1, the column in characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
pub struct Place {
    pub line: usize,
    pub column: usize,
}

/// From here to there, exclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct Span {
    pub start: Place,
    pub end: Place,
}

impl Span {
    /// Whether it holds the whole of another.
    pub fn holds(&self, other: &Self) -> bool {
        self.start <= other.start && other.end <= self.end
    }
}

/// The function that a mutant changes.
#[derive(Debug, Clone, Deserialize)]
pub struct Function {
    pub return_type: String,
    pub span: Span,
}

/// A change of the source.
#[derive(Debug, Clone, Deserialize)]
pub struct Mutant {
    /// Place and change in words; unique.
    pub name: String,
    pub package: String,
    /// Relative to the root.
    pub file: String,
    /// `None` for a constant and the like.
    pub function: Option<Function>,
    pub replacement: String,
    /// What is replaced.
    pub span: Span,
}

/// The mutants of an area.
pub struct List {
    /// Those to try, by file and then in the order of the source.
    pub mutants: Vec<Mutant>,
    /// How many more of each file are argued away.
    pub argued: BTreeMap<String, usize>,
}

/// Finds the mutants.
pub fn read(area: &Area) -> Result<List> {
    let all = ask(area, &["--no-config"])?;
    let mutants = ask(area, &[])?;
    ensure!(!mutants.is_empty(), "cargo-mutants finds nothing in {}", area.files.join(", "));
    let kept: BTreeSet<&str> = mutants.iter().map(|it| it.name.as_str()).collect();
    ensure!(kept.len() == mutants.len(), "two mutants have the same name");
    let mut argued = BTreeMap::new();
    for mutant in all.into_iter().filter(|it| !kept.contains(it.name.as_str())) {
        *argued.entry(mutant.file).or_default() += 1;
    }
    Ok(List { mutants, argued })
}

fn ask(area: &Area, options: &[&str]) -> Result<Vec<Mutant>> {
    let packages = area.packages.iter().flat_map(|it| ["--package", it.name]);
    let text = Task::new(CARGO_MUTANTS.name)
        .args(["mutants", "--list", "--json"])
        .args(packages)
        .args(options)
        .output()?;
    let mut mutants: Vec<Mutant> =
        serde_json::from_str(&text).context("the list of cargo-mutants cannot be read")?;
    mutants.retain(|it| area.files.iter().any(|file| it.file.starts_with(file)));
    mutants.sort_by(|a, b| (&a.file, a.span.start).cmp(&(&b.file, b.span.start)));
    Ok(mutants)
}
