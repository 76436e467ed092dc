//! Means with their errors, medians, and standardised differences between means.

use nalgebra::DMatrix;
use serde::Serialize;

use super::within::WithinDesign;
use super::{Undefined, centred, checked, checked_pairs, distributions, rounding, sum_of_squares};

/// A sample summarised by its mean and spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Description {
    /// Number of values.
    pub n: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation, with n - 1.
    pub sd: f64,
    /// The standard error of the mean, sd / sqrt(n).
    pub sem: f64,
    /// Student's 95 % confidence interval of the mean.
    pub mean_ci95: [f64; 2],
}

impl Description {
    /// The description of two or more values.
    ///
    /// # Errors
    /// With fewer values, or when one is not finite.
    pub fn new(values: &[f64]) -> Result<Self, Undefined> {
        checked(values, 2)?;
        let (mean, deviations) = centred(values);
        let variance = sum_of_squares(&deviations) / (values.len() - 1) as f64;
        Ok(Self::with(values.len(), mean, variance.sqrt()))
    }

    fn with(n: usize, mean: f64, sd: f64) -> Self {
        let sem = sd / (n as f64).sqrt();
        let reach = distributions::t_quantile(0.975, (n - 1) as f64) * sem;
        Self { n, mean, sd, sem, mean_ci95: [mean - reach, mean + reach] }
    }
}

/// The median; of an even number of values the upper of the two in the middle, so that it is always
/// one of the values. `None` if there are no values.
#[must_use]
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The table without the differences between subjects: each value minus its subject's mean plus the
/// grand mean (Cousineau 2005). One row per subject, one column per cell.
#[must_use]
pub fn normalised(design: &WithinDesign) -> DMatrix<f64> {
    let mut values = design.values().clone();
    let (grand_mean, _) = centred(values.as_slice());
    for mut person in values.row_iter_mut() {
        let (mean, _) = centred(&person.iter().copied().collect::<Vec<_>>());
        person.add_scalar_mut(-mean);
    }
    values.add_scalar(grand_mean)
}

/// Each cell of a within-subject table by its mean and the spread of its normalised values, with
/// the variance times C / (C - 1) to make up for the degree of freedom that the normalisation takes
/// from C cells (Morey 2008). With two cells both have the same error.
///
/// # Errors
/// With fewer than two subjects or two cells.
pub fn cousineau_morey(design: &WithinDesign) -> Result<Vec<Description>, Undefined> {
    let normalised = normalised(design);
    let cells = normalised.ncols();
    if cells < 2 {
        return Err(Undefined::TooFew { found: cells, needed: 2 });
    }
    let correction = (cells as f64 / (cells - 1) as f64).sqrt();
    let describe = |cell: &[f64]| {
        let it = Description::new(cell)?;
        Ok(Description::with(it.n, it.mean, it.sd * correction))
    };
    normalised.as_slice().chunks(normalised.nrows()).map(describe).collect()
}

/// Cohen's d from one mean to another, in units of the average spread sqrt((sd1^2 + sd2^2) / 2):
/// d_av (Cumming 2012) on raw values. On the values of [`cousineau_morey`] over all cells of a
/// measure it is the d of the paper's Table II. Positive where `to` is larger.
///
/// # Errors
/// When neither sample has any spread.
pub fn cohens_d(from: &Description, to: &Description) -> Result<f64, Undefined> {
    let spread = (0.5 * (from.sd * from.sd + to.sd * to.sd)).sqrt();
    if spread <= rounding([from.mean, to.mean]) {
        return Err(Undefined::NoSpread);
    }
    Ok((to.mean - from.mean) / spread)
}

/// Cohen's d of paired values in units of the spread of the differences: d_z = mean / sd of `to -
/// from`, which is t / sqrt(n). It grows with the correlation between the two, so it is not
/// comparable with [`cohens_d`].
///
/// # Errors
/// With fewer than two pairs, values that are not finite, or differences that are all the same.
pub fn cohens_d_z(from: &[f64], to: &[f64]) -> Result<f64, Undefined> {
    let differences = differences(from, to)?;
    Ok(differences.mean / differences.sd)
}

/// The differences `to - from` of pairs, if they have any spread.
pub(super) fn differences(from: &[f64], to: &[f64]) -> Result<Description, Undefined> {
    checked_pairs(from, to, 2)?;
    let differences: Vec<f64> = from.iter().zip(to).map(|(from, to)| to - from).collect();
    let description = Description::new(&differences)?;
    if description.sd <= rounding(from.iter().chain(to).copied()) {
        return Err(Undefined::NoSpread);
    }
    Ok(description)
}

#[cfg(test)]
mod tests {
    use super::super::testing::table;
    use super::*;

    fn one_factor(columns: &[&[f64]]) -> WithinDesign {
        table(&[columns.len()], columns[0].len(), |subject, cell| columns[cell][subject])
    }

    #[test]
    fn the_median_is_one_of_the_values() {
        assert_eq!(median([]), None);
        assert_eq!(median([3.0]), Some(3.0));
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([3.0, 1.0, 2.0, 4.0]), Some(3.0));
    }

    #[test]
    fn a_sample_is_described_whatever_its_offset() {
        // 2, 4, 4, 4, 5, 5, 7, 9: mean 5, sum of squares 32.
        for offset in [0.0, 1e9] {
            let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0].map(|it| it + offset);
            let it = Description::new(&values).unwrap();
            assert_eq!((it.n, it.mean), (8, 5.0 + offset));
            assert_eq!(it.sd, (32.0_f64 / 7.0).sqrt());
            assert_eq!(it.sem, it.sd / 8.0_f64.sqrt());
        }
    }

    #[test]
    fn with_two_cells_the_normalised_error_is_that_of_the_difference() {
        // Morey (2008): sd(difference) / sqrt(2 n) for both, whatever their own spreads are.
        let (first, second) = ([3.1, 5.0, 9.4, 2.2], [4.0, 5.5, 14.0, 2.0]);
        let cells = cousineau_morey(&one_factor(&[&first, &second])).unwrap();
        let difference = differences(&first, &second).unwrap();
        for cell in &cells {
            assert!((cell.sem / (difference.sd / 8.0_f64.sqrt()) - 1.0).abs() < 1e-14);
        }
        let (first, second) =
            (Description::new(&first).unwrap(), Description::new(&second).unwrap());
        assert!((cells[0].mean - first.mean).abs() < 1e-14);
        assert!((cells[1].mean - second.mean).abs() < 1e-14);
    }

    #[test]
    fn what_has_no_spread_has_no_standardised_difference() {
        assert_eq!(Description::new(&[1.0]), Err(Undefined::TooFew { found: 1, needed: 2 }));
        assert_eq!(Description::new(&[1.0, f64::NAN]), Err(Undefined::NotFinite(1)));
        let constant = Description::new(&[0.1; 7]).unwrap();
        assert_eq!((constant.mean, constant.sd), (0.1, 0.0));
        assert_eq!(cohens_d(&constant, &constant), Err(Undefined::NoSpread));
        // Each is 0.1 larger, but in binary no two of these differences are equal.
        let values = [0.1, 0.2, 0.3, 0.7];
        assert_eq!(cohens_d_z(&values, &values.map(|it| it + 0.1)), Err(Undefined::NoSpread));
        assert_eq!(cohens_d_z(&values, &values[1..]), Err(Undefined::Lengths(4, 3)));
        let one_cell = one_factor(&[&values]);
        assert_eq!(cousineau_morey(&one_cell), Err(Undefined::TooFew { found: 1, needed: 2 }));
    }
}
