//! The Coordinate 3D format (C3D) of motion capture: the part of it that recordings of markers
//! need, after the C3D User Guide (<https://www.c3d.org>).
//!
//! A file consists of blocks of 512 bytes: one with the [`Header`], then those with the
//! [`Parameters`], then the frames. In a frame each point has four numbers: X, Y, Z and a word that
//! is negative where the point was not seen; the analog measurements of the frame follow. Numbers
//! are little-endian: files of DEC and MIPS processors, which are no longer made, are refused.
//!
//! [`decode`] checks every length that a file states, whatever its bytes are.

use std::collections::BTreeMap;

pub const BLOCK_BYTES: usize = 512;

/// A count of frames in the header has 16 bits. This one means "or more": then the parameters
/// TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD have the numbers of the first and the last frame,
/// each as its low and its high 16 bits.
pub const FRAMES_MAX: u16 = u16::MAX;

/// The second byte of every file, and of its parameters.
const KEY: u8 = 0x50;

/// The processor whose numbers are little-endian.
const INTEL: u8 = 84;

/// The block where [`encode`] puts the parameters; blocks count from 1.
const PARAMETER_BLOCK: u8 = 2;

/// What the first block says of the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// Points per frame.
    pub points: u16,
    /// Analog measurements per frame.
    pub analog: u16,
    /// Number of the first frame, from 1.
    pub first_frame: u16,
    /// Number of the last frame, or [`FRAMES_MAX`].
    pub last_frame: u16,
    /// Negative where numbers are floating-point (4 bytes). Otherwise they are integers (2 bytes),
    /// and this is the length of one unit.
    pub scale: f32,
    /// Frames per second.
    pub rate_hz: f32,
}

impl Header {
    /// Bytes of one number in a frame.
    pub fn number_bytes(&self) -> usize {
        if self.scale < 0.0 { 4 } else { 2 }
    }
}

/// The value of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// One text.
    Text(String),
    /// Several texts. In the file they have one length; spaces at their ends do not count.
    Texts(Vec<String>),
    /// 16 bits each. The format has signed integers; those needed here are counts.
    Integers(Vec<u16>),
    /// Single precision.
    Floats(Vec<f32>),
    /// The same in two rows; each of these is a column.
    Pairs(Vec<[f32; 2]>),
}

impl Value {
    /// The bytes after the offset to the next parameter, but for the description.
    fn encode(&self) -> Vec<u8> {
        let (kind, dimensions, data): (i8, Vec<usize>, Vec<u8>) = match self {
            Self::Text(text) => (-1, vec![text.len()], text.as_bytes().to_vec()),
            Self::Texts(texts) => {
                let width = texts.iter().map(String::len).max().unwrap_or_default();
                let padded = texts.iter().flat_map(|text| {
                    text.bytes().chain(std::iter::repeat(b' ')).take(width).collect::<Vec<u8>>()
                });
                (-1, vec![width, texts.len()], padded.collect())
            }
            Self::Integers(values) => {
                (2, vec![values.len()], values.iter().flat_map(|it| it.to_le_bytes()).collect())
            }
            Self::Floats(values) => {
                (4, vec![values.len()], values.iter().flat_map(|it| it.to_le_bytes()).collect())
            }
            Self::Pairs(values) => {
                let numbers = values.as_flattened().iter();
                (4, vec![2, values.len()], numbers.flat_map(|it| it.to_le_bytes()).collect())
            }
        };
        let mut bytes = vec![kind.cast_unsigned(), dimensions.len() as u8];
        bytes.extend(dimensions.into_iter().map(|it| {
            assert!(it <= usize::from(u8::MAX), "a dimension of a C3D parameter has 8 bits: {it}");
            it as u8
        }));
        bytes.extend(data);
        bytes
    }

    /// The inverse of [`encode`](Self::encode), whatever follows; outside `None`, where bytes are
    /// missing or no such type exists, `None` inside is a parameter of bytes, which nothing needs.
    fn decode(bytes: &[u8]) -> Option<Option<Self>> {
        let (&[kind, dimensions], bytes) = bytes.split_first_chunk()?;
        let (dimensions, bytes) = bytes.split_at_checked(usize::from(dimensions))?;
        let mut sizes = dimensions.iter().map(|it| usize::from(*it));
        let count = sizes.try_fold(1_usize, usize::checked_mul)?;
        let number_bytes = usize::from(kind.cast_signed().unsigned_abs());
        let data = bytes.get(..count.checked_mul(number_bytes)?)?;
        Some(Some(match (kind.cast_signed(), dimensions) {
            (-1, [] | [_]) => Self::Text(text(data)),
            (-1, [width, ..]) => {
                Self::Texts(data.chunks(usize::from(*width).max(1)).map(text).collect())
            }
            (1, _) => return Some(None),
            (2, _) => Self::Integers(
                data.as_chunks().0.iter().map(|it| u16::from_le_bytes(*it)).collect(),
            ),
            (4, _) => {
                let numbers = data.as_chunks().0.iter().map(|it| f32::from_le_bytes(*it));
                let numbers: Vec<f32> = numbers.collect();
                match dimensions {
                    [2, _] => Self::Pairs(numbers.as_chunks().0.to_vec()),
                    _ => Self::Floats(numbers),
                }
            }
            _ => return None,
        }))
    }
}

/// Texts may be in any encoding; those that matter are ASCII.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_end_matches([' ', '\0']).to_owned()
}

/// The parameters by group and name; both are in capital letters.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parameters(BTreeMap<String, BTreeMap<String, Value>>);

impl Parameters {
    /// The value of a parameter.
    pub fn get(&self, group: &str, name: &str) -> Option<&Value> {
        self.0.get(group)?.get(name)
    }

    /// The first number of a parameter of numbers.
    pub fn number(&self, group: &str, name: &str) -> Option<f32> {
        match self.get(group, name)? {
            Value::Integers(values) => values.first().map(|it| f32::from(*it)),
            Value::Floats(values) => values.first().copied(),
            Value::Text(_) | Value::Texts(_) | Value::Pairs(_) => None,
        }
    }

    /// The texts of a parameter; none where it is absent.
    pub fn texts(&self, group: &str, name: &str) -> &[String] {
        match self.get(group, name) {
            Some(Value::Text(text)) => std::slice::from_ref(text),
            Some(Value::Texts(texts)) => texts,
            _ => &[],
        }
    }

    /// Adds a parameter or replaces its value.
    pub fn set(&mut self, group: &str, name: &str, value: Value) {
        self.0.entry(group.to_owned()).or_default().insert(name.to_owned(), value);
    }

    /// Whole blocks.
    fn encode(&self) -> Vec<u8> {
        let mut bytes = vec![1, KEY, 0, INTEL];
        for (id, (group, parameters)) in (1_i8..).zip(&self.0) {
            // Neither groups nor parameters have a description: its length is 0.
            put_record(&mut bytes, -id, group, &[0]);
            for (name, value) in parameters {
                put_record(&mut bytes, id, name, &[value.encode(), vec![0]].concat());
            }
        }
        // A name of no length is the end.
        bytes.resize((bytes.len() + 1).next_multiple_of(BLOCK_BYTES), 0);
        let blocks = bytes.len() / BLOCK_BYTES;
        assert!(blocks <= usize::from(u8::MAX), "too many C3D parameters: {blocks} blocks");
        bytes[2] = blocks as u8;
        bytes
    }

    /// From the bytes between header and frames; `None` where they are damaged.
    fn decode(bytes: &[u8]) -> Option<Self> {
        let mut groups = BTreeMap::new();
        let mut found = Vec::new();
        let mut rest = bytes.get(4..)?;
        while let Some((&[length, id], record)) = rest.split_first_chunk() {
            // Negative where the parameter is locked.
            let length = usize::from(length.cast_signed().unsigned_abs());
            if length == 0 {
                break;
            }
            let (name, record) = record.split_at_checked(length)?;
            let name = text(name).to_uppercase();
            let (offset, content) = record.split_first_chunk()?;
            // Groups have negative numbers, and may come after their parameters.
            match id.cast_signed() {
                ..0 => drop(groups.insert(id.wrapping_neg(), name)),
                0 => return None,
                1.. => found.extend(Value::decode(content)?.map(|value| (id, name, value))),
            }
            match usize::from(u16::from_le_bytes(*offset)) {
                0 => break,
                offset => rest = record.get(offset..)?,
            }
        }
        let mut parameters = Self::default();
        for (id, name, value) in found {
            parameters.set(groups.get(&id)?, &name, value);
        }
        Some(parameters)
    }
}

/// Appends a group or a parameter.
fn put_record(bytes: &mut Vec<u8>, id: i8, name: &str, content: &[u8]) {
    bytes.extend([name.len() as u8, id.cast_unsigned()]);
    bytes.extend(name.as_bytes());
    // To the next record, from the first byte of this number.
    bytes.extend((content.len() as u16 + 2).to_le_bytes());
    bytes.extend(content);
}

/// A whole file of these frames; where they begin is added to the parameters.
///
/// # Panics
/// When a text is longer than 255 bytes, or there are more than 255 texts or 127 KiB of parameters.
pub fn encode(header: &Header, mut parameters: Parameters, frames: &[u8]) -> Vec<u8> {
    let data_start = |block: u16| Value::Integers(vec![block]);
    parameters.set("POINT", "DATA_START", data_start(0));
    let parameter_blocks = parameters.encode().len() / BLOCK_BYTES;
    let data_block = u16::from(PARAMETER_BLOCK) + parameter_blocks as u16;
    parameters.set("POINT", "DATA_START", data_start(data_block));

    let mut bytes = vec![PARAMETER_BLOCK, KEY];
    for word in [header.points, header.analog, header.first_frame, header.last_frame] {
        bytes.extend(word.to_le_bytes());
    }
    // No gaps have been filled.
    bytes.extend([0, 0]);
    bytes.extend(header.scale.to_le_bytes());
    bytes.extend(data_block.to_le_bytes());
    // Analog samples per frame and channel.
    bytes.extend([0, 0]);
    bytes.extend(header.rate_hz.to_le_bytes());
    bytes.resize(BLOCK_BYTES, 0);
    bytes.extend(parameters.encode());
    bytes.extend(frames);
    bytes.resize(bytes.len().next_multiple_of(BLOCK_BYTES), 0);
    bytes
}

/// The parts of a file; the last is the frames, and what pads them to a whole block.
///
/// # Errors
/// What is wrong with the file.
pub fn decode(bytes: &[u8]) -> Result<(Header, Parameters, &[u8]), String> {
    let cut_off = || "it is cut off before its frames".to_owned();
    let block: &[u8; BLOCK_BYTES] = bytes.first_chunk().ok_or_else(cut_off)?;
    if block[1] != KEY {
        return Err("it is not a C3D file".to_owned());
    }
    let of_block = |block: usize| block.checked_sub(1).map(|it| it * BLOCK_BYTES);
    let parameters_at = of_block(usize::from(block[0]));
    let word = |at: usize| u16::from_le_bytes([block[at], block[at + 1]]);
    let number = |at: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| block[at + byte]));
    let contradicts = || "its header contradicts itself".to_owned();
    let parameters_at = parameters_at.filter(|at| *at > 0).ok_or_else(contradicts)?;
    let processor = bytes.get(parameters_at + 3).ok_or_else(cut_off)?;
    if *processor != INTEL {
        return Err("its numbers are those of a DEC or MIPS processor".to_owned());
    }
    let data_at = of_block(usize::from(word(16))).filter(|at| *at > parameters_at);
    let (before, frames) =
        bytes.split_at_checked(data_at.ok_or_else(contradicts)?).ok_or_else(cut_off)?;
    let parameters =
        Parameters::decode(&before[parameters_at..]).ok_or("its parameters are damaged")?;
    let header = Header {
        points: word(2),
        analog: word(4),
        first_frame: word(6),
        last_frame: word(8),
        scale: number(12),
        rate_hz: number(20),
    };
    Ok((header, parameters, frames))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> (Header, Parameters, Vec<u8>) {
        let header = Header {
            points: 2,
            analog: 3,
            first_frame: 1,
            last_frame: 10,
            scale: -0.5,
            rate_hz: 100.0,
        };
        let mut parameters = Parameters::default();
        let labels = ["A", "longer"].map(str::to_owned).to_vec();
        parameters.set("POINT", "LABELS", Value::Texts(labels));
        parameters.set("POINT", "UNITS", Value::Text("mm".to_owned()));
        parameters.set("POINT", "RATE", Value::Floats(vec![100.0]));
        parameters.set("TRIAL", "ACTUAL_END_FIELD", Value::Integers(vec![10, 0]));
        parameters.set("EVENT", "TIMES", Value::Pairs(vec![[0.0, 1.5], [2.0, 0.25]]));
        (header, parameters, (0..=255).cycle().take(700).collect())
    }

    #[test]
    fn what_is_written_is_read_back() {
        let (header, mut parameters, frames) = file();
        let bytes = encode(&header, parameters.clone(), &frames);
        assert_eq!(bytes.len() % BLOCK_BYTES, 0);
        let (found, found_parameters, found_frames) = decode(&bytes).unwrap();
        parameters.set("POINT", "DATA_START", Value::Integers(vec![3]));
        assert_eq!((found, found_parameters), (header, parameters));
        assert_eq!(found_frames[..700], frames);
        assert_eq!(found_frames[700..], [0; 324]);
    }

    /// By hand after the guide: a locked group after its parameter, small letters, no offset at the
    /// end, and a parameter of bytes.
    #[test]
    fn other_programs_order_their_parameters_in_other_ways() {
        let mut bytes = vec![0, 0, 1, INTEL];
        bytes.extend(b"\x04\x05rate\x0a\0\x04\x01\x01\0\0\x20\x41\0");
        bytes.extend(b"\x04\x05BITS\x07\0\x01\x01\x01\xff\0");
        bytes.extend(b"\xfb\xfbPoint\x03\0\0");
        bytes.extend(b"\x05\x05UNITS\0\0\xff\x01\x02mm");
        let parameters = Parameters::decode(&bytes).unwrap();
        assert_eq!(parameters.number("POINT", "RATE"), Some(10.0));
        assert_eq!(parameters.texts("POINT", "UNITS"), ["mm"]);
        assert_eq!(parameters.get("POINT", "BITS"), None);
    }

    #[test]
    fn no_bytes_make_the_reader_panic() {
        let (header, parameters, frames) = file();
        let good = encode(&header, parameters, &frames);
        let data = 2 * BLOCK_BYTES;
        for length in 0..data {
            assert!(decode(&good[..length]).is_err(), "{length}");
        }
        for place in 0..data {
            for byte in 0..=255 {
                let mut bytes = good.clone();
                bytes[place] = byte;
                let _ = decode(&bytes);
            }
        }
        // The product of the dimensions exceeds every integer.
        let huge = [&[0, KEY, 1, INTEL, 1, 1, b'A', 0, 0, 0xff, 40][..], &[255; 200]].concat();
        assert_eq!(Parameters::decode(&huge), None);
    }
}
