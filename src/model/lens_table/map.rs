//! A map of the plane as a table: a polynomial of the fourth degree for each cell of a grid.
//!
//! In: a smooth function on a rectangle. Out: its value and its Jacobian at any point. Each cell has
//! the 15 terms u^i v^j with i + j <= 4, fitted by least squares to 5 x 5 samples at Chebyshev nodes
//! (Mason and Handscomb 2003), so that the error is nearly the same all over the cell; it falls with
//! the fifth power of the cell's side. Where two cells meet, they differ by no more than the sum of
//! their errors. Outside the rectangle the map continues linearly.
//!
//! Cost: for each coordinate, with its two derivatives, 26 multiplications and as many additions;
//! both coordinates lie side by side in one register. No division, no square root, and only the 128
//! bytes of one cell are read.

use core::array;

use nalgebra::{Matrix2, Matrix5, Vector2};

/// A part of a plane.
pub(super) struct Rectangle {
    pub start: Vector2<f64>,
    pub end: Vector2<f64>,
}

/// A map of the plane; see the module's description.
#[derive(Debug, Clone)]
pub(super) struct Map<const SIDE: usize> {
    /// The middle of the first cell.
    start: Vector2<f64>,
    /// Cells per unit.
    per_unit: Vector2<f64>,
    /// Row by row.
    cells: [[Cell; SIDE]; SIDE],
}

impl<const SIDE: usize> Map<SIDE> {
    /// A map that gives 0 everywhere. It is all zeros, so that an idle pipeline takes no room in a
    /// program's file.
    pub const fn new() -> Self {
        Self {
            start: Vector2::new(0.0, 0.0),
            per_unit: Vector2::new(0.0, 0.0),
            cells: [[Cell::ZERO; SIDE]; SIDE],
        }
    }

    /// Becomes a function's map on a rectangle; `None` where the function has no value.
    pub fn fill(
        &mut self,
        on: &Rectangle,
        function: impl Fn(&Vector2<f64>) -> Option<Vector2<f64>>,
    ) -> Option<()> {
        let cell_size = (on.end - on.start) / SIDE as f64;
        self.start = on.start + cell_size * 0.5;
        self.per_unit = cell_size.map(|size| 1.0 / size);
        let fit = Fit::new();
        for (row, cells) in self.cells.iter_mut().enumerate() {
            for (column, cell) in cells.iter_mut().enumerate() {
                let middle = Vector2::new(column as f64, row as f64);
                *cell = fit.cell(|place| {
                    function(&(self.start + (middle + place).component_mul(&cell_size)))
                })?;
            }
        }
        Some(())
    }

    /// The value at a point and its Jacobian.
    #[inline]
    pub fn at(&self, from: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let place = (from - self.start).component_mul(&self.per_unit);
        match self.cell(&place) {
            Some((cell, within)) => cell.at(&within, &self.per_unit),
            None => self.beyond(&place),
        }
    }

    /// The cell that contains a place, which is counted in cells from the first one's middle, and
    /// the place in it, counted from its own. `None` outside the rectangle, and for NaN.
    #[inline]
    fn cell(&self, place: &Vector2<f64>) -> Option<(&Cell, Vector2<f64>)> {
        // Between 2^52 and 2^53 the last bit of a number is worth 1: the sum is rounded to the nearest
        // integer, and its bits count up from those of the constant. A place outside, and NaN, leave a
        // difference that is no index. Conversions and comparisons of floating-point numbers would
        // take more instructions for the same.
        const TO_INTEGER: f64 = 1.5 * (1_u64 << 52) as f64;
        let sum = place.add_scalar(TO_INTEGER);
        let [column, row] = array::from_fn(|axis| {
            usize::try_from(sum[axis].to_bits().wrapping_sub(TO_INTEGER.to_bits())).ok()
        });
        let cell = self.cells.get(row?)?.get(column?)?;
        Some((cell, place - sum.add_scalar(-TO_INTEGER)))
    }

    /// The value and the Jacobian outside the rectangle, where the map continues linearly from its
    /// border; NaN for NaN.
    #[cold]
    fn beyond(&self, place: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        // From its middle to its border a cell is half a cell wide; its last part might be rounded
        // to the cell beyond.
        const REACH: f64 = 0.499_999;
        let border = place.map(|place| place.clamp(-REACH, (SIDE - 1) as f64 + REACH));
        let Some((cell, within)) = self.cell(&border) else {
            return (Vector2::repeat(f64::NAN), Matrix2::repeat(f64::NAN));
        };
        let (value, jacobian) = cell.at(&within, &self.per_unit);
        (value + jacobian * (place - border).component_div(&self.per_unit), jacobian)
    }
}

/// The polynomial of one cell.
#[derive(Debug, Clone, Copy)]
struct Cell {
    /// The value in the middle.
    middle: [f64; 2],
    /// The coefficients of u, u2, u3, u4; v, uv, u2v, u3v; v2, uv2, u2v2; v3, uv3; v4. They are
    /// differences within the cell, for which single precision is enough.
    terms: [[f32; 2]; 14],
}

impl Cell {
    const ZERO: Self = Self { middle: [0.0; 2], terms: [[0.0; 2]; 14] };

    /// The value at a place, in cells from the middle, and its Jacobian, with `per_unit` cells to the
    /// unit.
    #[inline]
    fn at(&self, place: &Vector2<f64>, per_unit: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (u, v) = (place.x, place.y);
        let middle = Vector2::from(self.middle);
        let [u1, u2, u3, u4, v1, u1v1, u2v1, u3v1, v2, u1v2, u2v2, v3, u1v3, v4] =
            array::from_fn(|term| Vector2::from_fn(|axis, _| f64::from(self.terms[term][axis])));
        // The factors of each power of v, and their derivatives with respect to u.
        let (row0, row0_by_u) = horner([middle, u1, u2, u3, u4], u);
        let (row1, row1_by_u) = horner([v1, u1v1, u2v1, u3v1], u);
        let (row2, row2_by_u) = horner([v2, u1v2, u2v2], u);
        let (row3, row3_by_u) = horner([v3, u1v3], u);
        let (value, by_v) = horner([row0, row1, row2, row3, v4], v);
        let (by_u, _) = horner([row0_by_u, row1_by_u, row2_by_u, row3_by_u], v);
        (value, Matrix2::from_columns(&[by_u * per_unit.x, by_v * per_unit.y]))
    }
}

/// A polynomial and its derivative, by Horner's scheme; `terms` from the constant upwards, at least
/// two.
#[inline]
fn horner<const TERMS: usize>(
    terms: [Vector2<f64>; TERMS],
    at: f64,
) -> (Vector2<f64>, Vector2<f64>) {
    let mut slope = terms[TERMS - 1];
    let mut value = slope * at + terms[TERMS - 2];
    for term in terms[..TERMS - 2].iter().rev() {
        slope = slope * at + value;
        value = value * at + term;
    }
    (value, slope)
}

/// Chebyshev nodes of a cell along each axis: one more than the polynomial's degree.
const NODES: usize = 5;

/// Column i: the powers of u in the Chebyshev polynomial T_i(2 u), on a cell from -1/2 to 1/2.
const POWERS: Matrix5<f64> = Matrix5::new(
    1.0, 0.0, -1.0, 0.0, 1.0, //
    0.0, 2.0, 0.0, -6.0, 0.0, //
    0.0, 0.0, 8.0, 0.0, -32.0, //
    0.0, 0.0, 0.0, 32.0, 0.0, //
    0.0, 0.0, 0.0, 0.0, 128.0,
);

/// Fits cells' polynomials to samples.
struct Fit {
    /// Where the samples are along each axis, in cells from the middle.
    nodes: [f64; NODES],
    /// Chebyshev coefficients from samples.
    chebyshev: Matrix5<f64>,
}

impl Fit {
    fn new() -> Self {
        let angle = |node: usize| (node as f64 + 0.5) * core::f64::consts::PI / NODES as f64;
        Self {
            nodes: array::from_fn(|node| 0.5 * libm::cos(angle(node))),
            chebyshev: Matrix5::from_fn(|degree, node| {
                let twice = if degree == 0 { 1.0 } else { 2.0 };
                twice / NODES as f64 * libm::cos(degree as f64 * angle(node))
            }),
        }
    }

    /// The cell of a function of the place from the cell's middle; `None` where it has no value.
    fn cell(&self, function: impl Fn(Vector2<f64>) -> Option<Vector2<f64>>) -> Option<Cell> {
        let mut samples = [Matrix5::zeros(); 2];
        for (column, &u) in self.nodes.iter().enumerate() {
            for (row, &v) in self.nodes.iter().enumerate() {
                let value = function(Vector2::new(u, v))?;
                samples[0][(column, row)] = value.x;
                samples[1][(column, row)] = value.y;
            }
        }
        let coefficients = samples.map(|samples| {
            let mut degrees = self.chebyshev * samples * self.chebyshev.transpose();
            for u in 0..NODES {
                for v in NODES - u..NODES {
                    degrees[(u, v)] = 0.0;
                }
            }
            POWERS * degrees * POWERS.transpose()
        });
        let [x, y] = &coefficients;
        let mut terms = (0..NODES).flat_map(|v| (0..NODES - v).map(move |u| (u, v))).skip(1);
        Some(Cell {
            middle: [x[(0, 0)], y[(0, 0)]],
            terms: array::from_fn(|_| {
                let term = terms.next().unwrap_or_default();
                [x[term] as f32, y[term] as f32]
            }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::Random;

    /// A map on a rectangle that is nowhere near zero, of cells that are not square.
    fn map<const SIDE: usize>(function: impl Fn(&Vector2<f64>) -> Vector2<f64>) -> Map<SIDE> {
        let mut map = Map::new();
        let on = Rectangle { start: Vector2::new(1.0, -3.0), end: Vector2::new(2.0, -2.5) };
        map.fill(&on, |from| Some(function(from))).unwrap();
        map
    }

    fn any_place(random: &mut Random) -> Vector2<f64> {
        Vector2::new(random.uniform(1.0, 2.0), random.uniform(-3.0, -2.5))
    }

    #[test]
    fn a_polynomial_of_the_fourth_degree_is_its_own_map() {
        let map = map::<4>(|from| {
            let (x, y) = (from.x, from.y);
            Vector2::new(x.powi(4) + x.powi(3) * y - x * y + y, x * x * y * y + x * y.powi(3) - y)
        });
        let mut random = Random::new(1);
        for _ in 0..1000 {
            let from = any_place(&mut random);
            let (x, y) = (from.x, from.y);
            let (value, jacobian) = map.at(&from);
            let exact = Vector2::new(
                x.powi(4) + x.powi(3) * y - x * y + y,
                x * x * y * y + x * y.powi(3) - y,
            );
            let exact_jacobian = Matrix2::new(
                4.0 * x.powi(3) + 3.0 * x * x * y - y,
                x.powi(3) - x + 1.0,
                2.0 * x * y * y + y.powi(3),
                2.0 * x * x * y + 3.0 * x * y * y - 1.0,
            );
            // Within a cell values change by up to 7, and single precision has 24 bits.
            assert!((value - exact).norm() < 1e-6, "{value} instead of {exact}");
            // A cell is 0.125 wide.
            assert!((jacobian - exact_jacobian).norm() < 1e-5, "{jacobian}, not {exact_jacobian}");
        }
    }

    #[test]
    fn the_error_falls_with_the_fifth_power_of_the_cells_side() {
        let function =
            |from: &Vector2<f64>| Vector2::new((5.0 * from.x).sin() * from.y.cos(), from.y.exp());
        let mut random = Random::new(2);
        let (coarse, fine) = (map::<2>(function), map::<4>(function));
        let [mut coarse_error, mut fine_error] = [0.0_f64; 2];
        for _ in 0..10_000 {
            let from = any_place(&mut random);
            coarse_error = coarse_error.max((coarse.at(&from).0 - function(&from)).norm());
            fine_error = fine_error.max((fine.at(&from).0 - function(&from)).norm());
        }
        let ratio = coarse_error / fine_error;
        assert!((24.0..40.0).contains(&ratio), "{coarse_error} / {fine_error}");
    }

    #[test]
    fn outside_the_rectangle_it_continues_linearly() {
        let map = map::<4>(|from| {
            Vector2::new(from.x.powi(4) * from.y, from.y.powi(4) - from.x * from.y)
        });
        let border = Vector2::new(2.0, -2.8);
        let (value, jacobian) = map.at(&(border - Vector2::new(1e-9, 0.0)));
        for beyond in [1e-9, 0.1, 1.0, 1e6, 1e100] {
            let (far, far_jacobian) = map.at(&(border + Vector2::new(beyond, 0.0)));
            let continued = value + jacobian.column(0) * beyond;
            assert!((far - continued).norm() < 1e-4 * (1.0 + beyond), "{beyond}: {far}");
            assert!((far_jacobian - jacobian).norm() < 1e-3, "{beyond}: {far_jacobian}");
        }
        // Beyond a corner too.
        let (corner, by_corner) = map.at(&Vector2::new(1.0, -3.0));
        let (far, _) = map.at(&Vector2::new(-1.0, -7.0));
        assert!((far - (corner + by_corner * Vector2::new(-2.0, -4.0))).norm() < 1e-2, "{far}");
    }

    #[test]
    fn what_is_not_a_number_stays_so() {
        let map = map::<4>(|from| *from);
        assert!(map.at(&Vector2::new(f64::NAN, -2.8)).0.x.is_nan());
        assert!(map.at(&Vector2::new(1.5, f64::NAN)).0.y.is_nan());
    }
}
