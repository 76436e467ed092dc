//! Kernel modules, loaded in the order of a list.
//!
//! The list is a text file with the absolute path of one module per line, each after
//! those that it needs; `#` begins a comment. One list serves every computer that
//! the image boots on, so a driver that finds no hardware is nothing unusual.

use std::fs::File;
use std::path::Path;

use nix::errno::Errno;
use nix::kmod::{ModuleInitFlags, finit_module};

/// How many modules were loaded, and how many were not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Modules {
    loaded: usize,
    failed: usize,
}

impl std::fmt::Display for Modules {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} kernel modules loaded, {} not", self.loaded, self.failed)
    }
}

/// Loads every module of the list that the kernel accepts.
pub fn load_all(list: &Path) -> Modules {
    let mut modules = Modules::default();
    let text = match std::fs::read_to_string(list) {
        Ok(text) => text,
        Err(error) => {
            log::warn!("no kernel modules are loaded: {}: {error}", list.display());
            return modules;
        }
    };
    for path in paths(&text) {
        match load(path) {
            Ok(()) => modules.loaded += 1,
            Err(error) => {
                log::debug!("{path}: not loaded: {error}");
                modules.failed += 1;
            }
        }
    }
    modules
}

fn paths(list: &str) -> impl Iterator<Item = &str> {
    list.lines()
        .map(|line| line.split_once('#').map_or(line, |(before, _)| before).trim())
        .filter(|path| !path.is_empty())
}

fn load(path: &str) -> std::io::Result<()> {
    match finit_module(File::open(path)?, c"", ModuleInitFlags::empty()) {
        Ok(()) | Err(Errno::EEXIST) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_and_empty_lines_are_skipped() {
        let list =
            "# what a box needs\n/lib/fat.ko\n\n  /lib/vfat.ko # after fat\r\n\t\n#/lib/x.ko";
        assert_eq!(paths(list).collect::<Vec<_>>(), ["/lib/fat.ko", "/lib/vfat.ko"]);
    }

    #[test]
    fn missing_modules_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("modules");
        std::fs::write(&list, "/nowhere/a.ko\n/nowhere/b.ko\n").unwrap();
        assert_eq!(load_all(&list), Modules { loaded: 0, failed: 2 });
        assert_eq!(load_all(&folder.path().join("absent")), Modules::default());
    }
}
