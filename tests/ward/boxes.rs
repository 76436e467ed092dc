//! Boxes that are played, all of them by one thread.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{
    Action, AnatomicalPoint, Command, Document, Hello, Message, PART_BYTES_MAX, Part, ReplyOutcome,
};
use plumbline::seal::Key;
use plumbline_stream::fixture::{self, SealedBox};

/// The frames of a box in a second.
pub const RATE_HZ: u32 = 60;

/// The clock of a box when it starts.
const ZERO_NS: u64 = 1_000_000_000;

/// The key of a box.
pub fn key(number: usize) -> Key {
    let mut bytes = [7; 32];
    bytes[..8].copy_from_slice(&(number as u64 + 1).to_le_bytes());
    Key::new(bytes).unwrap()
}

/// The serial number of a box.
pub fn serial_number(number: usize) -> String {
    format!("PL-{number:04}")
}

/// A box.
struct Played {
    sealed: SealedBox,
    begun: Instant,
    hello: Hello,
    blob: Arc<[u8]>,
    sequence: u32,
    next_frame: Instant,
    said: Option<Instant>,
}

/// What all boxes share with the test.
#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    streams: AtomicBool,
    frames_max: AtomicU32,
    sent: Vec<AtomicU32>,
}

/// Boxes that are on.
pub struct Boxes {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Boxes {
    /// So many boxes that announce themselves to a host, and send no frames yet. The start is that of their
    /// packets.
    pub fn switch_on(count: usize, host: SocketAddr, start: u32) -> Self {
        let shared = Arc::new(Shared {
            frames_max: AtomicU32::new(u32::MAX),
            sent: (0..count).map(|_| AtomicU32::new(0)).collect(),
            ..Shared::default()
        });
        let own = Arc::clone(&shared);
        let thread = std::thread::spawn(move || play(count, host, start, &own));
        Self { shared, thread: Some(thread) }
    }

    /// Frames come from now on, so many of each box at most.
    pub fn stream(&self, frames_max: u32) {
        self.shared.frames_max.store(frames_max, Ordering::Relaxed);
        self.shared.streams.store(true, Ordering::Relaxed);
    }

    /// The frames that a box has sent.
    pub fn sent(&self, number: usize) -> u32 {
        self.shared.sent[number].load(Ordering::Relaxed)
    }

    /// Whether every box has sent all of its frames.
    pub fn has_sent_all(&self) -> bool {
        let all = self.shared.frames_max.load(Ordering::Relaxed);
        self.shared.sent.iter().all(|it| it.load(Ordering::Relaxed) >= all)
    }
}

impl Drop for Boxes {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let done = thread.join();
            assert!(done.is_ok() || std::thread::panicking(), "the boxes have panicked");
        }
    }
}

fn play(count: usize, host: SocketAddr, start: u32, shared: &Shared) {
    let config = fixture::config();
    let blob: Arc<[u8]> = config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().into();
    let mut boxes: Vec<Played> =
        (0..count).map(|number| Played::new(number, host, start, &config, &blob)).collect();
    let period = Duration::from_secs(1) / RATE_HZ;
    let mut streams = false;
    while !shared.stop.load(Ordering::Relaxed) {
        let now = Instant::now();
        if !streams && shared.streams.load(Ordering::Relaxed) {
            streams = true;
            // Not all at the same moment.
            for (number, it) in boxes.iter_mut().enumerate() {
                it.next_frame = now + period * number as u32 / count as u32;
            }
        }
        let frames_max = shared.frames_max.load(Ordering::Relaxed);
        for (it, sent) in boxes.iter_mut().zip(&shared.sent) {
            it.answer();
            it.speak(now);
            while streams && it.sequence < frames_max && now >= it.next_frame {
                it.frame();
                it.next_frame += period;
                sent.store(it.sequence, Ordering::Relaxed);
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

impl Played {
    fn new(number: usize, host: SocketAddr, start: u32, config: &Config, blob: &Arc<[u8]>) -> Self {
        let now = Instant::now();
        let hello = Hello {
            device: format!("bed {number}").as_str().try_into().unwrap(),
            serial_number: serial_number(number).as_str().try_into().unwrap(),
            boot_id: start,
            ..fixture::hello(config)
        };
        Self {
            sealed: SealedBox::with_key(host, start, key(number)),
            begun: now,
            hello,
            blob: Arc::clone(blob),
            sequence: 0,
            next_frame: now,
            said: None,
        }
    }

    fn clock_ns(&self, at: Instant) -> u64 {
        ZERO_NS + at.saturating_duration_since(self.begun).as_nanos() as u64
    }

    /// What every box says once a second.
    fn speak(&mut self, now: Instant) {
        if self.said.is_some_and(|at| now - at < Duration::from_secs(1)) {
            return;
        }
        self.said = Some(now);
        self.sealed.send(&Message::Hello(self.hello.clone()));
        let mut health = fixture::health();
        health.frames = self.sequence;
        self.sealed.send(&Message::Health(health));
    }

    /// A person who sways by some millimetres.
    fn frame(&mut self) {
        let mut packet = fixture::pose_packet(self.sequence);
        packet.capture_time_ns = self.clock_ns(self.next_frame);
        let time_s = f64::from(self.sequence) / f64::from(RATE_HZ);
        let sway = |scale: f64| {
            let ap_mm = scale * 5.0 * (0.3 * std::f64::consts::TAU * time_s).sin();
            let ml_mm = scale * 3.0 * (0.45 * std::f64::consts::TAU * time_s).cos();
            AnatomicalPoint { ap_mm: ap_mm as f32, ml_mm: ml_mm as f32, si_mm: 1.0 }
        };
        packet.upper_trunk = Some(sway(1.0));
        packet.lower_trunk = Some(sway(0.6));
        self.sealed.send(&Message::Pose(packet));
        self.sequence += 1;
    }

    fn answer(&mut self) {
        for (listener, message) in self.sealed.receive() {
            let Message::Command(Command { id, action, .. }) = message else { continue };
            let outcome = match action {
                Action::SendHello => {
                    self.sealed.send(&Message::Hello(self.hello.clone()));
                    ReplyOutcome::Accepted
                }
                Action::SendHealth => {
                    self.sealed.send(&Message::Health(fixture::health()));
                    ReplyOutcome::Accepted
                }
                Action::SendView => {
                    let view = fixture::view();
                    self.sealed.send_to(listener, &Message::View(view));
                    ReplyOutcome::Accepted
                }
                Action::QueryConfig => {
                    let crc = self.hello.config_crc;
                    ReplyOutcome::Config { crc, bytes: self.blob.len() as u32, next_crc: crc }
                }
                Action::SendParts { document: Document::Config, .. } => {
                    for (index, bytes) in self.blob.chunks(PART_BYTES_MAX).enumerate() {
                        let offset = (index * PART_BYTES_MAX) as u32;
                        let bytes = bytes.iter().copied().collect();
                        let part = Part { document: Document::Config, offset, bytes };
                        self.sealed.send_to(listener, &Message::Part(part));
                    }
                    ReplyOutcome::Accepted
                }
                Action::Ping { host_sent_ns } => {
                    let now_ns = self.clock_ns(Instant::now());
                    ReplyOutcome::Pong {
                        host_sent_ns,
                        box_received_ns: now_ns,
                        box_sent_ns: now_ns,
                        stream_next: self.sealed.end().stream_next(),
                    }
                }
                _ => ReplyOutcome::Accepted,
            };
            self.sealed.answer(listener, id, outcome);
        }
    }
}
