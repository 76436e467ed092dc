//! What the kernel has asked the firmware for, over the mailbox of a Raspberry Pi.
//!
//! QEMU plays this part of the firmware, and can log the tag of each property that it is sent. It has
//! no property SET_REBOOT_FLAGS, which it answers like any other that it does not know; so what the
//! box has sent with the tag is looked for in the machine's memory, where the answer has come back
//! to: the tag, the size of what belongs to it, a length with the mark of an answer, and the flags.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// The properties, by raspberrypi/linux, raspberrypi-firmware.h.
const SET_REBOOT_FLAGS: u32 = 0x0003_8064;
const NOTIFY_REBOOT: u32 = 0x0003_0048;

/// In the flags: start the other slot, this once.
const TRY_ONCE: u32 = 1;

/// In the length of a property: it has been answered.
const ANSWERED: u32 = 1 << 31;

/// The memory that the kernel has; the firmware's own follows.
const MEMORY_BYTES: u64 = 0x3c00_0000;

/// The request and its answer: four words.
const REQUEST_BYTES: usize = 16;

/// Whether the firmware of a machine that has stopped had been asked to start the other slot once.
/// `log` is what QEMU has logged since the machine was started, and `memory` the machine's.
///
/// # Panics
/// If it was asked, but not by the flag, or too late for the firmware.
pub fn asked_for_try(log: &Path, memory: &Path) -> bool {
    let log = std::fs::read_to_string(log).expect("QEMU has written a log");
    let tags: Vec<u32> = log.lines().filter_map(tag).collect();
    let Some(asked) = tags.iter().position(|&tag| tag == SET_REBOOT_FLAGS) else { return false };
    let notified = tags.iter().position(|&tag| tag == NOTIFY_REBOOT);
    assert!(notified.is_some_and(|at| asked < at), "not before the restart: {tags:x?}");
    let flags = answered_flags(memory);
    assert!(!flags.is_empty(), "the answer is not in the memory");
    assert!(flags.iter().all(|&flags| flags == TRY_ONCE), "other flags: {flags:x?}");
    true
}

/// The tag in a line like "mbox property tag:0x00038064 in_sz:4 out_sz:0", after a process and a time.
fn tag(line: &str) -> Option<u32> {
    let (_, rest) = line.split_once("mbox property tag:0x")?;
    u32::from_str_radix(rest.split(' ').next()?, 16).ok()
}

/// The flags of all answered requests in the memory: there may be copies.
fn answered_flags(memory: &Path) -> Vec<u32> {
    let file = File::open(memory).expect("the machine's memory is a file");
    let (mut found, mut at) = (Vec::new(), 0);
    let mut bytes = vec![0; 4 << 20];
    while at < MEMORY_BYTES {
        file.read_exact_at(&mut bytes, at).expect("the memory is as large as that");
        let requests = bytes.windows(REQUEST_BYTES).step_by(4);
        found.extend(requests.filter_map(|request| {
            let word = |index: usize| {
                let bytes = request[4 * index..][..4].try_into().expect("four bytes");
                u32::from_le_bytes(bytes)
            };
            let is_one = word(0) == SET_REBOOT_FLAGS && word(1) == 4 && word(2) & ANSWERED != 0;
            is_one.then(|| word(3))
        }));
        // One may lie across the end.
        at += (bytes.len() - REQUEST_BYTES) as u64;
    }
    found
}

#[test]
fn an_answered_request_is_found_and_its_flags_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let (log, memory) = (folder.path().join("log"), folder.path().join("memory"));
    let file = File::create(&memory).unwrap();
    file.set_len(MEMORY_BYTES + (4 << 20)).unwrap();
    let write = |at: u64, words: [u32; 4]| {
        file.write_all_at(&words.map(u32::to_le_bytes).concat(), at).unwrap();
    };
    let line = |tag: u32| {
        format!(
            "7@1764162.000001:bcm2835_mbox_property mbox property tag:0x{tag:08x} in_sz:4 out_sz:0\n"
        )
    };
    // As it lies in the module before it is sent.
    write(0x1000, [SET_REBOOT_FLAGS, 4, 0, TRY_ONCE]);
    std::fs::write(&log, line(0x0003_0002) + &line(NOTIFY_REBOOT)).unwrap();
    assert!(!asked_for_try(&log, &memory));
    std::fs::write(&log, line(SET_REBOOT_FLAGS) + &line(NOTIFY_REBOOT)).unwrap();
    // Across the end of what is read at once.
    write((4 << 20) - 8, [SET_REBOOT_FLAGS, 4, ANSWERED, TRY_ONCE]);
    assert!(asked_for_try(&log, &memory));
    assert_eq!(answered_flags(&memory), [TRY_ONCE]);
}
