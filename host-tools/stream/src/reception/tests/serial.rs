//! The serial line, here without a way back: what comes of it, what is kept of it, and what becomes
//! of one that vanishes.

use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::sync::mpsc;
use std::thread;

use plumbline::packet::{Deframer, SCHEMA_HASH, Start, frame_packet};
use plumbline::seal::{OneWay, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX, StreamSealer};
use plumbline_test_support::serial_lines;

use super::*;
use crate::fixture::key;
use crate::transport::{self, Memory, Raw, Serial, Transport};

/// A box that nobody answers: its frames, in the order in which it sends them.
struct Sender {
    announcement: OneWay,
    stream: StreamSealer,
}

impl Sender {
    fn new(start_count: u32) -> Self {
        let announcement = OneWay {
            key_id: key().id(),
            start: Start::new(START).unwrap(),
            start_count,
            schema_hash: SCHEMA_HASH,
            salt: [5; 16],
            next: 0,
        };
        Self { announcement, stream: StreamSealer::one_way(&key(), &announcement) }
    }

    fn announcement(&self) -> Vec<u8> {
        let announcement = OneWay { next: self.stream.next(), ..self.announcement };
        frame_of(announcement.packet(&key(), &mut [0; SEALED_BYTES_MAX]))
    }

    fn frame(&mut self, message: &Message) -> Vec<u8> {
        frame_of(self.stream.seal(message, &mut [0; SEALED_BYTES_MAX]).unwrap())
    }

    /// The announcement, and these.
    fn frames(&mut self, messages: &[Message]) -> Vec<Vec<u8>> {
        let announcement = self.announcement();
        let frames = messages.iter().map(|message| self.frame(message));
        std::iter::once(announcement).chain(frames).collect()
    }
}

fn frame_of(packet: &[u8]) -> Vec<u8> {
    frame_packet(packet, &mut [0; SEALED_FRAME_BYTES_MAX]).unwrap().to_vec()
}

fn link_over(serial: Serial) -> Link<Serial> {
    Link::new(serial, vec![known_box()], "a test")
}

#[cfg(unix)]
#[test]
fn frames_come_through_a_serial_line() {
    if !serial_lines() {
        return;
    }
    use serialport::SerialPort;
    let (mut boxside, host) = serialport::TTYPort::pair().unwrap();
    let path = host.name().unwrap();
    // The pair's own end would be a second reader.
    drop(host);
    let mut link = link_over(Serial::open(&path, 115_200).unwrap());
    let sender = thread::spawn(move || {
        let mut sender = Sender::new(1);
        let whole = sender.announcement();
        boxside.write_all(&whole[10..]).unwrap();
        for frame in sender.frames(&[hello(START), pose(0)]) {
            boxside.write_all(&frame).unwrap();
        }
        for sequence in 1..50 {
            let mut bytes = sender.frame(&pose(sequence));
            if sequence == 20 {
                bytes[40] = bytes[40].wrapping_add(1).max(1);
            }
            boxside.write_all(&bytes).unwrap();
        }
        boxside
    });
    let (mut receiver, csv) = receiver();
    receive(&mut link, &mut receiver, &mut (), Some(49), &AtomicBool::new(false), on()).unwrap();
    drop(sender.join().unwrap());
    assert_eq!(receiver.counts().lost, 1);
    let bad = receiver.bad();
    // The beginning that was missed decodes to something, of which nobody knows what it was.
    assert_eq!(bad.fragments + bad.corrupt + bad.other_version, 1, "{bad:?}");
    assert_eq!(bad.not_authentic, 1, "{bad:?}");
    assert_eq!(rows(&csv.text()).len(), 98);
}

/// A line whose reads are given in advance.
struct Script(VecDeque<std::io::Result<Vec<u8>>>);

impl Read for Script {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let bytes = self.0.pop_front().unwrap_or(Err(std::io::ErrorKind::TimedOut.into()))?;
        buffer[..bytes.len()].copy_from_slice(&bytes);
        Ok(bytes.len())
    }
}

impl Write for Script {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// A line that brings this once.
fn scripted(reads: Vec<Vec<u8>>) -> Serial {
    let script = Mutex::new(Some(Script(reads.into_iter().map(Ok).collect())));
    let opener: transport::Opener = Box::new(move || match script.lock().unwrap().take() {
        Some(script) => Ok(Box::new(script)),
        None => Err(std::io::Error::other("unplugged")),
    });
    Serial::new(opener).unwrap()
}

/// What a recording keeps.
#[derive(Default)]
struct Kept(Vec<Raw>);

impl Tap for Kept {
    fn event(&mut self, event: &Event, _: Instant) -> Result<(), BadInput> {
        if let Event::Raw(raw) = event {
            self.0.push(raw.clone());
        }
        Ok(())
    }

    fn turn(&mut self, _: Instant) -> Result<Option<Message>, BadInput> {
        Ok(None)
    }
}

#[test]
fn what_is_kept_of_a_damaged_line_are_the_packets_in_clear() {
    let mut sender = Sender::new(1);
    let messages = [hello(START), pose(0), pose(1), pose(2)];
    let mut reads = sender.frames(&messages);
    // A run that is longer than any frame, and delimited.
    let mut run = vec![7; 600];
    run.push(0);
    reads.insert(3, run);
    let mut link = link_over(scripted(reads));
    let (mut receiver, _) = receiver();
    let mut kept = Kept::default();
    let stop = AtomicBool::new(false);
    receive(&mut link, &mut receiver, &mut kept, Some(3), &stop, on()).unwrap();
    assert_eq!(receiver.bad().corrupt, 1);
    let mut deframer = Deframer::new();
    let read: Vec<_> = kept.0.iter().map(|raw| raw.decode(&mut deframer).unwrap()).collect();
    assert_eq!(read, messages.each_ref().map(sent));
}

#[test]
fn a_line_that_vanishes_is_waited_for() {
    let gone = || Err(std::io::Error::other("unplugged"));
    let mut sender = Sender::new(1);
    let mut first: Vec<_> = sender.frames(&[hello(START), pose(0)]).into_iter().map(Ok).collect();
    first.extend([Ok(sender.frame(&pose(1))[..60].to_vec()), gone()]);
    let last = [pose(2), pose(3)].map(|message| Ok(sender.frame(&message))).into();
    let openings: VecDeque<std::io::Result<Vec<_>>> =
        [Ok(first), Err(std::io::Error::other("unplugged")), Ok(last)].into();
    let openings = Mutex::new(openings);
    let (opened, seen) = mpsc::channel();
    let opener: transport::Opener = Box::new(move || {
        opened.send(Instant::now()).unwrap();
        let script = openings.lock().unwrap().pop_front().unwrap()?;
        Ok(Box::new(Script(script.into())) as Box<dyn transport::Line>)
    });
    let mut link = link_over(Serial::new(opener).unwrap());
    let (mut receiver, csv) = receiver();
    receive(&mut link, &mut receiver, &mut (), Some(3), &AtomicBool::new(false), on()).unwrap();
    assert_eq!(receiver.line_losses(), 1);
    assert_eq!((receiver.counts().received, receiver.counts().lost), (3, 1));
    // The half frame was forgotten with its line.
    assert_eq!(receiver.bad(), crate::bad_packets::BadPackets::default());
    assert_eq!(rows(&csv.text()).len(), 6);
    let times: Vec<_> = seen.try_iter().collect();
    let waits: Vec<_> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(waits[0] >= Duration::from_millis(250) && waits[1] >= Duration::from_millis(500));
}

/// What the test remembers of the starts of boxes.
#[derive(Clone, Default)]
struct Remembered(Arc<Mutex<BTreeMap<plumbline::seal::KeyId, u32>>>);

impl Memory for Remembered {
    fn met_at(&mut self, _: plumbline::seal::KeyId, _: std::net::SocketAddr) {}

    fn take_start(&mut self, key_id: plumbline::seal::KeyId, start_count: u32) -> bool {
        self.0.lock().unwrap().take_start(key_id, start_count)
    }
}

#[test]
fn a_start_that_was_heard_before_is_not_taken_again() {
    let remembered = Remembered::default();
    let frames = |start_count| Sender::new(start_count).frames(&[hello(START), pose(0), pose(1)]);
    // As it was; recorded and played again; an older one; the next.
    for (start_count, is_taken) in [(4, true), (4, false), (3, false), (5, true)] {
        let link = link_over(scripted(frames(start_count)));
        let mut link = link.remembering(Box::new(remembered.clone()));
        let mut poses = 0;
        for _ in 0..5 {
            let mut count = |event| {
                let is_pose = matches!(event, Event::Packet(ref it) if matches!(it.message, Message::Pose(_)));
                poses += usize::from(is_pose);
            };
            link.poll(&mut count).unwrap();
        }
        assert_eq!(poses, if is_taken { 2 } else { 0 }, "start {start_count}");
    }
}

#[test]
fn what_comes_twice_over_a_line_without_a_way_back_is_taken_once() {
    let mut frames = Sender::new(1).frames(&[hello(START), pose(0), pose(1), pose(2)]);
    let again = frames[2..4].to_vec();
    frames.extend(again);
    frames.push(Sender::new(1).frames(&[]).remove(0));
    let mut link = link_over(scripted(frames));
    let (mut poses, mut refused) = (0, 0);
    for _ in 0..8 {
        link.poll(&mut |event| match event {
            Event::Packet(Packet { message: Message::Pose(_), .. }) => poses += 1,
            Event::NotAuthentic => refused += 1,
            _ => {}
        })
        .unwrap();
    }
    assert_eq!((poses, refused), (3, 2));
}
