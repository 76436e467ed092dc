//! Reads a trial from its packets: the only way to read a recording, whether it was ended properly
//! or cut off.

pub(crate) mod builder;

use std::path::Path;

use plumbline::config::Config;
use plumbline_files::BadInput;

use self::builder::Builder;
use super::correction::Correction;
use super::journal::{Content, Reader};
use super::manifest::{Manifest, State};
use super::{Trial, names};

/// A recording that has gone wrong must not fill the memory. Ten hours at 200 Hz.
pub(crate) const FRAMES_MAX: usize = 7_200_000;

impl Trial {
    /// Reads a trial's folder.
    ///
    /// # Errors
    /// When there is no trial in it, or it cannot be read.
    pub fn open(folder: &Path) -> Result<Self, BadInput> {
        check_folder(folder)?;
        Ok(Self::open_as(folder, Manifest::read(folder)?)?.0)
    }

    /// Reads a trial's folder, whose manifest is this one; also returns what corrects its packets.
    ///
    /// # Errors
    /// When its packets or its configuration cannot be read.
    pub(crate) fn open_as(
        folder: &Path,
        manifest: Manifest,
    ) -> Result<(Self, Option<Correction>), BadInput> {
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
        let mut builder = Builder::new(folder, manifest, recorded, correction);
        while let Some(entry) = reader.next_entry()? {
            // A file of which the end is missing, as after a copy to a full disk, is cut off too.
            if let Content::About(text) = &entry.content {
                let state = &mut builder.trial.manifest.state;
                *state = State::told(text).unwrap_or(*state);
            }
            builder.take(entry);
            if builder.trial.frames.len() > FRAMES_MAX {
                return Err(too_long(folder));
            }
        }
        if builder.trial.manifest.state == State::Recording {
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
        builder.trial.observed.damaged_bytes = reader.damaged_bytes();
        builder.trial.warnings = warnings;
        Ok(builder.finish())
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
