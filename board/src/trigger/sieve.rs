//! Which edges of a line are triggers.

use gpiocdev::line::{EdgeEvent, EdgeKind};
use plumbline::config::{Edges, TriggerInput};
use plumbline::packet::{Edge, Trigger};

/// How much later than the edge the kernel's interrupt stamps it, at most: it is some microseconds,
/// and more while other interrupts are being served. For a line of the processor itself, not for one
/// behind a bus.
const INTERRUPT_NS_MAX: u32 = 100_000;

/// Turns the kernel's events into triggers.
#[derive(Debug)]
pub(super) struct Sieve {
    edges: Edges,
    debounce_ns: u64,
    /// The kernel's number of the latest edge, from 1; 0 before the first.
    latest: u32,
    latest_kind: Option<EdgeKind>,
    latest_ns: Option<u64>,
    sent: u32,
    bounces: u32,
    dropped: u32,
}

impl Sieve {
    /// For the line of a configuration; without one nothing comes.
    pub(super) fn new(input: Option<&TriggerInput>) -> Self {
        Self {
            edges: input.map_or(Edges::Both, |it| it.edges),
            debounce_ns: input.map_or(0, |it| 1000 * u64::from(it.debounce_us)),
            latest: 0,
            latest_kind: None,
            latest_ns: None,
            sent: 0,
            bounces: 0,
            dropped: 0,
        }
    }

    /// The line has been opened anew, and the kernel counts from the beginning.
    pub(super) fn start_over(&mut self) {
        self.latest = 0;
        self.latest_kind = None;
    }

    /// Takes an edge.
    pub(super) fn take(&mut self, event: &EdgeEvent) -> Option<Trigger> {
        let mut missing = event.line_seqno.wrapping_sub(self.latest).wrapping_sub(1);
        let kind_before = self.latest_kind.replace(event.kind);
        // The kernel tells an edge's kind by the level that it finds afterwards. Where it found the
        // same level twice, a pulse was over before it looked, and an edge is missing.
        if missing == 0 && kind_before == Some(event.kind) {
            missing = 1;
        }
        self.dropped = self.dropped.saturating_add(missing);
        self.latest = event.line_seqno;
        let time_ns = event.timestamp_ns;
        let before_ns = self.latest_ns.replace(time_ns);
        let edge = match event.kind {
            EdgeKind::Rising => Edge::Rising,
            EdgeKind::Falling => Edge::Falling,
        };
        if !self.edges.contain(edge) {
            return None;
        }
        if before_ns.is_some_and(|before_ns| time_ns.saturating_sub(before_ns) < self.debounce_ns) {
            self.bounces = self.bounces.saturating_add(1);
            return None;
        }
        let sequence = self.sent;
        self.sent = self.sent.wrapping_add(1);
        Some(Trigger { sequence, time_ns, uncertain_ns: INTERRUPT_NS_MAX, edge })
    }

    pub(super) fn sent(&self) -> u32 {
        self.sent
    }

    pub(super) fn bounces(&self) -> u32 {
        self.bounces
    }

    pub(super) fn dropped(&self) -> u32 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn sieve(edges: Edges, debounce_us: u32) -> Sieve {
        Sieve::new(Some(&TriggerInput { line: 4, edges, debounce_us }))
    }

    /// An edge as the kernel tells it.
    fn event(line_seqno: u32, timestamp_ns: u64, kind: EdgeKind) -> EdgeEvent {
        EdgeEvent { timestamp_ns, kind, offset: 4, seqno: line_seqno, line_seqno }
    }

    /// The times of the triggers among alternating edges at these times.
    fn times(sieve: &mut Sieve, times_ns: &[u64]) -> Vec<u64> {
        let kinds = [EdgeKind::Rising, EdgeKind::Falling].into_iter().cycle();
        let events =
            times_ns.iter().zip(kinds).zip(1..).map(|((ns, kind), at)| event(at, *ns, kind));
        events.filter_map(|event| sieve.take(&event)).map(|trigger| trigger.time_ns).collect()
    }

    #[test]
    fn the_edges_that_are_asked_for_are_triggers() {
        let all = [5 * MS, 6 * MS, 8 * MS, 9 * MS];
        for (edges, wanted) in [
            (Edges::Rising, &[5 * MS, 8 * MS][..]),
            (Edges::Falling, &[6 * MS, 9 * MS]),
            (Edges::Both, &all),
        ] {
            let mut sieve = sieve(edges, 0);
            assert_eq!(times(&mut sieve, &all), wanted, "{edges:?}");
            assert_eq!(sieve.sent() as usize, wanted.len());
            assert_eq!((sieve.bounces(), sieve.dropped()), (0, 0));
        }
    }

    #[test]
    fn triggers_are_numbered_and_say_how_certain_their_time_is() {
        let mut sieve = sieve(Edges::Falling, 0);
        assert_eq!(sieve.take(&event(1, MS, EdgeKind::Rising)), None);
        for sequence in 0..3 {
            let event = event(sequence + 2, 2 * MS, EdgeKind::Falling);
            let wanted = Trigger {
                sequence,
                time_ns: 2 * MS,
                uncertain_ns: INTERRUPT_NS_MAX,
                edge: Edge::Falling,
            };
            assert_eq!(sieve.take(&event), Some(wanted));
        }
    }

    #[test]
    fn a_bouncing_contact_is_one_trigger_when_it_closes_and_none_when_it_opens() {
        let closes = [100 * MS, 100 * MS + 300_000, 101 * MS, 102 * MS, 102 * MS + 100_000];
        // Its release a second later bounces, too.
        let opens = [1100 * MS, 1101 * MS, 1101 * MS + 200_000];
        let all = [&closes[..], &opens].concat();
        let mut sieve = sieve(Edges::Rising, 5_000);
        assert_eq!(times(&mut sieve, &all), [100 * MS]);
        assert_eq!((sieve.bounces(), sieve.dropped()), (3, 0));
        // The next one counts again.
        assert!(sieve.take(&event(9, 2000 * MS, EdgeKind::Rising)).is_some());
    }

    #[test]
    fn what_the_kernel_had_no_room_for_is_counted() {
        let mut sieve = sieve(Edges::Both, 0);
        // The first three are lost, and two in between.
        for (number, kind) in
            [(4, EdgeKind::Falling), (5, EdgeKind::Rising), (8, EdgeKind::Falling)]
        {
            assert!(sieve.take(&event(number, u64::from(number) * MS, kind)).is_some());
        }
        assert_eq!((sieve.sent(), sieve.dropped()), (3, 5));
        // The line is opened anew.
        sieve.start_over();
        assert!(sieve.take(&event(1, 20 * MS, EdgeKind::Rising)).is_some());
        assert_eq!((sieve.sent(), sieve.dropped()), (4, 5));
    }

    #[test]
    fn a_pulse_that_is_over_before_the_kernel_looks_costs_an_edge_that_is_counted() {
        let mut sieve = sieve(Edges::Rising, 0);
        assert!(sieve.take(&event(1, MS, EdgeKind::Rising)).is_some());
        assert_eq!(sieve.take(&event(2, 2 * MS, EdgeKind::Falling)), None);
        // Up and down at once: the kernel finds the line low.
        assert_eq!(sieve.take(&event(3, 3 * MS, EdgeKind::Falling)), None);
        assert!(sieve.take(&event(4, 4 * MS, EdgeKind::Rising)).is_some());
        assert_eq!((sieve.sent(), sieve.dropped()), (2, 1));
        // Of a line that is opened anew nothing is known from before.
        sieve.start_over();
        assert!(sieve.take(&event(1, 20 * MS, EdgeKind::Rising)).is_some());
        assert_eq!((sieve.sent(), sieve.dropped()), (3, 1));
    }
}
