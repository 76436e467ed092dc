//! `trial.toml`: what is known of a trial as a whole.

use std::path::Path;

use plumbline::packet::MarkedInstant;
use plumbline_files::BadInput;
use plumbline_files::{from_toml, read_text};
use serde::{Deserialize, Serialize};

use super::mark::Source;
use super::names;

/// What a person who opens it should know.
const HEADING: &str = "# Made of packets.bin. What a person has said may be corrected here: participant, condition,\n\
                       # note, and zero (mark, start or onset); events and the rest are made anew.\n\n";

/// The format that this program writes.
const FORMAT: u32 = 1;

/// A trial as a whole. What is only known at the end is absent while it is recorded, and where
/// the recording was cut off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of this file.
    pub format: u32,
    /// Whether the recording came to its end.
    pub state: State,
    /// When it began, by this computer's clock, UTC.
    pub started: String,
    /// Who was measured, as a code.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub participant: Option<String>,
    /// Under which condition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
    /// Anything else.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// What t = 0 is.
    pub zero: Zero,
    /// Which instant of a frame its time marks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instant: Option<MarkedInstant>,
    /// The box.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub the_box: Option<BoxSeen>,
    /// What came.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packets: Option<Packets>,
    /// How the box's clock stood to this computer's, for each of the box's runs.
    #[serde(default, rename = "clock", skip_serializing_if = "Vec::is_empty")]
    pub clocks: Vec<ClockSeen>,
    /// Noise of each trunk point: see [`NoiseSeen`].
    #[serde(default, rename = "noise", skip_serializing_if = "Vec::is_empty")]
    pub noise: Vec<NoiseSeen>,
    /// What happened.
    #[serde(default, rename = "event", skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<EventSeen>,
}

/// How far a recording came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It goes on, or was cut off.
    Recording,
    /// It came to its end.
    Finished,
}

/// What t = 0 of a trial is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Zero {
    /// The mark called "zero", else the first mark, or the first frame where there is none.
    #[default]
    Mark,
    /// The first frame.
    Start,
    /// When the person stands, found by the trunk's rise.
    Onset,
}

/// The box that was heard.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSeen {
    /// Its name.
    pub device: String,
    /// Its serial number.
    pub serial_number: String,
    /// Its program.
    pub firmware: String,
    /// The checksum of its configuration, which holds its calibration: `config.plb`.
    pub config_crc: String,
}

/// Packets by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Packets {
    /// Frames.
    pub frames: u64,
    /// Frames that never came.
    pub lost: u64,
    /// Packets that came damaged.
    pub corrupt: u64,
    /// Starts of the box.
    pub sessions: u32,
}

/// Two clocks over one run of the box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockSeen {
    /// The run, from 1.
    pub session: u32,
    /// The box's clock minus this computer's since the recording began.
    pub offset_s: f64,
    /// The offset is wrong by this at most: half of the shortest round trip.
    pub uncertain_s: f64,
    /// How much faster the box's clock runs; absent where that cannot be told from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drift_ppm: Option<f64>,
    /// Questions that were answered.
    pub exchanges: usize,
}

/// The median of the standard deviations that the box gives for each frame, along each axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseSeen {
    /// `upper` or `lower`.
    pub trunk: String,
    /// Forward.
    pub ap_mm: f64,
    /// To the right.
    pub ml_mm: f64,
    /// Up.
    pub si_mm: f64,
}

/// An event on the trial's clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventSeen {
    /// Since the first frame's time, which is of its [instant](Manifest::instant).
    pub time_s: f64,
    /// What it is called.
    pub label: String,
    /// Who said so.
    pub source: Source,
    /// How far its time may be off: by the clocks, and without their relation by the frames' way.
    pub uncertain_s: f64,
}

impl Manifest {
    /// Of a trial that begins; `started` is the time of day, as RFC 3339 writes it.
    #[must_use]
    pub fn begin(
        started: String,
        participant: Option<String>,
        condition: Option<String>,
        note: Option<String>,
        zero: Zero,
    ) -> Self {
        Self {
            format: FORMAT,
            state: State::Recording,
            started,
            participant,
            condition,
            note,
            zero,
            instant: None,
            the_box: None,
            packets: None,
            clocks: Vec::new(),
            noise: Vec::new(),
            events: Vec::new(),
        }
    }

    /// The mark that says when t = 0 is: the first that is called so, else the first of all.
    #[must_use]
    pub fn zero_mark(&self) -> Option<&EventSeen> {
        let named = self.events.iter().find(|it| it.label.eq_ignore_ascii_case("zero"));
        named.or(self.events.first())
    }

    /// From a trial's folder.
    ///
    /// # Errors
    /// When it is absent, or cannot be understood.
    pub fn read(folder: &Path) -> Result<Self, BadInput> {
        let path = folder.join(names::MANIFEST);
        let place = path.display().to_string();
        let remedy = "`plumb receive --out` writes it; correct what is named";
        let manifest: Self = from_toml(&read_text(&path)?, &place, remedy)?;
        if manifest.format != FORMAT {
            return Err(BadInput::new(
                place,
                "format",
                format!("{}, and this program knows {FORMAT}", manifest.format),
                "use the program that wrote it, or update this one",
            ));
        }
        Ok(manifest)
    }

    /// Into a trial's folder, in the place of the one that is there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), BadInput> {
        let path = folder.join(names::MANIFEST);
        let text = toml::to_string(self).map_err(|error| {
            BadInput::whole(path.display(), error, "report it: every manifest can be written")
        })?;
        plumbline_files::replace(&path, format!("{HEADING}{text}").as_bytes())
    }
}
