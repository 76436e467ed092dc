//! Track row column: five lines of header, then a row of tabs and numbers per frame.
//!
//! Names stand on the fourth line over every third column, and the sixth line is empty. A marker
//! that was not seen is NaN: an empty cell is usual as well, but a reader that splits lines at
//! any white space would take the next marker for this one.

use std::fmt::Write as _;
use std::path::Path;

use super::rows::Rows;
use super::{csv, right_handed};

/// The file; its name is in its first line.
pub fn bytes(rows: &Rows, path: &Path) -> Vec<u8> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    // A tab in the name would begin another column.
    let name: String = name.chars().filter(|letter| !letter.is_control()).collect();
    let (rate, frames, markers) = (rows.rate_hz, rows.time_s.len(), rows.points.len());
    let mut text = format!("PathFileType\t4\t(X/Y/Z)\t{name}\n");
    text += "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t\
             OrigDataStartFrame\tOrigNumFrames\n";
    // Writing to a String does not fail.
    let _ = writeln!(text, "{rate:.6}\t{rate:.6}\t{frames}\t{markers}\tmm\t{rate:.6}\t1\t{frames}");
    let names: Vec<String> =
        rows.points.iter().map(|point| format!("{}_trunk\t\t", point.name)).collect();
    let axes: Vec<String> = (1..=markers).map(|at| format!("X{at}\tY{at}\tZ{at}")).collect();
    let _ = writeln!(text, "Frame#\tTime\t{}\n\t\t{}\n", names.join("\t"), axes.join("\t"));
    for (row, time_s) in rows.time_s.iter().enumerate() {
        let _ = write!(text, "{}\t{}", row + 1, csv::seconds(*time_s));
        for point in &rows.points {
            text += &csv::cells(point.position_mm[row].map(right_handed), '\t', "NaN");
        }
        text.push('\n');
    }
    text.into_bytes()
}
