//! A recording as a source: Y4M from a file or from standard input.
//!
//! A thread reads ahead by one frame, so that reading overlaps with tracking
//! and a silent pipe never blocks the main loop. The reader and the loop share
//! one slot and swap buffers, and nothing is allocated after the first frame.
//!
//! In a paced replay, frame `n` is given at `start + n / rate`: deadlines are
//! absolute, so that delays do not add up. A frame is never skipped; one that is
//! given when the next was already due is marked late.

use std::io::{self, BufRead, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use plumbline::image::GreyImage;
use plumbline::limits::{FRAME_SIDE_PX_MAX, FRAME_SIDE_PX_MIN};
use plumbline::packet::{CameraState, MarkedInstant};

use super::rate::Rate;
use super::{Condition, Exposure, Frame, FrameSource, Next, Pixels};

/// The end of every message about an unusable recording.
const REMEDY: &str = "make one with: ffmpeg -i INPUT -pix_fmt yuv420p -f yuv4mpegpipe OUTPUT.y4m";

/// A recording that gives no frame for this long is reported as stalled.
const STALL: Duration = Duration::from_secs(1);

/// How often the wait for the recording's header checks whether to stop.
const STOP_CHECK: Duration = Duration::from_millis(50);

/// Which recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Input {
    /// A file, or anything else that can be opened and read.
    File(PathBuf),
    /// Standard input.
    Stdin,
}

impl From<&Path> for Input {
    /// `-` means standard input.
    fn from(path: &Path) -> Self {
        if path == Path::new("-") { Self::Stdin } else { Self::File(path.into()) }
    }
}

impl std::fmt::Display for Input {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(formatter),
            Self::Stdin => formatter.write_str("standard input"),
        }
    }
}

/// How fast frames are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// At the recording's rate.
    Recorded,
    /// As fast as they can be read and tracked.
    Unpaced,
}

/// A recording being replayed.
#[derive(Debug)]
pub struct Replay {
    shared: Arc<Shared>,
    size_px: (usize, usize),
    rate: Rate,
    pace: Pace,
    frame: Vec<u8>,
    index: u64,
    started: Option<Instant>,
    /// When the last frame was given.
    silent_since: Instant,
}

#[derive(Debug)]
struct Shared {
    slot: Mutex<Slot>,
    changed: Condvar,
}

#[derive(Debug)]
struct Slot {
    state: SlotState,
    luma: Vec<u8>,
    arrived: Option<Instant>,
}

#[derive(Debug)]
enum SlotState {
    /// The header has not been read yet.
    Opening,
    /// The header has been read; the reader waits for the loop to take it.
    Header(Header),
    Empty,
    Full,
    Ended,
    Broken(String),
    /// The replay was dropped, so the reader ends.
    Closed,
}

#[derive(Debug, Clone, Copy)]
struct Header {
    size_px: (usize, usize),
    rate: Option<Rate>,
}

impl Replay {
    /// Opens a recording and reads its header. `rate` replaces the header's.
    /// Returns `None` if `stop` was set before a header arrived.
    ///
    /// # Errors
    /// When the recording cannot be read or is not 8-bit Y4M of a size that can
    /// be tracked; the message names the recording and the remedy.
    pub fn open(
        input: &Input,
        pace: Pace,
        rate: Option<Rate>,
        stop: &AtomicBool,
    ) -> Result<Option<Self>> {
        let reader: Box<dyn Read + Send> = match input {
            Input::File(path) => Box::new(std::fs::File::open(path).with_context(|| {
                format!("the recording {} cannot be opened: check the path", path.display())
            })?),
            Input::Stdin => Box::new(io::stdin()),
        };
        let slot = Slot { state: SlotState::Opening, luma: Vec::new(), arrived: None };
        let shared = Arc::new(Shared { slot: Mutex::new(slot), changed: Condvar::new() });
        let for_reader = Arc::clone(&shared);
        let name = input.to_string();
        // Detached: it may be blocked in a read that never returns, and ends with the process.
        std::thread::Builder::new()
            .name("replay".into())
            .spawn(move || for_reader.read_all(&name, reader))
            .context("the thread that reads the recording cannot be started")?;

        let header = loop {
            let mut slot = shared.wait(shared.lock(), STOP_CHECK);
            match std::mem::replace(&mut slot.state, SlotState::Opening) {
                SlotState::Header(header) => {
                    slot.state = SlotState::Empty;
                    shared.changed.notify_all();
                    break header;
                }
                SlotState::Broken(message) => bail!(message),
                _ => {}
            }
            if stop.load(Ordering::Relaxed) {
                slot.state = SlotState::Closed;
                return Ok(None);
            }
        };
        let Some(rate) = rate.or(header.rate) else {
            shared.lock().state = SlotState::Closed;
            bail!("{input}: the header names no usable frame rate (F); give one with --fps");
        };
        let frame = vec![0; header.size_px.0 * header.size_px.1];
        Ok(Some(Self {
            shared,
            size_px: header.size_px,
            rate,
            pace,
            frame,
            index: 0,
            started: None,
            silent_since: Instant::now(),
        }))
    }

    /// Frames per second of the time stamps and of the paced replay.
    #[must_use]
    pub fn rate(&self) -> Rate {
        self.rate
    }

    /// Waits until `deadline`, but not beyond `until`. Returns whether the deadline was reached.
    fn wait_for(deadline: Instant, until: Instant) -> bool {
        let now = Instant::now();
        let wait = deadline.min(until).saturating_duration_since(now);
        if !wait.is_zero() {
            std::thread::sleep(wait);
        }
        deadline <= until || deadline <= now
    }
}

impl FrameSource for Replay {
    fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    fn next(&mut self, until: Instant) -> Next<'_> {
        let shared = Arc::clone(&self.shared);
        let mut slot = shared.lock();
        loop {
            match &mut slot.state {
                SlotState::Full => break,
                SlotState::Ended => return Next::End,
                SlotState::Broken(message) => return Next::Broken(std::mem::take(message)),
                SlotState::Opening
                | SlotState::Header(_)
                | SlotState::Empty
                | SlotState::Closed => {}
            }
            let wait = until.saturating_duration_since(Instant::now());
            if wait.is_zero() {
                return Next::Quiet;
            }
            slot = shared.wait(slot, wait);
        }
        let arrived = slot.arrived.unwrap_or(until);
        let since_start = Duration::from_nanos(self.rate.time_ns(self.index));
        let (ready_at, late) = match self.pace {
            Pace::Unpaced => (Instant::now(), false),
            Pace::Recorded => {
                // Time starts when the first frame has been asked for and read.
                let deadline = *self.started.get_or_insert_with(Instant::now) + since_start;
                // The reader waits meanwhile; it has one more frame in its own buffer.
                drop(slot);
                if !Self::wait_for(deadline, until) {
                    return Next::Quiet;
                }
                slot = shared.lock();
                let period = Duration::from_nanos(self.rate.time_ns(self.index + 1)) - since_start;
                (deadline.max(arrived), Instant::now() >= deadline + period)
            }
        };
        std::mem::swap(&mut self.frame, &mut slot.luma);
        slot.state = SlotState::Empty;
        drop(slot);
        shared.changed.notify_all();
        let capture_time_ns = self.rate.time_ns(self.index);
        self.index += 1;
        self.silent_since = Instant::now();
        let (width, height) = self.size_px;
        let image = GreyImage::new(&self.frame, width, height, width);
        Next::Frame(Frame {
            pixels: Pixels::Grey8(image.expect("the header's size has been checked")),
            capture_time_ns,
            instant: MarkedInstant::Recording,
            ready_at,
            late,
        })
    }

    fn expose(&mut self, _: Exposure) -> bool {
        false
    }

    fn exposure(&self) -> Exposure {
        Exposure::default()
    }

    fn condition(&self) -> Condition {
        let camera = match self.shared.lock().state {
            SlotState::Ended => CameraState::Ended,
            _ if self.index == 0 => CameraState::Starting,
            _ if self.silent_since.elapsed() > STALL => CameraState::Stalled,
            _ => CameraState::Running,
        };
        // A replay skips nothing, and is opened once.
        Condition { camera, frames_dropped: 0, frames_missed: 0, camera_losses: 0 }
    }
}

impl Drop for Replay {
    fn drop(&mut self) {
        self.shared.lock().state = SlotState::Closed;
        self.shared.changed.notify_all();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Slot> {
        // A poisoned lock means that the other side panicked; the slot is still whole.
        self.slot.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn wait<'a>(&self, slot: MutexGuard<'a, Slot>, wait: Duration) -> MutexGuard<'a, Slot> {
        match self.changed.wait_timeout(slot, wait) {
            Ok((slot, _)) => slot,
            Err(poisoned) => poisoned.into_inner().0,
        }
    }

    /// Waits until the loop has taken the frame in the slot; `None` if the replay was dropped.
    fn wait_until_empty(&self) -> Option<MutexGuard<'_, Slot>> {
        let mut slot = self.lock();
        loop {
            match slot.state {
                SlotState::Empty => return Some(slot),
                SlotState::Closed => return None,
                _ => slot = self.wait(slot, Duration::from_secs(1)),
            }
        }
    }

    /// The reader's thread.
    fn read_all(&self, name: &str, reader: impl Read) {
        let end = self.read_frames(name, reader);
        let mut slot = match end {
            // The loop must take the last frame first.
            Ok(()) => match self.wait_until_empty() {
                Some(slot) => slot,
                None => return,
            },
            Err(_) => {
                let mut slot = self.lock();
                while matches!(slot.state, SlotState::Full | SlotState::Header(_)) {
                    slot = self.wait(slot, Duration::from_secs(1));
                }
                slot
            }
        };
        if !matches!(slot.state, SlotState::Closed) {
            slot.state = match end {
                Ok(()) => SlotState::Ended,
                Err(error) => SlotState::Broken(format!("{error:#}")),
            };
        }
        drop(slot);
        self.changed.notify_all();
    }

    fn read_frames(&self, name: &str, reader: impl Read) -> Result<()> {
        let reader = io::BufReader::with_capacity(1 << 16, reader);
        let mut decoder = Y4m::open(name, reader)?;
        let header = decoder.header;
        let frame_bytes = header.size_px.0 * header.size_px.1;
        {
            let mut slot = self.lock();
            slot.luma = vec![0; frame_bytes];
            if matches!(slot.state, SlotState::Closed) {
                return Ok(());
            }
            slot.state = SlotState::Header(header);
        }
        self.changed.notify_all();
        while let Some(frame) = decoder.read()? {
            let arrived = Instant::now();
            let Some(mut slot) = self.wait_until_empty() else { return Ok(()) };
            slot.luma.copy_from_slice(&frame.get_y_plane()[..frame_bytes]);
            slot.arrived = Some(arrived);
            slot.state = SlotState::Full;
            drop(slot);
            self.changed.notify_all();
        }
        Ok(())
    }
}

/// The crate's decoder, with messages for people. It distinguishes the end of
/// the recording from a frame that is cut short.
struct Y4m<'n, R: Read> {
    name: &'n str,
    decoder: y4m::Decoder<Counted<io::Chain<io::Cursor<Vec<u8>>, R>>>,
    /// Shared with the reader within the decoder.
    bytes_read: std::rc::Rc<std::cell::Cell<u64>>,
    header: Header,
    frames: u64,
}

struct Counted<R> {
    reader: R,
    bytes_read: std::rc::Rc<std::cell::Cell<u64>>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // The decoder does not retry by itself when it reads the header.
        loop {
            match self.reader.read(buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                result => {
                    let count = result?;
                    self.bytes_read.set(self.bytes_read.get() + count as u64);
                    return Ok(count);
                }
            }
        }
    }
}

impl<'n, R: BufRead> Y4m<'n, R> {
    fn open(name: &'n str, mut reader: R) -> Result<Self> {
        let line = read_header_line(name, &mut reader)?;
        let size_px = checked_size(name, &line)?;
        let bytes_read = std::rc::Rc::new(std::cell::Cell::new(0));
        let reader = Counted {
            reader: io::Cursor::new(line.into_bytes()).chain(reader),
            bytes_read: std::rc::Rc::clone(&bytes_read),
        };
        let decoder = y4m::decode(reader).map_err(|error| {
            let what = match error {
                y4m::Error::UnknownColorspace => "its colour space (C) is not known",
                _ => "its header cannot be read",
            };
            anyhow::anyhow!("{name}: {what}; {REMEDY}")
        })?;
        if decoder.get_bytes_per_sample() != 1 {
            bail!(
                "{name}: its samples have {} bits, 8 are needed; {REMEDY}",
                decoder.get_bit_depth()
            );
        }
        let rate = decoder.get_framerate();
        let rate = Rate::new(rate.num as u64, rate.den as u64);
        Ok(Self { name, decoder, bytes_read, header: Header { size_px, rate }, frames: 0 })
    }

    /// The next frame, or `None` if the recording ends after a whole frame.
    fn read(&mut self) -> Result<Option<y4m::Frame<'_>>> {
        let (name, number) = (self.name, self.frames);
        let before = self.bytes_read.get();
        match self.decoder.read_frame() {
            Ok(frame) => {
                self.frames += 1;
                Ok(Some(frame))
            }
            Err(y4m::Error::EOF) => {
                let found = self.bytes_read.get() - before;
                if found == 0 {
                    return Ok(None);
                }
                bail!(
                    "{name}: breaks off {found} bytes into frame {number} (counted from 0); \
                     the {number} complete frames before it were tracked: record or copy the file again"
                )
            }
            Err(y4m::Error::IoError(error)) => Err(anyhow::Error::new(error)
                .context(format!("{name}: frame {number} (counted from 0) cannot be read"))),
            Err(_) => bail!(
                "{name}: frame {number} (counted from 0) does not begin with FRAME: the file is \
                 damaged there; {REMEDY}"
            ),
        }
    }
}

/// The first line, including its end. The decoder multiplies the sizes in it
/// unchecked, so they are checked before it sees them.
fn read_header_line(name: &str, reader: &mut impl BufRead) -> Result<String> {
    const MAGIC: &[u8] = b"YUV4MPEG2 ";
    let mut line = Vec::new();
    let mut read_until = |length: u64, reader: &mut dyn BufRead| {
        reader
            .take(length)
            .read_until(b'\n', &mut line)
            .with_context(|| format!("{name} cannot be read"))
            .map(|_| line.starts_with(MAGIC) && !line.ends_with(b"\n"))
    };
    // The rest only if the magic matches: another file may be one endless line.
    if read_until(MAGIC.len() as u64, reader)? {
        read_until(1024, reader)?;
    }
    if line.is_empty() {
        bail!("{name} is empty; {REMEDY}");
    }
    if !line.starts_with(MAGIC) || !line.ends_with(b"\n") {
        bail!("{name} is not a Y4M recording (it does not begin with a YUV4MPEG2 line); {REMEDY}");
    }
    String::from_utf8(line)
        .map_err(|_| anyhow::anyhow!("{name}: its header is not plain text; {REMEDY}"))
}

fn checked_size(name: &str, line: &str) -> Result<(usize, usize)> {
    let side = |tag: char, what: &str| {
        let text = line
            .trim_end()
            .split(' ')
            .skip(1)
            .filter_map(|field| field.strip_prefix(tag))
            .last()
            .with_context(|| format!("{name}: its header has no {what} ({tag}); {REMEDY}"))?;
        match text.parse::<u16>() {
            Ok(side_px) if (FRAME_SIDE_PX_MIN..=FRAME_SIDE_PX_MAX).contains(&side_px) => {
                Ok(usize::from(side_px))
            }
            _ => bail!(
                "{name}: the {what} in its header is {tag}{text}; frames of \
                 {FRAME_SIDE_PX_MIN} to {FRAME_SIDE_PX_MAX} pixels a side can be tracked"
            ),
        }
    };
    Ok((side('W', "width")?, side('H', "height")?))
}
