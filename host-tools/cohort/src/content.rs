//! The content of a trial in one number, by which the same trial is known again.

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::path::Path;

use plumbline_files::BadInput;
use plumbline_trial::names;
use sha2::{Digest as _, Sha256};

/// The files that say what was measured, in the order of their names; the rest of a trial's folder is
/// made of them.
const FILES: [&str; 4] = [names::CONFIG, names::CORRECTED, names::JOURNAL, names::MANIFEST];

/// The SHA-256 of a trial's content, hexadecimal: that of what
/// `sha256sum config.plb corrected.plb packets.bin trial.toml` prints in its folder, of the files that
/// are there.
///
/// # Errors
/// When a file cannot be read.
pub fn of(folder: &Path) -> Result<String, BadInput> {
    let mut lines = String::new();
    for name in FILES {
        let path = folder.join(name);
        let failed = |error: std::io::Error| BadInput::io(path.display(), &error);
        let mut file = match File::open(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => continue,
            opened => opened.map_err(failed)?,
        };
        let mut sum = Sha256::new();
        let mut buffer = vec![0; 1 << 16];
        loop {
            match file.read(&mut buffer).map_err(failed)? {
                0 => break,
                bytes => sum.update(&buffer[..bytes]),
            }
        }
        lines += &format!("{}  {name}\n", hexadecimal(&sum.finalize()));
    }
    Ok(hexadecimal(&Sha256::digest(lines)))
}

/// The SHA-256 of texts, hexadecimal.
pub fn of_texts<'a>(texts: impl Iterator<Item = &'a str>) -> String {
    let mut sum = Sha256::new();
    texts.for_each(|text| sum.update(text));
    hexadecimal(&sum.finalize())
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_what_sha256sum_says() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("packets.bin"), "abc").unwrap();
        std::fs::write(folder.path().join("report.html"), "no part of it").unwrap();
        let line =
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  packets.bin\n";
        assert_eq!(of(folder.path()).unwrap(), of_texts([line].into_iter()));
        let before = of(folder.path()).unwrap();
        std::fs::write(folder.path().join("trial.toml"), "").unwrap();
        assert_ne!(of(folder.path()).unwrap(), before);
    }
}
