//! A handshake with all its secrets, and the packets that follow from it, for other receivers.

use std::fmt::Write as _;
use std::path::PathBuf;

use plumbline::packet::{Action, Command, Message, Reply, ReplyOutcome, SCHEMA_HASH, Start};
use plumbline::seal::{BoxEnd, Caller, Heard, HostEnd, Key, Peer, SEALED_BYTES_MAX, Told};
use plumbline_stream::fixture::pose_packet;
use plumbline_test_support::root;
use serde_json::{Map, Value};

const FILE: &str = "tests/link/vectors.json";

const KEY: [u8; 32] = [0x01; 32];
const START: u32 = 0x1234_5678;
/// From which the box's cookies and the first key of its stream follow.
const SECRET: [u8; 32] = [0x02; 32];
/// The first 8 bytes are the token of the greeting.
const TOKEN: [u8; 32] = [0x03; 32];
const HOST_EPHEMERAL: [u8; 32] = [0x04; 32];
const BOX_EPHEMERAL: [u8; 32] = [0x05; 32];
const PROCESS: u32 = 0x0BAD_CAFE;
const NOW_NS: u64 = 5_000_000_000;

fn hexadecimal(bytes: &[u8]) -> Value {
    Value::String(bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    }))
}

fn vectors() -> Map<String, Value> {
    let mut all = Map::new();
    let mut note = |name: &str, bytes: &[u8]| {
        all.insert(name.to_owned(), hexadecimal(bytes));
    };
    let [box_at, host_at] = [4211, 4210].map(|port| Peer::Udp(([127, 0, 0, 1], port).into()));
    let key = Key::new(KEY).unwrap();
    let caller = Caller { process: PROCESS, name: "receiver.py".try_into().unwrap() };
    let mut host = HostEnd::new(key.clone(), caller, None);
    let mut of_box = BoxEnd::new(Some(key), Start::new(START).unwrap(), &SECRET);
    let mut buffer = [0; SEALED_BYTES_MAX];
    note("key", &KEY);
    note("box_secret", &SECRET);
    note("token", &TOKEN[..8]);
    note("host_ephemeral", &HOST_EPHEMERAL);
    note("box_ephemeral", &BOX_EPHEMERAL);
    note("schema_hash", &SCHEMA_HASH.to_le_bytes());
    note("process", &PROCESS.to_le_bytes());

    let announcement = of_box.announcement(&mut buffer).to_vec();
    note("announcement", &announcement);
    host.receive(box_at, &announcement, NOW_NS, || TOKEN, &mut buffer);
    let (_, greeting) = host.due(NOW_NS, || TOKEN, &mut buffer).expect("a greeting");
    let greeting = greeting.to_vec();
    note("greeting", &greeting);
    let draw = || BOX_EPHEMERAL;
    let answer = match of_box.receive(host_at, &greeting, NOW_NS, draw, &mut buffer) {
        Heard::Answer(answer) => answer.to_vec(),
        other => panic!("{other:?}"),
    };
    note("answer", &answer);
    let draw = || HOST_EPHEMERAL;
    let opening = match host.receive(box_at, &answer, NOW_NS, draw, &mut buffer) {
        Told::Handshake(Some(opening)) => opening.to_vec(),
        other => panic!("{other:?}"),
    };
    note("opening", &opening);
    // Two messages before it joins, so that its first counter is not 0.
    for sequence in 0..2 {
        of_box.seal_to_all(&Message::Pose(pose_packet(sequence)), &mut buffer).unwrap();
    }
    let draw = || BOX_EPHEMERAL;
    let acceptance = match of_box.receive(host_at, &opening, NOW_NS, draw, &mut buffer) {
        Heard::Answer(acceptance) => acceptance.to_vec(),
        other => panic!("{other:?}"),
    };
    note("acceptance", &acceptance);
    host.receive(box_at, &acceptance, NOW_NS, || TOKEN, &mut buffer);
    let (_, ping) = host.due(NOW_NS, || TOKEN, &mut buffer).expect("a ping");
    let ping = ping.to_vec();
    note("ping", &ping);
    let heard = of_box.receive(host_at, &ping, NOW_NS, draw, &mut buffer);
    let Heard::Message { listener, has_joined: true, message } = heard else { panic!("{heard:?}") };
    let action = Action::Ping { host_sent_ns: NOW_NS };
    assert_eq!(message, Message::Command(Command { id: 0, action, is_forced: false }));
    let outcome = ReplyOutcome::Pong {
        host_sent_ns: NOW_NS,
        box_received_ns: 7_000_000_000,
        box_sent_ns: 7_000_100_000,
        stream_next: 2,
    };
    let pong = Message::Reply(Reply { id: 0, outcome });
    let (_, packet) = of_box.seal_to(listener, &pong, &mut buffer).unwrap().unwrap();
    note("pong", packet);
    for (name, sequence) in [("first_pose", 2), ("second_pose", 3)] {
        let message = Message::Pose(pose_packet(sequence));
        let packet = of_box.seal_to_all(&message, &mut buffer).unwrap().1.to_vec();
        let told = host.receive(box_at, &packet, NOW_NS, || TOKEN, &mut buffer);
        assert!(matches!(&told, Told::Message { message: it, .. } if *it == message), "{told:?}");
        note(name, &packet);
        note(&format!("{name}_message"), &postcard(&message));
    }
    let mut leave = Vec::new();
    host.leave(|_, packet| leave.extend_from_slice(packet));
    note("leave", &leave);
    let heard = of_box.receive(host_at, &leave, NOW_NS, draw, &mut buffer);
    assert!(matches!(heard, Heard::Left), "{heard:?}");
    all
}

/// A message as it is before it is sealed: what lies between the header of a packet in clear and its
/// checksum.
fn postcard(message: &Message) -> Vec<u8> {
    let mut buffer = [0; plumbline::packet::PACKET_BYTES_MAX];
    let packet = plumbline::packet::encode_datagram(Start::new(START), message, &mut buffer);
    let packet = packet.unwrap();
    packet[9..packet.len() - 4].to_vec()
}

pub fn file() -> PathBuf {
    root().join(FILE)
}

/// After a change of the format that was meant, the file is put right with
/// `PLUMBLINE_WRITE_VECTORS=1 cargo test --locked -p plumbline-tests --test link vectors`.
#[test]
fn the_published_vectors_are_what_this_program_makes() {
    let made = serde_json::to_string_pretty(&vectors()).unwrap() + "\n";
    if std::env::var_os("PLUMBLINE_WRITE_VECTORS").is_some() {
        std::fs::write(file(), &made).unwrap();
    }
    let published = std::fs::read_to_string(file()).unwrap();
    assert!(published == made, "{FILE} is not what this program makes: {made}");
}
