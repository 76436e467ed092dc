//! Frames on a serial line.
//!
//! A line is slower than the box: at 115,200 baud a byte takes 87 us. Frames go
//! through a bounded buffer and are sent as fast as the line permits. A frame that
//! does not fit into it is dropped whole and counted; a partial frame is never sent,
//! unless the line itself fails.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use plumbline::packet::{DELIMITER, Deframer, frame_packet};
use plumbline::seal::{SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX};
use serialport::TTYPort;

use super::Counts;

/// The size of the buffer: 16 pose packets, a quarter of a second at 60 Hz. A larger
/// one would only make packets arrive later.
const WAITING_BYTES_MAX: usize = 2048;

/// The permitted bit rates.
const BAUD: std::ops::RangeInclusive<u32> = 1200..=4_000_000;

/// Bytes that are read at once.
const READ_BYTES: usize = 256;

/// Reads in search of one packet; more noise than that waits.
const READS_MAX: usize = 16;

/// How often opening an absent line is tried again.
const REOPEN_EVERY: Duration = Duration::from_secs(1);

/// A serial device, raw, 8 data bits, no parity, 1 stop bit, no flow control.
///
/// A line that fails (unplugged) is reopened when it is back. Until then packets for
/// it are dropped and counted.
#[derive(Debug)]
pub struct SerialLink {
    line: Option<Line>,
    /// When opening an absent line is tried again.
    again_at: Instant,
    name: String,
    baud: u32,
    waiting: Vec<u8>,
    incoming: Incoming,
    counts: Counts,
}

/// What has been read and not yet looked at.
#[derive(Debug)]
struct Incoming {
    deframer: Deframer<SEALED_FRAME_BYTES_MAX>,
    bytes: [u8; READ_BYTES],
    /// Of those bytes.
    unread: std::ops::Range<usize>,
}

/// The open device.
#[derive(Debug)]
struct Line {
    /// The same device, opened non-blocking; the port's own writes block until
    /// everything is sent.
    device: File,
    /// Holds the line's settings and the exclusive access.
    _port: TTYPort,
}

impl SerialLink {
    /// Opens `device` at `baud` bits per second.
    ///
    /// # Errors
    /// When the device is absent, in use, not a serial line, or does not support the rate.
    pub fn open(device: &str, baud: u32) -> Result<Self> {
        let mut link = Self::absent(device, baud)?;
        link.line = Some(Line::open(device, baud)?);
        Ok(link)
    }

    /// A link to a device that may be plugged in later.
    ///
    /// # Errors
    /// When no line runs at such a rate.
    pub fn absent(device: &str, baud: u32) -> Result<Self> {
        if !BAUD.contains(&baud) {
            bail!(
                "the serial device {device} cannot run at {baud} baud: give a rate from {} to {}, \
                 usually 115200",
                BAUD.start(),
                BAUD.end()
            );
        }
        Ok(Self {
            line: None,
            again_at: Instant::now(),
            name: device.into(),
            baud,
            waiting: Vec::with_capacity(WAITING_BYTES_MAX),
            incoming: Incoming::default(),
            counts: Counts::default(),
        })
    }

    /// Puts one frame into the buffer, if it fits, and sends as much as the line accepts.
    pub fn send(&mut self, frame: &[u8]) {
        self.service();
        if self.line.is_none() || self.waiting.len() + frame.len() > WAITING_BYTES_MAX {
            self.counts.dropped += 1;
            return;
        }
        self.waiting.extend_from_slice(frame);
        self.counts.waiting += 1;
        self.service();
    }

    /// Sends one packet, as a frame.
    pub fn send_packet(&mut self, packet: &[u8]) {
        let mut frame = [0; SEALED_FRAME_BYTES_MAX];
        match frame_packet(packet, &mut frame) {
            Ok(frame) => self.send(frame),
            Err(_) => unreachable!("a packet longer than {SEALED_BYTES_MAX} bytes"),
        }
    }

    /// Whether there is room for a packet and for two more after it.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.line.is_some() && self.waiting.len() + 3 * SEALED_FRAME_BYTES_MAX <= WAITING_BYTES_MAX
    }

    /// Sends as many bytes as the line accepts now.
    pub fn service(&mut self) {
        self.reopen();
        while !self.waiting.is_empty()
            && let Some(line) = &mut self.line
        {
            match line.device.write(&self.waiting) {
                Ok(0) => return,
                Ok(count) => {
                    // A frame ends with its only zero byte.
                    let ends = self.waiting.drain(..count).filter(|byte| *byte == 0).count() as u64;
                    self.counts.sent += ends;
                    self.counts.waiting = self.counts.waiting.saturating_sub(ends);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => {
                    log::error!("{} failed: {error}; it is used again when it is back", self.name);
                    self.line = None;
                    self.again_at = Instant::now() + REOPEN_EVERY;
                    self.drop_waiting();
                }
            }
        }
    }

    /// Tries to open an absent line when it is time to.
    fn reopen(&mut self) {
        if self.line.is_some() || Instant::now() < self.again_at {
            return;
        }
        self.again_at = Instant::now() + REOPEN_EVERY;
        // Opening allocates, so it waits for the device.
        if !Path::new(&self.name).exists() {
            return;
        }
        self.line = Line::open(&self.name, self.baud).ok();
        if self.line.is_some() {
            self.incoming = Incoming::default();
            log::info!("{} is open", self.name);
        }
    }

    /// The next packet, of `buffer`'s first bytes; frames that are damaged are left out.
    pub fn receive(&mut self, buffer: &mut [u8; SEALED_FRAME_BYTES_MAX]) -> Option<usize> {
        let Incoming { deframer, bytes, unread } = &mut self.incoming;
        for _ in 0..READS_MAX {
            for index in unread.by_ref() {
                if let Some(Ok(packet)) = deframer.frame(bytes[index])
                    && let Some(place) = buffer.get_mut(..packet.len())
                {
                    place.copy_from_slice(packet);
                    return Some(packet.len());
                }
            }
            match self.line.as_mut()?.device.read(bytes) {
                Ok(count) if count > 0 => *unread = 0..count,
                // Nothing to read, or the line failed, which sending notices.
                _ => return None,
            }
        }
        None
    }

    /// Sends what is left in the buffer, for at most `limit`.
    pub fn finish(&mut self, limit: Duration) {
        let give_up = Instant::now() + limit;
        while !self.waiting.is_empty() && Instant::now() < give_up {
            self.service();
            std::thread::sleep(Duration::from_millis(1));
        }
        self.drop_waiting();
    }

    fn drop_waiting(&mut self) {
        self.counts.dropped += std::mem::take(&mut self.counts.waiting);
        self.waiting.clear();
    }

    /// What became of the packets so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }
}

impl Default for Incoming {
    fn default() -> Self {
        Self { deframer: Deframer::new(), bytes: [0; READ_BYTES], unread: 0..0 }
    }
}

impl Line {
    fn open(device: &str, baud: u32) -> Result<Self> {
        let hint = || {
            format!(
                "the serial device {device} cannot be opened: check that it is plugged in \
                 (ls /dev/tty*), that no other program uses it, and that this user may (group dialout)"
            )
        };
        // Before the port takes exclusive access, after which nobody opens it again.
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(libc::O_NONBLOCK | libc::O_NOCTTY)
            .open(device)
            .with_context(hint)?;
        let port = TTYPort::open(&serialport::new(device, baud)).with_context(hint)?;
        // Until it is raw, a line says back what it hears. A frame of its own keeps that out of the
        // first packet; on a line that takes nothing now, nothing was said either.
        let _ = file.write(&[DELIMITER]);
        Ok(Self { device: file, _port: port })
    }
}

impl std::fmt::Display for SerialLink {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "serial {} at {} baud", self.name, self.baud)
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::process::Command;

    use plumbline_test_support::serial_lines;
    use serialport::SerialPort;

    use super::*;

    #[test]
    fn a_line_that_failed_is_used_again_when_it_is_back() {
        if !serial_lines() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("line");
        let plug_in = || {
            let (host, box_end) = TTYPort::pair().unwrap();
            let _ = std::fs::remove_file(&name);
            symlink(box_end.name().unwrap(), &name).unwrap();
            (host, box_end)
        };
        let (host, mut box_end) = plug_in();
        let mut link = SerialLink::open(name.to_str().unwrap(), 115_200).unwrap();
        link.send(&[1, 2, 0]);
        assert_eq!(link.counts(), Counts { sent: 1, dropped: 0, waiting: 0 });
        drop(host);
        // A program that another test starts meanwhile inherits the host's end and may keep it open: the
        // line is gone when that has ended, too.
        box_end.set_timeout(Duration::from_secs(30)).unwrap();
        let read = box_end.read(&mut [0]);
        assert!(!matches!(&read, Err(error) if error.kind() == ErrorKind::TimedOut), "not gone");
        std::fs::remove_file(&name).unwrap();
        // The first finds out that the line is gone, the second knows.
        link.send(&[3, 0]);
        link.send(&[4, 0]);
        assert_eq!(link.counts(), Counts { sent: 1, dropped: 2, waiting: 0 });
        let (mut host, _box_end) = plug_in();
        host.set_timeout(Duration::from_secs(10)).unwrap();
        let give_up = Instant::now() + Duration::from_secs(10);
        while link.counts().sent < 2 {
            assert!(Instant::now() < give_up, "the line is not used again");
            std::thread::sleep(Duration::from_millis(50));
            link.send(&[5, 0]);
        }
        let mut bytes = [0; 3];
        host.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, [0, 5, 0]);
    }

    #[test]
    fn what_a_line_says_back_before_it_is_raw_is_no_part_of_the_first_packet() {
        if !serial_lines() {
            return;
        }
        // As a device is before anybody has opened it: what comes is said back.
        let (mut host, box_end) = TTYPort::pair().unwrap();
        let name = box_end.name().unwrap();
        assert!(Command::new("stty").args(["-F", &name, "echo"]).status().unwrap().success());
        host.set_timeout(Duration::from_secs(10)).unwrap();
        host.write_all(b"U").unwrap();
        let mut said_back = [0];
        host.read_exact(&mut said_back).unwrap();
        assert_eq!(said_back, *b"U");
        let mut link = SerialLink::open(&name, 115_200).unwrap();
        link.send(&[3, 1, 2, 0]);
        assert_eq!(link.counts(), Counts { sent: 1, dropped: 0, waiting: 0 });
        let mut bytes = [0; 5];
        host.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, [0, 3, 1, 2, 0]);
    }
}
