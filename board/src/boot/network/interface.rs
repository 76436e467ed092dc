//! Sets a network interface's address and route, with the kernel's old `ioctl` requests.
//!
//! There are five of them, and they will not change. Their modern replacement, netlink,
//! would need a crate with an asynchronous runtime for the same calls.

// The requests take pointers to C structures, which no safe interface offers.
#![allow(unsafe_code)]

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result};

/// A box's address and its route to other networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Address {
    /// The box's own address.
    pub address: Ipv4Addr,
    /// The number of leading bits that all addresses of its network share, 32 at most.
    pub prefix_bits: u8,
    /// The router to other networks.
    pub gateway: Option<Ipv4Addr>,
}

impl Address {
    /// The bits of the network, as a mask.
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

/// Brings an interface up.
///
/// # Errors
/// When there is no such interface.
pub fn bring_up(name: &str) -> Result<()> {
    let request = |content| request(name, content);
    let content = libc::__c_anonymous_ifr_ifru { ifru_flags: 0 };
    let fault = || format!("the network interface {name} cannot be brought up");
    let mut request = request(content).with_context(fault)?;
    call(libc::SIOCGIFFLAGS, &mut request).with_context(fault)?;
    // SAFETY: SIOCGIFFLAGS has just written this member of the union.
    let flags = unsafe { request.ifr_ifru.ifru_flags };
    request.ifr_ifru.ifru_flags = flags | libc::IFF_UP as libc::c_short;
    call(libc::SIOCSIFFLAGS, &mut request).with_context(fault)
}

/// Gives an interface this address and no other, brings it up, and adds a default route to
/// the gateway. Does nothing where this is already the case.
///
/// # Errors
/// When the kernel refuses a request.
pub fn configure(name: &str, to: &Address) -> Result<()> {
    let fault = || format!("the network interface {name} does not take {to}");
    set_address(libc::SIOCSIFADDR, name, to.address).with_context(fault)?;
    set_address(libc::SIOCSIFNETMASK, name, to.netmask()).with_context(fault)?;
    bring_up(name)?;
    if let Some(gateway) = to.gateway {
        add_default_route(gateway).with_context(|| format!("{name}: no route by {gateway}"))?;
    }
    Ok(())
}

/// Removes an interface's address, and with it the routes that use it.
///
/// # Errors
/// When there is no such interface.
pub fn clear(name: &str) -> Result<()> {
    set_address(libc::SIOCSIFADDR, name, Ipv4Addr::UNSPECIFIED)
        .with_context(|| format!("the network interface {name} keeps its address"))
}

fn set_address(kind: libc::Ioctl, name: &str, address: Ipv4Addr) -> io::Result<()> {
    let content = libc::__c_anonymous_ifr_ifru { ifru_addr: socket_address(address) };
    call(kind, &mut request(name, content)?)
}

/// The kernel's `struct rtentry`, which the libc crate defines for other C libraries only.
#[repr(C)]
struct Route {
    pad1: libc::c_ulong,
    destination: libc::sockaddr,
    gateway: libc::sockaddr,
    netmask: libc::sockaddr,
    flags: libc::c_ushort,
    pad2: libc::c_short,
    pad3: libc::c_ulong,
    pad4: *mut libc::c_void,
    metric: libc::c_short,
    device: *mut libc::c_char,
    mtu: libc::c_ulong,
    window: libc::c_ulong,
    initial_round_trip: libc::c_ushort,
}

fn add_default_route(gateway: Ipv4Addr) -> io::Result<()> {
    let any = socket_address(Ipv4Addr::UNSPECIFIED);
    let mut route = Route {
        pad1: 0,
        destination: any,
        gateway: socket_address(gateway),
        netmask: any,
        flags: libc::RTF_UP | libc::RTF_GATEWAY,
        pad2: 0,
        pad3: 0,
        pad4: std::ptr::null_mut(),
        metric: 0,
        device: std::ptr::null_mut(),
        mtu: 0,
        window: 0,
        initial_round_trip: 0,
    };
    match call(SIOCADDRT, &mut route) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        result => result,
    }
}

/// The same on every architecture; not in the libc crate.
const SIOCADDRT: libc::Ioctl = 0x890B;

fn request(name: &str, content: libc::__c_anonymous_ifr_ifru) -> io::Result<libc::ifreq> {
    let mut request = libc::ifreq { ifr_name: [0; libc::IFNAMSIZ], ifr_ifru: content };
    // The kernel's names end with a zero byte.
    if name.len() >= request.ifr_name.len() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    for (to, from) in request.ifr_name.iter_mut().zip(name.bytes()) {
        *to = from as libc::c_char;
    }
    Ok(request)
}

/// A `struct sockaddr_in` in its general form: port, address, padding.
fn socket_address(address: Ipv4Addr) -> libc::sockaddr {
    let mut data = [0; 14];
    for (to, from) in data[2..].iter_mut().zip(address.octets()) {
        *to = from as libc::c_char;
    }
    libc::sockaddr { sa_family: libc::AF_INET as libc::sa_family_t, sa_data: data }
}

/// `content` must be the structure that requests of this kind take.
fn call<T>(kind: libc::Ioctl, content: &mut T) -> io::Result<()> {
    // Any socket of the address family will do.
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    // SAFETY: the callers above pair SIOC?IF* with an ifreq and SIOCADDRT with a
    // Route; the kernel reads and writes that structure during the call only.
    let result = unsafe { libc::ioctl(socket.as_raw_fd(), kind, std::ptr::from_mut(content)) };
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_have_the_bits_of_the_network() {
        let mask = |prefix_bits| {
            Address { address: Ipv4Addr::LOCALHOST, prefix_bits, gateway: None }.netmask()
        };
        assert_eq!(mask(0), Ipv4Addr::new(0, 0, 0, 0));
        assert_eq!(mask(1), Ipv4Addr::new(128, 0, 0, 0));
        assert_eq!(mask(23), Ipv4Addr::new(255, 255, 254, 0));
        assert_eq!(mask(24), Ipv4Addr::new(255, 255, 255, 0));
        assert_eq!(mask(32), Ipv4Addr::new(255, 255, 255, 255));
    }

    #[test]
    fn the_structures_are_as_long_as_the_kernels() {
        // struct rtentry of linux/route.h: 120 bytes with 64-bit words, 64 with 32-bit ones.
        let expected = if cfg!(target_pointer_width = "64") { 120 } else { 64 };
        assert_eq!(size_of::<Route>(), expected);
        assert_eq!(size_of::<libc::sockaddr>(), size_of::<libc::sockaddr_in>());
    }

    #[test]
    fn an_interface_that_is_not_there_is_named() {
        let error = bring_up("plumbline0").unwrap_err();
        assert!(error.to_string().contains("plumbline0"), "{error:#}");
        assert!(bring_up("a-name-that-is-far-too-long").is_err());
    }
}
