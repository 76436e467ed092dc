//! A board that stands still: whatever its poses do is the error of the measurement.
//!
//! Each of the six coordinates is described by
//!
//! - its *spread*, the standard deviation of all values;
//! - its *noise*, from successive differences, which a drift does not change;
//! - the noise as a multiple of what the tracker says of each frame, which is 1 if the poses'
//!   covariance is right;
//! - its *drift*, the slope of the line fitted by least squares, whose uncertainty allows for
//!   residuals that depend on each other. Whether a drift is beyond chance is judged for all six
//!   coordinates together: of six intervals that hold in 95 of 100 cases each, one would not hold
//!   in every fourth recording;
//! - its *Allan deviation* (Allan 1966; here with overlapping parts, IEEE 1139): how much the
//!   means of neighbouring parts of the recording differ, divided by sqrt(2). It falls as
//!   1 / sqrt(length of the parts) while noise dominates, and rises where drift does. Averaging
//!   for longer than where it is lowest does not help.

use serde::Serialize;

use plumbline_analysis::agreement::effective::effective_samples;
use plumbline_analysis::statistics::regression::{Line, line};

use crate::sighting::{COORDINATES, Coordinate, Deviations, Sighting};
use crate::uncertainty::{Estimate, Spread, few_values};

/// Fewer frames say little about noise, and nothing about drift.
pub const FRAMES_MIN: usize = 60;

/// A line takes two degrees of freedom.
const LINE_PARAMETERS: f64 = 2.0;

/// Where nothing drifts, a drift is found in this share of the recordings.
const FALSE_DRIFTS: f64 = 0.05;

/// Neighbouring parts are compared as long as there are this many of them.
const PARTS_MIN: usize = 4;

/// Lengths of parts per factor of two.
const LENGTHS_PER_OCTAVE: f64 = 2.0;

/// What a board that stood still shows.
#[derive(Debug, Clone, Serialize)]
pub struct Repeatability {
    /// Frames in which the board was seen.
    pub frames: usize,
    /// From the first of them to the last.
    pub duration_s: f64,
    /// Where the board stood, in the camera's frame.
    pub position_mm: [f64; 3],
    /// The six coordinates.
    pub coordinates: Vec<Steadiness>,
}

/// One coordinate.
#[derive(Debug, Clone, Serialize)]
pub struct Steadiness {
    /// Its name.
    pub name: &'static str,
    /// The unit of all of its lengths or turns: `mm` or `deg`.
    pub unit: &'static str,
    /// The standard deviation of all values.
    pub spread_sd: f64,
    /// The largest distance from the mean.
    pub largest: f64,
    /// The noise of one frame, from successive differences.
    pub noise: Spread,
    /// The noise of one frame as the tracker says: root mean square.
    pub stated_sd: f64,
    /// The noise as a multiple of what the tracker says of each frame.
    pub noise_over_stated: Spread,
    /// The spread about the line of the drift as such a multiple. It is larger than that of the
    /// noise where errors last for some frames.
    pub spread_over_stated: f64,
    /// The slope of the fitted line, per minute.
    pub drift_per_min: Estimate,
    /// How far that line goes in the recording.
    pub drift_in_all: Estimate,
    /// The two-sided p of such a slope where nothing drifts, for this coordinate alone.
    pub drift_p: f64,
    /// The Allan deviation.
    pub allan: Vec<Allan>,
}

/// The Allan deviation for one length of the parts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Allan {
    /// The length of the parts.
    pub part_s: f64,
    /// The deviation.
    pub deviation: f64,
}

/// Measures the repeatability. `None` with fewer than [`FRAMES_MIN`] frames, or when no time
/// passes between them.
///
/// The sightings are in the order of their times, and of a board that stood still (see
/// [`stillness`](crate::stillness)). Costs O(n log n).
#[must_use]
pub fn repeatability(sightings: &[Sighting]) -> Option<Repeatability> {
    let (first, last) = (sightings.first()?, sightings.last()?);
    let duration_s = last.time_s - first.time_s;
    if sightings.len() < FRAMES_MIN || duration_s <= 0.0 {
        return None;
    }
    let time_s: Vec<f64> = sightings.iter().map(|it| it.time_s - first.time_s).collect();
    let Deviations { mean, values, variances } = Deviations::of(sightings);
    let of = |axis: usize| steadiness(COORDINATES[axis], &time_s, &values[axis], &variances[axis]);
    Some(Repeatability {
        frames: sightings.len(),
        duration_s,
        position_mm: mean.translation_mm.into(),
        coordinates: (0..COORDINATES.len()).map(of).collect::<Option<_>>()?,
    })
}

impl Repeatability {
    /// The coordinates that drift beyond chance, all six judged together (Bonferroni): where
    /// nothing drifts, none of them is named in 95 of 100 recordings.
    pub fn drifting(&self) -> impl Iterator<Item = &Steadiness> {
        let tests = self.coordinates.len() as f64;
        self.coordinates.iter().filter(move |it| it.drift_p * tests < FALSE_DRIFTS)
    }
}

fn steadiness(
    coordinate: Coordinate,
    time_s: &[f64],
    values: &[f64],
    variances: &[f64],
) -> Option<Steadiness> {
    let duration_s = time_s[time_s.len() - 1];
    let Drift { per_s, p, residuals } = Drift::of(time_s, values)?;
    let in_units: f64 =
        residuals.iter().zip(variances).map(|(it, variance)| it * it / variance).sum();
    let stated = variances.iter().sum::<f64>() / variances.len() as f64;
    Some(Steadiness {
        name: coordinate.name,
        unit: coordinate.unit,
        spread_sd: Spread::of(values).sd,
        largest: values.iter().map(|it| it.abs()).fold(0.0, f64::max),
        noise: Spread::of_successive(values),
        stated_sd: stated.sqrt(),
        noise_over_stated: Spread::of_successive_in_units(values, variances),
        spread_over_stated: (in_units / (values.len() as f64 - LINE_PARAMETERS)).sqrt(),
        drift_per_min: per_s.times(60.0),
        drift_in_all: per_s.times(duration_s),
        drift_p: p,
        allan: allan_deviations(values, duration_s / (values.len() - 1) as f64),
    })
}

/// The line through values over time.
struct Drift {
    per_s: Estimate,
    /// As [`Steadiness::drift_p`].
    p: f64,
    /// What is left of the values.
    residuals: Vec<f64>,
}

impl Drift {
    /// The residuals depend on each other, which the uncertainty allows for by their effective
    /// number. `None` where no time passes.
    fn of(time_s: &[f64], values: &[f64]) -> Option<Self> {
        let Line { slope, intercept, .. } = line(time_s, values, values.len() as f64).ok()?;
        let residuals: Vec<f64> = time_s
            .iter()
            .zip(values)
            .map(|(time, value)| value - intercept - slope * time)
            .collect();
        let effective = effective_samples(std::slice::from_ref(&residuals));
        let Line { slope_se, correlation, .. } = line(time_s, values, effective).ok()?;
        let standard = slope_se * few_values(effective - LINE_PARAMETERS).sqrt();
        // Values that are all the same do not drift.
        let p = correlation.map_or(1.0, |it| it.p);
        Some(Self { per_s: Estimate::new(slope, standard), p, residuals })
    }
}

/// The Allan deviation for parts from one frame up to a quarter of the recording.
fn allan_deviations(values: &[f64], frame_s: f64) -> Vec<Allan> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let lengths = (0..).map(|step| 2_f64.powf(f64::from(step) / LENGTHS_PER_OCTAVE) as usize);
    let mut lengths: Vec<usize> =
        lengths.take_while(|length| length * PARTS_MIN <= values.len()).collect();
    lengths.dedup();
    let deviation = |length: usize| {
        let starts = 0..values.len() - 2 * length + 1;
        let count = starts.len() as f64;
        let change = |at: usize| {
            (sums[at + 2 * length] - 2.0 * sums[at + length] + sums[at]) / length as f64
        };
        let squares: f64 = starts.map(|at| change(at).powi(2)).sum();
        (0.5 * squares / count).sqrt()
    };
    lengths
        .into_iter()
        .map(|length| Allan { part_s: length as f64 * frame_s, deviation: deviation(length) })
        .collect()
}

impl Steadiness {
    /// The length of the parts whose means differ least: averaging for longer does not help.
    /// `None` where averaging helps as far as the recording shows.
    #[must_use]
    pub fn steadiest_s(&self) -> Option<f64> {
        let lowest =
            self.allan.iter().enumerate().min_by(|a, b| a.1.deviation.total_cmp(&b.1.deviation));
        let (at, allan) = lowest?;
        (at + 1 < self.allan.len()).then_some(allan.part_s)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix6;
    use plumbline::pose::Pose;

    use super::*;
    use crate::testing::{COVERED_OF_1000, NOISE, RATE_HZ, Random};

    const DRIFT_MM_PER_MIN: f64 = 0.15;

    /// 20 s of a board whose depth drifts.
    fn session(seed: u64) -> Vec<Sighting> {
        Random::new(seed).sightings(600, |time_s| {
            let z_mm = 900.0 + DRIFT_MM_PER_MIN * time_s / 60.0;
            Pose::from_theta([0.1, 0.2, -0.1, 5.0, 8.0, z_mm])
        })
    }

    #[test]
    fn what_is_said_of_noise_and_drift_is_true_in_95_of_100_sessions() {
        let mut covered = [0; 6];
        for seed in 0..1000 {
            let found = repeatability(&session(seed)).unwrap();
            let [x, z, turn] = [0, 2, 5].map(|axis| &found.coordinates[axis]);
            let drift_mm = DRIFT_MM_PER_MIN * (599.0 / RATE_HZ) / 60.0;
            let facts = [
                z.noise.covers(NOISE[5]),
                z.drift_per_min.covers(DRIFT_MM_PER_MIN) && z.drift_in_all.covers(drift_mm),
                z.noise_over_stated.covers(1.0),
                turn.noise.covers(NOISE[2].to_degrees()),
                !x.drift_per_min.is_beyond_chance(),
                // Of the other five none is found to drift: in 95.9 of 100.
                found.drifting().map(|it| it.name).eq([z.name]),
            ];
            for (covered, fact) in covered.iter_mut().zip(facts) {
                *covered += usize::from(fact);
            }
        }
        for (at, covered) in covered.iter().enumerate() {
            assert!(COVERED_OF_1000.contains(covered), "fact {at}: {covered}");
        }
    }

    /// Noise of a tenth of a second, as from flickering lamps: by the white-noise formula the
    /// drift's uncertainty would be a third of what it is.
    #[test]
    fn a_drift_is_no_surer_than_noise_that_lasts_allows() {
        let mut random = Random::new(1);
        let time_s: Vec<f64> = (0..900).map(|at| f64::from(at) / RATE_HZ).collect();
        let covered = (0..1000).filter(|_| {
            let noise = random.process(900, 0.8);
            Drift::of(&time_s, &noise).unwrap().per_s.covers(0.0)
        });
        let covered = covered.count();
        assert!(COVERED_OF_1000.contains(&covered), "{covered}");
    }

    /// Each error is followed by the same once more: differences of successive frames show half of
    /// its variance, and the spread all of it.
    #[test]
    fn errors_that_last_for_some_frames_are_in_the_spread() {
        let mut sightings = session(8);
        for at in (0..sightings.len() - 1).step_by(2) {
            sightings[at + 1].cam_from_board = sightings[at].cam_from_board;
        }
        for it in repeatability(&sightings).unwrap().coordinates {
            assert!((it.noise_over_stated.sd - 0.5_f64.sqrt()).abs() < 0.1);
            assert!((it.spread_over_stated - 1.0).abs() < 0.15, "{}", it.spread_over_stated);
        }
    }

    #[test]
    fn a_covariance_that_is_too_small_is_seen() {
        let mut sightings = session(7);
        for it in &mut sightings {
            it.covariance = Matrix6::from_diagonal(&it.covariance.diagonal()) / 4.0;
        }
        for it in repeatability(&sightings).unwrap().coordinates {
            assert!(it.noise_over_stated.covers(2.0) && !it.noise_over_stated.covers(1.0));
            // 600 values give it to 3 %.
            assert!((it.spread_over_stated - 2.0).abs() < 0.2, "{}", it.spread_over_stated);
        }
    }

    /// White noise of 1 gives 1 / sqrt(length); a line of slope b gives b length / sqrt(2).
    #[test]
    fn the_allan_deviation_tells_noise_and_drift_apart() {
        let mut random = Random::new(2);
        let noise: Vec<f64> = (0..20_000).map(|_| random.normal()).collect();
        let drift: Vec<f64> = (0..20_000).map(|at| 1e-3 * f64::from(at)).collect();
        for (allan, expected) in [
            (allan_deviations(&noise, 1.0), (|length| length.powf(-0.5)) as fn(f64) -> f64),
            (allan_deviations(&drift, 1.0), |length| 1e-3 * length / 2_f64.sqrt()),
        ] {
            assert_eq!((allan[0].part_s, allan[1].part_s), (1.0, 2.0));
            assert!(allan.last().unwrap().part_s > 4000.0);
            for it in allan.iter().filter(|it| it.part_s <= 200.0) {
                // Of 100 independent parts the deviation is known to 10 %; overlaps help.
                let off = it.deviation / expected(it.part_s) - 1.0;
                assert!(off.abs() < 0.2, "{it:?}: {off}");
            }
        }
        let both: Vec<f64> = noise.iter().zip(&drift).map(|(a, b)| a + b).collect();
        let of = |values: &[f64]| Steadiness {
            allan: allan_deviations(values, 1.0),
            ..repeatability(&session(3)).unwrap().coordinates.remove(0)
        };
        // 1 / sqrt(length) meets the drift where length is 159, and both together are lowest at
        // 126.
        let steadiest_s = of(&both).steadiest_s().unwrap();
        assert!((60.0..260.0).contains(&steadiest_s), "{steadiest_s}");
    }

    #[test]
    fn too_little_gives_nothing() {
        assert!(repeatability(&[]).is_none());
        assert!(repeatability(&session(1)[..FRAMES_MIN - 1]).is_none());
        let mut at_once = session(1);
        at_once.iter_mut().for_each(|it| it.time_s = 0.0);
        assert!(repeatability(&at_once).is_none());
    }
}
