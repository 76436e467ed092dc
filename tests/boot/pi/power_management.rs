//! The power management of a Raspberry Pi's chip, as far as its watchdog goes, played in the
//! emulated machine's memory.
//!
//! QEMU has the registers, but resets the machine as soon as the watchdog is started. The
//! emulated machine's device tree therefore has them in its memory, where this thread does what
//! the hardware does: it counts PM_WDOG down, and resets the machine when that has come to zero
//! while PM_RSTC asks for a full reset. The kernel's own driver, bcm2835_wdt, writes to them
//! and reads from them as on a Pi. The count goes by the machine's clock, not by this one's.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Duration;

/// As in the device tree of the emulated machine, `host-tools/xtask/src/image/emulated_pi.rs`.
const REGISTERS: u64 = 0x3e00_0000;
const RSTC: u64 = REGISTERS + 0x1c;
const WDOG: u64 = REGISTERS + 0x24;

/// In PM_RSTC: a full reset is asked for when the time is over.
const FULL_RESET: u32 = 0x20;

/// What a write must contain to be one.
const PASSWORD: u32 = 0x5a00_0000;

/// The bits of PM_WDOG that count, 16 us each.
const TIME: u32 = 0x000f_ffff;
const TICKS_PER_S: f64 = 65_536.0;

/// The registers are looked at this often.
pub const LOOK_EVERY: Duration = Duration::from_millis(20);

/// What had the registers show a reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reset {
    /// Power came on: PM_RSTS has HADPOR.
    PowerOn,
    /// The watchdog: PM_RSTS has HADWRF.
    Watchdog,
}

impl Reset {
    /// PM_RSTS, as the firmware hands it over.
    pub fn status(self) -> u32 {
        match self {
            Self::PowerOn => 0x1000,
            Self::Watchdog => 0x20,
        }
    }
}

/// The registers of a machine whose memory is in a file.
pub struct PowerManagement {
    memory: File,
    before_us: Option<u32>,
}

impl PowerManagement {
    /// The registers as they are when power has come on: all zero, like the memory.
    pub fn of(memory: &Path) -> Self {
        let memory = OpenOptions::new().read(true).write(true).open(memory);
        Self { memory: memory.expect("the machine's memory is a file"), before_us: None }
    }

    /// Starts the watchdog, as the firmware does before the kernel.
    pub fn start(&self, seconds: u32) {
        self.write(WDOG, PASSWORD | seconds << 16 & TIME);
        self.write(RSTC, PASSWORD | FULL_RESET);
    }

    /// Lets the time go on to `now_us` of the machine's clock; true when the watchdog bites.
    pub fn go_on(&mut self, now_us: u32) -> bool {
        // The clock has 32 bits and begins again after 71 minutes. Read from outside, it may
        // stand a little before where it stood.
        let passed_us = now_us.wrapping_sub(self.before_us.unwrap_or(now_us));
        let passed_us = if passed_us > u32::MAX / 2 { 0 } else { passed_us };
        if passed_us > 0 || self.before_us.is_none() {
            self.before_us = Some(now_us);
        }
        if self.read(RSTC) & FULL_RESET == 0 {
            return false;
        }
        let register = self.read(WDOG);
        let passed = (f64::from(passed_us) * 1e-6 * TICKS_PER_S).round() as u32;
        let left = (register & TIME).saturating_sub(passed);
        self.write(WDOG, register & !TIME | left);
        left == 0
    }

    fn read(&self, address: u64) -> u32 {
        let mut bytes = [0; 4];
        self.memory.read_exact_at(&mut bytes, address).expect("the memory is as large as that");
        u32::from_le_bytes(bytes)
    }

    fn write(&self, address: u64, word: u32) {
        self.memory.write_all_at(&word.to_le_bytes(), address).expect("the memory is writable");
    }
}

#[test]
fn it_bites_when_its_time_is_over_and_only_then() {
    let memory = tempfile::NamedTempFile::new().unwrap();
    memory.as_file().set_len(REGISTERS + 0x1000).unwrap();
    let mut registers = PowerManagement::of(memory.path());
    // Never started.
    assert!(!registers.go_on(0) && !registers.go_on(60_000_000));
    // As the driver starts it with 5 s, and feeds it after 4 s.
    let start = |registers: &PowerManagement| {
        registers.write(WDOG, 0x5a00_0000 | 5 << 16);
        registers.write(RSTC, 0x5a00_0122);
    };
    start(&registers);
    assert!(!registers.go_on(64_000_000));
    // What is left is read back, as from the hardware.
    assert_eq!(registers.read(WDOG), 0x5a00_0000 | 1 << 16);
    start(&registers);
    assert!(!registers.go_on(68_900_000));
    // A clock that is read a little late is no time that has passed.
    assert!(!registers.go_on(68_899_999) && !registers.go_on(68_900_000));
    // Stopped in time, it never bites.
    registers.write(RSTC, 0x5a00_0102);
    assert!(!registers.go_on(80_000_000));
    start(&registers);
    assert!(!registers.go_on(84_900_000));
    assert!(registers.go_on(85_100_000));
    // Started by the firmware, which nobody feeds.
    let mut registers = PowerManagement::of(memory.path());
    registers.start(15);
    assert!(!registers.go_on(0) && !registers.go_on(14_900_000));
    assert!(registers.go_on(15_100_000));
}
