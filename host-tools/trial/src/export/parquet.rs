//! The table of [`csv`](super::csv) as Parquet: null where there is no value.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, Repetition, Type as Physical};
use parquet::data_type::DoubleType;
use parquet::errors::Result as ParquetResult;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use plumbline_files::BadInput;

use super::orientation::{QUATERNION, components};
use super::rows::Rows;
use super::{BODY_AXES, csv};
use crate::Verdict;
use crate::tables::put;

/// The file.
///
/// # Errors
/// When the writer fails.
pub fn bytes(rows: &Rows, verdict: &Verdict, place: &Path) -> Result<Vec<u8>, BadInput> {
    write(rows, verdict)
        .map_err(|error| BadInput::whole(place.display(), error, "report it: rows can be written"))
}

fn write(rows: &Rows, verdict: &Verdict) -> ParquetResult<Vec<u8>> {
    let column = |name: &str, repetition| {
        let column = Type::primitive_type_builder(name, Physical::DOUBLE);
        column.with_repetition(repetition).build().map(Arc::new)
    };
    let mut fields = vec![column("time_s", Repetition::REQUIRED)?];
    for name in csv::columns(rows) {
        fields.push(column(&name, Repetition::OPTIONAL)?);
    }
    let schema = Type::group_type_builder("positions").with_fields(fields).build()?;
    let always = [
        ("axes", BODY_AXES.to_owned()),
        ("orientations", QUATERNION.to_owned()),
        ("verdict", verdict.line()),
    ];
    let always = always.map(|(key, about)| KeyValue::new(key.to_owned(), about));
    let times = rows.moved().map(|moved| KeyValue::new("times".to_owned(), moved));
    let about = always.into_iter().chain(times).collect();
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(about))
        .build();
    let mut file = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut file, Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    put::<DoubleType, _>(&mut group, &rows.time_s, None)?;
    for point in &rows.points {
        put_all(&mut group, &point.position_mm)?;
        let turned = point.orientation.iter().map(|it| it.as_ref().map(components));
        put_all(&mut group, &turned.collect::<Vec<_>>())?;
    }
    group.close()?;
    writer.close()?;
    Ok(file)
}

/// A column for each of the numbers; null where a row has none.
fn put_all<const N: usize>(
    group: &mut SerializedRowGroupWriter<'_, &mut Vec<u8>>,
    rows: &[Option<[f64; N]>],
) -> ParquetResult<()> {
    let there: Vec<i16> = rows.iter().map(|it| i16::from(it.is_some())).collect();
    for at in 0..N {
        let values: Vec<f64> = rows.iter().flatten().map(|it| it[at]).collect();
        put::<DoubleType, _>(group, &values, Some(&there))?;
    }
    Ok(())
}
