//! The box's complete root file system, which the kernel unpacks into memory.
//!
//! | file | is |
//! |---|---|
//! | `/init` | `plumbline-board`, static: the first process |
//! | `/etc/plumbline/modules` | the kernel modules to load, in order |
//! | `/lib/modules/*.ko` | these modules |
//! | `/etc/plumbline/update-keys` | the public keys with which updates must be signed, if there are any |
//! | `/sbin/busybox` | for its DHCP client only |
//! | `/sbin/network-lease` | what that client tells an address to: `/init` again |
//!
//! The same inputs give the same bytes.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use flate2::{Compression, GzBuilder};
use plumbline_update::header::VerifyingKey;

use super::archive::{self, Archive};
use super::debian_root::DebianRoot;
use super::{modules, own_module};
use crate::command::Task;

/// Makes the initramfs with `program` as its first process, for a box that takes updates signed with
/// these keys.
pub fn make(debian: &DebianRoot, program: &Path, update_keys: &[VerifyingKey]) -> Result<Vec<u8>> {
    let mut root = Archive::default();
    root.program("init", stripped(program)?);
    // The boards' own modules first, because they include the watchdogs.
    let names = modules::listed(&["rpi4", "virt", "common"])?;
    let own = own_module::make(debian)?;
    let list = modules::add(&mut root, debian, Some(&own), &names, "lib/modules")?;
    root.file("etc/plumbline/modules", (list.join("\n") + "\n").into_bytes());
    if !update_keys.is_empty() {
        let keys = update_keys.iter().flat_map(|key| key.to_bytes());
        root.file("etc/plumbline/update-keys", keys.collect());
    }
    root.program("sbin/busybox", debian.read("usr/bin/busybox")?);
    root.link("sbin/network-lease", "/init");
    compressed(&root.to_bytes()?)
}

/// A program without its debugging symbols: a fifth of its size.
pub fn stripped(program: &Path) -> Result<Vec<u8>> {
    let path = program.with_extension("stripped");
    // Part of the package of the linker.
    Task::new("aarch64-linux-gnu-strip")
        .args(["-o".as_ref(), path.as_os_str()])
        .args([program])
        .output()?;
    fs::read(&path).with_context(|| path.display().to_string())
}

/// Of the formats known to the kernel, gzip unpacks fastest after lz4, which is twice as large.
pub fn compressed(archive: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
    encoder.write_all(archive)?;
    let mut bytes = encoder.finish()?;
    archive::pad(&mut bytes);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compression_is_reproducible_and_leaves_room_for_a_second_archive() {
        let archive = b"070701".repeat(1000);
        let bytes = compressed(&archive).unwrap();
        assert_eq!(bytes, compressed(&archive).unwrap());
        assert_eq!(bytes.len() % 4, 0);
        assert!(bytes.len() < archive.len() / 10);
    }
}
