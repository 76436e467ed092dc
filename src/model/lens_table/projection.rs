//! The plane over which a lens table is made.

use nalgebra::{Matrix2, Vector2};

use crate::model::lens::Lens;

/// Rays are sampled up to this distance from the middle of the stereographic plane: 89.7 degrees off
/// the optical axis.
const PLANE_MAX: f64 = 1.99;

/// How rays become points of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Projection {
    /// A point of the plane z = 1 is its own ray, (x/z, y/z).
    Gnomonic,
    /// The ray at angle theta to the optical axis is 2 tan(theta/2) away from the plane's middle.
    Stereographic,
}

impl Projection {
    /// The plane's point of a ray.
    pub fn plane_from_ray(self, ray: &Vector2<f64>) -> Vector2<f64> {
        match self {
            Self::Gnomonic => *ray,
            Self::Stereographic => stereographic_from_ray(ray).0,
        }
    }

    /// The ray at a point of the plane; `None` where there is none in front of the camera.
    pub fn ray_from_plane(self, plane: &Vector2<f64>) -> Option<Vector2<f64>> {
        match self {
            Self::Gnomonic => Some(*plane),
            Self::Stereographic => {
                (plane.norm_squared() < 4.0).then(|| ray_from_stereographic(plane).0)
            }
        }
    }

    /// A lens's raw pixel at any point of the plane; linear beyond [`PLANE_MAX`].
    pub fn raw_from_plane(self, lens: &Lens, plane: &Vector2<f64>) -> Vector2<f64> {
        match self {
            Self::Gnomonic => lens.raw_from_ray_with_jacobian(plane).0,
            Self::Stereographic => {
                let within = plane * (PLANE_MAX / plane.norm()).min(1.0);
                let (ray, ray_by_plane) = ray_from_stereographic(&within);
                let (raw_px, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
                raw_px + raw_by_ray * ray_by_plane * (plane - within)
            }
        }
    }
}

/// The stereographic projection of a ray, and its Jacobian with respect to the ray.
#[inline]
pub(super) fn stereographic_from_ray(ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    // With theta the angle to the axis: 1 / cos(theta), and 2 tan(theta/2) / tan(theta).
    let secant = libm::sqrt(1.0 + ray.norm_squared());
    let scale = 2.0 / (1.0 + secant);
    let change = -scale * scale / (2.0 * secant);
    (ray * scale, radial_jacobian(ray, scale, change))
}

/// The ray at a point of the stereographic plane, which must be within 2 of its middle, and its
/// Jacobian with respect to the point.
fn ray_from_stereographic(plane: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let scale = 1.0 / (1.0 - 0.25 * plane.norm_squared());
    let change = 0.5 * scale * scale;
    (plane * scale, radial_jacobian(plane, scale, change))
}

/// The Jacobian of a point times a scale that depends on its distance r from the origin, and changes
/// by `change` times r per r.
#[inline]
fn radial_jacobian(point: &Vector2<f64>, scale: f64, change: f64) -> Matrix2<f64> {
    let cross = change * point.x * point.y;
    let [x, y] = [point.x, point.y].map(|along| scale + change * along * along);
    Matrix2::new(x, cross, cross, y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::lens::Distortion;
    use crate::test_support::{Random, bedside_lens};

    /// A direction in the plane.
    fn any_direction(random: &mut Random) -> Vector2<f64> {
        let angle_rad = random.uniform(0.0, core::f64::consts::TAU);
        Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad))
    }

    /// Checks a Jacobian against central differences, which are good to 1e-9.
    fn check_jacobian(
        function: impl Fn(&Vector2<f64>) -> Vector2<f64>,
        at: &Vector2<f64>,
        jacobian: &Matrix2<f64>,
    ) {
        for axis in 0..2 {
            let step = Vector2::from_fn(|row, _| if row == axis { 1e-6 } else { 0.0 });
            let difference = (function(&(at + step)) - function(&(at - step))) / 2e-6;
            let error = (jacobian.column(axis) - difference).norm();
            assert!(error < 1e-8 * (1.0 + jacobian.norm()), "{error} at {at}");
        }
    }

    #[test]
    fn a_ray_lies_at_twice_the_tangent_of_half_its_angle() {
        let mut random = Random::new(1);
        for _ in 0..200 {
            let theta_rad = random.uniform(0.0, 1.5);
            let direction = any_direction(&mut random);
            let ray = direction * libm::tan(theta_rad);
            let expected = direction * (2.0 * libm::tan(0.5 * theta_rad));
            let (plane, plane_by_ray) = stereographic_from_ray(&ray);
            assert!((plane - expected).norm() < 1e-14, "{theta_rad}");
            assert_eq!(Projection::Stereographic.plane_from_ray(&ray), plane);
            check_jacobian(|ray| stereographic_from_ray(ray).0, &ray, &plane_by_ray);

            let (back, ray_by_plane) = ray_from_stereographic(&expected);
            assert!((back - ray).norm() < 1e-13 * (1.0 + ray.norm_squared()), "{theta_rad}");
            assert_eq!(Projection::Stereographic.ray_from_plane(&expected), Some(back));
            if theta_rad < 1.2 {
                check_jacobian(|plane| ray_from_stereographic(plane).0, &plane, &ray_by_plane);
            }
            assert_eq!(Projection::Gnomonic.plane_from_ray(&ray), ray);
            assert_eq!(Projection::Gnomonic.ray_from_plane(&ray), Some(ray));
        }
    }

    #[test]
    fn beside_the_camera_there_is_no_ray() {
        let ray = |x: f64, y: f64| Projection::Stereographic.ray_from_plane(&Vector2::new(x, y));
        assert!(ray(1.999_999, 0.0).is_some() && ray(0.0, -1.999_999).is_some());
        assert!(ray(2.0, 0.0).is_none() && ray(0.0, -2.0).is_none());
        assert!(ray(1.5, 1.5).is_none() && ray(1.3, 1.3).is_some());
    }

    #[test]
    fn a_lens_goes_on_linearly_where_it_sees_nothing() {
        let distortion = Distortion::Fisheye4([-0.02, 0.004, -0.003, 0.0005]);
        let lens = Lens { fx_px: 640.0, fy_px: 645.0, distortion, ..bedside_lens() };
        let raw_px = |plane: Vector2<f64>| Projection::Stereographic.raw_from_plane(&lens, &plane);
        assert_eq!(raw_px(Vector2::zeros()), Vector2::new(lens.cx_px, lens.cy_px));
        let mut random = Random::new(2);
        for _ in 0..50 {
            let direction = any_direction(&mut random);
            let within = direction * random.uniform(0.1, PLANE_MAX);
            let ray = ray_from_stereographic(&within).0;
            let expected_px = lens.raw_from_ray_with_jacobian(&ray).0;
            assert!((raw_px(within) - expected_px).norm() < 1e-12, "{within}");

            // Its slope at the border, from three places within, to the third order.
            let along_px = |distance: f64| raw_px(direction * distance);
            let border_px = along_px(PLANE_MAX);
            let [one_px, two_px] = [1.0, 2.0].map(|steps| along_px(PLANE_MAX - steps * 1e-5));
            let slope_px = (border_px * 3.0 - one_px * 4.0 + two_px) / 2e-5;
            for beyond in [0.01, 0.5, 3.0] {
                let off_px = along_px(PLANE_MAX + beyond) - (border_px + slope_px * beyond);
                // Rounding of pixels, over the steps.
                assert!(off_px.norm() < 1e-6, "{beyond}: {off_px}");
            }
        }
    }
}
