//! The 95 % prediction ellipse: the region in which one more point would lie with 95 % probability.
//!
//! For N normally distributed points with sample covariance `S` (over N - 1), the semi-axes of the
//! ellipse are `sqrt(k lambda)` with the eigenvalues `lambda` of `S`, and its area is `pi k
//! sqrt(det S)`, where `k = 2 (N - 1) (N + 1) / (N (N - 2)) F` and `F` is the 0.95 quantile of
//! Fisher's distribution with 2 and N - 2 degrees of freedom (Schubert & Kirchner 2014, Gait
//! Posture 39:518). This is the `COParea` of the data set BDS. The points of a trial are not
//! independent, so 95 % is a name rather than a probability.

use nalgebra::{Matrix2, SymmetricEigen, Vector2};
use serde::Serialize;

use super::figure::{Absent, ByPlane, Figure, Figures};
use super::path::along;
use crate::series::{Plane, Series};

/// With two points, Fisher's distribution would have no degrees of freedom left.
const SAMPLES_MIN: usize = 3;

/// An ellipse in one plane.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ellipse {
    /// The area, mm².
    pub area_mm2: Figure,
    /// The longer semi-axis, mm.
    pub major_mm: Figure,
    /// The shorter semi-axis, mm.
    pub minor_mm: Figure,
    /// The angle of the longer semi-axis, from the plane's first axis towards its second, above
    /// -pi/2 and up to pi/2.
    pub angle_rad: Figure,
}

impl Figures for Ellipse {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        let all = [&mut self.area_mm2, &mut self.major_mm, &mut self.minor_mm, &mut self.angle_rad];
        all.into_iter().for_each(visit);
    }
}

pub(super) fn ellipses(series: &Series) -> ByPlane<Ellipse> {
    ByPlane::of(|plane| {
        let axes = axes(series, plane);
        let figure = |of: fn(&Axes) -> f64| axes.as_ref().map(of).map_err(|absent| *absent);
        Ellipse {
            area_mm2: figure(|it| core::f64::consts::PI * it.major_mm * it.minor_mm).into(),
            major_mm: figure(|it| it.major_mm).into(),
            minor_mm: figure(|it| it.minor_mm).into(),
            angle_rad: axes.and_then(|it| it.angle_rad.ok_or(Absent::NoDirection)).into(),
        }
    })
}

/// Turns ellipses by half a turn where that brings their angles closer to those of others: an axis
/// has no sign, and angles just on either side of pi/2 are reported as pi/2 and -pi/2.
pub(super) fn turn_towards(ellipses: &mut ByPlane<Ellipse>, others: &ByPlane<Ellipse>) {
    use core::f64::consts::PI;
    let turn = |ellipse: &mut Ellipse, other: &Ellipse| {
        if let (Figure::Known { value, .. }, Some(other_rad)) =
            (&mut ellipse.angle_rad, other.angle_rad.value())
        {
            *value += PI * ((other_rad - *value) / PI).round();
        }
    };
    turn(&mut ellipses.transverse, &others.transverse);
    turn(&mut ellipses.sagittal, &others.sagittal);
    turn(&mut ellipses.coronal, &others.coronal);
}

struct Axes {
    major_mm: f64,
    minor_mm: f64,
    angle_rad: Option<f64>,
}

fn axes(series: &Series, plane: Plane) -> Result<Axes, Absent> {
    let [x_mm, y_mm] = plane.axes().map(|axis| along(series, axis));
    let (x_mm, y_mm) = (x_mm?, y_mm?);
    let samples = series.samples();
    if samples < SAMPLES_MIN {
        return Err(Absent::TooFewSamples { samples, needed: SAMPLES_MIN });
    }
    let count = samples as f64;
    let points = || x_mm.iter().zip(y_mm).map(|(x, y)| Vector2::new(*x, *y));
    let mean = points().sum::<Vector2<f64>>() / count;
    let scatter: Matrix2<f64> = points().map(|it| (it - mean) * (it - mean).transpose()).sum();
    let covariance = scatter / (count - 1.0);
    if !covariance.iter().all(|it| it.is_finite()) {
        return Err(Absent::Overflow);
    }
    let scale = 2.0 * (count - 1.0) * (count + 1.0) / (count * (count - 2.0)) * f_95(count - 2.0);
    let eigen = SymmetricEigen::new(covariance);
    let longer = eigen.eigenvalues.imax();
    // Rounding can make the smaller eigenvalue of a line negative.
    let semi_axis_mm = |index: usize| (scale * eigen.eigenvalues[index].max(0.0)).sqrt();
    let direction = eigen.eigenvectors.column(longer);
    // An axis along the plane's second axis has the angle pi/2, whatever its sign.
    let angle_rad = if direction.x == 0.0 {
        core::f64::consts::FRAC_PI_2
    } else {
        (direction.y / direction.x).atan()
    };
    Ok(Axes {
        major_mm: semi_axis_mm(longer),
        minor_mm: semi_axis_mm(1 - longer),
        angle_rad: (eigen.eigenvalues[0] != eigen.eigenvalues[1]).then_some(angle_rad),
    })
}

/// The 0.95 quantile of Fisher's distribution with 2 and `m` degrees of freedom, whose tail is
/// `(1 + 2 F / m)^(-m/2)`.
fn f_95(m: f64) -> f64 {
    m / 2.0 * (-2.0 / m * 0.05_f64.ln()).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fishers_quantile_is_the_tables() {
        // From any table of F: 5 %, 2 and 10 or 120 degrees of freedom.
        assert!((f_95(10.0) - 4.1028).abs() < 5e-5);
        assert!((f_95(120.0) - 3.0718).abs() < 5e-5);
        // Towards infinity: half of chi-squared, -ln 0.05, plus about (ln 0.05)^2 / m.
        assert!((f_95(1e9) + 0.05_f64.ln()).abs() < 1e-8);
    }
}
