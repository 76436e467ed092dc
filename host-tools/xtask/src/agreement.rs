//! Checks that every processor computes the same poses: the standard recording is tracked on this
//! machine and under QEMU.
//!
//! Rust neither reorders nor fuses floating-point operations, and the core takes its mathematical
//! functions from one library, so both should give the same bits. The check requires them to agree
//! to [`DIFFERENCE_MAX`] and prints the difference reached.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use plumbline_test_support::{RECORDINGS, STANDARD_FRAMES};

use crate::command::Task;
use crate::cross::{Linking, Toolchain};

/// The largest difference allowed between the numbers of the two processors, mm or rad.
pub const DIFFERENCE_MAX: f64 = 1e-6;

/// The number of targets in the standard scene.
const TARGETS: usize = 2;

/// The numeric columns of a row: the target's pose, and the trunk point that it carries.
const NUMBERS: [&str; 9] =
    ["theta1_rad", "theta2_rad", "theta3_rad", "x_mm", "y_mm", "z_mm", "ap_mm", "ml_mm", "si_mm"];

/// The columns that must be identical: what was seen, and how.
const IDENTICAL: [&str; 4] = ["frame", "target", "state", "points"];

/// Tracks the recording twice and compares every pose: with the program in `native`, which is built
/// first if it is missing, and with the one built along with the tests for the other processor.
pub fn check(
    native: Option<&Path>,
    toolchain: &Toolchain,
    linking: Linking,
    recordings: &Path,
) -> Result<()> {
    let name = "poses";
    let native = match native {
        Some(programs) => Task::new(programs.join(name)),
        None => Task::cargo().args(["run", "--package", "plumbline-core-tests", "--bin", name]),
    };
    let emulated = toolchain.programs(linking, "debug").join(name);
    let emulated = toolchain.emulated(linking, &emulated);
    let poses = |task: Task| task.env(RECORDINGS, &recordings.display().to_string()).output();
    let (native, emulated) = (poses(native)?, poses(emulated)?);
    let compared = compare_rows(&native, &emulated)?;
    println!("{compared}");
    // The other target is seen in every frame; the hidden one is seen before and after.
    ensure!(
        compared.rows == STANDARD_FRAMES * TARGETS && compared.poses > STANDARD_FRAMES,
        "that is too little for {STANDARD_FRAMES} frames of {TARGETS} targets"
    );
    ensure!(
        compared.largest <= DIFFERENCE_MAX,
        "the poses of the two processors differ by {:e} mm or rad, more than {DIFFERENCE_MAX:e}",
        compared.largest
    );
    Ok(())
}

/// How much two tables of poses differ.
#[derive(Debug, PartialEq)]
pub struct Compared {
    /// The number of rows.
    pub rows: usize,
    /// The number of rows with a pose.
    pub poses: usize,
    /// The largest difference between two numbers, mm or rad.
    pub largest: f64,
}

impl std::fmt::Display for Compared {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            formatter,
            "{} poses in {} rows: largest difference of a number {:e} mm or rad",
            self.poses, self.rows, self.largest
        )
    }
}

/// Compares the rows of two tables in pairs; an error where they describe different things.
pub fn compare_rows(one: &str, other: &str) -> Result<Compared> {
    let [mut one, mut other] = [one, other].map(|text| csv::Reader::from_reader(text.as_bytes()));
    let header = one.headers()?.clone();
    ensure!(&header == other.headers()?, "the columns differ");
    let column = |name: &str| {
        header.iter().position(|column| column == name).with_context(|| format!("no column {name}"))
    };
    let identical = IDENTICAL.map(column).into_iter().collect::<Result<Vec<_>>>()?;
    let numbers = NUMBERS.map(column).into_iter().collect::<Result<Vec<_>>>()?;
    let mut compared = Compared { rows: 0, poses: 0, largest: 0.0 };
    let (mut one, mut other) = (one.records(), other.records());
    loop {
        let (left, right) = match (one.next(), other.next()) {
            (Some(left), Some(right)) => (left?, right?),
            (None, None) => return Ok(compared),
            _ => bail!("only one of the tables continues after row {}", compared.rows),
        };
        compared.rows += 1;
        for &column in &identical {
            let (left, right) = (&left[column], &right[column]);
            ensure!(
                left == right,
                "row {}: {} is {left:?} and {right:?}",
                compared.rows,
                &header[column]
            );
        }
        let mut has_pose = false;
        for &column in &numbers {
            let (left, right) = (&left[column], &right[column]);
            if left.is_empty() && right.is_empty() {
                continue;
            }
            let number = |text: &str| {
                text.parse::<f64>().ok().filter(|value| value.is_finite()).with_context(|| {
                    format!("row {}: {} is {text:?}", compared.rows, &header[column])
                })
            };
            compared.largest = compared.largest.max((number(left)? - number(right)?).abs());
            has_pose = true;
        }
        compared.poses += usize::from(has_pose);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "frame,target,state,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm,points,ap_mm,ml_mm,si_mm";

    fn file(rows: &[&str]) -> String {
        format!("{HEADER}\n{}\n", rows.join("\n"))
    }

    #[test]
    fn the_largest_difference_of_all_numbers_is_told() {
        let one =
            file(&["0,lumbar,tracking,7,8,9,1,2,1000,30,4,5,6", "0,shoulder,lost,,,,,,,0,,,"]);
        let same = compare_rows(&one, &one).unwrap();
        assert_eq!(same, Compared { rows: 2, poses: 1, largest: 0.0 });
        for (from, to, largest) in
            [("1000", "1000.000002", 2e-6), (",4,", ",3.5,", 0.5), (",8,", ",8.25,", 0.25)]
        {
            let other = one.replacen(from, to, 1);
            let compared = compare_rows(&one, &other).unwrap();
            assert!((compared.largest - largest).abs() < 1e-9, "{to}: {compared}");
        }
    }

    #[test]
    fn files_that_tell_of_different_things_do_not_agree() {
        let row = "0,lumbar,tracking,7,8,9,1,2,1000,30,4,5,6";
        let one = file(&[row]);
        for (other, part) in [
            (file(&[row, row]), "only one of the tables continues after row 1"),
            (one.replace("tracking", "coasting"), "state is \"tracking\" and \"coasting\""),
            (one.replace(",30,", ",29,"), "points"),
            (one.replace("1000", ""), "z_mm is \"\""),
            (one.replace("1000", "NaN"), "z_mm is \"NaN\""),
            (one.replace("y_mm", "w_mm"), "the columns differ"),
        ] {
            let error = format!("{:#}", compare_rows(&one, &other).unwrap_err());
            assert!(error.contains(part), "{error}");
        }
        let narrow = "frame,target\n0,lumbar\n";
        assert!(compare_rows(narrow, narrow).unwrap_err().to_string().contains("no column state"));
    }
}
