//! What several modules' tests share: a seeded generator that gives the same
//! numbers on every machine, a lens, and the corners seen through it.

extern crate std;

use core::cell::RefCell;
use std::rc::Rc;

use nalgebra::{Vector2, Vector3};

use crate::fit::planar::SeenCorner;
use crate::limits::TARGET_CORNERS_MAX;
use crate::model::lens::{Distortion, Lens};
use crate::model::lens_table::LensTable;
use crate::model::pose::{Cam, Pose, Target};

pub mod drawing;

/// The corners of one target, as a tracker would see them.
pub type SeenCorners = heapless::Vec<SeenCorner, TARGET_CORNERS_MAX>;

/// How often a test repeats its work: `count` times, or a tenth of that in an emulator, where each
/// repetition takes at least ten times as long. `cargo xtask test` sets the variable.
pub fn repetitions(count: usize) -> usize {
    if std::env::var_os("PLUMBLINE_RUNNER").is_some() { count.div_ceil(10) } else { count }
}

/// Steele, Lea and Flood's SplitMix64 (2014): 64 bits of state; every seed is good.
pub struct Random {
    state: u64,
}

impl Random {
    /// A generator with this seed.
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
}

/// The lens of the bedside scene that the design assumes.
pub fn bedside_lens() -> Lens {
    Lens {
        width_px: 1456,
        height_px: 1088,
        fx_px: 1740.0,
        fy_px: 1741.0,
        cx_px: 731.0,
        cy_px: 540.0,
        skew_px: 0.3,
        distortion: Distortion::Brown5([-0.12, 0.08, 0.0005, 0.0003, 0.0]),
    }
}

std::thread_local! {
    /// The table that was made last: tests ask for the same one thousands of times.
    static LAST_TABLE: RefCell<Option<(Lens, Rc<LensTable>)>> = const { RefCell::new(None) };
}

/// A lens's table.
pub fn table(lens: &Lens) -> Rc<LensTable> {
    LAST_TABLE.with_borrow_mut(|last| match last {
        Some((of, table)) if of == lens => table.clone(),
        _ => {
            let mut table = LensTable::new();
            table.fill(lens).expect("a usual lens");
            let table = Rc::new(table);
            *last = Some((*lens, table.clone()));
            table
        }
    })
}

/// The corners of a checkerboard of 12 mm pitch seen at a pose; each raw coordinate has noise of
/// `sigma_px`.
pub fn observe(
    lens: &Lens,
    cam_from_target: &Pose<Cam, Target>,
    [columns, rows]: [u8; 2],
    sigma_px: f64,
    random: &mut Random,
) -> SeenCorners {
    let mut observations = SeenCorners::new();
    for index in 0..columns * rows {
        let offset = |place: u8, count: u8| f64::from(place) - f64::from(count - 1) / 2.0;
        let (x, y) = (offset(index % columns, columns), offset(index / columns, rows));
        let point_target_mm = Vector3::new(x, y, 0.0) * 12.0;
        let true_px = lens.project(&cam_from_target.transform(&point_target_mm)).unwrap();
        let seen_px = true_px + random.normal2() * sigma_px;
        // Exact corners still need a sigma for their weights.
        let sigma_px = if sigma_px > 0.0 { sigma_px } else { 0.01 };
        let ray = lens.ray_from_raw(&seen_px).unwrap();
        let (_, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
        let seen = SeenCorner { point_target_mm, ray, raw_by_ray, sigma_px };
        observations.push(seen).unwrap();
    }
    observations
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
