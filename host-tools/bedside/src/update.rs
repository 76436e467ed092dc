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

use plumbline::packet::{Action, Document, Hello, PART_BYTES_MAX, ReplyOutcome, UpdateState};
use plumbline_files::{BadInput, bytes_of};
use plumbline_stream::link::BoxLink;
use plumbline_update::header::{HEADER_BYTES, Header, slot_hash};

use crate::delivery::greet;
use crate::told::{Tell, Told, waiting};

/// Parts that are under way at once: few enough for the box's socket.
const PARTS: usize = 128;

/// For so many answers in a row nothing may have arrived.
const BARREN_MAX: usize = 50;

/// Between two questions while the box is busy by itself.
const PAUSE: Duration = Duration::from_millis(500);

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

/// Sends an update to the box that is heard, which tries it and keeps it if it works; returns what it
/// runs then. `progress` is told how many bytes have arrived.
///
/// `force` does it even while somebody records a trial, which it spoils.
///
/// # Errors
/// When the box refuses it, does not answer, or has tried it and gone back.
pub fn install(
    link: &mut BoxLink,
    update: &UpdateFile,
    force: bool,
    progress: &mut dyn FnMut(usize),
    tell: &mut Tell<'_>,
) -> Result<Hello, BadInput> {
    if force {
        link.force();
    }
    let before = greet(link, tell)?;
    link.request(Action::BeginUpdate, "the update")?;
    send(link, update, progress)?;
    waiting(tell, "the box reads it back from its card", || wait_until_ready(link, update))?;
    link.request(Action::TryUpdate, "to try the update")?;
    tell(Told::Note("the box restarts with it, and keeps it if it works".into()));
    waiting(tell, "waiting until the box has shown that it works", || {
        wait_until_decided(link, update, &before)
    })
}

/// Sends the parts, as fast as the box takes them.
fn send(
    link: &mut BoxLink,
    update: &UpdateFile,
    progress: &mut dyn FnMut(usize),
) -> Result<(), BadInput> {
    let (mut from, mut barren) = (0, 0);
    while barren < BARREN_MAX {
        let end = (from + PARTS * PART_BYTES_MAX).min(update.bytes.len());
        link.send_parts(Document::Update, from, &update.bytes[from..end]);
        match state(link)? {
            (UpdateState::Receiving { next }, _) => {
                let next = (next as usize).min(update.bytes.len());
                barren = if next > from { 0 } else { barren + 1 };
                from = next;
                progress(from);
            }
            (UpdateState::Checking | UpdateState::Ready, _) => {
                progress(update.bytes.len());
                return Ok(());
            }
            (UpdateState::Unusable, why) => return Err(refused(link, update, &why)),
            other => return Err(disturbed(link, &other)),
        }
    }
    Err(BadInput::whole(
        link.place(),
        "the parts of the update no longer arrive",
        "check the link with `plumb doctor`, and send it again; the box is as it was",
    ))
}

fn wait_until_ready(link: &mut BoxLink, update: &UpdateFile) -> Result<(), BadInput> {
    let give_up = Instant::now() + CHECKED_WITHIN;
    while Instant::now() < give_up {
        match state(link)? {
            (UpdateState::Ready, _) => return Ok(()),
            (UpdateState::Checking, _) => listen(link, PAUSE)?,
            (UpdateState::Unusable, why) => return Err(refused(link, update, &why)),
            other => return Err(disturbed(link, &other)),
        }
    }
    Err(BadInput::whole(
        link.place(),
        format!("the box has not read the update back in {} s", CHECKED_WITHIN.as_secs()),
        "its card is worn out or very slow: try another; the box is as it was",
    ))
}

/// Waits until the box has restarted and says what became of the update.
fn wait_until_decided(
    link: &mut BoxLink,
    update: &UpdateFile,
    before: &Hello,
) -> Result<Hello, BadInput> {
    let give_up = Instant::now() + DECIDED_WITHIN;
    while Instant::now() < give_up {
        listen(link, PAUSE)?;
        // While it restarts it does not answer.
        let Ok(hello) = link.hello() else { continue };
        if hello.boot_id == before.boot_id {
            continue;
        }
        match state(link) {
            Ok((UpdateState::Installed, _)) => return Ok(hello),
            Ok((UpdateState::GivenUp, why)) => {
                return Err(BadInput::whole(
                    &update.place,
                    format!("the box has tried it and gone back to what it had: {why}"),
                    "the box measures as before; tell who has made the update",
                ));
            }
            Ok(_) | Err(_) => {}
        }
    }
    Err(BadInput::whole(
        link.place(),
        format!("the box has not said in {} s what became of the update", DECIDED_WITHIN.as_secs()),
        "`plumb doctor` shows how it is; switched off and on, it starts with what has worked",
    ))
}

/// How far the box says that it is.
fn state(link: &mut BoxLink) -> Result<(UpdateState, String), BadInput> {
    match link.ask(Action::QueryUpdate)? {
        ReplyOutcome::Update { state, text } => Ok((state, text.as_str().to_owned())),
        ReplyOutcome::Refused { refusal, reason } => {
            Err(link.refused("the update", refusal, &reason))
        }
        other => Err(BadInput::whole(
            link.place(),
            format!("the box answers another question: {other:?}"),
            "update the older of the two programs",
        )),
    }
}

/// Lets time pass with an open ear: a link that nobody listens to is over.
fn listen(link: &mut BoxLink, time: Duration) -> Result<(), BadInput> {
    link.messages(Instant::now() + time, |_| None::<()>).map(drop)
}

fn refused(link: &BoxLink, update: &UpdateFile, why: &str) -> BadInput {
    BadInput::whole(
        &update.place,
        format!("{} does not take it: {why}", link.place()),
        "the box is as it was; give an update that is made for it",
    )
}

fn disturbed(link: &BoxLink, (state, _): &(UpdateState, String)) -> BadInput {
    BadInput::whole(
        link.place(),
        format!("the box no longer takes this update ({state:?})"),
        "check that nobody else updates it, and send it again",
    )
}
