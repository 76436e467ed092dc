//! Updates of a box: a slot, and a head that its maker has signed.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use plumbline_update::header::{Header, KeyId, Text, VerifyingKey, slot_hash};
use plumbline_update::release::{CURRENT, OLDEST_ALLOWED};
use plumbline_update::sign::{self, SigningKey};

use super::{Parts, output, slot};
use crate::command::BadInput;
use crate::commit::Commit;

/// The board for which updates are made.
const BOARD: &str = "rpi4";

/// The public keys in PEM files, with whose private ones updates of a box are signed.
pub fn public_keys(files: &[PathBuf]) -> Result<Vec<VerifyingKey>> {
    let read = |path: &PathBuf| {
        let pem = text(path, "--update-key")?;
        sign::verifying_key(&pem).map_err(|error| {
            anyhow!(BadInput(format!(
                "--update-key: {}: no public key of Ed25519 in PEM ({error}); of a private one it is \
                 what `openssl pkey -in FILE -pubout` prints",
                path.display()
            )))
        })
    };
    files.iter().map(read).collect()
}

/// The private key in a PEM file.
pub fn signing_key(path: &Path) -> Result<SigningKey> {
    let pem = text(path, "--signing-key")?;
    sign::signing_key(&pem).map_err(|error| {
        anyhow!(BadInput(format!(
            "--signing-key: {}: no private key of Ed25519 in PEM ({error}); make one with `openssl \
             genpkey -algorithm ed25519 -out FILE`, and keep it where nobody else can read it",
            path.display()
        )))
    })
}

fn text(path: &Path, option: &str) -> Result<String> {
    fs::read_to_string(path)
        .map_err(|error| anyhow!(BadInput(format!("{option}: {}: {error}", path.display()))))
}

/// Makes the update `out` of what a new card would have in its slots.
pub fn make(parts: &Parts, key: &SigningKey, out: &Path) -> Result<()> {
    let file = slot::make(parts)?;
    let system = fs::read(&file).with_context(|| file.display().to_string())?;
    let slot = sign::used(&system).context("the slot is no FAT32")?;
    let header = Header {
        board: Text::new(BOARD).context("the board's name")?,
        version: CURRENT,
        oldest_allowed: OLDEST_ALLOWED,
        commit: Text::new(&Commit::read()?.mark()).context("the commit's name")?,
        slot_bytes: u32::try_from(slot.len())?,
        slot_hash: slot_hash(slot),
        key: KeyId::of(&key.verifying_key()),
    };
    let bytes = [&sign::signed(&header, key)[..], slot].concat();
    output::file(out, |out| fs::write(out, &bytes).context("the update"))?;
    println!(
        "\n{}: version {CURRENT} for {BOARD}, {:.1} MB, signed with the key {}: send it with `plumb \
         update`",
        out.display(),
        bytes.len() as f64 * 1e-6,
        header.key
    );
    Ok(())
}
