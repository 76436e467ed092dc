//! Reads a trial from its packets: the only way to read a recording, whether it was ended properly
//! or cut off.

mod builder;

use std::path::{Path, PathBuf};

use nalgebra::Matrix3;
use plumbline::config::Config;
use plumbline::packet::View;
use plumbline::pose::{Cam, Pose, Target};
use plumbline_files::BadInput;
use plumbline_stream::power::PowerSeen;
use serde::{Deserialize, Serialize};

use self::builder::Builder;
use super::correction::Correction;
use super::journal::{Content, Reader};
use super::manifest::{Manifest, State};
use super::names;

/// A recording that has gone wrong must not fill the memory. Ten hours at 200 Hz.
pub(crate) const FRAMES_MAX: usize = 7_200_000;

/// A trunk point in one frame, along the body's axes: AP, ML, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// When its target was exposed, on the clock of [`Frame::time_s`]: later than the frame by as
    /// much as the camera's row was read later than the first one.
    pub time_s: f64,
    /// The position.
    pub position_mm: [f64; 3],
    /// Its covariance, from that of the target's pose. `None` where the trial has no configuration,
    /// which alone relates the target to the body.
    pub covariance_mm2: Option<Matrix3<f64>>,
}

/// One frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The box's run, from 1.
    pub session: u32,
    /// The number that the box gave it.
    pub sequence: u32,
    /// Time since the trial's first frame; [`Manifest::instant`] says of which instant.
    pub time_s: f64,
    /// The upper trunk.
    pub upper: Option<Point>,
    /// The lower trunk.
    pub lower: Option<Point>,
    /// theta1..6 of `cam_from_target`, as the box gave them: of the upper target, and of the
    /// lower.
    pub theta: [Option<[f32; 6]>; 2],
    /// Root mean square reprojection errors, pixels: of the upper target, and of the lower.
    pub rms_px: [Option<f32>; 2],
}

impl Frame {
    /// The point of a trunk.
    #[must_use]
    pub fn point(&self, trunk: Trunk) -> Option<&Point> {
        match trunk {
            Trunk::Upper => self.upper.as_ref(),
            Trunk::Lower => self.lower.as_ref(),
        }
    }

    /// The pose of the target that a trunk's point is fixed to.
    #[must_use]
    pub fn cam_from_target(&self, trunk: Trunk) -> Option<Pose<Cam, Target>> {
        let [upper, lower] = self.theta;
        let theta = match trunk {
            Trunk::Upper => upper,
            Trunk::Lower => lower,
        };
        Some(Pose::from_theta(theta?.map(f64::from)))
    }
}

/// One of the two points of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Trunk {
    /// At the shoulder.
    Upper,
    /// In front of the lower back.
    Lower,
}

impl Trunk {
    /// Both, in the order of the paper's tables.
    pub const ALL: [Self; 2] = [Self::Lower, Self::Upper];

    /// Its name in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Upper => "upper",
            Self::Lower => "lower",
        }
    }
}

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
    /// Reads a trial's folder.
    ///
    /// # Errors
    /// When there is no trial in it, or it cannot be read.
    pub fn open(folder: &Path) -> Result<Self, BadInput> {
        check_folder(folder)?;
        Self::open_as(folder, Manifest::read(folder)?)
    }

    /// Reads a trial's folder, whose manifest is this one.
    ///
    /// # Errors
    /// When its packets or its configuration cannot be read.
    pub(crate) fn open_as(folder: &Path, mut manifest: Manifest) -> Result<Self, BadInput> {
        let mut warnings = Vec::new();
        let recorded = read_config(folder, &mut warnings)?;
        let correction = Correction::read(folder, recorded.as_ref())?;
        if let Some(corrected) = &manifest.corrected {
            check_corrected(folder, &corrected.config_crc, correction.as_ref())?;
            warnings.push(corrected.words());
        } else if correction.is_some() {
            warnings.push(format!(
                "{} replaces what the box was told, by files that are not known any more",
                names::CORRECTED
            ));
        }
        let mut reader = Reader::open(&folder.join(names::JOURNAL))?;
        let mut builder = Builder::new(recorded, correction);
        while let Some(entry) = reader.next_entry()? {
            // A file of which the end is missing, as after a copy to a full disk, is cut off too.
            if let Content::About(text) = &entry.content {
                manifest.state = State::told(text).unwrap_or(manifest.state);
            }
            builder.take(entry);
            if builder.frames.len() > FRAMES_MAX {
                return Err(too_long(folder));
            }
        }
        if manifest.state == State::Recording {
            warnings.push(
                "the recording was cut off: this is what was on the disk until then".to_owned(),
            );
        }
        if reader.damaged_bytes() > 0 {
            warnings.push(format!(
                "{} bytes of {} belong to no packet and are left out",
                reader.damaged_bytes(),
                names::JOURNAL
            ));
        }
        builder.observed.damaged_bytes = reader.damaged_bytes();
        Ok(builder.finish(folder, manifest, warnings))
    }

    /// From the first frame to the last.
    #[must_use]
    pub fn length_s(&self) -> f64 {
        let time_s = |frame: Option<&Frame>| frame.map_or(0.0, |frame| frame.time_s);
        time_s(self.frames.last()) - time_s(self.frames.first())
    }

    /// Frames per second on average, pauses included; `None` where they have no length.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let length_s = self.length_s();
        (length_s > 0.0).then(|| (self.frames.len() - 1) as f64 / length_s)
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

/// Checks that a path can be a trial's.
pub(crate) fn check_folder(folder: &Path) -> Result<(), BadInput> {
    if folder.is_dir() {
        return Ok(());
    }
    Err(BadInput::whole(
        folder.display(),
        "it is not the folder of a trial",
        "give the folder that `plumb receive --out` has made",
    ))
}

/// Checks that what was replaced is what `trial.toml` says.
fn check_corrected(
    folder: &Path,
    crc: &str,
    correction: Option<&Correction>,
) -> Result<(), BadInput> {
    let found = match correction {
        Some(correction) if format!("{:08x}", correction.config().crc()) == crc => return Ok(()),
        Some(correction) => format!("its checksum is {:08x}", correction.config().crc()),
        None => "it is not there".to_owned(),
    };
    Err(BadInput::whole(
        folder.join(names::CORRECTED).display(),
        format!("{found}, and {} names one with the checksum {crc}", names::MANIFEST),
        "give the files again, or take the replacement back: `plumb replay TRIAL --tables \
         --as-recorded`",
    ))
}

/// The error for more than [`FRAMES_MAX`] frames.
pub(crate) fn too_long(folder: &Path) -> BadInput {
    BadInput::whole(
        folder.join(names::JOURNAL).display(),
        format!("more than {FRAMES_MAX} frames"),
        "no trial is so long: check what was recorded",
    )
}

/// The box's configuration, if it is in the folder and can be used; a warning says why it is not.
pub(crate) fn read_config(
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Result<Option<Config>, BadInput> {
    let path = folder.join(names::CONFIG);
    let blob = match std::fs::read(&path) {
        Ok(blob) => blob,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            warnings.push(
                "the box did not tell its configuration: the uncertainty of the trunk points is \
                 not known"
                    .to_owned(),
            );
            return Ok(None);
        }
        Err(error) => return Err(BadInput::io(path.display(), &error)),
    };
    match Config::decode(&blob) {
        Ok(config) => Ok(Some(config)),
        Err(error) => {
            warnings.push(format!("{}: {error}; it is not used", path.display()));
            Ok(None)
        }
    }
}
