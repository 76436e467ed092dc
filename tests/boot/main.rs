//! The box's image, booted under QEMU, seen from outside as a host and a
//! technician see it.
//!
//! The kernel and the initramfs are the ones that ship, but for the program's optimisation and two
//! words on the kernel's command line that make it hang or panic. A second archive adds
//! `/test/start` (package `tests/guest`), which makes the kernel's own test driver
//! vivid a camera that sees a rendered scene, and then starts the box's program.
//!
//! Most tests boot QEMU's own board `virt`, which has everything; `pi` boots the SD card in an
//! emulated Raspberry Pi 4.
//!
//! `cargo xtask test boot` makes what is booted and runs this.

mod machine;
mod scene;

mod another_system;
mod configuration;
mod endurance;
mod first_trial;
mod formats;
mod libcamera;
mod modem_line;
mod package;
mod pairing;
mod pi;
mod poses;
mod provisioning;
mod strangers;
mod trigger;
mod trouble;

use std::path::Path;

use machine::{Host, Machine, Parts, image};
use scene::SCENE;

/// Boots with vivid playing the scene; `more` goes to the kernel's command line.
fn boot_with_camera(host: &Host, boot_disk: &Path, more: &str) -> Machine {
    boot_with_disk(host, boot_disk, "", more)
}

/// The same with a boot disk that QEMU emulates in its own way.
fn boot_with_disk(host: &Host, boot_disk: &Path, boot_disk_options: &str, more: &str) -> Machine {
    let parts = Parts {
        kernel: image("vmlinuz"),
        initramfs: vec![image("initramfs"), image("overlay.cpio")],
        command_line: &format!("rdinit=/test/start {more}"),
        boot_disk,
        boot_disk_options,
        frames_disk: Some(&SCENE.frames_disk),
        device_tree: None,
    };
    Machine::start(&parts, host)
}
