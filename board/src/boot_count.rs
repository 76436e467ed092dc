//! How often the program has started, kept in a small text file.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Context, Result};

/// Counts this start in `path` and returns its number; the first is 1.
///
/// # Errors
/// When the file does not hold a number, or cannot be written.
pub fn count_start(path: &Path) -> Result<u32> {
    let name = path.display();
    let before: u32 = match std::fs::read_to_string(path) {
        Ok(text) => text.trim().parse().with_context(|| {
            format!("the boot count file {name} does not hold a number: delete it to start from 1")
        })?,
        Err(error) if error.kind() == ErrorKind::NotFound => 0,
        Err(error) => {
            return Err(error)
                .with_context(|| format!("the boot count file {name} cannot be read"));
        }
    };
    let count = before.wrapping_add(1);
    // A power cut must not leave half a number: write a second file, then rename it.
    let fresh = path.with_extension("new");
    std::fs::write(&fresh, format!("{count}\n"))
        .and_then(|()| std::fs::rename(&fresh, path))
        .with_context(|| format!("the boot count file {name} cannot be written"))?;
    Ok(count)
}
