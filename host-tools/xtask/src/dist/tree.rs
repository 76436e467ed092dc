//! Files to be packed, and the archives of them. The same files give the same bytes: names are sorted,
//! nobody but root owns anything, and every file has the commit's date.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use anyhow::{Context, Result};
use flate2::{Compression, GzBuilder};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// Files by name; names do not start with a slash.
#[derive(Debug, Default, Clone)]
pub struct Tree {
    files: BTreeMap<String, File>,
}

#[derive(Debug, Clone)]
struct File {
    is_program: bool,
    bytes: Vec<u8>,
}

impl File {
    const fn mode(&self) -> u32 {
        if self.is_program { 0o755 } else { 0o644 }
    }
}

impl Tree {
    /// Adds a file.
    pub fn file(&mut self, name: impl Into<String>, bytes: impl Into<Vec<u8>>) {
        self.files.insert(name.into(), File { is_program: false, bytes: bytes.into() });
    }

    /// Adds a program.
    pub fn program(&mut self, name: impl Into<String>, bytes: impl Into<Vec<u8>>) {
        self.files.insert(name.into(), File { is_program: true, bytes: bytes.into() });
    }

    /// Adds a file that is on the disk.
    pub fn copy(&mut self, name: impl Into<String>, from: &Path) -> Result<()> {
        self.file(name, fs::read(from).with_context(|| from.display().to_string())?);
        Ok(())
    }

    /// Each file: its name, whether it is a program, its bytes.
    pub fn files(&self) -> impl Iterator<Item = (&str, bool, &[u8])> {
        self.files.iter().map(|(name, file)| (&name[..], file.is_program, &file.bytes[..]))
    }

    /// The size of all files together, in KiB.
    pub fn kib(&self) -> usize {
        self.files.values().map(|file| file.bytes.len().div_ceil(1024)).sum()
    }

    /// A tar archive, compressed by gzip; everything lies in the directory `top`.
    pub fn to_tar_gz(&self, top: &str, seconds: u64) -> Result<Vec<u8>> {
        let encoder = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
        let mut archive = tar::Builder::new(encoder);
        let header = |kind: tar::EntryType, mode: u32, size: u64| {
            let mut header = tar::Header::new_ustar();
            header.set_entry_type(kind);
            header.set_mode(mode);
            header.set_size(size);
            header.set_mtime(seconds);
            header.set_uid(0);
            header.set_gid(0);
            header
        };
        for name in self.directories(top) {
            let mut header = header(tar::EntryType::Directory, 0o755, 0);
            archive.append_data(&mut header, name, &[][..])?;
        }
        for (name, file) in &self.files {
            let mut header = header(tar::EntryType::Regular, file.mode(), file.bytes.len() as u64);
            archive.append_data(&mut header, format!("{top}/{name}"), &file.bytes[..])?;
        }
        Ok(archive.into_inner()?.finish()?)
    }

    /// A zip archive; everything lies in the directory `top`. Its dates are those of the format's
    /// first day, because the format has no time zone.
    pub fn to_zip(&self, top: &str) -> Result<Vec<u8>> {
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, file) in &self.files {
            let options = SimpleFileOptions::default()
                .compression_method(CompressionMethod::Deflated)
                .last_modified_time(DateTime::default())
                .unix_permissions(file.mode());
            archive.start_file(format!("{top}/{name}"), options)?;
            archive.write_all(&file.bytes)?;
        }
        Ok(archive.finish()?.into_inner())
    }

    /// Writes the files below a directory, which must not contain others.
    pub fn write_to(&self, directory: &Path) -> Result<()> {
        for (name, file) in &self.files {
            let path = directory.join(name);
            let failed = || path.display().to_string();
            fs::create_dir_all(path.parent().context("a name without a directory")?)
                .with_context(failed)?;
            fs::write(&path, &file.bytes).with_context(failed)?;
            fs::set_permissions(&path, fs::Permissions::from_mode(file.mode()))
                .with_context(failed)?;
        }
        Ok(())
    }

    /// `top`, and every directory below it that has something in it, sorted.
    fn directories(&self, top: &str) -> Vec<String> {
        let within = self.files.keys().flat_map(|name| {
            name.match_indices('/').map(|(end, _)| format!("{top}/{}", &name[..end]))
        });
        let mut all: Vec<String> = within.chain([top.to_owned()]).collect();
        all.sort_unstable();
        all.dedup();
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(reversed: bool) -> Tree {
        let mut tree = Tree::default();
        let mut steps: [&dyn Fn(&mut Tree); 3] = [
            &|tree| tree.program("bin/plumb", "run"),
            &|tree| tree.file("share/man/man1/plumb.1", "page"),
            &|tree| tree.file("README", "words"),
        ];
        if reversed {
            steps.reverse();
        }
        steps.iter().for_each(|step| step(&mut tree));
        tree
    }

    #[test]
    fn the_same_files_give_the_same_archives() {
        let [one, other] = [false, true].map(sample);
        assert_eq!(one.to_tar_gz("p-1", 7).unwrap(), other.to_tar_gz("p-1", 7).unwrap());
        assert_eq!(one.to_zip("p-1").unwrap(), other.to_zip("p-1").unwrap());
        assert_ne!(one.to_tar_gz("p-1", 7).unwrap(), one.to_tar_gz("p-1", 8).unwrap());
    }

    #[test]
    fn a_tar_has_its_directories_first_and_nobody_s_name() {
        let bytes = sample(false).to_tar_gz("p-1", 1_700_000_000).unwrap();
        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(&bytes[..]));
        let mut found = Vec::new();
        for entry in archive.entries().unwrap() {
            let entry = entry.unwrap();
            let header = entry.header();
            assert_eq!((header.uid().unwrap(), header.gid().unwrap()), (0, 0));
            assert_eq!(header.mtime().unwrap(), 1_700_000_000);
            assert_eq!(header.username().unwrap(), Some(""));
            found.push((entry.path().unwrap().display().to_string(), header.mode().unwrap()));
        }
        let expected = [
            ("p-1", 0o755),
            ("p-1/bin", 0o755),
            ("p-1/share", 0o755),
            ("p-1/share/man", 0o755),
            ("p-1/share/man/man1", 0o755),
            ("p-1/README", 0o644),
            ("p-1/bin/plumb", 0o755),
            ("p-1/share/man/man1/plumb.1", 0o644),
        ];
        assert_eq!(found, expected.map(|(name, mode)| (name.to_owned(), mode)));
    }

    #[test]
    fn a_zip_has_every_file_with_its_mode() {
        let bytes = sample(false).to_zip("p-1").unwrap();
        let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
        let found: Vec<_> = (0..archive.len())
            .map(|index| {
                let file = archive.by_index(index).unwrap();
                (file.name().unwrap().into_owned(), file.unix_mode().unwrap() & 0o777)
            })
            .collect();
        let expected = [
            ("p-1/README", 0o644),
            ("p-1/bin/plumb", 0o755),
            ("p-1/share/man/man1/plumb.1", 0o644),
        ];
        assert_eq!(found, expected.map(|(name, mode)| (name.to_owned(), mode)));
    }
}
