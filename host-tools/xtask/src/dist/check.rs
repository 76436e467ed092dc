//! Whether a second build in another directory gives the same bytes.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};

use super::platform;
use crate::command::{Task, root};
use crate::commit::Commit;
use crate::{sums, toolchain};

/// The directory of the second checkout; its name has another length than that of any checkout here.
const ELSEWHERE: &str = "checked-out-elsewhere";

/// Makes the same things from a clone of the commit, and compares them with those in `out`.
pub fn again(what: &[String], out: &Path, commit: &Commit) -> Result<()> {
    let place = platform::work().join(ELSEWHERE);
    if place.exists() {
        fs::remove_dir_all(&place).with_context(|| place.display().to_string())?;
    }
    let second = place.join("dist");
    println!("\n== the same again, in {}", place.display());
    Task::new("git").args(["clone", "--quiet", "--shared"]).args([root(), &place]).run()?;
    let checkout = ["checkout", "--quiet", "--detach", &commit.id];
    Task::new("git").args(checkout).current_dir(&place).run()?;
    Task::cargo()
        .args(["run", "--quiet", "--package", "xtask", "--", "dist"])
        .args(what)
        .args((!toolchain::is_pinned()).then_some("--other-rust"))
        .args(["--out".as_ref(), second.as_os_str()])
        .env("CARGO_TARGET_DIR", &place.join("target").to_string_lossy())
        .current_dir(&place)
        .run()?;
    let (first, second) = (sums::of(out)?, sums::of(&second)?);
    let differing = differing(&first, &second);
    if !differing.is_empty() {
        bail!("not the same in both directories: {}", differing.join(", "));
    }
    println!("\n{} files, the same bytes in both directories", second.len());
    fs::remove_dir_all(&place).with_context(|| place.display().to_string())
}

/// The names of the second that the first lacks or has with another sum.
fn differing(first: &[(String, String)], second: &[(String, String)]) -> Vec<String> {
    let other = second.iter().filter(|it| !first.contains(it));
    other.map(|(name, _)| name.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_named() {
        let list = |sums: &[(&str, &str)]| -> Vec<(String, String)> {
            sums.iter().map(|(name, sum)| ((*name).to_owned(), (*sum).to_owned())).collect()
        };
        let first = list(&[("a.deb", "1"), ("b.whl", "2"), ("from before", "3")]);
        assert!(differing(&first, &list(&[("a.deb", "1"), ("b.whl", "2")])).is_empty());
        assert_eq!(differing(&first, &list(&[("a.deb", "1"), ("b.whl", "9")])), ["b.whl"]);
    }
}
