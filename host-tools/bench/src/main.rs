//! Measures the core on rendered frames; started by `cargo xtask bench`.
//!
//! `plumbline-bench DIRECTORY` reads the directory that `plumb simulate` has
//! written, with the configuration of `plumb provision` as `box.plb` beside it.
//! It prints one line per figure: name, tab, value.
//!
//! Times are those of the machine's clock. In an emulator whose clock advances by one nanosecond
//! per instruction, they count instructions; there this program is the only one, process 1, and the
//! kernel stops the machine when it exits.

use std::env;
use std::fs;
use std::hint::black_box;
use std::io::Read;
use std::ops::RangeInclusive;
use std::path::Path;
use std::process::{self, ExitCode};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use nalgebra::Vector3;
use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::lens_table::LensTable;
use plumbline::packet::{MarkedInstant, Message, PosePacket, SCHEMA_HASH, Start};
use plumbline::pipeline::{Measurable, Pipeline};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::Report;
use plumbline::seal::{Key, OneWay, SEALED_BYTES_MAX, StreamSealer};

mod paper;
mod stages;

/// One frame in this many is searched as a whole, and the search timed.
const SEARCH_EVERY: usize = 5;

/// A pose farther from the truth than this belongs to something else.
const FALSE_MM: f64 = 20.0;

/// Half widths of the windows that are tried for the paper's step.
const PAPER_WINDOWS_PX: RangeInclusive<usize> = 3..=10;

/// How long after its start a kernel may still have work of its own, which would share the
/// processor with what is measured.
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
        // The machine stops when process 1 exits; its console must finish its output first.
        thread::sleep(Duration::from_secs(1));
    }
    if done.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn measure() -> Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [directory] = &arguments[..] else { bail!("usage: plumbline-bench DIRECTORY") };
    let directory = Path::new(directory);
    let path = directory.join("frames.y4m");
    let file = fs::File::open(&path).with_context(|| path.display().to_string())?;
    let mut video = y4m::decode(file).context("frames.y4m")?;
    match video.get_bytes_per_sample() {
        1 => Bench::read(directory, &mut video, <[u8]>::to_vec)?.measure(),
        _ => Bench::read(directory, &mut video, words)?.measure(),
    }
}

/// The 16-bit samples of a plane.
fn words(plane: &[u8]) -> Vec<u16> {
    plane.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect()
}

/// A recording with its truth, in memory, so that no file is read between frames.
struct Bench<P> {
    config: Config,
    lens: Box<LensTable>,
    frames: Vec<Vec<P>>,
    white_level: u16,
    rate_hz: f64,
    /// Per frame: the pose of each target, in the order of the configuration.
    truth: Vec<Vec<Pose<Cam, Target>>>,
}

impl<P: Measurable> Bench<P> {
    /// `samples` extracts the samples from a plane's bytes.
    fn read(
        directory: &Path,
        video: &mut y4m::Decoder<impl Read>,
        samples: fn(&[u8]) -> Vec<P>,
    ) -> Result<Self> {
        let blob = fs::read(directory.join("box.plb")).context("box.plb")?;
        let config = Config::decode(&blob).context("box.plb")?;
        let rate = video.get_framerate();
        let frames = read_frames(video, samples).context("frames.y4m")?;
        let path = directory.join("truth.csv");
        let truth = fs::File::open(&path).with_context(|| path.display().to_string())?;
        let truth = read_truth(truth, &config, frames.len()).context("truth.csv")?;
        let mut lens = Box::new(LensTable::new());
        lens.fill(&config.lens)?;
        Ok(Self {
            config,
            lens,
            frames,
            white_level: (1 << video.get_bit_depth()) - 1,
            rate_hz: rate.num as f64 / rate.den as f64,
            truth,
        })
    }

    fn measure(&self) -> Result<()> {
        println!("frames\t{}", self.frames.len());
        println!("pipeline_bytes\t{}", size_of::<Pipeline>());
        self.tracking()?;
        self.searching()?;
        self.paper();
        stages::measure(self)
    }

    fn view(&self, frame: usize) -> GreyImage<'_, P> {
        let (width, height) = (self.config.lens.width_px.into(), self.config.lens.height_px.into());
        GreyImage::with_white_level(&self.frames[frame], width, height, width, self.white_level)
            .expect("a whole frame")
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
        let (mut times, mut sealing) = (Vec::new(), Vec::new());
        let mut errors = Errors::new(&self.config);
        let mut seal = sealer()?;
        for frame in 1..self.frames.len() {
            let view = self.view(frame);
            let start = Instant::now();
            let report = pipeline.step(&view, self.time_ns(frame));
            times.push(start.elapsed());
            errors.add(&self.truth[frame], positions(&report));
            let packet = PosePacket::from_report(&report, MarkedInstant::ExposureMiddle, 0);
            let message = Message::Pose(packet);
            let start = Instant::now();
            seal.seal(black_box(&message), &mut [0; SEALED_BYTES_MAX])?;
            sealing.push(start.elapsed());
        }
        say_times("tracking", &mut times);
        say_times("sealing", &mut sealing);
        errors.say("tracking");
        Ok(())
    }

    /// `step` when nothing is known of either target.
    fn searching(&self) -> Result<()> {
        let mut pipeline = self.pipeline()?;
        let mut times = Vec::new();
        let mut errors = Errors::new(&self.config);
        for frame in (0..self.frames.len()).step_by(SEARCH_EVERY) {
            let view = self.view(frame);
            pipeline.forget();
            let start = Instant::now();
            let report = pipeline.step(&view, self.time_ns(frame));
            times.push(start.elapsed());
            errors.add(&self.truth[frame], positions(&report));
        }
        say_times("search", &mut times);
        errors.say("search");
        Ok(())
    }

    /// The published baseline while both targets are tracked, with the window that gives the least
    /// spread of those tried.
    fn paper(&self) {
        let runs = PAPER_WINDOWS_PX.map(|radius_px| {
            let (times, errors) = self.paper_run(radius_px);
            (radius_px, times, errors)
        });
        let best = runs.min_by(|(.., one), (.., other)| one.spread().total_cmp(&other.spread()));
        let (radius_px, mut times, errors) = best.expect("at least one window");
        println!("paper_window_px\t{radius_px}");
        say_times("paper", &mut times);
        errors.say("paper");
    }

    fn paper_run(&self, radius_px: usize) -> (Vec<Duration>, Errors<'_>) {
        let mut times = Vec::new();
        let mut errors = Errors::new(&self.config);
        for frame in 1..self.frames.len() {
            let (view, lens) = (self.view(frame), &*self.lens);
            let targets = self.config.targets.iter().zip(&self.truth[frame - 1]);
            let start = Instant::now();
            let poses: Vec<_> = targets
                .map(|(target, before)| {
                    let pose = paper::pose(&view, lens, &target.geometry, before, radius_px)?;
                    Some(Found { position_mm: pose.translation_mm, sd_mm: None })
                })
                .collect();
            times.push(start.elapsed());
            errors.add(&self.truth[frame], poses);
        }
        (times, errors)
    }
}

/// What seals a box's packets.
fn sealer() -> Result<StreamSealer> {
    let key = Key::new([1; 32])?;
    let start = OneWay {
        key_id: key.id(),
        start: Start::MIN,
        start_count: 1,
        schema_hash: SCHEMA_HASH,
        salt: [2; 16],
        next: 0,
    };
    Ok(StreamSealer::one_way(&key, &start))
}

/// The positions that a report holds.
fn positions(report: &Report) -> impl Iterator<Item = Option<Found>> + '_ {
    report.targets.iter().map(|target| {
        let found = target.measurement.as_ref().ok()?;
        let position_mm = found.cam_from_target.translation_mm;
        Some(Found { position_mm, sd_mm: Some(found.sd_mm()) })
    })
}

fn read_frames<P>(
    video: &mut y4m::Decoder<impl Read>,
    samples: fn(&[u8]) -> Vec<P>,
) -> Result<Vec<Vec<P>>> {
    let mut frames = Vec::new();
    loop {
        match video.read_frame() {
            Ok(frame) => frames.push(samples(frame.get_y_plane())),
            Err(y4m::Error::EOF) => break,
            Err(error) => return Err(error.into()),
        }
    }
    ensure!(frames.len() > 1, "the recording has fewer than two frames");
    Ok(frames)
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

/// A position in the camera's frame that was found, and its standard deviations where a method
/// states any.
struct Found {
    position_mm: Vector3<f64>,
    sd_mm: Option<Vector3<f64>>,
}

/// One target's errors.
#[derive(Clone, Default)]
struct TargetErrors {
    /// Found minus true position in the camera's frame.
    mm: Vec<Vector3<f64>>,
    /// The same in stated standard deviations.
    in_sd: Vec<Vector3<f64>>,
    /// The number of frames without a (true) pose.
    lost: usize,
}

/// The errors of each target.
struct Errors<'a> {
    config: &'a Config,
    targets: Vec<TargetErrors>,
}

impl<'a> Errors<'a> {
    fn new(config: &'a Config) -> Self {
        Self { config, targets: vec![TargetErrors::default(); config.targets.len()] }
    }

    fn add(&mut self, truth: &[Pose<Cam, Target>], found: impl IntoIterator<Item = Option<Found>>) {
        for (errors, (found, truth)) in self.targets.iter_mut().zip(found.into_iter().zip(truth)) {
            let error_mm = |found: &Found| (found.position_mm - truth.translation_mm, found.sd_mm);
            match found.as_ref().map(error_mm) {
                Some((error_mm, sd_mm)) if error_mm.norm() < FALSE_MM => {
                    errors.mm.push(error_mm);
                    errors.in_sd.extend(sd_mm.map(|sd_mm| error_mm.component_div(&sd_mm)));
                }
                _ => errors.lost += 1,
            }
        }
    }

    /// The spread of the depth, summed over all targets.
    fn spread(&self) -> f64 {
        self.targets.iter().map(|errors| mean_and_spread(&errors.mm)[1].z).sum()
    }

    /// Prints the figures; those of the depth have no axis in their name.
    fn say(&self, run: &str) {
        for (target, errors) in self.config.targets.iter().zip(&self.targets) {
            let (name, lost) = (&target.name, errors.lost);
            let [mean, spread] = mean_and_spread(&errors.mm);
            println!("{run}_spread_mm:{name}\t{:.4}", spread.z);
            println!("{run}_spread_x_mm:{name}\t{:.4}", spread.x);
            println!("{run}_spread_y_mm:{name}\t{:.4}", spread.y);
            println!("{run}_bias_mm:{name}\t{:.4}", mean.z);
            println!("{run}_lost:{name}\t{lost}");
            if !errors.in_sd.is_empty() {
                let squares = errors.in_sd.iter().map(|error| error.z * error.z).sum::<f64>();
                let rms = (squares / errors.in_sd.len() as f64).sqrt();
                println!("{run}_normalised:{name}\t{rms:.3}");
            }
        }
    }
}

/// Mean and spread along each axis; the spread is 1.96 standard deviations.
fn mean_and_spread(errors: &[Vector3<f64>]) -> [Vector3<f64>; 2] {
    let count = errors.len() as f64;
    let mean = errors.iter().sum::<Vector3<f64>>() / count;
    let squares = errors.iter().map(|error| (error - mean).map(|value| value * value));
    [mean, (squares.sum::<Vector3<f64>>() / count).map(f64::sqrt) * 1.96]
}

fn say_times(what: &str, times: &mut [Duration]) {
    times.sort_unstable();
    let us = |time: Duration| time.as_secs_f64() * 1e6;
    println!("{what}_median_us\t{:.1}", us(times[times.len() / 2]));
    println!("{what}_worst_us\t{:.1}", us(times[times.len() - 1]));
}
