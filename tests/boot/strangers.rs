//! A box that refuses its configuration and has a key: it takes another configuration from hosts with
//! that key, and from nobody else on its network.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use plumbline::packet::{Action, LinkKind, Log, Message, PROTOCOL_VERSION};
use plumbline::seal::{
    Announcement, BoxState, Caller, HostEnd, KEY_FILE_NAME, Key, Pairing, Peer, SEALED_BYTES_MAX,
    Told,
};
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;
use plumbline_stream::transport::{Arrived, Carrier, Link, Udp};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::machine::{HOST, Host, Machine, PATIENCE};
use crate::provisioning::{known_box, two_of};
use crate::scene::{self, file_on, files_on};

/// The kind of an answer to a greeting: all that a stranger gets.
const ANSWER: u8 = 3;

/// Changed packets of each kind. The guest takes some milliseconds for each of the others.
const CHANGED: usize = 200;

/// What passes between a host and the box, for somebody who listens.
#[derive(Default)]
struct Heard {
    to_box: Vec<Vec<u8>>,
    of_box: Vec<Vec<u8>>,
    the_box: Option<SocketAddr>,
}

struct Tapped {
    udp: Udp,
    heard: Arc<Mutex<Heard>>,
}

impl Carrier for Tapped {
    fn poll(&mut self, wait: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput> {
        let heard = &self.heard;
        self.udp.poll(wait, &mut |arrived| {
            if let Arrived::Packet { from: Peer::Udp(from), bytes } = &arrived {
                let mut heard = heard.lock().expect("nobody panics with it");
                heard.the_box = Some(*from);
                heard.of_box.push(bytes.to_vec());
            }
            take(arrived);
        })
    }

    fn send(&mut self, to: Peer, packet: &[u8]) {
        self.heard.lock().expect("nobody panics with it").to_box.push(packet.to_vec());
        self.udp.send(to, packet);
    }

    fn only_peer(&self) -> Option<Peer> {
        None
    }

    fn dropped_here(&self) -> Option<u64> {
        None
    }
}

/// A box that refuses what is on this disk, and its host.
struct Bench {
    _machine: Machine,
    _host: Host,
    link: BoxLink,
    heard: Arc<Mutex<Heard>>,
}

impl Bench {
    fn boot(disk: &Path) -> Self {
        let udp = Udp::bind((Ipv4Addr::LOCALHOST, 0).into()).expect("a free port");
        let port = udp.local_address().expect("it is bound").port();
        let heard = Arc::<Mutex<Heard>>::default();
        let tapped = Tapped { udp, heard: Arc::clone(&heard) };
        let link = Link::new(tapped, vec![known_box()], "boot test");
        let mut link = BoxLink::new(Box::new(link), "the box".to_owned(), LinkKind::Udp);
        let host = Host::new();
        let options = format!("plumbline.udp={}", SocketAddr::from((HOST, port)));
        let machine = crate::boot_with_camera(&host, disk, &options);
        assert_refusing(&mut link);
        Self { _machine: machine, _host: host, link, heard }
    }

    fn announcements(&self) -> Vec<Announcement> {
        let heard = self.heard.lock().expect("nobody panics with it");
        heard.of_box.iter().filter_map(|packet| Announcement::parse(packet)).collect()
    }
}

/// The box says once more that it refuses its configuration.
fn assert_refusing(link: &mut BoxLink) {
    let said = link.messages(Instant::now() + PATIENCE, |message| match message {
        Message::Log(Log { text, .. }) => text.contains("configuration refused").then_some(()),
        other => panic!("a box that refuses its configuration says {other:?}"),
    });
    assert_eq!(said.expect("the link works"), Some(()), "it says nothing");
}

/// A stranger's socket, with what it sends and what comes back.
struct Stranger {
    socket: UdpSocket,
    the_box: SocketAddr,
    sent: usize,
    bytes_sent: usize,
    bytes_come: usize,
}

impl Stranger {
    fn send(&mut self, packet: &[u8]) {
        self.bytes_sent += self.socket.send_to(packet, self.the_box).expect("it is sent");
        self.sent += 1;
        if self.sent.is_multiple_of(20) {
            self.listen();
        }
    }

    fn listen(&mut self) -> Vec<Vec<u8>> {
        let mut packets = Vec::new();
        let mut bytes = [0; 2048];
        while let Ok((length, _)) = self.socket.recv_from(&mut bytes) {
            assert_eq!(bytes[..2], [PROTOCOL_VERSION, ANSWER], "more than an answer");
            self.bytes_come += length;
            packets.push(bytes[..length].to_vec());
        }
        packets
    }

    /// Tries to open a session with another key than the box's, for this time.
    fn knock(&mut self, time: Duration) {
        let peer = Peer::Udp(self.the_box);
        let caller = Caller { process: 3, name: "stranger".try_into().expect("a short name") };
        let key = Key::new([99; 32]).expect("a key");
        let mut end = HostEnd::new(key, caller, Some(peer));
        let mut buffer = [0; SEALED_BYTES_MAX];
        let began = Instant::now();
        while began.elapsed() < time {
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

/// B5: packets of an earlier start of the box, in which it got a configuration and was restarted, as
/// they were and changed; sessions with another key; and keys.
#[test]
fn a_refused_box_takes_nothing_from_strangers() {
    let directory = tempfile::tempdir().unwrap();
    let [refused, stored] = two_of(&scene::config((HOST, 4210).into()));
    let mut damaged = scene::blob(&refused);
    damaged[30] ^= 1;

    // What a stranger has recorded, of the same box.
    let disk = scene::boot_disk(directory.path(), &damaged);
    let mut before = Bench::boot(&disk);
    before.link.store_config(None, &stored).unwrap();
    before.link.request(Action::Reboot, "to restart").unwrap();
    let recorded = std::mem::take(&mut before.heard.lock().unwrap().to_box);
    drop(before);
    assert!(recorded.len() > 8, "{} packets", recorded.len());

    let disk = scene::boot_disk(directory.path(), &damaged);
    let name = disk.to_str().expect("a plain path").to_owned();
    let files = files_on(&name);
    let mut bench = Bench::boot(&disk);
    let the_box = bench.heard.lock().unwrap().the_box.expect("it was heard");
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut stranger = Stranger { socket, the_box, sent: 0, bytes_sent: 0, bytes_come: 0 };
    stranger.knock(Duration::from_secs(5));
    let other = Pairing { key: Key::new([99; 32]).unwrap() };
    stranger.send(other.packet(&mut [0; SEALED_BYTES_MAX]));
    for _ in 0..3 {
        recorded.iter().for_each(|packet| stranger.send(packet));
    }
    // Of this start as well.
    let of_this_start = bench.heard.lock().unwrap().to_box.clone();
    let mut random = ChaCha8Rng::seed_from_u64(61);
    for packets in [&recorded, &of_this_start] {
        for _ in 0..CHANGED {
            let mut packet = packets[random.random_range(0..packets.len())].clone();
            let bit = random.random_range(0..8 * packet.len());
            packet[bit / 8] ^= 1 << (bit % 8);
            stranger.send(&packet);
        }
    }
    // It is where it was, in the same start, and says the same of itself.
    assert_refusing(&mut bench.link);
    assert_refusing(&mut bench.link);
    stranger.listen();
    let Stranger { sent, bytes_sent, bytes_come, .. } = stranger;
    println!("{sent} packets, {bytes_sent} bytes; {bytes_come} bytes came back");
    assert!(bytes_come > 0 && bytes_come <= bytes_sent, "{bytes_come} bytes for {bytes_sent}");
    let announcements = bench.announcements();
    let first = announcements.first().expect("it announces itself");
    assert_eq!((first.state, first.key_id), (BoxState::Refusing, Some(scene::key().id())));
    assert!(announcements.iter().all(|it| it == first), "{announcements:?}");
    drop(bench);
    assert_eq!(files_on(&name), files);
    assert_eq!(file_on(&name, "config.plb"), Some(damaged));
    assert_eq!(file_on(&name, KEY_FILE_NAME), Some(scene::key_file(&scene::key())));
}
