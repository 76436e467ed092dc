//! The real program, and what arrives at the other end of its links.

use std::net::UdpSocket;
use std::time::Duration;

use crate::common::{
    Board, Host, assert_whole, config, folder, messages, poses, starts, write_config, write_key,
    write_recording,
};
use plumbline::packet::{Action, MarkedInstant, Message, ReplyOutcome};
use plumbline_test_support::serial_lines;
use serialport::{SerialPort, TTYPort};

#[test]
fn every_frame_becomes_a_packet_over_udp() {
    let folder = folder();
    let mut host = Host::udp();
    let config_file = write_config(&folder, &config());
    let mut board = Board::start_fed(&config_file, &["--udp", &host.address()]);
    host.join();
    board.feed(30);
    board.end_feed();
    let all = host.until_the_end();
    assert_whole(&all, 30);
    let hello = all.iter().find_map(|message| match message {
        Message::Hello(hello) => Some(hello),
        _ => None,
    });
    let hello = hello.unwrap();
    assert_eq!((hello.device.as_str(), hello.config_crc), ("bench", config().crc()));
    assert_eq!(hello.targets[0].corners, 30);
    assert_eq!(Some(hello.boot_id), host.end().start().map(|it| it.get()));
    let Some(Message::Health(health)) = all.last() else { panic!("{:?}", all.last()) };
    assert_eq!((health.frames, health.heap_allocations), (30, Some(0)));
    assert!(
        poses(&all).iter().all(|pose| {
            pose.instant == MarkedInstant::Recording && pose.latency_us < 1_000_000
        })
    );
    // It was logged before anybody listened.
    assert!(all.iter().any(|message| {
        matches!(message, Message::Log(log) if log.text.contains("replaying") && log.cut == 0)
    }));
    let finished = board.wait();
    assert!(finished.status.success(), "{}", finished.stderr);
    for part in ["frames       30 (0 late)", "0 dropped (udp 127.0.0.1", "allocations  0 after"] {
        assert!(finished.stdout.contains(part), "{}", finished.stdout);
    }
}

#[test]
fn the_same_packets_go_to_all_links_at_once() {
    if !serial_lines() {
        return;
    }
    let folder = folder();
    let mut by_udp = Host::udp();
    let (line, end) = TTYPort::pair().unwrap();
    let mut by_serial = Host::serial(line);
    let file = folder.path().join("packets.bin");
    let mut board = Board::start_fed(
        &write_config(&folder, &config()),
        &[
            "--udp",
            &by_udp.address(),
            "--serial",
            &end.name().unwrap(),
            "--baud",
            "230400",
            "--record",
            file.to_str().unwrap(),
        ],
    );
    by_udp.join();
    by_serial.join();
    // Slowly enough for a line of 4 KiB that is read all the time.
    for _ in 0..20 {
        board.feed(1);
        by_serial.turn();
        by_udp.turn();
    }
    board.end_feed();
    let over_serial = by_serial.until_the_end();
    let over_udp = by_udp.until_the_end();
    assert!(board.wait().status.success());
    let in_file = messages(&std::fs::read(&file).unwrap());
    assert_whole(&over_udp, 20);
    assert_eq!(poses(&over_udp), poses(&over_serial));
    assert_eq!(poses(&over_udp), poses(&in_file));
    assert!(matches!(in_file[0], Message::Hello(_)), "{:?}", in_file[0]);
    drop(end);
}

#[test]
fn a_file_is_appended_to() {
    let folder = folder();
    let (config, trial) = (write_config(&folder, &config()), write_recording(&folder, 5));
    let file = folder.path().join("packets.bin");
    let arguments =
        ["--replay", trial.to_str().unwrap(), "--unpaced", "--record", file.to_str().unwrap()];
    for runs in 1..=2 {
        assert!(Board::start(&config, &arguments).wait().status.success());
        let bytes = std::fs::read(&file).unwrap();
        assert_eq!(poses(&messages(&bytes)).len(), 5 * runs);
        assert_eq!(starts(&bytes).len(), runs, "each run is another start");
    }
}

#[test]
fn a_line_that_takes_nothing_costs_whole_packets_and_no_time() {
    if !serial_lines() {
        return;
    }
    let folder = folder();
    let (line, end) = TTYPort::pair().unwrap();
    let file = folder.path().join("packets.bin");
    // More packets than fit the kernel's buffers (64 KiB and some) and the link's
    // own, at 30 bytes or more each.
    const FRAMES: usize = 5000;
    let mut host = Host::serial(line.try_clone_native().unwrap());
    let mut board = Board::start_fed(
        &write_config(&folder, &config()),
        &["--serial", &end.name().unwrap(), "--record", file.to_str().unwrap()],
    );
    host.join();
    // From now on nobody reads the line until the program has ended.
    board.feed(FRAMES);
    board.end_feed();
    let finished = board.wait();
    assert!(finished.status.success(), "{}", finished.stderr);
    assert_whole(&messages(&std::fs::read(&file).unwrap()), FRAMES);
    let counts = finished.stdout.lines().find(|text| text.contains("(serial")).unwrap();
    let numbers: Vec<usize> =
        counts.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let (sent, dropped) = (numbers[0], numbers[1]);
    assert!(sent > 0 && dropped > 100, "{counts}");
    // All sent frames are intact; only the last may be cut short, because the line was
    // closed before its end.
    host.turn_for(Duration::from_millis(300));
    assert_eq!(host.packets.len() + host.lost.len(), sent);
    assert!(!poses(&host.stream()).is_empty());
    drop((line, end));
}

#[test]
fn a_host_that_is_not_there_is_no_fault() {
    let folder = folder();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = socket.local_addr().unwrap().to_string();
    drop(socket);
    let trial = write_recording(&folder, 50);
    let config = write_config(&folder, &config());
    write_key(&config);
    let arguments = ["--replay", trial.to_str().unwrap(), "--unpaced", "--udp", &address];
    let finished = Board::start(&config, &arguments).wait();
    assert!(finished.status.success(), "{}", finished.stderr);
    assert!(finished.stdout.contains("frames       50"), "{}", finished.stdout);
    // Nothing but what announces it was sent.
    let counts = finished.stdout.lines().find(|text| text.contains("(udp")).unwrap();
    let sent: usize = counts.split_whitespace().find_map(|word| word.parse().ok()).unwrap();
    assert!(sent < 10, "{counts}");
}

#[test]
fn a_network_that_cannot_be_reached_is_no_fault() {
    let folder = folder();
    let config = write_config(&folder, &config());
    write_key(&config);
    let trial = write_recording(&folder, 50);
    // An address for documents (RFC 5737), which nobody has; there may be a route.
    let arguments = ["--replay", trial.to_str().unwrap(), "--unpaced", "--udp", "192.0.2.1:4210"];
    let finished = Board::start(&config, &arguments).wait();
    assert!(finished.status.success(), "{}", finished.stderr);
    assert!(finished.stdout.contains("frames       50"), "{}", finished.stdout);
}

#[test]
fn the_heartbeat_goes_on_while_the_recording_is_silent_and_a_signal_ends_it() {
    for signal in ["TERM", "INT"] {
        let folder = folder();
        let mut host = Host::udp();
        let config = write_config(&folder, &config());
        let mut board = Board::start_fed(&config, &["--udp", &host.address()]);
        host.join();
        // Three frames, and then silence with the pipe still open.
        board.feed(3);
        for _ in 0..2 {
            host.wait_for(|message| matches!(message, Message::Hello(_)).then_some(()));
        }
        assert_eq!(poses(&host.stream()).len(), 3);
        board.signal(signal);
        host.until_the_end();
        let stdin = board.child.stdin.take();
        let finished = board.wait();
        assert!(finished.status.success(), "{signal}: {}", finished.stderr);
        assert!(finished.stdout.contains("frames       3"), "{}", finished.stdout);
        drop(stdin);
    }
}

#[test]
fn commands_are_answered() {
    let folder = folder();
    let mut host = Host::udp();
    let config_file = write_config(&folder, &config());
    let mut board = Board::start_fed(&config_file, &["--udp", &host.address()]);
    host.join();
    board.feed(1);
    let peer = host.end().peer().unwrap();
    host.send_raw(b"no packet", peer);
    let crc = config().crc();
    let bytes =
        config().encode(&mut vec![0; plumbline::config::BLOB_BYTES_MAX]).unwrap().len() as u32;
    assert_eq!(host.ask(Action::QueryConfig), ReplyOutcome::Config { crc, bytes, next_crc: crc });
    let pong = host.ask(Action::Ping { host_sent_ns: 77 });
    let ReplyOutcome::Pong { host_sent_ns: 77, stream_next, .. } = pong else { panic!("{pong:?}") };
    assert!(stream_next >= 3, "Hello, Health and a pose");
    assert_eq!(host.ask(Action::SendHello), ReplyOutcome::Accepted);
    assert!(matches!(host.ask(Action::Reboot), ReplyOutcome::Refused { .. }));
    board.end_feed();
    assert!(board.wait().status.success());
}
