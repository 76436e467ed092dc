//! The Raspberry Pi's SD card: what is on it, and what its firmware makes of it.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::Path;

use super::firmware::{self, BOARDS};
use plumbline_update::card::{CARD_BYTES, CHOOSER, PARTITIONS, Partition, Slot};
use plumbline_update::{chooser, firmware as choosing};

use crate::machine::{image, read};
use crate::scene::{file_on, files_on, run};

/// A partition of a card as mtools take it.
pub fn place(card: &Path, partition: &Partition) -> String {
    format!("{}@@{}", card.display(), partition.start_bytes)
}

/// The slot that the firmware takes from a card.
pub fn chosen(card: &Path, is_try: bool) -> Slot {
    let sector = file_on(&place(card, &CHOOSER), chooser::FILE_NAME).expect("a chooser");
    let partition = choosing::partition(&sector, is_try);
    partition.and_then(Slot::of_partition).expect("it names a slot")
}

/// The files of a card's slot, which have names without case.
#[derive(Clone)]
pub struct Card {
    files: BTreeMap<String, Vec<u8>>,
    initramfs_names: Vec<String>,
    modules: String,
    kernel_config: String,
}

impl Card {
    /// Reads the slot that the firmware takes from the image of a card.
    pub fn of(image_file: &Path, is_try: bool) -> Self {
        let slot = chosen(image_file, is_try);
        let partition = place(image_file, &slot.partition());
        let names = files_on(&partition).into_iter();
        let files = names.filter_map(|name| Some((name.clone(), file_on(&partition, &name)?)));
        let files: BTreeMap<_, _> = files.collect();
        let (initramfs_names, modules) = unpacked(&files["initramfs"]);
        let kernel_config =
            String::from_utf8(read(&image("kernel-config"))).expect("the kernel's is text");
        Self { files, initramfs_names, modules, kernel_config }
    }

    pub fn has(&self, name: &str) -> bool {
        self.files.contains_key(&name.to_lowercase())
    }

    pub fn file(&self, name: &str) -> Option<&[u8]> {
        self.files.get(&name.to_lowercase()).map(Vec::as_slice)
    }

    pub fn text(&self, name: &str) -> Option<&str> {
        Some(str::from_utf8(self.file(name)?).expect("what the firmware reads is text"))
    }

    /// The names of what the kernel unpacks.
    pub fn initramfs_names(&self) -> &[String] {
        &self.initramfs_names
    }

    /// The module that the box loads first, without its path.
    pub fn first_module(&self) -> Option<&str> {
        let name = self.modules.lines().next()?.rsplit('/').next()?;
        name.strip_suffix(".ko")
    }

    /// What the card's kernel was built with.
    pub fn kernel_config(&self) -> &str {
        &self.kernel_config
    }

    fn with(&self, name: &str, content: &str) -> Self {
        let mut changed = self.clone();
        changed.files.insert(name.to_owned(), content.as_bytes().to_vec());
        changed
    }

    fn without(&self, name: &str) -> Self {
        let mut changed = self.clone();
        changed.files.remove(name).expect("it was there");
        changed
    }
}

/// What a gzip archive holds.
pub fn unzipped(bytes: &[u8]) -> Vec<u8> {
    let mut unzipped = Vec::new();
    flate2::read::GzDecoder::new(bytes).read_to_end(&mut unzipped).expect("it is compressed");
    unzipped
}

/// The names in an initramfs, and its list of modules.
fn unpacked(initramfs: &[u8]) -> (Vec<String>, String) {
    let archive = unzipped(initramfs);
    let (mut rest, mut names, mut modules) = (&archive[..], Vec::new(), String::new());
    loop {
        let mut reader = cpio::NewcReader::new(rest).expect("an archive");
        if reader.entry().is_trailer() {
            return (names, modules);
        }
        names.push(reader.entry().name().to_owned());
        if reader.entry().name() == "etc/plumbline/modules" {
            reader.read_to_string(&mut modules).expect("a list of modules");
        }
        rest = reader.finish().expect("the next entry");
    }
}

/// As the card was before it was ever held against the firmware's rules.
const CONFIG_THAT_NEVER_BOOTED: &str = "\
arm_64bit=1
upstream_kernel=1
device_tree=bcm2711-rpi-4-b.dtb
kernel=vmlinuz
initramfs initramfs followkernel
enable_uart=1
force_turbo=1
gpu_mem=16
boot_delay=0
disable_splash=1
";

fn complaints(card: &Card) -> String {
    let each = BOARDS.iter().filter_map(|board| firmware::start(card, board).err());
    each.flatten().collect::<Vec<_>>().join("\n")
}

#[test]
fn the_firmware_finds_what_the_card_makes_it_look_for_on_every_board() {
    let card = Card::of(&image("rpi4.img"), false);
    for board in &BOARDS {
        let start = firmware::start(&card, board).unwrap_or_else(|complaints| {
            panic!("the card does not start:\n{}", complaints.join("\n"))
        });
        println!("{}: {start:?}", board.name);
        assert_eq!(start.device_tree, board.tree);
        let kernel = card.file(&start.kernel).expect("it is there");
        assert!(unzipped(kernel) == read(&image("vmlinuz")), "another kernel");
        assert!(card.file(&start.initramfs) == Some(&read(&image("initramfs"))[..]), "another one");
    }
    // The firmware itself is what it is called.
    assert_eq!(card.file("start4.elf").map(|file| &file[..4]), Some(&b"\x7fELF"[..]));
    assert!(card.file("fixup4.dat").is_some_and(|file| file.len() > 1000));
}

#[test]
fn a_card_that_would_not_start_is_told_by_what_is_wrong_with_it() {
    let card = Card::of(&image("rpi4.img"), false);
    let never_booted = complaints(&card.with("config.txt", CONFIG_THAT_NEVER_BOOTED));
    for words in [
        "Pi 4 Model B: start4cd.elf is not on the card",
        "Pi 4 Model B: fixup4cd.dat is not on the card",
        "Pi 400: device_tree=bcm2711-rpi-4-b.dtb is the tree of another board",
        "Compute Module 4: device_tree=bcm2711-rpi-4-b.dtb is the tree of another board",
    ] {
        assert!(never_booted.contains(words), "{words} is not in\n{never_booted}");
    }

    let config = card.text("config.txt").unwrap().to_owned();
    let mut other_order = card.clone();
    other_order.modules = "/lib/modules/fixed.ko\n/lib/modules/bcm2835_wdt.ko\n".into();
    let mut other_kernel = card.clone();
    other_kernel.kernel_config = card.kernel_config.replace("CONFIG_FB_SIMPLE=y", "");
    let with_line = |line: &str| card.with("config.txt", &format!("{config}\n{line}\n"));
    let with_words = |words: &str| {
        card.with("cmdline.txt", &format!("{} {words}\n", card.text("cmdline.txt").unwrap().trim()))
    };
    let table = [
        (card.without("start4.elf"), "start4.elf is not on the card"),
        (card.without("fixup4.dat"), "fixup4.dat is not on the card"),
        (card.without("bcm2711-rpi-400.dtb"), "Pi 400: bcm2711-rpi-400.dtb is not on the card"),
        (card.without("vmlinuz"), "vmlinuz is not on the card"),
        (card.without("cmdline.txt"), "cmdline.txt is not on the card"),
        (card.without("config.txt"), "there is no config.txt"),
        (
            card.with("start4.elf", "\x7fELF of April 2024"),
            "start4.elf is too old for kernel_watchdog_timeout",
        ),
        (with_line("kernel_watchdog_timeout=16"), "`kernel_watchdog_timeout=16`: there is no rule"),
        (with_line("start_x=1"), "`start_x=1`: there is no rule"),
        (with_line("gpu_mem=8"), "`gpu_mem=8`: there is no rule"),
        (with_line("initramfs=initramfs"), "`initramfs=initramfs`: there is no rule"),
        (with_line("kernel=vmlinux"), "vmlinux is not on the card"),
        (with_line("kernel=initramfs"), "initramfs is no 64-bit kernel"),
        (card.with("config.txt", &config.replace("arm_64bit=1", "")), "arm_64bit=1 is missing"),
        (card.with("config.txt", &config.replace("enable_uart=1", "")), "no enable_uart=1"),
        (card.with("recovery.bin", ""), "recovery.bin is on the card"),
        (with_words("8250.nr_uarts=1"), "`8250.nr_uarts=1`: there is no rule"),
        (card.with("cmdline.txt", "quiet\npanic=10\n"), "cmdline.txt is not one line"),
        (card.with("bcm2711-rpi-400.dtb", ""), "Pi 400: bcm2711-rpi-400.dtb is not a device tree"),
        (other_order, "not the driver that restarts the computer"),
        (other_kernel, "the kernel has no FB_SIMPLE built in"),
    ];
    for (changed, words) in table {
        let found = complaints(&changed);
        assert!(found.contains(words), "{words} is not in\n{found}");
    }
}

#[test]
fn the_card_has_partitions_where_the_firmware_looks_for_them() {
    let card = image("rpi4.img");
    // doc: raspberry-pi/eeprom-bootloader.adoc: a partition table as of old, and FAT32.
    let table = run("/usr/sbin/sfdisk", &["--json", card.to_str().unwrap()]);
    let compact: String = table.split_whitespace().collect();
    assert!(compact.contains(r#""label":"dos""#), "{table}");
    assert_eq!(compact.matches(r#""node":"#).count(), PARTITIONS.len(), "{table}");
    let bytes = read(&card);
    assert_eq!(bytes.len() as u64, CARD_BYTES);
    let directory = tempfile::tempdir().unwrap();
    let of = |it: &Partition| &bytes[it.start_bytes as usize..][..it.bytes as usize];
    for partition in PARTITIONS {
        let (start, size) = (partition.start_bytes / 512, partition.bytes / 512);
        // The first bootable one is where autoboot.txt is looked for.
        let bootable = if partition == CHOOSER { r#","bootable":true"# } else { "" };
        let entry = format!(r#""start":{start},"size":{size},"type":"c"{bootable}}}"#);
        assert!(compact.contains(&entry), "{entry} is not in {table}");
        let file = directory.path().join("partition.img");
        std::fs::write(&file, of(&partition)).unwrap();
        let checked = run("/usr/sbin/fsck.fat", &["-n", "-v", file.to_str().unwrap()]);
        assert!(checked.contains("32 bit entries"), "{checked}");
        assert_eq!(of(&partition)[71..82].trim_ascii_end(), partition.label.as_bytes());
    }
    assert!(of(&Slot::A.partition()) == of(&Slot::B.partition()), "slots that differ");
    assert_eq!((chosen(&card, false), chosen(&card, true)), (Slot::A, Slot::B));
    assert_eq!(files_on(&place(&card, &CHOOSER)), [chooser::FILE_NAME]);
}
