//! The serial line: what comes of it, what is kept of it, and what becomes of one that vanishes.

use std::collections::VecDeque;
use std::io::Read;
use std::sync::mpsc;
use std::thread;

use plumbline::packet::{Deframer, PacketError};
use plumbline_test_support::serial_lines;

use super::*;
use crate::transport::{self, Raw, Serial};

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
    let mut serial = Serial::open(&path, 115_200).unwrap();
    let sender = thread::spawn(move || {
        let whole = frame(&pose(0));
        boxside.write_all(&whole[50..]).unwrap();
        boxside.write_all(&frame(&hello(START))).unwrap();
        for sequence in 1..50 {
            let mut bytes = frame(&pose(sequence));
            if sequence == 20 {
                bytes[40] ^= 4;
            }
            boxside.write_all(&bytes).unwrap();
        }
        boxside
    });
    let (mut receiver, csv) = receiver();
    receive(&mut serial, &mut receiver, &mut (), Some(48), &AtomicBool::new(false), on()).unwrap();
    drop(sender.join().unwrap());
    assert_eq!(receiver.counts().lost, 1);
    let bad = receiver.bad();
    assert_eq!((bad.fragments, bad.corrupt), (1, 1));
    assert_eq!(rows(&csv.text()).len(), 96);
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
fn what_is_kept_of_a_damaged_line_reads_as_it_came() {
    // A run that is longer than any frame, and delimited.
    let mut run = vec![7; 600];
    run.push(0);
    let reads = [frame(&hello(START)), frame(&pose(0)), run, frame(&pose(1)), frame(&pose(2))];
    let script = Mutex::new(Some(Script(reads.map(Ok).into())));
    let opener: transport::Opener = Box::new(move || match script.lock().unwrap().take() {
        Some(script) => Ok(Box::new(script)),
        None => Err(std::io::Error::other("unplugged")),
    });
    let mut serial = Serial::new(opener).unwrap();
    let (mut receiver, _) = receiver();
    let mut kept = Kept::default();
    let stop = AtomicBool::new(false);
    receive(&mut serial, &mut receiver, &mut kept, Some(3), &stop, on()).unwrap();
    assert_eq!(receiver.bad().corrupt, 1);
    let mut deframer = Deframer::new();
    let read: Vec<_> = kept.0.iter().map(|raw| raw.decode(&mut deframer)).collect();
    let expected =
        [Ok(hello(START)), Ok(pose(0)), Err(PacketError::Oversize), Ok(pose(1)), Ok(pose(2))];
    assert_eq!(read, expected.map(|message| message.map(|message| sent(&message))));
}

#[test]
fn a_line_that_vanishes_is_waited_for() {
    let gone = || Err(std::io::Error::other("unplugged"));
    let half = frame(&pose(1))[..60].to_vec();
    let openings: VecDeque<std::io::Result<Vec<_>>> = [
        Ok(vec![Ok(frame(&hello(START))), Ok(frame(&pose(0))), Ok(half), gone()]),
        Err(std::io::Error::other("unplugged")),
        Ok(vec![Ok(frame(&pose(2))), Ok(frame(&pose(3)))]),
    ]
    .into();
    let openings = Mutex::new(openings);
    let (opened, seen) = mpsc::channel();
    let opener: transport::Opener = Box::new(move || {
        opened.send(Instant::now()).unwrap();
        let script = openings.lock().unwrap().pop_front().unwrap()?;
        Ok(Box::new(Script(script.into())) as Box<dyn transport::Line>)
    });
    let mut serial = Serial::new(opener).unwrap();
    let (mut receiver, csv) = receiver();
    receive(&mut serial, &mut receiver, &mut (), Some(3), &AtomicBool::new(false), on()).unwrap();
    assert_eq!(receiver.line_losses(), 1);
    assert_eq!((receiver.counts().received, receiver.counts().lost), (3, 1));
    // The half frame was forgotten with its line.
    assert_eq!(receiver.bad(), crate::bad_packets::BadPackets::default());
    assert_eq!(rows(&csv.text()).len(), 6);
    let times: Vec<_> = seen.try_iter().collect();
    let waits: Vec<_> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(waits[0] >= Duration::from_millis(250) && waits[1] >= Duration::from_millis(500));
}
