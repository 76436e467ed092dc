//! The linear regression of an edge's pixels on its model.
//!
//! Its normal equations are solved by elimination. The columns of shift ([`SLOPE`]) and turn come
//! last, so that what the elimination of the others leaves of them is a whitener for
//! [`crate::fit::solve`].

use crate::fit::edge::light::Levels;

/// Fewest values that an edge is fitted to: five numbers are fitted, and the rest tells the noise.
const VALUES_MIN: f64 = 8.0;

/// Smallest ratio of a pivot to its own column's square: below it, the pixels do not distinguish
/// two of the model's columns.
const PIVOT_RATIO_MIN: f64 = 1e-3;

/// Columns of the regression.
pub(super) const COLUMNS: usize = 5;
const ONE: usize = 0;
pub(super) const STEP: usize = 1;
pub(super) const BLUR: usize = 2;
pub(super) const SLOPE: usize = 3;
const TURN: usize = 4;
/// After the columns.
const PIXEL: usize = COLUMNS;

/// Weighted inner products of the columns and the pixels, the upper triangle row by row, the
/// pixels last. The column of ones makes the first row sums of the weights and of the weighted columns.
pub(super) const PRODUCTS: usize = (COLUMNS + 1) * (COLUMNS + 2) / 2;
const ONE_ONE: usize = place(ONE, ONE);
const ONE_STEP: usize = place(ONE, STEP);
const ONE_PIXEL: usize = place(ONE, PIXEL);
const STEP_STEP: usize = place(STEP, STEP);
const STEP_PIXEL: usize = place(STEP, PIXEL);
const PIXEL_PIXEL: usize = place(PIXEL, PIXEL);

/// Index of the product of two columns among the products; `row` is at most `column`.
const fn place(row: usize, column: usize) -> usize {
    row * (2 * COLUMNS + 1 - row) / 2 + column
}

#[derive(Default)]
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
        let light = (levels.light - self.base, levels.certainty.light_weight, sign);
        let dark = (levels.dark - self.base, levels.certainty.dark_weight, -sign);
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
    /// The blur's pivot: what the pixels alone tell of it, beyond offset and contrast.
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
        if count < VALUES_MIN {
            return None;
        }
        let pivots_min = [ONE, STEP, BLUR, SLOPE, TURN]
            .map(|column| PIVOT_RATIO_MIN * sums[place(column, column)]);
        let mut free = Elimination { sums: *sums, pivots_min };
        free.eliminate::<ONE>()?;
        free.eliminate::<STEP>()?;
        let mut known = free;
        known.sums[place(BLUR, BLUR)] += blur_precision;
        for blur in [&mut free, &mut known] {
            blur.eliminate::<BLUR>()?;
            blur.eliminate::<SLOPE>()?;
            blur.eliminate::<TURN>()?;
        }
        let [slope_root, turn_root] =
            [SLOPE, TURN].map(|column| libm::sqrt(known.sums[place(column, column)]));
        Some(Self {
            coefficients: free.coefficients(),
            factor: [slope_root, slope_root * known.sums[place(SLOPE, TURN)], turn_root],
            seen: [
                slope_root * known.sums[place(SLOPE, PIXEL)],
                turn_root * known.sums[place(TURN, PIXEL)],
            ],
            blur_pivot: free.sums[place(BLUR, BLUR)],
            noise_variance: free.sums[PIXEL_PIXEL].max(0.0) / (count - COLUMNS as f64),
        })
    }
}

/// The normal equations while one column after the other is eliminated.
///
/// The rows of the columns that have been eliminated hold the factors of N = U^T D U: the pivot, which
/// is an element of D, and beside it a row of U, which says how much of the column the later ones
/// contain.
#[derive(Clone, Copy)]
struct Elimination {
    sums: [f64; PRODUCTS],
    /// Smallest usable pivot of each column.
    pivots_min: [f64; COLUMNS],
}

impl Elimination {
    /// Eliminates the next column; `None` when the pixels do not distinguish it from those before
    /// it. The column is a constant, so that the compiler unrolls the loops.
    #[inline(always)]
    fn eliminate<const COLUMN: usize>(&mut self) -> Option<()> {
        let pivot = self.sums[place(COLUMN, COLUMN)];
        // A column of zeros is not usable, nor one with a NaN.
        let is_usable = pivot > 0.0 && pivot >= self.pivots_min[COLUMN];
        if !is_usable {
            return None;
        }
        let per_pivot = 1.0 / pivot;
        for row in COLUMN + 1..PIXEL + 1 {
            let share = self.sums[place(COLUMN, row)] * per_pivot;
            for column in row..PIXEL + 1 {
                self.sums[place(row, column)] -= share * self.sums[place(COLUMN, column)];
            }
            self.sums[place(COLUMN, row)] = share;
        }
        Some(())
    }

    /// How much of each column the pixels contain, after all have been eliminated.
    fn coefficients(&self) -> [f64; COLUMNS] {
        let mut coefficients = [0.0; COLUMNS];
        for row in (0..COLUMNS).rev() {
            coefficients[row] = self.sums[place(row, PIXEL)];
            for column in row + 1..COLUMNS {
                coefficients[row] -= self.sums[place(row, column)] * coefficients[column];
            }
        }
        coefficients
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::fit::edge::light::Light;
    use crate::fit::edge::rendered::{Scene, image};
    use crate::test_support::Random;

    /// Adds the products of a row of the columns and its pixel, of this weight.
    fn add(sums: &mut Sums, row: &[f64; COLUMNS + 1], weight: f64) {
        for first in 0..=PIXEL {
            for second in first..=PIXEL {
                sums.products[place(first, second)] += weight * row[first] * row[second];
            }
        }
    }

    /// Rows of ones and random numbers, of which the pixels contain this much each.
    fn rows(coefficients: &[f64; COLUMNS], random: &mut Random) -> [[f64; COLUMNS + 1]; 20] {
        core::array::from_fn(|_| {
            let mut row = core::array::from_fn(|_| random.uniform(-1.0, 1.0));
            row[ONE] = 1.0;
            row[PIXEL] = (0..COLUMNS).map(|column| coefficients[column] * row[column]).sum();
            row
        })
    }

    fn sums_of(rows: &[[f64; COLUMNS + 1]]) -> Sums {
        let mut sums = Sums { count: rows.len() as f64, ..Sums::default() };
        for row in rows {
            add(&mut sums, row, 1.0);
        }
        sums
    }

    #[test]
    fn what_the_pixels_contain_of_each_column_is_found() {
        let mut random = Random::new(34);
        for _ in 0..20 {
            let coefficients = core::array::from_fn(|_| random.uniform(-3.0, 3.0));
            let sums = sums_of(&rows(&coefficients, &mut random));
            let found = Regression::new(&sums, 0.0).unwrap();
            for (found, expected) in found.coefficients.iter().zip(coefficients) {
                // Rounding, times the condition of a matrix of random numbers.
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
            // The whitener has the same root: it is a turn of which none is left.
            let [shift, both, turn] = found.factor;
            let [.., slope, turned] = coefficients;
            assert!((shift * slope + both * turned - found.seen[0]).abs() < 1e-11);
            assert!((turn * turned - found.seen[1]).abs() < 1e-11);
        }
    }

    #[test]
    fn columns_that_the_pixels_do_not_distinguish_have_no_result() {
        let mut random = Random::new(35);
        let independent = rows(&[1.0; COLUMNS], &mut random);
        assert!(Regression::new(&sums_of(&independent), 0.0).is_some());
        for column in 1..COLUMNS {
            let absent = independent.map(|mut row| {
                row[column] = 0.0;
                row
            });
            assert!(Regression::new(&sums_of(&absent), 0.0).is_none(), "{column}");
            // The sum of those before it and 1 % of its own: a ten-thousandth of its square.
            let near = independent.map(|mut row| {
                row[column] = row[..column].iter().sum::<f64>() + 0.01 * row[column];
                row
            });
            assert!(Regression::new(&sums_of(&near), 0.0).is_none(), "{column}");
        }
    }

    #[test]
    fn levels_that_are_known_count_as_pixels_on_either_side() {
        let scene = Scene::new(21.0, 0.0, 0.0);
        let pixels = scene.render().sampled(0.01, &mut Random::new(36));
        let nodes = scene.nodes(&scene.cam_from_target);
        let light = Light::measure(&image(&pixels), &nodes, true, scene.blur_px()).unwrap();
        let edge = nodes.edges(true).next().unwrap();
        let mut levels = light.beside(&nodes, &edge, &Vector2::new(100.0, 80.0)).unwrap();
        (levels.light, levels.dark) = (8.0, 4.0);
        (levels.certainty.light_weight, levels.certainty.dark_weight) = (5.0, 3.0);
        for sign in [1.0, -1.0] {
            let mut random = Random::new(37);
            let found_rows = rows(&[1.0, 2.0, 3.0, 4.0, 5.0], &mut random);
            let (mut found, mut expected) = (sums_of(&found_rows), sums_of(&found_rows));
            (found.base, expected.base) = (1.0, 1.0);
            found.add_levels(&levels, sign);
            // E is 1 on the right and -1 on the left; the light side is right where the sign is 1.
            add(&mut expected, &[1.0, sign, 0.0, 0.0, 0.0, 8.0 - 1.0], 5.0);
            add(&mut expected, &[1.0, -sign, 0.0, 0.0, 0.0, 4.0 - 1.0], 3.0);
            assert_eq!(found.count, 22.0);
            for (found, expected) in found.products.iter().zip(expected.products) {
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
        }
    }
}
