//! `packets.bin`: everything that came from the box, as it came and when; the marks; and what was said
//! of the trial, so that `trial.toml` can be made again.
//!
//! ```text
//! "PLUMBLINE JOURNAL 4\n", tag (4 bytes)
//! entry: 0, COBS of [kind (1 byte), time (8), content, CRC-32 of all of these xor tag (4)], 0
//! ```
//!
//! Numbers are little endian; the time is in nanoseconds since the recording began, by this
//! computer's monotonic clock. The tag is drawn at random: where a disk that has lost power shows, behind
//! what it has kept, blocks of another journal that was deleted, no entry of that one counts. Consistent overhead byte stuffing (COBS; Cheshire and Baker, 1999)
//! leaves no zero in an entry, so that a zero is always a border. An entry that a crash has cut off,
//! or that a disk has damaged, is left out, and reading goes on at the next border: a damaged byte
//! costs the entry that it is in and no other, wherever it is. Each byte is looked at four times at
//! most, whatever the file holds: twice for a border, once to unstuff it, once for its checksum.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use plumbline::packet::document_crc;
use plumbline_files::BadInput;
use plumbline_stream::transport::Raw;

use super::mark::Mark;

const MAGIC: &[u8] = b"PLUMBLINE JOURNAL 4\n";

/// The beginning of files of every version.
const ANY_MAGIC: &[u8] = b"PLUMBLINE JOURNAL ";

/// What each checksum of a journal is combined with.
type Tag = [u8; 4];

const DELIMITER: u8 = 0;

const HEAD_BYTES: usize = 9;
const CRC_BYTES: usize = 4;

/// No entry is longer: longer datagrams are cut, and are none of our packets.
pub(crate) const CONTENT_BYTES_MAX: usize = 2048;

/// The longest entry without its two delimiters.
const STUFFED_BYTES_MAX: usize =
    cobs::max_encoding_length(HEAD_BYTES + CONTENT_BYTES_MAX + CRC_BYTES);

/// The journal is brought to the disk at least this often. A loss of power may cost one second;
/// this is half of it.
const SYNC_EVERY: Duration = Duration::from_millis(500);

/// What an entry holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Content {
    /// Bytes from the box.
    Raw(Raw),
    /// A mark.
    Mark(Mark),
    /// What was said of the trial: the manifest that is to be written if `trial.toml` is lost. The
    /// latest counts.
    About(String),
    /// One check of the box that was not passed, likewise for `trial.toml`. All count.
    Check(String),
    /// The number of packets until now that came damaged or were not the box's. They are counted
    /// and not kept. The latest counts.
    NotAuthentic(u64),
}

/// One entry.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Time since the recording began.
    pub host_ns: u64,
    /// What came at that time.
    pub content: Content,
}

impl Entry {
    fn encode(&self, tag: Tag) -> Vec<u8> {
        let (kind, content) = match &self.content {
            Content::Raw(Raw::Datagram(bytes)) => (1, Cow::from(bytes)),
            Content::Raw(Raw::Frame(bytes)) => (2, Cow::from(bytes)),
            Content::Mark(mark) => (3, Cow::from(mark.text().into_bytes())),
            Content::About(text) => (4, Cow::from(text.as_bytes())),
            Content::Check(text) => (5, Cow::from(text.as_bytes())),
            Content::NotAuthentic(count) => (6, Cow::from(count.to_le_bytes().to_vec())),
        };
        let content = &content[..content.len().min(CONTENT_BYTES_MAX)];
        let mut entry = vec![kind];
        entry.extend(self.host_ns.to_le_bytes());
        entry.extend(content);
        entry.extend(checksum(&entry, tag));
        let stuffed = cobs::encode_vec(&entry);
        [&[DELIMITER], &stuffed[..], &[DELIMITER]].concat()
    }

    /// The entry between two delimiters.
    fn decode(stuffed: &mut [u8], tag: Tag) -> Option<Self> {
        let length = cobs::decode_in_place(stuffed).ok()?;
        let (covered, crc) = stuffed[..length].split_last_chunk::<CRC_BYTES>()?;
        let (&[kind, ref time @ ..], content) = covered.split_first_chunk::<HEAD_BYTES>()?;
        if checksum(covered, tag) != *crc {
            return None;
        }
        let content = match kind {
            1 => Content::Raw(Raw::Datagram(content.to_vec())),
            2 => Content::Raw(Raw::Frame(content.to_vec())),
            3 => Content::Mark(Mark::read(std::str::from_utf8(content).ok()?)?),
            4 => Content::About(String::from_utf8(content.to_vec()).ok()?),
            5 => Content::Check(String::from_utf8(content.to_vec()).ok()?),
            6 => Content::NotAuthentic(u64::from_le_bytes(content.try_into().ok()?)),
            _ => return None,
        };
        Some(Self { host_ns: u64::from_le_bytes(*time), content })
    }
}

fn checksum(covered: &[u8], tag: Tag) -> [u8; CRC_BYTES] {
    (document_crc(covered) ^ u32::from_le_bytes(tag)).to_le_bytes()
}

/// Writes a journal.
pub struct Writer {
    file: File,
    tag: Tag,
    place: String,
    keeper: Keeper,
}

impl Writer {
    /// A new journal.
    ///
    /// # Errors
    /// When it exists, or cannot be written, or the operating system gives no random bytes.
    pub fn create(path: &Path) -> Result<Self, BadInput> {
        let place = path.display().to_string();
        let failed = |error| BadInput::io(&place, &error);
        let mut file = plumbline_files::create(path, false)?;
        let mut tag = Tag::default();
        getrandom::fill(&mut tag).map_err(|error| failed(error.into()))?;
        file.write_all(&[MAGIC, &tag].concat()).map_err(failed)?;
        let keeper = file.try_clone().and_then(Keeper::start).map_err(failed)?;
        Ok(Self { file, tag, place, keeper })
    }

    /// Adds an entry. From now on it survives the end of this program, and within half a second
    /// also a loss of power.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays.
    pub fn write(&mut self, entry: &Entry) -> Result<(), BadInput> {
        let written = self.keeper.failure().map_or(Ok(()), Err);
        let written = written.and_then(|()| self.file.write_all(&entry.encode(self.tag)));
        written.map_err(|error| BadInput::io(&self.place, &error))
    }

    /// Brings all entries to the disk now.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn sync(&mut self) -> Result<(), BadInput> {
        self.file.sync_data().map_err(|error| BadInput::io(&self.place, &error))
    }
}

/// Brings a file to the disk periodically, in a thread of its own: a disk may take seconds, and a
/// serial line does not wait. The thread ends when this is dropped.
struct Keeper {
    /// Dropped with this; then the thread ends.
    _held: mpsc::Sender<()>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl Keeper {
    fn start(file: File) -> io::Result<Self> {
        let (held, is_held) = mpsc::channel::<()>();
        let thread =
            thread::Builder::new().name("journal to disk".to_owned()).spawn(move || {
                while let Err(RecvTimeoutError::Timeout) = is_held.recv_timeout(SYNC_EVERY) {
                    file.sync_data()?;
                }
                Ok(())
            })?;
        Ok(Self { _held: held, thread: Some(thread) })
    }

    /// Why the file could not be brought to the disk; reported once.
    fn failure(&mut self) -> Option<io::Error> {
        let ended = self.thread.take_if(|thread| thread.is_finished())?;
        ended.join().ok()?.err()
    }
}

/// Reads a journal, entry by entry, in little memory.
pub struct Reader<R: Read> {
    source: BufReader<R>,
    tag: Tag,
    place: String,
    /// What lies between two delimiters.
    stuffed: Vec<u8>,
    /// Bytes that were read.
    read: u64,
    /// Those of them that belong to an entry.
    entries: u64,
    /// Bytes that were decoded, of which an entry may have come.
    #[cfg(test)]
    decoded: u64,
}

impl Reader<File> {
    /// Opens a journal.
    ///
    /// # Errors
    /// When it cannot be read, or is not a journal.
    pub fn open(path: &Path) -> Result<Self, BadInput> {
        let place = path.display().to_string();
        let file = File::open(path).map_err(|error| BadInput::io(&place, &error))?;
        Self::new(file, place)
    }
}

impl<R: Read> Reader<R> {
    /// Reads from a source that `place` names in errors.
    ///
    /// # Errors
    /// When it cannot be read, or does not begin as a journal.
    pub fn new(source: R, place: String) -> Result<Self, BadInput> {
        let mut source = BufReader::with_capacity(1 << 16, source);
        let mut head = Vec::new();
        (&mut source)
            .take((MAGIC.len() + size_of::<Tag>()) as u64)
            .read_to_end(&mut head)
            .map_err(|error| BadInput::io(&place, &error))?;
        let tag = head.strip_prefix(MAGIC).and_then(|tag| Tag::try_from(tag).ok());
        let Some(tag) = tag else {
            let is_other = head.starts_with(ANY_MAGIC) && !head.starts_with(MAGIC);
            let (found, remedy) = if is_other {
                (
                    "it is a journal of another version of this program",
                    "read it with the version that wrote it",
                )
            } else {
                (
                    "it is not a Plumbline journal",
                    "give the folder that `plumb receive --out` has made",
                )
            };
            return Err(BadInput::whole(place, found, remedy));
        };
        Ok(Self {
            source,
            tag,
            place,
            stuffed: Vec::new(),
            read: 0,
            entries: 0,
            #[cfg(test)]
            decoded: 0,
        })
    }

    /// The next entry; `None` at the end.
    ///
    /// # Errors
    /// When the disk cannot be read.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, BadInput> {
        loop {
            let is_bordered = self.next_border().map_err(|it| BadInput::io(&self.place, &it))?;
            let length = self.stuffed.len() as u64;
            if length == 0 {
                return Ok(None);
            }
            if !is_bordered {
                continue;
            }
            #[cfg(test)]
            {
                self.decoded += length;
            }
            if let Some(entry) = Entry::decode(&mut self.stuffed, self.tag) {
                self.entries += length + 2;
                return Ok(Some(entry));
            }
        }
    }

    /// The number of bytes read so far that belong to no entry, such as those of a last one that was
    /// cut off.
    #[must_use]
    pub fn damaged_bytes(&self) -> u64 {
        self.read.saturating_sub(self.entries)
    }

    /// Reads what lies before the next delimiter or, without one, before the end; nothing at the
    /// end. False when it cannot be an entry.
    fn next_border(&mut self) -> io::Result<bool> {
        self.skip_delimiters()?;
        self.stuffed.clear();
        loop {
            let buffer = self.source.fill_buf()?;
            if buffer.is_empty() {
                return Ok(false);
            }
            let border = buffer.iter().position(|byte| *byte == DELIMITER);
            let part = border.unwrap_or(buffer.len());
            // One byte more than an entry has shows that this is none.
            let room = STUFFED_BYTES_MAX + 1 - self.stuffed.len();
            self.stuffed.extend_from_slice(&buffer[..part.min(room)]);
            let used = part + usize::from(border.is_some());
            self.source.consume(used);
            self.read += used as u64;
            if border.is_some() {
                return Ok(self.stuffed.len() <= STUFFED_BYTES_MAX);
            }
        }
    }

    /// A disk that has lost power may have left millions of zeros.
    fn skip_delimiters(&mut self) -> io::Result<()> {
        loop {
            let buffer = self.source.fill_buf()?;
            let delimiters = buffer.iter().take_while(|byte| **byte == DELIMITER).count();
            let is_over = delimiters == 0 || delimiters < buffer.len();
            self.source.consume(delimiters);
            self.read += delimiters as u64;
            if is_over {
                return Ok(());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline_test_support::mutations;

    use super::*;
    use crate::mark::Source;

    const TAG: Tag = *b"tag.";

    /// What a journal begins with.
    const HEAD: &[u8] = b"PLUMBLINE JOURNAL 4\ntag.";

    fn entries() -> Vec<Entry> {
        (0..400_u64)
            .map(|at| Entry {
                host_ns: at * 16_666_667,
                content: match at % 6 {
                    0 => Content::Mark(Mark::new(Source::Key, "stands")),
                    1 => Content::Raw(Raw::Frame(vec![at as u8 | 1; 200])),
                    2 => Content::About("format = 2\n".to_owned()),
                    3 => Content::Check("subject = \"rate\"\n".to_owned()),
                    _ => Content::Raw(Raw::Datagram(vec![at as u8; at as usize % 254])),
                },
            })
            .collect()
    }

    fn bytes(entries: &[Entry]) -> Vec<u8> {
        entries.iter().fold(HEAD.to_vec(), |bytes, entry| [bytes, entry.encode(TAG)].concat())
    }

    fn read(bytes: &[u8]) -> (Vec<Entry>, u64) {
        let mut reader = Reader::new(bytes, "packets.bin".into()).unwrap();
        let mut entries = Vec::new();
        while let Some(entry) = reader.next_entry().unwrap() {
            entries.push(entry);
        }
        (entries, reader.damaged_bytes())
    }

    #[test]
    fn what_was_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("packets.bin");
        let mut writer = Writer::create(&path).unwrap();
        for entry in entries() {
            writer.write(&entry).unwrap();
        }
        writer.sync().unwrap();
        assert_eq!(read(&std::fs::read(&path).unwrap()), (entries(), 0));
        assert!(Writer::create(&path).is_err(), "a journal is never overwritten");
    }

    #[test]
    fn entries_of_every_length_come_back() {
        for fill in [0, 1, 0xff] {
            for length in 0..=CONTENT_BYTES_MAX {
                let host_ns = u64::from_le_bytes([fill; 8]);
                let content = Content::Raw(Raw::Datagram(vec![fill; length]));
                let entry = Entry { host_ns, content };
                let bytes = entry.encode(TAG);
                let (_, stuffed) = bytes.split_first().unwrap();
                assert_eq!(stuffed.iter().position(|it| *it == DELIMITER), Some(stuffed.len() - 1));
                assert!(stuffed.len() <= STUFFED_BYTES_MAX + 1, "{length}");
                assert_eq!(read(&[HEAD, &bytes].concat()), (vec![entry], 0), "{length}");
            }
        }
    }

    #[test]
    fn a_cut_costs_the_entry_that_it_hits_and_no_other() {
        let (entries, whole) = (entries(), bytes(&entries()));
        let (mut start, mut at) = (HEAD.len(), 0);
        for cut in HEAD.len()..whole.len() {
            if cut >= start + entries[at].encode(TAG).len() {
                start += entries[at].encode(TAG).len();
                at += 1;
            }
            // Every place in some entries; elsewhere now and then, for the time it takes.
            if cut % 101 == 0 || at < 5 {
                let expected = (entries[..at].to_vec(), (cut - start) as u64);
                assert_eq!(read(&whole[..cut]), expected, "cut at {cut}");
            }
        }
    }

    #[test]
    fn damage_costs_the_entry_that_it_hits_and_no_other() {
        let (entries, whole) = (entries(), bytes(&entries()));
        for place in (HEAD.len()..whole.len()).step_by(97) {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x40;
            let (read, lost) = read(&damaged);
            assert_eq!(read.len(), entries.len() - 1, "at {place}");
            assert!(read.iter().all(|entry| entries.contains(entry)) && lost > 0);
        }
    }

    #[test]
    fn what_a_disk_has_kept_of_another_journal_does_not_count() {
        let old: Vec<u8> = entries().iter().flat_map(|it| it.encode(*b"old.")).collect();
        let (kept, cut) = (bytes(&entries()[..3]), 100);
        let file = [&kept, &old[..cut], &old].concat();
        assert_eq!(read(&file), (entries()[..3].to_vec(), (cut + old.len()) as u64));
        let folder = tempfile::tempdir().unwrap();
        let tags = ["one", "other"].map(|name| {
            let path = folder.path().join(name);
            drop(Writer::create(&path).unwrap());
            std::fs::read(path).unwrap()[MAGIC.len()..].to_vec()
        });
        assert_ne!(tags[0], tags[1], "by chance only once in four thousand million times");
    }

    fn entry_of(content: Vec<u8>) -> Vec<u8> {
        Entry { host_ns: 7, content: Content::Raw(Raw::Datagram(content)) }.encode(TAG)
    }

    /// No file costs more than its bytes, and what follows the worst damage is found.
    #[test]
    fn damage_is_skipped_in_time_linear_in_its_length() {
        const DAMAGED: usize = 1 << 20;
        let last = entry_of(vec![0; 300]);
        // Each byte a length, a delimiter, or the beginning of an entry that nearly agrees.
        let spoiled = {
            let mut entry = entry_of(vec![1; CONTENT_BYTES_MAX]);
            let middle = entry.len() / 2;
            entry[middle] ^= 2;
            entry
        };
        let worst: [(&str, Vec<u8>); 6] = [
            ("zeros", vec![0; DAMAGED]),
            ("ones", vec![1; DAMAGED]),
            ("the longest runs", vec![0xff; DAMAGED]),
            ("runs as long as an entry", [vec![1; STUFFED_BYTES_MAX], vec![0]].concat()),
            ("heads", b"\x01\x00\x00\x00\x00\x00\x00\x00\x08".to_vec()),
            ("entries with a flipped bit", spoiled),
        ];
        for (name, pattern) in worst {
            let damage: Vec<u8> = pattern.iter().copied().cycle().take(DAMAGED).collect();
            let file = [HEAD, &damage, &last].concat();
            let mut reader = Reader::new(&file[..], "packets.bin".into()).unwrap();
            let found = reader.next_entry().unwrap();
            // A last run without a border of its own takes the entry's first one.
            assert!(found.is_some_and(|entry| entry.encode(TAG) == last), "{name}");
            assert_eq!(reader.next_entry().unwrap(), None, "{name}");
            assert_eq!(reader.damaged_bytes(), DAMAGED as u64, "{name}");
            // Decoding looks at each byte three times, and reading once.
            let examined = reader.read + 3 * reader.decoded;
            assert!(examined <= 4 * file.len() as u64, "{name}: {examined}");
        }
    }

    #[test]
    fn no_bytes_make_the_reader_panic() {
        let whole = bytes(&entries()[..20]);
        for mutated in mutations(&whole[HEAD.len()..], 3_000) {
            let (entries, damaged) = read(&[HEAD, &mutated].concat());
            let there: usize = entries.iter().map(|entry| entry.encode(TAG).len()).sum();
            // Where one of two delimiters is missing, both entries count the other.
            let counted = there as u64 + damaged - mutated.len() as u64;
            assert!(counted <= entries.len() as u64, "{counted}");
        }
    }

    #[test]
    fn what_is_no_journal_is_refused() {
        let old = Reader::new(&b"PLUMBLINE JOURNAL 1\n\x01"[..], "packets.bin".into());
        let error = old.err().unwrap().to_string();
        assert!(error.contains("another version") && error.contains("version that"), "{error}");
        // The last one has lost all but its first line.
        for bytes in [&b""[..], b"PLUMBLINE", b"frame,time_s\n0,0.0\n", MAGIC] {
            let error = Reader::new(bytes, "packets.bin".into()).err().unwrap().to_string();
            assert!(error.contains("packets.bin") && error.contains("plumb receive"), "{error}");
        }
    }
}
