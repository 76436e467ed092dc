//! The stack tables in memory.md: generated here, and compared with the measurement.

use std::fmt::Write as _;

use anyhow::{Context, Result, ensure};

use super::Deepest;

/// The fraction by which another compiler, or a change of the code, may change a depth before the
/// table has to be generated again.
const TOLERANCE: f64 = 0.1;

const SUM: &str = "sum, by the compiler";
const PAINTED: &str = "painted in a run";

/// The table of one board: its title, the path, and both depths.
pub fn table(title: &str, deepest: &Deepest, painted_bytes: u64) -> String {
    let mut text = format!("{title}:\n\n| from `step` down | bytes |\n|---|---:|\n");
    for level in &deepest.levels {
        let _ = writeln!(text, "| `{}` | {} |", level.name, grouped(level.bytes));
    }
    for (name, bytes) in [(SUM, deepest.bytes()), (PAINTED, painted_bytes)] {
        let _ = writeln!(text, "| {name} | {} |", grouped(bytes));
    }
    if !deepest.uncounted.is_empty() {
        let names: Vec<String> = deepest.uncounted.iter().map(|name| format!("`{name}`")).collect();
        let _ = write!(text, "\nWithout a known frame: {}.", names.join(", "));
    }
    text.trim_end().to_owned()
}

/// Compares the text of memory.md with a new measurement: the depths within a tolerance and, if the
/// compiler is the same, the functions.
pub fn compare(written: &str, measured: &str) -> Result<()> {
    for name in [SUM, PAINTED] {
        let [old, new] = [written, measured].map(|table| figure(table, name));
        let (old, new) = (old?, new?);
        ensure!(
            old.abs_diff(new) as f64 <= TOLERANCE * new as f64,
            "{name}: {new} bytes instead of {old}"
        );
    }
    if written.lines().next() == measured.lines().next() {
        ensure!(
            without_figures(written) == without_figures(measured),
            "the deepest path has changed"
        );
    }
    Ok(())
}

/// The number in the row of this name.
fn figure(table: &str, name: &str) -> Result<u64> {
    let cell = table.lines().find_map(|line| {
        line.strip_prefix("| ")?.strip_prefix(name)?.strip_prefix(" | ")?.strip_suffix(" |")
    });
    let number = cell.and_then(|cell| cell.replace(',', "").parse().ok());
    number.with_context(|| format!("no row {name:?}"))
}

/// The lines, without the last cell of each row.
fn without_figures(table: &str) -> Vec<&str> {
    let lines = table.lines().filter(|line| !line.is_empty());
    lines.map(|line| line.rsplit_once(" | ").map_or(line, |(row, _)| row)).collect()
}

/// Groups digits by thousands: 12,288.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.char_indices() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::Level;
    use super::*;

    fn made(title: &str, leaf: &str, bytes: u64, painted_bytes: u64) -> String {
        let level = |name: &str, bytes| Level { name: name.into(), bytes };
        let levels = vec![level("step", 1000), level(leaf, bytes)];
        let deepest = Deepest { levels, uncounted: ["memcpy".to_owned()].into() };
        table(title, &deepest, painted_bytes)
    }

    #[test]
    fn a_table_is_true_within_the_tolerance() {
        let written = made("rustc 1", "leaf", 9000, 8000);
        assert!(written.contains("\n| sum, by the compiler | 10,000 |\n"), "{written}");
        compare(&written, &written).unwrap();
        compare(&written, &made("rustc 1", "leaf", 9900, 7400)).unwrap();
        for wrong in [made("rustc 1", "leaf", 10_200, 8000), made("rustc 1", "leaf", 9000, 7200)] {
            assert!(compare(&written, &wrong).is_err(), "{wrong}");
        }
        assert!(compare("", &written).is_err());
    }

    #[test]
    fn another_path_is_another_table_unless_the_compiler_is_another() {
        let written = made("rustc 1", "leaf", 9000, 8000);
        assert!(compare(&written, &made("rustc 1", "other", 9000, 8000)).is_err());
        compare(&written, &made("rustc 2", "other", 9000, 8000)).unwrap();
    }

    #[test]
    fn digits_are_grouped() {
        for (number, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (1_048_576, "1,048,576")] {
            assert_eq!(grouped(number), text);
        }
    }
}
