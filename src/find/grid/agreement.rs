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
/// Least pivot of neighbours that are not on too few lines, as a share of its diagonal element. Rounding
/// leaves less than 1e-15 of one that is 0; the least of others is a thousandth.
const PIVOT_MIN: f64 = 1e-9;
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
    let cholesky = normal.cholesky()?;
    let pivot = |row: usize| cholesky.l_dirty()[(row, row)] * cholesky.l_dirty()[(row, row)];
    if (0..6).any(|row| pivot(row) < PIVOT_MIN * normal[(row, row)]) {
        return None;
    }
    let surface = cholesky.solve(&right);
    let error = libm::hypot(surface[(0, 0)], surface[(0, 1)]);
    let step_px = if step_px < f64::MAX { step_px } else { return None };
    error.is_finite().then(|| error / (ERROR_MAX * step_px + ERROR_MAX_PX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::find::grid::lattice::Least;
    use crate::find::grid::tests::drawn::{corners_at, grown, px};

    /// Curved and in perspective: quadratic in the place.
    fn curved_px([u, v]: [f64; 2]) -> [f64; 2] {
        let [x, y] = px([u, v]);
        [x + 0.3 * u * u - 0.2 * u * v + 0.1 * v * v, y - 0.1 * u * u + 0.25 * u * v + 0.2 * v * v]
    }

    #[test]
    fn a_quadratic_lattice_agrees_with_itself() {
        let corners = corners_at([6, 5], curved_px);
        let (mut lattice, bounds) = grown(&corners, Least::Target);
        for cell in bounds.cells() {
            let excess = excess(&lattice, &corners, cell).unwrap();
            // Positions in single precision, extrapolated by two steps.
            assert!(excess < 1e-3, "{cell:?}: {excess}");
        }
        remove_disagreeing(&mut lattice, &corners, bounds);
        assert_eq!(lattice.cells().count(), 30);
        assert_eq!(excess(&lattice, &corners, [6, 0]), None);
    }

    /// The distance from the place that the others predict, divided by the allowed one: 0.12 of the way to the
    /// nearest neighbour, and a pixel.
    #[test]
    fn the_excess_is_the_distance_divided_by_the_allowed_one() {
        let exact = corners_at([6, 5], curved_px);
        let (lattice, _) = grown(&exact, Least::Target);
        for cell in [[2, 2], [0, 0], [5, 4], [3, 0], [1, 3]] {
            for moved in [[2.0, 0.5], [-1.0, 3.0], [0.0, -1.5]] {
                let mut corners = exact.clone();
                let place = (cell[1] * 6 + cell[0]) as usize;
                for (coordinate, moved) in corners[place].position_px.iter_mut().zip(moved) {
                    *coordinate += moved as f32;
                }
                let here = corners[place].position_px.map(f64::from);
                let neighbours = [[1, 0], [-1, 0], [0, 1], [0, -1]].map(|step: [i32; 2]| {
                    let index = lattice.corner([cell[0] + step[0], cell[1] + step[1]])?;
                    let [x, y] = corners[usize::from(index)].position_px.map(f64::from);
                    Some((x - here[0]).hypot(y - here[1]))
                });
                let step_px = neighbours.into_iter().flatten().fold(f64::MAX, f64::min);
                let moved_px = f64::hypot(moved[0], moved[1]);
                let expected = moved_px / (0.12 * step_px + 1.0);
                let excess = excess(&lattice, &corners, cell).unwrap();
                assert!(
                    (excess - expected).abs() < 1e-3,
                    "{cell:?} {moved:?}: {excess} {expected}"
                );
            }
        }
    }

    #[test]
    fn the_worst_are_removed_first_and_at_most_eight() {
        let exact = corners_at([6, 5], px);
        let (_, bounds) = grown(&exact, Least::Target);
        // Along u, 17 px from the nearest neighbours: 0.12 times 17, and 1, is 3.04 px.
        for (moved, is_removed) in [(2.9, false), (3.2, true)] {
            let (mut lattice, _) = grown(&exact, Least::Target);
            let mut corners = exact.clone();
            corners[2 * 6 + 2].position_px[0] += moved;
            remove_disagreeing(&mut lattice, &corners, bounds);
            assert_eq!(lattice.corner([2, 2]).is_none(), is_removed, "{moved}");
            assert_eq!(lattice.cells().count(), if is_removed { 29 } else { 30 });
        }
        // Ten far from each other, more than may be removed.
        let large = corners_at([19, 7], |[u, v]| [20.0 * u, 20.0 * v]);
        let (mut lattice, bounds) = grown(&large, Least::Target);
        let moved = || (0..10).map(|n| [4 * (n % 5) + 1, 4 * (n / 5) + 1]);
        let mut corners = large.clone();
        for (n, [u, v]) in moved().enumerate() {
            corners[(19 * v + u) as usize].position_px[1] += 6.0 + 0.1 * n as f32;
        }
        remove_disagreeing(&mut lattice, &corners, bounds);
        let removed = bounds.cells().filter(|&cell| lattice.corner(cell).is_none());
        // The two that are moved least remain.
        assert!(removed.eq(moved().skip(2)));
    }

    #[test]
    fn without_eight_neighbours_on_enough_lines_there_is_no_prediction() {
        let corners = corners_at([3, 3], px);
        let (mut lattice, _) = grown(&corners, Least::Target);
        assert!(excess(&lattice, &corners, [1, 1]).is_some());
        lattice.remove([2, 2]);
        assert_eq!(excess(&lattice, &corners, [1, 1]), None);
        // Two lines: nothing says how it curves across.
        let corners = corners_at([5, 3], px);
        let (mut lattice, _) = grown(&corners, Least::Target);
        (0..5).for_each(|u| lattice.remove([u, 2]));
        assert_eq!(excess(&lattice, &corners, [2, 0]), None);
        // Nor for a corner beside a whole board, wherever along its side it lies.
        let corners = corners_at([7, 6], px);
        for place in 0..5 {
            for only in [[6, place], [place, 5]] {
                let (mut lattice, bounds) = grown(&corners, Least::Target);
                let is_other = |cell: &[i32; 2]| (cell[0] == 6 || cell[1] == 5) && *cell != only;
                bounds.cells().filter(is_other).for_each(|cell| lattice.remove(cell));
                assert_eq!(excess(&lattice, &corners, only), None, "{only:?}");
            }
        }
        // None of the four nearest: nothing says how long a step is.
        let corners = corners_at([5, 5], px);
        let (mut lattice, _) = grown(&corners, Least::Target);
        assert!(excess(&lattice, &corners, [2, 2]).is_some());
        for cell in [[1, 2], [3, 2], [2, 1]] {
            lattice.remove(cell);
        }
        assert!(excess(&lattice, &corners, [2, 2]).is_some());
        lattice.remove([2, 3]);
        assert_eq!(excess(&lattice, &corners, [2, 2]), None);
        // Corners three steps away do not matter.
        let mut corners = corners_at([7, 3], px);
        let (lattice, _) = grown(&corners, Least::Target);
        let before = excess(&lattice, &corners, [1, 1]);
        corners[4].position_px = [0.0, 0.0];
        assert_eq!(excess(&lattice, &corners, [1, 1]), before);
        corners[3].position_px[0] += 1.0;
        assert_ne!(excess(&lattice, &corners, [1, 1]), before);
    }
}
