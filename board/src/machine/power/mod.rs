//! Whether the computer's power supply is too weak, and whether its processor is slowed down.
//!
//! A supply whose voltage drops under load, or heat, makes a Raspberry Pi lower its clock: then
//! frames come late, and some are dropped. How that is known depends on the kernel:
//!
//! | kernel | supply | processor |
//! |---|---|---|
//! | Raspberry Pi OS's | the firmware's flags ([`firmware`]) | the same |
//! | Debian's, on the box's own card | not known | its clock, measured ([`clock`]) |
//! | others | not known | not known, unless their clock is held at one frequency |
//!
//! Reading takes microseconds, waits for nothing and allocates nothing.

mod clock;
mod firmware;

use clock::Clock;
use firmware::Firmware;

/// What is known of the power; `None` where the computer does not tell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Power {
    /// The supply's voltage is or was too low.
    pub undervoltage: Option<bool>,
    /// The processor is or was slowed down.
    pub throttled: Option<bool>,
}

/// What the computer has to tell it with.
#[derive(Debug)]
pub struct PowerMonitor {
    firmware: Option<Firmware>,
    clock: Option<Clock>,
}

impl PowerMonitor {
    /// Begins to watch. The clock is measured while the calling thread runs: this must be the
    /// thread that measures.
    #[must_use]
    pub fn open() -> Self {
        Self { firmware: Firmware::open(), clock: Clock::open() }
    }

    /// Now, and since the last call.
    pub fn read(&mut self) -> Power {
        match self.firmware.as_ref().and_then(Firmware::power) {
            Some(power) => power,
            None => Power {
                undervoltage: None,
                throttled: self.clock.as_mut().and_then(Clock::is_throttled),
            },
        }
    }
}
