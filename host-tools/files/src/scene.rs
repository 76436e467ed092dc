//! `scene.toml`: where the scene board stands, the transform `cam_from_scene`.
//!
//! ```toml
//! theta1_rad = 0.0
//! theta2_rad = 0.0
//! theta3_rad = 0.0
//! x_mm = 0.0
//! y_mm = 120.0
//! z_mm = 1000.0
//! source = "board9x7.png, 2026-11-21"
//! [camera]                           # optional: the lens that it was measured through
//! width_px = 1456
//! height_px = 1088
//! fx_px = 1740.0
//! checksum = "5f3a9c01"              # of all numbers of the lens
//! ```
//!
//! A scene holds for its camera alone: through another lens the same board would have had another
//! pose. Where `[camera]` is missing, as in a file that a person has written, nobody can tell.

use std::path::Path;

use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Scene};
use serde::{Deserialize, Serialize};

use crate::BadInput;
use crate::lens_id::LensId;
use crate::{from_toml, read_text, write_text};

const REMEDY: &str = "a scene file has theta1_rad, theta2_rad, theta3_rad, x_mm, y_mm, z_mm of cam_from_scene and, optionally, source and [camera] with width_px, height_px, fx_px, checksum";

/// The scene board's pose and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    /// theta1..6 of the pose that takes scene coordinates to camera coordinates, digit by
    /// digit as the file has them.
    pub cam_from_scene_theta: [f64; 6],
    /// What it was measured from, in words.
    pub source: String,
    /// The lens that it was measured through, where the file says so.
    pub camera: Option<LensId>,
}

impl SceneFile {
    /// Takes scene coordinates to camera coordinates.
    #[must_use]
    pub fn cam_from_scene(&self) -> Pose<Cam, Scene> {
        Pose::from_theta(self.cam_from_scene_theta)
    }

    /// Checks that it was measured through this lens; a warning where the file does not say through
    /// which. `place` is the scene's file.
    ///
    /// # Errors
    /// When it was measured through another one.
    pub fn check_lens(&self, lens: &Lens, place: &str) -> Result<Option<String>, BadInput> {
        let here = LensId::of(lens);
        match self.camera {
            Some(camera) if camera == here => Ok(None),
            Some(camera) => Err(BadInput::new(
                place,
                "camera",
                format!(
                    "the scene was measured through another lens, {camera}; this one is {here}"
                ),
                "measure the scene with this camera (`plumb scene`), or give the camera file that \
                 it was measured with",
            )),
            None => Ok(Some(format!(
                "{place}: it does not say through which camera it was measured, so that a scene of \
                 another camera would not be noticed; `plumb scene` writes it down"
            ))),
        }
    }
}

/// The file's fields, as they are written.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    theta1_rad: f64,
    theta2_rad: f64,
    theta3_rad: f64,
    x_mm: f64,
    y_mm: f64,
    z_mm: f64,
    #[serde(default)]
    source: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    camera: Option<LensId>,
}

/// The scene of a file.
///
/// # Errors
/// When the file cannot be read, a field is missing, unknown or not finite, or
/// the scene is 100 m or more away.
pub fn read(path: &Path) -> Result<SceneFile, BadInput> {
    parse(&read_text(path)?, &path.display().to_string())
}

/// The scene of a text; `place` names it in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, place: &str) -> Result<SceneFile, BadInput> {
    let fields: Fields = from_toml(text, place, REMEDY)?;
    let named = [
        ("theta1_rad", fields.theta1_rad, 7.0),
        ("theta2_rad", fields.theta2_rad, 7.0),
        ("theta3_rad", fields.theta3_rad, 7.0),
        ("x_mm", fields.x_mm, 1e5),
        ("y_mm", fields.y_mm, 1e5),
        ("z_mm", fields.z_mm, 1e5),
    ];
    for (name, value, size_max) in named {
        if !value.is_finite() || value.abs() > size_max {
            let remedy = format!(
                "give a value within +-{size_max} (angles in radians, lengths in millimetres)"
            );
            return Err(BadInput::new(place, name, value, remedy));
        }
    }
    Ok(SceneFile {
        cam_from_scene_theta: named.map(|(_, value, _)| value),
        source: fields.source,
        camera: fields.camera,
    })
}

/// Writes a scene file.
///
/// # Errors
/// When the operating system refuses.
pub fn write(path: &Path, scene: &SceneFile) -> Result<(), BadInput> {
    write_text(path, &to_toml(scene))
}

/// The scene file's text.
#[must_use]
pub fn to_toml(scene: &SceneFile) -> String {
    let [theta1_rad, theta2_rad, theta3_rad, x_mm, y_mm, z_mm] = scene.cam_from_scene_theta;
    let (source, camera) = (scene.source.clone(), scene.camera);
    let fields = Fields { theta1_rad, theta2_rad, theta3_rad, x_mm, y_mm, z_mm, source, camera };
    toml::to_string(&fields).expect("numbers and texts are TOML")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::stand_in;

    fn scene(camera: Option<LensId>) -> SceneFile {
        SceneFile {
            cam_from_scene_theta: [0.01, -0.2, 0.3, 1.5, -20.0, 1003.25],
            source: "a test".to_owned(),
            camera,
        }
    }

    #[test]
    fn a_scene_comes_back() {
        for scene in [scene(None), scene(Some(LensId::of(&stand_in(640, 480))))] {
            assert_eq!(parse(&to_toml(&scene), "scene.toml").unwrap(), scene);
        }
    }

    #[test]
    fn a_scene_holds_for_its_camera_alone() {
        let lens = stand_in(640, 480);
        let own = scene(Some(LensId::of(&lens)));
        assert_eq!(own.check_lens(&lens, "scene.toml"), Ok(None));
        // The same size, and a focal length that shows in no digit that is written for people.
        let other = Lens { fx_px: lens.fx_px + 1e-9, ..lens };
        let error = own.check_lens(&other, "scene.toml").unwrap_err();
        assert_eq!((&*error.place, &*error.field), ("scene.toml", "camera"));
        let text = error.to_string();
        assert!(text.contains("640 x 480 px") && text.contains("plumb scene"), "{text}");
        let warning = scene(None).check_lens(&lens, "scene.toml").unwrap().unwrap();
        assert!(warning.starts_with("scene.toml: it does not say through which camera"));
    }

    #[test]
    fn a_bad_field_is_named() {
        let good = to_toml(&SceneFile { cam_from_scene_theta: [0.0; 6], ..scene(None) });
        let error = parse(&good.replace("x_mm", "x_cm"), "s.toml").unwrap_err();
        assert_eq!(error.field.split(' ').next(), Some("x_cm"));
        let error = parse(&good.replace("x_mm = 0.0", "x_mm = nan"), "s.toml").unwrap_err();
        assert_eq!((error.field.as_str(), error.found.as_str()), ("x_mm", "NaN"));
        let error = parse(&good.replace("z_mm = 0.0", "z_mm = \"far\""), "s.toml").unwrap_err();
        assert!(error.field.starts_with("z_mm"), "{error}");
        let error = parse(&good.replace("z_mm = 0.0", ""), "s.toml").unwrap_err();
        assert_eq!(error.field, "z_mm");
        let half = good + "[camera]\nwidth_px = 640\n";
        assert!(parse(&half, "s.toml").unwrap_err().to_string().contains("height_px"));
    }
}
