//! What a camera's format costs before a frame can be tracked: time, and heap.

use std::fmt::Write as _;

use anyhow::Result;

use super::{Figures, figures_of, get, times};
use crate::command::Task;

/// The formats that are not read where they lie, by their names in the figures and in `box.toml`.
const FORMATS: [(&str, &str); 5] = [
    ("yuyv", "`yuyv`"),
    ("y10p", "`y10`, packed"),
    ("rgb24", "`rgb24`"),
    ("bayer8", "`bayer8`"),
    ("mjpeg", "`mjpeg`"),
];

/// Measures and prints the table.
pub fn table() -> Result<String> {
    let bench = Task::cargo().args(["bench", "--package", "plumbline-board", "--bench", "luma"]);
    let figures = figures_of(|each_line| bench.run_and_read(each_line))?;
    table_of(&figures)
}

fn table_of(figures: &Figures) -> Result<String> {
    let mut text = String::from(
        "| a camera's frame of 1280 x 720, to grey values | KiB | ms, median / worst | heap allocations, and their KiB |\n\
         |---|---:|---:|---:|\n\
         | `grey`, `y10` and `y16` in words, `nv12` | | 0, read where they lie | 0 |\n",
    );
    for (name, words) in FORMATS {
        let figure = |what: &str| get(figures, &format!("luma_{name}_{what}"));
        let heap = match figure("allocations")? {
            "0" => "0".to_owned(),
            count => format!("{count}, {}", figure("allocated_kib")?),
        };
        let times = times(figures, &format!("luma_{name}"))?;
        writeln!(text, "| {words} | {} | {times} | {heap} |", figure("frame_kib")?)?;
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_format_has_a_row_and_heap_is_counted() {
        let figures = figures_of(|each_line| {
            for (name, _) in FORMATS {
                let count = if name == "mjpeg" { "14" } else { "0" };
                each_line(&format!("luma_{name}_allocations\t{count}"));
                for figure in ["frame_kib", "median_us", "worst_us", "allocated_kib"] {
                    each_line(&format!("luma_{name}_{figure}\t2000"));
                }
            }
            Ok(())
        });
        let text = table_of(&figures.unwrap()).unwrap();
        assert!(text.contains("| `bayer8` | 2000 | 2.000 / 2.000 | 0 |\n"), "{text}");
        assert!(text.ends_with("| `mjpeg` | 2000 | 2.000 / 2.000 | 14, 2000 |\n"), "{text}");
    }
}
