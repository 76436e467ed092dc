//! `plumb show`: a box's configuration back into the files it was made from.

use std::path::{Path, PathBuf};

use plumbline::config::Config;
use plumbline_bedside::box_settings::BoxSettings;
use plumbline_bedside::delivery;
use plumbline_bedside::setup;
use plumbline_files::BadInput;
use plumbline_files::camera::{Camera, Provenance};
use plumbline_files::counting::counted;
use plumbline_files::lens_id::LensId;
use plumbline_files::scene::SceneFile;
use plumbline_files::{camera, scene, targets};
use plumbline_stream::link::BoxLink;
use plumbline_trial::{Trial, names};

use crate::arguments::LinkArguments;
use crate::ui::waiting::{self, Waiting};

/// Show what a configuration holds, as the files that `plumb provision` takes.
///
/// Of a trial's folder it shows the verdict on the trial, and the configuration that its figures are
/// by: what the box was told, with what `plumb replay --tables` has replaced.
///
/// Without BLOB it is read back from the box that this computer hears. Nothing is lost: from
/// these files the very same configuration is made again, down to its checksum. Without --out
/// they are printed, one after the other.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  plumb show config.plb
  plumb show config.plb --out files      # files/camera.toml, targets.toml, scene.toml, box.toml
  plumb show trials/p01-control          # the verdict on a trial, and what it was measured with
  plumb show --out files                 # of the box that sends to this computer
  plumb show --serial /dev/ttyUSB0")]
pub struct Arguments {
    /// The configuration: config.plb on a box's card, what `plumb provision` wrote, or a trial's
    /// folder.
    #[arg(value_name = "BLOB", conflicts_with_all = ["udp", "serial"])]
    blob: Option<PathBuf>,
    /// Where the box is heard.
    #[command(flatten)]
    link: LinkArguments,
    /// Write the files into this directory.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace files of --out that exist.
    #[arg(long, requires = "out")]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the blob is none, is damaged, or the files cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (config, place) = match &arguments.blob {
        Some(folder) if folder.is_dir() => (of_trial(folder)?, folder.display().to_string()),
        Some(blob) => (setup::read_blob(blob)?, blob.display().to_string()),
        None => {
            let mut link = arguments.link.open()?;
            (read_back(&mut link)?, link.place().to_owned())
        }
    };
    let targets = counted(config.targets.len(), "target");
    eprintln!("{place}: checksum {:08x}, {targets}", config.crc());
    let is_calibrated = !camera::is_stand_in(&config.lens);
    if !is_calibrated {
        let (width, height) = (config.lens.width_px, config.lens.height_px);
        eprintln!(
            "warning: ITS CAMERA IS NOT CALIBRATED: camera.toml says the size of its frames and \
             nothing else, and nobody is measured with it. Calibrate it with `plumb aim --stills` \
             and `plumb calibrate`; the same configuration is made again with --uncalibrated \
             {width}x{height} instead of --camera"
        );
    }
    let calibrated = if is_calibrated { "" } else { ", NOT CALIBRATED" };
    let files = texts(&config, &format!("configuration {:08x}{calibrated}", config.crc()));
    let Some(directory) = &arguments.out else {
        for (name, text) in files {
            println!("# {name}\n{text}");
        }
        return Ok(());
    };
    let outputs: Vec<_> =
        files.into_iter().map(|(name, text)| (directory.join(name), text.into_bytes())).collect();
    plumbline_files::write_all(&outputs, arguments.force)?;
    for (path, _) in &outputs {
        eprintln!("written to {}", path.display());
    }
    Ok(())
}

/// The configuration that a trial's figures are by; the verdict on the trial goes to standard error.
fn of_trial(folder: &Path) -> Result<Config, BadInput> {
    let trial = Trial::open(folder)?;
    eprintln!("{}: {}", trial.title(), trial.manifest.verdict().lines());
    for warning in &trial.warnings {
        eprintln!("warning: {warning}");
    }
    trial.config.ok_or_else(|| {
        BadInput::whole(
            folder.join(names::CONFIG).display(),
            "what the box was told is not in the trial",
            "copy the box's config.plb, as `plumb provision` wrote it, to this place",
        )
    })
}

/// The configuration of a live box.
fn read_back(link: &mut BoxLink) -> Result<Config, BadInput> {
    let mut told = waiting::shown();
    delivery::greet(link, &mut told)?;
    let config = {
        let _waiting = Waiting::new("reading its configuration back");
        link.config()?
    };
    delivery::warn_of_others(link, &mut told)?;
    Ok(config)
}

/// Each file's name and text.
fn texts(config: &Config, source: &str) -> Vec<(&'static str, String)> {
    let provenance = Provenance { source: Some(source.to_owned()), ..Provenance::default() };
    let camera = Camera { lens: config.lens, readout_ns: config.readout_ns, provenance };
    let described: Vec<_> = config
        .targets
        .iter()
        .map(|target| targets::description(&target.name, &target.geometry))
        .collect();
    let mut texts = vec![
        ("camera.toml", camera::to_toml(&camera)),
        ("targets.toml", targets::to_toml(&described)),
    ];
    if let Some(cam_from_scene_theta) = config.cam_from_scene_theta {
        let (source, camera) = (source.to_owned(), Some(LensId::of(&config.lens)));
        let scene = SceneFile { cam_from_scene_theta, source, camera };
        texts.push(("scene.toml", scene::to_toml(&scene)));
    }
    texts.push(("box.toml", BoxSettings::of(config).to_toml()));
    texts
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use plumbline::config::{BLOB_BYTES_MAX, Links, Machine, TargetConfig};
    use plumbline::packet::document_crc;
    use plumbline::target::{Role, TargetGeometry};

    use super::*;
    use plumbline_bedside::setup::Places;
    use plumbline_render::simulate::{Simulation, SimulationSettings};

    static CONFIG: LazyLock<Config> =
        LazyLock::new(|| Simulation::new(&SimulationSettings::default()).unwrap().config());

    /// The configuration that `plumb provision` makes of the files.
    fn again(config: &Config) -> Config {
        let texts = texts(config, "a test");
        let text = |name| texts.iter().find(|(is, _)| *is == name).map(|(_, text)| text.as_str());
        let name = String::new;
        let places = Places {
            camera: name(),
            targets: name(),
            scene: name(),
            settings: name(),
            udp: name(),
            serial: name(),
        };
        let camera = camera::parse(text("camera.toml").unwrap(), "").unwrap();
        let targets = targets::parse(text("targets.toml").unwrap(), "").unwrap();
        let scene = text("scene.toml").map(|text| scene::parse(text, "").unwrap());
        let mut config = setup::config(&camera, &targets, scene.as_ref(), &places).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("box.toml");
        std::fs::write(&path, text("box.toml").unwrap()).unwrap();
        plumbline_bedside::box_settings::read(&path).unwrap().apply(&mut config, "").unwrap();
        config
    }

    #[test]
    fn nothing_is_lost_on_the_way_to_files_and_back() {
        let mut config = CONFIG.clone();
        assert_eq!(again(&config).crc(), config.crc());
        // A pitch that no two corners are exactly apart, and corners that were measured.
        let uneven = |corner: i32| [f64::from(corner % 4) * 12.3, f64::from(corner / 4) / 3.0, 0.1];
        let measured = TargetGeometry::from_points(
            4,
            3,
            (0..12).map(uneven),
            Role::Scene,
            [1.0, 2.0, 1.0 / 3.0],
        );
        let target =
            TargetConfig { name: "board".try_into().unwrap(), geometry: measured.unwrap() };
        config.targets.push(target).unwrap();
        config.cam_from_scene_theta = Some([0.1 + 0.2, 1.0 / 3.0, -0.7, 1e-3, 2.0, 1234.567]);
        config.readout_ns = -15_999_999;
        config.links = Links {
            udp: Some("192.168.1.20:4210".parse().unwrap()),
            serial: Some(
                plumbline_bedside::box_settings::serial("", "", "/dev/ttyS0:115200").unwrap(),
            ),
        };
        config.machine = Machine { cpu: Some(3), ..Machine::default() };
        assert_eq!(again(&config), config);
        assert_eq!(again(&config).crc(), config.crc());
        config.cam_from_scene_theta = None;
        assert_eq!(again(&config), config);
    }

    #[test]
    fn a_configuration_whose_texts_cannot_be_seen_is_refused_without_showing_them() {
        let mut config = CONFIG.clone();
        config.device = "ward~3".try_into().unwrap();
        let mut blob = config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec();
        let at = blob.windows(6).position(|part| part == b"ward~3").unwrap();
        blob[at + 4] = 0x1b;
        let covered = blob.len() - 4;
        let crc = document_crc(&blob[..covered]);
        blob[covered..].copy_from_slice(&crc.to_le_bytes());
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("config.plb");
        std::fs::write(&path, blob).unwrap();
        let error = setup::read_blob(&path).unwrap_err().to_string();
        assert!(error.contains("device: must not contain characters that cannot be seen"));
        assert!(!error.contains('\u{1b}'), "{error:?}");
    }
}
