//! Keeps a configuration or a key that a box would refuse out of images.
//!
//! They are checked by the box's own program, built for this machine: like the one in the images, it
//! has no libcamera.

use std::fs;
use std::path::{self, Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use super::fat::Fat;
use super::{CONFIG_NAME, KEY_NAME};
use crate::command::{BadInput, Task, target_directory};
use crate::setup;

/// What a box is given on its settings partition: absolute paths.
#[derive(Debug, Default, PartialEq)]
pub struct Provided {
    /// Its configuration.
    config: Option<PathBuf>,
    /// Its key.
    key: Option<PathBuf>,
}

impl Provided {
    /// The configuration and the key that was named, or else the one beside the configuration, after
    /// they have been found valid.
    pub fn checked(config: &Path, key: Option<&Path>) -> Result<Self> {
        // Checked first because it is quick, whereas building the program takes some minutes.
        let provided = Self::readable(config, key)?;
        setup::ensure(&[setup::LINKER, setup::VIDEO])?;
        Task::cargo().args(["build", "--release", "--package", "plumbline-board"]).run()?;
        judged(&target_directory().join("release/plumbline-board"), config, key)?;
        Ok(provided)
    }

    fn readable(config: &Path, key: Option<&Path>) -> Result<Self> {
        read(config, "--config", "give the file that `plumb provision` wrote")?;
        let beside = config.with_file_name(KEY_NAME);
        let key = key.or_else(|| beside.exists().then_some(&beside));
        if let Some(key) = key {
            let remedy = "give the file that `plumb provision --new-key` or `plumb keys export --out` \
                          wrote";
            read(key, "--key", remedy)?;
        }
        Ok(Self {
            config: Some(path::absolute(config).context("--config")?),
            key: key.map(path::absolute).transpose().context("--key")?,
        })
    }

    /// Copies them onto the settings partition.
    pub fn copy(&self, fat: &Fat<'_>) -> Result<()> {
        for (file, name) in [(&self.config, CONFIG_NAME), (&self.key, KEY_NAME)] {
            if let Some(file) = file {
                fat.copy(file, name)?;
            }
        }
        Ok(())
    }

    /// Says what is lacking, and how it gets onto the settings partition of `image`.
    pub fn say_what_is_lacking(&self, image: &Path) {
        let lacking = match self {
            Self { config: None, .. } => "configuration and no key",
            Self { key: None, .. } => "key",
            _ => return,
        };
        println!(
            "It has no {lacking} yet, and will say so. What is lacking is put in with\n    \
             plumb provision ... --new-key --card {}",
            image.display()
        );
    }
}

fn read(file: &Path, option: &str, remedy: &str) -> Result<()> {
    if let Err(error) = fs::read(file) {
        let name = file.display();
        bail!(BadInput(format!("{option}: {name} cannot be read: {error}; {remedy}")));
    }
    Ok(())
}

fn judged(program: &Path, config: &Path, key: Option<&Path>) -> Result<()> {
    let mut command = Command::new(program);
    command.args(["--check", "--config"]).arg(config);
    if let Some(key) = key {
        command.arg("--key").arg(key);
    }
    let output = command.output().with_context(|| format!("cannot start {}", program.display()))?;
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
            let error = Provided::checked(&path, None).unwrap_err();
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
        judged(&program, Path::new("box.plb"), None).unwrap();
        let error = judged(&program, Path::new("other.plb"), None).unwrap_err();
        assert!(error.is::<BadInput>());
        assert_eq!(error.to_string(), "--config: other.plb: no camera; nothing was made");
    }

    #[test]
    fn the_key_is_the_one_that_is_named_or_the_one_beside_the_configuration() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        let [config, beside, other] = ["box.plb", KEY_NAME, "other.key"].map(path);
        fs::write(&config, "").unwrap();
        let key = |named: Option<&PathBuf>| {
            Provided::readable(&config, named.map(PathBuf::as_path)).map(|it| it.key)
        };
        assert_eq!(key(None).unwrap(), None);
        let error = key(Some(&other)).unwrap_err();
        assert!(error.is::<BadInput>() && error.to_string().contains("other.key"), "{error}");
        fs::write(&beside, "").unwrap();
        assert_eq!(key(None).unwrap(), Some(beside));
        fs::write(&other, "").unwrap();
        assert_eq!(key(Some(&other)).unwrap(), Some(other));
    }
}
