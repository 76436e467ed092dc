//! `session.toml`: a session on the disk.
//!
//! It is written atomically after every step, before anything else that the step leads to: a
//! recording that exists is always known. Whoever reads it checks that it is what a session can be.

use std::path::Path;

use plumbline_files::{BadInput, from_toml, read_text};

use crate::names;
use crate::participants::check_code;
use crate::protocol::TRIALS_MAX;
use crate::session::{ATTEMPTS_MAX, Ended, FORMAT, Outcome, Session, State, Status, folder_name};
use crate::words::{NAME_LETTERS_MAX, REASON_LETTERS_MAX, check_text, of_field};

const HEADING: &str = "# Written by `plumb` after every step of a session. The recordings are in the folders beside it.\n\n";

const REMEDY: &str = "it is written by `plumb` and not meant to be edited: put back a copy of it, or \
                      begin another session; the recordings stay";

/// No session takes so long: some thousand years.
const MS_MAX: u64 = 1 << 45;

impl Session {
    /// Reads the session of a folder.
    ///
    /// # Errors
    /// When the file cannot be read, or is not of a session.
    pub fn read(folder: &Path) -> Result<Self, BadInput> {
        let path = folder.join(names::SESSION);
        Self::parse(&read_text(&path)?, &path.display().to_string())
    }

    /// The session of a text; `place` names it in errors.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(text: &str, place: &str) -> Result<Self, BadInput> {
        let session: Self = from_toml(text, place, REMEDY)?;
        session.check(place)?;
        Ok(session)
    }

    /// Its text, from which [`parse`](Self::parse) makes it again.
    ///
    /// # Panics
    /// Never: every session is a TOML table.
    #[must_use]
    pub fn text(&self) -> String {
        let text = toml::to_string(self).expect("a session is a TOML table");
        format!("{HEADING}{text}")
    }

    /// Writes it into a folder, atomically.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn write(&self, folder: &Path) -> Result<(), BadInput> {
        plumbline_files::replace(&folder.join(names::SESSION), self.text().as_bytes())
    }

    fn check(&self, place: &str) -> Result<(), BadInput> {
        let wrong = |field: &str, found: String| Err(BadInput::new(place, field, found, REMEDY));
        if self.format != FORMAT {
            let found = format!("{}, and this program knows {FORMAT}", self.format);
            return Err(BadInput::new(place, "format", found, "use the program that wrote it"));
        }
        of_field(place, "participant", check_code(&self.participant))?;
        if self.number == 0 {
            return wrong("number", "0, and participants count from 1".to_owned());
        }
        if let Some(operator) = &self.operator {
            of_field(place, "operator", check_text(operator, NAME_LETTERS_MAX))?;
        }
        of_field(place, "started", check_text(&self.started, NAME_LETTERS_MAX))?;
        self.protocol.check(&format!("{place}, protocol"))?;
        if !(1..=TRIALS_MAX).contains(&self.plan.len()) {
            return wrong("trial", format!("there are {}", self.plan.len()));
        }
        if let Some(it) = self.plan.iter().find(|it| {
            self.protocol.condition(&it.condition).is_none()
                || !(1..=self.protocol.repeats).contains(&it.repeat)
        }) {
            return wrong(
                "trial",
                format!("{:?}, {} is not of the protocol", it.condition, it.repeat),
            );
        }
        self.check_attempts(place)?;
        self.check_state(place)
    }

    fn check_attempts(&self, place: &str) -> Result<(), BadInput> {
        let wrong = |field: &str, found: String| Err(BadInput::new(place, field, found, REMEDY));
        if self.attempts.len() > ATTEMPTS_MAX {
            return wrong("recording", format!("there are {}", self.attempts.len()));
        }
        let is_place = |at: usize| (1..=self.plan.len()).contains(&at);
        for (at, attempt) in self.attempts.iter().enumerate() {
            let field = format!("[[recording]] {}", at + 1);
            if !is_place(attempt.place) {
                return wrong(&field, format!("there is no trial {}", attempt.place));
            }
            let before = &self.attempts[..at];
            let number = before.iter().filter(|it| it.place == attempt.place).count() + 1;
            let planned = &self.plan[attempt.place - 1];
            let folder = folder_name(attempt.place, &planned.condition, number);
            // A path that leads elsewhere is no name either.
            if attempt.folder != folder {
                return wrong(&field, format!("the folder {:?} is not {folder:?}", attempt.folder));
            }
            if let Outcome::Rejected { why }
            | Outcome::Nothing { why }
            | Outcome::Accepted { why: Some(why) } = &attempt.outcome
            {
                of_field(place, &field, check_text(why, REASON_LETTERS_MAX))?;
            }
            let outcomes = self.attempts[..=at].iter().filter(|it| it.place == attempt.place);
            if outcomes.filter(|it| it.outcome.is_accepted()).count() > 1 {
                return wrong(&field, "another one of this trial is accepted as well".to_owned());
            }
            if attempt.outcome == Outcome::Open && at + 1 < self.attempts.len() {
                return wrong(&field, "it is open, and another one follows".to_owned());
            }
        }
        for (at, skipped) in self.skipped.iter().enumerate() {
            let field = format!("[[skipped]] {}", at + 1);
            of_field(place, &field, check_text(&skipped.why, REASON_LETTERS_MAX))?;
            let is_again = self.skipped[..at].iter().any(|it| it.place == skipped.place);
            let is_accepted = matches!(self.status(skipped.place), Status::Accepted(_));
            if !is_place(skipped.place) || is_again || is_accepted {
                return wrong(&field, format!("trial {} cannot be skipped", skipped.place));
            }
        }
        Ok(())
    }

    fn check_state(&self, place: &str) -> Result<(), BadInput> {
        let wrong = |found: &str| Err(BadInput::new(place, "state", found, REMEDY));
        let (times, ended) = match &self.state {
            State::Resting { until_ms, .. } | State::Countdown { until_ms, .. } => {
                ([*until_ms, 0, 0], None)
            }
            State::Recording { begun_ms, first_frame_ms, zero, .. } => {
                let zero_ms = zero.map_or(0, |it| it.at_ms);
                ([*begun_ms, first_frame_ms.unwrap_or(0), zero_ms], None)
            }
            State::Judging { ended_ms, ended, .. } | State::Deciding { ended_ms, ended, .. } => {
                ([*ended_ms, 0, 0], Some(ended))
            }
            State::Stopped { undecided: Some(undecided), .. } => {
                ([undecided.ended_ms, 0, 0], Some(&undecided.ended))
            }
            State::Instruct { .. } | State::Stopped { undecided: None, .. } | State::Over => {
                ([0; 3], None)
            }
        };
        if times.into_iter().chain([self.at_ms]).any(|it| it > MS_MAX) {
            return wrong("a time is further than a thousand years away");
        }
        if let Some(Ended::Lost(why)) = ended {
            of_field(place, "state.ended", check_text(why, REASON_LETTERS_MAX))?;
        }
        let open = self.attempt().map(|it| it.place);
        let needs_open = matches!(self.state, State::Recording { .. }) || ended.is_some();
        match self.place() {
            Some(at) if !(1..=self.plan.len()).contains(&at) => wrong("there is no such trial"),
            Some(at) if self.status(at) != Status::Open => wrong("this trial is over"),
            Some(at) if needs_open && open != Some(at) => wrong("its recording is not listed"),
            _ if !needs_open && open.is_some() => wrong("a recording is open that is not going on"),
            None if (1..=self.plan.len()).any(|it| self.status(it) == Status::Open) => {
                wrong("it is over, and a trial is not")
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::SUPPLIED;

    fn session() -> Session {
        let protocol = SUPPLIED[0].protocol();
        Session::begin(
            "P01".into(),
            1,
            Some("A.B.".into()),
            "2026-01-01T00:00:00Z".into(),
            protocol,
        )
    }

    #[test]
    fn what_no_session_can_be_is_refused() {
        use crate::session::{Attempt, Skipped};
        let attempt =
            |place, folder: &str, outcome| Attempt { place, folder: folder.into(), outcome };
        let first = || attempt(1, "01-eyes-open-firm", Outcome::Open);
        type Change<'a> = Box<dyn Fn(&mut Session) + 'a>;
        let recording =
            |place| State::Recording { place, begun_ms: 0, first_frame_ms: None, zero: None };
        let cases: Vec<(Change<'_>, &str)> = vec![
            (Box::new(|it| it.format = 9), "format: 9"),
            (Box::new(|it| it.participant = "../P01".into()), "participant: "),
            (Box::new(|it| it.number = 0), "number: 0"),
            (Box::new(|it| it.operator = Some("\u{1b}".into())), "operator: "),
            (Box::new(|it| it.started = String::new()), "started: "),
            (Box::new(|it| it.protocol.repeats = 0), "protocol: repeats"),
            (Box::new(|it| it.plan.clear()), "trial: there are 0"),
            (Box::new(|it| it.plan[1].condition = "x".into()), "trial: \"x\", 1 is not of"),
            (Box::new(|it| it.plan[1].repeat = 2), "2 is not of the protocol"),
            (Box::new(|it| it.attempts = vec![first(); 257]), "recording: there are 257"),
            (Box::new(|it| it.attempts = vec![attempt(9, "x", Outcome::Open)]), "no trial 9"),
            (
                Box::new(|it| it.attempts = vec![attempt(1, "../..", Outcome::Open)]),
                "\"../..\" is not",
            ),
            (Box::new(|it| it.attempts = vec![first()]), "open that is not going on"),
            (Box::new(|it| it.state = recording(1)), "state: its recording is not listed"),
            (Box::new(|it| it.state = State::Instruct { place: 5 }), "no such trial"),
            (Box::new(|it| it.state = State::Instruct { place: 0 }), "no such trial"),
            (Box::new(|it| it.state = State::Over), "it is over, and a trial is not"),
            (Box::new(|it| it.at_ms = MS_MAX + 1), "a thousand years"),
            (
                Box::new(|it| {
                    it.state = State::Countdown { place: 1, until_ms: MS_MAX + 1 };
                }),
                "a thousand years",
            ),
            (
                Box::new(|it| it.skipped = vec![Skipped { place: 1, why: "so".into() }; 2]),
                "trial 1 cannot be skipped",
            ),
            (
                Box::new(|it| it.skipped = vec![Skipped { place: 1, why: "so".into() }]),
                "this trial is over",
            ),
            (
                Box::new(|it| {
                    let second = attempt(1, "01-eyes-open-firm-2", Outcome::Accepted { why: None });
                    it.attempts = vec![first(), second];
                }),
                "it is open, and another one follows",
            ),
        ];
        for (change, part) in cases {
            let mut session = session();
            change(&mut session);
            let error = Session::parse(&session.text(), "s.toml").unwrap_err().to_string();
            assert!(error.contains(part), "no {part}: {error}");
        }
        assert_eq!(Session::parse(&session().text(), "").unwrap(), session());
    }

    /// Every byte of a file is damaged in turn: whatever is read then passes its own check.
    #[test]
    fn a_damaged_file_never_panics() {
        let mut session = session();
        session = session.next(&crate::session::Event::Ready, 5).unwrap();
        session = session.next(&crate::session::Event::Tick, 5000).unwrap();
        let text = session.text();
        let from = text.len() - session.protocol.text().len();
        for at in (0..from).filter(|at| text.is_char_boundary(*at)) {
            let _ = Session::parse(&text[..at], "s.toml");
            let rest = &text[at + text[at..].chars().next().map_or(1, char::len_utf8)..];
            for put in ["", "9", "-"] {
                if let Ok(read) = Session::parse(&format!("{}{put}{rest}", &text[..at]), "s.toml") {
                    assert_eq!(Session::parse(&read.text(), "s.toml").unwrap(), read);
                }
            }
        }
    }
}
