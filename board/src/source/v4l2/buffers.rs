//! Keeps track of who owns each buffer: this process, or the driver.
//!
//! ```text
//!             give (QBUF)
//!    Ours ──────────────────▶ Drivers
//!     ▲                          │
//!     └──────────────────────────┘
//!            take (DQBUF)
//! ```
//!
//! A buffer that this process owns is represented by a value, [`Ours`]. There is at
//! most one per buffer, and without it the memory cannot be read. Giving the buffer
//! to the driver consumes it, so that a buffer can neither be queued twice nor be
//! read while the driver fills it. What the driver gives back is checked: an index
//! that does not exist, or a buffer that the driver does not own, is refused.
//!
//! No call into the kernel is made here.

/// The kernel's own limit on the buffers of one queue.
pub const BUFFERS_MAX: usize = 32;

/// A buffer that this process owns and may read.
#[derive(Debug, PartialEq, Eq)]
#[must_use = "a buffer that is neither read nor given back is lost to the camera"]
pub struct Ours {
    index: u32,
}

impl Ours {
    /// Its number, from 0.
    pub fn index(&self) -> u32 {
        self.index
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Owner {
    Ours,
    Driver,
}

/// Why a buffer that the driver gives back is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// There is no such buffer.
    NoSuchBuffer {
        /// What the driver said.
        index: u32,
        /// How many there are.
        count: usize,
    },
    /// The driver does not own it.
    NotQueued {
        /// What the driver said.
        index: u32,
    },
}

impl std::fmt::Display for Refused {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoSuchBuffer { index, count } => {
                write!(formatter, "its driver gave back buffer {index} of {count}")
            }
            Self::NotQueued { index } => {
                write!(formatter, "its driver gave back buffer {index}, which it did not have")
            }
        }
    }
}

/// The owners of all buffers of a queue.
#[derive(Debug)]
pub struct Buffers {
    owners: heapless::Vec<Owner, BUFFERS_MAX>,
}

impl Buffers {
    /// `count` buffers, all of them ours; at most [`BUFFERS_MAX`] are used.
    pub fn new(count: usize) -> (Self, impl Iterator<Item = Ours>) {
        let count = count.min(BUFFERS_MAX);
        let owners = std::iter::repeat_n(Owner::Ours, count).collect();
        (Self { owners }, (0..count as u32).map(|index| Ours { index }))
    }

    /// The number of buffers that the driver owns.
    pub fn with_driver(&self) -> usize {
        self.owners.iter().filter(|&&owner| owner == Owner::Driver).count()
    }

    /// Notes that the driver has accepted a buffer.
    pub fn give(&mut self, ours: Ours) {
        self.owners[ours.index as usize] = Owner::Driver;
    }

    /// Takes a buffer that the driver gives back.
    ///
    /// # Errors
    /// When there is no such buffer or the driver did not own it; nothing changes.
    pub fn take(&mut self, index: u32) -> Result<Ours, Refused> {
        let count = self.owners.len();
        match self.owners.get_mut(index as usize) {
            None => Err(Refused::NoSuchBuffer { index, count }),
            Some(Owner::Ours) => Err(Refused::NotQueued { index }),
            Some(owner) => {
                *owner = Owner::Ours;
                Ok(Ours { index })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every state of three buffers, and every index a driver may name in it.
    #[test]
    fn a_driver_gives_back_what_it_has_and_nothing_else() {
        for states in 0..8_u32 {
            let has = |index: u32| index < 3 && states >> index & 1 == 1;
            for index in [0, 1, 2, 3, 31, 32, u32::MAX] {
                let (mut buffers, all) = Buffers::new(3);
                let mut kept: Vec<Ours> = Vec::new();
                for ours in all {
                    if has(ours.index()) {
                        buffers.give(ours);
                    } else {
                        kept.push(ours);
                    }
                }
                let before = buffers.with_driver();
                assert_eq!(before, states.count_ones() as usize);
                let taken = buffers.take(index);
                if has(index) {
                    assert_eq!(taken, Ok(Ours { index }));
                    assert_eq!(buffers.with_driver(), before - 1);
                    // The same one twice.
                    assert_eq!(buffers.take(index), Err(Refused::NotQueued { index }));
                } else if index < 3 {
                    assert_eq!(taken, Err(Refused::NotQueued { index }));
                    assert_eq!(buffers.with_driver(), before);
                } else {
                    assert_eq!(taken, Err(Refused::NoSuchBuffer { index, count: 3 }));
                    assert_eq!(buffers.with_driver(), before);
                }
            }
        }
    }

    #[test]
    fn a_buffer_goes_round_and_round() {
        let (mut buffers, all) = Buffers::new(1);
        let mut ours = all.last().unwrap();
        for _ in 0..3 {
            assert_eq!(buffers.with_driver(), 0);
            buffers.give(ours);
            assert_eq!(buffers.with_driver(), 1);
            ours = buffers.take(0).unwrap();
        }
        assert_eq!(ours.index(), 0);
    }

    #[test]
    fn a_driver_with_too_many_buffers_is_cut_to_the_bound() {
        let (buffers, all) = Buffers::new(1000);
        assert_eq!((buffers.owners.len(), all.count()), (BUFFERS_MAX, BUFFERS_MAX));
    }
}
