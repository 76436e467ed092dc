//! The real program, and what arrives at the other end of its links.

use std::io::{Read, Write};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

use crate::common::{
    Board, PATIENCE, assert_whole, config, folder, messages, poses, recording, starts,
    write_config, write_recording,
};
use plumbline::packet::{
    Action, CameraState, Command, MarkedInstant, Message, PACKET_BYTES_MAX, ReplyOutcome,
    decode_datagram, encode_datagram,
};
use plumbline_test_support::serial_lines;
use serialport::{SerialPort, TTYPort};

fn receiver() -> (UdpSocket, String) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let address = socket.local_addr().unwrap().to_string();
    (socket, address)
}

fn receive(socket: &UdpSocket) -> (Message, std::net::SocketAddr) {
    let mut datagram = [0; PACKET_BYTES_MAX];
    let (length, from) = socket.recv_from(&mut datagram).expect("a packet in time");
    (decode_datagram(&datagram[..length]).expect("an intact packet").message, from)
}

fn is_last(message: &Message) -> bool {
    matches!(message, Message::Health(health) if health.camera == CameraState::Ended)
}

/// Everything up to the last Health.
fn receive_all(socket: &UdpSocket) -> Vec<Message> {
    let mut all = Vec::new();
    while !all.last().is_some_and(is_last) {
        all.push(receive(socket).0);
    }
    all
}

/// Everything up to the last Health.
fn read_all(line: &mut TTYPort) -> Vec<Message> {
    line.set_timeout(Duration::from_millis(100)).unwrap();
    let give_up = Instant::now() + PATIENCE;
    let (mut bytes, mut buffer) = (Vec::new(), [0; 4096]);
    loop {
        assert!(Instant::now() < give_up, "the last packet never came");
        if let Ok(count) = line.read(&mut buffer) {
            bytes.extend_from_slice(&buffer[..count]);
        }
        if bytes.last() == Some(&0) && messages(&bytes).last().is_some_and(is_last) {
            return messages(&bytes);
        }
    }
}

#[test]
fn every_frame_becomes_a_packet_over_udp() {
    let folder = folder();
    let (socket, address) = receiver();
    let recording = write_recording(&folder, 30);
    let board = Board::start(
        &write_config(&folder, &config()),
        &["--replay", recording.to_str().unwrap(), "--unpaced", "--udp", &address],
    );
    let all = receive_all(&socket);
    assert_whole(&all, 30);
    let Message::Hello(hello) = &all[0] else { panic!("{:?}", all[0]) };
    assert_eq!((hello.device.as_str(), hello.config_crc), ("bench", config().crc()));
    assert_eq!(hello.targets[0].corners, 30);
    let Some(Message::Health(health)) = all.last() else { panic!("{:?}", all.last()) };
    assert_eq!((health.frames, health.heap_allocations), (30, Some(0)));
    assert!(
        poses(&all).iter().all(|pose| {
            pose.instant == MarkedInstant::Recording && pose.latency_us < 1_000_000
        })
    );
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
    let (socket, address) = receiver();
    let (mut line, end) = TTYPort::pair().unwrap();
    let file = folder.path().join("packets.bin");
    let mut board = Board::start(
        &write_config(&folder, &config()),
        &[
            "--replay",
            "-",
            "--unpaced",
            "--udp",
            &address,
            "--serial",
            &end.name().unwrap(),
            "--baud",
            "230400",
            "--record",
            file.to_str().unwrap(),
        ],
    );
    let mut stdin = board.child.stdin.take().unwrap();
    let feeder = std::thread::spawn(move || {
        // Slowly enough for a line of 4 KiB that is read all the time.
        for chunk in recording(20).chunks(1 << 16) {
            stdin.write_all(chunk).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
    });
    let over_serial = read_all(&mut line);
    let over_udp = receive_all(&socket);
    feeder.join().unwrap();
    assert!(board.wait().status.success());
    let in_file = messages(&std::fs::read(&file).unwrap());
    assert_whole(&over_udp, 20);
    assert_eq!(poses(&over_udp), poses(&over_serial));
    assert_eq!(poses(&over_udp), poses(&in_file));
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
    let (mut line, end) = TTYPort::pair().unwrap();
    let file = folder.path().join("packets.bin");
    // More packets than fit the kernel's buffers (64 KiB and some) and the link's
    // own, at 30 bytes or more each.
    const FRAMES: usize = 5000;
    let trial = write_recording(&folder, FRAMES);
    let board = Board::start(
        &write_config(&folder, &config()),
        &[
            "--replay",
            trial.to_str().unwrap(),
            "--unpaced",
            "--serial",
            &end.name().unwrap(),
            "--record",
            file.to_str().unwrap(),
        ],
    );
    // Nobody reads the line until the program has ended.
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
    line.set_timeout(Duration::from_millis(200)).unwrap();
    let (mut bytes, mut buffer) = (Vec::new(), [0; 4096]);
    while let Ok(count @ 1..) = line.read(&mut buffer) {
        bytes.extend_from_slice(&buffer[..count]);
    }
    let whole = bytes.iter().rposition(|byte| *byte == 0).unwrap();
    assert_eq!(messages(&bytes[..=whole]).len(), sent);
    drop(end);
}

#[test]
fn a_host_that_is_not_there_is_no_fault() {
    let folder = folder();
    let (socket, address) = receiver();
    drop(socket);
    let trial = write_recording(&folder, 50);
    let board = Board::start(
        &write_config(&folder, &config()),
        &["--replay", trial.to_str().unwrap(), "--unpaced", "--udp", &address],
    );
    let finished = board.wait();
    assert!(finished.status.success(), "{}", finished.stderr);
    assert!(finished.stdout.contains("frames       50"), "{}", finished.stdout);
    let counts = finished.stdout.lines().find(|text| text.contains("(udp")).unwrap();
    assert!(!counts.contains(" 0 dropped"), "{counts}");
}

#[test]
fn the_heartbeat_goes_on_while_the_recording_is_silent_and_a_signal_ends_it() {
    for signal in ["TERM", "INT"] {
        let folder = folder();
        let (socket, address) = receiver();
        let mut board = Board::start(
            &write_config(&folder, &config()),
            &["--replay", "-", "--unpaced", "--udp", &address],
        );
        let mut stdin = board.child.stdin.take().unwrap();
        // Three frames, and then silence with the pipe still open.
        stdin.write_all(&recording(3)).unwrap();
        let (mut hellos, mut all) = (0, Vec::new());
        while hellos < 2 {
            let (message, _) = receive(&socket);
            hellos += usize::from(matches!(message, Message::Hello(_)));
            all.push(message);
        }
        assert_eq!(poses(&all).len(), 3);
        board.signal(signal);
        all.extend(receive_all(&socket));
        let finished = board.wait();
        assert!(finished.status.success(), "{signal}: {}", finished.stderr);
        assert!(finished.stdout.contains("frames       3"), "{}", finished.stdout);
        drop(stdin);
    }
}

#[test]
fn commands_are_answered_on_the_link_they_came_on() {
    let folder = folder();
    let (socket, address) = receiver();
    let mut board = Board::start(
        &write_config(&folder, &config()),
        &["--replay", "-", "--unpaced", "--udp", &address],
    );
    let mut stdin = board.child.stdin.take().unwrap();
    stdin.write_all(&recording(1)).unwrap();
    let (_, box_address) = receive(&socket);
    let mut buffer = [0; PACKET_BYTES_MAX];
    let mut reply_to = |id, action| {
        let command = Message::Command(Command { id, action });
        let datagram = encode_datagram(None, &command, &mut buffer).unwrap();
        socket.send_to(datagram, box_address).unwrap();
        loop {
            if let (Message::Reply(reply), _) = receive(&socket) {
                assert_eq!(reply.id, id);
                return reply.outcome;
            }
        }
    };
    socket.send_to(b"no packet", box_address).unwrap();
    let crc = config().crc();
    let bytes =
        config().encode(&mut vec![0; plumbline::config::BLOB_BYTES_MAX]).unwrap().len() as u32;
    assert_eq!(
        reply_to(1, Action::QueryConfig),
        ReplyOutcome::Config { crc, bytes, next_crc: crc }
    );
    assert!(matches!(
        reply_to(2, Action::Ping { host_sent_ns: 77 }),
        ReplyOutcome::Pong { host_sent_ns: 77, .. }
    ));
    assert_eq!(reply_to(3, Action::SendHello), ReplyOutcome::Accepted);
    assert!(matches!(reply_to(4, Action::Reboot), ReplyOutcome::Refused { .. }));
    drop(stdin);
    assert!(board.wait().status.success());
}
