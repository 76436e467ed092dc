//! `plumb provision`: the configuration of a box, as a file, on a card, or sent to the box.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;

use plumbline::config::{BLOB_BYTES_MAX, Config};

use crate::delivery;
use crate::error::BadInput;
use crate::files::box_settings::{self, BoxSettings};
use crate::files::{self, refuse_overwriting};
use crate::link::{self, LinkArguments};
use crate::setup::{self, Descriptions, Places};

mod card;
mod identity;

/// Give a box what it needs to know: as a file, on its card, or sent to it while it runs.
///
/// Camera, targets, scene and the box's own settings become one checked blob with a version
/// and a checksum, which the box's program takes at its start.
///
/// --udp and --serial say where the BOX sends its packets to. Where THIS computer hears the
/// box, for --send, is said by --via-udp or --via-serial. The box keeps what is sent, whatever
/// happens to its power, and starts anew with it.
#[derive(clap::Args)]
#[command(
    group(clap::ArgGroup::new("outputs").args(["out", "card", "send"]).required(true).multiple(true)),
    after_help = "\
Examples:
  For a box with a camera, as a file:
    plumb provision --camera camera.toml --targets targets.toml --scene scene.toml \\
        --box box.toml --out config.plb
  To the box that sends to this computer, over the network or a serial line:
    plumb provision --camera camera.toml --targets targets.toml --box box.toml --send
    plumb provision --camera camera.toml --targets targets.toml --box box.toml --send \\
        --via-serial /dev/ttyUSB0
  Into a card's image; onto a card (lsblk shows its name); onto a card that is mounted:
    plumb provision ... --box box.toml --card plumbline-rpi4.img
    sudo plumb provision ... --box box.toml --card /dev/sdX
    plumb provision ... --box box.toml --out /media/PLUMBLINE/config.plb --force
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
                              # stopped while the camera is known to be lost"
)]
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
    /// Write it to this file.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Put it on this card, in the place of the one there: an image of `cargo xtask image`, or
    /// a card's device.
    #[arg(long, value_name = "IMAGE|DEVICE")]
    card: Option<PathBuf>,
    /// Send it to the box that this computer hears, which then starts anew with it.
    #[arg(long)]
    send: bool,
    /// With --send: hear the box at this address and port of this computer [default:
    /// 0.0.0.0:4210]
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        value_parser = link::address,
        requires = "send",
        conflicts_with = "via_serial"
    )]
    via_udp: Option<SocketAddr>,
    /// With --send: hear the box on this serial device of this computer.
    #[arg(long, value_name = "DEVICE", requires = "send")]
    via_serial: Option<String>,
    /// Bits per second of --via-serial.
    #[arg(long, value_name = "RATE", default_value_t = link::BAUD, requires = "via_serial")]
    via_baud: u32,
    /// With --send: do not restart the box; it takes effect at its next start.
    #[arg(long, requires = "send")]
    no_restart: bool,
    /// Replace the file of --out if it exists, and the configuration of a box of another name.
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used, an output cannot be written, or the box does not take it.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(out) = &arguments.out {
        refuse_overwriting(out, arguments.descriptions.paths().chain(&arguments.settings))?;
    }
    let (config, places) = config(arguments)?;
    let mut buffer = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut buffer).map_err(|error| setup::bad_config(&error, &places))?;
    assert_eq!(Config::decode(blob).as_ref(), Ok(&config), "a blob reads back as it was written");
    if arguments.card.is_some() {
        setup::check_for_box(&config, &places)?;
    } else if config.capture.is_some() {
        // A replay can be given a link when it is started.
        setup::check_links(&config, &places)?;
    }
    eprintln!(
        "configuration {:08x}: {} bytes, {} targets, {}",
        config.crc(),
        blob.len(),
        config.targets.len(),
        if config.capture.is_some() { "a camera" } else { "no camera (replays only)" }
    );
    if let Some(out) = &arguments.out {
        files::create(out, arguments.force)?
            .write_all(blob)
            .map_err(|error| BadInput::io(out.display(), &error))?;
        eprintln!("written to {}", out.display());
    }
    if let Some(card) = &arguments.card {
        card::write(card, &config, blob, arguments.force)?;
    }
    if arguments.send {
        send(arguments, &config, &places)?;
    }
    Ok(())
}

/// The configuration that the files and options make, once it has been checked as a box will.
fn config(arguments: &Arguments) -> Result<(Config, Places), BadInput> {
    let mut places = arguments.descriptions.places();
    let (camera, targets, scene) = arguments.descriptions.read()?;
    let mut config = setup::config(&camera, &targets, scene.as_ref(), &places)?;
    if let Some(path) = &arguments.settings {
        places.settings = path.display().to_string();
        places.udp.clone_from(&places.settings);
        places.serial.clone_from(&places.settings);
        box_settings::read(path)?.apply(&mut config, &places.settings)?;
    } else {
        places.settings = "--box".into();
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
    // A box would come to this at its start.
    setup::configured(&config, &places)?;
    Ok((config, places))
}

fn send(arguments: &Arguments, config: &Config, places: &Places) -> Result<(), BadInput> {
    let reached_by = LinkArguments {
        udp: arguments.via_udp,
        serial: arguments.via_serial.clone(),
        baud: arguments.via_baud,
    };
    let mut link = reached_by.open()?;
    let before = delivery::meet(&mut link)?;
    if let Some(hello) = &before.hello {
        identity::refuse_another_box(
            link.place(),
            (&hello.device, &hello.serial_number),
            (&config.device, &config.serial_number),
            arguments.force,
        )?;
    }
    // One that replays a recording may do so without a camera.
    if before.config.as_ref().is_none_or(|old| old.capture.is_some()) {
        setup::check_for_box(config, places)?;
    }
    delivery::deliver(&mut link, &before, config, !arguments.no_restart)
}
