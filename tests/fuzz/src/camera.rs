//! What a V4L2 driver says, and the memory that it shares: offsets, strides, lengths, formats; and which
//! buffers it gives back, and when.
//!
//! The first byte chooses between the layout of a frame and the queue of a camera.
//!
//! Laws:
//! - A layout that is accepted is read within the memory that it asked for, whatever else the driver
//!   said; the frame has the size that was configured.
//! - No buffer is given to the driver while it has it. Buffers are neither lost nor invented. Each buffer
//!   that came is given once, or counted as dropped or missed.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::os::fd::AsFd as _;
use std::time::{Duration, Instant};

use plumbline::limits::{FRAME_SIDE_PX_MAX, FRAME_SIDE_PX_MIN};
use plumbline_board::source::Pixels;
use plumbline_board::source::camera::Waited;
use plumbline_board::source::stamp::Now;
use plumbline_board::source::v4l2::buffers::{BUFFERS_MAX, Buffers};
use plumbline_board::source::v4l2::intake::{Dequeued, Intake, Queue, Wake};
use plumbline_board::source::v4l2::luma::Luma;
use plumbline_board::source::v4l2::mapping::Mapping;

use crate::input::Input;

const CODES: [&[u8; 4]; 17] = [
    b"GREY", b"NV12", b"Y10 ", b"Y16 ", b"YUYV", b"UYVY", b"RGB3", b"BGR3", b"Y10P", b"Y10B",
    b"RGGB", b"GRBG", b"GBRG", b"BA81", b"MJPG", b"JPEG", b"H264",
];

/// The largest frame that is laid out: a larger one has no other arithmetic, and takes its time.
const FRAME_BYTES_MAX: usize = 1 << 17;

const PAGE_BYTES: usize = 4096;

/// The most things that a driver does in an input.
const EVENTS_MAX: usize = 200;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    if input.byte().is_multiple_of(2) { layout(input) } else { queue(input) }
}

fn layout(mut input: Input<'_>) {
    let code = CODES[input.below(CODES.len())];
    // A configuration has no other frames; a driver may say any stride.
    let sides = FRAME_SIDE_PX_MAX - FRAME_SIDE_PX_MIN + 1;
    let mut side = || usize::from(FRAME_SIDE_PX_MIN + input.word() % sides);
    let size_px = (side(), side());
    let stride = input.number() as usize;
    let (offset_pages, more) = (input.byte() % 4, input.word());
    let Ok(mut luma) = Luma::new(code, size_px, stride) else { return };
    let least = luma.bytes_min();
    let is_file = matches!(code, b"MJPG" | b"JPEG");
    assert!(is_file || least >= size_px.0.max(stride * (size_px.1 - 1)), "{least} bytes");
    if least > FRAME_BYTES_MAX {
        return;
    }
    // The memory ends, as a driver's may, right behind the frame.
    let bytes = least + usize::from(more) % PAGE_BYTES;
    let offset = usize::from(offset_pages) * PAGE_BYTES;
    let device = memory(offset + bytes, input.rest(), offset);
    let mapping = Mapping::new(device.as_fd(), bytes, offset as u32).expect("memory can be mapped");
    assert_eq!(mapping.len_bytes(), bytes);
    let (_, mut all) = Buffers::new(1);
    let ours = all.next().expect("one buffer");
    let (seen, words) = (mapping.bytes(&ours), mapping.words(&ours));
    assert_eq!((seen.len(), words.len()), (bytes, bytes / 2));
    for arrived in [least, bytes] {
        if luma.load(&seen[..arrived]).is_err() {
            assert!(is_file, "{} is refused", code.escape_ascii());
            return;
        }
        // As many bytes have been loaded as came, and are viewed in the whole buffer.
        let found = luma.view(seen, words).expect("every mapping holds a frame");
        let (found_px, white_level) = match found {
            Pixels::Grey8(image) => ((image.width(), image.height()), image.white_level()),
            Pixels::Grey16(image) => ((image.width(), image.height()), image.white_level()),
        };
        assert_eq!(found_px, size_px);
        assert!(white_level > 0);
        // Every row can be read to its end.
        let sum: u64 = match found {
            Pixels::Grey8(image) => (0..size_px.1).map(|y| sum(image.row(y))).sum(),
            Pixels::Grey16(image) => (0..size_px.1).map(|y| sum(image.row(y))).sum(),
        };
        assert!(sum <= u64::from(u16::MAX) * (size_px.0 * size_px.1) as u64);
    }
}

fn sum<T: Copy + Into<u64>>(row: &[T]) -> u64 {
    row.iter().map(|it| (*it).into()).sum()
}

/// A file in memory, as a device that can be mapped.
fn memory(bytes: usize, content: &[u8], at: usize) -> File {
    use std::os::unix::fs::FileExt as _;
    let file = nix::sys::memfd::memfd_create(c"frames", nix::sys::memfd::MFdFlags::empty());
    let file = File::from(file.expect("a file in memory"));
    file.set_len(bytes as u64).expect("memory");
    file.write_all_at(&content[..content.len().min(bytes - at)], at as u64).expect("memory");
    file
}

/// A driver that does what the input says.
struct Driver {
    answers: RefCell<VecDeque<Result<Dequeued, i32>>>,
    wakes: RefCell<VecDeque<Wake>>,
    /// Whether the driver has each buffer.
    has: RefCell<Vec<bool>>,
    given_back: Cell<u64>,
    refuses_after: Cell<Option<u32>>,
    /// Whether it said of a buffer that it gives back one that it does not have.
    has_lied: Cell<bool>,
}

impl Queue for Driver {
    fn queue(&self, index: u32) -> io::Result<()> {
        if let Some(left) = self.refuses_after.get() {
            if left == 0 {
                return Err(io::Error::from_raw_os_error(libc::EIO));
            }
            self.refuses_after.set(Some(left - 1));
        }
        let has = &mut self.has.borrow_mut()[index as usize];
        assert!(!std::mem::replace(has, true), "buffer {index} is given to the driver twice");
        Ok(())
    }

    fn dequeue(&self) -> io::Result<Option<Dequeued>> {
        match self.answers.borrow_mut().pop_front() {
            None => Ok(None),
            Some(Err(code)) => Err(io::Error::from_raw_os_error(code)),
            Some(Ok(done)) => {
                match self.has.borrow_mut().get_mut(done.index as usize) {
                    Some(has) if *has => {
                        *has = false;
                        self.given_back.set(self.given_back.get() + 1);
                    }
                    _ => self.has_lied.set(true),
                }
                Ok(Some(done))
            }
        }
    }

    fn wait(&self, _: Duration) -> io::Result<Wake> {
        // A wait in vain ends it: time does not pass here.
        self.wakes.borrow_mut().pop_front().ok_or_else(|| io::Error::from_raw_os_error(libc::ETIME))
    }

    fn now(&self) -> Now {
        Now { monotonic_ns: 1_000_000_000, instant: Instant::now() }
    }
}

fn queue(mut input: Input<'_>) {
    let count = input.below(BUFFERS_MAX + 3);
    let bytes_min = usize::from(input.word());
    let driver = Driver {
        answers: RefCell::default(),
        wakes: RefCell::default(),
        has: RefCell::new(vec![false; count]),
        given_back: Cell::new(0),
        refuses_after: Cell::new(None),
        has_lied: Cell::new(false),
    };
    let count = count.min(BUFFERS_MAX);
    let mut intake = Intake::new(&driver, count, bytes_min).expect("the driver takes them all");
    assert_eq!(driver.has.borrow().iter().filter(|has| **has).count(), count);
    let (mut frames, mut missed_numbers) = (0, 0);
    let mut last: Option<u32> = None;
    for _ in 0..EVENTS_MAX {
        if input.is_empty() {
            break;
        }
        match input.below(8) {
            0..=3 => {
                let (index, bytes, flags) = (input.byte() % 40, input.word(), input.number());
                let skipped = u32::from(input.byte());
                let done = Dequeued {
                    index: index.into(),
                    bytes: bytes.into(),
                    flags,
                    sequence: last.map_or(0, |it| it.wrapping_add(skipped)),
                    stamp_s: i64::from(input.number().cast_signed()),
                    stamp_us: i64::from(input.number().cast_signed()),
                };
                let step = last.map_or(0, |last| done.sequence.wrapping_sub(last));
                missed_numbers += u64::from(step);
                last = Some(done.sequence);
                driver.answers.borrow_mut().push_back(Ok(done));
            }
            4 => driver.answers.borrow_mut().push_back(Err(i32::from(input.byte()))),
            5 => driver.refuses_after.set(Some(input.byte().into())),
            6 => {
                let wake = Wake::from_events(input.word().cast_signed());
                driver.wakes.borrow_mut().push_back(wake);
            }
            _ => {
                // Either a look at what is there, or a wait for more.
                let until = match input.byte() % 2 {
                    0 => Instant::now(),
                    _ => Instant::now() + Duration::from_secs(60),
                };
                match intake.wait(&driver, until) {
                    Waited::Ready => {
                        frames += 1;
                        let arrived = intake.out().expect("a wait that found one has one");
                        let index = arrived.ours.index() as usize;
                        assert!(!driver.has.borrow()[index], "the driver has what is read");
                        assert!(arrived.bytes >= bytes_min, "a frame of too few bytes");
                    }
                    Waited::Quiet => assert!(intake.out().is_none()),
                    // The camera is opened anew.
                    Waited::Lost(what) => {
                        assert!(!what.is_empty());
                        return;
                    }
                }
                assert!(!driver.has_lied.get(), "a buffer that the driver did not have is taken");
                // Of three buffers at most the driver is deprived, whatever it does.
                let away = driver.has.borrow()[..count].iter().filter(|has| !**has).count();
                assert!(away <= 3, "{away} buffers are away from the driver");
                let counts = intake.counts();
                let damaged = counts.missed;
                assert!(
                    frames + counts.dropped + damaged <= driver.given_back.get() + missed_numbers,
                    "{frames} frames, {counts:?}, of {} buffers",
                    driver.given_back.get()
                );
                let unaccounted = driver.given_back.get().saturating_sub(
                    frames + counts.dropped + damaged + u64::from(intake.is_late()),
                );
                assert_eq!(unaccounted, 0, "{frames} frames, {counts:?}");
            }
        }
    }
}

/// Every format, with and without padding; and a camera that runs, stalls and is lost.
pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    for code in 0..CODES.len() as u8 {
        let of = |columns: u16, stride: u16| {
            let mut seed = vec![0, code];
            for word in [columns - FRAME_SIDE_PX_MIN, 1, stride, 0] {
                seed.extend(word.to_le_bytes());
            }
            seed.extend([1, 3, 0]);
            seed.extend((0..200_u8).map(|it| it.wrapping_mul(37)));
            seed
        };
        seeds.extend([of(64, 0), of(64, 260)]);
    }
    let mut jpeg = vec![0, 14, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 60);
    let grey = [128; 64 * 64];
    encoder.encode(&grey, 64, 64, jpeg_encoder::ColorType::Luma).expect("it can be written");
    seeds.push(jpeg);
    let done = |index: u8, bytes: u8, skipped: u8| {
        let mut event = vec![0, index, bytes, 0, 0, 32, 0, 0, skipped];
        event.extend([9, 0, 0, 0, 5, 0, 0, 0]);
        event
    };
    let look = &[7, 0][..];
    let good = [&[1, 4, 100, 0][..], &done(0, 100, 0), look, &done(1, 100, 1), look].concat();
    let many = [&done(0, 100, 1), &done(1, 100, 1)[..], &done(2, 100, 1), &done(3, 9, 1)].concat();
    seeds.push([&good[..], &many, look, look, look].concat());
    seeds.push([&good[..], &done(2, 100, 5), &[6, 1, 0, 7, 1], look].concat());
    seeds.push([&good[..], &[4, 19], look].concat());
    seeds.push([&good[..], &[5, 0], &done(0, 1, 1), look].concat());
    seeds
}
