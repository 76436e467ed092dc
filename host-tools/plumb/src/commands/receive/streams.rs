//! The poses for other programs, while they are received; and marks from the Lab Streaming Layer.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Instant;

use clap::Args;
use plumbline_files::BadInput;
use plumbline_publish::lsl::markers::Markers;
use plumbline_publish::lsl::outlet::MARKS_SUFFIX;
use plumbline_publish::lsl::{self, Lsl};
use plumbline_publish::{MarkFeed, Publisher};
use plumbline_stream::reception::Tap;
use plumbline_trial::mark::{Mark, MarkSender, Source};

/// Streams for other programs.
#[derive(Debug, Args)]
pub(super) struct StreamArguments {
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

/// The streams in use.
pub(super) struct Streams(Publisher);

impl StreamArguments {
    /// Opens what is asked for, and says so unless `is_quiet`. `begun` is the zero of the recording's
    /// times; without a recording, `asks`, the streams ask the box for its clock.
    ///
    /// # Errors
    /// When an address cannot be used.
    pub(super) fn open(
        &self,
        lsl: Option<Lsl>,
        begun: Instant,
        asks: bool,
        is_quiet: bool,
    ) -> Result<Option<Streams>, BadInput> {
        if self.lsl.is_none() && self.json.is_none() && self.osc.is_none() {
            return Ok(None);
        }
        let say = |text: &str| {
            if !is_quiet {
                eprintln!("{text}");
            }
        };
        let mut publisher = Publisher::new(begun, asks);
        if let (Some(name), Some(library)) = (&self.lsl, lsl) {
            publisher.add_lsl(library, name)?;
            say(&format!(
                "the stream {name} of the Lab Streaming Layer can be read by every computer of this \
                 network, unless a file lsl_api.cfg restricts it"
            ));
        }
        for (option, address) in [("--json", self.json), ("--osc", self.osc)] {
            if let Some(address) = address.filter(|it| !it.ip().is_loopback()) {
                eprintln!(
                    "warning: {option} {address}: a person's movements leave this computer, and are \
                     not encrypted: use it in a network of your own only"
                );
            }
        }
        if let Some(address) = self.json {
            let address = publisher.add_json(address)?;
            say(&format!("lines of JSON for whoever connects to {address}"));
        }
        if let Some(address) = self.osc {
            publisher.add_osc(address)?;
        }
        Ok(Some(Streams(publisher)))
    }
}

impl Streams {
    /// What follows the reception.
    pub(super) fn tap(&mut self) -> &mut dyn Tap {
        &mut self.0
    }

    /// Through which the recording tells its marks.
    pub(super) fn mark_feed(&self) -> MarkFeed {
        self.0.mark_feed()
    }

    /// Ends them; what came of them, in words.
    pub(super) fn finish(self) -> Vec<String> {
        self.0.finish()
    }
}

/// The library of the Lab Streaming Layer, if an option needs it.
///
/// # Errors
/// When it is not on this computer.
pub(super) fn library(arguments: &super::Arguments) -> Result<Option<Lsl>, BadInput> {
    let is_wanted = arguments.streams.lsl.is_some() || arguments.mark_lsl.is_some();
    is_wanted.then(Lsl::load).transpose()
}

/// Listens to the markers that are named.
///
/// # Errors
/// When no stream can have that name.
pub(super) fn markers(
    arguments: &super::Arguments,
    lsl: Option<Lsl>,
    sender: &MarkSender,
) -> Result<Option<Markers>, BadInput> {
    let (Some(name), Some(lsl)) = (&arguments.mark_lsl, lsl) else { return Ok(None) };
    if arguments.streams.lsl.as_ref().is_some_and(|own| *name == format!("{own}{MARKS_SUFFIX}")) {
        return Err(BadInput::whole(
            format!("--mark-lsl {name}"),
            "is the stream in which the marks of this recording are published",
            "name another program's stream",
        ));
    }
    let sender = sender.clone();
    let take = move |at, label: &str| sender.send(at, Mark::new(Source::Lsl, label));
    Markers::of(lsl, name, take).map(Some)
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
