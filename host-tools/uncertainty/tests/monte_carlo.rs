//! The combined uncertainty against a propagation of distributions, GUM supplement 1 (JCGM
//! 101:2008): one movement, measured again and again with errors drawn anew, and its errors taken.

use plumbline_uncertainty::Budget;
use plumbline_uncertainty::inputs::Inputs;
use rayon::prelude::*;

use super::world::{Errors, Movement, Random, Simulated, aligned, figures, name, trial};

const DRAWS: u64 = 300;

/// The budget is that of one of the draws; its own noise changes it by a few percent.
const BUDGETS: usize = 10;

/// The standard deviation of 300 draws is known to 4 %, and the budget's parts that are standard
/// deviations of noisy copies to 11 %.
const RATIO_OFF_MAX: f64 = 0.15;

#[test]
fn the_combined_uncertainty_is_that_of_a_monte_carlo_propagation() {
    let (inputs, settings) = (Inputs::default(), aligned());
    let measure = |seed: u64| {
        let mut same = Random::new(77);
        let movements = [(); 2].map(|()| Movement::of_person(&mut same));
        let mut random = Random::new(seed);
        let errors = Errors::draw(&inputs, 0.0, &mut random);
        trial(&movements, &errors, &inputs, &settings, &mut random)
    };
    let draws: Vec<Simulated> = (1..=DRAWS).into_par_iter().map(measure).collect();
    let budgets: Vec<Budget> = draws[..BUDGETS]
        .par_iter()
        .map(|it| Budget::of(&it.measured, &inputs, &settings, "a simulated trial").unwrap())
        .collect();
    // The errors of the measured figures. Known effects are nearly the same in all of them.
    let errors = |it: &Simulated| -> Vec<f64> {
        let measured = figures(&it.measured.bodies, &settings);
        measured.iter().zip(&it.truth).map(|(measured, truth)| measured - truth).collect()
    };
    let values: Vec<Vec<f64>> = draws.par_iter().map(errors).collect();
    let count = DRAWS as f64;
    let mut off = Vec::new();
    for (at, figure) in budgets[0].figures.iter().take(values[0].len()).enumerate() {
        let mean = values.iter().map(|it| it[at]).sum::<f64>() / count;
        let squares: f64 = values.iter().map(|it| (it[at] - mean).powi(2)).sum();
        let sd = (squares / (count - 1.0)).sqrt();
        let u = budgets.iter().map(|it| it.figures[at].u).sum::<f64>() / BUDGETS as f64;
        let name = name(figure);
        println!(
            "{name}: mean error {mean:.5}, u {u:.5}, Monte Carlo {sd:.5}, ratio {:.3}",
            u / sd
        );
        for it in &figure.contributions {
            println!("  {:?} {:.5}", it.term, it.u);
        }
        if (u / sd - 1.0).abs() > RATIO_OFF_MAX {
            off.push(name);
        }
    }
    assert!(off.is_empty(), "{off:?}");
}
