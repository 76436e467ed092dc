//! An address of the box in its network.

use std::net::Ipv4Addr;

/// An address and the way to other networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Address {
    /// The box.
    pub address: Ipv4Addr,
    /// Leading bits that all addresses of its network share, 32 at most.
    pub prefix_bits: u8,
    /// The way to other networks.
    pub gateway: Option<Ipv4Addr>,
}

impl Address {
    /// The network's bits, as a mask.
    pub fn netmask(&self) -> Ipv4Addr {
        let host_bits = 32 - u32::from(self.prefix_bits.min(32));
        u32::MAX.checked_shl(host_bits).unwrap_or(0).into()
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}/{}", self.address, self.prefix_bits)?;
        self.gateway.map_or(Ok(()), |gateway| write!(formatter, " by {gateway}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_have_as_many_bits_as_they_should() {
        let mask = |prefix_bits| {
            Address { address: Ipv4Addr::LOCALHOST, prefix_bits, gateway: None }.netmask()
        };
        assert_eq!(mask(0), Ipv4Addr::new(0, 0, 0, 0));
        assert_eq!(mask(1), Ipv4Addr::new(128, 0, 0, 0));
        assert_eq!(mask(23), Ipv4Addr::new(255, 255, 254, 0));
        assert_eq!(mask(24), Ipv4Addr::new(255, 255, 255, 0));
        assert_eq!(mask(32), Ipv4Addr::new(255, 255, 255, 255));
    }
}
