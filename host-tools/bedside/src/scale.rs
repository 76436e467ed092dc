//! The comparison of a target's distance with a tape, kept on this computer.
//!
//! One camera cannot see how large anything is: a wrong `pitch_mm` makes every length wrong by the
//! same factor, and shows in nothing else. A person has to measure one length, once for each lens
//! and print; that they did is remembered here. It belongs to the lens and to the target's corners,
//! whose numbers name it, so that another calibration, another pitch or another print of other
//! dimensions has to be compared anew. Another print of the same dimensions cannot be told apart.

use std::path::{Path, PathBuf};

use plumbline::config::Config;
use plumbline::lens::Lens;
use plumbline::packet::document_crc;
use plumbline::target::{Role, TargetGeometry};
use plumbline_files::BadInput;
use plumbline_files::lens_id::LensId;
use serde::{Deserialize, Serialize};

use crate::kept;

/// The folder of these comparisons.
const KIND: &str = "scales";

/// A comparison that agreed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compared {
    /// The day, as in 2026-11-24.
    pub date: String,
    /// From the front of the lens to the middle of the target, by the tape.
    pub tape_mm: f64,
    /// From where the camera sees to the middle of the target, by the box.
    pub measured_mm: f64,
}

/// Keeps a comparison; returns its file.
///
/// # Errors
/// When it cannot be written.
pub fn keep(
    lens: &Lens,
    target: &TargetGeometry,
    compared: &Compared,
) -> Result<PathBuf, BadInput> {
    keep_in(&kept::folder(KIND)?, lens, target, compared)
}

/// Forgets the comparison of a target: a later one did not agree.
///
/// # Errors
/// When its file cannot be removed.
pub fn forget(lens: &Lens, target: &TargetGeometry) -> Result<(), BadInput> {
    forget_in(&kept::folder(KIND)?, lens, target)
}

/// The trunks' targets that were compared, each with what was found.
#[must_use]
pub fn all_kept(config: &Config) -> Vec<(Role, Compared)> {
    let Ok(folder) = kept::folder(KIND) else { return Vec::new() };
    let targets = config.targets.iter().map(|target| &target.geometry);
    let kept =
        |target: &TargetGeometry| Some((target.role(), kept_in(&folder, &config.lens, target)?));
    targets.filter(|target| target.role() != Role::Scene).filter_map(kept).collect()
}

fn keep_in(
    folder: &Path,
    lens: &Lens,
    target: &TargetGeometry,
    compared: &Compared,
) -> Result<PathBuf, BadInput> {
    let path = path(folder, lens, target);
    let text = toml::to_string(compared).expect("a date and two numbers are TOML");
    plumbline_files::replace(&path, text.as_bytes())?;
    Ok(path)
}

fn forget_in(folder: &Path, lens: &Lens, target: &TargetGeometry) -> Result<(), BadInput> {
    let path = path(folder, lens, target);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(BadInput::io(path.display(), &error))
        }
        _ => Ok(()),
    }
}

/// One that cannot be read is none: comparing again replaces it.
fn kept_in(folder: &Path, lens: &Lens, target: &TargetGeometry) -> Option<Compared> {
    let text = plumbline_files::read_text(&path(folder, lens, target)).ok()?;
    let compared: Compared = toml::from_str(&text).ok()?;
    let is_date = compared.date.parse::<jiff::civil::Date>().is_ok();
    is_date.then_some(compared)
}

fn path(folder: &Path, lens: &Lens, target: &TargetGeometry) -> PathBuf {
    let [columns, rows] = [target.columns(), target.rows()].map(|count| count as u8);
    let mut bytes = vec![columns, rows];
    for corner in 0..target.corner_count() {
        bytes.extend(target.corner_mm(corner).iter().flat_map(|value| value.to_le_bytes()));
    }
    let lens = LensId::of(lens).checksum();
    folder.join(format!("{lens:08x}-{:08x}.toml", document_crc(&bytes)))
}

#[cfg(test)]
mod tests {
    use plumbline::target::Origin;

    use super::*;
    use plumbline_stream::fixture::config;

    fn print(columns: u8, pitch_mm: f64, role: Role, depth_mm: f64) -> TargetGeometry {
        let point_mm = [0.0, 0.0, depth_mm];
        TargetGeometry::checker(columns, 5, pitch_mm, Origin::Center, role, point_mm).unwrap()
    }

    #[test]
    fn a_comparison_comes_back_for_its_lens_and_print_alone() {
        let data = tempfile::tempdir().unwrap();
        let folder = data.path().join("plumbline/scales");
        let lens = config().lens;
        let target = print(6, 12.0, Role::Lower, 100.0);
        let kept = |lens: &Lens, target: &TargetGeometry| kept_in(&folder, lens, target);
        let date = "2026-11-24".to_owned();
        let compared = Compared { date, tape_mm: 1030.0, measured_mm: 1046.5 };
        assert_eq!(kept(&lens, &target), None);
        forget_in(&folder, &lens, &target).unwrap();
        let path = keep_in(&folder, &lens, &target, &compared).unwrap();
        assert_eq!(kept(&lens, &target), Some(compared.clone()));
        // What it is called and what it is fixed to does not change its size.
        assert_eq!(kept(&lens, &print(6, 12.0, Role::Upper, 0.0)), Some(compared));
        assert_eq!(kept(&lens, &print(6, 12.1, Role::Lower, 100.0)), None);
        assert_eq!(kept(&lens, &print(5, 12.0, Role::Lower, 100.0)), None);
        assert_eq!(kept(&Lens { fx_px: lens.fx_px + 0.1, ..lens }, &target), None);

        let text = std::fs::read_to_string(&path).unwrap();
        for spoilt in [text.replace("2026-11-24", "yesterday"), text[..20].to_owned()] {
            std::fs::write(&path, spoilt).unwrap();
            assert_eq!(kept(&lens, &target), None);
        }
        forget_in(&folder, &lens, &target).unwrap();
        assert!(!path.exists());
    }
}
