//! The account of one start's frames, against a set of the numbers that have come.
//!
//! - What came is told from what had come, what was overtaken from what was not, one by one.
//! - The sums agree: what came, and what lies between the first and the last and did not. If nothing
//!   is lost, nothing is said to be.
//! - So they do whatever comes: packets that no camera and no network can have made.

use std::collections::BTreeSet;
use std::ops::Range;

use plumbline_stream::accounting::{Accounting, Arrival, Counts};
use proptest::prelude::*;

use crate::laws::Tries;

/// Less than a packet may be under way: see `DELAY_NS_MAX` in `accounting.rs`.
const DELAY_MS_MAX: u16 = 9_000;

/// What becomes of one frame on its way to a host.
#[derive(Debug, Clone)]
pub struct Fate {
    /// Frames before it that the camera or the box has left out: they have no number.
    pub left_out: u8,
    /// When its packet comes after its capture: never, once, or more often.
    pub delays_ms: Vec<u16>,
}

/// The frames of one start, and their way.
#[derive(Debug, Clone)]
pub struct Journey {
    /// The number of the first frame; they wrap.
    pub first: u32,
    /// The camera's period.
    pub period_ns: u64,
    /// What becomes of each frame.
    pub fates: Vec<Fate>,
}

/// A packet at a host: which frame, and when it was captured and came.
#[derive(Debug, Clone, Copy)]
pub struct Come {
    /// Which frame of the start, from 0.
    pub index: u64,
    /// Its capture time, from 0.
    pub capture_ns: u64,
    /// Its arrival, by a clock that began with the box's.
    pub arrival_ns: u64,
}

/// Journeys of up to this many frames, each under way for less than this many milliseconds.
pub fn journeys(frames: usize, delay_ms: u16) -> impl Strategy<Value = Journey> {
    let delay = prop_oneof![
        6 => 0..3_u16.min(delay_ms),
        2 => 0..100_u16.min(delay_ms),
        1 => 0..delay_ms,
    ];
    let delays = prop_oneof![
        8 => proptest::collection::vec(delay.clone(), 1),
        2 => Just(Vec::new()),
        1 => proptest::collection::vec(delay, 2..4),
    ];
    let left_out = prop_oneof![9 => Just(0), 1 => 1..20_u8];
    let fate = (left_out, delays).prop_map(|(left_out, delays_ms)| Fate { left_out, delays_ms });
    let first = prop_oneof![Just(0), any::<u32>(), u32::MAX - 40..=u32::MAX];
    // The configuration allows 1 to 1,000 Hz.
    let period_ns = prop_oneof![Just(16_666_667), 1_000_000..1_000_000_000_u64];
    (first, period_ns, proptest::collection::vec(fate, 1..frames))
        .prop_map(|(first, period_ns, fates)| Journey { first, period_ns, fates })
}

impl Journey {
    /// The packets in the order in which they come.
    pub fn packets(&self) -> Vec<Come> {
        let mut packets = Vec::new();
        let mut capture_ns = 0;
        for (index, fate) in (0..).zip(&self.fates) {
            capture_ns += self.period_ns * (1 + u64::from(fate.left_out));
            packets.extend(fate.delays_ms.iter().map(|delay_ms| Come {
                index,
                capture_ns,
                arrival_ns: capture_ns + u64::from(*delay_ms) * 1_000_000,
            }));
        }
        packets.sort_by_key(|it| it.arrival_ns);
        packets
    }

    /// A frame's number.
    pub fn number(&self, index: u64) -> u32 {
        self.first.wrapping_add(index as u32)
    }
}

/// What has come, as a set.
#[derive(Debug, Default)]
pub struct Seen {
    came: BTreeSet<u64>,
    repeated: u64,
    late: u64,
}

impl Seen {
    /// Takes note of a frame; what its packet is.
    pub fn take(&mut self, index: u64) -> Arrival {
        let (first, last) = (self.came.first().copied(), self.came.last().copied());
        if !self.came.insert(index) {
            self.repeated += 1;
            return Arrival::Repeated;
        }
        match (first, last) {
            (Some(_), Some(last)) if index > last => Arrival::New { skipped: index - last - 1 },
            (None, _) | (_, None) => Arrival::First,
            _ => {
                self.late += 1;
                Arrival::Late
            }
        }
    }

    /// The frames between the first and the last, and what became of their packets.
    pub fn counts(&self) -> Counts {
        let received = self.came.len() as u64;
        let all = match (self.came.first(), self.came.last()) {
            (Some(first), Some(last)) => last - first + 1,
            _ => 0,
        };
        let Self { repeated, late, .. } = *self;
        Counts { received, lost: all - received, repeated, late, implausible: 0 }
    }
}

fn every_frame_is_told_once(tries: Tries) {
    tries.hold(
        "frames on their way from a box, lost, repeated and overtaken, against a set of those that came",
        "each was told for what it was, and each sum is right; nothing was said to be lost that was not",
        &(journeys(60, DELAY_MS_MAX), any::<u64>().prop_map(|it| it >> 1)),
        |(journey, begun_ns)| {
            let (mut accounting, mut seen) = (Accounting::default(), Seen::default());
            for Come { index, capture_ns, arrival_ns } in journey.packets() {
                let arrival =
                    accounting.pose(journey.number(index), capture_ns, begun_ns + arrival_ns);
                assert_eq!(arrival, seen.take(index), "frame {index}");
                assert_eq!(accounting.counts(), seen.counts(), "after frame {index}");
            }
        },
    );
}

#[test]
fn every_frame_is_told_once_for_what_it_is() {
    every_frame_is_told_once(Tries::few(1_000));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn every_frame_is_told_once_for_what_it_is_many_times() {
    every_frame_is_told_once(Tries::many(500_000));
}

/// A number, a capture time and a time of arrival that nobody has checked: mostly near each other.
fn wild() -> impl Strategy<Value = (u32, u64, u64)> {
    let near = |range: Range<u64>| prop_oneof![6 => range, 1 => any::<u64>()];
    let number = prop_oneof![6 => 0..50_u32, 1 => 0..20_000_u32, 1 => any::<u32>()];
    (number, near(0..2_000_000_000), near(0..20_000_000_000))
}

fn sums_agree_whatever_comes(tries: Tries) {
    tries.hold(
        "pose packets with any numbers and times",
        "each is counted once, and what is lost is what lies between the first and the last and did not \
         come",
        &proptest::collection::vec(wild(), 0..80),
        |packets| {
            let mut accounting = Accounting::default();
            // The numbers of the first and of the last frame that count, as they do not wrap.
            let (mut span, mut early) = (None::<u64>, 0);
            for (count, (number, capture_ns, arrival_ns)) in (1..).zip(packets) {
                let before = accounting.counts();
                let arrival = accounting.pose(number, capture_ns, arrival_ns);
                let Counts { received, lost, repeated, late, implausible } = accounting.counts();
                match arrival {
                    Arrival::First => span = Some(1),
                    Arrival::New { skipped } => span = span.map(|it| it + skipped + 1),
                    // One before the first makes what is watched longer.
                    Arrival::Late if lost + 1 != before.lost => {
                        span = span.map(|it| it + lost + 1 - before.lost);
                    }
                    Arrival::Early => early += 1,
                    Arrival::Implausible => {
                        assert_eq!(accounting.counts(), Counts { implausible, ..before });
                    }
                    _ => {}
                }
                assert_eq!(received + repeated + implausible + early, count, "{arrival:?}");
                assert_eq!(received + lost, span.unwrap_or(0), "{arrival:?}");
                assert!(late <= received + early);
            }
        },
    );
}

#[test]
fn sums_agree_for_whatever_comes() {
    sums_agree_whatever_comes(Tries::few(1_000));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn sums_agree_for_whatever_comes_many_times() {
    sums_agree_whatever_comes(Tries::many(500_000));
}
