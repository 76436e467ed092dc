//! How the format of the frames affects precision: 8 bits, 10 bits, 8 bits after JPEG, poor light,
//! and frames drawn by another renderer.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;

use super::{
    Figures, figures_of, get, limit, limit_mm, measure, python_has, render, share_of_bound,
};
use crate::command::{Task, root, target_directory};

/// The name of a row, and the figures of its frames.
type Row = (String, Figures);

/// Mitsuba's drawings, which take some seconds each, and how often each is exposed: often enough to
/// tell the spread to 2 %, one standard deviation, and the drawings' own part of it to 3 %.
const MITSUBA_DRAWINGS: u32 = 16;
const MITSUBA_EXPOSURES: u32 = 90;

/// Measures every format except plain 8-bit frames, whose figures are already known. The contents
/// of `directory` are replaced.
pub fn measure_all(directory: &Path, frames: u32, plain: &Figures) -> Result<Vec<Row>> {
    let mut rows = vec![("8 bits".to_owned(), plain.clone())];
    // Includes the options that the bound must take into account. JPEG can only raise the bound.
    let (bits, light) = (["--bits", "10"], ["--black", "60", "--white", "180"]);
    let forms: [(_, &[_], &[_]); 4] = [
        ("8 bits, poor light (60 and 180)", &light, &light),
        ("10 bits", &bits, &bits),
        ("8 bits, after JPEG of quality 95", &["--jpeg", "95"], &[]),
        ("8 bits, lens without distortion", &["--lens", "none"], &[]),
    ];
    let mut bounds = Figures::new();
    for (name, options, options_of_bound) in forms {
        render(directory, frames, options)?;
        bounds = limit(directory, options_of_bound)?;
        let mut figures = measure(directory)?;
        figures.extend(bounds.clone());
        rows.push((name.to_owned(), figures));
    }
    if python_has("mitsuba") {
        // The same scene as in the previous format.
        let script = root().join("host-tools/bench/mitsuba_scene.py");
        let plumb = target_directory().join("release/plumb");
        let drawn = Task::new("python3")
            .args([&script, directory, &directory.join("mitsuba")])
            .args(["--drawings", &MITSUBA_DRAWINGS.to_string()])
            .args(["--exposures", &MITSUBA_EXPOSURES.to_string()])
            .args(["--plumb".as_ref(), plumb.as_os_str()]);
        let mut figures = figures_of(|each_line| drawn.run_and_read(each_line))?;
        figures.append(&mut bounds);
        let name = format!("the same, drawn by Mitsuba {}", get(&figures, "version")?);
        rows.push((name, figures));
    } else {
        println!("No frames drawn by Mitsuba: this machine's python3 has no mitsuba");
    }
    Ok(rows)
}

/// One row per form and target; below them, what Mitsuba's drawings contribute.
pub fn table(rows: &[Row], targets: &[&str]) -> Result<String> {
    let mut text = String::from(
        "| tracking, errors of the position in mm | target | depth, +-1.96 SD | its bound | the depth's share of it | SD of the errors over the stated one | x, +-1.96 SD | y, +-1.96 SD | depth, mean | poses missing | frames |\n\
         |---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for (name, figures) in rows {
        for target in targets {
            let mm = |figure: &str| -> Result<f64> {
                Ok(get(figures, &format!("tracking_{figure}_mm:{target}"))?.parse()?)
            };
            writeln!(
                text,
                "| {name} | {target} | {:.3} | {} | {} | {} | {:.3} | {:.3} | {:+.3} | {} | {} |",
                mm("spread")?,
                limit_mm(figures, target)?,
                share_of_bound(&[figures], target)?,
                get(figures, &format!("tracking_normalised:{target}"))?,
                mm("spread_x")?,
                mm("spread_y")?,
                mm("bias")?,
                get(figures, &format!("tracking_lost:{target}"))?,
                get(figures, "frames")?,
            )?;
        }
    }
    for (_, figures) in rows.iter().filter(|(_, figures)| figures.contains_key("drawings")) {
        let drawn: Result<Vec<_>> = targets
            .iter()
            .map(|target| {
                let mm: f64 = get(figures, &format!("tracking_drawn_mm:{target}"))?.parse()?;
                Ok(format!("{target} {mm:.3}"))
            })
            .collect();
        writeln!(
            text,
            "\nMitsuba's frames are {} drawings with {} exposures each. What the drawings themselves contribute to the spread of the depth, +-1.96 SD in mm: {}.",
            get(figures, "drawings")?,
            MITSUBA_EXPOSURES,
            drawn?.join(", "),
        )?;
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_form_has_a_row_per_target() {
        let figures = figures_of(|each_line| {
            for figure in [
                "frames\t1250",
                "tracking_lost:lumbar\t2",
                "tracking_normalised:lumbar\t0.98",
                "limit_mm:lumbar\t0.0400",
                "tracking_drawn_mm:lumbar\t0.0021",
            ] {
                each_line(figure);
            }
            for figure in ["spread", "spread_x", "spread_y", "bias"] {
                each_line(&format!("tracking_{figure}_mm:lumbar\t0.0426"));
            }
            Ok(())
        });
        let mut rows = [("10 bits".to_owned(), figures.unwrap())];
        let text = table(&rows, &["lumbar"]).unwrap();
        let row = "| 10 bits | lumbar | 0.043 | 0.040 | 1.06 +- 0.02 | 0.98 | 0.043 | 0.043 | +0.043 | 2 | 1250 |\n";
        assert!(text.ends_with(row), "{text}");
        assert!(table(&rows, &["shoulder"]).unwrap_err().to_string().contains("shoulder"));
        // Drawings that were exposed several times.
        rows[0].1.insert("drawings".into(), "16".into());
        let text = table(&rows, &["lumbar"]).unwrap();
        assert!(text.ends_with("+-1.96 SD in mm: lumbar 0.002.\n"), "{text}");
    }
}
