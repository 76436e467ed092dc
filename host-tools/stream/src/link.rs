//! Talking to a box: questions and their answers, and documents in parts.
//!
//! The link may lose, repeat and damage packets. A question is repeated until it is answered,
//! and repeating a question does no harm; a document's missing bytes are asked for
//! until all have come and its checksum agrees. No wait is unlimited.

use std::time::{Duration, Instant};

use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{
    Action, Document, Hello, LinkKind, Message, PART_BYTES_MAX, Part, Refusal, Reply, ReplyOutcome,
};
use plumbline_files::BadInput;

use crate::complaints::Complaints;
use crate::deadline::Deadline;
use crate::others::{self, Others, is_same_box};
use crate::questions::Questions;
use crate::transport::{Event, Transport};

mod configuration;
mod download;

pub use configuration::Configuration;
pub use download::{Download, Stopped};

/// Where boxes send their packets, unless they were told otherwise.
pub const PORT: u16 = 4210;

/// The rate of boxes' serial lines, unless they were told otherwise.
pub const BAUD: u32 = 115_200;

/// A box sends something once a second; a refused one every two.
pub const HEARD_WITHIN: Duration = Duration::from_secs(6);

/// A longer silence is a fault: a box sends something at least once a second, and a
/// refused one every two.
pub const SILENT_AFTER: Duration = Duration::from_secs(3);

/// Every box has sent a Hello by then: it does once a second.
const NAMED_WITHIN: Duration = Duration::from_millis(1200);

/// What to do when no box is heard.
pub const NOT_HEARD_REMEDY: &str = "check that the box is on, and that it sends to this \
    computer's address and port (or on this line, at this rate); stop another `plumb` that \
    listens here";

/// A question is repeated after this time.
const ANSWER_WITHIN: Duration = Duration::from_millis(700);

/// A disk takes less than this to store a configuration, and a slow one less than [`TRIES`]
/// times this.
const STORED_WITHIN: Duration = Duration::from_secs(3);

/// The most times that a question is sent.
const TRIES: usize = 6;

/// A download is given up when this many requests in a row bring nothing.
const BARREN_MAX: usize = 6;

/// What a box says of itself.
#[derive(Debug)]
pub enum Introduction {
    /// It runs with its configuration.
    Hello(Hello),
    /// It has no usable configuration, says why, and accepts another one.
    Refusing(String),
}

/// The link to one box.
pub struct BoxLink {
    transport: Box<dyn Transport>,
    place: String,
    kind: LinkKind,
    questions: Questions,
    /// When the box was last heard.
    heard: Option<Instant>,
    others: Others,
}

/// Whether a message comes from a box: a line may echo what is sent to it.
#[must_use]
pub fn is_of_box(message: &Message) -> bool {
    !matches!(message, Message::Command(_))
}

impl BoxLink {
    /// A link over this transport, which `place` names in messages.
    #[must_use]
    pub fn new(transport: Box<dyn Transport>, place: String, kind: LinkKind) -> Self {
        Self {
            transport,
            place,
            kind,
            questions: Questions::of_link(),
            heard: None,
            others: Others::default(),
        }
    }

    /// Its name in messages.
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Its transport, for a reception of the same box.
    #[must_use]
    pub fn into_transport(self) -> Box<dyn Transport> {
        self.transport
    }

    /// The kind of its transport.
    #[must_use]
    pub fn kind(&self) -> LinkKind {
        self.kind
    }

    /// Hands what comes to `take`, until it has found something or until `until`: see [`Deadline`].
    ///
    /// # Errors
    /// When the link can no longer be used.
    pub fn listen<T>(
        &mut self,
        until: Instant,
        mut take: impl FnMut(&Event) -> Option<T>,
    ) -> Result<Option<T>, BadInput> {
        let (mut deadline, mut found) = (Deadline::at(until), None);
        let Self { transport, heard, others, .. } = self;
        while found.is_none() {
            let looked = deadline.look(|| {
                transport.poll(&mut |event| {
                    match &event {
                        Event::Packet(packet) if is_of_box(&packet.message) => {
                            *heard = Some(Instant::now());
                        }
                        Event::Other { from, name, announcement } => {
                            let _ = others.take(*from, name.as_deref(), announcement);
                        }
                        _ => {}
                    }
                    if found.is_none() {
                        found = take(&event);
                    }
                })
            });
            let Some(polled) = looked else { break };
            polled?;
        }
        Ok(found)
    }

    /// Like [`listen`](Self::listen), for messages only.
    ///
    /// # Errors
    /// As [`listen`](Self::listen).
    pub fn messages<T>(
        &mut self,
        until: Instant,
        mut take: impl FnMut(&Message) -> Option<T>,
    ) -> Result<Option<T>, BadInput> {
        self.listen(until, |event| match event {
            Event::Packet(packet) => take(&packet.message),
            _ => None,
        })
    }

    /// Waits for any message of a box.
    ///
    /// # Errors
    /// When nothing comes in time.
    pub fn wait_until_heard(&mut self) -> Result<Message, BadInput> {
        self.wait_until_heard_within(HEARD_WITHIN)
    }

    /// Waits up to `limit` for any message of a box.
    ///
    /// # Errors
    /// When nothing comes in time.
    pub fn wait_until_heard_within(&mut self, limit: Duration) -> Result<Message, BadInput> {
        let until = Instant::now() + limit;
        let heard = self.messages(until, |message| Some(message.clone()))?;
        heard.ok_or_else(|| self.not_heard())
    }

    /// Why nothing is heard of the box, in words, and what to do, if something is known of that.
    #[must_use]
    pub fn obstacle(&self) -> Option<(String, String)> {
        self.transport.obstacle()
    }

    /// That no box is heard, or why none listens to this computer.
    fn not_heard(&self) -> BadInput {
        match self.obstacle() {
            Some((why, remedy)) => BadInput::whole(&self.place, why, remedy),
            None => BadInput::whole(&self.place, "no box is heard", NOT_HEARD_REMEDY),
        }
    }

    /// Who the box is, or why it runs with no configuration.
    ///
    /// # Errors
    /// When no box is heard, or it says neither.
    pub fn introduction(&mut self) -> Result<Introduction, BadInput> {
        let mut complaints = Complaints::default();
        complaints.take(&self.wait_until_heard()?);
        for _ in 0..TRIES {
            let id = self.send(Action::SendHello);
            let until = Instant::now() + ANSWER_WITHIN;
            let answer = self.messages(until, |message| match message {
                Message::Hello(hello) => Some(Introduction::Hello(hello.clone())),
                Message::Reply(Reply { id: of, outcome: ReplyOutcome::Refused { reason, .. } })
                    if *of == id =>
                {
                    // Its log has the whole text.
                    let text = complaints.text().unwrap_or_else(|| reason.as_str().to_owned());
                    Some(Introduction::Refusing(text))
                }
                other => {
                    complaints.take(other);
                    None
                }
            })?;
            if let Some(answer) = answer {
                return Ok(answer);
            }
        }
        // A box may be heard but not hear.
        match complaints.text() {
            Some(text) => Ok(Introduction::Refusing(text)),
            None => Err(self.no_answer("who it is")),
        }
    }

    /// Who the box is.
    ///
    /// # Errors
    /// When no box is heard, it does not say, or it runs with no configuration.
    pub fn hello(&mut self) -> Result<Hello, BadInput> {
        match self.introduction()? {
            Introduction::Hello(hello) => Ok(hello),
            Introduction::Refusing(text) => Err(BadInput::whole(
                &self.place,
                format!("the box tracks nothing; it says: {text}"),
                "send it a configuration with `plumb provision --send`",
            )),
        }
    }

    /// The other boxes that are heard here, for people; listens long enough for each to have
    /// said who it is.
    ///
    /// # Errors
    /// When the link can no longer be used.
    pub fn others(&mut self) -> Result<Option<String>, BadInput> {
        self.listen(Instant::now() + NAMED_WITHIN, |_| None::<()>)?;
        Ok(self.others.words())
    }

    /// Checks that a box is the one that was met.
    ///
    /// # Errors
    /// When it has another name or serial number.
    pub fn refuse_another(&self, met: &Hello, now: &Hello) -> Result<(), BadInput> {
        if is_same_box(met, now) {
            return Ok(());
        }
        Err(self.another(&others::name(met), &others::name(now)))
    }

    fn another(&self, met: &str, now: &str) -> BadInput {
        BadInput::whole(
            &self.place,
            format!("another box is heard now: {now}, no longer {met}"),
            "nothing was changed; check which boxes are on and send here, and start again",
        )
    }

    /// From now on, what changes the box is to be done even while somebody records a trial, which it
    /// spoils.
    pub fn force(&mut self) {
        self.questions.force();
    }

    /// Sends a question without waiting for the answer; returns its number.
    pub fn send(&mut self, action: Action) -> u16 {
        let (id, question) = self.questions.ask(action);
        self.transport.send(&question);
        id
    }

    /// Sends bytes of a document that begin at `offset` in it, as parts, without waiting for anything.
    pub fn send_parts(&mut self, document: Document, offset: usize, bytes: &[u8]) {
        for (index, bytes) in bytes.chunks(PART_BYTES_MAX).enumerate() {
            let offset = (offset + index * PART_BYTES_MAX) as u32;
            let bytes = bytes.iter().copied().collect();
            self.transport.send(&Message::Part(Part { document, offset, bytes }));
        }
    }

    /// Repeats a question until it is answered. Other messages that come meanwhile go to
    /// `aside`.
    ///
    /// # Errors
    /// When there is no answer.
    pub fn ask_aside(
        &mut self,
        action: Action,
        within: Duration,
        mut aside: impl FnMut(&Message),
    ) -> Result<ReplyOutcome, BadInput> {
        for _ in 0..TRIES {
            let id = self.send(action);
            let reply = self.messages(Instant::now() + within, |message| match message {
                Message::Reply(reply) if reply.id == id => Some(reply.outcome.clone()),
                other => {
                    aside(other);
                    None
                }
            })?;
            if let Some(outcome) = reply {
                return Ok(outcome);
            }
        }
        Err(self.no_answer("a question"))
    }

    /// Repeats a question until it is answered.
    ///
    /// # Errors
    /// When there is no answer.
    pub fn ask(&mut self, action: Action) -> Result<ReplyOutcome, BadInput> {
        self.ask_aside(action, ANSWER_WITHIN, |_| {})
    }

    /// Repeats a question until it is answered; the box must agree.
    ///
    /// # Errors
    /// When there is no answer, or it refuses.
    pub fn request(&mut self, action: Action, what: &str) -> Result<(), BadInput> {
        match self.ask(action)? {
            ReplyOutcome::Refused { refusal, reason } => Err(self.refused(what, refusal, &reason)),
            _ => Ok(()),
        }
    }

    /// Fetches a document of known length.
    ///
    /// # Errors
    /// When the box refuses, or parts are missing.
    pub fn fetch(&mut self, document: Document, bytes: usize) -> Result<Vec<u8>, BadInput> {
        let mut download = Download::new(document, bytes);
        loop {
            if let Some(file) = download.file() {
                return Ok(file.to_vec());
            }
            let now = Instant::now();
            if let Some(action) = download.due(now).map_err(|stopped| self.stopped(&stopped))? {
                let id = self.send(action);
                download.asked(id, now);
            }
            let mut taken = Ok(());
            self.transport.poll(&mut |event| {
                if let (Event::Packet(packet), Ok(())) = (event, &taken) {
                    taken = download.take(&packet.message, Instant::now());
                }
            })?;
            taken.map_err(|stopped| self.stopped(&stopped))?;
        }
    }

    /// The box's configuration, to be changed and stored again.
    ///
    /// # Errors
    /// As [`config`](Self::config), and when the box will start with another one next, which
    /// would be lost.
    pub fn config_to_change(&mut self) -> Result<Config, BadInput> {
        let (config, next_crc) = self.config_and_next()?;
        if config.crc() == next_crc {
            return Ok(config);
        }
        Err(BadInput::whole(
            &self.place,
            format!(
                "the box has been given another configuration, {next_crc:08x}, which it uses \
                 from its next start on"
            ),
            "restart it first: switch it off and on, or send that one again without \
             --no-restart",
        ))
    }

    /// The box's configuration.
    ///
    /// # Errors
    /// When the box does not answer, or its configuration cannot be read here.
    pub fn config(&mut self) -> Result<Config, BadInput> {
        Ok(self.config_and_next()?.0)
    }

    /// The configuration that the box runs with, and the checksum of the one that it will start
    /// with next.
    ///
    /// # Errors
    /// As [`config`](Self::config).
    pub fn config_and_next(&mut self) -> Result<(Config, u32), BadInput> {
        let (crc, bytes, next_crc) = match self.ask(Action::QueryConfig)? {
            ReplyOutcome::Config { crc, bytes, next_crc } => (crc, bytes, next_crc),
            ReplyOutcome::Refused { refusal, reason } => {
                return Err(self.refused("to tell its configuration", refusal, &reason));
            }
            _ => return Err(self.nonsense("an answer to another question")),
        };
        if bytes as usize > BLOB_BYTES_MAX {
            return Err(self.nonsense("a configuration larger than any"));
        }
        let blob = self.fetch(Document::Config, bytes as usize)?;
        let config = Config::decode(&blob).map_err(|error| {
            BadInput::whole(&self.place, error, "update the older of the two programs")
        })?;
        if config.crc() != crc {
            return Err(self.nonsense("another configuration than the one it announced"));
        }
        Ok((config, next_crc))
    }

    /// Sends a configuration that the box is to keep, if it is still the one that was `met`
    /// (`None`: one without a configuration, which has no name); returns its Hello of now,
    /// and the checksum as the box has read it back. It is in use from the box's next start on.
    ///
    /// # Errors
    /// When it is another box, refuses it, cannot keep it, or does not answer.
    pub fn store_config(
        &mut self,
        met: Option<&Hello>,
        config: &Config,
    ) -> Result<(Option<Hello>, u32), BadInput> {
        let hello = self.met_again(met)?;
        Ok((hello, self.store_config_there(config)?))
    }

    /// The Hello that the box that was met sends now.
    fn met_again(&mut self, met: Option<&Hello>) -> Result<Option<Hello>, BadInput> {
        const NAMELESS: &str = "the box that tracks nothing";
        match (met, self.introduction()?) {
            (Some(met), Introduction::Hello(now)) => {
                self.refuse_another(met, &now)?;
                Ok(Some(now))
            }
            (None, Introduction::Refusing(_)) => Ok(None),
            (None, Introduction::Hello(now)) => Err(self.another(NAMELESS, &others::name(&now))),
            (Some(met), Introduction::Refusing(text)) => {
                Err(self.another(&others::name(met), &format!("one that tracks nothing ({text})")))
            }
        }
    }

    fn store_config_there(&mut self, config: &Config) -> Result<u32, BadInput> {
        let mut buffer = vec![0; BLOB_BYTES_MAX];
        let blob = config
            .encode(&mut buffer)
            .map_err(|error| BadInput::whole("the configuration", error, "correct this value"))?;
        let crc = config.crc();
        let mut from = 0;
        for _ in 0..BARREN_MAX {
            self.send_parts(Document::Config, from, &blob[from..]);
            let store = Action::StoreConfig { bytes: blob.len() as u32, crc };
            match self.ask_aside(store, STORED_WITHIN, |_| {})? {
                ReplyOutcome::Stored { crc: stored } if stored == crc => return Ok(crc),
                ReplyOutcome::Refused {
                    refusal: Refusal::Incomplete { from: missing }, ..
                } => {
                    from = (missing as usize).min(blob.len());
                }
                ReplyOutcome::Refused { refusal, reason } => {
                    return Err(self.refused("the configuration", refusal, &reason));
                }
                _ => return Err(self.nonsense("that it keeps another configuration")),
            }
        }
        Err(self.no_answer("the parts of the configuration, which do not all arrive"))
    }

    /// A refusal as an error for the user.
    #[must_use]
    pub fn refused(&self, what: &str, refusal: Refusal, reason: &str) -> BadInput {
        let (why, remedy) = match refusal {
            Refusal::NotSupported => ("it does not do that", "see `plumb doctor`"),
            Refusal::Busy => ("not now", "try again in a moment"),
            Refusal::Recording => (
                "somebody records a trial",
                "wait until it is over; --force does it all the same, and spoils the trial",
            ),
            Refusal::NotAiming => ("it is not in set-up mode", "start `plumb aim` again"),
            Refusal::Incomplete { .. } => ("not all of it arrived", "try again"),
            Refusal::Unusable => ("it cannot be used", "correct what is named"),
            Refusal::NotStored => {
                ("it could not be stored", "check the box's card; what was stored before still is")
            }
        };
        let why = if reason.is_empty() { why } else { reason };
        BadInput::whole(&self.place, format!("the box refuses {what}: {why}"), remedy)
    }

    fn no_answer(&self, what: &str) -> BadInput {
        let Some(heard) = self.heard else { return self.not_heard() };
        let silence = heard.elapsed();
        if silence >= SILENT_AFTER {
            return BadInput::whole(
                &self.place,
                format!(
                    "the box has fallen silent: nothing heard from it for {} s",
                    silence.as_secs()
                ),
                "check its power and its link, and try again",
            );
        }
        BadInput::whole(
            &self.place,
            format!("the box is heard, but does not answer {what}"),
            "check that nothing stops packets on the way to the box (a firewall, a serial line \
             without its second wire), and that no other `plumb` uses it",
        )
    }

    fn nonsense(&self, what: &str) -> BadInput {
        BadInput::whole(
            &self.place,
            format!("the box sends {what}"),
            "try again; if it happens again, update the older of the two programs",
        )
    }
}

#[cfg(test)]
mod tests;
