//! The network between a box and its hosts, with what a network does to packets, and with everybody
//! who listens in it or sends under another's address.
//!
//! ```text
//! box ◀─▶ socket, the host for the box │ socket, the box for the host ◀─▶ host      one way
//! ```
//!
//! Each host has a way of its own, and the box announces itself on the first; its announcements go
//! on to all. A sender of forged addresses sends from the relay's own sockets: for the receiver that
//! is the same.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::packet::PROTOCOL_VERSION;
use plumbline::seal::SEALED_BYTES_MAX;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The second bytes of packets: see LINK.md.
pub const ANNOUNCEMENT: u8 = 1;
pub const ANSWER: u8 = 3;
pub const OPENING: u8 = 4;
pub const ACCEPTANCE: u8 = 5;
pub const CHANNEL: u8 = 6;
pub const STREAM: u8 = 7;

/// Packets that are kept, and that are held back, at most: some minutes of a box.
const PACKETS_MAX: usize = 200_000;

/// Packets that are taken from one socket before the next one's turn.
const AT_ONCE_MAX: usize = 64;

const PAUSE: Duration = Duration::from_micros(500);

/// What happens to the packets of a way, in either direction; each is a share of them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Faults {
    pub lost: f64,
    pub repeated: f64,
    pub flipped: f64,
    /// Held back for this time, so that others overtake them.
    pub late: f64,
    pub late_by: Duration,
}

impl Faults {
    /// Nothing gets through.
    pub fn cut() -> Self {
        Self { lost: 1.0, ..Self::default() }
    }

    pub fn lost(share: f64) -> Self {
        Self { lost: share, ..Self::default() }
    }
}

/// A packet that a way was given to carry.
#[derive(Debug, Clone)]
pub struct Seen {
    pub at: Instant,
    pub way: usize,
    pub is_to_box: bool,
    pub bytes: Vec<u8>,
    pub is_lost: bool,
}

impl Seen {
    pub fn is(&self, kind: u8) -> bool {
        is_kind(&self.bytes, kind)
    }
}

/// Whether a packet is of this kind.
pub fn is_kind(bytes: &[u8], kind: u8) -> bool {
    bytes.get(..2) == Some(&[PROTOCOL_VERSION, kind])
}

struct Way {
    /// The box's host.
    to_box: UdpSocket,
    /// The host's box.
    to_host: UdpSocket,
    host: SocketAddr,
}

struct State {
    faults: Vec<Faults>,
    the_box: Option<SocketAddr>,
    seen: Vec<Seen>,
}

struct Shared {
    ways: Vec<Way>,
    state: Mutex<State>,
    is_over: AtomicBool,
}

pub struct Relay {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// A network with a way to each of these hosts; the seed decides which packets meet with what.
    pub fn new(hosts: &[SocketAddr], seed: u64) -> Self {
        let socket = || {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.set_nonblocking(true).unwrap();
            socket
        };
        let ways = hosts.iter().map(|&host| Way { to_box: socket(), to_host: socket(), host });
        let state =
            State { faults: vec![Faults::default(); hosts.len()], the_box: None, seen: Vec::new() };
        let shared = Arc::new(Shared {
            ways: ways.collect(),
            state: Mutex::new(state),
            is_over: AtomicBool::new(false),
        });
        let carried = Arc::clone(&shared);
        let thread = std::thread::spawn(move || carry(&carried, ChaCha8Rng::seed_from_u64(seed)));
        Self { shared, thread: Some(thread) }
    }

    /// Where the box is to announce itself.
    pub fn address(&self) -> SocketAddr {
        self.shared.ways[0].to_box.local_addr().unwrap()
    }

    /// From now on this happens on a way.
    pub fn set(&self, way: usize, faults: Faults) {
        self.shared.state().faults[way] = faults;
    }

    /// Where the box is, once it has announced itself.
    pub fn the_box(&self) -> Option<SocketAddr> {
        self.shared.state().the_box
    }

    /// What the ways were given to carry since this many packets.
    pub fn seen_since(&self, count: usize) -> Vec<Seen> {
        self.shared.state().seen[count..].to_vec()
    }

    pub fn seen(&self) -> Vec<Seen> {
        self.seen_since(0)
    }

    pub fn seen_count(&self) -> usize {
        self.shared.state().seen.len()
    }

    /// Sends to the box under the address of a host.
    pub fn as_host(&self, way: usize, bytes: &[u8]) {
        if let Some(the_box) = self.the_box() {
            send(&self.shared.ways[way].to_box, bytes, the_box);
        }
    }

    /// Sends to a host under the address of the box.
    pub fn as_box(&self, way: usize, bytes: &[u8]) {
        let way = &self.shared.ways[way];
        send(&way.to_host, bytes, way.host);
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        let thread = self.thread.take();
        assert!(thread.is_some_and(|it| it.join().is_ok()) || std::thread::panicking());
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }
}

/// A packet that is held back, the earliest first: when it is due, its number, its way, its
/// direction, and its bytes.
type Held = Reverse<(Instant, u64, usize, bool, Vec<u8>)>;

fn carry(shared: &Shared, mut random: ChaCha8Rng) {
    let mut held: BinaryHeap<Held> = BinaryHeap::new();
    let mut number = 0;
    let mut buffer = [0; SEALED_BYTES_MAX + 1];
    while !shared.is_over.load(Ordering::Relaxed) {
        let mut is_idle = true;
        for (index, way) in shared.ways.iter().enumerate() {
            for (socket, is_to_box) in [(&way.to_host, true), (&way.to_box, false)] {
                for _ in 0..AT_ONCE_MAX {
                    let Ok((length, from)) = socket.recv_from(&mut buffer) else { break };
                    is_idle = false;
                    let bytes = &buffer[..length];
                    let mut state = shared.state();
                    let is_announcement = is_kind(bytes, ANNOUNCEMENT);
                    if is_announcement && !is_to_box {
                        state.the_box = Some(from);
                        for way in 1..shared.ways.len() {
                            pass(
                                &mut state,
                                &mut random,
                                &mut held,
                                &mut number,
                                (way, false),
                                bytes,
                            );
                        }
                    }
                    pass(
                        &mut state,
                        &mut random,
                        &mut held,
                        &mut number,
                        (index, is_to_box),
                        bytes,
                    );
                }
            }
        }
        let now = Instant::now();
        while held.peek().is_some_and(|Reverse(it)| it.0 <= now) {
            let Some(Reverse((_, _, way, is_to_box, bytes))) = held.pop() else { break };
            let way = &shared.ways[way];
            match shared.state().the_box {
                Some(the_box) if is_to_box => send(&way.to_box, &bytes, the_box),
                None if is_to_box => {}
                _ => send(&way.to_host, &bytes, way.host),
            }
        }
        if is_idle {
            std::thread::sleep(PAUSE);
        }
    }
}

/// Decides what becomes of a packet.
fn pass(
    state: &mut State,
    random: &mut ChaCha8Rng,
    held: &mut BinaryHeap<Held>,
    number: &mut u64,
    (way, is_to_box): (usize, bool),
    bytes: &[u8],
) {
    let Faults { lost, repeated, flipped, late, late_by } = state.faults[way];
    let now = Instant::now();
    let is_lost = random.random_bool(lost);
    if state.seen.len() < PACKETS_MAX {
        state.seen.push(Seen { at: now, way, is_to_box, bytes: bytes.to_vec(), is_lost });
    }
    if is_lost || held.len() > PACKETS_MAX {
        return;
    }
    for _ in 0..1 + usize::from(random.random_bool(repeated)) {
        let mut bytes = bytes.to_vec();
        if random.random_bool(flipped) && !bytes.is_empty() {
            let bit = random.random_range(0..8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        let due = if random.random_bool(late) { now + late_by } else { now };
        *number += 1;
        held.push(Reverse((due, *number, way, is_to_box, bytes)));
    }
}

/// Whoever it is for may be gone, or its buffer full.
fn send(socket: &UdpSocket, bytes: &[u8], to: SocketAddr) {
    let _ = socket.send_to(bytes, to);
}
