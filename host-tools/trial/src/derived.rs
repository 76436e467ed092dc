//! What is derived from a trial's packets: the tables, and what the manifest says of them. It is made
//! when the recording ends, and again where something of what the box was told is replaced.

use std::path::Path;

use plumbline_files::BadInput;

use super::correction::{Corrected, Correction, Replacements};
use super::manifest::Manifest;
use super::reading::{check_folder, read_config};
use super::verdict::Criteria;
use super::{Trial, names, tables};

/// What is to change where a trial's tables are made again.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// Other criteria for the verdict.
    pub criteria: Option<Criteria>,
    /// Files that replace what the box was told.
    pub replaced: Option<Replacements>,
    /// Earlier replacements are taken back.
    pub as_recorded: bool,
}

/// Makes everything that is derived from a trial's packets once more: the tables, and what the
/// manifest says of them. A recording that was cut off is still marked as such. Files that replace
/// what the box was told replace earlier ones too: they always start from what was recorded.
///
/// # Errors
/// When there is no trial, a file cannot replace what was recorded, or the operating system
/// refuses; the packets stay.
pub fn remake(folder: &Path, changes: &Changes) -> Result<Trial, BadInput> {
    check_folder(folder)?;
    // Before anything is changed: the files may not suit.
    let mut warnings = Vec::new();
    let replaced = changes.replaced.as_ref();
    let replaced = replaced.map(|it| correction_by(folder, it, &mut warnings)).transpose()?;
    let (mut manifest, restored) = Manifest::restore(folder)?;
    warnings.extend(restored);
    if let Some(criteria) = &changes.criteria {
        manifest.criteria = criteria.clone();
    }
    if let Some((correction, corrected)) = replaced {
        plumbline_files::replace(&folder.join(names::CORRECTED), &correction.blob())?;
        manifest.corrected = Some(corrected);
    } else if changes.as_recorded {
        take_back(folder)?;
        manifest.corrected = None;
    }
    let mut trial = make(folder, manifest)?;
    trial.warnings.splice(0..0, warnings);
    Ok(trial)
}

fn correction_by(
    folder: &Path,
    replacements: &Replacements,
    warnings: &mut Vec<String>,
) -> Result<(Correction, Corrected), BadInput> {
    let Some(recorded) = read_config(folder, &mut Vec::new())? else {
        return Err(BadInput::whole(
            folder.join(names::CONFIG).display(),
            "what the box was told is not in the trial, so that nothing of it can be replaced",
            "copy the box's config.plb, as `plumb provision` wrote it, to this place first",
        ));
    };
    Correction::of(replacements, &recorded, warnings)
}

fn take_back(folder: &Path) -> Result<(), BadInput> {
    let path = folder.join(names::CORRECTED);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(BadInput::io(path.display(), &error))
        }
        _ => Ok(()),
    }
}

/// Makes the tables, and writes the manifest with what they say of the trial.
///
/// # Errors
/// When the packets cannot be read, or the operating system refuses; the packets stay.
pub(crate) fn make(folder: &Path, manifest: Manifest) -> Result<Trial, BadInput> {
    // First of all what a person has said, whatever comes of the rest.
    manifest.write(folder)?;
    let (trial, correction) = Trial::open_as(folder, manifest)?;
    tables::write(folder, correction.as_ref(), &trial.manifest.verdict())?;
    trial.manifest.write(folder)?;
    Ok(trial)
}
