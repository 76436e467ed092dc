//! The links and the camera that a configuration names: what a box measures with.
//!
//! A start, a configuration that a host sends and `--check` all judge a configuration by this,
//! so that none of them accepts what another refuses.

use anyhow::{Result, bail};
use plumbline::config::{Config, ConfigError, NO_LINK};
use plumbline::lens_table::LensTable;

use crate::link::{Link, Links, SerialLink, UdpLink};
use crate::source::chosen::Source;

/// What a box measures with. Neither the camera nor the other end of a link needs to be there
/// yet.
#[derive(Debug)]
pub struct Equipment {
    /// Where the packets go.
    pub links: Links,
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
        Ok(Self { links: links(config)?, source: Source::camera(config)? })
    }
}

fn links(config: &Config) -> Result<Links> {
    let udp = config.links.udp.map(|host| UdpLink::to(host).map(Link::Udp));
    let serial = config.links.serial.as_ref();
    let serial = serial.map(|line| SerialLink::absent(&line.path, line.baud).map(Link::Serial));
    let links: Links = udp.into_iter().chain(serial).collect::<Result<_>>()?;
    if links.is_empty() {
        bail!("links: {NO_LINK}");
    }
    Ok(links)
}
