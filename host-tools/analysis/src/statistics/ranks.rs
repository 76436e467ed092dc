//! Non-parametric analysis of variance: relative treatment effects by ranks (Brunner, Domhof &
//! Langer 2002, designs LD-F1 and LD-F2; the statistics of the R package nparLD, Noguchi et al.
//! 2012).
//!
//! All N = subjects x cells values are ranked together; ties get their mean rank. With p the
//! relative effects of the cells, V the covariance of sqrt(n) p and C the orthonormal contrasts of
//! an effect, both statistics compare z = C p with S = C V C'.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{DMatrix, SymmetricEigen};
use serde::Serialize;

use super::within::{Factor, WithinDesign};
use super::{SINGULAR, Undefined, distributions, rounding};

/// The result of a rank analysis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RankAnalysis {
    /// Number of subjects.
    pub subjects: usize,
    /// The effects of the cells and, with several factors, of the levels of each factor.
    pub relative_effects: Vec<RelativeEffect>,
    /// Main effects and interactions: A, B, A:B.
    pub effects: Vec<RankEffect>,
}

/// How the values at some levels rank among all values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RelativeEffect {
    /// The levels, with their factors.
    pub levels: Vec<FactorLevel>,
    /// Number of values.
    pub observations: usize,
    /// Their mean rank, from 1 to N.
    pub mean_rank: f64,
    /// (mean rank - 1/2) / N, from 0 to 1: the probability that a value drawn from all values is
    /// smaller than one drawn from these, counting half of the ties.
    pub relative_treatment_effect: f64,
}

/// A factor and one of its levels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FactorLevel {
    /// The factor's name.
    pub factor: String,
    /// The name of the level.
    pub level: String,
}

/// The tests of one effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RankEffect {
    /// Its factors' names, with a colon between them.
    pub effect: String,
    /// ANOVA-type: n |z|^2 / tr S with tr(S)^2 / tr(S^2) degrees of freedom, and infinitely many in
    /// the denominator (Box's approximation). The one to report for few subjects. `None` where the
    /// ranks of all subjects differ in the same way.
    pub anova_type: Option<RankTest>,
    /// Wald-type: n z' S^-1 z, chi-squared with one degree of freedom per contrast. Far too liberal
    /// unless there are many more subjects than cells. `None` where S is singular.
    pub wald_type: Option<RankTest>,
}

/// One test statistic.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RankTest {
    /// Its value.
    pub statistic: f64,
    /// Its degrees of freedom.
    pub df: f64,
    /// Its p value.
    pub p: f64,
}

/// Analyses a complete table.
///
/// # Errors
/// With fewer than two subjects, or a factor of one level.
pub fn rank_analysis(design: &WithinDesign) -> Result<RankAnalysis, Undefined> {
    super::checked_factors(design)?;
    let (subjects, cells) = design.values().shape();
    let ranks = mid_ranks(design.values().as_slice());
    let ranks = DMatrix::from_vec(subjects, cells, ranks);
    let test = |effect| {
        let contrasts = design.contrasts(&effect);
        let (anova_type, wald_type) = tests(&ranks, &contrasts);
        RankEffect { effect: effect.name, anova_type, wald_type }
    };
    Ok(RankAnalysis {
        subjects,
        relative_effects: relative_effects(design, &ranks),
        effects: design.effects().into_iter().map(test).collect(),
    })
}

/// The ANOVA-type statistic of two paired columns: one factor with two levels.
///
/// # Errors
/// With fewer than two pairs, values that are not finite, or ranks that differ alike in all pairs.
pub fn rank_comparison(from: &[f64], to: &[f64]) -> Result<RankTest, Undefined> {
    super::checked_pairs(from, to, 2)?;
    let ranks = DMatrix::from_vec(from.len(), 2, mid_ranks(&[from, to].concat()));
    let contrast = DMatrix::from_row_slice(1, 2, &[-FRAC_1_SQRT_2, FRAC_1_SQRT_2]);
    tests(&ranks, &contrast).0.ok_or(Undefined::EqualRanks)
}

/// The rank of each value among all, starting at 1; equal values share the mean of their ranks.
fn mid_ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&left, &right| values[left].total_cmp(&values[right]));
    let mut ranks = vec![0.0; values.len()];
    let mut below = 0;
    // `total_cmp` would order -0 before 0.
    for ties in order.chunk_by(|&left, &right| values[left] == values[right]) {
        for &index in ties {
            ranks[index] = below as f64 + (ties.len() + 1) as f64 / 2.0;
        }
        below += ties.len();
    }
    ranks
}

/// Both statistics of the effect with these contrasts, computed from ranks instead of relative
/// effects: N cancels.
fn tests(ranks: &DMatrix<f64>, contrasts: &DMatrix<f64>) -> (Option<RankTest>, Option<RankTest>) {
    let n = ranks.nrows() as f64;
    let mut scores = ranks * contrasts.transpose();
    let mean = scores.row_mean();
    for mut person in scores.row_iter_mut() {
        person -= &mean;
    }
    let covariance = scores.transpose() * &scores / (n - 1.0);
    let trace = covariance.trace();
    // Ranks are multiples of one half.
    if trace <= rounding([ranks.len() as f64]).powi(2) {
        return (None, None);
    }

    let statistic = n * mean.norm_squared() / trace;
    let df = trace.powi(2) / covariance.norm_squared();
    let p = distributions::chi_squared_upper(df * statistic, df);
    let anova_type = Some(RankTest { statistic, df, p });

    let eigen = SymmetricEigen::new(covariance);
    let largest = eigen.eigenvalues.max();
    let wald_type = (eigen.eigenvalues.min() > SINGULAR * largest).then(|| {
        let along = eigen.eigenvectors.transpose() * mean.transpose();
        let squares = along.iter().zip(&eigen.eigenvalues).map(|(z, variance)| z * z / variance);
        let statistic = n * squares.sum::<f64>();
        let df = contrasts.nrows() as f64;
        RankTest { statistic, df, p: distributions::chi_squared_upper(statistic, df) }
    });
    (anova_type, wald_type)
}

/// The effects of the cells and, if there are several factors, of the levels of each.
fn relative_effects(design: &WithinDesign, ranks: &DMatrix<f64>) -> Vec<RelativeEffect> {
    let of = |(factor, level): (&Factor, &String)| FactorLevel {
        factor: factor.name.clone(),
        level: level.clone(),
    };
    let cells: Vec<Vec<FactorLevel>> =
        design.cells().map(|cell| design.factors().iter().zip(&cell).map(of).collect()).collect();
    let mut groups = cells.clone();
    if design.factors().len() > 1 {
        for factor in design.factors() {
            groups.extend(factor.levels.iter().map(|level| vec![of((factor, level))]));
        }
    }
    let means = ranks.row_mean();
    let effect = |levels: Vec<FactorLevel>| {
        let own: Vec<f64> = cells
            .iter()
            .zip(&means)
            .filter(|(cell, _)| levels.iter().all(|level| cell.contains(level)))
            .map(|(_, &mean)| mean)
            .collect();
        let mean_rank = own.iter().sum::<f64>() / own.len() as f64;
        RelativeEffect {
            levels,
            observations: own.len() * ranks.nrows(),
            mean_rank,
            relative_treatment_effect: (mean_rank - 0.5) / ranks.len() as f64,
        }
    };
    groups.into_iter().map(effect).collect()
}

#[cfg(test)]
mod tests {
    use super::super::paired::{Family, paired_t};
    use super::super::testing::{LEVELS, table};
    use super::*;

    /// Whole numbers with many ties.
    fn tied(row: usize, column: usize) -> f64 {
        ((row * 7 + column * 5 + row * column * 3) % 6) as f64
    }

    #[test]
    fn ties_share_their_mean_rank() {
        assert_eq!(mid_ranks(&[3.0, 1.0, 3.0, -0.0, 0.0]), [4.5, 3.0, 4.5, 1.5, 1.5]);
    }

    #[test]
    fn of_two_cells_both_statistics_are_the_square_of_the_ranks_t() {
        let table = table(&[2], 8, tied);
        let ranks = mid_ranks(table.values().as_slice());
        let (first, second) = ranks.split_at(8);
        let family = Family { name: "one".to_owned(), tests: 1 };
        let t = paired_t(first, second, &family).unwrap().t;
        let it = rank_analysis(&table).unwrap();
        let [RankEffect { anova_type: Some(ats), wald_type: Some(wts), .. }] = it.effects[..]
        else {
            panic!("{it:?}")
        };
        assert!((ats.statistic / t.powi(2) - 1.0).abs() < 1e-13);
        assert!((wts.statistic / t.powi(2) - 1.0).abs() < 1e-13);
        assert!((ats.df - 1.0).abs() < 1e-14 && (wts.df - 1.0).abs() < 1e-14);
        assert!((ats.p / wts.p - 1.0).abs() < 1e-12);
    }

    #[test]
    fn only_the_order_of_the_values_matters() {
        let plain = rank_analysis(&table(&[2, 3], 9, tied)).unwrap();
        let other = table(&[2, 3], 9, |row, column| 1e6 + tied(row, column).exp());
        assert_eq!(rank_analysis(&other).unwrap(), plain);
        // The relative effects average one half, over the cells and over the levels of each factor.
        for (effects, count) in [(0..6, 6.0), (6..8, 2.0), (8..11, 3.0)] {
            let effects = &plain.relative_effects[effects];
            let sum: f64 = effects.iter().map(|it| it.relative_treatment_effect).sum();
            assert!((sum / count - 0.5).abs() < 1e-15);
        }
        assert_eq!(plain.relative_effects[9].levels[0].factor, LEVELS[1].0);
        assert_eq!(plain.relative_effects[9].observations, 18);
    }

    #[test]
    fn where_ranks_do_not_scatter_there_is_no_test() {
        let constant = rank_analysis(&table(&[2, 3], 5, |_, _| 0.1)).unwrap();
        for it in &constant.effects {
            assert_eq!((it.anova_type, it.wald_type), (None, None));
        }
        assert!(constant.relative_effects.iter().all(|it| it.relative_treatment_effect == 0.5));
        // All subjects alike, however different the cells.
        let alike = rank_analysis(&table(&[3], 7, |_, cell| cell as f64)).unwrap();
        assert_eq!((alike.effects[0].anova_type, alike.effects[0].wald_type), (None, None));
    }

    #[test]
    fn a_singular_covariance_has_no_wald_statistic() {
        for subjects in [2, 4] {
            let it = rank_analysis(&table(&[5], subjects, |row, column| {
                tied(row, column) + 0.1 * column as f64
            }));
            let effect = &it.unwrap().effects[0];
            assert!(effect.anova_type.is_some_and(|it| it.df < subjects as f64 - 1.0 + 1e-12));
            assert_eq!(effect.wald_type, None);
        }
        let one = rank_analysis(&table(&[1], 4, tied));
        assert_eq!(one, Err(Undefined::OneLevel(LEVELS[0].0.to_owned())));
    }
}
