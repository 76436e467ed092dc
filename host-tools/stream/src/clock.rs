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
///
/// Later times of the one are never earlier times of the other, whatever the exchanges say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// The most certain exchange; the rest is measured from it.
    anchor: Exchange,
    /// How much faster the box's clock runs, and how uncertain that is at most; `None` where the
    /// exchanges do not tell it from 0.
    pub drift_ppm: Option<(f64, f64)>,
    /// The drift that times are told by, and its largest error, ppm.
    pace_ppm: (f64, f64),
    /// By how much the clocks have jumped against each other meanwhile, at most: 0 unless the exchanges
    /// say that one of them has stood still, as that of a computer that sleeps does.
    jumped_ns: f64,
}

/// Two quartz clocks differ by less, at a temperature at which people stand.
const QUARTZ_PPM: f64 = 100.0;

/// Two clocks of which both are being corrected differ by less: what seems to be more is no pace.
const PACE_PPM_MAX: f64 = 2000.0;

impl Relation {
    /// By the exchanges with the shortest times under way; `None` without one.
    #[must_use]
    pub fn of(exchanges: &[Exchange]) -> Option<Self> {
        let anchor = *surest(exchanges)?;
        let is_pace = |(drift, _): &(f64, f64)| drift.abs() <= PACE_PPM_MAX;
        let pace_ppm = match drift_ppm(exchanges).filter(is_pace) {
            None => (0.0, QUARTZ_PPM),
            Some((drift, uncertain)) => {
                let (least, most) =
                    ((drift - uncertain).max(-QUARTZ_PPM), (drift + uncertain).min(QUARTZ_PPM));
                // What is known better without the exchanges, unless they say that one of the clocks
                // is being corrected.
                let is_by_quartz = uncertain >= QUARTZ_PPM && least <= most;
                if is_by_quartz {
                    (0.5 * (least + most), 0.5 * (most - least))
                } else {
                    (drift, uncertain)
                }
            }
        };
        let drift_ppm = Some(pace_ppm).filter(|(drift, uncertain)| drift.abs() > *uncertain);
        let mut relation = Self { anchor, drift_ppm, pace_ppm, jumped_ns: 0.0 };
        let jumps_ns = exchanges.iter().map(|exchange| relation.jumped_ns(exchange));
        relation.jumped_ns = jumps_ns.fold(0.0, f64::max);
        Some(relation)
    }

    /// By how much the clocks have jumped at most between the anchor and this exchange: 0 where what is
    /// uncertain of both explains that they do not agree.
    fn jumped_ns(&self, exchange: &Exchange) -> f64 {
        let since_ns = exchange.host_sent_ns.wrapping_sub(self.anchor.host_sent_ns).cast_signed();
        let gained_ns = 1e-6 * self.pace_ppm.0 * since_ns as f64;
        let off_ns = (exchange.offset_ns() - self.offset_ns() - gained_ns).abs();
        let uncertain_ns =
            0.5 * exchange.round_trip_ns() as f64 + self.uncertain_ns_at(exchange.host_sent_ns);
        // A little more than that is what the clocks gain while a question is under way.
        let is_explained = off_ns <= 1.01 * uncertain_ns + 1000.0;
        if is_explained { 0.0 } else { off_ns + uncertain_ns }
    }

    /// The box's clock minus this computer's, at the most certain exchange.
    #[must_use]
    pub fn offset_ns(&self) -> f64 {
        self.anchor.offset_ns()
    }

    /// The largest error of the offset.
    #[must_use]
    pub fn uncertain_ns(&self) -> f64 {
        0.5 * self.anchor.round_trip_ns() as f64 + self.jumped_ns
    }

    /// What relates the clocks at this time is wrong by this at most: the further from the
    /// surest exchange, the more.
    #[must_use]
    pub fn uncertain_ns_at(&self, host_ns: u64) -> f64 {
        let away_ns = host_ns.abs_diff(self.anchor.host_sent_ns) as f64;
        self.uncertain_ns() + 1e-6 * self.pace_ppm.1 * away_ns
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
        1.0 + 1e-6 * self.pace_ppm.0
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

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

    /// A box that is watched as a desk watches one: asked eight times in the first second, and once a
    /// second from then on. Each way takes 0.15 ms at least, more by chance and, one time in
    /// twenty, up to 15 ms more, because a computer is busy; neither way knows of the other. With the
    /// true drift, and by how much the box's clock is ahead at the beginning, of [`box_ns`].
    fn watched(seconds: u64, random: &mut ChaCha8Rng) -> (Vec<Exchange>, f64, i64) {
        let drift_ppm = random.random_range(-80.0..80.0);
        let ahead_ns = random.random_range(-1_000_000_000_000..1_000_000_000_000);
        let mut way_ns = |mean_ns: f64| {
            let by_chance = -mean_ns * (1.0 - random.random::<f64>()).ln();
            let is_busy = random.random_bool(0.05);
            let busy = if is_busy { 15e6 * random.random::<f64>() } else { 0.0 };
            (150_000.0 + by_chance + busy) as u64
        };
        let begun_ns = 3_000_000_000_000_u64;
        let at_first = (0..8).map(|index| 100_000_000 * index);
        let sent = at_first.chain((1..seconds).map(|second| 700_000_000 + SECOND_NS * second));
        let exchange = |since_ns: u64| {
            let host_sent_ns = begun_ns + since_ns;
            let taken_ns = host_sent_ns + way_ns(200_000.0);
            let answered_ns = taken_ns + 50_000;
            Exchange {
                host_sent_ns,
                box_received_ns: box_ns(taken_ns, begun_ns, drift_ppm, ahead_ns),
                box_sent_ns: box_ns(answered_ns, begun_ns, drift_ppm, ahead_ns),
                host_received_ns: answered_ns + way_ns(300_000.0),
            }
        };
        (sent.map(exchange).collect(), drift_ppm, ahead_ns)
    }

    const SECOND_NS: u64 = 1_000_000_000;

    fn box_ns(host_ns: u64, begun_ns: u64, drift_ppm: f64, ahead_ns: i64) -> u64 {
        let gained_ns = 1e-6 * drift_ppm * (host_ns - begun_ns) as f64;
        (host_ns + 2_000_000_000_000).wrapping_add_signed(ahead_ns + gained_ns.round() as i64)
    }

    /// The largest of 300 histories of this length: of the rate's error, ppm, where a rate is measured; of
    /// the time's error at the end, and of what is stated of that, microseconds.
    fn largest(seconds: u64) -> [f64; 3] {
        let mut random = ChaCha8Rng::seed_from_u64(seconds);
        let mut largest = [0.0_f64; 3];
        for _ in 0..300 {
            let (exchanges, drift_ppm, ahead_ns) = watched(seconds, &mut random);
            let relation = Relation::of(&exchanges).unwrap();
            let rate_error = relation.drift_ppm.map_or(0.0, |(found_ppm, uncertain_ppm)| {
                let error_ppm = (found_ppm - drift_ppm).abs();
                assert!(error_ppm <= uncertain_ppm, "{found_ppm} +- {uncertain_ppm}: {drift_ppm}");
                error_ppm
            });
            let begun_ns = exchanges[0].host_sent_ns;
            let end_ns = exchanges.last().unwrap().host_received_ns;
            for host_ns in [begun_ns, begun_ns.midpoint(end_ns), end_ns, end_ns + SECOND_NS] {
                let found_ns = relation.host_ns(box_ns(host_ns, begun_ns, drift_ppm, ahead_ns));
                let error_ns = (found_ns - host_ns as f64).abs();
                let stated_ns = relation.uncertain_ns_at(host_ns);
                // A nanosecond for rounding.
                assert!(error_ns <= stated_ns + 1.0, "{error_ns} ns where {stated_ns} are stated");
                if host_ns == end_ns {
                    let now = [rate_error, 1e-3 * error_ns, 1e-3 * stated_ns];
                    largest.iter_mut().zip(now).for_each(|(most, it)| *most = most.max(it));
                }
            }
        }
        largest
    }

    /// The quickest of a few answers was under way for 0.3 ms and a little more, one way for up to 0.1 ms
    /// longer than the other: by half of that its time is wrong. The rest is the rate, over the time since
    /// then: in 3 s it is that of quartz, and from 10 s on it is measured, by a millisecond and less in
    /// what lies between the first and the last third. What is stated has to allow for ways that differ
    /// by all of their times.
    #[test]
    fn times_and_rates_are_as_true_as_one_sided_delays_allow() {
        for (seconds, rate_ppm, error_us, stated_us) in [
            (3, 0.0, 290.0, 640.0),
            (10, 28.0, 490.0, 1320.0),
            (60, 3.6, 210.0, 1110.0),
            (600, 0.15, 50.0, 820.0),
        ] {
            let found = largest(seconds);
            let bounds = [rate_ppm, error_us, stated_us];
            let is_within = found.iter().zip(&bounds).all(|(it, bound)| it <= bound);
            assert!(is_within, "{seconds} s: {found:.2?}, not within {bounds:?}");
        }
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
