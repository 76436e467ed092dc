//! Two clocks, compared by questions and their answers.

/// One question and its answer: sent and received by this computer's clock, received and
/// answered by the box's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exchange {
    /// This computer's clock when the question left.
    pub host_sent_ns: u64,
    /// The box's clock when it took the question.
    pub box_received_ns: u64,
    /// The box's clock when the answer left.
    pub box_sent_ns: u64,
    /// This computer's clock when the answer came.
    pub host_received_ns: u64,
}

impl Exchange {
    /// The time under way, there and back.
    #[must_use]
    pub fn round_trip_ns(&self) -> u64 {
        let all = self.host_received_ns.saturating_sub(self.host_sent_ns);
        all.saturating_sub(self.box_sent_ns.saturating_sub(self.box_received_ns))
    }

    /// The box's clock minus this computer's, if both ways took the same time; it is wrong by
    /// half of the round trip at most.
    fn offset_ns(&self) -> f64 {
        let difference = |of: u64, to: u64| of.wrapping_sub(to).cast_signed() as f64;
        let there = difference(self.box_received_ns, self.host_sent_ns);
        let back = difference(self.box_sent_ns, self.host_received_ns);
        0.5 * (there + back)
    }
}

/// The exchange with the shortest time under way: its offset is the surest.
#[must_use]
pub fn surest(exchanges: &[Exchange]) -> Option<&Exchange> {
    exchanges.iter().min_by_key(|exchange| exchange.round_trip_ns())
}

/// How much faster the box's clock runs than this computer's, and how uncertain that is at
/// most, in millionths: by the surest exchange of the first half and that of the second.
///
/// `None` without exchanges a second apart.
#[must_use]
pub fn drift_ppm(exchanges: &[Exchange]) -> Option<(f64, f64)> {
    let (first, second) = exchanges.split_at(exchanges.len() / 2);
    let (first, second) = (surest(first)?, surest(second)?);
    let between_ns = second.host_sent_ns.checked_sub(first.host_sent_ns)? as f64;
    let uncertain_ns = 0.5 * (first.round_trip_ns() + second.round_trip_ns()) as f64;
    (between_ns >= 1e9).then(|| {
        let drift = (second.offset_ns() - first.offset_ns()) / between_ns;
        (1e6 * drift, 1e6 * uncertain_ns / between_ns)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box whose clock is ahead and runs faster, asked ten times a second over ways that
    /// take more or less long.
    fn exchanges(ahead_ns: i64, faster_ppm: f64) -> Vec<Exchange> {
        let on_box = |host_ns: u64| {
            let gained = (host_ns as f64 * faster_ppm * 1e-6) as i64;
            host_ns.wrapping_add_signed(ahead_ns + gained)
        };
        (0..50_u64)
            .map(|index| {
                let sent = index * 100_000_000;
                let there = 100_000 + (index * 7919 % 17) * 1_000_000;
                let back = 100_000 + (index % 5) * 100_000;
                Exchange {
                    host_sent_ns: sent,
                    box_received_ns: on_box(sent + there),
                    box_sent_ns: on_box(sent + there + 50_000),
                    host_received_ns: sent + there + 50_000 + back,
                }
            })
            .collect()
    }

    #[test]
    fn offset_and_drift_are_found_within_what_they_are_said_to_be() {
        for (ahead_ns, faster_ppm) in [(5_000_000_000, 0.0), (-1, 300.0), (7, -500.0)] {
            let exchanges = exchanges(ahead_ns, faster_ppm);
            let best = surest(&exchanges).unwrap();
            assert!(best.round_trip_ns().abs_diff(200_000) < 100, "{best:?}");
            let gained_ns = best.host_sent_ns as f64 * faster_ppm * 1e-6;
            assert!((best.offset_ns() - ahead_ns as f64 - gained_ns).abs() <= 100_100.0);
            let (drift_ppm, uncertain_ppm) = drift_ppm(&exchanges).unwrap();
            assert!((drift_ppm - faster_ppm).abs() <= uncertain_ppm, "{drift_ppm}");
            assert!(uncertain_ppm < 600.0, "{uncertain_ppm}");
        }
    }

    #[test]
    fn what_cannot_be_compared_is_not() {
        assert_eq!(drift_ppm(&[]), None);
        let exchanges = exchanges(0, 0.0);
        assert_eq!(drift_ppm(&exchanges[..1]), None);
        assert_eq!(drift_ppm(&exchanges[..5]), None);
        assert!(surest(&[]).is_none());
    }
}
