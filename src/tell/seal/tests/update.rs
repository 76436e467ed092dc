//! Updates between a box and hosts of whatever release.

extern crate std;

use std::format;
use std::string::String as StdString;
use std::vec::Vec as StdVec;

use heapless::{String, Vec};

use super::super::wire::{Kind, greeting};
use super::super::*;
use super::world::{MS, S, address, caller, draw, key};
use crate::packet::{
    PART_BYTES_MAX, PROTOCOL_VERSION, SCHEMA_HASH, Start, UPDATE_PART_BYTES_MAX,
    UPDATE_TEXT_BYTES_MAX, UpdateOutcome, UpdateRefusal, UpdateReply, UpdateRequest, UpdateState,
    UpdateStep,
};
use crate::test_support::{Random, repetitions};

const BOX_AT: usize = 0;
const NOW_NS: u64 = 10_000 * S;

/// A box, and programs that update it, over a network that may lose some packets.
struct Bench {
    now_ns: u64,
    random: Random,
    bx: BoxEnd,
    hosts: StdVec<(Peer, UpdateEnd)>,
    /// What the box was asked, by whom.
    asked: StdVec<(UpdaterId, UpdateRequest)>,
    /// What each host was told.
    told: StdVec<(usize, UpdateReply)>,
    /// Everything that hosts sent and that the box sent.
    log: StdVec<(Peer, StdVec<u8>)>,
    lost: f64,
}

impl Bench {
    fn new(seed: u64) -> Self {
        let mut random = Random::new(seed);
        let bx = BoxEnd::new(Some(key(1)), Start::new(77).unwrap(), &draw(&mut random));
        Self {
            now_ns: NOW_NS,
            random,
            bx,
            hosts: StdVec::new(),
            asked: StdVec::new(),
            told: StdVec::new(),
            log: StdVec::new(),
            lost: 0.0,
        }
    }

    fn join(&mut self, process: u32) -> usize {
        let place = self.hosts.len();
        let caller = caller(process, &format!("program {process}"));
        let end = UpdateEnd::new(key(1), caller, Some(address(BOX_AT)));
        self.hosts.push((address(10 + place), end));
        place
    }

    /// The box takes a packet, and what it answers goes back.
    fn box_receives(&mut self, from: Peer, packet: &[u8]) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let random = &mut self.random;
        let heard = self.bx.receive(from, packet, self.now_ns, || draw(random), &mut buffer);
        let answer = match heard {
            Heard::Answer(answer) => answer.to_vec(),
            Heard::Update { updater, request } => {
                let id = request.id;
                let is_part = matches!(request.step, UpdateStep::Part { .. });
                self.asked.push((updater, request));
                if is_part {
                    return;
                }
                let reply = UpdateReply { id, version: String::new(), outcome: none() };
                let mut buffer = [0; SEALED_BYTES_MAX];
                let (to, packet) = self.bx.seal_to_updater(&reply, &mut buffer).unwrap().unwrap();
                assert_eq!(to, from);
                packet.to_vec()
            }
            Heard::Nothing | Heard::Left => return,
            other => panic!("{other:?}"),
        };
        self.log.push((address(BOX_AT), answer.clone()));
        self.host_receives(from, &answer);
    }

    fn host_receives(&mut self, at: Peer, packet: &[u8]) {
        if self.random.uniform(0.0, 1.0) < self.lost {
            return;
        }
        let Some(place) = self.hosts.iter().position(|(peer, _)| *peer == at) else { return };
        let mut buffer = [0; SEALED_BYTES_MAX];
        let random = &mut self.random;
        let end = &mut self.hosts[place].1;
        let from = address(BOX_AT);
        match end.receive(from, packet, self.now_ns, || draw(random), &mut buffer) {
            ToldOfUpdate::Handshake(Some(packet)) => {
                let packet = packet.to_vec();
                self.send(at, &packet);
            }
            ToldOfUpdate::Reply { reply, .. } => self.told.push((place, reply)),
            _ => {}
        }
    }

    /// A host sends something.
    fn send(&mut self, from: Peer, packet: &[u8]) {
        self.log.push((from, packet.to_vec()));
        if self.random.uniform(0.0, 1.0) >= self.lost {
            self.box_receives(from, packet);
        }
    }

    /// Lets time pass.
    fn run(&mut self, time_ns: u64) {
        let end_ns = self.now_ns + time_ns;
        while self.now_ns < end_ns {
            self.now_ns += 10 * MS;
            self.bx.pass(self.now_ns);
            for place in 0..self.hosts.len() {
                let mut buffer = [0; SEALED_BYTES_MAX];
                loop {
                    let random = &mut self.random;
                    let (at, end) = &mut self.hosts[place];
                    let due = end.due(self.now_ns, || draw(random), &mut buffer);
                    let Some((_, packet)) = due else { break };
                    let (at, packet) = (*at, packet.to_vec());
                    self.send(at, &packet);
                }
            }
        }
    }

    /// A host asks for a step, once.
    fn ask(&mut self, place: usize, id: u16, step: UpdateStep) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let (at, end) = &mut self.hosts[place];
        let request = UpdateRequest { id, step };
        let Some(packet) = end.seal(&request, &mut buffer) else { return };
        let (at, packet) = (*at, packet.unwrap().1.to_vec());
        self.send(at, &packet);
    }

    /// The outcomes that a host has been told since the last call.
    fn outcomes(&mut self, place: usize) -> StdVec<UpdateOutcome> {
        let all = std::mem::take(&mut self.told);
        all.into_iter().filter(|it| it.0 == place).map(|it| it.1.outcome).collect()
    }
}

fn none() -> UpdateOutcome {
    UpdateOutcome::State { state: UpdateState::None, text: String::new() }
}

#[test]
fn a_box_and_a_host_of_any_release_talk_about_an_update() {
    let ours = PROTOCOL_VERSION;
    let ours = [ours, ours];
    for (of_box, of_host) in [
        (ours, ours),
        ([ours[0] + 1; 2], ours),
        (ours, [ours[0] + 1; 2]),
        ([1, 2], [250, 255]),
        ([250, 255], [1, 2]),
    ] {
        for schema_hash in [SCHEMA_HASH, SCHEMA_HASH ^ 1] {
            let mut bench = Bench::new(31);
            let announcement = &mut bench.bx.announcement;
            (announcement.versions, announcement.schema_hash) = (of_box, schema_hash);
            let host = bench.join(5);
            bench.hosts[host].1.speak(of_host);
            bench.run(20 * MS);
            bench.ask(host, 9, UpdateStep::Query);
            assert_eq!(bench.outcomes(host), [none()], "{of_box:?} {of_host:?} {schema_hash:x}");
            // Nobody who updates a box listens to it.
            assert!(bench.bx.listeners().is_empty() && bench.bx.recorder().is_none());
        }
    }
}

#[test]
fn nobody_without_the_key_asks_or_is_told_anything() {
    let mut bench = Bench::new(32);
    let thief = bench.join(6);
    bench.hosts[thief].1 = UpdateEnd::new(key(2), caller(6, "a thief"), Some(address(BOX_AT)));
    bench.run(5 * S);
    bench.ask(thief, 1, UpdateStep::Query);
    assert!(bench.asked.is_empty() && bench.told.is_empty());
    assert_eq!(bench.hosts[thief].1.peer(), None);
    // And a box with another key opens no session with a host that has its key.
    bench.bx = BoxEnd::new(Some(key(2)), Start::new(78).unwrap(), &[7; 32]);
    let host = bench.join(7);
    bench.run(5 * S);
    assert_eq!(bench.hosts[host].1.peer(), None);
}

#[test]
fn one_program_at_a_time_updates_a_box() {
    let mut bench = Bench::new(33);
    let (first, second) = (bench.join(1), bench.join(2));
    bench.run(20 * MS);
    bench.ask(first, 1, UpdateStep::Begin { is_forced: false });
    let updater = bench.asked[0].0;
    bench.ask(second, 1, UpdateStep::Query);
    let text = "it is being updated by program 1".try_into().unwrap();
    let busy = UpdateOutcome::Refused { refusal: UpdateRefusal::Busy, text };
    assert_eq!(bench.outcomes(second), [busy]);
    assert!(bench.asked.iter().all(|it| it.0 == updater));
    // After another handshake it is the same program.
    let (at, _) = bench.hosts[first];
    bench.hosts[first] =
        (at, UpdateEnd::new(key(1), caller(1, "program 1"), Some(address(BOX_AT))));
    bench.run(20 * MS);
    bench.ask(first, 2, UpdateStep::Query);
    assert_eq!(bench.asked.last().unwrap().0, updater);
    // What it said before in the session that is over is not taken late.
    bench.asked.clear();
    for (from, packet) in bench.log.clone() {
        if from == at && Kind::of(&packet).unwrap().0 == Kind::UpdateChannel {
            bench.box_receives(from, &packet);
        }
    }
    assert!(bench.asked.is_empty());
    // Silent for three seconds, or gone, it makes room.
    bench.run(3 * S);
    bench.ask(second, 2, UpdateStep::Query);
    bench.run(4 * S);
    bench.ask(second, 3, UpdateStep::Query);
    assert_ne!(bench.asked.last().unwrap().0, updater);
    bench.ask(second, 4, UpdateStep::Leave);
    bench.ask(first, 5, UpdateStep::Query);
    bench.run(4 * S);
    bench.ask(first, 6, UpdateStep::Query);
    assert_eq!(bench.asked.last().unwrap().0, updater);
}

#[test]
fn a_program_updates_from_its_address_and_in_its_latest_session() {
    let mut bench = Bench::new(36);
    let host = bench.join(1);
    bench.run(20 * MS);
    bench.ask(host, 1, UpdateStep::Query);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let (at, end) = &mut bench.hosts[host];
    let request = UpdateRequest { id: 2, step: UpdateStep::Query };
    let (at, packet) = (*at, end.seal(&request, &mut buffer).unwrap().unwrap().1.to_vec());
    bench.box_receives(address(400), &packet);
    bench.box_receives(at, &packet);
    bench.hosts[host].1 = UpdateEnd::new(key(1), caller(1, "program 1"), Some(address(BOX_AT)));
    bench.run(20 * MS);
    bench.ask(host, 3, UpdateStep::Query);
    let ids: StdVec<u16> = bench.asked.iter().map(|it| it.1.id).collect();
    assert_eq!(ids, [1, 2, 3]);
}

#[test]
fn a_reply_counts_where_the_box_is_alone() {
    let mut bench = Bench::new(37);
    let host = bench.join(1);
    bench.run(20 * MS);
    assert_eq!(bench.hosts[host].1.peer(), Some(address(BOX_AT)));
    bench.ask(host, 1, UpdateStep::Query);
    let sent = UpdateReply { id: 1, version: String::new(), outcome: none() };
    let mut buffer = [0; SEALED_BYTES_MAX];
    let packet = bench.bx.seal_to_updater(&sent, &mut buffer).unwrap().unwrap().1.to_vec();
    for (from, is_it) in [(address(400), false), (address(BOX_AT), true)] {
        let end = &mut bench.hosts[host].1;
        let told = end.receive(from, &packet, bench.now_ns, || unreachable!(), &mut buffer);
        let is_told = matches!(&told, ToldOfUpdate::Reply { reply, .. } if *reply == sent);
        assert_eq!(is_told, is_it, "{told:?}");
    }
}

#[test]
fn an_announcement_has_a_host_greet_another_start_of_its_box_alone() {
    let mut bench = Bench::new(38);
    let [met, new] = [bench.join(1), bench.join(2)];
    bench.run(20 * MS);
    bench.hosts[new].1 = UpdateEnd::new(key(1), caller(2, "program 2"), None);
    // The key and start that are announced, and which of the two then greets.
    let cases = [
        (2, 77, [None, None]),
        (1, 77, [None, Some(address(400))]),
        (1, 78, [Some(address(401)), Some(address(401))]),
    ];
    for (index, (of, start, greeted)) in cases.into_iter().enumerate() {
        let mut buffer = [0; SEALED_BYTES_MAX];
        let bx = BoxEnd::new(Some(key(of)), Start::new(start).unwrap(), &[2; 32]);
        let packet = bx.announcement(&mut buffer).to_vec();
        for (place, expected) in [met, new].into_iter().zip(greeted) {
            let (end, now_ns) = (&mut bench.hosts[place].1, bench.now_ns);
            let from = address(399 + index);
            let told = end.receive(from, &packet, now_ns, || [9; 32], &mut buffer);
            let is_of_its_box = matches!(told, ToldOfUpdate::Handshake(None));
            assert_eq!(is_of_its_box, of == 1, "{told:?}");
            let due = end.due(now_ns, || [9; 32], &mut buffer);
            let due = due.map(|(to, packet)| (to, Kind::of(packet).unwrap().0));
            assert_eq!(due, expected.map(|to| (to, Kind::Greeting)), "{of} {start} {place}");
        }
    }
}

#[test]
fn what_is_lost_is_asked_again_and_nothing_is_done_twice() {
    for seed in 0..repetitions(30) as u64 {
        let mut bench = Bench::new(100 + seed);
        bench.lost = 0.3;
        let host = bench.join(5);
        let mut answered = 0;
        for id in 0..200 {
            bench.ask(host, id, UpdateStep::Query);
            bench.run(100 * MS);
            let outcomes = bench.outcomes(host);
            assert!(outcomes.len() <= 1);
            answered += outcomes.len();
        }
        // Of 200, half get through both ways; a session takes a second or two to come about, and
        // now and then another one.
        assert!(answered >= 40, "{answered}");
        let mut ids: StdVec<u16> = bench.asked.iter().map(|it| it.1.id).collect();
        let count = ids.len();
        ids.dedup();
        assert_eq!(ids.len(), count, "one was taken twice");
        // Everything once more, from where it came and from elsewhere: what never arrived may still.
        let log = std::mem::take(&mut bench.log);
        bench.lost = 0.0;
        bench.asked.clear();
        for (from, packet) in &log {
            if *from != address(BOX_AT) {
                bench.box_receives(*from, packet);
                bench.box_receives(address(400), packet);
            }
        }
        assert!(bench.asked.iter().all(|it| !ids.contains(&it.1.id)));
    }
}

/// Whoever makes one kind of packet into the other opens nothing: the seal covers the kind.
#[test]
fn the_two_kinds_of_session_are_not_exchanged() {
    let mut bench = Bench::new(34);
    let host = bench.join(1);
    bench.run(20 * MS);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let request = UpdateRequest { id: 1, step: UpdateStep::Query };
    let (at, end) = &mut bench.hosts[host];
    let (at, mut packet) = (*at, end.seal(&request, &mut buffer).unwrap().unwrap().1.to_vec());
    assert_eq!(packet[..2], [4, Kind::UpdateChannel as u8]);
    packet[..2].copy_from_slice(&[PROTOCOL_VERSION, Kind::Channel as u8]);
    bench.box_receives(at, &packet);
    packet[1] = Kind::UpdateChannel as u8;
    packet[0] ^= 1;
    bench.box_receives(at, &packet);
    assert!(bench.asked.is_empty());
    // As it was sent it opens.
    packet[0] = 4;
    bench.box_receives(at, &packet);
    assert_eq!(bench.asked.len(), 1);
}

fn hexadecimal(bytes: &[u8]) -> StdString {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A session of the first release that has updates, with all its secrets, packet by packet. It never
/// changes: later releases put other versions and other hashes into it, and nothing else.
#[test]
fn the_packets_are_those_of_the_first_release() {
    let [box_at, host_at] = [4211, 4210].map(|port| Peer::Udp(([127, 0, 0, 1], port).into()));
    let key = Key::new([1; 32]).unwrap();
    let mut bx = BoxEnd::new(Some(key.clone()), Start::new(0x1234_5678).unwrap(), &[2; 32]);
    (bx.announcement.versions, bx.announcement.schema_hash) = ([4, 4], 0x2eb1_0d3c);
    let mut host = UpdateEnd::new(key, caller(0x0bad_cafe, "a host"), Some(box_at));
    host.speak([4, 4]);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut made = StdVec::new();
    let now_ns = 5 * S;
    let (_, greeted) = host.due(now_ns, || [3; 32], &mut buffer).unwrap();
    // Its version is that of the release, and nobody looks at it.
    assert_eq!(greeted[1..], greeting([3; 8], &mut [0; SEALED_BYTES_MAX])[1..]);
    let greeted = greeted.to_vec();
    let Heard::Answer(answer) = bx.receive(host_at, &greeted, now_ns, || [5; 32], &mut buffer)
    else {
        panic!()
    };
    let answer = answer.to_vec();
    made.push(hexadecimal(&answer));
    let told = host.receive(box_at, &answer, now_ns, || [4; 32], &mut buffer);
    let ToldOfUpdate::Handshake(Some(opening)) = told else { panic!("{told:?}") };
    let opening = opening.to_vec();
    made.push(hexadecimal(&opening));
    let heard = bx.receive(host_at, &opening, now_ns, || [5; 32], &mut buffer);
    let Heard::Answer(acceptance) = heard else { panic!("{heard:?}") };
    let acceptance = acceptance.to_vec();
    made.push(hexadecimal(&acceptance));
    host.receive(box_at, &acceptance, now_ns, || [4; 32], &mut buffer);
    for step in steps() {
        let request = UpdateRequest { id: 300, step };
        let packet = host.seal(&request, &mut buffer).unwrap().unwrap().1.to_vec();
        made.push(hexadecimal(&packet));
        let heard = bx.receive(host_at, &packet, now_ns, || [5; 32], &mut buffer);
        assert!(matches!(&heard, Heard::Update { request: it, .. } if *it == request), "{heard:?}");
    }
    for outcome in outcomes() {
        let version = "0.1.0+1a2b3c4d".try_into().unwrap();
        let reply = UpdateReply { id: 300, version, outcome };
        let packet = bx.seal_to_updater(&reply, &mut buffer).unwrap().unwrap().1.to_vec();
        made.push(hexadecimal(&packet));
        let told = host.receive(box_at, &packet, now_ns, || [4; 32], &mut buffer);
        assert!(matches!(&told, ToldOfUpdate::Reply { reply: it, .. } if *it == reply), "{told:?}");
    }
    let leave = UpdateRequest { id: 301, step: UpdateStep::Leave };
    let packet = host.seal(&leave, &mut buffer).unwrap().unwrap().1.to_vec();
    made.push(hexadecimal(&packet));
    let heard = bx.receive(host_at, &packet, now_ns, || [5; 32], &mut buffer);
    assert!(matches!(heard, Heard::Left), "{heard:?}");
    let expected: StdVec<&str> = include_str!("update_vectors.txt").lines().collect();
    assert_eq!(made, expected);
}

/// One of each, but for the last.
fn steps() -> [UpdateStep; 4] {
    let bytes = Vec::from_slice(&[0xab; 3]).unwrap();
    [
        UpdateStep::Query,
        UpdateStep::Begin { is_forced: true },
        UpdateStep::Part { offset: 70_000, bytes },
        UpdateStep::Try { is_forced: false },
    ]
}

/// One of each.
fn outcomes() -> StdVec<UpdateOutcome> {
    let states = [
        UpdateState::None,
        UpdateState::Receiving { next: 70_000 },
        UpdateState::Checking,
        UpdateState::Ready,
        UpdateState::Unusable,
        UpdateState::Restarting,
        UpdateState::OnTrial,
        UpdateState::Installed,
        UpdateState::GivenUp,
    ];
    let refusals = [
        UpdateRefusal::NotSupported,
        UpdateRefusal::Busy,
        UpdateRefusal::Recording,
        UpdateRefusal::NotReady,
        UpdateRefusal::NotStored,
    ];
    let text = || "why".try_into().unwrap();
    let states = states.into_iter().map(|state| UpdateOutcome::State { state, text: text() });
    let refusals =
        refusals.into_iter().map(|refusal| UpdateOutcome::Refused { refusal, text: text() });
    states.chain(refusals).collect()
}

/// The longest of each kind is one packet.
#[test]
fn the_longest_messages_fit() {
    let full = || {
        let mut text = String::<UPDATE_TEXT_BYTES_MAX>::new();
        while text.push('x').is_ok() {}
        text
    };
    let mut version = String::new();
    while version.push('x').is_ok() {}
    let mut bench = Bench::new(35);
    let host = bench.join(1);
    bench.run(20 * MS);
    let bytes = core::iter::repeat_n(0xff, UPDATE_PART_BYTES_MAX).collect();
    bench.ask(host, u16::MAX, UpdateStep::Part { offset: u32::MAX, bytes });
    assert_eq!(bench.asked.len(), 1);
    let state = UpdateState::Receiving { next: u32::MAX };
    let refusal = UpdateRefusal::NotStored;
    for outcome in [
        UpdateOutcome::State { state, text: full() },
        UpdateOutcome::Refused { refusal, text: full() },
    ] {
        let reply = UpdateReply { id: u16::MAX, version: version.clone(), outcome };
        bench.bx.seal_to_updater(&reply, &mut [0; SEALED_BYTES_MAX]).unwrap().unwrap();
    }
    // So that a part of an update costs the link what any other part does.
    assert_eq!(UPDATE_PART_BYTES_MAX, PART_BYTES_MAX);
}
