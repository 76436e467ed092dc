//! Whether all parts of a compressed frame are there; and a copy in which a gap cannot hide.
//!
//! A JPEG file (ITU-T T.81, annex B) is a sequence of segments, each of which begins with a marker:
//!
//! ```text
//! FF D8   tables, the frame's size and so on   FF DA, compressed samples           FF D9
//! start   segments with their lengths          the scan; FF is followed by 0,      end
//!                                              or is a restart marker, FF D0..D7
//! ```
//!
//! What USB cameras send is laid down in "USB Device Class Definition for Video Devices: Motion-JPEG
//! Payload": baseline JPEG, one scan with all components, with or without the tables of its code. No
//! other kind is read, so that neither time nor memory depend on what a damaged frame says: a
//! progressive file, for example, may have many scans, each of the size of the frame. Restart
//! markers, which some cameras put after every so many blocks, are numbered, so that a lost one is
//! noticed.
//!
//! A decoder whose samples run out makes up the rest, as a viewer should: if bytes have been lost in
//! the middle, everything after them is in the wrong place, and it says nothing. In the copy, [`ONES`]
//! follow the samples. No code consists of ones only (T.81, annex C), so that samples that run out
//! are an error. Samples that are left over are not: many cameras send a few bytes more, before
//! restart markers and at the end.

use anyhow::{Context, Result, bail, ensure};

const START: u8 = 0xD8;
const END: u8 = 0xD9;
const BASELINE: u8 = 0xC0;
/// Baseline with more bits or more tables, which is decoded in the same way.
const EXTENDED: u8 = 0xC1;
const HUFFMAN_TABLES: u8 = 0xC4;
const RESTART_INTERVAL: u8 = 0xDD;
const SCAN: u8 = 0xDA;

/// The side of a block of samples.
const BLOCK_PX: usize = 8;

/// What is put behind compressed samples: ones, each byte with the zero that tells it from a marker.
/// More than the rest of a code, the longest value after it and another code.
const ONES: [u8; 16] = [0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0];

/// The start of a file, and the segment that stands for the code's usual tables (T.81, annex K.3).
/// Many cameras leave out the tables, and some of them this segment as well.
const START_WITH_USUAL_TABLES: &[u8] = b"\xFF\xD8\xFF\xE0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0";

/// What the segments before the scan say.
#[derive(Debug, Default)]
struct Header {
    has_tables: bool,
    /// Groups of blocks from one restart marker to the next; 0 if there are none.
    restart_interval: usize,
    components: usize,
    /// Groups of blocks in the frame.
    groups: usize,
}

/// Copies a frame of exactly this size for the decoder.
///
/// # Errors
/// When a part is missing, damaged, or of a kind that cameras do not send.
pub fn guarded(bytes: &[u8], size_px: (usize, usize)) -> Result<Vec<u8>> {
    ensure!(bytes.starts_with(&[0xFF, START]), "it is not a JPEG file");
    let mut header = Header::default();
    let mut at = 2;
    let mut marker = START;
    while marker != SCAN {
        // Filled up before a marker.
        while bytes[at..].starts_with(&[0xFF, 0xFF]) {
            at += 1;
        }
        let segment;
        (marker, segment) =
            self::segment(&bytes[at..]).context("it is cut off before its samples")?;
        header.read(marker, segment, size_px)?;
        at += 4 + segment.len();
    }
    let capacity =
        START_WITH_USUAL_TABLES.len() + bytes.len() + ONES.len() * (header.restarts() + 2);
    let mut copy = Vec::with_capacity(capacity);
    copy.extend(if header.has_tables { &bytes[..2] } else { START_WITH_USUAL_TABLES });
    copy.extend(&bytes[2..at]);
    header.copy_scan(&bytes[at..], &mut copy)?;
    Ok(copy)
}

/// The first marker with a segment, and the segment's bytes after its length; `None` if they are
/// not all there.
fn segment(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let [0xFF, marker, ..] = *bytes else { return None };
    let length = word(bytes, 2)?;
    Some((marker, bytes.get(4..2 + length)?))
}

/// Two bytes as a number, highest first.
fn word(bytes: &[u8], at: usize) -> Option<usize> {
    let pair = bytes.get(at..at + 2)?;
    Some(usize::from(u16::from_be_bytes([pair[0], pair[1]])))
}

impl Header {
    fn read(&mut self, marker: u8, segment: &[u8], size_px: (usize, usize)) -> Result<()> {
        match marker {
            HUFFMAN_TABLES => self.has_tables = true,
            RESTART_INTERVAL => {
                self.restart_interval = word(segment, 0).context("a damaged restart interval")?;
            }
            BASELINE | EXTENDED => self.read_frame(segment, size_px)?,
            0xC2..=0xCF => bail!("it is not baseline JPEG, the only kind that is read"),
            SCAN => {
                ensure!(self.components > 0, "it has no size");
                let components = segment.first().copied().map(usize::from);
                ensure!(components == Some(self.components), "it has several scans");
            }
            START | END | 0xD0..=0xD7 => bail!("it has no samples"),
            _ => {}
        }
        Ok(())
    }

    /// Reads the segment of the frame: bits, height, width, and three bytes for each component.
    fn read_frame(&mut self, segment: &[u8], (width, height): (usize, usize)) -> Result<()> {
        ensure!(self.components == 0, "it has two sizes");
        let found = word(segment, 3).zip(word(segment, 1)).context("a damaged size")?;
        ensure!(found == (width, height), "it has {} x {} px", found.0, found.1);
        // Grey; or luma and two colours.
        let components = segment.get(5).copied().map_or(0, usize::from);
        ensure!(matches!(components, 1 | 3), "it has {components} components, neither 1 nor 3");
        let samplings = segment[6..].chunks(3).take(components);
        // The component with most samples has so many blocks in a group, along and down.
        let (mut along, mut down) = (1, 1);
        for component in samplings.filter(|_| components > 1) {
            let factors = usize::from(*component.get(1).context("a damaged size")?);
            (along, down) = (along.max(factors >> 4), down.max(factors & 0xF));
        }
        ensure!(down <= along, "its colours are sampled more finely along than down, as 4:4:0");
        self.components = components;
        self.groups = width.div_ceil(BLOCK_PX * along) * height.div_ceil(BLOCK_PX * down);
        Ok(())
    }

    /// The number of restart markers: one between any two parts of the scan.
    fn restarts(&self) -> usize {
        self.groups.saturating_sub(1).checked_div(self.restart_interval).unwrap_or(0)
    }

    /// Appends the scan with which `bytes` begin, and the end of the file.
    fn copy_scan(&self, bytes: &[u8], copy: &mut Vec<u8>) -> Result<()> {
        let mut restarts = 0;
        let (mut copied, mut at) = (0, 0);
        loop {
            at += bytes[at..].iter().position(|&byte| byte == 0xFF).context("it is cut off")?;
            let marker = *bytes.get(at + 1).context("it is cut off")?;
            match marker {
                0 => at += 2,
                0xFF => at += 1,
                0xD0..=0xD7 | END => {
                    copy.extend(&bytes[copied..at]);
                    copy.extend(ONES);
                    copy.extend([0xFF, marker]);
                    at += 2;
                    copied = at;
                    if marker == END {
                        break;
                    }
                    ensure!(usize::from(marker & 7) == restarts % 8, "a part of it is missing");
                    restarts += 1;
                }
                _ => bail!("a part of it is missing"),
            }
        }
        // Some encoders put one behind the last part as well.
        let expected = self.restarts();
        ensure!((expected..=expected + 1).contains(&restarts), "a part of it is missing");
        Ok(())
    }
}
