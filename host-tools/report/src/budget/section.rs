//! The uncertainty budget, as a part of a trial's report.

use maud::{Markup, html};

use super::{TrialBudget, tables};
use crate::page::table;

/// The section of a trial whose camera is given.
pub(crate) fn section(trial: &TrialBudget) -> Markup {
    let budget = &trial.budget;
    let causes = tables::causes(budget);
    html! {
        section {
            h2 { "Uncertainty" }
            (table("What is not known exactly, and in which trials the error is the same", &causes.header, &causes.rows))
            @for (caption, grid) in &tables::figures(budget) {
                (table(caption, &grid.header, &grid.rows))
            }
            p.method {
                "Uncertainty budget after the GUM (JCGM 100:2008): the figures are computed again "
                "with the whole trial displaced by each cause; contributions add in squares. "
                "U = " (trial.coverage_factor) " u. Paths are less what noise adds to them, and more "
                "by what the steps between the samples leave out. Types: A, from observations; B, by "
                "judgement. Not included: " (budget.not_included.join("; ")) "."
            }
        }
    }
}
