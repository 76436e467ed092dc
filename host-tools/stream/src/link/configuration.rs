//! The box's configuration, for whoever does not wait for it.

use std::time::{Duration, Instant};

use plumbline::config::BLOB_BYTES_MAX;
use plumbline::packet::{Action, Document, Message, Reply, ReplyOutcome};

use super::Download;
use crate::questions::Questions;

/// It is asked for again after this time without an answer: what is asked before the box was first heard
/// never reaches it.
const ASK_AGAIN: Duration = Duration::from_secs(2);

/// How far the box's configuration has come.
pub struct Configuration {
    state: State,
    next_crc: Option<u32>,
}

enum State {
    /// It is asked for again at this time.
    Ask(Instant),
    Coming(Download),
    /// It is there, or the box does not send it.
    Done,
}

impl Configuration {
    /// To be asked for from now on.
    #[must_use]
    pub fn wanted(now: Instant) -> Self {
        Self { state: State::Ask(now), next_crc: None }
    }

    /// The checksum of the configuration with which the box starts next, once it has told.
    #[must_use]
    pub fn next_crc(&self) -> Option<u32> {
        self.next_crc
    }

    /// Takes an answer of the box; the configuration, when it is whole.
    pub fn take(&mut self, message: &Message, now: Instant) -> Option<Vec<u8>> {
        match (&mut self.state, message) {
            (
                State::Ask(_),
                Message::Reply(Reply {
                    outcome: ReplyOutcome::Config { bytes, next_crc, .. }, ..
                }),
            ) if *bytes as usize <= BLOB_BYTES_MAX => {
                self.next_crc = Some(*next_crc);
                self.state = State::Coming(Download::new(Document::Config, *bytes as usize));
                None
            }
            (State::Coming(download), message) => {
                // A box that refuses is not asked again.
                if download.take(message, now).is_err() {
                    self.state = State::Done;
                    return None;
                }
                let blob = download.file().map(<[u8]>::to_vec)?;
                self.state = State::Done;
                Some(blob)
            }
            _ => None,
        }
    }

    /// The question that is due.
    pub fn due(&mut self, questions: &mut Questions, now: Instant) -> Option<Message> {
        match &mut self.state {
            State::Ask(at) if now >= *at => {
                *at = now + ASK_AGAIN;
                Some(questions.ask(Action::QueryConfig).1)
            }
            State::Coming(download) => match download.due(now) {
                Ok(action) => {
                    let (id, question) = questions.ask(action?);
                    download.asked(id, now);
                    Some(question)
                }
                // The network may be down for any time.
                Err(_) => {
                    self.state = State::Ask(now + ASK_AGAIN);
                    None
                }
            },
            State::Ask(_) | State::Done => None,
        }
    }
}
