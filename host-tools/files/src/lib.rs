//! The files that `plumb` reads and writes.
//!
//! Every reader refuses what it does not understand, with a [`BadInput`] that names the file, the
//! field, what was found and what to do. None guesses, and none allocates more than its limits
//! allow, whatever a header claims.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use flate2::read::MultiGzDecoder;
use serde::de::DeserializeOwned;

pub mod camera;
pub mod columns;
pub mod counting;
mod error;
pub mod frames;
mod output;
pub mod poses;
pub mod scene;
pub mod targets;
pub mod text;

pub use error::BadInput;
pub use output::{
    Late, Made, create, directory_of, make_directory, refuse_overwriting, replace, replace_with,
    sync_directory, write_all, write_text,
};

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

/// Parses a TOML text; errors name the field and its line.
///
/// `remedy` says what a correct file looks like.
///
/// # Errors
/// When it is not TOML, or not of this type.
pub fn from_toml<T: DeserializeOwned>(
    text: &str,
    place: &str,
    remedy: &str,
) -> Result<T, BadInput> {
    toml::from_str(text).map_err(|error| {
        let message = error.message().trim();
        let line_of = |offset: usize| text[..offset].matches('\n').count();
        let line = error.span().map(|span| line_of(span.start.min(text.len())));
        // serde names the field in its own words; otherwise it is the key on the line.
        let key_on_line = || {
            let (key, _) = text.lines().nth(line?)?.split_once('=')?;
            Some(key.trim().to_owned())
        };
        let in_backticks =
            || Some(message.split('`').nth(1).filter(|name| !name.is_empty())?.to_owned());
        let named = ["missing field", "unknown field", "duplicate key", "duplicate field"];
        let field = if named.iter().any(|start| message.starts_with(start)) {
            in_backticks().or_else(key_on_line)
        } else {
            key_on_line()
        };
        let mut place_in_file = field.unwrap_or_default();
        // A missing field has no line: its table may be the whole file.
        if let Some(line) = line.filter(|_| !message.starts_with("missing field")) {
            let separator = if place_in_file.is_empty() { "" } else { " " };
            place_in_file = format!("{place_in_file}{separator}(line {})", line + 1);
        }
        let found = message.lines().next().unwrap_or("it is not TOML");
        BadInput::new(place, place_in_file, found, remedy)
    })
}
