//! Measures the core on rendered frames; started by `cargo xtask bench`.
//!
//! `cargo bench --package plumb --bench frame -- DIRECTORY` reads what `plumb
//! simulate --out DIRECTORY` has written, and prints one line per figure: name,
//! tab, value.

use std::env;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use plumb::files::{camera, frames, poses, targets};
use plumb::setup::{self, Places};
use plumbline::config::Config;
use plumbline::corner::{CornerList, Detector};
use plumbline::grid::{GridFinder, GridRejection};
use plumbline::image::GreyImage;
use plumbline::measure::{Observations, Optics, fit_predicted, observe};
use plumbline::pipeline::Pipeline;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::Report;
use plumbline::undistort::UndistortionLut;

/// Frames between two searches of the whole frame that are measured.
const SEARCH_EVERY: usize = 5;

/// A pose further from the truth than this is of something else.
const FALSE_MM: f64 = 20.0;

fn main() -> Result<()> {
    // `cargo bench` adds `--bench`; `cargo test --all-targets` gives no arguments at all.
    let arguments: Vec<String> = env::args().skip(1).filter(|one| one != "--bench").collect();
    let [directory] = &arguments[..] else {
        println!("usage: cargo bench --package plumb --bench frame -- DIRECTORY");
        return Ok(());
    };
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
        let [camera, targets, truth, video] =
            ["camera.toml", "targets.toml", "truth.csv", "frames.y4m"]
                .map(|name| directory.join(name));
        let places = Places {
            camera: camera.display().to_string(),
            targets: targets.display().to_string(),
            scene: String::new(),
            settings: String::new(),
        };
        let config =
            setup::config(&camera::read(&camera)?, &targets::read(&targets)?, None, &places)?;
        let (frames, rate_hz) = read_frames(video)?;
        let rows = poses::read(&truth)?;
        let pose = |frame: usize, name: &str| {
            let row = rows.iter().find(|row| row.frame == frame as u64 && row.target == name);
            row.and_then(|row| row.cam_from_target())
                .with_context(|| format!("{}: no {name} in frame {frame}", truth.display()))
        };
        let poses_of =
            |frame| config.targets.iter().map(|target| pose(frame, &target.name)).collect();
        let truth = (0..frames.len()).map(poses_of).collect::<Result<_>>()?;
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
        let lens = &self.config.lens;
        let mut lut = Box::new(UndistortionLut::new());
        lut.build(lens)?;
        let optics = Optics { lens, lut: &lut };
        let mut observations = Observations::new();
        let (mut windows, mut fits) = (Vec::new(), Vec::new());
        for frame in 1..self.frames.len() {
            let view = self.view(frame);
            // As good as a prediction: the truth of one frame before.
            let expected = &self.truth[frame - 1];
            let (mut window, mut fit) = (Duration::ZERO, Duration::ZERO);
            for (target, pose) in self.config.targets.iter().zip(expected) {
                let start = Instant::now();
                observe(optics, &view, &target.geometry, true, pose, &mut observations);
                window += start.elapsed();
                let start = Instant::now();
                let _ = black_box(fit_predicted(pose, &target.geometry, &observations));
                fit += start.elapsed();
            }
            windows.push(window);
            fits.push(fit);
        }
        say_times("stage_windows", &mut windows);
        say_times("stage_fit", &mut fits);

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

fn read_frames(video: PathBuf) -> Result<(Vec<Vec<u8>>, f64)> {
    let mut source = frames::FrameSource::open(&[video], None)?;
    let rate_hz = source.rate_hz();
    let mut all = Vec::new();
    while let Some(frame) = source.next_frame()? {
        let frames::Pixels::Grey8(pixels) = frame.pixels else {
            bail!("the recording is not 8-bit")
        };
        all.push(pixels.to_vec());
    }
    ensure!(all.len() > 1, "the recording has fewer than two frames");
    Ok((all, rate_hz))
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
