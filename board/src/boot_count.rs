//! How often the box has started, kept in a small text file of its own: a [`StoredFile`], so that no
//! power cut makes a count come twice.

use std::path::Path;

use anyhow::{Context, Result};

use crate::machine::read_only_partition::ReadOnlyPartition;
use crate::stored_file::{Kind, StoredFile, is_absent};

/// The count's name on the card.
const FILE_NAME: &str = "starts.txt";

static COUNT: Kind =
    Kind { bytes_max: 32, mode: 0o666, is_whole: |bytes| count_of(bytes).is_some() };

/// Counts this start in `path` and returns its number; the first is 1.
///
/// # Errors
/// When the file does not hold a number, or cannot be written.
pub fn count_start(path: &Path) -> Result<u32> {
    count(&StoredFile::file(&COUNT, path))
}

/// The same on a box's card.
///
/// # Errors
/// As for [`count_start`].
pub fn count_start_on(partition: &ReadOnlyPartition) -> Result<u32> {
    count(&StoredFile::on_partition(&COUNT, partition, FILE_NAME))
}

fn count(file: &StoredFile) -> Result<u32> {
    let name = file.path().display();
    let before = match file.read() {
        Ok(bytes) => count_of(&bytes).with_context(|| {
            format!("the boot count file {name} does not hold a number: delete it to start from 1")
        })?,
        Err(error) if is_absent(&error) => 0,
        Err(error) => {
            return Err(error)
                .with_context(|| format!("the boot count file {name} cannot be read"));
        }
    };
    let count = before.wrapping_add(1);
    file.store(format!("{count}\n").as_bytes())
        .with_context(|| format!("the boot count file {name} cannot be written"))?;
    Ok(count)
}

fn count_of(bytes: &[u8]) -> Option<u32> {
    std::str::from_utf8(bytes).ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_counted_and_a_cut_repeats_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("starts.txt");
        for start in 1..=11 {
            assert_eq!(count_start(&path).unwrap(), start);
        }
        assert_eq!(std::fs::read(&path).unwrap(), b"11\n");
        // The power failed while 12 was written over 11 on a card.
        std::fs::write(folder.path().join("starts.new"), "12\n").unwrap();
        std::fs::write(&path, [0xff, 0xff, b'\n']).unwrap();
        assert_eq!(count_start(&path).unwrap(), 13);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        std::fs::write(&path, "many").unwrap();
        let error = format!("{:#}", count_start(&path).unwrap_err());
        assert!(error.contains("starts.txt") && error.contains("delete it"), "{error}");
    }
}
