//! B14: as many datagrams as one thread can send, at the box and at a host.

use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::packet::PROTOCOL_VERSION;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::{Bench, assert_whole};
use crate::relay::Relay;

/// Names the seconds that a flood lasts, for a longer one by hand.
const SECONDS: &str = "PLUMBLINE_FLOOD_SECONDS";

/// Datagrams a second: as many as the finding had.
const RATE: u64 = 50_000;

/// Memory that a program may take during a flood: what its buffers grow to once, and no more.
const GROWTH_KB: u64 = 6 * 1024;

fn seconds() -> u64 {
    std::env::var(SECONDS).ok().and_then(|it| it.parse().ok()).unwrap_or(5)
}

/// Sends junk until it is told to stop: noise, and what looks like each kind of packet. Returns the
/// number of datagrams.
fn flood(to: SocketAddr, stop: &Arc<AtomicBool>) -> JoinHandle<u64> {
    let stop = Arc::clone(stop);
    std::thread::spawn(move || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut junk = vec![0_u8; 300 * 64];
        random.fill(&mut junk[..]);
        for (index, datagram) in junk.chunks_mut(300).enumerate() {
            (datagram[0], datagram[1]) = (PROTOCOL_VERSION, index as u8 % 12);
        }
        let began = Instant::now();
        let mut sent = 0;
        while !stop.load(Ordering::Relaxed) {
            if sent > RATE * began.elapsed().as_millis() as u64 / 1000 {
                std::thread::sleep(Duration::from_micros(200));
                continue;
            }
            for datagram in junk.chunks(300) {
                let length = [300, 227, 60, 25][sent as usize % 4];
                sent += u64::from(socket.send_to(&datagram[..length], to).is_ok());
            }
        }
        sent
    })
}

fn flooded(is_box: bool) {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 21);
    let mut host = bench.receive(0, "trial", "--quiet");
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 60);
    let the_box_at = relay.the_box().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let target = if is_box { the_box_at } else { bench.hosts[0] };
    let memory = || [the_box.running.resident_kb(), host.resident_kb()];
    let flood = flood(target, &stop);
    // The sockets' buffers and the first of everything.
    std::thread::sleep(Duration::from_secs(1));
    let before = memory();
    std::thread::sleep(Duration::from_secs(seconds()));
    let after = memory();
    let journal = bench.read("trial/packets.bin").len();
    stop.store(true, Ordering::Relaxed);
    let sent = flood.join().unwrap();
    let poses = bench.recorded("trial").len();
    bench.wait_for_poses("trial", poses + 120);
    host.interrupt();
    let said = host.succeeds();
    the_box.end();
    println!("{sent} datagrams in {} s; {before:?} kB became {after:?} kB", seconds() + 1);
    let whole = assert_whole(&bench, "trial", "sent.bin");
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.frames, packets.lost), (whole as u64, 0), "{said}");
    assert_eq!((packets.sessions, packets.repeated), (1, 0), "{said}");
    for (before, after) in before.into_iter().zip(after) {
        assert!(after <= before + GROWTH_KB, "{before} kB became {after} kB");
    }
    // No junk is kept: a pose takes some 170 bytes of the journal, what it says besides some kB.
    assert!(journal < 100_000 + 300 * poses, "{journal} bytes for {poses} poses");
    // Far more than a host or a box ever gets, also where the machine is slow.
    assert!(sent >= 5_000 * seconds(), "{sent}");
}

#[test]
fn of_the_box() {
    flooded(true);
}

#[test]
fn of_a_host() {
    flooded(false);
}
