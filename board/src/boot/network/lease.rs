//! The program that the DHCP client runs when something has happened to its lease.
//!
//! busybox's `udhcpc` runs a program of our choice with the event as its argument and the
//! lease in the environment: `interface`, `ip`, `subnet`, `router`. That is this program,
//! under another name.

use std::io::Write;
use std::net::Ipv4Addr;

use anyhow::{Context, Result};

use super::interface::{self, Address};

/// The name under which the client runs the program.
pub const NAME: &str = "network-lease";

/// Handles one event; `variable` reads the environment.
///
/// The outcome goes to standard output, and so through the network process to the box;
/// the client's own messages, on standard error, are not shown.
pub fn run(event: &str, variable: impl Fn(&str) -> Option<String>) {
    let line = match carry_out(event, variable) {
        Ok(None) => return,
        Ok(Some(news)) => format!("INFO: network: {news}"),
        Err(error) => format!("ERROR: network: {error:#}"),
    };
    // A closed output is no reason to fail.
    let _ = writeln!(std::io::stdout(), "{line}");
}

fn carry_out(event: &str, variable: impl Fn(&str) -> Option<String>) -> Result<Option<String>> {
    let name = variable("interface").context("the DHCP client names no interface")?;
    match event {
        "deconfig" => {
            interface::clear(&name)?;
            interface::bring_up(&name)?;
            Ok(None)
        }
        "bound" | "renew" => {
            let address = address(variable)?;
            interface::configure(&name, &address)?;
            Ok((event == "bound").then(|| format!("{name} has {address}, from a DHCP server")))
        }
        "leasefail" => Ok(Some(format!("no DHCP server answers on {name}"))),
        // A refusal, after which the client starts over by itself.
        _ => Ok(None),
    }
}

fn address(variable: impl Fn(&str) -> Option<String>) -> Result<Address> {
    let read = |name: &str, text: &str| -> Result<Ipv4Addr> {
        text.parse().with_context(|| format!("the DHCP server's {name} is {text:?}, no address"))
    };
    let required = |name: &str| -> Result<Ipv4Addr> {
        read(name, &variable(name).with_context(|| format!("the DHCP server gives no {name}"))?)
    };
    let netmask = required("subnet")?.to_bits();
    // Leading ones, then zeros only.
    let prefix_bits = netmask.leading_ones();
    anyhow::ensure!(
        netmask.checked_shl(prefix_bits).unwrap_or(0) == 0,
        "the DHCP server's subnet is {}, no mask",
        Ipv4Addr::from(netmask)
    );
    // Of several routers the first is preferred.
    let routers = variable("router").unwrap_or_default();
    let gateway = routers.split_whitespace().next().map(|first| read("router", first));
    Ok(Address {
        address: required("ip")?,
        prefix_bits: prefix_bits as u8,
        gateway: gateway.transpose()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn environment<'a>(set: &'a [(&str, &str)]) -> impl Fn(&str) -> Option<String> + 'a {
        |name| set.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
    }

    #[test]
    fn a_lease_is_read_from_the_environment() {
        let set =
            [("ip", "10.0.2.15"), ("subnet", "255.255.254.0"), ("router", "10.0.2.2 10.0.2.3")];
        let expected = Address {
            address: Ipv4Addr::new(10, 0, 2, 15),
            prefix_bits: 23,
            gateway: Some(Ipv4Addr::new(10, 0, 2, 2)),
        };
        assert_eq!(address(environment(&set)).unwrap(), expected);
        let alone = Address { gateway: None, ..expected };
        assert_eq!(address(environment(&set[..2])).unwrap(), alone);
    }

    #[test]
    fn the_fault_of_a_lease_is_named() {
        let table: [(&[(&str, &str)], &str); 5] = [
            (&[("subnet", "255.0.0.0")], "no ip"),
            (&[("ip", "10.0.2.15")], "no subnet"),
            (&[("ip", "10.0.2.15"), ("subnet", "255.0.255.0")], "255.0.255.0"),
            (&[("ip", "10.0.2"), ("subnet", "255.0.0.0")], "\"10.0.2\""),
            (&[("ip", "10.0.2.15"), ("subnet", "255.0.0.0"), ("router", "none")], "\"none\""),
        ];
        for (set, words) in table {
            let error = format!("{:#}", address(environment(set)).unwrap_err());
            assert!(error.contains(words), "{error}");
        }
        assert!(carry_out("bound", environment(&[])).is_err());
    }
}
