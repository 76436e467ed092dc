//! Y4M (YUV4MPEG2) videos.
//!
//! The crate `y4m` decodes; this module guards it (sizes are checked before it
//! allocates) and counts bytes, so that a recording that ends inside a frame is
//! told from one that ends after it.

use std::io::{BufRead, Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Samples, check_rate, check_size};
use crate::BadInput;

/// No writer comes near this many bytes in a header line.
const HEADER_BYTES_MAX: u64 = 1000;

const CONVERT: &str =
    "convert the recording, for example: ffmpeg -i RECORDING -pix_fmt gray out.y4m";

type Source = std::io::Chain<Cursor<Vec<u8>>, Counted>;

/// Counts the bytes that pass.
struct Counted {
    reader: Box<dyn BufRead + Send>,
    bytes: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.reader.read(buffer)?;
        self.bytes.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

/// A video whose header was read.
pub(super) struct Video {
    decoder: y4m::Decoder<Source>,
    bytes: Arc<AtomicU64>,
    /// `None` when the caller gave the rate.
    rate_hz: Option<f64>,
    frames_hint: Option<u64>,
    frames_read: u64,
    frame_bytes: u64,
}

impl Video {
    /// Reads the header; `file_bytes` is the length of the whole, if known.
    pub(super) fn open(
        mut reader: Box<dyn BufRead + Send>,
        file_bytes: Option<u64>,
        given_rate_hz: Option<f64>,
        place: &str,
    ) -> Result<Self, BadInput> {
        let mut header = Vec::new();
        reader
            .by_ref()
            .take(HEADER_BYTES_MAX)
            .read_until(b'\n', &mut header)
            .map_err(|error| BadInput::io(place, &error))?;
        if header.last() != Some(&b'\n') {
            return Err(BadInput::new(
                place,
                "header",
                format!("the Y4M header line does not end within {} bytes", header.len()),
                "the file is cut short or damaged: copy or record it again",
            ));
        }
        check_header_size(&header, place)?;
        let header_bytes = header.len() as u64;
        let bytes = Arc::new(AtomicU64::new(0));
        let counted = Counted { reader, bytes: Arc::clone(&bytes) };
        let decoder = y4m::Decoder::new(Cursor::new(header.clone()).chain(counted));
        let decoder = decoder.map_err(|error| match error {
            y4m::Error::UnknownColorspace => {
                let name = parameter(&header, b'C').unwrap_or_default();
                BadInput::new(
                    place,
                    "header, C",
                    format!("the unsupported colour space {name}"),
                    CONVERT,
                )
            }
            error => BadInput::new(
                place,
                "header",
                format!("{:?}: {error}", String::from_utf8_lossy(&header).trim_end()),
                CONVERT,
            ),
        })?;
        let rate_hz = match given_rate_hz {
            Some(_) => None,
            None => {
                let ratio = decoder.get_framerate();
                let rate_hz = ratio.num as f64 / ratio.den as f64;
                check_rate(
                    place,
                    "header, F",
                    rate_hz,
                    "`plumb track`, `plumb prove` and `plumb calibrate --readout` take the recording's rate, for example --fps 60",
                )?;
                Some(rate_hz)
            }
        };
        let mut video =
            Self { decoder, bytes, rate_hz, frames_hint: None, frames_read: 0, frame_bytes: 0 };
        video.frame_bytes = video.luma_and_chroma_bytes();
        // "FRAME\n" stands before each.
        video.frames_hint =
            file_bytes.map(|total| total.saturating_sub(header_bytes) / (video.frame_bytes + 6));
        Ok(video)
    }

    fn luma_and_chroma_bytes(&self) -> u64 {
        use y4m::Colorspace as C;
        let (width, height) = self.size();
        let half = |side: usize| side.div_ceil(2);
        let chroma = match self.decoder.get_colorspace() {
            C::Cmono | C::Cmono12 => 0,
            C::C422 | C::C422p10 | C::C422p12 => half(width) * height,
            C::C444 | C::C444p10 | C::C444p12 => width * height,
            _ => half(width) * half(height),
        };
        ((width * height + 2 * chroma) * self.decoder.get_bytes_per_sample()) as u64
    }

    pub(super) fn size(&self) -> (usize, usize) {
        (self.decoder.get_width(), self.decoder.get_height())
    }

    pub(super) fn rate_hz(&self) -> Option<f64> {
        self.rate_hz
    }

    pub(super) fn frames_hint(&self) -> Option<u64> {
        self.frames_hint
    }

    pub(super) fn white_level(&self) -> u16 {
        (1 << self.decoder.get_bit_depth()) - 1
    }

    /// Reads the next frame's luma into `samples`; false at the end.
    pub(super) fn read_frame(
        &mut self,
        samples: &mut Samples,
        place: &str,
    ) -> Result<bool, BadInput> {
        let bytes_before = self.bytes.load(Ordering::Relaxed);
        let wide = self.decoder.get_bytes_per_sample() == 2;
        let frame = match self.decoder.read_frame() {
            Ok(frame) => frame,
            Err(error) => {
                let bytes = self.bytes.load(Ordering::Relaxed) - bytes_before;
                return match error {
                    y4m::Error::EOF if bytes == 0 && self.frames_read > 0 => Ok(false),
                    error => Err(self.frame_error(&error, bytes, place)),
                };
            }
        };
        let luma = frame.get_y_plane();
        if wide {
            let words = luma.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
            match samples {
                Samples::Grey16(samples) => {
                    samples.clear();
                    samples.extend(words);
                }
                Samples::Grey8(_) => *samples = Samples::Grey16(words.collect()),
            }
        } else {
            match samples {
                Samples::Grey8(samples) => {
                    samples.clear();
                    samples.extend_from_slice(luma);
                }
                Samples::Grey16(_) => *samples = Samples::Grey8(luma.to_vec()),
            }
        }
        self.frames_read += 1;
        Ok(true)
    }

    /// `bytes` of the frame had been read when `error` came.
    fn frame_error(&self, error: &y4m::Error, bytes: u64, place: &str) -> BadInput {
        let number = self.frames_read;
        let frame = format!("frame {number}");
        match error {
            y4m::Error::EOF if number == 0 && bytes == 0 => BadInput::new(
                place,
                frame,
                "the file ends after its header: there is not one frame",
                "record again; was the recording program stopped too early?",
            ),
            y4m::Error::EOF => BadInput::new(
                place,
                frame,
                format!(
                    "the file ends {bytes} bytes into this frame of {} bytes",
                    self.frame_bytes + 6
                ),
                format!(
                    "the {number} complete frames before it were used; copy the file again if it should hold more"
                ),
            ),
            y4m::Error::IoError(error) => BadInput::io(place, error),
            _ => BadInput::new(
                place,
                frame,
                "no FRAME line where this frame should begin",
                "the file is damaged, or its header states another size or colour space than it holds: copy or record it again",
            ),
        }
    }
}

/// The value of one header parameter.
fn parameter(header: &[u8], name: u8) -> Option<String> {
    let line = header.strip_suffix(b"\n").unwrap_or(header);
    let mut parameters = line.split(|&byte| byte == b' ').skip(1);
    let value = parameters.find(|parameter| parameter.first() == Some(&name))?;
    Some(String::from_utf8_lossy(&value[1..]).into_owned())
}

/// Refuses absurd sizes before the decoder multiplies or allocates them.
fn check_header_size(header: &[u8], place: &str) -> Result<(), BadInput> {
    let side = |name: u8, field: &str| {
        let text = parameter(header, name).unwrap_or_default();
        text.parse::<usize>().map_err(|_| {
            BadInput::new(
                place,
                format!("header, {field}"),
                if text.is_empty() { "missing".to_owned() } else { format!("{text:?}") },
                "the file is damaged: copy or record it again",
            )
        })
    };
    check_size(place, "header, W and H", side(b'W', "W")?, side(b'H', "H")?)
}
