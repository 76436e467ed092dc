//! Where this program keeps on this computer what belongs neither to a box nor to a trial.

use std::path::PathBuf;

use plumbline_files::BadInput;

/// The folder for one kind of what is kept, among this user's data: by the XDG Base Directory
/// Specification, and on Windows where programs keep what stays on one computer, unless
/// `XDG_DATA_HOME` names another place.
///
/// # Errors
/// When this user has no home directory.
pub fn folder(kind: &str) -> Result<PathBuf, BadInput> {
    let data = std::env::var_os("XDG_DATA_HOME").map(PathBuf::from).filter(|it| it.is_absolute());
    let data = data.or_else(of_user).ok_or_else(|| {
        BadInput::whole("HOME", "this user has no home directory", "set XDG_DATA_HOME")
    })?;
    Ok(data.join("plumbline").join(kind))
}

/// Where the system keeps the data of this user's programs.
fn of_user() -> Option<PathBuf> {
    if cfg!(windows) {
        return std::env::var_os("LOCALAPPDATA").map(PathBuf::from).filter(|it| it.is_absolute());
    }
    std::env::home_dir().map(|home| home.join(".local/share"))
}
