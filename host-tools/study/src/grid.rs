//! Text tables for the terminal and for reports, with the reasons for absent values below.

use std::fmt::Write as _;

use comfy_table::{CellAlignment, Table, presets};

/// A text table; the first column names the rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Grid {
    /// One cell for each column.
    pub header: Vec<String>,
    /// The rows, each with as many cells as the header.
    pub rows: Vec<Vec<String>>,
}

impl Grid {
    /// The table as text for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut table = Table::new();
        table.load_style(presets::UTF8_BORDERS_ONLY);
        table.set_header(&self.header);
        for row in &self.rows {
            table.add_row(row);
        }
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        format!("{table}\n")
    }
}

/// A table with marks for absent values, and the reasons below it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Annotated {
    /// The table.
    pub grid: Grid,
    /// The notes, each beginning with its mark.
    pub notes: Vec<String>,
}

impl Annotated {
    /// The table and its notes as text for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = self.grid.text();
        for note in &self.notes {
            // Writing to a String does not fail.
            let _ = writeln!(text, "  {note}");
        }
        text
    }
}

/// The reasons for the absent values of a table, each once.
#[derive(Debug, Default)]
pub struct Footnotes(Vec<String>);

impl Footnotes {
    /// The mark of an absent value, for its cell in the table.
    pub fn absent(&mut self, reason: &impl ToString) -> String {
        let reason = reason.to_string();
        let at = self.0.iter().position(|it| *it == reason).unwrap_or_else(|| {
            self.0.push(reason);
            self.0.len() - 1
        });
        format!("–{}", superscript(at + 1))
    }

    /// The value, or the mark that stands for it.
    pub fn stated(&mut self, cell: Result<String, &str>) -> String {
        cell.unwrap_or_else(|reason| self.absent(&reason))
    }

    /// The table with its reasons.
    #[must_use]
    pub fn below(self, grid: Grid) -> Annotated {
        let numbered = self.0.iter().enumerate();
        let notes = numbered.map(|(at, reason)| format!("–{} {reason}", superscript(at + 1)));
        Annotated { notes: notes.collect(), grid }
    }
}

/// A number in superscript digits, which look the same on a page and in a terminal.
fn superscript(number: usize) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let digits = number.to_string();
    digits.chars().filter_map(|it| DIGITS.get(it.to_digit(10)? as usize)).collect()
}

/// Up to four significant digits.
pub fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        // A small value must not be shown as zero.
        size if size < 0.00005 => format!("{value:.1e}"),
        size if size < 0.1 => format!("{value:.4}"),
        size if size < 10.0 => format!("{value:.3}"),
        size if size < 100.0 => format!("{value:.2}"),
        _ => format!("{value:.1}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_absent_for_the_same_reason_has_the_same_note() {
        let mut notes = Footnotes::default();
        let marks: Vec<String> = ["a", "b", "a"].iter().map(|it| notes.absent(it)).collect();
        assert_eq!(marks, ["–¹", "–²", "–¹"]);
        let grid = Grid { header: vec!["x".to_owned()], rows: Vec::new() };
        assert_eq!(notes.below(grid).notes, ["–¹ a", "–² b"]);
        assert_eq!(superscript(120), "¹²⁰");
    }

    #[test]
    fn what_is_small_is_not_shown_as_nothing() {
        let texts = [0.0, 3.21e-5, -4.99e-5, 5.0e-5, 0.0999, 1.2345, 12.345, 1234.5].map(digits);
        let wanted = ["0", "3.2e-5", "-5.0e-5", "0.0001", "0.0999", "1.234", "12.35", "1234.5"];
        assert_eq!(texts, wanted);
    }
}
