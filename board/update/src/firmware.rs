//! What the boot firmware of a Raspberry Pi makes of `autoboot.txt`, by its documentation
//! (Raspberry Pi documentation, "autoboot.txt" and "Fail-safe OS updates (TRYBOOT)"):
//!
//! - at most 512 bytes are read;
//! - `[all]`, `[none]` and `[tryboot]` begin a section, which holds where its condition does;
//!   `[tryboot]` holds in a start that was asked for with the flag *tryboot*;
//! - `boot_partition=N` names the partition to start from, and a later line overrules an earlier one;
//! - `tryboot_a_b=1` has the same files read in a try, `config.txt` and not `tryboot.txt`;
//! - the flag is good for one start, and is cleared **before** anything is started: whatever becomes
//!   of that start, the next one is an ordinary one.
//!
//! The box itself does not need this. Tests play the firmware by it, and check what a box writes.

use crate::card::SECTOR_BYTES;

/// The partition from which the firmware starts: `None` if `autoboot.txt` names none, or if it would
/// look for `tryboot.txt` instead.
#[must_use]
pub fn partition(autoboot: &[u8], is_try: bool) -> Option<u32> {
    let read = &autoboot[..autoboot.len().min(SECTOR_BYTES)];
    let text = core::str::from_utf8(read).ok()?;
    let (mut holds, mut partition, mut by_partition) = (true, None, false);
    for line in text.lines().map(str::trim) {
        match line {
            "[all]" => holds = true,
            "[none]" => holds = false,
            "[tryboot]" => holds = is_try,
            _ if holds => match line.split_once('=') {
                Some(("boot_partition", number)) => partition = number.parse().ok(),
                Some(("tryboot_a_b", value)) => by_partition = value == "1",
                _ => {}
            },
            _ => {}
        }
    }
    partition.filter(|_| !is_try || by_partition)
}

/// The firmware's one-shot flag, and the resets that it goes through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Flag {
    is_set: bool,
}

impl Flag {
    /// A restart with the words `0 tryboot`.
    pub fn ask_for_try(&mut self) {
        self.is_set = true;
    }

    /// Power was cut: what was asked for is forgotten.
    pub fn lose_power(&mut self) {
        self.is_set = false;
    }

    /// A start: whether it is the one that was asked for. It is cleared by that.
    pub fn take(&mut self) -> bool {
        core::mem::take(&mut self.is_set)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documented_example_is_read_as_documented() {
        let example = b"[all]\ntryboot_a_b=1\nboot_partition=2\n[tryboot]\nboot_partition=3\n";
        assert_eq!(partition(example, false), Some(2));
        assert_eq!(partition(example, true), Some(3));
        // Without tryboot_a_b a try is one of files.
        let by_file = b"boot_partition=2\n[tryboot]\nboot_partition=3\n";
        assert_eq!((partition(by_file, false), partition(by_file, true)), (Some(2), None));
        assert_eq!(partition(b"[none]\nboot_partition=2\n", false), None);
        // A section ends where the next one begins.
        let again = b"[none]\nboot_partition=2\n[all]\nboot_partition=3\n";
        assert_eq!(partition(again, false), Some(3));
        let mut beyond = [b'\n'; SECTOR_BYTES + 20];
        beyond[SECTOR_BYTES..][..16].copy_from_slice(b"boot_partition=2");
        assert_eq!(partition(&beyond, false), None);
    }

    #[test]
    fn the_flag_is_good_for_one_start() {
        let mut flag = Flag::default();
        assert!(!flag.take());
        flag.ask_for_try();
        assert!(flag.take() && !flag.take());
        flag.ask_for_try();
        flag.lose_power();
        assert!(!flag.take());
    }
}
