//! The statistics agree with those of statsmodels, pingouin, scipy and mpmath on the same data:
//! `tests/oracles/`. Every bound is a few times the error reached, and its comment says what limits
//! it.

use std::path::{Path, PathBuf};

use crate::common::{assert_close, columns, design, design_of};
use plumbline_analysis::statistics::anova::{AnovaEffect, anova, residuals};
use plumbline_analysis::statistics::bland_altman::bland_altman;
use plumbline_analysis::statistics::describe::{Description, cohens_d, cousineau_morey};
use plumbline_analysis::statistics::distributions::*;
use plumbline_analysis::statistics::paired::{Family, paired_t};
use plumbline_analysis::statistics::regression::{Line, line};
use plumbline_analysis::statistics::shapiro_wilk::shapiro_wilk;
use plumbline_analysis::statistics::within::WithinDesign;
use serde_json::Value;

/// Sums of several hundred products, each program's in its own order. 1e-13 is reached; the limit
/// is what the other programs compute as the remainder of a total.
const SUMS: f64 = 1e-12;
/// p is up to ten times as sensitive as its statistic, and adds the errors of two programs' tails.
/// 3e-11 is reached, with 298 degrees of freedom.
const P: f64 = 1e-10;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracles")
}

fn oracle(section: &str) -> Value {
    let text = std::fs::read_to_string(folder().join("oracles.json")).unwrap();
    let all: Value = serde_json::from_str(&text).unwrap();
    all[section].clone()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(number).collect()
}

fn study(name: &str) -> WithinDesign {
    let path = folder().join(format!("inputs/study_{name}.csv"));
    design(&path, "subject", &["condition", "time"], "value")
}

fn input(name: &str, headers: &[&str]) -> Vec<Vec<String>> {
    columns(&folder().join(format!("inputs/{name}.csv")), headers)
}

fn assert_effect(found: &AnovaEffect, expected: &Value) {
    let close = |what: &str, found: f64, relative: f64| {
        assert_close(found, number(&expected[what]), relative, &format!("{what} of {}", expected));
    };
    close("sum_of_squares", found.sum_of_squares, SUMS);
    close("df", found.df as f64, 0.0);
    close("error_df", found.error_df as f64, 0.0);
    let test = found.test.as_ref().unwrap();
    close("f", test.f, SUMS);
    close("p", test.p, P);
    close("generalized_eta_squared", test.generalized_eta_squared, SUMS);
    let Some(sphericity) = &test.sphericity else {
        assert_eq!((found.df, number(&expected["greenhouse_geisser"])), (1, 1.0));
        return;
    };
    close("greenhouse_geisser", sphericity.greenhouse_geisser.epsilon, SUMS);
    close("greenhouse_geisser_p", sphericity.greenhouse_geisser.p, P);
    close("huynh_feldt", sphericity.huynh_feldt.unwrap().epsilon, SUMS);
    let mauchly = sphericity.mauchly.unwrap();
    close("mauchly_w", mauchly.w, SUMS);
    close("mauchly_p", mauchly.p, P);
}

#[test]
fn two_way_analyses_of_variance_agree_with_statsmodels_and_pingouin() {
    for (name, expected) in oracle("two_way").as_object().unwrap() {
        let table = study(name);
        let found = anova(&table).unwrap();
        assert_eq!(found.effects.len(), 3);
        for effect in &found.effects {
            let expected = &expected["effects"][&effect.effect];
            assert_effect(effect, expected);
            let test = effect.test.as_ref().unwrap();
            assert_close(test.f, number(&expected["statsmodels_f"]), SUMS, "statsmodels' F");
            assert_close(test.p, number(&expected["statsmodels_p"]), P, "statsmodels' p");
            let partial = number(&expected["partial_eta_squared"]);
            assert_close(test.partial_eta_squared, partial, SUMS, "partial eta squared");
            if let Some(sphericity) = &test.sphericity {
                let mauchly = sphericity.mauchly.unwrap();
                let chi_squared = number(&expected["mauchly_chi_squared"]);
                assert_close(mauchly.chi_squared, chi_squared, SUMS, "Mauchly's chi-squared");
                assert_eq!(mauchly.df as u64, expected["mauchly_df"].as_u64().unwrap());
            }
        }
        let residuals = shapiro_wilk(&residuals(&table)).unwrap();
        assert_shapiro(residuals.w, residuals.p, &expected["residuals"], "residuals");
    }
}

#[test]
fn one_way_analyses_of_variance_agree_with_pingouin() {
    for (name, expected) in oracle("one_way").as_object().unwrap() {
        let found = anova(&first_condition(name, expected)).unwrap();
        let [effect] = &found.effects[..] else { panic!("one factor, one effect") };
        assert_effect(effect, expected);
        let error = number(&expected["error_sum_of_squares"]);
        assert_close(effect.error_sum_of_squares, error, SUMS, "error");
    }
}

/// The times within the condition named by an oracle.
fn first_condition(study: &str, expected: &Value) -> WithinDesign {
    let rows = input(&format!("study_{study}"), &["subject", "value", "time", "condition"]);
    let rows: Vec<Vec<String>> = rows
        .into_iter()
        .filter(|row| row[3] == expected["condition"])
        .map(|row| row[..3].to_vec())
        .collect();
    design_of(&["time"], &rows)
}

#[test]
fn cousineau_and_moreys_errors_make_up_pingouins_mean_square_of_the_error() {
    // The mean of the cells' variances is the error's mean square: both are what remains of the
    // subjects' values without their levels, over (n - 1) (C - 1).
    for (name, expected) in oracle("one_way").as_object().unwrap() {
        let cells = cousineau_morey(&first_condition(name, expected)).unwrap();
        let variances = cells.iter().map(|cell| cell.sem.powi(2) * cell.n as f64);
        let mean = variances.sum::<f64>() / cells.len() as f64;
        let square = number(&expected["error_sum_of_squares"]) / number(&expected["error_df"]);
        assert_close(mean, square, SUMS, "mean variance");
    }
}

#[test]
fn paired_tests_agree_with_scipy_and_effect_sizes_with_pingouin() {
    for (name, expected) in oracle("paired").as_object().unwrap() {
        let table = study(name);
        let tests = expected["tests"].as_array().unwrap();
        let family = Family { name: "times".to_owned(), tests: tests.len() };
        for expected_test in tests {
            let cell = |condition: &Value| {
                let time = expected_test["time"].as_str().unwrap();
                table.cell(table.cell_with(&[condition.as_str().unwrap(), time]).unwrap())
            };
            let (from, to) = (cell(&expected["from"]), cell(&expected["to"]));
            let test = paired_t(from, to, &family).unwrap();
            let close = |found: f64, what: &str, relative: f64| {
                assert_close(found, number(&expected_test[what]), relative, what);
            };
            close(test.t, "t", SUMS);
            close(test.df as f64, "df", 0.0);
            close(test.p, "p", P);
            close(test.p_bonferroni, "p_bonferroni", P);
            let interval = numbers(&expected_test["difference_ci95"]);
            for (found, expected) in test.difference_ci95.into_iter().zip(interval) {
                assert_close(found, expected, SUMS, "interval");
            }
            let describe = |values| Description::new(values).unwrap();
            close(cohens_d(&describe(from), &describe(to)).unwrap(), "d_av", SUMS);
        }
    }
}

#[track_caller]
fn assert_shapiro(w: f64, p: f64, expected: &Value, name: &str) {
    // scipy computes the weights from a normal quantile with seven digits.
    assert!((w - number(&expected["w"])).abs() < 2e-9, "{name}: W {w} instead of {expected}");
    // At p = 1e-37 the error of W is amplified 300 times; at ordinary p it is 1e-8.
    assert_close(p, number(&expected["p"]), 1e-6, name);
}

#[test]
fn shapiro_and_wilks_test_agrees_with_scipy() {
    let rows = input("normality", &["sample", "value"]);
    let mut samples = oracle("shapiro_wilk");
    for (name, expected) in samples.as_object_mut().unwrap() {
        let values: Vec<f64> = match &name[..] {
            "1 to 5000" => (1..=5000).map(f64::from).collect(),
            _ => rows
                .iter()
                .filter(|row| row[0] == *name)
                .map(|row| row[1].parse().unwrap())
                .collect(),
        };
        let found = shapiro_wilk(&values).unwrap();
        assert_shapiro(found.w, found.p, expected, name);
    }
    assert_eq!(samples.as_object().unwrap().len(), 18);
}

fn assert_line(found: &Line, expected: &Value) {
    let correlation = found.correlation.unwrap();
    for (found, what) in [
        (found.slope, "slope"),
        (found.slope_se, "slope_se"),
        (found.intercept, "intercept"),
        (found.intercept_se, "intercept_se"),
        (correlation.r, "r"),
    ] {
        assert_close(found, number(&expected[what]), SUMS, what);
    }
    // scipy's p for a correlation of 0.998 over 300 pairs is 0.
    match number(&expected["p"]) {
        0.0 => assert!(correlation.p < 1e-300),
        p => assert_close(correlation.p, p, P, "p"),
    }
}

#[test]
fn lines_and_differences_agree_with_scipy() {
    let rows = input("agreement", &["reference", "measured"]);
    let column = |at: usize| rows.iter().map(|row| row[at].parse().unwrap()).collect::<Vec<f64>>();
    let (reference, measured) = (column(0), column(1));
    let expected = oracle("agreement");
    let n = reference.len() as f64;
    assert_line(&line(&reference, &measured, n).unwrap(), &expected["regression"]);
    let found = bland_altman(&reference, &measured, n).unwrap();
    assert_line(&found.proportional.unwrap(), &expected["proportional"]);
    assert_close(found.bias, number(&expected["bias"]), SUMS, "bias");
    assert_close(found.sd, number(&expected["sd"]), SUMS, "sd");
    for (found, expected) in found.bias_ci95.into_iter().zip(numbers(&expected["bias_ci95"])) {
        assert_close(found, expected, SUMS, "interval of the bias");
    }
}

#[test]
fn exact_intervals_of_limits_agree_with_the_noncentral_t_of_scipy() {
    for row in oracle("limit_quantiles").as_array().unwrap() {
        let [n, inner, outer] = numbers(row)[..] else { panic!("{row}") };
        // Half of the differences are -1, half 1, divided by their spread.
        let zero = vec![0.0; n as usize + 1];
        let sides: Vec<f64> =
            (0..zero.len()).map(|at| if at % 2 == 0 { -1.0 } else { 1.0 }).collect();
        let found = bland_altman(&zero, &sides, n).unwrap();
        let quantiles = found.upper_limit.ci95_exact.map(|it| (it - found.bias) / found.sd);
        assert_close(quantiles[0], inner, 1e-13, &format!("inner, n = {n}"));
        assert_close(quantiles[1], outer, 1e-13, &format!("outer, n = {n}"));
        let lower = found.lower_limit.ci95_exact.map(|it| (found.bias - it) / found.sd);
        assert_close(lower[0], quantiles[1], 1e-14, "symmetry");
        assert_close(lower[1], quantiles[0], 1e-14, "symmetry");
    }
}

/// Compares a function of the leading numbers of each row with the last number of the row.
fn assert_rows(section: &str, name: &str, relative: f64, of: impl Fn(&[f64]) -> f64) {
    let table = oracle(section)[name].clone();
    let rows = table.as_array().unwrap();
    assert!(rows.len() > 7);
    for row in rows {
        let row = numbers(row);
        let (expected, arguments) = row.split_last().unwrap();
        assert_close(of(arguments), *expected, relative, &format!("{name} {arguments:?}"));
    }
}

#[test]
fn tails_keep_their_digits_down_to_1e_300() {
    // The worst case has thousands of degrees of freedom, where the logarithms in the leading
    // factor of the incomplete beta function cancel.
    assert_rows("tails", "f", 1e-11, |it| f_upper(it[0], it[1], it[2]));
    assert_rows("tails", "t", 5e-12, |it| t_upper(it[0], it[1]));
    assert_rows("tails", "chi_squared", 5e-13, |it| chi_squared_upper(it[0], it[1]));
    // The rounding of z / sqrt(2), times z^2.
    assert_rows("tails", "normal", 3e-13, |it| normal_upper(it[0]));
}

#[test]
fn quantiles_are_where_the_tails_are() {
    // The error of the tail, divided by the slope of its logarithm at the quantile.
    assert_rows("quantiles", "t", 5e-11, |it| t_quantile(it[0], it[1]));
    assert_rows("quantiles", "normal", 1e-15, |it| normal_quantile(it[0]));
}
