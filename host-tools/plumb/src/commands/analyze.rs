//! `plumb analyze`: the sway figures of a trial.

use std::io::Write as _;
use std::ops::Range;
use std::path::PathBuf;

use clap::Args;
use plumbline_analysis::sway::{Settings, density};
use plumbline_files::columns::Delimiter;
use plumbline_files::write_all;
use plumbline_study::analysis::{Analysis, tables};
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::Points;
use plumbline_trial::positions::{Columns, Table, Unit};

/// Window of the paper's filter.
const FILTER_S: f64 = 0.5;

/// The sway figures of a trial: path length, extent, ellipse, frequencies, and more.
///
/// The positions are filtered as in the paper (Savitzky-Golay, second order, 0.5 s), and again
/// left as they are: both are in the JSON. Each figure comes with its uncertainty from the
/// poses' covariance, and each path with the length that the noise alone would give. Nothing is
/// interpolated over gaps.
///
/// A table of another system, such as a force plate, gets the same figures with --table.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("input").required(true).args(["trial", "table"])))]
#[command(after_help = "Examples:\n  plumb analyze trials/p01-control\n  \
    plumb analyze trials/p01-control --bins 0-30,30-60 --json p01.json\n  \
    plumb analyze --table plate.txt --columns 'time=Time[s],ap=COPx[cm],ml=COPy[cm]' --unit cm \\\n      \
    --delimiter tab --json plate.json")]
pub struct Arguments {
    /// The trial's folder
    pub trial: Option<PathBuf>,

    /// A table of positions instead (text; .gz is unpacked)
    #[arg(long, value_name = "FILE", requires_all = ["columns", "unit"])]
    pub table: Option<PathBuf>,

    /// The table's columns, as its own header names them: time=NAME,ap=NAME,ml=NAME,si=NAME
    #[arg(long, value_parser = Columns::parse, requires = "table")]
    pub columns: Option<Columns>,

    /// The unit of the table's positions
    #[arg(long, requires = "table")]
    pub unit: Option<Unit>,

    /// What separates the table's columns [default: the one with which they are found]
    #[arg(long, requires = "table")]
    pub delimiter: Option<Delimiter>,

    /// How figures are made.
    #[command(flatten)]
    pub method: Method,

    /// What t = 0 is [default: as trial.toml says]
    #[arg(long, conflicts_with = "table")]
    pub zero: Option<Zero>,

    /// Write all figures, with the settings that they were made with, into this file
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,

    /// Replace the file of --json if it exists
    #[arg(long, requires = "json")]
    pub force: bool,
}

/// How figures are made. What is not given is as in the paper; it is no default of clap's, so that
/// a command can refuse what it has no use for.
#[derive(Debug, Clone, Default, Args)]
pub struct Method {
    /// Window of the filter, seconds [default: 0.5]
    #[arg(long, value_name = "SECONDS")]
    pub filter: Option<f64>,

    /// Times that have their own path length, seconds from t = 0 [default: 0-20,20-40,40-60]
    #[arg(
        long,
        value_name = "FROM-TO,...",
        value_delimiter = ',',
        value_parser = span,
        allow_hyphen_values = true
    )]
    pub bins: Vec<Range<f64>>,

    /// Analyse this time only, seconds from t = 0 [default: all]
    #[arg(long, value_name = "FROM-TO", value_parser = span, allow_hyphen_values = true)]
    pub span: Option<Range<f64>>,

    /// Radius of the sway density, mm [default: 3]
    #[arg(long, value_name = "MM")]
    pub radius: Option<f64>,
}

/// A span of time, `FROM-TO`; a start before t = 0 is negative, as in `-5-0`.
fn span(text: &str) -> Result<Range<f64>, String> {
    let remedy = || format!("{text:?} is no span: give FROM-TO in seconds, such as 0-20");
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
        let Self { filter, bins, span, radius } = self;
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
        self.filter.unwrap_or(FILTER_S)
    }

    /// The settings of the filtered figures.
    #[must_use]
    pub fn settings(&self) -> Settings {
        let paper = Settings::default();
        let radius_mm = self.radius.unwrap_or(paper.density.radius_mm);
        Settings {
            filter_s: Some(self.filter_s()),
            span_s: self.span.clone(),
            bins_s: if self.bins.is_empty() { paper.bins_s } else { self.bins.clone() },
            density: density::Settings { radius_mm },
        }
    }
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial or the table cannot be used, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let points = match (&arguments.table, &arguments.trial) {
        (Some(path), _) => {
            let (Some(columns), Some(unit)) = (arguments.columns.clone(), arguments.unit) else {
                unreachable!("--table requires both");
            };
            let delimiter = arguments.delimiter;
            Points::of_table(&Table { path: path.clone(), columns, unit, delimiter })?
        }
        (None, Some(folder)) => Points::of_trial(folder, arguments.zero)?,
        (None, None) => unreachable!("one of both is required"),
    };
    let analysis =
        Analysis::of(&points, arguments.method.filter_s(), &arguments.method.settings())?;
    for warning in &analysis.warnings {
        eprintln!("warning: {warning}");
    }
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&analysis)? + "\n";
        write_all(&[(path.clone(), text.into_bytes())], arguments.force)?;
    }
    // A closed pipe must not hide the result.
    let _ = write!(std::io::stdout(), "{}", tables::text(&analysis));
    Ok(())
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
        let command = clap::Command::new("analyze").term_width(0);
        let help = Arguments::augment_args(command).render_help().to_string();
        let bins: Vec<String> =
            paper.bins_s.iter().map(|it| format!("{}-{}", it.start, it.end)).collect();
        let radius_mm = paper.density.radius_mm;
        for default in [FILTER_S.to_string(), bins.join(","), radius_mm.to_string()] {
            assert!(help.contains(&format!("[default: {default}]")), "no {default}: {help}");
        }
    }
}
