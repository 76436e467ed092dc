//! The wires to other devices: a GPIO line whose edges become packets, and one that marks the frames
//! or the trial.
//!
//! ```text
//! lines    the kernel's lines (gpiocdev): opened, read, driven
//! sieve    which edges are triggers: kind, bouncing, what was lost
//! ```
//!
//! The kernel stamps an edge in its interrupt, by CLOCK_MONOTONIC, the clock of the frames. So it does
//! not matter when the edge is read: once in each turn of the main loop. A contact's bouncing is
//! sorted out here and not by the kernel, which would stamp the edge when the bouncing is over.
//!
//! A line that is not there is opened again and again. Nothing here waits, and nothing allocates but
//! the opening.

mod lines;
mod sieve;

use std::time::{Duration, Instant};

use plumbline::config::{Capture, Marked, TriggerInput, TriggerLines, TriggerOutput};
use plumbline::packet::{Trigger, TriggerHealth, TriggerState};

use lines::{Input, Output};
use sieve::Sieve;

/// A line that is not there is tried again after this time.
const RETRY: Duration = Duration::from_secs(1);

/// A pulse is this long, or half a frame's period if that is shorter: recorders of 1 kHz see it.
const PULSE: Duration = Duration::from_millis(2);

/// Triggers that are passed on in one turn; the kernel keeps as many.
pub const PER_TURN_MAX: usize = lines::KEPT_MAX as usize;

/// The trigger of a box, which may have none.
#[derive(Debug, Default)]
pub struct Triggers {
    wired: Option<Wired>,
}

/// The lines of a configuration.
#[derive(Debug)]
struct Wired {
    lines: TriggerLines,
    input: Option<Input>,
    output: Option<Output>,
    sieve: Sieve,
    pulse: Duration,
    pulses: u32,
    /// When lines that are missing are tried again.
    retry_at: Instant,
    /// Whether the log says that one is missing.
    is_told: bool,
}

impl Triggers {
    /// The trigger of a configuration; its lines are opened by the first
    /// [`look_after`](Self::look_after).
    #[must_use]
    pub fn of(lines: Option<&TriggerLines>, capture: Option<&Capture>) -> Self {
        let half_period =
            capture.map(|it| Duration::from_secs_f64(0.5 / f64::from(it.rate_hz.max(1.0))));
        let wired = lines.map(|lines| Wired {
            sieve: Sieve::new(lines.input.as_ref()),
            lines: lines.clone(),
            input: None,
            output: None,
            pulse: half_period.map_or(PULSE, |half| half.min(PULSE)),
            pulses: 0,
            retry_at: Instant::now(),
            is_told: false,
        });
        Self { wired }
    }

    /// Opens lines that are missing, if it is time to, and ends a pulse that has been long enough.
    /// Returns whether it has opened one, or tried to, which allocates.
    pub fn look_after(&mut self, now: Instant) -> bool {
        let Some(wired) = &mut self.wired else { return false };
        wired.drive(|output| output.lower_in_time(now));
        if !wired.is_missing() || now < wired.retry_at {
            return false;
        }
        wired.retry_at = now + RETRY;
        wired.open();
        true
    }

    /// When [`look_after`](Self::look_after) must be called at the latest, for a pulse to end in time.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        self.wired.as_ref()?.output.as_ref()?.pulse_until()
    }

    /// The next trigger, if there is one; of a line that changes faster than anybody needs, the rest
    /// waits for the next turn.
    pub fn read(&mut self) -> Option<Trigger> {
        let wired = self.wired.as_mut()?;
        for _ in 0..lines::KEPT_MAX {
            match wired.input.as_mut()?.next() {
                Ok(None) => return None,
                Ok(Some(event)) => {
                    if let Some(trigger) = wired.sieve.take(&event) {
                        return Some(trigger);
                    }
                }
                Err(error) => {
                    wired.input = None;
                    wired.lost(&error);
                    return None;
                }
            }
        }
        None
    }

    /// A frame has been measured, and its packet is about to be sent.
    pub fn mark_frame(&mut self, now: Instant) {
        let Some(wired) = &mut self.wired else { return };
        if wired.marks() != Some(Marked::Exposures) {
            return;
        }
        let until = now + wired.pulse;
        if wired.drive(|output| output.pulse(until)) {
            wired.pulses = wired.pulses.wrapping_add(1);
        }
    }

    /// Whether a listener records a trial.
    pub fn mark_recording(&mut self, is_recorded: bool) {
        let Some(wired) = &mut self.wired else { return };
        if wired.marks() != Some(Marked::Recording) {
            return;
        }
        let was_high = wired.output.as_ref().is_some_and(Output::is_high);
        if wired.drive(|output| output.set(is_recorded)) && is_recorded && !was_high {
            wired.pulses = wired.pulses.wrapping_add(1);
        }
    }

    /// How the lines are doing.
    #[must_use]
    pub fn health(&self) -> TriggerHealth {
        let Some(wired) = &self.wired else { return TriggerHealth::default() };
        let state = |is_wanted: bool, is_open: bool| match (is_wanted, is_open) {
            (false, _) => TriggerState::Off,
            (true, true) => TriggerState::Ready,
            (true, false) => TriggerState::Missing,
        };
        TriggerHealth {
            input: state(wired.lines.input.is_some(), wired.input.is_some()),
            output: state(wired.lines.output.is_some(), wired.output.is_some()),
            sent: wired.sieve.sent(),
            bounces: wired.sieve.bounces(),
            dropped: wired.sieve.dropped(),
            pulses: wired.pulses,
        }
    }
}

impl Wired {
    fn marks(&self) -> Option<Marked> {
        self.lines.output.map(|output| output.marks)
    }

    fn is_missing(&self) -> bool {
        (self.lines.input.is_some() && self.input.is_none())
            || (self.lines.output.is_some() && self.output.is_none())
    }

    /// Opens what is missing.
    fn open(&mut self) {
        let opened = self.try_to_open();
        match opened {
            Ok(()) => {
                log::info!("trigger: the lines of {} are in use", self.lines.chip);
                self.is_told = false;
            }
            Err(error) => self.tell(&error),
        }
    }

    /// Either line is opened, whatever becomes of the other one.
    fn try_to_open(&mut self) -> anyhow::Result<()> {
        let path = lines::find_chip(&self.lines.chip)?;
        let mut failed = None;
        if let (Some(TriggerOutput { line, .. }), None) = (self.lines.output, &self.output) {
            match Output::open(&path, line) {
                Ok(output) => self.output = Some(output),
                Err(error) => failed = Some(error),
            }
        }
        if let (Some(TriggerInput { line, .. }), None) = (self.lines.input, &self.input) {
            match Input::open(&path, line) {
                Ok(input) => {
                    self.input = Some(input);
                    self.sieve.start_over();
                }
                Err(error) => failed = Some(error),
            }
        }
        failed.map_or(Ok(()), Err)
    }

    /// Drives the output line, if there is one; returns whether that has been done.
    fn drive(&mut self, drive: impl FnOnce(&mut Output) -> anyhow::Result<()>) -> bool {
        let Some(output) = &mut self.output else { return false };
        let Err(error) = drive(output) else { return true };
        self.output = None;
        self.lost(&error);
        false
    }

    fn lost(&mut self, error: &anyhow::Error) {
        self.retry_at = Instant::now() + RETRY;
        self.tell(error);
    }

    /// Once, until it is mended.
    fn tell(&mut self, error: &anyhow::Error) {
        if !std::mem::replace(&mut self.is_told, true) {
            log::error!("trigger: {error:#}; trying again until it is there");
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline::config::Edges;

    use super::*;

    fn lines(chip: &str) -> TriggerLines {
        TriggerLines {
            chip: chip.try_into().unwrap(),
            input: Some(TriggerInput { line: 0, edges: Edges::Rising, debounce_us: 0 }),
            output: Some(TriggerOutput { line: 1, marks: Marked::Exposures }),
        }
    }

    #[test]
    fn a_box_without_wires_has_none() {
        let mut triggers = Triggers::of(None, None);
        let now = Instant::now();
        triggers.mark_frame(now);
        triggers.mark_recording(true);
        assert!(!triggers.look_after(now));
        assert_eq!((triggers.read(), triggers.due()), (None, None));
        assert_eq!(triggers.health(), TriggerHealth::default());
    }

    #[test]
    fn a_chip_that_is_not_there_is_missing_and_tried_once_a_second() {
        for chip in ["/dev/no-such-chip", "no such label", "/dev/null"] {
            let mut triggers = Triggers::of(Some(&lines(chip)), None);
            let now = Instant::now();
            assert!(triggers.look_after(now), "{chip}");
            assert!(!triggers.look_after(now + RETRY / 2), "{chip}");
            assert!(triggers.look_after(now + RETRY), "{chip}");
            triggers.mark_frame(now);
            assert_eq!(triggers.read(), None);
            let TriggerHealth { input, output, pulses, .. } = triggers.health();
            assert_eq!((input, output), (TriggerState::Missing, TriggerState::Missing));
            assert_eq!(pulses, 0);
        }
    }

    #[test]
    fn what_is_wrong_with_a_chip_is_said() {
        let said = |chip: &str| {
            let error = lines::find_chip(chip).and_then(|path| Input::open(&path, 0).map(drop));
            format!("{:#}", error.unwrap_err())
        };
        assert!(said("/dev/no-such-chip").contains("/dev/no-such-chip"));
        assert!(said("no such label").contains("no GPIO chip has the label \"no such label\""));
        assert!(said("/dev/null").contains("/dev/null"));
    }
}
