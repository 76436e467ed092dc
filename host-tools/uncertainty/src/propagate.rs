//! From causes to figures: what each term contributes to each figure.

use std::f64::consts::FRAC_2_PI;

use nalgebra::{Matrix3, SVector, Vector3};
use plumbline_analysis::series::{Axis, Series};
use plumbline_analysis::sway::noise::Noise;
use plumbline_analysis::sway::{Lengths, PathErrors, Prepared, Settings};
use plumbline_files::BadInput;
use rayon::prelude::*;

use crate::figures::{Correction, Listed, Quantity, corrections, distance, listed};
use crate::inputs::Inputs;
use crate::measured::{Body, Measured};
use crate::response::{LENS_NUMBERS, NUMBERS, SHAPES};
use crate::terms::TermName;

/// Three ways of bending come first among the numbers of a shape; then the stretch.
const STRETCH: usize = LENS_NUMBERS + SHAPES - 1;

/// A trial, and how its figures are made.
pub(crate) struct Propagation<'a> {
    pub measured: &'a Measured,
    pub inputs: &'a Inputs,
    pub settings: &'a Settings,
    /// The trial, for errors.
    pub place: &'a str,
}

/// What was found of a trial's figures.
pub(crate) struct Propagated {
    /// The figures as measured.
    pub figures: Vec<Listed>,
    /// Known effects on each.
    pub corrections: Vec<Correction>,
    /// What the terms contribute to each; a term may be there several times.
    pub contributions: Vec<(TermName, Vec<f64>)>,
    /// The number of noisy copies.
    pub copies: usize,
}

/// The figures of a point with what its random errors do to them.
struct Random {
    /// With the noise of the poses as their uncertainty.
    noisy: Lengths,
    /// With the jitter of the time stamps as their uncertainty.
    jittered: Lengths,
    /// What moves its path.
    path: PathErrors,
    /// The number of noisy copies.
    copies: usize,
}

/// What displaces all positions of a trial together.
enum Cause {
    /// The scale of the print, as a part.
    Scale(f64),
    /// Numbers of the lens and of the target's shape, of each point's target.
    Numbers(Vec<SVector<f32, NUMBERS>>),
    /// The axes, turned in the plane of two of them, radians.
    Turn([Axis; 2], f64),
}

impl Propagation<'_> {
    /// Everything.
    ///
    /// # Errors
    /// When the settings do not suit the trial.
    pub fn run(&self) -> Result<Propagated, BadInput> {
        let bodies = &self.measured.bodies;
        let random: Vec<Random> =
            bodies.par_iter().map(|body| self.random(body)).collect::<Result<_, _>>()?;
        let series: Vec<&Series> = bodies.iter().map(|body| &body.series).collect();
        let figures = self.listed(random.iter().map(|it| &it.noisy), &series, self.settings);
        let jitter = self.listed(random.iter().map(|it| &it.jittered), &series, self.settings);
        let corrections: Vec<Correction> = random
            .iter()
            .flat_map(|it| corrections(&it.noisy, &it.path))
            .chain([Correction::default()])
            .take(figures.len())
            .collect();

        let mut contributions = self.systematic(&figures)?;
        let noise_sd = |it: &Listed| it.noise_sd.unwrap_or(0.0);
        // The copies are of one point; a mean of many frames does not notice their jitter.
        let jitter_sd = |it: &Listed| match it.quantity {
            Quantity::Distance => 0.0,
            _ => noise_sd(it),
        };
        contributions.push((TermName::Noise, figures.iter().map(noise_sd).collect()));
        contributions.push((TermName::Jitter, jitter.iter().map(jitter_sd).collect()));
        contributions.push((TermName::Zero, self.of_zero(figures.len())?));
        // What noise adds grows with its variance: by twice the relative error of its deviation.
        let share = 2.0 * self.inputs.noise.u_percent / 100.0;
        let of_noise = corrections.iter().map(|it| share * it.noise_adds);
        contributions.push((TermName::NoiseCorrection, of_noise.collect()));
        let of_steps = corrections.iter().map(|it| it.u_steps);
        contributions.push((TermName::Steps, of_steps.collect()));
        let clock = 1e-6 * self.inputs.timing.clock_u_ppm;
        let of_clock = figures.iter().map(|it| match it.quantity {
            Quantity::Velocity => clock * it.value.unwrap_or(0.0),
            _ => 0.0,
        });
        contributions.push((TermName::Clock, of_clock.collect()));
        let copies = random.iter().map(|it| it.copies).min().unwrap_or_default();
        Ok(Propagated { figures, corrections, contributions, copies })
    }

    /// The random causes, one after the other: their noises are as large as the trial.
    fn random(&self, body: &Body) -> Result<Random, BadInput> {
        let prepared =
            Prepared::of(&body.series, self.settings).map_err(|error| self.refuse(error))?;
        let lengths =
            |noise: &Noise| prepared.lengths(Some(noise)).map_err(|error| self.refuse(error));
        let noise = self.noise(body, &body.covariance_mm2)?;
        let (noisy, copies) = lengths(&noise)?;
        let path = prepared.path_errors(&noise).map_err(|error| self.refuse(error))?;
        drop(noise);
        let jitter_mm2 = jitter_mm2(body, self.inputs.timing.jitter_u_s);
        let (jittered, _) = lengths(&self.noise(body, &jitter_mm2)?)?;
        Ok(Random { noisy, jittered, path, copies })
    }

    /// The contributions of the causes that displace all positions together.
    fn systematic(&self, figures: &[Listed]) -> Result<Vec<(TermName, Vec<f64>)>, BadInput> {
        let changes = self.causes().into_par_iter().map(|(term, cause)| {
            let mut squares = vec![0.0; figures.len()];
            for sign in [1.0, -1.0] {
                let displaced = self.displaced(&cause, sign)?;
                for ((square, figure), displaced) in squares.iter_mut().zip(figures).zip(displaced)
                {
                    let values = displaced.value.zip(figure.value);
                    *square += values.map_or(0.0, |(after, before)| (after - before).powi(2)) / 2.0;
                }
            }
            Ok((term, squares.into_iter().map(f64::sqrt).collect()))
        });
        changes.collect()
    }

    /// Each independent cause, one standard uncertainty of it.
    fn causes(&self) -> Vec<(TermName, Cause)> {
        let Inputs { print, targets, scene, .. } = self.inputs;
        let bodies = self.measured.bodies.len();
        let mut causes = vec![(TermName::Scale, Cause::Scale(print.u_mm / print.measured_mm))];
        let mut stretch = SVector::<f32, NUMBERS>::zeros();
        stretch[STRETCH] = (print.stretch_u_percent / 100.0) as f32;
        causes.push((TermName::Stretch, Cause::Numbers(vec![stretch; bodies])));
        for way in &self.measured.lens.ways {
            let mut numbers = SVector::<f32, NUMBERS>::zeros();
            for (number, value) in numbers.iter_mut().zip(way) {
                *number = *value as f32;
            }
            causes.push((TermName::Lens, Cause::Numbers(vec![numbers; bodies])));
        }
        // Each target is bent in its own way.
        for body in 0..bodies {
            for way in LENS_NUMBERS..STRETCH {
                let mut numbers = vec![SVector::<f32, NUMBERS>::zeros(); bodies];
                numbers[body][way] = targets.bow_u_mm as f32;
                causes.push((TermName::Flatness, Cause::Numbers(numbers)));
            }
        }
        let turns = [
            (TermName::Tilt, [Axis::Ap, Axis::Si], scene.tilt_u_deg),
            (TermName::Tilt, [Axis::Ml, Axis::Si], scene.tilt_u_deg),
            (TermName::Turn, [Axis::Ap, Axis::Ml], scene.turn_u_deg),
        ];
        causes
            .extend(turns.map(|(term, axes, u_deg)| (term, Cause::Turn(axes, u_deg.to_radians()))));
        causes
    }

    /// The figures of positions displaced by a cause, or by its opposite.
    fn displaced(&self, cause: &Cause, sign: f64) -> Result<Vec<Listed>, BadInput> {
        let bodies = self.measured.bodies.iter().enumerate();
        let series = bodies.map(|(at, body)| {
            let displaced_mm = displaced_mm(body, at, cause, sign);
            body.series.with_positions(displaced_mm).map_err(|error| self.refuse(error))
        });
        let series: Vec<Series> = series.collect::<Result<_, _>>()?;
        self.figures(&series.iter().collect::<Vec<_>>(), self.settings)
    }

    /// The contributions of the time of t = 0: it decides which samples belong to a span.
    ///
    /// An error `d` much smaller than the time `h` between two samples usually changes nothing, and
    /// with the probability `|d| / h` it exchanges a sample at each end: as a mean square, a shift by
    /// `|d| h`. Larger errors have their own square, and `h^2 / 6` because samples are whole. The
    /// change is taken over at least two samples to either side, or to one side at an end of the
    /// trial, and scaled.
    fn of_zero(&self, figures: usize) -> Result<Vec<f64>, BadInput> {
        let nothing = vec![0.0; figures];
        let (Some(span_s), Some(u_s)) = (&self.settings.span_s, self.measured.zero_u_s) else {
            return Ok(nothing);
        };
        if u_s == 0.0 {
            return Ok(nothing);
        }
        let series: Vec<&Series> = self.measured.bodies.iter().map(|it| &it.series).collect();
        let period_s = series.iter().map(|it| it.period_s()).fold(0.0, f64::max);
        let mean_error_s = u_s * FRAC_2_PI.sqrt();
        let whole_samples_s2 = f64::min(mean_error_s * period_s, period_s * period_s / 6.0);
        let effective_s = (u_s * u_s + whole_samples_s2).sqrt();
        let shift_s = f64::max(u_s, 2.0 * period_s);
        // A span at an end of the trial can be shifted one way only.
        let mut shifted = [shift_s, -shift_s, 0.0].into_iter().filter_map(|shift_s| {
            let span_s = Some(span_s.start + shift_s..span_s.end + shift_s);
            let figures = self.figures(&series, &Settings { span_s, ..self.settings.clone() });
            Some((shift_s, figures.ok()?))
        });
        let (Some((one_s, one)), Some((other_s, other))) = (shifted.next(), shifted.next()) else {
            return Err(self.lost(shift_s));
        };
        let per_shift = effective_s / (one_s - other_s).abs();
        let change = |(one, other): (&Listed, &Listed)| {
            let values = one.value.zip(other.value);
            values.map_or(0.0, |(one, other)| (one - other).abs() * per_shift)
        };
        Ok(one.iter().zip(&other).map(change).collect())
    }

    fn figures(&self, series: &[&Series], settings: &Settings) -> Result<Vec<Listed>, BadInput> {
        let of = |series: &&Series| {
            let figures = Prepared::of(series, settings).and_then(|it| it.lengths(None));
            figures.map(|it| it.0).map_err(|error| self.refuse(error))
        };
        let all: Vec<Lengths> = series.iter().map(of).collect::<Result<_, _>>()?;
        Ok(self.listed(all.iter(), series, settings))
    }

    /// The figures of all points, and the distance of two.
    fn listed<'a>(
        &self,
        lengths: impl Iterator<Item = &'a Lengths>,
        series: &[&Series],
        settings: &Settings,
    ) -> Vec<Listed> {
        let bodies = &self.measured.bodies;
        let own = bodies.iter().zip(lengths).flat_map(|(body, it)| listed(body.trunk.word(), it));
        let distance = match (&bodies[..], series) {
            ([lower, upper], [of_lower, of_upper]) => {
                Some(distance([lower, upper], [of_lower, of_upper], settings))
            }
            _ => None,
        };
        own.chain(distance).collect()
    }

    fn noise(&self, body: &Body, covariance_mm2: &[Matrix3<f64>]) -> Result<Noise, BadInput> {
        Noise::per_sample(&body.series, covariance_mm2).map_err(|error| self.refuse(error))
    }

    /// The error for a span that is lost in the uncertainty of t = 0.
    fn lost(&self, shift_s: f64) -> BadInput {
        let found = format!(
            "t = 0 is not known well enough: {shift_s:.3} s earlier or later there are fewer than \
             two samples in the span"
        );
        BadInput::whole(self.place, found, "give a longer --span that lies within the trial")
    }

    fn refuse(&self, error: impl std::fmt::Display) -> BadInput {
        BadInput::whole(
            self.place,
            error,
            "give other settings (--filter, --span), or a longer trial",
        )
    }
}

/// The positions of a point, displaced.
fn displaced_mm(body: &Body, at: usize, cause: &Cause, sign: f64) -> [Vec<f64>; 3] {
    let [ap, ml, si] = Axis::ALL.map(|axis| body.series.along(axis).unwrap_or_default());
    let displaced = |sample: usize| -> Vector3<f64> {
        let mut position_mm = Vector3::new(ap[sample], ml[sample], si[sample]);
        match cause {
            Cause::Scale(part) => position_mm += body.by_scale_mm[sample] * (sign * part),
            Cause::Numbers(numbers) => {
                let moved = body.by_numbers[sample] * numbers[at];
                position_mm += moved.map(f64::from) * sign;
            }
            Cause::Turn([first, second], angle_rad) => {
                let (sin, cos) = (sign * angle_rad).sin_cos();
                let (first, second) = (*first as usize, *second as usize);
                let (x, y) = (position_mm[first], position_mm[second]);
                position_mm[first] = cos * x - sin * y;
                position_mm[second] = sin * x + cos * y;
            }
        }
        position_mm
    };
    let mut all: [Vec<f64>; 3] = Default::default();
    for sample in 0..body.series.samples() {
        for (values, value) in all.iter_mut().zip(&displaced(sample)) {
            values.push(*value);
        }
    }
    all
}

/// The covariances that errors of the time stamps amount to: the position changes by velocity times
/// error. The velocity is that over two samples to either side.
fn jitter_mm2(body: &Body, jitter_u_s: f64) -> Vec<Matrix3<f64>> {
    let [ap, ml, si] = Axis::ALL.map(|axis| body.series.along(axis).unwrap_or_default());
    let time_s = body.series.time_s();
    let last = time_s.len() - 1;
    let covariance = |at: usize| {
        let (from, to) = (at.saturating_sub(2), (at + 2).min(last));
        let step_mm = [ap, ml, si].map(|it| it[to] - it[from]);
        let off_mm = Vector3::from(step_mm) * (jitter_u_s / (time_s[to] - time_s[from]));
        off_mm * off_mm.transpose()
    };
    (0..time_s.len()).map(covariance).collect()
}
