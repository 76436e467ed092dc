//! Combines the values of trials into the statistics of a response.

use std::collections::{HashMap, HashSet};

use plumbline_analysis::statistics::inference::Inference;
use plumbline_analysis::statistics::multiplicity::{benjamini_hochberg, holm};
use plumbline_analysis::statistics::within::{DesignError, Incomplete, Observation, WithinDesign};
use plumbline_files::BadInput;
use serde::Serialize;

use crate::manifest::Study;

/// A value, or why there is none: a sentence without its full stop that names the trial.
pub type Value = Result<f64, String>;

/// The values of one trial.
#[derive(Debug, Clone)]
pub struct TrialValues<M> {
    /// The trial's folder or table.
    pub place: String,
    /// The participant.
    pub participant: String,
    /// The condition.
    pub condition: String,
    /// Each response's value at each time, or its only one.
    pub responses: Vec<(M, Vec<Value>)>,
}

/// The statistics of a response of a whole study.
#[derive(Debug, Clone, Serialize)]
pub struct Response {
    /// The number of participants in it.
    pub n: usize,
    /// Condition by time, or condition alone where there is one value for all times.
    pub inference: Inference,
    /// Participants without a value in some cell.
    pub left_out: Vec<LeftOut>,
    /// The effects, with p adjusted for the number of responses in which each is tested.
    pub adjusted: Vec<Adjusted>,
}

/// A participant who is left out of a response.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize)]
pub struct LeftOut {
    /// Who.
    pub participant: String,
    /// The condition, and the time if there are several, of the first absent value.
    pub cell: Vec<String>,
    /// Why it is absent.
    pub reason: String,
}

/// The p of an effect's ANOVA-type statistic among those of all responses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Adjusted {
    /// The effect.
    pub effect: String,
    /// The number of responses in which this effect is tested.
    pub tests: usize,
    /// The p of this test alone.
    pub p: f64,
    /// After Holm.
    pub p_holm: f64,
    /// After Benjamini and Hochberg.
    pub p_benjamini_hochberg: f64,
}

/// The responses of these trials, in the order in which they first appear.
#[must_use]
pub fn responses<M: PartialEq + Clone>(trials: &[TrialValues<M>]) -> Vec<M> {
    let mut found: Vec<M> = Vec::new();
    for trial in trials {
        for (at, (response, _)) in trial.responses.iter().enumerate() {
            // Most trials have the same ones, in the same order.
            if found.get(at) != Some(response) && !found.contains(response) {
                found.push(response.clone());
            }
        }
    }
    found
}

/// Why no trial has any value of a response; `None` if one has.
#[must_use]
pub fn never_measured<M: PartialEq>(trials: &[TrialValues<M>], response: &M) -> Option<String> {
    let of_response = trials.iter().flat_map(|trial| &trial.responses);
    let values = of_response.filter(|(it, _)| it == response).flat_map(|(_, values)| values);
    let mut reason = None;
    for value in values {
        match value {
            Ok(_) => return None,
            Err(absent) => reason = reason.or(Some(absent)),
        }
    }
    Some(reason.map_or_else(|| "no trial has it".to_owned(), String::clone))
}

/// The statistics of one response at these times; without times, of its only value. A single time
/// has nothing to be compared with: the design is then that of the conditions alone. Trials of one
/// participant under one condition are first averaged, separately for each time, as in the paper.
///
/// # Errors
/// When a participant lacks a value and the study does not leave out such participants, or when
/// nobody has a value under some condition or at some time, or in all of them; `name` names the
/// response.
pub fn analyse<M: PartialEq>(
    study: &Study,
    times: &[String],
    trials: &[TrialValues<M>],
    response: &M,
    name: &str,
) -> Result<Response, BadInput> {
    let times = if times.len() > 1 { times } else { &[] };
    let values = Values::new(times, trials, response);
    let observations = values.means(study);
    let wrong = |found: String, remedy| BadInput::new(&study.place, name, found, remedy);
    for level in study.conditions.iter().chain(times) {
        if !observations.iter().any(|it| it.levels.contains(&&**level)) {
            let reason = values.reason(trials.iter(), |trial, time| {
                trial.condition == *level || times.get(time).is_some_and(|it| it == level)
            });
            return Err(wrong(format!("nobody has a value in {level}: {reason}"), REMEDY_ALL));
        }
    }
    let factors: &[&str] = if times.is_empty() { &["condition"] } else { &["condition", "time"] };
    let design = WithinDesign::of_complete_subjects(factors, &observations);
    let (design, incomplete) = match design {
        Ok(complete) => complete,
        Err(DesignError::Missing(first)) if study.drop_incomplete => {
            let first = values.left_out(first);
            let found = format!("nobody has a value in every cell; the first {first}");
            return Err(wrong(found, REMEDY_ALL));
        }
        Err(DesignError::Missing(first)) => {
            return Err(wrong(values.left_out(first).to_string(), REMEDY));
        }
        Err(error) => return Err(wrong(error.to_string(), REMEDY_ALL)),
    };
    let left_out: Vec<LeftOut> = incomplete.into_iter().map(|it| values.left_out(it)).collect();
    match left_out.first() {
        Some(first) if !study.drop_incomplete => Err(wrong(first.to_string(), REMEDY)),
        _ => Ok(Response {
            n: design.subjects().len(),
            inference: Inference::of(&design),
            left_out,
            adjusted: Vec::new(),
        }),
    }
}

impl std::fmt::Display for LeftOut {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { participant, cell, reason } = self;
        write!(formatter, "participant {participant} has no value in {}: {reason}", cell.join(", "))
    }
}

const REMEDY: &str = "these methods need complete data: record what is missing, or write \
                      drop_incomplete = true to leave such participants out of this response";

const REMEDY_ALL: &str = "record what is missing, or change the conditions, bins_s or figures";

/// The values of one response in all trials.
struct Values<'a, M> {
    times: &'a [String],
    response: &'a M,
    /// Where the response is in most trials.
    at: usize,
    /// In the order of their first trials.
    participants: Vec<&'a str>,
    /// The trials of each participant under each condition.
    own: HashMap<&'a str, HashMap<&'a str, Vec<&'a TrialValues<M>>>>,
}

impl<'a, M: PartialEq> Values<'a, M> {
    fn new(times: &'a [String], trials: &'a [TrialValues<M>], response: &'a M) -> Self {
        let first = trials.first().map_or(&[][..], |it| &it.responses);
        let at = first.iter().position(|(it, _)| it == response).unwrap_or(0);
        let mut own: HashMap<&str, HashMap<&str, Vec<_>>> = HashMap::new();
        for trial in trials {
            let of_participant = own.entry(&trial.participant).or_default();
            of_participant.entry(&trial.condition).or_default().push(trial);
        }
        Self { times, response, at, participants: participants(trials), own }
    }

    /// The values of a trial; none if it has not this response.
    fn of(&self, trial: &'a TrialValues<M>) -> &'a [Value] {
        let is_it = |(it, _): &&(M, Vec<Value>)| it == self.response;
        let usual = trial.responses.get(self.at).filter(is_it);
        let found = usual.or_else(|| trial.responses.iter().find(is_it));
        found.map_or(&[], |(_, values)| values)
    }

    /// The trials of a participant under a condition.
    fn own(&self, participant: &str, condition: &str) -> &[&'a TrialValues<M>] {
        let found = self.own.get(participant).and_then(|own| own.get(condition));
        found.map_or(&[], Vec::as_slice)
    }

    /// Ordered by condition and time, so that the tables have the study's order; participants are
    /// in the order of their first trials.
    fn means(&self, study: &'a Study) -> Vec<Observation<'a>> {
        let mut observations = Vec::new();
        for condition in &study.conditions {
            for time in 0..self.times.len().max(1) {
                for &participant in &self.participants {
                    let own = self.own(participant, condition).iter();
                    let values = own.filter_map(|trial| self.of(trial).get(time)?.as_ref().ok());
                    let (sum, count) = values.fold((0.0, 0.0), |(sum, n), it| (sum + it, n + 1.0));
                    if count > 0.0 {
                        let time = self.times.get(time).map(String::as_str);
                        observations.push(Observation {
                            subject: participant,
                            levels: [condition.as_str()].into_iter().chain(time).collect(),
                            value: sum / count,
                        });
                    }
                }
            }
        }
        observations
    }

    /// Why there is no value in a participant's cell.
    fn left_out(&self, Incomplete { subject, cell }: Incomplete) -> LeftOut {
        let own = self.own(&subject, &cell[0]).iter().copied();
        let reason = self.reason(own, |_, time| self.times.get(time) == cell.get(1));
        LeftOut { participant: subject, cell, reason }
    }

    /// The reason for the first absent value in `trials` of which `is_asked` is true, given its trial
    /// and the index of its time.
    fn reason(
        &self,
        trials: impl Iterator<Item = &'a TrialValues<M>>,
        is_asked: impl Fn(&TrialValues<M>, usize) -> bool,
    ) -> String {
        let mut without: Option<String> = None;
        for trial in trials {
            for time in (0..self.times.len().max(1)).filter(|time| is_asked(trial, *time)) {
                match self.of(trial).get(time) {
                    Some(Err(absent)) => return absent.clone(),
                    Some(Ok(_)) => {}
                    None => {
                        without.get_or_insert_with(|| format!("{} has none", trial.place));
                    }
                }
            }
        }
        without.unwrap_or_else(|| "no trial takes part".to_owned())
    }
}

/// The participants of these trials, in the order of their first ones.
#[must_use]
pub fn participants<M>(trials: &[TrialValues<M>]) -> Vec<&str> {
    let mut seen = HashSet::new();
    trials.iter().map(|it| &*it.participant).filter(|who| seen.insert(*who)).collect()
}

/// Adjusts the p of each effect for the number of responses in which it is tested.
pub fn adjust(responses: &mut [&mut Response]) {
    let tested: Vec<Vec<(String, f64)>> = responses.iter().map(|it| p_of_effects(it)).collect();
    for (response, adjusted) in responses.iter_mut().zip(adjusted(&tested)) {
        response.adjusted = adjusted;
    }
}

/// For each response, given its effects and their p, these with p adjusted.
#[must_use]
pub fn adjusted(tested: &[Vec<(String, f64)>]) -> Vec<Vec<Adjusted>> {
    let mut responses = vec![Vec::new(); tested.len()];
    let mut effects: Vec<&str> = Vec::new();
    for (effect, _) in tested.iter().flatten() {
        if !effects.contains(&&**effect) {
            effects.push(effect);
        }
    }
    for effect in effects {
        let of_effect = |(at, tested): (usize, &Vec<(String, f64)>)| {
            let (_, p) = tested.iter().find(|(it, _)| it == effect)?;
            Some((at, *p))
        };
        let (indices, p): (Vec<usize>, Vec<f64>) =
            tested.iter().enumerate().filter_map(of_effect).unzip();
        let (p_holm, p_bh) = (holm(&p), benjamini_hochberg(&p));
        for (test, index) in indices.iter().enumerate() {
            responses[*index].push(Adjusted {
                effect: effect.to_owned(),
                tests: p.len(),
                p: p[test],
                p_holm: p_holm[test],
                p_benjamini_hochberg: p_bh[test],
            });
        }
    }
    responses
}

/// The effects whose ANOVA-type statistic is defined, and its p.
#[must_use]
pub fn p_of_effects(response: &Response) -> Vec<(String, f64)> {
    let ranks = response.inference.ranks.known().into_iter().flat_map(|it| &it.effects);
    ranks.filter_map(|it| Some((it.effect.clone(), it.anova_type.as_ref()?.p))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::time_name;

    fn study(drop_incomplete: bool) -> Study {
        let conditions = ["control", "hypo"].map(str::to_owned).into();
        Study { conditions, bins_s: vec![0.0..1.0, 1.0..2.0], drop_incomplete, ..Study::example() }
    }

    fn trials() -> Vec<TrialValues<&'static str>> {
        let value = |it: f64| if it.is_nan() { Err("loose: 4 s".to_owned()) } else { Ok(it) };
        let trial = |participant: &str, condition: &str, values: [f64; 2]| TrialValues {
            place: format!("{participant}-{condition}"),
            participant: participant.to_owned(),
            condition: condition.to_owned(),
            responses: vec![("HR", values.map(value).into())],
        };
        vec![
            trial("P2", "hypo", [3.0, 4.0]),
            trial("P10", "control", [10.0, 20.0]),
            trial("P2", "control", [1.0, 2.0]),
            trial("P2", "control", [f64::NAN, 6.0]),
            trial("P10", "hypo", [30.0, 40.0]),
            trial("P10", "hypo", [32.0, 44.0]),
        ]
    }

    fn of(study: &Study, trials: &[TrialValues<&'static str>]) -> Result<Response, String> {
        let times = [0, 1].map(time_name);
        analyse(study, &times, trials, &"HR", "HR").map_err(|error| error.to_string())
    }

    #[test]
    fn trials_are_averaged_and_everything_has_the_studys_order() {
        let found = of(&study(false), &trials()).unwrap().inference;
        assert_eq!(found.subjects, ["P2", "P10"]);
        let means: Vec<f64> = found.cells.iter().map(|it| it.raw.known().unwrap().mean).collect();
        assert_eq!(means, [5.5, 12.0, 17.0, 23.0]);
        assert_eq!(found.cells[3].levels, ["hypo", "T2"]);
        let times = [0, 1].map(time_name);
        let error = analyse(&study(false), &times, &trials(), &"SV", "SV").unwrap_err();
        assert_eq!(error.found, "nobody has a value in control: P10-control has none");
    }

    #[test]
    fn who_lacks_a_value_is_left_out_only_if_the_study_says_so() {
        let mut fewer = trials();
        fewer.remove(0);
        let error = of(&study(false), &fewer).unwrap_err();
        assert!(error.contains("HR: participant P2 has no value in hypo, T1: no trial"));
        let found = of(&study(true), &fewer).unwrap();
        assert_eq!((found.n, &*found.inference.subjects), (1, &["P10".to_owned()][..]));
        let left_out = LeftOut {
            participant: "P2".to_owned(),
            cell: vec!["hypo".to_owned(), "T1".to_owned()],
            reason: "no trial takes part".to_owned(),
        };
        assert_eq!(found.left_out, [left_out]);
        let without_late: Vec<_> = trials()
            .into_iter()
            .map(|mut trial| {
                trial.responses[0].1[1] = Err("lasts 20 s".to_owned());
                trial
            })
            .collect();
        let error = of(&study(true), &without_late).unwrap_err();
        assert!(error.contains("nobody has a value in T2: lasts 20 s"), "{error}");
    }

    #[test]
    fn a_single_time_is_no_factor() {
        let found = analyse(&study(false), &[time_name(0)], &trials(), &"HR", "HR").unwrap();
        let inference = found.inference;
        assert_eq!(inference.factors.len(), 1);
        assert_eq!(inference.cells[1].levels, ["hypo"]);
        // Both participants have a higher value in hypo: 1 to 3, and 10 to 31.
        let test = inference.comparison(["control", "hypo"], None).unwrap().t_test.known();
        assert_eq!(test.unwrap().mean_difference, 11.5);
        let effects = &inference.anova.known().unwrap().effects;
        assert_eq!(effects.iter().map(|it| &*it.effect).collect::<Vec<_>>(), ["condition"]);
    }
}
