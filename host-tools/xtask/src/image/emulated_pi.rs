//! What an emulated Raspberry Pi 4 needs besides the card: an emulator that has this machine, and a
//! device tree of the hardware that it emulates.
//!
//! QEMU has had the machine `raspi4b` since version 9, and Debian since trixie. If the system's own
//! emulator lacks it, trixie's is fetched like the ARM packages and run by its own loader with its
//! own libraries: nothing is installed.
//!
//! The device tree is the card's own for a Pi 4 Model B, changed where QEMU 10 differs from a Pi:
//!
//! | node | change | because |
//! |---|---|---|
//! | the display's, `txp` to `gpu` | off | not emulated |
//! | `bluetooth` | off | the PL011 serial line ends in the test instead |
//! | mini UART | off | its interrupt never ends once a process has written to it |
//! | the power LED | gone | it hangs on the firmware's pins, which QEMU refuses; the green LED would go with it |
//! | `mmc@7e300000`, the radio's | a slot for a card | QEMU has its card there, and not at `emmc2` |
//! | power management | in memory | QEMU resets the machine as soon as the watchdog is *started*; the tests play the registers, as the hardware does |
//! | `/chosen/framebuffer` | new | as the firmware adds it where there is a screen |
//!
//! QEMU itself removes PCIe, Ethernet, the thermal sensor and the random number generator.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::debian_root::RELEASE;
use super::here::{Here, write_script};
use super::unpacked::unpack;
use crate::command::{Task, quoted, target_directory};
use crate::setup::{Need, Probe};

/// The machine's name in QEMU.
const MACHINE: &str = "raspi4b";

/// The packages fetched if the system's QEMU is older.
const PACKAGES: &[&str] = &["qemu-system-arm"];

/// The tools needed for both.
pub const NEEDS: &[Need] = &[
    Need {
        probe: Probe::Program("fdtput"),
        package: "device-tree-compiler",
        why: "fits the Raspberry Pi's device tree to what QEMU emulates",
    },
    Need {
        probe: Probe::Program("fdtget"),
        package: "device-tree-compiler",
        why: "reads device trees",
    },
];

/// An address beyond the memory reported to the kernel, which ends at 0x3c000000, but inside the
/// emulated memory. `tests/boot/pi/power_management.rs` simulates the registers there.
const POWER_MANAGEMENT: u32 = 0x3e00_0000;

/// The address of QEMU's frame buffer after a reset: 640 x 480 pixels of 16 bits.
const FRAME_BUFFER: u32 = 0x3c10_0000;

/// Nodes below `/soc` that QEMU does not have: names, or prefixes of names that end with `@` or an
/// address.
const ABSENT: &[&str] = &[
    "txp@",
    "hvs@",
    "pixelvalve@",
    "vec@",
    "dsi@",
    "hdmi@",
    "pwm@",
    "i2c@7ef",
    "clock@7ef",
    "interrupt-controller@7ef",
];

/// Writes the device tree of the emulated machine: `tree`, the card's, with changes, as `emulated`.
pub fn make_tree(tree: &Path, emulated: &Path) -> Result<()> {
    fs::copy(tree, emulated).with_context(|| tree.display().to_string())?;
    let tree = Tree { file: emulated };
    for node in tree.nodes("/soc")?.iter().filter(|node| is_absent(node)) {
        tree.disable(&format!("/soc/{node}"))?;
    }
    for node in ["/gpu", "/soc/serial@7e215040", "/soc/serial@7e201000/bluetooth"] {
        tree.disable(node)?;
    }
    tree.remove("/leds/led-pwr")?;

    let slot = "/soc/mmc@7e300000";
    tree.remove(&format!("{slot}/wifi@1"))?;
    for property in ["non-removable", "mmc-pwrseq", "pinctrl-0", "pinctrl-names"] {
        tree.edit(&["-d"], &[slot, property])?;
    }
    tree.edit(&[], &[slot, "broken-cd"])?;
    tree.disable("/emmc2bus/mmc@7e340000")?;

    // The bus address is the same as the memory address.
    let page = [POWER_MANAGEMENT, 0, POWER_MANAGEMENT, 0x1000];
    let ranges = [tree.cells("/soc", "ranges")?, page.to_vec()].concat();
    tree.set_cells("/soc", "ranges", &ranges)?;
    let node = "/soc/watchdog@7e100000";
    let mut registers = tree.cells(node, "reg")?;
    *registers.first_mut().context("the power management has no registers")? = POWER_MANAGEMENT;
    tree.set_cells(node, "reg", &registers)?;

    let node = format!("/chosen/framebuffer@{FRAME_BUFFER:x}");
    tree.edit(&["-p", "-t", "s"], &[&node, "compatible", "simple-framebuffer"])?;
    tree.edit(&["-t", "s"], &[&node, "format", "r5g6b5"])?;
    let (width_px, height_px, stride) = (640, 480, 1280);
    tree.set_cells(&node, "reg", &[0, FRAME_BUFFER, height_px * stride])?;
    for (name, value) in [("width", width_px), ("height", height_px), ("stride", stride)] {
        tree.set_cells(&node, name, &[value])?;
    }
    tree.set_cells("/chosen", "#address-cells", &[2])?;
    tree.set_cells("/chosen", "#size-cells", &[1])?;
    tree.edit(&[], &["/chosen", "ranges"])
}

fn is_absent(node: &str) -> bool {
    ABSENT.iter().any(|name| node.starts_with(name))
}

/// A device tree in a file, edited with Debian's tools.
struct Tree<'a> {
    file: &'a Path,
}

impl Tree<'_> {
    fn edit(&self, options: &[&str], words: &[&str]) -> Result<()> {
        Task::new("fdtput").args(options).args([self.file]).args(words).output().map(drop)
    }

    fn disable(&self, node: &str) -> Result<()> {
        self.edit(&["-t", "s"], &[node, "status", "disabled"])
    }

    fn remove(&self, node: &str) -> Result<()> {
        self.edit(&["-r"], &[node])
    }

    fn set_cells(&self, node: &str, property: &str, cells: &[u32]) -> Result<()> {
        let cells: Vec<String> = cells.iter().map(|cell| format!("{cell:x}")).collect();
        let words = [&[node, property][..], &cells.iter().map(String::as_str).collect::<Vec<_>>()];
        self.edit(&["-t", "x"], &words.concat())
    }

    fn cells(&self, node: &str, property: &str) -> Result<Vec<u32>> {
        let said = Task::new("fdtget")
            .args(["-t", "x"])
            .args([self.file])
            .args([node, property])
            .output()?;
        let cells = said.split_whitespace().map(|cell| u32::from_str_radix(cell, 16));
        cells.collect::<Result<_, _>>().with_context(|| format!("{node} {property}: {said}"))
    }

    fn nodes(&self, below: &str) -> Result<Vec<String>> {
        let said = Task::new("fdtget").args(["-l"]).args([self.file]).args([below]).output()?;
        Ok(said.lines().map(str::to_owned).collect())
    }
}

/// Writes the script that starts an emulator for the machine, which is fetched if the system has
/// none.
pub fn make_emulator(script: &Path) -> Result<()> {
    let command = if system_has_it() {
        "qemu-system-aarch64".to_owned()
    } else {
        let (root, here) = (fetched()?, Here::of_this_machine()?);
        let place = |name: &str| quoted(root.join(name).as_ref());
        let (loader, libraries) = (place(here.loader), place(here.libraries));
        format!("{loader} --library-path {libraries} {}", place("usr/bin/qemu-system-aarch64"))
    };
    let text = format!("#!/bin/sh\nexec {command} -machine {MACHINE} \"$@\"\n");
    write_script(script, &text)
}

fn system_has_it() -> bool {
    let machines = Task::new("qemu-system-aarch64").args(["-machine", "help"]).output();
    machines.is_ok_and(|text| text.lines().any(|line| line.starts_with(MACHINE)))
}

/// The release's emulator, unpacked.
fn fetched() -> Result<PathBuf> {
    let path = target_directory().join("image").join(format!("{RELEASE}-qemu"));
    if !path.exists() {
        println!("The system's QEMU has no machine {MACHINE}: Debian {RELEASE}'s is fetched");
        let unfinished = path.with_extension("unfinished");
        unpack(Here::of_this_machine()?.architecture, PACKAGES, &unfinished)?;
        fs::rename(&unfinished, &path)?;
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_qemu_lacks_is_told_from_its_neighbours() {
        for absent in ["hvs@7e400000", "i2c@7ef04500", "pwm@7e20c800", "hdmi@7ef00700"] {
            assert!(is_absent(absent), "{absent}");
        }
        for there in ["i2c@7e804000", "serial@7e201000", "interrupt-controller@40041000", "gpio"] {
            assert!(!is_absent(there), "{there}");
        }
    }
}
