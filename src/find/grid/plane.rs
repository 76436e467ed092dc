//! The plane of a lattice: where a homography, fitted to all of its corners, puts each place.
//!
//! Over the few squares of a target, a lens bends the lines by a small part of a square; where it
//! bends them more, corners are not predicted, and what lies behind a cover stays unknown.

use nalgebra::{SMatrix, SVector};

use super::lattice::Lattice;
use crate::find::corner::Corner;

/// Fewest corners: they give twelve equations for eight unknowns.
const CORNERS_MIN: usize = 6;

/// How much is known of the perspective beforehand: its share of a step per step is about 0.02,
/// while corners are good to about 0.003 of a lattice's size; (0.003 / 0.02)^2. It matters where
/// only two lines are seen.
const PERSPECTIVE_WEIGHT: f64 = 0.02;

/// From places of a lattice to pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Subtracted from a place.
    cell: [f64; 2],
    /// Added to a pixel, after multiplication with `scale_px`.
    px: [f64; 2],
    scale_px: f64,
    /// `x = (h0 u + h1 v + h2) / (h6 u + h7 v + 1)`, and y with h3, h4, h5.
    h: SVector<f64, 8>,
}

impl Plane {
    /// The plane of a lattice's corners; `None` when they do not fix one.
    pub(super) fn fit(lattice: &Lattice, corners: &[Corner]) -> Option<Self> {
        let seen = || {
            lattice.cells().filter_map(|cell| {
                let position_px = corners.get(usize::from(lattice.corner(cell)?))?.position_px;
                Some((cell.map(f64::from), position_px.map(f64::from)))
            })
        };
        let (mut count, mut cell, mut px) = (0_usize, [0.0; 2], [0.0; 2]);
        for (place, position_px) in seen() {
            count += 1;
            for axis in 0..2 {
                cell[axis] += place[axis];
                px[axis] += position_px[axis];
            }
        }
        if count < CORNERS_MIN {
            return None;
        }
        let cell = cell.map(|sum| sum / count as f64);
        let px = px.map(|sum| sum / count as f64);
        let scale_px = seen()
            .map(|(_, position)| libm::hypot(position[0] - px[0], position[1] - px[1]))
            .fold(0.0, f64::max);
        if scale_px <= 0.0 {
            return None;
        }
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut right = SVector::<f64, 8>::zeros();
        for (place, position) in seen() {
            let [u, v] = [place[0] - cell[0], place[1] - cell[1]];
            let [x, y] = [0, 1].map(|axis| (position[axis] - px[axis]) / scale_px);
            for (row, value) in [
                ([u, v, 1.0, 0.0, 0.0, 0.0, -u * x, -v * x], x),
                ([0.0, 0.0, 0.0, u, v, 1.0, -u * y, -v * y], y),
            ] {
                let row = SVector::from(row);
                normal += row * row.transpose();
                right += row * value;
            }
        }
        for row in 6..8 {
            normal[(row, row)] += PERSPECTIVE_WEIGHT;
        }
        let h = normal.cholesky()?.solve(&right);
        h.iter().all(|value| value.is_finite()).then_some(Self { cell, px, scale_px, h })
    }

    /// The pixel of a place; `None` near the horizon or beyond it.
    pub(super) fn at(&self, [u, v]: [f32; 2]) -> Option<[f32; 2]> {
        let Self { cell, px, scale_px, h } = self;
        let [u, v] = [f64::from(u) - cell[0], f64::from(v) - cell[1]];
        let depth = h[6] * u + h[7] * v + 1.0;
        if depth < 0.2 {
            return None;
        }
        let x = (h[0] * u + h[1] * v + h[2]) / depth;
        let y = (h[3] * u + h[4] * v + h[5]) / depth;
        Some([(px[0] + scale_px * x) as f32, (px[1] + scale_px * y) as f32])
    }

    /// The steps along u and along v at a place, pixels.
    pub(super) fn steps(&self, [u, v]: [f32; 2]) -> Option<[[f32; 2]; 2]> {
        let between = |[du, dv]: [f32; 2]| {
            let (from, to) = (self.at([u - du, v - dv])?, self.at([u + du, v + dv])?);
            Some([to[0] - from[0], to[1] - from[1]])
        };
        Some([between([0.5, 0.0])?, between([0.0, 0.5])?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::find::grid::lattice::Least;
    use crate::find::grid::tests::drawn::{STEP_PX, corners_at, grown, px};

    /// A board tilted about both axes.
    fn tilted_px([u, v]: [f64; 2]) -> [f64; 2] {
        let depth = 1.0 + 0.02 * u - 0.03 * v;
        [120.0 + (20.0 * u + 1.5 * v) / depth, 110.0 + (17.0 * v - 2.0 * u) / depth]
    }

    fn steps_apart_px([a, b]: [[f32; 2]; 2]) -> f32 {
        libm::hypotf(a[0] - b[0], a[1] - b[1])
    }

    #[test]
    fn without_perspective_it_is_exact() {
        let corners = corners_at([4, 3], px);
        let (lattice, _) = grown(&corners, Least::Target);
        let plane = Plane::fit(&lattice, &corners).unwrap();
        for place in [[0.0, 0.0], [3.0, 2.0], [1.5, 0.25], [-4.0, 7.0], [9.0, -3.0]] {
            let expected = px(place).map(|value| value as f32);
            let at = plane.at(place.map(|value| value as f32)).unwrap();
            // Single precision, of some hundred pixels.
            assert!(steps_apart_px([at, expected]) < 1e-4, "{place:?}: {at:?} {expected:?}");
            let [along_u, along_v] = plane.steps(place.map(|value| value as f32)).unwrap();
            assert!(steps_apart_px([along_u, [STEP_PX[0] as f32, 0.0]]) < 1e-4, "{along_u:?}");
            assert!(steps_apart_px([along_v, [0.0, STEP_PX[1] as f32]]) < 1e-4, "{along_v:?}");
        }
    }

    /// The sum of squares of which the plane is the minimum: the errors of x and of y at each corner,
    /// multiplied by the depth, in units of the lattice's size; and what is known of the perspective.
    fn cost(plane: &Plane, corners: &[Corner], columns: usize) -> f64 {
        let h = &plane.h;
        let of_corners = corners.iter().enumerate().map(|(n, corner)| {
            let [u, v] =
                [(n % columns) as f64 - plane.cell[0], (n / columns) as f64 - plane.cell[1]];
            let depth = h[6] * u + h[7] * v + 1.0;
            let [x, y] = [0, 1].map(|axis| {
                (f64::from(corner.position_px[axis]) - plane.px[axis]) / plane.scale_px
            });
            let errors =
                [h[0] * u + h[1] * v + h[2] - depth * x, h[3] * u + h[4] * v + h[5] - depth * y];
            errors[0].powi(2) + errors[1].powi(2)
        });
        of_corners.sum::<f64>() + 0.02 * (h[6].powi(2) + h[7].powi(2))
    }

    #[test]
    fn it_has_the_least_sum_of_squares() {
        let mut corners = corners_at([4, 3], tilted_px);
        // Some corners are not quite in their place.
        corners[5].position_px[0] += 0.8;
        corners[10].position_px[1] -= 0.6;
        let (lattice, _) = grown(&corners, Least::Target);
        let plane = Plane::fit(&lattice, &corners).unwrap();
        // The mean place and the mean pixel are the origins; all corners are within 1 of it.
        assert_eq!(plane.cell, [1.5, 1.0]);
        let mean_x =
            corners.iter().map(|corner| f64::from(corner.position_px[0])).sum::<f64>() / 12.0;
        let mean_y =
            corners.iter().map(|corner| f64::from(corner.position_px[1])).sum::<f64>() / 12.0;
        assert!((plane.px[0] - mean_x).abs() < 1e-9 && (plane.px[1] - mean_y).abs() < 1e-9);
        let farthest = corners.iter().map(|corner| {
            let [x, y] = corner.position_px.map(f64::from);
            (x - mean_x).hypot(y - mean_y)
        });
        assert!((plane.scale_px - farthest.fold(0.0, f64::max)).abs() < 1e-9);
        for parameter in 0..8 {
            let moved = |by: f64| {
                let mut moved = plane;
                moved.h[parameter] += by;
                cost(&moved, &corners, 4)
            };
            // Central differences of a square are exact.
            let slope = (moved(1e-3) - moved(-1e-3)) / 2e-3;
            assert!(slope.abs() < 1e-9, "{parameter}: {slope}");
            assert!(moved(1e-3) > moved(0.0), "{parameter}");
        }
        // The sum is that at the corners themselves.
        for (n, corner) in corners.iter().enumerate() {
            let at = plane.at([(n % 4) as f32, (n / 4) as f32]).unwrap();
            // Less than the largest displacement.
            assert!(steps_apart_px([at, corner.position_px]) < 0.8, "{n}: {at:?} {corner:?}");
        }
    }

    #[test]
    fn steps_are_from_half_a_step_before_to_half_a_step_after() {
        let corners = corners_at([4, 3], tilted_px);
        let (lattice, _) = grown(&corners, Least::Target);
        let plane = Plane::fit(&lattice, &corners).unwrap();
        let [u, v] = [1.25, 0.75];
        for (axis, [du, dv]) in [(0, [0.5, 0.0]), (1, [0.0, 0.5])] {
            let step = plane.steps([u, v]).unwrap()[axis];
            let [from, to] = [[u - du, v - dv], [u + du, v + dv]].map(|it| plane.at(it).unwrap());
            assert_eq!(step, [to[0] - from[0], to[1] - from[1]]);
        }
    }

    #[test]
    fn near_the_horizon_there_is_no_pixel() {
        let plane = Plane {
            cell: [1.0, 2.0],
            px: [100.0, 50.0],
            scale_px: 10.0,
            h: SVector::from([1.0, 0.0, 0.5, 0.0, 2.0, 0.0, -0.1, -0.2]),
        };
        // u = 3, v = -2 from the origin: the depth is 1 - 0.3 + 0.4.
        let [x, y] = plane.at([4.0, 0.0]).unwrap();
        assert!((f64::from(x) - (100.0 + 10.0 * 3.5 / 1.1)).abs() < 1e-4, "{x}");
        assert!((f64::from(y) - (50.0 - 10.0 * 4.0 / 1.1)).abs() < 1e-4, "{y}");
        // A depth of 0.21, and of 0.19; and beyond the horizon.
        assert!(plane.at([8.9, 2.0]).is_some());
        assert!(plane.at([9.1, 2.0]).is_none());
        assert!(plane.at([1.0, 8.0]).is_none());
        // Half a step farther is too near: there are no steps.
        assert!(plane.steps([7.9, 2.0]).is_some());
        assert!(plane.steps([8.6, 2.0]).is_none());
        assert!(plane.steps([1.0, 5.7]).is_none());
    }

    #[test]
    fn six_corners_fix_it_and_five_or_one_place_do_not() {
        let corners = corners_at([3, 3], px);
        let (mut lattice, _) = grown(&corners, Least::Target);
        for cell in [[2, 0], [0, 2], [1, 1]] {
            lattice.remove(cell);
        }
        assert!(Plane::fit(&lattice, &corners).is_some());
        lattice.remove([2, 2]);
        assert!(Plane::fit(&lattice, &corners).is_none());
        let (lattice, _) = grown(&corners, Least::Target);
        let mut same = corners.clone();
        same.iter_mut().for_each(|corner| corner.position_px = [100.0, 100.0]);
        assert!(Plane::fit(&lattice, &same).is_none());
        let mut wrong = corners;
        wrong[4].position_px[0] = f32::NAN;
        assert!(Plane::fit(&lattice, &wrong).is_none());
    }
}
