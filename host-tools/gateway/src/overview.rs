//! How everything is, for people: the boxes, the records, the broker.

use plumbline_desk::wire::{CheckState, HealthState};

use crate::outbox::{Counts, Standing};

/// Whether a box is heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hearing {
    /// It is looked for.
    Searching,
    /// It is heard.
    Heard,
    /// It was heard, and is silent.
    Silent,
    /// The gateway has ended, and does not know.
    Unknown,
}

/// What is done with a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doing {
    /// It is listened to.
    Watching,
    /// A trial is recorded.
    Recording,
    /// A trial is over, and what was lost of it on the way is still coming.
    Ending,
}

/// What was counted of a box since the gateway was started.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct BoxCounts {
    /// Frames that have come.
    pub frames: u64,
    /// Frames that have not.
    pub lost: u64,
    /// Frames that came after a later one.
    pub late: u64,
    /// Packets that were not the box's.
    pub not_authentic: u64,
}

/// A box.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxNow {
    /// What topics and folders call it.
    pub level: String,
    /// The identity of its key.
    pub id: String,
    /// Its name.
    pub name: String,
    /// Its serial number.
    pub serial_number: Option<String>,
    /// Whether it is heard.
    pub hearing: Hearing,
    /// Since when, UTC.
    pub since: String,
    /// What is done with it.
    pub doing: Doing,
    /// The number of the trial that is recorded.
    pub trial: Option<String>,
    /// What is amiss, and what to do.
    pub problem: Option<(String, String)>,
    /// Frames per second, lately.
    pub rate_hz: f64,
    /// From exposure to its packet, of the latest frame.
    pub latency_ms: Option<f64>,
    /// What was counted.
    pub counts: BoxCounts,
    /// How it is, by its own word.
    pub health: Option<HealthState>,
    /// What the doctor found last, the worst first; when, UTC.
    pub examination: Option<(String, Vec<CheckState>)>,
    /// Where it is.
    pub address: Option<std::net::SocketAddr>,
}

/// Everything.
#[derive(Debug, Clone, PartialEq)]
pub struct Overview {
    /// The boxes, in the order of their names.
    pub boxes: Vec<BoxNow>,
    /// How it stands with the broker.
    pub standing: Standing,
    /// What was counted of messages.
    pub broker: Counts,
    /// The messages that wait: states and answers, and those kept on the disk.
    pub waiting: (usize, usize),
    /// Trials that were begun.
    pub trials_begun: u64,
    /// Trials whose verdict is in the outbox, or has been delivered.
    pub trials_judged: u64,
    /// Trials that are over and wait for their verdict.
    pub trials_waiting: usize,
    /// Datagrams of nobody that is known.
    pub datagrams_unknown: u64,
    /// Datagrams of boxes that were dropped, because too many waited.
    pub datagrams_dropped: u64,
    /// Datagrams that the operating system has dropped, as far as it tells.
    pub datagrams_dropped_by_system: Option<u64>,
}

impl Overview {
    /// The boxes that are heard.
    #[must_use]
    pub fn heard(&self) -> usize {
        self.boxes.iter().filter(|it| it.hearing == Hearing::Heard).count()
    }

    /// The boxes of which a trial is recorded.
    #[must_use]
    pub fn recording(&self) -> usize {
        self.boxes.iter().filter(|it| it.doing == Doing::Recording).count()
    }

    /// The frames that have come from all boxes.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.boxes.iter().map(|it| it.counts.frames).sum()
    }

    /// The frames that have not.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.boxes.iter().map(|it| it.counts.lost).sum()
    }

    /// In one line.
    #[must_use]
    pub fn line(&self) -> String {
        let broker = match &self.standing {
            Standing::Up(_) => "broker up".to_owned(),
            Standing::Down(since, _) => format!("broker AWAY for {} s", since.elapsed().as_secs()),
        };
        let rate_hz: f64 = self.boxes.iter().map(|it| it.rate_hz).sum();
        format!(
            "{} of {} boxes heard, {} recording, {rate_hz:.0} frames/s, {} frames, {} lost; {} of {} \
             trials judged; {broker}, {} published, {} waiting, {} kept",
            self.heard(),
            self.boxes.len(),
            self.recording(),
            self.frames(),
            self.lost(),
            self.trials_judged,
            self.trials_begun,
            self.broker.published,
            self.waiting.0,
            self.waiting.1,
        )
    }

    /// What came of it all, in one line.
    #[must_use]
    pub fn summary(&self) -> String {
        format!(
            "{} frames of {} boxes, {} lost; {} trials, {} of them judged; {} messages published, {} kept \
             for the next start",
            self.frames(),
            self.boxes.len(),
            self.lost(),
            self.trials_begun,
            self.trials_judged,
            self.broker.published,
            self.waiting.1,
        )
    }

    /// What had to be dropped, in words.
    #[must_use]
    pub fn amiss(&self) -> Vec<String> {
        let counted = [
            (self.broker.kept_dropped, "verdicts and summaries were dropped: too many were kept"),
            (self.broker.refused, "messages were not taken by the broker: check its ACL"),
            (self.broker.answers_dropped, "answers to commands were dropped: the broker was away"),
            (self.datagrams_dropped, "datagrams of boxes were dropped, and asked for again"),
        ];
        let amiss = counted.into_iter().filter(|(count, _)| *count > 0);
        amiss.map(|(count, words)| format!("{count} {words}")).collect()
    }
}
