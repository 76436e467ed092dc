//! What waits for the broker, and what is on its way.
//!
//! ```text
//! states ─▶ latest: one for each topic, the newest counts ─┐
//! answers to commands ─▶ a short queue ────────────────────┼─▶ a window of 16 ─▶ broker ─▶ acknowledged
//! verdicts, summaries ─▶ kept on the disk ─────────────────┘
//! ```
//!
//! Everything is published with QoS 1: a message leaves here when the broker has acknowledged it. When a
//! connection begins, every state is published once more, because the broker may have forgotten them; then
//! what is kept, in its order. Whatever had no acknowledgement when a connection ended is sent again on
//! the next one, so that a message may come twice.

use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use plumbline_files::BadInput;
use rumqttc::v5::AsyncClient;
use rumqttc::v5::mqttbytes::QoS;
use rumqttc::v5::mqttbytes::v5::{Filter, PublishProperties, RetainForwardRule};

use crate::kept::{Kept, Message};
use crate::notices::Notices;

/// The messages that are on their way at once. Brokers allow 20 and more.
pub const WINDOW: u16 = 16;

/// The most topics with a state; more than a gateway has.
const TOPICS_MAX: usize = 100_000;

/// The answers that wait.
const ANSWERS_MAX: usize = 256;

/// An answer is of no use after this time.
const ANSWER_EXPIRES_S: u32 = 60;

/// A topic that the broker refuses is told of once.
const REFUSED_TOLD_MAX: usize = 100;

/// A state that is published.
#[derive(Debug, Clone)]
struct Latest {
    payload: String,
    expires_s: Option<u32>,
    is_due: bool,
}

/// An answer to a command.
#[derive(Debug, Clone)]
pub struct Answer {
    /// The topic that the command named.
    pub topic: String,
    /// What the command wants to find in its answer.
    pub correlation: Option<Vec<u8>>,
    /// The answer.
    pub payload: String,
}

/// A message on its way.
#[derive(Debug, Clone)]
enum Sent {
    State { topic: String },
    Answer,
    Kept { number: u64, topic: String },
}

/// How it stands with the broker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Standing {
    /// There is a connection, since then.
    Up(Instant),
    /// There is none, since then, and why.
    Down(Instant, String),
}

/// What was counted since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Messages that the broker has acknowledged.
    pub published: u64,
    /// States that a newer one has replaced before they were sent.
    pub replaced: u64,
    /// Answers for which there was no room, or no connection.
    pub answers_dropped: u64,
    /// Verdicts and summaries that had to be dropped: too many, or damaged files.
    pub kept_dropped: u64,
    /// Messages that the broker did not take.
    pub refused: u64,
    /// Connections that were opened.
    pub connections: u64,
}

#[derive(Debug)]
struct Inner {
    latest: BTreeMap<String, Latest>,
    /// The topics of states that are due.
    due: VecDeque<String>,
    answers: VecDeque<Answer>,
    kept: Kept,
    /// The last kept message that was sent on this connection.
    kept_sent: u64,
    client: Option<AsyncClient>,
    /// Handed over, and without a packet number yet; then with one.
    handed: VecDeque<Sent>,
    flying: HashMap<u16, Sent>,
    standing: Standing,
    counts: Counts,
    refused_told: HashSet<String>,
}

/// What waits for the broker.
#[derive(Debug)]
pub struct Outbox {
    inner: Mutex<Inner>,
    notices: Arc<Notices>,
}

impl Outbox {
    /// Opens the folder of what is kept.
    ///
    /// # Errors
    /// When it cannot be used.
    pub fn open(folder: PathBuf, notices: Arc<Notices>) -> Result<Self, BadInput> {
        let inner = Inner {
            latest: BTreeMap::new(),
            due: VecDeque::new(),
            answers: VecDeque::new(),
            kept: Kept::open(folder)?,
            kept_sent: 0,
            client: None,
            handed: VecDeque::new(),
            flying: HashMap::new(),
            standing: Standing::Down(Instant::now(), "not connected yet".to_owned()),
            counts: Counts::default(),
            refused_told: HashSet::new(),
        };
        Ok(Self { inner: Mutex::new(inner), notices })
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        // What is in it is whole after every statement.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The newest state of a topic. It is retained, and expires at the broker after this time, if any.
    pub fn state(&self, topic: String, payload: String, expires_s: Option<u32>) {
        let mut inner = self.inner();
        if !inner.latest.contains_key(&topic) && inner.latest.len() >= TOPICS_MAX {
            return;
        }
        let state = inner.latest.entry(topic.clone()).or_insert(Latest {
            payload: String::new(),
            expires_s,
            is_due: false,
        });
        state.payload = payload;
        state.expires_s = expires_s;
        if std::mem::replace(&mut state.is_due, true) {
            inner.counts.replaced += 1;
        } else {
            inner.due.push_back(topic);
        }
        self.fill(&mut inner);
    }

    /// An answer to a command. Without a connection it is of no use.
    pub fn answer(&self, answer: Answer) {
        let mut inner = self.inner();
        if inner.client.is_none() || inner.answers.len() >= ANSWERS_MAX {
            inner.counts.answers_dropped += 1;
            return;
        }
        inner.answers.push_back(answer);
        self.fill(&mut inner);
    }

    /// A message that is kept on the disk until the broker has it. It is retained.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn keep(&self, message: &Message) -> Result<(), BadInput> {
        let mut inner = self.inner();
        inner.kept.add(message)?;
        self.fill(&mut inner);
        Ok(())
    }

    /// How it stands with the broker.
    #[must_use]
    pub fn standing(&self) -> Standing {
        self.inner().standing.clone()
    }

    /// What was counted.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let inner = self.inner();
        Counts { kept_dropped: inner.kept.dropped(), ..inner.counts }
    }

    /// The messages that wait: states and answers, and those that are kept on the disk.
    #[must_use]
    pub fn waiting(&self) -> (usize, usize) {
        let inner = self.inner();
        (inner.due.len() + inner.answers.len(), inner.kept.count())
    }

    /// Whether the broker has everything, as far as it takes it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        let inner = self.inner();
        inner.due.is_empty()
            && inner.answers.is_empty()
            && inner.handed.is_empty()
            && inner.flying.is_empty()
            && inner.kept.count() == 0
    }

    /// A connection begins; commands come from this topic, if they are taken.
    pub(crate) fn up(&self, client: AsyncClient, commands: Option<String>) {
        let mut inner = self.inner();
        inner.counts.connections += 1;
        inner.standing = Standing::Up(Instant::now());
        if let Some(path) = commands {
            let mut filter = Filter::new(path, QoS::AtLeastOnce);
            // What was said before is none of our business.
            filter.retain_forward_rule = RetainForwardRule::Never;
            // One that is retained stays for others: it is seen as such, and refused.
            filter.preserve_retain = true;
            // The queue of a new client is empty.
            let _ = client.try_subscribe_many([filter]);
        }
        inner.client = Some(client);
        let Inner { latest, due, .. } = &mut *inner;
        due.clear();
        for (topic, state) in latest {
            state.is_due = true;
            due.push_back(topic.clone());
        }
        self.fill(&mut inner);
    }

    /// The connection has ended, or could not be opened.
    pub(crate) fn down(&self, why: String) {
        let mut inner = self.inner();
        let since = match &inner.standing {
            Standing::Down(since, _) => *since,
            Standing::Up(_) => Instant::now(),
        };
        inner.standing = Standing::Down(since, why);
        inner.client = None;
        inner.kept_sent = 0;
        inner.handed.clear();
        inner.flying.clear();
        let answers = inner.answers.len() as u64;
        inner.counts.answers_dropped += answers;
        inner.answers.clear();
    }

    /// The client says goodbye to the broker.
    pub(crate) fn leave(&self) {
        if let Some(client) = &self.inner().client {
            let _ = client.try_disconnect();
        }
    }

    /// The next message that was handed over has this packet number.
    pub(crate) fn numbered(&self, number: u16) {
        let mut inner = self.inner();
        if let Some(sent) = inner.handed.pop_front() {
            inner.flying.insert(number, sent);
        }
    }

    /// The broker has acknowledged a packet; why it does not take it, if it does not.
    pub(crate) fn acknowledged(&self, number: u16, refusal: Option<String>) {
        let mut inner = self.inner();
        let Some(sent) = inner.flying.remove(&number) else { return };
        if let Some(why) = refusal {
            inner.counts.refused += 1;
            let topic = match sent {
                // It stays, and is tried again on the next connection.
                Sent::State { topic } | Sent::Kept { topic, .. } => topic,
                Sent::Answer => "an answer to a command".to_owned(),
            };
            if inner.refused_told.len() < REFUSED_TOLD_MAX
                && inner.refused_told.insert(topic.clone())
            {
                self.notices.say(format!(
                    "warning: the broker does not take {topic}: {why}; check what its ACL allows this \
                     user"
                ));
            }
        } else {
            inner.counts.published += 1;
            if let Sent::Kept { number, .. } = sent {
                inner.kept.delivered(number);
            }
        }
        self.fill(&mut inner);
    }

    /// Hands over as much as the window allows.
    fn fill(&self, inner: &mut Inner) {
        let Some(client) = inner.client.clone() else { return };
        while inner.handed.len() + inner.flying.len() < usize::from(WINDOW) {
            let Some((sent, published)) = self.next(inner) else { return };
            let Published { topic, payload, retain, properties } = published;
            let handed = client.try_publish_with_properties(
                topic,
                QoS::AtLeastOnce,
                retain,
                payload,
                properties,
            );
            // It holds more than the window; when the connection has just ended, nothing may be lost.
            if handed.is_err() {
                match sent {
                    Sent::State { topic } => {
                        if let Some(state) = inner.latest.get_mut(&topic) {
                            state.is_due = true;
                            inner.due.push_front(topic);
                        }
                    }
                    Sent::Kept { number, .. } => inner.kept_sent = number - 1,
                    Sent::Answer => inner.counts.answers_dropped += 1,
                }
                return;
            }
            inner.handed.push_back(sent);
        }
    }

    /// The next message: first answers, which somebody waits for, then states, then what is kept.
    fn next(&self, inner: &mut Inner) -> Option<(Sent, Published)> {
        if let Some(Answer { topic, correlation, payload }) = inner.answers.pop_front() {
            let properties = PublishProperties {
                correlation_data: correlation.map(Into::into),
                message_expiry_interval: Some(ANSWER_EXPIRES_S),
                ..json()
            };
            return Some((Sent::Answer, Published { topic, payload, retain: false, properties }));
        }
        while let Some(topic) = inner.due.pop_front() {
            let Some(state) = inner.latest.get_mut(&topic) else { continue };
            state.is_due = false;
            let properties =
                PublishProperties { message_expiry_interval: state.expires_s, ..json() };
            let payload = state.payload.clone();
            let sent = Sent::State { topic: topic.clone() };
            return Some((sent, Published { topic, payload, retain: true, properties }));
        }
        loop {
            match inner.kept.after(inner.kept_sent) {
                Ok(None) => return None,
                Ok(Some((number, Message { topic, payload }))) => {
                    inner.kept_sent = number;
                    let sent = Sent::Kept { number, topic: topic.clone() };
                    let properties = json();
                    return Some((sent, Published { topic, payload, retain: true, properties }));
                }
                Err(error) => self.notices.say(format!("warning: {error}")),
            }
        }
    }
}

/// A message as it is handed over.
struct Published {
    topic: String,
    payload: String,
    retain: bool,
    properties: PublishProperties,
}

fn json() -> PublishProperties {
    PublishProperties {
        payload_format_indicator: Some(1),
        content_type: Some("application/json".to_owned()),
        ..PublishProperties::default()
    }
}

#[cfg(test)]
mod tests {
    use rumqttc::v5::{EventLoop, MqttOptions};

    use super::*;

    fn outbox() -> (tempfile::TempDir, Outbox) {
        let folder = tempfile::tempdir().unwrap();
        let outbox = Outbox::open(folder.path().join("outbox"), Arc::default()).unwrap();
        (folder, outbox)
    }

    /// A client whose connection nobody serves.
    fn client() -> (AsyncClient, EventLoop) {
        AsyncClient::new(MqttOptions::new("test", "localhost", 1), 1000)
    }

    fn keep(outbox: &Outbox, number: usize) {
        let message = Message { topic: "t/verdict".into(), payload: number.to_string() };
        outbox.keep(&message).unwrap();
    }

    #[test]
    fn of_a_state_only_the_newest_waits_and_everything_is_due_on_a_new_connection() {
        let (_folder, outbox) = outbox();
        for value in 0..1000 {
            outbox.state("t/state".into(), value.to_string(), None);
        }
        outbox.state("t/health".into(), "0".into(), Some(3));
        assert_eq!(outbox.waiting(), (2, 0));
        assert_eq!(outbox.counts().replaced, 999);
        let (first, _connection) = client();
        outbox.up(first, None);
        assert_eq!(outbox.waiting(), (0, 0));
        assert!(!outbox.is_empty());
        outbox.numbered(1);
        outbox.acknowledged(1, None);
        outbox.down("gone".into());
        // The broker may have forgotten both.
        let (second, _connection) = client();
        outbox.up(second, None);
        for number in 1..=2 {
            outbox.numbered(number);
            outbox.acknowledged(number, None);
        }
        assert!(outbox.is_empty());
        assert_eq!((outbox.counts().published, outbox.counts().connections), (3, 2));
    }

    #[test]
    fn what_is_kept_goes_only_when_it_is_acknowledged() {
        let (_folder, outbox) = outbox();
        for number in 0..100 {
            keep(&outbox, number);
        }
        let (first, _connection) = client();
        outbox.up(first, None);
        // No more than the window is on its way.
        for number in 1..=WINDOW {
            outbox.numbered(number);
        }
        assert_eq!(outbox.waiting(), (0, 100));
        outbox.acknowledged(3, None);
        // One that the broker does not take stays.
        outbox.acknowledged(4, Some("NotAuthorized".into()));
        assert_eq!((outbox.waiting().1, outbox.counts().refused), (99, 1));
        outbox.down("gone".into());
        let (second, _connection) = client();
        outbox.up(second, None);
        for turn in 0..99 {
            let number = turn % WINDOW + 1;
            outbox.numbered(number);
            outbox.acknowledged(number, None);
        }
        assert!(outbox.is_empty());
        // An acknowledgement of something else changes nothing.
        outbox.acknowledged(9, None);
        assert_eq!(outbox.counts().published, 100);
    }

    #[test]
    fn answers_are_for_those_who_wait_for_them() {
        let (_folder, outbox) = outbox();
        let answer =
            || Answer { topic: "t/reply/x".into(), correlation: None, payload: "{}".into() };
        outbox.answer(answer());
        assert_eq!((outbox.waiting(), outbox.counts().answers_dropped), ((0, 0), 1));
        let (first, _connection) = client();
        outbox.up(first, None);
        for _ in 0..2 * ANSWERS_MAX {
            outbox.answer(answer());
        }
        assert_eq!(outbox.waiting().0, ANSWERS_MAX);
        let before = outbox.counts().answers_dropped;
        assert_eq!(before, (ANSWERS_MAX - usize::from(WINDOW)) as u64 + 1);
        outbox.down("gone".into());
        assert_eq!(outbox.counts().answers_dropped, before + ANSWERS_MAX as u64);
    }
}
