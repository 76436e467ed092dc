//! The power flags of a Raspberry Pi's firmware, where the kernel passes them on: a hexadecimal
//! number without a prefix.
//!
//! | flag | bit: since the kernel's previous query | bit: now |
//! |---|---|---|
//! | the supply's voltage is too low | 16 | 0 |
//! | the processor's clock is limited | 17 | 1 |
//! | the processor is throttled | 18 | 2 |
//! | the processor is so hot that its clock is lowered | 19 | 3 |
//!
//! The kernel's driver `raspberrypi-hwmon` queries the firmware every 2 s, which clears the upper
//! bits; the file holds the latest answer. So a voltage drop of a few milliseconds stays in the
//! file for 2 s, and reading it once a second misses none.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use super::Power;

/// The firmware's directory in the kernel of Raspberry Pi OS.
const FOLDER: &str = "/sys/devices/platform/soc/soc:firmware";

const UNDERVOLTAGE: u32 = 1 | 1 << 16;
const THROTTLED: u32 = 0b1110 | 0b1110 << 16;

/// The open file.
#[derive(Debug)]
pub struct Firmware {
    flags: File,
    /// Exists as long as the driver runs.
    driver: PathBuf,
}

impl Firmware {
    /// `None` if the kernel has no such file.
    pub fn open() -> Option<Self> {
        Self::open_in(Path::new(FOLDER))
    }

    fn open_in(folder: &Path) -> Option<Self> {
        let flags = File::open(folder.join("get_throttled")).ok()?;
        Some(Self { flags, driver: folder.join("raspberrypi-hwmon/driver") })
    }

    /// `None` if the file cannot be read, or nothing keeps it up to date.
    pub fn power(&self) -> Option<Power> {
        // Without the driver the file holds what the firmware reported at the kernel's start.
        if !self.driver.exists() {
            return None;
        }
        let mut text = [0; 16];
        let length = self.flags.read_at(&mut text, 0).ok()?;
        power_of(std::str::from_utf8(&text[..length]).ok()?)
    }
}

fn power_of(text: &str) -> Option<Power> {
    let flags = u32::from_str_radix(text.trim(), 16).ok()?;
    Some(Power {
        undervoltage: Some(flags & UNDERVOLTAGE != 0),
        throttled: Some(flags & THROTTLED != 0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_flag_has_its_meaning() {
        let table = [
            ("0\n", Some((false, false))),
            ("1\n", Some((true, false))),
            ("2\n", Some((false, true))),
            ("4\n", Some((false, true))),
            ("8\n", Some((false, true))),
            ("10\n", Some((false, false))),
            ("10000\n", Some((true, false))),
            ("20000\n", Some((false, true))),
            ("40000\n", Some((false, true))),
            ("80000\n", Some((false, true))),
            ("50005\n", Some((true, true))),
            ("fff0fff0\n", Some((false, false))),
            ("", None),
            ("\n", None),
            ("none\n", None),
            ("100000000\n", None),
        ];
        for (text, wanted) in table {
            let wanted = wanted.map(|(undervoltage, throttled)| Power {
                undervoltage: Some(undervoltage),
                throttled: Some(throttled),
            });
            assert_eq!(power_of(text), wanted, "{text:?}");
        }
    }

    #[test]
    fn the_file_is_reread_each_time_and_trusted_only_while_the_driver_runs() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Firmware::open_in(folder.path()).is_none());
        let file = folder.path().join("get_throttled");
        std::fs::write(&file, "50000\n").unwrap();
        let firmware = Firmware::open_in(folder.path()).unwrap();
        assert_eq!(firmware.power(), None);
        let driver = folder.path().join("raspberrypi-hwmon/driver");
        std::fs::create_dir_all(&driver).unwrap();
        let power = |undervoltage, throttled| Some(Power { undervoltage, throttled });
        assert_eq!(firmware.power(), power(Some(true), Some(true)));
        std::fs::write(&file, "0\n").unwrap();
        assert_eq!(firmware.power(), power(Some(false), Some(false)));
        std::fs::remove_dir(&driver).unwrap();
        assert_eq!(firmware.power(), None);
    }
}
