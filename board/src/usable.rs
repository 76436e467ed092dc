//! Whether this program can run with a configuration. A start asks it, and so does a host that
//! sends one.

use anyhow::{Result, bail};
use plumbline::config::{Config, NO_LINK};

use crate::link::{Link, Links, SerialLink, UdpLink};
use crate::source::chosen::Source;

/// The links and the camera of a configuration, once this program has been found able to use
/// it. Neither need be there yet.
///
/// # Errors
/// What a box would refuse it for.
pub fn usable(config: &Config) -> Result<(Links, Source)> {
    config.check()?;
    Ok((links(config)?, Source::camera(config)?))
}

/// The links of the configuration; what they need may come later.
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
