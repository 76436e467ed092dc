//! Frames from files: Y4M videos, or images in the order given.
//!
//! A [`FrameSource`] gives one grey frame after another, each borrowed until
//! the next. Pixels are as recorded: neither resampled nor turned, since the
//! calibration holds for the sensor's pixels (a JPEG's EXIF orientation is
//! ignored). Colour becomes its luma. Memory is bounded by one frame of at most
//! [`FRAME_SIDE_PX_MAX`] a side, whatever a header claims.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use plumbline::limits::{FRAME_SIDE_PX_MAX, FRAME_SIDE_PX_MIN};

use crate::BadInput;

mod picture;
mod video;

use picture::Picture;
use video::Video;

/// Images have no frame rate; this one is assumed unless another is given.
pub const IMAGE_RATE_HZ: f64 = 30.0;

/// What the user writes for standard input.
const STANDARD_INPUT: &str = "-";

/// The samples of one frame, row by row without padding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pixels<'a> {
    /// 8 bits.
    Grey8(&'a [u8]),
    /// More than 8 bits, in 16-bit words.
    Grey16(&'a [u16]),
}

/// One grey frame.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// Number in the whole input, from 0.
    pub index: u64,
    /// `index` divided by the frame rate.
    pub capture_time_ns: u64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The brightest possible sample.
    pub white_level: u16,
    /// The samples.
    pub pixels: Pixels<'a>,
}

/// The samples of one frame, kept.
enum Samples {
    Grey8(Vec<u8>),
    Grey16(Vec<u16>),
}

enum Open {
    Video(Box<Video>),
    /// An image that has already been decoded, because its size was needed.
    Picture(Picture),
}

/// Frames of a list of inputs.
pub struct FrameSource {
    inputs: VecDeque<PathBuf>,
    /// The input that the next frame comes from, and its name.
    open: Option<Open>,
    place: String,
    given_rate_hz: Option<f64>,
    rate_hz: f64,
    width: usize,
    height: usize,
    index: u64,
    count_hint: Option<u64>,
    /// The number of inputs that were images.
    pictures: usize,
    samples: Samples,
    white_level: u16,
}

impl FrameSource {
    /// Opens the first of `inputs` and checks that the others exist.
    ///
    /// `rate_hz` overrides the rate of a video, and is the rate of images.
    ///
    /// # Errors
    /// When there is no input, a file cannot be read, or the first one is no
    /// image and no video that is supported.
    pub fn open(inputs: &[PathBuf], rate_hz: Option<f64>) -> Result<Self, BadInput> {
        if let Some(rate_hz) = rate_hz {
            check_rate("--fps", "", rate_hz, "give the recording's own rate, for example 60")?;
        }
        for input in inputs.iter().filter(|input| input.as_os_str() != STANDARD_INPUT) {
            let place = input.display();
            let metadata =
                std::fs::metadata(input).map_err(|error| BadInput::io(&place, &error))?;
            if metadata.is_dir() {
                return Err(BadInput::whole(
                    &place,
                    "a directory",
                    format!("name its files instead, for example {place}/*.png"),
                ));
            }
        }
        let mut source = Self {
            inputs: inputs.iter().cloned().collect(),
            open: None,
            place: String::new(),
            given_rate_hz: rate_hz,
            rate_hz: rate_hz.unwrap_or(IMAGE_RATE_HZ),
            width: 0,
            height: 0,
            index: 0,
            count_hint: None,
            pictures: 0,
            samples: Samples::Grey8(Vec::new()),
            white_level: 255,
        };
        if !source.open_next()? {
            return Err(BadInput::whole(
                "INPUT",
                "no input was given",
                "name one or more Y4M videos or images, or - for a Y4M on standard input",
            ));
        }
        source.count_hint = match &source.open {
            Some(Open::Video(video)) if inputs.len() == 1 => video.frames_hint(),
            Some(Open::Picture(_)) => Some(inputs.len() as u64),
            _ => None,
        };
        Ok(source)
    }

    /// Columns of every frame.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of every frame.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Frames per second.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Whether the frames have times of their own: a video says its rate, images do not.
    #[must_use]
    pub fn has_rate(&self) -> bool {
        self.given_rate_hz.is_some() || matches!(self.open, Some(Open::Video(_)))
    }

    /// The number of images among the inputs so far.
    #[must_use]
    pub fn pictures(&self) -> usize {
        self.pictures
    }

    /// Number of frames, as far as it can be known beforehand.
    #[must_use]
    pub fn count_hint(&self) -> Option<u64> {
        self.count_hint
    }

    /// The input that the latest frame came from (before the first frame, the
    /// one it will come from).
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// The next frame, or `None` after the last.
    ///
    /// # Errors
    /// When an input cannot be read, ends inside a frame, is no supported image
    /// or video, or has another size or rate than the ones before. Every complete
    /// frame before the fault has been given by then.
    pub fn next_frame(&mut self) -> Result<Option<Frame<'_>>, BadInput> {
        loop {
            match self.open.take() {
                Some(Open::Video(mut video)) => {
                    if video.read_frame(&mut self.samples, &self.place)? {
                        self.white_level = video.white_level();
                        self.open = Some(Open::Video(video));
                        break;
                    }
                }
                Some(Open::Picture(picture)) => {
                    self.white_level = picture.white_level;
                    self.samples = picture.samples;
                    break;
                }
                None => {
                    if !self.open_next()? {
                        return Ok(None);
                    }
                }
            }
        }
        let index = self.index;
        self.index += 1;
        Ok(Some(Frame {
            index,
            // Rounded from the quotient, not summed: an hour at 59.94 Hz does not drift.
            capture_time_ns: (index as f64 * 1e9 / self.rate_hz).round() as u64,
            width: self.width,
            height: self.height,
            white_level: self.white_level,
            pixels: match &self.samples {
                Samples::Grey8(samples) => Pixels::Grey8(samples),
                Samples::Grey16(samples) => Pixels::Grey16(samples),
            },
        }))
    }

    /// Opens the next input; false when there is none.
    fn open_next(&mut self) -> Result<bool, BadInput> {
        let Some(input) = self.inputs.pop_front() else {
            return Ok(false);
        };
        let is_first = self.place.is_empty();
        let former_place = std::mem::take(&mut self.place);
        let (open, (width, height), rate_hz) = open_input(&input, self.given_rate_hz)?;
        self.place = place_of(&input);
        if is_first {
            (self.width, self.height) = (width, height);
            self.rate_hz = rate_hz.unwrap_or(self.rate_hz);
        } else if (width, height) != (self.width, self.height) {
            return Err(BadInput::new(
                &self.place,
                "frame size",
                format!(
                    "{width} x {height} px, but the frames up to {former_place} have {} x {} px",
                    self.width, self.height
                ),
                "give frames of one size at a time: a calibration holds for one size",
            ));
        } else if let Some(rate_hz) = rate_hz.filter(|&rate_hz| rate_hz != self.rate_hz) {
            return Err(BadInput::new(
                &self.place,
                "frame rate",
                format!(
                    "{rate_hz} Hz, but the frames up to {former_place} have {} Hz",
                    self.rate_hz
                ),
                "give recordings of one rate at a time; `plumb track`, `plumb prove` and `plumb calibrate --readout` take --fps for all of them",
            ));
        }
        self.pictures += usize::from(matches!(open, Open::Picture(_)));
        self.open = Some(open);
        Ok(true)
    }
}

fn place_of(input: &Path) -> String {
    if input.as_os_str() == STANDARD_INPUT {
        "standard input".to_owned()
    } else {
        input.display().to_string()
    }
}

type Opened = (Open, (usize, usize), Option<f64>);

/// Opens one input as the kind of file that its first bytes say.
fn open_input(input: &Path, given_rate_hz: Option<f64>) -> Result<Opened, BadInput> {
    let place = place_of(input);
    let (mut reader, bytes): (Box<dyn BufRead + Send>, Option<u64>) =
        if input.as_os_str() == STANDARD_INPUT {
            (Box::new(BufReader::new(std::io::stdin())), None)
        } else {
            let file = File::open(input).map_err(|error| BadInput::io(&place, &error))?;
            let bytes = file.metadata().ok().filter(|data| data.is_file()).map(|data| data.len());
            (Box::new(BufReader::new(file)), bytes)
        };
    let start = reader.fill_buf().map_err(|error| BadInput::io(&place, &error))?;
    if start.is_empty() {
        return Err(BadInput::whole(
            &place,
            "empty: not a single byte",
            "give a Y4M video or an image that was recorded completely",
        ));
    }
    if start.starts_with(b"YUV4MPEG2") {
        let video = Video::open(reader, bytes, given_rate_hz, &place)?;
        let (size, rate_hz) = (video.size(), video.rate_hz());
        return Ok((Open::Video(Box::new(video)), size, rate_hz));
    }
    if input.as_os_str() == STANDARD_INPUT {
        return Err(BadInput::whole(
            &place,
            "not a Y4M video (it does not begin with YUV4MPEG2)",
            "pipe Y4M in, for example: ffmpeg -i VIDEO -pix_fmt gray -f yuv4mpegpipe - | plumb ... -",
        ));
    }
    drop(reader);
    let picture = Picture::read(input, &place)?;
    let size = (picture.width, picture.height);
    Ok((Open::Picture(picture), size, None))
}

fn check_rate(place: &str, field: &str, rate_hz: f64, remedy: &str) -> Result<(), BadInput> {
    // From one frame in three hours to high-speed cameras.
    if (1e-4..=1e5).contains(&rate_hz) {
        return Ok(());
    }
    Err(BadInput::new(place, field, format!("{rate_hz} frames per second"), remedy))
}

/// Refuses a frame before memory is reserved for it.
fn check_size(place: &str, field: &str, width: usize, height: usize) -> Result<(), BadInput> {
    let sides = usize::from(FRAME_SIDE_PX_MIN)..=usize::from(FRAME_SIDE_PX_MAX);
    if sides.contains(&width) && sides.contains(&height) {
        return Ok(());
    }
    Err(BadInput::new(
        place,
        field,
        format!("{width} x {height} px"),
        format!("each side must lie within {FRAME_SIDE_PX_MIN} to {FRAME_SIDE_PX_MAX} px"),
    ))
}

#[cfg(test)]
mod tests;
