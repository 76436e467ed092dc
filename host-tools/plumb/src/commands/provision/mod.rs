//! `plumb provision`: the configuration of a box, as a file, on a card, or sent to the box.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use plumbline::config::Config;
use plumbline::seal::Key;
use plumbline_bedside::box_settings::{self, BoxSettings, NEW_BOX};
use plumbline_bedside::delivery;
use plumbline_bedside::keys::{self, Plan, Store};
use plumbline_bedside::setup::{self, Descriptions, Places};
use plumbline_files::BadInput;
use plumbline_files::refuse_overwriting;

use crate::arguments::LinkArguments;
use crate::ui::waiting;

mod card;

/// Give a box what it needs to know: as a file, on its card, or sent to it while it runs.
///
/// Camera, targets, scene and the box's own settings become one checked blob with a version
/// and a checksum, which the box's program takes at its start.
///
/// --udp and --serial say where the BOX sends its packets to. Where THIS computer hears the
/// box, for --send, is said by --via-udp or --via-serial. The box keeps what is sent, whatever
/// happens to its power, and restarts with it.
///
/// Beside its configuration a card has the box's key (box.key), by which the box and its hosts know
/// each other. --new-key makes it, and keeps it on this computer by the box's serial number (`plumb
/// keys`). Afterwards --card writes the same key onto every card of that box. A key is never sent
/// over a network: --send leaves it as it is.
#[derive(clap::Args)]
#[command(
    group(
        clap::ArgGroup::new("outputs")
            .args(["out", "card", "send", "new_box"])
            .required(true)
            .multiple(true)
    ),
    after_help = format!("\
Examples:
  What is the box's own, to be edited:
    plumb provision --new-box box.toml
  For a box whose camera is yet to be calibrated, with photographs that it takes (`plumb aim`):
    plumb provision --uncalibrated 1456x1088 --targets targets.toml --box box.toml --send
  For a box with a camera, as a file:
    plumb provision --camera camera.toml --targets targets.toml --scene scene.toml \\
        --box box.toml --out config.plb
  To the box that sends to this computer, over the network or a serial line:
    plumb provision --camera camera.toml --targets targets.toml --box box.toml --send
    plumb provision --camera camera.toml --targets targets.toml --box box.toml --send \\
        --via-serial /dev/ttyUSB0
  A new box, with a key of its own; the same, as two files to be copied to the card:
    plumb provision ... --box box.toml --new-key --card plumbline-rpi4.img
    plumb provision ... --box box.toml --new-key --out card/config.plb
  Into a card's image; onto a card (lsblk shows its name); onto a card that is mounted:
    plumb provision ... --box box.toml --card plumbline-rpi4.img
    sudo plumb provision ... --box box.toml --card /dev/sdX
    plumb provision ... --box box.toml --out /media/PLUMBLINE/config.plb --force
  For a replay on this machine:
    plumb provision --camera camera.toml --targets targets.toml --udp 127.0.0.1:4210 --out config.plb

A box file, as --new-box writes it (only driver, pixel_format and rate_hz of a capture must be
given):

{NEW_BOX}")
)]
pub struct Arguments {
    /// Camera file: camera.toml, OpenCV (YAML or JSON), or ROS camera_info (YAML).
    #[arg(long, value_name = "FILE", required_unless_present_any = ["uncalibrated", "new_box"])]
    camera: Option<PathBuf>,
    /// Instead of a camera file: the size of the frames of a camera that is not calibrated.
    /// Such a box looks for the scene board alone, and is for aiming and taking photographs.
    #[arg(
        long,
        value_name = "WIDTHxHEIGHT",
        value_parser = frame_size,
        conflicts_with_all = ["camera", "scene"]
    )]
    uncalibrated: Option<[u16; 2]>,
    /// Targets file: each printed target's name, role, inner corners and pitch.
    #[arg(long, value_name = "FILE", required_unless_present = "new_box")]
    targets: Option<PathBuf>,
    /// Scene file: where the scene board stands; without it there are no trunk points.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Write a box file with every setting explained, to be edited, and end.
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = [
            "camera", "uncalibrated", "targets", "scene", "settings", "udp", "serial", "out",
            "card", "send"
        ]
    )]
    new_box: Option<PathBuf>,
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
    /// Put it on this card, replacing the one there: an image of `cargo xtask image`, or
    /// a card's device.
    #[arg(long, value_name = "IMAGE|DEVICE")]
    card: Option<PathBuf>,
    /// Make a key for the box, keep it here, and write it beside the configuration of --card or --out,
    /// as box.key. Other computers get it with `plumb keys export`.
    #[arg(long, conflicts_with_all = ["send", "new_box"])]
    new_key: bool,
    /// Send it to the box that this computer hears, which then restarts with it.
    #[arg(long)]
    send: bool,
    /// With --send: hear the box at this address and port of this computer [default:
    /// 0.0.0.0:4210]
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        value_parser = crate::arguments::address,
        requires = "send",
        conflicts_with = "via_serial"
    )]
    via_udp: Option<SocketAddr>,
    /// With --send: hear the box on this serial device of this computer.
    #[arg(long, value_name = "DEVICE", requires = "send")]
    via_serial: Option<String>,
    /// Bits per second of --via-serial.
    #[arg(long, value_name = "RATE", default_value_t = plumbline_stream::link::BAUD, requires = "via_serial")]
    via_baud: u32,
    /// With --send: do not restart the box; it takes effect at its next start.
    #[arg(long, requires = "send")]
    no_restart: bool,
    /// Replace the file of --out if it exists, and the configuration of a box of another name, of
    /// one whose frames have another size, or of one that would no longer be heard here; and the key
    /// of a box that has another. With --send, also while somebody records a trial, which that spoils.
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used, an output cannot be written, or the box does not take it.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(path) = &arguments.new_box {
        plumbline_files::write_all(&[(path.clone(), NEW_BOX.into())], arguments.force)?;
        eprintln!("written to {}; edit its links and its camera", path.display());
        return Ok(());
    }
    if let Some(out) = &arguments.out {
        let inputs = [&arguments.camera, &arguments.targets, &arguments.scene, &arguments.settings];
        refuse_overwriting(out, inputs.into_iter().flatten())?;
    }
    let (config, places) = config(arguments)?;
    let blob = setup::blob(&config, &places)?;
    if arguments.card.is_some() {
        setup::check_for_box(&config, &places)?;
    } else if config.capture.is_some() {
        // A replay can be given a link when it is started.
        setup::check_links(&config, &places)?;
    }
    eprintln!(
        "configuration {:08x}: {} bytes, targets: {}; {}",
        config.crc(),
        blob.len(),
        config.targets.iter().map(|target| target.name.as_str()).collect::<Vec<_>>().join(", "),
        if config.capture.is_some() { "a camera" } else { "no camera (replays only)" }
    );
    write(arguments, &config, &blob, &places)?;
    if arguments.send {
        send(arguments, &config, &places)?;
    }
    Ok(())
}

/// Writes the configuration to its file and its card, and the key beside it.
fn write(
    arguments: &Arguments,
    config: &Config,
    blob: &[u8],
    places: &Places,
) -> Result<(), BadInput> {
    if arguments.card.is_none() && !arguments.new_key {
        let Some(out) = &arguments.out else { return Ok(()) };
        write_files(out, blob, None, arguments.force)?;
        let Plan { words, .. } = Plan::for_file(config, out);
        if !words.is_empty() {
            eprintln!("{words}");
        }
        return Ok(());
    }
    let store = Store::open()?;
    let force = arguments.force;
    let found = arguments.card.as_deref().map(|card| card::key(card, config, force)).transpose()?;
    let plan = match (&arguments.card, &found) {
        (Some(card), Some(found)) if !arguments.new_key => {
            Plan::for_card(&store, config, &card.display().to_string(), found, force)?
        }
        _ => Plan::new_key(&store, config, &places.settings, found.as_ref(), force)?,
    };
    plan.begin(&store)?;
    if let Some(out) = &arguments.out {
        // A card gets the key that is known; a file gets one beside it only where that was asked for.
        let key = plan.written.as_ref().filter(|_| arguments.new_key);
        write_files(out, blob, key, force)
            .inspect_err(|_| plan.undo(&store, &mut waiting::shown()))?;
    }
    if let Some(card) = &arguments.card {
        card::write(card, config, blob, plan.written.as_ref(), force).inspect_err(|_| {
            // A file may have it already.
            if arguments.out.is_none() {
                plan.undo(&store, &mut waiting::shown());
            }
        })?;
    }
    plan.end(&store)?;
    if !plan.words.is_empty() {
        eprintln!("{}", plan.words);
    }
    Ok(())
}

/// Writes the configuration to a file, and the key beside it: both or neither.
fn write_files(out: &Path, blob: &[u8], key: Option<&Key>, force: bool) -> Result<(), BadInput> {
    let mut outputs = vec![(out.to_owned(), blob.to_vec())];
    if let Some(key) = key {
        outputs.push((keys::beside(out)?, keys::file(key).to_vec()));
    }
    plumbline_files::write_all(&outputs, force)?;
    for (path, _) in &outputs {
        eprintln!("written to {}", path.display());
    }
    Ok(())
}

/// The configuration that the files and options make, checked as the box will check it.
fn config(arguments: &Arguments) -> Result<(Config, Places), BadInput> {
    let (mut config, mut places) = described(arguments)?;
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

/// The configuration of camera, targets and scene.
fn described(arguments: &Arguments) -> Result<(Config, Places), BadInput> {
    // The command line has made sure that each is given.
    let targets = arguments.targets.as_deref().unwrap_or_else(|| Path::new(""));
    let camera = arguments.camera.as_deref().unwrap_or_else(|| Path::new(""));
    let descriptions = Descriptions::of(camera, targets, arguments.scene.as_deref());
    let mut places = descriptions.places();
    if let Some([width, height]) = arguments.uncalibrated {
        places.camera = "--uncalibrated".into();
        let config = setup::uncalibrated(
            width,
            height,
            descriptions.read_targets(&mut waiting::shown())?,
            &places,
        )?;
        return Ok((config, places));
    }
    let (camera, targets, scene) = descriptions.read(&mut waiting::shown())?;
    Ok((setup::config(&camera, &targets, scene.as_ref(), &places)?, places))
}

/// A frame's size, as an option has it.
fn frame_size(text: &str) -> Result<[u16; 2], String> {
    let sides = text.split_once('x').map(|(width, height)| (width.parse(), height.parse()));
    match sides {
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("give the frames' size as WIDTHxHEIGHT, such as 1456x1088".to_owned()),
    }
}

fn send(arguments: &Arguments, config: &Config, places: &Places) -> Result<(), BadInput> {
    // Otherwise it is for the box that is heard, which gets another number.
    let known = Store::open()?.by_serial_number(&config.serial_number)?;
    let reached_by = LinkArguments {
        udp: arguments.via_udp,
        serial: arguments.via_serial.clone(),
        baud: arguments.via_baud,
        called: known.map(|it| it.key.id().to_string()),
    };
    let mut link = reached_by.open()?;
    let restart = !arguments.no_restart;
    delivery::provision(&mut link, config, places, arguments.force, restart, &mut waiting::shown())
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_bedside::box_settings;

    const README: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../README.md"));

    #[test]
    fn a_new_box_file_is_read_as_it_is_and_with_every_setting() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("box.toml");
        std::fs::write(&path, NEW_BOX).unwrap();
        box_settings::read(&path).unwrap();
        // What is left out begins with # and no space; what explains, with a space.
        let all: String = NEW_BOX
            .lines()
            .map(|line| line.strip_prefix('#').filter(|it| !it.starts_with(' ')).unwrap_or(line))
            .map(|line| format!("{line}\n"))
            .collect();
        assert!(!all.lines().any(|line| line.starts_with('#')), "{all}");
        std::fs::write(&path, all).unwrap();
        box_settings::read(&path).unwrap();
    }

    #[test]
    fn the_readme_shows_the_box_file_that_is_written() {
        assert!(README.contains(&format!("```toml\n{NEW_BOX}```")));
    }
}
