//! What several modules' tests share: a seeded generator that gives the same
//! numbers on every machine.

use nalgebra::{Vector2, Vector3};

/// Steele, Lea and Flood's SplitMix64 (2014): 64 bits of state, every seed good.
pub struct Random {
    state: u64,
}

impl Random {
    /// The generator of a seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in `low..high`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1_u64 << 53) as f64)
    }

    /// Normal, mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        // 1 - u lies in (0, 1], where the logarithm is finite.
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform(0.0, 1.0)));
        radius * libm::cos(self.uniform(0.0, core::f64::consts::TAU))
    }

    /// Two independent normals.
    pub fn normal2(&mut self) -> Vector2<f64> {
        Vector2::new(self.normal(), self.normal())
    }

    /// A direction, uniform over the sphere.
    pub fn direction(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()).normalize()
    }
}

#[test]
fn the_normals_have_mean_0_and_sd_1() {
    const COUNT: usize = 100_000;
    let mut random = Random::new(1);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..COUNT {
        let value = random.normal();
        sum += value;
        squares += value * value;
    }
    // Standard errors: 1 / sqrt(N) = 0.0032 of the mean, sqrt(2 / N) = 0.0045 of the variance.
    assert!((sum / COUNT as f64).abs() < 0.012);
    assert!((squares / COUNT as f64 - 1.0).abs() < 0.018);
}
