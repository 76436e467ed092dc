//! Tables of numbers as text, as measuring systems export them: comma-separated and the like, with
//! a line that names the columns, after a preamble of any kind.
//!
//! Cells may be in quotes, as RFC 4180 says, but must not have several lines: a quote that is never
//! closed would otherwise swallow the rest of a recording.

use std::path::Path;

use serde::Deserialize;

use super::text_of;
use crate::BadInput;

/// The columns' names are searched for in this number of lines.
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
    /// All delimiters, in the order in which they are tried.
    pub const ALL: [Self; 3] = [Self::Tab, Self::Comma, Self::Semicolon];

    /// The character as a byte.
    #[must_use]
    pub fn byte(self) -> u8 {
        match self {
            Self::Tab => b'\t',
            Self::Comma => b',',
            Self::Semicolon => b';',
        }
    }
}

/// A table whose columns have been found.
pub struct TextTable {
    place: String,
    text: String,
    /// Where the lines below the names begin in the text: byte, and number of the line from 1.
    rows_at: (usize, usize),
    delimiter: Delimiter,
    /// The names of all columns.
    names: Vec<String>,
}

impl TextTable {
    /// Reads a file that has these columns; if its name ends with .gz, it is unpacked. Without a
    /// delimiter, the one is taken with which the columns are found.
    ///
    /// # Errors
    /// When the file cannot be read, or a column is missing; then the error names those it has.
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
        let mut byte = 0;
        for (line, number) in text.split_inclusive('\n').zip(1..=HEADER_LINES_MAX) {
            byte += line.len();
            for delimiter in delimiters.iter().copied() {
                let names = names(line, delimiter);
                let is_there = |column: &&&str| names.iter().any(|name| name == **column);
                let there = columns.iter().filter(is_there).count();
                if there == columns.len() {
                    return Ok(Self { place, text, rows_at: (byte, number + 1), delimiter, names });
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

    /// A column that was asked for when the table was opened.
    pub fn column(&self, name: &str) -> Column<'_> {
        let at = self.names.iter().position(|it| it == name);
        let at = at.unwrap_or_else(|| unreachable!("{name} was found when the text was read"));
        Column { at, name: &self.names[at], place: &self.place }
    }

    /// Checks that a row has as many cells as there are columns.
    ///
    /// # Errors
    /// When it has more or fewer.
    pub fn check_length(&self, row: &Row) -> Result<(), BadInput> {
        let (cells, columns) = (row.cells.len(), self.names.len());
        if cells == columns {
            return Ok(());
        }
        Err(BadInput::new(
            &self.place,
            format!("line {}", row.line),
            format!("{cells} cells, and the header has {columns}"),
            "correct that line, or give the --delimiter",
        ))
    }

    /// The rows below the names, without empty lines.
    pub fn rows(&self) -> Rows<'_> {
        let (byte, line) = self.rows_at;
        let text = &self.text[byte..];
        Rows { reader: reader(text, self.delimiter), text, byte: 0, line, place: &self.place }
    }
}

/// A reader of lines that may have any number of cells.
fn reader(text: &str, delimiter: Delimiter) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(delimiter.byte())
        .from_reader(text.as_bytes())
}

/// The names of columns in a line.
fn names(line: &str, delimiter: Delimiter) -> Vec<String> {
    let record = reader(line.trim_start_matches('\u{feff}'), delimiter).records().next();
    let record = record.and_then(Result::ok).unwrap_or_default();
    record.iter().map(|name| trimmed(name).to_owned()).collect()
}

/// A cell without the spaces around it, and without the quotes that remain where a space is before
/// the first one.
fn trimmed(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|it| it.strip_suffix('"')).unwrap_or(cell)
}

/// The rows of a table, one by one.
pub struct Rows<'a> {
    reader: csv::Reader<&'a [u8]>,
    text: &'a str,
    /// A place in the text, and the number of its line: the reader's own count is late by the line
    /// ends that it has still to skip.
    byte: usize,
    line: usize,
    place: &'a str,
}

impl Rows<'_> {
    /// The number of the line in which this byte is.
    fn advance(&mut self, byte: usize) -> usize {
        self.line += self.text[self.byte..byte].matches('\n').count();
        self.byte = byte;
        self.line
    }
}

impl Iterator for Rows<'_> {
    type Item = Result<Row, BadInput>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut cells = csv::StringRecord::new();
        loop {
            let before = self.reader.position().byte() as usize;
            let is_there = self.reader.read_record(&mut cells);
            let source = &self.text[before..self.reader.position().byte() as usize];
            let row = source.trim_start_matches(['\r', '\n']);
            let line = self.advance(before + source.len() - row.len());
            let wrong = |found: String, remedy| {
                BadInput::new(self.place, format!("line {line}"), found, remedy)
            };
            match is_there {
                Ok(false) => return None,
                Ok(true) if row.trim().is_empty() => {}
                Ok(true) if row.trim_end().contains('\n') => {
                    return Some(Err(wrong(
                        "a quote is not closed in its line".to_owned(),
                        "close or remove it",
                    )));
                }
                Ok(true) => return Some(Ok(Row { line, cells })),
                Err(error) => {
                    return Some(Err(wrong(error.to_string(), "correct or remove that line")));
                }
            }
        }
    }
}

/// One row.
pub struct Row {
    /// The number of its line in the file, from 1.
    pub line: usize,
    cells: csv::StringRecord,
}

/// One column.
#[derive(Clone, Copy)]
pub struct Column<'a> {
    at: usize,
    name: &'a str,
    place: &'a str,
}

impl Column<'_> {
    /// As it stands in the file.
    #[must_use]
    pub fn name(&self) -> &str {
        self.name
    }

    /// The text of a row's cell; empty where the line is too short.
    pub fn text<'r>(&self, row: &'r Row) -> &'r str {
        trimmed(row.cells.get(self.at).unwrap_or_default())
    }

    /// The number in a row's cell; `None` where the cell is empty, or not finite (NaN).
    ///
    /// # Errors
    /// When it is not a number; the error names the line.
    pub fn number(&self, row: &Row) -> Result<Option<f64>, BadInput> {
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
            self.wrong(row, format!("{cell:?} is not a number"), remedy)
        })
    }

    /// An error about a row's cell.
    pub fn wrong(&self, row: &Row, found: impl Into<String>, remedy: &str) -> BadInput {
        BadInput::new(
            self.place,
            format!("{} (line {})", self.name, row.line),
            found.into(),
            remedy,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(text: &str, columns: &[&str]) -> Result<TextTable, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plate.csv");
        std::fs::write(&path, text).unwrap();
        TextTable::open(&path, columns, None, "name them").map_err(|error| error.to_string())
    }

    /// The lines and the numbers of a column.
    fn numbers(text: &str, column: &str) -> Result<Vec<(usize, Option<f64>)>, String> {
        let table = open(text, &[column])?;
        let column = table.column(column);
        let rows = table.rows().map(|row| {
            let row = row?;
            Ok((row.line, column.number(&row)?))
        });
        rows.collect::<Result<_, BadInput>>().map_err(|error| error.to_string())
    }

    #[test]
    fn quotes_protect_commas_and_quotes() {
        let text = "\"Force, \"\"left\"\" [N]\",note,t\r\n\
                    \"1.5\",\"fell, nearly\",0\r\n2.5,\"says \"\"no\"\"\",1\r\n";
        let table = open(text, &["Force, \"left\" [N]", "t"]).unwrap();
        let (force, note, time) =
            (table.column("Force, \"left\" [N]"), table.column("note"), table.column("t"));
        let rows: Vec<Row> = table.rows().map(Result::unwrap).collect();
        let cells = |row: &Row| {
            (force.number(row).unwrap(), note.text(row).to_owned(), time.number(row).unwrap())
        };
        assert_eq!(cells(&rows[0]), (Some(1.5), "fell, nearly".to_owned(), Some(0.0)));
        assert_eq!(cells(&rows[1]), (Some(2.5), "says \"no\"".to_owned(), Some(1.0)));
    }

    #[test]
    fn the_delimiter_is_that_which_finds_the_columns() {
        for text in
            ["a;b, c\td;t\n1;2;3\n", "x\ty\n\nb, c\tt\n2\t3\n", "\u{feff} \"t\" , u\n 3 ,1\n"]
        {
            let found = numbers(text, "t").unwrap();
            assert_eq!(found.iter().map(|it| it.1).collect::<Vec<_>>(), [Some(3.0)], "{text}");
        }
    }

    #[test]
    fn lines_are_counted_whatever_ends_them() {
        for end in ["\n", "\r\n"] {
            let lines =
                ["a \"preamble", "", "t,u", "1,2", "", "  ", "2,3", "", "short", "nan,\"6\"", "x,"];
            let text = lines.join(end);
            let good = text.strip_suffix("x,").unwrap();
            let short = good.replace("short", "3");
            let found = numbers(&short, "t").unwrap();
            assert_eq!(found, [(4, Some(1.0)), (7, Some(2.0)), (9, Some(3.0)), (10, None)]);
            assert!(
                numbers(&text.replace("short", "3"), "t")
                    .unwrap_err()
                    .contains("t (line 11): \"x\"")
            );
            assert_eq!(numbers(&short, "u").unwrap()[2..], [(9, None), (10, Some(6.0))]);
        }
    }

    #[test]
    fn a_quote_that_is_not_closed_is_refused() {
        let error = numbers("t,u\n1,2\n\n2,\"3\n3,4\n4,5\n", "t").unwrap_err();
        assert!(error.contains("plate.csv: line 4: a quote is not closed"), "{error}");
        // Within a cell a quote is a character, as for inches.
        assert_eq!(numbers("t,u\n1,5\"\n2,3\"\n", "t").unwrap().len(), 2);
    }
}
