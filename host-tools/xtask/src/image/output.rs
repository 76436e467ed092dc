//! The output of an image. It is first made under another name: if that fails, an earlier image is
//! left unchanged.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::command::BadInput;

/// Checks that `out` can become a directory or, if not `is_directory`, a file.
pub fn check(out: &Path, is_directory: bool) -> Result<()> {
    let bad = |path: &Path, found: &str, remedy: &str| {
        bail!(BadInput(format!("--out: {} {found}; {remedy}", path.display())))
    };
    match fs::metadata(out) {
        Ok(there) if is_directory && !there.is_dir() => {
            bad(out, "is a file", "this image is a directory: give another name")
        }
        Ok(there) if !is_directory && there.is_dir() => {
            bad(out, "is a directory", "give the name of a file in it")
        }
        Ok(there) if !is_directory && !there.is_file() => {
            bad(out, "is a device", "give a file, and write it to the card afterwards")
        }
        Ok(_) => Ok(()),
        Err(_) => match out.ancestors().skip(1).find(|path| path.exists()) {
            Some(above) if !above.is_dir() => {
                bad(above, "is a file", "a directory belongs there: give another name")
            }
            _ => Ok(()),
        },
    }
}

/// Makes the file `out`, and the directories above it.
pub fn file(out: &Path, make: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    if let Some(directory) = out.parent() {
        fs::create_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    let unfinished = unfinished(out);
    let made = make(&unfinished)
        .and_then(|()| fs::rename(&unfinished, out).with_context(|| out.display().to_string()));
    if made.is_err() {
        // It may not exist.
        let _ = fs::remove_file(&unfinished);
    }
    made
}

/// Makes files in the directory `out`, which may contain others.
pub fn directory(out: &Path, make: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let unfinished = out.join("unfinished");
    // Left by a run that was killed.
    let _ = fs::remove_dir_all(&unfinished);
    fs::create_dir(&unfinished).with_context(|| unfinished.display().to_string())?;
    let made = make(&unfinished).and_then(|()| {
        for entry in fs::read_dir(&unfinished)? {
            let entry = entry?;
            let place = out.join(entry.file_name());
            fs::rename(entry.path(), &place).with_context(|| place.display().to_string())?;
        }
        Ok(())
    });
    let _ = fs::remove_dir_all(&unfinished);
    made
}

fn unfinished(out: &Path) -> PathBuf {
    let mut name = OsString::from(out);
    name.push(".unfinished");
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fails_leaves_the_earlier_one_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let (card, image) = (folder.path().join("a/card.img"), folder.path().join("image"));
        let whole = |path: &Path| Ok(fs::write(path, "whole")?);
        file(&card, whole).unwrap();
        directory(&image, |path| whole(&path.join("kernel"))).unwrap();
        let half = |path: &Path| {
            fs::write(path, "half")?;
            bail!("no room")
        };
        assert!(file(&card, half).is_err());
        assert!(directory(&image, |path| half(&path.join("kernel"))).is_err());
        let names = |path: &Path| -> Vec<_> {
            fs::read_dir(path).unwrap().map(|entry| entry.unwrap().file_name()).collect()
        };
        assert_eq!(names(card.parent().unwrap()), ["card.img"]);
        assert_eq!(names(&image), ["kernel"]);
        for path in [card, image.join("kernel")] {
            assert_eq!(fs::read_to_string(path).unwrap(), "whole");
        }
    }

    #[test]
    fn a_place_that_cannot_be_had_is_named_with_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        for (out, is_directory, found) in [
            (file.clone(), true, "file is a file"),
            (file.join("image/virt"), true, "file is a file"),
            (folder.path().to_owned(), false, "is a directory"),
            ("/dev/null".into(), false, "/dev/null is a device"),
        ] {
            let error = check(&out, is_directory).unwrap_err();
            assert!(error.is::<BadInput>());
            let error = error.to_string();
            assert!(error.contains(found) && error.contains("; "), "{error}");
        }
        check(&file, false).unwrap();
        check(folder.path(), true).unwrap();
        check(&folder.path().join("new/image"), true).unwrap();
    }
}
