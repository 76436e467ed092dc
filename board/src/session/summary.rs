//! The figures of a session, for people.

use std::time::Duration;

use crate::link::Counts;
use crate::measure::Durations;
use crate::source::Condition;

use plumbline::packet::LINKS_MAX;

/// How a session ended.
#[derive(Debug)]
pub struct Ended {
    /// The figures.
    pub summary: Summary,
    /// Why the source broke, when it did.
    pub broken: Option<String>,
    /// The host has asked for a restart.
    pub reboot: bool,
}

/// The figures of a session.
#[derive(Debug)]
pub struct Summary {
    /// Frames tracked.
    pub frames: u64,
    /// Of them, those taken up when the next one was already due.
    pub late: u64,
    /// What the source says of itself.
    pub source: Condition,
    /// Time in the pipeline, per frame.
    pub step: Durations,
    /// From the instant that a frame's time marks to its packet's being handed to the links.
    pub latency: Durations,
    /// What became of the packets, per link.
    pub links: heapless::Vec<(String, Counts), LINKS_MAX>,
    /// Heap allocations of the whole process between the end of the first frame
    /// and the end of the last.
    pub allocations: u64,
}

impl std::fmt::Display for Summary {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        let Condition { frames_dropped, frames_missed, camera_losses, .. } = self.source;
        writeln!(
            formatter,
            "frames       {} ({} late), {frames_dropped} dropped, {frames_missed} missed, \
             camera lost {camera_losses} times",
            self.frames, self.late
        )?;
        for (name, durations) in [("step time", &self.step), ("latency", &self.latency)] {
            writeln!(
                formatter,
                "{name:<12} median {:.3} ms, worst {:.3} ms",
                ms(durations.median()),
                ms(durations.worst())
            )?;
        }
        for (name, counts) in &self.links {
            writeln!(
                formatter,
                "packets      {} sent, {} dropped ({name})",
                counts.sent, counts.dropped
            )?;
        }
        write!(formatter, "allocations  {} after the first frame", self.allocations)
    }
}
