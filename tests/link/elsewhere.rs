//! Strangers with addresses of their own, who lie between a box and its host: see [`network`].
//!
//! [`network`]: crate::network

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};

use plumbline::seal::{KEY_FILE_NAME, Key, Pairing, SEALED_BYTES_MAX};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::attacks::{
    assert_unreadable, commands_of_another_box, forged_announcements, pause, spoiled,
    strangers_packets,
};
use crate::bench::{Bench, assert_whole, wait_for};
use crate::network::{Datagram, Forger, HOST, Listener, Network, STRANGER, THE_BOX};
use crate::relay::{ANNOUNCEMENT, OPENING, is_kind};

fn v4(address: SocketAddr) -> SocketAddrV4 {
    let SocketAddr::V4(address) = address else { panic!("{address}") };
    address
}

/// B13: a mark of another computer counts only if that computer is named, and its name is then beside
/// the mark. Nobody on another computer passes for a program on this one.
#[test]
fn a_mark_of_another_computer_is_refused_and_counted_unless_it_is_named() {
    let Some(network) = Network::new() else { return };
    let none = network.host.enter(|| marks(&network, ""));
    let Some((none, said)) = none else { return };
    assert_eq!(none, [("here".to_owned(), None)]);
    let refused = "2 marks from other computers did not count; name them with --mark-from";
    assert!(said.contains(refused), "{said}");

    let more = format!("--mark-from treadmill={STRANGER}");
    let (named, said) = network.host.enter(|| marks(&network, &more)).unwrap();
    let by = |label: &str| (label.to_owned(), Some("treadmill".to_owned()));
    assert_eq!(named, [by("zero"), by("forged"), ("here".to_owned(), None)]);
    assert!(!said.contains("did not count"), "{said}");
}

/// Marks of a trial and their senders, in the order in which they came; and what the host said.
type Recorded = (Vec<(String, Option<String>)>, String);

/// Records a trial, and sends marks to it from elsewhere and from here.
fn marks(network: &Network, more: &str) -> Option<Recorded> {
    let bench = Bench::at(HOST)?;
    let port = UdpSocket::bind((HOST, 0)).unwrap().local_addr().unwrap().port();
    // At all addresses of the host: at one that is for this computer alone nobody else comes.
    let marks = format!("--mark-udp 0.0.0.0:{port} {more} --quiet");
    let mut host = bench.receive(0, "trial", &marks);
    let mut the_box = network.the_box.enter(|| bench.start_at(bench.hosts[0], "sent.bin"));
    bench.wait_for_poses("trial", 20);
    let to = SocketAddrV4::new(HOST, port);
    network.stranger.enter(|| {
        let own = UdpSocket::bind((STRANGER, 0)).unwrap();
        own.send_to(b"zero", to).unwrap();
        // A forged one from there comes through, so that those below would too.
        let forger = Forger::new();
        let forged = |from: Ipv4Addr, label: &[u8]| {
            let from = SocketAddrV4::new(from, 9);
            forger.send(&Datagram { from, to, bytes: label.to_vec() });
        };
        forged(STRANGER, b"forged");
        // The system itself refuses what claims to be of its own computer and comes by a cable.
        for source in [Ipv4Addr::LOCALHOST, HOST] {
            forged(source, b"of this computer");
        }
    });
    bench.wait_for_poses("trial", 80);
    let here = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    here.send_to(b"here", (Ipv4Addr::LOCALHOST, port)).unwrap();
    bench.wait_for_poses("trial", 110);
    host.interrupt();
    let said = host.succeeds();
    the_box.end();
    let events = bench.manifest("trial").events.into_iter();
    Some((events.map(|it| (it.label, it.sender)).collect(), said))
}

/// B1 to B4 and B6 to B8, by a computer that passes on every packet between the two: it reads none,
/// and whatever it sends under their addresses changes nothing.
#[test]
fn a_computer_between_box_and_host_reads_nothing_and_changes_nothing() {
    let Some(network) = Network::new() else { return };
    network.host.enter(|| between(&network));
}

fn between(network: &Network) {
    let Some(bench) = Bench::at(HOST) else { return };
    let listener = network.stranger.enter(Listener::new);
    let [config, key] = ["box.plb", KEY_FILE_NAME].map(|name| bench.read(name));
    let mut host = bench.receive(0, "trial", "--quiet");
    let mut the_box = network.the_box.enter(|| bench.start_at(bench.hosts[0], "sent.bin"));
    bench.wait_for_poses("trial", 60);
    wait_for("the configuration", || bench.path("trial/config.plb").exists());
    let of_box = |it: &Datagram| *it.from.ip() == THE_BOX && *it.to.ip() == HOST;
    let of_host = |it: &Datagram| *it.from.ip() == HOST && *it.to.ip() == THE_BOX;
    let seen = listener.seen();
    assert!(seen.iter().filter(|it| of_box(it)).count() >= 60, "it sees what the box sends");
    assert!(seen.iter().filter(|it| of_host(it)).count() >= 3, "it sees what the host sends");
    let first = seen.iter().find(|it| of_box(it) && is_kind(&it.bytes, ANNOUNCEMENT)).unwrap();
    let (to_box, to_host) = ((v4(bench.hosts[0]), first.from), (first.from, v4(bench.hosts[0])));

    let sent = network.stranger.enter(|| forge(&seen, to_box, to_host));
    let before = bench.recorded("trial").len();
    bench.wait_for_poses("trial", before + 60);
    host.interrupt();
    let said = host.succeeds();
    the_box.end();
    assert_whole(&bench, "trial", "sent.bin");
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.lost, packets.repeated, packets.sessions), (0, 0, 1), "{said}");
    let none = [packets.implausible, packets.other_box, packets.conflicting, packets.unknown_start];
    assert_eq!(none, [0; 4], "{said}");
    // Half of what was sent went to the host; announcements, which are in clear, are not counted.
    assert!(packets.not_authentic > sent as u64 / 4, "{packets:?} of {sent}");
    assert_eq!(bench.manifest("trial").the_box.unwrap().device, "ward 3");
    assert_eq!([bench.read("box.plb"), bench.read(KEY_FILE_NAME)], [config, key]);
    let all = listener.seen();
    let opened = |it: &&Datagram| of_host(it) && is_kind(&it.bytes, OPENING);
    let openings = all.iter().filter(opened).filter(|it| !seen.contains(it)).count();
    assert!(openings <= 1, "{openings}: the host begins again because of what it is sent");
    let bytes: Vec<u8> = all.into_iter().flat_map(|it| it.bytes).collect();
    assert_unreadable(&bench, &bytes);
}

/// Whoever sends a datagram, and whom it is for.
type Way = (SocketAddrV4, SocketAddrV4);

/// All that was seen, once more and changed, and what the stranger makes itself, under the addresses
/// of the two. Returns the number of datagrams.
fn forge(seen: &[Datagram], to_box: Way, to_host: Way) -> usize {
    let forger = Forger::new();
    let mut random = ChaCha8Rng::seed_from_u64(41);
    let mut count = 0;
    let mut send = |(from, to): Way, bytes: Vec<u8>| {
        pause(count);
        count += 1;
        forger.send(&Datagram { from, to, bytes });
    };
    for kind in 0..5 {
        for it in seen {
            send((it.from, it.to), spoiled(kind, &it.bytes, &mut random));
        }
    }
    for packet in commands_of_another_box() {
        send(to_box, packet);
    }
    let other = Key::new([99; 32]).unwrap();
    for _ in 0..10 {
        let mut buffer = [0; SEALED_BYTES_MAX];
        send(to_box, Pairing { key: other.clone() }.packet(&mut buffer).to_vec());
    }
    for packet in strangers_packets(&other).into_iter().chain(forged_announcements()) {
        send(to_host, packet);
    }
    count
}
