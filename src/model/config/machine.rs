//! The settings of the box's computer besides the measurement: its network address, the
//! measurement's priority among the other programs, the watchdog.

use core::net::Ipv4Addr;

use serde::{Deserialize, Serialize};

/// Longest time without a processed frame that a watchdog can be asked to allow.
pub const WATCHDOG_S_MAX: u16 = 600;

/// The box's own address. Only a box that is its computer's first process sets
/// one; elsewhere the operating system does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Network {
    /// From a DHCP server.
    #[default]
    Dhcp,
    /// A fixed one.
    Static {
        /// The box's address.
        address: Ipv4Addr,
        /// The number of leading bits that all addresses of its network share.
        prefix_bits: u8,
        /// The gateway to other networks.
        gateway: Option<Ipv4Addr>,
    },
}

/// How the box's computer runs the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Machine {
    /// The box's own address.
    pub network: Network,
    /// SCHED_FIFO priority of the measurement, 1 to 99; `None` gives it no priority over other
    /// programs.
    pub realtime_priority: Option<u8>,
    /// The processor core on which the measurement runs, from 0.
    pub cpu: Option<u8>,
    /// The hardware watchdog restarts the computer after this many seconds without
    /// a processed frame; `None` leaves it off.
    pub watchdog_s: Option<u16>,
}

/// Which field of a [`Machine`] is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MachineError {
    /// The fixed address or the gateway is not that of a host, or the prefix is not within 1 to 30.
    Network,
    /// The priority is not within 1 to 99.
    RealtimePriority,
    /// The watchdog's time is not within 1 to [`WATCHDOG_S_MAX`].
    Watchdog,
}

impl core::fmt::Display for MachineError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Network => formatter.write_str(
                "network: address and gateway must be those of hosts, with a prefix within 1 to 30",
            ),
            Self::RealtimePriority => {
                formatter.write_str("realtime_priority: must be within 1 to 99")
            }
            Self::Watchdog => {
                write!(formatter, "watchdog_s: must be within 1 to {WATCHDOG_S_MAX}")
            }
        }
    }
}

impl Machine {
    /// Checks every value.
    ///
    /// # Errors
    /// The first field that is out of range.
    pub fn check(&self) -> Result<(), MachineError> {
        if let Network::Static { address, prefix_bits, gateway } = self.network {
            let is_host =
                |it: Ipv4Addr| !it.is_unspecified() && !it.is_multicast() && !it.is_broadcast();
            if !is_host(address) || !gateway.is_none_or(is_host) || !(1..=30).contains(&prefix_bits)
            {
                return Err(MachineError::Network);
            }
        }
        if self.realtime_priority.is_some_and(|priority| !(1..=99).contains(&priority)) {
            return Err(MachineError::RealtimePriority);
        }
        if self.watchdog_s.is_some_and(|seconds| !(1..=WATCHDOG_S_MAX).contains(&seconds)) {
            return Err(MachineError::Watchdog);
        }
        Ok(())
    }
}
