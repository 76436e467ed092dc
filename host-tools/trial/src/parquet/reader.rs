//! Reads tables again that [`super`] has written.

use std::fs::File;
use std::path::{Path, PathBuf};

use parquet::basic::{LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_typed_column_reader};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use plumbline_files::BadInput;

use super::Values;

const REMEDY: &str = "it is damaged, or not what `plumb` writes here: make it again";

/// A file that is open; its rows are read group by group.
pub struct Reader {
    path: PathBuf,
    file: SerializedFileReader<File>,
}

/// Rows of a file: its columns, by their names.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    place: String,
    columns: Vec<(String, Values)>,
}

impl Reader {
    /// Opens a file, and refuses one with more rows than this.
    ///
    /// # Errors
    /// When it cannot be read, is not Parquet, or has more rows.
    pub fn open(path: &Path, rows_max: u64) -> Result<Self, BadInput> {
        let file = File::open(path).map_err(|error| BadInput::io(path.display(), &error))?;
        let file = SerializedFileReader::new(file).map_err(|error| unreadable(path, &error))?;
        let rows = file.metadata().file_metadata().num_rows();
        if u64::try_from(rows).is_ok_and(|rows| rows <= rows_max) {
            return Ok(Self { path: path.to_owned(), file });
        }
        let found = format!("{rows} rows, and at most {rows_max} are expected");
        Err(BadInput::whole(path.display(), found, REMEDY))
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.file.metadata().file_metadata().num_rows().unsigned_abs()
    }

    /// The value of a key of the file's metadata.
    #[must_use]
    pub fn about(&self, key: &str) -> Option<&str> {
        let all = self.file.metadata().file_metadata().key_value_metadata()?;
        all.iter().find(|it| it.key == key)?.value.as_deref()
    }

    /// The number of groups of rows.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.file.num_row_groups()
    }

    /// The rows of a group, or some columns of them; without names, all.
    ///
    /// # Errors
    /// When they cannot be read, or there is no such column.
    ///
    /// # Panics
    /// When there is no such group.
    pub fn group(&self, at: usize, names: &[&str]) -> Result<Table, BadInput> {
        let place = self.path.display().to_string();
        let group = self.file.get_row_group(at).map_err(|error| unreadable(&self.path, &error))?;
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        let schema = group.metadata().schema_descr();
        let mut columns = Vec::new();
        for index in 0..schema.num_columns() {
            let column = schema.column(index);
            if !names.is_empty() && !names.contains(&column.name()) {
                continue;
            }
            let values = group.get_column_reader(index).and_then(|reader| {
                let is_some = column.max_def_level() > 0;
                let is_instant =
                    matches!(column.logical_type_ref(), Some(LogicalType::Timestamp(_)));
                values(reader, column.physical_type(), rows, is_some, is_instant)
            });
            let values = values.map_err(|error| unreadable(&self.path, &error))?;
            columns.push((column.name().to_owned(), values));
        }
        let table = Table { place, columns };
        match names.iter().find(|name| table.values(name).is_none()) {
            Some(name) => Err(table.lacks(name)),
            None => Ok(table),
        }
    }

    /// All rows.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn all(&self) -> Result<Table, BadInput> {
        let mut all = Table { place: self.path.display().to_string(), columns: Vec::new() };
        for at in 0..self.groups() {
            let group = self.group(at, &[])?;
            if all.columns.is_empty() {
                all = group;
                continue;
            }
            for ((_, values), (_, more)) in all.columns.iter_mut().zip(group.columns) {
                values.extend(more);
            }
        }
        Ok(all)
    }
}

impl Values {
    /// Keeps the values of some rows.
    fn retain(&mut self, is_kept: &[bool]) {
        fn retain<T>(values: &mut Vec<T>, is_kept: &[bool]) {
            let mut is_kept = is_kept.iter();
            values.retain(|_| is_kept.next() == Some(&true));
        }
        match self {
            Self::Texts(values) => retain(values, is_kept),
            Self::SomeTexts(values) => retain(values, is_kept),
            Self::Numbers(values) => retain(values, is_kept),
            Self::SomeNumbers(values) => retain(values, is_kept),
            Self::Integers(values) => retain(values, is_kept),
            Self::SomeIntegers(values) | Self::SomeInstants(values) => retain(values, is_kept),
            Self::Flags(values) => retain(values, is_kept),
        }
    }

    /// Adds the values of another column of the same kind.
    fn extend(&mut self, more: Self) {
        match (self, more) {
            (Self::Texts(all), Self::Texts(more)) => all.extend(more),
            (Self::SomeTexts(all), Self::SomeTexts(more)) => all.extend(more),
            (Self::Numbers(all), Self::Numbers(more)) => all.extend(more),
            (Self::SomeNumbers(all), Self::SomeNumbers(more)) => all.extend(more),
            (Self::Integers(all), Self::Integers(more)) => all.extend(more),
            (Self::SomeIntegers(all), Self::SomeIntegers(more))
            | (Self::SomeInstants(all), Self::SomeInstants(more)) => all.extend(more),
            (Self::Flags(all), Self::Flags(more)) => all.extend(more),
            _ => unreachable!("a file's column is of one kind"),
        }
    }
}

impl Table {
    /// Rows that are in memory; `place` is where they are from, for messages.
    #[must_use]
    pub fn new(place: String, columns: Vec<(String, Values)>) -> Self {
        Self { place, columns }
    }

    /// The columns.
    #[must_use]
    pub fn columns(&self) -> &[(String, Values)] {
        &self.columns
    }

    /// Keeps some rows, in their order: those for which `is_kept` is true, which has a value for each.
    pub fn retain(&mut self, is_kept: &[bool]) {
        self.columns.iter_mut().for_each(|(_, values)| values.retain(is_kept));
    }

    /// A column, if there is one of this name.
    #[must_use]
    pub fn values(&self, name: &str) -> Option<&Values> {
        self.columns.iter().find(|(it, _)| it == name).map(|(_, values)| values)
    }

    /// A column of texts.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn texts(&self, name: &str) -> Result<&[String], BadInput> {
        match self.values(name) {
            Some(Values::Texts(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    /// A column of texts that may be null.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn some_texts(&self, name: &str) -> Result<&[Option<String>], BadInput> {
        match self.values(name) {
            Some(Values::SomeTexts(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    /// A column of numbers.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn numbers(&self, name: &str) -> Result<&[f64], BadInput> {
        match self.values(name) {
            Some(Values::Numbers(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    /// A column of numbers that may be null.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn some_numbers(&self, name: &str) -> Result<&[Option<f64>], BadInput> {
        match self.values(name) {
            Some(Values::SomeNumbers(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    /// A column of whole numbers.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn integers(&self, name: &str) -> Result<&[i64], BadInput> {
        match self.values(name) {
            Some(Values::Integers(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    /// A column of whole numbers or of instants that may be null.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn some_integers(&self, name: &str) -> Result<&[Option<i64>], BadInput> {
        match self.values(name) {
            Some(Values::SomeIntegers(values) | Values::SomeInstants(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    /// A column of flags.
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn flags(&self, name: &str) -> Result<&[bool], BadInput> {
        match self.values(name) {
            Some(Values::Flags(values)) => Ok(values),
            _ => Err(self.lacks(name)),
        }
    }

    fn lacks(&self, name: &str) -> BadInput {
        BadInput::new(
            &self.place,
            name,
            "there is no such column, or it is of another kind",
            REMEDY,
        )
    }
}

fn unreadable(path: &Path, error: &parquet::errors::ParquetError) -> BadInput {
    BadInput::whole(path.display(), error, REMEDY)
}

/// The values of a column of one group.
fn values(
    reader: ColumnReader,
    physical: Physical,
    rows: usize,
    is_some: bool,
    is_instant: bool,
) -> Result<Values> {
    Ok(match (physical, is_some) {
        (Physical::BYTE_ARRAY, _) => {
            let texts = read::<ByteArrayType, _>(reader, rows, |it| text(&it))?;
            let texts: Option<Vec<Option<String>>> =
                texts.into_iter().map(|it| it.map_or(Some(None), |it| it.map(Some))).collect();
            let texts = texts.ok_or_else(|| general("a text is not UTF-8"))?;
            if is_some { Values::SomeTexts(texts) } else { Values::Texts(whole(texts)?) }
        }
        (Physical::DOUBLE, true) => {
            Values::SomeNumbers(read::<DoubleType, _>(reader, rows, |it| it)?)
        }
        (Physical::DOUBLE, false) => {
            Values::Numbers(whole(read::<DoubleType, _>(reader, rows, |it| it)?)?)
        }
        (Physical::INT64, true) => {
            let values = read::<Int64Type, _>(reader, rows, |it| it)?;
            if is_instant { Values::SomeInstants(values) } else { Values::SomeIntegers(values) }
        }
        (Physical::INT64, false) => {
            Values::Integers(whole(read::<Int64Type, _>(reader, rows, |it| it)?)?)
        }
        (Physical::BOOLEAN, false) => {
            Values::Flags(whole(read::<BoolType, _>(reader, rows, |it| it)?)?)
        }
        (physical, _) => return Err(general(&format!("a column of {physical}"))),
    })
}

fn general(text: &str) -> parquet::errors::ParquetError {
    parquet::errors::ParquetError::General(text.to_owned())
}

fn text(bytes: &ByteArray) -> Option<String> {
    std::str::from_utf8(bytes.data()).ok().map(str::to_owned)
}

/// Values of which none may be null.
fn whole<T>(values: Vec<Option<T>>) -> Result<Vec<T>> {
    values.into_iter().collect::<Option<_>>().ok_or_else(|| general("a null in a whole column"))
}

fn read<T: DataType, V>(
    reader: ColumnReader,
    rows: usize,
    of: impl Fn(T::T) -> V,
) -> Result<Vec<Option<V>>> {
    let mut reader: ColumnReaderImpl<T> = get_typed_column_reader(reader);
    let (mut values, mut there) = (Vec::new(), Vec::new());
    loop {
        let (records, ..) = reader.read_records(rows, Some(&mut there), None, &mut values)?;
        if records == 0 {
            break;
        }
    }
    let mut values = values.into_iter().map(of);
    if there.is_empty() {
        // A column without nulls has no levels.
        return Ok(values.map(Some).collect());
    }
    let all: Vec<Option<V>> =
        there.iter().map(|level| if *level > 0 { values.next() } else { None }).collect();
    Ok(all)
}
