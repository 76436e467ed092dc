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
