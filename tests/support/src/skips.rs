//! Tests that cannot run here.

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;
use std::{env, fs, io, thread};

/// Names the file that skips are appended to.
pub const SKIPS: &str = "PLUMBLINE_SKIPS";

/// What a test lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Absent {
    /// Photographs or recordings that are not in the repository.
    Data,
    /// Something that this computer does not have and that is not installed for a test: counters
    /// of processor cycles, systemd.
    Machine,
    /// Something that an emulator of another processor cannot do.
    Emulator,
    /// A program or package by others, which `cargo xtask test` installs where it can.
    Tool,
    /// A program of this project, which `cargo xtask test` always builds.
    Build,
}

impl Absent {
    const ALL: [Self; 5] = [Self::Data, Self::Machine, Self::Emulator, Self::Tool, Self::Build];

    /// The word for it in the file.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Machine => "machine",
            Self::Emulator => "emulator",
            Self::Tool => "tool",
            Self::Build => "build",
        }
    }
}

/// A test that was skipped.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Skip {
    /// What it lacked.
    pub absent: Absent,
    /// The test program and the test in it.
    pub test: String,
    /// The reason, for people.
    pub reason: String,
}

impl Skip {
    fn line(&self) -> String {
        let text = format!("{}\t{}\t{}", self.absent.word(), self.test, self.reason);
        text.replace('\n', " ") + "\n"
    }

    fn parse(line: &str) -> Option<Self> {
        let mut words = line.splitn(3, '\t');
        let (absent, test, reason) = (words.next()?, words.next()?, words.next()?);
        let absent = Absent::ALL.into_iter().find(|it| it.word() == absent)?;
        Some(Self { absent, test: test.to_owned(), reason: reason.to_owned() })
    }
}

/// Records that the test of this thread cannot run, and why. The test must return afterwards.
///
/// # Panics
/// When the file that [`SKIPS`] names cannot be written.
pub fn skip(absent: Absent, reason: &str) {
    println!("skipped: {reason}");
    let Some(file) = env::var_os(SKIPS) else { return };
    let skip = Skip { absent, test: this_test(), reason: reason.to_owned() };
    append(Path::new(&file), &skip).expect("the file of skips can be written");
}

/// The program's name without cargo's hash, and the name of the test, which its thread has.
fn this_test() -> String {
    let program = env::current_exe().unwrap_or_default();
    let program = program.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let program = program.rsplit_once('-').map_or(&*program, |(name, _)| name);
    format!("{program}: {}", thread::current().name().unwrap_or("a thread without a name"))
}

/// A single write, so that the lines of programs that run at the same time do not mix.
fn append(file: &Path, skip: &Skip) -> io::Result<()> {
    let mut file = OpenOptions::new().create(true).append(true).open(file)?;
    file.write_all(skip.line().as_bytes())
}

/// The skips in a file, sorted and without duplicates; none where there is no file.
///
/// # Errors
/// When the file cannot be read, or a line of it is not a skip.
pub fn read_skips(file: &Path) -> io::Result<Vec<Skip>> {
    let text = match fs::read_to_string(file) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        text => text?,
    };
    let parse = |line: &str| Skip::parse(line).ok_or_else(|| io::Error::other(line.to_owned()));
    let mut skips = text.lines().map(parse).collect::<Result<Vec<_>, _>>()?;
    skips.sort();
    skips.dedup();
    Ok(skips)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_appended_is_read_in_order_and_once() {
        let file = env::temp_dir().join(format!("plumbline-skips-{}", std::process::id()));
        assert_eq!(read_skips(&file).unwrap(), []);
        let skip = |absent, test: &str, reason: &str| Skip {
            absent,
            test: test.into(),
            reason: reason.into(),
        };
        let [one, other] = [
            skip(Absent::Tool, "a: b", "none\there"),
            skip(Absent::Data, "c: d", "no photographs"),
        ];
        for skip in [&one, &other, &one] {
            append(&file, skip).unwrap();
        }
        assert_eq!(read_skips(&file).unwrap(), [other, one]);
        fs::write(&file, "nonsense\n").unwrap();
        assert!(read_skips(&file).is_err());
        fs::remove_file(&file).unwrap();
    }

    #[test]
    fn a_test_is_named_with_its_program() {
        let name = this_test();
        assert_eq!(name, "plumbline_test_support: skips::tests::a_test_is_named_with_its_program");
    }
}
