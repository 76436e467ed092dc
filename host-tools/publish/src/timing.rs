//! When a frame was captured, by this computer's clock.
//!
//! A camera's frames have times of the box's clock, which answers to pings relate to this computer's
//! ([`Relation`]). Where there is no answer (a serial line without a way back), or where the frames
//! have the times of a recording that the box replays, their arrival is all there is: each packet says how long
//! after its capture it left the box, and of many the one that was least under way is taken as not
//! delayed. Such times are late by what that one took.

use std::collections::VecDeque;

use plumbline::packet::{MarkedInstant, PosePacket};
use plumbline_stream::clock::{Exchange, Relation, surest};

/// The answers that count: of ten minutes, at one a second.
const EXCHANGES_MAX: usize = 600;

/// And the latest of them, of a minute: the pace of a clock follows its temperature.
const EXCHANGES_LATEST: usize = 60;

/// Answers after which nothing is waited for.
const EXCHANGES_ENOUGH: usize = 3;

/// How long more answers are waited for, and frames that show what is not delayed.
const SETTLING_NS: u64 = 1_000_000_000;

/// A box that has not answered by then, does not.
const ANSWERED_WITHIN_NS: u64 = 2_500_000_000;

/// The least delayed frame is looked for among so many, and as many before.
const SOONEST_FRAMES: u32 = 256;

/// What a packet may be under way where nothing tells: a slow serial line.
const UNKNOWN_NS: f64 = 1e8;

/// The times of one session.
#[derive(Debug, Default)]
pub struct Timing {
    exchanges: VecDeque<Exchange>,
    relation: Option<Relation>,
    first_answer_ns: Option<u64>,
    soonest: Soonest,
    first_frame_ns: Option<u64>,
    is_replay: bool,
}

/// From the box's clock to this computer's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mapping {
    /// By answers.
    Answers(Relation),
    /// By arrival.
    Arrivals {
        /// This computer's clock minus the frames'.
        ahead_ns: i64,
        /// What the least delayed frame took at most.
        error_ns: f64,
    },
}

impl Timing {
    /// The box has answered.
    pub fn answer(&mut self, exchange: Exchange) {
        self.first_answer_ns.get_or_insert(exchange.host_received_ns);
        if self.exchanges.len() == EXCHANGES_MAX {
            self.exchanges.pop_front();
        }
        self.exchanges.push_back(exchange);
        let all: &[Exchange] = self.exchanges.make_contiguous();
        let latest = &all[all.len().saturating_sub(EXCHANGES_LATEST)..];
        let error_ns = |relation: &Relation| relation.uncertain_ns_at(exchange.host_received_ns);
        let relations = [all, latest].into_iter().filter_map(Relation::of);
        self.relation = relations.min_by(|a, b| error_ns(a).total_cmp(&error_ns(b)));
    }

    /// A frame has come in its place.
    pub fn frame(&mut self, arrival_ns: u64, packet: &PosePacket) {
        self.first_frame_ns.get_or_insert(arrival_ns);
        self.is_replay |= packet.instant == MarkedInstant::Recording;
        self.soonest.take(arrival_ns.wrapping_sub(packet.handed_over_ns()).cast_signed());
    }

    /// Whether what is there suffices to place frames.
    #[must_use]
    pub fn is_settled(&self, now_ns: u64) -> bool {
        let Some(first_ns) = self.first_frame_ns else { return false };
        let since_first_ns = now_ns.saturating_sub(first_ns);
        if self.is_replay {
            return since_first_ns >= SETTLING_NS;
        }
        match self.first_answer_ns {
            Some(answer_ns) => {
                self.exchanges.len() >= EXCHANGES_ENOUGH
                    || now_ns.saturating_sub(answer_ns) >= SETTLING_NS
            }
            None => since_first_ns >= ANSWERED_WITHIN_NS,
        }
    }

    /// How the clocks are related now; `None` before the first frame.
    #[must_use]
    pub fn mapping(&self) -> Option<Mapping> {
        if let Some(relation) = self.relation.filter(|_| !self.is_replay) {
            return Some(Mapping::Answers(relation));
        }
        let quickest = surest(self.exchanges.as_slices().0);
        let error_ns = quickest.map_or(UNKNOWN_NS, |it| it.round_trip_ns() as f64);
        Some(Mapping::Arrivals { ahead_ns: self.soonest.least_ns()?, error_ns })
    }
}

impl Mapping {
    /// This computer's clock at that of the frames.
    #[must_use]
    pub fn host_ns(&self, frame_ns: u64) -> f64 {
        match self {
            Self::Answers(relation) => relation.host_ns(frame_ns),
            Self::Arrivals { ahead_ns, .. } => {
                frame_ns.wrapping_add_signed(*ahead_ns).cast_signed() as f64
            }
        }
    }

    /// The largest error of [`host_ns`](Self::host_ns) at this time of this computer's clock.
    #[must_use]
    pub fn error_s(&self, host_ns: f64) -> f64 {
        let error_ns = match self {
            // A time before the zero is as far from the answers as the zero.
            Self::Answers(relation) => relation.uncertain_ns_at(host_ns.max(0.0) as u64),
            Self::Arrivals { error_ns, .. } => *error_ns,
        };
        1e-9 * error_ns
    }
}

/// The least delay of the latest frames, plus a constant: the difference of the clocks.
#[derive(Debug, Default)]
struct Soonest {
    before_ns: Option<i64>,
    now_ns: Option<i64>,
    frames: u32,
}

impl Soonest {
    fn take(&mut self, delay_ns: i64) {
        if self.frames == SOONEST_FRAMES {
            *self = Self { before_ns: self.now_ns, now_ns: None, frames: 0 };
        }
        self.frames += 1;
        self.now_ns = Some(self.now_ns.map_or(delay_ns, |it| it.min(delay_ns)));
    }

    fn least_ns(&self) -> Option<i64> {
        self.now_ns.into_iter().chain(self.before_ns).min()
    }
}

#[cfg(test)]
mod tests {
    use plumbline_stream::fixture::pose_packet;

    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    fn frame(number: u64, instant: MarkedInstant) -> PosePacket {
        let capture_time_ns = 7_000 * SECOND_NS + number * SECOND_NS / 60;
        PosePacket { capture_time_ns, instant, latency_us: 1200, ..pose_packet(number as u32) }
    }

    /// The box's clock is ahead by 7000 s; each packet is under way for a little more or less than
    /// 2 ms after the 1.2 ms that it says.
    fn arrival_ns(number: u64) -> u64 {
        SECOND_NS + number * SECOND_NS / 60 + 3_200_000 + number * 7919 % 13 * 100_000
    }

    #[test]
    fn a_cameras_frames_are_placed_by_the_answers() {
        let mut timing = Timing::default();
        for number in 0..30 {
            timing.frame(arrival_ns(number), &frame(number, MarkedInstant::ExposureMiddle));
        }
        assert!(!timing.is_settled(arrival_ns(30)));
        for number in 0..3_u64 {
            let sent_ns = SECOND_NS + number * 100_000_000;
            let box_ns = 6_999 * SECOND_NS + sent_ns + 300_000;
            timing.answer(Exchange {
                host_sent_ns: sent_ns,
                box_received_ns: box_ns,
                box_sent_ns: box_ns,
                host_received_ns: sent_ns + 500_000,
            });
        }
        assert!(timing.is_settled(arrival_ns(30)));
        let mapping = timing.mapping().unwrap();
        let found_ns = mapping.host_ns(frame(600, MarkedInstant::ExposureMiddle).capture_time_ns);
        let error_ns = found_ns - 11.0 * 1e9;
        // Half of the round trip, less the true way of 0.3 ms.
        assert!((error_ns + 50_000.0).abs() < 1.0, "{error_ns}");
        assert!(error_ns.abs() <= 1e9 * mapping.error_s(found_ns));
    }

    #[test]
    fn frames_of_a_recording_and_of_a_silent_box_are_placed_by_their_arrival() {
        for (instant, waits_ns) in [
            (MarkedInstant::Recording, SETTLING_NS),
            (MarkedInstant::FrameArrival, ANSWERED_WITHIN_NS),
        ] {
            let mut timing = Timing::default();
            assert_eq!(timing.mapping(), None);
            for number in 0..2_000 {
                timing.frame(arrival_ns(number), &frame(number, instant));
            }
            assert!(!timing.is_settled(arrival_ns(0) + waits_ns - 1));
            assert!(timing.is_settled(arrival_ns(0) + waits_ns));
            let mapping = timing.mapping().unwrap();
            let found_ns = mapping.host_ns(frame(600, instant).capture_time_ns);
            assert!((found_ns - 11.0 * 1e9 - 2e6).abs() < 1.0, "{found_ns}");
            assert!((mapping.error_s(found_ns) - 0.1).abs() < 1e-12);
        }
    }

    #[test]
    fn a_way_that_becomes_longer_is_followed() {
        let mut soonest = Soonest::default();
        (0..SOONEST_FRAMES).for_each(|_| soonest.take(5));
        (0..2 * SOONEST_FRAMES).for_each(|_| soonest.take(9));
        assert_eq!(soonest.least_ns(), Some(9));
    }
}
