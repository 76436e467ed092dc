//! The figures of a session, for people.

use std::time::Duration;

use super::durations::Durations;
use crate::link::Counts;
use crate::source::Condition;

use plumbline::packet::{CameraState, LINKS_MAX};

/// How a session ended.
#[derive(Debug)]
pub struct Ended {
    /// The figures.
    pub summary: Summary,
    /// Why the source failed, if it did.
    pub broken: Option<String>,
    /// Why packets could not be recorded, if they could not.
    pub unrecorded: Option<String>,
}

/// The figures of a session.
#[derive(Debug)]
pub struct Summary {
    /// Frames tracked.
    pub frames: u64,
    /// Those of them that were processed when the next one was already due.
    pub late: u64,
    /// The source's last condition.
    pub source: Condition,
    /// Time in the pipeline, per frame.
    pub step: Durations,
    /// From the instant that a frame's time marks until its packet has been passed to the links.
    pub latency: Durations,
    /// What became of the packets, per link.
    pub links: heapless::Vec<(String, Counts), LINKS_MAX>,
    /// Heap allocations of the whole process between the end of the first frame
    /// and the end of the last.
    pub allocations: u64,
}

impl Summary {
    fn camera(&self) -> String {
        let absent = matches!(self.source.camera, CameraState::Lost | CameraState::Stalled);
        if absent && self.frames == 0 {
            return "the camera never gave a frame".into();
        }
        let at_the_end = if absent { ", absent at the end" } else { "" };
        format!("camera lost {} times{at_the_end}", self.source.camera_losses)
    }
}

impl std::fmt::Display for Summary {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        let Condition { frames_dropped, frames_missed, .. } = self.source;
        writeln!(
            formatter,
            "frames       {} ({} late), {frames_dropped} dropped, {frames_missed} missed, {}",
            self.frames,
            self.late,
            self.camera()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_is_absent_at_the_end_is_reported() {
        let text = |frames, camera, camera_losses| {
            let source = Condition { camera, frames_dropped: 0, frames_missed: 0, camera_losses };
            let summary = Summary {
                frames,
                late: 0,
                source,
                step: Durations::new(),
                latency: Durations::new(),
                links: heapless::Vec::new(),
                allocations: 0,
            };
            summary.to_string()
        };
        for (frames, camera, losses, words) in [
            (0, CameraState::Lost, 0, "missed, the camera never gave a frame\n"),
            (9, CameraState::Lost, 1, "missed, camera lost 1 times, absent at the end\n"),
            (9, CameraState::Stalled, 2, "missed, camera lost 2 times, absent at the end\n"),
            (9, CameraState::Running, 1, "missed, camera lost 1 times\n"),
        ] {
            let text = text(frames, camera, losses);
            assert!(text.contains(words), "{text}");
        }
    }
}
