//! What only those get who have the box's key, however many they are and whatever others send.

use std::net::UdpSocket;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use plumbline::packet::{Action, Command, Message, Refusal, ReplyOutcome};
use plumbline::seal::{BoxState, Key, Peer};

use crate::common::{
    Board, Host, STREAM, assert_whole, config, folder, key, poses, recording, write_config,
};

/// A box whose camera the test plays, and the folder of its configuration.
struct Bench {
    board: Board,
    config: PathBuf,
    _folder: tempfile::TempDir,
}

fn bench(host: &Host) -> Bench {
    let folder = folder();
    let config = write_config(&folder, &config());
    let board = Board::start_fed(&config, &["--udp", &host.address(), "--supervised"]);
    Bench { board, config, _folder: folder }
}

/// A host that is not where the box announces itself, and listens as well.
fn another(known: &mut Host, name: &str) -> Host {
    let peer = known.find();
    let mut host = Host::udp_with(key(), name);
    host.knock(peer);
    host.join();
    host
}

fn refusal(outcome: ReplyOutcome) -> (Refusal, String) {
    match outcome {
        ReplyOutcome::Refused { refusal, reason } => (refusal, reason.as_str().into()),
        other => panic!("{other:?}"),
    }
}

#[test]
fn two_listen_at_once_and_each_gets_its_own_answers() {
    let mut one = Host::udp();
    let Bench { mut board, _folder, .. } = bench(&one);
    one.join();
    board.feed(5);
    one.turn_until("5 poses", |it| (poses(&it.stream()).len() == 5).then_some(()));
    let mut two = another(&mut one, "second");
    // All were told again who the box is, when the second one joined.
    one.wait_for(|message| matches!(message, Message::Hello(_)).then_some(()));
    board.feed(20);
    assert_eq!(two.ask(Action::SendView), ReplyOutcome::Accepted);
    board.feed(5);
    two.wait_for(|message| matches!(message, Message::View(_)).then_some(()));
    // Every other pose from here on; what is left out is not missed.
    one.turn_until("all poses", |it| (poses(&it.stream()).len() == 30).then_some(()));
    two.turn_until("25 poses", |it| (poses(&it.stream()).len() == 25).then_some(()));
    two.want_poses(2);
    board.feed(10);
    one.turn_until("10 more", |it| (poses(&it.stream()).len() == 40).then_some(()));
    two.want_poses(0);
    assert_eq!(poses(&two.stream()).len(), 30);
    board.feed(10);
    board.end_feed();
    let all = one.until_the_end();
    assert_whole(&all, 50);
    assert!(!one.heard.iter().any(|(_, it)| matches!(it, Message::Reply(_) | Message::View(_))));
    let seen = two.until_the_end();
    assert_eq!(poses(&seen).len(), 30);
    // One seal for both: the packets are the same.
    let stream = |host: &Host| -> Vec<Vec<u8>> {
        host.packets.iter().filter(|packet| packet[1] == STREAM).cloned().collect()
    };
    let of_one = stream(&one);
    assert!(stream(&two).iter().filter(|packet| of_one.contains(packet)).count() > 25);
    let Some(Message::Health(health)) = all.last() else { panic!("{:?}", all.last()) };
    // Neither a handshake nor a listener costs memory.
    assert_eq!((health.frames, health.heap_allocations), (50, Some(0)));
    assert!(board.wait().status.success());
}

#[test]
fn what_is_lost_on_the_way_comes_again_byte_by_byte() {
    let mut host = Host::udp();
    let Bench { mut board, _folder, .. } = bench(&host);
    host.join();
    let mut count = 0;
    // A third of the stream, and 40 packets in a row.
    host.lose = Box::new(move |packet| {
        count += usize::from(packet[1] == STREAM);
        packet[1] == STREAM && (count % 3 == 0 || (100..140).contains(&count))
    });
    board.feed(200);
    host.turn_for(Duration::from_millis(300));
    host.lose = Box::new(|_| false);
    host.turn_until("all poses", |it| (poses(&it.stream()).len() == 200).then_some(()));
    host.turn_until("the rest", |it| (!it.end().is_missing()).then_some(()));
    board.end_feed();
    assert_whole(&host.until_the_end(), 200);
    assert_eq!(host.end().lost(), 0);
    assert!(host.lost.len() > 80, "{}", host.lost.len());
    for lost in &host.lost {
        assert!(host.packets.contains(lost), "{lost:?} has not come again as it was");
    }
    assert!(board.wait().status.success());
}

#[test]
fn what_is_lost_at_the_end_comes_again_before_the_box_ends() {
    let mut host = Host::udp();
    let Bench { mut board, _folder, .. } = bench(&host);
    host.join();
    board.feed(20);
    host.turn_until("all poses", |it| (poses(&it.stream()).len() == 20).then_some(()));
    let began = Instant::now();
    host.lose = Box::new(move |_| began.elapsed() < Duration::from_millis(100));
    board.feed(10);
    board.end_feed();
    assert_whole(&host.until_the_end(), 30);
    host.turn_until("the rest", |it| (poses(&it.stream()).len() == 30).then_some(()));
    assert!(host.lost.len() > 10, "{}", host.lost.len());
    assert!(board.wait().status.success());
}

#[test]
fn what_is_older_than_the_ring_is_gone() {
    /// More than the ring keeps.
    const FRAMES: usize = 13_000;
    let mut host = Host::udp();
    let Bench { mut board, _folder, .. } = bench(&host);
    host.join();
    let first = host.heard.iter().find_map(|(counter, _)| *counter).unwrap();
    let mut stdin = board.child.stdin.take().unwrap();
    let feeder = std::thread::spawn(move || {
        let frames = &recording(100)[recording(0).len()..];
        for _ in 0..FRAMES / 100 {
            std::io::Write::write_all(&mut stdin, frames).unwrap();
        }
        stdin
    });
    while !feeder.is_finished() {
        host.turn();
    }
    let stdin = feeder.join().unwrap();
    let outcome = host.ask(Action::Resend { first, mask: 1 });
    let ReplyOutcome::Gone { first: kept } = outcome else { panic!("{outcome:?}") };
    assert!(kept > first && kept < FRAMES as u64, "{kept}");
    // What is kept is not answered in words.
    host.lose = Box::new(|packet| packet[1] == STREAM);
    host.lost.clear();
    let before = host.heard.len();
    host.send(&Message::Command(Command {
        id: 999,
        action: Action::Resend { first: kept + 200, mask: 0b101 },
        is_forced: false,
    }));
    host.turn_for(Duration::from_millis(200));
    let counters: Vec<&[u8]> = host.lost.iter().map(|packet| &packet[2..4]).collect();
    let expected = [kept + 200, kept + 202].map(|it| [it as u8 | 0x80, (it >> 7) as u8]);
    assert!(expected.iter().all(|it| counters.contains(&&it[..])), "{counters:?}");
    assert!(
        !host.heard[before..]
            .iter()
            .any(|(_, it)| { matches!(it, Message::Reply(reply) if reply.id == 999) })
    );
    drop(stdin);
    assert!(board.wait().status.success());
}

#[test]
fn nothing_that_changes_the_box_is_done_while_somebody_records() {
    let mut one = Host::udp_with(key(), "trial 7 on laptop");
    let Bench { board, _folder, .. } = bench(&one);
    one.join();
    let mut two = another(&mut one, "desk");
    assert_eq!(one.ask(Action::Record { on: true }), ReplyOutcome::Accepted);
    let changes = [
        Action::Reboot,
        Action::Aim { seconds: 1 },
        Action::TakePicture { reduction: 2 },
        Action::Expose { exposure_us: None, gain: None },
        Action::StoreConfig { bytes: 1, crc: 1 },
    ];
    for host in [&mut one, &mut two] {
        for action in changes {
            let (why, words) = refusal(host.ask(action));
            assert_eq!(why, Refusal::Recording, "{action:?}");
            assert!(words.contains("trial 7 on laptop records a trial"), "{words}");
        }
        assert_eq!(host.ask(Action::SendHealth), ReplyOutcome::Accepted);
    }
    assert_eq!(two.ask_with(Action::Aim { seconds: 1 }, true), ReplyOutcome::Accepted);
    assert_eq!(one.ask(Action::Record { on: false }), ReplyOutcome::Accepted);
    assert_eq!(two.ask(Action::Aim { seconds: 0 }), ReplyOutcome::Accepted);
    assert_eq!(one.ask(Action::Record { on: true }), ReplyOutcome::Accepted);
    assert_eq!(two.ask_with(Action::Reboot, true), ReplyOutcome::Accepted);
    assert!(board.wait().status.success());
}

#[test]
fn a_host_that_leaves_frees_its_place_and_the_box_at_once() {
    let mut one = Host::udp_with(key(), "trial 7 on laptop");
    let Bench { mut board, _folder, .. } = bench(&one);
    one.join();
    let mut two = another(&mut one, "desk");
    let mut others = [another(&mut two, "gateway"), another(&mut two, "report")];
    assert_eq!(one.ask(Action::Record { on: true }), ReplyOutcome::Accepted);
    let (why, _) = refusal(two.ask(Action::Aim { seconds: 1 }));
    assert_eq!(why, Refusal::Recording);
    // A fifth has no place before, and one at once afterwards.
    let peer = two.find();
    let mut fifth = Host::udp_with(key(), "fifth");
    fifth.knock(peer);
    fifth.turn_until("a refusal", |it| it.end().obstacle().map(|_| ()));
    let (first, sent) = one.leave();
    let mut fifth = another(&mut two, "fifth");
    assert_eq!(two.ask(Action::Aim { seconds: 1 }), ReplyOutcome::Accepted);
    // Whoever has recorded the goodbye cannot end another session with it.
    for packet in &sent {
        fifth.send_raw(packet, peer);
        first.send_to(packet, address(peer)).unwrap();
    }
    for host in [&mut two, &mut fifth].into_iter().chain(&mut others) {
        assert_eq!(host.ask(Action::SendHealth), ReplyOutcome::Accepted);
    }
    board.feed(10);
    board.end_feed();
    let all = two.until_the_end();
    assert_whole(&all, 10);
    let Some(Message::Health(health)) = all.last() else { panic!("{:?}", all.last()) };
    assert_eq!(health.heap_allocations, Some(0));
    let finished = board.wait();
    assert!(finished.status.success());
    assert!(finished.stderr.contains("has left"), "{}", finished.stderr);
}

fn address(peer: Peer) -> std::net::SocketAddr {
    let Peer::Udp(address) = peer else { panic!("a box on UDP") };
    address
}

#[test]
fn another_key_opens_nothing_and_changes_nothing() {
    let mut host = Host::udp();
    let Bench { mut board, config, _folder } = bench(&host);
    host.join();
    let peer = host.find();
    let before = std::fs::read(&config).unwrap();
    let mut stranger = Host::udp_with(Key::new([99; 32]).unwrap(), "stranger");
    let end = Instant::now() + Duration::from_secs(1);
    while Instant::now() < end {
        stranger.knock(peer);
        stranger.turn();
        host.turn();
    }
    assert!(stranger.heard.is_empty() && stranger.end().start().is_none());
    // It is told nothing but which key the box has.
    let (_, announcement) = stranger.announced.clone().expect("an answer to its greeting");
    assert_eq!((announcement.key_id, announcement.state), (Some(key().id()), BoxState::Ready));
    assert_eq!(announcement.text, "");
    // Whatever the host has sent is old when somebody sends it again, from anywhere.
    host.ask(Action::SendHealth);
    let packets = host.sent.clone();
    for packet in &packets {
        stranger.send_raw(packet, peer);
    }
    let health = host.health();
    let replies = |host: &Host| {
        host.heard.iter().filter(|(_, message)| matches!(message, Message::Reply(_))).count()
    };
    let count = replies(&host);
    for packet in packets {
        host.send_raw(&packet, peer);
    }
    assert_eq!(host.health().camera, health.camera);
    assert_eq!(replies(&host), count + 1);
    stranger.turn_for(Duration::from_millis(100));
    assert!(stranger.heard.is_empty());
    assert_eq!(std::fs::read(&config).unwrap(), before);
    board.feed(10);
    board.end_feed();
    assert_whole(&host.until_the_end(), 10);
    assert!(board.wait().status.success());
}

#[test]
fn thousands_of_datagrams_of_junk_cost_neither_a_pose_nor_a_command() {
    if plumbline_test_support::is_emulated() {
        let reason = "a program in an emulator sends no thousands of datagrams in a second";
        plumbline_test_support::skip(plumbline_test_support::Absent::Emulator, reason);
        return;
    }
    let mut host = Host::udp();
    let Bench { mut board, _folder, .. } = bench(&host);
    host.join();
    let address = address(host.find());
    let junk = std::thread::spawn(move || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut sent = 0;
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(1) {
            // Noise, and what looks like each kind of packet.
            for kind in 0..12 {
                let mut datagram = rand::random::<[u8; 300]>();
                if kind > 0 {
                    (datagram[0], datagram[1]) = (plumbline::packet::PROTOCOL_VERSION, kind);
                }
                let length = 20 + usize::from(datagram[7]);
                sent += usize::from(socket.send_to(&datagram[..length], address).is_ok());
            }
            std::thread::sleep(Duration::from_millis(3));
        }
        sent
    });
    let mut answers = 0;
    for _ in 0..20 {
        board.feed(5);
        let outcome = host.ask(Action::SendHealth);
        answers += usize::from(outcome == ReplyOutcome::Accepted);
        host.turn_for(Duration::from_millis(20));
    }
    let sent = junk.join().unwrap();
    assert!(sent >= 2_000, "{sent}");
    assert_eq!(answers, 20);
    board.end_feed();
    let all = host.until_the_end();
    assert_whole(&all, 100);
    let Some(Message::Health(health)) = all.last() else { panic!("{:?}", all.last()) };
    assert_eq!(health.heap_allocations, Some(0));
    assert!(board.wait().status.success());
}

#[test]
fn a_box_without_a_key_tracks_and_only_says_that_it_waits() {
    for (text, state, words) in [
        (None, BoxState::Unpaired, "bench (7) has no key"),
        (Some("PLUMBLINE-KEY-1:77"), BoxState::KeyUnreadable, "bench (7): its key cannot be used"),
    ] {
        let folder = folder();
        let config = write_config(&folder, &config());
        if let Some(text) = text {
            std::fs::write(folder.path().join("box.key"), text).unwrap();
        }
        let trial = folder.path().join("trial.y4m");
        std::fs::write(&trial, recording(100)).unwrap();
        let mut host = Host::udp();
        let address = host.address();
        let arguments = ["--replay", trial.to_str().unwrap(), "--udp", &address];
        let board = Board::start(&config, &arguments);
        let peer = host.find();
        let (_, announcement) = host.announced.clone().unwrap();
        assert_eq!((announcement.key_id, announcement.state), (None, state));
        assert!(announcement.text.contains(words), "{}", announcement.text);
        // No cable, no key over it.
        assert_eq!(announcement.pairing_s, 0);
        host.knock(peer);
        host.turn_for(Duration::from_millis(900));
        assert!(host.heard.is_empty() && host.end().start().is_none());
        assert!(host.packets.len() >= 3, "it is announced several times a second");
        let finished = board.wait();
        assert!(finished.stdout.contains("frames       100 "), "{}", finished.stdout);
        assert!(finished.stderr.contains("without a key the box only announces"));
    }
}
