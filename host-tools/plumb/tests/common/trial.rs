//! A trial's folder as `plumb receive --out` leaves it, of positions that a test chooses.

use std::path::Path;

use plumbline::packet::{
    AnatomicalPoint, MarkedInstant, Message, PACKET_BYTES_MAX, Packet, PosePacket, TargetPacket,
    encode_datagram,
};
use plumbline_stream::fixture::adversity::hello_of;
use plumbline_stream::fixture::{START, packet};
use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Entry, Writer};
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::mark::{Mark, Source};

/// One frame: its number, when it was taken, and where the lower and the upper trunk were, along
/// AP, ML and SI.
pub struct Frame {
    pub sequence: u32,
    pub time_s: f64,
    pub lower_mm: Option<[f64; 3]>,
    pub upper_mm: Option<[f64; 3]>,
}

/// The box takes so long for each frame.
const LATENCY_US: u32 = 4000;

/// Then its packet is under way so long, which nothing tells: whatever is of this computer's clock, as a mark
/// is, seems to be earlier by as much.
const WAY_NS: u64 = 1_000_000;

const FIRST_CAPTURE_NS: u64 = 7_000_000_000;

/// Writes the folder; marks are a time and a label. No target's pose is in it.
pub fn write(folder: &Path, frames: &[Frame], marks: &[(f64, &str)]) {
    write_with(folder, frames, marks, |_| Vec::new());
}

/// As [`write`], with what the box tells of its targets in each frame.
pub fn write_with(
    folder: &Path,
    frames: &[Frame],
    marks: &[(f64, &str)],
    targets: impl Fn(&Frame) -> Vec<TargetPacket>,
) {
    std::fs::create_dir(folder).unwrap();
    let manifest = Manifest::begin(
        "2026-01-01T00:00:00Z".to_owned(),
        Some("p-01".to_owned()),
        Some("control".to_owned()),
        None,
        Zero::Mark,
    );
    manifest.write(folder).unwrap();
    let mut journal = Writer::create(&folder.join("packets.bin")).unwrap();
    let mut entries: Vec<Entry> = frames.iter().map(|frame| entry(frame, targets(frame))).collect();
    entries.extend(marks.iter().map(|(time_s, label)| Entry {
        host_ns: nanoseconds(*time_s) + WAY_NS,
        content: Content::Mark(Mark::new(Source::Key, label)),
    }));
    entries.sort_by_key(|entry| entry.host_ns);
    let hello = content(&hello_of("ward 3", START));
    journal.write(&Entry { host_ns: 0, content: hello }).unwrap();
    for entry in &entries {
        journal.write(entry).unwrap();
    }
}

fn entry(frame: &Frame, targets: Vec<TargetPacket>) -> Entry {
    let point = |position_mm: Option<[f64; 3]>| {
        let [ap_mm, ml_mm, si_mm] = position_mm?.map(|it| it as f32);
        Some(AnatomicalPoint { ap_mm, ml_mm, si_mm })
    };
    let message = Message::Pose(PosePacket {
        sequence: frame.sequence,
        capture_time_ns: FIRST_CAPTURE_NS + nanoseconds(frame.time_s),
        instant: MarkedInstant::Recording,
        latency_us: LATENCY_US,
        targets: targets.into_iter().collect(),
        upper_trunk: point(frame.upper_mm),
        lower_trunk: point(frame.lower_mm),
    });
    Entry {
        host_ns: nanoseconds(frame.time_s) + 1000 * u64::from(LATENCY_US) + WAY_NS,
        content: content(&packet(START, message)),
    }
}

/// What a recording keeps of a packet.
pub fn content(packet: &Packet) -> Content {
    let mut buffer = [0; PACKET_BYTES_MAX];
    let datagram = encode_datagram(packet.start, &packet.message, &mut buffer).unwrap();
    Content::Raw(Raw::Datagram(datagram.to_vec()))
}

fn nanoseconds(time_s: f64) -> u64 {
    (1e9 * time_s).round() as u64
}
