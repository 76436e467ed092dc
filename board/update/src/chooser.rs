//! `autoboot.txt`: the sector by which the boot firmware chooses a slot.
//!
//! It has exactly one sector, the most that the firmware reads, so that it changes as a whole or not
//! at all: a card writes a sector or does not. There are two versions of it, one for each slot;
//! anything else was not written by a box.

use crate::card::{SECTOR_BYTES, Slot};

/// The file's name on the chooser.
pub const FILE_NAME: &str = "autoboot.txt";

/// The sector that has the firmware start `slot`, and the other one if it is asked to try that once.
#[must_use]
pub fn sector(slot: Slot) -> [u8; SECTOR_BYTES] {
    let mut sector = [b'\n'; SECTOR_BYTES];
    let mut at = 0;
    let mut write = |text: &[u8]| {
        sector[at..at + text.len()].copy_from_slice(text);
        at += text.len();
    };
    write(b"# Which partition the boot firmware starts. The box rewrites this file as a whole.\n");
    write(b"[all]\ntryboot_a_b=1\nboot_partition=");
    write(&[digit(slot)]);
    write(b"\n[tryboot]\nboot_partition=");
    write(&[digit(slot.other())]);
    sector
}

/// The slot that a sector chooses; `None` for one that no box has written.
#[must_use]
pub fn chosen(bytes: &[u8]) -> Option<Slot> {
    Slot::ALL.into_iter().find(|slot| sector(*slot) == bytes)
}

/// Partitions have numbers of one digit.
const fn digit(slot: Slot) -> u8 {
    b'0' + slot.partition().number as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::firmware;

    #[test]
    fn a_sector_says_what_it_was_made_to_say_and_any_other_says_nothing() {
        for slot in Slot::ALL {
            let made = sector(slot);
            assert_eq!(chosen(&made), Some(slot));
            assert_eq!(firmware::partition(&made, false), Some(slot.partition().number));
            assert_eq!(firmware::partition(&made, true), Some(slot.other().partition().number));
            for index in 0..SECTOR_BYTES {
                let mut damaged = made;
                damaged[index] ^= 1;
                assert_ne!(chosen(&damaged), Some(slot), "byte {index}");
            }
        }
        assert_eq!(chosen(&[0; SECTOR_BYTES]), None);
        assert_eq!(chosen(b""), None);
    }
}
