//! How many instructions the box's processor needs: a count, so that it is the
//! same on every machine, however busy.
//!
//! QEMU emulates a whole 64-bit ARM board and advances its clock by one
//! nanosecond per instruction (`-icount shift=0`). `plumbline-bench` measures
//! with that clock what it measures with this machine's own, and its
//! microseconds are thousands of instructions. It is the only program on the
//! board; what the kernel does in between, mostly its timer's interrupts, is
//! counted too and adds less than one percent.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use crate::command::{Task, quoted, target_directory};
use crate::cross::{Linking, Target};
use crate::setup::{self, Need, Probe};

/// QEMU and what packs its first root file system.
const NEEDS: &[Need] = &[
    Need {
        probe: Probe::Program("qemu-system-aarch64"),
        package: "qemu-system-arm",
        why: "emulates a whole board with a 64-bit ARM processor",
    },
    Need { probe: Probe::Program("cpio"), package: "cpio", why: "packs a board's first files" },
];

/// The frames are in the emulated board's memory, and a search takes seconds there.
pub const FRAMES: u32 = 16;

/// Longest run of the emulator, in seconds; it takes one or two minutes.
const WITHIN_S: &str = "900";

/// Installs what is missing.
pub fn prepare() -> Result<()> {
    Target::Aarch64.prepare()?;
    setup::ensure(&[NEEDS])
}

/// Runs `plumbline-bench` on a board that starts `kernel`, with the recording in
/// `directory`, and hands its lines to `each_line`.
pub fn count(kernel: &Path, directory: &Path, each_line: impl FnMut(&str)) -> Result<()> {
    let toolchain = Target::Aarch64.toolchain()?;
    toolchain
        .cargo(Linking::Static)
        .args(["build", "--release", "--package", "plumbline-bench"])
        .run()?;
    let root = target_directory().join("instructions");
    let recording = root.join("recording");
    fs::create_dir_all(&recording).with_context(|| recording.display().to_string())?;
    let copy = |from: &Path, to: &Path| {
        fs::copy(from, to).with_context(|| format!("{} to {}", from.display(), to.display()))
    };
    copy(
        &toolchain.programs(Linking::Static, "release").join("plumbline-bench"),
        &root.join("init"),
    )?;
    for name in ["box.plb", "frames.y4m", "truth.csv"] {
        copy(&directory.join(name), &recording.join(name))?;
    }
    let archive = root.with_extension("cpio");
    let pack =
        format!("find . | cpio --quiet --create --format=newc >{}", quoted(archive.as_ref()));
    let root = quoted(root.as_ref());
    Task::new("sh").args(["-c", &format!("cd {root} && {pack}")]).run()?;
    // The machine ends when its only program does: without a process 1 the kernel
    // panics, and restarts at once.
    Task::new("timeout")
        .args([WITHIN_S, "qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72", "-smp", "1"])
        .args(["-m", "512", "-icount", "shift=0", "-nographic", "-no-reboot", "-nic", "none"])
        .args(["-append", "console=ttyAMA0 quiet panic=-1 rdinit=/init -- /recording", "-kernel"])
        .args([kernel, "-initrd".as_ref(), &archive])
        .run_and_read(each_line)?;
    fs::remove_file(&archive).with_context(|| archive.display().to_string())
}
