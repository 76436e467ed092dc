//! Takes frames off the driver's queue and keeps the newest two, in order.
//!
//! In each wait the frame of the previous wait goes back to the driver, all frames
//! that are done are taken, those older than the newest two go back and are counted,
//! and the first of the two is given. The other is there for the next wait. At most
//! three buffers are away from the driver at any time, two between waits. If the
//! loop stops for longer than the driver's buffers last, it finds the frames from
//! the beginning of that time, with their true stamps, and a gap after them.
//!
//! The kernel is reached through [`Queue`], so that the tests can simulate a driver
//! with any fault. Nothing is allocated unless the camera is lost.

use std::io;
use std::time::{Duration, Instant};

use v4l::v4l_sys::V4L2_BUF_FLAG_ERROR;

use super::super::camera::{Counts, Waited};
use super::super::newest::{NEWEST, Newest};
use super::super::stamp::{Now, Sequence, Stamp};
use super::buffers::{Buffers, Ours};
use super::stamp::stamp;

/// The smallest number of buffers that leaves the driver one while three are away from it.
pub const BUFFERS_MIN: u32 = NEWEST as u32 + 2;

/// The driver's side of the queue; only [`wait`](Self::wait) blocks.
pub trait Queue {
    /// Gives the driver a buffer to fill.
    fn queue(&self, index: u32) -> io::Result<()>;

    /// Takes back a buffer that is done, if there is one.
    fn dequeue(&self) -> io::Result<Option<Dequeued>>;

    /// Waits until a frame is done or something has changed.
    fn wait(&self, timeout: Duration) -> io::Result<Wake>;

    /// Both clocks.
    fn now(&self) -> Now;
}

/// What the driver reports about a buffer that it gives back.
#[derive(Debug, Clone, Copy, Default)]
pub struct Dequeued {
    /// Which buffer.
    pub index: u32,
    /// The number of bytes filled.
    pub bytes: usize,
    /// Bits `V4L2_BUF_FLAG_*`.
    pub flags: u32,
    /// The frame's number.
    pub sequence: u32,
    /// The stamp's whole seconds.
    pub stamp_s: i64,
    /// The stamp's microseconds.
    pub stamp_us: i64,
}

/// Why a wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wake {
    /// The time was up, or a signal interrupted it.
    Nothing,
    /// A buffer is done.
    Frame,
    /// The video signal at the input has changed.
    SignalChanged,
    /// No more frames will come.
    Broken,
}

impl Wake {
    /// From the events that `poll` reports.
    pub fn from_events(events: i16) -> Self {
        let has = |event| events & event != 0;
        if has(libc::POLLERR | libc::POLLHUP | libc::POLLNVAL) {
            Self::Broken
        } else if has(libc::POLLPRI) {
            Self::SignalChanged
        } else if has(libc::POLLIN) {
            Self::Frame
        } else {
            Self::Nothing
        }
    }
}

/// A frame in a buffer of ours.
#[derive(Debug)]
pub struct Arrived {
    /// The buffer.
    pub ours: Ours,
    /// The number of bytes that the camera has written.
    pub bytes: usize,
    /// Its capture time.
    pub stamp: Stamp,
}

/// All buffers of a running queue, and the frames in them.
#[derive(Debug)]
pub struct Intake {
    buffers: Buffers,
    /// A frame with fewer bytes is damaged.
    bytes_min: usize,
    sequence: Sequence,
    waiting: Newest<Arrived>,
    out: Option<Arrived>,
    counts: Counts,
}

impl Intake {
    /// Gives all buffers to the driver.
    ///
    /// # Errors
    /// When it does not accept one.
    pub fn new(queue: &impl Queue, count: usize, bytes_min: usize) -> io::Result<Self> {
        let (buffers, all) = Buffers::new(count);
        let mut intake = Self {
            buffers,
            bytes_min,
            sequence: Sequence::default(),
            waiting: Newest::new(),
            out: None,
            counts: Counts::default(),
        };
        for ours in all {
            intake.give(queue, ours)?;
        }
        Ok(intake)
    }

    /// Waits for a frame, but not beyond `until`.
    pub fn wait(&mut self, queue: &impl Queue, until: Instant) -> Waited {
        match self.next(queue, until) {
            Ok(true) => Waited::Ready,
            Ok(false) => Waited::Quiet,
            Err(what) => Waited::Lost(what),
        }
    }

    /// The frame that the last wait found.
    pub fn out(&self) -> Option<&Arrived> {
        self.out.as_ref()
    }

    /// Counts the frame that the last wait found as one that never came: it cannot be read.
    pub fn refuse(&mut self) {
        self.counts.missed += 1;
    }

    /// Whether the frame after the one given has already arrived.
    pub fn is_late(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Frames that were not handed out.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    fn next(&mut self, queue: &impl Queue, until: Instant) -> Result<bool, String> {
        if let Some(arrived) = self.out.take() {
            self.give(queue, arrived.ours).map_err(|error| lost(&error))?;
        }
        loop {
            self.take_done(queue)?;
            self.out = self.waiting.pop();
            if self.out.is_some() {
                return Ok(true);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(false);
            }
            match queue.wait(left).map_err(|error| lost(&error))? {
                Wake::Nothing | Wake::Frame => {}
                Wake::SignalChanged => return Err("the signal at its input changed".into()),
                // The call for a frame reports what is wrong.
                Wake::Broken => match queue.dequeue() {
                    Err(error) => return Err(lost(&error)),
                    Ok(_) => return Err("its driver reports an error".into()),
                },
            }
        }
    }

    /// Takes every frame that is done. The number of iterations is bounded by the driver's
    /// buffers, so that a driver faster than this loop cannot hold it up.
    fn take_done(&mut self, queue: &impl Queue) -> Result<(), String> {
        for _ in 0..self.buffers.with_driver() {
            let Some(done) = queue.dequeue().map_err(|error| lost(&error))? else {
                break;
            };
            let now = queue.now();
            let ours = self.buffers.take(done.index).map_err(|refused| refused.to_string())?;
            self.counts.missed += self.sequence.missed_before(done.sequence);
            let free = if done.flags & V4L2_BUF_FLAG_ERROR != 0 || done.bytes < self.bytes_min {
                self.counts.missed += 1;
                Some(ours)
            } else {
                let stamp = stamp(done.flags, done.stamp_s, done.stamp_us, now);
                self.keep(Arrived { ours, bytes: done.bytes, stamp })
            };
            if let Some(ours) = free {
                self.give(queue, ours).map_err(|error| lost(&error))?;
            }
        }
        Ok(())
    }

    /// Queues a frame; if there are too many, returns the buffer of the oldest.
    fn keep(&mut self, arrived: Arrived) -> Option<Ours> {
        let oldest = self.waiting.push(arrived)?;
        self.counts.dropped += 1;
        Some(oldest.ours)
    }

    fn give(&mut self, queue: &impl Queue, ours: Ours) -> io::Result<()> {
        queue.queue(ours.index())?;
        self.buffers.give(ours);
        Ok(())
    }
}

fn lost(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::ENODEV) => "it was unplugged".into(),
        _ => format!("its driver reports: {error}"),
    }
}

#[cfg(test)]
mod tests;
