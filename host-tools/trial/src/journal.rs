//! `packets.bin`: everything that came from the box, as it came and when; the marks; and what was said
//! of the trial, so that `trial.toml` can be made again.
//!
//! ```text
//! "PLUMBLINE JOURNAL 1\n"
//! entry: kind (1 byte), time (8), length (2), that number of bytes, CRC-32 of all of these (4)
//! ```
//!
//! Numbers are little endian; the time is in nanoseconds since the recording began, by this
//! computer's monotonic clock. An entry that a crash has cut off, or that a disk has damaged, is
//! left out, and reading goes on at the next one whose checksum agrees.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use plumbline::packet::document_crc;
use plumbline_files::BadInput;
use plumbline_stream::transport::Raw;

use super::mark::Mark;

const MAGIC: &[u8] = b"PLUMBLINE JOURNAL 1\n";

const HEAD_BYTES: usize = 11;
const CRC_BYTES: usize = 4;

/// No entry is longer: longer datagrams are cut, and are none of our packets.
pub(crate) const CONTENT_BYTES_MAX: usize = 2048;

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
    /// Another box, by its name or its address, that was heard and not listened to.
    Other(String),
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
    fn encode(&self) -> Vec<u8> {
        let (kind, content) = match &self.content {
            Content::Raw(Raw::Datagram(bytes)) => (1, Cow::from(bytes)),
            Content::Raw(Raw::Frame(bytes)) => (2, Cow::from(bytes)),
            Content::Mark(mark) => (3, Cow::from(mark.text().into_bytes())),
            Content::About(text) => (4, Cow::from(text.as_bytes())),
            Content::Other(name) => (5, Cow::from(name.as_bytes())),
        };
        let content = &content[..content.len().min(CONTENT_BYTES_MAX)];
        let mut entry = vec![kind];
        entry.extend(self.host_ns.to_le_bytes());
        entry.extend((content.len() as u16).to_le_bytes());
        entry.extend(content);
        entry.extend(document_crc(&entry).to_le_bytes());
        entry
    }

    /// The entry at the beginning of these bytes, and its length.
    fn decode(bytes: &[u8]) -> Option<(Self, usize)> {
        let (head, rest) = bytes.split_first_chunk::<HEAD_BYTES>()?;
        let [kind, time @ .., low, high] = head;
        let length = usize::from(u16::from_le_bytes([*low, *high]));
        let crc = rest.get(length..length + CRC_BYTES)?;
        let covered = HEAD_BYTES + length;
        // The cheap test comes first: it fails at most places where no entry begins.
        if length > CONTENT_BYTES_MAX || document_crc(&bytes[..covered]).to_le_bytes() != crc {
            return None;
        }
        let content = &rest[..length];
        let content = match kind {
            1 => Content::Raw(Raw::Datagram(content.to_vec())),
            2 => Content::Raw(Raw::Frame(content.to_vec())),
            3 => Content::Mark(Mark::read(std::str::from_utf8(content).ok()?)?),
            4 => Content::About(String::from_utf8(content.to_vec()).ok()?),
            5 => Content::Other(String::from_utf8(content.to_vec()).ok()?),
            _ => return None,
        };
        let host_ns = u64::from_le_bytes(*time);
        Some((Self { host_ns, content }, covered + CRC_BYTES))
    }
}

/// Writes a journal.
pub struct Writer {
    file: File,
    place: String,
    keeper: Keeper,
}

impl Writer {
    /// A new journal.
    ///
    /// # Errors
    /// When it exists, or cannot be written.
    pub fn create(path: &Path) -> Result<Self, BadInput> {
        let place = path.display().to_string();
        let failed = |error| BadInput::io(&place, &error);
        let mut file = File::create_new(path).map_err(failed)?;
        file.write_all(MAGIC).map_err(failed)?;
        let keeper = file.try_clone().and_then(Keeper::start).map_err(failed)?;
        Ok(Self { file, place, keeper })
    }

    /// Adds an entry. From now on it survives the end of this program, and within half a second
    /// also a loss of power.
    ///
    /// # Errors
    /// When it cannot be written; what was written before stays.
    pub fn write(&mut self, entry: &Entry) -> Result<(), BadInput> {
        let written = self.keeper.failure().map_or(Ok(()), Err);
        let written = written.and_then(|()| self.file.write_all(&entry.encode()));
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
    source: R,
    place: String,
    /// What was read; the part from `at` on is not used yet.
    buffer: Vec<u8>,
    at: usize,
    is_over: bool,
    /// Bytes that belong to no entry.
    damaged_bytes: u64,
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
        let buffer = Vec::new();
        let mut reader = Self { source, place, buffer, at: 0, is_over: false, damaged_bytes: 0 };
        reader.fill()?;
        if !reader.buffer.starts_with(MAGIC) {
            return Err(BadInput::whole(
                reader.place,
                "it is not a Plumbline journal",
                "give the folder that `plumb receive --out` has made",
            ));
        }
        reader.at = MAGIC.len();
        Ok(reader)
    }

    /// The next entry; `None` at the end.
    ///
    /// # Errors
    /// When the disk cannot be read.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, BadInput> {
        loop {
            self.fill()?;
            if self.at == self.buffer.len() {
                return Ok(None);
            }
            if let Some((entry, length)) = Entry::decode(&self.buffer[self.at..]) {
                self.at += length;
                return Ok(Some(entry));
            }
            self.at += 1;
            self.damaged_bytes += 1;
        }
    }

    /// The number of bytes that belong to no entry, such as those of a last one that was cut off.
    #[must_use]
    pub fn damaged_bytes(&self) -> u64 {
        self.damaged_bytes
    }

    /// Fills the buffer, so that it holds the longest entry if the source has that much.
    fn fill(&mut self) -> Result<(), BadInput> {
        const ENTRY_BYTES_MAX: usize = HEAD_BYTES + CONTENT_BYTES_MAX + CRC_BYTES;
        if self.is_over || self.buffer.len() - self.at >= ENTRY_BYTES_MAX {
            return Ok(());
        }
        self.buffer.drain(..self.at);
        self.at = 0;
        let wanted = 64 * ENTRY_BYTES_MAX - self.buffer.len();
        let read = (&mut self.source).take(wanted as u64).read_to_end(&mut self.buffer);
        let read = read.map_err(|error| BadInput::io(&self.place, &error))?;
        self.is_over = read < wanted;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mark::Source;

    fn entries() -> Vec<Entry> {
        (0..400_u64)
            .map(|at| Entry {
                host_ns: at * 16_666_667,
                content: match at % 7 {
                    0 => Content::Mark(Mark::new(Source::Key, "stands")),
                    1 => Content::Raw(Raw::Frame(vec![at as u8 | 1; 200])),
                    2 => Content::About("format = 2\n".to_owned()),
                    3 => Content::Other("ward 4 (PL-0002)".to_owned()),
                    _ => Content::Raw(Raw::Datagram(vec![at as u8; at as usize % 254])),
                },
            })
            .collect()
    }

    fn bytes(entries: &[Entry]) -> Vec<u8> {
        entries.iter().fold(MAGIC.to_vec(), |bytes, entry| [bytes, entry.encode()].concat())
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
    fn a_cut_costs_the_entry_that_it_hits_and_no_other() {
        let (entries, whole) = (entries(), bytes(&entries()));
        let (mut start, mut at) = (MAGIC.len(), 0);
        for cut in MAGIC.len()..whole.len() {
            if cut >= start + entries[at].encode().len() {
                start += entries[at].encode().len();
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
        for place in (MAGIC.len()..whole.len()).step_by(97) {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x40;
            let (read, lost) = read(&damaged);
            assert_eq!(read.len(), entries.len() - 1, "at {place}");
            assert!(read.iter().all(|entry| entries.contains(entry)) && lost > 0);
        }
    }

    #[test]
    fn what_is_no_journal_is_refused() {
        for bytes in [&b""[..], b"PLUMBLINE", b"frame,time_s\n0,0.0\n"] {
            let error = Reader::new(bytes, "packets.bin".into()).err().unwrap().to_string();
            assert!(error.contains("packets.bin") && error.contains("plumb receive"), "{error}");
        }
    }
}
