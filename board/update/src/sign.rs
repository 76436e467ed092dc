//! How an update's file is made.
//!
//! Keys are files as OpenSSL has them: the private one PKCS #8 in PEM (`openssl genpkey -algorithm
//! ed25519`), the public one SubjectPublicKeyInfo in PEM (`openssl pkey -pubout`).

use ed25519_dalek::Signer as _;
pub use ed25519_dalek::pkcs8::{self, spki};
use ed25519_dalek::pkcs8::{DecodePrivateKey as _, DecodePublicKey as _};
pub use ed25519_dalek::{SigningKey, VerifyingKey};

use crate::card::SECTOR_BYTES;
use crate::header::{HEADER_BYTES, Header};

/// The private key in a PEM file's text.
///
/// # Errors
/// When it is none of Ed25519.
pub fn signing_key(pem: &str) -> Result<SigningKey, pkcs8::Error> {
    SigningKey::from_pkcs8_pem(pem)
}

/// The public key in a PEM file's text.
///
/// # Errors
/// When it is none of Ed25519.
pub fn verifying_key(pem: &str) -> Result<VerifyingKey, spki::Error> {
    VerifyingKey::from_public_key_pem(pem)
}

/// A head, signed.
#[must_use]
pub fn signed(header: &Header, key: &SigningKey) -> [u8; HEADER_BYTES] {
    let signed = header.signed();
    let signature = key.sign(&signed);
    let mut bytes = [0; HEADER_BYTES];
    bytes[..signed.len()].copy_from_slice(&signed);
    bytes[signed.len()..].copy_from_slice(&signature.to_bytes());
    bytes
}

/// The part of a FAT32 file system that must be sent: up to its last cluster that belongs to a file,
/// by its first table. What follows in a slot stays as it was, and no file has it. `None` if it is no
/// such file system.
#[must_use]
pub fn used(file_system: &[u8]) -> Option<&[u8]> {
    let number = |at: usize, bytes: usize| -> Option<usize> {
        let field = file_system.get(at..at + bytes)?;
        Some(field.iter().rev().fold(0, |number, byte| number << 8 | usize::from(*byte)))
    };
    // The fields of the boot sector as Microsoft's specification of FAT has them.
    let (sector_bytes, cluster_sectors) = (number(11, 2)?, number(13, 1)?);
    let (reserved, tables, table_sectors) = (number(14, 2)?, number(16, 1)?, number(36, 4)?);
    let is_fat32 = number(22, 2)? == 0 && number(510, 2)? == 0xaa55;
    if !is_fat32 || sector_bytes != SECTOR_BYTES || cluster_sectors == 0 {
        return None;
    }
    let table_start = reserved * SECTOR_BYTES;
    let table = file_system.get(table_start..)?.get(..table_sectors * SECTOR_BYTES)?;
    let is_taken = |entry: &[u8]| {
        // The upper four bits are reserved.
        matches!(*entry, [a, b, c, d] if a | b | c | d & 0x0f != 0)
    };
    let last = table.chunks_exact(4).rposition(is_taken)?;
    let data = reserved + tables * table_sectors;
    // The first two entries belong to no cluster.
    let sectors = data + last.checked_sub(1)? * cluster_sectors;
    file_system.get(..sectors * SECTOR_BYTES)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file system of 64 clusters of two sectors, with two tables of three sectors.
    fn file_system() -> Vec<u8> {
        let mut system = vec![0; (32 + 6 + 64 * 2) * SECTOR_BYTES];
        system[11..17].copy_from_slice(&[0, 2, 2, 32, 0, 2]);
        system[36] = 3;
        system[510..512].copy_from_slice(&[0x55, 0xaa]);
        system
    }

    #[test]
    fn the_last_cluster_of_a_file_is_the_end_even_if_it_is_empty() {
        let mut system = file_system();
        let entry = |cluster: usize| 32 * SECTOR_BYTES + 4 * cluster;
        for cluster in [0, 1, 2, 9] {
            system[entry(cluster)..][..4].copy_from_slice(&[0xff, 0xff, 0xff, 0x0f]);
        }
        // Clusters 2 to 9 are eight.
        assert_eq!(used(&system).unwrap().len(), (38 + 8 * 2) * SECTOR_BYTES);
        system[entry(60) + 3] = 0xf0;
        assert_eq!(used(&system).unwrap().len(), (38 + 8 * 2) * SECTOR_BYTES);
        system[entry(65)] = 1;
        assert_eq!(used(&system).unwrap().len(), system.len());
        // A table that says more than there is, in its first sector and in its second.
        system[entry(66)] = 1;
        assert_eq!(used(&system), None);
        system[entry(66)] = 0;
        system[entry(200)] = 1;
        assert_eq!(used(&system), None);
    }

    #[test]
    fn what_is_no_fat32_is_none() {
        assert_eq!(used(&[]), None);
        assert_eq!(used(&[0; 4096]), None);
        let mut sound = file_system();
        sound[32 * SECTOR_BYTES] = 0xff;
        sound[32 * SECTOR_BYTES + 4] = 0xff;
        assert!(used(&sound).is_some());
        // Tables of the older kinds of FAT, sectors of another size, clusters of none, no signature.
        for (at, value) in [(22, 1), (23, 1), (12, 4), (13, 0), (510, 0), (511, 0)] {
            let mut system = sound.clone();
            system[at] = value;
            assert_eq!(used(&system), None, "byte {at}");
        }
    }

    /// RFC 8410, section 10.3 and 10.1.
    #[test]
    fn keys_are_read_as_others_write_them() {
        let private = "-----BEGIN PRIVATE KEY-----\n\
            MC4CAQAwBQYDK2VwBCIEINTuctv5E1hK1bbY8fdp+K06/nwoy/HU++CXqI9EdVhC\n\
            -----END PRIVATE KEY-----\n";
        let public = "-----BEGIN PUBLIC KEY-----\n\
            MCowBQYDK2VwAyEAGb9ECWmEzf6FQbrBZ9w7lshQhqowtrbLDFw4rXAxZuE=\n\
            -----END PUBLIC KEY-----\n";
        let key = signing_key(private).unwrap();
        assert_eq!(key.verifying_key(), verifying_key(public).unwrap());
        assert!(signing_key(public).is_err() && verifying_key(private).is_err());
    }
}
