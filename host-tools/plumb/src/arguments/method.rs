//! The options that say how a trial's figures are made.

use std::ops::Range;

use clap::Args;
use plumbline_analysis::filter::Design;
use plumbline_analysis::sway::Settings;
use plumbline_study::method::{Choice, Part};
use plumbline_trial::points::Points;

/// What figures are of. What is not given is as in the paper; clap has no defaults here, so that
/// a command can refuse options that it has no use for.
#[derive(Debug, Clone, Default, Args)]
pub struct Window {
    /// The filter: paper[:SECONDS], butterworth:HZ[:ORDER], or none [default: paper:0.5]
    ///
    /// paper: Savitzky and Golay, second order, with a window of SECONDS; near an end, the parabola
    /// of the first or last whole window. butterworth: two passes, forwards and backwards, so that
    /// nothing is delayed; HZ and ORDER (2 unless given) are those of each pass, as in scipy's
    /// sosfiltfilt and MATLAB's filtfilt, without a correction: both together halve the amplitude at
    /// HZ and attenuate like twice the ORDER, and the tables state where they are at -3 dB. Ends are
    /// extended by 3 (ORDER + 1) samples, rotated about the end point. Each part without a gap is
    /// filtered alone; samples in parts that are too short are left out and counted.
    #[arg(long, value_name = "FILTER", allow_hyphen_values = true)]
    filter: Option<Design>,

    /// Analyse this time only: FROM-TO in seconds from t = 0, or all [default: from t = 0 on where a
    /// mark or the stand onset sets it, otherwise all]
    #[arg(long, value_name = "FROM-TO", value_parser = part, allow_hyphen_values = true)]
    span: Option<Part>,
}

impl Window {
    /// The settings for these points, the others as in the paper.
    #[must_use]
    pub fn settings(&self, points: &Points) -> Settings {
        self.choice().settings(points)
    }

    fn choice(&self) -> Choice {
        Choice { filter: self.filter, part: self.span.clone(), ..Choice::default() }
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

    /// The share of a time bin that must have been measured for it to have a path length, percent
    /// [default: 90]
    ///
    /// A path is not scaled up for what is missing. A bin with less has no value, and its note says
    /// how much it has.
    #[arg(long, value_name = "PERCENT", value_parser = percent, allow_hyphen_values = true)]
    covered_min: Option<f64>,

    /// Radius of the sway density, mm [default: 3]
    #[arg(long, value_name = "MM")]
    radius: Option<f64>,
}

/// What is analysed: `all`, or a span.
fn part(text: &str) -> Result<Part, String> {
    if text.trim() == "all" {
        return Ok(Part::All);
    }
    span(text).map(Part::Between).map_err(|remedy| format!("{remedy}, or all"))
}

/// A share in percent, as a fraction.
fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim().parse::<f64>().ok();
    let share = number.filter(|it| (0.0..=100.0).contains(it)).map(|it| it / 100.0);
    share.ok_or_else(|| format!("{text:?} is not a share: give 0 to 100 percent, such as 90"))
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
        let Self { window: Window { filter, span }, bins, covered_min, radius } = self;
        let options = [
            ("--filter", filter.is_some()),
            ("--bins", !bins.is_empty()),
            ("--covered-min", covered_min.is_some()),
            ("--span", span.is_some()),
            ("--radius", radius.is_some()),
        ];
        options.into_iter().find_map(|(option, is_given)| is_given.then_some(option))
    }

    /// The settings for these points.
    #[must_use]
    pub fn settings(&self, points: &Points) -> Settings {
        let choice = Choice {
            bins_s: self.bins.clone(),
            covered_min: self.covered_min,
            radius_mm: self.radius,
            ..self.window.choice()
        };
        choice.settings(points)
    }
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory as _, Parser};

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        method: Method,
    }

    fn settings(arguments: &[&str], is_zero_set: bool) -> Settings {
        let points = Points {
            place: String::new(),
            points: Vec::new(),
            zero: String::new(),
            zero_s: 0.0,
            is_zero_set,
            zero_utc_s: None,
            verdict: None,
            events: Vec::new(),
            warnings: Vec::new(),
        };
        let command = Command::try_parse_from([&["figures"], arguments].concat());
        command.unwrap_or_else(|error| panic!("{error}")).method.settings(&points)
    }

    #[test]
    fn a_span_is_two_times_in_order() {
        assert_eq!(span("0-20"), Ok(0.0..20.0));
        assert_eq!(span("-5-0.5"), Ok(-5.0..0.5));
        assert_eq!(span("-5--2"), Ok(-5.0..-2.0));
        for text in ["", "5", "-", "20-0", "0-inf", "a-b", "0-0"] {
            assert!(span(text).is_err() && part(text).is_err(), "{text}");
        }
    }

    #[test]
    fn figures_are_of_what_follows_a_zero_that_was_set() {
        assert_eq!(settings(&[], true).span_s, Some(0.0..f64::INFINITY));
        assert_eq!(settings(&[], false).span_s, None);
        for is_zero_set in [true, false] {
            assert_eq!(settings(&["--span", "all"], is_zero_set).span_s, None);
            assert_eq!(settings(&["--span", "-5-5"], is_zero_set).span_s, Some(-5.0..5.0));
        }
    }

    #[test]
    fn a_filter_is_named_with_its_numbers() {
        let of = |text: &str| settings(&["--filter", text], false).filter;
        let butterworth = |cutoff_hz, order| Design::Butterworth { cutoff_hz, order };
        assert_eq!((of("none"), of("paper")), (Design::None, Design::PAPER));
        assert_eq!(of("paper:1.5"), Design::SavitzkyGolay { window_s: 1.5 });
        assert_eq!(of("butterworth:10"), butterworth(10.0, 2));
        assert_eq!(of("butterworth:12.5:4"), butterworth(12.5, 4));
        let wrong = ["", "0", "0.5", "-1", "paper:0", "paper:nan", "paper:1:2", "butterworth"];
        let more = ["butterworth:-5", "butterworth:5:x", "butterworth:inf", "butterworth:5:-1"];
        for text in wrong.into_iter().chain(more) {
            let error = text.parse::<Design>().unwrap_err();
            assert!(error.contains("paper:0.5 or butterworth:10"), "{error}");
        }
    }

    #[test]
    fn a_share_is_a_percentage() {
        let of = |text: &str| settings(&["--covered-min", text], false).covered_min;
        assert_eq!((of("75"), of("0"), of("100 %")), (0.75, 0.0, 1.0));
        for text in ["101", "-1", "nan", "much"] {
            assert!(percent(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_help_tells_the_papers_settings() {
        let paper = Settings::default();
        assert_eq!(settings(&[], false), paper);
        let help = Command::command().term_width(0).render_help().to_string();
        let bins: Vec<String> =
            paper.bins_s.iter().map(|it| format!("{}-{}", it.start, it.end)).collect();
        let radius_mm = paper.density.radius_mm;
        let covered_min = format!("{:.0}", 100.0 * paper.covered_min);
        for default in [bins.join(","), radius_mm.to_string(), covered_min] {
            assert!(help.contains(&format!("[default: {default}]")), "no {default}: {help}");
        }
        let (_, default) = help.split_once("none [default: ").unwrap();
        assert_eq!(default.split(']').next().unwrap().parse(), Ok(paper.filter));
    }
}
