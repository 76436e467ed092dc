//! The files that `plumb` reads and writes.
//!
//! Every reader refuses what it does not understand, with a [`BadInput`] that names the file, the
//! field, what was found and what to do. None guesses, and none allocates more than its limits
//! allow, whatever a header claims.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use serde::de::DeserializeOwned;

pub mod camera;
pub mod columns;
pub mod counting;
mod error;
pub mod frames;
pub mod poses;
pub mod room;
pub mod scene;
pub mod targets;

pub use error::BadInput;

/// Descriptions are far smaller; a device or a video that is given by mistake is larger.
const TEXT_BYTES_MAX: u64 = 1 << 20;

/// The largest recording of another system: an hour at 1 kHz of a plate with some 30 columns.
const TRIAL_BYTES_MAX: u64 = 1 << 30;

/// Reads a whole recording of another system, of at most 1 GiB. If its name ends with .gz, it is
/// unpacked.
///
/// # Errors
/// When it cannot be read, or is larger.
pub fn bytes_of(path: &Path) -> Result<Vec<u8>, BadInput> {
    let place = path.display();
    let file = File::open(path).map_err(|error| BadInput::io(&place, &error))?;
    let mut bytes = Vec::new();
    let packed = path.extension().is_some_and(|it| it.eq_ignore_ascii_case("gz"));
    let source: Box<dyn Read> =
        if packed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
    source
        .take(TRIAL_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| BadInput::io(&place, &error))?;
    if bytes.len() as u64 > TRIAL_BYTES_MAX {
        return Err(BadInput::whole(place, "more than 1 GiB", "no trial is so long"));
    }
    Ok(bytes)
}

/// As [`bytes_of`], for text. Names may be in any encoding; numbers are ASCII in all of them.
///
/// # Errors
/// As [`bytes_of`].
pub fn text_of(path: &Path) -> Result<String, BadInput> {
    Ok(String::from_utf8_lossy(&bytes_of(path)?).into_owned())
}

/// Reads a whole text file of at most 1 MiB.
///
/// # Errors
/// When it cannot be read, is longer, or is not text.
pub fn read_text(path: &Path) -> Result<String, BadInput> {
    let place = path.display();
    let file = File::open(path).map_err(|error| BadInput::io(&place, &error))?;
    let mut bytes = Vec::new();
    file.take(TEXT_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| BadInput::io(&place, &error))?;
    if bytes.len() as u64 > TEXT_BYTES_MAX {
        return Err(BadInput::whole(
            place,
            "more than 1 MiB",
            "a small text file is expected here: check that the right file is given",
        ));
    }
    String::from_utf8(bytes).map_err(|_| {
        BadInput::whole(
            place,
            "not a text file (its bytes are not UTF-8)",
            "a small text file is expected here: check that the right file is given",
        )
    })
}

/// Writes a whole text file.
///
/// # Errors
/// When the operating system refuses.
pub fn write_text(path: &Path, text: &str) -> Result<(), BadInput> {
    std::fs::write(path, text).map_err(|error| BadInput::io(path.display(), &error))
}

/// Opens the file of `--out` for writing. One that exists is kept unless `force`.
///
/// # Errors
/// When it exists, or the operating system refuses.
pub fn create(path: &Path, force: bool) -> Result<File, BadInput> {
    open_new(path, force).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => BadInput::whole(
            path.display(),
            "exists already",
            "give another --out, or --force to replace it",
        ),
        ErrorKind::NotFound => no_such_directory(path),
        _ => BadInput::io(path.display(), &error),
    })
}

fn open_new(path: &Path, force: bool) -> std::io::Result<File> {
    let mut options = File::options();
    options.write(true);
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    options.open(path)
}

/// A file of `--out` that is created when the first byte is written: if nothing is written there is
/// none, and one from before is unchanged.
#[derive(Debug)]
pub struct Late {
    path: PathBuf,
    force: bool,
    file: Option<File>,
}

impl Late {
    /// Checks that the file can be created, and leaves nothing behind.
    ///
    /// # Errors
    /// As [`create`].
    pub fn new(path: &Path, force: bool) -> Result<Self, BadInput> {
        if !(force && path.exists()) {
            create(path, false)?;
            std::fs::remove_file(path).map_err(|error| BadInput::io(path.display(), &error))?;
        } else if path.is_file() || path.is_dir() {
            // Only files and directories: opening a device or a pipe can have effects.
            let opened = File::options().append(true).open(path);
            opened.map_err(|error| BadInput::io(path.display(), &error))?;
        }
        Ok(Self { path: path.to_owned(), force, file: None })
    }
}

impl Write for Late {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(open_new(&self.path, self.force)?),
        };
        file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.as_mut().map_or(Ok(()), File::flush)
    }
}

/// Writes several files: all of them or none. Where one exists and `force` is not given, a
/// directory is absent, or the disk is full, nothing is left behind. Each file is renamed
/// atomically: no other program ever sees a part of it.
///
/// # Errors
/// When one exists, or the operating system refuses.
pub fn write_all(outputs: &[(PathBuf, Vec<u8>)], force: bool) -> Result<(), BadInput> {
    if let Some((path, _)) = outputs.iter().find(|(path, _)| !force && path.exists()) {
        let remedy = "give another name, or --force to replace it";
        return Err(BadInput::whole(path.display(), "exists already", remedy));
    }
    let mut staged = Vec::new();
    for (path, bytes) in outputs {
        if path.exists() && !path.is_file() {
            // A device or a pipe cannot be replaced by a file: it is written to.
            let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
            create(path, force)?.write_all(bytes).map_err(failed)?;
        } else {
            staged.push((beside(path, |file| write_bytes(file, path, bytes))?, path));
        }
    }
    for (file, path) in staged {
        file.persist(path).map_err(|error| BadInput::io(path.display(), &error.error))?;
    }
    Ok(())
}

/// Writes one file as [`write_all`] does, in place of one that exists.
///
/// # Errors
/// When the operating system refuses.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), BadInput> {
    replace_with(path, |file| write_bytes(file, path, bytes))
}

/// Writes one file as [`replace`] does; `fill` writes its content.
///
/// # Errors
/// When the operating system refuses, and those of `fill`.
pub fn replace_with(
    path: &Path,
    fill: impl FnOnce(&File) -> Result<(), BadInput>,
) -> Result<(), BadInput> {
    let file = beside(path, fill)?;
    file.persist(path).map_err(|error| BadInput::io(path.display(), &error.error))?;
    sync_directory(directory_of(path));
    Ok(())
}

/// Brings the names in a directory to the disk, so that they survive a loss of power. File systems
/// that cannot do so bring them there in their own time.
pub fn sync_directory(directory: &Path) {
    let _ = File::open(directory).and_then(|it| it.sync_all());
}

/// A temporary file beside `path`, to be renamed to it.
fn beside(
    path: &Path,
    fill: impl FnOnce(&File) -> Result<(), BadInput>,
) -> Result<tempfile::NamedTempFile, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
    let directory = directory_of(path);
    if !directory.is_dir() {
        return Err(no_such_directory(path));
    }
    // Readable as any file of this user; temporary files are private otherwise.
    let mut builder = tempfile::Builder::new();
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder.tempfile_in(directory).map_err(failed)?;
    fill(file.as_file())?;
    // Otherwise the name may be on the disk before the content.
    file.as_file().sync_all().map_err(failed)?;
    Ok(file)
}

fn write_bytes(mut file: &File, path: &Path, bytes: &[u8]) -> Result<(), BadInput> {
    file.write_all(bytes).map_err(|error| BadInput::io(path.display(), &error))
}

/// The directory of a file.
#[must_use]
pub fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn no_such_directory(path: &Path) -> BadInput {
    BadInput::whole(
        path.display(),
        "there is no such directory",
        "make the directory first, or give another name",
    )
}

/// Checks that writing `out` destroys none of the files that are read.
///
/// # Errors
/// When `out` exists and is one of `inputs`, under whatever name.
pub fn refuse_overwriting<'a>(
    out: &Path,
    inputs: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<(), BadInput> {
    // A file that does not exist yet is not an input.
    let Ok(existing) = out.canonicalize() else { return Ok(()) };
    if inputs.into_iter().any(|input| input.canonicalize().is_ok_and(|it| it == existing)) {
        return Err(BadInput::whole(
            "--out",
            format!("{} is one of the inputs, and would be overwritten", out.display()),
            "give another name",
        ));
    }
    Ok(())
}

/// Parses a TOML text; errors name the field and its line.
///
/// `remedy` says what a correct file looks like.
///
/// # Errors
/// When it is not TOML, or not of this type.
pub fn from_toml<T: DeserializeOwned>(
    text: &str,
    place: &str,
    remedy: &str,
) -> Result<T, BadInput> {
    toml::from_str(text).map_err(|error| {
        let message = error.message().trim();
        let line_of = |offset: usize| text[..offset].matches('\n').count();
        let line = error.span().map(|span| line_of(span.start.min(text.len())));
        // serde names the field in its own words; otherwise it is the key on the line.
        let key_on_line = || {
            let (key, _) = text.lines().nth(line?)?.split_once('=')?;
            Some(key.trim().to_owned())
        };
        let in_backticks =
            || Some(message.split('`').nth(1).filter(|name| !name.is_empty())?.to_owned());
        let named = ["missing field", "unknown field", "duplicate key", "duplicate field"];
        let field = if named.iter().any(|start| message.starts_with(start)) {
            in_backticks().or_else(key_on_line)
        } else {
            key_on_line()
        };
        let mut place_in_file = field.unwrap_or_default();
        // A missing field has no line: its table may be the whole file.
        if let Some(line) = line.filter(|_| !message.starts_with("missing field")) {
            let separator = if place_in_file.is_empty() { "" } else { " " };
            place_in_file = format!("{place_in_file}{separator}(line {})", line + 1);
        }
        let found = message.lines().next().unwrap_or("it is not TOML");
        BadInput::new(place, place_in_file, found, remedy)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_written_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let names = || std::fs::read_dir(&folder).unwrap().count();
        let path = folder.path().join("view.png");
        replace(&path, b"old").unwrap();
        replace(&path, b"new").unwrap();
        assert_eq!((std::fs::read(&path).unwrap(), names()), (b"new".to_vec(), 1));
        let taken = folder.path().join("directory");
        std::fs::create_dir(&taken).unwrap();
        assert!(replace(&taken, b"new").is_err());
        assert_eq!(names(), 2);
    }

    #[test]
    fn an_old_file_is_kept_unless_forced() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("poses.csv");
        std::fs::write(&path, "precious").unwrap();
        let error = create(&path, false).unwrap_err();
        assert!(error.to_string().contains("--force"), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
        create(&path, true).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "");
        let error = create(&directory.path().join("no/poses.csv"), false).unwrap_err();
        assert!(error.found.contains("no such directory"), "{error}");
    }
}
