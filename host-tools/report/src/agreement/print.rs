//! The agreement for people: in a terminal and on a page.

use std::fmt::Write as _;

use plumbline_analysis::agreement::AxisAgreement;
use plumbline_analysis::statistics::bland_altman::Limit;
use plumbline_analysis::statistics::regression::Line;
use plumbline_study::grid::{Annotated, Footnotes, Grid};

use super::Validation;

/// In a terminal.
pub fn text(validation: &Validation) -> String {
    let mut text = String::new();
    for pair in &validation.pairs {
        // Writing to a String does not fail.
        let _ = writeln!(
            text,
            "{} and {}: {} samples over {:.1} s, {}",
            pair.trial,
            pair.reference,
            pair.samples,
            pair.length_s,
            pair.alignment()
        );
    }
    text += &table(validation).text();
    text += "[95 % confidence intervals, by the effective samples]\n";
    if validation.origins_aligned {
        text += "The origins were aligned, trial by trial: the bias is 0 by construction.\n";
    }
    text
}

/// One line for each figure, one column for each axis.
#[must_use]
pub(super) fn table(validation: &Validation) -> Annotated {
    let names = validation.axes.iter().map(|axis| axis.axis.to_owned());
    let header = ["camera less reference".to_owned()].into_iter().chain(names).collect();
    let mut notes = Footnotes::default();
    let mut rows = Vec::new();
    let mut row = |name: &str, cell: &dyn Fn(&AxisAgreement) -> Result<String, &'static str>| {
        let cells = validation.axes.iter().map(|axis| notes.stated(cell(axis)));
        rows.push([name.to_owned()].into_iter().chain(cells).collect());
    };
    row("bias (mm)", &|it| Ok(with_interval(it.bland_altman.bias, it.bland_altman.bias_ci95)));
    row("lower limit (mm)", &|it| Ok(limit(&it.bland_altman.lower_limit)));
    row("upper limit (mm)", &|it| Ok(limit(&it.bland_altman.upper_limit)));
    row("RMS difference (mm)", &|it| Ok(format!("{:.4}", it.rms_mm)));
    row("proportional error", &|it| {
        let line = it.bland_altman.proportional.ok_or("neither moves")?;
        let [low, high] = line.slope_ci95;
        Ok(format!("{:.5} [{low:.5}, {high:.5}]", line.slope))
    });
    let still = "the reference does not move";
    row("regression", &|it| it.regression.as_ref().map(equation).ok_or(still));
    row("slope", &|it| {
        let line = it.regression.ok_or(still)?;
        let [low, high] = line.slope_ci95;
        Ok(format!("{:.5} [{low:.5}, {high:.5}]", line.slope))
    });
    row("r²", &|it| {
        let correlation = it.regression.ok_or(still)?.correlation;
        Ok(format!("{:.5}", correlation.ok_or("the camera sees no movement")?.r_squared))
    });
    row("samples", &|it| Ok(it.bland_altman.n.to_string()));
    row("effective samples", &|it| Ok(format!("{:.1}", it.bland_altman.effective_samples)));
    notes.below(Grid { header, rows })
}

fn limit(limit: &Limit) -> String {
    with_interval(limit.value, limit.ci95_exact)
}

fn with_interval(value: f64, [low, high]: [f64; 2]) -> String {
    let [value, low, high] = [value, low, high].map(|it| rounded(it, 4));
    format!("{value:.4} [{low:.4}, {high:.4}]")
}

/// A regression line, for people.
pub(super) fn equation(line: &Line) -> String {
    let intercept = rounded(line.intercept, 4);
    let sign = if intercept < 0.0 { '-' } else { '+' };
    format!("{:.5} x {sign} {:.4}", line.slope, intercept.abs())
}

/// To so many digits; what is 0 with them has no sign.
pub(super) fn rounded(value: f64, digits: i32) -> f64 {
    let unit = 10_f64.powi(-digits);
    (value / unit).round() * unit + 0.0
}
