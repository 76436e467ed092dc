//! Versions of what runs on a box.

use core::fmt;

/// The version of this program.
pub const CURRENT: Version = Version::of_text(env!("CARGO_PKG_VERSION"));

/// The oldest version that a box with this program goes to. It rises when an older version has a
/// fault that must not come back.
pub const OLDEST_ALLOWED: Version = Version { major: 0, minor: 1, patch: 0 };

/// A version, by the rules of Semantic Versioning, without what may follow its three numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Version {
    /// Rises with what is no longer compatible.
    pub major: u16,
    /// Rises with what is new.
    pub minor: u16,
    /// Rises with what is mended.
    pub patch: u16,
}

impl Version {
    /// Its length in an update's head.
    pub(crate) const BYTES: usize = 6;

    /// The version that a text of three numbers names; it panics on another, and is for the
    /// compiler to evaluate.
    const fn of_text(text: &str) -> Self {
        let bytes = text.as_bytes();
        let mut numbers = [0_u16; 3];
        let (mut part, mut index) = (0, 0);
        while index < bytes.len() {
            match bytes[index] {
                b'.' => part += 1,
                digit @ b'0'..=b'9' => numbers[part] = numbers[part] * 10 + (digit - b'0') as u16,
                _ => panic!("a version has three numbers"),
            }
            index += 1;
        }
        Self { major: numbers[0], minor: numbers[1], patch: numbers[2] }
    }

    #[cfg(feature = "sign")]
    pub(crate) fn to_bytes(self) -> [u8; Self::BYTES] {
        let [[a, b], [c, d], [e, f]] = [self.major, self.minor, self.patch].map(u16::to_le_bytes);
        [a, b, c, d, e, f]
    }

    pub(crate) fn of_bytes([a, b, c, d, e, f]: [u8; Self::BYTES]) -> Self {
        let [major, minor, patch] = [[a, b], [c, d], [e, f]].map(u16::from_le_bytes);
        Self { major, minor, patch }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

impl core::str::FromStr for Version {
    type Err = NoVersion;

    fn from_str(text: &str) -> Result<Self, NoVersion> {
        let mut parts = text.split('.').map(|part| {
            // A sign would be taken for part of a number.
            if part.starts_with('+') { None } else { part.parse().ok() }
        });
        let mut next = || parts.next().flatten().ok_or(NoVersion);
        let version = Self { major: next()?, minor: next()?, patch: next()? };
        if parts.next().is_some() { Err(NoVersion) } else { Ok(version) }
    }
}

/// A text that is no version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NoVersion;

impl fmt::Display for NoVersion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a version has three numbers, such as 1.2.3")
    }
}

impl core::error::Error for NoVersion {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_ordered_by_their_numbers_and_not_by_their_text() {
        let version = |text: &str| text.parse::<Version>().unwrap();
        assert!(version("0.10.0") > version("0.9.99"));
        assert!(version("1.0.0") > version("0.65535.65535"));
        assert_eq!(version("1.2.3").to_string(), "1.2.3");
        assert_eq!(Version::of_bytes(version("1.2.300").to_bytes()), version("1.2.300"));
        for wrong in ["", "1", "1.2", "1.2.3.4", "1.2.x", "1..3", "1.2.65536", "+1.2.3", "-1.2.3"] {
            assert_eq!(wrong.parse::<Version>(), Err(NoVersion), "{wrong}");
        }
    }

    #[test]
    fn the_compiler_reads_versions_as_programs_do() {
        for text in ["0.1.0", "1.20.345", "65535.10.9"] {
            assert_eq!(Version::of_text(text), text.parse().unwrap());
        }
        assert!(NoVersion.to_string().contains("such as 1.2.3"));
    }

    #[test]
    fn this_program_may_run_by_its_own_rule() {
        assert_eq!(CURRENT.to_string(), env!("CARGO_PKG_VERSION"));
        assert!(CURRENT >= OLDEST_ALLOWED);
    }
}
