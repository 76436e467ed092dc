//! `trial.toml`: what is known of a trial as a whole.
//!
//! What a person has said is also in `packets.bin`, from the beginning of the recording: a
//! `trial.toml` that is lost or spoiled is made again with it ([`Manifest::restore`]).

mod restore;

use std::path::Path;

use plumbline::packet::MarkedInstant;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_files::{from_toml, read_text};
use serde::{Deserialize, Serialize};

use super::correction::Corrected;
use super::mark::Source;
use super::names;
use super::verdict::{Criteria, Verdict};

/// The comment at the top of the file.
const HEADING: &str = "# Made of packets.bin. What a person has said may be corrected here: participant, condition,\n\
                       # note, zero (mark, start or onset), and overruled, by and why of the verdict; the rest is\n\
                       # made anew.\n\n";

/// The format that this program writes.
const FORMAT: u32 = 2;

/// What stands for the time of the beginning where it is not known.
const UNKNOWN: &str = "unknown";

const REMEDY: &str =
    "correct what is named; `plumb replay TRIAL --tables` makes the file again from the packets";

/// A trial as a whole. What only the end of a recording tells is absent while it is recorded, and
/// after one that was cut off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of this file.
    pub format: u32,
    /// Whether the recording was ended properly.
    pub state: State,
    /// When it began, by this computer's clock, UTC; "unknown" if neither the file nor the packets
    /// tell.
    pub started: String,
    /// Who was measured, as a code.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub participant: Option<String>,
    /// The condition under which.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
    /// Further notes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// What t = 0 is.
    pub zero: Zero,
    /// Which instant of a frame its time marks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instant: Option<MarkedInstant>,
    /// What the trial is worth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// What was replaced afterwards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrected: Option<Corrected>,
    /// The box.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub the_box: Option<BoxSeen>,
    /// What came.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packets: Option<Packets>,
    /// How the box's clock and this computer's were related, in each of the box's runs.
    #[serde(default, rename = "clock", skip_serializing_if = "Vec::is_empty")]
    pub clocks: Vec<ClockSeen>,
    /// Noise of each trunk point: see [`NoiseSeen`].
    #[serde(default, rename = "noise", skip_serializing_if = "Vec::is_empty")]
    pub noise: Vec<NoiseSeen>,
    /// What was amiss of the box when the recording began, or was not looked at.
    #[serde(default, rename = "check", skip_serializing_if = "Vec::is_empty")]
    pub checks: Vec<CheckSeen>,
    /// What happened.
    #[serde(default, rename = "event", skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<EventSeen>,
    /// What the verdict is by.
    #[serde(default)]
    pub criteria: Criteria,
}

/// How far a recording came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It is still being recorded, or was cut off.
    Recording,
    /// It was ended properly.
    Finished,
}

impl State {
    /// As the text of [`Manifest::about`] has it, whatever else is in it.
    pub(crate) fn told(about: &str) -> Option<Self> {
        #[derive(Deserialize)]
        struct Told {
            state: State,
        }
        toml::from_str(about).ok().map(|Told { state }| state)
    }
}

/// What t = 0 of a trial is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Zero {
    /// The mark with the label "zero"; without one the first mark; without any the first frame.
    #[default]
    Mark,
    /// The first frame.
    Start,
    /// The moment from which the person stands, found by the trunk's rise.
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
    /// The version of its firmware.
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
    /// Frames that never arrived.
    pub lost: u64,
    /// Frames that arrived after a later one; those from before the first are no part of the trial.
    pub late: u64,
    /// Packets that arrived again.
    pub repeated: u64,
    /// Packets in the recording that are damaged.
    pub corrupt: u64,
    /// Packets that were not the box's, by their seal: forged, damaged on the way, or of before. They
    /// are counted and change nothing.
    #[serde(default)]
    pub not_authentic: u64,
    /// Packets that no box sends: with a number or a time that cannot be true, or a position that no
    /// room holds.
    pub implausible: u64,
    /// Packets of another box than this one.
    pub other_box: u64,
    /// Packets of a second box that says it is this one, while this one sent.
    pub conflicting: u64,
    /// Pose packets of a start of a box that never said which box it is.
    pub unknown_start: u64,
    /// How often the box started.
    pub sessions: u32,
}

impl Packets {
    /// What a user should know of them.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.sessions > 1 {
            warnings.push(format!(
                "the box has started {} times: between its runs times are only as good as the \
                 arrival of its packets, and no path is measured across them; RMS, range and \
                 ellipse are of all runs together, and wrong if the camera was moved in between",
                self.sessions
            ));
        }
        for (count, what) in [
            (self.other_box, "of another box that sent here too; each needs a port of its own"),
            (
                self.conflicting,
                "of a second box that called itself this one while this one sent; check which was \
                 recorded",
            ),
            (self.unknown_start, "of a sender that never said which box it is"),
            (self.implausible, "with a number, time or position that cannot be true"),
        ] {
            if count > 0 {
                warnings.push(format!("left out: {} {what}", counted(count, "packet")));
            }
        }
        warnings
    }
}

/// The relation of the box's clock and this computer's during one run of the box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockSeen {
    /// The run, from 1.
    pub session: u32,
    /// The box's clock minus this computer's time since the recording began.
    pub offset_s: f64,
    /// Bound of the offset's error: half of the shortest round trip.
    pub uncertain_s: f64,
    /// How much faster the box's clock runs; absent where that cannot be distinguished from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drift_ppm: Option<f64>,
    /// The number of questions that the box answered.
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

/// A check of the box that was not passed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckSeen {
    /// What was looked at, as `plumb doctor` calls it.
    pub subject: String,
    /// How bad it is.
    pub verdict: CheckVerdict,
    /// What was seen, with figure and bound.
    pub seen: String,
}

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CheckVerdict {
    /// It was not looked at.
    Skipped,
    /// It measures, and could measure better.
    Warn,
    /// It does not measure, or what it measures is not to be used.
    Fail,
}

/// An event on the trial's clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EventSeen {
    /// Time since the first frame, of which [`Manifest::instant`] says the instant.
    pub time_s: f64,
    /// Its label.
    pub label: String,
    /// Where it comes from.
    pub source: Source,
    /// The name of the computer that sent it, if that is another one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sender: Option<String>,
    /// Bound of the error of its time: from the clocks' relation or, without one, from the delay of
    /// frames.
    pub uncertain_s: f64,
}

impl Manifest {
    /// The manifest of a trial that begins; `started` is the time of day, as RFC 3339 writes it.
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
            verdict: None,
            corrected: None,
            instant: None,
            the_box: None,
            packets: None,
            clocks: Vec::new(),
            noise: Vec::new(),
            checks: Vec::new(),
            events: Vec::new(),
            criteria: Criteria::default(),
        }
    }

    /// The verdict, which every trial has that was read from its packets.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        self.verdict.clone().unwrap_or_default()
    }

    /// The mark that defines t = 0: the first with the label "zero", else the first of all.
    #[must_use]
    pub fn zero_mark(&self) -> Option<&EventSeen> {
        let named = self.events.iter().find(|it| it.label.eq_ignore_ascii_case("zero"));
        named.or(self.events.first())
    }

    /// Reads the manifest of a trial's folder.
    ///
    /// # Errors
    /// When it is absent, or cannot be understood.
    pub fn read(folder: &Path) -> Result<Self, BadInput> {
        let path = folder.join(names::MANIFEST);
        if !path.exists() {
            return Err(BadInput::whole(
                path.display(),
                "it is not there",
                "give the folder of a trial; if the file was lost, `plumb replay TRIAL --tables` \
                 makes it again from the packets",
            ));
        }
        Self::parse(&read_text(&path)?, &path.display().to_string())
    }

    fn parse(text: &str, place: &str) -> Result<Self, BadInput> {
        // Of another format, any of its fields might be named instead.
        if let Some(format) = format_of(text).filter(|format| *format != FORMAT) {
            return Err(BadInput::new(
                place,
                "format",
                format!("{format}, and this program knows {FORMAT}"),
                "use the program that wrote it",
            ));
        }
        let manifest: Self = from_toml(text, place, REMEDY)?;
        manifest.verdict().check(place)?;
        manifest.criteria.check(place)?;
        Ok(manifest)
    }

    /// Writes it into a trial's folder, in place of the one that is there.
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

/// The format that a manifest says it has.
fn format_of(text: &str) -> Option<u32> {
    #[derive(Deserialize)]
    struct Format {
        format: u32,
    }
    toml::from_str(text).ok().map(|Format { format }| format)
}
