//! The folder of a trial: journal, manifest and configurations, whatever has become of them.
//!
//! An input is a list of entries, of which the law makes a journal with right checksums, and of other
//! things that may happen to the folder: bytes of the journal that are damaged or missing, another text
//! of the manifest, a configuration.
//!
//! Laws:
//! - The reader gives the entries that were not damaged, in their order; of a journal that was cut off
//!   anywhere it gives the entries before the cut; entries and damaged bytes are all the bytes that
//!   there are.
//! - A trial that can be opened has finite poses and times; its points are finite; so is what is
//!   restored from its journal.

use std::fs;
use std::path::Path;

use plumbline::packet::document_crc;
use plumbline_files::text::printable;
use plumbline_trial::frame::Trunk;
use plumbline_trial::journal::{Content, Entry, Reader};
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::points::Points;
use plumbline_trial::test_trial::{Made, raw};
use plumbline_trial::{Trial, names};

use crate::input::{Input, put_block};
use crate::packets;

const MAGIC: &[u8] = b"PLUMBLINE JOURNAL 3\n";

const ENTRIES_MAX: usize = 256;

/// The steps of an input.
const ENTRY: u8 = 0;
const NOISE: u8 = 1;
const DAMAGE: u8 = 2;
const MANIFEST: u8 = 3;
const CONFIG: u8 = 4;
const CORRECTED: u8 = 5;
const STEPS: usize = 6;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    let mut journal = MAGIC.to_vec();
    let mut files = Vec::new();
    let mut host_ns = 0_u64;
    let mut whole = Vec::new();
    let mut is_whole = true;
    for _ in 0..ENTRIES_MAX {
        if input.is_empty() {
            break;
        }
        match input.below(STEPS) as u8 {
            ENTRY => {
                let kind = 1 + input.byte() % 6;
                host_ns = host_ns.saturating_add(u64::from(input.word()) * 100_000);
                let content = input.block();
                let entry = entry(kind, host_ns, content);
                whole.push(entry.clone());
                journal.extend(entry);
            }
            NOISE => {
                is_whole = false;
                journal.extend(input.block());
            }
            DAMAGE => {
                is_whole = false;
                let back = 1 + usize::from(input.word()) % journal.len();
                let at = journal.len() - back;
                // The head stays: without it nothing is read.
                if at >= MAGIC.len() {
                    let new = input.byte();
                    if new == 1 { journal.truncate(at) } else { journal[at] ^= new }
                }
            }
            MANIFEST => files.push((names::MANIFEST, input.block())),
            CONFIG => files.push((names::CONFIG, input.block())),
            _ => files.push((names::CORRECTED, input.block())),
        }
    }
    let entries = read(&journal);
    if is_whole {
        // One of a content that is none of its kind is left out, and damages no other.
        let alone = whole.iter().flat_map(|entry| read(&[MAGIC, entry].concat()));
        assert_eq!(entries, alone.collect::<Vec<_>>(), "entries disturb each other");
    }
    let cut = usize::from(document_crc(bytes) as u16) % (journal.len() - MAGIC.len() + 1);
    let before = read(&journal[..MAGIC.len() + cut]);
    assert!(entries.starts_with(&before), "a cut at {cut} changes what is before it");
    folder(&journal, &files);
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
        Content::Raw(Raw::Datagram(bytes)) => put_entry(seed, 1, 16_600, bytes),
        Content::Raw(Raw::Frame(bytes)) => put_entry(seed, 2, 16_600, bytes),
        Content::Mark(mark) => put_entry(seed, 3, 0, mark.text().as_bytes()),
        Content::About(text) => put_entry(seed, 4, 0, text.as_bytes()),
        Content::Check(text) => put_entry(seed, 5, 0, text.as_bytes()),
        Content::NotAuthentic(count) => put_entry(seed, 6, 0, &count.to_le_bytes()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Otherwise nothing is tried but how folders are refused.
    #[test]
    fn the_seeds_are_trials() {
        let folder = tempfile::tempdir().unwrap();
        let seed = seeds().swap_remove(0);
        let mut input = &seed[..];
        let mut journal = MAGIC.to_vec();
        while let [ENTRY, kind, _, _, ..] = input {
            let mut content = Input::new(&input[4..]);
            journal.extend(entry(kind + 1, 0, content.block()));
            input = content.rest();
        }
        assert!(read(&journal).len() > 40);
        fs::write(folder.path().join(names::JOURNAL), &journal).unwrap();
        restored(folder.path());
        assert_eq!(Trial::open(folder.path()).unwrap().frames.len(), 40);
    }
}
