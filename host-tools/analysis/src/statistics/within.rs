//! A complete within-subject table: each subject measured once in every combination of levels
//! of one or more factors.
//!
//! The methods for it ([`anova`](super::anova), [`ranks`](super::ranks)) represent an effect by
//! orthonormal contrasts of the cells: for a factor in the effect, all differences among its
//! levels; for any other factor, the average over its levels. With that one matrix, main effects
//! and interactions are the same computation.

use std::collections::HashMap;
use std::fmt;

use nalgebra::DMatrix;
use serde::Serialize;

use super::is_number;

/// One measurement, as in a long table.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation<'a> {
    /// The subject.
    pub subject: &'a str,
    /// The level of each factor, in the order of the factors.
    pub levels: Vec<&'a str>,
    /// The measurement.
    pub value: f64,
}

/// A within-subject factor, such as time with the levels early, mid and late.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Factor {
    /// Its name.
    pub name: String,
    /// Its levels, in the order in which they first appear in the data.
    pub levels: Vec<String>,
}

/// A main effect or an interaction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Effect {
    /// Its factors' names, with a colon between them.
    pub name: String,
    /// For each factor, whether the effect includes it.
    includes: Vec<bool>,
}

/// The table: subjects by cells, none empty. Cells are in the order of the levels, with the level
/// of the last factor changing fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct WithinDesign {
    factors: Vec<Factor>,
    subjects: Vec<String>,
    /// One row per subject, one column per cell.
    values: DMatrix<f64>,
}

/// A subject without a measurement in some cell.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Incomplete {
    /// The subject.
    pub subject: String,
    /// The levels of the first cell without one.
    pub cell: Vec<String>,
}

/// The cost of the methods grows with the second to fourth power of the number of cells.
const CELLS_MAX: usize = 200;

/// Why observations do not form a complete table.
#[derive(Debug, Clone, PartialEq)]
pub enum DesignError {
    /// There is no factor, or two have the same name.
    Factors,
    /// Too many combinations of levels for a design: one of the columns is not a factor.
    Cells(usize),
    /// There are no measurements.
    Empty,
    /// A measurement is missing.
    Missing(Incomplete),
    /// A cell was measured twice for a subject.
    Duplicate {
        /// The subject.
        subject: String,
        /// The levels of the cell.
        cell: Vec<String>,
    },
    /// A value is not a number, or beyond 1e100.
    NotFinite {
        /// The subject.
        subject: String,
        /// The levels of the cell.
        cell: Vec<String>,
    },
}

impl fmt::Display for DesignError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (subject, cell, fault) = match self {
            Self::Factors => {
                return write!(
                    formatter,
                    "factors: at least one is needed, each with its own name"
                );
            }
            Self::Cells(cells) => {
                return write!(
                    formatter,
                    "the factors have {cells} combinations of levels, but at most {CELLS_MAX} are allowed"
                );
            }
            Self::Empty => return write!(formatter, "there are no measurements"),
            Self::Missing(it) => (&it.subject, &it.cell, "has no value"),
            Self::Duplicate { subject, cell } => (subject, cell, "has two values"),
            Self::NotFinite { subject, cell } => {
                (subject, cell, "has a value that is no number within +-1e100")
            }
        };
        write!(formatter, "subject {subject} {fault} in {}", cell.join(", "))
    }
}

impl std::error::Error for DesignError {}

impl WithinDesign {
    /// From measurements in any order; every subject must have one in every cell.
    ///
    /// # Errors
    /// Without factors, or with two of the same name. Otherwise the error names the first subject
    /// and cell with no value, with two values, or with one that is not a number.
    ///
    /// # Panics
    /// When an observation does not have exactly one level of each factor.
    pub fn new(factors: &[&str], observations: &[Observation<'_>]) -> Result<Self, DesignError> {
        let (design, mut dropped) = Self::of_complete_subjects(factors, observations)?;
        if dropped.is_empty() {
            Ok(design)
        } else {
            Err(DesignError::Missing(dropped.swap_remove(0)))
        }
    }

    /// The table without the subjects that lack a value in some cell; those are listed.
    ///
    /// # Errors
    /// As [`new`](Self::new), and when no subject remains.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn of_complete_subjects(
        factors: &[&str],
        observations: &[Observation<'_>],
    ) -> Result<(Self, Vec<Incomplete>), DesignError> {
        let table = LongTable::new(factors, observations)?;
        let (mut subjects, mut values, mut dropped) = (Vec::new(), Vec::new(), Vec::new());
        for (subject, row) in table.subjects.into_iter().zip(&table.rows) {
            match row.iter().position(Option::is_none) {
                Some(empty) => {
                    let cell = levels_of(&table.factors, empty);
                    dropped.push(Incomplete { subject, cell });
                }
                None => {
                    subjects.push(subject);
                    values.extend(row.iter().flatten());
                }
            }
        }
        if subjects.is_empty() {
            return Err(dropped
                .into_iter()
                .next()
                .map_or(DesignError::Empty, DesignError::Missing));
        }
        let cells = table.factors.iter().map(|factor| factor.levels.len()).product();
        let values = DMatrix::from_row_slice(subjects.len(), cells, &values);
        Ok((Self { factors: table.factors, subjects, values }, dropped))
    }

    /// The factors.
    #[must_use]
    pub fn factors(&self) -> &[Factor] {
        &self.factors
    }

    /// The subjects, in the order in which they first appear in the data.
    #[must_use]
    pub fn subjects(&self) -> &[String] {
        &self.subjects
    }

    /// The measurements: one row per subject, one column per cell.
    #[must_use]
    pub fn values(&self) -> &DMatrix<f64> {
        &self.values
    }

    /// A cell's measurements, by subject.
    ///
    /// # Panics
    /// When there is no such cell.
    #[must_use]
    pub fn cell(&self, index: usize) -> &[f64] {
        let count = self.subjects.len();
        &self.values.as_slice()[index * count..(index + 1) * count]
    }

    /// The levels of each cell, in the order of the cells.
    pub fn cells(&self) -> impl Iterator<Item = Vec<String>> + '_ {
        (0..self.values.ncols()).map(|cell| levels_of(&self.factors, cell))
    }

    /// The index of the cell with these levels; `None` if there is none.
    #[must_use]
    pub fn cell_with(&self, levels: &[&str]) -> Option<usize> {
        self.cells().position(|cell| cell == levels)
    }

    /// Every main effect and interaction: A, B, A:B.
    #[must_use]
    pub fn effects(&self) -> Vec<Effect> {
        let subsets = 1_usize..1 << self.factors.len();
        let effect = |subset: usize| {
            let includes: Vec<bool> =
                (0..self.factors.len()).map(|factor| subset >> factor & 1 == 1).collect();
            let names: Vec<&str> = self
                .factors
                .iter()
                .zip(&includes)
                .filter_map(|(factor, included)| included.then_some(&factor.name[..]))
                .collect();
            Effect { name: names.join(":"), includes }
        };
        subsets.map(effect).collect()
    }

    /// The orthonormal contrasts of an effect: one row per contrast, one column per cell. There are
    /// as many rows as the effect has degrees of freedom.
    #[must_use]
    pub fn contrasts(&self, effect: &Effect) -> DMatrix<f64> {
        let parts = self.factors.iter().zip(&effect.includes).map(|(factor, included)| {
            let levels = factor.levels.len();
            if *included {
                differences(levels)
            } else {
                DMatrix::from_element(1, levels, (levels as f64).sqrt().recip())
            }
        });
        parts.fold(DMatrix::identity(1, 1), |whole, part| whole.kronecker(&part))
    }
}

/// Normalised Helmert contrasts: each level against the mean of the levels before it.
fn differences(levels: usize) -> DMatrix<f64> {
    DMatrix::from_fn(levels - 1, levels, |row, level| {
        let before = (row + 1) as f64;
        let length = (before * (before + 1.0)).sqrt();
        match level {
            _ if level <= row => -length.recip(),
            _ if level == row + 1 => before / length,
            _ => 0.0,
        }
    })
}

/// The levels of the cell with this index.
fn levels_of(factors: &[Factor], cell: usize) -> Vec<String> {
    let mut levels = Vec::with_capacity(factors.len());
    let mut rest = cell;
    for factor in factors.iter().rev() {
        levels.push(factor.levels[rest % factor.levels.len()].clone());
        rest /= factor.levels.len();
    }
    levels.reverse();
    levels
}

/// The observations arranged by subject and cell; some cells may be empty.
struct LongTable {
    factors: Vec<Factor>,
    subjects: Vec<String>,
    /// One row per subject, with a value per cell.
    rows: Vec<Vec<Option<f64>>>,
}

impl LongTable {
    fn new(factors: &[&str], observations: &[Observation<'_>]) -> Result<Self, DesignError> {
        if factors.is_empty() || Labels::new(factors.iter().copied()).names != factors {
            return Err(DesignError::Factors);
        }
        assert!(
            observations.iter().all(|it| it.levels.len() == factors.len()),
            "an observation has a level of each factor"
        );
        let subjects = Labels::new(observations.iter().map(|it| it.subject));
        let levels: Vec<Labels<'_>> = (0..factors.len())
            .map(|factor| Labels::new(observations.iter().map(move |it| it.levels[factor])))
            .collect();
        let counts = levels.iter().map(|labels| labels.names.len());
        let cells = counts.fold(1, usize::saturating_mul);
        if cells > CELLS_MAX {
            return Err(DesignError::Cells(cells));
        }
        let mut rows = vec![vec![None; cells]; subjects.names.len()];
        for it in observations {
            let cell = levels
                .iter()
                .zip(&it.levels)
                .fold(0, |cell, (labels, level)| cell * labels.names.len() + labels.places[level]);
            let named = || (it.subject.to_owned(), it.levels.iter().map(|&it| it.into()).collect());
            if !is_number(it.value) {
                let (subject, cell) = named();
                return Err(DesignError::NotFinite { subject, cell });
            }
            if rows[subjects.places[it.subject]][cell].replace(it.value).is_some() {
                let (subject, cell) = named();
                return Err(DesignError::Duplicate { subject, cell });
            }
        }
        let factors = factors.iter().zip(levels).map(|(&name, labels)| Factor {
            name: name.to_owned(),
            levels: labels.names.into_iter().map(str::to_owned).collect(),
        });
        let subjects = subjects.names.into_iter().map(str::to_owned).collect();
        Ok(Self { factors: factors.collect(), subjects, rows })
    }
}

/// Distinct labels in the order of their first appearance.
struct Labels<'a> {
    names: Vec<&'a str>,
    places: HashMap<&'a str, usize>,
}

impl<'a> Labels<'a> {
    fn new(labels: impl Iterator<Item = &'a str>) -> Self {
        let (mut names, mut places) = (Vec::new(), HashMap::new());
        for label in labels {
            places.entry(label).or_insert_with(|| {
                names.push(label);
                names.len() - 1
            });
        }
        Self { names, places }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS: [[&str; 2]; 6] =
        [["b", "z"], ["b", "x"], ["b", "y"], ["a", "z"], ["a", "x"], ["a", "y"]];

    fn observations() -> Vec<Observation<'static>> {
        let row = |subject, person: f64| {
            CELLS.iter().zip([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).map(move |(levels, cell)| {
                Observation { subject, levels: levels.to_vec(), value: person + cell }
            })
        };
        row("Z", 10.0).chain(row("A", 20.0)).collect()
    }

    fn design(observations: &[Observation<'_>]) -> Result<WithinDesign, DesignError> {
        WithinDesign::new(&["condition", "time"], observations)
    }

    #[test]
    fn numbers_of_frames_are_no_levels() {
        let frames: Vec<String> = (0..CELLS_MAX + 1).map(|it| it.to_string()).collect();
        let observation = |frame| Observation { subject: "a", levels: vec![frame], value: 1.0 };
        let observations: Vec<Observation<'_>> =
            frames.iter().map(|it| observation(it.as_str())).collect();
        let of = |count: usize| WithinDesign::new(&["frame"], &observations[..count]).map(|_| ());
        assert_eq!(of(CELLS_MAX), Ok(()));
        assert_eq!(of(CELLS_MAX + 1), Err(DesignError::Cells(CELLS_MAX + 1)));
    }

    #[test]
    fn cells_are_in_the_order_of_first_appearance_wherever_the_rows_stand() {
        let mut rows = observations();
        let table = design(&rows).unwrap();
        assert_eq!(table.subjects(), ["Z", "A"]);
        assert_eq!(table.factors()[1].levels, ["z", "x", "y"]);
        assert_eq!(table.cells().collect::<Vec<_>>(), CELLS.map(|cell| cell.to_vec()));
        assert_eq!(table.cell(4), [14.0, 24.0]);
        assert_eq!(table.cell_with(&["a", "x"]), Some(4));
        assert_eq!(table.cell_with(&["x", "a"]), None);
        rows[6..].reverse();
        assert_eq!(design(&rows).unwrap(), table);
    }

    #[test]
    fn a_fault_is_named_by_subject_and_cell() {
        let mut rows = observations();
        rows.remove(10);
        let error = design(&rows).unwrap_err();
        assert_eq!(error.to_string(), "subject A has no value in a, x");
        rows.push(rows[0].clone());
        let error = design(&rows).unwrap_err();
        assert_eq!(error.to_string(), "subject Z has two values in b, z");
        for value in [f64::NAN, f64::INFINITY, -1e101] {
            rows[0].value = value;
            let error = design(&rows).unwrap_err().to_string();
            assert_eq!(error, "subject Z has a value that is no number within +-1e100 in b, z");
        }
        assert_eq!(design(&[]), Err(DesignError::Empty));
        for factors in [&[][..], &["time", "time"]] {
            assert_eq!(WithinDesign::new(factors, &rows), Err(DesignError::Factors));
        }
    }

    #[test]
    fn incomplete_subjects_can_be_left_out_and_are_listed() {
        let mut rows = observations();
        rows.remove(4);
        let (rest, dropped) =
            WithinDesign::of_complete_subjects(&["condition", "time"], &rows).unwrap();
        assert_eq!(rest.subjects(), ["A"]);
        assert_eq!(
            dropped,
            [Incomplete { subject: "Z".into(), cell: vec!["a".into(), "x".into()] }]
        );
        // With the last complete subject gone, nothing is left to analyse.
        rows.retain(|it| it.levels != ["b", "z"]);
        let error = WithinDesign::of_complete_subjects(&["condition", "time"], &rows).unwrap_err();
        assert_eq!(error.to_string(), "subject Z has no value in b, z");
    }

    #[test]
    fn contrasts_are_orthonormal_and_together_with_the_mean_span_all_cells() {
        let table = design(&observations()).unwrap();
        let effects = table.effects();
        assert_eq!(
            effects.iter().map(|effect| &effect.name[..]).collect::<Vec<_>>(),
            ["condition", "time", "condition:time"]
        );
        let all: Vec<DMatrix<f64>> = effects.iter().map(|it| table.contrasts(it)).collect();
        assert_eq!(all.iter().map(DMatrix::nrows).collect::<Vec<_>>(), [1, 2, 2]);
        let projection: DMatrix<f64> = all.iter().map(|c| c.transpose() * c).sum();
        let centring = DMatrix::identity(6, 6) - DMatrix::from_element(6, 6, 1.0 / 6.0);
        // Products of a few square roots.
        assert!((projection - centring).amax() < 1e-15);
        for c in &all {
            assert!((c * c.transpose() - DMatrix::identity(c.nrows(), c.nrows())).amax() < 1e-15);
        }
    }
}
