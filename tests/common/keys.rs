//! The keys that `plumb` has in the tests that run in a directory.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use plumbline::seal::Key;

/// What `plumb` keeps for a user, in the tests that run in a directory.
pub fn data(directory: &Path) -> PathBuf {
    directory.join("data")
}

/// `plumb` knows the box of this key in this directory.
pub fn know(directory: &Path, key: &Key) {
    let folder = data(directory).join("plumbline/keys");
    std::fs::create_dir_all(&folder).expect("there is room");
    let only_owner = |path: &Path, mode| {
        std::fs::set_permissions(path, Permissions::from_mode(mode)).expect("it is ours");
    };
    only_owner(&folder, 0o700);
    let file = folder.join(format!("{}.toml", key.id()));
    let text = format!("key = \"{}\"\nmade = \"2026-01-01T00:00:00Z\"\n", key.text().as_str());
    std::fs::write(&file, text).expect("there is room");
    only_owner(&file, 0o600);
}
