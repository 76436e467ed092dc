//! Compares the tables of memory.md with the build.

use core::mem::size_of;
use std::collections::BTreeMap;

use plumbline::lens_table::LensTable;
use plumbline::parts::Batch;
use plumbline::parts::GridFinder;
use plumbline::parts::Search;
use plumbline::parts::Workspace;
use plumbline::parts::{CornerList, Detector};
use plumbline::pipeline::Pipeline;
use plumbline::seal::{BoxEnd, StreamRing};

/// The core's bound.
const TOTAL_BYTES_MAX: usize = 384 * 1024;

/// Largest row that needs no formula of its own.
const SMALL_BYTES_MAX: usize = 1024;

/// One row: a buffer, what it is part of, and its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Row {
    name: String,
    parent: String,
    formula: String,
    bytes: usize,
}

/// The rows `| name | in | what | formula | bytes |` of the document's tables.
fn rows(document: &str) -> Vec<Row> {
    let mut rows = Vec::new();
    for line in document.lines() {
        let cells: Vec<&str> = line
            .trim()
            .trim_matches('|')
            .split('|')
            .map(|cell| cell.trim().trim_matches('`'))
            .collect();
        let [name, parent, _, formula, bytes] = cells[..] else { continue };
        let Ok(bytes) = bytes.replace(',', "").parse() else { continue };
        rows.push(Row { name: name.into(), parent: parent.into(), formula: formula.into(), bytes });
    }
    rows
}

/// `12,288 nodes x 8 + 16` is 98,320: the sum of the products of the numbers with which the factors
/// begin.
fn evaluate(formula: &str) -> usize {
    let factor = |text: &str| -> usize {
        let number = text.split_whitespace().next().unwrap_or_default().replace(',', "");
        number
            .parse()
            .unwrap_or_else(|_| panic!("no number at the start of {text:?} in {formula:?}"))
    };
    formula.split(" + ").map(|term| term.split(" x ").map(factor).product::<usize>()).sum()
}

/// The types named in memory.md.
fn sizes() -> BTreeMap<&'static str, usize> {
    BTreeMap::from([
        ("Pipeline", size_of::<Pipeline>()),
        ("CRC32", size_of::<crc::Crc<u32>>()),
        ("Workspace", size_of::<Workspace>()),
        ("Batch", size_of::<Batch>()),
        ("LensTable", size_of::<LensTable>()),
        ("Search", size_of::<Search>()),
        ("Detector", size_of::<Detector>()),
        ("GridFinder", size_of::<GridFinder>()),
        ("CornerList", size_of::<CornerList>()),
        ("BoxEnd", size_of::<BoxEnd>()),
        ("Ring", size_of::<StreamRing>()),
    ])
}

/// Everything that is wrong with the rows.
fn faults(rows: &[Row], sizes: &BTreeMap<&str, usize>) -> Vec<String> {
    let mut faults = Vec::new();
    for row in rows {
        if row.formula.is_empty() {
            if row.bytes > SMALL_BYTES_MAX && !rows.iter().any(|part| part.parent == row.name) {
                faults.push(format!("{}: {} bytes without a formula", row.name, row.bytes));
            }
        } else if evaluate(&row.formula) != row.bytes {
            let value = evaluate(&row.formula);
            faults.push(format!(
                "{}: the formula gives {value}, the row says {}",
                row.name, row.bytes
            ));
        }
        let parts: Vec<_> = rows.iter().filter(|part| part.parent == row.name).collect();
        let sum: usize = parts.iter().map(|part| part.bytes).sum();
        if !parts.is_empty() && sum != row.bytes {
            faults.push(format!(
                "{}: its parts add up to {sum} bytes, the row says {}",
                row.name, row.bytes
            ));
        }
    }
    for (name, &size) in sizes {
        match rows.iter().find(|row| row.name == *name) {
            None => faults.push(format!("{name}: {size} bytes in the build, but there is no row")),
            Some(row) if row.bytes != size => {
                faults
                    .push(format!("{name}: {size} bytes in the build, the row says {}", row.bytes));
            }
            Some(_) => {}
        }
    }
    faults
}

#[test]
fn memory_md_is_true_to_the_byte() {
    let rows = rows(include_str!("../../memory.md"));
    let faults = faults(&rows, &sizes());
    assert!(faults.is_empty(), "memory.md differs from the build:\n{}", faults.join("\n"));
}

#[test]
fn the_core_stays_within_its_bound() {
    let bytes = size_of::<Pipeline>() + size_of::<BoxEnd>() + size_of::<crc::Crc<u32>>();
    assert!(bytes <= TOTAL_BYTES_MAX, "{bytes} bytes");
}

#[test]
fn a_wrong_row_is_found() {
    let table = "| name | in | what | formula | bytes |\n|---|---|---|---|---:|\n\
                 | `Whole` | static | all | | 1,100 |\n\
                 | `Part` | `Whole` | some | 10 things x 100 + 60 | 1,060 |\n\
                 | rest | `Whole` | | | 40 |";
    let right = rows(table);
    assert_eq!(right.len(), 3);
    let sizes = BTreeMap::from([("Whole", 1100), ("Part", 1060)]);
    assert_eq!(faults(&right, &sizes), Vec::<String>::new());
    let mut wrong = right.clone();
    wrong[1].bytes = 1061;
    assert_eq!(faults(&wrong, &sizes).len(), 3, "sum, formula and build all disagree");
    assert_eq!(faults(&right[..1], &sizes).len(), 2, "no formula, no row for the part");
}
