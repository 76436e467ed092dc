//! Video4Linux cameras: USB cameras, HDMI grabbers, and others whose driver
//! gives complete pictures.
//!
//! `device` finds the camera and settles format, size and rate; `controls` fixes
//! exposure and gain; `intake` takes the frames off the driver's queue, with
//! `buffers` to track who owns which buffer and `stamp` to tell when a frame was
//! captured; `luma` finds the grey values. `driver` and `mapping` are the only
//! parts that touch the kernel, and the only ones with unsafe code.
//!
//! Frames are read in the driver's own memory where the format allows. Waiting
//! for frames and giving them does not allocate, except to decode compressed ones;
//! losing the camera does, once. A frame that was given stays intact until the next
//! wait.

pub mod buffers;
mod controls;
mod device;
mod driver;
pub mod intake;
pub mod luma;
pub mod mapping;
mod stamp;

use std::time::Instant;

use anyhow::{Context, Result, ensure};
use plumbline::config::Capture;

use super::Frame;
use super::camera::{Counts, Device, Waited};
use crate::allocation;
use buffers::BUFFERS_MAX;
use driver::Driver;
use intake::{BUFFERS_MIN, Intake};
use luma::Luma;
use mapping::Mapping;

/// The program may hold three at once, which leaves as many to the driver: more
/// than the newest two frames, which are all that is ever used of a backlog.
const BUFFERS_ASKED: u32 = 6;

/// A running camera.
#[derive(Debug)]
pub struct V4l2 {
    path: String,
    luma: Luma,
    intake: Intake,
    stream: Stream,
    /// Whether reading a frame allocated, which is said once.
    has_allocated: bool,
    /// Whether a frame could not be read, which is said once.
    has_refused: bool,
}

/// The driver's buffers in this process's memory.
///
/// Dropped in the only order that the kernel accepts: streaming stops, the memory
/// is unmapped, the buffers are freed, the device is closed.
#[derive(Debug)]
struct Stream {
    mappings: Vec<Mapping>,
    driver: Driver,
}

impl Stream {
    /// Asks for buffers and maps them.
    fn new(driver: Driver, bytes_min: usize) -> Result<Self> {
        let mut stream = Self { mappings: Vec::new(), driver };
        let driver = &stream.driver;
        let count = driver
            .request_buffers(BUFFERS_ASKED)
            .context("its driver gives no buffers: does another program use it?")?;
        ensure!(
            count >= BUFFERS_MIN,
            "its driver gives {count} buffers, and at least {BUFFERS_MIN} are needed"
        );
        for index in 0..count.min(BUFFERS_MAX as u32) {
            let mapping = driver.map(index).context("a buffer cannot be mapped")?;
            ensure!(
                mapping.len_bytes() >= bytes_min,
                "its buffers have {} bytes, and a frame takes {bytes_min}",
                mapping.len_bytes()
            );
            stream.mappings.push(mapping);
        }
        Ok(stream)
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // A device that is gone answers with errors, but it has stopped anyway.
        let _ = self.driver.stop();
        self.mappings.clear();
        let _ = self.driver.request_buffers(0);
    }
}

impl V4l2 {
    fn start(settled: device::Settled, capture: &Capture, width_px: usize) -> Result<Self> {
        let device::Settled { driver, path, luma } = settled;
        for warning in controls::set_up(&driver, capture, width_px)? {
            log::warn!("camera: {path}: {warning}");
        }
        let stream = Stream::new(driver, luma.bytes_min())?;
        let intake = Intake::new(&stream.driver, stream.mappings.len(), luma.bytes_min())
            .context("its driver does not take its buffers")?;
        stream.driver.start().context("it does not start")?;
        Ok(Self { path, luma, intake, stream, has_allocated: false, has_refused: false })
    }

    /// Reads the grey values of the frame that arrived.
    fn load(&mut self) -> Result<()> {
        let arrived = self.intake.out().expect("the wait has found a frame");
        let bytes = self.stream.mappings[arrived.ours.index() as usize].bytes(&arrived.ours);
        let bytes = &bytes[..arrived.bytes.min(bytes.len())];
        let started = Instant::now();
        let (loaded, allocated) = allocation::apart(|| self.luma.load(bytes));
        if allocated.count > 0 && loaded.is_ok() && !self.has_allocated {
            self.has_allocated = true;
            log::info!(
                "camera: {}: decoding a frame took {} us and {} heap allocations ({} KiB), which \
                 Health leaves out",
                self.path,
                started.elapsed().as_micros(),
                allocated.count,
                allocated.bytes / 1024
            );
        }
        loaded
    }

    /// Counts the frame that arrived as missed.
    fn refuse(&mut self, error: &anyhow::Error) {
        self.intake.refuse();
        if !self.has_refused {
            self.has_refused = true;
            log::warn!(
                "camera: {}: a frame cannot be read: {error:#}; it and all further ones count as \
                 missed frames",
                self.path
            );
        }
    }
}

impl Device for V4l2 {
    fn open(capture: &Capture, size_px: (usize, usize)) -> Result<Self> {
        let settled = device::settle(capture, size_px)?;
        let path = settled.path.clone();
        Self::start(settled, capture, size_px.0).context(path)
    }

    fn wait(&mut self, until: Instant) -> Waited {
        loop {
            match self.intake.wait(&self.stream.driver, until) {
                Waited::Lost(what) => return Waited::Lost(format!("{}: {what}", self.path)),
                Waited::Quiet => return Waited::Quiet,
                Waited::Ready => {}
            }
            match self.load() {
                Ok(()) => return Waited::Ready,
                Err(error) => self.refuse(&error),
            }
            // A camera whose frames are all damaged must not hold up the loop.
            if Instant::now() >= until {
                return Waited::Quiet;
            }
        }
    }

    fn frame(&self) -> Frame<'_> {
        let arrived = self.intake.out().expect("a frame is asked for after a wait that found one");
        let mapping = &self.stream.mappings[arrived.ours.index() as usize];
        let pixels = self
            .luma
            .view(mapping.bytes(&arrived.ours), mapping.words(&arrived.ours))
            .expect("every mapping was found to hold a frame when the camera was opened");
        Frame {
            pixels,
            capture_time_ns: arrived.stamp.capture_time_ns,
            instant: arrived.stamp.instant,
            ready_at: arrived.stamp.ready_at,
            late: self.intake.is_late(),
        }
    }

    fn counts(&self) -> Counts {
        self.intake.counts()
    }
}
