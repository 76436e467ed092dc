//! Files and directories for their owner alone.
//!
//! On Unix by their modes: 0600 for files, 0700 for directories, whatever the umask. On Windows what
//! is made has the access rights of the folder that it is made in: those of a user's own folders,
//! where the keys are too, let in nobody else but the computer's administrators.

use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, ErrorKind};
use std::path::Path;

/// Options that open a file to be made for its owner alone. One that is there keeps its rights.
#[must_use]
pub fn options() -> OpenOptions {
    let mut options = File::options();
    system::restrict(&mut options);
    options
}

/// Takes away from others what they may do with a file. Devices and pipes stay as they are.
///
/// # Errors
/// When the operating system refuses.
pub(crate) fn own_file(file: &File) -> io::Result<()> {
    if !file.metadata()?.is_file() {
        return Ok(());
    }
    or_without_owners(system::own_file(file))
}

/// Makes a directory for its owner alone.
///
/// # Errors
/// When the operating system refuses.
pub(crate) fn make_directory(path: &Path) -> io::Result<()> {
    system::make_directory(path)?;
    // The umask may have taken from the owner as well.
    or_without_owners(system::own_directory(path))
}

/// The mode of a file or directory that others can use; `None` where they cannot, or where modes do
/// not tell.
#[must_use]
pub fn shared_mode(metadata: &Metadata) -> Option<u32> {
    system::shared_mode(metadata)
}

/// On file systems without owners, such as those of cards and some networks, nothing can be kept
/// from anybody: that is no reason to write nothing.
fn or_without_owners(outcome: io::Result<()>) -> io::Result<()> {
    match outcome {
        Err(error)
            if matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::Unsupported) =>
        {
            Ok(())
        }
        outcome => outcome,
    }
}

#[cfg(unix)]
mod system {
    use std::fs::{self, DirBuilder, File, Metadata, OpenOptions, Permissions};
    use std::io;
    use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _, PermissionsExt as _};
    use std::path::Path;

    const FILE_MODE: u32 = 0o600;
    const DIRECTORY_MODE: u32 = 0o700;

    pub(super) fn restrict(options: &mut OpenOptions) {
        options.mode(FILE_MODE);
    }

    pub(super) fn own_file(file: &File) -> io::Result<()> {
        file.set_permissions(Permissions::from_mode(FILE_MODE))
    }

    pub(super) fn make_directory(path: &Path) -> io::Result<()> {
        DirBuilder::new().mode(DIRECTORY_MODE).create(path)
    }

    pub(super) fn own_directory(path: &Path) -> io::Result<()> {
        fs::set_permissions(path, Permissions::from_mode(DIRECTORY_MODE))
    }

    pub(super) fn shared_mode(metadata: &Metadata) -> Option<u32> {
        let mode = metadata.permissions().mode() & 0o777;
        (mode & 0o077 != 0).then_some(mode)
    }
}

#[cfg(not(unix))]
mod system {
    use std::fs::{self, File, Metadata, OpenOptions};
    use std::io;
    use std::path::Path;

    pub(super) fn restrict(_: &mut OpenOptions) {}

    pub(super) fn own_file(_: &File) -> io::Result<()> {
        Ok(())
    }

    pub(super) fn make_directory(path: &Path) -> io::Result<()> {
        fs::create_dir(path)
    }

    pub(super) fn own_directory(_: &Path) -> io::Result<()> {
        Ok(())
    }

    pub(super) fn shared_mode(_: &Metadata) -> Option<u32> {
        None
    }
}
