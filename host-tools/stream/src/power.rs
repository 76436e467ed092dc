//! What a box has reported of its power supply and of its processor's clock.

use plumbline::packet::Health;

const UNDERVOLTAGE: &str = "the voltage of the box's power supply was too low: use the official \
    supply of 5.1 V and 3 A, a shorter cable, and nothing but the camera on its USB ports";

const THROTTLED: &str = "the box's processor was slowed down, by heat or by its power supply: \
    frames may have come late or been dropped; `plumb doctor` tells its temperature";

/// The worst that its Health packets have reported; `None` where they reported nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PowerSeen {
    /// The supply's voltage was too low.
    pub undervoltage: Option<bool>,
    /// The processor was slowed down.
    pub throttled: Option<bool>,
}

impl PowerSeen {
    /// Takes note of a Health; returns the warnings for which it is the first reason.
    pub fn take(&mut self, health: &Health) -> Vec<&'static str> {
        let before = self.warnings();
        // None, then good, then bad: what was bad stays bad.
        self.undervoltage = self.undervoltage.max(health.undervoltage);
        self.throttled = self.throttled.max(health.throttled);
        self.warnings().into_iter().filter(|warning| !before.contains(warning)).collect()
    }

    /// Warnings for the user.
    #[must_use]
    pub fn warnings(&self) -> Vec<&'static str> {
        let known = [(self.undervoltage, UNDERVOLTAGE), (self.throttled, THROTTLED)];
        known.into_iter().filter(|(is_so, _)| *is_so == Some(true)).map(|(_, text)| text).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::health;

    #[test]
    fn each_fault_is_news_once_and_stays_known() {
        let mut seen = PowerSeen::default();
        let mut hear =
            |undervoltage, throttled| seen.take(&Health { undervoltage, throttled, ..health() });
        assert_eq!(hear(None, None), [""; 0]);
        assert_eq!(hear(Some(false), Some(false)), [""; 0]);
        assert_eq!(hear(Some(false), Some(true)), [THROTTLED]);
        assert_eq!(hear(Some(true), Some(true)), [UNDERVOLTAGE]);
        assert_eq!(hear(Some(false), Some(false)), [""; 0]);
        assert_eq!(hear(Some(true), None), [""; 0]);
        assert_eq!(seen.warnings(), [UNDERVOLTAGE, THROTTLED]);
        assert_eq!((seen.undervoltage, seen.throttled), (Some(true), Some(true)));
        assert_eq!(PowerSeen::default().take(&health()), [""; 0]);
    }
}
