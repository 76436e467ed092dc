//! Debian's programs, unpacked into the target directory.
//!
//! Used for programs that apt could only install by removing other packages, such as an emulator
//! alongside newer tools of its family. The missing packages are downloaded and unpacked, and a
//! script for each program starts it with their libraries. The system is not changed, and `cargo
//! clean` removes everything.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use anyhow::{Context, Result, bail};

use crate::command::{Task, quoted, unpacked, unpacked_programs};

/// Unpacks `packages`, and those of their dependencies that the machine lacks, so that `programs`
/// can be run.
pub fn unpack(
    as_root: impl Fn(&str, &[&str]) -> Task,
    packages: &[&str],
    programs: &[&str],
) -> Result<()> {
    let (archives, root) = (unpacked().join("archives"), unpacked().join("root"));
    for directory in [&archives, &root, &unpacked_programs()] {
        fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    let option = format!("Dir::Cache::archives={}", archives.display());
    as_root("apt-get", &["install", "--download-only", "--yes", "--no-install-recommends"])
        .args(["-o", &option])
        .args(packages)
        .run()?;
    for entry in fs::read_dir(&archives).with_context(|| archives.display().to_string())? {
        let archive = entry?.path();
        if archive.extension().is_some_and(|extension| extension == "deb") {
            Task::new("dpkg-deb").args([Path::new("-x"), &archive, &root]).run()?;
        }
    }
    let libraries = library_directories(&root)?;
    for name in programs {
        let found = ["usr/bin", "bin"].iter().map(|place| root.join(place).join(name));
        let Some(program) = found.into_iter().find(|path| path.is_file()) else {
            bail!("{name} is not in {}", packages.join(", "))
        };
        let script = format!(
            "#!/bin/sh\nLD_LIBRARY_PATH={} exec {} \"$@\"\n",
            quoted(libraries.as_ref()),
            quoted(program.as_ref())
        );
        let path = unpacked_programs().join(name);
        fs::write(&path, script).with_context(|| path.display().to_string())?;
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755))?;
    }
    Ok(())
}

/// The directories of the unpacked libraries, each named after an architecture, as a list for the
/// dynamic linker.
fn library_directories(root: &Path) -> Result<String> {
    let mut places = Vec::new();
    for directory in ["usr/lib", "lib"].map(|name| root.join(name)) {
        for entry in fs::read_dir(&directory).into_iter().flatten() {
            let path = entry?.path();
            if path.is_dir() && path.to_string_lossy().contains("-linux-gnu") {
                places.push(path.to_string_lossy().into_owned());
            }
        }
    }
    Ok(places.join(":"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_directories_of_architectures_hold_libraries() {
        let root = tempfile::tempdir().unwrap();
        for name in ["usr/lib/x86_64-linux-gnu", "usr/lib/qemu", "lib/x86_64-linux-gnu"] {
            fs::create_dir_all(root.path().join(name)).unwrap();
        }
        let at = |name: &str| root.path().join(name).display().to_string();
        let wanted = format!("{}:{}", at("usr/lib/x86_64-linux-gnu"), at("lib/x86_64-linux-gnu"));
        assert_eq!(library_directories(root.path()).unwrap(), wanted);
        assert_eq!(library_directories(Path::new("/no/such/root")).unwrap(), "");
    }
}
