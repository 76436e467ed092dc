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
//! ```

use std::path::Path;

use plumbline::pose::{Cam, Pose, Scene};
use serde::{Deserialize, Serialize};

use crate::BadInput;
use crate::{from_toml, read_text, write_text};

const REMEDY: &str = "a scene file has theta1_rad, theta2_rad, theta3_rad, x_mm, y_mm, z_mm of cam_from_scene and, optionally, source";

/// The scene board's pose and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    /// theta1..6 of the pose that takes scene coordinates to camera coordinates, digit by
    /// digit as the file has them.
    pub cam_from_scene_theta: [f64; 6],
    /// What it was measured from, in words.
    pub source: String,
}

impl SceneFile {
    /// Takes scene coordinates to camera coordinates.
    #[must_use]
    pub fn cam_from_scene(&self) -> Pose<Cam, Scene> {
        Pose::from_theta(self.cam_from_scene_theta)
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
    Ok(SceneFile { cam_from_scene_theta: named.map(|(_, value, _)| value), source: fields.source })
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
    let source = scene.source.clone();
    let fields = Fields { theta1_rad, theta2_rad, theta3_rad, x_mm, y_mm, z_mm, source };
    toml::to_string(&fields).expect("six numbers and a text are TOML")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_comes_back() {
        let scene = SceneFile {
            cam_from_scene_theta: [0.01, -0.2, 0.3, 1.5, -20.0, 1003.25],
            source: "a test".to_owned(),
        };
        let back = parse(&to_toml(&scene), "scene.toml").unwrap();
        assert_eq!(back, scene);
    }

    #[test]
    fn a_bad_field_is_named() {
        let good = to_toml(&SceneFile { cam_from_scene_theta: [0.0; 6], source: String::new() });
        let error = parse(&good.replace("x_mm", "x_cm"), "s.toml").unwrap_err();
        assert_eq!(error.field.split(' ').next(), Some("x_cm"));
        let error = parse(&good.replace("x_mm = 0.0", "x_mm = nan"), "s.toml").unwrap_err();
        assert_eq!((error.field.as_str(), error.found.as_str()), ("x_mm", "NaN"));
        let error = parse(&good.replace("z_mm = 0.0", "z_mm = \"far\""), "s.toml").unwrap_err();
        assert!(error.field.starts_with("z_mm"), "{error}");
        let error = parse(&good.replace("z_mm = 0.0", ""), "s.toml").unwrap_err();
        assert_eq!(error.field, "z_mm");
    }
}
