//! Two boards on one plate: the distance between two of their points is the same wherever the plate
//! is, and whatever its measured values do is the error of the measurement.
//!
//! After the idea of VDI/VDE 2634 part 1 (length measurement error): the plate is brought to many
//! positions all over the volume; at each the length is measured, and the largest error counts. A
//! *position* here is whatever frames have the plate at nearly the same place and in nearly the
//! same direction. The plate need not stand still, so that it can be held in the hands.
//!
//! The largest error must not be that of a single false detection. Of a recording only positions
//! count at which [`FRAMES_MIN`] frames or more have the plate; a lone frame of a position whose
//! distance is none that noise explains, where all others agree, is not used. Both are listed with
//! the reason. An error that shows in two frames of a position repeats itself, and counts. Of
//! photographs that stand for themselves, each may be a position: there is nothing to confirm it.
//!
//! The error of a position has the standard uncertainty of the noise of its mean, combined with
//! that of the known length. Without a known length only the scatter of the positions is known: an
//! error that is the same everywhere, as of a print that is not true to scale, cannot be seen.
//! With a rolling shutter the two boards are not seen at the same time, while the plate may move:
//! [`pairs`] takes both points at the time of the first.
//!
//! Noise that lasts for longer than the plate is at a position counts as an error of the position:
//! it is in the scatter, and not in the uncertainty of the single error.

use nalgebra::Vector3;
use plumbline::pose::{Cam, Pose, Target};
use plumbline_analysis::agreement::effective::effective_samples;
use plumbline_analysis::statistics::describe::median;
use serde::Serialize;

use crate::sighting::{Point, Sighting};
use crate::stillness::MEDIAN_OF_ABSOLUTE;
use crate::uncertainty::{Estimate, Spread, mean};
use crate::volume::Direction;

/// Fewer positions say nothing about a volume.
pub const POSITIONS_MIN: usize = 10;

/// Fewer frames of a recording are no position: of two that differ, either may be the false one.
pub const FRAMES_MIN: usize = 3;

/// A frame whose distance is this many standard deviations from the median of its position is none
/// that noise explains: of normal noise one in half a billion.
const OFF_SD_MAX: f64 = 6.0;

/// Frames belong to one position as long as the plate is within this share of its distance from
/// the camera: a thirtieth of a wide picture.
const PLACE_SHARE: f64 = 0.03;

/// And turned by no more than this.
const TURN_DEG: f64 = 8.0;

/// How a board moves is told by frames that are no farther away than this: a hand needs longer to
/// turn back.
const NEIGHBOURS_S: f64 = 0.2;

/// The scatter of frames about their positions' means is used if it has so many degrees of
/// freedom; otherwise, as for single photographs, what the tracker says of each frame.
const SCATTER_FREEDOM_MIN: usize = 20;

/// Both boards in one frame.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    ends_mm: [Vector3<f64>; 2],
    /// The first board's pose, for the plate's direction.
    cam_from_first: Pose<Cam, Target>,
    distance_mm: f64,
    /// The variance of the distance, as the tracker says.
    variance_mm2: f64,
}

/// Both boards in the frames that show both: in each frame of a recording, the first board and the
/// second, each with the point from which, or to which, the length is measured.
///
/// A frame is left out if the boards are exposed one after the other, and no frame beside it tells
/// how the second one moves.
#[must_use]
pub fn pairs(boards: [&[Option<Sighting>]; 2], points_mm: &[Vector3<f64>; 2]) -> Vec<Pair> {
    let [first, second] = boards;
    let both = first.iter().zip(second).enumerate();
    both.filter_map(|(frame, (one, other))| {
        let (one, other) = (one.as_ref()?, other.as_ref()?);
        let points = [one.point(&points_mm[0]), other.point(&points_mm[1])];
        let second_mm = position_at(second, frame, &points_mm[1], one.time_s)?;
        Some(Pair::of(one, points, second_mm))
    })
    .collect()
}

/// Where a board's point was at a time within a frame: the polynomial through the point in this
/// frame and in those beside it that show the board. If both do, and the time is less than a quarter
/// of a frame away, its noise is that of the point in the frame, to a tenth; if only one does, to three
/// tenths.
fn position_at(
    board: &[Option<Sighting>],
    frame: usize,
    point_mm: &Vector3<f64>,
    time_s: f64,
) -> Option<Vector3<f64>> {
    let this = board[frame].as_ref()?;
    let is_near = |it: &&Sighting| (it.time_s - this.time_s).abs() <= NEIGHBOURS_S;
    let around = &board[frame.saturating_sub(1)..board.len().min(frame + 2)];
    let known: Vec<&Sighting> = around.iter().flatten().filter(is_near).collect();
    if known.len() < 2 {
        return (time_s == this.time_s).then(|| this.cam_from_board.transform(point_mm));
    }
    let weight = |it: &Sighting| -> f64 {
        let others = known.iter().filter(|other| other.time_s != it.time_s);
        others.map(|other| (time_s - other.time_s) / (it.time_s - other.time_s)).product()
    };
    Some(known.iter().map(|it| it.cam_from_board.transform(point_mm) * weight(it)).sum())
}

impl Pair {
    /// From the first board, both points as they were seen, and where the second one was when the
    /// first was seen.
    fn of(first: &Sighting, points: [Point; 2], second_mm: Vector3<f64>) -> Self {
        let ends_mm = [points[0].position_mm, second_mm];
        let between_mm = ends_mm[1] - ends_mm[0];
        let along = between_mm.normalize();
        let covariance_mm2 = points[0].covariance_mm2 + points[1].covariance_mm2;
        Self {
            ends_mm,
            cam_from_first: first.cam_from_board,
            distance_mm: between_mm.norm(),
            variance_mm2: along.dot(&(covariance_mm2 * along)),
        }
    }

    /// How far apart the points are.
    #[must_use]
    pub fn distance_mm(&self) -> f64 {
        self.distance_mm
    }

    fn middle_mm(&self) -> Vector3<f64> {
        0.5 * (self.ends_mm[0] + self.ends_mm[1])
    }

    fn is_near(&self, other: &Self) -> bool {
        let apart_mm = (self.middle_mm() - other.middle_mm()).norm();
        let turn = self.cam_from_first.rotation.transpose() * other.cam_from_first.rotation;
        let cosine = 0.5 * (turn.trace() - 1.0);
        apart_mm <= PLACE_SHARE * other.middle_mm().norm() && cosine >= TURN_DEG.to_radians().cos()
    }
}

/// The plate at one position.
#[derive(Debug, Clone, Serialize)]
pub struct Position {
    /// The two points, in the camera's frame: means of the frames.
    pub ends_mm: [[f64; 3]; 2],
    /// The direction of the length.
    pub direction: Direction,
    /// Frames at this position.
    pub frames: usize,
    /// The mean distance; its uncertainty is that of noise alone.
    pub distance_mm: Estimate,
    /// The distance less the known length, if that is known.
    pub error_mm: Option<Estimate>,
}

/// Frames that do not count, because no others confirm them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Unconfirmed {
    /// Where the plate's middle was seen, in the camera's frame.
    pub middle_mm: [f64; 3],
    /// How many there are.
    pub frames: usize,
    /// The distance that they show: their mean.
    pub distance_mm: f64,
    /// Why they do not count.
    pub reason: Reason,
}

/// Why frames do not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// Fewer than [`FRAMES_MIN`] frames have the plate there.
    FewFrames,
    /// It is the only one of its position that is so far off.
    Outlier,
}

/// What a plate that was moved through the volume shows.
#[derive(Debug, Clone, Serialize)]
pub struct Distance {
    /// Frames that show both boards.
    pub frames: usize,
    /// The positions, in the order in which they were first visited.
    pub positions: Vec<Position>,
    /// What does not count.
    pub unconfirmed: Vec<Unconfirmed>,
    /// The noise of the distance in one frame: standard deviation.
    pub noise_sd_mm: f64,
    /// The mean of the positions' distances.
    pub mean_mm: Estimate,
    /// The scatter of the positions' distances.
    pub scatter_mm: Spread,
    /// From the smallest to the largest of them.
    pub range_mm: f64,
    /// Against the known length, if that is known.
    pub against: Option<Against>,
}

/// Errors against a known length.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Against {
    /// The known length.
    pub length_mm: Estimate,
    /// The mean error.
    pub mean_error_mm: Estimate,
    /// The mean error in per cent of the length: an error of scale.
    pub scale_error_percent: Estimate,
    /// The error that is farthest from 0.
    pub largest_error_mm: Estimate,
    /// Which position has it.
    pub largest_at: usize,
}

/// Measures the errors of a length, at positions that at least `frames_min` frames show: 1 for
/// photographs that stand for themselves, [`FRAMES_MIN`] otherwise.
///
/// # Errors
/// With fewer than [`POSITIONS_MIN`] positions; gives their number.
pub fn distance(
    pairs: &[Pair],
    length_mm: Option<Estimate>,
    frames_min: usize,
) -> Result<Distance, usize> {
    let (groups, unconfirmed) = confirmed(groups(pairs), frames_min);
    if groups.len() < POSITIONS_MIN {
        return Err(groups.len());
    }
    let noise = Noise::of(&groups);
    let positions: Vec<Position> =
        groups.iter().map(|group| noise.position(group, length_mm)).collect();
    let distances: Vec<f64> = positions.iter().map(|it| it.distance_mm.value).collect();
    let mean_mm = Estimate::mean_of_independent(&distances);
    let ends = |start: f64, pick: fn(f64, f64) -> f64| distances.iter().copied().fold(start, pick);
    Ok(Distance {
        frames: pairs.len(),
        noise_sd_mm: noise.sd_mm,
        mean_mm,
        scatter_mm: Spread::of(&distances),
        range_mm: ends(f64::NEG_INFINITY, f64::max) - ends(f64::INFINITY, f64::min),
        against: length_mm.map(|length_mm| against(length_mm, mean_mm, &positions)),
        positions,
        unconfirmed,
    })
}

fn against(length_mm: Estimate, mean_mm: Estimate, positions: &[Position]) -> Against {
    let mean_error_mm = mean_mm.minus(length_mm);
    let errors = || positions.iter().filter_map(|it| it.error_mm).enumerate();
    let size = |it: &(usize, Estimate)| it.1.value.abs();
    let (largest_at, largest_error_mm) = errors()
        .max_by(|a, b| size(a).total_cmp(&size(b)))
        .expect("every position has an error where the length is known");
    Against {
        length_mm,
        mean_error_mm,
        scale_error_percent: mean_error_mm.times(100.0 / length_mm.value),
        largest_error_mm,
        largest_at,
    }
}

/// The frames of each position: each frame joins the first position whose first frame it is near.
fn groups(pairs: &[Pair]) -> Vec<Vec<&Pair>> {
    let mut groups: Vec<Vec<&Pair>> = Vec::new();
    for pair in pairs {
        match groups.iter_mut().find(|group| pair.is_near(group[0])) {
            Some(group) => group.push(pair),
            None => groups.push(vec![pair]),
        }
    }
    groups
}

/// The positions that count, and the frames that do not.
fn confirmed(groups: Vec<Vec<&Pair>>, frames_min: usize) -> (Vec<Vec<&Pair>>, Vec<Unconfirmed>) {
    let (mut groups, few): (Vec<_>, Vec<_>) =
        groups.into_iter().partition(|group| group.len() >= frames_min);
    let few = few.iter().map(|group| Unconfirmed::of(group, Reason::FewFrames));
    let mut unconfirmed: Vec<Unconfirmed> = few.collect();
    let off_sd: Vec<Vec<f64>> = groups.iter().map(|group| off_sd(group)).collect();
    // What the tracker says of a frame leaves out how a hand and a lens add to the scatter.
    let sizes = off_sd.iter().filter(|off| off.len() >= FRAMES_MIN).flatten();
    let Some(usual_size) = median(sizes.map(|off| off.abs())) else {
        return (groups, unconfirmed);
    };
    let off_sd_max = OFF_SD_MAX * (usual_size / MEDIAN_OF_ABSOLUTE).max(1.0);
    for (group, off_sd) in groups.iter_mut().zip(&off_sd) {
        let mut outliers = (0..group.len()).filter(|&at| off_sd[at].abs() > off_sd_max);
        if let (Some(lone), None) = (outliers.next(), outliers.next())
            && group.len() >= FRAMES_MIN
        {
            let outlier = group.remove(lone);
            unconfirmed.push(Unconfirmed::of(&[outlier], Reason::Outlier));
        }
    }
    (groups, unconfirmed)
}

/// How far each frame's distance is from the median of the position, in standard deviations as the
/// tracker says. A false detection says little of its own; the position's median frame does.
fn off_sd(group: &[&Pair]) -> Vec<f64> {
    let median = |values: Vec<f64>| median(values).expect("a position has frames");
    let middle_mm = median(distances(group));
    let variance_mm2 = median(group.iter().map(|it| it.variance_mm2).collect());
    let sd_mm = variance_mm2.max(f64::MIN_POSITIVE).sqrt();
    group.iter().map(|it| (it.distance_mm - middle_mm) / sd_mm).collect()
}

impl Unconfirmed {
    fn of(group: &[&Pair], reason: Reason) -> Self {
        let count = group.len() as f64;
        let middle_mm = group.iter().map(|it| it.middle_mm()).sum::<Vector3<f64>>() / count;
        Self {
            middle_mm: middle_mm.into(),
            frames: group.len(),
            distance_mm: mean(&distances(group)),
            reason,
        }
    }
}

/// The noise of the distance in one frame.
struct Noise {
    sd_mm: f64,
    /// Frames per independent one.
    dependence: f64,
}

impl Noise {
    fn of(groups: &[Vec<&Pair>]) -> Self {
        let frames: usize = groups.iter().map(Vec::len).sum();
        let freedom = frames - groups.len();
        if freedom < SCATTER_FREEDOM_MIN {
            let variances_mm2 = groups.iter().flatten().map(|pair| pair.variance_mm2);
            let sd_mm = (variances_mm2.sum::<f64>() / frames as f64).max(0.0).sqrt();
            return Self { sd_mm, dependence: 1.0 };
        }
        let residuals: Vec<Vec<f64>> = groups
            .iter()
            .map(|group| {
                let distances = distances(group);
                let mean = mean(&distances);
                distances.iter().map(|it| it - mean).collect()
            })
            .collect();
        let squares: f64 = residuals.iter().flatten().map(|it| it * it).sum();
        Self {
            sd_mm: (squares / freedom as f64).sqrt(),
            dependence: frames as f64 / effective_samples(&residuals),
        }
    }

    fn position(&self, group: &[&Pair], length_mm: Option<Estimate>) -> Position {
        let count = group.len() as f64;
        let independent = (count / self.dependence).max(1.0);
        let distance_mm = Estimate::new(mean(&distances(group)), self.sd_mm / independent.sqrt());
        let end = |at: usize| group.iter().map(|it| it.ends_mm[at]).sum::<Vector3<f64>>() / count;
        let ends_mm = [end(0), end(1)];
        Position {
            ends_mm: ends_mm.map(Into::into),
            direction: Direction::of(&ends_mm),
            frames: group.len(),
            distance_mm,
            error_mm: length_mm.map(|length_mm| distance_mm.minus(length_mm)),
        }
    }
}

fn distances(group: &[&Pair]) -> Vec<f64> {
    group.iter().map(|it| it.distance_mm).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::testing::{COVERED_OF_1000, NOISE, RATE_HZ, Random};

    const LENGTH_MM: f64 = 120.0;
    const POSITIONS: usize = 20;
    const FRAMES: usize = 15;
    /// How well the user knows the length: a caliper, and the eye.
    const READING_MM: f64 = 0.02;
    /// All lengths are too large by this share, as with a wrong pitch.
    const SCALE: f64 = 0.001;
    /// How much the error differs from one position to the next, as by a wrong lens.
    const FIELD_MM: f64 = 0.05;

    const POINTS_MM: [Vector3<f64>; 2] =
        [Vector3::new(-24.0, -18.0, 0.0), Vector3::new(-20.0, 15.0, 0.0)];

    /// The second board's pose on the first one, when the points are this far apart.
    fn first_from_second(length_mm: f64) -> Pose<Target, Target> {
        let turn_rad = [0.0, 0.0, 0.3, 0.0, 0.0, 0.0];
        let turned = Pose::<Target, Target>::from_theta(turn_rad).rotation;
        let along = Vector3::new(0.96, 0.28, 0.0);
        Pose::new(turned, POINTS_MM[0] + length_mm * along - turned * POINTS_MM[1])
    }

    /// Both boards in a frame that a global shutter has taken.
    fn pair_of(boards: &[Sighting; 2], points_mm: &[Vector3<f64>; 2]) -> Pair {
        let [first, second] = boards.map(|it| [Some(it)]);
        pairs([&first, &second], points_mm)[0]
    }

    /// Where a plate is held: anywhere in the volume, turned by up to 30 degrees.
    fn held(random: &mut Random) -> Pose<Cam, Target> {
        let mut within = |half: f64| half * (random.normal()).clamp(-1.0, 1.0);
        let [turn_1, turn_2, turn_3] = [within(3.0), within(0.5), within(0.5)];
        let [x_mm, y_mm, z_mm] = [within(200.0), within(150.0), 900.0 + within(250.0)];
        Pose::from_theta([turn_1, turn_2, turn_3, x_mm, y_mm, z_mm])
    }

    /// A plate in the hands: it trembles by some tenths of a millimetre. The errors of the length
    /// at the positions are given.
    fn session(random: &mut Random, errors_mm: &[f64]) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for error_mm in errors_mm {
            let place = held(random);
            for _ in 0..FRAMES {
                let tremor = Vector6::from_fn(|axis, _| {
                    [1e-3, 0.3][usize::from(axis >= 3)] * random.normal()
                });
                let first = place.moved_by(&tremor);
                let second = first * first_from_second(LENGTH_MM + error_mm);
                let time_s = pairs.len() as f64 / RATE_HZ;
                let boards = [random.sighting(time_s, &first), random.sighting(time_s, &second)];
                pairs.push(pair_of(&boards, &POINTS_MM));
            }
        }
        pairs
    }

    fn errors_mm(random: &mut Random) -> Vec<f64> {
        (0..POSITIONS).map(|_| SCALE * LENGTH_MM + FIELD_MM * random.normal()).collect()
    }

    #[test]
    fn what_is_said_of_lengths_is_true_in_95_of_100_sessions() {
        let mut random = Random::new(1);
        let mut covered = [0; 6];
        for _ in 0..1000 {
            let errors_mm = errors_mm(&mut random);
            let pairs = session(&mut random, &errors_mm);
            let read = Estimate::new(LENGTH_MM + READING_MM * random.normal(), READING_MM);
            let found = distance(&pairs, Some(read), FRAMES_MIN).unwrap();
            let against = found.against.unwrap();
            let error_mm = |at: usize| found.positions[at].error_mm.unwrap();
            let facts = [
                against.mean_error_mm.covers(SCALE * LENGTH_MM),
                against.scale_error_percent.covers(100.0 * SCALE),
                found.scatter_mm.covers(FIELD_MM),
                // All places are apart, or else the groups would not be those of the truth.
                found.positions.len() < POSITIONS || error_mm(0).covers(errors_mm[0]),
                found.positions.len() < POSITIONS
                    || found.positions[1].distance_mm.covers(LENGTH_MM + errors_mm[1]),
                found.positions.len() < POSITIONS
                    || against.largest_error_mm.covers(errors_mm[against.largest_at]),
            ];
            for (covered, fact) in covered.iter_mut().zip(facts) {
                *covered += usize::from(fact);
            }
        }
        for (at, covered) in covered.iter().enumerate() {
            assert!(COVERED_OF_1000.contains(covered), "fact {at}: {covered}, of {covered:?}");
        }
    }

    /// Of noise that lasts for some frames the mean of a position keeps more than of white noise:
    /// with phi = 0.3 nearly twice the variance, without which U would hold in 86 of 100 cases. Of
    /// that, positions of 15 frames show a little too little: 92 of 100, less three standard
    /// deviations of 0.9.
    #[test]
    fn a_mean_is_no_surer_than_noise_that_lasts_allows() {
        let mut random = Random::new(6);
        let mut covered = 0;
        for _ in 0..1000 {
            let mut pairs = session(&mut random, &[0.0; POSITIONS]);
            for frames in pairs.chunks_mut(FRAMES) {
                for (pair, error) in frames.iter_mut().zip(random.process(FRAMES, 0.3)) {
                    pair.distance_mm = LENGTH_MM + 0.1 * error;
                }
            }
            let found = distance(&pairs, None, FRAMES_MIN).unwrap();
            covered += usize::from(found.positions[0].distance_mm.covers(LENGTH_MM));
        }
        assert!(covered >= 893, "{covered}");
    }

    /// The second board is exposed 8 ms later, which at 300 mm/s is 2.4 mm. A parabola leaves a sixth
    /// of the third derivative, 75 mm * (4/s)^3, times 8 ms and (33 ms)^2: 7 um. A line, at the ends,
    /// half of the second one times 8 ms and 33 ms: 0.2 mm. The board's turn adds less than both.
    #[test]
    fn boards_that_are_exposed_one_after_the_other_have_the_length_of_one_time() {
        const LATE_S: f64 = 0.008;
        let plate = |time_s: f64| {
            let (sin, cos) = (4.0 * time_s).sin_cos();
            Pose::from_theta([0.1, 0.2 * sin, 0.3 * cos, 20.0 + 75.0 * cos, 75.0 * sin, 900.0])
        };
        let sighting = |time_s: f64, cam_from_board| {
            Some(Sighting { time_s, cam_from_board, covariance: nalgebra::Matrix6::identity() })
        };
        let time_s = |frame: usize| frame as f64 / RATE_HZ;
        let first: Vec<_> = (0..60).map(|at| sighting(time_s(at), plate(time_s(at)))).collect();
        let mut second: Vec<_> = (0..60)
            .map(|at| time_s(at) + LATE_S)
            .map(|time_s| sighting(time_s, plate(time_s) * first_from_second(LENGTH_MM)))
            .collect();
        let found = pairs([&first, &second], &POINTS_MM);
        assert_eq!(found.len(), 60);
        for (frame, pair) in found.iter().enumerate() {
            let error_mm = pair.distance_mm - LENGTH_MM;
            let bound_mm = if (1..59).contains(&frame) { 0.015 } else { 0.4 };
            assert!(error_mm.abs() < bound_mm, "frame {frame}: {error_mm}");
        }
        // Alone, frame 10 does not tell how the board moves.
        (second[9], second[11]) = (None, None);
        assert_eq!(pairs([&first, &second], &POINTS_MM).len(), 57);
    }

    #[test]
    fn a_plate_that_turns_in_its_place_is_at_another_position() {
        let mut random = Random::new(7);
        let place = Pose::from_theta([0.1, 0.2, 0.3, 20.0, -10.0, 900.0]);
        let mut pair = |turn_deg: f64| {
            let turn_rad = Vector6::new(0.0, turn_deg.to_radians(), 0.0, 0.0, 0.0, 0.0);
            let board = random.sighting(0.0, &place.moved_by(&turn_rad));
            // Both points on one board, so that its middle stays where it is.
            let ends_mm = [Vector3::x() * 20.0, Vector3::x() * -20.0];
            pair_of(&[board; 2], &ends_mm)
        };
        let pairs = [0.0, 3.0, 12.0, 15.0, -12.0].map(&mut pair);
        let frames: Vec<usize> = groups(&pairs).iter().map(Vec::len).collect();
        assert_eq!(frames, [2, 2, 1]);
    }

    #[test]
    fn the_largest_error_may_be_negative() {
        let mut random = Random::new(8);
        let mut errors_mm = [0.1; POSITIONS];
        errors_mm[7] = -0.5;
        let pairs = session(&mut random, &errors_mm);
        let known = Some(Estimate::new(LENGTH_MM, 1e-3));
        let found = distance(&pairs, known, FRAMES_MIN).unwrap();
        let largest_mm = found.against.unwrap().largest_error_mm;
        assert!(largest_mm.covers(-0.5) && !largest_mm.covers(-0.4), "{largest_mm:?}");
    }

    /// A session at ten places that are surely apart.
    fn apart(random: &mut Random) -> Vec<Pair> {
        let mut pairs = session(random, &[0.0; POSITIONS_MIN]);
        for (at, frames) in pairs.chunks_mut(FRAMES).enumerate() {
            for pair in frames {
                pair.ends_mm.iter_mut().for_each(|end_mm| end_mm.z += 200.0 * at as f64);
            }
        }
        pairs
    }

    const KNOWN: Option<Estimate> = Some(Estimate::new(LENGTH_MM, 1e-3));

    #[test]
    fn a_single_false_frame_is_not_the_largest_error() {
        let mut random = Random::new(9);
        // Somewhere else, as a grid that was numbered wrongly is; and where the plate is.
        for (aside_mm, reason) in [(500.0, Reason::FewFrames), (0.0, Reason::Outlier)] {
            let mut pairs = apart(&mut random);
            let mut falsely = pairs[3 * FRAMES + 7];
            falsely.distance_mm += 3.0;
            falsely.ends_mm.iter_mut().for_each(|end_mm| end_mm.x += aside_mm);
            pairs.insert(3 * FRAMES + 7, falsely);
            let found = distance(&pairs, KNOWN, FRAMES_MIN).unwrap();
            assert!(found.against.unwrap().largest_error_mm.value.abs() < 0.05, "{found:?}");
            assert_eq!(found.positions.len(), POSITIONS_MIN);
            let [unconfirmed] = found.unconfirmed[..] else { panic!("{found:?}") };
            assert_eq!((unconfirmed.frames, unconfirmed.reason), (1, reason));
            assert!((unconfirmed.distance_mm - falsely.distance_mm).abs() < 1e-9);
        }
    }

    #[test]
    fn an_error_that_repeats_itself_counts() {
        let mut random = Random::new(10);
        for aside_mm in [500.0, 0.0] {
            let mut pairs = apart(&mut random);
            // Three frames somewhere else; of a position, two of fifteen: a mean of a fifth of a
            // millimetre each.
            let repeated = if aside_mm == 0.0 { 2 } else { FRAMES_MIN };
            for pair in &mut pairs[3 * FRAMES..][..repeated] {
                pair.distance_mm += 3.0;
                pair.ends_mm.iter_mut().for_each(|end_mm| end_mm.x += aside_mm);
            }
            let found = distance(&pairs, KNOWN, FRAMES_MIN).unwrap();
            let largest_mm = found.against.unwrap().largest_error_mm.value;
            assert!(largest_mm > 0.35, "{found:?}");
            assert_eq!(found.unconfirmed, []);
        }
    }

    #[test]
    fn without_false_frames_all_count() {
        let mut random = Random::new(11);
        for _ in 0..100 {
            let found = distance(&apart(&mut random), None, FRAMES_MIN).unwrap();
            assert_eq!(found.unconfirmed, []);
        }
    }

    #[test]
    fn a_plate_that_trembles_is_at_one_position() {
        let mut random = Random::new(2);
        let pairs = session(&mut random, &[0.0; POSITIONS]);
        let found = distance(&pairs, None, FRAMES_MIN).unwrap();
        assert_eq!(found.frames, POSITIONS * FRAMES);
        let frames: usize = found.positions.iter().map(|it| it.frames).sum();
        assert_eq!(frames, POSITIONS * FRAMES);
        assert!(found.positions.len() >= POSITIONS - 2, "{}", found.positions.len());
        assert!(found.against.is_none() && found.positions[0].error_mm.is_none());
        // Without errors the positions scatter by the noise of their means.
        let expected_mm = found.noise_sd_mm / (FRAMES as f64).sqrt();
        assert!(found.scatter_mm.covers(expected_mm), "{:?} {expected_mm}", found.scatter_mm);
    }

    /// Of single photographs the tracker's own covariance tells the noise: that of two boards, and
    /// of their levers.
    #[test]
    fn single_photographs_have_the_noise_that_their_covariance_says() {
        let mut random = Random::new(3);
        let place = held(&mut random);
        let pair = |random: &mut Random| {
            let second = place * first_from_second(LENGTH_MM);
            let boards = [random.sighting(0.0, &place), random.sighting(0.0, &second)];
            pair_of(&boards, &POINTS_MM)
        };
        let pairs: Vec<Pair> = (0..2000).map(|_| pair(&mut random)).collect();
        let found = Spread::of(&pairs.iter().map(|it| it.distance_mm).collect::<Vec<_>>());
        let stated_mm = pairs[0].variance_mm2.sqrt();
        assert!(found.covers(stated_mm), "{found:?} {stated_mm}");
        assert!(stated_mm > NOISE[3]);

        let photographs: Vec<Pair> =
            session(&mut random, &[0.0; POSITIONS]).into_iter().step_by(FRAMES).collect();
        let found = distance(&photographs, None, 1).unwrap();
        let variance_mm2 = photographs.iter().map(|it| it.variance_mm2).sum::<f64>();
        assert!((found.noise_sd_mm.powi(2) - variance_mm2 / POSITIONS as f64).abs() < 1e-12);
    }

    #[test]
    fn too_few_positions_are_counted() {
        let mut random = Random::new(4);
        let pairs = session(&mut random, &[0.0; 3]);
        assert_eq!(distance(&pairs, None, FRAMES_MIN).unwrap_err(), 3);
        assert_eq!(distance(&[], None, 1).unwrap_err(), 0);
    }
}
