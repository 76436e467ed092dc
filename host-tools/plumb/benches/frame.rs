//! Measures the core on rendered frames of the standard scene; started by
//! `cargo xtask bench`.
//!
//! `cargo bench --package plumb --bench frame -- DIRECTORY FRAMES` prints one line
//! per figure (name, tab, value), and leaves the frames, the camera, the targets
//! and the true poses in DIRECTORY, for others to be measured on the same ones.

use std::env;
use std::fs::File;
use std::hint::black_box;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use heapless::String as Text;
use plumb::files::camera::{self, Camera, Provenance};
use plumb::files::poses::{PoseRow, Writer};
use plumb::files::targets;
use plumb::simulate::{Simulation, SimulationSettings};
use plumbline::config::{Config, Links, TargetConfig};
use plumbline::corner::{CornerList, Detector};
use plumbline::grid::GridFinder;
use plumbline::image::GreyImage;
use plumbline::measure::{Observations, Optics, fit_predicted, observe};
use plumbline::pipeline::Pipeline;
use plumbline::report::Report;
use plumbline::undistort::UndistortionLut;
use rayon::prelude::*;

/// Frames between two searches of the whole frame that are measured.
const SEARCH_EVERY: usize = 5;

/// A pose further from the truth than this is of something else.
const FALSE_MM: f64 = 20.0;

fn main() -> Result<()> {
    // `cargo bench` adds `--bench`; `cargo test --all-targets` gives no arguments at all.
    let arguments: Vec<String> = env::args().skip(1).filter(|one| one != "--bench").collect();
    let [directory, count] = &arguments[..] else {
        println!("usage: cargo bench --package plumb --bench frame -- DIRECTORY FRAMES");
        return Ok(());
    };
    let directory = PathBuf::from(directory);
    let count: u64 = count.parse().context("FRAMES must be a number")?;
    let bench = Bench::new(count)?;
    bench.leave_for_others(&directory)?;
    println!("frames\t{count}");
    println!("pipeline_bytes\t{}", size_of::<Pipeline>());
    bench.tracking()?;
    bench.searching()?;
    bench.stages()
}

struct Bench {
    simulation: Simulation,
    config: Config,
    frames: Vec<Vec<u8>>,
}

impl Bench {
    fn new(count: u64) -> Result<Self> {
        let simulation = Simulation::new(&SimulationSettings::default())?;
        let frames = (0..count).into_par_iter().map(|frame| {
            let mut samples = Vec::new();
            simulation.render(frame, &mut samples);
            samples
        });
        let frames = frames.collect();
        let config = config_of(&simulation);
        Ok(Self { simulation, config, frames })
    }

    fn names(&self) -> impl Iterator<Item = &'static str> {
        self.simulation.targets().iter().map(|target| target.layout.name)
    }

    fn view(&self, frame: usize) -> GreyImage<'_> {
        let (width, height) = (self.config.lens.width_px.into(), self.config.lens.height_px.into());
        GreyImage::new(&self.frames[frame], width, height, width).expect("a whole frame")
    }

    fn time_ns(&self, frame: usize) -> u64 {
        (frame as f64 * 1e9 / self.simulation.settings().frame_rate_hz) as u64
    }

    fn pipeline(&self) -> Result<Box<Pipeline>> {
        let mut pipeline = Box::new(Pipeline::new());
        pipeline.configure(&self.config).map_err(|error| anyhow::anyhow!("{error}"))?;
        Ok(pipeline)
    }

    fn leave_for_others(&self, directory: &Path) -> Result<()> {
        std::fs::create_dir_all(directory)?;
        let provenance =
            Provenance { source: Some("the simulation".into()), ..Provenance::default() };
        let camera = Camera { lens: self.config.lens, provenance };
        camera::write(&directory.join("camera.toml"), &camera)?;
        targets::write(&directory.join("targets.toml"), &targets::standard_pair())?;
        let mut truth = Writer::create(&directory.join("truth.csv"))?;
        let path = directory.join("frames.y4m");
        let mut video = BufWriter::new(File::create(&path).context(format!("{}", path.display()))?);
        let lens = &self.config.lens;
        writeln!(video, "YUV4MPEG2 W{} H{} F60:1 Ip Cmono", lens.width_px, lens.height_px)?;
        for (frame, pixels) in self.frames.iter().enumerate() {
            video.write_all(b"FRAME\n")?;
            video.write_all(pixels)?;
            let frame = frame as u64;
            let true_poses = self.simulation.truth(frame);
            for (name, target) in self.names().zip(&true_poses.targets) {
                let row = PoseRow::without_pose(frame, true_poses.time_s, name, "truth");
                truth.write(&row.with_pose(&target.cam_from_target))?;
            }
        }
        truth.flush()?;
        Ok(video.flush()?)
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
            errors.add(self, frame, &report);
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
            errors.add(self, frame, &report);
        }
        say_times("search", &mut times);
        errors.say("search");
        Ok(())
    }

    /// The parts of `step`, on their own.
    fn stages(&self) -> Result<()> {
        let lens = &self.config.lens;
        let mut lut = Box::new(UndistortionLut::new());
        lut.build(lens).map_err(|error| anyhow::anyhow!("{error}"))?;
        let optics = Optics { lens, lut: &lut };
        let mut observations = Observations::new();
        let (mut windows, mut fits) = (Vec::new(), Vec::new());
        for frame in 1..self.frames.len() {
            let view = self.view(frame);
            // As good as a prediction: the truth of one frame before.
            let expected = self.simulation.truth(frame as u64 - 1);
            let (mut window, mut fit) = (Duration::ZERO, Duration::ZERO);
            for (target, truth) in self.simulation.targets().iter().zip(&expected.targets) {
                let pose = &truth.cam_from_target;
                let start = Instant::now();
                observe(optics, &view, &target.geometry, pose, &mut observations);
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
            self.simulation.targets().iter().map(|target| target.geometry.shape()).collect();
        let (mut detections, mut grids) = (Vec::new(), Vec::new());
        for frame in (0..self.frames.len()).step_by(SEARCH_EVERY) {
            let view = self.view(frame);
            corners.clear();
            let start = Instant::now();
            detector.detect(&view, 0..view.width(), 0..view.height(), &mut corners);
            detections.push(start.elapsed());
            let mut found: Vec<_> =
                wanted.iter().map(|_| Err(plumbline::grid::GridRejection::NotFound)).collect();
            let start = Instant::now();
            finder.find(corners.as_slice(), &wanted, &mut found);
            grids.push(start.elapsed());
        }
        say_times("stage_detector", &mut detections);
        say_times("stage_grid", &mut grids);
        Ok(())
    }
}

fn config_of(simulation: &Simulation) -> Config {
    let targets = simulation.targets().iter().map(|target| TargetConfig {
        name: Text::try_from(target.layout.name).expect("the standard names are short"),
        geometry: target.geometry.clone(),
    });
    Config {
        device: Text::new(),
        serial_number: Text::new(),
        lens: *simulation.camera(),
        targets: targets.collect(),
        cam_from_scene_theta: None,
        links: Links::default(),
    }
}

/// Per target: depth errors, and frames without a (true) pose.
struct Errors {
    targets: Vec<(&'static str, Vec<f64>, usize)>,
}

impl Errors {
    fn new(bench: &Bench) -> Self {
        Self { targets: bench.names().map(|name| (name, Vec::new(), 0)).collect() }
    }

    fn add(&mut self, bench: &Bench, frame: usize, report: &Report) {
        let truth = bench.simulation.truth(frame as u64);
        for (place, (_, errors, lost)) in self.targets.iter_mut().enumerate() {
            let true_mm = truth.targets[place].cam_from_target.translation_mm;
            let error_mm = report.targets[place]
                .measurement
                .as_ref()
                .map(|found| found.cam_from_target.translation_mm - true_mm);
            match error_mm {
                Ok(error_mm) if error_mm.norm() < FALSE_MM => errors.push(error_mm.z),
                _ => *lost += 1,
            }
        }
    }

    fn say(&self, run: &str) {
        for (name, errors, lost) in &self.targets {
            let count = errors.len() as f64;
            let mean = errors.iter().sum::<f64>() / count;
            let variance = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / count;
            println!("{run}_spread_mm:{name}\t{:.4}", 1.96 * variance.sqrt());
            println!("{run}_lost:{name}\t{lost}");
        }
    }
}

fn say_times(what: &str, times: &mut [Duration]) {
    times.sort_unstable();
    let us = |time: Duration| time.as_secs_f64() * 1e6;
    println!("{what}_median_us\t{:.1}", us(times[times.len() / 2]));
    println!("{what}_worst_us\t{:.1}", us(times[times.len() - 1]));
}
