//! Reads and writes the kernel's small files without allocating.

use std::fmt::{Arguments, Write as _};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Result, Write as _};

use heapless::String;

/// The standard library allocates for longer paths.
const PATH_BYTES_MAX: usize = 256;

/// Longer than any value that is read here.
const VALUE_BYTES_MAX: usize = 64;

/// The folder that `/sys` and `/dev` are in: `""`, except in tests.
#[derive(Debug, Clone, Copy)]
pub struct Root<'a>(&'a str);

impl<'a> Root<'a> {
    pub fn new(folder: &'a str) -> Self {
        Self(folder)
    }

    /// The first line of a file.
    pub fn read(self, path: Arguments<'_>) -> Option<String<VALUE_BYTES_MAX>> {
        let mut bytes = [0; VALUE_BYTES_MAX];
        let count = self.open(path, OpenOptions::new().read(true)).ok()?.read(&mut bytes).ok()?;
        let text = str::from_utf8(bytes.get(..count)?).ok()?;
        text.lines().next()?.trim().try_into().ok()
    }

    /// Writes a value to an existing file.
    pub fn write(self, path: Arguments<'_>, value: &str) -> Result<()> {
        self.open_to_write(path)?.write_all(value.as_bytes())
    }

    /// Opens an existing file.
    pub fn open_to_write(self, path: Arguments<'_>) -> Result<File> {
        self.open(path, OpenOptions::new().write(true))
    }

    fn open(self, path: Arguments<'_>, options: &OpenOptions) -> Result<File> {
        let mut whole = String::<PATH_BYTES_MAX>::new();
        write!(whole, "{}{path}", self.0).map_err(|_| ErrorKind::InvalidFilename)?;
        options.open(whole.as_str())
    }
}
