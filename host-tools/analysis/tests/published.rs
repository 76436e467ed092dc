//! Published tables are reproduced.

use crate::common::design_of;
use crate::common::table_2::CONDITIONS;
use nalgebra::DMatrix;
use plumbline_analysis::statistics::anova::anova;
use plumbline_analysis::statistics::bland_altman::bland_altman;
use plumbline_analysis::statistics::describe::{cohens_d, cousineau_morey};
use plumbline_analysis::statistics::within::WithinDesign;

const TIMES: [&str; 3] = ["T1", "T2", "T3"];

/// A table of these factors, from one value per subject and cell.
fn table(factors: &[&str], levels: &[Vec<&str>], values: &DMatrix<f64>) -> WithinDesign {
    let mut rows = Vec::new();
    for (subject, row) in values.row_iter().enumerate() {
        for (value, levels) in row.iter().zip(levels) {
            let head = [format!("P{subject}"), value.to_string()];
            rows.push(head.into_iter().chain(levels.iter().map(|&it| it.to_owned())).collect());
        }
    }
    design_of(factors, &rows)
}

#[test]
fn the_papers_table_2_comes_out_of_a_study_with_its_means_and_errors() {
    let rows: Vec<Vec<f64>> =
        crate::common::table_2::rows().into_iter().map(|(_, row)| row).collect();
    let levels: Vec<Vec<&str>> = CONDITIONS
        .iter()
        .flat_map(|&condition| TIMES.iter().map(move |&time| vec![condition, time]))
        .collect();
    let mut compared = 0;
    for times in rows.chunks(TIMES.len()) {
        for part in [0, 5] {
            let column =
                |at: usize| times.iter().map(move |row| row[part + at]).collect::<Vec<_>>();
            let means = [column(0), column(2)].concat();
            let sems = [column(1), column(3)].concat();
            let table = table(
                &["condition", "time"],
                &levels,
                &crate::common::table_2::study(&means, &sems),
            );
            let cells = cousineau_morey(&table).unwrap();
            for (cell, (mean, sem)) in cells.iter().zip(means.iter().zip(&sems)) {
                assert!((cell.mean - mean).abs() < 1e-12 * mean, "{cell:?} {mean}");
                assert!((cell.sem - sem).abs() < 1e-12 * sem, "{cell:?} {sem}");
            }
            for (time, expected) in column(4).into_iter().enumerate() {
                let d = cohens_d(&cells[time], &cells[TIMES.len() + time]).unwrap();
                // The authors computed from means and errors with all digits: rounding them as
                // printed changes d by up to 0.016, most where the errors are small.
                assert!((d - expected).abs() < 0.016, "d {d} instead of {expected}");
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 36);
}

#[test]
fn loftus_and_massons_example() {
    // Loftus & Masson (1994), table 2: words recalled after 1, 2 and 5 s by ten subjects. Their
    // table 3: F(2, 18) = 42.51, mean squares 26.13 and 0.61.
    const RECALLED: [[f64; 3]; 10] = [
        [10.0, 13.0, 13.0],
        [6.0, 8.0, 8.0],
        [11.0, 14.0, 14.0],
        [22.0, 23.0, 25.0],
        [16.0, 18.0, 20.0],
        [15.0, 17.0, 17.0],
        [1.0, 1.0, 4.0],
        [12.0, 15.0, 17.0],
        [9.0, 12.0, 12.0],
        [8.0, 9.0, 12.0],
    ];
    let values = DMatrix::from_row_slice(10, 3, RECALLED.as_flattened());
    let levels = [vec!["1"], vec!["2"], vec!["5"]];
    let table = table(&["exposure"], &levels, &values);
    let it = anova(&table).unwrap();
    let effect = &it.effects[0];
    assert_eq!((effect.df, effect.error_df), (2, 18));
    assert!((effect.test.as_ref().unwrap().f - 42.51).abs() < 0.005);
    assert!((effect.sum_of_squares / 2.0 - 26.13).abs() < 0.005);
    assert!((effect.error_sum_of_squares / 18.0 - 0.61).abs() < 0.005);
    let cells = cousineau_morey(&table).unwrap();
    for (cell, mean) in cells.iter().zip([11.0, 13.0, 14.2]) {
        assert!((cell.mean - mean).abs() < 1e-14 * mean);
    }
}

#[test]
fn bland_and_altmans_example() {
    // Bland & Altman (1986), table 1: peak expiratory flow of 17 people, measured with Wright's
    // meter and a mini meter, first readings, l/min.
    const LARGE: [f64; 17] = [
        494.0, 395.0, 516.0, 434.0, 476.0, 557.0, 413.0, 442.0, 650.0, 433.0, 417.0, 656.0, 267.0,
        478.0, 178.0, 423.0, 427.0,
    ];
    const MINI: [f64; 17] = [
        512.0, 430.0, 520.0, 428.0, 500.0, 600.0, 364.0, 380.0, 658.0, 445.0, 432.0, 626.0, 260.0,
        477.0, 259.0, 350.0, 451.0,
    ];
    let it = bland_altman(&MINI, &LARGE, 17.0).unwrap();
    let near = |found: f64, printed: f64, within: f64| {
        assert!((found - printed).abs() <= within, "{found} instead of {printed}");
    };
    near(it.bias, -2.1, 0.05);
    near(it.sd, 38.8, 0.05);
    near(it.bias_ci95[0], -22.0, 0.1);
    near(it.bias_ci95[1], 17.8, 0.1);
    // They use 2 sd instead of 1.96 sd, so the limits are computed from their bias and sd, each
    // printed to 0.05: 0.05 + 1.96 x 0.05.
    let (lower, upper) = (-2.1 - 1.96 * 38.8, -2.1 + 1.96 * 38.8);
    near(it.lower_limit.value, lower, 0.15);
    near(it.upper_limit.value, upper, 0.15);
    // They use sqrt(3 / n) for the standard error of the limits over sd, which is sqrt(1 / n +
    // 1.96^2 / (2 (n - 1))) (Bland & Altman 1999): half of -45.1 + 114.3, times the ratio of both.
    // Both ends are printed to 0.05, and so is the error of 16.3 that they multiply by 2.12.
    let half = 34.6 * f64::sqrt((1.0 / 17.0 + 1.96 * 1.96 / 32.0) / (3.0 / 17.0));
    let [from, to] = it.lower_limit.ci95_approximate;
    near((to - from) / 2.0, half, 0.05 + 2.12 * 0.05);
    near((from + to) / 2.0, lower, 0.15);
}
