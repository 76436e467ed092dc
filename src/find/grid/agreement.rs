//! Whether each corner of a lattice lies where its neighbours predict it.
//!
//! For each coordinate, a quadratic surface is fitted to the corners at most two steps away,
//! without the tested one: over four squares, perspective and lens distortion are quadratic to
//! within a few hundredths of a square.

use nalgebra::{SMatrix, SVector};

use super::lattice::{Bounds, Lattice};
use crate::find::corner::Corner;

/// Steps to the farthest neighbours that are used.
const REACH: i32 = 2;
/// Fewest neighbours that overdetermine the surface.
const NEIGHBOURS_MIN: usize = 8;
/// Largest distance from the prediction, in steps to the nearest neighbour.
const ERROR_MAX: f64 = 0.12;
/// What the error of the positions, a quarter of a pixel, may add at the lattice's own corners,
/// where the surface is extrapolated.
const ERROR_MAX_PX: f64 = 1.0;
/// Most corners that may be removed before the rest is no longer reliable.
const REMOVALS_MAX: usize = 8;

/// Removes the corners that disagree, the worst first.
pub(super) fn remove_disagreeing(lattice: &mut Lattice, corners: &[Corner], bounds: Bounds) {
    for _ in 0..REMOVALS_MAX {
        let worst = bounds
            .cells()
            .filter_map(|cell| Some((excess(lattice, corners, cell)?, cell)))
            .max_by(|(a, _), (b, _)| a.total_cmp(b));
        match worst {
            Some((excess, cell)) if excess > 1.0 => lattice.remove(cell),
            _ => return,
        }
    }
}

/// The distance of a corner from its prediction, divided by the allowed distance; `None` where
/// there is no corner or no prediction.
fn excess(lattice: &Lattice, corners: &[Corner], cell: [i32; 2]) -> Option<f64> {
    let position = |index: u16| corners[usize::from(index)].position_px.map(f64::from);
    let here = position(lattice.corner(cell)?);
    let mut normal = SMatrix::<f64, 6, 6>::zeros();
    let mut right = SMatrix::<f64, 6, 2>::zeros();
    let mut neighbours = 0;
    let mut step_px = f64::MAX;
    for dj in -REACH..=REACH {
        for di in -REACH..=REACH {
            let Some(index) = lattice.corner([cell[0] + di, cell[1] + dj]) else { continue };
            if (di, dj) == (0, 0) {
                continue;
            }
            let [x, y] = position(index);
            let offset = [x - here[0], y - here[1]];
            if di.abs() + dj.abs() == 1 {
                step_px = step_px.min(libm::hypot(offset[0], offset[1]));
            }
            let (u, v) = (f64::from(di), f64::from(dj));
            let terms = SVector::from([1.0, u, v, u * u, u * v, v * v]);
            normal += terms * terms.transpose();
            right += terms * SVector::from(offset).transpose();
            neighbours += 1;
        }
    }
    if neighbours < NEIGHBOURS_MIN {
        return None;
    }
    // Singular when the neighbours lie on too few lines: no prediction.
    let surface = normal.cholesky()?.solve(&right);
    let error = libm::hypot(surface[(0, 0)], surface[(0, 1)]);
    let step_px = if step_px < f64::MAX { step_px } else { return None };
    error.is_finite().then(|| error / (ERROR_MAX * step_px + ERROR_MAX_PX))
}
