//! The links and the camera that a configuration names: what a box measures with.
//!
//! A start, a configuration that a host sends and `--check` all judge a configuration by this,
//! so that none of them accepts what another refuses.

use anyhow::{Result, bail};
use plumbline::config::{Config, ConfigError, Links, NO_LINK};
use plumbline::lens_table::LensTable;

use crate::link::{Ports, SerialLink, UdpLink};
use crate::source::chosen::Source;

/// What a box measures with. Neither the camera nor the other end of a link needs to be there
/// yet.
#[derive(Debug)]
pub struct Equipment {
    /// Where the packets go.
    pub ports: Ports,
    /// Where the frames come from.
    pub source: Source,
}

impl Equipment {
    /// The equipment of a configuration, once this program has been found able to use it.
    ///
    /// # Errors
    /// The reason for which a box would refuse the configuration.
    pub fn of(config: &Config) -> Result<Self> {
        config.check()?;
        // Too large for a small stack.
        let mut table = Box::new(LensTable::new());
        table.fill(&config.lens).map_err(ConfigError::from)?;
        Ok(Self { ports: ports(&config.links)?, source: Source::camera(config)? })
    }
}

/// The ports of these links.
fn ports(links: &Links) -> Result<Ports> {
    let udp = links.udp.map(UdpLink::to).transpose()?;
    let line = links.serial.as_ref();
    let serial = line.map(|line| SerialLink::absent(&line.path, line.baud)).transpose()?;
    let is_one_way = line.is_some_and(|line| line.one_way);
    let ports = Ports { udp, serial, is_one_way, file: None };
    if ports.is_empty() {
        bail!("links: {NO_LINK}");
    }
    Ok(ports)
}
