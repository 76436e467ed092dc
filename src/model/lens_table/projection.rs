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
