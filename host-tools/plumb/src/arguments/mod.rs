//! Options that several subcommands take, and the values of options.

pub mod method;
pub mod table;

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use clap::Args;
use plumbline::packet::LinkKind;
use plumbline_files::BadInput;
use plumbline_stream::link::{BAUD, BoxLink, PORT};
use plumbline_stream::transport::{Serial, Transport, Udp};

/// How to reach a box: it sends to this computer, and answers where it is asked.
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
    /// Opens the socket or the line; returns it and its name for messages.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn transport(&self) -> Result<(Box<dyn Transport>, String), BadInput> {
        if let Some(path) = &self.serial {
            return Ok((Box::new(Serial::open(path, self.baud)?), path.clone()));
        }
        let address = self.udp.unwrap_or((Ipv4Addr::UNSPECIFIED, PORT).into());
        Ok((Box::new(Udp::bind(address)?), format!("UDP {address}")))
    }

    /// Opens the socket or the line to talk to the box.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn open(&self) -> Result<BoxLink, BadInput> {
        let (transport, place) = self.transport()?;
        let kind = if self.serial.is_some() { LinkKind::Serial } else { LinkKind::Udp };
        Ok(BoxLink::new(transport, place, kind))
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
