//! The version of Rust that the project is tested and released with.
//!
//! It is not a `rust-toolchain.toml`: rustup would then refuse to start any other compiler, and where it
//! cannot download this one, nobody could build anything. Instead, the tasks whose result depends on the
//! compiler start again with this version if rustup has it or can fetch it; and say so, if they must do
//! with another.

use std::env;
use std::os::unix::process::CommandExt as _;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result};

use crate::command::{LOCKED, Task, root};

/// The version.
pub const PINNED: &str = "1.95.0";

/// The time limit for rustup's download: on some networks it hangs.
const INSTALLED_WITHIN: Duration = Duration::from_secs(300);

/// The variable that keeps a task from starting itself again and again.
const SETTLED: &str = "PLUMBLINE_TOOLCHAIN_SETTLED";

/// Starts this program again with the pinned version, which then takes its place; returns if it is that
/// version already, or cannot be had.
pub fn settle() -> Result<()> {
    if is_pinned() || env::var_os(SETTLED).is_some() {
        return Ok(());
    }
    let name = format!("{PINNED}-{}-unknown-linux-gnu", env::consts::ARCH);
    let list = Task::new("rustup").args(["toolchain", "list"]).output();
    // Without rustup there is only one Rust.
    let Ok(list) = list else { return Ok(()) };
    if !has(&list, &name) {
        println!("The project is built with Rust {PINNED}, which rustup does not have yet");
        let install = ["toolchain", "install", PINNED, "--profile", "minimal"];
        let components = ["--component", "clippy", "--component", "rustfmt"];
        let install = Task::new("rustup").args(install).args(components);
        if let Err(error) = install.run_within(INSTALLED_WITHIN) {
            println!("{error:#}");
            return Ok(());
        }
    }
    println!("Starting again with Rust {PINNED}");
    let error = Command::new("rustup")
        .args(["run", PINNED, "cargo", "run", "--quiet", LOCKED, "--bin", "xtask", "--"])
        .args(env::args_os().skip(1))
        .current_dir(root())
        .env(SETTLED, "1")
        .exec();
    Err(error).context("rustup cannot be started")
}

/// What to tell the user if it is not the pinned version.
pub fn notice() -> Option<String> {
    (!is_pinned()).then(|| {
        format!(
            "This is {}, and not {PINNED}, with which the project is tested and released: `rustup \
             toolchain install {PINNED}` installs that, and the next run uses it.",
            version().unwrap_or_else(|error| format!("an unknown Rust ({error:#})"))
        )
    })
}

/// Whether the compiler that cargo takes is of this version.
pub fn is_pinned() -> bool {
    version().is_ok_and(|version| version.split(' ').nth(1) == Some(PINNED))
}

/// What the compiler says: `rustc 1.95.0 (59807616e 2026-04-14)`.
fn version() -> Result<String> {
    let compiler = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    Ok(Task::new(compiler).args(["--version"]).output()?.trim().to_owned())
}

/// Whether rustup's list has a toolchain of this name: `name (active, default)`.
fn has(list: &str, name: &str) -> bool {
    list.lines().any(|line| line.split(' ').next() == Some(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rustups_list_is_read() {
        let list =
            "stable-x86_64-unknown-linux-gnu (active, default)\n1.95.0-x86_64-unknown-linux-gnu\n";
        assert!(has(list, "1.95.0-x86_64-unknown-linux-gnu"));
        assert!(has(list, "stable-x86_64-unknown-linux-gnu"));
        assert!(!has(list, "1.95.0") && !has("", "stable"));
    }

    #[test]
    fn the_stack_in_memory_md_was_measured_with_the_pinned_version() {
        let document = std::fs::read_to_string(root().join("memory.md")).unwrap();
        let here = document.lines().find(|line| line.starts_with("x86-64, rustc ")).unwrap();
        assert_eq!(here, format!("x86-64, rustc {PINNED}:"));
    }
}
