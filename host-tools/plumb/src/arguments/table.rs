//! How a table of positions is read: the options of every command that takes one.

use std::path::Path;

use clap::Args;
use plumbline_files::BadInput;
use plumbline_files::columns::Delimiter;
use plumbline_trial::positions::{Columns, Table, Unit};

/// What a table's columns are.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub struct TableColumns {
    /// The table's columns, as its own header names them: time=NAME,ap=NAME,ml=NAME,si=NAME
    #[arg(long, requires = "unit")]
    pub columns: Option<String>,

    /// The unit of the positions, where their file does not say it
    #[arg(long)]
    pub unit: Option<Unit>,

    /// What separates the table's columns [default: the one with which they are found]
    #[arg(long, requires = "columns")]
    pub delimiter: Option<Delimiter>,
}

impl TableColumns {
    /// The first option that is given.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let Self { columns, unit, delimiter } = self;
        let options = [
            ("--columns", columns.is_some()),
            ("--unit", unit.is_some()),
            ("--delimiter", delimiter.is_some()),
        ];
        options.into_iter().find_map(|(option, is_given)| is_given.then_some(option))
    }

    /// The table in a file; `None` where columns or unit are not given.
    ///
    /// # Errors
    /// When the columns are not written as they should be.
    pub fn of(&self, path: &Path) -> Result<Option<Table>, BadInput> {
        let (Some(columns), Some(unit)) = (&self.columns, self.unit) else { return Ok(None) };
        let columns = Columns::parse(columns)
            .map_err(|found| BadInput::new(path.display(), "columns", found, "see --help"))?;
        let (path, delimiter) = (path.to_owned(), self.delimiter);
        Ok(Some(Table { path, columns, unit, delimiter }))
    }
}
