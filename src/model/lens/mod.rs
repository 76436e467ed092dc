//! The camera model: a pinhole with skew (the paper's K) behind a distorting lens.
//!
//! A point of the camera frame goes through three steps, each with its inverse:
//!
//! ```text
//! camera point ──divide by z──▶ ray (x/z, y/z) ──distort──▶ distorted ray ──K──▶ raw pixel
//! ```
//!
//! The distortion is the paper's ([`Distortion::Radial2`]) or one of OpenCV's, in OpenCV's order and
//! meaning, so that OpenCV and ROS calibrations can be used as they are.

mod distortion;

pub use distortion::Distortion;

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::limits::{FRAME_SIDE_PX_MAX, FRAME_SIDE_PX_MIN};
use crate::model::lens_table::ERROR_PX_MAX;

/// Why a camera model cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LensError {
    /// A side is outside the frame limits.
    FrameSize,
    /// A focal length is not between 10 px and 100,000 px.
    FocalLength,
    /// The principal point is more than one frame away from the frame.
    PrincipalPoint,
    /// The skew is not finite or is more than a tenth of the focal length.
    Skew,
    /// A distortion coefficient is not finite or is 1,000 or more.
    Coefficient,
    /// The distortion folds back inside the frame, so that one raw pixel has two rays, or a pixel
    /// has none: a frame that sees 180 degrees or more.
    Folds,
    /// The distortion changes too fast for the lens table
    /// ([`LensTable`](crate::lens_table::LensTable)).
    Table,
}

impl core::fmt::Display for LensError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::FrameSize => write!(
                formatter,
                "width_px and height_px must lie within {FRAME_SIDE_PX_MIN} to {FRAME_SIDE_PX_MAX}"
            ),
            Self::FocalLength => {
                formatter.write_str("fx_px and fy_px must lie within 10 to 100,000 px")
            }
            Self::PrincipalPoint => formatter
                .write_str("cx_px and cy_px must lie within one frame's length of the frame"),
            Self::Skew => formatter.write_str("skew_px must be finite and below a tenth of fx_px"),
            Self::Coefficient => {
                formatter.write_str("every distortion coefficient must be finite and below 1,000")
            }
            Self::Folds => formatter.write_str(
                "the distortion folds back inside the frame, or the frame sees 180 degrees or more: \
                 a pixel would have two rays or none",
            ),
            Self::Table => write!(
                formatter,
                "the distortion changes too fast within the frame: the lens table would be wrong \
                 by more than {ERROR_PX_MAX} px; calibrate again, with fewer coefficients or with \
                 photographs that cover the whole frame"
            ),
        }
    }
}

impl core::error::Error for LensError {}

/// A camera: frame size, intrinsic matrix K and distortion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Frame width.
    pub width_px: u16,
    /// Frame height.
    pub height_px: u16,
    /// Focal length along x.
    pub fx_px: f64,
    /// Focal length along y.
    pub fy_px: f64,
    /// Principal point, x.
    pub cx_px: f64,
    /// Principal point, y.
    pub cy_px: f64,
    /// Skew, the paper's s.
    pub skew_px: f64,
    /// Distortion.
    pub distortion: Distortion,
}

/// Most Newton steps of [`Lens::ray_from_raw`]: convergence is quadratic, and the strongest lens of
/// the tests, a fisheye at 85 degrees, needs 12.
const INVERSION_STEPS_MAX: usize = 24;

/// Halvings of one Newton step before the inversion gives up.
const INVERSION_HALVINGS_MAX: usize = 10;

/// An inversion has converged when the next step moves the ray by less than
/// this: 1e-12 of a focal length is far below a millionth of a pixel.
const INVERSION_STEP_END: f64 = 1e-12;

impl Lens {
    /// Checks every field, and that the frame's border and corners have a ray.
    ///
    /// # Errors
    /// The first [`LensError`] found.
    pub fn check(&self) -> Result<(), LensError> {
        let sides = FRAME_SIDE_PX_MIN..=FRAME_SIDE_PX_MAX;
        if !sides.contains(&self.width_px) || !sides.contains(&self.height_px) {
            return Err(LensError::FrameSize);
        }
        let focal = 10.0..=100_000.0;
        if !focal.contains(&self.fx_px) || !focal.contains(&self.fy_px) {
            return Err(LensError::FocalLength);
        }
        let near = |value: f64, side: u16| (-1.0..=2.0).contains(&(value / f64::from(side)));
        if !near(self.cx_px, self.width_px) || !near(self.cy_px, self.height_px) {
            return Err(LensError::PrincipalPoint);
        }
        let skew_px_max = 0.1 * self.fx_px;
        if !(-skew_px_max..=skew_px_max).contains(&self.skew_px) {
            return Err(LensError::Skew);
        }
        if !self.distortion.coefficients().iter().all(|value| value.abs() < 1000.0) {
            return Err(LensError::Coefficient);
        }
        // Distortion grows outwards, so that the border is where most lenses fold first; a rational
        // one may do so before.
        const BORDER_SAMPLES: u16 = 32;
        for sample in 0..=BORDER_SAMPLES {
            let fraction = f64::from(sample) / f64::from(BORDER_SAMPLES);
            let right = f64::from(self.width_px - 1);
            let bottom = f64::from(self.height_px - 1);
            let (x, y) = (fraction * right, fraction * bottom);
            for [u, v] in [[x, 0.0], [x, bottom], [0.0, y], [right, y]] {
                let ray = self.ray_from_raw(&Vector2::new(u, v)).ok_or(LensError::Folds)?;
                if !self.is_unfolded_up_to(&ray) {
                    return Err(LensError::Folds);
                }
            }
        }
        Ok(())
    }

    /// Whether the distortion keeps its orientation everywhere from the optical axis to a ray.
    fn is_unfolded_up_to(&self, ray: &Vector2<f64>) -> bool {
        const SAMPLES: u16 = 16;
        (1..=SAMPLES).all(|sample| {
            let part = ray * (f64::from(sample) / f64::from(SAMPLES));
            // A NaN is not above zero.
            self.distortion.distort_with_jacobian(&part).1.determinant() > 0.0
        })
    }

    /// K applied to a ray (distorted or not): pixel coordinates.
    #[must_use]
    pub fn pixel_from_ray(&self, ray: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(
            self.fx_px * ray.x + self.skew_px * ray.y + self.cx_px,
            self.fy_px * ray.y + self.cy_px,
        )
    }

    /// The inverse of K applied to a pixel: the ray at z = 1.
    #[must_use]
    pub fn ray_from_pixel(&self, pixel_px: &Vector2<f64>) -> Vector2<f64> {
        let y = (pixel_px.y - self.cy_px) / self.fy_px;
        Vector2::new((pixel_px.x - self.cx_px - self.skew_px * y) / self.fx_px, y)
    }

    /// The linear part of K, d pixel / d ray.
    #[must_use]
    pub fn pixel_by_ray(&self) -> Matrix2<f64> {
        Matrix2::new(self.fx_px, self.skew_px, 0.0, self.fy_px)
    }

    /// How the raw pixel of a ray moves with each number of the lens: fx, fy, cx, cy and the skew, then
    /// the coefficients of the distortion. `distorted` is the ray distorted.
    pub fn pixel_by_numbers(
        &self,
        ray: &Vector2<f64>,
        distorted: &Vector2<f64>,
    ) -> impl Iterator<Item = Vector2<f64>> {
        let (x, y) = (distorted.x, distorted.y);
        let pinhole = [[x, 0.0], [0.0, y], [1.0, 0.0], [0.0, 1.0], [y, 0.0]];
        let by_distorted = self.pixel_by_ray();
        let coefficients = self.distortion.by_coefficients(ray);
        pinhole.map(Vector2::from).into_iter().chain(coefficients.map(move |it| by_distorted * it))
    }

    /// The raw pixel of a ray, and its 2 x 2 Jacobian with respect to the ray.
    #[must_use]
    pub fn raw_from_ray_with_jacobian(&self, ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (distorted, jacobian) = self.distortion.distort_with_jacobian(ray);
        (self.pixel_from_ray(&distorted), self.pixel_by_ray() * jacobian)
    }

    /// The raw pixel at which a point of the camera frame appears; `None` when
    /// it is not in front of the camera.
    #[must_use]
    pub fn project(&self, point_cam_mm: &Vector3<f64>) -> Option<Vector2<f64>> {
        let ray = ray_of(point_cam_mm)?;
        let (distorted, _) = self.distortion.distort_with_jacobian(&ray);
        Some(self.pixel_from_ray(&distorted))
    }

    /// The ray of a raw pixel: damped Newton steps on the distortion, from the
    /// centre outwards. `None` when no ray of the lens's monotonic range reaches
    /// the pixel.
    #[must_use]
    pub fn ray_from_raw(&self, raw_px: &Vector2<f64>) -> Option<Vector2<f64>> {
        let wanted = self.ray_from_pixel(raw_px);
        // A start at the distorted ray itself could lie beyond the fold of a
        // strong barrel lens; the centre never does.
        let mut ray = Vector2::zeros();
        let (mut value, mut jacobian) = self.distortion.distort_with_jacobian(&ray);
        for _ in 0..INVERSION_STEPS_MAX {
            let mut step = jacobian.try_inverse()? * (wanted - value);
            if step.norm() < INVERSION_STEP_END {
                return Some(ray);
            }
            let residual = (wanted - value).norm();
            let mut halvings = 0;
            (value, jacobian) = loop {
                let (value, jacobian) = self.distortion.distort_with_jacobian(&(ray + step));
                // A lens keeps its orientation up to the fold: past it there is no inverse.
                if jacobian.determinant() > 0.0 && (wanted - value).norm() < residual {
                    break (value, jacobian);
                }
                halvings += 1;
                if halvings > INVERSION_HALVINGS_MAX {
                    // At the rounding floor no step improves the residual: the ray has been found.
                    return (residual < INVERSION_STEP_END).then_some(ray);
                }
                step *= 0.5;
            };
            ray += step;
        }
        None
    }
}

/// The ray through a point in front of the camera.
#[must_use]
pub fn ray_of(point_cam_mm: &Vector3<f64>) -> Option<Vector2<f64>> {
    // A point closer than a micrometre to the plane of the centre has no useful ray.
    (point_cam_mm.z > 1e-3).then(|| point_cam_mm.xy() / point_cam_mm.z)
}

/// d ray / d point, 1/mm.
#[must_use]
pub fn ray_by_point(point_cam_mm: &Vector3<f64>, ray: &Vector2<f64>) -> Matrix2x3<f64> {
    let inverse_z = 1.0 / point_cam_mm.z;
    Matrix2x3::new(inverse_z, 0.0, -ray.x * inverse_z, 0.0, inverse_z, -ray.y * inverse_z)
}

#[cfg(test)]
mod tests {
    use super::*;

    mod check;

    fn wide_angle() -> Lens {
        Lens {
            width_px: 1456,
            height_px: 1088,
            fx_px: 800.0,
            fy_px: 805.0,
            cx_px: 731.0,
            cy_px: 540.0,
            skew_px: 0.7,
            distortion: Distortion::Brown5([-0.28, 0.09, 0.001, -0.0008, -0.008]),
        }
    }

    /// One lens of each model.
    pub(crate) fn all_models() -> [Lens; 5] {
        [
            Distortion::Radial2([-0.12, 0.05]),
            Distortion::Brown5([-0.28, 0.09, 0.001, -0.0008, -0.008]),
            Distortion::Rational8([0.1, 0.02, 0.0006, -0.0004, 0.001, 0.3, 0.02, 0.0005]),
            Distortion::ThinPrism12([
                -0.2, 0.06, 0.0006, -0.0004, -0.004, 0.05, 0.01, 0.002, 0.003, -0.001, -0.002,
                0.0008,
            ]),
            Distortion::Fisheye4([-0.02, 0.004, -0.003, 0.0005]),
        ]
        .map(|distortion| Lens { distortion, ..wide_angle() })
    }

    /// Largest difference between an analytic Jacobian and central differences.
    fn jacobian_error(lens: &Lens, scale: f64) -> f64 {
        let mut worst = 0.0_f64;
        for point in [[10.0, -20.0, 900.0], [-700.0, 500.0, 1000.0], [650.0, -480.0, 1100.0]] {
            let point = Vector3::from(point);
            let ray = ray_of(&point).unwrap();
            let (_, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
            let jacobian = raw_by_ray * ray_by_point(&point, &ray);
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-3;
                let ahead = lens.project(&(point + step)).unwrap();
                let behind = lens.project(&(point - step)).unwrap();
                let difference = (ahead - behind) / 2e-3;
                worst = worst.max((jacobian.column(axis) * scale - difference).norm());
            }
        }
        worst
    }

    #[test]
    fn projection_jacobian_matches_differences_and_a_wrong_one_does_not() {
        // Central differences of 1e-3 mm are good to about 1e-9 px/mm here.
        for lens in all_models() {
            assert!(jacobian_error(&lens, 1.0) < 1e-8, "{lens:?}");
            assert!(jacobian_error(&lens, 1.0001) > 1e-5, "{lens:?}");
        }
    }

    #[test]
    fn a_fisheyes_series_joins_its_formula() {
        let fisheye = Distortion::Fisheye4([-0.02, 0.004, -0.003, 0.0005]);
        let at = |r: f64| fisheye.distort_with_jacobian(&(Vector2::new(0.6, 0.8) * r));
        let [(near, near_by_ray), (far, far_by_ray)] = [at(0.999_999e-4), at(1.000_001e-4)];
        assert!((far - near).norm() < 3e-10);
        assert!((far_by_ray - near_by_ray).norm() < 1e-12);
        assert_eq!(at(0.0), (Vector2::zeros(), Matrix2::identity()));
    }

    #[test]
    fn derivatives_with_respect_to_the_numbers_match_differences() {
        for lens in all_models() {
            for ray in [[0.3, -0.2], [-0.8, 0.5], [0.0, 0.6]] {
                let ray = Vector2::from(ray);
                let pixel_px = |lens: &Lens| lens.raw_from_ray_with_jacobian(&ray).0;
                let distorted = lens.distortion.distort_with_jacobian(&ray).0;
                let mut count = 0;
                for (place, by) in lens.pixel_by_numbers(&ray, &distorted).enumerate() {
                    let [ahead, behind] = [1e-6, -1e-6].map(|step| {
                        let mut moved = lens;
                        let Lens { fx_px, fy_px, cx_px, cy_px, skew_px, .. } = &mut moved;
                        match place {
                            0..5 => *[fx_px, fy_px, cx_px, cy_px, skew_px][place] += step,
                            _ => moved.distortion.coefficients_mut()[place - 5] += step,
                        }
                        pixel_px(&moved)
                    });
                    let difference = (ahead - behind) / 2e-6;
                    // Pixels per unit: the focal length, and 1e-16 of the pixel over the step.
                    assert!((difference - by).norm() < 1e-5, "{lens:?} {place}");
                    count += 1;
                }
                assert_eq!(count, 5 + lens.distortion.names().len());
            }
        }
    }

    /// From OpenCV 5.0: `cv2.projectPoints` of the ray (0.4, -0.3, 1) with K the identity, and
    /// `cv2.fisheye.projectPoints` of the ray (0.8, -0.6, 1), with the lenses of `all_models`.
    #[test]
    fn distorted_rays_are_opencvs() {
        const OPENCV: [[f64; 2]; 5] = [
            [0.38925000000000004, -0.2919375],
            [0.37350399999999995, -0.28002799999999994],
            [0.381047995499452, -0.285710996624589],
            [0.3768368904568027, -0.28248704284260207],
            [0.6211263323729372, -0.4658447492797029],
        ];
        for (lens, expected) in all_models().iter().zip(OPENCV) {
            let is_fisheye = matches!(lens.distortion, Distortion::Fisheye4(_));
            let ray = Vector2::new(0.4, -0.3) * if is_fisheye { 2.0 } else { 1.0 };
            let (distorted, _) = lens.distortion.distort_with_jacobian(&ray);
            assert!((distorted - Vector2::from(expected)).norm() < 1e-12, "{distorted} {lens:?}");
        }
    }

    #[test]
    fn raw_pixels_come_back_through_their_rays() {
        // The widest: 85 degrees off the axis in the frame's corners.
        let fisheye = Lens {
            fx_px: 620.0,
            fy_px: 620.0,
            distortion: Distortion::Fisheye4([-0.02, 0.004, -0.003, 0.0005]),
            ..wide_angle()
        };
        for lens in all_models().into_iter().chain([fisheye]) {
            assert_eq!(lens.check(), Ok(()), "{lens:?}");
            for raw_px in [[0.0, 0.0], [1455.0, 1087.0], [728.0, 544.0], [0.0, 900.0]] {
                let raw_px = Vector2::from(raw_px);
                let ray = lens.ray_from_raw(&raw_px).unwrap();
                let (back_px, _) = lens.raw_from_ray_with_jacobian(&ray);
                assert!((back_px - raw_px).norm() < 1e-9, "{lens:?}");
            }
        }
    }

    /// A distorted length of r - r^3 / 3, which grows up to r = 1 only. Beyond it are more rays with
    /// the same pixels, some of which keep their orientation.
    #[test]
    fn a_pixel_has_a_ray_up_to_the_fold_and_none_beyond() {
        let distortion = Distortion::Radial2([-1.0 / 3.0, 0.0]);
        let lens = Lens { distortion, ..wide_angle() };
        for step in 1..200 {
            let length = 0.01 * f64::from(step);
            for angle_rad in [0.0, 0.3, 1.0, 2.0, 4.0] {
                let distorted = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad)) * length;
                let ray = lens.ray_from_raw(&lens.pixel_from_ray(&distorted));
                assert_eq!(ray.is_some(), length < 2.0 / 3.0, "{length} {angle_rad}");
                assert!(ray.is_none_or(|ray| ray.norm() < 1.0), "{length} {angle_rad}");
            }
        }
    }

    /// There the last digit of an angle is a step of 1e-10 of a ray, which is 573 long.
    #[test]
    fn a_ray_at_nearly_90_degrees_is_found_to_the_last_digit() {
        let lens = Lens { distortion: Distortion::Fisheye4([0.0; 4]), ..wide_angle() };
        let theta_rad = 89.9_f64.to_radians();
        for step in 0..100 {
            let angle_rad = 0.1 * f64::from(step);
            let distorted = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad)) * theta_rad;
            let ray = lens.ray_from_raw(&lens.pixel_from_ray(&distorted)).expect("a ray");
            assert!((libm::atan(ray.norm()) - theta_rad).abs() < 4e-15, "{angle_rad}");
        }
    }

    #[test]
    fn models_are_called_as_in_camera_files() {
        let names = all_models().map(|lens| lens.distortion.name());
        assert_eq!(names, ["radial2", "brown5", "rational8", "thin_prism12", "fisheye4"]);
        let count = all_models().map(|lens| lens.distortion.coefficients().len());
        assert_eq!(count, [2, 5, 8, 12, 4]);
    }

    #[test]
    fn no_number_of_a_fisheye_moves_the_middle() {
        let fisheye = Distortion::Fisheye4([-0.02, 0.004, -0.003, 0.0005]);
        for by in fisheye.by_coefficients(&Vector2::zeros()) {
            assert_eq!(by, Vector2::zeros());
        }
    }

    #[test]
    fn absurd_lenses_are_named() {
        let good = wide_angle();
        assert_eq!(good.check(), Ok(()));
        assert_eq!(Lens { fx_px: f64::NAN, ..good }.check(), Err(LensError::FocalLength));
        assert_eq!(Lens { cy_px: 1e5, ..good }.check(), Err(LensError::PrincipalPoint));
        assert_eq!(Lens { skew_px: f64::NAN, ..good }.check(), Err(LensError::Skew));
        assert_eq!(Lens { width_px: 0, ..good }.check(), Err(LensError::FrameSize));
        let folding = Distortion::Radial2([-0.5, 0.0]);
        assert_eq!(Lens { distortion: folding, ..good }.check(), Err(LensError::Folds));
        // A fold that ends before the border, and more than 180 degrees.
        let inner = Distortion::Brown5([-0.9, 0.35, 0.0, 0.0, 0.0]);
        assert_eq!(Lens { distortion: inner, ..good }.check(), Err(LensError::Folds));
        let fisheye = Distortion::Fisheye4([0.0; 4]);
        let wide = Lens { fx_px: 400.0, fy_px: 400.0, distortion: fisheye, ..good };
        assert_eq!(wide.check(), Err(LensError::Folds));
        let infinite = Distortion::Radial2([f64::INFINITY, 0.0]);
        assert_eq!(Lens { distortion: infinite, ..good }.check(), Err(LensError::Coefficient));
    }
}
