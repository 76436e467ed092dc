//! From the description files to what the pipeline is configured with.

use plumbline::config::{Config, ConfigError, Links, TargetConfig};

use crate::error::BadInput;
use crate::files::camera::Camera;
use crate::files::scene::SceneFile;
use crate::files::targets::Targets;

/// The names that errors give to the description files.
#[derive(Debug, Clone)]
pub struct Places {
    /// Of the camera file.
    pub camera: String,
    /// Of the targets file.
    pub targets: String,
    /// Of the scene file.
    pub scene: String,
}

/// The configuration of these files, without links and with an empty identity.
///
/// # Errors
/// When the parts pass their own checks but not [`Config::check`].
pub fn config(
    camera: &Camera,
    targets: &Targets,
    scene: Option<&SceneFile>,
    places: &Places,
) -> Result<Config, BadInput> {
    let mut config = Config {
        device: heapless::String::new(),
        serial_number: heapless::String::new(),
        lens: camera.lens,
        targets: heapless::Vec::new(),
        cam_from_scene_theta: scene.map(|scene| {
            let angles = scene.cam_from_scene.euler();
            let position_mm = scene.cam_from_scene.translation_mm;
            [
                angles.theta1_rad,
                angles.theta2_rad,
                angles.theta3_rad,
                position_mm.x,
                position_mm.y,
                position_mm.z,
            ]
        }),
        links: Links::default(),
    };
    for target in &targets.targets {
        // The reader of targets.toml has checked the length of the name and the number of targets.
        let name = target.name.as_str().try_into().expect("a name that fits");
        let target = TargetConfig { name, geometry: target.geometry.clone() };
        assert!(config.targets.push(target).is_ok(), "no more targets than fit");
    }
    config.check().map_err(|error| bad_config(&error, places))?;
    Ok(config)
}

/// Says which file a configuration's fault is in.
#[must_use]
pub fn bad_config(error: &ConfigError, places: &Places) -> BadInput {
    let place = match error {
        ConfigError::Lens(_) => &places.camera,
        ConfigError::Scene => &places.scene,
        ConfigError::Udp => "--udp",
        ConfigError::Serial => "--serial",
        _ => &places.targets,
    };
    BadInput::whole(place, error, "correct this value")
}
