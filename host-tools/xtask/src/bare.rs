//! Links the core into a final artefact that has no allocator.
//!
//! A `no_std` library that uses `alloc` still compiles; only linking a final artefact shows that
//! nothing allocates. The package `tests/bare` is that artefact: a shared library that contains
//! only the core, a panic handler and one entry point, which configures the pipeline and steps it.
//! The compiler refuses to build it if any crate in it uses `alloc`. Its list of undefined symbols
//! then shows everything it needs from elsewhere: the memory routines that the compiler itself
//! calls, and no `malloc`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use crate::command::{Task, target_directory};

/// The entry point of the artefact.
const ENTRY: &str = "plumbline_bare_step";

/// Functions that compiled Rust may call implicitly: the target always has them, and none of them
/// allocates.
const COMPILERS_OWN: &[&str] = &["memcpy", "memmove", "memset", "memcmp", "bcmp"];

/// The largest initialised data allowed in the artefact. An idle pipeline is all zero, so its
/// quarter of a megabyte takes no space in a program's file or a board's flash.
const DATA_BYTES_MAX: usize = 4096;

/// The target directory of all that is built without an operating system or an allocator. Separate
/// from the other builds, so that their choice of features does not affect it.
pub fn directory() -> PathBuf {
    target_directory().join("bare")
}

/// Builds the artefact; returns its path.
pub fn build() -> Result<PathBuf> {
    let directory = directory();
    Task::cargo()
        .args(["rustc", "--package", "plumbline-bare", "--profile", "bare"])
        .args(["--crate-type", "cdylib", "--target-dir"])
        .args([&directory])
        .args(["--", "-C", "link-arg=-nostartfiles"])
        .run()?;
    Ok(directory.join("bare/libplumbline_bare.so"))
}

/// Builds the artefact and checks its symbols and the size of its data.
pub fn check() -> Result<()> {
    let artefact = build()?;
    let defined = symbols(&artefact, "--defined-only")?;
    ensure!(defined.contains(ENTRY), "{} does not define {ENTRY}", artefact.display());
    let undefined = symbols(&artefact, "--undefined-only")?;
    let foreign: Vec<&str> = undefined
        .iter()
        .map(String::as_str)
        .filter(|symbol| !COMPILERS_OWN.contains(symbol))
        .collect();
    if !foreign.is_empty() {
        bail!("the core without an allocator needs {} from elsewhere", foreign.join(", "));
    }
    let data_bytes = data_bytes(&artefact)?;
    ensure!(
        data_bytes <= DATA_BYTES_MAX,
        "{} holds {data_bytes} bytes of initialised data: an idle pipeline is no longer all zero",
        artefact.display()
    );
    println!(
        "{}: linked without an allocator, {data_bytes} bytes of data; from elsewhere it needs only {}",
        artefact.display(),
        undefined.into_iter().collect::<Vec<_>>().join(" ")
    );
    Ok(())
}

/// The size of the artefact's initialised data: the second number of `size`'s second line.
fn data_bytes(artefact: &Path) -> Result<usize> {
    let listing = Task::new("size").args(["--format=berkeley"]).args([artefact]).output()?;
    let data = listing.lines().nth(1).and_then(|line| line.split_whitespace().nth(1));
    data.and_then(|data| data.parse().ok())
        .with_context(|| format!("`size` does not report the size of the data: {listing}"))
}

/// The names in the artefact's dynamic symbol table, as selected by `which`.
fn symbols(artefact: &Path, which: &str) -> Result<BTreeSet<String>> {
    let listing = Task::new("nm")
        .args(["--dynamic", "--format=just-symbols", which])
        .args([artefact])
        .output()?;
    // A symbol may carry its version: memcpy@GLIBC_2.14.
    let name = |line: &str| line.split('@').next().unwrap_or_default().to_owned();
    Ok(listing.lines().map(name).collect())
}
