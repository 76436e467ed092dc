//! What a program has in it besides crates: what the linker took from libraries of this computer, which
//! are Debian's, and what is embedded in its pages.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::sbom::Contents;
use crate::command::{Task, root};
use crate::sums::sha256;

/// An installed Debian package, of which a part is linked into a program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Installed {
    pub name: String,
    pub version: String,
    /// The package's checksum, where apt's lists still have this version.
    pub sha256: Option<String>,
}

/// The packages from which this gcc takes these libraries, which it links into programs.
pub fn packages(gcc: &str, libraries: &[&str]) -> Result<Vec<Installed>> {
    let mut packages: Vec<Installed> = Vec::new();
    for library in libraries {
        let path = Task::new(gcc).args([format!("-print-file-name={library}")]).output()?;
        // Paths such as `/usr/lib/gcc/../../../x/libc.a` are not those that dpkg knows.
        let path = fs::canonicalize(path.trim()).with_context(|| format!("{gcc}: no {library}"))?;
        let (name, version) = package_of(&path)?;
        if !packages.iter().any(|it| it.name == name) {
            let described = Task::new("apt-cache").args(["show", &format!("{name}={version}")]);
            let sha256 = described.output().ok().and_then(|text| checksum(&text));
            packages.push(Installed { name, version, sha256 });
        }
    }
    Ok(packages)
}

/// The package that has installed a file, and its version.
fn package_of(file: &Path) -> Result<(String, String)> {
    let wrong = || format!("{}: which Debian package is it of?", file.display());
    let line = Task::new("dpkg-query").args(["--search"]).args([file]).output();
    let line = line.with_context(wrong)?;
    let (name, _) = line.split_once(": ").with_context(wrong)?;
    let version =
        Task::new("dpkg-query").args(["--show", "--showformat=${Version}", name]).output()?;
    Ok((name.split(':').next().unwrap_or(name).to_owned(), version))
}

/// The checksum in apt's description of a package.
fn checksum(description: &str) -> Option<String> {
    description.lines().find_map(|line| line.strip_prefix("SHA256: ")).map(str::to_owned)
}

/// What the page of the desk has from others: see the directory's README.
const PAGE: &str = "host-tools/desk/page/vendor/preact-htm.js";

/// Adds what is embedded in `plumb`: the library of the desk's page.
pub fn with_page(contents: Contents) -> Result<Contents> {
    let path: PathBuf = root().join(PAGE);
    let readme =
        fs::read_to_string(path.with_file_name("README.md")).context("the page's README")?;
    let version = version_in(&readme).context("the page's README names no version of htm")?;
    let sum = sha256(&fs::read(&path).with_context(|| path.display().to_string())?);
    Ok(contents.with_npm_package("htm", version, "Apache-2.0 AND MIT", &sum))
}

/// `3.1.1` of `[htm](address) 3.1.1, ...`.
fn version_in(readme: &str) -> Option<&str> {
    let (_, rest) = readme.split_once("[htm](")?;
    let (_, rest) = rest.split_once(") ")?;
    rest.split(',').next().filter(|it| it.starts_with(|first: char| first.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_s_library_is_the_one_that_its_readme_describes() {
        let contents = with_page(Contents::default()).unwrap();
        let readme = fs::read_to_string(root().join(PAGE).with_file_name("README.md")).unwrap();
        assert_eq!(version_in(&readme), Some("3.1.1"));
        let sum = sha256(&fs::read(root().join(PAGE)).unwrap());
        assert!(readme.contains(&sum), "{sum}");
        assert_eq!(
            contents,
            Contents::default().with_npm_package("htm", "3.1.1", "Apache-2.0 AND MIT", &sum)
        );
        assert_eq!(version_in("[htm](https://x) , of today"), None);
    }

    #[test]
    fn the_package_of_a_file_is_found_and_its_checksum_read() {
        // Every Debian has it; elsewhere there are no packages.
        let Ok((name, version)) = package_of(Path::new("/usr/bin/dpkg-query")) else { return };
        assert_eq!(name, "dpkg");
        assert!(version.starts_with(|first: char| first.is_ascii_digit()), "{version}");
        let error = package_of(Path::new("/no/such/file")).unwrap_err().to_string();
        assert!(error.contains("/no/such/file: which"), "{error}");
        assert_eq!(checksum("Package: a\nSHA256: 12\n").as_deref(), Some("12"));
        assert_eq!(checksum("Package: a\n"), None);
    }
}
