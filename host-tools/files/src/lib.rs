//! The files that `plumb` reads and writes.
//!
//! Every reader refuses what it does not understand, with a [`BadInput`] that names the file, the
//! field, what was found and what to do. None guesses, and none allocates more than its limits
//! allow, whatever a header claims.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;

pub mod camera;
pub mod columns;
pub mod counting;
mod error;
pub mod frames;
pub mod lens_id;
mod output;
pub mod poses;
pub mod private;
pub mod room;
pub mod scene;
pub mod targets;
pub mod text;
mod toml_text;

pub use error::BadInput;
pub use output::{
    Late, Made, create, directory_of, make_directory, refuse_overwriting, replace, replace_with,
    sync_directory, write_all, write_text,
};
pub use toml_text::from_toml;

/// Descriptions are far smaller; a device or a video that is given by mistake is larger.
const TEXT_BYTES_MAX: u64 = 1 << 20;

/// The largest recording of another system: an hour at 1 kHz of a plate with some 30 columns.
const TRIAL_BYTES_MAX: u64 = 1 << 30;

/// Reads a whole recording of another system, of at most 1 GiB. If its name ends with .gz, it is
/// unpacked.
///
/// # Errors
/// When it cannot be read, or is larger.
pub fn bytes_of(path: &Path) -> Result<Vec<u8>, BadInput> {
    let place = path.display();
    let file = File::open(path).map_err(|error| BadInput::io(&place, &error))?;
    let mut bytes = Vec::new();
    let packed = path.extension().is_some_and(|it| it.eq_ignore_ascii_case("gz"));
    let source: Box<dyn Read> =
        if packed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
    source
        .take(TRIAL_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| BadInput::io(&place, &error))?;
    if bytes.len() as u64 > TRIAL_BYTES_MAX {
        return Err(BadInput::whole(place, "more than 1 GiB", "no trial is so long"));
    }
    Ok(bytes)
}

/// As [`bytes_of`], for text. Names may be in any encoding; numbers are ASCII in all of them.
///
/// # Errors
/// As [`bytes_of`].
pub fn text_of(path: &Path) -> Result<String, BadInput> {
    Ok(String::from_utf8_lossy(&bytes_of(path)?).into_owned())
}

/// Reads a whole text file of at most 1 MiB.
///
/// # Errors
/// When it cannot be read, is longer, or is not text.
pub fn read_text(path: &Path) -> Result<String, BadInput> {
    let place = path.display();
    let file = File::open(path).map_err(|error| BadInput::io(&place, &error))?;
    let mut bytes = Vec::new();
    file.take(TEXT_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| BadInput::io(&place, &error))?;
    if bytes.len() as u64 > TEXT_BYTES_MAX {
        return Err(BadInput::whole(
            place,
            "more than 1 MiB",
            "a small text file is expected here: check that the right file is given",
        ));
    }
    String::from_utf8(bytes).map_err(|_| {
        BadInput::whole(
            place,
            "not a text file (its bytes are not UTF-8)",
            "a small text file is expected here: check that the right file is given",
        )
    })
}
