//! A journal that was cut anywhere, as by a loss of power, with whatever a disk may have behind the cut:
//! nothing, zeros, noise, or another journal's blocks.
//!
//! What is read is what was written before the cut, to the entry; what was on the disk by then is among
//! it; and nothing else is.

use std::fs;
use std::path::Path;

use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Entry, Reader, Writer};
use plumbline_trial::mark::{Mark, Source};
use proptest::prelude::*;

use crate::laws::Tries;

/// Before the first entry.
const HEAD_BYTES: usize = 24;

/// Bytes with as many borders as one likes, and lengths at which their stuffing changes.
fn bytes() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![2 => Just(0), 1 => Just(0xff), 4 => any::<u8>()];
    let length = prop_oneof![6 => 0..40_usize, 2 => 225..270_usize, 1 => 0..2_049_usize];
    length.prop_flat_map(move |length| proptest::collection::vec(byte.clone(), length))
}

fn entries() -> impl Strategy<Value = Vec<Entry>> {
    let content = prop_oneof![
        6 => bytes().prop_map(|it| Content::Raw(Raw::Datagram(it))),
        2 => bytes().prop_map(|it| Content::Raw(Raw::Frame(it))),
        1 => ".{0,80}".prop_map(|it| Content::Mark(Mark::new(Source::Udp, &it))),
        1 => ".{0,200}".prop_map(Content::About),
        1 => ".{0,200}".prop_map(Content::Check),
        1 => any::<u64>().prop_map(Content::NotAuthentic),
    ];
    let entry = (any::<u64>(), content).prop_map(|(host_ns, content)| Entry { host_ns, content });
    proptest::collection::vec(entry, 0..12)
}

/// What lies behind the cut.
#[derive(Debug, Clone)]
enum Tail {
    Bytes(Vec<u8>),
    /// A journal of these entries, from somewhere on.
    OfAnother(Vec<Entry>, prop::sample::Index),
}

/// A journal as it was written.
struct Written {
    bytes: Vec<u8>,
    entries: Vec<Entry>,
    /// Where each entry ends.
    ends: Vec<usize>,
}

fn tails() -> impl Strategy<Value = Tail> {
    let bytes = prop_oneof![
        Just(Vec::new()),
        (1..4_096_usize).prop_map(|length| vec![0; length]),
        proptest::collection::vec(any::<u8>(), 1..4_096),
    ];
    let another = (entries(), any::<prop::sample::Index>());
    prop_oneof![
        3 => bytes.prop_map(Tail::Bytes),
        1 => another.prop_map(|(entries, from)| Tail::OfAnother(entries, from)),
    ]
}

fn written(entries: Vec<Entry>, path: &Path) -> Written {
    let _ = fs::remove_file(path);
    let mut writer = Writer::create(path).expect("a journal");
    let mut ends = Vec::new();
    for entry in &entries {
        writer.write(entry).expect("there is room");
        ends.push(fs::metadata(path).expect("a file").len() as usize);
    }
    Written { bytes: fs::read(path).expect("what was written"), entries, ends }
}

/// What must be read of these bytes, of which the first `own` are this journal's: the entries, and where
/// the last one ends.
fn expected<'a>(bytes: &[u8], own: usize, journal: &'a Written) -> (&'a [Entry], usize) {
    // A border behind the cut ends an entry that lacked nothing else.
    let is_there =
        |end: &&usize| **end <= own || (**end == own + 1 && bytes[own..].starts_with(&[0]));
    let count = journal.ends.iter().take_while(is_there).count();
    let used = if count == 0 { HEAD_BYTES } else { journal.ends[count - 1] };
    (&journal.entries[..count], used)
}

fn a_cut_gives_a_beginning(tries: Tries) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("packets.bin");
    tries.hold(
        "a journal cut at any place, with nothing, zeros, noise or another journal behind the cut",
        "each reads as the entries that were whole before the cut, and as nothing else",
        &(entries(), any::<prop::sample::Index>(), tails()),
        |(entries, cut, tail)| {
            let journal = written(entries, &path);
            let cut = cut.index(journal.bytes.len() + 1);
            let (tail, another) = match tail {
                Tail::Bytes(bytes) => (bytes, None),
                Tail::OfAnother(entries, from) => {
                    let another = written(entries, &path);
                    (another.bytes[from.index(another.bytes.len())..].to_vec(), Some(another))
                }
            };
            let bytes = [&journal.bytes[..cut], &tail].concat();
            let Ok(mut reader) = Reader::new(&bytes[..], "a journal".to_owned()) else {
                assert!(cut < HEAD_BYTES, "its head is there");
                return;
            };
            let mut read = Vec::new();
            while let Some(entry) = reader.next_entry().expect("memory can be read") {
                read.push(entry);
            }
            // Where only what all journals begin with is before the cut, the other one may be whole, and
            // is then all that there is.
            let (expected, used) = match another.as_ref().filter(|it| it.bytes == bytes) {
                Some(another) => (&another.entries[..], bytes.len()),
                None => expected(&bytes, cut, &journal),
            };
            assert_eq!(read, expected, "cut at {cut} of {}", journal.bytes.len());
            assert_eq!(reader.damaged_bytes(), (bytes.len() - used) as u64);
        },
    );
}

#[test]
fn a_journal_that_was_cut_is_the_beginning_of_what_was_written() {
    a_cut_gives_a_beginning(Tries::few(150));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_journal_that_was_cut_is_the_beginning_of_what_was_written_many_times() {
    a_cut_gives_a_beginning(Tries::many(30_000));
}
