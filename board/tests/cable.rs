//! What comes over a serial line besides: a key, and a stream on a line without a way back.

use std::io::{Read, Write};
use std::time::{Duration, Instant};

use plumbline::config::{Config, SerialLink};
use plumbline::packet::{Deframer, Message, frame_packet};
use plumbline::seal::{
    Announcement, BoxState, Key, OneWay, Paired, Pairing, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX,
    StreamOpener,
};
use plumbline_test_support::serial_lines;
use serialport::{SerialPort, TTYPort};

use crate::common::{
    Board, Host, PATIENCE, STREAM, assert_whole, config, folder, key, poses, recording,
    write_config, write_key,
};

/// The other end of a box's line, without a session.
struct Cable {
    line: TTYPort,
    deframer: Deframer<SEALED_FRAME_BYTES_MAX>,
    packets: Vec<Vec<u8>>,
}

impl Cable {
    fn new(mut line: TTYPort) -> Self {
        line.set_timeout(Duration::from_millis(5)).unwrap();
        Self { line, deframer: Deframer::new(), packets: Vec::new() }
    }

    fn read(&mut self) {
        let mut bytes = [0; 2048];
        let length = self.line.read(&mut bytes).unwrap_or(0);
        for byte in &bytes[..length] {
            if let Some(Ok(packet)) = self.deframer.frame(*byte) {
                self.packets.push(packet.to_vec());
            }
        }
    }

    fn wait_for<T>(&mut self, find: impl Fn(&[u8]) -> Option<T>) -> T {
        let give_up = Instant::now() + PATIENCE;
        loop {
            if let Some(found) = self.packets.iter().rev().find_map(|it| find(it)) {
                return found;
            }
            assert!(Instant::now() < give_up, "it never came");
            self.read();
        }
    }

    fn send(&mut self, packet: &[u8]) {
        let mut frame = [0; SEALED_FRAME_BYTES_MAX];
        self.line.write_all(frame_packet(packet, &mut frame).unwrap()).unwrap();
    }
}

#[test]
fn a_box_takes_its_key_over_the_cable() {
    if serial_lines() {
        takes_its_key(None, BoxState::Unpaired);
        takes_its_key(Some("PLUMBLINE-KEY-1:damaged"), BoxState::KeyUnreadable);
    }
}

/// A box with this in the place of its key, which is then in this state.
fn takes_its_key(before: Option<&str>, state: BoxState) {
    let folder = folder();
    let config_file = write_config(&folder, &config());
    if let Some(before) = before {
        std::fs::write(folder.path().join("box.key"), before).unwrap();
    }
    let (line, end) = TTYPort::pair().unwrap();
    let trial = folder.path().join("trial.y4m");
    std::fs::write(&trial, recording(1000)).unwrap();
    let device = end.name().unwrap();
    let arguments = ["--replay", trial.to_str().unwrap(), "--serial", &device];
    let board = Board::start(&config_file, &arguments);
    let mut cable = Cable::new(line);
    let announcement = cable.wait_for(Announcement::parse);
    assert_eq!((announcement.state, announcement.pairing_s), (state, 255));
    assert!(announcement.text.contains("bench (7)"), "{}", announcement.text);

    // A damaged key is no key.
    let mut buffer = [0; SEALED_BYTES_MAX];
    let pairing = Pairing { key: key() };
    let mut damaged = pairing.packet(&mut buffer).to_vec();
    damaged[9] ^= 1;
    cable.send(&damaged);
    let packet = pairing.packet(&mut buffer).to_vec();
    cable.send(&packet);
    let paired = cable.wait_for(Paired::read);
    assert_eq!(paired, Paired { key_id: key().id(), is_stored: true });
    let stored = std::fs::read_to_string(folder.path().join("box.key")).unwrap();
    assert_eq!(stored.trim(), key().text().as_str());
    // The answer was lost: it is given once more.
    cable.packets.clear();
    cable.send(&packet);
    assert_eq!(cable.wait_for(Paired::read), paired);
    let announcement = cable.wait_for(Announcement::parse);
    assert_eq!((announcement.key_id, announcement.state), (Some(key().id()), BoxState::Ready));
    assert_eq!((announcement.text.as_str(), announcement.pairing_s), ("", 0));
    // From now on it takes no other.
    let other = Key::new([99; 32]).unwrap();
    cable.send(Pairing { key: other }.packet(&mut buffer));
    cable.packets.clear();
    cable.send(&packet);
    assert_eq!(cable.wait_for(Paired::read), paired);
    assert!(cable.packets.iter().filter_map(|it| Paired::read(it)).all(|it| it == paired));
    let stored = std::fs::read_to_string(folder.path().join("box.key")).unwrap();
    assert_eq!(stored.trim(), key().text().as_str());
    // No pose has been sent in clear, nor at all.
    assert!(
        cable
            .packets
            .iter()
            .all(|it| Announcement::parse(it).is_some() || Paired::read(it).is_some())
    );

    let mut host = Host::serial(cable.line);
    host.join();
    host.turn_until("poses", |it| (poses(&it.stream()).len() > 10).then_some(()));
    board.signal("TERM");
    assert!(host.until_the_end().iter().any(|message| {
        matches!(message, Message::Log(log) if log.text.contains(&key().id().to_string()))
    }));
    let finished = board.wait();
    assert!(finished.stderr.contains("has come over the serial line"), "{}", finished.stderr);
    assert!(!finished.stderr.contains(&key().text().as_str()[20..40]), "{}", finished.stderr);
    drop(end);
}

#[test]
fn a_box_with_a_key_takes_no_other_over_the_cable() {
    if !serial_lines() {
        return;
    }
    let folder = folder();
    let config_file = write_config(&folder, &config());
    let (line, end) = TTYPort::pair().unwrap();
    let mut board = Board::start_fed(&config_file, &["--serial", &end.name().unwrap()]);
    let mut cable = Cable::new(line);
    let announcement = cable.wait_for(Announcement::parse);
    assert_eq!((announcement.key_id, announcement.pairing_s), (Some(key().id()), 0));
    let other = Key::new([99; 32]).unwrap();
    let packet = Pairing { key: other }.packet(&mut [0; SEALED_BYTES_MAX]).to_vec();
    cable.send(&packet);
    let mut host = Host::serial(cable.line);
    host.join();
    assert!(!host.packets.iter().any(|packet| Paired::read(packet).is_some()));
    let stored = std::fs::read_to_string(folder.path().join("box.key")).unwrap();
    assert_eq!(stored, key().text().as_str());
    board.end_feed();
    assert!(board.wait().status.success());
    drop(end);
}

#[test]
fn what_is_lost_on_a_line_comes_again_beside_the_live_packets() {
    if !serial_lines() {
        return;
    }
    let folder = folder();
    let (line, end) = TTYPort::pair().unwrap();
    let mut host = Host::serial(line);
    let config_file = write_config(&folder, &config());
    let mut board = Board::start_fed(&config_file, &["--serial", &end.name().unwrap()]);
    host.join();
    let mut count = 0;
    host.lose = Box::new(move |packet| {
        count += usize::from(packet[1] == STREAM);
        packet[1] == STREAM && count % 3 == 0
    });
    for _ in 0..100 {
        board.feed(1);
        host.turn();
    }
    host.lose = Box::new(|_| false);
    host.turn_until("all poses", |it| (poses(&it.stream()).len() == 100).then_some(()));
    for lost in &host.lost {
        assert!(host.packets.contains(lost), "{lost:?} has not come again as it was");
    }
    assert!(host.lost.len() > 25, "{}", host.lost.len());
    board.end_feed();
    assert_whole(&host.until_the_end(), 100);
    assert!(board.wait().status.success());
    drop(end);
}

/// A configuration whose line has no way back.
fn one_way_config(device: &str) -> Config {
    let mut config = config();
    let path = device.try_into().unwrap();
    config.links.serial = Some(SerialLink { path, baud: 230_400, one_way: true });
    config
}

#[test]
fn a_line_without_a_way_back_is_opened_at_its_other_end() {
    if !serial_lines() {
        return;
    }
    let folder = folder();
    let (line, end) = TTYPort::pair().unwrap();
    let config_file = write_config(&folder, &one_way_config(&end.name().unwrap()));
    let count = folder.path().join("starts");
    let mut cable = Cable::new(line);
    for start in 1..=2 {
        cable.packets.clear();
        let mut board =
            Board::start_fed(&config_file, &["--boot-count-file", count.to_str().unwrap()]);
        let announced = cable.wait_for(|packet| OneWay::read(&key(), packet));
        assert_eq!((announced.start_count, announced.next), (start, 0));
        let mut opener = StreamOpener::one_way(&key(), &announced).unwrap();
        for _ in 0..20 {
            board.feed(1);
            cable.read();
        }
        let again = cable
            .wait_for(|packet| OneWay::read(&key(), packet).filter(|it| it.next > announced.next));
        assert_eq!(OneWay { next: 0, ..again }, announced);
        // A receiver that comes later joins where the stream is.
        let mut later = StreamOpener::one_way(&key(), &again).unwrap();
        board.feed(5);
        board.end_feed();
        let finished = board.wait();
        assert!(finished.status.success(), "{}", finished.stderr);
        for _ in 0..40 {
            cable.read();
        }
        let opened = |opener: &mut StreamOpener| -> Vec<Message> {
            cable.packets.iter().filter_map(|it| Some(opener.open(it)?.message)).collect()
        };
        let (all, rest) = (opened(&mut opener), opened(&mut later));
        assert_eq!((poses(&all).len(), poses(&rest).len()), (25, 5));
        assert_eq!(opener.window().missing().count(), 0);
        assert!(all.iter().any(|message| matches!(message, Message::Hello(_))));
        assert!(cable.packets.iter().all(|packet| Announcement::parse(packet).is_none()));
    }
    drop(end);
}

#[test]
fn a_line_without_a_way_back_needs_a_count_of_starts() {
    if !serial_lines() {
        return;
    }
    let folder = folder();
    let (line, end) = TTYPort::pair().unwrap();
    let config_file = write_config(&folder, &one_way_config(&end.name().unwrap()));
    write_key(&config_file);
    let trial = folder.path().join("trial.y4m");
    std::fs::write(&trial, recording(100)).unwrap();
    let finished = Board::start(&config_file, &["--replay", trial.to_str().unwrap()]).wait();
    assert!(finished.status.success(), "{}", finished.stderr);
    for part in ["nothing is sent on the serial line", "--boot-count-file"] {
        assert!(finished.stderr.contains(part), "{}", finished.stderr);
    }
    assert!(finished.stdout.contains("0 sent, 0 dropped (serial"), "{}", finished.stdout);
    let mut cable = Cable::new(line);
    cable.read();
    assert!(cable.packets.is_empty());
    drop(end);
}
