//! Repeated-measures analysis of variance with all factors within subjects.
//!
//! Let Y be the subjects' values on the orthonormal contrasts of an effect (n x d). The effect's
//! sum of squares is n |mean Y|^2, that of its error is the sum of squares of Y about its mean, and
//! the covariance M of Y's columns shows how far the error is from spherical. A subject's overall
//! level does not enter Y, so nothing large is subtracted.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::Serialize;

use super::within::WithinDesign;
use super::{SINGULAR, Undefined, centred, distributions, rounding, sum_of_squares};

/// The table of an analysis of variance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Anova {
    /// Number of subjects.
    pub subjects: usize,
    /// Sum of squares of the subjects' means.
    pub subjects_sum_of_squares: f64,
    /// Main effects and interactions: A, B, A:B.
    pub effects: Vec<AnovaEffect>,
}

/// One effect with its own error, its interaction with the subjects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnovaEffect {
    /// Its factors' names, with a colon between them.
    pub effect: String,
    /// Sum of squares.
    pub sum_of_squares: f64,
    /// Degrees of freedom.
    pub df: usize,
    /// Sum of squares of the error.
    pub error_sum_of_squares: f64,
    /// Degrees of freedom of the error.
    pub error_df: usize,
    /// The test; `None` where the error is mere rounding.
    pub test: Option<AnovaTest>,
}

/// The F test of an effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnovaTest {
    /// The ratio of the mean squares.
    pub f: f64,
    /// The p value if the error is spherical.
    pub p: f64,
    /// Generalised eta squared, the effect's share of all variance including that between subjects:
    /// SS / (SS + SS of subjects + SS of all errors); comparable between designs (Olejnik & Algina
    /// 2003, Bakeman 2005).
    pub generalized_eta_squared: f64,
    /// SS / (SS + SS of its error).
    pub partial_eta_squared: f64,
    /// `None` with one degree of freedom, where the error is always spherical.
    pub sphericity: Option<Sphericity>,
}

/// How far the error is from spherical, and p corrected for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sphericity {
    /// `None` when the covariance is singular because there are too few subjects.
    pub mauchly: Option<Mauchly>,
    /// Greenhouse & Geisser (1959): tr(M)^2 / (d tr(M^2)), from 1/d to 1.
    pub greenhouse_geisser: Corrected,
    /// Huynh & Feldt (1976): (n d e - 2) / (d (n - 1 - d e)), where e is the Greenhouse-Geisser
    /// epsilon; at most 1. `None` where n - 1 <= d e, for which it is not defined.
    pub huynh_feldt: Option<Corrected>,
}

/// The F test with both degrees of freedom multiplied by epsilon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Corrected {
    /// 1 for a spherical error.
    pub epsilon: f64,
    /// The p value.
    pub p: f64,
}

/// Mauchly's test (1940) of whether the error is spherical.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mauchly {
    /// det M / (tr M / d)^d, from 0 to 1; 1 for a spherical error.
    pub w: f64,
    /// Bartlett's approximation, -(n - 1) (1 - (2 d^2 + d + 2) / (6 d (n - 1))) ln W.
    pub chi_squared: f64,
    /// Its degrees of freedom, d (d + 1) / 2 - 1.
    pub df: usize,
    /// From the chi-squared distribution with Box's second term (Anderson 2003, section 10.7).
    /// Where that term has 3 d, this uses 3 times the number of cells in the design, as do R's
    /// `mauchly.test` and `car` and the table of pingouin's `rm_anova`, so that p is the one they
    /// print.
    pub p: f64,
}

/// Analyses a complete table.
///
/// # Errors
/// With fewer than two subjects, or a factor of one level.
pub fn anova(design: &WithinDesign) -> Result<Anova, Undefined> {
    super::checked_factors(design)?;
    let (subjects, cells) = design.values().shape();
    let (_, deviations) = centred(design.values().as_slice());
    let deviations = DMatrix::from_vec(subjects, cells, deviations);
    let subjects_sum_of_squares = cells as f64 * deviations.column_mean().norm_squared();

    let parts: Vec<(String, Part)> = design
        .effects()
        .into_iter()
        .map(|effect| {
            let scores = &deviations * design.contrasts(&effect).transpose();
            (effect.name, Part::new(scores))
        })
        .collect();
    let errors: f64 = parts.iter().map(|(_, part)| part.error_sum_of_squares()).sum();
    let total_error = subjects_sum_of_squares + errors;
    let negligible = (subjects * cells) as f64 * rounding(design.values().iter().copied()).powi(2);

    let effects = parts.into_iter().map(|(effect, part)| AnovaEffect {
        effect,
        sum_of_squares: part.sum_of_squares(),
        df: part.df(),
        error_sum_of_squares: part.error_sum_of_squares(),
        error_df: part.error_df(),
        test: (part.error_sum_of_squares() > negligible).then(|| part.test(total_error, cells)),
    });
    Ok(Anova { subjects, subjects_sum_of_squares, effects: effects.collect() })
}

/// The residuals of the additive model: value - cell mean - subject mean + grand mean. The analysis
/// assumes that they are normal; [`shapiro_wilk`](super::shapiro_wilk) tests that.
#[must_use]
pub fn residuals(design: &WithinDesign) -> Vec<f64> {
    let (_, deviations) = centred(design.values().as_slice());
    let mut rest = DMatrix::from_vec(design.subjects().len(), design.values().ncols(), deviations);
    for mut cell in rest.column_iter_mut() {
        let mean = cell.mean();
        cell.add_scalar_mut(-mean);
    }
    for mut person in rest.row_iter_mut() {
        let mean = person.mean();
        person.add_scalar_mut(-mean);
    }
    rest.as_slice().to_vec()
}

/// A summary of the subjects' values on the contrasts of one effect.
struct Part {
    subjects: usize,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Part {
    fn new(mut scores: DMatrix<f64>) -> Self {
        let subjects = scores.nrows();
        let mean = scores.row_mean().transpose();
        for mut person in scores.row_iter_mut() {
            person -= mean.transpose();
        }
        let covariance = scores.transpose() * scores / (subjects - 1) as f64;
        Self { subjects, mean, covariance }
    }

    fn df(&self) -> usize {
        self.mean.len()
    }

    fn error_df(&self) -> usize {
        self.df() * (self.subjects - 1)
    }

    fn sum_of_squares(&self) -> f64 {
        self.subjects as f64 * self.mean.norm_squared()
    }

    fn error_sum_of_squares(&self) -> f64 {
        (self.subjects - 1) as f64 * self.covariance.trace()
    }

    /// `total_error`: the sum of squares of the subjects and of all errors.
    fn test(&self, total_error: f64, cells: usize) -> AnovaTest {
        let (effect, error) = (self.sum_of_squares(), self.error_sum_of_squares());
        let (df, error_df) = (self.df() as f64, self.error_df() as f64);
        let f = effect / df / (error / error_df);
        let corrected = |epsilon: f64| Corrected {
            epsilon,
            p: distributions::f_upper(f, epsilon * df, epsilon * error_df),
        };
        AnovaTest {
            f,
            p: corrected(1.0).p,
            generalized_eta_squared: effect / (effect + total_error),
            partial_eta_squared: effect / (effect + error),
            sphericity: (self.df() > 1).then(|| {
                let greenhouse_geisser = self.covariance.trace().powi(2)
                    / (df * sum_of_squares(self.covariance.as_slice()));
                Sphericity {
                    mauchly: self.mauchly(cells),
                    greenhouse_geisser: corrected(greenhouse_geisser.min(1.0)),
                    huynh_feldt: self.huynh_feldt(greenhouse_geisser).map(corrected),
                }
            }),
        }
    }

    fn huynh_feldt(&self, greenhouse_geisser: f64) -> Option<f64> {
        let (n, used) = (self.subjects as f64, self.df() as f64 * greenhouse_geisser);
        let left = n - 1.0 - used;
        // n - 1 = d e up to rounding, which is always so with two subjects.
        (left > SINGULAR).then(|| ((n * used - 2.0) / (self.df() as f64 * left)).min(1.0))
    }

    fn mauchly(&self, cells: usize) -> Option<Mauchly> {
        let eigenvalues = SymmetricEigen::new(self.covariance.clone()).eigenvalues;
        if eigenvalues.min() <= SINGULAR * eigenvalues.max() {
            return None;
        }
        let (n, d, cells) = ((self.subjects - 1) as f64, self.df() as f64, cells as f64);
        let log_w: f64 = eigenvalues.iter().map(|it| (it / eigenvalues.mean()).ln()).sum();
        let rho = 1.0 - (2.0 * d * d + d + 2.0) / (6.0 * d * n);
        let chi_squared = -n * rho * log_w;
        let df = d * (d + 1.0) / 2.0 - 1.0;
        let second_term =
            (d + 2.0) * (d - 1.0) * (d - 2.0) * (2.0 * d.powi(3) + 6.0 * d * d + 3.0 * cells + 2.0)
                / (288.0 * (n * d * rho).powi(2));
        let first = distributions::chi_squared_upper(chi_squared, df);
        let second = distributions::chi_squared_upper(chi_squared, df + 4.0);
        let p = (first + second_term * (second - first)).min(1.0);
        Some(Mauchly { w: log_w.exp(), chi_squared, df: df as usize, p })
    }
}

#[cfg(test)]
mod tests {
    use super::super::paired::{Family, paired_t};
    use super::super::testing::{LEVELS, table};
    use super::*;

    /// Irregular numbers from 0 to 1.
    fn scattered(row: usize, column: usize) -> f64 {
        ((13.0 * row as f64 + 78.2 * column as f64).sin() * 43_758.5).rem_euclid(1.0)
    }

    fn error_of(it: &Anova) -> f64 {
        it.effects.iter().map(|effect| effect.error_sum_of_squares).sum()
    }

    #[test]
    fn of_two_levels_f_is_the_square_of_t() {
        let table = table(&[2], 6, |subject, cell| scattered(subject, cell) + cell as f64);
        let it = anova(&table).unwrap();
        let family = Family { name: "one".to_owned(), tests: 1 };
        let t = paired_t(table.cell(0), table.cell(1), &family).unwrap();
        let test = it.effects[0].test.as_ref().unwrap();
        assert!((test.f / t.t.powi(2) - 1.0).abs() < 1e-13);
        assert!((test.p / t.p - 1.0).abs() < 1e-12);
        assert_eq!(test.sphericity, None);
    }

    #[test]
    fn the_sums_of_squares_make_up_the_whole_whatever_the_offset() {
        let of = |offset: f64| {
            table(&[2, 3], 7, move |subject, cell| offset + scattered(subject, cell + 1))
        };
        let (plain, far) = (anova(&of(0.0)).unwrap(), anova(&of(1e6)).unwrap());
        let values = of(0.0);
        let total = sum_of_squares(&centred(values.values().as_slice()).1);
        let effects: f64 = plain.effects.iter().map(|effect| effect.sum_of_squares).sum();
        let sum = effects + error_of(&plain) + plain.subjects_sum_of_squares;
        assert!((sum / total - 1.0).abs() < 1e-14);
        assert!((sum_of_squares(&residuals(&values)) / error_of(&plain) - 1.0).abs() < 1e-14);
        for (near, far) in plain.effects.iter().zip(&far.effects) {
            let (near, far) = (near.test.as_ref().unwrap(), far.test.as_ref().unwrap());
            // The rounding of the values themselves at 1e6 is 1e-10.
            assert!((far.f / near.f - 1.0).abs() < 1e-8, "{} {}", far.f, near.f);
        }
    }

    #[test]
    fn a_spherical_error_has_epsilons_of_one() {
        // Each subject departs from the mean along its own contrast, all equally far.
        let table = table(&[3], 4, |subject, cell| {
            let contrasts =
                [[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, -2.0], [-1.0, -1.0, 2.0]];
            let length = if subject < 2 { 2.0_f64 } else { 6.0 }.sqrt();
            10.0 + cell as f64 + contrasts[subject][cell] / length
        });
        let it = anova(&table).unwrap();
        let sphericity = it.effects[0].test.as_ref().unwrap().sphericity.as_ref().unwrap();
        assert!((sphericity.greenhouse_geisser.epsilon - 1.0).abs() < 1e-13);
        let mauchly = sphericity.mauchly.unwrap();
        assert!((mauchly.w - 1.0).abs() < 1e-13 && (mauchly.p - 1.0).abs() < 1e-12);
    }

    #[test]
    fn without_an_error_there_is_no_test() {
        // Decimal fractions, so that the sums are rounded.
        let constant = anova(&table(&[2, 3], 4, |_, _| 0.1)).unwrap();
        assert!(constant.effects.iter().all(|effect| effect.test.is_none()));
        let additive = table(&[2, 3], 4, |subject, cell| {
            1e6 + 0.1 * subject as f64 + [0.3, 0.7, 0.1, 0.2, 0.9, 1.1][cell]
        });
        assert!(anova(&additive).unwrap().effects.iter().all(|effect| effect.test.is_none()));
    }

    #[test]
    fn too_few_subjects_for_a_covariance_leave_sphericity_untested() {
        let sphericity = |subjects: usize| {
            let it = anova(&table(&[5], subjects, scattered)).unwrap();
            it.effects[0].test.as_ref().unwrap().sphericity.clone().unwrap()
        };
        let two = sphericity(2);
        assert_eq!((two.mauchly, two.huynh_feldt), (None, None));
        // One of four directions.
        assert!((two.greenhouse_geisser.epsilon - 0.25).abs() < 1e-14);
        assert_eq!(sphericity(4).mauchly, None);
        assert!(sphericity(4).greenhouse_geisser.epsilon < 0.75);
        assert!(sphericity(5).mauchly.is_some_and(|it| it.w > 0.0 && it.p <= 1.0));
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let one = anova(&table(&[2, 1], 4, scattered));
        assert_eq!(one, Err(Undefined::OneLevel(LEVELS[1].0.to_owned())));
        let alone = anova(&table(&[3], 1, scattered));
        assert_eq!(alone, Err(Undefined::TooFew { found: 1, needed: 2 }));
    }
}
