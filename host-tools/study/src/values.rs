//! Combines the values of trials into the statistics of a response.

use plumbline_analysis::statistics::inference::Inference;
use plumbline_analysis::statistics::within::{Incomplete, Observation, WithinDesign};
use plumbline_files::BadInput;

use crate::manifest::Study;

/// The values of one trial.
#[derive(Debug, Clone)]
pub struct TrialValues<M> {
    /// The participant.
    pub participant: String,
    /// The condition.
    pub condition: String,
    /// Each response's value at each time; `None` where it was not measured.
    pub responses: Vec<(M, Vec<Option<f64>>)>,
}

/// A response of a whole study.
#[derive(Debug, Clone)]
pub struct Response {
    /// Condition by time.
    pub inference: Inference,
    /// Participants without a value in some cell.
    pub left_out: Vec<Incomplete>,
}

/// The responses of these trials, in the order in which they first appear.
#[must_use]
pub fn responses<M: PartialEq + Clone>(trials: &[TrialValues<M>]) -> Vec<M> {
    let mut found: Vec<M> = Vec::new();
    for (response, _) in trials.iter().flat_map(|trial| &trial.responses) {
        if !found.contains(response) {
            found.push(response.clone());
        }
    }
    found
}

/// The statistics of one response. Trials of one participant under one condition are first
/// averaged, separately for each time, as in the paper. `None` if nobody was measured.
///
/// # Errors
/// When a participant lacks a value and the study does not leave out such participants, or when
/// there is no value under some condition or at some time; `name` names the response.
pub fn analyse<M: PartialEq>(
    study: &Study,
    times: &[String],
    trials: &[TrialValues<M>],
    response: &M,
    name: &str,
) -> Result<Option<Response>, BadInput> {
    let observations = means(study, times, trials, response);
    if observations.is_empty() {
        return Ok(None);
    }
    let wrong = |found: String| BadInput::new(&study.place, name, found, REMEDY);
    for level in study.conditions.iter().chain(times) {
        if !observations.iter().any(|it| it.levels.contains(&&**level)) {
            return Err(wrong(format!("nobody has a value in {level}")));
        }
    }
    let (design, left_out) =
        WithinDesign::of_complete_subjects(&["condition", "time"], &observations)
            .map_err(|error| wrong(error.to_string()))?;
    match left_out.first() {
        Some(first) if !study.drop_incomplete => Err(wrong(format!(
            "participant {} has no value in {}",
            first.subject,
            first.cell.join(", ")
        ))),
        _ => Ok(Some(Response { inference: Inference::of(&design), left_out })),
    }
}

const REMEDY: &str = "these methods need complete data: record what is missing, or write \
                      drop_incomplete = true to leave such participants out of this response";

/// Ordered by condition and time, so that the tables have the study's order; participants are in
/// the order of their first trials.
fn means<'a, M: PartialEq>(
    study: &'a Study,
    times: &'a [String],
    trials: &'a [TrialValues<M>],
    response: &M,
) -> Vec<Observation<'a>> {
    let mut participants: Vec<&str> = Vec::new();
    for trial in trials {
        if !participants.contains(&&*trial.participant) {
            participants.push(&trial.participant);
        }
    }
    let mut observations = Vec::new();
    for condition in &study.conditions {
        for (time, time_name) in times.iter().enumerate() {
            for participant in &participants {
                let own = trials
                    .iter()
                    .filter(|it| it.participant == **participant && it.condition == *condition);
                let values = own.flat_map(|trial| {
                    let of_response = trial.responses.iter().filter(|(it, _)| it == response);
                    of_response.filter_map(|(_, values)| *values.get(time)?)
                });
                let (sum, count) = values.fold((0.0, 0.0), |(sum, n), it| (sum + it, n + 1.0));
                if count > 0.0 {
                    observations.push(Observation {
                        subject: participant,
                        levels: vec![condition, time_name],
                        value: sum / count,
                    });
                }
            }
        }
    }
    observations
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::time_name;
    use crate::verdict::Unusable;

    fn study(drop_incomplete: bool) -> Study {
        Study {
            place: "study.toml".to_owned(),
            title: String::new(),
            conditions: ["control", "hypo"].map(str::to_owned).into(),
            bins_s: vec![0.0..1.0, 1.0..2.0],
            drop_incomplete,
            unusable: Unusable::default(),
            physiology: None,
            trials: Vec::new(),
        }
    }

    fn trials() -> Vec<TrialValues<&'static str>> {
        let trial = |participant: &str, condition: &str, values: [f64; 2]| TrialValues {
            participant: participant.to_owned(),
            condition: condition.to_owned(),
            responses: vec![("HR", values.map(|it| Some(it).filter(|it| !it.is_nan())).into())],
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

    fn of(study: &Study, trials: &[TrialValues<&'static str>]) -> Result<Option<Response>, String> {
        let times = [0, 1].map(time_name);
        analyse(study, &times, trials, &"HR", "HR").map_err(|error| error.to_string())
    }

    #[test]
    fn trials_are_averaged_and_everything_has_the_studys_order() {
        let found = of(&study(false), &trials()).unwrap().unwrap().inference;
        assert_eq!(found.subjects, ["P2", "P10"]);
        let means: Vec<f64> = found.cells.iter().map(|it| it.raw.known().unwrap().mean).collect();
        assert_eq!(means, [5.5, 12.0, 17.0, 23.0]);
        assert_eq!(found.cells[3].levels, ["hypo", "T2"]);
        let times = [0, 1].map(time_name);
        assert!(analyse(&study(false), &times, &trials(), &"SV", "SV").unwrap().is_none());
    }

    #[test]
    fn who_lacks_a_value_is_left_out_only_if_the_study_says_so() {
        let mut fewer = trials();
        fewer.remove(0);
        let error = of(&study(false), &fewer).unwrap_err();
        assert!(error.contains("HR: participant P2 has no value in hypo, T1"), "{error}");
        let found = of(&study(true), &fewer).unwrap().unwrap();
        assert_eq!((found.inference.subjects.len(), &*found.left_out[0].subject), (1, "P2"));
        let without_late: Vec<_> = trials()
            .into_iter()
            .map(|mut trial| {
                trial.responses[0].1[1] = None;
                trial
            })
            .collect();
        let error = of(&study(true), &without_late).unwrap_err();
        assert!(error.contains("nobody has a value in T2"), "{error}");
    }
}
