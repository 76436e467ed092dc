//! `cargo xtask bench`: measures the figures of README.md.
//!
//! `plumb simulate` renders the standard scene. On those frames `host-tools/bench/src/main.rs`
//! measures the core and, for comparison, the paper's chain; `host-tools/bench/opencv_chain.py`
//! measures OpenCV; and `host-tools/bench/limit.py` computes how good any method could be. All of
//! them print lines `name, tab, value`, which are turned into tables here. The core is also
//! measured on frames in other formats and, in instructions, on an emulated ARM board; `plumb` is
//! measured on recorded trials, and the box's program on a camera's frames.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};

use crate::command::{Task, root, target_directory};
use crate::generated::Part;
use crate::image::{self, DebianRoot};
use crate::tests::boot_with_camera;
use crate::{instructions, setup, toolchain};

mod boards;
mod calibration;
mod formats;
mod luma;
mod recordings;
mod stated;

/// The arguments of `cargo xtask bench`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Put the figures into README.md, between its markers.
    #[arg(long)]
    write_readme: bool,
    /// Rendered frames to measure on, 60 to a second.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(10..=3000))]
    frames: u32,
    /// Leave out what takes an emulated ARM board: instructions, and the booted box's latency.
    #[arg(long)]
    host_only: bool,
    /// Count only the instructions of the core, on an emulated ARM board.
    #[arg(long, conflicts_with_all = ["write_readme", "frames", "host_only"])]
    instructions_only: bool,
    /// Measure only how long `plumb` takes for recordings, and its memory.
    #[arg(long, conflicts_with_all = ["write_readme", "frames", "host_only", "instructions_only"])]
    recordings_only: bool,
    /// Measure only which checkerboards are found on photographs as people take them, beside
    /// OpenCV.
    #[arg(long, conflicts_with_all = ["write_readme", "frames", "host_only", "instructions_only", "recordings_only"])]
    boards_only: bool,
    /// The photographs of --boards-only.
    #[arg(long, default_value_t = 300, requires = "boards_only",
        value_parser = clap::value_parser!(u32).range(10..=10_000))]
    boards: u32,
    /// What the photographs of --boards-only are drawn from.
    #[arg(long, default_value_t = 1, requires = "boards_only")]
    seed: u32,
}

/// Measures, prints the tables, and puts them into README.md if asked.
pub fn run(arguments: &Arguments) -> Result<()> {
    toolchain::settle()?;
    if arguments.boards_only {
        println!("\n{}", boards::table(arguments.boards, arguments.seed)?.trim_end());
        return Ok(());
    }
    setup::ensure(&[setup::LINKER, setup::VIDEO])?;
    if arguments.recordings_only {
        println!("\n{}", recordings::table()?.trim_end());
        return Ok(());
    }
    let directory = target_directory().join("bench-frames");
    if arguments.instructions_only {
        let arm = count_instructions(&directory)?;
        arm.iter().filter(|(name, _)| name.ends_with("_median_us")).try_for_each(|(name, _)| {
            let run = name.trim_end_matches("_median_us");
            println!("{run}: {} million instructions", instructions(&arm, run)?);
            Ok(())
        })
    } else {
        measure_all(arguments, &directory)
    }
}

/// The core's instructions on an emulated ARM board, as times whose nanosecond is an instruction.
fn count_instructions(directory: &Path) -> Result<Figures> {
    setup::ensure(&[setup::QEMU_SYSTEM])?;
    render(directory, instructions::FRAMES, &[])?;
    let debian = DebianRoot::for_checks()?;
    let figures = figures_of(|each_line| instructions::count(&debian, directory, each_line))?;
    let thousands = |run: &str| anyhow::Ok(get(&figures, run)?.parse::<f64>()?);
    let (sealing, tracking) = (thousands("sealing_median_us")?, thousands("tracking_median_us")?);
    ensure!(
        sealing <= SEALING_SHARE_MAX * tracking,
        "to seal a packet takes {sealing} thousand instructions, more than {SEALING_SHARE_MAX} of a \
         tracked frame's {tracking}"
    );
    Ok(figures)
}

/// The most that sealing may take of a tracked frame.
const SEALING_SHARE_MAX: f64 = 0.05;

fn measure_all(arguments: &Arguments, directory: &Path) -> Result<()> {
    if !arguments.host_only {
        image::prepare_for_tests()?;
    }
    render(directory, arguments.frames, &[])?;
    let mut plumbline = measure(directory)?;
    plumbline.append(&mut limit(directory, &[])?);
    let opencv = opencv(directory)?;
    render(directory, arguments.frames, &BRISK_SWAY)?;
    let brisk = Brisk { plumbline: measure(directory)?, opencv: self::opencv(directory)? };
    let stated = stated::measure_all(directory, arguments.frames, &plumbline)?;
    let formats = formats::measure_all(directory, arguments.frames, &plumbline)?;
    let (recordings, calibrations, luma) =
        (recordings::table()?, calibration::table()?, luma::table()?);
    let (mut arm, mut booted) = (None, None);
    if !arguments.host_only {
        arm = Some(count_instructions(directory)?);
        booted = Some(figures_of(|each_line| boot_with_camera()?.run_and_read(each_line))?);
    }
    // Half a gigabyte that is of no further use.
    fs::remove_dir_all(directory).context(format!("{}", directory.display()))?;
    let mut tables = tables(&Measured { plumbline, opencv, brisk, stated, formats, arm, booted })?;
    for table in [luma, recordings, calibrations].iter().filter(|table| !table.is_empty()) {
        write!(tables, "\n\n{}", table.trim_end())?;
    }
    println!("\n{tables}");
    if arguments.write_readme {
        Part { document: "README.md", name: "bench" }.write(&tables)?;
    }
    Ok(())
}

type Figures = BTreeMap<String, String>;

/// Options of `plumb simulate`: a person who is not standing quietly, before a slow camera. The
/// shoulder's velocity has a standard deviation of 12 mm/s.
const BRISK_SWAY: [&str; 4] = ["--fps", "30", "--sway-mm", "14"];

/// What is measured with [`BRISK_SWAY`].
#[derive(Default)]
struct Brisk {
    plumbline: Figures,
    opencv: Option<Figures>,
}

/// All that goes into the tables.
#[derive(Default)]
struct Measured {
    plumbline: Figures,
    opencv: Option<Figures>,
    brisk: Brisk,
    stated: Vec<Figures>,
    formats: Vec<(String, Figures)>,
    arm: Option<Figures>,
    booted: Option<Figures>,
}

/// Renders the standard scene's recording, its ground truth, and a box's configuration; `options`
/// are further options of `plumb simulate`.
fn render(directory: &Path, frames: u32, options: &[&str]) -> Result<()> {
    let plumb = || Task::cargo().args(["run", "--release", "--package", "plumb", "--"]);
    let place = |name: &str| directory.join(name).display().to_string();
    plumb()
        .args(["simulate", "--force", "--frames", &frames.to_string(), "--out", &place("")])
        .args(options)
        .run()?;
    plumb()
        .args(["provision", "--force", "--camera", &place("camera.toml"), "--targets"])
        .args([place("targets.toml"), "--out".into(), place("box.plb")])
        .run()
}

/// The core's figures on the recording rendered into a directory.
fn measure(directory: &Path) -> Result<Figures> {
    let bench = Task::cargo()
        .args(["run", "--release", "--package", "plumbline-bench", "--"])
        .args([directory]);
    figures_of(|each_line| bench.run_and_read(each_line))
}

/// OpenCV's figures on that recording; `None` if Python lacks it.
fn opencv(directory: &Path) -> Result<Option<Figures>> {
    if !python_has("cv2, numpy") {
        println!("OpenCV is not compared: this machine's python3 has no cv2");
        return Ok(None);
    }
    let script = root().join("host-tools/bench/opencv_chain.py");
    let chain = Task::new("python3").args([&script, directory]);
    figures_of(|each_line| chain.run_and_read(each_line)).map(Some)
}

/// The Cramer-Rao bounds for the recording rendered into a directory; `options` are the relevant
/// options of `plumb simulate`. Empty if Python lacks the modules to compute them.
fn limit(directory: &Path, options: &[&str]) -> Result<Figures> {
    if !python_has("numpy, scipy") {
        println!("No Cramer-Rao bound: this machine's python3 has no numpy or no scipy");
        return Ok(Figures::new());
    }
    let script = root().join("host-tools/bench/limit.py");
    let bound = Task::new("python3").args([&script, directory]).args(options);
    figures_of(|each_line| bound.run_and_read(each_line))
}

/// Whether python3 has all of these modules.
fn python_has(modules: &str) -> bool {
    Task::new("python3").args(["-c", &format!("import {modules}")]).output().is_ok()
}

/// The figures that `run` prints as `name, tab, value`.
fn figures_of(run: impl FnOnce(&mut dyn FnMut(&str)) -> Result<()>) -> Result<Figures> {
    let mut figures = Figures::new();
    run(&mut |line| {
        if let Some((name, value)) = line.split_once('\t') {
            // A serial console ends its lines with a carriage return as well.
            figures.insert(name.to_owned(), value.trim_end().to_owned());
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

/// The median in millions of instructions, from figures whose nanoseconds are instructions.
fn instructions(figures: &Figures, run: &str) -> Result<String> {
    let thousands = get(figures, &format!("{run}_median_us"))?.parse::<f64>()?;
    Ok(format!("{:.2}", thousands / 1e3))
}

/// The Cramer-Rao bound of a target's depth, mm.
fn limit_mm(figures: &Figures, target: &str) -> Result<String> {
    let Some(bound) = figures.get(&format!("limit_mm:{target}")) else {
        return Ok("not calculated".into());
    };
    Ok(format!("{:.3}", bound.parse::<f64>()?))
}

/// The spread of a target's depth over its bound, in recordings with that bound, and the standard
/// deviation which that has by the number of frames.
fn share_of_bound(recordings: &[&Figures], target: &str) -> Result<String> {
    let [mut squares, mut frames] = [0.0; 2];
    for &figures in recordings {
        let Some(bound) = recordings[0].get(&format!("limit_mm:{target}")) else {
            return Ok("not calculated".into());
        };
        let spread: f64 = get(figures, &format!("tracking_spread_mm:{target}"))?.parse()?;
        let count: f64 = get(figures, "frames")?.parse()?;
        squares += count * (spread / bound.parse::<f64>()?).powi(2);
        frames += count;
    }
    let share = (squares / frames).sqrt();
    Ok(format!("{share:.2} +- {:.2}", share / (2.0 * frames).sqrt()))
}

/// The median of one run as a share of another's.
fn share(figures: &Figures, run: &str, of_figures: &Figures, of_run: &str) -> Result<String> {
    let median = |figures: &Figures, run: &str| -> Result<f64> {
        Ok(get(figures, &format!("{run}_median_us"))?.parse()?)
    };
    Ok(format!("{:.2}", median(figures, run)? / median(of_figures, of_run)?))
}

/// The cells for the targets in the table of spreads, and the number of frames without a pose.
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

fn tables(measured: &Measured) -> Result<String> {
    let Measured { plumbline, brisk, stated, formats, .. } = measured;
    let (opencv, arm) = (measured.opencv.as_ref(), measured.arm.as_ref());
    let mut text = String::new();
    let frames = get(plumbline, "frames")?;
    let compared = match opencv {
        Some(figures) => format!(", beside OpenCV {} in the same run", get(figures, "version")?),
        None => String::new(),
    };
    writeln!(text, "{frames} frames, one core of {}{compared}.", processor())?;
    if let Some(arm) = arm {
        writeln!(
            text,
            "Instructions: the median of {} frames on an emulated Cortex-A72, the kernel's interrupts included.",
            get(arm, "frames")?
        )?;
    }
    writeln!(text)?;

    let theirs =
        |run: &str| opencv.map_or(Ok("not measured".into()), |figures| times(figures, run));
    writeln!(
        text,
        "| both targets, ms per frame, median / worst | Plumbline | the paper's chain | OpenCV | million aarch64 instructions |"
    )?;
    writeln!(text, "|---|---:|---:|---:|---:|")?;
    for (what, run, opencv_run) in [
        ("**a tracked frame** (`step`)", "tracking", Some("warm")),
        ("its nodes, by the lens table", "lens_table", None),
        ("the same by the lens's model, for comparison", "lens_model", None),
        ("its light", "stage_light", None),
        ("its edges fitted to their pixels", "stage_fit", None),
        ("its poses solved", "stage_solve", None),
        ("its edges located first, where it is not where it was expected", "stage_locate", None),
        ("its packet sealed", "sealing", None),
        ("**a search of the whole frame** (`step`)", "search", Some("search")),
        ("its detector", "stage_detector", None),
        ("its grid finder", "stage_grid", None),
        ("its poses, from corners to fitted edges", "stage_acquire", None),
    ] {
        let papers = if run == "tracking" { times(plumbline, "paper")? } else { String::new() };
        let theirs = opencv_run.map_or(Ok(String::new()), theirs)?;
        let count = arm.map_or(Ok("not counted".into()), |figures| instructions(figures, run))?;
        writeln!(text, "| {what} | {} | {papers} | {theirs} | {count} |", times(plumbline, run)?)?;
    }
    writeln!(
        text,
        "| a tracked frame of brisk sway (12 mm/s SD) at 30 Hz | {} | {} | {} | |",
        times(&brisk.plumbline, "tracking")?,
        times(&brisk.plumbline, "paper")?,
        brisk.opencv.as_ref().map_or(Ok("not measured".into()), |theirs| times(theirs, "warm"))?,
    )?;
    if let Some(figures) = opencv {
        for (what, run, opencv_run) in [
            ("a tracked frame, share of OpenCV's (at most 0.25)", "tracking", "warm"),
            ("a search, share of OpenCV's (at most 0.25)", "search", "search"),
        ] {
            let share = share(plumbline, run, figures, opencv_run)?;
            writeln!(text, "| {what} | {share} | | 1 | |")?;
        }
    }
    if let Some(figures) = &brisk.opencv {
        let share = share(&brisk.plumbline, "tracking", figures, "warm")?;
        writeln!(
            text,
            "| a tracked frame of brisk sway, share of OpenCV's (at most 0.25) | {share} | | 1 | |"
        )?;
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
    let bounds: Result<Vec<_>> = targets.iter().map(|target| limit_mm(plumbline, target)).collect();
    writeln!(text, "| Cramer-Rao bound, for any method | {} | |", bounds?.join(" | "))?;
    writeln!(text, "| Plumbline, tracking | {} |", spreads(plumbline, "tracking", &targets)?)?;
    writeln!(text, "| Plumbline, search | {} |", spreads(plumbline, "search", &targets)?)?;
    let window = get(plumbline, "paper_window_px")?;
    writeln!(
        text,
        "| the paper's corners (+-{window} px, its best) and fit, from the true pose before | {} |",
        spreads(plumbline, "paper", &targets)?
    )?;
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
    writeln!(text, "{}", stated::rows(stated, &targets)?)?;
    write!(text, "\n{}", formats::table(formats, &targets)?)?;
    if let Some(figures) = &measured.booted {
        writeln!(
            text,
            "\nThe booted box, emulated at 500 million instructions per second and core, with a camera of 1280 x 720 at {} Hz: first pose packet {} s after the kernel's \
             start; from the camera's time stamp to the packet's departure {} ms, median / worst.",
            get(figures, "booted_rate_hz")?,
            get(figures, "booted_first_pose_s")?,
            times(figures, "booted_latency")?
        )?;
    }
    let bytes: usize = get(plumbline, "pipeline_bytes")?.parse()?;
    write!(
        text,
        "\nStatic memory of the core: {} KiB ([memory.md](memory.md)).",
        bytes.div_ceil(1024)
    )?;
    Ok(text)
}

/// The model name of the processor.
fn processor() -> String {
    let about = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = about.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    name.map_or_else(|| "this machine".into(), |(_, name)| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_that_is_missing_is_named() {
        let error = tables(&Measured::default()).unwrap_err().to_string();
        assert!(error.contains("frames"), "{error}");
    }

    #[test]
    fn a_share_of_the_bound_is_pooled_over_frames() {
        let of = |frames: &str, spread: &str| {
            Figures::from([
                ("frames".into(), frames.into()),
                ("tracking_spread_mm:lumbar".into(), spread.into()),
            ])
        };
        let (mut first, second) = (of("400", "0.6"), of("400", "0.8"));
        assert_eq!(share_of_bound(&[&first], "lumbar").unwrap(), "not calculated");
        first.insert("limit_mm:lumbar".into(), "0.5".into());
        // The root of (1.2^2 + 1.6^2) / 2, and of 1 / 1600 of it.
        assert_eq!(share_of_bound(&[&first, &second], "lumbar").unwrap(), "1.41 +- 0.04");
    }

    #[test]
    fn a_nanosecond_of_the_emulated_clock_is_an_instruction() {
        let figures = figures_of(|each_line| {
            ["a kernel's message", "tracking_median_us\t2345.6\r"].into_iter().for_each(each_line);
            Ok(())
        });
        assert_eq!(instructions(&figures.unwrap(), "tracking").unwrap(), "2.35");
    }
}
