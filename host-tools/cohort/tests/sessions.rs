//! Trials as the desk's sessions leave them.

use plumbline_cohort::folder::Cohort;
use plumbline_cohort::given::Said;
use plumbline_session::participants::{Participant, Participants, Sex};
use plumbline_session::protocol::SUPPLIED;
use plumbline_session::session::{Attempt, Outcome, Session, State};

use crate::support::{added, record};

const STARTED: &str = "2026-01-01T10:00:00Z";

#[test]
fn a_session_says_session_and_run_and_which_recordings_count() {
    let folder = tempfile::tempdir().unwrap();
    let study = folder.path().join("study");
    std::fs::create_dir(&study).unwrap();
    let mut participants = Participants::read(&study).unwrap();
    let person = Participant {
        code: "P01".to_owned(),
        age_years: Some(41.5),
        sex: Some(Sex::Female),
        height_cm: None,
        mass_kg: Some(70.25),
    };
    participants.set(person).unwrap();
    participants.write(&study).unwrap();

    let mut protocol = SUPPLIED[0].protocol();
    protocol.repeats = 2;
    let mut session = Session::begin("P01".into(), 1, None, STARTED.into(), protocol);
    let condition = session.plan[0].condition.clone();
    let second = session.plan.iter().rposition(|it| it.condition == condition).unwrap() + 1;
    let attempt = |place: usize, number: usize, outcome: Outcome| Attempt {
        place,
        folder: match number {
            1 => format!("{place:02}-{condition}"),
            _ => format!("{place:02}-{condition}-{number}"),
        },
        outcome,
    };
    session.attempts = vec![
        attempt(1, 1, Outcome::Rejected { why: "a cough".into() }),
        attempt(1, 2, Outcome::Accepted { why: None }),
        attempt(second, 1, Outcome::Accepted { why: None }),
    ];
    session.state = State::Instruct { place: 2 };
    let own = study.join("sessions/P01-3");
    for (at, attempt) in session.attempts.iter().enumerate() {
        record(&own.join(&attempt.folder), "P01", &condition, &format!("2026-01-01T10:0{at}:00Z"));
    }
    session.write(&own).unwrap();

    let cohort = folder.path().join("cohort");
    let given: Vec<_> = session.attempts.iter().map(|it| own.join(&it.folder)).collect();
    let done = added(&cohort, &given, &Said::default()).unwrap();
    assert_eq!(done.added.len(), 2, "{done:?}");
    let [(left_out, why)] = &done.left_out[..] else { panic!("{done:?}") };
    assert_eq!(left_out, &given[0]);
    assert_eq!(why, "the session did not accept it: a cough");
    let [note] = &done.notes[..] else { panic!("{:?}", done.notes) };
    assert!(note.starts_with("age, sex, height and mass of 2 of 2 trials are from "), "{note}");
    let rows = Cohort::open(&cohort).unwrap().rows().unwrap();
    for (row, run) in rows.iter().zip(1..) {
        assert_eq!((&*row.key.session, row.key.run), ("3", run));
        assert_eq!(row.person.age_years, Some(41.5));
        assert_eq!((row.person.sex.as_deref(), row.person.height_cm), (Some("F"), None));
    }

    // What is corrected afterwards is not passed over in silence.
    let mut participants = Participants::read(&study).unwrap();
    let person = participants.get("P01").unwrap().1.clone();
    participants.set(Participant { age_years: Some(42.0), ..person }).unwrap();
    participants.write(&study).unwrap();
    let error = added(&cohort, &given[1..], &Said::default()).unwrap_err().to_string();
    assert!(error.contains("the participants' file says something else"), "{error}");
    // A folder that the session does not know is not guessed about.
    std::fs::rename(&given[1], own.join("by-hand")).unwrap();
    let done = added(&cohort, &[own.join("by-hand")], &Said::default()).unwrap();
    assert!(done.left_out[0].1.contains("does not know this recording"), "{done:?}");
}
