//! `[network]` of `box.toml`: the box's address, where no DHCP server gives one.

use std::net::Ipv4Addr;

use plumbline::config::{Machine, Network};
use plumbline_files::BadInput;
use serde::{Deserialize, Serialize};

const ADDRESS_WANTED: &str =
    "give a host's address with a prefix within 1 to 30, for example 192.168.1.30/24";

/// What a field takes, for whoever gave it something of another kind.
pub(super) fn wanted(name: &str) -> Option<&'static str> {
    Some(match name {
        "address" => ADDRESS_WANTED,
        "gateway" => "give an address, for example 192.168.1.1, or leave it out",
        _ => return None,
    })
}

/// The settings of the network, as a file gives them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NetworkFields {
    address: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    gateway: Option<Ipv4Addr>,
}

impl NetworkFields {
    /// Those of a configuration; `None` for an address by DHCP.
    pub(super) fn of(network: Network) -> Option<Self> {
        match network {
            Network::Dhcp => None,
            Network::Static { address, prefix_bits, gateway } => {
                Some(Self { address: format!("{address}/{prefix_bits}"), gateway })
            }
        }
    }

    /// The network; `place` names the file in errors.
    pub(super) fn network(&self, place: &str) -> Result<Network, BadInput> {
        let parts = self.address.split_once('/');
        let parts =
            parts.and_then(|(address, bits)| Some((address.parse().ok()?, bits.parse().ok()?)));
        let Some((address, prefix_bits)) = parts else {
            let found = format!("{:?}", self.address);
            return Err(BadInput::new(place, "network.address", found, ADDRESS_WANTED));
        };
        let network = Network::Static { address, prefix_bits, gateway: self.gateway };
        if let Some(gateway) = self.gateway
            && !is_within(gateway, address, prefix_bits)
        {
            return Err(BadInput::new(
                place,
                "network.gateway",
                format!("{gateway} is not in the network of {}", self.address),
                "give the router of that network, or leave it out",
            ));
        }
        Ok(network)
    }
}

/// Both have the same leading bits; a prefix that is none is another fault.
fn is_within(gateway: Ipv4Addr, address: Ipv4Addr, prefix_bits: u8) -> bool {
    let differing = gateway.to_bits() ^ address.to_bits();
    prefix_bits > 32 || differing.leading_zeros() >= u32::from(prefix_bits)
}

/// Which of the two addresses a network is refused for.
pub(super) fn fault(place: &str, network: Network) -> BadInput {
    let Network::Static { address, prefix_bits, gateway } = network else {
        unreachable!("an address by DHCP has nothing to refuse");
    };
    let alone = Network::Static { address, prefix_bits, gateway: None };
    match gateway {
        Some(gateway) if (Machine { network: alone, ..Machine::default() }).check().is_ok() => {
            BadInput::new(place, "network.gateway", gateway, "give the address of a router")
        }
        _ => {
            let found = format!("{address}/{prefix_bits}");
            BadInput::new(place, "network.address", found, ADDRESS_WANTED)
        }
    }
}
