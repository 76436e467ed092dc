//! What the screen shows, as it is at one moment: for a terminal of any size, and as one line.

use std::time::Duration;

use super::judgement::Judgement;
use super::sway::{AXES, Along, Movement};

/// One moment of a reception.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Seen {
    /// The trial, the participant and the condition.
    pub(super) title: Vec<String>,
    pub(super) judgement: Judgement,
    pub(super) elapsed: Duration,
    /// Until the end, where it is known.
    pub(super) remaining: Option<Duration>,
    /// The times in words.
    pub(super) time: String,
    /// Empty without a pose.
    pub(super) movement: Vec<Movement>,
    /// From where movement counts.
    pub(super) since: &'static str,
    /// Rate, losses and so on, the most important first.
    pub(super) counts: Vec<String>,
    /// What is being typed, where marks can be typed.
    pub(super) typed: Option<String>,
}

impl Seen {
    /// All of it in one line.
    pub(super) fn line(&self) -> String {
        let Judgement { word, reasons } = &self.judgement;
        let judgement = word.map(|word| word.text().to_owned());
        let reasons: Vec<&str> = reasons.iter().map(|why| &*why.words).collect();
        let judgement: Vec<String> = judgement.into_iter().chain([reasons.join(", ")]).collect();
        let judgement = judgement.iter().filter(|it| !it.is_empty()).cloned().collect::<Vec<_>>();
        let mut parts = vec![self.time.clone(), judgement.join(": "), self.counts.join(", ")];
        parts.extend(self.movement.iter().map(numbers));
        parts.retain(|part| !part.is_empty());
        parts.join("; ")
    }
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

/// A zero, to a tenth, has no sign that flickers.
pub(super) fn no_minus_zero(value_mm: f64) -> f64 {
    if value_mm.abs() < 0.05 { 0.0 } else { value_mm }
}
