//! The bound of every position that is read: no room is larger.

use std::fmt;

use plumbline::packet::POSITION_MM_MAX;

use crate::BadInput;

/// Checks a coordinate of a file; one that is not finite is refused, too.
///
/// # Errors
/// When no room holds it.
pub fn check_mm(place: &str, field: impl fmt::Display, coordinate_mm: f64) -> Result<(), BadInput> {
    if coordinate_mm.abs() <= f64::from(POSITION_MM_MAX) {
        return Ok(());
    }
    let bound_m = f64::from(POSITION_MM_MAX) / 1000.0;
    Err(BadInput::new(
        place,
        field,
        format!("a position of {coordinate_mm:e} mm: no room is longer than {bound_m} m"),
        "check the unit, and correct or remove what is named",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_room_holds_is_refused_with_its_place() {
        for mm in [0.0, -99_999.0, 100_000.0] {
            check_mm("poses.csv", "x_mm", mm).unwrap();
        }
        for mm in [100_001.0, -1e30, f64::INFINITY, f64::NAN] {
            let error = check_mm("poses.csv", "x_mm (line 2)", mm).unwrap_err().to_string();
            assert!(error.starts_with("poses.csv: x_mm (line 2): a position of"), "{error}");
            assert!(error.contains("check the unit"), "{error}");
        }
    }
}
