//! `plumb track`: the box's pipeline over recorded frames.

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::report::GridRejection;
use plumbline::report::{NoPose, Report};
use plumbline_analysis::statistics::describe::median;
use plumbline_bedside::draw;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_files::frames::FrameSource;
use plumbline_files::poses::{PoseRow, Writer};
use plumbline_files::{camera, refuse_overwriting};
use plumbline_tracking::Tracker;

use crate::arguments::DescriptionArguments;
use crate::ui::png;
use crate::ui::progress::Progress;
use crate::ui::waiting;

/// Track the targets in recorded frames and write their poses.
///
/// Runs the very pipeline of the box over files. INPUT is one or more Y4M
/// videos, or images (PNG, JPEG, PGM) in the order given, or - for a Y4M on
/// standard input. The poses come out as CSV, one row per frame and target:
/// Euler angles (radians) and position (millimetres) in the camera frame, their
/// standard deviations, the reprojection error, the corners used. Without a pose
/// the numbers are empty and the column `state` says why. With --scene, ap_mm,
/// ml_mm, si_mm hold the trunk point that the target carries.
///
/// A summary goes to standard error. Exit code 0: done; 2: an input could not be
/// used (rows written before that stay).
#[derive(clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:
  plumb track --camera camera.toml --targets targets.toml --out poses.csv trial.y4m
  plumb track --camera left_intrinsics.yml --targets board.toml --independent photos/*.jpg
  ffmpeg -i trial.mp4 -pix_fmt gray -strict -1 -f yuv4mpegpipe - | plumb track --camera camera.toml --targets targets.toml -"
)]
pub struct Arguments {
    #[command(flatten)]
    descriptions: DescriptionArguments,
    /// Search every image afresh, for photographs that do not follow each other. The frame may cut
    /// the squares around a target whose corners are all seen.
    #[arg(long)]
    independent: bool,
    /// Frames per second; otherwise from the Y4M header, and 30 for images.
    #[arg(long, value_name = "RATE")]
    fps: Option<f64>,
    /// Use a calibration made at another size: the frames are the same picture resampled.
    #[arg(long)]
    scale_camera: bool,
    /// Print the median and the worst time of the pipeline per frame.
    #[arg(long)]
    timing: bool,
    /// Write the CSV here instead of to standard output.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the file of --out if it exists.
    #[arg(long, requires = "out")]
    force: bool,
    /// Write each frame as PNG into this directory, with what was found drawn in.
    #[arg(long, value_name = "DIR")]
    draw: Option<PathBuf>,
    /// Y4M videos or images, in order; - is standard input.
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
}

/// Runs the subcommand.
///
/// # Errors
/// When an input cannot be used or an output cannot be written; the rows of all
/// frames before that have been written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let descriptions = arguments.descriptions.descriptions();
    let places = descriptions.places();
    let (mut camera, targets, scene) = descriptions.read(&mut waiting::shown())?;
    let mut source = FrameSource::open(&arguments.inputs, arguments.fps)?;
    if arguments.scale_camera {
        camera = camera::scaled(&camera, source.width(), source.height(), &places.camera)?;
    }
    // Only here can it be scaled.
    let size = [source.width(), source.height()];
    camera::check_frame_size(&camera.lens, &places.camera, size[0], size[1], source.place())
        .map_err(|mut error| {
            error.remedy += ", or --scale-camera if these frames are the same picture resampled";
            error
        })?;
    let files = (&camera, &targets, scene.as_ref());
    let (config, mut tracker) = Tracker::of_source(&source, arguments.independent, files, &places)?;

    let mut rows = poses_writer(arguments)?;
    if let Some(directory) = &arguments.draw {
        plumbline_files::make_directory(directory)?;
    }
    let mut summary = Summary::new(&config);
    // Rows on the same terminal would tear the bar apart.
    let is_shown = arguments.out.is_some() || !std::io::stdout().is_terminal();
    let progress = Progress::new(source.count_hint(), is_shown);
    let outcome =
        track(arguments, &config, &mut source, &mut tracker, &mut rows, &mut |report, time| {
            summary.add(report, time);
            progress.advance();
        });
    progress.finish();
    if let Err(error) = &outcome
        && error.downcast_ref::<BadInput>().is_some_and(BadInput::is_closed_pipe)
    {
        // The reader has seen enough, as `head` does.
        return Ok(());
    }
    let other_dimensions = summary.other_dimensions(&config, &places.targets);
    summary.print(&source, arguments.timing);
    if !arguments.independent && source.pictures() > 1 && summary.is_often_lost() {
        eprintln!(
            "warning: the pictures are taken as a recording, in which each follows the one before, \
             and targets are missing in many; if they are photographs that do not follow each \
             other, give --independent"
        );
    }
    outcome?;
    match other_dimensions {
        Some(error) => Err(error.into()),
        None => Ok(()),
    }
}

fn poses_writer(arguments: &Arguments) -> Result<Writer<Box<dyn Write>>, BadInput> {
    let Some(path) = &arguments.out else {
        return Ok(Writer::new(Box::new(std::io::stdout()), "standard output"));
    };
    let place = path.display().to_string();
    refuse_overwriting(
        path,
        arguments.descriptions.descriptions().paths().chain(&arguments.inputs),
    )?;
    let file = plumbline_files::create(path, arguments.force)?;
    Ok(Writer::new(Box::new(file), place))
}

/// Tracks every frame: writes its rows, and passes its report and the time of the step to
/// `seen`.
fn track(
    arguments: &Arguments,
    config: &Config,
    source: &mut FrameSource,
    tracker: &mut Tracker,
    rows: &mut Writer<Box<dyn Write>>,
    seen: &mut dyn FnMut(&Report, Duration),
) -> anyhow::Result<()> {
    while let Some(frame) = source.next_frame()? {
        let started = Instant::now();
        let report = tracker.step(&frame);
        seen(&report, started.elapsed());
        for row in PoseRow::of_report(config, frame.index, &report) {
            rows.write(&row)?;
        }
        rows.flush()?;
        if let Some(directory) = &arguments.draw {
            let path = directory.join(format!("frame_{:06}.png", frame.index));
            png::write(&path, &draw::annotated(&frame, config, &report))?;
        }
    }
    Ok(())
}

/// Why there is no pose when a target's columns or rows are wrong.
const OTHER_DIMENSIONS: NoPose = NoPose::NotFound(GridRejection::OtherDimensions);

/// In a recording, a target is found in more than this part of the frames: it is lost for some
/// where it is covered, and searched for in some at the beginning.
const FOUND_USUALLY: f64 = 0.9;

/// The summary at the end.
struct Summary {
    frames: u64,
    step_times: Vec<Duration>,
    targets: Vec<TargetSummary>,
}

struct TargetSummary {
    name: String,
    rms_px: Vec<f64>,
    /// Frames without a pose, by reason.
    missing: BTreeMap<&'static str, u64>,
}

impl Summary {
    fn new(config: &Config) -> Self {
        let targets = config.targets.iter().map(|target| TargetSummary {
            name: target.name.to_string(),
            rms_px: Vec::new(),
            missing: BTreeMap::new(),
        });
        Self { frames: 0, step_times: Vec::new(), targets: targets.collect() }
    }

    fn add(&mut self, report: &Report, time: Duration) {
        self.frames += 1;
        self.step_times.push(time);
        for (target, found) in self.targets.iter_mut().zip(&report.targets) {
            match &found.measurement {
                Ok(measured) => target.rms_px.push(measured.rms_px),
                Err(reason) => *target.missing.entry(reason.words()).or_default() += 1,
            }
        }
    }

    /// Whether a target is missing so often that the frames may not follow each other.
    fn is_often_lost(&self) -> bool {
        let found = |target: &TargetSummary| target.rms_px.len() as f64 / self.frames.max(1) as f64;
        self.targets.iter().any(|target| found(target) < FOUND_USUALLY)
    }

    /// The error for a target that no frame shows although checkerboards of other sizes are
    /// there: its columns and rows are wrong.
    fn other_dimensions(&self, config: &Config, targets_file: &str) -> Option<BadInput> {
        let wrong = |target: &TargetSummary| {
            let most = target.missing.iter().max_by_key(|(_, count)| **count);
            target.rms_px.is_empty()
                && most.is_some_and(|(reason, _)| *reason == OTHER_DIMENSIONS.words())
        };
        let (target, configured) =
            self.targets.iter().zip(&config.targets).find(|(target, _)| wrong(target))?;
        let shape = configured.geometry.shape();
        Some(BadInput::new(
            targets_file,
            format!("columns, rows of target \"{}\"", target.name),
            format!(
                "no frame shows {} x {} inner corners; the checkerboards that are seen have other columns and rows",
                shape.columns, shape.rows
            ),
            "count the INNER corners, where four squares meet; --draw DIR shows the frames as the tracker sees them",
        ))
    }

    fn print(&self, source: &FrameSource, timing: bool) {
        let frames = counted(self.frames, "frame");
        eprintln!("{frames} of {} x {} px", source.width(), source.height());
        for target in &self.targets {
            let found = target.rms_px.len();
            let mut line = format!("{}: found in {found} of {frames}", target.name);
            if let Some(rms_px) = median(target.rms_px.iter().copied()) {
                line += &format!(", median reprojection RMS {rms_px:.3} px");
            }
            let reasons: Vec<String> =
                target.missing.iter().map(|(reason, count)| format!("{reason} {count}")).collect();
            if !reasons.is_empty() {
                line += &format!("; not found: {}", reasons.join(", "));
            }
            eprintln!("{line}");
        }
        let times_ms = || self.step_times.iter().map(|time| time.as_secs_f64() * 1e3);
        if let Some(median_ms) = median(times_ms())
            && timing
        {
            let worst_ms = times_ms().fold(0.0, f64::max);
            eprintln!("step: median {median_ms:.3} ms, worst {worst_ms:.3} ms per frame");
        }
    }
}
