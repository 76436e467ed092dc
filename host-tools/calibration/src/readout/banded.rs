//! Symmetric systems whose entries lie near the diagonal.

use nalgebra::DVector;

/// A symmetric positive definite matrix, of which the band below the diagonal is kept.
pub struct Banded {
    size: usize,
    /// The number of diagonals below the main one.
    below: usize,
    /// Row by row: `below` entries left of the diagonal, and the diagonal.
    rows: Vec<f64>,
}

impl Banded {
    pub fn zeros(size: usize, below: usize) -> Self {
        Self { size, below, rows: vec![0.0; size * (below + 1)] }
    }

    fn place(&self, row: usize, column: usize) -> usize {
        debug_assert!(column <= row && row - column <= self.below);
        row * (self.below + 1) + self.below - (row - column)
    }

    /// Adds to an entry on or below the diagonal.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let place = self.place(row, column);
        self.rows[place] += value;
    }

    /// Replaces the matrix A by its Cholesky factor L, A = L L^T; `None` when A is not positive
    /// definite. Costs size * below^2 operations.
    pub fn factored(mut self) -> Option<Factor> {
        for row in 0..self.size {
            let first = row.saturating_sub(self.below);
            for column in first..=row {
                let begin = first.max(column.saturating_sub(self.below));
                let left = &self.rows[self.place(row, begin)..self.place(row, column)];
                let right = &self.rows[self.place(column, begin)..self.place(column, column)];
                let product: f64 = left.iter().zip(right).map(|(a, b)| a * b).sum();
                let place = self.place(row, column);
                let rest = self.rows[place] - product;
                self.rows[place] = if column < row {
                    rest / self.rows[self.place(column, column)]
                } else if rest > 0.0 {
                    rest.sqrt()
                } else {
                    return None;
                };
            }
        }
        Some(Factor(self))
    }
}

/// The Cholesky factor of a [`Banded`].
pub struct Factor(Banded);

impl Factor {
    /// Solves A x = right.
    pub fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        let Self(factor) = self;
        let mut solution = right.clone();
        for row in 0..factor.size {
            for column in row.saturating_sub(factor.below)..row {
                solution[row] -= factor.rows[factor.place(row, column)] * solution[column];
            }
            solution[row] /= factor.rows[factor.place(row, row)];
        }
        for row in (0..factor.size).rev() {
            solution[row] /= factor.rows[factor.place(row, row)];
            for column in row.saturating_sub(factor.below)..row {
                solution[column] -= factor.rows[factor.place(row, column)] * solution[row];
            }
        }
        solution
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;

    #[test]
    fn a_band_is_solved_as_the_full_matrix_is() {
        let (size, below) = (11, 3);
        let entry = |row: usize, column: usize| match row.abs_diff(column) {
            0 => 9.0 + row as f64,
            apart if apart <= below => ((row * column) as f64).sin() + 1.0 / apart as f64,
            _ => 0.0,
        };
        let mut banded = Banded::zeros(size, below);
        for row in 0..size {
            for column in row.saturating_sub(below)..=row {
                banded.add(row, column, entry(row, column));
            }
        }
        let right = DVector::from_fn(size, |row, _| (row as f64 - 4.0).cos());
        let full = DMatrix::from_fn(size, size, entry).cholesky().unwrap().solve(&right);
        let found = banded.factored().unwrap().solve(&right);
        assert!((found - full).norm() < 1e-13);
    }

    #[test]
    fn an_indefinite_matrix_has_no_factor() {
        let mut banded = Banded::zeros(2, 1);
        for (row, column, value) in [(0, 0, 1.0), (1, 0, 2.0), (1, 1, 3.0)] {
            banded.add(row, column, value);
        }
        assert!(banded.factored().is_none());
    }
}
