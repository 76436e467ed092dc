//! What the boot firmware of a Raspberry Pi 4 makes of a card: which files each line of
//! `config.txt` and `cmdline.txt` makes the firmware or the kernel look for, and what it is
//! that the kernel is started with.
//!
//! A line without a rule here is an error: whoever adds one finds out first what the firmware
//! makes of it. The sources are
//!
//! - *doc*: raspberrypi/documentation, below `documentation/asciidoc/computers`;
//! - *firmware*, *linux*: issues of raspberrypi/firmware and raspberrypi/linux, by number;
//! - *Debian*: `z50-raspi-firmware`, the hook with which Debian's package raspi-firmware writes
//!   the same two files for the same kernel;
//! - *kernel*: the mainline kernel's drivers and device trees.

use std::path::Path;

use super::card::{Card, unzipped};
use crate::scene::run;

/// A board that a card may be put into.
#[derive(Debug, Clone, Copy)]
pub struct Board {
    /// For people.
    pub name: &'static str,
    /// The tree that the firmware takes with `upstream_kernel=1`; firmware 1660, Debian.
    pub tree: &'static str,
    /// Its name in that tree.
    pub compatible: &'static str,
}

/// The boards that the card is made for.
pub const BOARDS: [Board; 3] = [
    Board {
        name: "Pi 4 Model B",
        tree: "bcm2711-rpi-4-b.dtb",
        compatible: "raspberrypi,4-model-b",
    },
    Board { name: "Pi 400", tree: "bcm2711-rpi-400.dtb", compatible: "raspberrypi,400" },
    Board {
        name: "Compute Module 4",
        tree: "bcm2711-rpi-cm4-io.dtb",
        compatible: "raspberrypi,4-compute-module",
    },
];

/// Files that make the boot loader do something else than start the card's system;
/// doc: raspberry-pi/boot-eeprom.adoc, config_txt/autoboot.adoc.
const MUST_BE_ABSENT: [&str; 6] =
    ["recovery.bin", "recovery.elf", "recover4.elf", "pieeprom.upd", "vl805.bin", "autoboot.txt"];

/// Below this share of the memory, in MB, the firmware is the cut-down one; firmware 984.
const CUT_DOWN_BELOW_MB: u32 = 32;

/// What the kernel is started with: names of files on the card, and its command line.
#[derive(Debug, PartialEq, Eq)]
pub struct Start {
    pub kernel: String,
    pub initramfs: String,
    pub device_tree: String,
    pub command_line: String,
    /// The time of the watchdog, which runs then.
    pub watchdog_s: Option<u32>,
}

/// Starts the card on a board; or all that keeps it from starting.
pub fn start(card: &Card, board: &Board) -> Result<Start, Vec<String>> {
    let mut firmware = Firmware { card, board, config: Config::default(), complaints: Vec::new() };
    firmware.read_config();
    firmware.look_for_its_own_files();
    let start = firmware.choose();
    firmware.check_kernel(&start);
    firmware.check_tree(&start);
    firmware.check_command_line(&start);
    if firmware.complaints.is_empty() { Ok(start) } else { Err(firmware.complaints) }
}

/// What `config.txt` has set.
#[derive(Default)]
struct Config {
    arm_64bit: bool,
    serial_console: bool,
    upstream_kernel: bool,
    gpu_mem_mb: Option<u32>,
    watchdog_s: Option<u32>,
    kernel: Option<String>,
    initramfs: Option<String>,
    device_tree: Option<String>,
}

struct Firmware<'a> {
    card: &'a Card,
    board: &'a Board,
    config: Config,
    complaints: Vec<String>,
}

impl Firmware<'_> {
    fn complain(&mut self, complaint: String) {
        self.complaints.push(format!("{}: {complaint}", self.board.name));
    }

    fn look_for(&mut self, name: &str, why: &str) {
        if !self.card.has(name) {
            self.complain(format!("{name} is not on the card, and is looked for: {why}"));
        }
    }

    fn read_config(&mut self) {
        let Some(text) = self.card.text("config.txt") else {
            return self.complain("there is no config.txt".into());
        };
        for line in text.lines().map(str::trim) {
            if !line.is_empty() && !line.starts_with('#') && !self.config_line(line) {
                self.complain(format!(
                    "config.txt: `{line}`: there is no rule for this; find out what the firmware \
                     makes of it, and add it with its source"
                ));
            }
        }
    }

    /// Takes one line; false where no rule fits.
    fn config_line(&mut self, line: &str) -> bool {
        // "you should not use a `=` character here", doc: config_txt/boot.adoc.
        if let Some(rest) = line.strip_prefix("initramfs ") {
            let mut words = rest.split_whitespace();
            self.config.initramfs = words.next().map(str::to_owned);
            // Behind the kernel; an address would have to be known to be free.
            return words.eq(["followkernel"]);
        }
        let Some((key, value)) = line.split_once('=') else { return false };
        match (key, value) {
            // doc: config_txt/boot.adoc, arm_64bit; older firmware starts 32-bit code without it.
            ("arm_64bit", "1") => self.config.arm_64bit = true,
            // doc: config_txt/boot.adoc, upstream_kernel: names of trees as mainline has them, and
            // a directory `upstream/`, which is passed over where it is not there.
            ("upstream_kernel", "1") => self.config.upstream_kernel = true,
            // doc: config_txt/boot.adoc: "the alternative filename on the boot partition".
            ("kernel", name) => self.config.kernel = Some(name.into()),
            // doc: config_txt/boot.adoc: the tree for every board, whichever it is.
            ("device_tree", name) => self.config.device_tree = Some(name.into()),
            // doc: config_txt/memory.adoc: 76 by default, 16 at least.
            ("gpu_mem", value) => match value.parse() {
                Ok(mb @ 16..=512) => self.config.gpu_mem_mb = Some(mb),
                _ => return false,
            },
            // doc: config_txt/boot.adoc, kernel_watchdog_timeout. kernel: bcm2835_wdt.c: the register
            // counts 20 bits of 1/65536 s.
            ("kernel_watchdog_timeout", value) => match value.parse() {
                Ok(seconds @ 1..=15) => self.config.watchdog_s = Some(seconds),
                _ => return false,
            },
            // doc: configuration/uart.adoc: also fixes the core's clock, on which the mini UART's
            // rate depends.
            ("enable_uart", "1") => self.config.serial_console = true,
            // doc: config_txt/overclocking.adoc: no warranty bit without over_voltage.
            ("force_turbo", "0" | "1")
            // doc: config_txt/video.adoc.
            | ("hdmi_force_hotplug" | "disable_overscan", "0" | "1")
            // doc: configuration/device-tree.adoc: no overlay from a board on the pins.
            | ("force_eeprom_read", "0")
            // doc: config_txt/boot.adoc: seconds before the kernel is loaded.
            | ("boot_delay", "0" | "1")
            // doc: config_txt/boot.adoc.
            | ("disable_splash", "0" | "1") => {}
            _ => return false,
        }
        true
    }

    fn look_for_its_own_files(&mut self) {
        // doc: raspberry-pi/eeprom-bootloader.adoc, PARTITION_WALK: a partition is bootable that
        // "contains `start4.elf`", whichever firmware is then loaded.
        self.look_for("start4.elf", "without it the partition does not count as bootable");
        match self.config.gpu_mem_mb {
            // firmware 984: "forces the use of start_cd.elf"; firmware 1809, pftf/RPi4 58: on a
            // Pi 4 by the names below, and either pair alone does not start.
            Some(mb) if mb < CUT_DOWN_BELOW_MB => {
                let why = format!("gpu_mem={mb} takes the cut-down firmware");
                self.look_for("start4cd.elf", &why);
                self.look_for("fixup4cd.dat", &why);
            }
            // doc: configuration/boot_folder.adoc: each has its pair.
            _ => self.look_for("fixup4.dat", "it belongs to start4.elf"),
        }
        // Only what it has a word for does anything; firmware 1980: since July 2025.
        let word = b"kernel_watchdog_timeout";
        let knows = |file: &[u8]| file.windows(word.len()).any(|it| it == word);
        if self.config.watchdog_s.is_some() && !self.card.file("start4.elf").is_some_and(knows) {
            self.complain("start4.elf is too old for kernel_watchdog_timeout".into());
        }
        for name in MUST_BE_ABSENT {
            if self.card.has(name) {
                self.complain(format!("{name} is on the card, and would be obeyed first"));
            }
        }
    }

    /// The files of the system, by the names that the firmware has for them.
    fn choose(&mut self) -> Start {
        let missing = |name: &str| format!("config.txt names no {name}");
        let kernel = self.config.kernel.clone().unwrap_or_else(|| "kernel8.img".into());
        self.look_for(&kernel, "it is the kernel");
        let initramfs = self.config.initramfs.clone().unwrap_or_else(|| {
            self.complain(missing("initramfs"));
            String::new()
        });
        self.look_for(&initramfs, "it is the initramfs");
        if !self.config.upstream_kernel {
            self.complain(missing("upstream_kernel=1: the trees would have other names"));
        }
        let named = self.config.device_tree.clone();
        if let Some(named) = named.as_ref().filter(|named| *named != self.board.tree) {
            self.complain(format!("device_tree={named} is the tree of another board"));
        }
        let device_tree = named.unwrap_or_else(|| self.board.tree.into());
        // doc: configuration/device-tree.adoc: without its tree the kernel is started without any.
        self.look_for(&device_tree, "it is the board's device tree");
        // doc: configuration/kernel-command-line.adoc.
        self.look_for("cmdline.txt", "without it the firmware has a command line of its own");
        let mut command_line = self.card.text("cmdline.txt").unwrap_or_default().trim().to_owned();
        let watchdog_s = self.config.watchdog_s;
        if let Some(seconds) = watchdog_s {
            // doc: config_txt/boot.adoc: "The value is passed to the OS via the kernel command line".
            command_line += &format!(" watchdog.open_timeout={seconds}");
        }
        Start { kernel, initramfs, device_tree, command_line, watchdog_s }
    }

    fn check_kernel(&mut self, start: &Start) {
        let Some(kernel) = self.card.file(&start.kernel) else { return };
        // doc: config_txt/boot.adoc, arm_64bit: "gzip archives of an image", recognized by the bytes
        // with which they start.
        let kernel = if kernel.starts_with(&[0x1f, 0x8b]) { &unzipped(kernel) } else { kernel };
        // kernel: Documentation/arch/arm64/booting.rst. firmware 1415: the firmware reads the
        // same header, and places the kernel by it.
        if kernel.get(56..60) != Some(b"ARM\x64") {
            self.complain(format!("{} is no 64-bit kernel", start.kernel));
        } else if !self.config.arm_64bit {
            self.complain("the kernel is 64-bit code; arm_64bit=1 is missing".into());
        }
    }

    fn check_tree(&mut self, start: &Start) {
        let Some(tree) = self.card.file(&start.device_tree) else { return };
        if !tree.starts_with(b"\xd0\x0d\xfe\xed") {
            return self.complain(format!("{} is not a device tree", start.device_tree));
        }
        let directory = tempfile::tempdir().expect("a temporary directory");
        let path = directory.path().join("tree.dtb");
        std::fs::write(&path, tree).expect("the tree is written");
        let of = |node: &str, property: &str| property_of(&path, node, property);
        let compatible = of("/", "compatible");
        if !compatible.split_whitespace().any(|word| word == self.board.compatible) {
            self.complain(format!("{} is the tree of {compatible}", start.device_tree));
        }
        // firmware 613 and 846: the Ethernet address goes to the node of the alias `ethernet0`;
        // linux 3210: the memory that the SD slot can reach, to that of `emmc2bus`.
        for alias in ["ethernet0", "emmc2bus"] {
            if of("/aliases", alias).is_empty() {
                self.complain(format!("{} has no alias {alias}", start.device_tree));
            }
        }
        // kernel: 8250_bcm2835aux.c: the mini UART is ttyS of its alias's number.
        let console = of("/aliases", "serial1");
        let console = console.trim();
        if console.is_empty() || !of(console, "compatible").contains("brcm,bcm2835-aux-uart") {
            self.complain(format!("{}: ttyS1 is not the mini UART", start.device_tree));
        }
    }

    fn check_command_line(&mut self, start: &Start) {
        // doc: configuration/kernel-command-line.adoc: "all on a single line".
        if self.card.text("cmdline.txt").is_some_and(|text| text.trim().lines().count() != 1) {
            self.complain("cmdline.txt is not one line".into());
        }
        for word in start.command_line.split_whitespace() {
            match word {
                // kernel: the console on a screen, and the frame buffer that the firmware makes.
                "console=tty1" => {
                    for part in ["VT_CONSOLE", "FRAMEBUFFER_CONSOLE", "FB_SIMPLE"] {
                        self.needs_built_in(word, part);
                    }
                }
                "console=ttyS1,115200" => {
                    self.needs_built_in(word, "SERIAL_8250_CONSOLE");
                    self.needs_built_in(word, "SERIAL_8250_BCM2835AUX");
                    if !self.config.serial_console {
                        self.complain(format!("{word}: config.txt has no enable_uart=1"));
                    }
                }
                // kernel: Documentation/admin-guide/kernel-parameters.txt.
                "quiet" => {}
                // kernel: Documentation/admin-guide/kernel-parameters.txt: a parameter of what is built
                // in. The box uses none of the kernel's cryptography, and starts the sooner.
                "cryptomgr.notests" => self.needs_built_in(word, "CRYPTO_MANAGER"),
                "cpufreq.default_governor=performance" => {
                    self.needs_built_in(word, "CPU_FREQ_GOV_PERFORMANCE");
                }
                // kernel: process.c and bcm2835_wdt.c; linux 2523, 3187: a Pi is restarted by its
                // watchdog's driver, and stands still where that is not loaded.
                "panic=10" => {
                    if self.card.first_module() != Some("bcm2835_wdt") {
                        self.complain(format!(
                            "{word}: the first module of the initramfs is {:?}, not the driver \
                             that restarts the computer, bcm2835_wdt",
                            self.card.first_module()
                        ));
                    }
                }
                // kernel: Documentation/watchdog/watchdog-parameters.rst: so long the driver feeds a
                // watchdog that it has found running, until a program opens it.
                _ if word.starts_with("watchdog.open_timeout=") => {
                    self.needs_built_in(word, "WATCHDOG_CORE");
                    self.needs_built_in(word, "WATCHDOG_HANDLE_BOOT_ENABLED");
                }
                _ => self.complain(format!(
                    "cmdline.txt: `{word}`: there is no rule for this; find out what the kernel \
                     makes of it, and add it with its source"
                )),
            }
        }
        // Without a root file system on a disk the kernel runs this.
        if !self.card.initramfs_names().iter().any(|name| name == "init") {
            self.complain(format!("{} holds no init", start.initramfs));
        }
    }

    fn needs_built_in(&mut self, word: &str, part: &str) {
        if !self.card.kernel_config().lines().any(|line| line == format!("CONFIG_{part}=y")) {
            self.complain(format!("{word}: the kernel has no {part} built in"));
        }
    }
}

/// A property as text; empty where there is none.
fn property_of(tree: &Path, node: &str, property: &str) -> String {
    run("fdtget", &["-d", "", tree.to_str().expect("a plain path"), node, property])
}
