//! What is seen of the person now: each trunk's movement along the body's axes, and whether its
//! target is seen, by the bounds of the trial's criteria.

use std::time::{Duration, Instant};

use plumbline::packet::{AnatomicalPoint, PosePacket};
use plumbline::target::Role;
use plumbline_trial::verdict::{Criteria, Limits};

/// A trunk and its target.
#[derive(Debug)]
struct Trunk {
    role: Role,
    word: &'static str,
    /// Where it was when movement began to count.
    origin: Option<AnatomicalPoint>,
    /// When its target was last seen.
    seen: Option<Instant>,
}

/// What is seen of the person.
#[derive(Debug)]
pub(super) struct Live {
    criteria: Criteria,
    trunks: [Trunk; 2],
}

impl Live {
    pub(super) fn new(criteria: Criteria) -> Self {
        let trunk = |role, word| Trunk { role, word, origin: None, seen: None };
        Self { criteria, trunks: [trunk(Role::Upper, "upper"), trunk(Role::Lower, "lower")] }
    }

    /// t = 0 is now: movement counts from here.
    pub(super) fn start_over(&mut self) {
        self.trunks.iter_mut().for_each(|trunk| trunk.origin = None);
    }

    /// The latest frame.
    pub(super) fn take(&mut self, packet: &PosePacket, now: Instant) {
        for trunk in &mut self.trunks {
            if packet.pose(trunk.role).is_some() {
                trunk.seen = Some(now);
            }
            trunk.origin = trunk.origin.or(point(packet, trunk.role));
        }
    }

    /// Each trunk's movement in this frame, a line each.
    pub(super) fn movement(&self, packet: &PosePacket) -> Vec<String> {
        let words = |trunk: &Trunk| {
            let target = packet.targets.iter().find(|target| target.role == trunk.role)?;
            let now = point(packet, trunk.role).zip(trunk.origin);
            let what = match (now, &target.pose) {
                (Some((now, origin)), _) => format!(
                    "AP {:+7.1}  ML {:+7.1}  SI {:+7.1} mm",
                    now.ap_mm - origin.ap_mm,
                    now.ml_mm - origin.ml_mm,
                    now.si_mm - origin.si_mm
                ),
                (None, Ok(_)) => "seen; the box has no scene, so no AP, ML and SI".to_owned(),
                (None, Err(_)) if trunk.seen.is_none() => "not seen yet".to_owned(),
                (None, Err(_)) => "not seen".to_owned(),
            };
            Some(format!("{} trunk  {what}", trunk.word))
        };
        self.trunks.iter().filter_map(words).collect()
    }

    /// The verdict now, of targets that have been seen before: GOOD, LOOK or STOP.
    pub(super) fn verdict(&self, lost_percent: f64, now: Instant) -> String {
        let mut looks = Vec::new();
        for trunk in &self.trunks {
            let Some(seen) = trunk.seen else {
                looks.push((false, format!("{} target not seen yet", trunk.word)));
                continue;
            };
            let unseen = now.saturating_duration_since(seen);
            let misses = |limits: &Limits| exceeds(unseen, limits.gap_s_max);
            let words =
                format!("{} target not seen for {:.0} s", trunk.word, unseen.as_secs_f64().ceil());
            if misses(&self.criteria.unusable) {
                looks.push((true, words));
            } else if misses(&self.criteria.doubtful) {
                looks.push((false, words));
            }
        }
        let lost = format!("{lost_percent:.1} % of the frames lost");
        let misses = |limits: &Limits| limits.lost_percent_max.is_some_and(|it| lost_percent > it);
        if misses(&self.criteria.unusable) {
            looks.push((true, lost));
        } else if misses(&self.criteria.doubtful) {
            looks.push((false, lost));
        }
        let word = match looks.iter().any(|(is_unusable, _)| *is_unusable) {
            true => "STOP",
            false if looks.is_empty() => return "GOOD".to_owned(),
            false => "LOOK",
        };
        let looks: Vec<String> = looks.into_iter().map(|(_, words)| words).collect();
        format!("{word}: {}", looks.join("; "))
    }
}

fn exceeds(time: Duration, bound_s: Option<f64>) -> bool {
    bound_s.is_some_and(|bound_s| time.as_secs_f64() > bound_s)
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

    #[test]
    fn a_target_that_is_covered_is_named_and_then_ends_the_trial() {
        let start = Instant::now();
        let mut live = Live::new(Criteria::default());
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let yet = live.verdict(0.0, start);
        assert_eq!(yet, "LOOK: upper target not seen yet; lower target not seen yet");
        live.take(&pose_packet(0), start);
        assert_eq!(live.verdict(0.0, at(0.4)), "GOOD");
        let mut covered = pose_packet(1);
        covered.targets.iter_mut().filter(|it| it.role == Role::Lower).for_each(|target| {
            target.pose = Err(NoPose::Searching);
        });
        for (after_s, words) in [(3.0, "LOOK: lower target"), (10.5, "STOP: lower target")] {
            let mut both = pose_packet(2);
            both.targets.clone_from(&covered.targets);
            live.take(&both, at(after_s));
            let verdict = live.verdict(0.0, at(after_s));
            assert!(verdict.starts_with(words), "{verdict}");
        }
        live.take(&pose_packet(3), at(11.0));
        assert_eq!(live.verdict(0.5, at(11.0)), "GOOD");
        assert_eq!(live.verdict(3.0, at(11.0)), "LOOK: 3.0 % of the frames lost");
        assert_eq!(live.verdict(30.0, at(11.0)), "STOP: 30.0 % of the frames lost");
    }

    #[test]
    fn movement_is_along_the_bodys_axes_since_t_0() {
        let start = Instant::now();
        let mut live = Live::new(Criteria::default());
        let packet = |ap_mm| PosePacket {
            upper_trunk: Some(AnatomicalPoint { ap_mm, ml_mm: 2.0, si_mm: 3.0 }),
            ..pose_packet(0)
        };
        live.take(&packet(1.0), start);
        let lines = live.movement(&packet(5.5));
        assert_eq!(lines[0], "upper trunk  AP    +4.5  ML    +0.0  SI    +0.0 mm");
        assert!(lines[1].contains("no scene") && lines.len() == 2, "{lines:?}");
        live.start_over();
        live.take(&packet(5.0), start);
        assert!(live.movement(&packet(5.5))[0].contains("AP    +0.5"));
    }
}
