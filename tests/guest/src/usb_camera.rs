//! A USB camera that plays files: the kernel's own USB and camera drivers find it, ask it for its
//! formats and stream from it, as from one that is plugged in.
//!
//! ```text
//! this process ── USB/IP over a socket ──▶ vhci-hcd ──▶ usbcore ──▶ uvcvideo ──▶ /dev/video0
//! ```
//!
//! The protocol of the socket is in the kernel's Documentation/usb/usbip_protocol.rst. The camera
//! is one of USB Video Class 1.0 with one format, one size and one rate, and a bulk endpoint.

use std::collections::VecDeque;
use std::fs;
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};

use crate::disturbances::monotonic_ns;
use crate::random::Random;
use crate::usb_descriptors::{Descriptors, Format};
use crate::{PATIENCE, frame_index, number, seed};

/// Where the kernel takes the socket of a virtual USB device.
const ATTACH: &str = "/sys/devices/platform/vhci_hcd.0/attach";

/// `USB_SPEED_HIGH` of include/uapi/linux/usb/ch9.h.
const HIGH_SPEED: u32 = 3;

/// Slow enough for an emulated machine to decompress each frame.
pub const RATE_HZ: u32 = 5;

/// The same in the unit of the video class, 100 ns.
pub const INTERVAL: u32 = 10_000_000 / RATE_HZ;

/// A payload and its header; the driver's transfers are of this size.
const PAYLOAD_BYTES_MAX: usize = 16 * 1024;

/// Of a payload: its length and its flags.
const PAYLOAD_HEADER_BYTES: usize = 2;

/// Of the structure with which the driver and a camera agree on a stream (class 1.0).
const PROBE_BYTES: usize = 26;

/// The error of a request that the device does not know, `-EPIPE`.
const STALL: i32 = -32;

/// Of a transfer that the driver no longer wants, `-ECONNRESET`.
const UNLINKED: i32 = -104;

/// Plays the files `/frames/0`, `/frames/1` and so on, frames in the format with this code of the
/// kernel, forwards and backwards for ever.
///
/// # Errors
/// When the format is none that is played here, or the kernel has no virtual host controller, or
/// drops the device.
pub fn play(code: &str) -> Result<()> {
    let format = Format::of(code)?;
    let mut frames = Vec::new();
    while let Ok(frame) = fs::read(format!("/frames/{}", frames.len())) {
        frames.push(frame);
    }
    ensure!(!frames.is_empty(), "there is no /frames/0");
    let descriptors = Descriptors::new(&format);
    let mut stream = Stream { frames, step: 0, sent: 0, due: Instant::now() };
    let mut random = Random::new(seed()?);
    let payloads = u64::from(format.frame_bytes_max).div_ceil(PAYLOAD_BYTES_MAX as u64);
    for left in (0..=number("test.unplug=")?.unwrap_or(0)).rev() {
        let (device, at_ns) = plug_in()?;
        println!("test: the camera is plugged in at {at_ns} ns");
        let commands = read_commands(device.try_clone()?);
        // Some frames at least, so that there is something to lose.
        let payloads = random.in_range(FRAMES_MIN * payloads..FRAMES_MAX * payloads);
        let until = (left > 0).then_some(payloads);
        let mut camera = UsbCamera {
            device,
            format: &format,
            descriptors: &descriptors,
            waiting: VecDeque::new(),
            stream,
        };
        camera.serve(&commands, until)?;
        camera.device.shutdown(Shutdown::Both)?;
        println!("test: the camera is unplugged at {} ns", monotonic_ns()?);
        stream = camera.stream;
        stream.sent = 0;
        sleep(Duration::from_millis(random.in_range(AWAY_MS)));
    }
    Ok(())
}

/// Frames of the camera, at its full size, until its plug is pulled.
const FRAMES_MIN: u64 = 3;
const FRAMES_MAX: u64 = 10;

/// How long the plug is out.
const AWAY_MS: std::ops::Range<u64> = 20..5_000;

/// Plugs a device in, as soon as the port is free; its end of the socket, and when that was.
fn plug_in() -> Result<(UnixStream, u64)> {
    let give_up = Instant::now() + PATIENCE;
    loop {
        let (device, kernels) = UnixStream::pair()?;
        let at_ns = monotonic_ns()?;
        match attach(&kernels) {
            // The kernel has taken it, and this process's handle may go.
            Ok(()) => return Ok((device, at_ns)),
            Err(error) if Instant::now() > give_up => return Err(error).context(ATTACH),
            Err(_) => sleep(Duration::from_millis(5)),
        }
    }
}

fn attach(kernels: &UnixStream) -> io::Result<()> {
    fs::write(ATTACH, format!("0 {} 1 {HIGH_SPEED}", kernels.as_raw_fd()))
}

/// A request of the host's.
enum Command {
    Submit { number: u32, endpoint: u32, is_in: bool, length: usize, setup: [u8; 8], data: Vec<u8> },
    Unlink { number: u32, unwanted: u32 },
}

/// Reads requests for as long as there are any.
fn read_commands(mut device: UnixStream) -> Receiver<Command> {
    let (to, commands) = mpsc::channel();
    thread::spawn(move || {
        while let Ok(command) = read_command(&mut device) {
            if to.send(command).is_err() {
                return;
            }
        }
    });
    commands
}

fn read_command(device: &mut UnixStream) -> Result<Command> {
    let mut header = [0; 48];
    device.read_exact(&mut header)?;
    let word =
        |place: usize| u32::from_be_bytes(header[place..place + 4].try_into().expect("four bytes"));
    let number = word(4);
    match word(0) {
        1 => {
            let (is_in, length) = (word(12) == 1, word(24) as usize);
            let mut data = vec![0; if is_in { 0 } else { length }];
            device.read_exact(&mut data)?;
            let setup = header[40..].try_into()?;
            Ok(Command::Submit { number, endpoint: word(16), is_in, length, setup, data })
        }
        2 => Ok(Command::Unlink { number, unwanted: word(20) }),
        command => bail!("an unknown command of USB/IP: {command}"),
    }
}

/// The frames, and how far they have been sent.
struct Stream {
    frames: Vec<Vec<u8>>,
    step: usize,
    /// Bytes of the current frame.
    sent: usize,
    /// When the current frame begins.
    due: Instant,
}

impl Stream {
    /// The next payload of at most this length, with its header.
    fn payload(&mut self, length: usize) -> Vec<u8> {
        let frame = &self.frames[frame_index(self.step, self.frames.len())];
        let count =
            (length.min(PAYLOAD_BYTES_MAX) - PAYLOAD_HEADER_BYTES).min(frame.len() - self.sent);
        let is_last = self.sent + count == frame.len();
        // The end of the header; which of two frames in turn; whether the frame ends.
        let flags = 0x80 | (self.step % 2) as u8 | u8::from(is_last) << 1;
        let mut payload = vec![PAYLOAD_HEADER_BYTES as u8, flags];
        payload.extend(&frame[self.sent..self.sent + count]);
        self.sent += count;
        if is_last {
            self.step += 1;
            self.sent = 0;
            // After a pause the rate goes on from now.
            self.due = (self.due + Duration::from_secs(1) / RATE_HZ).max(Instant::now());
        }
        payload
    }
}

struct UsbCamera<'a> {
    device: UnixStream,
    format: &'a Format,
    descriptors: &'a Descriptors,
    /// Transfers that wait for a part of a frame: number and length.
    waiting: VecDeque<(u32, usize)>,
    stream: Stream,
}

impl UsbCamera<'_> {
    /// Answers the kernel, without end or until this many payloads have been sent.
    fn serve(&mut self, commands: &Receiver<Command>, until: Option<u64>) -> Result<()> {
        let mut payloads = 0;
        while until.is_none_or(|until| payloads < until) {
            let command = if self.waiting.is_empty() {
                commands.recv().map_err(|_| RecvTimeoutError::Disconnected)
            } else {
                commands.recv_timeout(self.stream.due.saturating_duration_since(Instant::now()))
            };
            match command {
                Ok(command) => self.answer(command)?,
                Err(RecvTimeoutError::Timeout) => {
                    let (number, length) = self.waiting.pop_front().expect("it was not empty");
                    let payload = self.stream.payload(length);
                    self.reply(number, 0, payload.len(), &payload)?;
                    payloads += 1;
                }
                Err(RecvTimeoutError::Disconnected) => bail!("the kernel has dropped the camera"),
            }
        }
        Ok(())
    }

    fn answer(&mut self, command: Command) -> Result<()> {
        match command {
            Command::Submit { number, endpoint: 0, is_in, length, setup, data } => {
                match self.control(setup, &data) {
                    Some(answer) if is_in => {
                        let answer = &answer[..answer.len().min(length)];
                        self.reply(number, 0, answer.len(), answer)
                    }
                    Some(_) => self.reply(number, 0, data.len(), &[]),
                    None => self.reply(number, STALL, 0, &[]),
                }
            }
            Command::Submit { number, length, .. } => {
                self.waiting.push_back((number, length));
                Ok(())
            }
            Command::Unlink { number, unwanted } => {
                // The driver stops: the next stream begins with a whole frame.
                self.stream.sent = 0;
                let before = self.waiting.len();
                self.waiting.retain(|(waiting, _)| *waiting != unwanted);
                let status = if self.waiting.len() < before { UNLINKED } else { 0 };
                self.send(4, number, [status as u32, 0], &[])
            }
        }
    }

    /// The answer to a control request, empty for one that carries data; `None` if it is unknown.
    fn control(&mut self, setup: [u8; 8], data: &[u8]) -> Option<Vec<u8>> {
        let [kind, request, low, high, ..] = setup;
        match (kind, request) {
            // GET_STATUS, SET_CONFIGURATION, SET_INTERFACE, and CLEAR_FEATURE of the endpoint.
            (0x80..=0x82, 0) => Some(vec![0, 0]),
            (0x00, 9) | (0x01, 11) | (0x02, 1) => Some(Vec::new()),
            // GET_DESCRIPTOR.
            (0x80, 6) => self.descriptors.get(high, low),
            // SET_CUR of what the stream is to be: it can be nothing else than it is.
            (0x21, 1) if matches!(high, 1 | 2) && data.len() <= PROBE_BYTES => Some(Vec::new()),
            // GET_CUR, GET_MIN, GET_MAX and GET_DEF of the same.
            (0xA1, 0x81..=0x83 | 0x87) if matches!(high, 1 | 2) => Some(self.probe()),
            _ => None,
        }
    }

    /// Ends a transfer.
    fn reply(&mut self, number: u32, status: i32, length: usize, data: &[u8]) -> Result<()> {
        self.send(3, number, [status as u32, length as u32], data)
    }

    fn send(&mut self, command: u32, number: u32, results: [u32; 2], data: &[u8]) -> Result<()> {
        let mut message = [0; 48];
        let [status, length] = results;
        for (place, word) in [(0, command), (4, number), (20, status), (24, length)] {
            message[place..place + 4].copy_from_slice(&word.to_be_bytes());
        }
        self.device.write_all(&message)?;
        Ok(self.device.write_all(data)?)
    }

    /// The one stream that there is: format 1, frame 1.
    fn probe(&self) -> Vec<u8> {
        let mut probe = vec![0; PROBE_BYTES];
        (probe[2], probe[3]) = (1, 1);
        probe[4..8].copy_from_slice(&INTERVAL.to_le_bytes());
        probe[18..22].copy_from_slice(&self.format.frame_bytes_max.to_le_bytes());
        probe[22..26].copy_from_slice(&(PAYLOAD_BYTES_MAX as u32).to_le_bytes());
        probe
    }
}
