//! Trials that are over are judged here, in a thread of their own: their frames are read once more, which
//! takes a while. What comes of it is kept in the outbox.
//!
//! A file below `due` says which trials have no verdict yet, so that none is forgotten when the gateway is
//! ended in between.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use plumbline_files::BadInput;
use plumbline_trial::recording::Closed;
use plumbline_trial::{Trial, derived};
use serde::{Deserialize, Serialize};

use crate::kept::Message;
use crate::notices::Notices;
use crate::outbox::Outbox;
use crate::payload::{Summary, TrialSaid, Verdict};
use crate::topics::{About, Topics};

/// The wait for a trial.
const WAIT: Duration = Duration::from_millis(100);

/// A trial without a verdict.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Due {
    /// The box, as topics call it.
    pub level: String,
    /// The trial's number.
    pub trial: String,
    /// What it was called.
    pub name: Option<String>,
    /// Its folder.
    pub folder: PathBuf,
}

impl Due {
    fn path(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}--{}.json", self.level, self.trial))
    }

    /// Notes that this trial will need a verdict.
    pub fn note(&self, folder: &Path) -> Result<(), BadInput> {
        let path = self.path(folder);
        let text = serde_json::to_vec(self)
            .map_err(|error| BadInput::whole(path.display(), error, "report it: texts are JSON"))?;
        plumbline_files::replace(&path, &text)
    }

    /// It can have none: the file is put aside, so that it is not tried again at every start.
    fn put_aside(&self, folder: &Path) {
        let path = self.path(folder);
        let _ = std::fs::rename(&path, path.with_extension("unjudged"));
    }

    /// It needs none any more.
    pub fn forget(&self, folder: &Path) {
        // One that stays is judged once more after the next start, which does no harm.
        let _ = std::fs::remove_file(self.path(folder));
    }
}

/// A trial that is over.
struct Job {
    due: Due,
    /// `None`: the gateway was ended while it was recorded.
    closed: Option<Closed>,
}

/// What is counted of trials.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub begun: AtomicU64,
    pub judged: AtomicU64,
    pub waiting: AtomicUsize,
}

/// The thread that judges.
pub(crate) struct Judge {
    sender: SyncSender<Job>,
    thread: JoinHandle<()>,
    pub counts: Arc<Counts>,
    room: usize,
}

/// What the thread has.
struct Worker {
    inbox: Receiver<Job>,
    folder: PathBuf,
    topics: Topics,
    outbox: Arc<Outbox>,
    notices: Arc<Notices>,
    counts: Arc<Counts>,
    /// Whether the names of trials are published.
    names: bool,
    /// At once, whatever waits: what waits is judged after the next start.
    stop: Arc<AtomicBool>,
}

impl Judge {
    /// Starts the thread; `room` trials can wait. Those that an earlier run has left wait first.
    ///
    /// # Errors
    /// When the folder of what is due cannot be used, or the system gives no thread.
    pub fn start(
        folder: PathBuf,
        topics: Topics,
        (outbox, notices): (Arc<Outbox>, Arc<Notices>),
        names: bool,
        room: usize,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, BadInput> {
        plumbline_files::make_directory(&folder)?;
        let left = left(&folder, &notices)?;
        let room = room.max(left.len());
        let (sender, inbox) = sync_channel(room);
        let counts = Arc::<Counts>::default();
        let worker = Worker {
            inbox,
            folder,
            topics,
            outbox,
            notices,
            counts: Arc::clone(&counts),
            names,
            stop,
        };
        let thread = std::thread::Builder::new()
            .name("judge".to_owned())
            .spawn(move || worker.run())
            .map_err(|error| BadInput::io("a thread for verdicts", &error))?;
        let judge = Self { sender, thread, counts, room };
        for due in left {
            judge.counts.begun.fetch_add(1, Ordering::Relaxed);
            judge.hand_over(due, None);
        }
        Ok(judge)
    }

    /// Whether another trial can be judged.
    pub fn has_room(&self) -> bool {
        self.counts.waiting.load(Ordering::Relaxed) < self.room
    }

    /// A trial is over. Without room it is judged after the next start.
    pub fn hand_over(&self, due: Due, closed: Option<Closed>) -> bool {
        self.counts.waiting.fetch_add(1, Ordering::Relaxed);
        let handed = self.sender.try_send(Job { due, closed });
        if handed.is_err() {
            self.counts.waiting.fetch_sub(1, Ordering::Relaxed);
        }
        handed.is_ok()
    }

    /// Nothing more comes: what waits is judged, unless it is stopped.
    pub fn end(self) {
        drop(self.sender);
        // A thread that has panicked has said so.
        let _ = self.thread.join();
    }
}

/// The trials that an earlier run has left without a verdict.
fn left(folder: &Path, notices: &Notices) -> Result<Vec<Due>, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(folder.display(), &error);
    let mut left = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.extension().is_none_or(|it| it != "json") {
            continue;
        }
        let read = plumbline_files::read_text(&path).and_then(|text| {
            serde_json::from_str::<Due>(&text).map_err(|error| {
                let remedy = "remove it; its trial is still there, and has a verdict of its own by \
                              `plumb replay TRIAL --tables`";
                BadInput::whole(path.display(), error, remedy)
            })
        });
        match read {
            Ok(due) => left.push(due),
            Err(error) => notices.say(format!("warning: {error}")),
        }
    }
    left.sort_by(|one, other| one.trial.cmp(&other.trial));
    Ok(left)
}

impl Worker {
    fn run(self) {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return;
            }
            match self.inbox.recv_timeout(WAIT) {
                Ok(job) => {
                    let Job { due, closed } = job;
                    // What failed once is tried again after the next start.
                    let is_second = closed.is_none();
                    if let Err(error) = self.judge(&due, closed) {
                        if is_second {
                            due.put_aside(&self.folder);
                        }
                        self.notices.say(format!(
                            "warning: {}: trial {} has no verdict: {error}",
                            due.level, due.trial
                        ));
                    }
                    self.counts.waiting.fetch_sub(1, Ordering::Relaxed);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn judge(&self, due: &Due, closed: Option<Closed>) -> Result<(), BadInput> {
        let was_cut_off = closed.is_none();
        let trial = match closed {
            Some(closed) => closed.judge()?,
            None if !due.folder.exists() => {
                // Nothing came of it.
                due.forget(&self.folder);
                return Ok(());
            }
            None => derived::remake(&due.folder, &derived::Changes::default())?,
        };
        self.publish(due, &trial, was_cut_off)?;
        due.forget(&self.folder);
        self.counts.judged.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn publish(&self, due: &Due, trial: &Trial, was_cut_off: bool) -> Result<(), BadInput> {
        let name = due.name.clone().filter(|_| self.names);
        let said = TrialSaid { trial: due.trial.clone(), name };
        let verdict = Verdict::on(trial, said.clone(), was_cut_off);
        let summary = Summary::of(trial, said);
        self.keep(&due.level, About::Verdict, &verdict)?;
        self.keep(&due.level, About::Summary, &summary)?;
        self.notices.say(format!("{}: trial {} is {}", due.level, due.trial, verdict.grade()));
        Ok(())
    }

    fn keep(&self, level: &str, about: About, said: &impl Serialize) -> Result<(), BadInput> {
        let topic = self.topics.of_box(level, about);
        let payload = serde_json::to_string(said)
            .map_err(|error| BadInput::whole(&topic, error, "report it: this is JSON"))?;
        self.outbox.keep(&Message { topic, payload })
    }
}
