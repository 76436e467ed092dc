//! SHA-256 sums, as `sha256sum --check` reads them.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use sha2::{Digest as _, Sha256};

/// The name of the file of sums.
pub const NAME: &str = "SHA256SUMS";

/// The sum of these bytes, in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes the sums of all other files in a directory, sorted by name.
pub fn write(directory: &Path) -> Result<()> {
    let sums = of(directory)?;
    let text: String = sums.iter().map(|(name, sum)| format!("{sum}  {name}\n")).collect();
    let path = directory.join(NAME);
    fs::write(&path, text).with_context(|| path.display().to_string())
}

/// The name and the sum of each file in a directory, except the file of sums, sorted by name.
pub fn of(directory: &Path) -> Result<Vec<(String, String)>> {
    let failed = || directory.display().to_string();
    let mut sums = Vec::new();
    for entry in fs::read_dir(directory).with_context(failed)? {
        let entry = entry.with_context(failed)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.file_type()?.is_file() && name != NAME {
            let bytes =
                fs::read(entry.path()).with_context(|| entry.path().display().to_string())?;
            sums.push((name, sha256(&bytes)));
        }
    }
    sums.sort_unstable();
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn sha256sum_agrees() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["plumb.tar.gz", "a.whl"] {
            fs::write(folder.path().join(name), name).unwrap();
        }
        fs::create_dir(folder.path().join("elsewhere")).unwrap();
        write(folder.path()).unwrap();
        let check = |name: &str| {
            let arguments = ["--check", "--strict", name];
            Command::new("sha256sum").args(arguments).current_dir(&folder).output().unwrap()
        };
        let said = String::from_utf8(check(NAME).stdout).unwrap();
        assert_eq!(said, "a.whl: OK\nplumb.tar.gz: OK\n");
        fs::write(folder.path().join("a.whl"), "changed").unwrap();
        assert!(!check(NAME).status.success());
    }
}
