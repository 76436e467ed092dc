//! Another system for a box: its file is sent beside the measurement, and the box tries it.
//!
//! ```text
//! file ─▶ checked here ─▶ sent in parts, as the box takes them ─▶ read back by the box
//!      ─▶ one start for a trial ─▶ installed, or the box is back with what it had, and says why
//! ```
//!
//! What the box may run is for its own keys to say: here the file is only checked for damage.

use std::path::Path;
use std::time::{Duration, Instant};

use plumbline::packet::{Start, UpdateOutcome, UpdateRefusal, UpdateState, UpdateStep};
use plumbline_files::{BadInput, bytes_of};
use plumbline_stream::update_link::{Answer, UpdateLink};
use plumbline_update::header::{HEADER_BYTES, Header, slot_hash};

use crate::told::{Tell, Told, waiting};

/// For so many answers in a row nothing may have arrived.
const BARREN_MAX: usize = 50;

/// Between two questions while the box is busy by itself.
const PAUSE: Duration = Duration::from_millis(500);

/// Nobody waits longer than this for trials to be over.
const RECORDED_FOR: Duration = Duration::from_secs(12 * 3600);

/// The slowest card gives an update back in less.
const CHECKED_WITHIN: Duration = Duration::from_secs(180);

/// The box starts, shows that it works within two minutes, and if it does not starts once more.
const DECIDED_WITHIN: Duration = Duration::from_secs(360);

/// An update, as its file has it.
#[derive(Debug)]
pub struct UpdateFile {
    /// What it is, which only the box can tell to be authentic.
    pub header: Header,
    bytes: Vec<u8>,
    place: String,
}

impl UpdateFile {
    /// Reads an update's file, which must be whole.
    ///
    /// # Errors
    /// When it cannot be read, is no update, or is damaged.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        let place = path.display().to_string();
        let bytes = bytes_of(path)?;
        let none = |what: String, remedy: &str| BadInput::whole(&place, what, remedy);
        let again = "copy or download it again";
        let head = bytes.first_chunk::<HEADER_BYTES>();
        let head = head.ok_or_else(|| none("too short for an update".into(), again))?;
        let header = Header::read(head).map_err(|fault| {
            none(fault.to_string(), "give the .plu file of a release, or one that you have made")
        })?;
        let slot = &bytes[HEADER_BYTES..];
        if slot.len() as u64 != u64::from(header.slot_bytes) {
            let (is, said) = (bytes.len(), HEADER_BYTES as u64 + u64::from(header.slot_bytes));
            return Err(none(format!("it has {is} bytes and says that it has {said}"), again));
        }
        if slot_hash(slot) != header.slot_hash {
            return Err(none("damaged: its SHA-256 is not the one that it names".into(), again));
        }
        Ok(Self { header, bytes, place })
    }

    /// Its length.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }
}

impl std::fmt::Display for UpdateFile {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Header { version, board, commit, key, .. } = &self.header;
        write!(
            formatter,
            "version {version} for {} ({}), signed with the key {key}, {:.1} MB",
            board.as_str(),
            commit.as_str(),
            self.bytes.len() as f64 * 1e-6
        )
    }
}

/// Sends an update to the box that is heard, which tries it and keeps it if it works; returns the
/// version of what it runs then. `progress` is told how many bytes have arrived.
///
/// While somebody records a trial it waits, unless `force` has it spoil the trial.
///
/// # Errors
/// When the box refuses it, does not answer, or has tried it and gone back.
pub fn install(
    link: &mut UpdateLink,
    update: &UpdateFile,
    force: bool,
    progress: &mut dyn FnMut(usize),
    tell: &mut Tell<'_>,
) -> Result<String, BadInput> {
    let heard = format!("listening at {}", link.place());
    let before = waiting(tell, heard, || link.ask(&UpdateStep::Query))?;
    tell(Told::Note(format!("{}: the box runs {}", link.place(), before.version)));
    let mut dialogue = Dialogue { link, update, tell };
    dialogue.ask(&UpdateStep::Begin { is_forced: force })?;
    dialogue.send(progress)?;
    dialogue.wait_until_ready()?;
    dialogue.start_trial(force)?;
    dialogue.wait_until_decided(before.start)
}

/// What is said about an update, until it is decided.
struct Dialogue<'a, 'b> {
    link: &'a mut UpdateLink,
    update: &'a UpdateFile,
    tell: &'a mut Tell<'b>,
}

impl Dialogue<'_, '_> {
    /// Asks for a step, as soon as nobody records a trial that it would disturb; how far the update is
    /// then, and the same in words.
    fn ask(&mut self, step: &UpdateStep) -> Result<(UpdateState, String), BadInput> {
        match self.link.ask(step)?.outcome {
            UpdateOutcome::State { state, text } => return Ok((state, text.as_str().to_owned())),
            UpdateOutcome::Refused { refusal: UpdateRefusal::Recording, text } => {
                self.tell(Told::Waiting(format!("{text}: waiting until it is over")));
            }
            UpdateOutcome::Refused { text, .. } => return Err(self.refused(&text)),
        }
        let over = self.ask_until_over(step);
        self.tell(Told::Done);
        over
    }

    fn ask_until_over(&mut self, step: &UpdateStep) -> Result<(UpdateState, String), BadInput> {
        let give_up = Instant::now() + RECORDED_FOR;
        while Instant::now() < give_up {
            self.link.wait(PAUSE)?;
            match self.link.ask(step)?.outcome {
                UpdateOutcome::State { state, text } => {
                    return Ok((state, text.as_str().to_owned()));
                }
                UpdateOutcome::Refused { refusal: UpdateRefusal::Recording, .. } => {}
                UpdateOutcome::Refused { text, .. } => return Err(self.refused(&text)),
            }
        }
        Err(BadInput::whole(
            self.link.place(),
            format!("trials have been recorded for {} hours", RECORDED_FOR.as_secs() / 3600),
            "send the update when nobody records; --force sends it all the same, and spoils the trial",
        ))
    }

    /// Sends the parts, as fast as the box takes them.
    fn send(&mut self, progress: &mut dyn FnMut(usize)) -> Result<(), BadInput> {
        let bytes = &self.update.bytes;
        let (mut from, mut barren) = (0, 0);
        while barren < BARREN_MAX {
            let end = (from + self.link.bytes_at_once()).min(bytes.len());
            self.link.send_parts(from, &bytes[from..end]);
            match self.ask(&UpdateStep::Query)? {
                (UpdateState::Receiving { next }, _) => {
                    let next = (next as usize).min(bytes.len());
                    barren = if next > from { 0 } else { barren + 1 };
                    from = next;
                    progress(from);
                }
                (UpdateState::Checking | UpdateState::Ready, _) => {
                    progress(bytes.len());
                    return Ok(());
                }
                other => return Err(self.unexpected(&other)),
            }
        }
        Err(BadInput::whole(
            self.link.place(),
            "the parts of the update no longer arrive",
            "check the link with `plumb doctor`, and send it again; the box is as it was",
        ))
    }

    fn wait_until_ready(&mut self) -> Result<(), BadInput> {
        self.tell(Told::Waiting("the box reads it back from its card".into()));
        let ready = self.ask_until_ready();
        self.tell(Told::Done);
        ready
    }

    fn ask_until_ready(&mut self) -> Result<(), BadInput> {
        let give_up = Instant::now() + CHECKED_WITHIN;
        while Instant::now() < give_up {
            match self.ask(&UpdateStep::Query)? {
                (UpdateState::Ready, _) => return Ok(()),
                (UpdateState::Checking, _) => self.link.wait(PAUSE)?,
                other => return Err(self.unexpected(&other)),
            }
        }
        Err(BadInput::whole(
            self.link.place(),
            format!("the box has not read the update back in {} s", CHECKED_WITHIN.as_secs()),
            "its card is worn out or very slow: try another; the box is as it was",
        ))
    }

    /// Has the box restart with it. When its last word is lost, what it says afterwards decides.
    fn start_trial(&mut self, force: bool) -> Result<(), BadInput> {
        let begun = Instant::now();
        match self.ask(&UpdateStep::Try { is_forced: force }) {
            Ok((UpdateState::Restarting, _)) => {}
            Ok(other) => return Err(self.unexpected(&other)),
            Err(error) if self.link.is_silent_since(begun) => {
                self.tell(Told::Warning(error.to_string()));
            }
            Err(error) => return Err(error),
        }
        self.tell(Told::Note("the box restarts with it, and keeps it if it works".into()));
        Ok(())
    }

    /// Waits until the box has restarted and says what became of the update.
    fn wait_until_decided(&mut self, before: Start) -> Result<String, BadInput> {
        self.tell(Told::Waiting("waiting until the box has shown that it works".into()));
        let decided = self.ask_until_decided(before);
        self.tell(Told::Done);
        decided
    }

    fn ask_until_decided(&mut self, before: Start) -> Result<String, BadInput> {
        let give_up = Instant::now() + DECIDED_WITHIN;
        while Instant::now() < give_up {
            self.link.wait(PAUSE)?;
            // While it restarts it does not answer.
            let Ok(Answer { start, version, outcome }) = self.link.ask(&UpdateStep::Query) else {
                continue;
            };
            match outcome {
                _ if start == before => {}
                UpdateOutcome::State { state: UpdateState::Installed, .. } => return Ok(version),
                UpdateOutcome::State { state: UpdateState::GivenUp, text } => {
                    return Err(BadInput::whole(
                        &self.update.place,
                        format!("the box has tried it and gone back to what it had: {text}"),
                        "the box measures as before; tell who has made the update",
                    ));
                }
                UpdateOutcome::State { .. } | UpdateOutcome::Refused { .. } => {}
            }
        }
        let seconds = DECIDED_WITHIN.as_secs();
        Err(BadInput::whole(
            self.link.place(),
            format!("the box has not said in {seconds} s what became of the update"),
            "`plumb doctor` shows how it is; switched off and on, it starts with what has worked",
        ))
    }

    fn tell(&mut self, told: Told) {
        (self.tell)(told);
    }

    fn refused(&self, why: &str) -> BadInput {
        BadInput::whole(
            self.link.place(),
            format!("the box refuses the update: {why}"),
            "the box is as it was",
        )
    }

    /// The box says something of the update that it should not say now.
    fn unexpected(&self, (state, text): &(UpdateState, String)) -> BadInput {
        if *state == UpdateState::Unusable {
            return BadInput::whole(
                &self.update.place,
                format!("{} does not take it: {text}", self.link.place()),
                "the box is as it was; give an update that is made for it",
            );
        }
        BadInput::whole(
            self.link.place(),
            format!("the box no longer takes this update ({state:?})"),
            "check that it has not restarted and that nobody else updates it, and send it again",
        )
    }
}
