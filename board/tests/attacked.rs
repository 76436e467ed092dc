//! A box without a usable key, which anybody on its network may try to command, give a configuration
//! or give a key.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, Command, Document, Message, PART_BYTES_MAX, PROTOCOL_VERSION, Part, ReplyOutcome,
};
use plumbline::seal::{
    Announcement, BoxEnd, BoxState, Caller, Heard, HostEnd, Key, Paired, Pairing, Peer,
    SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX, Told, greeting,
};
use plumbline_test_support::is_emulated;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serialport::{SerialPort, TTYPort};

use crate::common::{
    Board, Host, config, config_with_camera, folder, key, recording, write_config, write_key,
};

/// The kind of an answer to a greeting: all that such a box ever answers.
const ANSWER: u8 = 3;

/// An attacker pauses after this many packets, so that the box's program refuses them, and not its
/// socket's buffer.
const AT_ONCE: usize = 50;

/// Forged packets of each kind: a hundredth in an emulator, where each takes a hundred times as long.
fn packets_of_a_kind() -> usize {
    if is_emulated() { 20 } else { 2_000 }
}

/// A program on the box's network that counts what it sends and what comes back.
struct Attacker {
    socket: UdpSocket,
    the_box: SocketAddr,
    sent: usize,
    bytes_sent: usize,
    bytes_come: usize,
    /// The longest packet that has come.
    longest: usize,
}

impl Attacker {
    fn new(the_box: SocketAddr) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
        Self { socket, the_box, sent: 0, bytes_sent: 0, bytes_come: 0, longest: 0 }
    }

    fn send(&mut self, packet: &[u8]) {
        self.sent += 1;
        self.bytes_sent += self.socket.send_to(packet, self.the_box).unwrap();
        if self.sent.is_multiple_of(AT_ONCE) {
            self.listen();
        }
    }

    /// Takes what has come: answers to greetings, and nothing else.
    fn listen(&mut self) -> Vec<Vec<u8>> {
        let mut packets = Vec::new();
        let mut bytes = [0; 2048];
        while let Ok((length, _)) = self.socket.recv_from(&mut bytes) {
            let packet = &bytes[..length];
            assert_eq!(packet[..2], [PROTOCOL_VERSION, ANSWER], "{packet:?}");
            self.bytes_come += length;
            self.longest = self.longest.max(length);
            packets.push(packet.to_vec());
        }
        packets
    }

    /// Tries to open a session with this key.
    fn knock(&mut self, key: Key) {
        let peer = Peer::Udp(self.the_box);
        let caller = Caller { process: 3, name: "stranger".try_into().unwrap() };
        let mut end = HostEnd::new(key, caller, Some(peer));
        let began = Instant::now();
        let mut buffer = [0; SEALED_BYTES_MAX];
        while began.elapsed() < Duration::from_secs(1) {
            let now_ns = 1_000_000_000 + began.elapsed().as_nanos() as u64;
            while let Some((_, packet)) = end.due(now_ns, rand::random, &mut buffer) {
                let packet = packet.to_vec();
                self.send(&packet);
            }
            for packet in self.listen() {
                let told = end.receive(peer, &packet, now_ns, rand::random, &mut buffer);
                assert!(matches!(told, Told::Nothing), "{told:?}");
            }
        }
        assert!(end.start().is_none(), "a session");
    }
}

/// All packets of a host in an earlier start of the same box, which then had a key: commands, and a
/// configuration that was stored.
fn recorded_session(config_file: &Path) -> Vec<Vec<u8>> {
    write_key(config_file);
    let mut host = Host::udp();
    let address = host.address();
    let trial = config_file.with_file_name("trial.y4m");
    std::fs::write(&trial, recording(1000)).unwrap();
    let arguments = ["--replay", trial.to_str().unwrap(), "--udp", &address, "--supervised"];
    let board = Board::start(config_file, &arguments);
    host.join();
    let (blob, crc) = another();
    for part in parts(&blob) {
        host.send(&part);
    }
    let stored = host.ask(Action::StoreConfig { bytes: blob.len() as u32, crc });
    assert_eq!(stored, ReplyOutcome::Stored { crc });
    assert_eq!(host.ask(Action::Aim { seconds: 60 }), ReplyOutcome::Accepted);
    assert_eq!(host.ask(Action::TakePicture { reduction: 2 }), ReplyOutcome::Accepted);
    assert_eq!(host.ask(Action::Reboot), ReplyOutcome::Accepted);
    assert!(board.wait().status.success());
    host.sent
}

/// Another configuration that a box can run with, and its checksum.
fn another() -> (Vec<u8>, u32) {
    let mut config = config_with_camera();
    config.device = "the attacker's".try_into().unwrap();
    let mut buffer = vec![0; plumbline::config::BLOB_BYTES_MAX];
    (config.encode(&mut buffer).unwrap().to_vec(), config.crc())
}

fn parts(blob: &[u8]) -> impl Iterator<Item = Message> + '_ {
    blob.chunks(PART_BYTES_MAX).enumerate().map(|(index, bytes)| {
        let offset = (index * PART_BYTES_MAX) as u32;
        let bytes = bytes.try_into().unwrap();
        Message::Part(Part { document: Document::Config, offset, bytes })
    })
}

/// A configuration and commands, sealed in a session with a box that has another key.
fn commands_with_another_key() -> Vec<Vec<u8>> {
    let another_key = Key::new([99; 32]).unwrap();
    let caller = Caller { process: 4, name: "stranger".try_into().unwrap() };
    let [box_at, host_at] = [1, 2].map(|port| Peer::Udp(([127, 0, 0, 1], port).into()));
    let mut host = HostEnd::new(another_key.clone(), caller, Some(box_at));
    let start = plumbline::packet::Start::new(5).unwrap();
    let mut of_box = BoxEnd::new(Some(another_key), start, &[6; 32]);
    let (mut to_box, mut to_host) = ([0; SEALED_BYTES_MAX], [0; SEALED_BYTES_MAX]);
    let mut packets = Vec::new();
    while let Some((_, packet)) = host.due(1_000_000_000, rand::random, &mut to_box) {
        let mut packet = packet.to_vec();
        loop {
            packets.push(packet.clone());
            let heard = of_box.receive(host_at, &packet, 1_000_000_000, rand::random, &mut to_host);
            let Heard::Answer(answer) = heard else { break };
            let told = host.receive(box_at, answer, 1_000_000_000, rand::random, &mut to_box);
            let Told::Handshake(Some(next)) = told else { break };
            packet = next.to_vec();
        }
    }
    let (blob, crc) = another();
    let store = Action::StoreConfig { bytes: blob.len() as u32, crc };
    let actions = [store, Action::TakePicture { reduction: 1 }, Action::Reboot];
    let commands = actions
        .map(|action| Message::Command(Command { id: action_id(action), action, is_forced: true }));
    for message in parts(&blob).chain(commands) {
        let sealed = host.seal(&message, &mut to_box).expect("a session");
        packets.push(sealed.unwrap().1.to_vec());
    }
    packets
}

/// Commands have different numbers.
fn action_id(action: Action) -> u16 {
    match action {
        Action::StoreConfig { .. } => 1,
        Action::Reboot => 2,
        _ => 3,
    }
}

/// The files beside a configuration: names and contents.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            (name, std::fs::read(entry.path()).unwrap())
        })
        .collect();
    files.sort();
    files
}

/// Every way in which such a box was once commanded, or could be.
fn attack(attacker: &mut Attacker, recorded: &[Vec<u8>]) {
    // The key that the box had, and another.
    attacker.knock(key());
    attacker.knock(Key::new([99; 32]).unwrap());
    let sealed = commands_with_another_key();
    for packet in recorded.iter().chain(&sealed) {
        attacker.send(packet);
    }
    // Keys, and answers to keys, which belong on a cable.
    let mut buffer = [0; SEALED_BYTES_MAX];
    for byte in 1..=20 {
        let key = Key::new([byte; 32]).unwrap();
        attacker.send(Pairing { key: key.clone() }.packet(&mut buffer));
        attacker.send(Paired { key_id: key.id(), is_stored: true }.packet(&mut buffer));
        // As a frame of a serial line.
        let packet = Pairing { key }.packet(&mut buffer).to_vec();
        let mut frame = [0; SEALED_FRAME_BYTES_MAX];
        attacker.send(plumbline::packet::frame_packet(&packet, &mut frame).unwrap());
    }
    let mut random = ChaCha8Rng::seed_from_u64(51);
    let known: Vec<&Vec<u8>> = recorded.iter().chain(&sealed).collect();
    for kind in 0..4 {
        for index in 0..packets_of_a_kind() {
            let mut packet = known[random.random_range(0..known.len())].clone();
            match kind {
                0 => packet = greeting(random.random(), &mut buffer).to_vec(),
                1 => {
                    let bit = random.random_range(0..8 * packet.len());
                    packet[bit / 8] ^= 1 << (bit % 8);
                }
                2 => packet.truncate(random.random_range(0..packet.len())),
                // Noise behind each head that there is.
                _ => {
                    packet[1] = (index % 12) as u8;
                    random.fill(&mut packet[2..]);
                }
            }
            attacker.send(&packet);
        }
    }
    attacker.listen();
}

/// The box has a serial line, over which it would take a key at any time.
#[test]
fn a_box_without_a_usable_key_takes_nothing_over_the_network() {
    for (text, state) in
        [(None, BoxState::Unpaired), (Some("PLUMBLINE-KEY-1:77"), BoxState::KeyUnreadable)]
    {
        let folder = folder();
        let config_file = write_config(&folder, &config());
        let before = std::fs::read(&config_file).unwrap();
        let recorded = recorded_session(&config_file);
        std::fs::write(&config_file, before).unwrap();
        let key_file = folder.path().join("box.key");
        match text {
            Some(text) => std::fs::write(&key_file, text).unwrap(),
            None => std::fs::remove_file(&key_file).unwrap(),
        }
        let before = files(folder.path());

        let line = (!is_emulated()).then(|| TTYPort::pair().unwrap());
        let device = line.as_ref().map(|(_, end)| end.name().unwrap());
        let mut host = Host::udp();
        let address = host.address();
        let mut arguments = vec!["--replay", "-", "--unpaced", "--udp", &address, "--supervised"];
        arguments.extend(device.iter().flat_map(|device| ["--serial", device]));
        let mut board = Board::start(&config_file, &arguments);
        std::io::Write::write_all(board.child.stdin.as_mut().unwrap(), &recording(0)).unwrap();
        let Peer::Udp(the_box) = host.find() else { panic!("a box on UDP") };
        let (_, announced) = host.announced.clone().unwrap();
        let takes_key = if line.is_some() { 255 } else { 0 };
        assert_eq!((announced.key_id, announced.state), (None, state));
        assert_eq!(announced.pairing_s, takes_key);

        let mut attacker = Attacker::new(the_box);
        attack(&mut attacker, &recorded);
        // It is there as before, with what it has said from the beginning, and tracks.
        board.feed(50);
        host.packets.clear();
        host.turn_until("announcements", |it| (it.packets.len() >= 4).then_some(()));
        let same = |packet: &Vec<u8>| Announcement::parse(packet).as_ref() == Some(&announced);
        assert!(host.packets.iter().all(same), "{:?}", host.announced);
        assert!(host.heard.is_empty());
        attacker.listen();
        assert!(attacker.bytes_come > 0, "greetings are answered");
        let Attacker { sent, bytes_sent, bytes_come, longest, .. } = attacker;
        println!("{sent} packets, {bytes_sent} bytes; {bytes_come} bytes came back");
        let greeting = greeting([1; 8], &mut [0; SEALED_BYTES_MAX]).len();
        assert!(longest <= greeting, "{longest} bytes for {greeting}");
        assert!(bytes_come <= bytes_sent, "{bytes_come} bytes for {bytes_sent}");
        assert_eq!(files(folder.path()), before);
        board.end_feed();
        let finished = board.wait();
        assert!(finished.status.success(), "{}", finished.stderr);
        assert!(finished.stdout.contains("frames       50 "), "{}", finished.stdout);
        assert!(!finished.stderr.contains("has come over the serial line"), "{}", finished.stderr);
    }
}
