//! How each trunk moves, along the body's axes.
//!
//! In: pose packets, and whether t = 0 has come. Out: for each axis the position now and, since
//! t = 0, the range, both from an origin. The origin is the mean over [`ORIGIN_S`]: of the last
//! second, with which it follows the person until t = 0, and then of the second before t = 0, at
//! which it stays. So nothing jumps when t = 0 is set, wherever the person has walked before, and
//! the origin is no single frame. Cost: the points of one second.

use std::collections::VecDeque;

use plumbline::packet::{AnatomicalPoint, PosePacket};
use plumbline::target::Role;

use super::trail::{Trail, TrailPoint};

/// The origin is the mean over this time.
const ORIGIN_S: f64 = 1.0;

/// Twice what the fastest camera gives in that time: a box whose times hardly rise must not fill the
/// memory.
const POINTS_MAX: usize = 2048;

/// AP, ML and SI.
pub const AXES: [&str; 3] = ["AP", "ML", "SI"];

/// Where a trunk is on one axis, from the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Along {
    /// In the latest frame.
    pub now_mm: f64,
    /// From the least to the greatest since t = 0.
    pub range_mm: Option<[f64; 2]>,
}

/// What is seen of a trunk.
#[derive(Debug, Clone, PartialEq)]
pub struct Movement {
    /// Which trunk.
    pub trunk: &'static str,
    /// Along [`AXES`], or why not.
    pub along: Result<[Along; 3], &'static str>,
    /// Where it has been lately, from the same origin, the oldest first.
    pub trail: Vec<TrailPoint>,
}

/// A point at the capture time of its frame.
#[derive(Debug, Clone, Copy)]
struct At {
    capture_ns: u64,
    position_mm: [f64; 3],
}

/// A trunk and its target.
#[derive(Debug)]
struct Trunk {
    role: Role,
    word: &'static str,
    was_seen: bool,
    /// The points of the last [`ORIGIN_S`].
    recent: VecDeque<At>,
    /// Where the origin has come to stay.
    origin_mm: Option<[f64; 3]>,
    /// Since t = 0.
    range_mm: Option<[[f64; 2]; 3]>,
    trail: Trail,
}

/// Both trunks.
#[derive(Debug)]
pub(crate) struct Sway {
    trunks: [Trunk; 2],
}

impl Sway {
    pub fn new() -> Self {
        let trunk = |role, word| Trunk {
            role,
            word,
            was_seen: false,
            recent: VecDeque::new(),
            origin_mm: None,
            range_mm: None,
            trail: Trail::default(),
        };
        Self { trunks: [trunk(Role::Upper, "upper"), trunk(Role::Lower, "lower")] }
    }

    /// t = 0 is now: movement counts from here.
    pub fn start_over(&mut self) {
        for trunk in &mut self.trunks {
            trunk.origin_mm = None;
            trunk.range_mm = None;
        }
    }

    /// The latest frame; whether t = 0 has come.
    pub fn take(&mut self, packet: &PosePacket, is_after_zero: bool) {
        for trunk in &mut self.trunks {
            trunk.was_seen |= packet.pose(trunk.role).is_some();
            if let Some(point) = point(packet, trunk.role) {
                let position_mm = [point.ap_mm, point.ml_mm, point.si_mm].map(f64::from);
                let at = At { capture_ns: packet.capture_time_ns, position_mm };
                trunk.take(at, is_after_zero);
            }
        }
    }

    /// Each trunk's movement in this frame.
    pub fn movement(&self, packet: &PosePacket) -> Vec<Movement> {
        let movement = |trunk: &Trunk| {
            let target = packet.targets.iter().find(|target| target.role == trunk.role)?;
            let along = match (point(packet, trunk.role).and(trunk.along()), &target.pose) {
                (Some(along), _) => Ok(along),
                (None, Ok(_)) => Err("seen; the box has no scene, so no AP, ML and SI"),
                (None, Err(_)) if trunk.was_seen => Err("not seen"),
                (None, Err(_)) => Err("not seen yet"),
            };
            let trail = trunk.trail(packet.capture_time_ns);
            Some(Movement { trunk: trunk.word, along, trail })
        };
        self.trunks.iter().filter_map(movement).collect()
    }
}

impl Trunk {
    fn take(&mut self, at: At, is_after_zero: bool) {
        match self.recent.back() {
            // The same frame.
            Some(last) if last.capture_ns == at.capture_ns => return,
            // The box has restarted.
            Some(last) if last.capture_ns > at.capture_ns => self.recent.clear(),
            _ => {}
        }
        self.recent.push_back(at);
        self.trail.take(at.capture_ns, at.position_mm);
        let age_s = |of: &At| 1e-9 * at.capture_ns.saturating_sub(of.capture_ns) as f64;
        while self.recent.len() > POINTS_MAX
            || self.recent.get(1).is_some_and(|second| age_s(second) >= ORIGIN_S)
        {
            self.recent.pop_front();
        }
        if !is_after_zero {
            return;
        }
        let is_whole = self.recent.front().is_some_and(|oldest| age_s(oldest) >= ORIGIN_S);
        if is_whole && self.origin_mm.is_none() {
            self.origin_mm = self.mean_mm();
        }
        let range_mm = self.range_mm.get_or_insert(at.position_mm.map(|it| [it; 2]));
        for ([low_mm, high_mm], now_mm) in range_mm.iter_mut().zip(at.position_mm) {
            *low_mm = low_mm.min(now_mm);
            *high_mm = high_mm.max(now_mm);
        }
    }

    fn mean_mm(&self) -> Option<[f64; 3]> {
        let count = self.recent.len();
        let sum_mm = |axis: usize| self.recent.iter().map(|at| at.position_mm[axis]).sum::<f64>();
        (count > 0).then(|| std::array::from_fn(|axis| sum_mm(axis) / count as f64))
    }

    fn trail(&self, now_ns: u64) -> Vec<TrailPoint> {
        self.origin().map_or_else(Vec::new, |origin_mm| self.trail.points(now_ns, origin_mm))
    }

    fn origin(&self) -> Option<[f64; 3]> {
        self.origin_mm.or(self.mean_mm())
    }

    /// From the origin, of the latest point.
    fn along(&self) -> Option<[Along; 3]> {
        let now_mm = self.recent.back()?.position_mm;
        let origin_mm = self.origin()?;
        Some(std::array::from_fn(|axis| Along {
            now_mm: now_mm[axis] - origin_mm[axis],
            range_mm: self.range_mm.map(|it| it[axis].map(|end_mm| end_mm - origin_mm[axis])),
        }))
    }
}

fn point(packet: &PosePacket, role: Role) -> Option<AnatomicalPoint> {
    match role {
        Role::Upper => packet.upper_trunk,
        Role::Lower => packet.lower_trunk,
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use plumbline::report::NoPose;
    use plumbline_stream::fixture::pose_packet;

    use super::*;

    /// A person who stands 800 mm away after two seconds, and sways by 5 mm at 1 Hz; 60 Hz.
    fn packet(sequence: u32) -> PosePacket {
        let time_s = f64::from(sequence) / 60.0;
        let away_mm = (400.0 * time_s).min(800.0);
        let ap_mm = away_mm + 5.0 * (std::f64::consts::TAU * time_s).sin();
        PosePacket {
            upper_trunk: Some(AnatomicalPoint { ap_mm: ap_mm as f32, ml_mm: 2.0, si_mm: 3.0 }),
            ..pose_packet(sequence)
        }
    }

    fn upper(sway: &Sway, packet: &PosePacket) -> [Along; 3] {
        sway.movement(packet)[0].along.unwrap()
    }

    #[test]
    fn nothing_jumps_when_t_0_is_set_and_the_origin_is_a_mean() {
        let mut sway = Sway::new();
        let mut before_mm = 0.0;
        for sequence in 0..600 {
            let zero = 265;
            if sequence == zero {
                sway.start_over();
            }
            sway.take(&packet(sequence), sequence >= zero);
            let [ap, ml, _] = upper(&sway, &packet(sequence));
            // 5 mm at 1 Hz are 31.4 mm/s, 0.53 mm a frame; the mean follows by no more.
            let step_mm = (ap.now_mm - before_mm).abs();
            assert!(sequence < 200 || step_mm < 0.6, "{sequence}: {step_mm}");
            before_mm = ap.now_mm;
            assert_eq!(ml.now_mm, 0.0);
            assert_eq!(ap.range_mm.is_some(), sequence >= zero);
        }
        // Of whole periods the mean is the middle.
        let [ap, ..] = upper(&sway, &packet(599));
        let [low_mm, high_mm] = ap.range_mm.unwrap();
        assert!((low_mm + 5.0).abs() < 0.1 && (high_mm - 5.0).abs() < 0.1, "{low_mm} {high_mm}");
    }

    #[test]
    fn where_t_0_is_the_first_frame_the_origin_is_the_first_second() {
        let still = |sequence: u32, ap_mm: f32| PosePacket {
            upper_trunk: Some(AnatomicalPoint { ap_mm, ml_mm: 0.0, si_mm: 0.0 }),
            ..pose_packet(sequence)
        };
        let mut sway = Sway::new();
        for sequence in 0..=60 {
            sway.take(&still(sequence, if sequence % 2 == 0 { 9.0 } else { 11.0 }), true);
        }
        for sequence in 61..200 {
            sway.take(&still(sequence, 30.0), true);
        }
        let [ap, ..] = upper(&sway, &still(199, 30.0));
        assert!((ap.now_mm - 20.0).abs() < 0.05, "{ap:?}");
    }

    #[test]
    fn what_is_not_measured_is_said() {
        let mut sway = Sway::new();
        let words = |sway: &Sway, packet: &PosePacket| {
            let upper = sway.movement(packet).swap_remove(0);
            upper.along.err().unwrap_or_default()
        };
        let mut unseen = pose_packet(0);
        unseen.targets.iter_mut().for_each(|target| target.pose = Err(NoPose::Searching));
        sway.take(&unseen, true);
        assert_eq!(words(&sway, &unseen), "not seen yet");
        sway.take(&pose_packet(1), true);
        assert!(words(&sway, &pose_packet(1)).contains("no scene"));
        assert_eq!(words(&sway, &unseen), "not seen");
    }

    #[test]
    fn a_box_that_restarts_begins_a_new_mean() {
        let mut sway = Sway::new();
        for sequence in (500..600).chain(0..3) {
            sway.take(&packet(sequence), false);
        }
        assert_eq!(sway.trunks[0].recent.len(), 3);
    }
}
