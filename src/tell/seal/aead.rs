//! One key of ChaCha20-Poly1305 (RFC 8439), used with counters in place of nonces; and how one key
//! follows from another.

use chacha20poly1305::{AeadInPlace, ChaCha20Poly1305, KeyInit, Nonce, Tag};
use hmac::{Hmac, Mac};
use sha2::Sha256;
use zeroize::Zeroizing;

/// Bytes that sealing adds behind the body.
pub(super) const TAG_BYTES: usize = 16;

/// Bytes of a key.
pub(super) const KEY_BYTES: usize = 32;

/// A key; wiped when it is dropped.
#[derive(Clone)]
pub(super) struct CipherKey(Zeroizing<[u8; KEY_BYTES]>);

impl core::fmt::Debug for CipherKey {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str("CipherKey(..)")
    }
}

impl CipherKey {
    pub(super) fn new(bytes: [u8; KEY_BYTES]) -> Self {
        Self(Zeroizing::new(bytes))
    }

    /// The key that follows from a secret, a purpose and public values: their HMAC-SHA256.
    pub(super) fn derived(secret: &[u8; KEY_BYTES], purpose: &str, values: &[&[u8]]) -> Self {
        Self::new(mac(secret, purpose, values))
    }

    pub(super) fn bytes(&self) -> &[u8; KEY_BYTES] {
        &self.0
    }

    /// Seals a packet in place: after a header, which is authenticated, comes the body, which is
    /// encrypted as well, and then the room for the tag. A counter must be used once only.
    pub(super) fn seal(&self, counter: u64, packet: &mut [u8], header_bytes: usize) {
        let (header, rest) = packet.split_at_mut(header_bytes);
        let (body, place) = rest.split_at_mut(rest.len() - TAG_BYTES);
        let sealed = self.cipher().encrypt_in_place_detached(&nonce(counter), header, body);
        // It fails for bodies of 256 GiB.
        place.copy_from_slice(&sealed.unwrap_or_default());
    }

    /// Opens what was sealed, into `body`; `None` unless it is authentic.
    pub(super) fn open<'a>(
        &self,
        counter: u64,
        header: &[u8],
        sealed: &[u8],
        body: &'a mut [u8],
    ) -> Option<&'a [u8]> {
        let (encrypted, tag) = sealed.split_last_chunk::<TAG_BYTES>()?;
        let body = body.get_mut(..encrypted.len())?;
        body.copy_from_slice(encrypted);
        let tag = Tag::from(*tag);
        let opened = self.cipher().decrypt_in_place_detached(&nonce(counter), header, body, &tag);
        opened.ok().map(|()| &*body)
    }

    fn cipher(&self) -> ChaCha20Poly1305 {
        ChaCha20Poly1305::new((&*self.0).into())
    }
}

/// The HMAC-SHA256 of a purpose, and of values of fixed length.
pub(super) fn mac(secret: &[u8; KEY_BYTES], purpose: &str, values: &[&[u8]]) -> [u8; KEY_BYTES] {
    started(secret, purpose, values).finalize().into_bytes().into()
}

/// Whether a MAC that was cut short is right, compared in constant time.
pub(super) fn is_mac(
    expected: &[u8],
    secret: &[u8; KEY_BYTES],
    purpose: &str,
    values: &[&[u8]],
) -> bool {
    started(secret, purpose, values).verify_truncated_left(expected).is_ok()
}

fn started(secret: &[u8; KEY_BYTES], purpose: &str, values: &[&[u8]]) -> Hmac<Sha256> {
    // A key of any length will do.
    let mut mac = <Hmac<Sha256> as Mac>::new_from_slice(secret)
        .unwrap_or_else(|_| unreachable!("a key of a fixed length"));
    // No purpose is the beginning of another.
    mac.update(purpose.as_bytes());
    mac.update(&[0]);
    values.iter().for_each(|value| mac.update(value));
    mac
}

/// As Noise has it: 32 zero bits, and the counter.
fn nonce(counter: u64) -> Nonce {
    let mut nonce = Nonce::default();
    nonce[4..].copy_from_slice(&counter.to_le_bytes());
    nonce
}
