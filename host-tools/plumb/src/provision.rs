//! `plumb provision`: the configuration of a box, as one file.

use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;

use plumbline::config::{BLOB_BYTES_MAX, Config, SerialLink};

use crate::error::BadInput;
use crate::files::refuse_overwriting;
use crate::setup::{self, Descriptions};

/// Write what a box needs to know into one file.
///
/// Camera, targets, scene and links go in; out comes a checked blob with a
/// version and a checksum, which the box's program takes at its start.
#[derive(clap::Args)]
#[command(after_help = "Example:
  plumb provision --camera camera.toml --targets targets.toml --udp 192.168.1.20:4210 --out config.plb")]
pub struct Arguments {
    #[command(flatten)]
    descriptions: Descriptions,
    /// Where the box sends its packets.
    #[arg(long, value_name = "HOST:PORT")]
    udp: Option<String>,
    /// A serial device of the BOX that it sends its packets on, such as /dev/ttyS0:115200.
    #[arg(long, value_name = "DEVICE:BAUD")]
    serial: Option<String>,
    /// The box's name, for people.
    #[arg(long, default_value = "plumbline")]
    device: String,
    /// The box's serial number.
    #[arg(long, default_value = "0")]
    serial_number: String,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let places = arguments.descriptions.places();
    refuse_overwriting(&arguments.out, arguments.descriptions.paths())?;
    let (camera, targets, scene) = arguments.descriptions.read()?;
    let mut config = setup::config(&camera, &targets, scene.as_ref(), &places)?;
    config.device = text("--device", &arguments.device)?;
    config.serial_number = text("--serial-number", &arguments.serial_number)?;
    config.links.udp = arguments.udp.as_deref().map(udp).transpose()?;
    config.links.serial = arguments.serial.as_deref().map(serial).transpose()?;

    let mut buffer = vec![0; BLOB_BYTES_MAX];
    let blob = config.encode(&mut buffer).map_err(|error| setup::bad_config(&error, &places))?;
    assert_eq!(Config::decode(blob).as_ref(), Ok(&config), "a blob reads back as it was written");
    std::fs::write(&arguments.out, blob)
        .map_err(|error| BadInput::io(arguments.out.display(), &error))?;
    eprintln!(
        "{}: {} bytes, checksum {:08x}, {} targets",
        arguments.out.display(),
        blob.len(),
        config.crc(),
        config.targets.len()
    );
    Ok(())
}

fn text<const N: usize>(option: &str, value: &str) -> Result<heapless::String<N>, BadInput> {
    value.try_into().map_err(|_| {
        BadInput::whole(
            option,
            format!("{value:?} has {} bytes", value.len()),
            format!("give at most {N} bytes"),
        )
    })
}

fn udp(value: &str) -> Result<SocketAddr, BadInput> {
    let bad = |found: String| {
        BadInput::whole("--udp", found, "give HOST:PORT, for example 192.168.1.20:4210")
    };
    let mut addresses =
        value.to_socket_addrs().map_err(|error| bad(format!("{value:?}: {error}")))?;
    addresses.next().ok_or_else(|| bad(format!("{value:?} has no address")))
}

fn serial(value: &str) -> Result<SerialLink, BadInput> {
    let parts = value.rsplit_once(':').and_then(|(path, baud)| Some((path, baud.parse().ok()?)));
    let Some((path, baud)) = parts else {
        return Err(BadInput::whole(
            "--serial",
            format!("{value:?}"),
            "give DEVICE:BAUD, for example /dev/ttyS0:115200",
        ));
    };
    Ok(SerialLink { path: text("--serial", path)?, baud })
}
