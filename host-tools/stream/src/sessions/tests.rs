use super::*;
use crate::fixture::adversity::{self, Adversity, frame_of, hello_of};
use crate::fixture::{START, health, packet};

/// What is judged of all packets, and the sessions at the end.
fn run(packets: Vec<(u64, Packet)>) -> (Vec<Judged>, Sessions) {
    let mut sessions = Sessions::default();
    for (at_ns, packet) in packets {
        sessions.take(packet, at_ns);
    }
    sessions.finish();
    let judged = std::iter::from_fn(|| sessions.next_judged()).collect();
    (judged, sessions)
}

fn frames(judged: &[Judged]) -> impl Iterator<Item = &Frame> {
    judged.iter().filter_map(|it| match it {
        Judged::Frame(frame) => Some(frame),
        _ => None,
    })
}

#[test]
fn whatever_goes_wrong_is_told_from_what_is_the_boxs() {
    for Adversity { name, packets, sessions, counts, left_out, boxes } in adversity::all() {
        let (judged, found) = run(packets);
        assert_eq!(found.counts(), counts, "{name}");
        assert_eq!(found.left_out(), left_out, "{name}");
        assert_eq!(found.count(), sessions, "{name}");
        assert_eq!(frames(&judged).count() as u64, counts.received, "{name}");
        let exchanged = found.exchanged().map(|it| it.to.device.as_str());
        let first = judged.iter().find_map(|it| match it {
            Judged::Begins { hello, .. } => Some(hello.device.as_str()),
            _ => None,
        });
        assert_eq!((first, exchanged), (Some(boxes.0), boxes.1), "{name}");
        // Each frame has the time at which it was captured, within its session.
        let mut first_of = std::collections::BTreeMap::new();
        for frame in frames(&judged) {
            let time_s = frame.clock.time_s(frame.packet.capture_time_ns);
            let capture_s = frame.packet.capture_time_ns as f64 / 1e9;
            let zero_s = *first_of.entry(frame.session).or_insert(time_s - capture_s);
            assert!((time_s - capture_s - zero_s).abs() < 1e-9, "{name}: {frame:?}");
        }
    }
}

#[test]
fn what_was_judged_does_not_depend_on_when_time_was_seen_to_pass() {
    for Adversity { name, packets, .. } in adversity::all() {
        let mut watched = Sessions::default();
        let mut before_ns = 0;
        for (at_ns, packet) in packets.clone() {
            for now_ns in (before_ns..at_ns).step_by(100_000_000) {
                watched.pass(now_ns);
            }
            watched.take(packet, at_ns);
            before_ns = at_ns;
        }
        watched.finish();
        let judged: Vec<Judged> = std::iter::from_fn(|| watched.next_judged()).collect();
        assert_eq!(judged, run(packets).0, "{name}");
    }
}

#[test]
fn sessions_follow_one_another_even_if_the_first_packet_was_late() {
    // The first of all came 2 s late, and 0.5 s passed until the restart.
    let mut packets = vec![(2_000_000_000, hello_of("ward 3", 1))];
    packets.extend((0..120).map(|number| (2_000_000_000, frame_of(1, number, 60))));
    packets.push((2_500_000_000, hello_of("ward 3", 2)));
    packets.extend((0..60).map(|number| (2_500_000_000, frame_of(2, number, 60))));
    let (judged, _) = run(packets);
    let times: Vec<f64> =
        frames(&judged).map(|it| it.clock.time_s(it.packet.capture_time_ns)).collect();
    assert_eq!(times.len(), 180);
    assert!(times.is_sorted() && times[120] - times[119] > 1.5, "{times:?}");
}

#[test]
fn memory_is_bounded_and_a_flood_of_starts_hides_no_restart() {
    let mut packets = vec![(0, hello_of("ward 3", START))];
    packets.extend((0..60).map(|number| (0, frame_of(START, number, 60))));
    packets.extend((0..500).map(|at| (u64::from(at), frame_of(1000 + at, at, 60))));
    packets.push((3_000_000_000, hello_of("ward 3", 8)));
    packets.extend((0..60).map(|number| (3_000_000_001, frame_of(8, number, 60))));
    let (_, sessions) = run(packets);
    assert!(sessions.strangers.len() <= STRANGERS_MAX);
    assert_eq!((sessions.count(), sessions.counts().received), (2, 120));
    assert_eq!(sessions.left_out().unknown_start, 500);

    // Poses of one start that never says who it is.
    let mut sessions = Sessions::default();
    for number in 0..3 * HELD_MAX as u32 {
        sessions.take(frame_of(1, number, 1000), 0);
    }
    assert_eq!(sessions.strangers[0].held.len(), HELD_MAX);

    // Many restarts: the counts of all of them, the windows of the latest.
    let starts = 1..=3 * SESSIONS_MAX as u32;
    let each = |start: u32| {
        let at_ns = u64::from(start) * 10_000_000_000;
        [(at_ns, hello_of("ward 3", start)), (at_ns, frame_of(start, 0, 60))]
    };
    let (_, sessions) = run(starts.flat_map(each).collect());
    assert_eq!(sessions.sessions.len(), SESSIONS_MAX);
    assert_eq!((sessions.count(), sessions.counts().received), (24, 24));
}

#[test]
fn what_a_box_says_before_it_names_itself_is_heard() {
    let health = || packet(START, Message::Health(health()));
    let (judged, _) = run(vec![
        (0, health()),
        (1, frame_of(START, 0, 60)),
        (2, hello_of("ward 3", START)),
        (3, health()),
        // Of a host on the same line.
        (4, Packet { start: None, message: health().message }),
    ]);
    assert!(
        matches!(
            &judged[..],
            [
                Judged::Unnamed(Message::Health(_)),
                Judged::Begins { session: 1, .. },
                Judged::Frame(_),
                Judged::Message(Message::Health(_)),
            ]
        ),
        "{judged:?}"
    );
}
