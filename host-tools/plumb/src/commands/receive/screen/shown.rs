//! What the screen shows at one moment, and the same as one line.

use plumbline_bedside::recording::{AXES, Along, Judgement, Movement, NotYet, Seen, TrunkFigures};

/// One moment, for a terminal of any size.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shown {
    /// The trial, the participant and the condition.
    pub(super) title: Vec<String>,
    pub(super) seen: Seen,
    /// What is being typed, where marks can be typed.
    pub(super) typed: Option<String>,
}

/// All of a moment in one line.
pub(super) fn line(seen: &Seen) -> String {
    let Judgement { word, reasons } = &seen.judgement;
    let judgement = word.map(|word| word.text().to_owned());
    let reasons: Vec<&str> = reasons.iter().map(|why| &*why.words).collect();
    let judgement: Vec<String> = judgement.into_iter().chain([reasons.join(", ")]).collect();
    let judgement = judgement.iter().filter(|it| !it.is_empty()).cloned().collect::<Vec<_>>();
    let mut parts = vec![seen.time.clone(), judgement.join(": "), seen.counts.join(", ")];
    parts.extend(seen.movement.iter().map(numbers));
    let known = seen.figures.iter().filter(|(_, so_far)| so_far.is_ok());
    parts.extend(known.map(|(trunk, so_far)| figures_in_words(trunk, so_far)));
    parts.retain(|part| !part.is_empty());
    parts.join("; ")
}

/// A trunk's movement in numbers.
pub(super) fn numbers(movement: &Movement) -> String {
    let along = match &movement.along {
        Ok(along) => {
            let number =
                |(axis, Along { now_mm, .. })| format!("{axis} {:>+6.1}", no_minus_zero(now_mm));
            let numbers: Vec<String> = AXES.iter().zip(*along).map(number).collect();
            format!("{} mm", numbers.join("  "))
        }
        Err(why) => (*why).to_owned(),
    };
    format!("{} trunk  {along}", movement.trunk)
}

/// A trunk's figures: path and RMS since t = 0, what noise alone would have given, gaps.
pub(super) fn figures_in_words(trunk: &str, so_far: &Result<TrunkFigures, NotYet>) -> String {
    let figures = match so_far {
        Ok(figures) => figures,
        Err(why) => return format!("{trunk} figures: {why}"),
    };
    let TrunkFigures { path_mm, noise_path_mm, rms_mm: [ap, ml, si], gaps, gaps_s, .. } = figures;
    let noise = noise_path_mm.map_or(String::new(), |mm| format!(" (noise {mm:.1})"));
    let gaps = match gaps {
        0 => "no gap".to_owned(),
        _ => format!("gaps {gaps} ({gaps_s:.1} s)"),
    };
    format!("{trunk} path {path_mm:.1} mm{noise}, RMS AP {ap:.2} ML {ml:.2} SI {si:.2}, {gaps}")
}

/// A zero, to a tenth, has no sign that flickers.
pub(super) fn no_minus_zero(value_mm: f64) -> f64 {
    if value_mm.abs() < 0.05 { 0.0 } else { value_mm }
}
