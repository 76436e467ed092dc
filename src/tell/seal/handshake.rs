//! The handshake: Noise_NNpsk0_25519_ChaChaPoly_SHA256 (Noise Protocol Framework, revision 34).
//!
//! Both messages are authenticated by the box's key, the first one before the box computes anything
//! costly. Each side adds a fresh key pair, so that whoever learns the box's key later cannot open
//! what was recorded before.

use clatter::bytearray::ByteArray;
use clatter::crypto::cipher::ChaChaPoly;
use clatter::crypto::dh::X25519;
use clatter::crypto::hash::Sha256;
use clatter::handshakepattern::noise_nn_psk0;
use clatter::traits::{Dh, Handshaker};
use clatter::{KeyPair, NqHandshakeCore};
use rand_core::{CryptoRng, Error, RngCore};

use super::aead::{CipherKey, KEY_BYTES, TAG_BYTES};

/// Bytes that a message of the handshake adds to its payload: a public key, and a tag.
pub(super) const NOISE_BYTES: usize = KEY_BYTES + TAG_BYTES;

/// The keys of both directions.
#[derive(Debug, Clone)]
pub(super) struct Keys {
    pub(super) to_box: CipherKey,
    pub(super) to_host: CipherKey,
}

/// One side of a handshake.
#[derive(Clone)]
pub(super) struct Handshake(NqHandshakeCore<X25519, ChaChaPoly, Sha256, NoGenerator>);

impl Handshake {
    /// The side that begins, with a secret key for this handshake alone.
    pub(super) fn of_host(
        key: &[u8; KEY_BYTES],
        prologue: &[u8],
        ephemeral: &[u8; KEY_BYTES],
    ) -> Option<Self> {
        Self::new(key, prologue, Some(ephemeral), true)
    }

    /// The side that answers.
    pub(super) fn of_box(
        key: &[u8; KEY_BYTES],
        prologue: &[u8],
        ephemeral: &[u8; KEY_BYTES],
    ) -> Option<Self> {
        Self::new(key, prologue, Some(ephemeral), false)
    }

    /// Whether the host's message is authentic; it must be read again to go on.
    pub(super) fn check(
        key: &[u8; KEY_BYTES],
        prologue: &[u8],
        message: &[u8],
        payload: &mut [u8],
    ) -> Option<()> {
        Self::new(key, prologue, None, false)?.read(message, payload).map(|_| ())
    }

    fn new(
        key: &[u8; KEY_BYTES],
        prologue: &[u8],
        ephemeral: Option<&[u8; KEY_BYTES]>,
        is_host: bool,
    ) -> Option<Self> {
        let pair = ephemeral.map(|bytes| {
            let secret = <X25519 as Dh>::PrivateKey::from_slice(bytes);
            KeyPair { public: X25519::pubkey(&secret), secret }
        });
        let pattern = noise_nn_psk0();
        let handshake = NqHandshakeCore::new(pattern, prologue, is_host, None, pair, None, None);
        let mut handshake = handshake.ok()?;
        handshake.push_psk(key);
        Some(Self(handshake))
    }

    /// Writes this side's message; returns its length.
    pub(super) fn write(&mut self, payload: &[u8], message: &mut [u8]) -> Option<usize> {
        self.0.write_message(payload, message).ok()
    }

    /// Reads the other side's message; returns the length of its payload, or `None` if it is not
    /// authentic.
    pub(super) fn read(&mut self, message: &[u8], payload: &mut [u8]) -> Option<usize> {
        self.0.read_message(message, payload).ok()
    }

    /// The keys, once both messages are through.
    pub(super) fn keys(self) -> Option<Keys> {
        let states = self.0.finalize().ok()?.take();
        let key = |state: clatter::cipherstate::CipherState<ChaChaPoly>| {
            let (key, _) = state.take();
            CipherKey::new(*key)
        };
        let to_box = key(states.initiator_to_responder);
        Some(Keys { to_box, to_host: key(states.responder_to_initiator) })
    }
}

/// The library would draw a secret key by itself; it is always given one.
#[derive(Default, Clone)]
struct NoGenerator;

impl CryptoRng for NoGenerator {}
impl RngCore for NoGenerator {
    fn next_u32(&mut self) -> u32 {
        unreachable!("the key pair is given")
    }

    fn next_u64(&mut self) -> u64 {
        unreachable!("the key pair is given")
    }

    fn fill_bytes(&mut self, _: &mut [u8]) {
        unreachable!("the key pair is given")
    }

    fn try_fill_bytes(&mut self, _: &mut [u8]) -> Result<(), Error> {
        unreachable!("the key pair is given")
    }
}
