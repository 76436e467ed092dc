//! The key of a test's box, where `plumb` and the box's program look for it.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use plumbline::seal::{KEY_FILE_NAME, Key};
use plumbline_stream::fixture::key;

/// What `plumb` keeps for a user, in the tests that run in a directory.
pub fn data(directory: &Path) -> PathBuf {
    directory.join("data")
}

/// `plumb` knows the box of tests in this directory, and a box whose configuration is in it has the
/// key.
pub fn known(directory: &Path) {
    know(directory, &key(), "ward 3", "PL-0001");
    std::fs::write(directory.join(KEY_FILE_NAME), key().text().as_str()).unwrap();
}

/// `plumb` knows a box in this directory.
pub fn know(directory: &Path, key: &Key, name: &str, serial_number: &str) {
    let folder = data(directory).join("plumbline/keys");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::set_permissions(&folder, Permissions::from_mode(0o700)).unwrap();
    let file = folder.join(format!("{}.toml", key.id()));
    let text = format!(
        "key = \"{}\"\nname = \"{name}\"\nserial_number = \"{serial_number}\"\n\
         made = \"2026-01-01T00:00:00Z\"\n",
        key.text().as_str()
    );
    std::fs::write(&file, text).unwrap();
    std::fs::set_permissions(&file, Permissions::from_mode(0o600)).unwrap();
}
