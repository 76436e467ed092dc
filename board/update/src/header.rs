//! The head of an update's file, `.plu`: what it is for, and who vouches for that.
//!
//! | bytes | what |
//! |---:|---|
//! | 8 | [`MAGIC`] |
//! | 16 | the board, such as `rpi4`, in ASCII, then zeros |
//! | 6 | the version: three numbers of 16 bits |
//! | 6 | the oldest version that a box with this one goes to |
//! | 24 | the commit that it was made from, in ASCII, then zeros |
//! | 4 | the length of what follows the head |
//! | 32 | the SHA-256 of what follows the head |
//! | 8 | which key it is signed with |
//! | 64 | the Ed25519 signature (RFC 8032) of all of the above |
//!
//! All numbers are little endian. What follows the head is a slot, sector by sector. The magic is
//! under the signature too, so that the key's signature of something else is none of an update.

use core::fmt;

pub use ed25519_dalek::VerifyingKey;
use ed25519_dalek::{PUBLIC_KEY_LENGTH, SIGNATURE_LENGTH, Signature};
use sha2::{Digest, Sha256};

use crate::card::{SECTOR_BYTES, SLOT_BYTES};
use crate::release::Version;

/// The first bytes of every update's file; the digit is the format's.
pub const MAGIC: [u8; 8] = *b"PLUPDAT1";

/// The length of the head.
pub const HEADER_BYTES: usize = SIGNED_BYTES + SIGNATURE_LENGTH;

/// The length of a [`Text`] of a board.
pub const BOARD_BYTES: usize = 16;

/// The length of a [`Text`] of a commit.
pub const COMMIT_BYTES: usize = 24;

/// The length of a SHA-256.
pub const HASH_BYTES: usize = 32;

const SIGNED_BYTES: usize =
    8 + BOARD_BYTES + 2 * Version::BYTES + COMMIT_BYTES + 4 + HASH_BYTES + KeyId::BYTES;

/// A short text of letters, digits and `.+-_`.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Text<const BYTES: usize>([u8; BYTES]);

impl<const BYTES: usize> Text<BYTES> {
    /// `None` for a text that is empty, too long, or has other characters.
    #[must_use]
    pub fn new(text: &str) -> Option<Self> {
        let mut bytes = [0; BYTES];
        bytes.get_mut(..text.len())?.copy_from_slice(text.as_bytes());
        Self::of_bytes(bytes)
    }

    fn of_bytes(bytes: [u8; BYTES]) -> Option<Self> {
        let length = bytes.iter().position(|byte| *byte == 0).unwrap_or(BYTES);
        let (text, rest) = bytes.split_at(length);
        let is_allowed = |byte: &u8| byte.is_ascii_alphanumeric() || b".+-_".contains(byte);
        let is_one = !text.is_empty() && text.iter().all(is_allowed);
        (is_one && rest.iter().all(|byte| *byte == 0)).then_some(Self(bytes))
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let length = self.0.iter().position(|byte| *byte == 0).unwrap_or(BYTES);
        core::str::from_utf8(&self.0[..length]).unwrap_or_default()
    }
}

impl<const BYTES: usize> fmt::Debug for Text<BYTES> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), formatter)
    }
}

/// Which key: the first bytes of the SHA-256 of the public one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeyId([u8; Self::BYTES]);

impl KeyId {
    const BYTES: usize = 8;

    /// That of a public key.
    #[must_use]
    pub fn of(key: &VerifyingKey) -> Self {
        let hash = Sha256::digest(key.as_bytes());
        let mut id = [0; Self::BYTES];
        id.copy_from_slice(&hash[..Self::BYTES]);
        Self(id)
    }
}

impl fmt::Display for KeyId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(formatter, "{byte:02x}"))
    }
}

/// What an update is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// The board that it is for.
    pub board: Text<BOARD_BYTES>,
    /// Its version.
    pub version: Version,
    /// The oldest version that a box with it goes to.
    pub oldest_allowed: Version,
    /// The commit that it was made from.
    pub commit: Text<COMMIT_BYTES>,
    /// The length of the slot that follows: whole sectors.
    pub slot_bytes: u32,
    /// The SHA-256 of the slot that follows.
    pub slot_hash: [u8; HASH_BYTES],
    /// Which key it is signed with.
    pub key: KeyId,
}

impl Header {
    /// The bytes that are signed.
    #[cfg(feature = "sign")]
    pub(crate) fn signed(&self) -> [u8; SIGNED_BYTES] {
        let mut bytes = [0; SIGNED_BYTES];
        let mut rest = &mut bytes[..];
        for field in [
            &MAGIC[..],
            &self.board.0,
            &self.version.to_bytes(),
            &self.oldest_allowed.to_bytes(),
            &self.commit.0,
            &self.slot_bytes.to_le_bytes(),
            &self.slot_hash,
            &self.key.0,
        ] {
            let (place, after) = rest.split_at_mut(field.len());
            place.copy_from_slice(field);
            rest = after;
        }
        bytes
    }

    /// What a head says, without whether it is authentic.
    ///
    /// # Errors
    /// When it is not the head of an update.
    pub fn read(bytes: &[u8; HEADER_BYTES]) -> Result<Self, Fault> {
        let mut rest = &bytes[..];
        if take(&mut rest) != MAGIC {
            return Err(Fault::NoUpdate);
        }
        let header = Self {
            board: Text::of_bytes(take(&mut rest)).ok_or(Fault::Field("board"))?,
            version: Version::of_bytes(take(&mut rest)),
            oldest_allowed: Version::of_bytes(take(&mut rest)),
            commit: Text::of_bytes(take(&mut rest)).ok_or(Fault::Field("commit"))?,
            slot_bytes: u32::from_le_bytes(take(&mut rest)),
            slot_hash: take(&mut rest),
            key: KeyId(take(&mut rest)),
        };
        let slot_bytes = u64::from(header.slot_bytes);
        let is_whole = slot_bytes.is_multiple_of(SECTOR_BYTES as u64);
        if slot_bytes == 0 || slot_bytes > SLOT_BYTES || !is_whole {
            return Err(Fault::Field("length"));
        }
        if header.oldest_allowed > header.version {
            return Err(Fault::Field("oldest allowed version"));
        }
        Ok(header)
    }

    /// What a head says, once it is certain that the owner of one of the keys has said it.
    ///
    /// # Errors
    /// When it is not the head of an update, or not signed with one of these keys.
    pub fn authentic(bytes: &[u8; HEADER_BYTES], keys: &[VerifyingKey]) -> Result<Self, Fault> {
        let header = Self::read(bytes)?;
        let key = keys.iter().find(|key| KeyId::of(key) == header.key);
        let key = key.ok_or(Fault::UnknownKey(header.key))?;
        let (signed, mut signature) = bytes.split_at(SIGNED_BYTES);
        let signature = Signature::from_bytes(&take(&mut signature));
        // Strict: a signature has one form only, and a key that fits any signature is none.
        key.verify_strict(signed, &signature).map_err(|_| Fault::Signature)?;
        Ok(header)
    }

    /// Whether a box of this board, whose program allows versions from `oldest_allowed` on, may go
    /// to it.
    ///
    /// # Errors
    /// Why not.
    pub fn suits(&self, board: &str, oldest_allowed: Version) -> Result<(), Fault> {
        if self.board.as_str() != board {
            return Err(Fault::Board(self.board));
        }
        if self.version < oldest_allowed {
            return Err(Fault::TooOld { version: self.version, oldest_allowed });
        }
        Ok(())
    }
}

/// The next bytes of a head, whose length its caller has made sure of.
fn take<const BYTES: usize>(rest: &mut &[u8]) -> [u8; BYTES] {
    let mut field = [0; BYTES];
    let (bytes, after) = rest.split_at(BYTES);
    field.copy_from_slice(bytes);
    *rest = after;
    field
}

/// The SHA-256 of a slot.
#[must_use]
pub fn slot_hash(slot: &[u8]) -> [u8; HASH_BYTES] {
    Sha256::digest(slot).into()
}

/// The public keys in a file of them, one after the other; `None` for anything else.
pub fn keys(bytes: &[u8]) -> impl Iterator<Item = Option<VerifyingKey>> + '_ {
    bytes.chunks(PUBLIC_KEY_LENGTH).map(|key| {
        let key = VerifyingKey::from_bytes(key.try_into().ok()?).ok()?;
        (!key.is_weak()).then_some(key)
    })
}

/// Why a box does not take an update.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// It is none.
    NoUpdate,
    /// A field has a value that it cannot have.
    Field(&'static str),
    /// It is for another board.
    Board(Text<BOARD_BYTES>),
    /// It is older than the box goes.
    TooOld {
        /// Its version.
        version: Version,
        /// The oldest that the box goes to.
        oldest_allowed: Version,
    },
    /// It is signed with a key that the box does not know.
    UnknownKey(KeyId),
    /// It is not signed by the key that it names.
    Signature,
}

impl fmt::Display for Fault {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoUpdate => formatter.write_str(
                "not an update of a box: `cargo xtask image update` makes one, and it ends in .plu",
            ),
            Self::Field(field) => write!(formatter, "its {field} cannot be right"),
            Self::Board(board) => write!(formatter, "it is for the board {}", board.as_str()),
            Self::TooOld { version, oldest_allowed } => write!(
                formatter,
                "its version is {version}, and the box goes back to {oldest_allowed} at most"
            ),
            Self::UnknownKey(key) => {
                write!(formatter, "it is signed with the key {key}, which the box does not know")
            }
            Self::Signature => formatter.write_str("its signature is wrong"),
        }
    }
}

impl core::error::Error for Fault {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sign::{SigningKey, signed};

    fn key(byte: u8) -> SigningKey {
        SigningKey::from_bytes(&[byte; 32])
    }

    fn header(key: &SigningKey) -> Header {
        Header {
            board: Text::new("rpi4").unwrap(),
            version: "0.2.0".parse().unwrap(),
            oldest_allowed: "0.1.0".parse().unwrap(),
            commit: Text::new("0123456789ab").unwrap(),
            slot_bytes: 512,
            slot_hash: slot_hash(&[1; 512]),
            key: KeyId::of(&key.verifying_key()),
        }
    }

    #[test]
    fn a_head_says_what_was_signed() {
        let made = header(&key(1));
        let bytes = signed(&made, &key(1));
        let keys = [key(2).verifying_key(), key(1).verifying_key()];
        assert_eq!(Header::authentic(&bytes, &keys), Ok(made));
        assert_eq!(Header::read(&bytes), Ok(made));
    }

    /// Boxes in the field read what was made for them years before or after, at these places.
    #[test]
    fn a_heads_fields_stay_where_they_are() {
        let made = header(&key(1));
        let bytes = signed(&made, &key(1));
        assert_eq!(bytes.len(), 168);
        assert_eq!(bytes[..8], *b"PLUPDAT1");
        assert_eq!(bytes[8..24], *b"rpi4\0\0\0\0\0\0\0\0\0\0\0\0");
        assert_eq!(bytes[24..36], [0, 0, 2, 0, 0, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(bytes[36..60], *b"0123456789ab\0\0\0\0\0\0\0\0\0\0\0\0");
        assert_eq!(bytes[60..64], [0, 2, 0, 0]);
        assert_eq!(bytes[64..96], slot_hash(&[1; 512]));
        let key_hash = Sha256::digest(key(1).verifying_key().as_bytes());
        assert_eq!(bytes[96..104], key_hash[..8]);
        let signature = Signature::from_slice(&bytes[104..]).unwrap();
        key(1).verifying_key().verify_strict(&bytes[..104], &signature).unwrap();
    }

    /// FIPS 180-4, the example of one block.
    #[test]
    fn the_hash_of_a_slot_is_its_sha_256() {
        let hash = slot_hash(b"abc");
        let digits: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(digits, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }

    #[test]
    fn what_people_read_of_a_head_is_what_it_has() {
        let made = header(&key(1));
        assert_eq!(format!("{:?} {:?}", made.board, made.commit), "\"rpi4\" \"0123456789ab\"");
        let key_hash = Sha256::digest(key(1).verifying_key().as_bytes());
        let digits: String = key_hash[..8].iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(made.key.to_string(), digits);
        let unknown = Fault::UnknownKey(made.key).to_string();
        assert!(unknown.contains(&digits), "{unknown}");
    }

    /// The largest slot, and one from which no box goes back at all.
    #[test]
    fn fields_at_their_limits_are_sound() {
        let (sound, signer) = (header(&key(1)), key(1));
        for made in [
            Header { slot_bytes: SLOT_BYTES as u32, ..sound },
            Header { oldest_allowed: sound.version, ..sound },
        ] {
            assert_eq!(Header::read(&signed(&made, &signer)), Ok(made));
        }
    }

    #[test]
    fn no_bit_of_a_head_can_be_changed() {
        let (made, keys) = (header(&key(1)), [key(1).verifying_key()]);
        let bytes = signed(&made, &key(1));
        for bit in 0..8 * HEADER_BYTES {
            let mut forged = bytes;
            forged[bit / 8] ^= 1 << (bit % 8);
            assert!(Header::authentic(&forged, &keys).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn another_key_is_named_and_one_that_only_pretends_is_found_out() {
        let bytes = signed(&header(&key(1)), &key(1));
        let unknown = Fault::UnknownKey(KeyId::of(&key(1).verifying_key()));
        assert_eq!(Header::authentic(&bytes, &[key(2).verifying_key()]), Err(unknown));
        assert_eq!(Header::authentic(&bytes, &[]), Err(unknown));
        let forged = signed(&header(&key(1)), &key(2));
        let keys = [key(1).verifying_key(), key(2).verifying_key()];
        assert_eq!(Header::authentic(&forged, &keys), Err(Fault::Signature));
    }

    #[test]
    fn the_board_and_the_oldest_version_decide() {
        let made = header(&key(1));
        let oldest = |text: &str| text.parse::<Version>().unwrap();
        assert_eq!(made.suits("rpi4", oldest("0.2.0")), Ok(()));
        assert_eq!(made.suits("virt", oldest("0.1.0")), Err(Fault::Board(made.board)));
        let version = made.version;
        let too_old = Fault::TooOld { version, oldest_allowed: oldest("0.2.1") };
        assert_eq!(made.suits("rpi4", oldest("0.2.1")), Err(too_old));
        assert_eq!(
            too_old.to_string(),
            "its version is 0.2.0, and the box goes back to 0.2.1 at most"
        );
    }

    #[test]
    fn fields_that_cannot_be_are_named_though_they_are_signed() {
        let (sound, signer) = (header(&key(1)), key(1));
        let keys = [signer.verifying_key()];
        for (wrong, field) in [
            (Header { slot_bytes: 0, ..sound }, "length"),
            (Header { slot_bytes: SLOT_BYTES as u32 + 512, ..sound }, "length"),
            (Header { slot_bytes: 513, ..sound }, "length"),
            (
                Header { oldest_allowed: "0.2.1".parse().unwrap(), ..sound },
                "oldest allowed version",
            ),
            (Header { board: Text(*b"rpi4\0rpi4\0\0\0\0\0\0\0"), ..sound }, "board"),
            (Header { board: Text([0; 16]), ..sound }, "board"),
            (Header { commit: Text([0x1b; 24]), ..sound }, "commit"),
        ] {
            let bytes = signed(&wrong, &signer);
            assert_eq!(Header::authentic(&bytes, &keys), Err(Fault::Field(field)));
        }
        assert_eq!(Header::read(&[0; HEADER_BYTES]), Err(Fault::NoUpdate));
    }

    #[test]
    fn a_file_of_keys_holds_whole_and_sound_ones() {
        let file = [key(1).verifying_key().to_bytes(), key(2).verifying_key().to_bytes()].concat();
        let read: Vec<_> = keys(&file).collect();
        assert_eq!(read, [Some(key(1).verifying_key()), Some(key(2).verifying_key())]);
        assert_eq!(keys(&file[..40]).collect::<Vec<_>>()[1], None);
        // The neutral point fits signatures that nobody has made.
        let mut neutral = [0; PUBLIC_KEY_LENGTH];
        neutral[0] = 1;
        assert_eq!(keys(&neutral).collect::<Vec<_>>(), [None]);
        assert_eq!(keys(&[]).count(), 0);
    }
}
