//! Spans at the ends of a trial whose t = 0 is uncertain.

use std::ops::Range;

use plumbline_analysis::sway::Settings;
use plumbline_files::BadInput;
use plumbline_uncertainty::inputs::Inputs;
use plumbline_uncertainty::{Budget, TermName};

use super::world::{DURATION_S, Errors, Movement, Random, inner, name, trial};

/// What the time of t = 0 contributes to each figure of a span, by the figures' names.
fn of_zero(span_s: Range<f64>, zero_u_s: f64) -> Result<Vec<(String, f64)>, BadInput> {
    let inputs = Inputs::default();
    let mut random = Random::new(5);
    let movements = [(); 2].map(|()| Movement::of_person(&mut random));
    let errors = Errors::draw(&inputs, 0.0, &mut random);
    let mut measured = trial(&movements, &errors, &inputs, &inner(), &mut random).measured;
    measured.zero_u_s = Some(zero_u_s);
    let settings = Settings { span_s: Some(span_s), ..inner() };
    let budget = Budget::of(&measured, &inputs, &settings, "p01")?;
    let figures = budget.figures.iter().map(|it| {
        let zero = it.contributions.iter().find(|part| part.term == TermName::Zero).unwrap();
        (name(it), zero.u)
    });
    Ok(figures.collect())
}

/// A span that begins 0.15 s before the trial's end is empty if t = 0 is 0.2 s later. Its path then
/// changes by what is walked in that time: some millimetres per second.
#[test]
fn a_span_at_the_end_of_a_trial_is_shifted_the_way_that_is_left() {
    let found = of_zero(DURATION_S - 0.15..DURATION_S + 1.0, 0.2).unwrap();
    let (name, u_mm) = &found[3];
    assert_eq!(name, "lower path length transverse");
    assert!((0.1..10.0).contains(u_mm), "{u_mm}");
    // The same span by its own end, and at the trial's beginning.
    assert!(of_zero(DURATION_S - 0.15..DURATION_S, 0.2).is_ok());
    assert!(of_zero(-1.0..0.15, 0.2).is_ok());
}

#[test]
fn a_span_that_is_lost_in_the_uncertainty_is_refused_with_what_to_do() {
    // If t = 0 is wrong by as much as the trial lasts, the span is before it or after it.
    let error = of_zero(0.0..DURATION_S, DURATION_S).unwrap_err();
    assert!(error.found.contains("12.000 s earlier or later"), "{error}");
    assert!(error.place == "p01" && error.remedy.contains("--span"), "{error}");
}
