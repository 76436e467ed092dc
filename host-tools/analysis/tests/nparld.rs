//! The rank analysis agrees with R's nparLD on the data sets of that package. They are under the
//! GPL and not in this repository: the tests look for them where `PLUMBLINE_DATA` points, and are
//! skipped if they are absent.

use plumbline_test_support::data;
use std::path::Path;

use crate::common::{assert_close, columns, design};
use plumbline_analysis::statistics::ranks::{RankAnalysis, RankTest, rank_analysis};

/// The package prints 15 digits; the tails have 13.
const RELATIVE: f64 = 5e-13;

fn assert_agrees(found: &RankAnalysis, folder: &Path, prefix: &str) {
    let reference = |table: &str, headers: &[&str]| -> Vec<Vec<f64>> {
        let path = folder.join(format!("ref_{prefix}_{table}.csv"));
        let numbers = |row: Vec<String>| row.iter().map(|it| it.parse().unwrap()).collect();
        columns(&path, headers).into_iter().map(numbers).collect()
    };
    let effects = reference("RTE", &["RankMeans", "Nobs", "RTE"]);
    assert_eq!(found.relative_effects.len(), effects.len());
    for (found, expected) in found.relative_effects.iter().zip(effects) {
        let what = format!("{:?}", found.levels);
        assert_close(found.mean_rank, expected[0], RELATIVE, &what);
        assert_close(found.observations as f64, expected[1], 0.0, &what);
        assert_close(found.relative_treatment_effect, expected[2], RELATIVE, &what);
    }
    let assert_tests = |table: &str, of: &dyn Fn(usize) -> RankTest| {
        let rows = reference(table, &["Statistic", "df", "p-value"]);
        assert_eq!(found.effects.len(), rows.len());
        for (at, expected) in rows.iter().enumerate() {
            let (found, what) = (of(at), &found.effects[at].effect);
            assert_close(found.statistic, expected[0], RELATIVE, what);
            assert_close(found.df, expected[1], RELATIVE, what);
            assert_close(found.p, expected[2], RELATIVE, what);
        }
    };
    assert_tests("ANOVA.test", &|at| found.effects[at].anova_type.unwrap());
    assert_tests("Wald.test", &|at| found.effects[at].wald_type.unwrap());
}

#[test]
fn two_factors_ld_f2_amylase() {
    let Some(folder) = data("nparld") else { return };
    let table = design(&folder.join("amylase.csv"), "subject", &["time1", "time2"], "resp");
    assert_agrees(&rank_analysis(&table).unwrap(), &folder, "amylase_LDF2");
}

#[test]
fn one_factor_ld_f1_dental() {
    let Some(folder) = data("nparld") else { return };
    let table = design(&folder.join("dental.csv"), "subject", &["time"], "resp");
    assert_agrees(&rank_analysis(&table).unwrap(), &folder, "dental_LDF1");
}
