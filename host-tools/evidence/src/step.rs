//! A board that is lifted by a block of known thickness: the step between its two places.
//!
//! The board is put down once or several times with and without the block. Its places form two
//! groups along the board's normal; the step is the difference of the groups' means along that
//! normal. The standard uncertainty combines
//!
//! - the noise of the means, by the effective number of frames; or, if the board was put down
//!   often enough for it, the larger scatter of its places within the groups, which contains the
//!   noise;
//! - the direction of the normal, which matters as far as the board was moved sideways too: the
//!   angle between the groups' normals is taken as its standard uncertainty. Two boards that lie
//!   askew by chance are off from their mean by less, but sometimes look parallel.

use std::ops::Range;

use nalgebra::Vector3;
use serde::Serialize;

use crate::sighting::{Deviations, Sighting};
use crate::uncertainty::{Estimate, combined, few_values, mean};

/// A place with fewer frames is not used: a board that rested for a moment.
pub const FRAMES_MIN: usize = 15;

/// Degrees of freedom from which the scatter of places tells how well the board is put down.
const REPEATS_MIN: usize = 3;

/// A part of the recording in which the board rested.
#[derive(Debug, Clone)]
struct Place {
    from_s: f64,
    until_s: f64,
    frames: usize,
    position_mm: Vector3<f64>,
    normal: Vector3<f64>,
    /// Along the mean normal.
    along_mm: Estimate,
}

/// The step between two groups of places.
#[derive(Debug, Clone, Serialize)]
pub struct Step {
    /// How far the board moved along its normal.
    pub along_normal_mm: Estimate,
    /// How far it moved sideways, across its normal.
    pub sideways_mm: f64,
    /// How far it moved in space.
    pub in_space_mm: f64,
    /// By how much it turned out of its plane between the groups.
    pub tilted_deg: f64,
    /// What makes up the standard uncertainty.
    pub budget: Vec<Contribution>,
    /// Whether the board was put down often enough to know how well that repeats.
    pub is_placing_known: bool,
    /// The places, in the order of their times.
    pub places: Vec<PlaceSeen>,
    /// The mean normal, away from the camera.
    #[serde(skip)]
    normal: Vector3<f64>,
    /// Where the far group is along it.
    #[serde(skip)]
    far_mm: f64,
}

impl Step {
    /// How high a board is in a frame: along the mean normal, towards the camera, from the far
    /// group's mean.
    #[must_use]
    pub fn height_mm(&self, sighting: &Sighting) -> f64 {
        self.far_mm - self.normal.dot(&sighting.cam_from_board.translation_mm)
    }
}

/// One contribution to a standard uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Contribution {
    /// What it comes from.
    pub source: &'static str,
    /// Its standard uncertainty.
    pub standard_uncertainty_mm: f64,
}

/// One place of the board.
#[derive(Debug, Clone, Serialize)]
pub struct PlaceSeen {
    /// When it came to rest.
    pub from_s: f64,
    /// When it was moved again.
    pub until_s: f64,
    /// Frames in which it was seen meanwhile.
    pub frames: usize,
    /// Along the mean normal, towards the camera, from the far group's mean.
    pub height_mm: Estimate,
    /// Whether it belongs to the group nearer to the camera.
    pub is_near: bool,
}

/// Why there is no step.
#[derive(Debug, Clone, PartialEq)]
pub enum NoStep {
    /// The board rested at this number of places, which is fewer than two.
    TooFewPlaces(usize),
    /// The step is not larger than its expanded uncertainty.
    Lost(Estimate),
}

/// Measures the step between the places at which a board rested: parts of the recording, as found
/// by [`stillness`](crate::stillness).
///
/// # Errors
/// When there are fewer than two places with [`FRAMES_MIN`] frames, or no step beyond its
/// uncertainty.
pub fn step(parts: &[&[Sighting]]) -> Result<Step, NoStep> {
    let parts: Vec<&[Sighting]> =
        parts.iter().copied().filter(|part| part.len() >= FRAMES_MIN).collect();
    if parts.len() < 2 {
        return Err(NoStep::TooFewPlaces(parts.len()));
    }
    let (normal, mut places) = places(&parts);
    places.sort_by(|a, b| b.along_mm.value.total_cmp(&a.along_mm.value));
    // The far group comes first: the normal points away from the camera.
    let gap = |at: usize| places[at - 1].along_mm.value - places[at].along_mm.value;
    let split = (1..places.len()).max_by(|a, b| gap(*a).total_cmp(&gap(*b))).unwrap_or(1);
    let (far, near) = places.split_at(split);
    let step = of_groups(normal, far, near);
    if step.along_normal_mm.is_beyond_chance() {
        Ok(step)
    } else {
        Err(NoStep::Lost(step.along_normal_mm))
    }
}

/// The mean normal, and the places along it.
fn places(parts: &[&[Sighting]]) -> (Vector3<f64>, Vec<Place>) {
    let poses: Vec<_> = parts.iter().map(|part| Deviations::of(part).mean).collect();
    let normals: Vec<Vector3<f64>> =
        poses.iter().map(|pose| pose.rotation.column(2).into_owned()).collect();
    let normal = normals.iter().sum::<Vector3<f64>>().normalize();
    let of = |(at, part): (usize, &&[Sighting])| {
        let along: Vec<f64> =
            part.iter().map(|it| normal.dot(&it.cam_from_board.translation_mm)).collect();
        Place {
            from_s: part[0].time_s,
            until_s: part[part.len() - 1].time_s,
            frames: part.len(),
            position_mm: poses[at].translation_mm,
            normal: normals[at],
            along_mm: Estimate::mean(&along),
        }
    };
    (normal, parts.iter().enumerate().map(of).collect())
}

fn of_groups(normal: Vector3<f64>, far: &[Place], near: &[Place]) -> Step {
    let along =
        |group: &[Place]| -> Vec<f64> { group.iter().map(|it| it.along_mm.value).collect() };
    let middle = |group: &[Place], of: fn(&Place) -> Vector3<f64>| {
        group.iter().map(of).sum::<Vector3<f64>>() / group.len() as f64
    };
    let moved_mm = middle(near, |it| it.position_mm) - middle(far, |it| it.position_mm);
    let far_mm = mean(&along(far));
    let value = far_mm - mean(&along(near));
    let sideways_mm = (moved_mm.norm_squared() - value * value).max(0.0).sqrt();
    let tilted_rad = middle(far, |it| it.normal).angle(&middle(near, |it| it.normal));

    let noise = combined([far, near].map(noise_of_mean));
    let placing = scatter_of_means([&along(far), &along(near)]);
    let mut budget = vec![match placing {
        Some(placing) if placing > noise => contribution("putting the board down again", placing),
        _ => contribution("noise of the mean positions", noise),
    }];
    budget.push(contribution("direction of the board's normal", sideways_mm * tilted_rad));
    let standard = combined(budget.iter().map(|it| it.standard_uncertainty_mm));

    let seen = |group: &[Place], is_near: bool| -> Vec<PlaceSeen> {
        let seen = |place: &Place| PlaceSeen {
            from_s: place.from_s,
            until_s: place.until_s,
            frames: place.frames,
            height_mm: Estimate::new(far_mm - place.along_mm.value, place.along_mm.standard),
            is_near,
        };
        group.iter().map(seen).collect()
    };
    let mut places = [seen(far, false), seen(near, true)].concat();
    places.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    Step {
        along_normal_mm: Estimate::new(value, standard),
        sideways_mm,
        in_space_mm: moved_mm.norm(),
        tilted_deg: tilted_rad.to_degrees(),
        budget,
        is_placing_known: placing.is_some(),
        places,
        normal,
        far_mm,
    }
}

fn contribution(source: &'static str, standard_uncertainty_mm: f64) -> Contribution {
    Contribution { source, standard_uncertainty_mm }
}

fn noise_of_mean(group: &[Place]) -> f64 {
    combined(group.iter().map(|it| it.along_mm.standard)) / group.len() as f64
}

/// The standard uncertainty of the difference of two groups' means, from the scatter within both
/// groups together; `None` where there are too few places for it.
fn scatter_of_means(groups: [&[f64]; 2]) -> Option<f64> {
    let freedom = groups.iter().map(|it| it.len() - 1).sum::<usize>();
    if freedom < REPEATS_MIN {
        return None;
    }
    let squares = |group: &&[f64]| {
        let mean = mean(group);
        group.iter().map(|it| (it - mean).powi(2)).sum::<f64>()
    };
    let variance = groups.iter().map(squares).sum::<f64>() / freedom as f64;
    let of_means: f64 = groups.iter().map(|it| 1.0 / it.len() as f64).sum();
    Some((variance * few_values(freedom as f64) * of_means).sqrt())
}

/// The parts of recordings as slices, for [`step`].
#[must_use]
pub fn slices<'a>(sightings: &'a [Sighting], parts: &[Range<usize>]) -> Vec<&'a [Sighting]> {
    parts.iter().map(|part| &sightings[part.clone()]).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;
    use plumbline::pose::{Cam, Pose, Target};

    use super::*;
    use crate::testing::{COVERED_OF_1000, NOISE, Random};

    const THICKNESS_MM: f64 = 10.0;

    fn board() -> Pose<Cam, Target> {
        Pose::from_theta([0.1, 0.3, -0.2, 5.0, 8.0, 900.0])
    }

    /// A board that is put down with and without the block in turn, each time tilted by half a
    /// milliradian about both axes, and off by so much sideways and along its normal.
    fn session(
        random: &mut Random,
        [places, frames]: [usize; 2],
        thickness_mm: f64,
        [sideways_mm, scatter_mm]: [f64; 2],
    ) -> Vec<Vec<Sighting>> {
        let frame = |random: &mut Random, at: usize| {
            let height_mm = if at % 2 == 1 { thickness_mm } else { 0.0 };
            let off_mm = Vector3::new(
                sideways_mm * random.normal(),
                sideways_mm * random.normal(),
                scatter_mm * random.normal() - height_mm,
            );
            let tilt_rad = 5e-4;
            let turn_rad = [tilt_rad * random.normal(), tilt_rad * random.normal(), 0.0];
            let off_mm = board().rotation * off_mm;
            let mut off = Vector6::zeros();
            off.fixed_rows_mut::<3>(0).copy_from(&Vector3::from(turn_rad));
            off.fixed_rows_mut::<3>(3).copy_from(&off_mm);
            let pose = board().moved_by(&off);
            random.sightings(frames, |_| pose)
        };
        (0..places).map(|at| frame(random, at)).collect()
    }

    fn measured(session: &[Vec<Sighting>]) -> Result<Step, NoStep> {
        step(&session.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Of a board that was moved far sideways the direction of the normal is all that matters; its
    /// uncertainty is on the safe side.
    #[test]
    fn the_step_is_within_u_of_the_thickness_in_95_of_100_sessions() {
        for (places, off_mm) in [(2, [2.0, 0.0]), (6, [2.0, 0.01]), (2, [30.0, 0.0])] {
            let mut random = Random::new(places as u64);
            let covered = (0..1000).filter(|_| {
                let session = session(&mut random, [places, 60], THICKNESS_MM, off_mm);
                measured(&session).unwrap().along_normal_mm.covers(THICKNESS_MM)
            });
            let covered = covered.count();
            // An uncertainty that is far too large would cover everything.
            let good = *COVERED_OF_1000.start()..=990;
            assert!(good.contains(&covered), "{places} places, {off_mm:?}: {covered}");
        }
    }

    #[test]
    fn what_was_done_is_said() {
        let mut random = Random::new(1);
        let rests = session(&mut random, [6, 60], THICKNESS_MM, [2.0, 0.05]);
        let found = measured(&rests).unwrap();
        assert!(found.is_placing_known);
        assert_eq!(found.budget[0].source, "putting the board down again");
        let near: Vec<bool> = found.places.iter().map(|it| it.is_near).collect();
        // All of them begin at the time 0; each group has three.
        assert_eq!(near.iter().filter(|it| **it).count(), 3);
        assert!(found.in_space_mm >= found.along_normal_mm.value);
        // The mean height of a place's frames is that of the place.
        for sightings in &rests {
            let heights: Vec<f64> = sightings.iter().map(|it| found.height_mm(it)).collect();
            let height_mm = mean(&heights);
            let is_there = |it: &PlaceSeen| (it.height_mm.value - height_mm).abs() < 1e-9;
            assert_eq!(found.places.iter().filter(|it| is_there(it)).count(), 1);
        }
        let along_and_across_mm = found.along_normal_mm.value.hypot(found.sideways_mm);
        assert!((found.in_space_mm - along_and_across_mm).abs() < 1e-9);

        let once = measured(&session(&mut random, [2, 60], THICKNESS_MM, [2.0, 0.0])).unwrap();
        assert!(!once.is_placing_known);
        // Noise along the normal is near that of the depth; the mean of 60 frames has an eighth.
        let noise_mm = once.budget[0].standard_uncertainty_mm;
        let expected_mm = NOISE[5] * (2.0_f64 / 60.0).sqrt();
        assert!((0.7..1.5).contains(&(noise_mm / expected_mm)), "{noise_mm}");
    }

    #[test]
    fn what_is_no_step_is_refused() {
        let mut random = Random::new(2);
        let none = measured(&session(&mut random, [2, 60], 0.0, [2.0, 0.0]));
        assert!(matches!(none, Err(NoStep::Lost(step)) if step.value.abs() < 0.02), "{none:?}");
        let one = measured(&session(&mut random, [1, 60], THICKNESS_MM, [2.0, 0.0]));
        assert_eq!(one.unwrap_err(), NoStep::TooFewPlaces(1));
        let short = measured(&session(&mut random, [4, FRAMES_MIN - 1], THICKNESS_MM, [2.0, 0.0]));
        assert_eq!(short.unwrap_err(), NoStep::TooFewPlaces(0));
    }
}
