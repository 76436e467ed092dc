//! The budget as tables: the causes, and what each contributes to each figure.

use std::fmt::Write as _;

use plumbline_study::grid::Grid;
use plumbline_trial::points::point_name;
use plumbline_uncertainty::{Budget, FigureBudget, Group, Kind};

use super::TrialBudget;

/// Digits of an uncertainty that mean something.
const SIGNIFICANT: i32 = 2;

/// More decimals than any figure has.
const DECIMALS_MAX: i32 = 9;

/// The budget as text for people.
pub fn text(trial: &TrialBudget) -> String {
    let mut text = format!("{}, t = 0: {}", trial.source, trial.zero);
    // Writing to a String does not fail.
    if let Some([from_s, to_s]) = trial.span_s {
        let from_s = from_s.unwrap_or_default();
        let _ = match to_s {
            Some(to_s) => write!(text, "; {from_s} to {to_s} s"),
            None => write!(text, "; from {from_s} s on"),
        };
    }
    let _ = write!(text, "; filter: {}", trial.filter);
    text += "\n\n";
    text += &causes(&trial.budget).text();
    for (caption, grid) in figures(&trial.budget) {
        let _ = write!(text, "\n{caption}\n{}", grid.text());
    }
    text += "\nNot included:\n";
    for cause in &trial.budget.not_included {
        let _ = writeln!(text, "  {cause}");
    }
    text
}

/// What contributes, how well it is known, and what shares it.
#[must_use]
pub(super) fn causes(budget: &Budget) -> Grid {
    let header =
        ["cause", "column", "standard uncertainty", "type", "freedom", "the same error in"];
    let rows = budget.terms.iter().map(|term| {
        let kind = match term.kind {
            Kind::A => "A",
            Kind::B => "B",
        };
        let freedom = term.freedom.map_or("∞".to_owned(), |it| format!("{it:.0}"));
        let alike = term.alike.words();
        [term.name.words(), term.name.group().word(), &term.u, kind, &freedom, alike]
            .map(str::to_owned)
            .to_vec()
    });
    Grid { header: header.map(str::to_owned).to_vec(), rows: rows.collect() }
}

/// For each point a caption and the table of its figures.
#[must_use]
pub(super) fn figures(budget: &Budget) -> Vec<(String, Grid)> {
    let groups = Group::ALL.map(Group::word);
    let header: Vec<String> = ["figure", "estimate ± U", "%"]
        .into_iter()
        .chain(groups)
        .chain(["own"])
        .map(str::to_owned)
        .collect();
    let mut points: Vec<&str> = budget.figures.iter().map(|it| it.point).collect();
    points.dedup();
    let table = |point: &str| {
        let rows = budget.figures.iter().filter(|it| it.point == point).map(row).collect();
        let name = if point == "both" { "Both points" } else { point_name(point) };
        let caption = format!(
            "{name}: U is 2 u; then what each cause contributes to u, and the part of u that other \
             trials of the session do not share"
        );
        (caption, Grid { header: header.clone(), rows })
    };
    points.into_iter().map(table).collect()
}

fn row(figure: &FigureBudget) -> Vec<String> {
    let (quantity, unit) = figure.quantity.words();
    let decimals = decimals(figure.expanded);
    // One more than U has, so that the contributions still add up to it.
    let part = |u: f64| if u == 0.0 { "0".to_owned() } else { format!("{u:.*}", decimals + 1) };
    let percent = 100.0 * figure.expanded / figure.estimate.abs();
    let percent = if percent.is_finite() { format!("{percent:.2}") } else { String::new() };
    let own = [
        format!("{quantity} {} ({unit})", figure.direction),
        format!("{:.*} ±{:.*}", decimals, figure.estimate, decimals, figure.expanded),
        percent,
    ];
    let groups = Group::ALL.map(|group| part(figure.of_group(group)));
    own.into_iter().chain(groups).chain([part(figure.u_own)]).collect()
}

/// The decimals with which an uncertainty has two significant digits.
fn decimals(u: f64) -> usize {
    if u <= 0.0 {
        return 0;
    }
    let leading = u.log10().floor() as i32;
    usize::try_from((SIGNIFICANT - 1 - leading).clamp(0, DECIMALS_MAX)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_uncertainty_has_two_digits() {
        let cases = [(0.0123, 3), (0.123, 2), (1.23, 1), (12.3, 0), (1234.0, 0), (0.0, 0)];
        for (u, expected) in cases {
            assert_eq!(decimals(u), expected, "{u}");
        }
    }
}
