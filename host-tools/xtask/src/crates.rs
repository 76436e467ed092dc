//! Compares README's table of crates with their manifests: which crates each one uses, and which it
//! never may.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use anyhow::{Context, Result, ensure};
use toml::{Table, Value};

use crate::command::root;
use crate::generated::Part;

/// The crate that the tests of every crate may use; it depends on no other crate itself.
const TEST_SUPPORT: &str = "plumbline-test-support";

/// The crate that host and box share besides the core; it depends on no other crate itself.
const SHARED: &str = "plumbline-update";

/// A package of the workspace.
#[derive(Debug)]
struct Package {
    /// Its directory relative to the root; empty for the root itself.
    directory: String,
    /// The workspace packages that it uses.
    uses: BTreeSet<String>,
    /// The workspace packages that only its tests use.
    tests_use: BTreeSet<String>,
}

/// All packages by name.
fn packages() -> Result<BTreeMap<String, Package>> {
    let manifest = |directory: &str| -> Result<Table> {
        let path = root().join(directory).join("Cargo.toml");
        let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        text.parse().with_context(|| path.display().to_string())
    };
    let members = manifest("")?["workspace"]["members"].clone();
    let members = members.as_array().context("members")?.iter().filter_map(Value::as_str);
    let mut manifests = BTreeMap::new();
    for directory in [""].into_iter().chain(members) {
        let manifest = manifest(directory)?;
        let name = manifest["package"]["name"].as_str().context("a package without a name")?;
        manifests.insert(name.to_owned(), (directory.to_owned(), manifest.clone()));
    }
    let packages = manifests.iter().map(|(name, (directory, manifest))| {
        let own = |kinds: &[&str]| -> BTreeSet<String> {
            let found = dependencies(manifest, kinds);
            found.into_iter().filter(|it| manifests.contains_key(it)).collect()
        };
        let uses = own(&["dependencies", "build-dependencies"]);
        let tests_use = own(&["dev-dependencies"]);
        (name.clone(), Package { directory: directory.clone(), uses, tests_use })
    });
    Ok(packages.collect())
}

/// The names in a manifest's dependency tables of these kinds, for all processors.
fn dependencies(manifest: &Table, kinds: &[&str]) -> BTreeSet<String> {
    let targets = manifest.get("target").and_then(Value::as_table).into_iter().flatten();
    let tables = targets.filter_map(|(_, table)| table.as_table()).chain([manifest]);
    tables
        .flat_map(|table| kinds.iter().filter_map(|&kind| table.get(kind)?.as_table()))
        .flat_map(|dependencies| dependencies.keys().cloned())
        .collect()
}

/// README's rows `| name | what | names |`.
fn rows(table: &str) -> Result<BTreeMap<String, BTreeSet<String>>> {
    let quoted = |cell: &str| -> BTreeSet<String> {
        cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
    };
    let mut rows = BTreeMap::new();
    for row in table.lines().skip(2) {
        let cells: Vec<&str> = row.trim().trim_matches('|').split('|').collect();
        let [name, _, uses] = cells[..] else {
            anyhow::bail!("there should be three cells in {row}")
        };
        let name = quoted(name).pop_first().with_context(|| format!("no name in {row}"))?;
        ensure!(rows.insert(name, quoted(uses)).is_none(), "twice: {row}");
    }
    Ok(rows)
}

/// All errors in the table and in the packages' dependencies.
fn faults(
    rows: &BTreeMap<String, BTreeSet<String>>,
    packages: &BTreeMap<String, Package>,
) -> Vec<String> {
    let mut faults = Vec::new();
    let names: BTreeSet<_> = rows.keys().chain(packages.keys()).collect();
    for name in names {
        match (rows.get(name), packages.get(name)) {
            (Some(_), None) => faults.push(format!("{name}: no such package")),
            (None, Some(it)) => faults.push(format!("{name}: no row; it uses {:?}", it.uses)),
            (Some(row), Some(package)) if *row != package.uses => faults
                .push(format!("{name}: the row has {row:?}, its Cargo.toml {:?}", package.uses)),
            _ => {}
        }
    }
    for (name, package) in packages {
        let mut forbid =
            |used: &BTreeSet<String>, what: &str, is_forbidden: &dyn Fn(&str) -> bool| {
                for used in used.iter().filter(|used| is_forbidden(used)) {
                    faults.push(format!("{name}: {what} use {used}"));
                }
            };
        let lies_in = |used: &str, folder: &str| packages[used].directory.starts_with(folder);
        match package.directory.split('/').next().unwrap_or_default() {
            // Neither what both sides share depends on the workspace, nor its tests.
            place if place.is_empty() || name == SHARED => {
                forbid(&package.uses, "must not", &|_| true);
                // With features that only its tests need, a crate may use itself.
                forbid(&package.tests_use, "its tests must not", &|used| used != name);
            }
            // The tests of the whole workspace may use everything.
            "tests" => {}
            // A crate's own tests may not cross the line between host and box either.
            place => {
                let other = if place == "board" { "host-tools" } else { "board" };
                let is_forbidden = |used: &str| match used {
                    SHARED | TEST_SUPPORT => false,
                    _ => lies_in(used, other) || lies_in(used, "tests"),
                };
                forbid(&package.uses, "must not", &is_forbidden);
                forbid(&package.tests_use, "its tests must not", &is_forbidden);
            }
        }
    }
    faults
}

#[test]
fn readme_has_every_crate_with_its_arrows_and_none_is_forbidden() {
    let table = Part { document: "README.md", name: "crates" }.read().unwrap();
    let faults = faults(&rows(&table).unwrap(), &packages().unwrap());
    assert!(faults.is_empty(), "README.md or a Cargo.toml is wrong:\n{}", faults.join("\n"));
}

#[test]
fn wrong_rows_and_wrong_arrows_are_found() {
    let package = |directory: &str, uses: &[&str], tests_use: &[&str]| {
        let set = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        Package { directory: directory.to_owned(), uses: set(uses), tests_use: set(tests_use) }
    };
    let packages = |core: &[&str], box_tests: &[&str], host: &[&str]| {
        BTreeMap::from([
            ("core".to_owned(), package("", core, &[])),
            (SHARED.to_owned(), package("board/update", &[], &[])),
            ("box".to_owned(), package("board", &["core"], box_tests)),
            ("host".to_owned(), package("host-tools/host", host, &[])),
            ("whole".to_owned(), package("tests", &["box", "core", "host"], &[])),
            (TEST_SUPPORT.to_owned(), package("tests/support", &[], &[])),
        ])
    };
    let table = "| crate | what | uses |\n|---|---|---|\n\
                 | `core` | it | nothing |\n\
                 | `plumbline-update` | updates | nothing |\n\
                 | `box` | it | `core` |\n\
                 | `host` | it | `core` `plumbline-update` |\n\
                 | `whole` | tests | `box` `core` `host` |\n\
                 | `plumbline-test-support` | helpers | nothing |";
    let all = rows(table).unwrap();
    assert_eq!(faults(&all, &packages(&[], &[TEST_SUPPORT], &["core", SHARED])), [""; 0]);
    let wrong = faults(&all, &packages(&["box"], &["host"], &["box"]));
    for part in [
        "core: the row has {}, its Cargo.toml {\"box\"}",
        "core: must not use box",
        "box: its tests must not use host",
        "host: must not use box",
        "host: the row has {\"core\", \"plumbline-update\"}, its Cargo.toml {\"box\"}",
    ] {
        assert!(wrong.iter().any(|fault| fault == part), "{part}: {wrong:?}");
    }
    assert_eq!(wrong.len(), 5, "{wrong:?}");
    let fewer = rows(&table.replace("| `host` | it | `core` `plumbline-update` |\n", "")).unwrap();
    let wrong = faults(&fewer, &packages(&[], &[], &["core"]));
    assert_eq!(wrong, ["host: no row; it uses {\"core\"}"]);
    assert!(rows(&format!("{table}\n| `core` | again | nothing |")).is_err());
    assert!(rows(&format!("{table}\n| `core` | nothing |")).is_err());
}
