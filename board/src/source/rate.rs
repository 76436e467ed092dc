//! A frame rate as a fraction, so that the time of a frame is exact however
//! long the recording is.

use std::str::FromStr;

/// Frames per second, `numerator / denominator`, from 0.01 to 10,000.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    numerator: u64,
    denominator: u64,
}

impl Rate {
    /// The rate of this fraction, or `None` when it is out of range.
    #[must_use]
    pub fn new(numerator: u64, denominator: u64) -> Option<Self> {
        // Fractions with larger terms do not occur; below, no product of these overflows.
        let terms = 1..=u64::from(u32::MAX);
        if !terms.contains(&numerator) || !terms.contains(&denominator) {
            return None;
        }
        let in_range = numerator <= denominator * 10_000 && numerator * 100 >= denominator;
        in_range.then_some(Self { numerator, denominator })
    }

    /// When frame `index` was captured, counted from frame 0, rounded down.
    #[must_use]
    pub fn time_ns(self, index: u64) -> u64 {
        let time_ns = u128::from(index) * u128::from(self.denominator) * 1_000_000_000
            / u128::from(self.numerator);
        u64::try_from(time_ns).unwrap_or(u64::MAX)
    }

    /// Frames per second, rounded.
    #[must_use]
    pub fn hz(self) -> f64 {
        self.numerator as f64 / self.denominator as f64
    }
}

impl FromStr for Rate {
    type Err = String;

    /// Reads `60`, `59.94` or `60000/1001`, also with a colon.
    fn from_str(text: &str) -> Result<Self, String> {
        let fraction = match text.split_once(['/', ':']) {
            Some((numerator, denominator)) => numerator.parse().ok().zip(denominator.parse().ok()),
            None => text.parse::<f64>().ok().and_then(|rate_hz| {
                let scaled = (rate_hz * 10_000.0).round();
                (scaled >= 1.0 && scaled <= f64::from(u32::MAX)).then_some((scaled as u64, 10_000))
            }),
        };
        fraction.and_then(|(numerator, denominator)| Self::new(numerator, denominator)).ok_or_else(
            || {
                "a frame rate is a number from 0.01 to 10000 or a fraction such as 60000/1001"
                    .into()
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_do_not_drift() {
        let ntsc = Rate::new(60_000, 1001).unwrap();
        // 60,000 frames of 1001/60,000 s each are 1001 s to the nanosecond.
        assert_eq!(ntsc.time_ns(60_000), 1_001_000_000_000);
        assert_eq!(ntsc.time_ns(1), 16_683_333);
        // A century at the highest rate fits.
        assert!(Rate::new(10_000, 1).unwrap().time_ns(31_557_600_000_000) < u64::MAX);
    }

    #[test]
    fn rates_are_read_as_people_write_them() {
        assert_eq!("60".parse(), Rate::new(600_000, 10_000).ok_or_else(String::new));
        assert_eq!("60000/1001".parse(), Rate::new(60_000, 1001).ok_or_else(String::new));
        for bad in ["", "0", "-5", "NaN", "inf", "1/0", "0:0", "1e300", "20000", "sixty"] {
            assert!(bad.parse::<Rate>().is_err(), "{bad}");
        }
    }
}
