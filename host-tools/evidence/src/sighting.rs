//! A board in a frame, a board at rest, and the points on it.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3};
use plumbline::pose::{Cam, Pose, Target};
use plumbline_calibration::rotation::mean_pose;

/// One board in one frame.
#[derive(Debug, Clone, Copy)]
pub struct Sighting {
    /// When the board was exposed: with a rolling shutter, two boards of one frame at different
    /// times.
    pub time_s: f64,
    /// The pose.
    pub cam_from_board: Pose<Cam, Target>,
    /// What the tracker says of its uncertainty: the covariance of `[omega_rad, delta_mm]`, the
    /// increments of [`Pose::moved_by`].
    pub covariance: Matrix6<f64>,
}

/// A point in the camera's frame.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Where it is.
    pub position_mm: Vector3<f64>,
    /// What the tracker says of its uncertainty.
    pub covariance_mm2: Matrix3<f64>,
}

impl Sighting {
    /// A point that is fixed to the board.
    #[must_use]
    pub fn point(&self, board_mm: &Vector3<f64>) -> Point {
        let jacobian = self.cam_from_board.point_by_increment(board_mm);
        Point {
            position_mm: self.cam_from_board.transform(board_mm),
            covariance_mm2: jacobian * self.covariance * jacobian.transpose(),
        }
    }

    /// The board's normal, away from the camera.
    #[must_use]
    pub fn normal(&self) -> Vector3<f64> {
        self.cam_from_board.rotation.column(2).into_owned()
    }
}

/// The six coordinates of a pose near another one.
pub const COORDINATES: [Coordinate; 6] = [
    Coordinate { name: "x", unit: "mm" },
    Coordinate { name: "y", unit: "mm" },
    Coordinate { name: "z (depth)", unit: "mm" },
    Coordinate { name: "turn about x", unit: "deg" },
    Coordinate { name: "turn about y", unit: "deg" },
    Coordinate { name: "turn about z", unit: "deg" },
];

/// One of the six coordinates: positions along the camera's axes, turns about the board's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Coordinate {
    /// Its name for people.
    pub name: &'static str,
    /// `mm` or `deg`.
    pub unit: &'static str,
}

/// How a board's pose differs from its mean in each frame, coordinate by coordinate.
pub struct Deviations {
    /// The mean pose.
    pub mean: Pose<Cam, Target>,
    /// In the order of [`COORDINATES`], for each a value per frame.
    pub values: [Vec<f64>; 6],
    /// The variances of these values, as the tracker says.
    pub variances: [Vec<f64>; 6],
}

impl Deviations {
    /// The deviations from the [mean pose](mean_pose).
    ///
    /// # Panics
    /// When there are no sightings: a caller's bug.
    #[must_use]
    pub fn of(sightings: &[Sighting]) -> Self {
        let poses: Vec<Pose<Cam, Target>> = sightings.iter().map(|it| it.cam_from_board).collect();
        let mean = mean_pose(&poses);
        let board_from_cam = mean.rotation.transpose();
        let of = |sighting: &Sighting| -> [f64; 6] {
            let pose = &sighting.cam_from_board;
            let delta_mm = pose.translation_mm - mean.translation_mm;
            let turn = Rotation3::from_matrix_unchecked(board_from_cam * pose.rotation);
            let turn_deg = turn.scaled_axis().map(f64::to_degrees);
            [delta_mm.x, delta_mm.y, delta_mm.z, turn_deg.x, turn_deg.y, turn_deg.z]
        };
        let each: Vec<[f64; 6]> = sightings.iter().map(of).collect();
        let variance = |sighting: &Sighting, axis: usize| match axis {
            0..3 => sighting.covariance[(axis + 3, axis + 3)],
            _ => sighting.covariance[(axis - 3, axis - 3)] * 1_f64.to_degrees().powi(2),
        };
        Self {
            mean,
            values: std::array::from_fn(|axis| each.iter().map(|it| it[axis]).collect()),
            variances: std::array::from_fn(|axis| {
                sightings.iter().map(|it| variance(it, axis)).collect()
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::testing::{NOISE, Random};

    #[test]
    fn deviations_are_the_increments_from_the_mean() {
        let mean = Pose::<Cam, Target>::from_theta([0.2, -0.4, 0.1, 30.0, -20.0, 900.0]);
        let step = Vector6::new(1e-3, -2e-3, 3e-3, 0.1, -0.2, 0.3);
        let sighting = |sign: f64| Sighting {
            time_s: 0.0,
            cam_from_board: mean.moved_by(&(sign * step)),
            covariance: Matrix6::identity(),
        };
        let found = Deviations::of(&[sighting(1.0), sighting(-1.0)]);
        assert!((found.mean.rotation - mean.rotation).norm() < 1e-12);
        for axis in 0..3 {
            assert!((found.values[axis][0] - step[axis + 3]).abs() < 1e-12);
            assert!((found.values[axis + 3][1] + step[axis].to_degrees()).abs() < 1e-9);
            assert_eq!(found.variances[axis][0], 1.0);
            assert!((found.variances[axis + 3][0].sqrt() - 1_f64.to_degrees()).abs() < 1e-12);
        }
    }

    /// The spread of 4000 points is known to 1.1 %, and their covariance to 2.3 % of its largest.
    #[test]
    fn a_points_covariance_is_that_of_its_positions() {
        let mut random = Random::new(5);
        let pose = Pose::from_theta([0.2, -0.4, 0.1, 30.0, -20.0, 900.0]);
        let lever_mm = Vector3::new(60.0, -40.0, 5.0);
        let points: Vec<Point> =
            (0..4000).map(|_| random.sighting(0.0, &pose).point(&lever_mm)).collect();
        let truth_mm = pose.transform(&lever_mm);
        let outer = |it: &Point| {
            let off_mm = it.position_mm - truth_mm;
            off_mm * off_mm.transpose()
        };
        let found: Matrix3<f64> = points.iter().map(outer).sum::<Matrix3<f64>>() / 4000.0;
        let stated = points[0].covariance_mm2;
        assert!((found - stated).norm() < 0.1 * stated.norm(), "{found} {stated}");
        // Turns matter at this lever, which they do not at the origin.
        assert!(stated[(2, 2)] > 1.5 * NOISE[5] * NOISE[5]);
    }
}
