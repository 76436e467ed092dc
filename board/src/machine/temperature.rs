//! The processor's temperature, where the kernel reports it.

use std::fs::File;
use std::os::unix::fs::FileExt;

/// An open sensor; reading it does not allocate.
#[derive(Debug)]
pub struct Sensor {
    file: Option<File>,
}

impl Sensor {
    /// The kernel's first thermal zone, which is the processor on the boards in use.
    #[must_use]
    pub fn open() -> Self {
        Self { file: File::open("/sys/class/thermal/thermal_zone0/temp").ok() }
    }

    /// In 0.1 degrees Celsius; `None` where there is no sensor or it does not answer.
    #[must_use]
    pub fn decicelsius(&self) -> Option<i16> {
        let mut text = [0; 16];
        let length = self.file.as_ref()?.read_at(&mut text, 0).ok()?;
        let millicelsius: i32 = std::str::from_utf8(&text[..length]).ok()?.trim().parse().ok()?;
        i16::try_from(millicelsius / 100).ok()
    }
}
