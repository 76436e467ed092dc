//! How the figures of a trial are made: what a person has chosen, and for the rest the paper's
//! settings.

use std::ops::Range;

use plumbline_analysis::filter::Design;
use plumbline_analysis::sway::{Settings, density};
use plumbline_trial::points::Points;

/// A part of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Part {
    /// All of it.
    All,
    /// The time from and to these seconds from t = 0.
    Between(Range<f64>),
}

/// What a person has chosen; what is absent is as in the paper.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Choice {
    /// The filter of the positions.
    pub filter: Option<Design>,
    /// The time that is analysed; without it, from t = 0 on where anything has set that, otherwise
    /// all.
    pub part: Option<Part>,
    /// Intervals with a path length each, seconds from t = 0; empty: those of the paper.
    pub bins_s: Vec<Range<f64>>,
    /// The share of an interval that must have been measured, 0 to 1.
    pub covered_min: Option<f64>,
    /// The radius of the sway density.
    pub radius_mm: Option<f64>,
}

impl Choice {
    /// The settings for these points.
    #[must_use]
    pub fn settings(&self, points: &Points) -> Settings {
        let paper = Settings::default();
        let span_s = match &self.part {
            None => points.usual_span_s(),
            Some(Part::All) => None,
            Some(Part::Between(span_s)) => Some(span_s.clone()),
        };
        let radius_mm = self.radius_mm.unwrap_or(paper.density.radius_mm);
        Settings {
            filter: self.filter.unwrap_or_default(),
            span_s,
            bins_s: if self.bins_s.is_empty() { paper.bins_s } else { self.bins_s.clone() },
            covered_min: self.covered_min.unwrap_or(paper.covered_min),
            density: density::Settings { radius_mm },
        }
    }
}
