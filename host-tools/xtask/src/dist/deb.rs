//! The Debian package of the host, for every Debian and Ubuntu with a C library that is new enough.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use flate2::{Compression, GzBuilder};

use super::host::Programs;
use super::platform::{Builder, work};
use super::tree::Tree;
use crate::command::root;
use crate::commit::Commit;
use crate::debian;

/// The name of the package's file.
pub fn name(architecture: &str) -> String {
    format!("plumb_{}_{architecture}.deb", debian::VERSION)
}

/// Makes the package `out`.
pub fn make(builder: &Builder, programs: &Programs, commit: &Commit, out: &Path) -> Result<()> {
    let sources = root().join("host-tools/plumb/deb");
    let source = |name: &str| {
        let path = sources.join(name);
        fs::read_to_string(&path).with_context(|| path.display().to_string())
    };
    let mut tree = installed(&programs.tree)?;
    tree.file("usr/share/applications/plumb-desk.desktop", source("plumb-desk.desktop")?);
    let copyright = source("copyright")? + &debian::expat()?;
    tree.file("usr/share/doc/plumb/copyright", copyright);
    let architecture = builder.platform.debian();
    let control = source("control")?
        .replace("@VERSION@", debian::VERSION)
        .replace("@ARCHITECTURE@", architecture)
        .replace("@INSTALLED_KIB@", &tree.kib().to_string())
        .replace("@DEPENDS@", &debian::depends("readelf", &programs.plumb, &[])?);
    tree.file("DEBIAN/control", control);
    let directory = work().join(format!("deb-{architecture}"));
    if directory.exists() {
        fs::remove_dir_all(&directory).with_context(|| directory.display().to_string())?;
    }
    tree.write_to(&directory)?;
    debian::pack(&directory, out, &commit.epoch())
}

/// The files below /usr, the pages for man compressed as Debian wants them.
fn installed(programs: &Tree) -> Result<Tree> {
    let mut tree = Tree::default();
    for (name, is_program, bytes) in programs.files() {
        let place = format!("usr/{name}");
        if name.starts_with("share/man/") {
            let mut encoder = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
            encoder.write_all(bytes)?;
            tree.file(place + ".gz", encoder.finish()?);
        } else if is_program {
            tree.program(place, bytes);
        } else {
            tree.file(place, bytes);
        }
    }
    Ok(tree)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_compressed_and_the_rest_is_as_it_was() {
        let mut tree = Tree::default();
        tree.program("bin/plumb", "run");
        tree.file("share/man/man1/plumb.1", "page");
        let installed = installed(&tree).unwrap();
        let names: Vec<_> = installed.files().map(|(name, is, _)| (name.to_owned(), is)).collect();
        let expected = [("usr/bin/plumb", true), ("usr/share/man/man1/plumb.1.gz", false)];
        assert_eq!(names, expected.map(|(name, is)| (name.to_owned(), is)));
    }

    #[test]
    fn every_word_of_the_control_file_is_filled_in() {
        let control = fs::read_to_string(root().join("host-tools/plumb/deb/control")).unwrap();
        let filled = ["VERSION", "ARCHITECTURE", "INSTALLED_KIB", "DEPENDS"];
        let left = filled.iter().fold(control, |text, word| text.replace(&format!("@{word}@"), ""));
        assert_eq!(left.matches('@').count(), 1, "the maintainer's alone: {left}");
    }
}
