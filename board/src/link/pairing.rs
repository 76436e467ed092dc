//! How long a box takes a key over its serial cable.
//!
//! A box without a usable key takes one at any time. A box with a key takes another one only in the
//! first minute after somebody has switched it on: whoever holds the cable then could as well change
//! the card.

use plumbline::packet::ResetReason;

/// How long a box with a key takes another one after it was switched on.
const AFTER_POWER_ON_NS: u64 = 60_000_000_000;

/// What an announcement says of a box that takes a key until it has one.
const WITHOUT_END: u8 = 255;

/// When the time to pair a box that has a key is over.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairingTime {
    until_ns: u64,
}

impl PairingTime {
    /// For a box that has started now.
    pub(super) fn of_start(reason: ResetReason, now_ns: u64) -> Self {
        let is_by_hand = reason == ResetReason::PowerOn;
        Self { until_ns: if is_by_hand { now_ns + AFTER_POWER_ON_NS } else { now_ns } }
    }

    /// The seconds that are left, as an announcement says them.
    pub(super) fn left_s(self, has_key: bool, now_ns: u64) -> u8 {
        if !has_key {
            return WITHOUT_END;
        }
        self.until_ns.saturating_sub(now_ns).div_ceil(1_000_000_000) as u8
    }
}

const _: () = assert!(AFTER_POWER_ON_NS / 1_000_000_000 < WITHOUT_END as u64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_with_a_key_takes_another_one_for_a_minute_after_it_was_switched_on() {
        const S: u64 = 1_000_000_000;
        let on = PairingTime::of_start(ResetReason::PowerOn, 5 * S);
        let left = |after_s: f64| on.left_s(true, 5 * S + (after_s * 1e9) as u64);
        assert_eq!([left(0.0), left(0.5), left(59.5), left(60.0), left(1e6)], [60, 60, 1, 0, 0]);
        assert_eq!(on.left_s(false, 1000 * S), 255);
        for reason in [ResetReason::Watchdog, ResetReason::Unknown] {
            let restarted = PairingTime::of_start(reason, 5 * S);
            assert_eq!((restarted.left_s(true, 5 * S), restarted.left_s(false, 5 * S)), (0, 255));
        }
    }
}
