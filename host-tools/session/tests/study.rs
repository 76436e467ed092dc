//! Sessions on the disk, from the first step to `plumb study`: simulated trials are recorded in them,
//! programs end at every step, and the study's own reader finds what a study that was written by hand
//! finds.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use plumbline_session::folder::StudyFolder;
use plumbline_session::names;
use plumbline_session::open::{Failed, OpenSession};
use plumbline_session::order::Order;
use plumbline_session::participants::Participant;
use plumbline_session::protocol::{Protocol, SUPPLIED};
use plumbline_session::session::{Ended, Event, Outcome, Refused, Session, State, Status};
use plumbline_stream::fixture::config;
use plumbline_study::figures::{StudyFigures, analyze};
use plumbline_study::manifest;
use plumbline_trial::Trial;
use plumbline_trial::journal::Content;
use plumbline_trial::manifest::{Manifest, State as TrialState};
use plumbline_trial::mark::{Mark, Source};
use plumbline_trial::test_trial::{Made, scene_from_target};
use plumbline_trial::verdict::Grade;
use tempfile::TempDir;

const STARTED: &str = "2026-01-01T00:00:00Z";

/// The rate of simulated trials.
const HZ: u32 = 60;

/// Two conditions of eight seconds, by a Latin square.
fn protocol() -> Protocol {
    let mut protocol = SUPPLIED[0].protocol();
    protocol.conditions.truncate(2);
    for condition in &mut protocol.conditions {
        condition.duration_s = 8.0;
    }
    Protocol { order: Order::LatinSquare, bins_s: vec![[0.0, 4.0], [4.0, 8.0]], ..protocol }
}

fn study(path: &Path, protocol: &Protocol, codes: &[&str]) -> StudyFolder {
    let study = StudyFolder::create(path, "Two stances", protocol).unwrap();
    for code in codes {
        let participant = Participant { code: (*code).to_owned(), ..Participant::default() };
        study.set_participant(participant).unwrap();
    }
    study
}

/// Puts a simulated trial where the recording of a session goes, ended properly; `sway` says how fast
/// its person sways.
fn record(open: &OpenSession, seconds: u32, sway: f64, marks: &[&str]) {
    record_as(TrialState::Finished, open, seconds, sway, marks);
    let trial = Trial::open(&open.recording_folder().unwrap()).unwrap();
    trial.manifest.write(&trial.folder).unwrap();
}

fn record_as(state: TrialState, open: &OpenSession, seconds: u32, sway: f64, marks: &[&str]) {
    let config = config();
    let scene = config.cam_from_scene().unwrap();
    let mut made = Made::with_poses(&config, seconds * HZ + 2, |sequence, role| {
        scene * scene_from_target(role, (f64::from(sequence) * sway) as u32)
    });
    made.manifest = open.manifest(STARTED).unwrap();
    made.manifest.state = state;
    made.entries.retain(|it| !matches!(it.content, Content::Mark(_)));
    for (at, label) in marks.iter().enumerate() {
        let mut entry = made.entries[10 * (at + 1)].clone();
        entry.content = Content::Mark(Mark::new(Source::Key, label));
        made.entries.insert(10 * (at + 1), entry);
    }
    made.write(&open.recording_folder().unwrap());
}

/// A computer whose time goes on as it is told.
struct Clock {
    now: Instant,
}

impl Clock {
    fn new() -> Self {
        Self { now: Instant::now() }
    }

    fn after(&mut self, seconds: f64) -> Instant {
        self.now += Duration::from_secs_f64(seconds);
        self.now
    }
}

/// A study whose only participant's first session has begun.
struct Begun {
    study: StudyFolder,
    open: OpenSession,
    clock: Clock,
    /// The study is gone with it.
    _folder: TempDir,
}

fn begun(protocol: &Protocol) -> Begun {
    let folder = tempfile::tempdir().unwrap();
    let study = study(&folder.path().join("study"), protocol, &["P01"]);
    let clock = Clock::new();
    let open = study.begin("P01", None, STARTED, clock.now).unwrap();
    Begun { study, open, clock, _folder: folder }
}

/// From the instruction to the recording.
fn start(open: &mut OpenSession, clock: &mut Clock) {
    open.take(&Event::Ready, clock.after(1.0)).unwrap();
    open.take(&Event::Tick, clock.after(3.0)).unwrap();
    assert!(matches!(open.session().state, State::Recording { .. }), "{:?}", open.session().state);
}

/// From the instruction to the decision.
fn one_trial(open: &mut OpenSession, clock: &mut Clock, sway: f64) {
    if matches!(open.session().state, State::Resting { .. }) {
        open.take(&Event::Tick, clock.after(30.0)).unwrap();
    }
    start(open, clock);
    record(open, 8, sway, &[]);
    open.take(&Event::Frame, clock.after(0.1)).unwrap();
    open.take(&Event::Tick, clock.after(8.3)).unwrap();
    open.judge(clock.after(0.1)).unwrap();
    assert!(matches!(open.session().state, State::Deciding { .. }), "{:?}", open.session().state);
}

fn figures(study: &Path) -> StudyFigures {
    analyze(&manifest::read(study).unwrap()).unwrap()
}

#[test]
fn a_study_of_sessions_has_the_figures_of_one_that_was_written_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study");
    let codes = ["P01", "P02", "P03"];
    let study = study(&path, &protocol(), &codes);
    let mut clock = Clock::new();
    let mut by_hand = String::from(
        "title = \"Two stances\"\nconditions = [\"eyes-open-firm\", \"eyes-closed-firm\"]\n\
         bins_s = [[0, 4], [4, 8]]\n",
    );
    for (who, code) in codes.into_iter().enumerate() {
        let mut open = study.begin(code, Some("A.B."), STARTED, clock.now).unwrap();
        for trial in 0..2 {
            let sway = 1.0 + 0.5 * who as f64 + 0.25 * f64::from(trial);
            if who == 1 && trial == 0 {
                // Kept, and not read by the study.
                one_trial(&mut open, &mut clock, 3.0);
                open.take(&Event::Repeat(Some("stepped aside".into())), clock.now).unwrap();
            }
            one_trial(&mut open, &mut clock, sway);
            let accepted = open.recording_folder().unwrap();
            open.take(&Event::Accept(None), clock.now).unwrap();
            let accepted = accepted.strip_prefix(&path).unwrap().display().to_string();
            by_hand += &format!("[[trial]]\nfolder = \"{accepted}\"\n");
        }
        assert_eq!(open.session().state, State::Over);
        assert_eq!(open.warnings(), [""; 0]);
    }
    let hand = path.join("by-hand.toml");
    std::fs::write(&hand, by_hand).unwrap();
    let found = figures(&path.join(names::STUDY));
    assert_eq!(found.participants, codes);
    assert_eq!(found.sway[0].response.n, 3);
    let json = |it: &StudyFigures| serde_json::to_string(it).unwrap();
    assert_eq!(json(&found), json(&figures(&hand)));

    // The square: P02 begins with the other condition.
    let first = |name: &str| {
        let session = Session::read(&path.join(names::SESSIONS).join(name)).unwrap();
        session.plan[0].condition.clone()
    };
    let firsts = ["P01-1", "P02-1", "P03-1"].map(first);
    assert_eq!(firsts, ["eyes-open-firm", "eyes-closed-firm", "eyes-open-firm"]);
    // A pattern would find the rejected one, and stop at it.
    let rejected = path.join("sessions/P02-1/01-eyes-closed-firm");
    let verdict = Manifest::read(&rejected).unwrap().verdict();
    assert_eq!((verdict.overruled, verdict.by.as_deref()), (Some(Grade::Unusable), Some("A.B.")));
    assert!(verdict.why.unwrap().ends_with("P02-1, not accepted: stepped aside"));
    let pattern = path.join("pattern.toml");
    let conditions = "conditions = [\"eyes-open-firm\", \"eyes-closed-firm\"]";
    let text = format!("title = \"T\"\n{conditions}\ntrials = [\"sessions/*/*-firm*\"]\n");
    std::fs::write(&pattern, text).unwrap();
    let error = analyze(&manifest::read(&pattern).unwrap()).unwrap_err().to_string();
    assert!(error.contains("1 trial unusable") && error.contains("stepped aside"), "{error}");
}

#[test]
fn what_a_person_adds_to_the_study_stays_and_all_files_are_the_owners() {
    let Begun { study, mut open, mut clock, _folder } = begun(&protocol());
    let path = study.path().to_owned();
    one_trial(&mut open, &mut clock, 1.0);
    open.take(&Event::Accept(None), clock.now).unwrap();
    let file = path.join(names::STUDY);
    let text = std::fs::read_to_string(&file).unwrap();
    let text = text.replace("bins_s", "# mine\ndrop_incomplete = true\nbins_s");
    let text = format!("{text}condition = \"eyes-closed-firm\" # it was\n");
    std::fs::write(&file, &text).unwrap();
    one_trial(&mut open, &mut clock, 1.5);
    // A file that is no study is left alone, and the session goes on.
    std::fs::write(&file, "title = ").unwrap();
    open.take(&Event::Accept(None), clock.now).unwrap();
    assert_eq!(open.session().state, State::Over);
    assert!(open.warnings()[0].contains("study.toml: title (line 1)"), "{:?}", open.warnings());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "title = ");
    drop(open);
    // What is missing is added as soon as it is one again.
    std::fs::write(&file, &text).unwrap();
    let open = study.resume("P01-1", clock.now).unwrap();
    let last = &open.session().attempts[1].folder;
    let wanted = format!("{text}\n[[trial]]\nfolder = \"sessions/P01-1/{last}\"\n");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), wanted);

    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    for name in [names::PARTICIPANTS, names::PARTICIPANTS_COLUMNS, names::PROTOCOL, names::STUDY] {
        assert_eq!(mode(&path.join(name)), 0o600, "{name}");
    }
    assert_eq!(mode(&open.folder().join(names::SESSION)), 0o600);
    for folder in [path.clone(), path.join(names::SESSIONS), open.folder()] {
        assert_eq!(mode(&folder), 0o700, "{}", folder.display());
    }
}

/// What a program does until it ends at some step.
#[derive(Debug, Clone, Copy)]
enum Step {
    Take(&'static str, f64),
    Record,
    Judge,
}

fn event(word: &str) -> Event {
    match word {
        "tick" => Event::Tick,
        "ready" => Event::Ready,
        "end_rest" => Event::EndRest,
        "frame" => Event::Frame,
        "accept" => Event::Accept(None),
        "repeat" => Event::Repeat(None),
        "skip" => Event::Skip("tired".to_owned()),
        "stop" => Event::Stop,
        "continue" => Event::Continue,
        "lost" => Event::Lost("the box is gone".to_owned()),
        word => unreachable!("{word}"),
    }
}

#[test]
fn a_program_that_ends_at_any_step_goes_on_where_it_was() {
    let steps = [
        Step::Take("ready", 1.0),
        Step::Take("tick", 3.0),
        Step::Record,
        Step::Take("frame", 0.1),
        Step::Take("lost", 2.0),
        Step::Judge,
        Step::Take("repeat", 1.0),
        Step::Take("tick", 60.0),
        Step::Take("ready", 1.0),
        Step::Take("tick", 3.0),
        Step::Take("frame", 0.1),
        Step::Record,
        Step::Take("tick", 8.3),
        Step::Judge,
        Step::Take("stop", 1.0),
        Step::Take("continue", 1.0),
        Step::Take("accept", 1.0),
        Step::Take("end_rest", 1.0),
        Step::Take("skip", 1.0),
    ];
    for ends in 0..=steps.len() {
        let Begun { study, mut open, mut clock, _folder } = begun(&protocol());
        for step in &steps[..ends] {
            match *step {
                Step::Take(word, after_s) => {
                    open.take(&event(word), clock.after(after_s)).unwrap();
                }
                Step::Record => record(&open, 8, 1.0, &[]),
                Step::Judge => {
                    open.judge(clock.now).unwrap();
                }
            }
        }
        let before = open.session().clone();
        // While it runs, nobody else has it.
        let error = study.resume("P01-1", clock.now).unwrap_err().to_string();
        assert!(error.contains("open in another program"), "{error}");
        let has_folder = open.recording_folder().is_some_and(|it| it.exists());
        drop(open);
        assert_eq!(Session::read(&study.path().join("sessions/P01-1")), Ok(before.clone()));

        let resumed = study.resume("P01-1", clock.after(3600.0)).unwrap();
        let after = resumed.session();
        match &before.state {
            // Nothing was recorded yet.
            State::Countdown { .. } => assert_eq!(after.state, State::Instruct { place: 1 }),
            State::Recording { .. } if has_folder => assert!(
                matches!(&after.state, State::Deciding { ended: Ended::CutOff, .. }),
                "{ends}: {:?}",
                after.state
            ),
            State::Judging { ended, .. } if has_folder => assert!(
                matches!(&after.state, State::Deciding { ended: it, .. } if it == ended),
                "{ends}: {:?}",
                after.state
            ),
            State::Recording { .. } | State::Judging { .. } => {
                assert_eq!(after.state, State::Instruct { place: 1 });
                let last = &after.attempts.last().unwrap().outcome;
                assert!(matches!(last, Outcome::Nothing { why } if why == "no frame came"));
            }
            _ => assert_eq!(*after, before, "{ends}"),
        }
    }
}

/// The computer stops in the middle of a recording: no end was written, and the last entry is cut.
#[test]
fn a_recording_that_was_cut_off_is_found_and_judged() {
    let Begun { study, mut open, mut clock, _folder } = begun(&protocol());
    start(&mut open, &mut clock);
    record_as(TrialState::Recording, &open, 8, 1.0, &[]);
    let trial = open.recording_folder().unwrap();
    let packets = trial.join(plumbline_trial::names::JOURNAL);
    let bytes = std::fs::read(&packets).unwrap();
    std::fs::write(&packets, &bytes[..bytes.len() * 3 / 4]).unwrap();
    drop(open);

    let mut open = study.resume("P01-1", clock.now).unwrap();
    let State::Deciding { ended: Ended::CutOff, judged, .. } = &open.session().state else {
        panic!("{:?}", open.session().state);
    };
    assert!(judged.grade > Grade::Good && judged.is_zeroed);
    // The reasons are in its manifest, and the tables beside it.
    let reasons = Manifest::read(&trial).unwrap().verdict().reasons;
    assert!(reasons.iter().any(|it| it.key == "cut_off"), "{reasons:?}");
    assert!(trial.join(plumbline_trial::names::PARQUET).exists());
    open.take(&Event::Accept(None), clock.now).unwrap();
    assert!(matches!(open.session().status(1), Status::Accepted(_)));
}

#[test]
fn a_recording_without_the_mark_is_no_trial() {
    let mut protocol = SUPPLIED[1].protocol();
    protocol.countdown_s = 0.0;
    let Begun { mut open, mut clock, _folder, .. } = begun(&protocol);
    for (marks, accepted) in [(&["rises"][..], false), (&["rises", "zero"], true)] {
        if matches!(open.session().state, State::Resting { .. }) {
            open.take(&Event::EndRest, clock.now).unwrap();
        }
        open.take(&Event::Ready, clock.after(1.0)).unwrap();
        record(&open, 8, 1.0, marks);
        open.take(&Event::End, clock.after(5.0)).unwrap();
        open.judge(clock.now).unwrap();
        let outcome = open.take(&Event::Accept(None), clock.now).map(|_| ());
        match accepted {
            true => {
                assert!(outcome.is_ok(), "{outcome:?}");
                // To the trial's own reader it is t = 0 as well, although another came before.
                let folder = open.folder().join(&open.session().attempts[1].folder);
                assert_eq!(Manifest::read(&folder).unwrap().zero_mark().unwrap().label, "zero");
            }
            false => {
                assert!(matches!(outcome, Err(Failed::Refused(Refused::NoZero))), "{outcome:?}");
                open.take(&Event::Repeat(None), clock.now).unwrap();
            }
        }
    }
}

#[test]
fn who_and_what_is_not_there_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("study");
    let error = StudyFolder::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("no protocol.toml; give the folder of a study"), "{error}");
    let study = study(&path, &protocol(), &["P01", "P02"]);
    assert!(StudyFolder::create(&path, "Again", &protocol()).is_err());
    assert!(StudyFolder::open(&path).is_ok());
    let now = Instant::now();
    let refused =
        |code: &str, operator| study.begin(code, operator, STARTED, now).unwrap_err().to_string();
    assert!(refused("P03", None).contains("there is no participant \"P03\"; add the participant"));
    assert!(refused("P01", Some("\u{202e}")).contains("operator: "));
    for name in ["P01-1", "..", "", "../sessions"] {
        assert!(study.resume(name, now).is_err(), "{name}");
    }
    let mut open = study.begin("P01", None, STARTED, now).unwrap();
    let other = study.begin("P02", None, STARTED, now).unwrap();
    assert!(refused("P01", None).contains("P01-1: this participant's session is not over"));
    for _ in 0..2 {
        open.take(&Event::Skip("tired".into()), now).unwrap();
    }
    // The next one of the same participant; the protocol may have changed meanwhile.
    study.set_protocol(&Protocol { repeats: 3, ..protocol() }).unwrap();
    let next = study.begin("P01", None, STARTED, now).unwrap();
    assert_eq!((next.name(), next.session().plan.len()), ("P01-2", 6));
    assert_eq!((other.session().number, other.session().plan.len()), (2, 2));
    // One that is damaged is listed with its error, and keeps nobody from going on.
    std::fs::write(next.folder().join(names::SESSION), "format = 1\n").unwrap();
    let seen = study.sessions().unwrap();
    let names: Vec<_> = seen.iter().map(|it| (&*it.name, it.session.is_ok())).collect();
    assert_eq!(names, [("P01-1", true), ("P01-2", false), ("P02-1", true)]);
    assert_eq!(study.begin("P01", None, STARTED, now).unwrap().name(), "P01-3");
}

#[test]
fn programs_that_add_participants_at_the_same_time_lose_none() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(&folder.path().join("study"), &protocol(), &[]);
    let numbers = std::thread::scope(|scope| {
        let study = &study;
        let add = move |code: String| {
            let participant = Participant { code, ..Participant::default() };
            study.set_participant(participant).unwrap()
        };
        let added = (0..8).map(|at| scope.spawn(move || add(format!("P{at}"))));
        let added: Vec<_> = added.collect();
        let mut numbers: Vec<u32> = added.into_iter().map(|it| it.join().unwrap()).collect();
        numbers.sort_unstable();
        numbers
    });
    assert_eq!(numbers, [1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(study.participants().unwrap().iter().count(), 8);
}

#[test]
fn an_unusable_recording_is_accepted_with_a_reason_and_does_not_stop_the_study() {
    let Begun { mut open, mut clock, _folder, .. } = begun(&protocol());
    start(&mut open, &mut clock);
    record(&open, 3, 1.0, &[]);
    open.take(&Event::End, clock.after(3.0)).unwrap();
    open.judge(clock.now).unwrap();
    let recording = open.recording_folder().unwrap();
    let refused = open.take(&Event::Accept(None), clock.now).unwrap_err();
    assert!(matches!(refused, Failed::Refused(Refused::Unusable)), "{refused}");
    open.take(&Event::Accept(Some("a short stand".into())), clock.now).unwrap();
    let verdict = Trial::open(&recording).unwrap().manifest.verdict();
    assert_eq!((verdict.is, verdict.overruled), (Grade::Unusable, Some(Grade::Doubtful)));
    assert_eq!(verdict.why.as_deref(), Some("session P01-1, accepted: a short stand"));
}

/// What cannot be stored has not happened.
#[test]
fn a_step_that_cannot_be_written_changes_nothing() {
    let Begun { mut open, clock: Clock { now }, _folder, .. } = begun(&protocol());
    let before = open.session().clone();
    let file = open.folder().join(names::SESSION);
    std::fs::remove_file(&file).unwrap();
    std::fs::create_dir(&file).unwrap();
    let failed = open.take(&Event::Ready, now).unwrap_err();
    assert!(matches!(failed, Failed::Input(_)), "{failed}");
    assert_eq!(*open.session(), before);
    std::fs::remove_dir(&file).unwrap();
    open.take(&Event::Ready, now).unwrap();
    assert_eq!(Session::read(&open.folder()).as_ref(), Ok(open.session()));
}
