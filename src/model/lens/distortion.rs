//! How lenses distort rays: the models of the paper and of OpenCV and ROS.
//!
//! With (x, y) the ray, r^2 = x^2 + y^2, and the coefficients named as in OpenCV, all models but
//! the last are
//!
//! ```text
//!              1 + k1 r^2 + k2 r^4 + k3 r^6
//! x' = x * ───────────────────────────── + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
//!              1 + k4 r^2 + k5 r^4 + k6 r^6
//! ```
//!
//! and y' the same with p1 and p2 exchanged, s3 and s4 for s1 and s2. The last one is OpenCV's
//! fisheye model, ROS's `equidistant` (Kannala and Brandt 2006): with theta the angle of the ray to
//! the optical axis, the distorted ray has the length theta (1 + k1 theta^2 + k2 theta^4 + k3
//! theta^6 + k4 theta^8).

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

/// Distortion coefficients, acting on rays.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Distortion {
    /// k1, k2: the paper's model (Zhang 2000, section 3.3).
    Radial2([f64; 2]),
    /// k1, k2, p1, p2, k3: Brown's model in OpenCV's order.
    Brown5([f64; 5]),
    /// k1, k2, p1, p2, k3, k4, k5, k6: OpenCV's rational model.
    Rational8([f64; 8]),
    /// The same and s1, s2, s3, s4: with OpenCV's thin prism.
    ThinPrism12([f64; 12]),
    /// k1, k2, k3, k4: OpenCV's fisheye model.
    Fisheye4([f64; 4]),
}

/// Below this length of a ray a fisheye's distortion is given by the first terms of its series: what
/// is left out is beyond the last digit.
const NEAR_AXIS: f64 = 1e-4;

impl Distortion {
    /// As many as the model has, in its order.
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        match self {
            Self::Radial2(coefficients) => coefficients,
            Self::Brown5(coefficients) => coefficients,
            Self::Rational8(coefficients) => coefficients,
            Self::ThinPrism12(coefficients) => coefficients,
            Self::Fisheye4(coefficients) => coefficients,
        }
    }

    /// The same, to be changed.
    pub fn coefficients_mut(&mut self) -> &mut [f64] {
        match self {
            Self::Radial2(coefficients) => coefficients,
            Self::Brown5(coefficients) => coefficients,
            Self::Rational8(coefficients) => coefficients,
            Self::ThinPrism12(coefficients) => coefficients,
            Self::Fisheye4(coefficients) => coefficients,
        }
    }

    /// The model's name in camera files and commands.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Radial2(_) => "radial2",
            Self::Brown5(_) => "brown5",
            Self::Rational8(_) => "rational8",
            Self::ThinPrism12(_) => "thin_prism12",
            Self::Fisheye4(_) => "fisheye4",
        }
    }

    /// OpenCV's names of the coefficients, in the model's order.
    #[must_use]
    pub fn names(&self) -> &'static [&'static str] {
        const NAMES: [&str; 12] =
            ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"];
        match self {
            Self::Fisheye4(_) => &["k1", "k2", "k3", "k4"],
            other => &NAMES[..other.coefficients().len()],
        }
    }

    /// The distorted ray and its 2 x 2 Jacobian with respect to the ray.
    #[must_use]
    pub fn distort_with_jacobian(&self, ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match *self {
            Self::Fisheye4(k) => fisheye(&k, ray),
            _ => polynomial(&self.padded(), ray),
        }
    }

    /// The coefficients of the first four models as those of the largest of them; what a model
    /// lacks is 0.
    fn padded(&self) -> [f64; 12] {
        let mut all = [0.0; 12];
        let own = self.coefficients();
        all[..own.len()].copy_from_slice(own);
        all
    }

    /// The derivative of the distorted ray with respect to each coefficient, in their order.
    pub fn by_coefficients(&self, ray: &Vector2<f64>) -> impl Iterator<Item = Vector2<f64>> {
        let all = match self {
            Self::Fisheye4(_) => fisheye_by_coefficients(ray),
            _ => polynomial_by_coefficients(&self.padded(), ray),
        };
        all.into_iter().take(self.coefficients().len())
    }
}

fn polynomial(coefficients: &[f64; 12], ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = *coefficients;
    let (x, y) = (ray.x, ray.y);
    let r2 = x * x + y * y;
    let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
    let radial = above / below;
    // Derivatives with respect to r2.
    let above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
    let below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
    let slope = (above_slope - radial * below_slope) / below;
    let (prism_x, prism_y) = (r2 * (s1 + r2 * s2), r2 * (s3 + r2 * s4));
    let (prism_x_slope, prism_y_slope) = (s1 + r2 * 2.0 * s2, s3 + r2 * 2.0 * s4);
    let distorted = Vector2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + prism_x,
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + prism_y,
    );
    let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
    let jacobian = Matrix2::new(
        radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * prism_x_slope,
        cross + 2.0 * y * prism_x_slope,
        cross + 2.0 * x * prism_y_slope,
        radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * prism_y_slope,
    );
    (distorted, jacobian)
}

fn polynomial_by_coefficients(coefficients: &[f64; 12], ray: &Vector2<f64>) -> [Vector2<f64>; 12] {
    let [k1, k2, _, _, k3, k4, k5, k6, ..] = *coefficients;
    let (x, y) = (ray.x, ray.y);
    let r2 = ray.norm_squared();
    let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
    let first = ray * (r2 / below);
    let second = first * r2;
    let third = second * r2;
    let divided = -above / below;
    let prism = [Vector2::x(), Vector2::y()].map(|axis| [axis * r2, axis * (r2 * r2)]);
    [
        first,
        second,
        Vector2::new(2.0 * x * y, r2 + 2.0 * y * y),
        Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y),
        third,
        first * divided,
        second * divided,
        third * divided,
        prism[0][0],
        prism[0][1],
        prism[1][0],
        prism[1][1],
    ]
}

fn fisheye(&[k1, k2, k3, k4]: &[f64; 4], ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let r = ray.norm();
    // The distorted length over r, and the derivative of that with respect to r, over r.
    let (scale, slope_per_r) = if r < NEAR_AXIS {
        (1.0 + (k1 - 1.0 / 3.0) * r * r, 2.0 * (k1 - 1.0 / 3.0))
    } else {
        let theta = libm::atan(r);
        let t2 = theta * theta;
        let length = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        let by_theta = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        let scale = length / r;
        (scale, (by_theta / (1.0 + r * r) - scale) / (r * r))
    };
    (ray * scale, Matrix2::identity() * scale + ray * ray.transpose() * slope_per_r)
}

fn fisheye_by_coefficients(ray: &Vector2<f64>) -> [Vector2<f64>; 12] {
    let r = ray.norm();
    let theta = libm::atan(r);
    let direction = if r > 0.0 { ray / r } else { Vector2::zeros() };
    let mut power = theta;
    core::array::from_fn(|_| {
        power *= theta * theta;
        direction * power
    })
}
