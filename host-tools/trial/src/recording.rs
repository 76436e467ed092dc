//! Records a trial: the packets as they come, what relates the box's clock to this computer's, the
//! box's configuration, and the marks. The table is
//! [`Receiver`](plumbline_stream::receiver::Receiver)'s.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{Action, Document, Message, Reply, ReplyOutcome};
use plumbline_files::{BadInput, Made};
use plumbline_stream::link::Download;
use plumbline_stream::questions::Questions;
use plumbline_stream::reception::Tap;
use plumbline_stream::transport::Event;

use super::journal::{Content, Entry, Writer};
use super::manifest::{CheckSeen, Manifest, State};
use super::mark::{Mark, Marks};
use super::{Trial, names, tables};

/// The box's clock is asked for this often.
const PING_EVERY: Duration = Duration::from_secs(1);

/// The configuration is asked for again after this time without an answer.
const CONFIG_EVERY: Duration = Duration::from_secs(2);

/// How far the box's configuration has come.
enum Fetch {
    /// It is asked for again at this time.
    Ask(Instant),
    Coming(Download),
    /// It is there, or the box does not send it.
    Done,
}

/// Is called for each mark that is written, with the seconds since the recording began.
pub type Heard = Box<dyn FnMut(&Mark, f64)>;

/// A trial that is being recorded.
pub struct Recording {
    folder: PathBuf,
    /// The folder and those above it that were made for it.
    made: Made,
    journal: Writer,
    begun: Instant,
    marks: Marks,
    heard: Heard,
    questions: Questions,
    ping_at: Instant,
    fetch: Fetch,
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
        let journal = Writer::create(&folder.join(names::JOURNAL))?;
        manifest.write(folder)?;
        plumbline_files::sync_directory(plumbline_files::directory_of(folder));
        Ok(Self {
            folder: folder.to_owned(),
            made,
            journal,
            begun: now,
            marks,
            heard,
            questions: Questions::of_tap(),
            ping_at: now,
            fetch: Fetch::Ask(now),
        })
    }

    /// Writes down what was found amiss of the box, in place of what was written before.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn note(&self, checks: Vec<CheckSeen>) -> Result<(), BadInput> {
        let mut manifest = Manifest::read(&self.folder)?;
        manifest.checks = checks;
        manifest.write(&self.folder)
    }

    /// A question to the box; its number is none of those that wait for an answer here.
    pub fn ask(&mut self, action: Action) -> Message {
        self.questions.ask(action).1
    }

    /// The box's configuration, once it has come.
    #[must_use]
    pub fn config(&self) -> Option<Config> {
        Config::decode(&std::fs::read(self.folder.join(names::CONFIG)).ok()?).ok()
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
    pub fn end(mut self, frames: u64) -> Result<Option<Trial>, BadInput> {
        if frames == 0 {
            self.discard()?;
            return Ok(None);
        }
        self.journal.sync()?;
        self.made.keep();
        make(&self.folder, Some(State::Finished)).map(Some)
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
        let host_ns = self.host_ns(at);
        self.journal.write(&Entry { host_ns, content })
    }

    fn host_ns(&self, at: Instant) -> u64 {
        at.saturating_duration_since(self.begun).as_nanos() as u64
    }

    fn message(&mut self, message: &Message, now: Instant) -> Result<(), BadInput> {
        match (&mut self.fetch, message) {
            (
                Fetch::Ask(_),
                Message::Reply(Reply { outcome: ReplyOutcome::Config { bytes, .. }, .. }),
            ) if *bytes as usize <= BLOB_BYTES_MAX => {
                self.fetch = Fetch::Coming(Download::new(Document::Config, *bytes as usize));
            }
            (Fetch::Coming(download), message) => {
                // A box that refuses or does not answer is not asked again.
                if download.take(message, now).is_err() {
                    self.fetch = Fetch::Done;
                } else if let Some(blob) = download.file() {
                    plumbline_files::replace(&self.folder.join(names::CONFIG), blob)?;
                    self.fetch = Fetch::Done;
                }
            }
            _ => {}
        }
        Ok(())
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

/// Makes everything that is derived from a trial's packets once more: the tables, and what the
/// manifest says of them. A recording that was cut off is still marked as such.
///
/// # Errors
/// When there is no trial, or the operating system refuses; the packets stay.
pub fn remake(folder: &Path) -> Result<Trial, BadInput> {
    make(folder, None)
}

fn make(folder: &Path, state: Option<State>) -> Result<Trial, BadInput> {
    tables::write(folder)?;
    let mut manifest = Manifest::read(folder)?;
    manifest.state = state.unwrap_or(manifest.state);
    manifest.write(folder)?;
    let trial = Trial::open(folder)?;
    trial.manifest.write(folder)?;
    Ok(trial)
}

impl Tap for Recording {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        match event {
            Event::Raw(raw) => self.write(now, Content::Raw(raw.clone())),
            Event::Packet(packet) => self.message(&packet.message, now),
            _ => Ok(()),
        }
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        while let Some((at, mark)) = self.marks.next() {
            let since_s = at.saturating_duration_since(self.begun).as_secs_f64();
            (self.heard)(&mark, since_s);
            self.write(at, Content::Mark(mark))?;
        }
        match &mut self.fetch {
            Fetch::Ask(at) if now >= *at => {
                *at = now + CONFIG_EVERY;
                return Ok(Some(self.questions.ask(Action::QueryConfig).1));
            }
            Fetch::Coming(download) => match download.due(now) {
                Ok(Some(action)) => {
                    let (id, question) = self.questions.ask(action);
                    download.asked(id, now);
                    return Ok(Some(question));
                }
                Ok(None) => {}
                Err(_) => self.fetch = Fetch::Done,
            },
            Fetch::Ask(_) | Fetch::Done => {}
        }
        if now < self.ping_at {
            return Ok(None);
        }
        self.ping_at = now + PING_EVERY;
        let host_sent_ns = self.host_ns(now);
        Ok(Some(self.questions.ask(Action::Ping { host_sent_ns }).1))
    }
}
