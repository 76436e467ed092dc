//! The real `plumb`, for tests that use it as a person would.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use plumbline_test_support::{command, program};

use crate::keys::data;

/// The program, built once per test process, wherever cargo puts it.
pub fn plumb() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    let built = PROGRAM.get_or_init(|| program("plumb").expect("plumb builds"));
    let mut command = command(built);
    // An error is one line, whatever the environment asks for.
    command.env("RUST_BACKTRACE", "1");
    command
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
    let (code, said) = plumb_judges_in(directory, arguments);
    assert_eq!(code, Some(0), "plumb {arguments}: {said}");
    said
}

/// The same for a command whose exit code is a verdict: its exit code, and what it says.
pub fn plumb_judges_in(directory: &Path, arguments: &str) -> (Option<i32>, String) {
    let output = plumb()
        .args(arguments.split_whitespace())
        .current_dir(directory)
        .env("XDG_DATA_HOME", data(directory))
        .output()
        .expect("plumb runs");
    let said = messages(&output) + &String::from_utf8_lossy(&output.stdout);
    println!("$ plumb {arguments}\n{said}");
    (output.status.code(), said)
}
