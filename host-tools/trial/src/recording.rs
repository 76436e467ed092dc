//! Records a trial: the packets as they come, what relates the box's clock to this computer's, how the
//! targets look every few seconds, the box's configuration, and the marks. The table is
//! [`Receiver`](plumbline_stream::receiver::Receiver)'s.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::packet::{Action, Message};
use plumbline_files::{BadInput, Made};
use plumbline_stream::link::Configuration;
use plumbline_stream::questions::Questions;
use plumbline_stream::reception::Tap;
use plumbline_stream::transport::Event;

use super::derived;
use super::journal::{Content, Entry, Writer};
use super::manifest::{CheckSeen, Manifest, State};
use super::mark::{Mark, Marks};
use super::reading::builder::Builder;
use super::reading::{FRAMES_MAX, too_long};
use super::verdict::Verdict;
use super::{Trial, names};

/// The box's clock is asked for this often.
const PING_EVERY: Duration = Duration::from_secs(1);

/// The box is asked this often how the targets look: their light and their focus are in the trial.
const VIEW_EVERY: Duration = Duration::from_secs(10);

/// A view is asked for again after this time without an answer.
const ASK_AGAIN: Duration = Duration::from_secs(2);

/// The box is told this often that a trial is being recorded.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// What is counted and not kept is noted at most this often.
const NOTE_EVERY: Duration = Duration::from_secs(1);

/// Is called for each mark that is written, and for each trigger of the box as it comes, with the
/// seconds since the recording began.
pub type Heard = Box<dyn FnMut(&Mark, f64)>;

/// A trial that is being recorded.
pub struct Recording {
    folder: PathBuf,
    /// The folder and those above it that were made for it.
    made: Made,
    journal: Writer,
    /// The trial as far as it has come, where it is judged meanwhile.
    builder: Option<Builder>,
    /// What the box runs with, once it has told.
    config: Option<Config>,
    /// The packets that were written.
    packets: usize,
    begun: Instant,
    marks: Marks,
    heard: Heard,
    questions: Questions,
    ping_at: Instant,
    view_at: Instant,
    configuration: Configuration,
    /// Whether the box has said anything.
    is_heard: bool,
    /// When the box is told again that a trial is being recorded.
    tell_at: Instant,
    /// Packets that came damaged or were not the box's; how many of them the journal knows of, and
    /// when it may be told of more.
    not_authentic: u64,
    noted: u64,
    note_at: Instant,
}

impl Recording {
    /// Makes the folder and begins to record at `now`. `heard` is called for each mark.
    ///
    /// # Errors
    /// When the folder exists, or cannot be written to.
    pub fn begin(
        folder: &Path,
        manifest: &Manifest,
        marks: Marks,
        now: Instant,
        heard: Heard,
    ) -> Result<Self, BadInput> {
        if folder.exists() {
            return Err(exists_already(folder));
        }
        let made = Made::directories(folder)?;
        let mut journal = Writer::create(&folder.join(names::JOURNAL))?;
        for content in manifest.said() {
            journal.write(&Entry { host_ns: 0, content })?;
        }
        manifest.write(folder)?;
        plumbline_files::sync_directory(plumbline_files::directory_of(folder));
        let as_if_over = Manifest { state: State::Finished, ..manifest.clone() };
        let builder = Builder::new(folder, as_if_over, None, None);
        Ok(Self {
            folder: folder.to_owned(),
            made,
            journal,
            builder: Some(builder),
            config: None,
            packets: 0,
            begun: now,
            marks,
            heard,
            questions: Questions::of_tap(),
            ping_at: now,
            view_at: now,
            configuration: Configuration::wanted(now),
            is_heard: false,
            tell_at: now,
            not_authentic: 0,
            noted: 0,
            note_at: now,
        })
    }

    /// The same, without a [`verdict`](Self::verdict) before it ends: then it keeps nothing of what it has
    /// written, and takes the same memory however long it lasts.
    #[must_use]
    pub fn unjudged(self) -> Self {
        Self { builder: None, ..self }
    }

    /// Writes down what was found amiss of the box meanwhile.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn note(&mut self, checks: Vec<CheckSeen>) -> Result<(), BadInput> {
        for check in checks.iter().filter_map(CheckSeen::said) {
            self.write(Instant::now(), check)?;
        }
        let mut manifest = Manifest::read(&self.folder)?;
        manifest.checks.extend(checks);
        manifest.write(&self.folder)
    }

    /// A question to the box; its number is none of those that wait for an answer here.
    pub fn ask(&mut self, action: Action) -> Message {
        self.questions.ask(action).1
    }

    /// The box's configuration, once it has come.
    #[must_use]
    pub fn config(&self) -> Option<&Config> {
        self.config.as_ref()
    }

    /// The verdict on the trial, if it ended now: the one that [`end`](Self::end) then writes. It
    /// looks at all frames until now. Where nothing is kept for it, it is good without a reason.
    pub fn verdict(&mut self) -> Verdict {
        self.builder.as_mut().map(Builder::judged).unwrap_or_default()
    }

    /// The trial's folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file for the table of samples.
    #[must_use]
    pub fn csv(&self) -> PathBuf {
        self.folder.join(names::CSV)
    }

    /// The number of marks for which there was no room.
    #[must_use]
    pub fn marks_dropped(&self) -> u64 {
        self.marks.dropped()
    }

    /// Ends the recording: everything is on the disk, and the manifest says what came. A trial
    /// without a frame leaves no folder.
    ///
    /// # Errors
    /// When the operating system refuses; what was recorded stays.
    pub fn end(self, frames: u64) -> Result<Option<Trial>, BadInput> {
        self.close(frames)?.map(Closed::judge).transpose()
    }

    /// Ends the recording as [`end`](Self::end) does, and leaves to its caller when the frames are read
    /// once more and judged, which takes a while: it may be done in another thread.
    ///
    /// # Errors
    /// When the operating system refuses; what was recorded stays.
    pub fn close(mut self, frames: u64) -> Result<Option<Closed>, BadInput> {
        if frames == 0 {
            self.discard()?;
            return Ok(None);
        }
        let manifest = Manifest { state: State::Finished, ..Manifest::read(&self.folder)? };
        if let Some(about) = manifest.about() {
            self.write(Instant::now(), Content::About(about))?;
        }
        self.journal.sync()?;
        self.made.keep();
        Ok(Some(Closed { folder: self.folder, manifest }))
    }

    fn discard(self) -> Result<(), BadInput> {
        let Self { folder, made, journal, .. } = self;
        drop(journal);
        // Only the files that were made here: somebody may have put others beside them.
        for name in [names::JOURNAL, names::MANIFEST, names::CONFIG] {
            let path = folder.join(name);
            if path.exists() {
                std::fs::remove_file(&path)
                    .map_err(|error| BadInput::io(path.display(), &error))?;
            }
        }
        drop(made);
        Ok(())
    }

    fn write(&mut self, at: Instant, content: Content) -> Result<(), BadInput> {
        let entry = Entry { host_ns: self.host_ns(at), content };
        self.journal.write(&entry)?;
        self.packets += usize::from(matches!(entry.content, Content::Raw(_)));
        let frames = match &mut self.builder {
            Some(builder) => {
                builder.take(entry);
                builder.trial().frames.len()
            }
            None => self.packets,
        };
        // A trial of more frames could not be read.
        if frames >= FRAMES_MAX {
            return Err(too_long(&self.folder));
        }
        Ok(())
    }

    fn host_ns(&self, at: Instant) -> u64 {
        at.saturating_duration_since(self.begun).as_nanos() as u64
    }

    fn message(&mut self, message: &Message, now: Instant) -> Result<(), BadInput> {
        if matches!(message, Message::View(_)) {
            self.view_at = now + VIEW_EVERY;
        }
        if let Some(blob) = self.configuration.take(message, now) {
            plumbline_files::replace(&self.folder.join(names::CONFIG), &blob)?;
            if let Ok(config) = Config::decode(&blob) {
                if let Some(builder) = &mut self.builder {
                    builder.take_config(config.clone());
                }
                self.config = Some(config);
            }
        }
        Ok(())
    }
}

/// A recording that has ended: everything is on the disk, and what is derived from it is still to be made.
#[derive(Debug)]
pub struct Closed {
    folder: PathBuf,
    manifest: Manifest,
}

impl Closed {
    /// The trial's folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Reads all frames once more, makes the tables, and judges the trial.
    ///
    /// # Errors
    /// When the operating system refuses; what was recorded stays.
    pub fn judge(self) -> Result<Trial, BadInput> {
        derived::make(&self.folder, self.manifest)
    }
}

/// A folder that exists is not recorded into.
#[must_use]
pub fn exists_already(folder: &Path) -> BadInput {
    BadInput::whole(
        folder.display(),
        "exists already",
        "give another --out: nothing that was recorded is overwritten",
    )
}

impl Tap for Recording {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        match event {
            Event::Raw(raw) => self.write(now, Content::Raw(raw.clone())),
            Event::Packet(packet) => {
                self.is_heard = true;
                if let Message::Trigger(trigger) = &packet.message {
                    let since_s = now.saturating_duration_since(self.begun).as_secs_f64();
                    (self.heard)(&Mark::of_trigger(trigger), since_s);
                }
                self.message(&packet.message, now)
            }
            Event::NotAuthentic | Event::Bad(_) => {
                self.not_authentic += 1;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        let host_ns = self.host_ns(now);
        if let Some(builder) = &mut self.builder {
            builder.pass(host_ns);
        }
        while let Some((at, mark)) = self.marks.next() {
            let since_s = at.saturating_duration_since(self.begun).as_secs_f64();
            (self.heard)(&mark, since_s);
            self.write(at, Content::Mark(mark))?;
        }
        if self.noted != self.not_authentic && now >= self.note_at {
            self.note_at = now + NOTE_EVERY;
            self.noted = self.not_authentic;
            self.write(now, Content::NotAuthentic(self.not_authentic))?;
        }
        // Without a session there is nobody to ask.
        if !self.is_heard {
            return Ok(None);
        }
        if now >= self.tell_at {
            self.tell_at = now + TELL_EVERY;
            return Ok(Some(self.questions.ask(Action::Record { on: true }).1));
        }
        if let Some(question) = self.configuration.due(&mut self.questions, now) {
            return Ok(Some(question));
        }
        if now >= self.view_at {
            self.view_at = now + ASK_AGAIN;
            return Ok(Some(self.questions.ask(Action::SendView).1));
        }
        if now < self.ping_at {
            return Ok(None);
        }
        self.ping_at = now + PING_EVERY;
        let host_sent_ns = self.host_ns(now);
        Ok(Some(self.questions.ask(Action::Ping { host_sent_ns }).1))
    }
}

#[cfg(test)]
mod tests;
