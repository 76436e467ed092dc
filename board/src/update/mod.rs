//! Updates of the box's whole system over its link, beside the measurement.
//!
//! ```text
//! slots     which slots there are, which one runs          note     what is remembered across starts
//! writer    writes the idle slot and reads it back         trial    what a new program must show
//! disk      a partition without its file system            answers   what a host is answered
//! ```
//!
//! What an update is, and why a power cut at any time leaves a box that starts, is in
//! [`plumbline_update`]. What a host sends is taken in order: what is missing it is told, and sends
//! from there. Nothing is written before the head of the update has shown that the owner of one of the
//! box's update keys has made it for this board, and nothing at all while somebody records a trial.

mod answers;
mod disk;
mod note;
mod slots;
mod trial;
mod writer;

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use heapless::Vec;
use plumbline::packet::{UpdateOutcome, UpdateRefusal, UpdateState};
use plumbline::seal::UpdaterId;
use plumbline_update::header::{self, HEADER_BYTES, Header, VerifyingKey};
use plumbline_update::release::OLDEST_ALLOWED;

use crate::machine::read_only_partition::ReadOnlyPartition;
use answers::at;
pub use answers::refused;
use disk::{BLOCK_BYTES, Block};
use note::{Fate, Note, NoteStore, Update};
use slots::Slots;
use trial::{Trial, Verdict};
use writer::Writer;

/// The public keys of those who may make updates for this box, 32 bytes each.
const KEYS: &str = "/etc/plumbline/update-keys";

/// Which boards this computer fits, by the kernel's device tree.
const COMPATIBLE: &str = "/proc/device-tree/compatible";

/// The boards for which there are updates, and what their device trees say.
const BOARDS: [(&str, &str); 2] = [("rpi4", "brcm,bcm2711"), ("virt", "linux,dummy-virt")];

/// What a session ends for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Leave {
    /// To try the update once.
    ToTry,
    /// To go back to the program that was there before.
    ToGiveUp,
}

/// The update of a box.
#[derive(Debug)]
pub struct Updates {
    /// Or why the box cannot be updated over its link.
    card: Result<Card, String>,
    state: State,
    /// Whose parts they are.
    sender: Option<UpdaterId>,
    trial: Option<Trial>,
    /// What became of the last update, as this start knows it.
    last: Option<Note>,
    leave: Option<Leave>,
}

/// What is needed to take an update.
#[derive(Debug)]
struct Card {
    slots: Slots,
    board: &'static str,
    keys: std::vec::Vec<VerifyingKey>,
    notes: NoteStore,
}

/// How far it is.
#[derive(Debug)]
enum State {
    Idle,
    Receiving(Box<Receiving>),
    Checking { header: Header, writer: Writer },
    Ready(Header),
    Unusable(String),
}

/// An update whose parts come.
#[derive(Debug)]
struct Receiving {
    /// Even while somebody records a trial.
    is_forced: bool,
    head: Vec<u8, HEADER_BYTES>,
    /// What the head says, once it has come.
    header: Option<Header>,
    /// Bytes of the slot that have been handed to the writer.
    written: u64,
    block: Option<Box<Block>>,
    /// Bytes in the block.
    filled: usize,
    writer: Writer,
}

impl Updates {
    /// Of a program that is no box's own system.
    #[must_use]
    pub fn impossible(why: &str) -> Self {
        Self {
            card: Err(why.to_owned()),
            state: State::Idle,
            sender: None,
            trial: None,
            last: None,
            leave: None,
        }
    }

    /// Of the box whose settings are on this partition, with this device. A card that cannot be
    /// updated is no fault; who wants to update it is told why.
    #[must_use]
    pub fn of_box(settings: Option<(&ReadOnlyPartition, &str)>) -> Self {
        let card = Card::of_box(settings);
        if let Err(error) = &card {
            log::info!("the box is not updated over its link: {error:#}");
        }
        match card {
            Ok(card) => Self::of_card(card),
            Err(error) => Self::impossible(&format!("{error:#}")),
        }
    }

    fn of_card(card: Card) -> Self {
        let Slots { running, is_on_trial, .. } = card.slots;
        let kind = if is_on_trial { ", for one start" } else { "" };
        log::info!("running from {running}{kind}");
        let last = card.notes.read().map(|note| settled(note, running, is_on_trial));
        if let (Some(Note { update, fate: Fate::Failed(why) }), false) = (&last, is_on_trial) {
            log::error!("the update to {update} was given up: {why}");
        }
        Self { card: Ok(card), state: State::Idle, sender: None, trial: None, last, leave: None }
    }

    /// Whether this start is the one in which a new program is tried.
    #[must_use]
    pub fn is_on_trial(&self) -> bool {
        self.card.as_ref().is_ok_and(|card| card.slots.is_on_trial)
    }

    /// Whether the new program has yet to show that it works.
    #[must_use]
    pub fn is_unproven(&self) -> bool {
        self.trial.is_some()
    }

    /// The session begins; `has_key` if the box's key was read.
    pub fn begin_session(&mut self, has_key: bool) {
        if self.is_on_trial() {
            self.trial = Some(Trial::begin(has_key, Instant::now()));
        }
    }

    /// What the session is to end for, if anything.
    #[must_use]
    pub fn leave(&self) -> Option<Leave> {
        self.leave
    }

    /// Gives a trial up, for this reason; does nothing outside one.
    pub fn give_up(&mut self, why: &str) {
        if !self.is_on_trial() {
            return;
        }
        log::error!("the update is given up: {why}");
        self.trial = None;
        self.leave = Some(Leave::ToGiveUp);
        self.remember(Fate::Failed(why.to_owned()));
    }

    /// Whether parts are waited for.
    fn is_receiving(&self) -> bool {
        matches!(self.state, State::Receiving(_))
    }

    /// Whether they are taken even while somebody records a trial.
    fn receives_by_force(&self) -> bool {
        matches!(&self.state, State::Receiving(receiving) if receiving.is_forced)
    }

    /// Looks how far everything is; returns whether that took memory.
    pub fn look_after(&mut self, frames: u64, is_heard: bool) -> bool {
        self.judge(frames, is_heard) | self.look_at_writer()
    }

    fn judge(&mut self, frames: u64, is_heard: bool) -> bool {
        let Some(trial) = &mut self.trial else { return false };
        trial.see(frames, is_heard);
        match trial.verdict(Instant::now()) {
            Verdict::Open => return false,
            Verdict::Passed => self.install(),
            Verdict::Failed => {
                let why = trial.to_string();
                self.give_up(&why);
            }
        }
        true
    }

    /// Makes the program that has passed its trial the one that starts from now on.
    fn install(&mut self) {
        self.trial = None;
        let Ok(card) = &mut self.card else { return };
        match card.slots.commit() {
            Ok(()) => {
                card.slots.is_on_trial = false;
                log::info!("{} starts from now on", card.slots.running);
                self.remember(Fate::Installed);
            }
            Err(error) => self.give_up(&format!("{error:#}")),
        }
    }

    /// Keeps what became of the update that this start is the trial of.
    fn remember(&mut self, fate: Fate) {
        let Ok(card) = &self.card else { return };
        let Some(note) = &mut self.last else { return };
        note.fate = fate;
        // Without it the next start knows less, and is no other.
        if let Err(error) = card.notes.keep(note) {
            log::error!("{error:#}");
        }
    }

    fn look_at_writer(&mut self) -> bool {
        let (writer, header) = match &self.state {
            State::Receiving(receiving) => (&receiving.writer, None),
            State::Checking { header, writer } => (writer, Some(*header)),
            _ => return false,
        };
        let Some(outcome) = writer.outcome() else { return false };
        self.state = match (outcome, header) {
            (Ok(()), Some(header)) => {
                log::info!("the update to {} is on the card, as it was signed", header.version);
                State::Ready(header)
            }
            (Ok(()), None) => return false,
            (Err(error), _) => unusable(format_args!("{error:#}")),
        };
        true
    }

    /// Forgets what has come, and takes another update from this listener.
    fn begin(&mut self, sender: UpdaterId, is_forced: bool) -> UpdateOutcome {
        let card = match &self.card {
            Ok(card) => card,
            Err(why) => return refused(UpdateRefusal::NotSupported, why),
        };
        if card.slots.is_on_trial {
            let why = "the last update has not shown yet that it works";
            return refused(UpdateRefusal::Busy, why);
        }
        // What is about to be tried must be what was signed.
        if self.leave.is_some() {
            return refused(UpdateRefusal::Busy, "the box restarts with an update just now");
        }
        // The one before ends first: two must not write to the same slot.
        if matches!(self.state, State::Receiving(_) | State::Checking { .. }) {
            self.state = State::Idle;
        }
        match Writer::start(card.slots.idle()) {
            Ok(writer) => {
                self.sender = Some(sender);
                self.state = State::Receiving(Box::new(Receiving::new(writer, is_forced)));
                self.query()
            }
            Err(error) => refused(UpdateRefusal::NotStored, format_args!("{error:#}")),
        }
    }

    /// Takes a part of an update. One that leaves a gap, or for which there is no room yet, is
    /// ignored: the host asks how far it is, and sends from there again.
    fn take(&mut self, sender: UpdaterId, offset: u32, bytes: &[u8]) {
        let (Ok(card), State::Receiving(receiving)) = (&self.card, &mut self.state) else { return };
        if self.sender != Some(sender) || offset != receiving.next() {
            return;
        }
        match receiving.take(bytes, card) {
            Ok(false) => {}
            Ok(true) => {
                let state = std::mem::replace(&mut self.state, State::Idle);
                let State::Receiving(receiving) = state else { return };
                let Receiving { header: Some(header), writer, .. } = *receiving else { return };
                self.state = State::Checking { header, writer };
            }
            Err(error) => self.state = unusable(format_args!("{error:#}")),
        }
    }

    /// How far it is.
    fn query(&self) -> UpdateOutcome {
        let (state, text) = match (&self.card, &self.trial, &self.state) {
            (Err(why), ..) => return refused(UpdateRefusal::NotSupported, why),
            (_, Some(trial), _) => (UpdateState::OnTrial, trial.to_string()),
            (.., State::Receiving(receiving)) => {
                (UpdateState::Receiving { next: receiving.next() }, String::new())
            }
            (.., State::Checking { .. }) => (UpdateState::Checking, String::new()),
            (.., State::Ready(header)) => (UpdateState::Ready, header.version.to_string()),
            (.., State::Unusable(why)) => (UpdateState::Unusable, why.clone()),
            (.., State::Idle) => match &self.last {
                None => (UpdateState::None, String::new()),
                Some(Note { update, fate: Fate::Failed(why) }) => {
                    (UpdateState::GivenUp, format!("{update}: {why}"))
                }
                Some(Note { update, .. }) => (UpdateState::Installed, update.to_string()),
            },
        };
        at(state, text)
    }

    /// Has the session end, so that the update is tried.
    fn try_it(&mut self) -> UpdateOutcome {
        let (Ok(card), State::Ready(header)) = (&self.card, &self.state) else {
            return refused(UpdateRefusal::NotReady, "no update is ready");
        };
        let update = Update::of(header, card.slots.running.other());
        let words = update.to_string();
        let note = Note { update, fate: Fate::Trying };
        if let Err(error) = card.notes.keep(&note) {
            // Nobody could say afterwards what has become of it.
            return refused(UpdateRefusal::NotStored, format_args!("{error:#}"));
        }
        log::warn!("restarting with the update to {words}, to see whether it works");
        self.last = Some(note);
        self.leave = Some(Leave::ToTry);
        at(UpdateState::Restarting, words)
    }
}

/// What a note from before this start means now.
fn settled(note: Note, running: plumbline_update::card::Slot, is_on_trial: bool) -> Note {
    let Note { update, fate } = note;
    let fate = match fate {
        // It has made itself the one that starts, and had no time to say so.
        Fate::Trying if running == update.slot && !is_on_trial => Fate::Installed,
        Fate::Trying if !is_on_trial => Fate::Failed(
            "it never came to say that it works: it did not start, hung, or lost its power".into(),
        ),
        fate => fate,
    };
    Note { update, fate }
}

fn unusable(why: std::fmt::Arguments<'_>) -> State {
    log::error!("the update that was sent cannot be used: {why}");
    State::Unusable(why.to_string())
}

impl Card {
    fn of_box(settings: Option<(&ReadOnlyPartition, &str)>) -> Result<Self> {
        let (settings, device) = settings.context("it has no card")?;
        let slots = Slots::of_card_with(device)?;
        let compatible = fs::read(COMPATIBLE).context(COMPATIBLE)?;
        let board = board(&compatible).context("there are no updates for this board")?;
        let keys = keys(Path::new(KEYS))?;
        Ok(Self { slots, board, keys, notes: NoteStore::on_partition(settings) })
    }
}

/// The board of a computer with this list of names, each ended by a zero.
fn board(compatible: &[u8]) -> Option<&'static str> {
    let has = |name: &str| compatible.split(|byte| *byte == 0).any(|it| it == name.as_bytes());
    BOARDS.iter().find(|(_, name)| has(name)).map(|(board, _)| *board)
}

/// The keys of those who may make updates.
fn keys(path: &Path) -> Result<std::vec::Vec<VerifyingKey>> {
    let file = match fs::read(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            bail!("its image was made without a key for updates (--update-key)")
        }
        Err(error) => return Err(error).with_context(|| path.display().to_string()),
    };
    let keys: Option<std::vec::Vec<_>> = header::keys(&file).collect();
    let keys = keys.with_context(|| format!("{} has no keys", path.display()))?;
    ensure!(!keys.is_empty(), "{} is empty", path.display());
    Ok(keys)
}

impl Receiving {
    fn new(writer: Writer, is_forced: bool) -> Self {
        let head = Vec::new();
        Self { is_forced, head, header: None, written: 0, block: None, filled: 0, writer }
    }

    /// Where in the update the first missing byte is.
    fn next(&self) -> u32 {
        // A head and a slot are less than 4 GiB.
        (self.head.len() as u64 + self.written + self.filled as u64) as u32
    }

    /// Takes as much of the next bytes as there is room for; true when that was all of the update.
    fn take(&mut self, mut bytes: &[u8], card: &Card) -> Result<bool> {
        while !bytes.is_empty() {
            let Some(header) = self.header else {
                let (head, rest) = bytes.split_at(bytes.len().min(HEADER_BYTES - self.head.len()));
                bytes = rest;
                // There is room for it.
                let _ = self.head.extend_from_slice(head);
                self.read_head(card)?;
                continue;
            };
            let left = u64::from(header.slot_bytes) - self.written - self.filled as u64;
            let Some(block) = self.block.take().or_else(|| self.writer.block()) else {
                return Ok(false);
            };
            let block = self.block.insert(block);
            let room = (BLOCK_BYTES - self.filled).min(left.try_into().unwrap_or(BLOCK_BYTES));
            let (slot, rest) = bytes.split_at(bytes.len().min(room));
            block.bytes_mut()[self.filled..][..slot.len()].copy_from_slice(slot);
            self.filled += slot.len();
            bytes = rest;
            if slot.len() == room {
                self.hand_over();
            }
            if self.written == u64::from(header.slot_bytes) {
                self.writer.check(self.written, header.slot_hash);
                // What may follow is no part of it.
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn hand_over(&mut self) {
        if let Some(block) = self.block.take() {
            self.writer.write(self.written, block, self.filled);
            self.written += std::mem::take(&mut self.filled) as u64;
        }
    }

    /// Reads the head, once it is complete.
    fn read_head(&mut self, card: &Card) -> Result<()> {
        let Ok(head) = <&[u8; HEADER_BYTES]>::try_from(self.head.as_slice()) else { return Ok(()) };
        let header = Header::authentic(head, &card.keys)?;
        header.suits(card.board, OLDEST_ALLOWED)?;
        log::info!(
            "an update to version {} ({}) comes, {} bytes",
            header.version,
            header.commit.as_str(),
            header.slot_bytes
        );
        self.header = Some(header);
        Ok(())
    }
}

#[cfg(test)]
mod model;
#[cfg(test)]
mod tests;
