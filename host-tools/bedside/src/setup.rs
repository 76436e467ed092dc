//! Configurations: made from the description files, or read from a file that holds one.

use std::path::{Path, PathBuf};

use plumbline::config::{
    BLOB_BYTES_MAX, Config, ConfigError, Links, Machine, NO_LINK, TargetConfig,
};
use plumbline::lens::Lens;
use plumbline::pipeline::Pipeline;
use plumbline::target::Role;
use plumbline_files::BadInput;
use plumbline_files::camera::{self, Camera};
use plumbline_files::scene::{self, SceneFile};
use plumbline_files::targets::{self, Targets};

use crate::told::{Tell, Told};

/// The paths of the description files.
#[derive(Debug, Clone)]
pub struct Descriptions {
    /// The camera file: camera.toml, OpenCV (YAML or JSON), or ROS camera_info (YAML).
    pub camera: PathBuf,
    /// The targets file: each printed target's name, role, inner corners and pitch.
    pub targets: PathBuf,
    /// The scene file: where the scene board stands; without it there are no trunk points.
    pub scene: Option<PathBuf>,
}

impl Descriptions {
    /// From these paths.
    #[must_use]
    pub fn of(camera: &Path, targets: &Path, scene: Option<&Path>) -> Self {
        Self {
            camera: camera.to_owned(),
            targets: targets.to_owned(),
            scene: scene.map(Path::to_owned),
        }
    }

    /// The files' paths.
    pub fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.camera, &self.targets].into_iter().chain(&self.scene)
    }

    /// The files' names, for errors.
    #[must_use]
    pub fn places(&self) -> Places {
        let name = |path: &PathBuf| path.display().to_string();
        Places {
            camera: name(&self.camera),
            targets: name(&self.targets),
            scene: self.scene.as_ref().map(name).unwrap_or_default(),
            settings: String::new(),
            udp: "--udp".into(),
            serial: "--serial".into(),
        }
    }

    /// Reads the files; the targets' and the scene's warnings are told.
    ///
    /// # Errors
    /// When one of them cannot be read or used, or the scene is of another camera.
    pub fn read(
        &self,
        tell: &mut Tell<'_>,
    ) -> Result<(Camera, Targets, Option<SceneFile>), BadInput> {
        let camera = camera::read(&self.camera)?;
        let (targets, scene) = self.read_for(&camera.lens, tell)?;
        Ok((camera, targets, scene))
    }

    /// Reads the files other than the camera's, for this lens; their warnings are told.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_for(
        &self,
        lens: &Lens,
        tell: &mut Tell<'_>,
    ) -> Result<(Targets, Option<SceneFile>), BadInput> {
        let targets = self.read_targets(tell)?;
        let scene = self.scene.as_deref();
        let scene = scene.map(|path| read_scene(path, lens, tell)).transpose()?;
        Ok((targets, scene))
    }

    /// Reads the targets file; its warnings are told.
    ///
    /// # Errors
    /// When it cannot be read or used.
    pub fn read_targets(&self, tell: &mut Tell<'_>) -> Result<Targets, BadInput> {
        let targets = targets::read(&self.targets)?;
        for warning in &targets.warnings {
            tell(Told::Warning(warning.clone()));
        }
        Ok(targets)
    }
}

/// The scene of a file, which was measured through this lens.
fn read_scene(path: &Path, lens: &Lens, tell: &mut Tell<'_>) -> Result<SceneFile, BadInput> {
    let scene = scene::read(path)?;
    if let Some(warning) = scene.check_lens(lens, &path.display().to_string())? {
        tell(Told::Warning(warning));
    }
    Ok(scene)
}

/// The names that errors give to the description files.
#[derive(Debug, Clone)]
pub struct Places {
    /// The camera file.
    pub camera: String,
    /// The targets file.
    pub targets: String,
    /// The scene file.
    pub scene: String,
    /// The box file.
    pub settings: String,
    /// What gives the UDP address: an option, or the box file.
    pub udp: String,
    /// What gives the serial line, likewise.
    pub serial: String,
}

impl Places {
    /// Everything is in one place.
    #[must_use]
    pub fn all(place: &str) -> Self {
        let place = place.to_owned();
        Self {
            camera: place.clone(),
            targets: place.clone(),
            scene: place.clone(),
            settings: place.clone(),
            udp: place.clone(),
            serial: place,
        }
    }
}

/// The configuration of these files, without links and with an empty identity.
///
/// # Errors
/// When the camera is not calibrated, or the parts pass their own checks but not
/// [`Config::check`].
pub fn config(
    camera: &Camera,
    targets: &Targets,
    scene: Option<&SceneFile>,
    places: &Places,
) -> Result<Config, BadInput> {
    if camera::is_stand_in(&camera.lens) {
        return Err(not_calibrated(&places.camera));
    }
    assemble(camera.lens, camera.readout_ns, targets, scene, places)
}

/// The configuration of a box that takes the photographs for its camera's calibration: of
/// its targets it looks for the scene board alone, so that nobody is measured with it.
///
/// # Errors
/// When there is no scene board, or a frame cannot have this size.
pub fn uncalibrated(
    width_px: u16,
    height_px: u16,
    mut targets: Targets,
    places: &Places,
) -> Result<Config, BadInput> {
    targets.targets.retain(|target| target.geometry.role() == Role::Scene);
    if targets.targets.is_empty() {
        return Err(BadInput::new(
            &places.targets,
            "role",
            "no target has the role \"scene\", and a camera that is not calibrated looks for no other",
            "print a board: `plumb target --grid 9x6 --pitch-mm 20 --name board --role scene`",
        ));
    }
    assemble(camera::stand_in(width_px, height_px), 0, &targets, None, places)
}

/// What is said of a camera that is not calibrated where its poses would be used.
#[must_use]
pub fn not_calibrated(place: &str) -> BadInput {
    BadInput::whole(
        place,
        "the camera is not calibrated: every pose would be wrong",
        "take photographs of the board with `plumb aim --stills`, and calibrate it with `plumb calibrate`",
    )
}

fn assemble(
    lens: Lens,
    readout_ns: i32,
    targets: &Targets,
    scene: Option<&SceneFile>,
    places: &Places,
) -> Result<Config, BadInput> {
    let mut config = Config {
        device: heapless::String::new(),
        serial_number: heapless::String::new(),
        lens,
        readout_ns,
        targets: heapless::Vec::new(),
        cam_from_scene_theta: scene.map(|scene| scene.cam_from_scene_theta),
        links: Links::default(),
        capture: None,
        machine: Machine::default(),
        trigger: None,
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

/// The bytes of a configuration, as a box stores and sends it.
///
/// # Errors
/// When it fails its own check.
pub fn blob(config: &Config, places: &Places) -> Result<Vec<u8>, BadInput> {
    let mut buffer = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut buffer).map_err(|error| bad_config(&error, places))?;
    assert_eq!(Config::decode(blob).as_ref(), Ok(config), "a blob reads back as it was written");
    Ok(blob.to_vec())
}

/// The configuration in a file that `plumb provision` wrote.
///
/// # Errors
/// When the file cannot be read, or holds no configuration.
pub fn read_blob(path: &Path) -> Result<Config, BadInput> {
    let place = path.display();
    let bytes = std::fs::metadata(path).map_err(|error| BadInput::io(&place, &error))?.len();
    if bytes > BLOB_BYTES_MAX as u64 {
        return Err(BadInput::whole(
            place,
            format!("{bytes} bytes, where a configuration has at most {BLOB_BYTES_MAX}"),
            "give the file that `plumb provision` wrote",
        ));
    }
    let blob = std::fs::read(path).map_err(|error| BadInput::io(&place, &error))?;
    Config::decode(&blob).map_err(|error| {
        BadInput::whole(
            place,
            error,
            "give the file that `plumb provision` wrote, or write it again",
        )
    })
}

/// A pipeline that has a configuration.
///
/// # Errors
/// When it cannot be used.
pub fn configured(config: &Config, places: &Places) -> Result<Box<Pipeline>, BadInput> {
    // Larger than a thread's stack may be, so that it goes to the heap, once.
    let mut pipeline = Box::new(Pipeline::new());
    pipeline.configure(config).map_err(|error| bad_config(&error, places))?;
    Ok(pipeline)
}

/// Checks that a box can run with a configuration, as it will itself: it needs a camera, and
/// somewhere to send to.
///
/// # Errors
/// When it lacks one of them.
pub fn check_for_box(config: &Config, places: &Places) -> Result<(), BadInput> {
    if config.capture.is_none() {
        return Err(BadInput::new(
            &places.settings,
            "capture",
            "no camera is given, and a box without one tracks nothing",
            "give --box with a file that has a [capture]",
        ));
    }
    check_links(config, places)
}

/// Checks that a box has somewhere to send to.
///
/// # Errors
/// When it has not.
pub fn check_links(config: &Config, places: &Places) -> Result<(), BadInput> {
    if config.links != Links::default() {
        return Ok(());
    }
    let remedy = "add [links] with udp or serial, or give --udp or --serial";
    Err(BadInput::new(&places.settings, "links", NO_LINK, remedy))
}

/// Says which file a configuration's fault is in.
#[must_use]
pub fn bad_config(error: &ConfigError, places: &Places) -> BadInput {
    let place = match error {
        ConfigError::Lens(_) | ConfigError::Readout => &places.camera,
        ConfigError::Scene => &places.scene,
        ConfigError::Udp => &places.udp,
        ConfigError::Serial => &places.serial,
        ConfigError::Text { .. } | ConfigError::Capture(_) | ConfigError::Machine(_) => {
            &places.settings
        }
        _ => &places.targets,
    };
    BadInput::whole(place, error, "correct this value")
}
