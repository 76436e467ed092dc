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
    /// The time under way, to the box and back.
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

/// The exchange with the shortest time under way: its offset is the most certain.
#[must_use]
pub fn surest(exchanges: &[Exchange]) -> Option<&Exchange> {
    exchanges.iter().min_by_key(|exchange| exchange.round_trip_ns())
}

/// How much faster the box's clock runs than this computer's, and how uncertain that is at
/// most, in ppm: from the most certain exchanges of the first and of the last third. What lies
/// between keeps them apart, wherever the most certain of all are.
///
/// `None` without exchanges a second apart.
#[must_use]
pub fn drift_ppm(exchanges: &[Exchange]) -> Option<(f64, f64)> {
    let third = exchanges.len().div_ceil(3);
    let (first, second) = (&exchanges[..third], &exchanges[exchanges.len() - third..]);
    let (first, second) = (surest(first)?, surest(second)?);
    let between_ns = second.host_sent_ns.checked_sub(first.host_sent_ns)? as f64;
    let uncertain_ns = 0.5 * (first.round_trip_ns() as f64 + second.round_trip_ns() as f64);
    (between_ns >= 1e9).then(|| {
        let drift = (second.offset_ns() - first.offset_ns()) / between_ns;
        (1e6 * drift, 1e6 * uncertain_ns / between_ns)
    })
}

/// How the box's clock relates to this computer's, over one run of the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// The most certain exchange; the rest is measured from it.
    anchor: Exchange,
    /// How much faster the box's clock runs, and how uncertain that is at most; `None` where the
    /// exchanges lie too close together to tell, and it is taken as 0.
    pub drift_ppm: Option<(f64, f64)>,
    /// The largest error of the drift, ppm.
    pace_doubt_ppm: f64,
}

/// Two quartz clocks differ by less, at a temperature at which people stand.
const QUARTZ_PPM: f64 = 100.0;

impl Relation {
    /// By the exchanges with the shortest times under way; `None` without one.
    #[must_use]
    pub fn of(exchanges: &[Exchange]) -> Option<Self> {
        let anchor = *surest(exchanges)?;
        let measured = drift_ppm(exchanges);
        // A drift below its own uncertainty counts as not measured, but may exist.
        let drift_ppm = measured.filter(|(drift, uncertain)| drift.abs() > *uncertain);
        let pace_doubt_ppm = match (drift_ppm, measured) {
            (Some((_, uncertain)), _) => uncertain,
            (None, Some((drift, uncertain))) => QUARTZ_PPM.min(drift.abs() + uncertain),
            (None, None) => QUARTZ_PPM,
        };
        Some(Self { anchor, drift_ppm, pace_doubt_ppm })
    }

    /// The box's clock minus this computer's, at the most certain exchange.
    #[must_use]
    pub fn offset_ns(&self) -> f64 {
        self.anchor.offset_ns()
    }

    /// The largest error of the offset.
    #[must_use]
    pub fn uncertain_ns(&self) -> f64 {
        0.5 * self.anchor.round_trip_ns() as f64
    }

    /// What relates the clocks at this time is wrong by this at most: the further from the
    /// surest exchange, the more.
    #[must_use]
    pub fn uncertain_ns_at(&self, host_ns: u64) -> f64 {
        let away_ns = host_ns.abs_diff(self.anchor.host_sent_ns) as f64;
        self.uncertain_ns() + 1e-6 * self.pace_doubt_ppm * away_ns
    }

    /// The time of this computer's clock at that of the box's.
    #[must_use]
    pub fn host_ns(&self, box_ns: u64) -> f64 {
        // Differences first: an f64 holds no absolute nanoseconds.
        let since_ns = box_ns.wrapping_sub(self.anchor.box_received_ns).cast_signed() as f64;
        self.anchor.box_received_ns as f64 - self.offset_ns() + since_ns / self.pace()
    }

    /// The time of the box's clock at that of this computer's, from `box_from_ns` on.
    #[must_use]
    pub fn box_ns_since(&self, host_ns: u64, box_from_ns: u64) -> f64 {
        (host_ns as f64 - self.host_ns(box_from_ns)) * self.pace()
    }

    fn pace(&self) -> f64 {
        1.0 + 1e-6 * self.drift_ppm.map_or(0.0, |(drift, _)| drift)
    }
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
    fn a_drift_is_found_though_the_soonest_answers_lie_close_together() {
        let mut exchanges = exchanges(7, 300.0);
        for exchange in &mut exchanges[24..26] {
            exchange.host_received_ns = exchange.host_sent_ns + 60_000;
        }
        let (drift_ppm, uncertain_ppm) = drift_ppm(&exchanges).expect("they span 5 s");
        assert!((drift_ppm - 300.0).abs() <= uncertain_ppm, "{drift_ppm} +- {uncertain_ppm}");
        assert!(uncertain_ppm < 1_000.0, "{uncertain_ppm}");
    }

    #[test]
    fn a_time_of_the_box_becomes_one_of_this_computer_and_back() {
        let relation = Relation::of(&exchanges(5_000_000_000, 300.0)).unwrap();
        // Half of the shortest round trip, and what the drift gains in the 5 s watched.
        assert!((relation.uncertain_ns() - 100_000.0).abs() < 100.0);
        for host_ns in [0_u64, 2_000_000_000, 5_000_000_000] {
            let box_ns = host_ns + 5_000_000_000 + (host_ns as f64 * 300e-6) as u64;
            let found_ns = relation.host_ns(box_ns);
            // What it is said to be, and the rounding of the test's own clock.
            let within_ns = relation.uncertain_ns_at(host_ns) + 2.0;
            assert!((found_ns - host_ns as f64).abs() <= within_ns, "{host_ns}: {found_ns}");
            let back_ns = relation.box_ns_since(host_ns, box_ns);
            assert!((back_ns + found_ns - host_ns as f64).abs() < 1e3, "{back_ns}");
        }
        assert_eq!(Relation::of(&[]), None);
        // Five exchanges within half a second say nothing of a drift: ten minutes later the
        // clocks may be 60 ms apart.
        let short = Relation::of(&exchanges(0, 50.0)[..5]).unwrap();
        assert_eq!(short.drift_ppm, None);
        let later_ns = 600_000_000_000;
        assert!((short.uncertain_ns_at(later_ns) - 6e7).abs() < 5e5);
        let found_ns = short.host_ns(later_ns + 30_000_000);
        assert!((found_ns - later_ns as f64).abs() <= short.uncertain_ns_at(later_ns));
    }

    #[test]
    fn what_cannot_be_compared_is_not() {
        assert_eq!(drift_ppm(&[]), None);
        let exchanges = exchanges(0, 0.0);
        assert_eq!(drift_ppm(&exchanges[..1]), None);
        assert_eq!(drift_ppm(&exchanges[..5]), None);
        assert!(surest(&[]).is_none());
        // As a spoiled recording may have them: each was under way for all of the clock's range.
        let spoiled = Exchange {
            host_sent_ns: 0,
            box_received_ns: 9,
            box_sent_ns: 9,
            host_received_ns: u64::MAX,
        };
        assert_eq!(drift_ppm(&[spoiled; 2]), None);
    }
}
