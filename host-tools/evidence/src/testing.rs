//! What the tests share: random values and boards, and the bounds of a coverage.

use std::ops::RangeInclusive;

use nalgebra::{Matrix6, Vector6};
use plumbline::lens::{Distortion, Lens};
use plumbline::pose::{Cam, Pose, Target};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::sighting::Sighting;

/// How many of 1000 intervals of 95 % cover the truth, with three of the binomial's standard
/// deviations of 6.9 to either side; and k = 2 is 95.45 %, 4.5 more.
pub const COVERED_OF_1000: RangeInclusive<usize> = 929..=975;

/// Frames per second.
pub const RATE_HZ: f64 = 30.0;

/// Standard deviations of the noise: turns about the board's axes in radians, then x, y and z, mm.
pub const NOISE: [f64; 6] = [3e-4, 3e-4, 3e-5, 0.002, 0.004, 0.02];

/// Random values from a fixed seed.
pub struct Random(ChaCha8Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// A normal value of standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Values of a first-order autoregressive process of standard deviation 1.
    pub fn process(&mut self, count: usize, phi: f64) -> Vec<f64> {
        let mut value = self.normal();
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(value);
            value = phi * value + (1.0 - phi * phi).sqrt() * self.normal();
        }
        values
    }

    /// A pose with the noise of one frame.
    pub fn sighting(&mut self, time_s: f64, truth: &Pose<Cam, Target>) -> Sighting {
        let noise = Vector6::from_fn(|axis, _| NOISE[axis] * self.normal());
        let covariance = Matrix6::from_diagonal(&Vector6::from(NOISE.map(|sd| sd * sd)));
        Sighting { time_s, cam_from_board: truth.moved_by(&noise), covariance }
    }

    /// A board that stands where `truth` says at each time.
    pub fn sightings(
        &mut self,
        frames: usize,
        truth: impl Fn(f64) -> Pose<Cam, Target>,
    ) -> Vec<Sighting> {
        let times = (0..frames).map(|frame| frame as f64 / RATE_HZ);
        times.map(|time_s| self.sighting(time_s, &truth(time_s))).collect()
    }
}

/// A camera of 640 x 480 pixels.
pub fn lens() -> Lens {
    Lens {
        width_px: 640,
        height_px: 480,
        fx_px: 800.0,
        fy_px: 800.0,
        cx_px: 319.5,
        cy_px: 239.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
    }
}
