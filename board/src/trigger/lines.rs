//! The kernel's lines.
//!
//! The crate gpiocdev makes the calls of the kernel's GPIO character device, uAPI v2. Its
//! `read_edge_event` reads up to eight events and gives the first, so that events are read here into
//! a buffer of one's own.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, anyhow, ensure};
use gpiocdev::chip::{Chip, chips};
use gpiocdev::line::{EdgeDetection, EdgeEvent, EventClock, Value};
use gpiocdev::request::{Builder, Request};

/// Who uses the lines, for `gpioinfo` and its like.
const CONSUMER: &str = "plumbline";

/// Edges that the kernel keeps until they are read: a turn of the main loop is 20 ms at most.
pub(super) const KEPT_MAX: u32 = 64;

/// Edges that are read at once.
const READ_MAX: usize = 16;

/// Words of 8 bytes of `struct gpio_v2_line_event`.
const EVENT_WORDS: usize = 6;

/// The chip's device: it is given as a path, or as a label.
///
/// # Errors
/// When there is none with this label.
pub(super) fn find_chip(chip: &str) -> Result<PathBuf> {
    if chip.starts_with('/') {
        return Ok(chip.into());
    }
    let all = chips().context("the GPIO chips cannot be listed")?;
    let mut labels = Vec::new();
    for path in all {
        let info = Chip::from_path(&path).and_then(|it| it.info());
        let info = info.with_context(|| path.display().to_string())?;
        if info.label == chip || info.name == chip {
            return Ok(path);
        }
        labels.push(info.label);
    }
    let there = if labels.is_empty() { "there is none".to_owned() } else { labels.join(", ") };
    Err(anyhow!("no GPIO chip has the label {chip:?}: {there}"))
}

/// Asks the kernel for a line, set up so; returns with it the words for where it is.
///
/// # Errors
/// When the chip or the line is not there, or somebody else uses it.
fn request(
    chip: &Path,
    line: u16,
    set_up: impl FnOnce(&mut Builder) -> &mut Builder,
) -> Result<(Request, String)> {
    let place = format!("line {line} of {}", chip.display());
    let mut builder = Request::builder();
    builder.on_chip(chip).with_consumer(CONSUMER).with_line(line.into());
    let request = set_up(&mut builder).request().with_context(|| place.clone())?;
    Ok((request, place))
}

/// The line that is listened to.
#[derive(Debug)]
pub(super) struct Input {
    request: Request,
    place: String,
    read: VecDeque<EdgeEvent>,
}

impl Input {
    /// Asks the kernel for both edges of a line.
    ///
    /// # Errors
    /// When the chip or the line is not there, or somebody else uses it.
    pub(super) fn open(chip: &Path, line: u16) -> Result<Self> {
        let (request, place) = request(chip, line, |it| {
            it.as_input()
                .with_edge_detection(EdgeDetection::BothEdges)
                .with_event_clock(EventClock::Monotonic)
                .with_kernel_event_buffer_size(KEPT_MAX)
        })?;
        ensure!(request.edge_event_u64_size() == EVENT_WORDS, "{place}: events of another size");
        Ok(Self { request, place, read: VecDeque::with_capacity(READ_MAX) })
    }

    /// The next edge, if there is one.
    ///
    /// # Errors
    /// When the line has gone.
    pub(super) fn next(&mut self) -> Result<Option<EdgeEvent>> {
        if self.read.is_empty() {
            self.read_some().with_context(|| self.place.clone())?;
        }
        Ok(self.read.pop_front())
    }

    fn read_some(&mut self) -> Result<()> {
        if !self.request.has_edge_event()? {
            return Ok(());
        }
        let mut words = [0; READ_MAX * EVENT_WORDS];
        let read = self.request.read_edge_events_into_slice(&mut words)?;
        for event in words[..read].chunks_exact(EVENT_WORDS) {
            self.read.push_back(self.request.edge_event_from_slice(event)?);
        }
        Ok(())
    }
}

/// The line that is driven.
#[derive(Debug)]
pub(super) struct Output {
    request: Request,
    place: String,
    is_high: bool,
    pulse_until: Option<Instant>,
}

impl Output {
    /// Asks the kernel for the line, and drives it low.
    ///
    /// # Errors
    /// When the chip or the line is not there, or somebody else uses it.
    pub(super) fn open(chip: &Path, line: u16) -> Result<Self> {
        let (request, place) = request(chip, line, |it| it.as_output(Value::Inactive))?;
        Ok(Self { request, place, is_high: false, pulse_until: None })
    }

    pub(super) fn is_high(&self) -> bool {
        self.is_high
    }

    /// When the pulse that is under way is to end.
    pub(super) fn pulse_until(&self) -> Option<Instant> {
        self.pulse_until
    }

    /// Drives it high until then; a pulse that has not ended ends first.
    ///
    /// # Errors
    /// When the line has gone.
    pub(super) fn pulse(&mut self, until: Instant) -> Result<()> {
        self.set(false)?;
        self.set(true)?;
        self.pulse_until = Some(until);
        Ok(())
    }

    /// Drives it low again, if the pulse has been long enough.
    ///
    /// # Errors
    /// When the line has gone.
    pub(super) fn lower_in_time(&mut self, now: Instant) -> Result<()> {
        if self.pulse_until.is_some_and(|until| now >= until) {
            self.pulse_until = None;
            return self.set(false);
        }
        Ok(())
    }

    /// Drives it.
    ///
    /// # Errors
    /// When the line has gone.
    pub(super) fn set(&mut self, is_high: bool) -> Result<()> {
        if self.is_high == is_high {
            return Ok(());
        }
        let value = if is_high { Value::Active } else { Value::Inactive };
        self.request.set_lone_value(value).with_context(|| self.place.clone())?;
        self.is_high = is_high;
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // The line may have gone.
        let _ = self.set(false);
    }
}
