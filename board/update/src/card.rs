//! The partitions of a card that can be updated.
//!
//! | partition | label | what for |
//! |---|---|---|
//! | 1 | `PL-CHOOSER` | `autoboot.txt`, by which the boot firmware chooses a slot; nothing else |
//! | 2 | `PL-SLOT` | a slot: firmware, kernel, device trees, initramfs |
//! | 3 | `PL-SLOT` | the other slot, with the same bytes on a new card |
//! | 4 | `PLUMBLINE` | the settings: configuration, key, and what became of updates |
//!
//! All are FAT32, in a partition table of the old kind (MBR), which has four entries. An update is
//! the beginning of a slot's partition, as far as anything is stored in it: the same for both slots,
//! so that nothing in a slot may depend on which of them it is.

/// The bytes of a sector.
pub const SECTOR_BYTES: usize = 512;

/// Where the first partition starts: cards are written in blocks of this size or a fraction of it.
pub const FIRST_START_BYTES: u64 = 4 << 20;

/// The size of the chooser: of the smallest FAT32 that all systems take.
pub const CHOOSER_BYTES: u64 = 40 << 20;

/// The size of a slot: half as much again as a system has today.
pub const SLOT_BYTES: u64 = 96 << 20;

/// The size of the settings.
pub const SETTINGS_BYTES: u64 = 40 << 20;

/// The label of the settings' file system.
pub const SETTINGS_LABEL: &str = "PLUMBLINE";

/// A partition, by its number in the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Partition {
    /// Counted from 1.
    pub number: u32,
    /// Its file system's label.
    pub label: &'static str,
    /// Where it starts on the card.
    pub start_bytes: u64,
    /// How long it is.
    pub bytes: u64,
}

/// The chooser.
pub const CHOOSER: Partition = Partition {
    number: 1,
    label: "PL-CHOOSER",
    start_bytes: FIRST_START_BYTES,
    bytes: CHOOSER_BYTES,
};

/// The settings.
pub const SETTINGS: Partition = Partition {
    number: 4,
    label: SETTINGS_LABEL,
    start_bytes: Slot::B.partition().start_bytes + SLOT_BYTES,
    bytes: SETTINGS_BYTES,
};

/// The whole card.
pub const CARD_BYTES: u64 = SETTINGS.start_bytes + SETTINGS_BYTES;

/// The partitions in the order of the table.
pub const PARTITIONS: [Partition; 4] =
    [CHOOSER, Slot::A.partition(), Slot::B.partition(), SETTINGS];

/// One of the two places for a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Slot {
    /// Partition 2.
    A,
    /// Partition 3.
    B,
}

impl Slot {
    /// Both.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    /// Its partition.
    #[must_use]
    pub const fn partition(self) -> Partition {
        let (number, before) = match self {
            Self::A => (2, 0),
            Self::B => (3, SLOT_BYTES),
        };
        let start_bytes = FIRST_START_BYTES + CHOOSER_BYTES + before;
        Partition { number, label: "PL-SLOT", start_bytes, bytes: SLOT_BYTES }
    }

    /// The slot in the partition of this number.
    #[must_use]
    pub fn of_partition(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|slot| slot.partition().number == number)
    }
}

impl core::fmt::Display for Slot {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::A => "slot A",
            Self::B => "slot B",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partitions_follow_one_another_in_whole_blocks() {
        let mut end = FIRST_START_BYTES;
        for (index, partition) in PARTITIONS.iter().enumerate() {
            assert_eq!(partition.number as usize, index + 1);
            assert_eq!(partition.start_bytes, end);
            assert_eq!(partition.bytes % FIRST_START_BYTES, 0);
            end += partition.bytes;
        }
        assert_eq!(end, CARD_BYTES);
        assert_eq!(Slot::of_partition(2), Some(Slot::A));
        assert_eq!(Slot::of_partition(3), Some(Slot::B));
        assert_eq!([0, 1, 4, 5].map(Slot::of_partition), [None; 4]);
    }

    /// Boxes in the field have such cards, and an update must find its place on them.
    #[test]
    fn the_layout_of_a_card_stays_as_it_is() {
        let mebibytes = PARTITIONS.map(|it| (it.start_bytes >> 20, it.bytes >> 20));
        assert_eq!(mebibytes, [(4, 40), (44, 96), (140, 96), (236, 40)]);
        assert_eq!(Slot::ALL.map(|slot| slot.to_string()), ["slot A", "slot B"]);
        assert_eq!(Slot::ALL.map(Slot::other), [Slot::B, Slot::A]);
    }
}
