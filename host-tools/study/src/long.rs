//! Long tables, which have one measurement per line with its subject and the levels under which it
//! was made, and their statistics.

use std::collections::HashMap;
use std::path::Path;

use plumbline_analysis::statistics::inference::{Cell, Inference};
use plumbline_analysis::statistics::within::{DesignError, Incomplete, Observation, WithinDesign};
use plumbline_files::BadInput;
use plumbline_files::columns::{Column, Delimiter, TextTable};
use plumbline_files::counting::counted;
use serde::Serialize;

use crate::grid::{Annotated, Footnotes, Grid, digits};
use crate::inference::{COMPARED, Tested, comparisons, effects};

/// The names of the columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Columns {
    /// The measurement.
    pub response: String,
    /// The within-subject factors, one or two.
    pub within: Vec<String>,
    /// The subject.
    pub subject: String,
}

/// The statistics of a long table, as written to JSON.
#[derive(Debug, Clone, Serialize)]
pub struct LongFigures {
    /// The program that computed them.
    pub program: &'static str,
    /// The table's file.
    pub source: String,
    /// The column of the measurement.
    pub response: String,
    /// The statistics of the response.
    #[serde(flatten)]
    pub inference: Inference,
    /// Subjects without a value in some cell.
    pub left_out: Vec<Incomplete>,
}

/// One line of the table.
struct Row {
    line: usize,
    subject: String,
    levels: Vec<String>,
    value: f64,
}

/// Reads a long table and analyses it.
///
/// # Errors
/// As [`read`].
pub fn analyze(
    path: &Path,
    columns: &Columns,
    delimiter: Delimiter,
    drop_incomplete: bool,
) -> Result<LongFigures, BadInput> {
    let (design, left_out) = read(path, columns, delimiter, drop_incomplete)?;
    Ok(LongFigures {
        program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
        source: path.display().to_string(),
        response: columns.response.clone(),
        inference: Inference::of(&design),
        left_out,
    })
}

impl LongFigures {
    /// The statistics as text for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { response, inference, .. } = self;
        let pairs = inference.comparisons.iter().map(|it| (response.clone(), it));
        format!(
            "{response}: {}\n{}{}{}",
            counted(inference.subjects.len(), "subject"),
            self.cells().text(),
            effects([Tested { name: response.clone(), inference, adjusted: &[] }]).text(),
            comparisons(pairs).text() + COMPARED + "\n",
        )
    }

    /// A table of all combinations of levels.
    fn cells(&self) -> Annotated {
        let ranks = self.inference.ranks.as_result();
        let relative_effect = |cell: &Cell| {
            ranks.map(|ranks| {
                let mut effects = ranks.relative_effects.iter();
                let of_cell =
                    effects.find(|it| it.levels.iter().map(|it| &it.level).eq(&cell.levels));
                of_cell
                    .map_or_else(String::new, |it| format!("{:.3}", it.relative_treatment_effect))
            })
        };
        let mut notes = Footnotes::default();
        let mut rows = Vec::new();
        for cell in &self.inference.cells {
            let [raw, normalised] = [&cell.raw, &cell.normalised].map(|it| it.as_result());
            rows.push(vec![
                cell.levels.join(", "),
                notes.stated(raw.map(|it| digits(it.mean))),
                notes.stated(raw.map(|it| digits(it.sd))),
                notes.stated(normalised.map(|it| digits(it.sem))),
                notes.stated(relative_effect(cell)),
            ]);
        }
        let header = ["cell", "mean", "SD", "SEM (Cousineau-Morey)", "relative effect"];
        notes.below(Grid { header: header.map(str::to_owned).into(), rows })
    }
}

/// Reads a long table into a design. Subjects without a value in some cell are refused or, with
/// `drop_incomplete`, left out and listed.
///
/// # Errors
/// When the file cannot be read, a column is missing, a value is not a number, a cell has no value
/// or two, or a factor has one level only. The error names the line, or the subject and the cell.
pub fn read(
    path: &Path,
    columns: &Columns,
    delimiter: Delimiter,
    drop_incomplete: bool,
) -> Result<(WithinDesign, Vec<Incomplete>), BadInput> {
    let place = path.display().to_string();
    let rows = rows(path, columns, delimiter)?;
    let mut lines: HashMap<(&str, &[String]), usize> = HashMap::new();
    for row in &rows {
        if let Some(first) = lines.insert((&row.subject, &row.levels), row.line) {
            return Err(BadInput::new(
                &place,
                format!("line {}", row.line),
                format!(
                    "subject {} has a second value in {}, the first is in line {first}",
                    row.subject,
                    row.levels.join(", ")
                ),
                "average repeated measurements first, or name the column that tells them apart \
                 with --within",
            ));
        }
    }
    let observations: Vec<Observation<'_>> = rows
        .iter()
        .map(|row| Observation {
            subject: &row.subject,
            levels: row.levels.iter().map(String::as_str).collect(),
            value: row.value,
        })
        .collect();
    let factors: Vec<&str> = columns.within.iter().map(String::as_str).collect();
    let (design, dropped) = WithinDesign::of_complete_subjects(&factors, &observations)
        .map_err(|error| unusable(&place, &error))?;
    if let Some(first) = dropped.first()
        && !drop_incomplete
    {
        return Err(unusable(&place, &DesignError::Missing(first.clone())));
    }
    // Neither it nor the other factor would be tested, and the tables would be empty.
    if let Some(factor) = design.factors().iter().find(|it| it.levels.len() < 2) {
        return Err(BadInput::new(
            &place,
            &factor.name,
            format!("only one level, {:?}: there is nothing to compare", factor.levels[0]),
            "leave it out of --within, or name the column that tells the measurements apart",
        ));
    }
    Ok((design, dropped))
}

fn unusable(place: &str, error: &DesignError) -> BadInput {
    let remedy = match error {
        DesignError::Missing(_) => {
            "measure it, or leave such subjects out with --drop-incomplete: these methods need \
             complete data"
        }
        _ => "correct the table",
    };
    BadInput::whole(place, error, remedy)
}

fn rows(path: &Path, columns: &Columns, delimiter: Delimiter) -> Result<Vec<Row>, BadInput> {
    let remedy = "name the columns as they stand in the file, and what separates them with \
                  --delimiter";
    let named = [&columns.response, &columns.subject].into_iter().chain(&columns.within);
    let named: Vec<&str> = named.map(String::as_str).collect();
    let table = TextTable::open(path, &named, Some(delimiter), remedy)?;
    let (response, subject) = (table.column(&columns.response), table.column(&columns.subject));
    let within: Vec<Column<'_>> = columns.within.iter().map(|name| table.column(name)).collect();
    let mut rows = Vec::new();
    for row in table.rows() {
        let row = row?;
        table.check_length(&row)?;
        let value = response.text(&row);
        let value =
            value.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
                let remedy = "correct that line, or remove it where nothing was measured";
                response.wrong(&row, format!("{value:?} is not a number"), remedy)
            })?;
        let levels: Vec<String> = within.iter().map(|it| it.text(&row).to_owned()).collect();
        let subject = subject.text(&row).to_owned();
        if subject.is_empty() || levels.iter().any(String::is_empty) {
            return Err(BadInput::new(
                path.display(),
                format!("line {}", row.line),
                "a subject or a level is empty",
                "complete that line, or remove it",
            ));
        }
        rows.push(Row { line: row.line, subject, levels, value });
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_table(text: &str, drop: bool) -> Result<(WithinDesign, Vec<Incomplete>), String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.csv");
        std::fs::write(&path, text).unwrap();
        let columns = Columns {
            response: "resp".into(),
            within: vec!["day".into(), "time".into()],
            subject: "who".into(),
        };
        read(&path, &columns, Delimiter::Comma, drop).map_err(|error| error.to_string())
    }

    const WHOLE: &str = "who,day,time,resp\na,1,x,5\na,1,y,6\na,2,x,7\na,2,y,8.5\n\
                         b,1,x,4\nb,1,y,3\nb,2,x,2\nb,2,y,1\n";

    #[test]
    fn a_long_table_becomes_subjects_by_cells() {
        let (design, dropped) = read_table(WHOLE, false).unwrap();
        assert_eq!(design.subjects(), ["a", "b"]);
        assert_eq!(design.cell(3), [8.5, 1.0]);
        assert_eq!(dropped.len(), 0);
        let shorter = WHOLE.replace("b,2,y,1\n", "");
        let (design, dropped) = read_table(&shorter, true).unwrap();
        assert_eq!((design.subjects().len(), &*dropped[0].subject), (1, "b"));
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let cases = [
            (WHOLE.replace("resp", "value"), "resp: no such column; it has the columns who, day"),
            (WHOLE.replace("8.5", "many"), "resp (line 5): \"many\" is not a number"),
            (WHOLE.replace("8.5", "NaN"), "resp (line 5): \"NaN\" is not a number"),
            (WHOLE.replace("b,2,y,1\n", ""), "subject b has no value in 2, y"),
            (WHOLE.replace("a,2,y,8.5", "a,2,x,8.5"), "line 5: subject a has a second value"),
            (WHOLE.replace("a,2,y,8.5", ",2,y,8.5"), "line 5: a subject or a level is empty"),
            (WHOLE.replace("a,2,y,8.5", "a,2,y"), "3 cells, and the header has 4"),
            ("who,day,time,resp\n".to_owned(), "there are no measurements"),
            (
                "who,day,time,resp\na,1,x,5\na,1,y,6\nb,1,x,4\nb,1,y,3\n".to_owned(),
                "day: only one level, \"1\": there is nothing to compare; leave it out of --within",
            ),
            (
                WHOLE.replace("8.5", "many").replace('\n', "\r\n"),
                "resp (line 5): \"many\" is not a number",
            ),
        ];
        for (text, part) in cases {
            let error = read_table(&text, false).unwrap_err();
            assert!(error.contains("long.csv") && error.contains(part), "{error}");
        }
    }
}
