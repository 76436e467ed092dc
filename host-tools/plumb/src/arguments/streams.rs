//! The options of streams for other programs.

use std::net::{Ipv4Addr, SocketAddr};

use clap::Args;
use plumbline_files::BadInput;
use plumbline_publish::Ways;
use plumbline_publish::lsl::{self, Lsl};

/// Streams for other programs.
#[derive(Debug, Args)]
pub struct StreamArguments {
    /// Publish the poses by the Lab Streaming Layer, as the stream NAME, or Plumbline without a name
    ///
    /// One sample for each frame: both trunk points, both poses with their standard deviations, and
    /// their quality; NaN for what is missing. Frames that come late are in NAME-late, marks in
    /// NAME-marks. Every computer of this network can read them: a file lsl_api.cfg restricts that.
    /// liblsl must be installed; where it is not found, PLUMBLINE_LIBLSL names its file.
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = lsl::NAME)]
    lsl: Option<String>,

    /// Send the poses as lines of JSON to whoever connects here; a port alone is of this computer
    ///
    /// Who may reach the address can read the poses, which are not encrypted.
    #[arg(long, value_name = "[ADDRESS:]PORT", value_parser = here)]
    json: Option<SocketAddr>,

    /// Send the poses as OSC messages to this address by UDP; a port alone is of this computer
    #[arg(long, value_name = "[ADDRESS:]PORT", value_parser = here)]
    osc: Option<SocketAddr>,
}

impl StreamArguments {
    /// The ways out that are asked for.
    #[must_use]
    pub fn ways(&self) -> Ways {
        Ways { lsl: self.lsl.clone(), json: self.json, osc: self.osc }
    }
}

/// The library of the Lab Streaming Layer, if one of these names asks for it.
///
/// # Errors
/// When it is not on this computer.
pub fn library(names: [Option<&String>; 2]) -> Result<Option<Lsl>, BadInput> {
    names.into_iter().flatten().next().map(|_| Lsl::load()).transpose()
}

/// An address, or a port of this computer.
fn here(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse::<u16>() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    text.parse().map_err(|_| {
        "give a port of this computer (4217), or a numeric address and a port (192.168.1.20:4217)"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_of_this_computer() {
        assert_eq!(here("4217").unwrap(), "127.0.0.1:4217".parse().unwrap());
        assert_eq!(here("192.0.2.7:9000").unwrap(), "192.0.2.7:9000".parse().unwrap());
        assert!(here("lab-pc:4217").is_err() && here("70000").is_err());
    }
}
