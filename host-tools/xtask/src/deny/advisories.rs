//! The RustSec advisories that concern this project's crates, stored in `advisories.toml`: for computers
//! that cannot fetch the database, and so that a check gives the same everywhere.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;
use toml::Value;

use crate::command::root;

/// The file, relative to the root of the checkout.
pub const PLACE: &str = "host-tools/xtask/src/deny/advisories.toml";

/// What writes it.
pub const UPDATE: &str = "cargo xtask deny --update-advisories";

/// The stored advisories.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Advisories {
    /// Where the database is.
    pub source: String,
    /// The day of its last change: `2026-01-31`.
    pub date: String,
    /// The crates whose advisories were looked up.
    pub crates: BTreeSet<String>,
    #[serde(rename = "advisory")]
    pub advisories: Vec<Advisory>,
}

/// An advisory: what it takes to find out whether it concerns a version.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Advisory {
    pub package: String,
    pub id: String,
    pub date: String,
    pub title: String,
    /// `unsound` or `unmaintained`; absent for a vulnerability.
    pub informational: Option<String>,
    /// The day on which it was withdrawn.
    pub withdrawn: Option<String>,
    /// Ranges of versions.
    pub patched: Vec<String>,
    pub unaffected: Vec<String>,
}

impl Advisories {
    /// Reads the checkout's.
    pub fn read() -> Result<Self> {
        let text = fs::read_to_string(root().join(PLACE)).context(PLACE)?;
        toml::from_str(&text).with_context(|| format!("{PLACE}: `{UPDATE}` writes it anew"))
    }

    /// Those of a checkout of the database that concern the given crates.
    pub fn of_database(database: &Path, date: &str, crates: BTreeSet<String>) -> Result<Self> {
        let mut advisories = Vec::new();
        let all = database.join("crates");
        ensure!(all.is_dir(), "{}: this is not the RustSec database", database.display());
        for name in &crates {
            let Ok(entries) = fs::read_dir(all.join(name)) else { continue };
            for entry in entries {
                let path = entry?.path();
                let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
                let advisory =
                    Advisory::parse(&text).with_context(|| path.display().to_string())?;
                advisories.push(advisory);
            }
        }
        advisories.sort();
        Ok(Self { source: super::SOURCE.to_owned(), date: date.to_owned(), crates, advisories })
    }

    /// Writes the form of the database that cargo-deny reads.
    pub fn write_database(&self, directory: &Path) -> Result<()> {
        for advisory in &self.advisories {
            let place = directory.join("crates").join(&advisory.package);
            let path = place.join(format!("{}.md", advisory.id));
            let failed = || path.display().to_string();
            fs::create_dir_all(&place).with_context(failed)?;
            fs::write(&path, advisory.to_markdown()).with_context(failed)?;
        }
        Ok(())
    }

    /// The file's text: what stands above `crates` is kept, with the new date.
    pub fn to_text(&self, former: &str) -> Result<String> {
        let (head, _) = former.split_once("\ndate = ").context("no date")?;
        let mut text = format!(
            "{head}\ndate = {}\n# The crates whose advisories were looked up.\ncrates = [\n",
            quoted(&self.date)
        );
        let mut line = String::new();
        for name in &self.crates {
            let word = format!(" {},", quoted(name));
            if line.len() + word.len() > 107 {
                let _ = writeln!(text, "   {line}");
                line.clear();
            }
            line += &word;
        }
        let _ = writeln!(text, "   {line}\n]");
        for advisory in &self.advisories {
            let _ = write!(text, "\n[[advisory]]\n{}", advisory.to_toml());
        }
        Ok(text)
    }
}

impl Advisory {
    /// Reads a file of the database: TOML between fences, and Markdown whose first heading is the title.
    fn parse(text: &str) -> Result<Self> {
        let rest =
            text.trim_start().strip_prefix("```toml").context("it begins without ```toml")?;
        let (front, rest) = rest.split_once("\n```").context("its TOML does not end")?;
        let title = rest.lines().find_map(|line| line.strip_prefix("# ")).context("no title")?;
        let front: toml::Table = front.parse()?;
        let table = |name: &str| front.get(name).and_then(Value::as_table);
        let advisory = table("advisory").context("no [advisory]")?;
        let field = |name: &str| advisory.get(name).and_then(Value::as_str).map(str::to_owned);
        let needed = |name: &str| field(name).with_context(|| format!("no {name}"));
        let ranges = |name: &str| -> Result<Vec<String>> {
            let Some(all) = table("versions").and_then(|it| it.get(name)) else {
                return Ok(Vec::new());
            };
            let all = all.as_array().with_context(|| format!("{name} is not a list"))?;
            let text = |range: &Value| range.as_str().map(str::to_owned);
            all.iter().map(|it| text(it).with_context(|| format!("{name}: no text"))).collect()
        };
        if table("versions").is_none() {
            bail!("no [versions]");
        }
        Ok(Self {
            package: needed("package")?,
            id: needed("id")?,
            date: needed("date")?,
            title: title.trim().to_owned(),
            informational: field("informational"),
            withdrawn: field("withdrawn"),
            patched: ranges("patched")?,
            unaffected: ranges("unaffected")?,
        })
    }

    fn to_markdown(&self) -> String {
        let mut text = "```toml\n[advisory]\n".to_owned();
        let options = [("informational", &self.informational), ("withdrawn", &self.withdrawn)];
        let options = options.into_iter().filter_map(|(name, it)| Some((name, it.as_ref()?)));
        let fields = [("id", &self.id), ("package", &self.package), ("date", &self.date)];
        for (name, value) in fields.into_iter().chain(options) {
            let _ = writeln!(text, "{name} = {}", quoted(value));
        }
        let (patched, unaffected) = (list(&self.patched), list(&self.unaffected));
        let _ = write!(
            text,
            "\n[versions]\npatched = {patched}\nunaffected = {unaffected}\n```\n\n# {}\n\n\
             See <https://rustsec.org/advisories/{}.html>.\n",
            self.title, self.id
        );
        text
    }

    fn to_toml(&self) -> String {
        let mut text = String::new();
        for (name, value) in [
            ("id", Some(&self.id)),
            ("package", Some(&self.package)),
            ("date", Some(&self.date)),
            ("title", Some(&self.title)),
            ("informational", self.informational.as_ref()),
            ("withdrawn", self.withdrawn.as_ref()),
        ] {
            if let Some(value) = value {
                let _ = writeln!(text, "{name} = {}", quoted(value));
            }
        }
        let (patched, unaffected) = (list(&self.patched), list(&self.unaffected));
        let _ = write!(text, "patched = {patched}\nunaffected = {unaffected}\n");
        text
    }
}

/// A text as TOML has it.
fn quoted(text: &str) -> String {
    Value::String(text.to_owned()).to_string()
}

fn list(texts: &[String]) -> String {
    let texts: Vec<String> = texts.iter().map(|it| quoted(it)).collect();
    format!("[{}]", texts.join(", "))
}

/// The names of the crates in `Cargo.lock` that come from a registry.
pub fn locked_crates() -> Result<BTreeSet<String>> {
    let path: PathBuf = root().join("Cargo.lock");
    let lock: toml::Table = fs::read_to_string(path).context("Cargo.lock")?.parse()?;
    let packages =
        lock.get("package").and_then(Value::as_array).context("Cargo.lock: no package")?;
    let foreign = packages.iter().filter(|package| package.get("source").is_some());
    Ok(foreign.filter_map(|it| it.get("name")?.as_str().map(str::to_owned)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "\
```toml
[advisory]
id = \"RUSTSEC-2026-0002\"
package = \"lru\"
date = \"2026-01-07\"
informational = \"unsound\"
categories = [\"memory-corruption\"]

[versions]
patched = [\">= 0.16.3\"]
unaffected = [\"< 0.9.0\"]
```

# `IterMut` violates \"Stacked Borrows\"

Affected versions of this crate ...
";

    #[test]
    fn what_is_stored_is_what_the_database_says() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("crates/lru");
        fs::create_dir_all(&place).unwrap();
        fs::write(place.join("RUSTSEC-2026-0002.md"), FILE).unwrap();
        let crates = ["lru", "libm"].map(str::to_owned).into();
        let read = Advisories::of_database(folder.path(), "2026-10-02", crates).unwrap();
        let [advisory] = &read.advisories[..] else { panic!("{read:?}") };
        assert_eq!(advisory.title, "`IterMut` violates \"Stacked Borrows\"");
        assert_eq!(advisory.patched, [">= 0.16.3"]);
        let head =
            format!("# A head.\nsource = \"{}\"\ndate = \"2020-01-01\"\n", super::super::SOURCE);
        let text = read.to_text(&head).unwrap();
        assert!(text.starts_with("# A head.\n"), "{text}");
        assert_eq!(toml::from_str::<Advisories>(&text).unwrap(), read);
        // And back into the database's own form.
        let copy = tempfile::tempdir().unwrap();
        read.write_database(copy.path()).unwrap();
        let again = Advisories::of_database(copy.path(), &read.date, read.crates.clone()).unwrap();
        assert_eq!(again, read);
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (from, to, what) in [
            ("```toml", "", "begins without"),
            ("[versions]", "[other]", "no [versions]"),
            ("# `Iter", "`Iter", "no title"),
            ("id =", "name =", "no id"),
            ("[\">= 0.16.3\"]", "7", "patched is not a list"),
        ] {
            let error = format!("{:#}", Advisory::parse(&FILE.replacen(from, to, 1)).unwrap_err());
            assert!(error.contains(what), "{error}");
        }
        let folder = tempfile::tempdir().unwrap();
        assert!(Advisories::of_database(folder.path(), "", BTreeSet::new()).is_err());
    }

    #[test]
    fn the_stored_file_is_as_it_is_written() {
        let stored = Advisories::read().unwrap();
        let text = fs::read_to_string(root().join(PLACE)).unwrap();
        assert_eq!(stored.to_text(&text).unwrap(), text, "{PLACE}: `{UPDATE}` writes it anew");
        for advisory in &stored.advisories {
            assert!(stored.crates.contains(&advisory.package), "{}", advisory.id);
        }
    }
}
