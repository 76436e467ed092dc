//! The within-subject statistics of one response: everything that a paper reports about it.

use serde::Serialize;

use super::Undefined;
use super::anova::{Anova, anova, residuals};
use super::describe::{Description, cohens_d, cohens_d_z, cousineau_morey};
use super::paired::{Family, PairedT, paired_t};
use super::ranks::{RankAnalysis, RankTest, rank_analysis, rank_comparison};
use super::shapiro_wilk::{ShapiroWilk, shapiro_wilk};
use super::within::{Factor, WithinDesign};

/// Differences with a smaller p are marked in tables.
pub const SIGNIFICANT: f64 = 0.05;

/// A statistic, or why there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Stated<T> {
    /// It is defined for these data.
    Known(T),
    /// It is not defined.
    Absent {
        /// The reason.
        absent: String,
    },
}

impl<T> From<Result<T, Undefined>> for Stated<T> {
    fn from(result: Result<T, Undefined>) -> Self {
        match result {
            Ok(value) => Self::Known(value),
            Err(error) => Self::Absent { absent: error.to_string() },
        }
    }
}

impl<T> Stated<T> {
    /// The statistic.
    #[must_use]
    pub fn known(&self) -> Option<&T> {
        match self {
            Self::Known(value) => Some(value),
            Self::Absent { .. } => None,
        }
    }

    /// The statistic, or why there is none.
    ///
    /// # Errors
    /// Where there is none.
    pub fn as_result(&self) -> Result<&T, &str> {
        match self {
            Self::Known(value) => Ok(value),
            Self::Absent { absent } => Err(absent),
        }
    }
}

/// The statistics of one response.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inference {
    /// The factors and their levels.
    pub factors: Vec<Factor>,
    /// The subjects included in the analysis.
    pub subjects: Vec<String>,
    /// Each combination of levels, with the level of the last factor changing fastest.
    pub cells: Vec<Cell>,
    /// The normality of the residuals of the analysis of variance (value - cell - subject + grand
    /// mean).
    pub normality_of_residuals: Stated<ShapiroWilk>,
    /// Repeated-measures analysis of variance.
    pub anova: Stated<Anova>,
    /// Non-parametric analysis of variance (Brunner, Domhof and Langer 2002).
    pub ranks: Stated<RankAnalysis>,
    /// Paired comparisons.
    pub comparisons: Vec<Comparison>,
}

/// One combination of levels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cell {
    /// A level of each factor.
    pub levels: Vec<String>,
    /// The values as measured.
    pub raw: Stated<Description>,
    /// The values without the differences between subjects (Cousineau 2005, Morey 2008).
    pub normalised: Stated<Description>,
}

/// Two levels of one factor, at one level of the other factor if there is one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The factor that differs.
    pub factor: String,
    /// Its two levels.
    pub levels: [String; 2],
    /// The other factor's level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub under: Option<String>,
    /// Paired t test, from the first to the second.
    pub t_test: Stated<PairedT>,
    /// The same comparison by ranks.
    pub ranks: Stated<RankComparison>,
    /// Cohen's d of the normalised values, as in the paper's Table II: the difference of the means
    /// divided by the square root of the mean variance.
    pub d: Stated<f64>,
    /// Cohen's d of the differences: their mean divided by their standard deviation.
    pub d_z: Stated<f64>,
}

/// Two levels compared by the ranks of their values only: nparLD's LD-F1 with two levels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RankComparison {
    /// The ANOVA-type statistic.
    pub anova_type: RankTest,
    /// Its p times the number of tests in the family, at most 1 (Bonferroni).
    pub p_bonferroni: f64,
    /// The family.
    pub family: Family,
}

impl RankComparison {
    fn new(from: &[f64], to: &[f64], family: &Family) -> Result<Self, Undefined> {
        let anova_type = rank_comparison(from, to)?;
        let p_bonferroni = (anova_type.p * family.tests as f64).min(1.0);
        Ok(Self { anova_type, p_bonferroni, family: family.clone() })
    }
}

impl Inference {
    /// The statistics of a design with one or two factors.
    #[must_use]
    pub fn of(design: &WithinDesign) -> Self {
        let normalised = cousineau_morey(design);
        let cells: Vec<Cell> = design
            .cells()
            .enumerate()
            .map(|(at, levels)| Cell {
                levels,
                raw: Description::new(design.cell(at)).into(),
                normalised: normalised.clone().map(|all| all[at]).into(),
            })
            .collect();
        let comparisons = comparisons(design, &cells);
        Self {
            factors: design.factors().to_vec(),
            subjects: design.subjects().to_vec(),
            cells,
            normality_of_residuals: shapiro_wilk(&residuals(design)).into(),
            anova: anova(design).into(),
            ranks: rank_analysis(design).into(),
            comparisons,
        }
    }

    /// The comparison of two levels.
    #[must_use]
    pub fn comparison(&self, levels: [&str; 2], under: Option<&str>) -> Option<&Comparison> {
        self.comparisons.iter().find(|it| it.levels == levels && it.under.as_deref() == under)
    }
}

/// The levels of each factor compared pairwise, at each level of the other. The Bonferroni family
/// of the first factor is all its pairs at all levels of the second (what a condition changes, at
/// any time); that of the second is all its pairs at one level of the first.
fn comparisons(design: &WithinDesign, cells: &[Cell]) -> Vec<Comparison> {
    let factors = design.factors();
    let mut comparisons = Vec::new();
    for (which, factor) in factors.iter().enumerate() {
        let other = (factors.len() == 2).then(|| &factors[1 - which]);
        let unders: Vec<Option<&str>> = match other {
            Some(other) => other.levels.iter().map(|it| Some(it.as_str())).collect(),
            None => vec![None],
        };
        let pairs: Vec<[&str; 2]> = pairs(factor);
        let family = match other {
            Some(other) if which == 0 => Family {
                name: format!("{}, all pairs at all levels of {}", factor.name, other.name),
                tests: pairs.len() * other.levels.len(),
            },
            Some(other) => Family {
                name: format!("{}, all pairs within a level of {}", factor.name, other.name),
                tests: pairs.len(),
            },
            None => Family { name: format!("{}, all pairs", factor.name), tests: pairs.len() },
        };
        for under in unders {
            for levels in &pairs {
                let cell_of = |level: &str| {
                    let levels: Vec<&str> = match under {
                        Some(under) if which == 0 => vec![level, under],
                        Some(under) => vec![under, level],
                        None => vec![level],
                    };
                    design.cell_with(&levels)
                };
                let (Some(from), Some(to)) = (cell_of(levels[0]), cell_of(levels[1])) else {
                    continue;
                };
                let (a, b) = (design.cell(from), design.cell(to));
                let d = match (&cells[from].normalised, &cells[to].normalised) {
                    (Stated::Known(from), Stated::Known(to)) => cohens_d(from, to).into(),
                    (Stated::Absent { absent }, _) | (_, Stated::Absent { absent }) => {
                        Stated::Absent { absent: absent.clone() }
                    }
                };
                comparisons.push(Comparison {
                    factor: factor.name.clone(),
                    levels: levels.map(str::to_owned),
                    under: under.map(str::to_owned),
                    t_test: paired_t(a, b, &family).into(),
                    ranks: RankComparison::new(a, b, &family).into(),
                    d,
                    d_z: cohens_d_z(a, b).into(),
                });
            }
        }
    }
    comparisons
}

fn pairs(factor: &Factor) -> Vec<[&str; 2]> {
    let levels = &factor.levels;
    let of = |first: usize| {
        (first + 1..levels.len()).map(move |second| [&*levels[first], &*levels[second]])
    };
    (0..levels.len()).flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::testing::table;
    use super::*;

    #[test]
    fn three_subjects_can_be_ranked_by_hand() {
        // At time 1 the values of b lie three, four and two ranks above those of a; at time 2 all
        // lie three above.
        let cells = [[10.0, 20.0, 30.0], [1.0, 2.0, 3.0], [40.0, 60.0, 50.0], [4.0, 5.0, 6.0]];
        let inference = Inference::of(&table(&[2, 2], 3, |subject, cell| cells[cell][subject]));
        let at = |time| inference.comparison(["a", "b"], Some(time)).unwrap();
        // n mean^2 / variance = 3 x 3^2 / 1, chi-squared with one degree of freedom.
        let ranks = at("1").ranks.known().unwrap();
        let p = libm::erfc(13.5_f64.sqrt());
        assert!((ranks.anova_type.statistic - 27.0).abs() < 1e-12, "{ranks:?}");
        assert!((ranks.anova_type.p / p - 1.0).abs() < 1e-9, "{ranks:?} {p}");
        assert_eq!((ranks.family.tests, ranks.p_bonferroni), (2, 2.0 * ranks.anova_type.p));
        assert_eq!(
            at("2").ranks.as_result(),
            Err("the ranks of all subjects differ in the same way: there are too few")
        );
    }

    #[test]
    fn a_family_is_a_conditions_times_or_a_conditions_pairs_of_times() {
        let value = |subject: usize, cell: usize| ((7 * subject + 3) * (cell + 2) % 11) as f64;
        let inference = Inference::of(&table(&[2, 4], 5, value));
        let tests = |factor: &str| {
            let of_factor = inference.comparisons.iter().filter(|it| it.factor == factor);
            of_factor.map(|it| it.t_test.known().unwrap().family.tests).collect::<Vec<_>>()
        };
        assert_eq!(tests("condition"), [4; 4]);
        assert_eq!(tests("time"), [6; 12]);
        let three = Inference::of(&table(&[3, 2], 5, value));
        let condition = three.comparisons.iter().find(|it| it.factor == "condition").unwrap();
        assert_eq!(condition.t_test.known().unwrap().family.tests, 3 * 2);
        // The second cell under each condition.
        let second = inference.comparison(["a", "b"], Some("2")).unwrap();
        let differences = (0..5).map(|subject| value(subject, 5) - value(subject, 1));
        let test = second.t_test.known().unwrap();
        assert!((test.mean_difference - differences.sum::<f64>() / 5.0).abs() < 1e-14);
        assert_eq!(test.p_bonferroni, (4.0 * test.p).min(1.0));
    }
}
