//! Cookies: a host that sends one back has shown that it receives at the address that it sends from.
//!
//! The box remembers nothing for that: a cookie is the beginning of a MAC of the address and the
//! period of time, under a secret of this start.

use core::net::IpAddr;

use super::Peer;
use super::aead::{CipherKey, KEY_BYTES, is_mac, mac};
use super::wire::COOKIE_BYTES;

/// A cookie is valid for one to two such periods.
pub(super) const COOKIE_PERIOD_NS: u64 = 10_000_000_000;

const COOKIE: &str = "plumbline cookie";

/// The cookies of a box.
#[derive(Debug)]
pub(super) struct Cookies {
    secret: CipherKey,
}

impl Cookies {
    /// Those of a start for which this secret has been drawn.
    pub(super) fn new(secret: &[u8; KEY_BYTES]) -> Self {
        Self { secret: CipherKey::derived(secret, "plumbline cookies", &[]) }
    }

    /// The cookie for a host at this address.
    pub(super) fn cookie(&self, from: Peer, now_ns: u64) -> Option<[u8; COOKIE_BYTES]> {
        let values = Values::new(from, now_ns, 0)?;
        let code = mac(self.secret.bytes(), COOKIE, &values.parts());
        code.first_chunk().copied()
    }

    /// Whether a cookie was made for this address, in this period or in the one before.
    pub(super) fn is_valid(&self, cookie: &[u8; COOKIE_BYTES], from: Peer, now_ns: u64) -> bool {
        [0, 1].into_iter().any(|ago| {
            Values::new(from, now_ns, ago)
                .is_some_and(|it| is_mac(cookie, self.secret.bytes(), COOKIE, &it.parts()))
        })
    }
}

/// What a cookie stands for: an address, in one period of time.
struct Values {
    address: [u8; 19],
    period: [u8; 8],
}

impl Values {
    /// The values of an address that many periods ago; `None` before the first of them.
    fn new(from: Peer, now_ns: u64, ago: u64) -> Option<Self> {
        let period = (now_ns / COOKIE_PERIOD_NS).checked_sub(ago)?.to_le_bytes();
        let mut address = [0; 19];
        if let Peer::Udp(peer) = from {
            let ip = match peer.ip() {
                IpAddr::V4(ip) => ip.to_ipv6_mapped(),
                IpAddr::V6(ip) => ip,
            };
            address[0] = 1;
            address[1..17].copy_from_slice(&ip.octets());
            address[17..].copy_from_slice(&peer.port().to_le_bytes());
        }
        Some(Self { address, period })
    }

    fn parts(&self) -> [&[u8]; 2] {
        [&self.address, &self.period]
    }
}
