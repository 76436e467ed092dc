//! The readout time of a rolling shutter, from a video of a board that moves.
//!
//! A rolling shutter reads one row after the other, so a board that moves is seen skewed or
//! stretched: by its velocity times the time that passes between the rows in which it lies. The
//! camera is calibrated, so the poses of the board in successive frames give the velocity, and the
//! skew gives the time. Board, camera and rate are known; unknown are a pose for each frame and the
//! readout time, common to all ([`fit`]).
//!
//! In comes what each frame shows of the board ([`Observed`]), in the order of the video; out comes
//! the readout time with its standard deviation. If the board moves mostly one way, an error of the
//! lens can pass for a skew; to and fro it cancels, and what remains is in the deviation. Frames
//! that were dropped or repeated break the motion into runs; a video whose rate varies is refused.
//! For a fast board the deviation may be too small, by a factor of two or three.
//! A second of video takes about 0.1 s.

use nalgebra::Vector2;
use plumbline::image::GreyImage;
use plumbline::lens::Lens;
use plumbline::lens_table::LensTable;
use plumbline::parts::points_mm;
use plumbline::target::TargetGeometry;

use crate::model::Photograph;
use crate::observe::{Finder, Measured};

mod apparent;
mod banded;
mod fit;
mod intervals;
mod motion;
pub(crate) mod sandwich;

use fit::Fit;
use motion::WINDOW;

/// The fewest frames that are used.
pub const FRAMES_MIN: usize = 30;

/// Below this image speed of the board (root mean square) nothing can be told: in the 10 to 30 ms
/// that a readout takes, it would move by a pixel.
const SPEED_PX_S_MIN: f64 = 60.0;

/// If more than this share of the intervals that can be judged differ from the video's rate, the
/// rate is not constant.
const IRREGULAR_MAX: f64 = 0.1;

/// A readout time that is less certain is not worth having: a person who sways moves by 0.01 mm in
/// this time.
pub(crate) const DEVIATION_S_MAX: f64 = 0.5e-3;

/// What a frame of a video shows of the board.
#[derive(Clone)]
pub struct Observed(Photograph);

/// A readout time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readout {
    /// The delay from one row to the next times the number of rows; negative if the sensor is read
    /// from the bottom to the top.
    pub readout_s: f64,
    /// Its standard deviation.
    pub sd_s: f64,
    /// The number of frames used.
    pub frames: usize,
    /// The number of frames between which the video's rate does not hold, where that can be told.
    pub irregular: usize,
    /// How fast the board moved in the image, root mean square; `None` without a board.
    pub speed_px_s: Option<f64>,
}

impl Readout {
    /// Whether the video agrees with a global shutter: even at the largest deviation, to 1.5 ms, less
    /// than rolling shutters take.
    #[must_use]
    pub fn is_global(&self) -> bool {
        self.readout_s.abs() < 3.0 * self.sd_s
    }
}

/// Why a video gives no readout time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Failure {
    /// The board was seen in only this many frames that follow each other.
    TooFew(usize),
    /// The board hardly moved: its image speed, px/s.
    AtRest(f64),
    /// The rate of the video does not hold in the first number of intervals, of the second that can
    /// be judged.
    Irregular(usize, usize),
    /// The frames do not determine the poses.
    Unsettled,
    /// The uncertainty is too large: the readout time and its standard deviation, s.
    Uncertain(f64, f64),
}

impl Finder {
    /// Observes the board in a frame of a video; `None` when it is not there. `table` is the lens's.
    pub fn observe(
        &mut self,
        image: &GreyImage<'_, u8>,
        board: &TargetGeometry,
        lens: &Lens,
        table: &LensTable,
    ) -> Option<Observed> {
        let found = self.find(image, board).ok()?;
        let rigid = photograph(self.measure(image, board, table, &found)?);
        let deformed = apparent::board(lens, board, &rigid)?;
        let seen = self.measure(image, &deformed, table, &found)?.seen.into();
        Some(Observed(Photograph { seen, ..rigid }))
    }
}

fn photograph(measured: Measured) -> Photograph {
    let cam_from_board = measured.measurement.cam_from_target;
    Photograph { seen: measured.seen.into(), cam_from_board }
}

/// Estimates the readout time from successive frames that are `interval_s` apart.
///
/// # Errors
/// [`Failure`].
pub fn estimate(
    lens: &Lens,
    board: &TargetGeometry,
    interval_s: f64,
    frames: &[Option<Observed>],
) -> Result<Readout, Failure> {
    let seen = frames.iter().flatten().count();
    if seen < FRAMES_MIN {
        return Err(Failure::TooFew(seen));
    }
    let course = Course::new(lens, interval_s, frames);
    let (irregular, judged) = (course.irregular, course.judged);
    if irregular as f64 > IRREGULAR_MAX * judged as f64 {
        return Err(Failure::Irregular(irregular, judged));
    }
    let used = course.runs.iter().map(Vec::len).sum();
    if used < FRAMES_MIN {
        return Err(Failure::TooFew(used));
    }
    if course.speed_px_s < SPEED_PX_S_MIN {
        return Err(Failure::AtRest(course.speed_px_s));
    }
    let points_mm: Vec<_> = points_mm(board).collect();
    let mut fit = Fit {
        lens,
        points_mm: &points_mm,
        interval_s,
        runs: course.runs,
        readout_s: 0.0,
        tau_px: 0.0,
    };
    let sd_s = fit.refine().ok_or(Failure::Unsettled)?;
    let readout_s = fit.readout_s;
    if sd_s > DEVIATION_S_MAX {
        return Err(Failure::Uncertain(readout_s, sd_s));
    }
    let speed_px_s = Some(course.speed_px_s);
    Ok(Readout { readout_s, sd_s, frames: used, irregular, speed_px_s })
}

/// How the board moved through the video.
struct Course {
    /// Frames that follow each other at the video's rate, at least a [`WINDOW`] each.
    runs: Vec<Vec<Photograph>>,
    speed_px_s: f64,
    /// Intervals that differ from the video's rate, and those of which that can be told.
    irregular: usize,
    judged: usize,
}

impl Course {
    fn new(lens: &Lens, interval_s: f64, frames: &[Option<Observed>]) -> Self {
        let mut course = Self { runs: Vec::new(), speed_px_s: 0.0, irregular: 0, judged: 0 };
        let (mut squares, mut steps) = (0.0, 0_usize);
        for run in frames.split(Option::is_none) {
            let run: Vec<&Photograph> = run.iter().flatten().map(|frame| &frame.0).collect();
            let centre_px = |photograph: &&Photograph| {
                let centre_mm = photograph.cam_from_board.translation_mm;
                lens.project(&centre_mm).unwrap_or_else(|| Vector2::repeat(f64::NAN))
            };
            let places_px: Vec<_> = run.iter().map(centre_px).collect();
            squares +=
                places_px.windows(2).map(|pair| (pair[1] - pair[0]).norm_squared()).sum::<f64>();
            steps += places_px.len().saturating_sub(1);
            let regular = intervals::regular(&places_px);
            course.judged += regular.iter().flatten().count();
            course.irregular += regular.iter().flatten().filter(|is_regular| !**is_regular).count();
            let mut piece = Vec::new();
            for (place, photograph) in run.iter().enumerate() {
                piece.push((*photograph).clone());
                if regular.get(place) == Some(&Some(false)) {
                    course.keep(std::mem::take(&mut piece));
                }
            }
            course.keep(piece);
        }
        course.speed_px_s = (squares / steps.max(1) as f64).sqrt() / interval_s;
        course
    }

    fn keep(&mut self, run: Vec<Photograph>) {
        if run.len() >= WINDOW {
            self.runs.push(run);
        }
    }
}

#[cfg(test)]
mod tests;
