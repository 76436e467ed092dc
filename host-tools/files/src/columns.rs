//! Text with columns of numbers, as measuring systems export it: under a line that names the
//! columns, behind whatever preamble.

use std::path::Path;

use serde::Deserialize;

use super::text_of;
use crate::BadInput;

/// The line with the columns' names is among the first so many.
const HEADER_LINES_MAX: usize = 200;

/// What separates columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Delimiter {
    /// A tab.
    Tab,
    /// A comma.
    Comma,
    /// A semicolon.
    Semicolon,
}

impl Delimiter {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Tab, Self::Comma, Self::Semicolon];

    /// The letter itself.
    #[must_use]
    pub fn letter(self) -> char {
        match self {
            Self::Tab => '\t',
            Self::Comma => ',',
            Self::Semicolon => ';',
        }
    }
}

/// A text whose columns have been found.
pub struct TextTable {
    place: String,
    text: String,
    /// Its index.
    header_line: usize,
    delimiter: char,
    /// All columns' names.
    names: Vec<String>,
}

impl TextTable {
    /// Reads a file (one whose name ends with .gz is unpacked) that has these columns; without a
    /// delimiter, the one with which they are found.
    ///
    /// # Errors
    /// When it cannot be read, or a column is missing: with those that it has.
    pub fn open(
        path: &Path,
        columns: &[&str],
        delimiter: Option<Delimiter>,
        remedy: &str,
    ) -> Result<Self, BadInput> {
        let place = path.display().to_string();
        let text = text_of(path)?;
        let delimiters = match delimiter {
            Some(delimiter) => vec![delimiter],
            None => Delimiter::ALL.to_vec(),
        };
        let mut best: (usize, Vec<String>) = (0, Vec::new());
        for (header_line, line) in text.lines().take(HEADER_LINES_MAX).enumerate() {
            for delimiter in delimiters.iter().map(|it| it.letter()) {
                let names: Vec<String> = line
                    .trim_start_matches('\u{feff}')
                    .split(delimiter)
                    .map(|name| name.trim().trim_matches('"').to_owned())
                    .collect();
                let is_there = |column: &&&str| names.iter().any(|name| name == **column);
                let there = columns.iter().filter(is_there).count();
                if there == columns.len() {
                    return Ok(Self { place, text, header_line, delimiter, names });
                }
                if there > best.0 || (best.1.len() < 2 && names.len() >= 2) {
                    best = (there, names);
                }
            }
        }
        let is_missing = |column: &&&str| !best.1.iter().any(|name| name == **column);
        let missing: Vec<&str> = columns.iter().filter(is_missing).copied().collect();
        let found = if best.1.is_empty() {
            "it has no columns".to_owned()
        } else {
            format!("it has the columns {}", best.1.join(", "))
        };
        Err(BadInput::new(place, missing.join(", "), format!("no such column; {found}"), remedy))
    }

    /// A column that was asked for.
    pub fn column(&self, name: &str) -> Column<'_> {
        let at = self.names.iter().position(|it| it == name);
        let at = at.unwrap_or_else(|| unreachable!("{name} was found when the text was read"));
        Column { at, name: &self.names[at], place: &self.place }
    }

    /// The rows under the names; empty lines are none.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        let lines = self.text.lines().enumerate().skip(self.header_line + 1);
        let lines = lines.filter(|(_, text)| !text.trim().is_empty());
        lines.map(|(index, text)| Row {
            line: index + 1,
            cells: text.split(self.delimiter).map(str::trim).collect(),
        })
    }
}

/// One line.
pub struct Row<'a> {
    /// Its number in the file, from 1.
    pub line: usize,
    cells: Vec<&'a str>,
}

/// One column.
#[derive(Clone, Copy)]
pub struct Column<'a> {
    at: usize,
    name: &'a str,
    place: &'a str,
}

impl Column<'_> {
    /// What stands there; nothing where the line is too short.
    pub fn text<'r>(&self, row: &Row<'r>) -> &'r str {
        row.cells.get(self.at).copied().unwrap_or_default().trim_matches('"')
    }

    /// The number that stands there; `None` where nothing does, or NaN.
    ///
    /// # Errors
    /// When it is no number: with the line.
    pub fn number(&self, row: &Row<'_>) -> Result<Option<f64>, BadInput> {
        let cell = self.text(row);
        if cell.is_empty() {
            return Ok(None);
        }
        cell.parse::<f64>().map(|it| Some(it).filter(|it| it.is_finite())).map_err(|_| {
            let remedy = if cell.replacen(',', ".", 1).parse::<f64>().is_ok() {
                "write the table with decimal points: it has decimal commas"
            } else {
                "correct or remove that line; a missing value is an empty cell or NaN"
            };
            self.wrong(row, format!("{cell:?} is no number"), remedy)
        })
    }

    /// What is wrong in this line.
    pub fn wrong(&self, row: &Row<'_>, found: impl Into<String>, remedy: &str) -> BadInput {
        BadInput::new(
            self.place,
            format!("{} (line {})", self.name, row.line),
            found.into(),
            remedy,
        )
    }
}
