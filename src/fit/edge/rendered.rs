//! Test pictures of a whole checkerboard, exact to 1e-4 of the contrast: the Gaussian blur
//! of its squares in closed form, integrated over each pixel's box.

extern crate std;
use std::vec::Vec;

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::fit::nodes::Nodes;
use crate::model::image::GreyImage;
use crate::model::lens::{Distortion, Lens, ray_by_point};
use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::{Origin, Role, TargetGeometry};
use crate::test_support::{Random, bedside_lens, table};

pub(super) const WIDTH: u16 = 200;
pub(super) const HEIGHT: u16 = 160;

/// White of the 16-bit pictures: rounding is a thousandth of any noise in these tests.
pub(super) const WHITE: u16 = 65_535;

/// Inner corners: five by four squares.
pub(super) const COLUMNS: u8 = 4;
pub(super) const ROWS: u8 = 3;
pub(super) const PITCH_MM: f64 = 12.0;

/// Abscissas, from a pixel's centre, and weights of the three-point Gauss-Legendre rule: over a
/// whole pixel, with a blur of 0.5 px, its error is 1e-4.
const RULE: [(f64, f64); 3] = [
    (-0.387_298_334_620_741_7, 5.0 / 18.0),
    (0.0, 8.0 / 18.0),
    (0.387_298_334_620_741_7, 5.0 / 18.0),
];

/// Without distortion; the bedside lens's focal length.
pub(super) fn pinhole() -> Lens {
    Lens {
        width_px: WIDTH,
        height_px: HEIGHT,
        cx_px: 101.3,
        cy_px: 78.6,
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
        ..bedside_lens()
    }
}

/// The lower right part of the bedside lens's picture, where it bends lines most.
pub(super) fn corner_of_bedside_lens() -> Lens {
    let lens = bedside_lens();
    let [left, top] = [lens.width_px - WIDTH, lens.height_px - HEIGHT].map(f64::from);
    Lens {
        width_px: WIDTH,
        height_px: HEIGHT,
        cx_px: lens.cx_px - left,
        cy_px: lens.cy_px - top,
        ..lens
    }
}

/// A checkerboard on endless paper.
#[derive(Clone)]
pub(super) struct Scene {
    pub(super) lens: Lens,
    pub(super) target: TargetGeometry,
    pub(super) cam_from_target: Pose<Cam, Target>,
    pub(super) first_square_dark: bool,
    /// Standard deviation of the lens's blur, without the pixel's box.
    pub(super) psf_px: f64,
    /// How much larger dark squares are printed, on each side.
    pub(super) growth_mm: f64,
    /// Levels in the middle of the picture, as fractions of white, and their increase from its left
    /// to its right edge.
    pub(super) light: f64,
    pub(super) dark: f64,
    pub(super) light_gain: f64,
    pub(super) dark_gain: f64,
}

impl Scene {
    /// In the middle of a pinhole's picture, turned by `tilt_rad` about y and about x and by
    /// `turn_rad` about its normal, with squares of `pitch_px` where it is nearest to the camera.
    pub(super) fn new(pitch_px: f64, tilt_rad: f64, turn_rad: f64) -> Self {
        let lens = pinhole();
        let z_mm = lens.fx_px * PITCH_MM / pitch_px;
        let theta = [turn_rad, tilt_rad, 0.8 * tilt_rad, 0.0, 0.0, z_mm];
        Self {
            lens,
            target: checker(COLUMNS, ROWS),
            cam_from_target: Pose::from_theta(theta),
            first_square_dark: true,
            psf_px: 0.7,
            growth_mm: 0.0,
            light: 0.7,
            dark: 0.2,
            light_gain: 0.0,
            dark_gain: 0.0,
        }
    }

    /// Through another lens, with the target's origin at raw pixel `place_px` and at the same
    /// depth.
    pub(super) fn seen_at(mut self, lens: Lens, place_px: [f64; 2]) -> Self {
        let z_mm = self.cam_from_target.translation_mm.z;
        let ray = lens.ray_from_raw(&place_px.into()).expect("a place in the picture");
        self.cam_from_target.translation_mm = Vector3::new(ray.x, ray.y, 1.0) * z_mm;
        self.lens = lens;
        self
    }

    /// The same target moved in the picture by about this many pixels.
    pub(super) fn moved_px(&self, [x, y]: [f64; 2]) -> Pose<Cam, Target> {
        let mut pose = self.cam_from_target;
        let mm_per_px = pose.translation_mm.z / self.lens.fx_px;
        pose.translation_mm += Vector3::new(x, y, 0.0) * mm_per_px;
        pose
    }

    /// Standard deviation of the whole blur, with the pixel's box.
    pub(super) fn blur_px(&self) -> f64 {
        libm::sqrt(self.psf_px * self.psf_px + 1.0 / 12.0)
    }

    pub(super) fn nodes(&self, expected_cam_from_target: &Pose<Cam, Target>) -> Nodes {
        let mut nodes = Nodes::new();
        assert!(nodes.project(&table(&self.lens), &self.target, expected_cam_from_target));
        nodes
    }

    pub(super) fn render(&self) -> Picture {
        let [width, height] = [WIDTH, HEIGHT].map(usize::from);
        let levels = (0..width * height)
            .map(|index| {
                let [x, y] = [index % width, index / width].map(|place| place as f64);
                let part = x / f64::from(WIDTH) - 0.5;
                let light = self.light + self.light_gain * part;
                let dark = self.dark + self.dark_gain * part;
                light + (dark - light) * self.dark_share(&Vector2::new(x, y))
            })
            .collect();
        Picture { levels }
    }

    /// The share of a pixel that dark squares cover, after the blur.
    fn dark_share(&self, raw_px: &Vector2<f64>) -> f64 {
        let ray = self.lens.ray_from_raw(raw_px).expect("a pixel of the picture");
        // Where the ray meets the plane.
        let Pose { rotation, translation_mm, .. } = self.cam_from_target;
        let direction = Vector3::new(ray.x, ray.y, 1.0);
        let normal = rotation.column(2);
        let point_cam_mm = direction * (normal.dot(&translation_mm) / normal.dot(&direction));
        let on_plane_mm = rotation.tr_mul(&(point_cam_mm - translation_mm)).xy();
        let (_, raw_by_ray) = self.lens.raw_from_ray_with_jacobian(&ray);
        let raw_by_plane: Matrix2<f64> =
            raw_by_ray * ray_by_point(&point_cam_mm, &ray) * rotation.fixed_columns::<2>(0);
        let plane_by_raw = raw_by_plane.try_inverse().expect("not seen from the side");
        let covariance = plane_by_raw * plane_by_raw.transpose() * (self.psf_px * self.psf_px);
        if self.is_even_around(&on_plane_mm, &plane_by_raw, &covariance) {
            return self.blurred_dark(&on_plane_mm, &covariance);
        }
        let mut share = 0.0;
        for (y, y_weight) in RULE {
            for (x, x_weight) in RULE {
                let place_mm = on_plane_mm + plane_by_raw * Vector2::new(x, y);
                share += x_weight * y_weight * self.blurred_dark(&place_mm, &covariance);
            }
        }
        share
    }

    /// Whether no side of a square is so near to a pixel that any of it is seen in there: then all
    /// points of the pixel have one value.
    fn is_even_around(
        &self,
        place_mm: &Vector2<f64>,
        plane_by_raw: &Matrix2<f64>,
        covariance: &Matrix2<f64>,
    ) -> bool {
        let corners = [self.target.columns(), self.target.rows()];
        let half_pixel_mm = plane_by_raw.abs() * Vector2::repeat(0.5);
        (0..2).all(|axis| {
            let reach_mm = SEEN_SD_MAX * libm::sqrt(covariance[(axis, axis)])
                + half_pixel_mm[axis]
                + self.growth_mm;
            let squares = (corners[axis] + 1) as f64;
            let from_first = place_mm[axis] / PITCH_MM + squares / 2.0;
            let nearest = libm::round(from_first).clamp(0.0, squares);
            (from_first - nearest).abs() * PITCH_MM > reach_mm
        })
    }

    /// The sum of all dark squares after a Gaussian blur: products of their profiles along x and y,
    /// plus, to first order, what the correlation of x and y adds at their corners.
    fn blurred_dark(&self, place_mm: &Vector2<f64>, covariance: &Matrix2<f64>) -> f64 {
        let [columns, rows] = [self.target.columns(), self.target.rows()];
        let along = |place_mm: f64, corners: usize, variance: f64| {
            let from_first = place_mm + PITCH_MM * (corners + 1) as f64 / 2.0;
            let deviation = libm::sqrt(variance);
            move |square: usize| {
                let start = from_first - PITCH_MM * square as f64 + self.growth_mm;
                let end = start - PITCH_MM - 2.0 * self.growth_mm;
                let (start, start_slope) = normal_integral(start / deviation);
                let (end, end_slope) = normal_integral(end / deviation);
                (start - end, (start_slope - end_slope) / deviation)
            }
        };
        let along_x = along(place_mm.x, columns, covariance[(0, 0)]);
        let along_y = along(place_mm.y, rows, covariance[(1, 1)]);
        let mut sum = 0.0;
        for row in 0..=rows {
            let (y, y_slope) = along_y(row);
            if y == 0.0 {
                continue;
            }
            for column in (0..=columns)
                .filter(|column| (column + row).is_multiple_of(2) == self.first_square_dark)
            {
                let (x, x_slope) = along_x(column);
                sum += x * y + covariance[(0, 1)] * x_slope * y_slope;
            }
        }
        sum
    }
}

pub(super) fn checker(columns: u8, rows: u8) -> TargetGeometry {
    TargetGeometry::checker(columns, rows, PITCH_MM, Origin::Center, Role::Upper, [0.0; 3])
        .expect("a usual grid")
}

/// Beyond this many standard deviations, what is left of a blurred step is less than 1e-9.
const SEEN_SD_MAX: f64 = 6.0;

/// The integral of the standard normal density up to `x`, and its slope.
fn normal_integral(x: f64) -> (f64, f64) {
    if x.abs() > SEEN_SD_MAX {
        return (if x > 0.0 { 1.0 } else { 0.0 }, 0.0);
    }
    let density = libm::exp(-0.5 * x * x) / libm::sqrt(core::f64::consts::TAU);
    (0.5 + 0.5 * libm::erf(x * core::f64::consts::FRAC_1_SQRT_2), density)
}

/// Levels as fractions of white, before noise and rounding.
pub(super) struct Picture {
    pub(super) levels: Vec<f64>,
}

impl Picture {
    /// The samples, with Gaussian noise whose standard deviation is this fraction of white.
    pub(super) fn sampled(&self, noise: f64, random: &mut Random) -> Vec<u16> {
        self.levels.iter().map(|level| sample(level + noise * random.normal())).collect()
    }

    pub(super) fn noise_free(&self) -> Vec<u16> {
        self.levels.iter().map(|level| sample(*level)).collect()
    }
}

fn sample(level: f64) -> u16 {
    (level * f64::from(WHITE) + 0.5) as u16
}

pub(super) fn image(pixels: &[u16]) -> GreyImage<'_, u16> {
    let [width, height] = [WIDTH, HEIGHT].map(usize::from);
    GreyImage::with_white_level(pixels, width, height, width, WHITE).expect("a whole frame")
}
