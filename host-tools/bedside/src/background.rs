//! The picture of the background that shows later whether the camera was moved after its scene had
//! been measured.
//!
//! It is kept on this computer, and not in the box's configuration: that may be read at any time
//! and lies in every trial's folder, while pictures leave a box in set-up mode only. It belongs to
//! one measured scene, whose numbers name it, so that it does not matter by which way the scene
//! reaches the box.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{GrayImage, ImageFormat};
use plumbline::packet::document_crc;
use plumbline_calibration::background::Picture;
use plumbline_files::BadInput;

use crate::kept;

/// The folder of these pictures.
const KIND: &str = "scenes";

/// Keeps the picture of a scene; returns its file.
///
/// # Errors
/// When it cannot be written.
pub fn keep(scene_theta: &[f64; 6], picture: &Picture) -> Result<PathBuf, BadInput> {
    keep_in(&kept::folder(KIND)?, scene_theta, picture)
}

/// The picture of a scene, if this computer has it.
///
/// # Errors
/// When it is there and cannot be read.
pub fn kept(scene_theta: &[f64; 6]) -> Result<Option<Picture>, BadInput> {
    kept_in(&kept::folder(KIND)?, scene_theta)
}

fn keep_in(folder: &Path, scene_theta: &[f64; 6], picture: &Picture) -> Result<PathBuf, BadInput> {
    let path = path(folder, scene_theta);
    let [width, height] = [picture.width, picture.height].map(|side| side as u32);
    let grey = GrayImage::from_raw(width, height, picture.samples.clone());
    let mut file = Cursor::new(Vec::new());
    let grey = grey.expect("as many samples as pixels");
    grey.write_to(&mut file, ImageFormat::Png).map_err(|error| {
        BadInput::whole(path.display(), error, "make a picture of another size")
    })?;
    plumbline_files::replace(&path, file.get_ref())?;
    Ok(path)
}

fn kept_in(folder: &Path, scene_theta: &[f64; 6]) -> Result<Option<Picture>, BadInput> {
    let path = path(folder, scene_theta);
    if !path.exists() {
        return Ok(None);
    }
    let picture = image::open(&path).map_err(|error| {
        BadInput::whole(path.display(), error, "measure the scene again: `plumb scene --store`")
    })?;
    let grey = picture.into_luma8();
    let [width, height] = [grey.width(), grey.height()].map(|side| side as usize);
    Ok(Some(Picture { width, height, samples: grey.into_raw() }))
}

fn path(folder: &Path, scene_theta: &[f64; 6]) -> PathBuf {
    let bytes: Vec<u8> = scene_theta.iter().flat_map(|value| value.to_le_bytes()).collect();
    folder.join(format!("{:08x}.png", document_crc(&bytes)))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn a_picture_comes_back_for_its_own_scene_and_is_the_owners_alone() {
        let data = tempfile::tempdir().unwrap();
        let folder = data.path().join("plumbline/scenes");
        let theta = [0.01, -0.2, 0.3, 1.5, -20.0, 1003.25];
        let samples = (0..182 * 136).map(|index| (index % 251) as u8).collect();
        let picture = Picture { width: 182, height: 136, samples };
        assert_eq!(kept_in(&folder, &theta).unwrap(), None);
        let path = keep_in(&folder, &theta, &picture).unwrap();
        assert_eq!(kept_in(&folder, &theta).unwrap(), Some(picture));
        assert_eq!(kept_in(&folder, &theta.map(|value| value + 1e-15)).unwrap(), None);
        assert_eq!(folder.metadata().unwrap().permissions().mode() & 0o777, 0o700);
        std::fs::write(&path, b"cut").unwrap();
        let error = kept_in(&folder, &theta).unwrap_err().to_string();
        assert!(error.contains("plumb scene --store"), "{error}");
    }
}
