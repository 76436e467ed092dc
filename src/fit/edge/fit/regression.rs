//! The linear regression of an edge's pixels on its model.
//!
//! The columns are ordered so that the last two of the Cholesky factor of their normal equations
//! are those of shift and turn with the others eliminated: a whitener for [`crate::fit::solve`].

use nalgebra::{Matrix3, SMatrix, SVector};

use crate::fit::edge::light::Levels;

/// Fewest values that an edge is fitted to: five numbers are fitted, and the rest tells the noise.
const VALUES_MIN: f64 = 8.0;

/// Smallest ratio of a pivot to its own column's square: below it, the pixels do not distinguish
/// two of the model's columns.
const PIVOT_RATIO_MIN: f64 = 1e-3;

/// Columns of the regression.
pub(super) const COLUMNS: usize = 5;
pub(super) const STEP: usize = 1;
pub(super) const BLUR: usize = 2;
pub(super) const SLOPE: usize = 3;

/// Weighted inner products of the columns and the pixels, the upper triangle row by row, the
/// pixels last. The column of ones makes the first row sums of the weights and of the weighted columns.
pub(super) const PRODUCTS: usize = (COLUMNS + 1) * (COLUMNS + 2) / 2;
const ONE_ONE: usize = 0;
const ONE_STEP: usize = 1;
const ONE_PIXEL: usize = 5;
const STEP_STEP: usize = 6;
const STEP_PIXEL: usize = 10;
const PIXEL_PIXEL: usize = 20;

pub(super) struct Sums {
    /// The number of values that tell about the noise: samples, each the mean of some pixels, and
    /// levels known beforehand.
    pub(super) count: f64,
    pub(super) products: [f64; PRODUCTS],
    /// Subtracted from all pixels, so that the sums lose no digits.
    pub(super) base: f64,
}

impl Sums {
    /// Adds what is known about both sides, as if it were more pixels: some at the level of the
    /// right side, where E is 1, and some at that of the left one, where it is -1. Whatever their
    /// weight, they count as two pixels in the estimate of the noise.
    pub(super) fn add_levels(&mut self, levels: &Levels, sign: f64) {
        self.count += 2.0;
        let light = (levels.light - self.base, levels.light_weight, sign);
        let dark = (levels.dark - self.base, levels.dark_weight, -sign);
        for (level, weight, step) in [light, dark] {
            self.products[ONE_ONE] += weight;
            self.products[ONE_STEP] += weight * step;
            self.products[ONE_PIXEL] += weight * level;
            self.products[STEP_STEP] += weight;
            self.products[STEP_PIXEL] += weight * step * level;
            self.products[PIXEL_PIXEL] += weight * level * level;
        }
    }
}

/// The result of the regression.
pub(super) struct Regression {
    pub(super) coefficients: [f64; COLUMNS],
    /// Upper triangle of the factor of shift and turn: 00, 01, 11.
    pub(super) factor: [f64; 3],
    /// That factor times their coefficients.
    pub(super) seen: [f64; 2],
    /// Square of the blur's pivot.
    pub(super) blur_pivot: f64,
    pub(super) noise_variance: f64,
}

impl Regression {
    /// `blur_precision` is that of the expected blur, in units of the products: shift and turn are
    /// those for a blur that is known so well, while the blur's own coefficient, from which the
    /// next expectation is made, is the pixels' alone. `None` when the pixels are too few, or do
    /// not distinguish the columns.
    pub(super) fn new(
        &Sums { products: ref sums, count, .. }: &Sums,
        blur_precision: f64,
    ) -> Option<Self> {
        let mut normal = SMatrix::<f64, COLUMNS, COLUMNS>::zeros();
        let mut right = SVector::<f64, COLUMNS>::zeros();
        let mut index = 0;
        for row in 0..COLUMNS {
            for column in row..COLUMNS {
                normal[(row, column)] = sums[index];
                normal[(column, row)] = sums[index];
                index += 1;
            }
            right[row] = sums[index];
            index += 1;
        }
        let squares = sums[index];
        if count < VALUES_MIN {
            return None;
        }
        let factor = normal.cholesky()?.unpack();
        for column in 0..COLUMNS {
            let pivot = factor[(column, column)] * factor[(column, column)];
            if pivot < PIVOT_RATIO_MIN * normal[(column, column)] {
                return None;
            }
        }
        let whitened = factor.solve_lower_triangular(&right)?;
        let coefficients = factor.tr_solve_lower_triangular(&whitened)?;
        let residual = (squares - whitened.norm_squared()).max(0.0);
        let last = |matrix: &SMatrix<f64, COLUMNS, COLUMNS>| {
            Matrix3::from_fn(|row, column| matrix[(BLUR + row, BLUR + column)])
        };
        let last_factor = last(&factor).lower_triangle();
        let mut known = last_factor * last_factor.transpose();
        known[(0, 0)] += blur_precision;
        let known_factor = known.cholesky()?.unpack();
        let seen =
            known_factor.solve_lower_triangular(&(last_factor * whitened.fixed_rows::<3>(BLUR)))?;
        Some(Self {
            coefficients: coefficients.into(),
            factor: [known_factor[(1, 1)], known_factor[(2, 1)], known_factor[(2, 2)]],
            seen: [seen[1], seen[2]],
            blur_pivot: factor[(BLUR, BLUR)] * factor[(BLUR, BLUR)],
            noise_variance: residual / (count - COLUMNS as f64),
        })
    }
}
