//! How a measured pose answers to an error of what it was computed with.
//!
//! In: the lens and the target as they are believed to be, and a pose measured with them. Out: by
//! how much the measured pose differs from the true one, for each number in which the true lens or
//! the true target differs from what is believed.
//!
//! The frame shows the target's edges through the true lens; the tracker fits the pose to them
//! through the believed one. With `J` the derivatives of the edges' positions with respect to the
//! pose, and `P` with respect to the numbers in question, an excess `d` of the true numbers moves
//! the pose by `(J'J)^-1 J'P d`. Each edge between two neighbouring corners is one position, across
//! the edge at its middle, as in the tracker, whose edges are all weighted alike here. First order
//! in `d`. One pose of a target of 30 corners costs about ten microseconds.

use nalgebra::{Matrix2x6, Matrix6, SMatrix, Vector2, Vector3};
use plumbline::lens::{Lens, ray_by_point, ray_of};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::TargetGeometry;

/// The most numbers that a lens has: fx fy cx cy skew, and twelve coefficients.
pub const LENS_NUMBERS: usize = 17;

/// The numbers of a target's shape: see [`shapes`].
pub const SHAPES: usize = 4;

/// All numbers: those of the lens, unused ones being zero, then those of the shape.
pub const NUMBERS: usize = LENS_NUMBERS + SHAPES;

/// The increments of a pose, as in [`Pose::moved_by`], by the numbers.
pub type Response = SMatrix<f64, 6, NUMBERS>;

/// How a point of a target moves for each number of its shape: three ways of bending and one of
/// stretching.
///
/// `x^2`, `x y` and `y^2` bend the target along its columns, along its diagonals and along its rows,
/// where `x` and `y` run from -1 to 1 between the outermost corners: the number is the height of the
/// edge over the middle, mm. The last is by what fraction the rows are farther apart than the
/// columns.
#[must_use]
pub fn shapes(target: &TargetGeometry, point_mm: &Vector3<f64>) -> [Vector3<f64>; SHAPES] {
    let first = target.corner_mm(0);
    let last = target.corner_mm(target.corner_count() - 1);
    let (middle, half) = ((first + last) * 0.5, (last - first) * 0.5);
    let from_middle = point_mm - middle;
    let (x, y) = (from_middle.x / half.x, from_middle.y / half.y);
    let bent = |height: f64| Vector3::new(0.0, 0.0, height);
    [bent(x * x), bent(x * y), bent(y * y), Vector3::new(0.0, from_middle.y, 0.0)]
}

/// The response of a pose; `None` where the target lies behind the camera or does not fix the pose.
#[must_use]
pub fn response(
    lens: &Lens,
    target: &TargetGeometry,
    cam_from_target: &Pose<Cam, Target>,
) -> Option<Response> {
    let corners: Vec<Projected> = (0..target.corner_count())
        .map(|corner| Projected::of(lens, target, cam_from_target, corner))
        .collect::<Option<_>>()?;
    let (mut normal, mut right) = (Matrix6::zeros(), Response::zeros());
    let mut add = |first: usize, second: usize| {
        let (first, second) = (&corners[first], &corners[second]);
        let along_px = second.raw_px - first.raw_px;
        let across = Vector2::new(-along_px.y, along_px.x) / along_px.norm();
        let by_pose = (first.by_pose + second.by_pose).tr_mul(&across) * 0.5;
        let by_numbers = (first.by_numbers + second.by_numbers).tr_mul(&across) * 0.5;
        normal += by_pose * by_pose.transpose();
        right += by_pose * by_numbers.transpose();
    };
    let (columns, rows) = (target.columns(), target.rows());
    for row in 0..rows {
        for column in 0..columns {
            let corner = row * columns + column;
            if column + 1 < columns {
                add(corner, corner + 1);
            }
            if row + 1 < rows {
                add(corner, corner + columns);
            }
        }
    }
    // Turns and shifts have different units: scaled to a diagonal of ones before the inversion.
    let scale = normal.diagonal().map(|it: f64| it.sqrt().recip());
    let scaled = Matrix6::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    let rows = Matrix6::from_diagonal(&scale);
    let response = rows * scaled.cholesky()?.solve(&(rows * right));
    response.iter().all(|it| it.is_finite()).then_some(response)
}

/// A corner's raw pixel and its derivatives.
struct Projected {
    raw_px: Vector2<f64>,
    by_pose: Matrix2x6<f64>,
    by_numbers: SMatrix<f64, 2, NUMBERS>,
}

impl Projected {
    fn of(
        lens: &Lens,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
        corner: usize,
    ) -> Option<Self> {
        let point_mm = target.corner_mm(corner);
        let point_cam_mm = cam_from_target.transform(&point_mm);
        let ray = ray_of(&point_cam_mm)?;
        let (distorted, by_ray) = lens.distortion.distort_with_jacobian(&ray);
        let by_point = lens.pixel_by_ray() * by_ray * ray_by_point(&point_cam_mm, &ray);
        let mut by_numbers = SMatrix::<f64, 2, NUMBERS>::zeros();
        for (place, column) in lens.pixel_by_numbers(&ray, &distorted).enumerate() {
            by_numbers.set_column(place, &column);
        }
        let by_shape = by_point * cam_from_target.rotation;
        for (place, moved) in shapes(target, &point_mm).into_iter().enumerate() {
            by_numbers.set_column(LENS_NUMBERS + place, &(by_shape * moved));
        }
        Some(Self {
            raw_px: lens.pixel_from_ray(&distorted),
            by_pose: by_point * cam_from_target.point_by_increment(&point_mm),
            by_numbers,
        })
    }
}

#[cfg(test)]
mod tests {
    use plumbline::lens::Distortion;
    use plumbline::target::{Origin, Role};

    use super::*;

    const LENS: Lens = Lens {
        width_px: 1456,
        height_px: 1088,
        fx_px: 1740.0,
        fy_px: 1738.0,
        cx_px: 735.0,
        cy_px: 540.0,
        skew_px: 0.5,
        distortion: Distortion::Radial2([-0.1, 0.05]),
    };

    fn target() -> TargetGeometry {
        TargetGeometry::checker(6, 5, 12.0, Origin::Center, Role::Lower, [0.0, 0.0, 100.0]).unwrap()
    }

    #[test]
    fn a_longer_focal_length_is_a_farther_target() {
        // If the true focal lengths are greater by a part e, the target looks larger and is
        // measured nearer by e of its distance, in the direction in which it is seen.
        let lens = Lens { distortion: Distortion::Radial2([0.0; 2]), skew_px: 0.0, ..LENS };
        let straight = Pose::from_theta([0.0, 0.3, -0.2, 0.0, 0.0, 950.0]);
        let response = response(&lens, &target(), &straight).unwrap();
        let change = response.column(0) * lens.fx_px + response.column(1) * lens.fy_px;
        // To first order in the size of the target over its distance, 30 to 950 mm.
        assert!((change[5] / -950.0 - 1.0).abs() < 0.03, "{change}");
    }

    #[test]
    fn a_principal_point_is_a_direction() {
        let straight = Pose::from_theta([0.0, 0.3, -0.2, 0.0, 0.0, 950.0]);
        let response = response(&LENS, &target(), &straight).unwrap();
        let by_cx = response.column(2);
        // A pixel to the right is 950 mm / 1740 px to the right.
        assert!((by_cx[3] - 950.0 / 1740.0).abs() < 0.01 * by_cx[3], "{by_cx}");
    }

    #[test]
    fn a_target_that_is_edge_on_has_no_response() {
        let behind = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, -950.0]);
        assert!(response(&LENS, &target(), &behind).is_none());
    }
}
