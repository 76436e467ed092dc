//! Which kernel modules go into the initramfs, and the order in which they are loaded.
//!
//! They go there without the signatures that Debian has appended to them. Debian's kernel loads unsigned
//! modules too (the box's own is one), yet verifies each signature that it finds: in the emulator that
//! took more than half of the time between power and the last module. What comes over a link is signed
//! as a whole: package `plumbline-update`.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use super::archive::Archive;
use super::debian_root::DebianRoot;
use super::own_module;
use crate::command::{Task, root};

/// Puts the modules of these names, and those that they need, into the archive; returns where they
/// are in it, in the order of loading. `own` is the file of the box's own module, where it is one of
/// them.
///
/// The lists are files of names in `board/image/modules`; one initramfs serves all computers, so
/// that the one that was tested is the one that runs.
pub fn add(
    archive: &mut Archive,
    debian: &DebianRoot,
    own: Option<&Path>,
    names: &[String],
    directory: &str,
) -> Result<Vec<String>> {
    // It needs only what is built in.
    let own_line = own.map_or(String::new(), |_| format!("{}.ko:\n", own_module::NAME));
    let dependencies = own_line + &debian.module_dependencies()?;
    let kernel = debian.path().join("usr/lib/modules").join(debian.kernel_version()?);
    let mut list = Vec::new();
    for path in in_order(names, &dependencies)? {
        let name = format!("{directory}/{}.ko", module_name(&path));
        let own = own.filter(|_| module_name(&path) == own_module::NAME);
        let packed = own.map_or_else(|| kernel.join(&path), Path::to_owned);
        let module = match path.rsplit_once('.') {
            Some((_, "xz")) => {
                Task::new("xz").args(["--decompress", "--stdout"]).args([&packed]).output_bytes()?
            }
            _ => fs::read(&packed).with_context(|| packed.display().to_string())?,
        };
        archive.file(&name, without_signature(module));
        list.push(format!("/{name}"));
    }
    Ok(list)
}

/// The last words of a signed module. Linux, `include/linux/module_signature.h`: before them come twelve
/// bytes, the last four of which are the length of the signature before those.
const SIGNED: &[u8] = b"~Module signature appended~\n";

/// The module's file up to the signature, if there is one.
fn without_signature(mut module: Vec<u8>) -> Vec<u8> {
    let unsigned = || {
        let (before, length) = module.strip_suffix(SIGNED)?.split_last_chunk()?;
        before.len().checked_sub(8 + u32::from_be_bytes(*length) as usize)
    };
    module.truncate(unsigned().unwrap_or(module.len()));
    module
}

/// The names in lists of `board/image/modules`.
pub fn listed(lists: &[&str]) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for list in lists {
        let path = root().join("board/image/modules").join(list);
        let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default().trim());
        names.extend(lines.filter(|name| !name.is_empty()).map(str::to_owned));
    }
    Ok(names)
}

/// The files of the modules, each once, after all those that it needs.
///
/// `dependencies` has a line `file: needed needed ...` for each module: the file is followed by
/// those that it needs, directly or indirectly, with the first to be loaded last.
fn in_order(names: &[String], dependencies: &str) -> Result<Vec<String>> {
    let mut order: Vec<String> = Vec::new();
    for name in names {
        let line = dependencies
            .lines()
            .filter_map(|line| line.split_once(':'))
            .find(|(file, _)| module_name(file) == *name);
        let Some((file, needed)) = line else {
            bail!("board/image/modules: this kernel has no module {name}: correct the name");
        };
        for file in needed.split_whitespace().rev().chain([file]) {
            if !order.iter().any(|loaded| loaded == file) {
                order.push(file.to_owned());
            }
        }
    }
    ensure!(!order.is_empty(), "the lists of modules are empty");
    Ok(order)
}

/// `vfat` of `kernel/fs/fat/vfat.ko.xz`.
fn module_name(file: &str) -> &str {
    let name = file.rsplit('/').next().unwrap_or(file);
    name.split_once(".ko").map_or(name, |(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEPENDENCIES: &str = "\
kernel/fs/fat/vfat.ko.xz: kernel/fs/fat/fat.ko.xz
kernel/fs/fat/fat.ko.xz:
kernel/usb/uvc.ko: kernel/usb/v4l2.ko kernel/usb/core.ko kernel/usb/common.ko
kernel/usb/serial.ko: kernel/usb/core.ko kernel/usb/common.ko
# Aliases extracted from modules themselves.
";

    fn order(names: &[&str]) -> Result<Vec<String>> {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        let order = in_order(&names, DEPENDENCIES)?;
        Ok(order.iter().map(|file| module_name(file).to_owned()).collect())
    }

    #[test]
    fn what_is_needed_comes_first_and_once() {
        assert_eq!(order(&["vfat"]).unwrap(), ["fat", "vfat"]);
        let all = order(&["uvc", "serial", "uvc"]).unwrap();
        assert_eq!(all, ["common", "core", "v4l2", "uvc", "serial"]);
    }

    #[test]
    fn a_signature_is_taken_away_and_nothing_else() {
        let signed = |length: u32| {
            [b"module, signature", &[0; 8][..], &length.to_be_bytes(), SIGNED].concat()
        };
        assert_eq!(without_signature(signed(11)), b"module");
        // A length that is longer than the file is none.
        assert_eq!(without_signature(signed(18)), signed(18));
        assert_eq!(without_signature(b"module".to_vec()), b"module");
    }

    #[test]
    fn a_name_that_the_kernel_does_not_have_is_named() {
        let error = order(&["vfat", "no-such"]).unwrap_err().to_string();
        assert!(error.contains("no-such"), "{error}");
    }

    #[test]
    fn the_lists_of_this_checkout_name_each_module_once_per_list() {
        for list in ["common", "virt", "rpi4"] {
            let mut names = listed(&[list]).unwrap();
            let count = names.len();
            assert!(count > 3, "{list}");
            names.sort();
            names.dedup();
            assert_eq!(names.len(), count, "{list}");
        }
    }
}
