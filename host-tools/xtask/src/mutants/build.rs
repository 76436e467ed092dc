//! Compiles tests with mutants in them, and tells which mutants do not compile.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

use super::Suite;
use super::tree::Tree;
use crate::command::{Task, target_directory};

/// What came of compiling.
pub enum Built {
    /// The program with the tests.
    Program(PathBuf),
    /// What the compiler did not accept.
    Errors(Vec<CompilerError>),
}

/// An error of the compiler.
#[derive(Debug)]
pub struct CompilerError {
    /// What it says.
    pub text: String,
    /// The files and lines that it points at, the most important first.
    pub places: Vec<(String, usize)>,
}

/// How crates with mutants are compiled: each function is there hundreds of times, so it is optimised once,
/// in many units, and the tests take little longer. All others are compiled as for the checks, and shared
/// with them.
const OPTIONS: [&str; 5] = [
    "plumbline.opt-level=1",
    "plumbline.codegen-units=16",
    "plumbline.debug=false",
    "plumbline-board.opt-level=1",
    "plumbline-board.debug=false",
];

/// Compiles the tests of a suite in a tree.
pub fn build(tree: &Tree, suite: &Suite) -> Result<Built> {
    let options = OPTIONS.map(|option| format!("--config=profile.dev.package.{option}"));
    let task = Task::cargo()
        .args(["test", "--no-run", "--quiet", "--message-format", "json"])
        .args(options)
        .args(["--package", suite.package])
        .args(suite.target)
        .env("CARGO_TARGET_DIR", &target_directory().to_string_lossy())
        // Most of the crate is as it was for the mutant before, whatever is asked of the checks: one that is
        // compiled alone takes a quarter of the time.
        .env("CARGO_INCREMENTAL", "1")
        .current_dir(tree.place());
    let (output, status) = task.capture().context("cargo cannot be started")?;
    let messages = output.lines().filter_map(|line| serde_json::from_str::<Message>(line).ok());
    let (mut program, mut errors) = (None, Vec::new());
    for message in messages {
        if message.reason == "compiler-artifact" && message.target.is_some_and(|it| it.test) {
            program = message.executable.or(program);
        }
        if let Some(message) = message.message.filter(|it| it.level == "error") {
            errors.extend(message.into_error());
        }
    }
    match program {
        Some(program) if status.success() => Ok(Built::Program(program)),
        _ if !errors.is_empty() => Ok(Built::Errors(errors)),
        _ => {
            let said: Vec<&str> = output.lines().filter(|line| !line.starts_with('{')).collect();
            bail!("the tests of {} cannot be compiled: {}", suite.package, said.join("\n"))
        }
    }
}

/// A line of cargo's output.
#[derive(Deserialize)]
struct Message {
    reason: String,
    message: Option<Diagnostic>,
    target: Option<Target>,
    executable: Option<PathBuf>,
}

#[derive(Deserialize)]
struct Target {
    test: bool,
}

#[derive(Deserialize)]
struct Diagnostic {
    level: String,
    message: String,
    spans: Vec<DiagnosticSpan>,
}

#[derive(Deserialize)]
struct DiagnosticSpan {
    file_name: String,
    line_start: usize,
    is_primary: bool,
    expansion: Option<Box<Expansion>>,
}

/// Where the macro was called in which the place is.
#[derive(Deserialize)]
struct Expansion {
    span: DiagnosticSpan,
}

impl Diagnostic {
    /// `None` for the closing words that count the errors.
    fn into_error(self) -> Option<CompilerError> {
        let mut places = Vec::new();
        for is_primary in [true, false] {
            for span in self.spans.iter().filter(|it| it.is_primary == is_primary) {
                let mut place = Some(span);
                while let Some(span) = place {
                    places.push((span.file_name.clone(), span.line_start));
                    place = span.expansion.as_ref().map(|it| &it.span);
                }
            }
        }
        (!places.is_empty()).then_some(CompilerError { text: self.message, places })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_points_at_its_place_and_at_the_call_of_its_macro() {
        let line = r#"{"reason":"compiler-message","message":{"level":"error","message":"no","spans":[
            {"file_name":"b.rs","line_start":2,"is_primary":false,"expansion":null},
            {"file_name":"m.rs","line_start":1,"is_primary":true,"expansion":
                {"span":{"file_name":"a.rs","line_start":7,"is_primary":false,"expansion":null}}}]}}"#;
        let message: Message = serde_json::from_str(line).unwrap();
        let error = message.message.unwrap().into_error().unwrap();
        let places = [("m.rs", 1), ("a.rs", 7), ("b.rs", 2)];
        assert_eq!(error.places, places.map(|(file, line)| (file.to_owned(), line)));
        let line = r#"{"reason":"compiler-message","message":
            {"level":"error","message":"aborting due to 1 previous error","spans":[]}}"#;
        let message: Message = serde_json::from_str(line).unwrap();
        assert!(message.message.unwrap().into_error().is_none());
    }
}
