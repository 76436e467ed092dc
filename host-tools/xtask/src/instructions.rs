//! How many instructions the box's processor executes: a count, which is the same on every machine,
//! however busy.
//!
//! QEMU emulates a whole 64-bit ARM board and advances its clock by one nanosecond per instruction
//! (`-icount shift=0`). `plumbline-bench` measures with that clock what it otherwise measures with
//! this machine's, so its microseconds are thousands of instructions. It is the only program on the
//! board; what the kernel does in between, mostly timer interrupts, is included.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use crate::command::{Task, target_directory};
use crate::cross::{Linking, Target};
use crate::image::{Archive, DebianRoot};

/// The number of frames: they are in the emulated board's memory, and a search takes seconds there.
pub const FRAMES: u32 = 16;

/// The time limit for the emulator, in seconds; a run takes one or two minutes.
const WITHIN_S: &str = "900";

/// Runs `plumbline-bench` on a board with the recording in `directory`, and passes its lines to
/// `each_line`.
pub fn count(debian: &DebianRoot, directory: &Path, each_line: impl FnMut(&str)) -> Result<()> {
    let toolchain = Target::Aarch64.toolchain()?;
    toolchain
        .cargo(Linking::Static)
        .args(["build", "--release", "--package", "plumbline-bench"])
        .run()?;
    let read = |path: &Path| fs::read(path).with_context(|| path.display().to_string());
    let mut archive = Archive::default();
    let program = toolchain.programs(Linking::Static, "release").join("plumbline-bench");
    archive.program("init", read(&program)?);
    for name in ["box.plb", "frames.y4m", "truth.csv"] {
        archive.file(&format!("recording/{name}"), read(&directory.join(name))?);
    }
    let initramfs = target_directory().join("instructions.cpio");
    fs::write(&initramfs, archive.to_bytes()?).with_context(|| initramfs.display().to_string())?;
    // The machine stops when its only program ends: without a process 1 the kernel panics, and
    // restarts at once.
    Task::new("timeout")
        .args([WITHIN_S, "qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72", "-smp", "1"])
        .args(["-m", "512", "-icount", "shift=0", "-nographic", "-no-reboot", "-nic", "none"])
        .args(["-append", "console=ttyAMA0 quiet panic=-1 rdinit=/init -- /recording", "-kernel"])
        .args([&debian.kernel_path()?, Path::new("-initrd"), &initramfs])
        .run_and_read(each_line)?;
    fs::remove_file(&initramfs).with_context(|| initramfs.display().to_string())
}
