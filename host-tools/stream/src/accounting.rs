//! What the sequence numbers say: which packets were lost, came twice or came
//! late, and when the box restarted.
//!
//! ```text
//! sequence      0 1 2   4 3   5 5   8      0 1
//! arrival       n n n   n l   n r   n      S n       n new, l late, r repeated, S new session
//! missing               1 0         2      0
//! ```

use std::collections::VecDeque;

/// The number of frames by which a packet may be late. More than a second at 60 Hz: what is
/// older is not late, but the sequence of a box that restarted.
const WINDOW: usize = 128;

/// The number of packets that may have overtaken the first ones of a session.
const START_REORDER_MAX: u32 = 4;

/// Packets may be older than the one before by this much without meaning a restart:
/// they overtake each other, and a Log waits while a camera is being opened.
const UPTIME_SLACK_MS: u64 = 3000;

/// What a pose packet is, judged by its number and its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The next one, or a later one: those skipped are missing until now.
    New {
        /// Packets skipped between the last one and this one.
        skipped: u32,
    },
    /// One that was missing; it was overtaken on the way.
    Late,
    /// One that had already come.
    Repeated,
    /// The first one since a start of the box.
    NewSession,
}

/// Counters of all sessions together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Different pose packets that came.
    pub received: u64,
    /// Pose packets that never came.
    pub lost: u64,
    /// Pose packets that came again.
    pub repeated: u64,
    /// Pose packets that came after a later one.
    pub reordered: u64,
    /// The number of starts that the packets show, with frames or without.
    pub sessions: u32,
}

/// The account of one stream of packets.
#[derive(Debug, Default)]
pub struct Accounting {
    counts: Counts,
    boot_id: Option<u32>,
    uptime_ms: Option<u64>,
    /// The session has been counted: one of its packets came.
    counted: bool,
    /// The highest sequence number of this session; `None` when the next packet
    /// begins a session.
    highest: Option<u32>,
    /// Number and capture time of the latest packets, by number.
    recent: VecDeque<(u32, u64)>,
}

impl Accounting {
    /// The counters.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// True when the next pose packet begins a session, whatever its number.
    #[must_use]
    pub fn awaits_session(&self) -> bool {
        self.highest.is_none()
    }

    /// Takes note of a Hello; true when it comes from a box that restarted.
    pub fn hello(&mut self, boot_id: u32) -> bool {
        let known = self.boot_id.replace(boot_id);
        let anew = known.is_some_and(|known| known != boot_id);
        if anew {
            self.highest = None;
            self.uptime_ms = None;
            self.counted = false;
        }
        self.count_session();
        anew
    }

    /// Takes note of the time since the box's start, which Health and Log
    /// packets carry; true when the box restarted.
    pub fn uptime(&mut self, uptime_ms: u64) -> bool {
        let known = self.uptime_ms.replace(uptime_ms);
        let anew = known.is_some_and(|known| uptime_ms.saturating_add(UPTIME_SLACK_MS) < known);
        if anew {
            self.highest = None;
            self.boot_id = None;
            self.counted = false;
        }
        self.count_session();
        anew
    }

    /// Counts a session once, with the first of its packets of any kind.
    fn count_session(&mut self) {
        self.counts.sessions += u32::from(!self.counted);
        self.counted = true;
    }

    /// Takes note of a pose packet.
    pub fn pose(&mut self, sequence: u32, capture_time_ns: u64) -> Arrival {
        let arrival = self.arrival(sequence, capture_time_ns);
        match arrival {
            Arrival::New { skipped } => {
                self.counts.lost += u64::from(skipped);
                self.highest = Some(sequence);
            }
            Arrival::Late => {
                match self.recent.front() {
                    // Older than the session's first packet: those in between are missing now.
                    Some(&(first, _)) if sequence.wrapping_sub(first).cast_signed() < 0 => {
                        self.counts.lost += u64::from(first.wrapping_sub(sequence)) - 1;
                    }
                    _ => self.counts.lost -= 1,
                }
                self.counts.reordered += 1;
            }
            Arrival::Repeated => {
                self.counts.repeated += 1;
                return arrival;
            }
            Arrival::NewSession => {
                if self.highest.is_some() {
                    // Found by the number alone: what was known of the run
                    // before must not end this one a second time.
                    self.boot_id = None;
                    self.uptime_ms = None;
                    self.counted = false;
                }
                self.count_session();
                self.highest = Some(sequence);
                self.recent.clear();
            }
        }
        self.counts.received += 1;
        self.remember(sequence, capture_time_ns);
        arrival
    }

    fn arrival(&self, sequence: u32, capture_time_ns: u64) -> Arrival {
        let Some(highest) = self.highest else {
            return Arrival::NewSession;
        };
        // Numbers wrap after two years at 60 Hz; their difference is right all the same.
        let ahead = sequence.wrapping_sub(highest).cast_signed();
        if ahead > 0 {
            let time = self.recent.back().map_or(0, |&(_, time)| time);
            // A clock that went back although the number went on: another run.
            if capture_time_ns <= time {
                return Arrival::NewSession;
            }
            return Arrival::New { skipped: ahead.unsigned_abs() - 1 };
        }
        let behind = |entry: u32| entry.wrapping_sub(sequence).cast_signed();
        let first = self.recent.partition_point(|&(entry, _)| behind(entry) < 0);
        match self.recent.get(first) {
            Some(&(entry, time)) if entry == sequence => {
                if time == capture_time_ns {
                    Arrival::Repeated
                } else {
                    Arrival::NewSession
                }
            }
            // Late, if it was missed in this session and its time fits in between.
            Some(&(_, after)) if first > 0 => {
                let (_, before) = self.recent[first - 1];
                if before < capture_time_ns && capture_time_ns < after {
                    Arrival::Late
                } else {
                    Arrival::NewSession
                }
            }
            Some(&(entry, after))
                if self.recent.len() <= START_REORDER_MAX as usize
                    && behind(entry) <= START_REORDER_MAX.cast_signed()
                    && capture_time_ns < after =>
            {
                Arrival::Late
            }
            _ => Arrival::NewSession,
        }
    }

    fn remember(&mut self, sequence: u32, capture_time_ns: u64) {
        let at = self
            .recent
            .partition_point(|&(entry, _)| entry.wrapping_sub(sequence).cast_signed() < 0);
        self.recent.insert(at, (sequence, capture_time_ns));
        if self.recent.len() > WINDOW {
            self.recent.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    enum Event {
        /// Sequence number, capture time in frames, and what it must be.
        Pose(u32, u64, Arrival),
        Hello(u32, bool),
        Uptime(u64, bool),
    }
    use Arrival::{Late, NewSession, Repeated};
    use Event::{Hello, Pose, Uptime};

    const NEXT: Arrival = Arrival::New { skipped: 0 };

    fn after(skipped: u32) -> Arrival {
        Arrival::New { skipped }
    }

    fn run(name: &str, events: &[Event]) -> Counts {
        let mut accounting = Accounting::default();
        for (index, event) in events.iter().enumerate() {
            match *event {
                Pose(sequence, time, wanted) => {
                    assert_eq!(accounting.pose(sequence, time), wanted, "{name}, event {index}");
                }
                Hello(boot, wanted) => {
                    assert_eq!(accounting.hello(boot), wanted, "{name}, event {index}");
                }
                Uptime(time, wanted) => {
                    assert_eq!(accounting.uptime(time), wanted, "{name}, event {index}");
                }
            }
        }
        accounting.counts()
    }

    #[test]
    fn every_order_of_arrival_is_told_from_the_others() {
        let table: [(&str, &[Event], [u64; 5]); 16] = [
            // received, lost, repeated, reordered, sessions
            ("in order", &[Pose(7, 7, NewSession), Pose(8, 8, NEXT)], [2, 0, 0, 0, 1]),
            ("lost", &[Pose(0, 0, NewSession), Pose(4, 4, after(3))], [2, 3, 0, 0, 1]),
            (
                "reordered, then repeated",
                &[
                    Pose(0, 0, NewSession),
                    Pose(2, 2, after(1)),
                    Pose(1, 1, Late),
                    Pose(1, 1, Repeated),
                    Pose(2, 2, Repeated),
                    Pose(0, 0, Repeated),
                    Pose(3, 3, NEXT),
                ],
                [4, 0, 3, 1, 1],
            ),
            (
                "wraps",
                &[
                    Pose(u32::MAX - 1, 1, NewSession),
                    Pose(0, 3, after(1)),
                    Pose(u32::MAX, 2, Late),
                    Pose(1, 4, NEXT),
                ],
                [4, 0, 0, 1, 1],
            ),
            (
                "restart seen by Hello, though numbers and times go on",
                &[
                    Hello(4, false),
                    Pose(0, 0, NewSession),
                    Hello(4, false),
                    Pose(1, 1, NEXT),
                    Hello(5, true),
                    Pose(2, 2, NewSession),
                ],
                [3, 0, 0, 0, 2],
            ),
            (
                "restart seen by the uptime",
                &[
                    Uptime(9000, false),
                    Pose(0, 0, NewSession),
                    Uptime(6100, false),
                    Uptime(10, true),
                    Pose(0, 0, NewSession),
                    Uptime(20, false),
                ],
                [2, 0, 0, 0, 2],
            ),
            (
                "restart seen by the uptime, then by Hello: one restart",
                &[
                    Hello(1, false),
                    Uptime(9000, false),
                    Pose(0, 0, NewSession),
                    Uptime(10, true),
                    Pose(0, 0, NewSession),
                    Hello(2, false),
                    Pose(1, 1, NEXT),
                ],
                [3, 0, 0, 0, 2],
            ),
            (
                "restart seen by the number, then by the others: one restart",
                &[
                    Hello(1, false),
                    Uptime(9000, false),
                    Pose(500, 500, NewSession),
                    Pose(0, 0, NewSession),
                    Uptime(10, false),
                    Hello(2, false),
                    Pose(1, 1, NEXT),
                ],
                [3, 0, 0, 0, 2],
            ),
            (
                "restart without a frame",
                &[Hello(1, false), Uptime(900, false), Pose(0, 0, NewSession), Hello(2, true)],
                [1, 0, 0, 0, 2],
            ),
            (
                "no frame in the first of two",
                &[Uptime(9000, false), Uptime(10, true), Hello(2, false), Pose(0, 0, NewSession)],
                [1, 0, 0, 0, 2],
            ),
            (
                "the first ones reordered",
                &[Pose(3, 3, NewSession), Pose(0, 0, Late), Pose(1, 1, Late), Pose(4, 4, NEXT)],
                [4, 1, 0, 2, 1],
            ),
            (
                "restart far on, on a clock that goes on",
                &[Pose(1000, 1000, NewSession), Pose(0, 1100, NewSession), Pose(1, 1101, NEXT)],
                [3, 0, 0, 0, 2],
            ),
            (
                "restart within the window, on a clock that goes on",
                &[
                    Pose(0, 0, NewSession),
                    Pose(1, 1, NEXT),
                    Pose(2, 2, NEXT),
                    Pose(0, 50, NewSession),
                ],
                [4, 0, 0, 0, 2],
            ),
            (
                "restart into a gap, on a clock that restarted",
                &[
                    Pose(0, 1000, NewSession),
                    Pose(1, 1001, NEXT),
                    Pose(5, 1005, after(3)),
                    // 3 is missing, but not with this time.
                    Pose(3, 30, NewSession),
                ],
                [4, 3, 0, 0, 2],
            ),
            (
                "restart below the first number that came",
                &[Pose(10, 10, NewSession), Pose(3, 3, NewSession)],
                [2, 0, 0, 0, 2],
            ),
            (
                "restart that was missed until its number was higher",
                &[Pose(10, 1_000_000, NewSession), Pose(40, 40, NewSession)],
                [2, 0, 0, 0, 2],
            ),
        ];
        for (name, events, [received, lost, repeated, reordered, sessions]) in table {
            let sessions = u32::try_from(sessions).unwrap();
            let counts = Counts { received, lost, repeated, reordered, sessions };
            assert_eq!(run(name, events), counts, "{name}");
        }
    }

    #[test]
    fn a_packet_later_than_the_window_is_another_session() {
        let mut accounting = Accounting::default();
        let window = u32::try_from(WINDOW).unwrap();
        for sequence in (0..2 * window).filter(|sequence| *sequence != 1) {
            accounting.pose(sequence, u64::from(sequence));
        }
        assert_eq!(accounting.pose(1, 1), NewSession);
        assert_eq!(accounting.recent.len(), 1);
    }
}
