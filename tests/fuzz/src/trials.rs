//! The folder of a trial: journal, manifest and configurations, whatever has become of them.
//!
//! An input is a list of entries, of which the law makes a journal with right checksums, and of other
//! things that may happen to the folder: bytes of the journal that are damaged or missing, another text
//! of the manifest, a configuration. The packets of entries have right heads and checksums as well, which
//! the law makes, or are any bytes.
//!
//! Laws:
//! - The reader gives the entries that were not damaged, in their order; of a journal that was cut off
//!   anywhere it gives the entries before the cut; entries and damaged bytes are all the bytes that
//!   there are.
//! - A trial that can be opened has finite poses and times; its points are finite; so is what is
//!   restored from its journal.

use std::fs;
use std::path::Path;

use plumbline::packet::{FRAME_BYTES_MAX, document_crc, frame_packet};
use plumbline_files::text::printable;
use plumbline_trial::frame::Trunk;
use plumbline_trial::journal::{Content, Entry, Reader};
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::points::Points;
use plumbline_trial::test_trial::{Made, raw};
use plumbline_trial::{Trial, names};

use crate::input::{Input, put_block};
use crate::packets;

/// With a tag that changes no checksum.
const HEAD: &[u8] = b"PLUMBLINE JOURNAL 4\n\0\0\0\0";

const ENTRIES_MAX: usize = 256;

/// The steps of an input.
const ENTRY: u8 = 0;
const NOISE: u8 = 1;
const DAMAGE: u8 = 2;
const MANIFEST: u8 = 3;
const CONFIG: u8 = 4;
const CORRECTED: u8 = 5;
const PACKET: u8 = 6;
const STEPS: usize = 7;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let Tried { journal, whole, files } = Tried::of(Input::new(bytes));
    let entries = read(&journal);
    if let Some(whole) = whole {
        // One of a content that is none of its kind is left out, and damages no other.
        let alone = whole.iter().flat_map(|entry| read(&[HEAD, entry].concat()));
        assert_eq!(entries, alone.collect::<Vec<_>>(), "entries disturb each other");
    }
    let cut = usize::from(document_crc(bytes) as u16) % (journal.len() - HEAD.len() + 1);
    let before = read(&journal[..HEAD.len() + cut]);
    assert!(entries.starts_with(&before), "a cut at {cut} changes what is before it");
    folder(&journal, &files);
}

/// What an input makes of a folder.
struct Tried<'a> {
    journal: Vec<u8>,
    /// The entries of the journal, unless something else is in it.
    whole: Option<Vec<Vec<u8>>>,
    files: Vec<(&'static str, &'a [u8])>,
}

impl<'a> Tried<'a> {
    fn of(mut input: Input<'a>) -> Self {
        let mut tried = Self { journal: HEAD.to_vec(), whole: Some(Vec::new()), files: Vec::new() };
        let mut host_ns = 0_u64;
        for _ in 0..ENTRIES_MAX {
            if input.is_empty() {
                break;
            }
            tried.step(&mut input, &mut host_ns);
        }
        tried
    }

    fn step(&mut self, input: &mut Input<'a>, host_ns: &mut u64) {
        let journal = &mut self.journal;
        match input.below(STEPS) as u8 {
            step @ (ENTRY | PACKET) => {
                let kind = 1 + input.byte() % 6;
                *host_ns = host_ns.saturating_add(u64::from(input.word()) * 100_000);
                let entry = if step == ENTRY {
                    entry(kind, *host_ns, input.block())
                } else {
                    let start = input.number();
                    entry(1 + kind % 2, *host_ns, &said(1 + kind % 2, start, input.block()))
                };
                if let Some(whole) = &mut self.whole {
                    whole.push(entry.clone());
                }
                journal.extend(entry);
            }
            NOISE => {
                self.whole = None;
                journal.extend(input.block());
            }
            DAMAGE => {
                self.whole = None;
                let back = 1 + usize::from(input.word()) % journal.len();
                let at = journal.len() - back;
                // The head stays: without it nothing is read.
                if at >= HEAD.len() {
                    let new = input.byte();
                    if new == 1 { journal.truncate(at) } else { journal[at] ^= new }
                }
            }
            MANIFEST => self.files.push((names::MANIFEST, input.block())),
            CONFIG => self.files.push((names::CONFIG, input.block())),
            CORRECTED => self.files.push((names::CORRECTED, input.block())),
            _ => unreachable!("there are no other steps"),
        }
    }
}

/// A packet with this body, as a datagram (1) or as a frame of a serial line (2).
fn said(kind: u8, start: u32, body: &[u8]) -> Vec<u8> {
    let packet = packets::around(start, &body[..body.len().min(packets::BODY_BYTES_MAX)]);
    let mut buffer = [0; FRAME_BYTES_MAX];
    match kind {
        1 => packet,
        _ => frame_packet(&packet, &mut buffer).expect("it is short enough").to_vec(),
    }
}

/// An entry between its delimiters.
fn entry(kind: u8, host_ns: u64, content: &[u8]) -> Vec<u8> {
    let mut entry = vec![kind];
    entry.extend(host_ns.to_le_bytes());
    entry.extend(content);
    entry.extend(document_crc(&entry).to_le_bytes());
    [&[0], &cobs::encode_vec(&entry)[..], &[0]].concat()
}

fn read(journal: &[u8]) -> Vec<Entry> {
    let mut reader = Reader::new(journal, "journal".to_owned()).expect("it begins as a journal");
    let mut entries = Vec::new();
    while let Some(entry) = reader.next_entry().expect("memory can be read") {
        entries.push(entry);
        assert!(reader.damaged_bytes() <= journal.len() as u64);
    }
    // The shortest entry: a kind, a time and a checksum, one byte more for stuffing, two borders.
    assert!(entries.len() * 15 <= journal.len());
    entries
}

fn folder(journal: &[u8], files: &[(&str, &[u8])]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).expect("a temporary file");
    };
    write(names::JOURNAL, journal);
    for (name, bytes) in files {
        write(name, bytes);
    }
    if !files.iter().any(|(name, _)| *name == names::MANIFEST) {
        restored(folder.path());
    }
    let Ok(trial) = Trial::open(folder.path()) else { return };
    opened(&trial);
}

/// A folder whose manifest is lost.
fn restored(folder: &Path) {
    let Ok((manifest, _)) = Manifest::restore(folder) else { return };
    manifest.write(folder).expect("what is restored can be written");
    let again = Manifest::read(folder).expect("and read");
    assert_eq!(again, manifest, "what is restored is read as something else");
}

fn opened(trial: &Trial) {
    for frame in &trial.frames {
        assert!(frame.time_s.is_finite());
        for trunk in Trunk::ALL {
            if let Some(point) = frame.point(trunk) {
                let numbers = point.position_mm.iter().chain([&point.time_s]);
                assert!(numbers.copied().all(f64::is_finite), "{point:?}");
            }
            if let Some(pose) = frame.cam_from_target(trunk) {
                assert!(pose.translation_mm.iter().all(|it| it.is_finite()), "{pose:?}");
            }
        }
    }
    assert!(trial.length_s() >= 0.0, "{} s", trial.length_s());
    assert!(trial.rate_hz().is_none_or(|it| it.is_finite() && it > 0.0), "{:?}", trial.rate_hz());
    for warning in &trial.warnings {
        assert_eq!(printable(warning), *warning, "a warning would disturb a terminal");
    }
    if let Some(verdict) = &trial.manifest.verdict {
        let _ = (verdict.grade(), verdict.lines());
    }
    for zero in [Zero::Start, Zero::Mark, Zero::Onset] {
        let Ok(points) = Points::of(trial, zero) else { continue };
        for point in &points.points {
            assert!(point.series.time_s().iter().all(|it| it.is_finite()));
            assert!(point.series.rate_hz().is_finite());
        }
    }
}

/// A step that adds an entry.
fn put_entry(seed: &mut Vec<u8>, kind: u8, after_us: u16, content: &[u8]) {
    seed.extend([ENTRY, kind - 1]);
    seed.extend((after_us / 100).to_le_bytes());
    put_block(seed, content);
}

/// Short trials: good, damaged, with every kind of message, and with other files.
pub fn seeds() -> Vec<Vec<u8>> {
    let config = plumbline_stream::fixture::config();
    let made = Made::of(&config, 40);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path().join("trial");
    made.write(&folder);
    let file = |name: &str| fs::read(folder.join(name)).expect("a trial has it");
    let entries = read(&file(names::JOURNAL));
    let is_said = |entry: &&Entry| !matches!(entry.content, Content::Raw(_) | Content::Mark(_));
    let mut good = Vec::new();
    entries.iter().for_each(|entry| put(&mut good, &entry.content));
    let mut said = Vec::new();
    entries.iter().filter(is_said).for_each(|entry| put(&mut said, &entry.content));
    let mut every = said.clone();
    packets::messages().iter().for_each(|message| put(&mut every, &raw(message)));
    let damaged = [&good[..], &[DAMAGE, 200, 0, 7, DAMAGE, 90, 1, 1]].concat();
    let mut noisy = vec![NOISE];
    put_block(&mut noisy, b"\0\x03abc\0\0");
    let mut with_files = said;
    for (step, name) in
        [(CONFIG, names::CONFIG), (CORRECTED, names::CONFIG), (MANIFEST, names::MANIFEST)]
    {
        with_files.push(step);
        put_block(&mut with_files, &file(name));
    }
    vec![good, every, damaged, noisy, with_files]
}

fn put(seed: &mut Vec<u8>, content: &Content) {
    use plumbline_stream::transport::Raw;
    match content {
        Content::Raw(Raw::Datagram(packet)) => put_packet(seed, packet),
        Content::Raw(Raw::Frame(bytes)) => put_entry(seed, 2, 16_600, bytes),
        Content::Mark(mark) => put_entry(seed, 3, 0, mark.text().as_bytes()),
        Content::About(text) => put_entry(seed, 4, 0, text.as_bytes()),
        Content::Check(text) => put_entry(seed, 5, 0, text.as_bytes()),
        Content::NotAuthentic(count) => put_entry(seed, 6, 0, &count.to_le_bytes()),
    }
}

/// A step that adds an entry with a packet.
fn put_packet(seed: &mut Vec<u8>, packet: &[u8]) {
    let (start, body) = packets::parts(packet);
    assert_eq!(said(1, start, body), packet, "its body makes another packet");
    seed.extend([PACKET, 1]);
    seed.extend(166_u16.to_le_bytes());
    seed.extend(start.to_le_bytes());
    put_block(seed, body);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Otherwise nothing is tried but how folders are refused.
    #[test]
    fn the_seeds_are_trials() {
        let folder = tempfile::tempdir().unwrap();
        let seeds = seeds();
        let Tried { journal, whole, .. } = Tried::of(Input::new(&seeds[0]));
        assert_eq!(read(&journal).len(), whole.unwrap().len());
        assert!(read(&journal).len() > 40);
        fs::write(folder.path().join(names::JOURNAL), &journal).unwrap();
        restored(folder.path());
        assert_eq!(Trial::open(folder.path()).unwrap().frames.len(), 40);
    }
}
