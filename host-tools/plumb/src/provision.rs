//! `plumb provision`: the configuration of a box, as one file.

use std::io::Write as _;
use std::path::PathBuf;

use plumbline::config::{BLOB_BYTES_MAX, Config, Links};
use plumbline_board::link::NO_LINK;

use crate::error::BadInput;
use crate::files::box_settings::{self, BoxSettings};
use crate::files::{self, refuse_overwriting};
use crate::setup::{self, Descriptions};

/// Write what a box needs to know into one file.
///
/// Camera, targets, scene and the box's own settings go in; out comes a checked blob with a
/// version and a checksum, which the box's program takes at its start.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  For a box with a camera:
    plumb provision --camera camera.toml --targets targets.toml --scene scene.toml \\
        --box box.toml --out config.plb
  For a replay on this machine:
    plumb provision --camera camera.toml --targets targets.toml --udp 127.0.0.1:4210 --out config.plb

A box file (only driver, pixel_format and rate_hz of a capture must be given):
  device = \"ward 3\"
  serial_number = \"PL-0001\"
  [capture]
  driver = \"v4l2\"             # or \"libcamera\"
  device = \"/dev/video0\"      # left out: the first camera that can do this
  pixel_format = \"grey\"       # grey, y10, y16, yuyv or nv12
  rate_hz = 60.0
  exposure_us = 4000          # left out: as the camera has it
  gain = 2.0                  # the driver's steps (v4l2) or a factor (libcamera)
  [links]
  udp = \"192.168.1.20:4210\"
  serial = \"/dev/ttyS0:115200\"
  [network]                   # left out: an address by DHCP
  address = \"192.168.1.30/24\"
  gateway = \"192.168.1.1\"
  [machine]
  realtime_priority = 50      # 1 to 99, 0 for none
  cpu = 3                     # left out: any core
  watchdog_s = 15             # seconds without a frame until a restart, 0 for none;
                              # stopped while the camera is known to be lost")]
pub struct Arguments {
    #[command(flatten)]
    descriptions: Descriptions,
    /// Box file: name, camera settings, links, network, watchdog; without it the
    /// box can only replay recordings.
    #[arg(long = "box", value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Where the box sends its packets, instead of the box file's.
    #[arg(long, value_name = "HOST:PORT")]
    udp: Option<String>,
    /// A serial device of the BOX that it sends its packets on, such as
    /// /dev/ttyS0:115200, instead of the box file's.
    #[arg(long, value_name = "DEVICE:BAUD")]
    serial: Option<String>,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace the file of --out if it exists.
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut places = arguments.descriptions.places();
    let inputs = arguments.descriptions.paths().chain(&arguments.settings);
    refuse_overwriting(&arguments.out, inputs)?;
    let (camera, targets, scene) = arguments.descriptions.read()?;
    let mut config = setup::config(&camera, &targets, scene.as_ref(), &places)?;
    if let Some(path) = &arguments.settings {
        places.settings = path.display().to_string();
        places.udp.clone_from(&places.settings);
        places.serial.clone_from(&places.settings);
        box_settings::read(path)?.apply(&mut config, &places.settings)?;
    } else {
        BoxSettings::default().apply(&mut config, "")?;
    }
    if let Some(value) = &arguments.udp {
        places.udp = "--udp".into();
        config.links.udp = Some(box_settings::udp("--udp", "", value)?);
    }
    if let Some(value) = &arguments.serial {
        places.serial = "--serial".into();
        config.links.serial = Some(box_settings::serial("--serial", "", value)?);
    }

    let mut buffer = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut buffer).map_err(|error| setup::bad_config(&error, &places))?;
    assert_eq!(Config::decode(blob).as_ref(), Ok(&config), "a blob reads back as it was written");
    if config.capture.is_some() && config.links == Links::default() {
        // A box refuses it; a replay can be given a link when it is started.
        return Err(BadInput::new(
            &places.settings,
            "links",
            NO_LINK,
            "add [links] with udp or serial, or give --udp or --serial",
        )
        .into());
    }
    files::create(&arguments.out, arguments.force)?
        .write_all(blob)
        .map_err(|error| BadInput::io(arguments.out.display(), &error))?;
    eprintln!(
        "{}: {} bytes, checksum {:08x}, {} targets, {}",
        arguments.out.display(),
        blob.len(),
        config.crc(),
        config.targets.len(),
        if config.capture.is_some() { "a camera" } else { "no camera (replays only)" }
    );
    Ok(())
}
