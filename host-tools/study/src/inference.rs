//! Tables of the tests behind the means, of a study or of a long table: the effects on each
//! response, and which levels differ.

use plumbline_analysis::statistics::inference::{Comparison, Inference};

use crate::grid::{Annotated, Footnotes, Grid, digits};
use crate::values::Adjusted;

/// Why there is no test of sphericity.
const TOO_FEW: &str = "too few participants";

/// Why there is no F statistic.
const NO_ERROR: &str = "all participants show the same effect";

/// Why there is no rank statistic.
const NO_RANKS: &str = "all participants have the same ranks";

/// Why there is no adjusted p.
const NOT_TESTED: &str = "there is no p to adjust";

/// How the p of these effects are adjusted, in words; `None` where none is among others.
#[must_use]
pub fn adjusted_text<'a>(adjusted: impl IntoIterator<Item = &'a Adjusted>) -> Option<String> {
    let mut tests: Vec<String> = Vec::new();
    for it in adjusted.into_iter().filter(|it| it.tests > 1) {
        let tested = format!("{} in {} responses", it.effect, it.tests);
        if !tests.contains(&tested) {
            tests.push(tested);
        }
    }
    (!tests.is_empty()).then(|| {
        format!(
            "p Holm, p BH: p of the ANOVA-type statistic, adjusted for the number of responses in \
             which the same effect is tested ({}): after Holm (1979), for the chance that any is \
             significant by chance alone; after Benjamini and Hochberg (1995), for the share of \
             such ones among the significant.",
            tests.join(", ")
        )
    })
}

/// A response as it stands in a table of effects.
pub struct Tested<'a> {
    /// Its name.
    pub name: String,
    /// Its statistics.
    pub inference: &'a Inference,
    /// Its effects among those of other responses; none where it is the only one.
    pub adjusted: &'a [Adjusted],
}

/// The effects on each response: the non-parametric analysis of variance, and the parametric one
/// with tests of its assumptions.
#[must_use]
pub fn effects<'a>(responses: impl IntoIterator<Item = Tested<'a>>) -> Annotated {
    let responses: Vec<Tested<'_>> = responses.into_iter().collect();
    let is_adjusted = responses.iter().flat_map(|it| it.adjusted).any(|it| it.tests > 1);
    let adjusted = if is_adjusted { &["p Holm", "p BH"][..] } else { &[] };
    let header = [
        &["effect", "n", "ANOVA-type statistic", "df", "p"][..],
        adjusted,
        &["F", "df", "p (Greenhouse-Geisser)", "Mauchly p", "Shapiro-Wilk p"],
    ];
    let mut notes = Footnotes::default();
    let mut rows = Vec::new();
    for Tested { name, inference, adjusted } in responses {
        let normality = inference.normality_of_residuals.as_result();
        for (at, effect) in effect_names(inference).into_iter().enumerate() {
            let ranks = inference.ranks.as_result();
            let ranks = ranks.and_then(|it| it.effects[at].anova_type.as_ref().ok_or(NO_RANKS));
            let anova = inference.anova.as_result().map(|it| &it.effects[at]);
            let test = anova.and_then(|it| it.test.as_ref().ok_or(NO_ERROR));
            let p = test.map(|it| {
                let corrected = it.sphericity.as_ref().map(|it| it.greenhouse_geisser.p);
                p_text(corrected.unwrap_or(it.p))
            });
            let mauchly = test.and_then(|it| match &it.sphericity {
                // With one degree of freedom, sphericity always holds.
                None => Ok(String::new()),
                Some(it) => it.mauchly.as_ref().map(|it| p_text(it.p)).ok_or(TOO_FEW),
            });
            let by_ranks = [
                format!("{name}: {effect}"),
                inference.subjects.len().to_string(),
                notes.stated(ranks.map(|it| digits(it.statistic))),
                notes.stated(ranks.map(|it| format!("{:.2}", it.df))),
                notes.stated(ranks.map(|it| p_text(it.p))),
            ];
            let among = adjusted.iter().find(|it| it.effect == effect).ok_or(NOT_TESTED);
            let among = among.map(|it| [it.p_holm, it.p_benjamini_hochberg]);
            let among = (0..if is_adjusted { 2 } else { 0 })
                .map(|at| notes.stated(among.map(|p| p_text(p[at]))))
                .collect::<Vec<_>>();
            let by_variance = [
                notes.stated(test.map(|it| digits(it.f))),
                notes.stated(anova.map(|it| format!("{}, {}", it.df, it.error_df))),
                notes.stated(p),
                notes.stated(mauchly),
                notes.stated(normality.map(|it| p_text(it.p))),
            ];
            rows.push([&by_ranks[..], &among, &by_variance].concat());
        }
    }
    let header = header.concat().into_iter().map(str::to_owned).collect();
    notes.below(Grid { header, rows })
}

/// Main effects and the interaction, in the order of both analyses, whether present or not.
fn effect_names(inference: &Inference) -> Vec<String> {
    let mut names: Vec<String> = inference.factors.iter().map(|it| it.name.clone()).collect();
    if names.len() > 1 {
        names.push(names.join(":"));
    }
    names
}

/// How pairs of levels are compared, in words.
pub const COMPARED: &str = "Difference and 95 % CI: of this pair alone, not corrected. d: Cohen's, of the normalised \
     values, the difference of two means over the root of their mean variance. p: of the paired \
     t test and of the ANOVA-type statistic, times the number of tests (of), after Bonferroni.";

/// Pairs of levels, each with the name of its response.
#[must_use]
pub fn comparisons<'a>(pairs: impl IntoIterator<Item = (String, &'a Comparison)>) -> Annotated {
    let header = [
        "comparison",
        "under",
        "difference",
        "95 % CI",
        "t (df)",
        "d",
        "p (t test)",
        "p (ranks)",
        "of",
    ];
    let mut notes = Footnotes::default();
    let mut rows = Vec::new();
    for (name, it) in pairs {
        let [from, to] = &it.levels;
        let (t_test, ranks) = (it.t_test.as_result(), it.ranks.as_result());
        let interval = t_test.map(|it| {
            let [low, high] = it.difference_ci95.map(digits);
            format!("{low} to {high}")
        });
        let family = t_test.map(|it| &it.family).or(ranks.map(|it| &it.family));
        rows.push(vec![
            format!("{name}: {from} to {to}"),
            it.under.clone().unwrap_or_default(),
            notes.stated(t_test.map(|it| digits(it.mean_difference))),
            notes.stated(interval),
            notes.stated(t_test.map(|it| format!("{:.2} ({})", it.t, it.df))),
            notes.stated(it.d.as_result().map(|d| format!("{d:.2}"))),
            notes.stated(t_test.map(|it| p_text(it.p_bonferroni))),
            notes.stated(ranks.map(|it| p_text(it.p_bonferroni))),
            notes.stated(family.map(|it| it.tests.to_string())),
        ]);
    }
    notes.below(Grid { header: header.map(str::to_owned).into(), rows })
}

/// A probability, with as many digits as papers usually give.
fn p_text(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::statistics::within::{Observation, WithinDesign};

    use super::*;

    /// The statistics of these subjects, whose values are given by condition and time.
    fn inference(subjects: &[&str], value: impl Fn(usize, usize, usize) -> f64) -> Inference {
        let mut observations = Vec::new();
        for (who, subject) in subjects.iter().enumerate() {
            for (at, condition) in ["calm", "wild"].into_iter().enumerate() {
                for (when, time) in ["T1", "T2", "T3"].into_iter().enumerate() {
                    let levels = vec![condition, time];
                    observations.push(Observation { subject, levels, value: value(who, at, when) });
                }
            }
        }
        let design = WithinDesign::of_complete_subjects(&["condition", "time"], &observations);
        Inference::of(&design.unwrap().0)
    }

    fn names(table: &Annotated) -> Vec<&str> {
        table.grid.rows.iter().map(|row| &*row[0]).collect()
    }

    #[test]
    fn effects_that_cannot_be_tested_are_listed_with_the_reason() {
        let one = inference(&["a"], |_, at, when| (3 * at + when) as f64);
        let table = effects([Tested { name: "path".to_owned(), inference: &one, adjusted: &[] }]);
        assert_eq!(names(&table), ["path: condition", "path: time", "path: condition:time"]);
        assert!(table.grid.rows.iter().all(|row| row[2..].iter().all(|it| it.starts_with('–'))));
        let reasons = [one.ranks.as_result().err(), one.anova.as_result().err()];
        for reason in reasons.map(Option::unwrap) {
            assert!(table.notes.iter().any(|it| it.ends_with(reason)), "{:?}", table.notes);
        }
    }

    #[test]
    fn a_comparison_tells_its_family() {
        let value =
            |who: usize, at: usize, when: usize| ((7 * who + 3) * (3 * at + when + 2) % 11) as f64;
        let several = inference(&["a", "b", "c", "d", "e"], value);
        let pairs = several.comparisons.iter().map(|it| ("path".to_owned(), it));
        let table = comparisons(pairs);
        // For the conditions the three times; for the times the three pairs, under each condition.
        assert_eq!(table.grid.rows.len(), 3 + 2 * 3);
        assert_eq!(names(&table)[0], "path: calm to wild");
        assert_eq!(table.grid.rows[3][..2], ["path: T1 to T2", "calm"]);
        assert!(table.grid.rows.iter().all(|row| row[8] == "3"), "{}", table.text());
        let test = several.comparisons[0].t_test.known().unwrap();
        assert_eq!(table.grid.rows[0][4], format!("{:.2} (4)", test.t));
    }
}
