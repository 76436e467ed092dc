//! `cargo xtask bench`: the figures of README.md.
//!
//! `plumb simulate` renders the standard scene. On those frames the core is
//! measured by `host-tools/plumb/benches/frame.rs` and OpenCV by
//! `host-tools/bench/opencv_chain.py`. Both print lines `name, tab, value`; here
//! they become tables.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, Result, ensure};

use crate::command::{Task, root, target_directory};
use crate::setup;

/// What `cargo xtask bench` takes.
#[derive(clap::Args)]
pub struct Arguments {
    /// Put the figures into README.md, between its markers.
    #[arg(long)]
    write_readme: bool,
    /// Rendered frames to measure on, 60 to a second.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(10..=3000))]
    frames: u32,
}

const BEGIN: &str = "<!-- bench -->";
const END: &str = "<!-- /bench -->";

/// Measures, prints the tables, and puts them into README.md if asked.
pub fn run(arguments: &Arguments) -> Result<()> {
    setup::ensure(&[setup::LINKER])?;
    let directory = target_directory().join("bench-frames");
    let frames = arguments.frames.to_string();
    Task::cargo()
        .args(["run", "--release", "--package", "plumb", "--", "simulate", "--force"])
        .args(["--frames", &frames, "--out"])
        .args([&directory])
        .run()?;
    let bench = Task::cargo()
        .args(["bench", "--package", "plumb", "--bench", "frame", "--"])
        .args([&directory]);
    let plumbline = figures_of(bench)?;
    let opencv = if Task::new("python3").args(["-c", "import cv2, numpy"]).output().is_ok() {
        let script = root().join("host-tools/bench/opencv_chain.py");
        Some(figures_of(Task::new("python3").args([&script, &directory]))?)
    } else {
        println!("OpenCV is not compared: this machine's python3 has no cv2");
        None
    };
    // Half a gigabyte that nobody wants to find again.
    fs::remove_dir_all(&directory).context(format!("{}", directory.display()))?;
    let tables = tables(&plumbline, opencv.as_ref())?;
    println!("\n{tables}");
    if arguments.write_readme {
        let path = root().join("README.md");
        let readme = fs::read_to_string(&path).context("README.md")?;
        fs::write(&path, between_markers(&readme, &tables)?).context("README.md")?;
        println!("written to README.md");
    }
    Ok(())
}

type Figures = BTreeMap<String, String>;

fn figures_of(task: Task) -> Result<Figures> {
    let mut figures = Figures::new();
    task.run_and_read(|line| {
        if let Some((name, value)) = line.split_once('\t') {
            figures.insert(name.to_owned(), value.to_owned());
        }
    })?;
    Ok(figures)
}

fn get<'a>(figures: &'a Figures, name: &str) -> Result<&'a str> {
    figures.get(name).map(String::as_str).with_context(|| format!("the bench did not print {name}"))
}

/// `median / worst` in milliseconds.
fn times(figures: &Figures, run: &str) -> Result<String> {
    let ms = |which: &str| -> Result<f64> {
        Ok(get(figures, &format!("{run}_{which}_us"))?.parse::<f64>()? / 1e3)
    };
    Ok(format!("{:.3} / {:.3}", ms("median")?, ms("worst")?))
}

/// The targets' cells of the table of spreads, and the frames without a pose.
fn spreads(figures: &Figures, run: &str, targets: &[&str]) -> Result<String> {
    let mut cells = String::new();
    let mut lost = 0;
    for target in targets {
        let spread: f64 = get(figures, &format!("{run}_spread_mm:{target}"))?.parse()?;
        let _ = write!(cells, "{spread:.3} | ");
        lost += get(figures, &format!("{run}_lost:{target}"))?.parse::<u32>()?;
    }
    Ok(format!("{cells}{lost}"))
}

fn tables(plumbline: &Figures, opencv: Option<&Figures>) -> Result<String> {
    let mut text = String::new();
    let frames = get(plumbline, "frames")?;
    let compared = match opencv {
        Some(figures) => format!(", beside OpenCV {} in the same run", get(figures, "version")?),
        None => String::new(),
    };
    writeln!(text, "{frames} frames, one core of {}{compared}.\n", processor())?;

    let theirs =
        |run: &str| opencv.map_or(Ok("not measured".into()), |figures| times(figures, run));
    writeln!(text, "| both targets, ms per frame, median / worst | Plumbline | OpenCV |")?;
    writeln!(text, "|---|---:|---:|")?;
    for (what, run, opencv_run) in [
        ("**a tracked frame** (`step`)", "tracking", Some("warm")),
        ("its windows: corners, undistortion", "stage_windows", None),
        ("its fits: pose and covariance", "stage_fit", None),
        ("**a search of the whole frame** (`step`)", "search", Some("search")),
        ("its detector", "stage_detector", None),
        ("its grid finder", "stage_grid", None),
    ] {
        let theirs = opencv_run.map_or(Ok(String::new()), theirs)?;
        writeln!(text, "| {what} | {} | {theirs} |", times(plumbline, run)?)?;
    }

    let targets: Vec<&str> =
        plumbline.keys().filter_map(|name| name.strip_prefix("tracking_spread_mm:")).collect();
    ensure!(!targets.is_empty(), "the bench printed no spread");
    writeln!(
        text,
        "\n| depth of one frame against the truth, +-1.96 SD, mm | {} | poses missing |",
        targets.join(" | ")
    )?;
    writeln!(text, "|---|{}---:|", "---:|".repeat(targets.len()))?;
    writeln!(text, "| Plumbline, tracking | {} |", spreads(plumbline, "tracking", &targets)?)?;
    writeln!(text, "| Plumbline, search | {} |", spreads(plumbline, "search", &targets)?)?;
    if let Some(figures) = opencv {
        let window = get(figures, "warm_window_px")?;
        writeln!(
            text,
            "| OpenCV cornerSubPix (+-{window} px, its best) and solvePnP, warm | {} |",
            spreads(figures, "warm", &targets)?
        )?;
        writeln!(
            text,
            "| OpenCV remap, findChessboardCorners, cornerSubPix, solvePnP | {} |",
            spreads(figures, "search", &targets)?
        )?;
    }
    let bytes: usize = get(plumbline, "pipeline_bytes")?.parse()?;
    write!(
        text,
        "\nStatic memory of the core: {} KiB, undistortion table included ([memory.md](memory.md)).",
        bytes.div_ceil(1024)
    )?;
    Ok(text)
}

/// The processor's own name.
fn processor() -> String {
    let about = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = about.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    name.map_or_else(|| "this machine".into(), |(_, name)| name.trim().to_owned())
}

/// `text` with `tables` in place of what was between the markers.
fn between_markers(text: &str, tables: &str) -> Result<String> {
    let marked = text.split_once(BEGIN).and_then(|(before, rest)| {
        let (_, after) = rest.split_once(END)?;
        Some((before, after))
    });
    let (before, after) = marked.with_context(|| format!("README.md has no {BEGIN} ... {END}"))?;
    Ok(format!("{before}{BEGIN}\n{tables}\n{END}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_between_the_markers_changes() {
        let text = "before\n<!-- bench -->\nold\n<!-- /bench -->\nafter\n";
        let changed = between_markers(text, "new").unwrap();
        assert_eq!(changed, "before\n<!-- bench -->\nnew\n<!-- /bench -->\nafter\n");
        assert!(between_markers("no markers", "new").is_err());
    }

    #[test]
    fn a_figure_that_is_missing_is_named() {
        let error = tables(&Figures::new(), None).unwrap_err().to_string();
        assert!(error.contains("frames"), "{error}");
    }
}
