//! Options that several subcommands take, and the values of options.

pub mod method;
pub mod streams;
pub mod table;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use plumbline_bedside::link::{Carried, Way, called};
use plumbline_bedside::setup::Descriptions;
use plumbline_files::BadInput;
use plumbline_stream::link::{BAUD, BoxLink};
use plumbline_stream::update_link::UpdateLink;

/// How to reach a box: it announces itself to this computer, and answers whoever has its key.
#[derive(Debug, Clone, Args)]
pub struct LinkArguments {
    /// Listen for the box's datagrams at this address and port [default: 0.0.0.0:4210]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address, conflicts_with = "serial")]
    pub udp: Option<SocketAddr>,

    /// Listen on this serial device of this computer
    #[arg(long, value_name = "DEVICE")]
    pub serial: Option<String>,

    /// Bits per second of the serial device
    #[arg(long, value_name = "RATE", default_value_t = BAUD, requires = "serial")]
    pub baud: u32,

    /// Which box: its name, its serial number or the first digits of its key's identity, as in
    /// `plumb keys list` [default: the first that is heard of those whose keys are known here]
    #[arg(long = "box-name", value_name = "BOX")]
    pub called: Option<String>,
}

/// The description files, as options.
#[derive(Debug, Args)]
pub struct DescriptionArguments {
    /// Camera file: camera.toml, OpenCV (YAML or JSON), or ROS camera_info (YAML).
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// Targets file: each printed target's name, role, inner corners and pitch.
    #[arg(long, value_name = "FILE")]
    targets: PathBuf,
    /// Scene file: where the scene board stands; without it there are no trunk points.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
}

impl DescriptionArguments {
    /// The files' paths.
    #[must_use]
    pub fn descriptions(&self) -> Descriptions {
        Descriptions::of(&self.camera, &self.targets, self.scene.as_deref())
    }
}

/// What this program is called at boxes: its subcommand, and the computer's name.
#[must_use]
pub fn program() -> String {
    let subcommand = std::env::args().nth(1).unwrap_or_default();
    called(&subcommand)
}

/// Parses an address to listen at.
///
/// # Errors
/// The text says what to give instead.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| {
        "give a numeric address and a port: 0.0.0.0:4210 listens at all addresses".to_owned()
    })
}

impl LinkArguments {
    /// Opens the socket or the line to talk to the box.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open(&self) -> Result<BoxLink, BadInput> {
        self.open_with(false)
    }

    /// The same, and `past` wants what the box has kept of the last minute as well.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(&self, past: bool) -> Result<BoxLink, BadInput> {
        self.way().open(&program(), past, |warning| eprintln!("warning: {warning}"))
    }

    /// Opens the socket or the line to update the box.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open_for_update(&self) -> Result<UpdateLink, BadInput> {
        self.way().open_for_update(&program(), |warning| eprintln!("warning: {warning}"))
    }

    fn way(&self) -> Way {
        let carried = match &self.serial {
            Some(device) => Carried::Serial { device: device.clone(), baud: self.baud },
            None => Carried::Udp(self.udp),
        };
        Way { carried, called: self.called.clone(), at: None }
    }
}

/// Parses a time in seconds.
///
/// # Errors
/// The text says what to give instead.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let value: f64 = text.parse().map_err(|_| "give a number of seconds".to_owned())?;
    if value > 0.0 {
        Duration::try_from_secs_f64(value).map_err(|_| "too long".to_owned())
    } else {
        Err("give more than 0 seconds".to_owned())
    }
}
