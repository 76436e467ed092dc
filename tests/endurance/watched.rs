//! A box that is watched from outside: what it writes down, and its memory.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use plumbline::packet::Deframer;

use crate::judge::Judge;

/// A box that says nothing for this long has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Frames after which the box has all the memory that it needs.
pub const SETTLED: u64 = 10_000;

/// The process of a box; killed when the test leaves it behind.
pub struct TheBox(pub Child);

impl TheBox {
    /// Whether it has ended as it should.
    pub fn succeeds(&mut self) -> bool {
        self.0.wait().expect("it has ended").success()
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The memory of a process, in kilobytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Memory {
    /// Its own.
    pub own_kb: u64,
    /// With the parts of its program and of the libraries that it has read until then.
    pub resident_kb: u64,
}

impl Memory {
    fn of(child: &Child) -> Option<Self> {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
        let of = |name: &str| -> Option<u64> {
            let line = status.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().nth(1)?.parse().ok()
        };
        Some(Self { own_kb: of("RssAnon")?, resident_kb: of("VmRSS")? })
    }
}

/// The memory when the box had settled, and the most of later times; after how many frames each.
#[derive(Debug)]
pub struct Growth {
    pub settled: (u64, Memory),
    pub largest: (u64, Memory),
}

/// Judges what the box writes into `record`, until it has ended; `frames` are to come. Its memory is
/// looked at a hundred times.
pub fn watch(the_box: &mut TheBox, record: &Path, judge: &mut Judge, frames: u64) -> Growth {
    let child = &mut the_box.0;
    let began = Instant::now();
    let mut deframer: Deframer<512> = Deframer::new();
    let mut file = None;
    let mut bytes = vec![0; 1 << 16];
    let mut last = Instant::now();
    let (settled_at, every) = (SETTLED.min(frames / 10), (frames / 100).max(1));
    let (mut settled, mut largest, mut look_at) = (None, None, settled_at);
    loop {
        // Asked before the last look at the file: what it writes is then all there.
        let has_ended = child.try_wait().expect("it can be asked").is_some();
        if file.is_none() {
            file = File::open(record).ok();
        }
        let count = file.as_mut().map_or(0, |file| file.read(&mut bytes).expect("it can be read"));
        deframer.push(&bytes[..count], |packet| {
            judge.take(packet.expect("an intact frame").message);
        });
        if judge.seen >= look_at && judge.seen < frames {
            if let Some(memory) = Memory::of(child) {
                let now = (judge.seen, memory);
                let before: (u64, Memory) = *largest.get_or_insert(now);
                settled.get_or_insert(now);
                if memory.own_kb > before.1.own_kb {
                    largest = Some(now);
                }
            }
            if (look_at / every).is_multiple_of(5) {
                let seconds = began.elapsed().as_secs();
                println!("{} of {frames} frames after {seconds} s: {largest:?}", judge.seen);
            }
            look_at += every;
        }
        if count > 0 {
            last = Instant::now();
        } else if has_ended {
            break;
        } else {
            assert!(last.elapsed() < PATIENCE, "the box is silent after {} frames", judge.seen);
            std::thread::sleep(Duration::from_millis(2));
        }
    }
    println!("{} frames in {:.1} s", judge.seen, began.elapsed().as_secs_f64());
    let settled = settled.expect("its memory was looked at");
    Growth { settled, largest: largest.expect("as above") }
}
