//! Whether the computer's power supply is too weak, and whether its processor is slowed down.
//!
//! When the supply's voltage drops under load, or the processor gets hot, a Raspberry Pi lowers
//! its clock: frames are then late, and some are dropped. How this is detected depends on the
//! kernel:
//!
//! | kernel | supply | processor |
//! |---|---|---|
//! | Raspberry Pi OS's | the firmware's flags (`firmware`) | the same |
//! | Debian's, on the box's own card | not known | its clock, measured (`clock`) |
//! | others | not known | not known, unless their clock is held at one frequency |
//!
//! Reading takes microseconds, and neither waits nor allocates.

mod clock;
mod firmware;

use clock::Clock;
use firmware::Firmware;

/// The state of the power; `None` where the computer does not report it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Power {
    /// The supply's voltage is or was too low.
    pub undervoltage: Option<bool>,
    /// The processor is or was slowed down.
    pub throttled: Option<bool>,
}

/// The computer's means of reporting its power.
#[derive(Debug)]
pub struct PowerMonitor {
    firmware: Option<Firmware>,
    clock: Option<Clock>,
}

impl PowerMonitor {
    /// Starts monitoring. The clock is measured while the calling thread runs: this must be the
    /// thread that measures.
    #[must_use]
    pub fn open() -> Self {
        Self { firmware: Firmware::open(), clock: Clock::open() }
    }

    /// The state now and since the last call.
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
