//! What people install of the host: the program, its pages for man and completions for shells, the
//! licences; on Linux also the box's program, which `plumb demo` starts.
//!
//! An archive has the layout of /usr/local, into which it can be unpacked:
//!
//! ```text
//! bin/plumb                    share/man/man1/plumb*.1
//! lib/plumb/plumbline-board    share/bash-completion/completions/plumb, share/zsh/..., share/fish/...
//! ```

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::linked;
use super::platform::{Builder, MINGW_GCC, Platform};
use super::sbom::Contents;
use super::tree::Tree;
use crate::command::{Task, root};

/// The programs of a platform, built.
#[derive(Debug)]
pub struct Programs {
    /// Everything below a prefix such as /usr.
    pub tree: Tree,
    /// Where `plumb` was built.
    pub plumb: PathBuf,
    pub contents: Contents,
}

impl Programs {
    /// Builds them. `manual` is a directory that `plumb manual` has written.
    pub fn build(builder: &Builder, manual: &Path) -> Result<Self> {
        let platform = builder.platform;
        let mut tree = Tree::default();
        let plumb = builder.plumb()?;
        let bytes = fs::read(&plumb).with_context(|| plumb.display().to_string())?;
        let contents = Contents::of_crates("plumb", platform.triple(), &[])?
            .with_standard_library(&builder.compiler_version()?);
        let mut contents = linked::with_page(contents)?;
        if platform.is_windows() {
            tree.program("plumb.exe", bytes);
            tree.copy("_plumb.ps1", &manual.join("completions/_plumb.ps1"))?;
            let libraries = ["libmingw32.a", "libgcc.a"];
            contents = contents.with_linked(&linked::packages(MINGW_GCC, &libraries)?);
        } else {
            tree.program("bin/plumb", bytes);
            add_manual(&mut tree, manual)?;
        }
        if platform.is_linux() {
            let board = builder.board()?;
            let board = fs::read(&board).with_context(|| board.display().to_string())?;
            tree.program("lib/plumb/plumbline-board", board);
            contents =
                contents.and(Contents::of_crates("plumbline-board", platform.triple(), &[])?);
            let libraries = ["libc.a", "libgcc.a"];
            contents = contents.with_linked(&linked::packages(platform.gcc(), &libraries)?);
        }
        Ok(Self { tree, plumb, contents })
    }

    /// The archive for people without a package manager, and how its name ends.
    pub fn to_archive(&self, platform: Platform, top: &str, seconds: u64) -> Result<Vec<u8>> {
        let mut tree = self.tree.clone();
        let documents = if platform.is_windows() { "" } else { "share/doc/plumb/" };
        for name in ["LICENSE-APACHE", "LICENSE-MIT"] {
            tree.copy(format!("{documents}{name}"), &root().join(name))?;
        }
        if platform.is_windows() { tree.to_zip(top) } else { tree.to_tar_gz(top, seconds) }
    }
}

/// Where systems look for pages and completions, below a prefix.
fn add_manual(tree: &mut Tree, manual: &Path) -> Result<()> {
    for entry in fs::read_dir(manual.join("man1")).context("the pages for man")? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        tree.copy(format!("share/man/man1/{name}"), &path)?;
    }
    for (name, place) in [
        ("plumb.bash", "share/bash-completion/completions/plumb"),
        ("_plumb", "share/zsh/vendor-completions/_plumb"),
        ("plumb.fish", "share/fish/vendor_completions.d/plumb.fish"),
    ] {
        tree.copy(place, &manual.join("completions").join(name))?;
    }
    Ok(())
}

/// Has a `plumb` that runs on this computer write its pages and completions to a directory.
pub fn write_manual(plumb: &Path, directory: &Path) -> Result<()> {
    if directory.exists() {
        fs::remove_dir_all(directory).with_context(|| directory.display().to_string())?;
    }
    Task::new(plumb).args(["manual", "--out"]).args([directory]).run()
}
