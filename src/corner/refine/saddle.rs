//! The saddle of a quadratic fitted to a cone-smoothed window: the linear step.
//!
//! ROCHADE (Placht et al. 2014) and Deltille (Ha et al. 2017) smooth the window
//! with a cone, which turns the corner's four flat sectors into a wide saddle,
//! and fit z = k0 + kx x + ky y + kxx x^2 + kxy x y + kyy y^2 to it by least
//! squares. Smoothing and fit are both linear in the pixels, so that the six
//! coefficients are six inner products of the raw window with constant kernels;
//! the saddle is where the quadratic's gradient vanishes. Only five are kept:
//! nobody needs k0.
//!
//! The cone is the larger part of the window: that halves the pull towards the
//! window's middle, which is left of a fit that is no model of the corner (see
//! the module's table). It needs neither contrast nor blur nor edges, and finds
//! the corner from farther away than the model fit could start.

use super::RefineFailure;
use super::patch::{LANES, Lanes, Patch, RADIUS_PX_MAX, RADIUS_PX_MIN};

/// The smaller curvature must reach this part of the larger: an edge alone has
/// one curvature only. A seed two pixels off sees a lopsided saddle.
const CURVATURE_RATIO_MIN: f32 = 0.1;

/// The kernels of the quadratic's coefficients for one radius, over the raw window.
struct Kernels<const CHUNKS: usize> {
    x: [Lanes; CHUNKS],
    y: [Lanes; CHUNKS],
    xx: [Lanes; CHUNKS],
    xy: [Lanes; CHUNKS],
    yy: [Lanes; CHUNKS],
}

/// A quadratic's coefficients without the constant one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadratic {
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
    yy: f32,
}

/// Half width of the cone for a window of half width `radius`; the quadratic is
/// fitted to the rest.
const fn cone_radius(radius: usize) -> usize {
    radius.div_ceil(2)
}

/// Square root by Newton's steps, for the tables: the library's is not const.
const fn square_root(value: f64) -> f64 {
    let mut root = 0.5 * (1.0 + value);
    let mut step = 0;
    while step < 12 {
        root = 0.5 * (root + value / root);
        step += 1;
    }
    root
}

const fn chunks_of(radius: usize) -> usize {
    (2 * radius + 1).pow(2).div_ceil(LANES)
}

impl<const CHUNKS: usize> Kernels<CHUNKS> {
    const fn new(radius: usize) -> Self {
        let cone = cone_radius(radius) as isize;
        let fit = radius as isize - cone;
        let mut cone_sum = 0.0;
        let mut v = -cone;
        while v <= cone {
            let mut u = -cone;
            while u <= cone {
                cone_sum += cone_weight(u, v, cone);
                u += 1;
            }
            v += 1;
        }
        // Sums of x^2 and x^4 along one side of the fitted square.
        let (mut second, mut fourth) = (0.0, 0.0);
        let mut u = -fit;
        while u <= fit {
            let square = (u * u) as f64;
            second += square;
            fourth += square * square;
            u += 1;
        }
        let side = (2 * fit + 1) as f64;
        let mean = second / side;
        let spread = side * (fourth - second * mean);

        let zero = [[0.0; LANES]; CHUNKS];
        let mut kernels = Self { x: zero, y: zero, xx: zero, xy: zero, yy: zero };
        let width = 2 * radius + 1;
        let mut index = 0;
        while index < width * width {
            let px = (index % width) as isize - radius as isize;
            let py = (index / width) as isize - radius as isize;
            let mut sums = [0.0_f64; 5];
            // The cone at this pixel reaches these points of the fitted square.
            let mut v = max(-fit, py - cone);
            while v <= min(fit, py + cone) {
                let mut u = max(-fit, px - cone);
                while u <= min(fit, px + cone) {
                    let weight = cone_weight(px - u, py - v, cone) / cone_sum;
                    let (x, y) = (u as f64, v as f64);
                    sums[0] += weight * x / (side * second);
                    sums[1] += weight * y / (side * second);
                    sums[2] += weight * (x * x - mean) / spread;
                    sums[3] += weight * x * y / (second * second);
                    sums[4] += weight * (y * y - mean) / spread;
                    u += 1;
                }
                v += 1;
            }
            let (chunk, lane) = (index / LANES, index % LANES);
            kernels.x[chunk][lane] = sums[0] as f32;
            kernels.y[chunk][lane] = sums[1] as f32;
            kernels.xx[chunk][lane] = sums[2] as f32;
            kernels.xy[chunk][lane] = sums[3] as f32;
            kernels.yy[chunk][lane] = sums[4] as f32;
            index += 1;
        }
        kernels
    }

    fn fit(&self, patch: &Patch) -> Quadratic {
        let mut sums = [[0.0_f32; LANES]; 5];
        let kernels = self.x.iter().zip(&self.y).zip(&self.xx).zip(&self.xy).zip(&self.yy);
        for (value, ((((x, y), xx), xy), yy)) in patch.value.iter().zip(kernels) {
            for lane in 0..LANES {
                sums[0][lane] += value[lane] * x[lane];
                sums[1][lane] += value[lane] * y[lane];
                sums[2][lane] += value[lane] * xx[lane];
                sums[3][lane] += value[lane] * xy[lane];
                sums[4][lane] += value[lane] * yy[lane];
            }
        }
        let [x, y, xx, xy, yy] = sums.map(|lanes| lanes.iter().sum());
        Quadratic { x, y, xx, xy, yy }
    }

    /// Sums of the squares of the two slope kernels: what white noise of
    /// variance 1 does to the gradient.
    fn slope_noise(&self) -> f32 {
        self.x.as_flattened().iter().map(|weight| weight * weight).sum()
    }
}

const fn max(a: isize, b: isize) -> isize {
    if a > b { a } else { b }
}

const fn min(a: isize, b: isize) -> isize {
    if a < b { a } else { b }
}

const fn cone_weight(u: isize, v: isize, cone: isize) -> f64 {
    let weight = (cone + 1) as f64 - square_root((u * u + v * v) as f64);
    if weight > 0.0 { weight } else { 0.0 }
}

static RADIUS_3: Kernels<{ chunks_of(3) }> = Kernels::new(3);
static RADIUS_4: Kernels<{ chunks_of(4) }> = Kernels::new(4);
static RADIUS_5: Kernels<{ chunks_of(5) }> = Kernels::new(5);
static RADIUS_6: Kernels<{ chunks_of(6) }> = Kernels::new(6);
static RADIUS_7: Kernels<{ chunks_of(7) }> = Kernels::new(7);
static RADIUS_8: Kernels<{ chunks_of(8) }> = Kernels::new(8);

/// The quadratic of a window, by the table of its radius.
pub(super) fn fit(patch: &Patch) -> Quadratic {
    const { assert!(RADIUS_PX_MIN == 3 && RADIUS_PX_MAX == 8) };
    match patch.radius {
        3 => RADIUS_3.fit(patch),
        4 => RADIUS_4.fit(patch),
        5 => RADIUS_5.fit(patch),
        6 => RADIUS_6.fit(patch),
        7 => RADIUS_7.fit(patch),
        _ => RADIUS_8.fit(patch),
    }
}

fn slope_noise(radius: usize) -> f32 {
    match radius {
        3 => RADIUS_3.slope_noise(),
        4 => RADIUS_4.slope_noise(),
        5 => RADIUS_5.slope_noise(),
        6 => RADIUS_6.slope_noise(),
        7 => RADIUS_7.slope_noise(),
        _ => RADIUS_8.slope_noise(),
    }
}

impl Quadratic {
    /// Where the gradient vanishes, relative to the window's middle.
    ///
    /// # Errors
    /// [`RefineFailure::NotASaddle`] unless the two curvatures have opposite
    /// signs and comparable sizes.
    pub(super) fn saddle_px(&self) -> Result<[f32; 2], RefineFailure> {
        let determinant = 4.0 * self.xx * self.yy - self.xy * self.xy;
        let trace = 2.0 * (self.xx + self.yy);
        // With curvatures k1 > 0 > k2 and |k2| = r k1: determinant = -r k1^2 and
        // trace = (1 - r) k1, so that trace^2 / -determinant = (1 - r)^2 / r.
        let bound = (1.0 - CURVATURE_RATIO_MIN) * (1.0 - CURVATURE_RATIO_MIN) / CURVATURE_RATIO_MIN;
        // Written so that a NaN fails; a black window has determinant 0.
        if !(determinant < 0.0 && trace * trace < -bound * determinant) {
            return Err(RefineFailure::NotASaddle);
        }
        Ok([
            (self.xy * self.y - 2.0 * self.yy * self.x) / determinant,
            (self.xy * self.x - 2.0 * self.xx * self.y) / determinant,
        ])
    }

    /// Second derivative along a direction.
    fn curvature(&self, direction: [f32; 2]) -> f32 {
        let [x, y] = direction;
        2.0 * (self.xx * x * x + self.xy * x * y + self.yy * y * y)
    }

    /// Whether the sector in which the quadratic falls is the one between the
    /// edges that the seed calls dark; `dark` is that sector's bisector.
    pub(super) fn agrees_with(&self, dark: [f32; 2]) -> bool {
        self.curvature(dark) < self.curvature([-dark[1], dark[0]])
    }

    /// Standard deviation of one coordinate of the saddle, for white noise of
    /// standard deviation `noise`.
    pub(super) fn sigma_px(&self, radius: usize, noise: f32) -> f32 {
        let determinant = 4.0 * self.xx * self.yy - self.xy * self.xy;
        // Mean of the squared rows of the inverse Hessian.
        let squares = 4.0 * (self.xx * self.xx + self.yy * self.yy) + 2.0 * self.xy * self.xy;
        noise * libm::sqrtf(0.5 * squares * slope_noise(radius)) / determinant.abs()
    }
}
