//! Who has which trials of a study: what does not fit together is found before anything is
//! compared.

use std::collections::HashMap;

use plumbline_files::BadInput;

use crate::manifest::Study;
use crate::values::{TrialValues, participants};

/// Checks that each trial has one of the study's conditions, each condition a trial, and each
/// participant one trial under each condition. Whoever lacks a condition may be left out, if the
/// study says so, and several trials may be averaged.
///
/// # Errors
/// When something does not fit; all trials, conditions or participants concerned are named.
pub fn check<M>(study: &Study, trials: &[TrialValues<M>]) -> Result<(), BadInput> {
    let Study { place, conditions, .. } = study;
    let listed = conditions.join(", ");
    let wrong = |field: &str, faults: &[String], remedy: &str| {
        if faults.is_empty() {
            return Ok(());
        }
        Err(BadInput::new(place, field, faults.join("; "), remedy))
    };

    let others = trials.iter().filter(|it| !conditions.contains(&it.condition));
    let others: Vec<String> = others
        .map(|it| format!("{}: {:?} is not one of {listed}", it.place, it.condition))
        .collect();
    wrong(
        "conditions",
        &others,
        "correct the condition in trial.toml, add it to the conditions, or name fewer trials",
    )?;

    let nobody = conditions.iter().filter(|it| trials.iter().all(|trial| trial.condition != **it));
    let nobody: Vec<String> = nobody.map(|it| format!("no trial has {it:?}")).collect();
    wrong("conditions", &nobody, "write them as the trials have them, or remove them")?;

    let mut places: HashMap<(&str, &str), Vec<&str>> = HashMap::new();
    for trial in trials {
        places.entry((&trial.participant, &trial.condition)).or_default().push(&trial.place);
    }
    let (mut repeated, mut lacking) = (Vec::new(), Vec::new());
    for participant in participants(trials) {
        for condition in conditions {
            let own = places.get(&(participant, condition)).map_or(&[][..], Vec::as_slice);
            match own {
                [] => {
                    lacking.push(format!("participant {participant} has no trial in {condition}"))
                }
                [_] => {}
                _ => repeated.push(format!(
                    "participant {participant} has {} trials in {condition}: {}",
                    own.len(),
                    own.join(", ")
                )),
            }
        }
    }
    if !study.average_repeats {
        wrong(
            "trials",
            &repeated,
            "correct trial.toml where it is another's, or write repeats = \"mean\" to average them",
        )?;
    }
    if !study.drop_incomplete {
        wrong(
            "trials",
            &lacking,
            "record what is missing, or write drop_incomplete = true to leave such participants out",
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_trials(trials: &[(&str, &str)], change: impl Fn(&mut Study)) -> Result<(), String> {
        let conditions = ["control", "hypo"].map(str::to_owned).into();
        let mut study = Study { conditions, ..Study::example() };
        change(&mut study);
        let numbered = trials.iter().enumerate();
        let trials: Vec<TrialValues<()>> = numbered
            .map(|(at, (participant, condition))| TrialValues {
                place: format!("t{at}"),
                participant: (*participant).to_owned(),
                condition: (*condition).to_owned(),
                responses: Vec::new(),
            })
            .collect();
        check(&study, &trials).map_err(|error| error.to_string())
    }

    const WHOLE: [(&str, &str); 4] =
        [("P1", "control"), ("P1", "hypo"), ("P2", "hypo"), ("P2", "control")];

    #[test]
    fn one_trial_of_each_under_each_condition_is_complete() {
        assert_eq!(check_trials(&WHOLE, |_| ()), Ok(()));
    }

    #[test]
    fn all_that_does_not_fit_is_named() {
        let more = |more: &[(&'static str, &'static str)]| [&WHOLE[..], more].concat();
        for (trials, parts) in [
            (
                more(&[("P1", "contol"), ("P2", "rest")]),
                ["t4: \"contol\" is not one of control, hypo", "t5: \"rest\" is not"],
            ),
            (
                more(&[("P1", "hypo"), ("P2", "hypo")]),
                ["P1 has 2 trials in hypo: t1, t4", "P2 has 2 trials in hypo: t2, t5"],
            ),
            (
                more(&[("P3", "hypo"), ("P4", "control")]),
                ["P3 has no trial in control", "P4 has no trial in hypo"],
            ),
            (
                vec![("P1", "hypo"), ("P2", "hypo")],
                ["no trial has \"control\"", "write them as the trials have them"],
            ),
        ] {
            let error = check_trials(&trials, |_| ()).unwrap_err();
            for part in parts {
                assert!(error.contains(part), "no {part}: {error}");
            }
        }
    }

    #[test]
    fn repeats_are_averaged_and_incomplete_participants_left_out_if_the_study_says_so() {
        let trials = [&WHOLE[..], &[("P1", "hypo"), ("P3", "hypo")]].concat();
        assert!(check_trials(&trials, |it| it.average_repeats = true).is_err());
        assert!(check_trials(&trials, |it| it.drop_incomplete = true).is_err());
        let both = |it: &mut Study| (it.average_repeats, it.drop_incomplete) = (true, true);
        assert_eq!(check_trials(&trials, both), Ok(()));
    }
}
