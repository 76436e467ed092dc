//! `samples.csv` and `samples.parquet`: a trial's poses as tables for other programs, made from its
//! packets. The verdict on the trial is in the Parquet file's metadata, under `verdict`.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parquet::basic::{Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::Result as ParquetResult;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use plumbline::packet::Deframer;
use plumbline_files::BadInput;
use plumbline_files::poses::{NUMBERS, PoseRow, number_columns};
use plumbline_stream::receiver::Receiver;
use plumbline_stream::recorder::Recorder;
use plumbline_stream::transport::Event;

use super::correction::{Correction, corrected};
use super::journal::{Content, Reader};
use super::parquet::{field, properties, put, text_field};
use super::{Verdict, names};

/// Rows per group of the Parquet file; one group is held in memory.
const GROUP_ROWS: usize = 65_536;

/// Writes both tables.
///
/// # Errors
/// When there is no journal, or the operating system refuses.
pub fn write(
    folder: &Path,
    correction: Option<&Correction>,
    verdict: &Verdict,
) -> Result<(), BadInput> {
    let csv = folder.join(names::CSV);
    plumbline_files::replace_with(&csv, |file| csv_of(folder, correction, file, &csv))?;
    let parquet = folder.join(names::PARQUET);
    plumbline_files::replace_with(&parquet, |file| parquet_of(&csv, verdict, file, &parquet))
}

/// Receives the packets once more, so that the rows are those that were written as they came.
fn csv_of(
    folder: &Path,
    correction: Option<&Correction>,
    file: &File,
    place: &Path,
) -> Result<(), BadInput> {
    let mut journal = Reader::open(&folder.join(names::JOURNAL))?;
    let mut receiver = Receiver::new(Some(Recorder::new(file, place.display().to_string())));
    // The receiver takes moments; only their differences matter.
    let begun = Instant::now();
    let mut deframer = Deframer::new();
    while let Some(entry) = journal.next_entry()? {
        let Content::Raw(raw) = entry.content else { continue };
        let now = begun + Duration::from_nanos(entry.host_ns);
        // Time passes before each packet.
        receiver.tick(now)?;
        let packet = raw.decode(&mut deframer).map(|packet| corrected(correction, packet));
        receiver.handle(Event::of(packet), now)?;
        receiver.take_notices();
    }
    receiver.finish(begun)
}

/// The columns of one group of rows. A value that a row lacks is null.
#[derive(Default)]
struct Columns {
    whole: [Vec<i64>; 2],
    text: [Vec<ByteArray>; 2],
    time_s: Vec<f64>,
    /// The values, and for each row 1 where it has one and 0 where it has none.
    numbers: [(Vec<f64>, Vec<i16>); NUMBERS],
}

const WHOLE: [&str; 2] = ["session", "frame"];
const TEXT: [&str; 2] = ["target", "state"];
impl Columns {
    fn push(&mut self, row: &PoseRow, session: u32) {
        let whole = [i64::from(session), row.frame.cast_signed()];
        self.whole.iter_mut().zip(whole).for_each(|(column, value)| column.push(value));
        let text = [&row.target, &row.state];
        self.text.iter_mut().zip(text).for_each(|(column, it)| column.push(it.as_str().into()));
        self.time_s.push(row.time_s);
        for ((values, there), number) in self.numbers.iter_mut().zip(row.numbers()) {
            values.extend(number);
            there.push(i16::from(number.is_some()));
        }
    }

    fn rows(&self) -> usize {
        self.time_s.len()
    }

    fn schema() -> ParquetResult<Type> {
        let required = Repetition::REQUIRED;
        let mut fields = Vec::new();
        for name in WHOLE {
            fields.push(field(name, Physical::INT64, required, None)?);
        }
        for name in TEXT {
            fields.push(text_field(name)?);
        }
        fields.push(field("time_s", Physical::DOUBLE, required, None)?);
        for name in number_columns() {
            fields.push(field(name, Physical::DOUBLE, Repetition::OPTIONAL, None)?);
        }
        Type::group_type_builder("samples").with_fields(fields).build()
    }

    fn write(&self, mut group: SerializedRowGroupWriter<'_, &File>) -> ParquetResult<()> {
        for column in &self.whole {
            put::<Int64Type, _>(&mut group, column, None)?;
        }
        for column in &self.text {
            put::<ByteArrayType, _>(&mut group, column, None)?;
        }
        put::<DoubleType, _>(&mut group, &self.time_s, None)?;
        for (values, there) in &self.numbers {
            put::<DoubleType, _>(&mut group, values, Some(there))?;
        }
        group.close().map(drop)
    }
}

/// Made from the rows of the CSV, so that both tables agree.
fn parquet_of(csv: &Path, verdict: &Verdict, file: &File, place: &Path) -> Result<(), BadInput> {
    let unwritable =
        |error| BadInput::whole(place.display(), error, "check the disk, and that it has room");
    let unreadable =
        |error| BadInput::whole(csv.display(), error, "report it: plumb wrote this file");
    let schema = Columns::schema().map_err(unwritable)?;
    let properties = properties(vec![("verdict", verdict.line())]);
    let mut writer =
        SerializedFileWriter::new(file, Arc::new(schema), properties).map_err(unwritable)?;
    let mut rows = csv::Reader::from_path(csv).map_err(unreadable)?;
    let mut columns = Columns::default();
    let header = rows.headers().map_err(unreadable)?.clone();
    let session_at = header.iter().position(|name| name == "session");
    for record in rows.records() {
        let record = record.map_err(unreadable)?;
        let row: PoseRow = record.deserialize(Some(&header)).map_err(unreadable)?;
        let session = session_at.and_then(|at| record.get(at)?.parse().ok()).unwrap_or_default();
        columns.push(&row, session);
        if columns.rows() == GROUP_ROWS {
            let full = std::mem::take(&mut columns);
            writer.next_row_group().and_then(|group| full.write(group)).map_err(unwritable)?;
        }
    }
    if columns.rows() > 0 {
        writer.next_row_group().and_then(|group| columns.write(group)).map_err(unwritable)?;
    }
    writer.close().map(drop).map_err(unwritable)
}
