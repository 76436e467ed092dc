//! The box's network: gives its Ethernet interface an address, fixed or from a DHCP server.
//!
//! This is a separate process beside the measurement. It waits, lists and starts programs,
//! which allocates, and it may do so at any time: an adapter is unplugged, a lease is lost.
//! The measurement is not affected; what is logged here goes to the box's first process,
//! which passes it on to the hosts.
//!
//! The interface is the first Ethernet hardware in the order of names, whenever it appears;
//! one that disappears and comes back is set up again.

mod interface;
pub mod lease;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use plumbline::config::Network;

use interface::Address;

/// The process's name.
pub const NAME: &str = "plumbline-network";

const INTERFACES: &str = "/sys/class/net";

/// The pause between two searches while there is no interface.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// The number of searches before a missing interface is logged: ten seconds' worth.
const LOOKS_IN_SILENCE: u32 = 100;

/// The time between two checks that the interface is still there.
const CHECK: Duration = Duration::from_secs(1);

/// The pause after an address that the interface did not accept, or after the client ended.
const TRY_AGAIN: Duration = Duration::from_secs(5);

/// The DHCP client.
const BUSYBOX: &str = "/sbin/busybox";

/// What the client runs: this program, under the name of its role.
const LEASE_PROGRAM: &str = "/sbin/network-lease";

/// The arguments with which the process is started.
pub fn arguments(network: Network) -> Vec<String> {
    match network {
        Network::Dhcp => vec!["dhcp".into()],
        Network::Static { address, prefix_bits, gateway } => {
            let own = [address.to_string(), prefix_bits.to_string()];
            own.into_iter().chain(gateway.map(|it| it.to_string())).collect()
        }
    }
}

fn network(arguments: &[String]) -> Option<Network> {
    let (address, rest) = match arguments {
        [word] if word == "dhcp" => return Some(Network::Dhcp),
        [address, rest @ ..] => (address.parse().ok()?, rest),
        [] => return None,
    };
    let (prefix_bits, gateway) = match rest {
        [prefix_bits] => (prefix_bits, None),
        [prefix_bits, gateway] => (prefix_bits, Some(gateway.parse().ok()?)),
        _ => return None,
    };
    Some(Network::Static { address, prefix_bits: prefix_bits.parse().ok()?, gateway })
}

/// Runs the process: manages the network until the computer restarts.
///
/// # Errors
/// When the arguments are not those that [`arguments`] gives.
pub fn run(given: &[String]) -> Result<()> {
    let Some(network) = network(given) else {
        bail!(
            "{NAME} takes `dhcp` or ADDRESS PREFIX_BITS [GATEWAY], not `{}`; \
             the box starts it by itself",
            given.join(" ")
        );
    };
    if let Err(error) = interface::bring_up("lo") {
        log::warn!("{error:#}");
    }
    let mut looks = 0;
    loop {
        match ethernet(Path::new(INTERFACES)) {
            Some(found) => {
                looks = 0;
                if let Err(error) = look_after(&found, network) {
                    log::error!("network: {error:#}; trying again");
                    std::thread::sleep(TRY_AGAIN);
                }
            }
            None => {
                looks += 1;
                if looks == LOOKS_IN_SILENCE {
                    log::error!("no Ethernet interface found: plug in an adapter");
                }
                std::thread::sleep(LOOK_AGAIN);
            }
        }
    }
}

/// Gives the interface its address, and waits until it is gone or the DHCP client has
/// ended.
fn look_after(found: &Interface, network: Network) -> Result<()> {
    let mut client = match network {
        Network::Dhcp => Some(start_client(&found.name)?),
        Network::Static { address, prefix_bits, gateway } => {
            let address = Address { address, prefix_bits, gateway };
            interface::configure(&found.name, &address)?;
            log::info!("network: {} has {address}", found.name);
            None
        }
    };
    while ethernet(Path::new(INTERFACES)).as_ref() == Some(found) {
        std::thread::sleep(CHECK);
        if let Some(client) = &mut client
            && let Some(status) = client.try_wait().context("the DHCP client is lost")?
        {
            bail!("the DHCP client ended: {status}");
        }
    }
    log::warn!("network: {} is gone", found.name);
    if let Some(mut client) = client {
        // Fails if it has just ended, which is just as well.
        let _ = client.kill();
        let _ = client.wait();
    }
    Ok(())
}

/// Starts the client, which asks five times in five seconds, then pauses for ten; it runs
/// [`lease`] with the answers.
fn start_client(interface: &str) -> Result<Child> {
    Command::new(BUSYBOX)
        .args(["udhcpc", "-f", "-i", interface, "-s", LEASE_PROGRAM])
        .args(["-t", "5", "-T", "1", "-A", "10"])
        .stdin(Stdio::null())
        // Repetitive; `lease` prints the outcome on standard output.
        .stderr(Stdio::null())
        .spawn()
        .with_context(|| format!("the DHCP client {BUSYBOX} cannot be started"))
}

/// An interface as the kernel knows it: its number is never used twice.
#[derive(Debug, PartialEq, Eq)]
struct Interface {
    name: String,
    number: String,
}

/// The first Ethernet hardware that is not wireless.
fn ethernet(class: &Path) -> Option<Interface> {
    let read = |name: &str, file: &str| {
        std::fs::read_to_string(class.join(name).join(file)).map(|text| text.trim().to_owned())
    };
    let mut names: Vec<String> = std::fs::read_dir(class)
        .ok()?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| {
            // ARPHRD_ETHER; bridges and the like have that type too, but no device.
            read(name, "type").is_ok_and(|kind| kind == "1")
                && class.join(name).join("device").exists()
                && !class.join(name).join("phy80211").exists()
        })
        .collect();
    names.sort();
    let name = names.into_iter().next()?;
    let number = read(&name, "ifindex").ok()?;
    Some(Interface { name, number })
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn the_process_understands_how_it_is_started() {
        let address = Ipv4Addr::new(192, 168, 1, 7);
        for gateway in [None, Some(Ipv4Addr::new(192, 168, 1, 1))] {
            let fixed = Network::Static { address, prefix_bits: 24, gateway };
            assert_eq!(network(&arguments(fixed)), Some(fixed));
        }
        assert_eq!(network(&arguments(Network::Dhcp)), Some(Network::Dhcp));
        for wrong in [&[][..], &["192.168.1.7"], &["box", "24"], &["1.2.3.4", "24", "1.1.1.1", "x"]]
        {
            let wrong: Vec<String> = wrong.iter().map(ToString::to_string).collect();
            assert_eq!(network(&wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn the_first_wired_hardware_is_chosen() {
        let class = tempfile::tempdir().unwrap();
        assert_eq!(ethernet(class.path()), None);
        let add = |name: &str, kind: &str, below: &[&str]| {
            let folder = class.path().join(name);
            std::fs::create_dir(&folder).unwrap();
            std::fs::write(folder.join("type"), kind).unwrap();
            std::fs::write(folder.join("ifindex"), "3\n").unwrap();
            for name in below {
                std::fs::create_dir(folder.join(name)).unwrap();
            }
        };
        add("lo", "772\n", &[]);
        add("br0", "1\n", &[]);
        add("ath0", "1\n", &["device", "phy80211"]);
        assert_eq!(ethernet(class.path()), None);
        add("eth1", "1\n", &["device"]);
        add("eth0", "1\n", &["device"]);
        let expected = Interface { name: "eth0".into(), number: "3".into() };
        assert_eq!(ethernet(class.path()), Some(expected));
    }
}
