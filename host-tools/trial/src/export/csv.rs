//! A table as text: `time_s`, and for each point `NAME_ap_mm`, `NAME_ml_mm`, `NAME_si_mm` and the
//! orientation of its target, `NAME_quat_w` to `NAME_quat_z`: see
//! [`orientation`](super::orientation).

use std::fmt::Write as _;

use plumbline_analysis::series::Axis;

use super::orientation::{COMPONENTS, components};
use super::rows::Rows;

/// The columns after the time, in order.
pub fn columns(rows: &Rows) -> Vec<String> {
    let of = |name: &str| {
        let position = Axis::ALL.map(|axis| format!("{name}_{}_mm", axis.word().to_lowercase()));
        let turned = COMPONENTS.map(|component| format!("{name}_quat_{component}"));
        position.into_iter().chain(turned)
    };
    rows.points.iter().flat_map(|point| of(&point.name).collect::<Vec<_>>()).collect()
}

/// The table. Cells without a value are empty.
pub fn bytes(rows: &Rows) -> Vec<u8> {
    let mut text = format!("time_s,{}\n", columns(rows).join(","));
    for (row, time_s) in rows.time_s.iter().enumerate() {
        text += &seconds(*time_s);
        for point in &rows.points {
            text += &cells(point.position_mm[row], ',', "");
            text += &cells(point.orientation[row].as_ref().map(components), ',', "");
        }
        text.push('\n');
    }
    text.into_bytes()
}

/// A time to the microsecond.
pub fn seconds(time_s: f64) -> String {
    // "-0.000000" would be a time before t = 0.
    format!("{:.6}", (1e6 * time_s).round() / 1e6 + 0.0)
}

/// A separator and a number, several times. The numbers come from single precision, and are written
/// with the digits that give it back.
pub fn cells<const N: usize>(values: Option<[f64; N]>, separator: char, missing: &str) -> String {
    let mut text = String::new();
    for at in 0..N {
        // Writing to a String does not fail.
        let _ = match values {
            Some(values) => write!(text, "{separator}{}", values[at] as f32 + 0.0),
            None => write!(text, "{separator}{missing}"),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_no_sign() {
        assert_eq!(seconds(-1e-9), "0.000000");
        assert_eq!(seconds(-0.25), "-0.250000");
        let off = f64::from(0.1_f32);
        assert_eq!(cells(Some([off, -0.0, 1e-3]), ',', "n/a"), ",0.1,0,0.001");
        assert_eq!(cells::<3>(None, '\t', "n/a"), "\tn/a\tn/a\tn/a");
    }
}
