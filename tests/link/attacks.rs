//! What strangers send under any address, record and play back changes nothing: B1 to B9 and B13 of
//! the table in the module's documentation.

use std::net::UdpSocket;
use std::time::{Duration, Instant};

use plumbline::packet::PROTOCOL_VERSION;
use plumbline::packet::{Action, Command, Message, Start};
use plumbline::seal::{
    BoxEnd, Caller, Heard, HostEnd, Key, Peer, SEALED_BYTES_MAX, Told, greeting,
};
use plumbline_stream::fixture::pose_packet;
use plumbline_test_support::free_address;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::{Bench, assert_whole, described, key, wait_for};
use crate::relay::{ACCEPTANCE, ANNOUNCEMENT, ANSWER, CHANNEL, OPENING, Relay, STREAM, Seen};

/// Hostile packets of each kind: 10,000 in all, in either direction.
const PACKETS: usize = 2_000;

/// Without a pause the socket's buffer, not the program, would refuse most of them.
const AT_ONCE: usize = 50;

pub fn pause(index: usize) {
    if index.is_multiple_of(AT_ONCE) {
        std::thread::sleep(Duration::from_millis(4));
    }
}

/// A stranger's box, which knows everything but the key: it calls itself by the same name.
pub fn strangers_packets(key_of_it: &Key) -> Vec<Vec<u8>> {
    let mut of_box = BoxEnd::new(Some(key_of_it.clone()), Start::new(9).unwrap(), &[8; 32]);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut packets = vec![of_box.announcement(&mut buffer).to_vec()];
    for sequence in 0..200 {
        let pose = Message::Pose(pose_packet(sequence));
        packets.push(of_box.seal_to_all(&pose, &mut buffer).unwrap().1.to_vec());
    }
    packets
}

/// What anybody can make of the box's announcement, which is in clear: it has started again.
pub fn forged_announcements() -> Vec<Vec<u8>> {
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut forged = |start| {
        let of_box = BoxEnd::new(Some(key()), Start::new(start).unwrap(), &[1; 32]);
        of_box.announcement(&mut buffer).to_vec()
    };
    (1..=200).map(&mut forged).collect()
}

/// Changes a packet that was seen, as somebody would who does not have the key.
pub fn spoiled(kind: usize, bytes: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    match kind {
        // As it was.
        0 => {}
        1 => {
            let bit = random.random_range(0..8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        2 => bytes.truncate(random.random_range(0..bytes.len())),
        // Another counter, or another session.
        3 => {
            for byte in bytes.iter_mut().skip(2).take(3) {
                *byte = random.random();
            }
        }
        // Noise behind a head.
        _ => random.fill(&mut bytes[2..]),
    }
    bytes
}

/// The same for the box and for a host: everything that went to it, in five ways.
fn attack(relay: &Relay, seen: &[Seen], is_to_box: bool, random: &mut ChaCha8Rng) {
    let to_it: Vec<&Seen> =
        seen.iter().filter(|it| it.is_to_box == is_to_box && !it.is(ANNOUNCEMENT)).collect();
    // Also what is not for it.
    let all: Vec<&Seen> = seen.iter().collect();
    for kind in 0..5 {
        for index in 0..PACKETS {
            pause(index);
            let of = if index % 4 == 3 { &all } else { &to_it };
            let one = of[random.random_range(0..of.len())];
            let bytes = spoiled(kind, &one.bytes, random);
            if is_to_box { relay.as_host(0, &bytes) } else { relay.as_box(0, &bytes) }
        }
    }
}

/// B1 to B3, B6 to B9, B12 and B17: whatever is sent under either address while a trial is recorded,
/// and when the box has started again.
#[test]
fn ten_thousand_forged_and_repeated_packets_change_nothing() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 11);
    let mut random = ChaCha8Rng::seed_from_u64(12);
    // Before the box starts: a stranger's announcement and poses.
    let mut host = bench.receive(0, "trial", "--quiet");
    for packet in strangers_packets(&Key::new([99; 32]).unwrap()) {
        relay.as_box(0, &packet);
    }
    let config = bench.read("box.plb");
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 30);
    wait_for("the configuration", || bench.path("trial/config.plb").exists());
    let first_start = relay.seen();
    attack(&relay, &first_start, true, &mut random);
    attack(&relay, &first_start, false, &mut random);
    let before = bench.recorded("trial").len();
    bench.wait_for_poses("trial", before + 60);
    the_box.end();
    assert_whole(&bench, "trial", "sent.bin");
    let first = bench.sent("sent.bin").len();

    // Another start of the same box: all of the first one is played to it and to the host.
    let mut the_box = bench.start(&relay, "again.bin");
    bench.wait_for_poses("trial", first + 30);
    let before_attack = relay.seen_count();
    attack(&relay, &first_start, true, &mut random);
    attack(&relay, &first_start, false, &mut random);
    let elsewhere = UdpSocket::bind("127.0.0.1:0").unwrap();
    for (index, packet) in forged_announcements().into_iter().enumerate() {
        pause(index);
        relay.as_box(0, &packet);
        elsewhere.send_to(&packet, bench.hosts[0]).unwrap();
    }
    let before = bench.recorded("trial").len();
    bench.wait_for_poses("trial", before + 60);
    host.interrupt();
    let said = host.succeeds();
    the_box.end();

    let recorded = bench.recorded("trial");
    let sent = [bench.sent("sent.bin"), bench.sent("again.bin")].concat();
    for (index, (recorded, sent)) in recorded.iter().zip(&sent).enumerate() {
        assert_eq!(recorded, sent, "pose {index}");
    }
    assert!(recorded.len() > first + 90 && recorded.len() <= sent.len());
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.frames, packets.lost), (recorded.len() as u64, 0), "{said}");
    assert_eq!((packets.sessions, packets.repeated, packets.late), (2, 0, 0), "{said}");
    let none = [packets.implausible, packets.other_box, packets.conflicting, packets.unknown_start];
    assert_eq!(none, [0; 4], "{said}");
    // It is counted, and said, that there were such packets.
    assert!(packets.not_authentic > PACKETS as u64, "{packets:?}");
    assert_eq!(bench.manifest("trial").the_box.unwrap().device, "ward 3");
    assert_eq!(bench.read("box.plb"), config);
    // The host did not begin again because of them: one handshake at each start of the box.
    let openings = relay.seen().iter().filter(|it| it.is(OPENING) && it.is_to_box).count();
    assert!(openings <= 4, "{openings}");
    // The box answers the host's own commands, and greetings; a replayed command gets nothing.
    let seen = relay.seen_since(before_attack);
    let count =
        |is_to_box, kind| seen.iter().filter(|it| it.is_to_box == is_to_box && it.is(kind)).count();
    let (asked, replied) = (count(true, CHANNEL), count(false, CHANNEL));
    assert!(replied <= 2 * asked + 10, "{replied} to {asked}");
}

/// B3: what has set the box up once does not do so again, in this start or in a later one.
#[test]
fn a_recorded_provisioning_does_nothing_when_it_is_played_back() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 13);
    let old = bench.read("box.plb");
    let settings = "device = \"ward 4\"\nserial_number = \"PL-0001\"\n[capture]\ndriver = \"v4l2\"\n\
                    pixel_format = \"grey\"\nrate_hz = 60.0\n[links]\nudp = \"UDP\"\n";
    let provision = |name: &str, settings: &str| {
        let host = bench.hosts[0].to_string();
        bench.write(name, &settings.replace("UDP", &host));
        let arguments = "--send --no-restart --force --via-udp";
        bench.done(&format!("provision --box {name} {} {arguments} {host}", described()));
    };
    let mut the_box = bench.start(&relay, "sent.bin");
    provision("ward-4.toml", settings);
    let provisioned = bench.read("box.plb");
    assert_ne!(provisioned, old);
    let session = relay.seen();
    provision("ward-5.toml", &settings.replace("ward 4", "ward 5"));
    let newer = bench.read("box.plb");
    assert_ne!(newer, provisioned);
    let play = || {
        for (index, packet) in session.iter().filter(|it| it.is_to_box).enumerate() {
            pause(index);
            relay.as_host(0, &packet.bytes);
        }
        std::thread::sleep(Duration::from_millis(300));
    };
    for _ in 0..3 {
        play();
    }
    assert_eq!(bench.read("box.plb"), newer);
    the_box.end();
    let mut the_box = bench.start(&relay, "sent.bin");
    let before = relay.the_box();
    wait_for("the box's new port", || relay.the_box().is_some() && relay.seen_count() > 0);
    std::thread::sleep(Duration::from_millis(500));
    for _ in 0..3 {
        play();
    }
    assert_eq!(bench.read("box.plb"), newer);
    assert_ne!(relay.the_box(), before, "a start has another port");
    the_box.end();
}

/// B4: whoever listens reads neither a pose, nor a picture, nor a name, nor the configuration.
#[test]
fn nothing_that_a_listener_sees_can_be_read() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 14);
    let mut the_box = bench.start(&relay, "sent.bin");
    let mut aim = bench.host(0, "aim --png view.png --once");
    aim.succeeds();
    assert!(image::open(bench.path("view.png")).is_ok());
    the_box.end();
    let seen = relay.seen();
    assert!(seen.iter().filter(|it| it.is(CHANNEL)).count() > 50, "a picture has many packets");
    let all: Vec<u8> = seen.iter().flat_map(|it| it.bytes.clone()).collect();
    assert_unreadable(&bench, &all);
    // What is sealed looks like noise: every byte value about equally often.
    let sealed = seen.iter().filter(|it| it.is(CHANNEL) || it.is(STREAM));
    let bytes: Vec<u8> = sealed.flat_map(|it| it.bytes.iter().skip(8).copied()).collect();
    let mut counts = [0_f64; 256];
    bytes.iter().for_each(|byte| counts[usize::from(*byte)] += 1.0);
    let expected = bytes.len() as f64 / 256.0;
    let chi2: f64 = counts.iter().map(|count| (count - expected).powi(2) / expected).sum();
    // 255 degrees of freedom: 255 +- 22.6; seven deviations are one in 10^11.
    assert!((chi2 - 255.0).abs() < 7.0 * 22.6, "chi-square {chi2} of {} bytes", bytes.len());
}

/// Whether none of what is to be kept secret is in these bytes, which somebody has seen on their way.
#[track_caller]
pub fn assert_unreadable(bench: &Bench, all: &[u8]) {
    let config = bench.read("box.plb");
    let secret = key().text();
    let mut needles: Vec<(&str, Vec<u8>)> = vec![
        ("the box's name", b"ward 3".to_vec()),
        ("its serial number", b"PL-0001".to_vec()),
        ("a target's name", b"lumbar".to_vec()),
        ("the host's program", b"plumb".to_vec()),
        ("a PNG", b"\x89PNG".to_vec()),
        ("a JPEG", vec![0xFF, 0xD8, 0xFF, 0xE0]),
        ("the key", [7; 32].to_vec()),
        ("the key's text", secret.as_str().as_bytes()[16..32].to_vec()),
    ];
    for chunk in config.chunks_exact(12).filter(|it| it.iter().any(|byte| *byte != 0)) {
        needles.push(("the configuration", chunk.to_vec()));
    }
    // A pose's position in the bytes of its numbers.
    for pose in bench.sent("sent.bin") {
        for target in pose.targets.iter().filter_map(|it| it.pose.ok()) {
            let [x, y, z] = target.translation_mm.map(f32::to_le_bytes);
            needles.push(("a pose", [x, y, z].concat()));
        }
    }
    assert!(needles.len() > 50, "{}", needles.len());
    for (what, needle) in needles {
        assert!(!all.windows(needle.len()).any(|it| it == needle), "{what} can be read");
    }
}

/// A program on the same network that has the key of another box, and one that has none: neither is
/// let in, and neither is told more than which key the box has.
#[test]
fn commands_with_another_key_are_not_taken() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 15);
    let mut host = bench.receive(0, "trial", "--quiet");
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 10);
    let Some(address) = relay.the_box() else { panic!("it has announced itself") };
    let peer = Peer::Udp(address);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
    let began = Instant::now();
    let now_ns = || 1_000_000_000 + began.elapsed().as_nanos() as u64;
    let caller = Caller { process: 3, name: "stranger".try_into().unwrap() };
    let mut stranger = HostEnd::new(Key::new([99; 32]).unwrap(), caller, Some(peer));
    let (mut sent, mut bytes_sent, mut bytes_come) = (0, 0, 0);
    let mut buffer = [0; SEALED_BYTES_MAX];
    let mut bytes = [0; 2048];
    while began.elapsed() < Duration::from_secs(2) {
        let greeted = greeting([sent as u8; 8], &mut [0; SEALED_BYTES_MAX]).to_vec();
        bytes_sent += socket.send_to(&greeted, address).unwrap();
        sent += 1;
        while let Some((_, packet)) = stranger.due(now_ns(), rand::random, &mut buffer) {
            bytes_sent += socket.send_to(packet, address).unwrap();
        }
        while let Ok((length, _)) = socket.recv_from(&mut bytes) {
            bytes_come += length;
            let told =
                stranger.receive(peer, &bytes[..length], now_ns(), rand::random, &mut buffer);
            assert!(matches!(told, Told::Nothing), "{told:?}");
            assert_eq!(bytes[..2], [PROTOCOL_VERSION, ANSWER]);
        }
    }
    assert!(stranger.start().is_none() && bytes_come > 0);
    assert!(bytes_come <= bytes_sent, "{bytes_come} bytes for {bytes_sent}");
    // A session with the stranger's own box, whose commands it sends to this one.
    for packet in commands_of_another_box() {
        relay.as_host(0, &packet);
    }
    bench.wait_for_poses("trial", 150);
    host.interrupt();
    host.succeeds();
    the_box.end();
    assert_whole(&bench, "trial", "sent.bin");
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.lost, packets.not_authentic, packets.sessions), (0, 0, 1));
}

/// Commands in a session with a box that has another key: the number of the session is the same.
pub fn commands_of_another_box() -> Vec<Vec<u8>> {
    let another = Key::new([99; 32]).unwrap();
    let caller = Caller { process: 4, name: "stranger".try_into().unwrap() };
    let [box_at, host_at] = [1, 2].map(|port| Peer::Udp(([127, 0, 0, 1], port).into()));
    let mut host = HostEnd::new(another.clone(), caller, Some(box_at));
    let mut of_box = BoxEnd::new(Some(another), Start::new(5).unwrap(), &[6; 32]);
    let (mut to_box, mut to_host) = ([0; SEALED_BYTES_MAX], [0; SEALED_BYTES_MAX]);
    while let Some((_, packet)) = host.due(1_000_000_000, rand::random, &mut to_box) {
        let mut packet = packet.to_vec();
        // Greeting and answer, opening and acceptance.
        loop {
            let heard = of_box.receive(host_at, &packet, 1_000_000_000, rand::random, &mut to_host);
            let Heard::Answer(answer) = heard else { break };
            assert!([ANSWER, ACCEPTANCE].contains(&answer[1]));
            let told = host.receive(box_at, answer, 1_000_000_000, rand::random, &mut to_box);
            let Told::Handshake(Some(next)) = told else { break };
            packet = next.to_vec();
        }
    }
    let actions =
        [Action::Reboot, Action::Aim { seconds: 9 }, Action::TakePicture { reduction: 2 }];
    let commands = (0..50).map(|index| {
        let action = actions[index % actions.len()];
        let command = Command { id: index as u16, action, is_forced: true };
        let sealed = host.seal(&Message::Command(command), &mut to_box).expect("a session");
        sealed.unwrap().1.to_vec()
    });
    commands.collect()
}

/// B5, B9: beside the box, one without a key announces itself here. It is said, and changes nothing.
#[test]
fn a_box_without_a_key_on_the_network_is_not_listened_to() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 16);
    let mut unpaired = BoxEnd::new(None, Start::new(3).unwrap(), &[3; 32]);
    let mut buffer = [0; SEALED_BYTES_MAX];
    unpaired.describe(plumbline::seal::BoxState::Unpaired, 255, "ward 3 (PL-0001) \u{1b}[2J");
    let announcement = unpaired.announcement(&mut buffer).to_vec();
    let mut host = bench.receive(0, "trial", "");
    relay.as_box(0, &announcement);
    let mut the_box = bench.start(&relay, "sent.bin");
    for count in 1..20 {
        relay.as_box(0, &announcement);
        bench.wait_for_poses("trial", 5 * count);
    }
    host.interrupt();
    let said = host.succeeds();
    the_box.end();
    assert!(!said.contains('\u{1b}'), "{said}");
    assert_whole(&bench, "trial", "sent.bin");
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.lost, packets.not_authentic, packets.sessions), (0, 0, 1));
}

/// B13: a program on this computer makes marks, and nothing else that comes is one: see [`elsewhere`].
///
/// [`elsewhere`]: crate::elsewhere
#[test]
fn a_mark_of_this_computer_is_taken() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 17);
    let marks = free_address();
    let mut host = bench.receive(0, "trial", &format!("--mark-udp {marks} --quiet"));
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 20);
    let ours = UdpSocket::bind("127.0.0.1:0").unwrap();
    ours.send_to(b"stands\n", marks).unwrap();
    bench.wait_for_poses("trial", 80);
    host.interrupt();
    host.succeeds();
    the_box.end();
    let [event] = &bench.manifest("trial").events[..] else { panic!("another number of marks") };
    assert_eq!((event.label.as_str(), &event.sender), ("stands", &None));
}
