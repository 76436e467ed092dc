//! Compares which checkerboards `plumb` and OpenCV's two detectors find on rendered photographs as
//! people take them: `host-tools/bench/boards.py` renders them and runs OpenCV, and the example
//! `find_boards` of `plumbline-calibration` runs the project's search on the same files.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, Result, ensure};

use super::python_has;
use crate::command::{Task, root, target_directory};

/// What was found among the photographs of one kind.
#[derive(Default)]
struct Kind {
    photographs: u32,
    plumbline: u32,
    classic: u32,
    sector_based: u32,
    either: u32,
    /// Found by OpenCV, not by Plumbline.
    missed: u32,
    /// Boards of other columns and rows, at a wrong place, or where there is none.
    false_boards: u32,
}

/// Renders the photographs, searches them, and returns the table.
pub fn table(count: u32, seed: u32) -> Result<String> {
    ensure!(python_has("cv2, numpy"), "OpenCV is missing: python3 needs the modules cv2 and numpy");
    let directory = target_directory().join("bench-boards");
    let script = root().join("host-tools/bench/boards.py");
    Task::new("python3")
        .args([script, directory.clone()])
        .args([count.to_string(), seed.to_string()])
        .run()?;
    let opencv_path = directory.join("opencv.txt");
    let opencv = fs::read_to_string(&opencv_path).context(format!("{}", opencv_path.display()))?;
    let mut theirs = opencv.lines();
    let mut kinds: BTreeMap<String, Kind> = BTreeMap::new();
    let mut outcome = Ok(());
    let mut times_ms = Vec::new();
    Task::cargo()
        .args(["run", "--release", "--package", "plumbline-calibration", "--example"])
        .args(["find_boards", "--"])
        .args([&directory])
        .run_and_read(|line| {
            if outcome.is_ok() && line.contains('\t') {
                outcome = add(&mut kinds, &mut times_ms, line, theirs.next());
            }
        })?;
    outcome?;
    fs::remove_dir_all(&directory).context(format!("{}", directory.display()))?;
    times_ms.sort_by(f64::total_cmp);
    let median_ms = times_ms.get(times_ms.len() / 2).context("no photograph was searched")?;
    let mut text = format!(
        "{count} photographs, seed {seed}; a search at all sizes takes {median_ms:.1} ms (median).\n\n\
         | boards | photographs | Plumbline | findChessboardCorners | findChessboardCornersSB | either | missed by Plumbline alone | false boards |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|\n"
    );
    for (name, kind) in &kinds {
        let Kind { photographs, plumbline, classic, sector_based, either, missed, false_boards } =
            kind;
        writeln!(
            text,
            "| {name} | {photographs} | {plumbline} | {classic} | {sector_based} | {either} | {missed} | {false_boards} |"
        )?;
    }
    Ok(text)
}

/// Adds a line of `find_boards` and the line of OpenCV's results for the same photograph.
fn add(
    kinds: &mut BTreeMap<String, Kind>,
    times_ms: &mut Vec<f64>,
    ours: &str,
    theirs: Option<&str>,
) -> Result<()> {
    let ours: Vec<&str> = ours.trim_end().split('\t').collect();
    let theirs: Vec<&str> = theirs.context("opencv.txt is too short")?.split(' ').collect();
    let ([name, kind, verdict, false_boards, _, ms], [their_name, classic, sector_based]) =
        (&ours[..], &theirs[..])
    else {
        anyhow::bail!("{ours:?} and {theirs:?} are no results");
    };
    ensure!(name == their_name, "{name} and {their_name} are two photographs");
    let is_found = *verdict == "right";
    let [classic, sector_based] = [*classic == "1", *sector_based == "1"];
    let either = classic || sector_based;
    let kind = kinds.entry((*kind).to_owned()).or_default();
    kind.photographs += 1;
    kind.plumbline += u32::from(is_found);
    kind.classic += u32::from(classic);
    kind.sector_based += u32::from(sector_based);
    kind.either += u32::from(either);
    kind.missed += u32::from(either && !is_found);
    kind.false_boards += false_boards.parse::<u32>().context("a number of false boards")?;
    times_ms.push(ms.parse().context("milliseconds")?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_that_only_opencv_finds_is_missed() {
        let (mut kinds, mut times_ms) = (BTreeMap::new(), Vec::new());
        for (ours, theirs) in [
            ("0.pgm\tcut\tright\t0\t0.2\t3.0", "0.pgm 1 1"),
            ("1.pgm\tcut\tno checkerboard is seen\t1\tNaN\t3.0", "1.pgm 0 1"),
        ] {
            add(&mut kinds, &mut times_ms, ours, Some(theirs)).unwrap();
        }
        let cut = &kinds["cut"];
        assert_eq!((cut.photographs, cut.plumbline, cut.either), (2, 1, 2));
        assert_eq!((cut.missed, cut.false_boards), (1, 1));
        assert!(add(&mut kinds, &mut times_ms, "2.pgm\tcut\tright\t0\t0\t3", None).is_err());
    }
}
