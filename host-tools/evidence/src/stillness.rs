//! Whether, and when, a board stood still.
//!
//! At each frame the mean pose of the half second before is compared with that of the half second
//! after. The board is moving where any of the six coordinates differs by more than three times the
//! noise of one frame, and by more than 0.02 mm or 0.02 degrees, which no footstep in the room
//! causes. Two means of 15 frames differ by 0.4 times the noise of one frame, so that noise alone
//! never reaches the bound. A drift of less than 2 mm per minute is not a movement:
//! [`repeatability`](crate::repeatability) measures it.

use std::ops::Range;

use plumbline_analysis::statistics::describe::median;
use serde::Serialize;

use crate::sighting::{COORDINATES, Deviations, Sighting};

/// Length of each of the two parts that are compared.
const PART_S: f64 = 0.5;

/// A mean of fewer frames is too noisy.
const PART_FRAMES_MIN: usize = 8;

/// At 480 frames per second or more the parts are shorter.
const PART_FRAMES_MAX: usize = 240;

/// Difference of two parts, in units of the noise of one frame.
const DIFFERENCE_NOISES: f64 = 3.0;

/// Difference of two parts that matters, mm and degrees.
const DIFFERENCE_MIN: f64 = 0.02;

/// The median of the absolute value of a normal variable.
pub(crate) const MEDIAN_OF_ABSOLUTE: f64 = 0.674_489_75;

/// A board that moved.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Movement {
    /// When it moved fastest.
    pub time_s: f64,
    /// By how much within about half a second.
    pub by_mm: f64,
    /// By how much it turned.
    pub by_deg: f64,
}

/// What was found of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Stillness {
    /// Where the board stood still: indices of sightings.
    pub parts: Vec<Range<usize>>,
    /// When it moved, between these parts.
    pub movements: Vec<Movement>,
}

impl Stillness {
    /// The longest part.
    #[must_use]
    pub fn longest(&self) -> Option<&Range<usize>> {
        self.parts.iter().max_by_key(|part| part.len())
    }
}

/// The number of frames in half a second, for sightings at the rate of these.
#[must_use]
pub fn part_frames(sightings: &[Sighting]) -> usize {
    let apart_s = sightings.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
    let usual_s = median(apart_s).unwrap_or(PART_S);
    // `as` turns what is not finite into the largest number, or 0.
    ((PART_S / usual_s).round() as usize).clamp(PART_FRAMES_MIN, PART_FRAMES_MAX)
}

/// Finds the parts of a recording in which the board stood still. One that is shorter than two
/// half seconds counts as still: nothing is known of it.
///
/// Costs O(n).
#[must_use]
pub fn stillness(sightings: &[Sighting]) -> Stillness {
    let (count, width) = (sightings.len(), part_frames(sightings));
    if count < 2 * width {
        return Stillness {
            parts: Vec::from_iter((count > 0).then_some(0..count)),
            movements: Vec::new(),
        };
    }
    let Deviations { values, .. } = Deviations::of(sightings);
    let changes: [Vec<f64>; 6] = std::array::from_fn(|axis| changes(&values[axis], width));
    let bounds: [f64; 6] = std::array::from_fn(|axis| {
        (DIFFERENCE_NOISES * robust_noise(&values[axis])).max(DIFFERENCE_MIN)
    });
    // The change in units of the bound, at each frame that has both parts around it.
    let excess =
        |at: usize| (0..6).map(|axis| changes[axis][at].abs() / bounds[axis]).fold(0.0, f64::max);
    let mut found = Stillness { parts: Vec::new(), movements: Vec::new() };
    let mut still_from = 0;
    let mut at = 0;
    while at < changes[0].len() {
        if excess(at) <= 1.0 {
            at += 1;
            continue;
        }
        let end = (at..changes[0].len()).find(|&it| excess(it) <= 1.0).unwrap_or(changes[0].len());
        let fastest = (at..end).max_by(|a, b| excess(*a).total_cmp(&excess(*b))).unwrap_or(at);
        let size = |axes: Range<usize>| {
            axes.map(|axis| changes[axis][fastest].powi(2)).sum::<f64>().sqrt()
        };
        found.movements.push(Movement {
            time_s: sightings[fastest + width].time_s,
            by_mm: size(0..3),
            by_deg: size(3..COORDINATES.len()),
        });
        // The change at `at` is that between the frames before and from `at + width` on.
        let (moved_from, moved_to) = (at + width, end + width);
        found.parts.push(still_from..moved_from);
        still_from = moved_to;
        at = end;
    }
    // One that moved until the end has not come to rest.
    found.parts.push(still_from..count);
    found.parts.retain(|part| part.len() >= width);
    found
}

/// The mean of the `width` values from each on less that of the `width` values before it.
fn changes(values: &[f64], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let middle = width..=values.len() - width;
    middle.map(|at| (sums[at + width] - 2.0 * sums[at] + sums[at - width]) / width as f64).collect()
}

/// The noise of one value, from the median of successive differences: a few movements change
/// nothing.
fn robust_noise(values: &[f64]) -> f64 {
    let differences = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    median(differences).unwrap_or(0.0) / (MEDIAN_OF_ABSOLUTE * 2_f64.sqrt())
}

#[cfg(test)]
mod tests {
    use plumbline::pose::{Cam, Pose, Target};

    use super::*;
    use crate::testing::{RATE_HZ, Random};

    fn at_depth(z_mm: f64) -> Pose<Cam, Target> {
        Pose::from_theta([0.1, 0.2, -0.1, 5.0, 8.0, z_mm])
    }

    #[test]
    fn a_board_that_stands_still_or_drifts_has_not_moved() {
        for (seed, mm_per_min) in [(1, 0.0), (2, 1.0)] {
            let sightings = Random::new(seed)
                .sightings(3000, |time_s| at_depth(900.0 + mm_per_min * time_s / 60.0));
            let found = stillness(&sightings);
            assert_eq!((found.longest(), found.movements.len()), (Some(&(0..3000)), 0));
        }
    }

    #[test]
    fn a_movement_is_found_when_it_was_and_as_large_as_it_was() {
        // Steps of a tenth of a millimetre, five times the noise of one frame, and of 10 mm.
        for step_mm in [0.1, 10.0] {
            let sightings = Random::new(3).sightings(900, |time_s| {
                at_depth(900.0 + if time_s < 12.0 { 0.0 } else { step_mm })
            });
            let found = stillness(&sightings);
            assert_eq!(found.movements.len(), 1, "{found:?}");
            let Movement { time_s, by_mm, .. } = found.movements[0];
            // Means of 15 frames differ by 0.007 mm.
            assert!((by_mm - step_mm).abs() < 0.03, "{by_mm}");
            assert!((time_s - 12.0).abs() < 0.2, "{time_s}");
            // No frame of the other side is in a part.
            let [before, after] = &found.parts[..] else { panic!("{found:?}") };
            assert!(before.end <= 360 && after.start >= 360, "{found:?}");
            assert!(before.len() > 330 && after.len() > 510, "{found:?}");
        }
    }

    #[test]
    fn a_board_that_is_carried_is_never_still() {
        let carried = |time_s: f64| at_depth(900.0 + 20.0 * (4.0 * time_s).sin());
        let found = stillness(&Random::new(4).sightings(600, carried));
        let still: usize = found.parts.iter().map(Range::len).sum();
        // At the turning points it is slow.
        assert!(still < 60, "{found:?}");
    }

    #[test]
    fn a_turn_alone_is_a_movement() {
        let turned = |time_s: f64| {
            let turn_rad = if time_s < 5.0 { 0.2 } else { 0.21 };
            Pose::from_theta([0.1, turn_rad, -0.1, 5.0, 8.0, 900.0])
        };
        let found = stillness(&Random::new(5).sightings(300, turned));
        assert!((found.movements[0].by_deg - 0.57).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn few_frames_are_taken_as_they_are() {
        let frames = |count| Random::new(6).sightings(count, |_| at_depth(900.0));
        assert_eq!(part_frames(&frames(100)), (0.5 * RATE_HZ) as usize);
        assert_eq!(stillness(&frames(10)).longest(), Some(&(0..10)));
        assert_eq!(stillness(&[]).parts, [] as [Range<usize>; 0]);
    }
}
