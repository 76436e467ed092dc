//! Measures the core on rendered frames; started by `cargo xtask bench`.
//!
//! `plumbline-bench DIRECTORY` reads the directory that `plumb simulate` has
//! written, with the configuration of `plumb provision` as `box.plb` beside it.
//! It prints one line per figure: name, tab, value.
//!
//! Times are those of the machine's clock. In an emulator whose clock advances by
//! one nanosecond per instruction they are instructions; there this program is the
//! only one, process 1, and the kernel ends the machine when it returns.

use std::env;
use std::fs;
use std::hint::black_box;
use std::path::Path;
use std::process::{self, ExitCode};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use plumbline::config::Config;
use plumbline::corner::{CornerList, Detector};
use plumbline::grid::{GridFinder, GridRejection};
use plumbline::image::GreyImage;
use plumbline::pipeline::Pipeline;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::Report;

/// Frames between two searches of the whole frame that are measured.
const SEARCH_EVERY: usize = 5;

/// A pose further from the truth than this is of something else.
const FALSE_MM: f64 = 20.0;

/// For so long after its start a kernel has work of its own left, which would share
/// the processor with what is measured.
const KERNEL_SETTLES_IN: Duration = Duration::from_secs(10);

fn main() -> ExitCode {
    if process::id() == 1 {
        thread::sleep(KERNEL_SETTLES_IN);
    }
    let done = measure();
    if let Err(error) = &done {
        eprintln!("error: {error:#}");
    }
    if process::id() == 1 {
        // With process 1 the machine ends; its console has not said everything yet.
        thread::sleep(Duration::from_secs(1));
    }
    if done.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn measure() -> Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [directory] = &arguments[..] else { bail!("usage: plumbline-bench DIRECTORY") };
    let bench = Bench::read(Path::new(directory))?;
    println!("frames\t{}", bench.frames.len());
    println!("pipeline_bytes\t{}", size_of::<Pipeline>());
    bench.tracking()?;
    bench.searching()?;
    bench.stages()
}

/// A recording with its truth, in memory, so that no file is read between frames.
struct Bench {
    config: Config,
    frames: Vec<Vec<u8>>,
    rate_hz: f64,
    /// Per frame: the pose of each target, in the order of the configuration.
    truth: Vec<Vec<Pose<Cam, Target>>>,
}

impl Bench {
    fn read(directory: &Path) -> Result<Self> {
        let open = |name: &str| {
            let path = directory.join(name);
            fs::File::open(&path).with_context(|| path.display().to_string())
        };
        let blob = fs::read(directory.join("box.plb")).context("box.plb")?;
        let config = Config::decode(&blob).context("box.plb")?;
        let (frames, rate_hz) = read_frames(open("frames.y4m")?).context("frames.y4m")?;
        let truth = read_truth(open("truth.csv")?, &config, frames.len()).context("truth.csv")?;
        Ok(Self { config, frames, rate_hz, truth })
    }

    fn view(&self, frame: usize) -> GreyImage<'_> {
        let (width, height) = (self.config.lens.width_px.into(), self.config.lens.height_px.into());
        GreyImage::new(&self.frames[frame], width, height, width).expect("a whole frame")
    }

    fn time_ns(&self, frame: usize) -> u64 {
        (frame as f64 * 1e9 / self.rate_hz) as u64
    }

    fn pipeline(&self) -> Result<Box<Pipeline>> {
        let mut pipeline = Box::new(Pipeline::new());
        pipeline.configure(&self.config)?;
        Ok(pipeline)
    }

    /// `step` while both targets are tracked.
    fn tracking(&self) -> Result<()> {
        let mut pipeline = self.pipeline()?;
        pipeline.step(&self.view(0), 0);
        let mut times = Vec::new();
        let mut errors = Errors::new(self);
        for frame in 1..self.frames.len() {
            let view = self.view(frame);
            let start = Instant::now();
            let report = pipeline.step(&view, self.time_ns(frame));
            times.push(start.elapsed());
            errors.add(frame, &report);
        }
        say_times("tracking", &mut times);
        errors.say("tracking");
        Ok(())
    }

    /// `step` when nothing is known of either target.
    fn searching(&self) -> Result<()> {
        let mut pipeline = self.pipeline()?;
        let mut times = Vec::new();
        let mut errors = Errors::new(self);
        for frame in (0..self.frames.len()).step_by(SEARCH_EVERY) {
            let view = self.view(frame);
            pipeline.forget();
            let start = Instant::now();
            let report = pipeline.step(&view, self.time_ns(frame));
            times.push(start.elapsed());
            errors.add(frame, &report);
        }
        say_times("search", &mut times);
        errors.say("search");
        Ok(())
    }

    /// The parts of `step`, on their own.
    fn stages(&self) -> Result<()> {
        let mut detector = Box::new(Detector::new());
        let mut corners = Box::new(CornerList::new());
        let mut finder = Box::new(GridFinder::new());
        let wanted: Vec<_> =
            self.config.targets.iter().map(|target| target.geometry.shape()).collect();
        let (mut detections, mut grids) = (Vec::new(), Vec::new());
        for frame in (0..self.frames.len()).step_by(SEARCH_EVERY) {
            let view = self.view(frame);
            corners.clear();
            let start = Instant::now();
            detector.detect(&view, 0..view.width(), 0..view.height(), &mut corners);
            detections.push(start.elapsed());
            let mut found: Vec<_> = wanted.iter().map(|_| Err(GridRejection::NoLattice)).collect();
            let start = Instant::now();
            finder.find(&view, corners.as_slice(), &wanted, &mut found);
            grids.push(start.elapsed());
        }
        say_times("stage_detector", &mut detections);
        say_times("stage_grid", &mut grids);
        Ok(())
    }
}

fn read_frames(file: fs::File) -> Result<(Vec<Vec<u8>>, f64)> {
    let mut decoder = y4m::decode(file)?;
    let rate = decoder.get_framerate();
    ensure!(decoder.get_bytes_per_sample() == 1, "the recording is not 8-bit");
    let mut frames = Vec::new();
    loop {
        match decoder.read_frame() {
            Ok(frame) => frames.push(frame.get_y_plane().to_vec()),
            Err(y4m::Error::EOF) => break,
            Err(error) => return Err(error.into()),
        }
    }
    ensure!(frames.len() > 1, "the recording has fewer than two frames");
    Ok((frames, rate.num as f64 / rate.den as f64))
}

/// Per frame: the pose of each target, in the order of the configuration.
fn read_truth(
    file: fs::File,
    config: &Config,
    frames: usize,
) -> Result<Vec<Vec<Pose<Cam, Target>>>> {
    const POSE: [&str; 6] = ["theta1_rad", "theta2_rad", "theta3_rad", "x_mm", "y_mm", "z_mm"];
    let mut rows = csv::Reader::from_reader(file);
    let header = rows.headers()?.clone();
    let column = |name: &str| {
        header.iter().position(|column| column == name).with_context(|| format!("no column {name}"))
    };
    let (frame, target) = (column("frame")?, column("target")?);
    let theta = POSE.map(column).into_iter().collect::<Result<Vec<_>>>()?;
    let mut truth = vec![vec![None; config.targets.len()]; frames];
    for row in rows.records() {
        let row = row?;
        let place = config.targets.iter().position(|one| one.name.as_str() == &row[target]);
        let of_frame = truth.get_mut(row[frame].parse::<usize>()?);
        let (Some(place), Some(of_frame)) = (place, of_frame) else { continue };
        let mut values = [0.0; 6];
        for (value, &column) in values.iter_mut().zip(&theta) {
            *value = row[column].parse()?;
        }
        of_frame[place] = Some(Pose::from_theta(values));
    }
    let whole = |poses: Vec<Option<_>>| poses.into_iter().collect::<Option<Vec<_>>>();
    truth.into_iter().map(whole).collect::<Option<_>>().context("a frame or target is missing")
}

/// Per target: depth errors, and frames without a (true) pose.
struct Errors<'a> {
    bench: &'a Bench,
    targets: Vec<(Vec<f64>, usize)>,
}

impl<'a> Errors<'a> {
    fn new(bench: &'a Bench) -> Self {
        Self { bench, targets: vec![(Vec::new(), 0); bench.config.targets.len()] }
    }

    fn add(&mut self, frame: usize, report: &Report) {
        let truth = &self.bench.truth[frame];
        for ((errors, lost), (target, truth)) in
            self.targets.iter_mut().zip(report.targets.iter().zip(truth))
        {
            let error_mm = target
                .measurement
                .as_ref()
                .map(|found| found.cam_from_target.translation_mm - truth.translation_mm);
            match error_mm {
                Ok(error_mm) if error_mm.norm() < FALSE_MM => errors.push(error_mm.z),
                _ => *lost += 1,
            }
        }
    }

    fn say(&self, run: &str) {
        for (target, (errors, lost)) in self.bench.config.targets.iter().zip(&self.targets) {
            let count = errors.len() as f64;
            let mean = errors.iter().sum::<f64>() / count;
            let variance = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / count;
            println!("{run}_spread_mm:{}\t{:.4}", target.name, 1.96 * variance.sqrt());
            println!("{run}_lost:{}\t{lost}", target.name);
        }
    }
}

fn say_times(what: &str, times: &mut [Duration]) {
    times.sort_unstable();
    let us = |time: Duration| time.as_secs_f64() * 1e6;
    println!("{what}_median_us\t{:.1}", us(times[times.len() / 2]));
    println!("{what}_worst_us\t{:.1}", us(times[times.len() - 1]));
}
