//! The paper's step: the point to which every gradient is at right angles.
//!
//! p = argmin_q sum_n (grad_n^T (n - q))^2 over the window's pixels n (the
//! paper, section "Feature detection"; Geiger et al. 2012; Foerstner and Guelch
//! 1987). On an edge through q the gradient is normal to n - q, in the flat
//! sectors it vanishes. The minimum solves the 2 x 2 system
//! (sum g g^T) q = sum g g^T n.
//!
//! It is kept as the published baseline: it squares the noise of every flat
//! pixel into its system and the blur rounds the edges at the crossing, so that
//! its spread is about three times the model fit's.

use super::RefineFailure;
use super::patch::{Patch, RADIUS_PX_MAX};

/// The smaller eigenvalue of sum g g^T must reach this part of the larger; an
/// edge alone has 0 and noise, edges 30 degrees apart have 0.07.
const EIGENVALUE_RATIO_MIN: f32 = 0.04;

const SIDE_MAX: usize = 2 * RADIUS_PX_MAX + 1;

/// The minimum, relative to the window's middle, with what it is made of.
pub(super) struct Minimum {
    pub(super) offset_px: [f32; 2],
    /// Inverse of sum g g^T: xx, xy, yy.
    inverse: [f32; 3],
}

/// Central differences: half the difference of the two neighbours, at the flat `index`.
fn gradient(pixels: &[f32], side: usize, index: usize) -> [f32; 2] {
    [
        0.5 * (pixels[index + 1] - pixels[index - 1]),
        0.5 * (pixels[index + side] - pixels[index - side]),
    ]
}

/// Solves one window.
///
/// # Errors
/// [`RefineFailure::NotASaddle`] when the gradients do not span both directions.
pub(super) fn solve(patch: &Patch) -> Result<Minimum, RefineFailure> {
    let (pixels, side) = (patch.pixels(), patch.side());
    let radius = patch.radius as f32;
    let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0_f32, 0.0, 0.0, 0.0, 0.0);
    for row in 1..side - 1 {
        let y = row as f32 - radius;
        for column in 1..side - 1 {
            let x = column as f32 - radius;
            let [gx, gy] = gradient(pixels, side, row * side + column);
            let along = gx * x + gy * y;
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
            bx += gx * along;
            by += gy * along;
        }
    }
    let determinant = xx * yy - xy * xy;
    let trace = xx + yy;
    let bound =
        EIGENVALUE_RATIO_MIN / ((1.0 + EIGENVALUE_RATIO_MIN) * (1.0 + EIGENVALUE_RATIO_MIN));
    if !(trace > 0.0 && determinant > bound * trace * trace) {
        return Err(RefineFailure::NotASaddle);
    }
    let inverse = [yy / determinant, -xy / determinant, xx / determinant];
    let offset_px = [inverse[0] * bx + inverse[1] * by, inverse[1] * bx + inverse[2] * by];
    Ok(Minimum { offset_px, inverse })
}

impl Minimum {
    /// Standard deviation of one coordinate for white noise of standard
    /// deviation `noise`: the noise of every pixel, followed through the
    /// differences and the system to first order.
    pub(super) fn sigma_px(&self, patch: &Patch, noise: f32) -> f32 {
        let (pixels, side) = (patch.pixels(), patch.side());
        let radius = patch.radius as f32;
        // d(offset) / d(pixel), times 2 (the differences' halves are taken out).
        let mut influence = [[0.0_f32; 2]; SIDE_MAX * SIDE_MAX];
        for row in 1..side - 1 {
            for column in 1..side - 1 {
                let index = row * side + column;
                let [gx, gy] = gradient(pixels, side, index);
                let x = column as f32 - radius - self.offset_px[0];
                let y = row as f32 - radius - self.offset_px[1];
                let along = gx * x + gy * y;
                let by_gx = self.step([along + gx * x, gy * x]);
                let by_gy = self.step([gx * y, along + gy * y]);
                for axis in 0..2 {
                    influence[index + 1][axis] += by_gx[axis];
                    influence[index - 1][axis] -= by_gx[axis];
                    influence[index + side][axis] += by_gy[axis];
                    influence[index - side][axis] -= by_gy[axis];
                }
            }
        }
        let squares: f32 = influence.as_flattened().iter().map(|value| value * value).sum();
        // A quarter for the halves, half for the mean of the two coordinates.
        noise * libm::sqrtf(squares * 0.125)
    }

    fn step(&self, right: [f32; 2]) -> [f32; 2] {
        [
            self.inverse[0] * right[0] + self.inverse[1] * right[1],
            self.inverse[1] * right[0] + self.inverse[2] * right[1],
        ]
    }
}
