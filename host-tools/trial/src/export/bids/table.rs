//! A table of a data set that others have written to as well: rows are added, and nothing else is
//! changed.

use std::path::Path;

use plumbline_files::text::cell;
use plumbline_files::{BadInput, read_text};

/// What the standard writes where there is no value.
pub const MISSING: &str = "n/a";

/// Rows of tab-separated text, with names above them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
    /// The column by which rows are told apart.
    key: usize,
}

impl Table {
    /// A table with these columns and no row; the first tells rows apart.
    #[must_use]
    pub fn new(names: &[&str]) -> Self {
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        Self { names, rows: Vec::new(), key: 0 }
    }

    /// Reads a table. One that does not exist has the column `key` and no row.
    ///
    /// # Errors
    /// When it cannot be read, or has no such column, or a row has too many or too few cells.
    pub fn read(path: &Path, key: &str) -> Result<Self, BadInput> {
        if !path.exists() {
            return Ok(Self::new(&[key]));
        }
        Self::parse(&read_text(path)?, key).map_err(|(line, found)| {
            let remedy = "correct the table, and export again";
            BadInput::new(path.display(), format!("line {line}"), found, remedy)
        })
    }

    fn parse(text: &str, key: &str) -> Result<Self, (usize, String)> {
        let text = text.trim_start_matches('\u{feff}');
        let mut lines = text.lines().map(cells).zip(1..);
        let (names, _) = lines.next().ok_or((1, "the table is empty".to_owned()))?;
        let key = names
            .iter()
            .position(|name| name == key)
            .ok_or_else(|| (1, format!("there is no column {key}")))?;
        let mut rows = Vec::new();
        for (row, line) in lines {
            if row.iter().all(String::is_empty) {
                continue;
            }
            if row.len() != names.len() {
                let found = format!("{} cells, and the first line has {}", row.len(), names.len());
                return Err((line, found));
            }
            rows.push(row);
        }
        Ok(Self { names, rows, key })
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// The row with this key.
    #[must_use]
    pub fn row(&self, key: &str) -> Option<usize> {
        self.rows.iter().position(|row| row[self.key] == key)
    }

    /// A cell, if there is such a column.
    ///
    /// # Panics
    /// When there is no such row.
    #[must_use]
    pub fn get(&self, row: usize, name: &str) -> Option<&str> {
        let column = self.names.iter().position(|it| it == name)?;
        Some(&self.rows[row][column])
    }

    /// Sets cells of the row with this key, which is added if it is not there. Other cells of the row
    /// stay as they are or, in a new one, have no value; columns that are not in the table are added.
    pub fn add(&mut self, values: &[(&str, &str)]) {
        for (name, _) in values {
            if !self.names.iter().any(|it| it == name) {
                self.names.push((*name).to_owned());
                self.rows.iter_mut().for_each(|row| row.push(MISSING.to_owned()));
            }
        }
        let key = values.iter().find(|(name, _)| *name == self.names[self.key]);
        let at = key.and_then(|(_, key)| self.row(key)).unwrap_or_else(|| {
            self.rows.push(vec![MISSING.to_owned(); self.names.len()]);
            self.rows.len() - 1
        });
        for (cell, name) in self.rows[at].iter_mut().zip(&self.names) {
            if let Some((_, value)) = values.iter().find(|(it, _)| it == name) {
                (*value).clone_into(cell);
            }
        }
    }

    /// The table's text.
    #[must_use]
    pub fn text(&self) -> String {
        let lines = std::iter::once(&self.names).chain(&self.rows);
        lines.map(|cells| cells.join("\t") + "\n").collect()
    }
}

fn cells(line: &str) -> Vec<String> {
    line.split('\t').map(str::to_owned).collect()
}

/// A label as a cell. It has no control character; a double quote would begin a quoted cell.
pub fn word(label: &str) -> String {
    match label.trim() {
        "" => MISSING.to_owned(),
        label => cell(&label.replace('"', "'")).into_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_have_written_stays() {
        let text = "participant_id\tage\tsex\nsub-02\t34\tF\n\nsub-01\tn/a\tM\n";
        let mut table = Table::parse(text, "participant_id").unwrap();
        assert_eq!(table.row("sub-01"), Some(1));
        table.add(&[("participant_id", "sub-03")]);
        let wanted = "participant_id\tage\tsex\nsub-02\t34\tF\nsub-01\tn/a\tM\nsub-03\tn/a\tn/a\n";
        assert_eq!(table.text(), wanted);
        // A column of ours, and a row that is there already.
        table.add(&[("participant_id", "sub-01"), ("acq_time", "noon")]);
        assert_eq!(table.get(0, "acq_time"), Some("n/a"));
        assert_eq!(table.get(1, "acq_time"), Some("noon"));
        assert_eq!(table.get(1, "sex"), Some("M"));
        assert_eq!(table.row("sub-03"), Some(2));
    }

    #[test]
    fn a_table_that_cannot_be_kept_whole_is_refused() {
        let refused = |text: &str| Table::parse(text, "filename").unwrap_err();
        assert_eq!(refused(""), (1, "the table is empty".to_owned()));
        assert_eq!(refused("a\tb\n"), (1, "there is no column filename".to_owned()));
        let found = "1 cells, and the first line has 2".to_owned();
        assert_eq!(refused("filename\tacq_time\na\tb\nc\n"), (3, found));
    }

    #[test]
    fn a_label_begins_no_formula_and_no_quotation() {
        for (label, wanted) in
            [("=1+1", "'=1+1"), ("\"turns\"", "'turns'"), ("stands", "stands"), (" ", "n/a")]
        {
            assert_eq!(word(label), wanted);
        }
    }
}
