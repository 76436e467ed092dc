//! One run of the box, and the times of events in it by the box's clock. This computer's clock is
//! related to it by the answers to pings or, without any, by the arrival of frames.

use plumbline::packet::{MarkedInstant, Trigger};
use plumbline_stream::clock::{Exchange, Relation};
use plumbline_stream::sessions::{Frame, SessionClock};

use super::manifest::{ClockSeen, EventSeen};
use super::mark::Mark;

/// One run of the box.
#[derive(Default)]
pub struct Run {
    exchanges: Vec<Exchange>,
    /// Its frames as they came.
    arrivals: Vec<Arrival>,
    /// Whether frames have the times of a recording that the box replays: its clock says
    /// nothing of those.
    is_replay: bool,
    clock: SessionClock,
}

/// When a frame's packet came, by this computer's clock; when the frame was captured and when the packet left,
/// by the box's.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    host_ns: u64,
    capture_ns: u64,
    left_ns: u64,
}

impl Arrival {
    /// The time under way, plus a constant: the difference of the two clocks.
    fn way_ns(&self) -> i64 {
        self.host_ns.wrapping_sub(self.left_ns).cast_signed()
    }
}

/// Bound of what a packet is under way where no answer measures it: a slow serial line, and a margin.
const UNKNOWN_DELAY_S: f64 = 0.1;

/// Of the frames that arrive this shortly before or after a moment, one arrives without having
/// waited; and in this time two quartz clocks drift apart by less than a millisecond.
const NEAR_NS: u64 = 2_000_000_000;

impl Run {
    /// A frame has come.
    pub fn frame(&mut self, frame: &Frame) {
        let Frame { arrival_ns, packet, clock, .. } = frame;
        self.arrivals.push(Arrival {
            host_ns: *arrival_ns,
            capture_ns: packet.capture_time_ns,
            left_ns: packet.handed_over_ns(),
        });
        self.is_replay |= packet.instant == MarkedInstant::Recording;
        self.clock = *clock;
    }

    /// When its first frame came, by this computer's clock since the recording began.
    pub fn begun_ns(&self) -> Option<u64> {
        Some(self.arrivals.first()?.host_ns)
    }

    /// The box has answered.
    pub fn answer(&mut self, exchange: Exchange) {
        self.exchanges.push(exchange);
    }

    /// How the two clocks were related, for the manifest.
    pub fn clock_seen(&self, session: u32) -> Option<ClockSeen> {
        let relation = self.relation()?;
        Some(ClockSeen {
            session,
            offset_s: 1e-9 * relation.offset_ns(),
            uncertain_s: 1e-9 * relation.uncertain_ns(),
            drift_ppm: relation.drift_ppm.map(|(drift, _)| drift),
            exchanges: self.exchanges.len(),
        })
    }

    /// When the run's first frame was captured, by this computer's clock since the recording began;
    /// `None` without a frame.
    pub fn first_capture_s(&self) -> Option<f64> {
        let first = self.arrivals.first()?;
        Some(1e-9 * (first.host_ns as f64 - self.box_ns_since_first(first.host_ns)?))
    }

    /// A mark on the trial's clock; `None` without a frame.
    pub fn event(&self, host_ns: u64, mark: &Mark) -> Option<EventSeen> {
        let first = self.arrivals.first()?;
        let since_first_s = 1e-9 * self.box_ns_since_first(host_ns)?;
        let uncertain_s =
            self.relation().map_or(UNKNOWN_DELAY_S, |it| 1e-9 * it.uncertain_ns_at(host_ns));
        let time_s = self.clock.time_s(first.capture_ns) + since_first_s;
        Some(event(time_s, uncertain_s, mark))
    }

    /// A trigger on the trial's clock: the box has stamped it by the clock of its frames. `None`
    /// without a frame, or where frames have the times of a recording.
    pub fn trigger(&self, trigger: &Trigger) -> Option<EventSeen> {
        if self.arrivals.is_empty() || self.is_replay {
            return None;
        }
        Some(event(self.clock.time_s(trigger.time_ns), 0.0, &Mark::of_trigger(trigger)))
    }

    /// The relation of the frames' clock and this computer's.
    fn relation(&self) -> Option<Relation> {
        Relation::of(&self.exchanges).filter(|_| !self.is_replay)
    }

    /// From the first frame's capture to a moment of this computer's, by the box's clock.
    fn box_ns_since_first(&self, host_ns: u64) -> Option<f64> {
        let first_ns = self.arrivals.first()?.capture_ns;
        if let Some(relation) = self.relation() {
            return Some(relation.box_ns_since(host_ns, first_ns));
        }
        // Without an answer of the box, the packet that was least under way is taken as not delayed: in truth
        // it took a moment, which nothing measures. Others have also waited while a computer was busy.
        let soonest = self.soonest(host_ns)?;
        let to_soonest_ns = soonest.left_ns.wrapping_sub(first_ns).cast_signed();
        Some(to_soonest_ns as f64 + (host_ns as f64 - soonest.host_ns as f64))
    }

    /// Of the frames that came near this moment, the one that was least under way or, where none came, the
    /// nearest.
    fn soonest(&self, host_ns: u64) -> Option<Arrival> {
        let from = |host_ns: u64| self.arrivals.partition_point(|it| it.host_ns < host_ns);
        let near = from(host_ns.saturating_sub(NEAR_NS))..from(host_ns.saturating_add(NEAR_NS));
        let near = self.arrivals.get(near).unwrap_or_default();
        if let Some(soonest) = near.iter().min_by_key(|it| it.way_ns()) {
            return Some(*soonest);
        }
        let after = from(host_ns);
        let beside = self.arrivals[after.saturating_sub(1)..].iter().take(2);
        beside.min_by_key(|it| it.host_ns.abs_diff(host_ns)).copied()
    }
}

/// A mark at this time, which is itself known to `uncertain_s`.
fn event(time_s: f64, uncertain_s: f64, mark: &Mark) -> EventSeen {
    EventSeen {
        // None of the clocks is more precise than a microsecond.
        time_s: (1e6 * time_s).round() / 1e6,
        label: mark.label.clone(),
        source: mark.source,
        sender: mark.sender.clone(),
        uncertain_s: uncertain_s + f64::from(mark.uncertain_us) / 1e6,
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{Edge, Message};
    use plumbline_stream::fixture::adversity::{frame_of, hello_of};
    use plumbline_stream::sessions::{Judged, Sessions};

    use super::*;
    use crate::mark::Source;

    const SECOND_NS: u64 = 1_000_000_000;

    /// How long the box tracks a frame.
    fn tracked_ms(number: u64) -> u64 {
        3 + number * 7919 % 13
    }

    /// Ten seconds at 50 Hz, each packet under way for this long; the box's clock is behind by an
    /// hour.
    fn run(way_ms: impl Fn(u64) -> u64) -> Run {
        let mut run = Run::default();
        let mut sessions = Sessions::default();
        sessions.take(hello_of("ward 3", 1), 0);
        for number in 0..500 {
            let mut packet = frame_of(1, number, 50);
            if let Message::Pose(pose) = &mut packet.message {
                pose.capture_time_ns += 4 * SECOND_NS;
                pose.instant = MarkedInstant::Recording;
                let tracked_ms = tracked_ms(number.into());
                pose.latency_us = 1000 * tracked_ms as u32;
                let all_ns = (tracked_ms + way_ms(number.into())) * 1_000_000;
                let host_ns = 3600 * SECOND_NS + pose.capture_time_ns + all_ns;
                sessions.take(packet, host_ns);
            }
        }
        while let Some(judged) = sessions.next_judged() {
            if let Judged::Frame(frame) = judged {
                run.frame(&frame);
            }
        }
        run
    }

    /// When a mark was, that was given so long after the first frame was captured.
    fn time_s(run: &Run, after_ns: u64) -> f64 {
        let mark = Mark::new(Source::Key, "stands");
        run.event(3605 * SECOND_NS + after_ns, &mark).unwrap().time_s
    }

    #[test]
    fn a_first_frame_that_was_held_up_moves_no_mark() {
        // The computer was busy: half a second of frames came at once, and each tenth comes late.
        let way_ms = |frame| match frame {
            0..25 => 505 - 20 * frame,
            _ if frame % 10 == 0 => 90,
            _ => 5,
        };
        let run = run(way_ms);
        for after_ms in [0, 700, 4000, 9990] {
            // A packet that nothing held up was under way for 5 ms, which nothing tells; how long its frame was
            // tracked, it says itself.
            let error_s = time_s(&run, after_ms * 1_000_000) - 1e-3 * after_ms as f64;
            assert!((error_s + 0.005).abs() < 1e-6, "{after_ms} ms: {error_s}");
        }
        let first_s = run.first_capture_s().unwrap();
        assert!((first_s - 3605.005).abs() < 1e-6, "{first_s}");
    }

    #[test]
    fn a_trigger_has_its_time_by_the_clock_of_the_frames() {
        let mut run = run(|_| 5);
        let trigger = Trigger {
            sequence: 0,
            // The first frame was captured when the box's clock said 5 s.
            time_ns: 7 * SECOND_NS + 123_456_789,
            uncertain_ns: 100_000,
            edge: Edge::Falling,
        };
        assert_eq!(run.trigger(&trigger), None, "a recording's times are not the box's");
        run.is_replay = false;
        let seen = run.trigger(&trigger).unwrap();
        assert!((seen.time_s - 2.123_457).abs() < 1e-9, "{seen:?}");
        assert!((seen.uncertain_s - 1e-4).abs() < 1e-12, "{seen:?}");
        assert_eq!((&*seen.label, seen.source), ("falling edge", Source::Trigger));
        assert_eq!(Run::default().trigger(&trigger), None);
    }

    #[test]
    fn a_mark_far_from_every_frame_has_the_time_of_the_nearest() {
        let run = run(|frame| if frame < 250 { 5 } else { 8 });
        let error_s = time_s(&run, 60 * SECOND_NS) - 60.0;
        assert!((error_s + 0.008).abs() < 1e-6, "{error_s}");
        assert!(Run::default().event(0, &Mark::new(Source::Key, "stands")).is_none());
        assert!(Run::default().first_capture_s().is_none());
    }
}
