//! Tables as Parquet files, for data analysis: named columns of texts and of numbers, which may be
//! null, compressed with Snappy.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType};
use parquet::errors::Result;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

/// The values of a column.
#[derive(Debug, Clone)]
pub enum Values {
    /// Texts.
    Texts(Vec<String>),
    /// Numbers, one for each row.
    Numbers(Vec<f64>),
    /// Numbers; null in a row without one.
    SomeNumbers(Vec<Option<f64>>),
}

impl Values {
    fn field(&self, name: &str) -> Result<Arc<Type>> {
        match self {
            Self::Texts(_) => text_field(name),
            Self::Numbers(_) => field(name, Physical::DOUBLE, Repetition::REQUIRED, None),
            Self::SomeNumbers(_) => field(name, Physical::DOUBLE, Repetition::OPTIONAL, None),
        }
    }

    fn put<W: Write + Send>(&self, group: &mut SerializedRowGroupWriter<'_, W>) -> Result<()> {
        match self {
            Self::Texts(texts) => {
                let texts: Vec<ByteArray> = texts.iter().map(|it| it.as_str().into()).collect();
                put::<ByteArrayType, _>(group, &texts, None)
            }
            Self::Numbers(numbers) => put::<DoubleType, _>(group, numbers, None),
            Self::SomeNumbers(numbers) => {
                let there: Vec<i16> = numbers.iter().map(|it| i16::from(it.is_some())).collect();
                let numbers: Vec<f64> = numbers.iter().copied().flatten().collect();
                put::<DoubleType, _>(group, &numbers, Some(&there))
            }
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
    let fields: Result<Vec<_>> = columns.iter().map(|(name, it)| it.field(name)).collect();
    let schema = Type::group_type_builder(name).with_fields(fields?).build()?;
    let mut file = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut file, Arc::new(schema), properties(about))?;
    let mut group = writer.next_row_group()?;
    for (_, values) in columns {
        values.put(&mut group)?;
    }
    group.close()?;
    writer.close()?;
    Ok(file)
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
