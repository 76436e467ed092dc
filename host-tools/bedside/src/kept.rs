//! Where this program keeps on this computer what belongs neither to a box nor to a trial.

use std::path::PathBuf;

use plumbline_files::BadInput;

/// The folder for one kind of what is kept, among this user's data, by the XDG Base Directory
/// Specification.
///
/// # Errors
/// When this user has no home directory.
pub fn folder(kind: &str) -> Result<PathBuf, BadInput> {
    let data = std::env::var_os("XDG_DATA_HOME").map(PathBuf::from).filter(|it| it.is_absolute());
    let home = || std::env::home_dir().map(|home| home.join(".local/share"));
    let data = data.or_else(home).ok_or_else(|| {
        BadInput::whole("HOME", "this user has no home directory", "set XDG_DATA_HOME")
    })?;
    Ok(data.join("plumbline").join(kind))
}
