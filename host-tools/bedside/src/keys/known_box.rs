//! A box whose key is known here, and its file.
//!
//! ```toml
//! key = "PLUMBLINE-KEY-1:..."
//! name = "ward 3"
//! serial_number = "PL-0001"
//! made = "2026-11-24T09:30:00Z"
//! address = "192.168.1.30:4210"
//! start_count = 12
//! ```
//!
//! Everything may be left out but `key` and `made`.

use std::net::SocketAddr;

use jiff::{Timestamp, Unit};
use plumbline::seal::Key;
use plumbline_files::{BadInput, from_toml};
use serde::{Deserialize, Serialize};
use zeroize::{Zeroize as _, Zeroizing};

const REMEDY: &str = "the file of a key has key and made, and may have name, serial_number, \
                      address and start_count; remove it, and import the key again";

/// A box whose key is known here.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownBox {
    /// Its key.
    pub key: Key,
    /// The box's name, where it is known.
    pub name: Option<String>,
    /// Its serial number, where it is known; no other box here has it.
    pub serial_number: Option<String>,
    /// When the key was made here, or imported; whole seconds.
    pub made: Timestamp,
    /// Where the box was last heard.
    pub address: Option<SocketAddr>,
    /// The highest number of a start that was taken on a line without a way back.
    pub start_count: Option<u32>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    key: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    serial_number: Option<String>,
    made: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    address: Option<SocketAddr>,
    #[serde(skip_serializing_if = "Option::is_none")]
    start_count: Option<u32>,
}

impl Drop for Fields {
    fn drop(&mut self) {
        self.key.zeroize();
    }
}

impl KnownBox {
    /// A box that gets this key now, and was not heard yet.
    #[must_use]
    pub fn new(key: Key, name: Option<String>, serial_number: Option<String>) -> Self {
        let now = Timestamp::now();
        // Whole seconds are always within the range of times.
        let made = now.round(Unit::Second).unwrap_or(now);
        Self { key, name, serial_number, made, address: None, start_count: None }
    }

    /// What people call it: as much of name and serial number as is known.
    #[must_use]
    pub fn title(&self) -> String {
        match (&self.name, &self.serial_number) {
            (Some(name), Some(number)) => format!("{name:?} ({number})"),
            (Some(name), None) => format!("{name:?}"),
            (None, Some(number)) => number.clone(),
            (None, None) => format!("without a name (key {})", self.key.id()),
        }
    }

    /// The box of a file's text; `place` names the file in errors, which never repeat the key.
    pub(super) fn parse(text: &str, place: &str) -> Result<Self, BadInput> {
        let mut fields: Fields = from_toml(text, place, REMEDY)?;
        let key = Key::from_text(&fields.key).map_err(|error| {
            BadInput::new(place, "key", error, "remove the file, and import the key again")
        })?;
        let made = fields.made.parse().map_err(|_| {
            let found = format!("{:?} is no time", fields.made);
            BadInput::new(place, "made", found, "give one such as 2026-11-24T09:30:00Z")
        })?;
        Ok(Self {
            key,
            name: fields.name.take(),
            serial_number: fields.serial_number.take(),
            made,
            address: fields.address,
            start_count: fields.start_count,
        })
    }

    /// The file's text.
    pub(super) fn to_toml(&self) -> Zeroizing<String> {
        let fields = Fields {
            key: self.key.text().as_str().to_owned(),
            name: self.name.clone(),
            serial_number: self.serial_number.clone(),
            made: self.made.to_string(),
            address: self.address,
            start_count: self.start_count,
        };
        Zeroizing::new(toml::to_string(&fields).expect("texts and numbers are TOML"))
    }
}
