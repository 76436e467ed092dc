use std::collections::BTreeSet;

use plumbline_trial::verdict::Grade;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};

use super::*;
use crate::order::Order;
use crate::protocol::{SUPPLIED, Tones};

const GOOD: Judged = Judged { grade: Grade::Good, is_zeroed: true };

fn of(protocol: Protocol) -> Session {
    Session::begin("P01".into(), 1, None, "2026-01-01T00:00:00Z".into(), protocol)
}

/// Four conditions of 30 s from the first frame, with rests of 30 s and a countdown of 3 s.
fn mctsib() -> Session {
    of(SUPPLIED[0].protocol())
}

/// Two conditions twice; after a baseline of 60 s or 120 s the marks rises and zero, then 60 s.
fn stand() -> Session {
    of(Protocol { order: Order::Fixed, ..SUPPLIED[1].protocol() })
}

/// The session after these events, each at its second.
fn after(session: Session, events: &[(f64, Event)]) -> Session {
    events.iter().fold(session, |session, (at_s, event)| {
        session.next(event, milliseconds(*at_s)).unwrap_or_else(|it| panic!("{event:?}: {it}"))
    })
}

fn recorded(place: usize) -> State {
    State::Recording { place, begun_ms: 3000, first_frame_ms: None, zero: None }
}

fn judging(ended: Ended, ended_ms: u64) -> State {
    State::Judging { place: 1, ended, ended_ms }
}

fn deciding(judged: Judged) -> State {
    State::Deciding { place: 1, ended: Ended::Complete, ended_ms: 40_000, judged }
}

/// A session in this state; a recording is listed if the state has one.
fn in_state(state: State) -> Session {
    let mut session = mctsib();
    if matches!(state, State::Recording { .. } | State::Judging { .. } | State::Deciding { .. })
        || matches!(state, State::Stopped { undecided: Some(_), .. })
    {
        let folder = "01-eyes-open-firm".to_owned();
        session.attempts.push(Attempt { place: 1, folder, outcome: Outcome::Open });
    }
    session.state = state;
    session
}

#[test]
fn each_event_in_each_state() {
    let why = || "tired".to_owned();
    let resting = State::Resting { place: 1, until_ms: 60_000 };
    let instruct = |place| State::Instruct { place };
    let countdown = State::Countdown { place: 1, until_ms: 3000 };
    let undecided = Undecided { ended: Ended::Complete, ended_ms: 40_000, judged: GOOD };
    let stopped = State::Stopped { place: 1, undecided: None };
    let waits = State::Stopped { place: 1, undecided: Some(undecided) };
    let framed =
        State::Recording { place: 1, begun_ms: 3000, first_frame_ms: Some(4000), zero: None };
    let next_rest = |place| State::Resting { place, until_ms: 70_000 };
    // State, event, its second, the state then; all other events are refused.
    let table = [
        (resting.clone(), Event::Tick, 59.999, resting.clone()),
        (resting.clone(), Event::Tick, 60.0, instruct(1)),
        (resting.clone(), Event::EndRest, 1.0, instruct(1)),
        (resting.clone(), Event::Skip(why()), 1.0, State::Resting { place: 2, until_ms: 60_000 }),
        (resting.clone(), Event::Stop, 1.0, stopped.clone()),
        (instruct(1), Event::Tick, 1e6, instruct(1)),
        (instruct(1), Event::Ready, 1.0, State::Countdown { place: 1, until_ms: 4000 }),
        (instruct(1), Event::Skip(why()), 1.0, instruct(2)),
        (instruct(1), Event::Stop, 1.0, stopped.clone()),
        (countdown.clone(), Event::Tick, 2.999, countdown.clone()),
        (countdown.clone(), Event::Tick, 3.0, recorded(1)),
        (countdown.clone(), Event::Cancel, 1.0, instruct(1)),
        (countdown.clone(), Event::Interrupted, 1.0, instruct(1)),
        (countdown.clone(), Event::Stop, 1.0, stopped.clone()),
        (recorded(1), Event::Frame, 4.0, framed.clone()),
        (framed.clone(), Event::Frame, 5.0, framed.clone()),
        (framed.clone(), Event::Mark("turn".into()), 5.0, framed.clone()),
        (framed.clone(), Event::Tick, 34.249, framed.clone()),
        (framed.clone(), Event::Tick, 34.25, judging(Ended::Complete, 34_250)),
        (recorded(1), Event::Tick, 33.25, judging(Ended::Complete, 33_250)),
        (framed.clone(), Event::End, 10.0, judging(Ended::ByHand, 10_000)),
        (framed.clone(), Event::Lost(why()), 10.0, judging(Ended::Lost(why()), 10_000)),
        (framed.clone(), Event::Interrupted, 10.0, judging(Ended::CutOff, 10_000)),
        (framed.clone(), Event::Nothing(why()), 10.0, instruct(1)),
        (judging(Ended::Complete, 40_000), Event::Judged(GOOD), 41.0, deciding(GOOD)),
        (judging(Ended::Complete, 40_000), Event::Nothing(why()), 41.0, instruct(1)),
        (deciding(GOOD), Event::Accept(None), 69.999, next_rest(2)),
        (deciding(GOOD), Event::Accept(None), 70.0, instruct(2)),
        (deciding(GOOD), Event::Repeat(None), 50.0, next_rest(1)),
        (deciding(GOOD), Event::Repeat(Some(why())), 50.0, next_rest(1)),
        (deciding(GOOD), Event::Skip(why()), 50.0, next_rest(2)),
        (deciding(GOOD), Event::Stop, 50.0, waits.clone()),
        (waits.clone(), Event::Continue, 50.0, deciding(GOOD)),
        (stopped.clone(), Event::Continue, 50.0, instruct(1)),
    ];
    for (state, event, at_s, wanted) in &table {
        let session = in_state(state.clone());
        let next = session.next(event, milliseconds(*at_s)).unwrap();
        assert_eq!(next.state, *wanted, "{event:?} in {state:?}");
        assert_eq!(next.step, u64::from(next.state != *state), "{event:?} in {state:?}");
    }
    let events = [
        Event::Tick,
        Event::EndRest,
        Event::Ready,
        Event::Cancel,
        Event::Frame,
        Event::Mark("x".into()),
        Event::End,
        Event::Lost(why()),
        Event::Interrupted,
        Event::Judged(GOOD),
        Event::Nothing(why()),
        Event::Accept(None),
        Event::Repeat(None),
        Event::Skip(why()),
        Event::Stop,
        Event::Continue,
    ];
    let states = [
        resting,
        instruct(1),
        countdown,
        framed,
        judging(Ended::Complete, 40_000),
        deciding(GOOD),
        stopped,
        waits,
        State::Over,
    ];
    for state in &states {
        let session = in_state(state.clone());
        for event in &events {
            let same = |it: &&(State, Event, f64, State)| {
                it.0.word() == state.word() && it.1.word() == event.word()
            };
            let is_listed = table.iter().any(|it| same(&it));
            match session.next(event, 0) {
                Ok(next) if !is_listed => {
                    let quiet = [Event::Tick, Event::Frame, Event::Interrupted];
                    assert!(quiet.contains(event), "{event:?} in {state:?}");
                    assert_eq!(next, session, "{event:?} in {state:?}");
                }
                Ok(_) => {}
                Err(refused) => {
                    assert!(!is_listed, "{event:?} in {state:?}: {refused}");
                    let (event, state) = (event.word(), state.word());
                    assert_eq!(refused, Refused::NotNow { event, state });
                }
            }
        }
    }
}

#[test]
fn nothing_recorded_is_recorded_over() {
    let session = after(
        mctsib(),
        &[
            (0.0, Event::Ready),
            (3.0, Event::Tick),
            (33.5, Event::Tick),
            (34.0, Event::Judged(GOOD)),
            (35.0, Event::Repeat(Some("stepped aside".into()))),
            (36.0, Event::EndRest),
            (36.0, Event::Ready),
            (39.0, Event::Tick),
            (40.0, Event::Nothing("the box was not there".into())),
            (41.0, Event::Ready),
            (44.0, Event::Tick),
            (75.0, Event::Tick),
            (76.0, Event::Judged(Judged { grade: Grade::Unusable, is_zeroed: true })),
            (77.0, Event::Accept(Some("no more is needed".into()))),
        ],
    );
    let folders: Vec<&str> = session.attempts.iter().map(|it| &*it.folder).collect();
    assert_eq!(folders, ["01-eyes-open-firm", "01-eyes-open-firm-2", "01-eyes-open-firm-3"]);
    let outcomes: Vec<&Outcome> = session.attempts.iter().map(|it| &it.outcome).collect();
    let wanted = [
        &Outcome::Rejected { why: "stepped aside".into() },
        &Outcome::Nothing { why: "the box was not there".into() },
        &Outcome::Accepted { why: Some("no more is needed".into()) },
    ];
    assert_eq!(outcomes, wanted);
    assert_eq!(session.status(1), Status::Accepted(&session.attempts[2]));
    assert_eq!((session.status(2), session.place()), (Status::Open, Some(2)));
}

#[test]
fn the_duration_counts_from_the_mark_called_zero() {
    let recording = after(stand(), &[(0.0, Event::Ready), (3.0, Event::Tick), (4.0, Event::Frame)]);
    assert_eq!(recording.mark_due_ms(), Some(64_000));
    assert_eq!(recording.ends_ms(), Some((664_000, true)));
    let rises = after(recording.clone(), &[(70.0, Event::Mark("rises".into()))]);
    assert_eq!(rises.ends_ms(), Some((664_000, true)));
    let stands = after(
        rises.clone(),
        &[(73.0, Event::Mark("Zero".into())), (74.0, Event::Mark("zero".into()))],
    );
    assert_eq!((stands.ends_ms(), stands.mark_due_ms()), (Some((133_000, false)), None));
    let ended = after(stands, &[(133.25, Event::Tick)]);
    let ended_ms = 133_250;
    assert_eq!(ended.state, State::Judging { place: 1, ended: Ended::Complete, ended_ms });
    // Without it the recording ends all the same, and is no trial.
    let without = after(
        rises,
        &[
            (664.25, Event::Tick),
            (665.0, Event::Judged(Judged { grade: Grade::Good, is_zeroed: false })),
        ],
    );
    assert!(matches!(&without.state, State::Deciding { ended: Ended::NoMark, .. }));
    assert_eq!(without.next(&Event::Accept(None), 0), Err(Refused::NoZero));
    assert!(without.next(&Event::Repeat(None), 0).is_ok());

    // The only mark of a protocol may have any name; one called zero that comes later counts more.
    let mut only = stand();
    only.protocol.marks = vec!["stands".into()];
    let events = [(0.0, Event::Ready), (3.0, Event::Tick), (5.0, Event::Mark("stands".into()))];
    let only = after(only, &events);
    assert_eq!(only.ends_ms(), Some((65_000, false)));
    let only = after(only, &[(6.0, Event::Mark("x".into())), (7.0, Event::Mark("zero".into()))]);
    assert_eq!(only.ends_ms(), Some((67_000, false)));
}

#[test]
fn where_the_onset_is_t_0_there_is_time_for_rising() {
    let protocol = Protocol { zero: Zero::Onset, marks: Vec::new(), ..stand().protocol };
    let session = after(
        of(protocol),
        &[
            (0.0, Event::Ready),
            (3.0, Event::Tick),
            (4.0, Event::Frame),
            (5.0, Event::Mark("zero".into())),
        ],
    );
    assert_eq!((session.ends_ms(), session.mark_due_ms()), (Some((124_000, false)), None));
}

#[test]
fn tones_are_at_the_beginning_and_at_the_proper_end() {
    let both = Tones { start: true, end: true };
    let countdown = State::Countdown { place: 1, until_ms: 3000 };
    assert_eq!(tone(&countdown, &recorded(1), both), Some(Tone::Start));
    assert_eq!(tone(&State::Instruct { place: 1 }, &recorded(1), both), Some(Tone::Start));
    assert_eq!(tone(&recorded(1), &judging(Ended::Complete, 9), both), Some(Tone::End));
    for ended in [Ended::ByHand, Ended::CutOff, Ended::NoMark, Ended::Lost("x".into())] {
        assert_eq!(tone(&recorded(1), &judging(ended, 9), both), None);
    }
    assert_eq!(tone(&recorded(1), &recorded(1), both), None);
    assert_eq!(tone(&countdown, &recorded(1), Tones { start: false, end: true }), None);
    let end = judging(Ended::Complete, 9);
    assert_eq!(tone(&recorded(1), &end, Tones { start: true, end: false }), None);
}

#[test]
fn a_reason_is_checked_and_what_programs_say_is_made_readable() {
    let deciding = in_state(deciding(GOOD));
    for why in ["", " ", "a\nb", &"a".repeat(REASON_LETTERS_MAX + 1)] {
        let why = || Some(why.to_owned());
        for event in [Event::Skip(why().unwrap()), Event::Repeat(why()), Event::Accept(why())] {
            let refused = deciding.next(&event, 0).unwrap_err();
            assert!(matches!(refused, Refused::Reason(..)), "{event:?}: {refused}");
        }
    }
    let unusable = Judged { grade: Grade::Unusable, is_zeroed: true };
    let unusable =
        State::Deciding { place: 1, ended: Ended::ByHand, ended_ms: 0, judged: unusable };
    assert_eq!(in_state(unusable).next(&Event::Accept(None), 0), Err(Refused::Unusable));
    assert_eq!(brief("a\u{1b}[2J\nb"), "a?[2J b");
    assert_eq!(brief(" \n"), "no reason was given");
    assert_eq!(brief(&format!("{} b", "a".repeat(199))), "a".repeat(199));
    let many = Session {
        attempts: vec![
            Attempt {
                place: 1,
                folder: String::new(),
                outcome: Outcome::Accepted { why: None }
            };
            ATTEMPTS_MAX
        ],
        ..mctsib()
    };
    assert_eq!(many.next(&Event::Ready, 0), Err(Refused::TooMany));
}

#[test]
fn the_plan_has_each_condition_in_each_repeat() {
    let protocol = SUPPLIED[1].protocol();
    let mut firsts = BTreeSet::new();
    for number in 1..50 {
        let plan = plan(&protocol, number);
        firsts.insert(plan[0].condition.clone());
        for repeat in [1, 2] {
            let names: BTreeSet<&str> =
                plan.iter().filter(|it| it.repeat == repeat).map(|it| &*it.condition).collect();
            assert_eq!(names.len(), 2);
        }
        assert_eq!(plan.iter().map(|it| it.repeat).collect::<Vec<_>>(), [1, 1, 2, 2]);
    }
    assert_eq!(firsts.len(), 2);
}

/// Random runs, of which each state is stored and read: it is the same, and no run gets stuck.
#[test]
fn what_is_stored_at_every_step_is_what_is_read() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut seen = BTreeSet::new();
    for run in 0..40 {
        let mut session = if run % 2 == 0 { mctsib() } else { stand() };
        session.protocol.countdown_s *= (run % 3) as f64;
        let mut now_ms = 0;
        for _ in 0..120 {
            now_ms += u64::from(random.next_u32() % 40_000);
            let why = || "because\u{fc} \"'# = [".to_owned();
            let judged = Judged {
                grade: [Grade::Good, Grade::Doubtful, Grade::Unusable][run % 3],
                is_zeroed: random.next_u32() % 4 > 0,
            };
            let event = match random.next_u32() % 24 {
                0..=3 => Event::Tick,
                4 => Event::EndRest,
                5..=7 => Event::Ready,
                8 => Event::Cancel,
                9..=10 => Event::Frame,
                11..=12 => Event::Mark(["rises", "zero"][run % 2].to_owned()),
                13 => Event::End,
                14 => Event::Lost("the box\nis gone".to_owned()),
                15 => Event::Interrupted,
                16..=18 => Event::Judged(judged),
                19 => Event::Nothing(why()),
                20 => Event::Accept(Some(why()).filter(|_| run % 2 == 0)),
                21 => Event::Repeat(Some(why()).filter(|_| run % 2 == 0)),
                22 => Event::Skip(why()),
                _ if random.next_u32() % 4 == 0 => Event::Stop,
                _ => Event::Continue,
            };
            let Ok(next) = session.next(&event, now_ms) else { continue };
            assert_eq!(Session::parse(&next.text(), "s.toml"), Ok(next.clone()));
            seen.insert(next.state.word());
            let folders: BTreeSet<&str> = next.attempts.iter().map(|it| &*it.folder).collect();
            assert_eq!(folders.len(), next.attempts.len());
            // What was decided stays decided.
            for (before, after) in session.attempts.iter().zip(&next.attempts) {
                assert!(before.outcome == Outcome::Open || before == after);
            }
            session = next;
        }
    }
    assert_eq!(seen.len(), 8, "{seen:?}");
}

#[test]
fn the_longest_session_can_be_read() {
    let text = |letters: usize| "ü".repeat(letters);
    let condition = |at: usize| Condition {
        name: format!("c{at}"),
        label: text(80),
        instruction: text(1000),
        baseline_s: 0.0,
        duration_s: 1.0 / 0.3,
    };
    let protocol = Protocol {
        about: Some(text(1000)),
        repeats: 4,
        conditions: (0..16).map(condition).collect(),
        bins_s: vec![[0.0, 1.0]],
        ..SUPPLIED[0].protocol()
    };
    let mut session = of(protocol);
    for at in 0..ATTEMPTS_MAX - 1 {
        let folder = folder_name(1, &session.plan[0].condition, at + 1);
        let outcome = Outcome::Rejected { why: "\u{10348}".repeat(200) };
        session.attempts.push(Attempt { place: 1, folder, outcome });
    }
    let session = after(session, &[(0.0, Event::Ready), (3.0, Event::Tick)]);
    let folder = tempfile::tempdir().unwrap();
    session.write(folder.path()).unwrap();
    assert_eq!(Session::read(folder.path()), Ok(session));
}
