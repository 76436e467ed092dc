//! The state of a target from frame to frame, in every sequence of frames up to a length, against what
//! its documentation says of the frames that were.

use plumbline::parts::TrackState;
use plumbline::pose::{Cam, Pose, Target};
use plumbline_test_support::evidence;

/// A target that was not seen for this long is searched for in the whole frame.
const COASTING_NS_MAX: u64 = 1_000_000_000;

/// A velocity is trusted for this long.
const VELOCITY_NS_MAX: u64 = 100_000_000;

/// From one frame to the next: the bounds and what lies beside them, and clocks that stand still, go
/// back and jump.
const STEPS_NS: [i64; 9] = [
    16_666_667,
    0,
    1,
    -1,
    VELOCITY_NS_MAX.cast_signed(),
    VELOCITY_NS_MAX.cast_signed() + 1,
    COASTING_NS_MAX.cast_signed(),
    COASTING_NS_MAX.cast_signed() + 1,
    i64::MAX,
];

/// When the first frame is taken.
const BEGUN_NS: u64 = 5_000_000_000;

/// A frame: when, and whether the target was measured in it.
type Frame = (u64, bool);

/// Where the target is in the frame of this place in a sequence: it goes away slowly, so that all are
/// told apart, and a person may move like that.
fn pose(place: usize) -> Pose<Cam, Target> {
    Pose::from_theta([0.01, -0.02, 0.03, 0.0, 5.0, 1000.0 + 1e-6 * place as f64])
}

/// What a sequence of frames leaves: the place of the frame that is gone on from, and whether that was
/// the last frame; `None` for nothing.
fn by_the_documentation(frames: &[Frame]) -> Option<(usize, bool)> {
    let last_seen = frames.iter().rposition(|(_, is_seen)| *is_seen)?;
    let seen_ns = frames[last_seen].0;
    let missed = &frames[last_seen + 1..];
    // One that came too late, or at no later time, ends it, whatever comes after.
    let is_near = |time_ns: u64| {
        time_ns.checked_sub(seen_ns).is_some_and(|gap_ns| (1..=COASTING_NS_MAX).contains(&gap_ns))
    };
    missed.iter().all(|(time_ns, _)| is_near(*time_ns)).then_some((last_seen, missed.is_empty()))
}

/// Whether a velocity is known of it: the frame that is gone on from continues one that was seen a
/// short time before.
fn has_velocity(frames: &[Frame], seen: usize) -> bool {
    by_the_documentation(&frames[..seen]).is_some_and(|(before, _)| {
        let gap_ns = frames[seen].0.checked_sub(frames[before].0);
        gap_ns.is_some_and(|gap_ns| (1..=VELOCITY_NS_MAX).contains(&gap_ns))
    })
}

fn check(state: &TrackState, frames: &[Frame]) {
    let (name, motion) = match state {
        TrackState::Acquiring => ("Acquiring", None),
        TrackState::Tracking(motion) => ("Tracking", Some(motion)),
        TrackState::Coasting(motion) => ("Coasting", Some(motion)),
    };
    let expected = by_the_documentation(frames);
    let expected_name = match expected {
        None => "Acquiring",
        Some((_, true)) => "Tracking",
        Some((_, false)) => "Coasting",
    };
    assert_eq!(name, expected_name, "{frames:?}");
    assert_eq!(state.motion(), motion);
    let (Some(motion), Some((seen, _))) = (motion, expected) else { return };
    assert_eq!((motion.cam_from_target, motion.time_ns), (pose(seen), frames[seen].0));
    assert_eq!(motion.velocity_per_s().is_some(), has_velocity(frames, seen), "{frames:?}");
    let at = |after_ns: u64| motion.predict(motion.time_ns.wrapping_add(after_ns));
    assert_eq!(at(0), pose(seen));
    // No velocity is trusted for longer, nor where time has gone back.
    for after_ns in [COASTING_NS_MAX, u64::MAX] {
        assert_eq!(at(after_ns), at(VELOCITY_NS_MAX), "{frames:?}");
    }
}

/// Tries every sequence that begins with these frames and has at most `length`; how many there are.
fn every_sequence(state: TrackState, frames: &mut Vec<Frame>, length: usize) -> u64 {
    check(&state, frames);
    if frames.len() == length {
        return 1;
    }
    let now_ns = frames.last().map_or(BEGUN_NS, |frame| frame.0);
    let mut count = 1;
    for step_ns in STEPS_NS {
        for is_seen in [true, false] {
            let time_ns = now_ns.wrapping_add_signed(step_ns);
            let measured = is_seen.then(|| pose(frames.len()));
            frames.push((time_ns, is_seen));
            count += every_sequence(state.next(measured, time_ns), frames, length);
            frames.pop();
        }
    }
    count
}

fn tracks(length: usize) {
    let count = every_sequence(TrackState::Acquiring, &mut Vec::new(), length);
    evidence(
        &format!(
            "a target's track in every sequence of up to {length} frames, {} of each kind: seen and not, \
             with clocks that stand still, go back and jump",
            STEPS_NS.len()
        ),
        &format!("{count} sequences"),
        "the state, what it goes on from, and whether it knows a velocity: as documented",
    );
}

#[test]
fn a_track_is_as_documented_in_every_short_sequence() {
    tracks(4);
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_track_is_as_documented_in_every_sequence() {
    tracks(6);
}
