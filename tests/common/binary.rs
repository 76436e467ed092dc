//! The real `plumb`, for tests that use it as a person would.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

use crate::runner;

/// The program, built once per test process, wherever cargo puts it.
pub fn plumb() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    let mut command = runner::command(PROGRAM.get_or_init(build));
    // An error is one line, whatever the environment asks for.
    command.env("RUST_BACKTRACE", "1");
    command
}

// Cargo is the machine's own, and finds the processor to build for in the environment.
fn build() -> PathBuf {
    let output = Command::new(env!("CARGO"))
        .args(["build", "--package", "plumb", "--bin", "plumb"])
        .arg("--message-format=json-render-diagnostics")
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stderr(Stdio::inherit())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "plumb does not build");
    let messages = String::from_utf8(output.stdout).expect("cargo writes JSON");
    let path = messages
        .lines()
        .filter_map(|line| line.split_once("\"executable\":\""))
        .filter_map(|(_, rest)| rest.split('"').next())
        .next_back()
        .expect("cargo names the program");
    PathBuf::from(path)
}

/// Standard error as text, after checking that nobody panicked.
pub fn messages(output: &Output) -> String {
    let text = String::from_utf8(output.stderr.clone()).expect("messages are UTF-8");
    assert!(!text.contains("panicked") && !text.contains("stack backtrace"), "{text}");
    text
}

/// Runs it in a directory with these words, and expects it to succeed; what it says.
#[track_caller]
pub fn plumb_in(directory: &Path, arguments: &str) -> String {
    let output = plumb()
        .args(arguments.split_whitespace())
        .current_dir(directory)
        .output()
        .expect("plumb runs");
    let said = messages(&output) + &String::from_utf8_lossy(&output.stdout);
    println!("$ plumb {arguments}\n{said}");
    assert_eq!(output.status.code(), Some(0), "plumb {arguments}: {said}");
    said
}

/// Real photographs, or `None` (said on standard error) where they are absent.
pub fn data(folder: &str) -> Option<PathBuf> {
    let data = std::env::var("PLUMBLINE_DATA").unwrap_or_else(|_| "../shared/data".to_owned());
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(data).join(folder);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: there is no {}; set PLUMBLINE_DATA", path.display());
    None
}
