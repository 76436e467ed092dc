//! What the sequence numbers of one start of a box say: which frames were lost, came twice or came
//! late, and which packets cannot be true.
//!
//! ```text
//! sequence      2 3 4   6 5   5 6   9   1
//! arrival       f n n   n l   r r   n   l       f first, n new, l late, r repeated
//! missing               1 0         2   2
//! ```
//!
//! Within one start, which each packet names, numbers rise by one with each frame, and capture times
//! rise with them. So a packet counts as late however late it comes, and a jump is judged by what a
//! camera can do in the time that has passed.

use std::collections::BTreeMap;

use plumbline::limits::RING_PACKETS;

/// The shortest period of a camera: the configuration allows 1 to 1,000 Hz.
const PERIOD_NS_MIN: u64 = 1_000_000;

/// Frames that may follow one another faster than the period: where the time is that of the
/// frame's arrival at the box, a few come at once after a computer was busy.
const BURST_MAX: u64 = 8;

/// A frame's packet is no longer under way than this, unless the box sends it again. If the box's
/// clock has gone on by more than this computer's since a packet that was not, a time is not true.
const DELAY_NS_MAX: u64 = 10_000_000_000;

/// The longest period of a camera.
const PERIOD_NS_MAX: u64 = 1_000_000_000;

/// Two quartz clocks differ by less.
const CLOCKS_PPM: u64 = 1000;

/// This number of packets in a row, each plausible after the one before, are believed although
/// the time between the clocks jumped: this computer slept, and its clock stood still.
const CONFIRMED_BY: u32 = 8;

/// Most gaps that are remembered: a frame of an older one would count as repeated.
const GAPS_MAX: usize = 4096;

/// How far before the first frame that came another may lie and still belong to what is received: as
/// far as the box's ring reaches, since a host asks for what it has missed.
const BEFORE_MAX: u64 = RING_PACKETS as u64;

/// What a pose packet is, judged by its number and its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The first one of this start.
    First,
    /// The next one, or a later one: those skipped are missing until now.
    New {
        /// Packets skipped between the last one and this one.
        skipped: u64,
    },
    /// One that was missing; it was overtaken on the way.
    Late,
    /// One from so long before the first that nobody can have asked for it: no part of what is
    /// received.
    Early,
    /// One that had already come.
    Repeated,
    /// One whose number or time cannot be true: more frames than a camera can take in the time
    /// since the one before, or a time that does not rise with the number. It changes nothing.
    Implausible,
}

impl Arrival {
    /// Whether the packet holds a frame that was not there before.
    #[must_use]
    pub fn is_frame(self) -> bool {
        matches!(self, Self::First | Self::New { .. } | Self::Late)
    }
}

/// Pose packets, by what became of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Different frames that came.
    pub received: u64,
    /// Frames that never came.
    pub lost: u64,
    /// Packets that came again.
    pub repeated: u64,
    /// Packets that came after a later one.
    pub late: u64,
    /// Packets whose number or time cannot be true.
    pub implausible: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        let Self { received, lost, repeated, late, implausible } = other;
        self.received += received;
        self.lost += lost;
        self.repeated += repeated;
        self.late += late;
        self.implausible += implausible;
    }
}

/// A frame: its number, which does not wrap, and its capture time.
#[derive(Debug, Clone, Copy)]
struct Place {
    number: i64,
    capture_ns: u64,
}

impl Place {
    /// Whether a camera can have taken `self` after `before`.
    fn may_follow(self, before: Self) -> bool {
        let Some(passed_ns) = self.capture_ns.checked_sub(before.capture_ns) else { return false };
        let frames = self.number.abs_diff(before.number);
        passed_ns > 0 && frames <= passed_ns / PERIOD_NS_MIN + BURST_MAX
    }

    /// Whether `before` can have been kept in the box's ring until `self` was taken, so that both
    /// came at once: the frames from the one to the other take that long.
    fn may_come_with(self, before: Self) -> bool {
        let frames = self.number.abs_diff(before.number);
        let passed_ns = self.capture_ns.saturating_sub(before.capture_ns);
        frames <= RING_PACKETS as u64 && passed_ns <= frames * PERIOD_NS_MAX
    }
}

/// Frames that are missing: up to this number, and captured between these times.
#[derive(Debug, Clone, Copy)]
struct Gap {
    last: i64,
    after_ns: u64,
    before_ns: u64,
}

/// A frame, and when its packet came.
#[derive(Debug, Clone, Copy)]
struct Come {
    place: Place,
    arrival_ns: u64,
}

/// The account of the frames of one start.
#[derive(Debug, Default)]
pub struct Accounting {
    counts: Counts,
    first: Option<Place>,
    /// The highest number that came.
    highest: Option<Place>,
    /// The packet that came soonest after its frame was taken, as far as is known.
    soonest: Option<Come>,
    /// What is missing, by the first number of each gap.
    gaps: BTreeMap<i64, Gap>,
    /// The latest packet that came too far ahead of this computer's clock, and how many before it
    /// agree with it.
    ahead: Option<(Come, u32)>,
}

impl Accounting {
    /// The counters.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes note of a pose packet that came at `arrival_ns` by this computer's monotonic clock,
    /// whose zero does not matter.
    pub fn pose(&mut self, sequence: u32, capture_ns: u64, arrival_ns: u64) -> Arrival {
        let arrival = self.judge(sequence, capture_ns, arrival_ns);
        match arrival {
            Arrival::First => {}
            Arrival::New { skipped } => self.counts.lost += skipped,
            Arrival::Late => {
                self.counts.lost -= 1;
                self.counts.late += 1;
            }
            Arrival::Early => self.counts.late += 1,
            Arrival::Repeated => self.counts.repeated += 1,
            Arrival::Implausible => self.counts.implausible += 1,
        }
        self.counts.received += u64::from(arrival.is_frame());
        arrival
    }

    fn judge(&mut self, sequence: u32, capture_ns: u64, arrival_ns: u64) -> Arrival {
        let (Some(first), Some(highest)) = (self.first, self.highest) else {
            let place = Place { number: sequence.into(), capture_ns };
            self.first = Some(place);
            self.highest = Some(place);
            self.soonest = Some(Come { place, arrival_ns });
            return Arrival::First;
        };
        // Numbers wrap after two years at 60 Hz; their difference is right all the same.
        let ahead = sequence.wrapping_sub(highest.number as u32).cast_signed();
        let place = Place { number: highest.number + i64::from(ahead), capture_ns };
        if ahead > 0 {
            return self.beyond(highest, Come { place, arrival_ns });
        }
        if place.number < first.number {
            return self.before(first, place);
        }
        self.within(place)
    }

    /// A number higher than all before.
    fn beyond(&mut self, highest: Place, now: Come) -> Arrival {
        if !now.place.may_follow(highest) {
            return Arrival::Implausible;
        }
        let is_in_time = self.soonest.is_some_and(|soonest| now.is_in_time(soonest));
        if !is_in_time && !now.place.may_come_with(highest) {
            let agreeing = match self.ahead {
                Some((last, agreeing))
                    if now.place.may_follow(last.place) && now.is_in_time(last) =>
                {
                    agreeing + 1
                }
                _ => 1,
            };
            if agreeing < CONFIRMED_BY {
                self.ahead = Some((now, agreeing));
                return Arrival::Implausible;
            }
        }
        self.ahead = None;
        self.highest = Some(now.place);
        if self.soonest.is_none_or(|soonest| now.came_as_soon_as(soonest)) {
            self.soonest = Some(now);
        }
        let skipped = now.place.number.abs_diff(highest.number) - 1;
        if skipped > 0 {
            self.miss(highest, now.place);
        }
        Arrival::New { skipped }
    }

    /// A number below the first that came.
    fn before(&mut self, first: Place, place: Place) -> Arrival {
        if !first.may_follow(place) {
            return Arrival::Implausible;
        }
        let frames = place.number.abs_diff(first.number);
        if frames > BEFORE_MAX {
            return Arrival::Early;
        }
        self.first = Some(place);
        // Those in between are missing now, and this one, until it is counted.
        self.counts.lost += frames;
        if frames > 1 {
            self.miss(place, first);
        }
        Arrival::Late
    }

    /// A number between the first and the highest: missing until now, or there before.
    fn within(&mut self, place: Place) -> Arrival {
        let gap = self.gaps.range(..=place.number).next_back().map(|(first, gap)| (*first, *gap));
        let Some((first, gap)) = gap.filter(|(_, gap)| place.number <= gap.last) else {
            return Arrival::Repeated;
        };
        if !(gap.after_ns < place.capture_ns && place.capture_ns < gap.before_ns) {
            return Arrival::Implausible;
        }
        self.gaps.remove(&first);
        if first < place.number {
            let before = Gap { last: place.number - 1, before_ns: place.capture_ns, ..gap };
            self.gaps.insert(first, before);
        }
        if place.number < gap.last {
            self.gaps.insert(place.number + 1, Gap { after_ns: place.capture_ns, ..gap });
        }
        Arrival::Late
    }

    /// What lies between two frames is missing.
    fn miss(&mut self, from: Place, to: Place) {
        let gap = Gap { last: to.number - 1, after_ns: from.capture_ns, before_ns: to.capture_ns };
        self.gaps.insert(from.number + 1, gap);
        if self.gaps.len() > GAPS_MAX {
            self.gaps.pop_first();
        }
    }
}

impl Come {
    /// Whether the box's clock has gone on by no more than this computer's and the longest delay.
    fn is_in_time(self, before: Self) -> bool {
        let [box_ns, host_ns, drift_ns] = self.passed_ns(before);
        box_ns <= host_ns.saturating_add(drift_ns).saturating_add(DELAY_NS_MAX)
    }

    /// Whether its delay was no longer, as far as the clocks tell.
    fn came_as_soon_as(self, before: Self) -> bool {
        let [box_ns, host_ns, drift_ns] = self.passed_ns(before);
        host_ns <= box_ns.saturating_add(drift_ns)
    }

    /// The time that has passed by the box's clock and by this computer's, and by how much the two
    /// may differ.
    fn passed_ns(self, before: Self) -> [u64; 3] {
        let box_ns = self.place.capture_ns.saturating_sub(before.place.capture_ns);
        let host_ns = self.arrival_ns.saturating_sub(before.arrival_ns);
        [box_ns, host_ns, host_ns / 1_000_000 * CLOCKS_PPM]
    }
}

#[cfg(test)]
mod tests {
    use super::Arrival::{Early, First, Implausible, Late, Repeated};
    use super::*;

    const NEXT: Arrival = Arrival::New { skipped: 0 };
    const FRAME_NS: u64 = 16_666_667;

    fn after(skipped: u64) -> Arrival {
        Arrival::New { skipped }
    }

    /// Sequence number, capture time in frames, and what it must be.
    type Come = (u32, u64, Arrival);

    /// All arrive at once.
    fn run(name: &str, packets: &[Come]) -> Counts {
        let mut accounting = Accounting::default();
        for (index, &(sequence, time, wanted)) in packets.iter().enumerate() {
            let arrival = accounting.pose(sequence, time * FRAME_NS, 0);
            assert_eq!(arrival, wanted, "{name}, packet {index}");
        }
        accounting.counts()
    }

    #[test]
    fn every_order_of_arrival_is_told_from_the_others() {
        let table: [(&str, &[Come], [u64; 5]); 10] = [
            // received, lost, repeated, late, implausible
            ("in order", &[(7, 7, First), (8, 8, NEXT)], [2, 0, 0, 0, 0]),
            ("lost", &[(0, 0, First), (4, 4, after(3))], [2, 3, 0, 0, 0]),
            (
                "reordered, then repeated",
                &[
                    (0, 0, First),
                    (2, 2, after(1)),
                    (1, 1, Late),
                    (1, 1, Repeated),
                    (2, 2, Repeated),
                    (0, 0, Repeated),
                    (3, 3, NEXT),
                ],
                [4, 0, 3, 1, 0],
            ),
            (
                "a gap filled from its middle",
                &[
                    (0, 0, First),
                    (6, 6, after(5)),
                    (3, 3, Late),
                    (3, 3, Repeated),
                    (5, 5, Late),
                    (1, 1, Late),
                    // Their times are those of frames that came.
                    (2, 3, Implausible),
                    (4, 5, Implausible),
                    (4, 4, Late),
                ],
                [6, 1, 1, 4, 2],
            ),
            (
                "wraps",
                &[(u32::MAX - 1, 1, First), (0, 3, after(1)), (u32::MAX, 2, Late), (1, 4, NEXT)],
                [4, 0, 0, 1, 0],
            ),
            (
                "the first ones reordered",
                &[(3, 3, First), (0, 0, Late), (1, 1, Late), (0, 0, Repeated), (4, 4, NEXT)],
                [4, 1, 1, 2, 0],
            ),
            (
                "asked for again, when others had come",
                &[
                    (9, 9, First),
                    (10, 10, NEXT),
                    (11, 11, NEXT),
                    (12, 12, NEXT),
                    (13, 13, NEXT),
                    (2, 2, Late),
                    (8, 8, Late),
                    (8, 8, Repeated),
                    (14, 14, NEXT),
                ],
                [8, 5, 1, 2, 0],
            ),
            (
                "from before anybody listened",
                &[
                    (20_000, 20_000, First),
                    (20_000 - BEFORE_MAX as u32 - 1, 50, Early),
                    (19_999, 20_001, Implausible),
                    (20_001, 20_001, NEXT),
                ],
                [2, 0, 0, 1, 1],
            ),
            (
                "times that do not rise with the number",
                &[(5, 50, First), (6, 50, Implausible), (7, 20, Implausible), (6, 51, NEXT)],
                [2, 0, 0, 0, 2],
            ),
            (
                "more frames than a camera takes in that time",
                &[
                    (0, 0, First),
                    (0x7FFF_FFF5, 1, Implausible),
                    (1000, 1, Implausible),
                    (1, 1, NEXT),
                    // 24 periods of 1 ms, within which a few frames come at once.
                    (25, 2, after(23)),
                    (67, 3, Implausible),
                ],
                [3, 23, 0, 0, 3],
            ),
        ];
        for (name, packets, [received, lost, repeated, late, implausible]) in table {
            let counts = Counts { received, lost, repeated, late, implausible };
            assert_eq!(run(name, packets), counts, "{name}");
        }
    }

    #[test]
    fn a_late_frame_of_any_age_is_late() {
        for rate_hz in [60, 200, 1000_u32] {
            let period_ns = 1_000_000_000 / u64::from(rate_hz);
            let late: Vec<u32> = (0..8).map(|index| rate_hz * index / 2 + 1).collect();
            // 2.5 s late, and a minute.
            for delay in [5 * rate_hz / 2, 60 * rate_hz] {
                let mut accounting = Accounting::default();
                for now in 0..70 * rate_hz {
                    let at_ns = u64::from(now) * period_ns;
                    let mut arrive =
                        |number: u32| accounting.pose(number, u64::from(number) * period_ns, at_ns);
                    if !late.contains(&now) {
                        assert!(arrive(now).is_frame());
                    }
                    if let Some(before) = now.checked_sub(delay).filter(|it| late.contains(it)) {
                        assert_eq!(arrive(before), Late, "{before} at {rate_hz} Hz");
                    }
                }
                let received = u64::from(70 * rate_hz);
                let counts = Counts { received, late: 8, ..Counts::default() };
                assert_eq!(accounting.counts(), counts, "{rate_hz} Hz");
            }
        }
    }

    /// The capture time of a frame runs ahead of this computer's clock by an hour.
    #[test]
    fn one_time_that_jumps_ahead_is_not_believed_and_a_computer_that_slept_goes_on() {
        const HOUR_NS: u64 = 3_600_000_000_000;
        let mut accounting = Accounting::default();
        let mut pose = |number: u32, ahead_ns: u64| {
            let at_ns = u64::from(number) * FRAME_NS;
            accounting.pose(number, at_ns + ahead_ns, at_ns)
        };
        assert_eq!((pose(0, 0), pose(1, 0)), (First, NEXT));
        assert_eq!((pose(1000, HOUR_NS), pose(2, 0)), (Implausible, NEXT));
        let asleep = u32::try_from(HOUR_NS / FRAME_NS).unwrap();
        for number in asleep..asleep + CONFIRMED_BY - 1 {
            assert_eq!(pose(number, HOUR_NS), Implausible);
        }
        let last = asleep + CONFIRMED_BY - 1;
        assert_eq!(pose(last, HOUR_NS), after(u64::from(last) - 3));
        assert_eq!(pose(last + 1, HOUR_NS), NEXT);
        // The computer was awake, but busy for as long as a packet may be under way.
        assert_eq!(pose(last + 500, HOUR_NS + 9_000_000_000), after(498));
    }

    /// The network was down for 50 s; then the box sends all of that time again, in any order with
    /// what it takes meanwhile, and last of all what it took before its camera stood still.
    #[test]
    fn what_the_box_has_kept_comes_at_once_and_counts() {
        const RATE_HZ: u64 = 60;
        let orders: [fn(u64) -> u64; 3] = [
            |index| index,
            // Two of the old ones, and one of the new ones.
            |index| if index % 3 == 2 { 3000 + index / 3 } else { index / 3 * 2 + index % 3 },
            |index| 4499 - index,
        ];
        for (number, order) in orders.into_iter().enumerate() {
            for first in [0, 60] {
                let mut accounting = Accounting::default();
                let mut pose =
                    |index: u64, at_ns: u64| accounting.pose(index as u32, index * FRAME_NS, at_ns);
                // Heard before, or not.
                for index in 0..first {
                    assert!(pose(index, index * FRAME_NS).is_frame());
                }
                let now_ns = 4500 * FRAME_NS;
                for index in (0..4500).map(order).filter(|it| *it >= first) {
                    let arrival = pose(index, now_ns + 1_000 * index);
                    assert!(arrival.is_frame(), "order {number}, frame {index} is {arrival:?}");
                }
                assert_eq!(accounting.counts().lost, 0, "order {number}");
            }
        }
        // A camera that stood still for 40 s of it: one frame, and the next.
        let mut accounting = Accounting::default();
        assert_eq!(accounting.pose(0, FRAME_NS, FRAME_NS), First);
        let back_ns = 50 * RATE_HZ * FRAME_NS;
        assert_eq!(accounting.pose(1, 2 * FRAME_NS, back_ns), NEXT);
        assert_eq!(accounting.pose(2, back_ns, back_ns + 1), NEXT);
    }

    /// As a spoiled recording may have them.
    #[test]
    fn times_at_the_ends_of_their_range_are_judged() {
        let mut accounting = Accounting::default();
        assert_eq!(accounting.pose(0, 0, 0), First);
        assert_eq!(accounting.pose(1, 1, u64::MAX), NEXT);
        // As much time has passed as since the first, by both clocks.
        assert_eq!(accounting.pose(2, u64::MAX, u64::MAX), NEXT);
        let mut accounting = Accounting::default();
        assert_eq!(accounting.pose(0, 0, u64::MAX), First);
        assert_eq!(accounting.pose(1, u64::MAX, u64::MAX), Implausible);
    }

    #[test]
    fn the_memory_of_gaps_is_bounded() {
        let mut accounting = Accounting::default();
        for number in (0..20_000).step_by(2) {
            accounting.pose(number, u64::from(number) * FRAME_NS, 0);
        }
        assert_eq!(accounting.gaps.len(), GAPS_MAX);
        assert_eq!(accounting.pose(1, FRAME_NS, 0), Repeated);
        assert_eq!(accounting.counts().lost, 9_999);
    }
}
