//! The options that say how a trial's figures are made.

use std::ops::Range;

use clap::Args;
use plumbline_analysis::sway::{Settings, density};

/// Window of the paper's filter.
const FILTER_S: f64 = 0.5;

/// What figures are of. What is not given is as in the paper; clap has no defaults here, so that
/// a command can refuse options that it has no use for.
#[derive(Debug, Clone, Default, Args)]
pub struct Window {
    /// Window of the filter, seconds [default: 0.5]
    #[arg(long, value_name = "SECONDS")]
    filter: Option<f64>,

    /// Analyse this time only, seconds from t = 0 [default: all]
    #[arg(long, value_name = "FROM-TO", value_parser = span, allow_hyphen_values = true)]
    span: Option<Range<f64>>,
}

impl Window {
    /// Window of the filter, seconds.
    #[must_use]
    pub fn filter_s(&self) -> f64 {
        self.filter.unwrap_or(FILTER_S)
    }

    /// The settings of filtered figures, the others as in the paper.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let (filter_s, span_s) = (Some(self.filter_s()), self.span.clone());
        Settings { filter_s, span_s, ..Settings::default() }
    }
}

/// How figures are made.
#[derive(Debug, Clone, Default, Args)]
pub struct Method {
    /// What they are of.
    #[command(flatten)]
    window: Window,

    /// Times that each get a path length of their own, seconds from t = 0 [default: 0-20,20-40,40-60]
    #[arg(
        long,
        value_name = "FROM-TO,...",
        value_delimiter = ',',
        value_parser = span,
        allow_hyphen_values = true
    )]
    bins: Vec<Range<f64>>,

    /// Radius of the sway density, mm [default: 3]
    #[arg(long, value_name = "MM")]
    radius: Option<f64>,
}

/// A span of time, `FROM-TO`; a start before t = 0 is negative, as in `-5-0`.
fn span(text: &str) -> Result<Range<f64>, String> {
    let remedy = || format!("{text:?} is not a span: give FROM-TO in seconds, such as 0-20");
    // A minus that begins the text is a sign.
    let dash = text.char_indices().skip(1).find(|(_, it)| *it == '-').map(|(at, _)| at);
    let (from, to) = text.split_at(dash.ok_or_else(remedy)?);
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|it| it.is_finite());
    match (number(from), number(&to[1..])) {
        (Some(from), Some(to)) if from < to => Ok(from..to),
        _ => Err(remedy()),
    }
}

impl Method {
    /// The first option that is given.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let Self { window: Window { filter, span }, bins, radius } = self;
        let options = [
            ("--filter", filter.is_some()),
            ("--bins", !bins.is_empty()),
            ("--span", span.is_some()),
            ("--radius", radius.is_some()),
        ];
        options.into_iter().find_map(|(option, is_given)| is_given.then_some(option))
    }

    /// Window of the filter, seconds.
    #[must_use]
    pub fn filter_s(&self) -> f64 {
        self.window.filter_s()
    }

    /// The settings of the filtered figures.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let paper = self.window.settings();
        let radius_mm = self.radius.unwrap_or(paper.density.radius_mm);
        let bins_s = if self.bins.is_empty() { paper.bins_s.clone() } else { self.bins.clone() };
        Settings { bins_s, density: density::Settings { radius_mm }, ..paper }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_two_times_in_order() {
        assert_eq!(span("0-20"), Ok(0.0..20.0));
        assert_eq!(span("-5-0.5"), Ok(-5.0..0.5));
        assert_eq!(span("-5--2"), Ok(-5.0..-2.0));
        for text in ["", "5", "-", "20-0", "0-inf", "a-b", "0-0"] {
            assert!(span(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_help_tells_the_papers_settings() {
        let paper = Settings::default();
        assert_eq!(Method::default().settings(), paper);
        let command = clap::Command::new("figures").term_width(0);
        let help = Method::augment_args(command).render_help().to_string();
        let bins: Vec<String> =
            paper.bins_s.iter().map(|it| format!("{}-{}", it.start, it.end)).collect();
        let radius_mm = paper.density.radius_mm;
        for default in [FILTER_S.to_string(), bins.join(","), radius_mm.to_string()] {
            assert!(help.contains(&format!("[default: {default}]")), "no {default}: {help}");
        }
    }
}
