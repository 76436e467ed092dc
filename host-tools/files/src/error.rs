//! The error for input that cannot be used.

use std::fmt;

/// Something from outside that cannot be used: where it is, what was found
/// there, and what to do next.
///
/// Shown as `FILE: FIELD: found; remedy`, in one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BadInput {
    /// The file, as the user named it, or the device, address or option.
    pub place: String,
    /// The field, line or frame within it; empty when the whole is meant.
    pub field: String,
    /// What was found there.
    pub found: String,
    /// What the user can do next.
    pub remedy: String,
    os_error: Option<std::io::ErrorKind>,
}

impl BadInput {
    /// An error about one field of one file.
    pub fn new(
        place: impl fmt::Display,
        field: impl fmt::Display,
        found: impl fmt::Display,
        remedy: impl fmt::Display,
    ) -> Self {
        Self {
            place: place.to_string(),
            field: field.to_string(),
            found: found.to_string(),
            remedy: remedy.to_string(),
            os_error: None,
        }
    }

    /// An error about a whole file.
    pub fn whole(
        place: impl fmt::Display,
        found: impl fmt::Display,
        remedy: impl fmt::Display,
    ) -> Self {
        Self::new(place, "", found, remedy)
    }

    /// The operating system refused to open, read or write a file.
    pub fn io(place: impl fmt::Display, error: &std::io::Error) -> Self {
        use std::io::ErrorKind;
        let remedy = match error.kind() {
            ErrorKind::NotFound => "check the path and the spelling",
            ErrorKind::PermissionDenied => {
                "change the file's permissions, or run as a user who may use it"
            }
            ErrorKind::IsADirectory => "name the files in the directory, not the directory",
            ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
                "a directory belongs here and a file is in its place: give another name"
            }
            ErrorKind::StorageFull => "make room on the disk",
            _ => "check the disk or the device, and try again",
        };
        // "No such file or directory (os error 2)": the number helps nobody.
        let message = error.to_string();
        let message = message.split(" (os error").next().unwrap_or_default().to_lowercase();
        Self { os_error: Some(error.kind()), ..Self::whole(place, message, remedy) }
    }

    /// True when the program that reads the output has closed it.
    #[must_use]
    pub fn is_closed_pipe(&self) -> bool {
        self.os_error == Some(std::io::ErrorKind::BrokenPipe)
    }
}

impl fmt::Display for BadInput {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}: ", self.place)?;
        if !self.field.is_empty() {
            write!(formatter, "{}: ", self.field)?;
        }
        write!(formatter, "{}; {}", self.found, self.remedy)
    }
}

impl std::error::Error for BadInput {}
