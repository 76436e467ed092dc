//! The Raspberry Pi's SD card: right as far as it can be seen without a Pi, and
//! the emulated box boots from what is on it.

use std::path::Path;

use crate::machine::{Host, Machine, Parts, image, is_measured, poses, read};
use crate::scene::{self, SCENE, run};

const START_BYTES: u64 = 4 << 20;

/// Copies a file from the card.
fn from_card(card: &Path, name: &str, directory: &Path) -> Vec<u8> {
    let (image, copy) = (format!("{}@@{START_BYTES}", card.display()), directory.join(name));
    run("mcopy", &["-n", "-i", &image, &format!("::{name}"), copy.to_str().unwrap()]);
    read(&copy)
}

#[test]
fn the_sd_card_is_sound_and_what_is_on_it_boots() {
    let directory = tempfile::tempdir().unwrap();
    let card = directory.path().join("card.img");
    run("cp", &["--sparse=always", image("rpi4.img").to_str().unwrap(), card.to_str().unwrap()]);
    let card_name = card.to_str().unwrap();

    // One partition, FAT32, where the firmware looks for it.
    let table = run("/usr/sbin/sfdisk", &["--json", card_name]);
    let compact: String = table.split_whitespace().collect();
    assert!(compact.contains(r#""label":"dos""#), "{table}");
    assert_eq!(compact.matches(r#""node":"#).count(), 1, "{table}");
    assert!(
        compact.contains(r#""start":8192,"size":262144,"type":"c","bootable":true"#),
        "{table}"
    );
    let partition = directory.path().join("partition.img");
    let bytes = read(&card);
    std::fs::write(&partition, &bytes[START_BYTES as usize..]).unwrap();
    let checked = run("/usr/sbin/fsck.fat", &["-n", "-v", partition.to_str().unwrap()]);
    assert!(checked.contains("32 bits"), "{checked}");

    // The files are what they are called, and those that the firmware is told of are there.
    let files = directory.path().join("files");
    std::fs::create_dir(&files).unwrap();
    let file = |name: &str| from_card(&card, name, &files);
    let listing = run("mdir", &["-b", "-i", &format!("{card_name}@@{START_BYTES}")]);
    println!("{listing}");
    let config = String::from_utf8(file("config.txt")).unwrap();
    let told = |key: &str| {
        let line = config.lines().find_map(|line| line.strip_prefix(key));
        line.unwrap_or_else(|| panic!("config.txt has no {key}"))
            .split(' ')
            .next()
            .unwrap()
            .to_owned()
    };
    assert!(config.lines().any(|line| line == "arm_64bit=1"), "{config}");
    // An arm64 kernel has this mark 56 bytes after its start, a device tree and a
    // program begin with theirs.
    let kernel = file(&told("kernel="));
    assert_eq!(&kernel[56..60], b"ARM\x64");
    assert!(kernel == read(&image("vmlinuz")), "the kernel is not the one that is booted");
    assert!(file(&told("initramfs ")) == read(&image("initramfs")), "nor is the initramfs");
    assert_eq!(&file(&told("device_tree="))[..4], b"\xd0\x0d\xfe\xed");
    assert_eq!(&file("start4.elf")[..4], b"\x7fELF");
    assert!(file("fixup4.dat").len() > 1000);
    let command_line = String::from_utf8(file("cmdline.txt")).unwrap();
    assert!(command_line.contains("console=ttyS1,115200") && command_line.lines().count() == 1);

    // The emulated box, from the card's own kernel and initramfs, with the card in its slot.
    let host = Host::new();
    let blob = scene::blob(&scene::config(host.address()));
    scene::copy_config(&card, START_BYTES, directory.path(), &blob);
    let parts = Parts {
        kernel: files.join(told("kernel=")),
        initramfs: vec![files.join(told("initramfs ")), image("overlay.cpio")],
        command_line: "rdinit=/test/start",
        boot_disk: &card,
        frames_disk: Some(&SCENE.frames_disk),
    };
    let machine = Machine::start(&parts, &host);
    machine.wait_for("a pose", |seen| poses(&seen.udp).any(is_measured).then_some(()));
}
