//! What the tests add to the initramfs: a second archive that the kernel unpacks
//! over it, so that the one that is tested is the one that ships.
//!
//! `/test/start` (package `tests/guest`) becomes the first process; it sets up
//! vivid as a camera and then starts `/init`.

use std::path::Path;

use anyhow::Result;

use super::archive::Archive;
use super::debian_root::DebianRoot;
use super::{initramfs, modules};

/// One capture and one output device, both HDMI: the only signal that vivid
/// loops from the one to the other at any size.
const VIVID_OPTIONS: &str =
    "n_devs=1 node_types=0x101 num_outputs=1 output_types=1 num_inputs=1 input_types=3";

/// Makes the overlay with `guest` as the first process, and `init`, where it is
/// given, in place of the box's own program.
pub fn make(debian: &DebianRoot, guest: &Path, init: Option<&Path>) -> Result<Vec<u8>> {
    let mut root = Archive::default();
    root.program("test/start", initramfs::stripped(guest)?);
    let list = modules::add(&mut root, debian, &["vivid".to_owned()], "test/modules.d")?;
    // What vivid needs comes before it, and so its options end the list.
    root.file("test/modules", format!("{} {VIVID_OPTIONS}\n", list.join("\n")).into_bytes());
    if let Some(init) = init {
        root.program("init", initramfs::stripped(init)?);
    }
    root.to_bytes()
}
