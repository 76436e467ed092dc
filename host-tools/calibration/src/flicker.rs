//! The readout time of a rolling shutter, from the light and dark bands that a flickering lamp makes
//! on a plain wall.
//!
//! Rows are exposed one after the other, so the flicker of the lamp in time is seen along the rows:
//! at f Hz and a readout time of d seconds, a frame shows f d periods, and from one frame to the
//! next the bands advance by f times the interval, less whole periods. In come the mean greys of the
//! rows of each frame; out comes the readout time with its standard deviation.
//!
//! Each frame, divided by the mean of all, is a constant and a sinusoid along the rows, whose phase
//! is its own and whose frequency is common. The frequency is searched on a grid and refined by
//! Gauss-Newton, with constants, amplitudes and phases eliminated. The standard deviation is
//! estimated from the residuals, frame by frame, so that a flicker that is no pure sinusoid, or a
//! wall that is not plain, counts. The direction of the bands tells which row is read first.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use nalgebra::{Complex, Matrix3, Vector3};
use plumbline::image::GreyImage;

use crate::readout::Readout;
use crate::readout::sandwich::variance_of_sum;

/// The fewest frames that are used.
pub const FRAMES_MIN: usize = 20;

/// Fewest periods of the flicker in a frame: a smaller part of a sinusoid cannot be told from uneven
/// light.
const PERIODS_MIN: f64 = 0.3;

/// The step of the search, in periods per frame: an eighth of the width of the peak.
const PERIODS_STEP: f64 = 0.1;

/// Smallest amplitude of the bands, relative to the mean: a tenth of a grey level of a bright wall.
const AMPLITUDE_MIN: f64 = 5e-4;

/// The sinusoids must explain this share of what changes from frame to frame, apart from the
/// brightness of whole frames.
const EXPLAINED_MIN: f64 = 0.25;

/// The phases of the two directions must differ by this much from frame to frame, rad.
const DIRECTION_MIN_RAD: f64 = 0.4;

/// The bands may advance by this much more or less than the flicker says, rad: mains are off by up
/// to 0.2 Hz.
const ADVANCE_ERROR_MAX_RAD: f64 = 0.2;

/// The flicker has twice the frequency of the mains, which have 16.7 Hz on railways and up to 400 Hz
/// in aircraft.
const FLICKER_HZ: RangeInclusive<f64> = 30.0..=1000.0;

/// No camera takes longer to read a frame, s.
const READOUT_S_MAX: f64 = 1.0;

/// How far the flicker may be from its nominal frequency, relative: mains are kept to 0.05 of 50 Hz.
const FLICKER_DEVIATION: f64 = 1e-3;

const ITERATIONS: usize = 12;

/// The mean grey of a row.
pub type Row = f64;

/// Why a video gives no readout time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Failure {
    /// It has only this many frames.
    TooFew(usize),
    /// No lamp on the mains flickers at this frequency.
    Frequency,
    /// There are no bands.
    NoBands,
    /// The bands stand still or alternate, so their direction is unknown.
    Standing,
    /// The bands advance as those of another flicker, or at another frame rate.
    OtherFlicker,
    /// The uncertainty is too large: the readout time and its standard deviation, s.
    Uncertain(f64, f64),
}

/// The mean grey of each row of a frame.
pub fn rows(image: &GreyImage<'_, u8>) -> Vec<Row> {
    let mean = |y: usize| {
        let row = image.row(y);
        let sum: u64 = row.iter().map(|&pixel| u64::from(pixel)).sum();
        sum as f64 / row.len() as f64
    };
    (0..image.height()).map(mean).collect()
}

/// Estimates the readout time from the rows of successive frames that are `interval_s` apart.
///
/// # Errors
/// [`Failure`].
pub fn estimate(flicker_hz: f64, interval_s: f64, frames: &[Vec<Row>]) -> Result<Readout, Failure> {
    if frames.len() < FRAMES_MIN {
        return Err(Failure::TooFew(frames.len()));
    }
    if !FLICKER_HZ.contains(&flicker_hz) {
        return Err(Failure::Frequency);
    }
    let mut wall = Wall::new(frames).ok_or(Failure::NoBands)?;
    // A frame takes longer than its readout.
    let most = flicker_hz * interval_s.min(READOUT_S_MAX);
    let periods = wall.search(most).ok_or(Failure::NoBands)?;
    let bands = wall.refine(periods).ok_or(Failure::NoBands)?;
    let direction = bands.direction(flicker_hz * interval_s)?;
    let readout_s = direction * bands.periods / flicker_hz;
    let sd_s = (bands.sd_periods / flicker_hz).hypot(readout_s * FLICKER_DEVIATION);
    if sd_s > crate::readout::DEVIATION_S_MAX {
        return Err(Failure::Uncertain(readout_s, sd_s));
    }
    Ok(Readout { readout_s, sd_s, frames: frames.len(), irregular: 0, speed_px_s: None })
}

/// The rows of a video, relative to the wall's own light.
struct Wall<'a> {
    frames: &'a [Vec<Row>],
    /// Of each frame: row by row, the grey over the wall's own, less 1.
    relative: Vec<Vec<f64>>,
}

/// The bands of a video.
struct Bands {
    /// Periods per frame.
    periods: f64,
    sd_periods: f64,
    /// Of each frame: amplitude and phase in the middle row.
    phases: Vec<Complex<f64>>,
}

impl<'a> Wall<'a> {
    /// `None` when a row is black, or the frames differ in size.
    fn new(frames: &'a [Vec<Row>]) -> Option<Self> {
        let rows = frames.first()?.len();
        if frames.iter().any(|frame| frame.len() != rows) {
            return None;
        }
        let mut wall = Self { frames, relative: Vec::new() };
        wall.divide(|_, _| 1.0)?;
        Some(wall)
    }

    /// Divides the frames by the wall's own light: the mean of all frames, each divided by its
    /// flicker.
    fn divide(&mut self, flicker: impl Fn(usize, usize) -> f64) -> Option<()> {
        let count = self.frames.len() as f64;
        let own = |y: usize| {
            let frames = self.frames.iter().enumerate();
            frames.map(|(frame, rows)| rows[y] / flicker(frame, y)).sum::<f64>() / count
        };
        let own: Vec<f64> = (0..self.frames[0].len()).map(own).collect();
        if own.iter().any(|&grey| grey.is_nan() || grey <= 0.0) {
            return None;
        }
        let relative = |rows: &Vec<Row>| -> Vec<f64> {
            rows.iter().zip(&own).map(|(row, own)| row / own - 1.0).collect()
        };
        self.relative = self.frames.iter().map(relative).collect();
        Some(())
    }

    /// The number of periods per frame whose sinusoids explain most, up to `most`.
    fn search(&self, most: f64) -> Option<f64> {
        let steps = ((most - PERIODS_MIN) / PERIODS_STEP).ceil().max(0.0) as usize;
        let candidates = (0..=steps).map(|step| PERIODS_MIN + step as f64 * PERIODS_STEP);
        let explained = candidates.map(|periods| (self.fit(periods).explained(), periods));
        let (share, periods) = explained.max_by(|one, other| one.0.total_cmp(&other.0))?;
        (share > EXPLAINED_MIN).then_some(periods)
    }

    fn fit(&self, periods: f64) -> Fit<'_> {
        Fit::new(&self.relative, periods)
    }

    /// Refines the number of periods; `None` when the bands are too faint, or leave the search.
    fn refine(&mut self, start: f64) -> Option<Bands> {
        let mut periods = start;
        for _ in 0..ITERATIONS {
            let fit = self.fit(periods);
            let (gradient, information, _) = fit.normal();
            periods -= gradient / information;
            let moved = (periods - start).abs();
            if moved.is_nan() || moved > 2.0 * PERIODS_STEP {
                return None;
            }
            // The mean of the frames contains the mean of their flickers.
            let fit = self.fit(periods);
            let (basis, found) = (fit.basis, fit.found);
            self.divide(|frame, y| 1.0 + found[frame].dot(&without_constant(&basis[y])))?;
        }
        let fit = self.fit(periods);
        let (_, information, scores) = fit.normal();
        // A sinusoid a cos + b sin has the amplitude and phase of a - i b.
        let phases = fit.found.iter().map(|found| Complex::new(found[1], -found[2]));
        let phases: Vec<_> = phases.collect();
        let power = phases.iter().map(Complex::norm_sqr).sum::<f64>() / phases.len() as f64;
        let sd_periods = variance_of_sum(&scores).sqrt() / information;
        (power.sqrt() > AMPLITUDE_MIN && sd_periods.is_finite()).then_some(Bands {
            periods,
            sd_periods,
            phases,
        })
    }
}

fn without_constant(basis: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(0.0, basis[1], basis[2])
}

/// A constant and a sinusoid fitted to each frame.
struct Fit<'a> {
    relative: &'a [Vec<f64>],
    /// Of each row: 1, cosine and sine.
    basis: Vec<Vector3<f64>>,
    inverse: Matrix3<f64>,
    /// Of each frame: the constant, and the amplitudes of cosine and sine.
    found: Vec<Vector3<f64>>,
}

impl<'a> Fit<'a> {
    fn new(relative: &'a [Vec<f64>], periods: f64) -> Self {
        let rows = relative[0].len();
        let basis: Vec<_> = (0..rows)
            .map(|y| {
                let (sin, cos) = (TAU * periods * place(y, rows)).sin_cos();
                Vector3::new(1.0, cos, sin)
            })
            .collect();
        let normal: Matrix3<f64> = basis.iter().map(|row| row * row.transpose()).sum();
        // Independent for any part of a period.
        let inverse = normal.try_inverse().unwrap_or_else(Matrix3::zeros);
        let solve = |frame: &Vec<f64>| -> Vector3<f64> {
            inverse
                * frame.iter().zip(&basis).map(|(value, row)| row * *value).sum::<Vector3<f64>>()
        };
        let found = relative.iter().map(solve).collect();
        Self { relative, basis, inverse, found }
    }

    fn residuals(&self, frame: usize) -> impl Iterator<Item = f64> {
        let found = self.found[frame];
        self.relative[frame].iter().zip(&self.basis).map(move |(value, row)| found.dot(row) - value)
    }

    /// The share of the squares that the sinusoids explain, apart from the frames' means.
    fn explained(&self) -> f64 {
        let (mut all, mut left) = (0.0, 0.0);
        for (frame, values) in self.relative.iter().enumerate() {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            all += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
            left += self.residuals(frame).map(|residual| residual * residual).sum::<f64>();
        }
        if all > 0.0 { 1.0 - left / all } else { 0.0 }
    }

    /// Gradient and information of the number of periods, with what each frame adds to the gradient.
    fn normal(&self) -> (f64, f64, Vec<f64>) {
        let rows = self.basis.len();
        let mut information = 0.0;
        let scores: Vec<f64> = self
            .found
            .iter()
            .enumerate()
            .map(|(frame, found)| {
                let by_periods = |(y, row): (usize, &Vector3<f64>)| {
                    TAU * place(y, rows) * (found[2] * row[1] - found[1] * row[2])
                };
                let slopes: Vec<f64> = self.basis.iter().enumerate().map(by_periods).collect();
                let mixed: Vector3<f64> =
                    slopes.iter().zip(&self.basis).map(|(slope, row)| row * *slope).sum();
                let squares: f64 = slopes.iter().map(|slope| slope * slope).sum();
                information += squares - mixed.dot(&(self.inverse * mixed));
                // The residuals are orthogonal to the basis: eliminating it changes nothing here.
                slopes.iter().zip(self.residuals(frame)).map(|(slope, off)| slope * off).sum()
            })
            .collect();
        (scores.iter().sum(), information, scores)
    }
}

/// Where a row is in the frame, from -1/2 to 1/2.
fn place(y: usize, rows: usize) -> f64 {
    y as f64 / rows as f64 - 0.5
}

impl Bands {
    /// 1 if the bands advance as those of a sensor that is read from the top, -1 from the bottom.
    fn direction(&self, periods_per_interval: f64) -> Result<f64, Failure> {
        let advance: Complex<f64> =
            self.phases.windows(2).map(|pair| pair[1] * pair[0].conj()).sum();
        let advance_rad = advance.im.atan2(advance.re);
        let off =
            |direction: f64| wrapped(advance_rad - direction * TAU * periods_per_interval).abs();
        let (down, up) = (off(1.0), off(-1.0));
        if down.min(up) > ADVANCE_ERROR_MAX_RAD {
            return Err(Failure::OtherFlicker);
        }
        if wrapped(2.0 * TAU * periods_per_interval).abs() < DIRECTION_MIN_RAD {
            return Err(Failure::Standing);
        }
        Ok(if down < up { 1.0 } else { -1.0 })
    }
}

/// An angle within half a turn of zero.
fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 720;

    /// A wall that is brighter at the top, in a light that flickers at 100 Hz.
    fn video(readout_s: f64, rate_hz: f64, noise: f64) -> Vec<Vec<Row>> {
        let mut state = 7_u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let mut frame = |frame: usize| {
            (0..ROWS)
                .map(|y| {
                    let time_s = frame as f64 / rate_hz + y as f64 / ROWS as f64 * readout_s;
                    let phase = TAU * 100.0 * time_s + 0.3;
                    let wall = 180.0 - 0.05 * y as f64;
                    wall * (1.0 + 0.1 * phase.cos()) + noise * 12_f64.sqrt() * uniform()
                })
                .collect()
        };
        (0..60).map(&mut frame).collect()
    }

    #[test]
    fn the_readout_and_its_direction_come_from_the_bands() {
        for readout_s in [16e-3, -16e-3, 5e-3, -28e-3] {
            let found = estimate(100.0, 1.0 / 30.0, &video(readout_s, 30.0, 0.1)).unwrap();
            println!("{readout_s}: {found:?}");
            // Here the frequency is exact. The noise is a tenth of a grey level in each row's mean,
            // of bands of 18: 0.6 % in each of 43,200 rows.
            assert!((found.readout_s - readout_s).abs() < 5e-6, "{found:?}");
            assert!((found.sd_s / readout_s.abs() - 1e-3).abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn bands_that_tell_nothing_are_refused() {
        // All rows at once, and a wall at rest in steady light.
        assert_eq!(estimate(100.0, 1.0 / 30.0, &video(0.0, 30.0, 0.1)), Err(Failure::NoBands));
        let steady = vec![vec![120.0; ROWS]; 60];
        assert_eq!(estimate(100.0, 1.0 / 30.0, &steady), Err(Failure::NoBands));
        // Standing still at 50 frames per second they vanish in the mean, and at 40 they alternate.
        assert_eq!(estimate(100.0, 1.0 / 50.0, &video(16e-3, 50.0, 0.1)), Err(Failure::NoBands));
        assert_eq!(estimate(100.0, 1.0 / 40.0, &video(16e-3, 40.0, 0.1)), Err(Failure::Standing));
        let other = estimate(120.0, 1.0 / 30.0, &video(16e-3, 30.0, 0.1));
        assert_eq!(other, Err(Failure::OtherFlicker));
        for flicker_hz in [0.0, -100.0, 1e12, f64::NAN] {
            let found = estimate(flicker_hz, 1.0 / 30.0, &video(16e-3, 30.0, 0.1));
            assert_eq!(found, Err(Failure::Frequency), "{flicker_hz}");
        }
        // As if a frame took hours: no readout does, and none is searched for.
        let hours = estimate(100.0, 1e4, &video(16e-3, 30.0, 0.1));
        assert_eq!(hours, Err(Failure::OtherFlicker));
        let few = &video(16e-3, 30.0, 0.1)[..5];
        assert_eq!(estimate(100.0, 1.0 / 30.0, few), Err(Failure::TooFew(5)));
        assert_eq!(estimate(100.0, 1.0 / 30.0, &vec![vec![0.0; ROWS]; 60]), Err(Failure::NoBands));
    }
}
