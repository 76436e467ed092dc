//! The one place that writes files.
//!
//! What is measured on people is readable by its owner alone ([`private`]): files also where they
//! replace one that others could read, and directories that are made. Directories that exist stay as
//! they are.
//!
//! The directories above an output are made. Where it is a symbolic link, the link stays, and the file
//! that it names is written. Nothing is overwritten unasked, and an output that
//! fails leaves nothing behind, neither a part of a file nor an empty directory.

use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::{BadInput, private};

/// As many symbolic links as Linux follows, one after the other.
const LINKS_MAX: usize = 40;

/// Writes a text file, in place of one that exists.
///
/// # Errors
/// When the operating system refuses.
pub fn write_text(path: &Path, text: &str) -> Result<(), BadInput> {
    write_all(&[(path.to_owned(), text.into())], true)
}

/// Opens the file of `--out` for writing. One that exists is kept unless `force`.
///
/// # Errors
/// When it exists, or the operating system refuses.
pub fn create(path: &Path, force: bool) -> Result<File, BadInput> {
    let path = followed(path)?;
    let made = Made::directories(directory_of(&path))?;
    let file = open_new(&path, force).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => exists_already(&path, "give another --out"),
        _ => BadInput::io(path.display(), &error),
    })?;
    made.keep();
    Ok(file)
}

fn open_new(path: &Path, force: bool) -> std::io::Result<File> {
    let mut options = private::options();
    options.write(true);
    if force {
        options.create(true).truncate(true)
    } else {
        options.create_new(true)
    };
    let file = options.open(path)?;
    // One that was there keeps its mode when it is opened.
    private::own_file(&file)?;
    Ok(file)
}

fn exists_already(path: &Path, remedy: &str) -> BadInput {
    let remedy = format!("{remedy}, or --force to replace it");
    BadInput::whole(path.display(), "exists already", remedy)
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
        let path = followed(path)?;
        if !(force && path.exists()) {
            // Removed again when this goes out of scope.
            let _made = Made::directories(directory_of(&path))?;
            create(&path, false)?;
            std::fs::remove_file(&path).map_err(|error| BadInput::io(path.display(), &error))?;
        } else if path.is_file() || path.is_dir() {
            // Only files and directories: opening a device or a pipe can have effects.
            let opened = File::options().append(true).open(&path);
            opened.map_err(|error| BadInput::io(path.display(), &error))?;
        }
        Ok(Self { path, force, file: None })
    }

    fn open(&self) -> std::io::Result<File> {
        let made = Made::try_directories(directory_of(&self.path))?;
        let file = open_new(&self.path, self.force)?;
        made.keep();
        Ok(file)
    }
}

impl Write for Late {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.file.is_none() {
            self.file = Some(self.open()?);
        }
        self.file.as_mut().map_or(Ok(0), |file| file.write(bytes))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.as_mut().map_or(Ok(()), File::flush)
    }
}

/// Writes several files: all of them or none. Where one exists and `force` is not given, or the
/// disk is full, nothing is left behind. Each file is renamed atomically: no other program ever
/// sees a part of it.
///
/// # Errors
/// When one exists, or the operating system refuses.
pub fn write_all(outputs: &[(PathBuf, Vec<u8>)], force: bool) -> Result<(), BadInput> {
    if let Some((path, _)) = outputs.iter().find(|(path, _)| !force && path.exists()) {
        return Err(exists_already(path, "give another name"));
    }
    let mut made = Made::default();
    let mut staged = Vec::new();
    for (path, bytes) in outputs {
        let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
        let path = followed(path)?;
        if is_device(&path) {
            create(&path, force)?.write_all(bytes).map_err(failed)?;
        } else {
            made.add(directory_of(&path)).map_err(failed)?;
            staged.push((beside(&path, |file| write_bytes(file, &path, bytes))?, path));
        }
    }
    for (file, path) in staged {
        file.persist(&path).map_err(|error| BadInput::io(path.display(), &error.error))?;
    }
    made.keep();
    Ok(())
}

/// Writes one file as [`write_all`] does, in place of one that exists, and brings its name to the
/// disk as well.
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
    let path = followed(path)?;
    if is_device(&path) {
        return fill(&create(&path, true)?);
    }
    let made = Made::directories(directory_of(&path))?;
    let file = beside(&path, fill)?;
    file.persist(&path).map_err(|error| BadInput::io(path.display(), &error.error))?;
    made.keep();
    sync_directory(directory_of(&path));
    Ok(())
}

/// The file to which a path leads through symbolic links; it need not exist. A file that is renamed
/// to the link itself would take the link's place.
fn followed(path: &Path) -> Result<PathBuf, BadInput> {
    // The links of /proc/self/fd, to which /dev/stdout leads, name no path where there is a pipe.
    if is_device(path) {
        return Ok(path.to_owned());
    }
    let mut file = path.to_owned();
    for _ in 0..LINKS_MAX {
        let Ok(target) = std::fs::read_link(&file) else { return Ok(file) };
        file = directory_of(&file).join(target);
    }
    // They lead in a circle, for which the operating system has its own words.
    std::fs::metadata(path).map(|_| file).map_err(|error| BadInput::io(path.display(), &error))
}

/// Whether there is a device or a pipe, which must not be replaced by a file: it is written to.
/// A directory is refused when it is opened.
fn is_device(path: &Path) -> bool {
    path.exists() && !path.is_file()
}

/// A temporary file beside `path`, to be renamed to it.
fn beside(
    path: &Path,
    fill: impl FnOnce(&File) -> Result<(), BadInput>,
) -> Result<tempfile::NamedTempFile, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
    let file = tempfile::NamedTempFile::new_in(directory_of(path)).map_err(failed)?;
    private::own_file(file.as_file()).map_err(failed)?;
    fill(file.as_file())?;
    // Otherwise the name may be on the disk before the content.
    file.as_file().sync_all().map_err(failed)?;
    Ok(file)
}

fn write_bytes(mut file: &File, path: &Path, bytes: &[u8]) -> Result<(), BadInput> {
    file.write_all(bytes).map_err(|error| BadInput::io(path.display(), &error))
}

/// Brings the names in a directory to the disk, so that they survive a loss of power. File systems
/// that cannot do so bring them there in their own time.
pub fn sync_directory(directory: &Path) {
    let _ = File::open(directory).and_then(|it| it.sync_all());
}

/// Makes a directory and those above it, where they are missing.
///
/// # Errors
/// When the operating system refuses.
pub fn make_directory(path: &Path) -> Result<(), BadInput> {
    Made::directories(path).map(Made::keep)
}

/// Directories that were made for an output. Unless it succeeds, they are removed again.
#[derive(Debug, Default)]
pub struct Made {
    /// From the outermost to the innermost.
    directories: Vec<PathBuf>,
}

impl Made {
    /// Makes a directory and those above it, where they are missing.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn directories(path: &Path) -> Result<Self, BadInput> {
        Self::try_directories(path).map_err(|error| BadInput::io(path.display(), &error))
    }

    fn try_directories(path: &Path) -> std::io::Result<Self> {
        let mut made = Self::default();
        made.add(path)?;
        Ok(made)
    }

    fn add(&mut self, path: &Path) -> std::io::Result<()> {
        if path.exists() && !path.is_dir() {
            return Err(ErrorKind::NotADirectory.into());
        }
        let is_missing = |it: &&Path| !it.as_os_str().is_empty() && !it.exists();
        let missing: Vec<&Path> = path.ancestors().take_while(is_missing).collect();
        for directory in missing.into_iter().rev() {
            match private::make_directory(directory) {
                // Another program was faster, or the name has `..` in it.
                Err(error) if error.kind() == ErrorKind::AlreadyExists && directory.is_dir() => {}
                Err(error) => return Err(error),
                Ok(()) => self.directories.push(directory.to_owned()),
            }
        }
        Ok(())
    }

    /// The output is written: the directories stay.
    pub fn keep(mut self) {
        self.directories.clear();
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        for directory in self.directories.iter().rev() {
            // One that has something in it by now is not ours alone.
            let _ = std::fs::remove_dir(directory);
        }
    }
}

/// The directory of a file.
#[must_use]
pub fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
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

#[cfg(test)]
mod tests {
    use std::fs::Permissions;
    use std::io::Read as _;
    use std::os::fd::AsRawFd as _;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn mode(path: &Path) -> u32 {
        std::fs::metadata(path).unwrap().permissions().mode() & 0o777
    }

    fn entries(folder: &Path) -> usize {
        std::fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn a_file_that_cannot_be_written_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("view.png");
        replace(&path, b"old").unwrap();
        replace(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(entries(folder.path()), 1);
        let taken = folder.path().join("directory");
        std::fs::create_dir(&taken).unwrap();
        assert!(replace(&taken, b"new").is_err());
        assert_eq!(entries(folder.path()), 2);
    }

    #[test]
    fn a_device_is_written_to_and_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &path).unwrap();
        replace(&path, b"nothing").unwrap();
        write_all(&[(path.clone(), b"nothing".to_vec())], true).unwrap();
        assert_eq!(std::fs::read_link(&path).unwrap(), Path::new("/dev/null"));
    }

    /// As `--out /dev/stdout` before a `|`.
    #[test]
    fn a_pipe_that_the_system_names_is_written_to() {
        let (mut reader, writer) = std::io::pipe().unwrap();
        let path = PathBuf::from(format!("/proc/self/fd/{}", writer.as_raw_fd()));
        replace(&path, b"replace ").unwrap();
        write_all(&[(path.clone(), b"write_all ".to_vec())], true).unwrap();
        create(&path, true).unwrap().write_all(b"create ").unwrap();
        Late::new(&path, true).unwrap().write_all(b"late").unwrap();
        drop(writer);
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert_eq!(text, "replace write_all create late");
    }

    #[test]
    fn a_symbolic_link_stays_and_the_file_that_it_names_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("elsewhere")).unwrap();
        std::fs::write(at("elsewhere/file"), "old").unwrap();
        let linked = |link: &str, target: &str| {
            std::os::unix::fs::symlink(target, at(link)).unwrap();
            at(link)
        };
        let absolute = at("elsewhere/absolute").display().to_string();
        for (link, target, file) in [
            (linked("link", "elsewhere/file"), "elsewhere/file", "elsewhere/file"),
            (linked("elsewhere/chain", "../link"), "../link", "elsewhere/file"),
            // The files that these name do not exist yet.
            (linked("ahead", "elsewhere/new"), "elsewhere/new", "elsewhere/new"),
            (linked("absolute", &absolute), &absolute, "elsewhere/absolute"),
            (linked("deeper", "made/for/it"), "made/for/it", "made/for/it"),
        ] {
            for text in ["first", "second"] {
                replace(&link, text.as_bytes()).unwrap();
                assert_eq!(std::fs::read_to_string(at(file)).unwrap(), text, "{target}");
                write_all(&[(link.clone(), format!("{text} again").into())], true).unwrap();
                assert_eq!(std::fs::read_to_string(at(file)).unwrap(), format!("{text} again"));
            }
            assert_eq!(std::fs::read_link(&link).unwrap(), Path::new(target));
            assert_eq!(mode(&at(file)), 0o600, "{target}");
        }
        // What is written as it comes, too.
        for (link, file) in [("early", "by/and/by"), ("late", "bye/and/bye")] {
            let link = linked(link, file);
            for force in [false, true] {
                let mut late = Late::new(&link, force).unwrap();
                assert!(force || !at(file).exists());
                late.write_all(b"late").unwrap();
                std::fs::remove_file(at(file)).unwrap();
                create(&link, force).unwrap().write_all(b"now").unwrap();
                assert_eq!(std::fs::read_to_string(at(file)).unwrap(), "now");
                assert!(create(&link, false).unwrap_err().to_string().contains("--force"));
                std::fs::remove_file(at(file)).unwrap();
            }
            assert_eq!(std::fs::read_link(&link).unwrap(), Path::new(file));
        }
        // A link to itself leads nowhere.
        let circle = linked("circle", "circle");
        assert!(replace(&circle, b"new").unwrap_err().to_string().contains("circle"));
        assert!(write_all(&[(circle.clone(), Vec::new())], true).is_err());
        assert_eq!(std::fs::read_link(&circle).unwrap(), Path::new("circle"));
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
    }

    #[test]
    fn directories_above_an_output_are_made_and_are_private() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        create(&at("a/b/poses.csv"), false).unwrap();
        write_all(&[(at("c/d/p.json"), b"{}".to_vec())], false).unwrap();
        replace(&at("e/f.png"), b"picture").unwrap();
        make_directory(&at("g/h")).unwrap();
        make_directory(&at("g/h")).unwrap();
        for directory in ["a", "a/b", "c/d", "e", "g/h"] {
            assert_eq!(mode(&at(directory)), 0o700, "{directory}");
        }
        // A file is in the directory's place.
        let error = make_directory(&at("e/f.png")).unwrap_err().to_string();
        assert!(error.contains("f.png: not a directory; a directory belongs here"), "{error}");
        let error = create(&at("e/f.png/g/h.csv"), false).unwrap_err().to_string();
        assert!(error.contains("a file is in its place"), "{error}");
    }

    #[test]
    fn an_output_that_fails_leaves_no_directory() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        drop(Late::new(&at("a/b/samples.csv"), false).unwrap());
        assert_eq!(entries(folder.path()), 0);
        let fails = |_: &File| Err(BadInput::whole("disk", "full", "make room"));
        assert!(replace_with(&at("a/b.csv"), fails).is_err());
        // The second file's directory would lie in the first file.
        std::fs::write(at("file"), "").unwrap();
        let outputs = [at("new/a.json"), at("file/b.json")].map(|path| (path, Vec::new()));
        assert!(write_all(&outputs, true).is_err());
        assert_eq!(entries(folder.path()), 1);
        Late::new(&at("a/b/samples.csv"), false).unwrap().write_all(b"row\n").unwrap();
        assert_eq!(mode(&at("a/b")), 0o700);
        assert_eq!(mode(&at("a/b/samples.csv")), 0o600);
    }

    /// The test runs under the usual umask of 022, and some files are there with 0644 before.
    #[test]
    fn every_way_to_write_gives_the_file_to_its_owner_alone() {
        type Way = fn(&Path);
        let ways: [(&str, Way); 6] = [
            ("create", |path| drop(create(path, true).unwrap())),
            ("late", |path| Late::new(path, true).unwrap().write_all(b"row").unwrap()),
            ("write_all", |path| write_all(&[(path.to_owned(), vec![1])], true).unwrap()),
            ("replace", |path| replace(path, b"new").unwrap()),
            ("replace_with", |path| replace_with(path, |_| Ok(())).unwrap()),
            ("write_text", |path| write_text(path, "new").unwrap()),
        ];
        let folder = tempfile::tempdir().unwrap();
        for (name, way) in ways {
            let [new, old] = ["new", "old"].map(|it| folder.path().join(format!("{name}-{it}")));
            std::fs::write(&old, "readable by all").unwrap();
            std::fs::set_permissions(&old, Permissions::from_mode(0o644)).unwrap();
            for path in [new, old] {
                way(&path);
                assert_eq!(mode(&path), 0o600, "{}", path.display());
            }
        }
    }
}
