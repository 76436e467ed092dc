//! An archive that the kernel unpacks into the initial root file system: cpio, format `newc`.
//!
//! The same entries give the same bytes, whatever the order in which they are added: they are
//! sorted by name, owned by root and dated 1970.

use std::collections::BTreeMap;
use std::io::Write as _;

use anyhow::{Context, Result};
use cpio::newc::{Builder, ModeFileType, trailer};

/// Files, directories and links by name; names do not start with a slash.
#[derive(Debug, Default)]
pub struct Archive {
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug)]
enum Entry {
    Directory,
    File { executable: bool, bytes: Vec<u8> },
    Link { target: String },
}

impl Archive {
    /// Adds a file.
    pub fn file(&mut self, name: &str, bytes: Vec<u8>) {
        self.add(name, Entry::File { executable: false, bytes });
    }

    /// Adds a program.
    pub fn program(&mut self, name: &str, bytes: Vec<u8>) {
        self.add(name, Entry::File { executable: true, bytes });
    }

    /// Adds a symbolic link.
    pub fn link(&mut self, name: &str, target: &str) {
        self.add(name, Entry::Link { target: target.into() });
    }

    /// Adds an entry and the directories above it.
    fn add(&mut self, name: &str, entry: Entry) {
        for (end, _) in name.match_indices('/') {
            self.entries.entry(name[..end].into()).or_insert(Entry::Directory);
        }
        self.entries.insert(name.into(), entry);
    }

    /// The bytes of the archive, padded to a multiple of 4 so that another may follow.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        for (number, (name, entry)) in (1..).zip(&self.entries) {
            let (kind, permissions, content) = match entry {
                Entry::Directory => (ModeFileType::Directory, 0o755, &[][..]),
                Entry::File { executable: false, bytes } => {
                    (ModeFileType::Regular, 0o644, &bytes[..])
                }
                Entry::File { executable: true, bytes } => {
                    (ModeFileType::Regular, 0o755, &bytes[..])
                }
                Entry::Link { target } => (ModeFileType::Symlink, 0o777, target.as_bytes()),
            };
            let size = u32::try_from(content.len()).context("a file beyond 4 GiB")?;
            let header = Builder::new(name).ino(number).mode(permissions).set_mode_file_type(kind);
            let mut writer = header.write(&mut bytes, size);
            writer.write_all(content)?;
            writer.finish()?;
        }
        trailer(&mut bytes)?;
        pad(&mut bytes);
        Ok(bytes)
    }
}

/// Appends zeros up to a multiple of 4, where the kernel looks for the next archive.
pub fn pad(bytes: &mut Vec<u8>) {
    bytes.resize(bytes.len().next_multiple_of(4), 0);
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;

    fn sample(reversed: bool) -> Vec<u8> {
        let mut archive = Archive::default();
        let mut steps: [&dyn Fn(&mut Archive); 3] = [
            &|archive| archive.program("init", b"run".to_vec()),
            &|archive| archive.link("sbin/lease", "/init"),
            &|archive| archive.file("lib/modules/a.ko", b"12345".to_vec()),
        ];
        if reversed {
            steps.reverse();
        }
        steps.iter().for_each(|step| step(&mut archive));
        archive.to_bytes().unwrap()
    }

    #[test]
    fn the_same_entries_give_the_same_bytes() {
        assert_eq!(sample(false), sample(true));
    }

    #[test]
    fn directories_come_before_what_is_in_them_and_nobody_but_root_owns_anything() {
        let bytes = sample(false);
        assert_eq!(bytes.len() % 4, 0);
        let (mut rest, mut found) = (&bytes[..], Vec::new());
        loop {
            let mut reader = cpio::NewcReader::new(rest).unwrap();
            let entry = reader.entry().clone();
            if entry.is_trailer() {
                break;
            }
            assert_eq!((entry.uid(), entry.gid(), entry.mtime()), (0, 0, 0));
            let mut content = String::new();
            reader.read_to_string(&mut content).unwrap();
            found.push((entry.name().to_owned(), entry.mode(), content));
            rest = reader.finish().unwrap();
        }
        let expected = [
            ("init", 0o100_755, "run"),
            ("lib", 0o040_755, ""),
            ("lib/modules", 0o040_755, ""),
            ("lib/modules/a.ko", 0o100_644, "12345"),
            ("sbin", 0o040_755, ""),
            ("sbin/lease", 0o120_777, "/init"),
        ];
        let expected = expected.map(|(name, mode, content)| (name.into(), mode, content.into()));
        assert_eq!(found, expected);
    }
}
