//! What the tests add to the initramfs: a second archive that the kernel unpacks over it, so that
//! the initramfs under test is the one that ships.
//!
//! `/test/start` (package `tests/guest`) becomes the first process; it sets up
//! vivid as a camera, or plugs a virtual camera into a virtual USB port, and then starts `/init`.
//!
//! For libcamera there is another overlay: the program with libcamera as `/init`, and the Debian
//! files that it needs. There, libcamera's own virtual camera plays pictures, which the test adds
//! in a separate archive.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::archive::Archive;
use super::debian_root::DebianRoot;
use super::{initramfs, modules};
use crate::command::Task;

/// One capture and one output device, both HDMI: the only signal that vivid loops from one to the
/// other at any size.
const VIVID_OPTIONS: &str =
    "n_devs=1 node_types=0x101 num_outputs=1 output_types=1 num_inputs=1 input_types=3";

/// What the guest loads, each list by its name: the modules, and options for the last one.
///
/// The third is a serial modem and the USB port that it is plugged into, all in the one kernel.
const MODULES: [(&str, &[&str], &str); 3] = [
    ("vivid", &["vivid"], VIVID_OPTIONS),
    ("usb", &["vhci-hcd"], ""),
    ("modem", &["cdc-acm", "dummy_hcd", "usb_f_acm", "g_serial"], ""),
];

/// Makes the overlay with `guest` as the first process.
pub fn make(debian: &DebianRoot, guest: &Path) -> Result<Vec<u8>> {
    let mut root = Archive::default();
    root.program("test/start", initramfs::stripped(guest)?);
    // The modules that one needs come before it, so its options end its list.
    for (name, modules, options) in MODULES {
        let directory = format!("test/modules.d/{name}");
        let modules: Vec<String> = modules.iter().map(|&it| it.to_owned()).collect();
        let list = modules::add(&mut root, debian, None, &modules, &directory)?;
        let list = format!("{} {options}\n", list.join("\n"));
        root.file(&format!("test/modules.{name}"), list.into_bytes());
    }
    root.to_bytes()
}

/// The directory in which Debian has shared libraries and the loader looks for them.
pub const LIBRARIES: &str = "usr/lib/aarch64-linux-gnu";

/// The virtual camera: it plays the JPEG files of a directory at 30 frames per second.
const VIRTUAL_CAMERA: &str = "\
\"Virtual0\":
  supported_formats:
  - width: 1280
    height: 720
    frame_rates: [30, 30]
  frames:
    path: \"/frames/\"
  location: \"CameraLocationFront\"
  model: \"Virtual Video Device\"
";

/// Makes the overlay with `program`, built with libcamera, as `/init`.
pub fn make_with_libcamera(debian: &DebianRoot, program: &Path) -> Result<Vec<u8>> {
    let mut root = Archive::default();
    root.program("init", initramfs::stripped(program)?);
    root.program("lib/ld-linux-aarch64.so.1", debian.read("usr/lib/ld-linux-aarch64.so.1")?);
    for library in libraries(debian, program)? {
        let name = format!("{LIBRARIES}/{library}");
        root.program(&name, debian.read(&name)?);
    }
    // Its image processing modules and their signatures: unsigned modules run in a process of their
    // own.
    let own = debian.path().join(LIBRARIES).join("libcamera");
    for entry in fs::read_dir(&own).with_context(|| own.display().to_string())? {
        let name = format!("{LIBRARIES}/libcamera/{}", entry?.file_name().to_string_lossy());
        root.program(&name, debian.read(&name)?);
    }
    let camera = "usr/share/libcamera/pipeline/virtual/virtual.yaml";
    root.file(camera, VIRTUAL_CAMERA.into());
    root.to_bytes()
}

/// The shared libraries that a program needs, directly or indirectly: their names in [`LIBRARIES`].
pub fn libraries(debian: &DebianRoot, program: &Path) -> Result<BTreeSet<String>> {
    let (mut found, mut to_do) = (BTreeSet::new(), vec![program.to_owned()]);
    while let Some(path) = to_do.pop() {
        let listing = Task::new("aarch64-linux-gnu-readelf")
            .args(["--wide", "--dynamic"])
            .args([&path])
            .output()?;
        for line in listing.lines().filter(|line| line.contains("(NEEDED)")) {
            let name = line.split(['[', ']']).nth(1).context("a NEEDED without a name")?;
            if name.starts_with("ld-linux") {
                continue;
            }
            // systemd keeps its own in a directory of their own.
            let is_of_systemd =
                ["libsystemd-core-", "libsystemd-shared-"].iter().any(|it| name.starts_with(it));
            let name = if is_of_systemd { format!("systemd/{name}") } else { name.to_owned() };
            if found.insert(name.clone()) {
                to_do.push(debian.path().join(LIBRARIES).join(name));
            }
        }
    }
    Ok(found)
}
