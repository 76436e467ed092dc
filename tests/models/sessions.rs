//! The starts of a box, told from one another and from other boxes.
//!
//! - Over restarts the sums are those of the starts, each counted alone; every frame is handed out once.
//! - Whatever comes, from whom and when, each packet of a pose is counted once.
//! - What is judged does not depend on when somebody looked: a recording is read as it was made.

use std::collections::BTreeSet;
use std::iter::from_fn;

use plumbline::packet::{Message, Packet, PosePacket};
use plumbline_stream::accounting::Counts;
use plumbline_stream::fixture::adversity::{frame_of, hello_of};
use plumbline_stream::fixture::{health, packet, pose_packet};
use plumbline_stream::sessions::{Judged, LeftOut, Sessions};
use proptest::prelude::*;

use crate::accounting::{Journey, Seen, journeys};
use crate::laws::Tries;

const SECOND_NS: u64 = 1_000_000_000;

/// A packet is under way for less than this, and a box is off for longer: what it has said before it
/// restarted comes before what it says afterwards.
const DELAY_MS_MAX: u16 = 1_000;

fn judged(sessions: &mut Sessions) -> Vec<Judged> {
    from_fn(|| sessions.next_judged()).collect()
}

/// A start of the box: how long it was off before, in milliseconds, when each of its Hellos comes, and
/// its frames.
type OneStart = (u16, Vec<u16>, Journey);

fn starts() -> impl Strategy<Value = Vec<OneStart>> {
    let hellos = proptest::collection::vec(0..DELAY_MS_MAX, 60);
    let start = (2 * DELAY_MS_MAX..6_000, hellos, journeys(30, DELAY_MS_MAX));
    proptest::collection::vec(start, 1..4)
}

/// Pose packet of a frame.
fn pose(start: u32, sequence: u32, capture_time_ns: u64) -> Packet {
    packet(start, Message::Pose(PosePacket { capture_time_ns, ..pose_packet(sequence) }))
}

fn restarts_add_up(tries: Tries) {
    // Making one takes longer than all the rest.
    let hellos: Vec<Packet> = (1..=4).map(|start| hello_of("ward 3", start)).collect();
    tries.hold(
        "a box that restarts up to twice, on a network that loses, repeats and reorders",
        "every start is a session of its own, each sum is that of the starts, and each frame came out once",
        &starts(),
        |starts| {
            let mut packets = Vec::new();
            let (mut begun_ns, mut expected) = (0, Counts::default());
            let count = starts.len() as u32;
            for (start, (off_ms, delays_ms, journey)) in (1..).zip(starts) {
                begun_ns += u64::from(off_ms) * 1_000_000;
                let come = journey.packets();
                let mut seen = Seen::default();
                for it in &come {
                    seen.take(it.index);
                }
                expected += seen.counts();
                let lasted_ns = journey.fates.iter().map(|it| 1 + u64::from(it.left_out)).sum::<u64>()
                    * journey.period_ns;
                for (second, delay_ms) in (0..=lasted_ns / SECOND_NS).zip(&delays_ms) {
                    let at_ns = begun_ns + second * SECOND_NS + u64::from(*delay_ms) * 1_000_000;
                    packets.push((at_ns, hellos[start as usize - 1].clone()));
                }
                packets.extend(come.iter().map(|it| {
                    let packet = pose(start, journey.number(it.index), SECOND_NS + it.capture_ns);
                    (begun_ns + it.arrival_ns, packet)
                }));
                begun_ns += lasted_ns;
            }
            packets.sort_by_key(|(at_ns, _)| *at_ns);
            let mut sessions = Sessions::default();
            for (at_ns, packet) in packets {
                sessions.take(packet, at_ns);
            }
            sessions.finish();
            assert_eq!(sessions.counts(), expected);
            assert_eq!((sessions.count(), sessions.left_out()), (count, LeftOut::default()));
            let mut handed_out = BTreeSet::new();
            for judged in judged(&mut sessions) {
                if let Judged::Frame(frame) = judged {
                    let it = (frame.session, frame.packet.sequence);
                    assert!(handed_out.insert(it), "{it:?} came out twice");
                }
            }
            assert_eq!(handed_out.len() as u64, expected.received);
        },
    );
}

#[test]
fn restarts_add_up_to_their_parts() {
    restarts_add_up(Tries::few(150));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn restarts_add_up_to_their_parts_many_times() {
    restarts_add_up(Tries::many(50_000));
}

/// What somebody may send: a start, and what of it.
#[derive(Debug, Clone, Copy)]
enum Sent {
    Hello,
    OthersHello,
    Pose(u32),
    Health,
    OfHost,
}

/// Packets of up to five starts, each after a pause in milliseconds.
fn anything() -> impl Strategy<Value = Vec<(u16, u32, Sent)>> {
    let sent = prop_oneof![
        2 => Just(Sent::Hello),
        1 => Just(Sent::OthersHello),
        6 => (0..200_u32).prop_map(Sent::Pose),
        1 => Just(Sent::Health),
        1 => Just(Sent::OfHost),
    ];
    let pause_ms = prop_oneof![6 => 0..50_u16, 2 => 0..1_500_u16, 1 => 0..8_000_u16];
    proptest::collection::vec((pause_ms, 1..6_u32, sent), 0..60)
}

/// The packets that these stand for, each with its time.
struct Packets {
    hellos: Vec<[Packet; 2]>,
}

impl Packets {
    fn new() -> Self {
        let hellos = (1..6).map(|start| ["ward 3", "ward 4"].map(|name| hello_of(name, start)));
        Self { hellos: hellos.collect() }
    }

    fn of(&self, sent: &[(u16, u32, Sent)]) -> Vec<(u64, Packet)> {
        let mut at_ns = 0;
        let packet = |&(pause_ms, start, sent): &(u16, u32, Sent)| {
            at_ns += u64::from(pause_ms) * 1_000_000;
            let [own, others] = &self.hellos[start as usize - 1];
            let packet = match sent {
                Sent::Hello => own.clone(),
                Sent::OthersHello => others.clone(),
                Sent::Pose(number) => frame_of(start, number, 60),
                Sent::Health => packet(start, Message::Health(health())),
                Sent::OfHost => Packet { start: None, message: Message::Health(health()) },
            };
            (at_ns, packet)
        };
        sent.iter().map(packet).collect()
    }
}

fn every_packet_is_counted_once(tries: Tries) {
    let packets = Packets::new();
    tries.hold(
        "packets of two boxes and five starts of theirs, in any order and at any time",
        "each pose is counted once: handed out, repeated, implausible, or left out with a reason",
        &anything(),
        |sent| {
            let mut sessions = Sessions::default();
            let (mut poses, mut others) = (0, 0);
            for (at_ns, packet) in packets.of(&sent) {
                match &packet {
                    Packet { message: Message::Pose(_), .. } => poses += 1,
                    // What a host says is nobody's.
                    Packet { start: None, .. } => {}
                    _ => others += 1,
                }
                sessions.take(packet, at_ns);
            }
            sessions.finish();
            let Counts { received, repeated, implausible, .. } = sessions.counts();
            let LeftOut { other_box, conflicting, unknown_start } = sessions.left_out();
            let counted =
                received + repeated + implausible + other_box + conflicting + unknown_start;
            // Whoever is left out is left out with what he says of himself.
            assert!((poses..=poses + others).contains(&counted), "{poses} and {others}: {counted}");
            let frames =
                judged(&mut sessions).iter().filter(|it| matches!(it, Judged::Frame(_))).count();
            assert_eq!(frames as u64, received);
        },
    );
}

#[test]
fn every_packet_is_counted_exactly_once() {
    every_packet_is_counted_once(Tries::few(400));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn every_packet_is_counted_exactly_once_many_times() {
    every_packet_is_counted_once(Tries::many(150_000));
}

fn looking_changes_nothing(tries: Tries) {
    let packets = Packets::new();
    tries.hold(
        "the same packets, judged as they come and with looks at any time between them",
        "the judgement is the same",
        &(anything(), proptest::collection::vec(0..2_000_u64, 1..20)),
        |(sent, looks_ms)| {
            let (mut one, mut other) = (Sessions::default(), Sessions::default());
            let mut looks_ms = looks_ms.into_iter().cycle();
            let mut looked_ns = 0;
            for (at_ns, packet) in packets.of(&sent) {
                one.take(packet.clone(), at_ns);
                while looked_ns < at_ns {
                    other.pass(looked_ns);
                    looked_ns += 1_000_000 * (1 + looks_ms.next().expect("there are some"));
                }
                other.take(packet, at_ns);
            }
            one.finish();
            other.finish();
            assert_eq!(judged(&mut other), judged(&mut one));
            assert_eq!((other.counts(), other.left_out()), (one.counts(), one.left_out()));
        },
    );
}

#[test]
fn a_look_changes_nothing() {
    looking_changes_nothing(Tries::few(400));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_look_changes_nothing_many_times() {
    looking_changes_nothing(Tries::many(150_000));
}
