//! The ways out that are asked for.

use std::net::SocketAddr;

use plumbline_files::BadInput;

use crate::Publisher;
use crate::lsl::Lsl;

/// The ways out that are asked for.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Ways {
    /// The name of the stream of the Lab Streaming Layer.
    pub lsl: Option<String>,
    /// The address at which lines of JSON can be had.
    pub json: Option<SocketAddr>,
    /// The address to which OSC messages are sent.
    pub osc: Option<SocketAddr>,
}

impl Ways {
    /// Whether none is asked for.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// What is to be known of them before they are opened: that they leave this computer.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let ways = [("--json", self.json), ("--osc", self.osc)].into_iter();
        let ways = ways.filter_map(|(option, address)| Some((option, address?)));
        let leaving = ways.filter(|(_, address)| !address.ip().is_loopback());
        leaving
            .map(|(option, address)| {
                format!(
                    "{option} {address}: a person's movements leave this computer, and are not \
                     encrypted: use it in a network of your own only"
                )
            })
            .collect()
    }

    /// Opens them; what was opened, in words.
    ///
    /// # Errors
    /// When an address cannot be used, or there is no thread.
    pub fn open(
        &self,
        publisher: &mut Publisher,
        library: Option<Lsl>,
    ) -> Result<Vec<String>, BadInput> {
        let mut opened = Vec::new();
        if let (Some(name), Some(library)) = (&self.lsl, library) {
            publisher.add_lsl(library, name)?;
            opened.push(format!(
                "the stream {name} of the Lab Streaming Layer can be read by every computer of this \
                 network, unless a file lsl_api.cfg restricts it"
            ));
        }
        if let Some(address) = self.json {
            let address = publisher.add_json(address)?;
            opened.push(format!("lines of JSON for whoever connects to {address}"));
        }
        if let Some(address) = self.osc {
            publisher.add_osc(address)?;
            opened.push(format!("OSC messages to {address}"));
        }
        Ok(opened)
    }
}
