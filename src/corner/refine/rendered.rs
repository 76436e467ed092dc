//! Test pictures of one corner, exact to 1e-6 of the contrast: a Gaussian blur
//! of the ideal corner in closed form, integrated over each pixel's box.

extern crate std;
use std::vec::Vec;

use crate::image::GreyImage;

/// Side of the picture: the smallest frame allowed.
pub(super) const SIDE: usize = 64;

/// Pixels farther than this from the corner are not rendered.
const REACH_PX: f64 = 12.0;

/// Abscissas and weights on [0, 1] of Gauss and Legendre's rules.
struct Rule<const N: usize>([(f64, f64); N]);

impl<const N: usize> Rule<N> {
    /// Newton's method on the Legendre polynomial of degree N.
    fn new() -> Self {
        let mut rule = [(0.0, 0.0); N];
        let degree = N as f64;
        for (index, entry) in rule.iter_mut().enumerate() {
            let mut x = libm::cos(core::f64::consts::PI * (index as f64 + 0.75) / (degree + 0.5));
            let mut slope = 0.0;
            for _ in 0..20 {
                let (mut before, mut value) = (1.0, x);
                for k in 2..=N {
                    let k = k as f64;
                    (before, value) =
                        (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
                }
                slope = degree * (x * value - before) / (x * x - 1.0);
                x -= value / slope;
            }
            *entry = (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope));
        }
        Self(rule)
    }

    fn integrate(&self, function: impl Fn(f64) -> f64) -> f64 {
        self.0.iter().map(|&(x, weight)| weight * function(x)).sum()
    }
}

/// A corner to render.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene {
    pub(super) position_px: [f64; 2],
    /// Edge directions; the second within (0, pi) above the first.
    pub(super) edges_rad: [f64; 2],
    pub(super) blur_px: f64,
    pub(super) dark: f64,
    pub(super) light: f64,
}

impl Scene {
    /// Full contrast 120 around 120, edges at right angles.
    pub(super) fn new(position_px: [f64; 2], first_edge_rad: f64, blur_px: f64) -> Self {
        let edges_rad = [first_edge_rad, first_edge_rad + core::f64::consts::FRAC_PI_2];
        Self { position_px, edges_rad, blur_px, dark: 60.0, light: 180.0 }
    }

    /// As seen on a board tilted by `tilt_rad` about an axis 45 degrees from
    /// its edges, which closes the angle between the edges most, the whole
    /// turned by `turn_rad`.
    pub(super) fn tilted(self, tilt_rad: f64, turn_rad: f64) -> Self {
        let half = libm::atan(libm::cos(tilt_rad));
        Self { edges_rad: [turn_rad - half, turn_rad + half], ..self }
    }

    /// The exact picture.
    pub(super) fn render(&self) -> Picture {
        let (orthant, pixel) = (Rule::<16>::new(), Rule::<5>::new());
        let mean = 0.5 * (self.dark + self.light);
        let half = 0.5 * (self.light - self.dark);
        let mut levels = std::vec![mean; SIDE * SIDE];
        for (index, level) in levels.iter_mut().enumerate() {
            let x = (index % SIDE) as f64 - self.position_px[0];
            let y = (index / SIDE) as f64 - self.position_px[1];
            if x.abs() > REACH_PX || y.abs() > REACH_PX {
                continue;
            }
            let profile = pixel.integrate(|v| {
                pixel.integrate(|u| {
                    corner_profile(
                        &orthant,
                        self.edges_rad,
                        self.blur_px,
                        [x + u - 0.5, y + v - 0.5],
                    )
                })
            });
            *level = mean + half * profile;
        }
        Picture { levels }
    }

    /// Seed at the true place with the true edges.
    pub(super) fn seed(&self, radius_px: usize) -> super::CornerSeed {
        super::CornerSeed { position_px: self.position_px, edges_rad: self.edges_rad, radius_px }
    }
}

/// sign(d0) sign(d1) behind a Gaussian blur, at a point relative to the corner.
fn corner_profile(orthant: &Rule<16>, edges_rad: [f64; 2], blur_px: f64, [x, y]: [f64; 2]) -> f64 {
    let [a, b] = edges_rad.map(|edge| (libm::cos(edge) * y - libm::sin(edge) * x) / blur_px);
    normal_product(orthant, a, b, core::f64::consts::FRAC_PI_2 - (edges_rad[1] - edges_rad[0]))
}

/// E[sign(a + u) sign(b + v)] for standard normal u, v of correlation sin(theta).
fn normal_product(orthant: &Rule<16>, a: f64, b: f64, theta: f64) -> f64 {
    let product = libm::erf(a * core::f64::consts::FRAC_1_SQRT_2)
        * libm::erf(b * core::f64::consts::FRAC_1_SQRT_2);
    let squares = a * a + b * b;
    if theta == 0.0 || squares > 200.0 {
        return product;
    }
    let integral = orthant.integrate(|part| {
        let (sine, cosine) = libm::sincos(theta * part);
        libm::exp(-(squares - 2.0 * a * b * sine) / (2.0 * cosine * cosine))
    });
    product + core::f64::consts::FRAC_2_PI * theta * integral
}

/// Grey levels before noise and rounding.
pub(super) struct Picture {
    pub(super) levels: Vec<f64>,
}

impl Picture {
    /// With Gaussian noise, rounded to 8 bits.
    pub(super) fn sampled(&self, noise: f64, random: &mut Random) -> Vec<u8> {
        self.levels.iter().map(|level| (level + noise * random.normal() + 0.5) as u8).collect()
    }

    /// Without noise, 16 bits, black 0 and white 256 * 255: quantised 256 times finer.
    pub(super) fn fine(&self) -> Vec<u16> {
        self.levels.iter().map(|level| (level * 256.0 + 0.5) as u16).collect()
    }
}

pub(super) fn image(pixels: &[u8]) -> GreyImage<'_, u8> {
    GreyImage::new(pixels, SIDE, SIDE, SIDE).unwrap()
}

pub(super) fn fine_image(pixels: &[u16]) -> GreyImage<'_, u16> {
    GreyImage::with_white_level(pixels, SIDE, SIDE, SIDE, 255 * 256).unwrap()
}

/// SplitMix64 (Steele, Lea and Flood 2014) and Box and Muller's normal numbers.
pub(super) struct Random(pub(super) u64);

impl Random {
    /// Uniform in [0, 1).
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform()));
        radius * libm::cos(core::f64::consts::TAU * self.uniform())
    }
}

#[test]
fn orthant_probability_agrees_with_an_independent_computation() {
    let orthant = Rule::<16>::new();
    // 4 P(u < a, v < b) - 2 P(u < a) - 2 P(v < b) + 1, by
    // scipy.stats.multivariate_normal.cdf at a tolerance of 1e-12.
    for (a, b, correlation, expected) in SCIPY {
        let theta = libm::asin(correlation);
        let found = normal_product(&orthant, a, b, theta);
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

const SCIPY: [(f64, f64, f64, f64); 4] = [
    (0.0, 0.0, 0.5, 0.333333333333),
    (0.3, -1.1, 0.6, 0.000023617216),
    (1.7, 0.9, -0.45, 0.546423680085),
    (-0.2, -0.8, 0.2, 0.183670321186),
];
