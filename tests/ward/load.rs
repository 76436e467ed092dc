//! A hundred boxes at 60 Hz, and what each of them costs.

use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use plumbline::packet::{Message, decode_datagram};
use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Reader};

use crate::bench::{Bench, wait_for};
use crate::boxes::{Boxes, RATE_HZ, serial_number};

/// How long every box sends, unless [`SECONDS`] says otherwise.
const SECONDS_USUALLY: u32 = 60;

/// Says how long every box sends.
const SECONDS: &str = "PLUMBLINE_WARD_SECONDS";

/// The costs of some boxes.
#[derive(Debug, Clone, Copy)]
struct Costs {
    boxes: f64,
    /// Of one core, while all boxes send and are recorded.
    cpu: f64,
    /// Resident memory at the end of that.
    memory_mb: f64,
    disk_bytes_s: f64,
    network_bytes_s: f64,
}

/// Processor time of a process, seconds, and its resident memory, megabytes.
fn used(child: &Child) -> (f64, f64) {
    let id = child.id();
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
    let ticks: f64 = fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap();
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap();
    let resident = status.lines().find(|it| it.starts_with("VmRSS")).unwrap();
    let kb: f64 = resident.split_whitespace().nth(1).unwrap().parse().unwrap();
    // A tick is a hundredth of a second on Linux, whatever the kernel's own is.
    (ticks / 100.0, kb / 1000.0)
}

/// The numbers of the frames in a trial, in the order of their arrival.
fn frames(folder: &Path) -> Vec<u32> {
    let mut reader = Reader::open(&folder.join("packets.bin")).unwrap();
    let mut frames = Vec::new();
    while let Some(entry) = reader.next_entry().unwrap() {
        if let Content::Raw(Raw::Datagram(bytes)) = entry.content
            && let Ok(packet) = decode_datagram(&bytes)
            && let Message::Pose(pose) = packet.message
        {
            frames.push(pose.sequence);
        }
    }
    frames
}

fn bytes_in(folder: &Path) -> u64 {
    let bytes = folder.read_dir().unwrap().map(|it| it.unwrap().metadata().unwrap().len());
    bytes.sum()
}

/// Bytes that this computer's loopback has carried.
fn carried() -> f64 {
    let path = "/sys/class/net/lo/statistics/rx_bytes";
    std::fs::read_to_string(path).unwrap().trim().parse().unwrap()
}

/// So many boxes are recorded; every pose is in the trials.
fn record(count: usize) -> Option<Costs> {
    let seconds = std::env::var(SECONDS).map_or(SECONDS_USUALLY, |it| it.parse().unwrap());
    let bench = Bench::new(count)?;
    let boxes = Boxes::switch_on(count, bench.host, 7);
    let gateway = bench.gateway("--record all --trial-seconds 3600 --every 10");
    let reader = bench.broker.reader();
    for number in 0..count {
        reader.wait(&format!("{}/state", serial_number(number)), |it| it["doing"] == "recording");
    }
    let all = seconds * RATE_HZ;
    boxes.stream(all);
    // The costs of the middle: all boxes send.
    let from = 5 * RATE_HZ;
    wait_for("the first seconds", || boxes.sent(0) >= from);
    let (begun, (cpu_s, _), sent, bytes) =
        (Instant::now(), used(&gateway.child), boxes.sent(0), carried());
    let give_up = Instant::now() + Duration::from_secs(600);
    while boxes.sent(0) < all - RATE_HZ {
        assert!(Instant::now() < give_up, "the boxes do not come to an end");
        std::thread::sleep(Duration::from_millis(100));
    }
    let (end_s, memory_mb) = used(&gateway.child);
    let lasted_s = begun.elapsed().as_secs_f64();
    // On a busy computer boxes send late; what they cost is counted by what they have sent.
    let sent_s = f64::from(boxes.sent(0) - sent) / f64::from(RATE_HZ);
    let network_bytes_s = (carried() - bytes) / sent_s;
    wait_for("the last frames", || boxes.has_sent_all());
    reader.wait("gateway/health", |it| it["frames"] == u64::from(all) * count as u64);
    let said = gateway.end();
    let mut disk_bytes = 0;
    for number in 0..count {
        let folders = bench.trials(number);
        let [folder] = &folders[..] else { panic!("{folders:?}\n{said}") };
        let mut frames = frames(folder);
        frames.sort_unstable();
        // Every one, and each once.
        assert!(frames.iter().copied().eq(0..all), "box {number}: {} of {all}", frames.len());
        disk_bytes += bytes_in(folder);
        let level = serial_number(number);
        let summary = reader.wait(&format!("{level}/summary"), |it| it["frames"] == all);
        assert_eq!(summary["frames_lost"], 0, "{level}");
        reader.wait(&format!("{level}/verdict"), |_| true);
    }
    let costs = Costs {
        boxes: count as f64,
        cpu: (end_s - cpu_s) / sent_s,
        memory_mb,
        disk_bytes_s: disk_bytes as f64 / f64::from(seconds),
        network_bytes_s,
    };
    println!(
        "{count} boxes, {all} frames of each, none lost; {sent_s:.0} s of frames in {lasted_s:.0} s: \
         {:.1} % of a core, {:.1} MB, disk {:.2} MB/s, loopback {:.2} MB/s",
        100.0 * costs.cpu,
        costs.memory_mb,
        1e-6 * costs.disk_bytes_s,
        1e-6 * costs.network_bytes_s
    );
    Some(costs)
}

#[test]
fn a_few_boxes_are_recorded_whole() {
    // As long as the tests of every day can be.
    let Some(bench) = Bench::new(5) else { return };
    let boxes = Boxes::switch_on(5, bench.host, 7);
    let gateway = bench.gateway("--record all");
    let reader = bench.broker.reader();
    for number in 0..5 {
        reader.wait(&format!("{}/state", serial_number(number)), |it| it["doing"] == "recording");
    }
    boxes.stream(2 * RATE_HZ);
    wait_for("the frames", || boxes.has_sent_all());
    reader.wait("gateway/health", |it| it["frames"] == u64::from(2 * RATE_HZ) * 5);
    gateway.end();
    for number in 0..5 {
        let folders = bench.trials(number);
        let mut frames = frames(&folders[0]);
        frames.sort_unstable();
        assert!(frames.into_iter().eq(0..2 * RATE_HZ), "box {number}");
    }
}

/// Minutes, alone on a quiet computer, with the programs as users have them: `cargo xtask test ward`.
#[test]
#[ignore = "takes minutes: cargo xtask test ward"]
fn a_hundred_boxes_cost_what_ten_cost_each_and_no_pose_is_lost() {
    let mut all = Vec::new();
    for count in [10, 30, 100] {
        let Some(costs) = record(count) else { return };
        all.push(costs);
    }
    let cpu = Line::of(&all, |it| it.cpu);
    let memory_mb = Line::of(&all, |it| it.memory_mb);
    println!("each further box: {:.3} % of a core, {:.2} MB", 100.0 * cpu.each, memory_mb.each);
    // The one in the middle lies where the other two say: each further box costs the same.
    let middle = &all[1];
    for (what, seen, line) in
        [("processor", middle.cpu, &cpu), ("memory", middle.memory_mb, &memory_mb)]
    {
        let expected = line.at(middle.boxes);
        let ratio = seen / expected;
        assert!((0.6..1.6).contains(&ratio), "{what}: {seen} at 30 boxes, {expected} expected");
    }
    project(&all, &cpu, &memory_mb);
}

/// What something costs by itself, and for each box.
struct Line {
    own: f64,
    each: f64,
}

impl Line {
    /// Through the costs of the fewest and of the most boxes.
    fn of(all: &[Costs], of: fn(&Costs) -> f64) -> Self {
        let (first, last) = (&all[0], &all[all.len() - 1]);
        let each = (of(last) - of(first)) / (last.boxes - first.boxes);
        Self { own: of(first) - each * first.boxes, each }
    }

    fn at(&self, boxes: f64) -> f64 {
        self.own + self.each * boxes
    }
}

/// A thousand boxes on paper, and what their number is limited by.
fn project(all: &[Costs], cpu: &Line, memory_mb: &Line) {
    const BOXES: f64 = 1000.0;
    /// The journal of each trial is brought to the disk twice a second.
    const SYNCS_PER_BOX: f64 = 2.0;
    let last = &all[all.len() - 1];
    let mb_s = |bytes_s: f64| 1e-6 * bytes_s / last.boxes * BOXES;
    let disk_mb_s = mb_s(last.disk_bytes_s);
    let full_at = (1.0 - cpu.own.max(0.0)) / cpu.each;
    println!("a thousand boxes, from these costs, all of them recorded:");
    println!("  processor  {:.2} cores", cpu.at(BOXES));
    println!("  memory     {:.0} MB", memory_mb.at(BOXES));
    println!("  network    {:.1} MB/s, both ways together", mb_s(last.network_bytes_s));
    println!("  disk       {disk_mb_s:.1} MB/s, {:.0} GB in a day", 86.4 * disk_mb_s);
    println!("  disk       {:.0} fdatasync a second", SYNCS_PER_BOX * BOXES);
    println!("one thread receives for all boxes: a core is full at {full_at:.0} boxes");
}
