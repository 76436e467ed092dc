//! Tables as Parquet files, for data analysis: named columns of texts, numbers, flags and instants,
//! which may be null, compressed with Snappy; and the same tables read again.

mod reader;

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{
    Compression, LogicalType, Repetition, TimeUnit, TimestampType, Type as Physical,
};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

pub use reader::{Reader, Table};

/// The values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Texts.
    Texts(Vec<String>),
    /// Texts; null in a row without one.
    SomeTexts(Vec<Option<String>>),
    /// Numbers, one for each row.
    Numbers(Vec<f64>),
    /// Numbers; null in a row without one.
    SomeNumbers(Vec<Option<f64>>),
    /// Whole numbers.
    Integers(Vec<i64>),
    /// Whole numbers; null in a row without one.
    SomeIntegers(Vec<Option<i64>>),
    /// Yes or no.
    Flags(Vec<bool>),
    /// Times of day, microseconds since 1970 UTC; null in a row without one.
    SomeInstants(Vec<Option<i64>>),
}

/// A time of day, UTC.
const INSTANT: LogicalType =
    LogicalType::Timestamp(TimestampType { is_adjusted_to_u_t_c: true, unit: TimeUnit::MICROS });

impl Values {
    fn field(&self, name: &str) -> Result<Arc<Type>> {
        let (physical, logical) = match self {
            Self::Texts(_) | Self::SomeTexts(_) => {
                (Physical::BYTE_ARRAY, Some(LogicalType::String))
            }
            Self::Numbers(_) | Self::SomeNumbers(_) => (Physical::DOUBLE, None),
            Self::Integers(_) | Self::SomeIntegers(_) => (Physical::INT64, None),
            Self::Flags(_) => (Physical::BOOLEAN, None),
            Self::SomeInstants(_) => (Physical::INT64, Some(INSTANT)),
        };
        let repetition = match self {
            Self::Texts(_) | Self::Numbers(_) | Self::Integers(_) | Self::Flags(_) => {
                Repetition::REQUIRED
            }
            Self::SomeTexts(_)
            | Self::SomeNumbers(_)
            | Self::SomeIntegers(_)
            | Self::SomeInstants(_) => Repetition::OPTIONAL,
        };
        field(name, physical, repetition, logical)
    }

    fn put<W: Write + Send>(&self, group: &mut SerializedRowGroupWriter<'_, W>) -> Result<()> {
        match self {
            Self::Texts(texts) => {
                let texts: Vec<ByteArray> = texts.iter().map(|it| it.as_str().into()).collect();
                put::<ByteArrayType, _>(group, &texts, None)
            }
            Self::SomeTexts(texts) => {
                put_some::<ByteArrayType, _, _>(group, texts, |it| it.as_str().into())
            }
            Self::Numbers(numbers) => put::<DoubleType, _>(group, numbers, None),
            Self::SomeNumbers(numbers) => put_some::<DoubleType, _, _>(group, numbers, |it| *it),
            Self::Integers(numbers) => put::<Int64Type, _>(group, numbers, None),
            Self::SomeIntegers(numbers) | Self::SomeInstants(numbers) => {
                put_some::<Int64Type, _, _>(group, numbers, |it| *it)
            }
            Self::Flags(flags) => put::<BoolType, _>(group, flags, None),
        }
    }
}

/// A file with these columns, all of the same length; `about` is its metadata.
///
/// # Errors
/// When the columns are not of the same length.
pub fn bytes(
    name: &str,
    columns: &[(String, Values)],
    about: Vec<(&str, String)>,
) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    let mut writer = Writer::new(&mut file, name, columns, about)?;
    writer.group(columns)?;
    writer.close()?;
    Ok(file)
}

/// Writes a table group by group, so that memory holds one group of its rows.
pub struct Writer<W: Write + Send>(SerializedFileWriter<W>);

impl<W: Write + Send> Writer<W> {
    /// Begins a file with columns of these names and kinds; `about` is its metadata. No row is
    /// written yet.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn new(
        file: W,
        name: &str,
        columns: &[(String, Values)],
        about: Vec<(&str, String)>,
    ) -> Result<Self> {
        let fields: Result<Vec<_>> = columns.iter().map(|(name, it)| it.field(name)).collect();
        let schema = Type::group_type_builder(name).with_fields(fields?).build()?;
        SerializedFileWriter::new(file, Arc::new(schema), properties(about)).map(Self)
    }

    /// Writes rows: columns of the kinds that the file began with, all of one length.
    ///
    /// # Errors
    /// When the columns are not of the same length, or the operating system refuses.
    pub fn group(&mut self, columns: &[(String, Values)]) -> Result<()> {
        let mut group = self.0.next_row_group()?;
        for (_, values) in columns {
            values.put(&mut group)?;
        }
        group.close().map(drop)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn close(self) -> Result<()> {
        self.0.close().map(drop)
    }
}

/// The compression and the metadata of a file.
pub(crate) fn properties(about: Vec<(&str, String)>) -> Arc<WriterProperties> {
    let about = about.into_iter().map(|(key, value)| KeyValue::new(key.to_owned(), value));
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(about.collect()));
    Arc::new(properties.build())
}

/// The description of a column of texts.
pub(crate) fn text_field(name: &str) -> Result<Arc<Type>> {
    field(name, Physical::BYTE_ARRAY, Repetition::REQUIRED, Some(LogicalType::String))
}

/// The description of a column.
pub(crate) fn field(
    name: &str,
    physical: Physical,
    repetition: Repetition,
    logical: Option<LogicalType>,
) -> Result<Arc<Type>> {
    let column = Type::primitive_type_builder(name, physical);
    column.with_repetition(repetition).with_logical_type(logical).build().map(Arc::new)
}

/// Writes the next column of a group. `there` is 1 for each row with a value, and 0 for a null.
pub(crate) fn put<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    there: Option<&[i16]>,
) -> Result<()> {
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(values, there, None)?;
        column.close()?;
    }
    Ok(())
}

/// Writes the next column of a group, which may have nulls.
fn put_some<T: DataType, V, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[Option<V>],
    of: impl Fn(&V) -> T::T,
) -> Result<()> {
    let there: Vec<i16> = values.iter().map(|it| i16::from(it.is_some())).collect();
    let values: Vec<T::T> = values.iter().flatten().map(of).collect();
    put::<T, _>(group, &values, Some(&there))
}
