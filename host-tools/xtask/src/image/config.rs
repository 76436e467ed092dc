//! Keeps a configuration that a box would refuse out of images.
//!
//! It is checked by the box's own program, built for this machine: like the one in the images, it
//! has no libcamera.

use std::fs;
use std::path::{self, Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::command::{BadInput, Task, target_directory};
use crate::setup;

/// The path of the configuration, after it has been found valid.
pub fn checked(config: &Path) -> Result<PathBuf> {
    let name = config.display();
    // Checked first because it is quick, whereas building the program takes some minutes.
    if let Err(error) = fs::read(config) {
        bail!(BadInput(format!(
            "--config: {name} cannot be read: {error}; give the file that `plumb provision` wrote"
        )));
    }
    setup::ensure(&[setup::LINKER, setup::VIDEO])?;
    Task::cargo().args(["build", "--release", "--package", "plumbline-board"]).run()?;
    judged(&target_directory().join("release/plumbline-board"), config)?;
    path::absolute(config).context("--config")
}

fn judged(program: &Path, config: &Path) -> Result<()> {
    let output = Command::new(program)
        .args(["--check", "--config"])
        .arg(config)
        .output()
        .with_context(|| format!("cannot start {}", program.display()))?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let said = said.trim().trim_start_matches("plumbline-board: ");
    bail!(BadInput(format!("--config: {said}; nothing was made")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_readable_file_is_refused_before_anything_is_built() {
        let directory = tempfile::tempdir().unwrap();
        for path in [directory.path().join("absent.plb"), directory.path().to_owned()] {
            let error = checked(&path).unwrap_err();
            assert!(error.is::<BadInput>());
            let (error, name) = (error.to_string(), path.display().to_string());
            assert!(error.contains(&name) && error.contains("plumb provision"), "{error}");
        }
    }

    #[test]
    fn a_refusal_of_the_box_s_program_is_passed_on() {
        use std::os::unix::fs::PermissionsExt as _;
        let directory = tempfile::tempdir().unwrap();
        let program = directory.path().join("program");
        let script = "#!/bin/sh\n[ \"$*\" = \"--check --config box.plb\" ] && exit\n\
                      echo \"plumbline-board: $3: no camera\" >&2; exit 2\n";
        fs::write(&program, script).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        judged(&program, Path::new("box.plb")).unwrap();
        let error = judged(&program, Path::new("other.plb")).unwrap_err();
        assert!(error.is::<BadInput>());
        assert_eq!(error.to_string(), "--config: other.plb: no camera; nothing was made");
    }
}
