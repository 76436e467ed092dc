//! `plumb calibrate --readout`: the readout of a rolling shutter, from a video.

use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};
use plumbline::image::GreyImage;
use plumbline::lens_table::LensTable;
use plumbline_bedside::calibration::{board, in_8_bits};
use plumbline_calibration::flicker::{self, Row};
use plumbline_calibration::observe::Finder;
use plumbline_calibration::readout::{self, FRAMES_MIN, Failure, Observed, Readout};
use plumbline_files::BadInput;
use plumbline_files::camera::{self, Camera, check_frame_size};
use plumbline_files::counting::counted;
use plumbline_files::frames::FrameSource;
use rayon::prelude::*;

use super::{Arguments, printed};

/// What more frames would add is far less than what they cost.
const FRAMES_MAX: usize = 1200;

/// The number of frames in memory for each processor.
const BATCH_PER_CORE: usize = 2;

/// Runs the subcommand for the camera of this file.
///
/// # Errors
/// When an input cannot be used, the video does not show the readout, or the output cannot be
/// written.
pub fn run(arguments: &Arguments, camera_path: &Path) -> anyhow::Result<()> {
    let camera = camera::read(camera_path)?;
    let place = camera_path.display().to_string();
    if camera::is_stand_in(&camera.lens) {
        return Err(plumbline_bedside::setup::not_calibrated(&place).into());
    }
    let video = Video::open(arguments, &camera, &place)?;
    let readout = match arguments.flicker_hz {
        Some(flicker_hz) => by_flicker(video, flicker_hz)?,
        None => by_board(arguments, video, &camera)?,
    };
    let measured = camera_with(camera, &readout);
    let output = (arguments.out.clone(), camera::to_toml(&measured).into_bytes());
    plumbline_files::write_all(&[output], arguments.force)?;
    print(&readout);
    eprintln!("written to {}", arguments.out.display());
    Ok(())
}

/// The frames of a video, one batch after the other.
struct Video {
    source: FrameSource,
    bar: ProgressBar,
    frames: usize,
}

impl Video {
    fn open(arguments: &Arguments, camera: &Camera, place: &str) -> Result<Self, BadInput> {
        let source = FrameSource::open(&arguments.images, arguments.fps)?;
        if !source.has_rate() {
            return Err(BadInput::whole(
                source.place(),
                "a photograph, and photographs do not tell when they were taken",
                "give a Y4M video; if these are the frames of one, say its rate with --fps",
            ));
        }
        let (width, height) = (source.width(), source.height());
        check_frame_size(&camera.lens, place, width, height, source.place())?;
        let style = ProgressStyle::with_template("searching {wide_bar} {pos}/{len} frames")
            .expect("a template that is right");
        let length = source.count_hint().map(|count| count.min(FRAMES_MAX as u64));
        Ok(Self { source, bar: ProgressBar::new(length.unwrap_or(0)).with_style(style), frames: 0 })
    }

    fn interval_s(&self) -> f64 {
        1.0 / self.source.rate_hz()
    }

    /// The next frames, in 8 bits; none after the last.
    fn batch(&mut self) -> Result<Vec<Vec<u8>>, BadInput> {
        let mut batch = Vec::new();
        while batch.len() < BATCH_PER_CORE * rayon::current_num_threads() {
            if self.frames == FRAMES_MAX {
                break;
            }
            let Some(frame) = self.source.next_frame()? else { break };
            batch.push(in_8_bits(&frame));
            self.frames += 1;
        }
        self.bar.inc(batch.len() as u64);
        Ok(batch)
    }

    /// What `look` sees in each frame.
    fn each<T: Send>(
        &mut self,
        look: impl Fn(&mut Finder, &GreyImage<'_, u8>) -> T + Sync,
    ) -> Result<Vec<T>, BadInput> {
        let (width, height) = (self.source.width(), self.source.height());
        let mut seen = Vec::new();
        loop {
            let batch = self.batch()?;
            if batch.is_empty() {
                break;
            }
            let look = |finder: &mut Finder, samples: &Vec<u8>| {
                let image = GreyImage::new(samples, width, height, width).expect("a whole frame");
                look(finder, &image)
            };
            let found: Vec<T> = batch.par_iter().map_init(Finder::new, look).collect();
            seen.extend(found);
        }
        self.bar.finish_and_clear();
        if self.frames == FRAMES_MAX && self.source.next_frame()?.is_some() {
            eprintln!("the first {FRAMES_MAX} frames are used; the video is longer");
        }
        Ok(seen)
    }
}

fn by_board(arguments: &Arguments, mut video: Video, camera: &Camera) -> Result<Readout, BadInput> {
    let (size, pitch_mm) = printed(arguments);
    let board = board(size, pitch_mm)?;
    let mut table = Box::new(LensTable::new());
    table.fill(&camera.lens).expect("a lens from a file has a table");
    let observed: Vec<Option<Observed>> =
        video.each(|finder, image| finder.observe(image, &board, &camera.lens, &table))?;
    let spinner = ProgressBar::new_spinner().with_message("fitting the motion of the board");
    spinner.enable_steady_tick(std::time::Duration::from_millis(100));
    let estimated = readout::estimate(&camera.lens, &board, video.interval_s(), &observed);
    spinner.finish_and_clear();
    estimated.map_err(|failure| refusal(&failure, arguments, &video))
}

fn by_flicker(mut video: Video, flicker_hz: f64) -> Result<Readout, BadInput> {
    let rows: Vec<Vec<Row>> = video.each(|_, image| flicker::rows(image))?;
    flicker::estimate(flicker_hz, video.interval_s(), &rows).map_err(|failure| {
        let (found, remedy) = flicker_refusal(&failure, flicker_hz, video.source.rate_hz());
        BadInput::new(video.source.place(), "frames", found, remedy)
    })
}

fn refusal(failure: &Failure, arguments: &Arguments, video: &Video) -> BadInput {
    let ([columns, rows], _) = printed(arguments);
    let (found, remedy) = match *failure {
        Failure::TooFew(count) => (
            format!(
                "the whole board of {columns} x {rows} inner corners is seen in {count} of {} without a gap, and {FRAMES_MIN} are needed",
                counted(video.frames as u64, "frame"),
            ),
            "check --board (count the INNER corners), focus, light and exposure; move the board more slowly, or for longer",
        ),
        Failure::AtRest(speed_px_s) => (
            format!("the board moves by {speed_px_s:.0} px/s only"),
            "wave the board, to and fro and up and down, by a hand's breadth and about once a second",
        ),
        Failure::Irregular(count, of) => (
            format!(
                "{count} of {of} intervals between them are not those of the video's rate: frames are missing or repeated"
            ),
            "record at a constant frame rate; most cameras need a fixed exposure and good light for it, and a converter must not change the rate",
        ),
        Failure::Unsettled => (
            "they do not determine the motion of the board".to_owned(),
            "check that the camera file belongs to this camera; keep the whole board in view",
        ),
        Failure::Uncertain(readout_s, sd_s) => (
            format!(
                "they do not determine the readout: {:.1} +- {:.1} ms",
                readout_s * 1e3,
                sd_s * 1e3
            ),
            "move the board faster, for longer, and in all directions; let it fill a third to a half of the frame",
        ),
    };
    BadInput::new(video.source.place(), "frames", found, remedy)
}

fn flicker_refusal(
    failure: &flicker::Failure,
    flicker_hz: f64,
    rate_hz: f64,
) -> (String, &'static str) {
    match *failure {
        flicker::Failure::TooFew(count) => (
            format!("{count}, and {} are needed", flicker::FRAMES_MIN),
            "record the wall for a second or more",
        ),
        flicker::Failure::Frequency => (
            format!("a flicker of {flicker_hz} Hz"),
            "--flicker-hz takes twice the frequency of the mains: 100 or 120",
        ),
        flicker::Failure::NoBands => (
            "no light and dark bands move through the picture".to_owned(),
            "choose an exposure shorter than 3 ms and a lamp that flickers; a camera with a global shutter shows no bands: measure it with a board",
        ),
        flicker::Failure::Standing => (
            format!(
                "at {rate_hz} frames per second the bands of {flicker_hz} Hz do not tell their direction"
            ),
            "record at another rate, such as 30 for 100 Hz and 25 for 120 Hz",
        ),
        flicker::Failure::OtherFlicker => (
            format!(
                "the bands do not move as those of {flicker_hz} Hz at {rate_hz} frames per second do"
            ),
            "check --flicker-hz (twice that of the mains) and the video's rate (--fps)",
        ),
        flicker::Failure::Uncertain(readout_s, sd_s) => (
            format!(
                "they do not determine the readout: {:.1} +- {:.1} ms",
                readout_s * 1e3,
                sd_s * 1e3
            ),
            "record for longer, with more light on the wall",
        ),
    }
}

/// The camera with its readout. A shutter that agrees with a global one is taken for one; what was
/// measured then belongs to the deviation, as the error that 0 has if the shutter is none.
fn camera_with(camera: Camera, readout: &Readout) -> Camera {
    let Readout { readout_s, sd_s, .. } = *readout;
    let (readout_s, sd_s) =
        if readout.is_global() { (0.0, sd_s.hypot(readout_s)) } else { (readout_s, sd_s) };
    let mut measured = Camera { readout_ns: (readout_s * 1e9).round() as i32, ..camera };
    measured.provenance.readout_sd_ms = Some(rounded(sd_s * 1e3));
    measured
}

/// To two significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}

fn print(readout: &Readout) {
    let Readout { readout_s, sd_s, frames, irregular, speed_px_s } = *readout;
    let frames = counted(frames as u64, "frame");
    match speed_px_s {
        Some(speed_px_s) => eprintln!("{frames} used, the board moving at {speed_px_s:.0} px/s"),
        None => eprintln!("{frames} used"),
    }
    if irregular > 0 {
        let gaps = counted(irregular as u64, "interval");
        eprintln!("{gaps} not used: frames are missing or repeated there");
    }
    let (readout_ms, sd_ms) = (readout_s * 1e3, sd_s * 1e3);
    let decimals = if sd_ms < 0.1 { 3 } else { 2 };
    let shutter = match (readout.is_global(), readout_ms > 0.0) {
        (true, _) => "global shutter: yes",
        (false, true) => "global shutter: no, the top row is read first",
        (false, false) => "global shutter: no, the bottom row is read first",
    };
    eprintln!("readout {readout_ms:.decimals$} +- {sd_ms:.decimals$} ms; {shutter}");
}

#[cfg(test)]
mod tests {
    use plumbline_files::camera::{Provenance, parse};

    use super::*;

    const CAMERA: &str = "width_px = 800\nheight_px = 600\nfx_px = 1000\nfy_px = 1000\n\
        cx_px = 400\ncy_px = 300\nmodel = \"radial2\"\ndistortion = [0, 0]\n";

    /// The readout in nanoseconds and its deviation in milliseconds, as the file has them.
    fn written(readout_s: f64, sd_s: f64) -> (i32, Option<f64>) {
        let readout = Readout { readout_s, sd_s, frames: 60, irregular: 0, speed_px_s: None };
        let Camera { readout_ns, provenance: Provenance { readout_sd_ms, .. }, .. } =
            camera_with(parse(CAMERA, "camera.toml").unwrap(), &readout);
        (readout_ns, readout_sd_ms)
    }

    #[test]
    fn what_is_taken_for_a_global_shutter_says_how_wrong_that_may_be() {
        assert_eq!(written(16e-3, 2e-5), (16_000_000, Some(0.02)));
        assert_eq!(written(0.0, 2e-5), (0, Some(0.02)));
        // At the largest deviation that is accepted, 1.2 ms may be none.
        assert_eq!(written(-1.2e-3, 5e-4), (0, Some(1.3)));
        assert_eq!(written(-1.6e-3, 5e-4), (-1_600_000, Some(0.5)));
    }
}
