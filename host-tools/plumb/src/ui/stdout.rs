//! Results on standard output.

use std::io::{ErrorKind, Write as _};

use plumbline_files::BadInput;

/// Writes a result to standard output. A program that reads no further, such as `head`, is no fault.
///
/// # Errors
/// When the operating system refuses, as on a full disk.
pub fn print(text: &str) -> Result<(), BadInput> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(BadInput::io("standard output", &error))
        }
        _ => Ok(()),
    }
}
