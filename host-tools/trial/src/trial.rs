//! A trial as its packets have it.

use std::path::PathBuf;

use plumbline::config::Config;
use plumbline::packet::View;
use plumbline_stream::power::PowerSeen;

use super::frame::{Frame, Trunk};
use super::manifest::Manifest;

/// A recording.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Its folder.
    pub folder: PathBuf,
    /// What its packets say of it as a whole.
    pub manifest: Manifest,
    /// The box's configuration, if the box sent it, with what was replaced afterwards.
    pub config: Option<Config>,
    /// What else the packets tell.
    pub observed: Observed,
    /// In the order of their times.
    pub frames: Vec<Frame>,
    /// When the first was captured, seconds since 1970 by this computer's clock.
    pub first_frame_utc_s: Option<f64>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// What the packets tell of the circumstances of a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Observed {
    /// The box was given another configuration during the trial.
    pub config_changed: bool,
    /// Other boxes that sent to the same computer.
    pub others: Vec<String>,
    /// What the box has told of its power supply.
    pub power: PowerSeen,
    /// How frames looked, every few seconds.
    pub views: Vec<View>,
    /// Bytes that belong to no packet.
    pub damaged_bytes: u64,
}

impl Trial {
    /// Whether a trunk's target was seen in any frame.
    pub(crate) fn sees_a_target(&self) -> bool {
        let is_seen = |frame: &Frame, trunk| frame.cam_from_target(trunk).is_some();
        self.frames.iter().any(|frame| Trunk::ALL.into_iter().any(|trunk| is_seen(frame, trunk)))
    }

    /// From the first frame to the last.
    #[must_use]
    pub fn length_s(&self) -> f64 {
        let time_s = |frame: Option<&Frame>| frame.map_or(0.0, |frame| frame.time_s);
        time_s(self.frames.last()) - time_s(self.frames.first())
    }

    /// The camera's frames per second on average over the runs of the box, pauses included: frames
    /// that were lost on the way count, too. `None` where the runs have no length.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let pairs = self.frames.windows(2).filter(|pair| pair[0].session == pair[1].session);
        let (steps, length_s) = pairs.fold((0_u64, 0.0), |(steps, length_s), pair| {
            (steps + 1, length_s + (pair[1].time_s - pair[0].time_s))
        });
        let lost = self.manifest.packets.map_or(0, |packets| packets.lost);
        (length_s > 0.0).then(|| (steps + lost) as f64 / length_s)
    }

    /// The participant and the condition or, without them, the folder's name.
    #[must_use]
    pub fn title(&self) -> String {
        let folder = self.folder.file_name().map(|name| name.to_string_lossy().into_owned());
        let parts = [self.manifest.participant.clone(), self.manifest.condition.clone()];
        let named: Vec<String> = parts.into_iter().flatten().collect();
        if named.is_empty() { folder.unwrap_or_default() } else { named.join(", ") }
    }
}
