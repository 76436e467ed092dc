//! What may be asked of the gateway by MQTT: to start and to stop a recording.
//!
//! ```json
//! {"do": "start", "name": "stance-1", "seconds": 60}
//! {"do": "stop", "trial": "20261126T011530Z"}
//! ```
//!
//! `name` becomes part of the trial's folder; `seconds` is how long it lasts at most; `trial` stops that
//! one only. All three may be left out. Who may command is the broker's business: its users and its ACL.
//! A retained message is no command. An answer goes to the response topic of the command, which must lie
//! below `reply` of its ward, with its correlation data.

use std::time::Duration;

use rumqttc::v5::mqttbytes::v5::Publish;
use serde::{Deserialize, Serialize};

use crate::outbox::{Answer, Outbox};
use crate::topics::{Topics, is_level};

/// The longest command.
const COMMAND_BYTES_MAX: usize = 1024;

/// The longest name of a trial.
const NAME_BYTES_MAX: usize = 40;

/// The longest correlation data.
const CORRELATION_BYTES_MAX: usize = 128;

/// The longest trial.
pub const SECONDS_MAX: u32 = 3600;

/// The commands that wait.
pub(crate) const WAITING_MAX: usize = 256;

/// A command.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub enum Command {
    /// To begin a trial.
    Start {
        /// What it is called.
        #[serde(default)]
        name: Option<String>,
        /// How long it lasts at most.
        #[serde(default)]
        seconds: Option<u32>,
    },
    /// To end it.
    Stop {
        /// Which one; without it, whichever is recorded.
        #[serde(default)]
        trial: Option<String>,
    },
}

/// Where an answer is wanted.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplyTo {
    topic: Option<String>,
    correlation: Option<Vec<u8>>,
}

/// A command for a box.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asked {
    /// The box, as topics call it.
    pub level: String,
    /// What is to be done.
    pub command: Command,
    reply_to: ReplyTo,
}

/// A command that is not carried out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refused {
    pub found: String,
    remedy: String,
    reply_to: ReplyTo,
}

/// What became of a command.
#[derive(Debug, Serialize)]
struct Reply<'a> {
    done: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    trial: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<&'a str>,
}

impl ReplyTo {
    fn of(publish: &Publish, topics: &Topics) -> Self {
        let Some(properties) = &publish.properties else { return Self::default() };
        let topic = properties.response_topic.clone().filter(|it| topics.is_reply(it));
        let correlation = properties.correlation_data.as_ref().map(|it| it.to_vec());
        let correlation = correlation.filter(|it| it.len() <= CORRELATION_BYTES_MAX);
        Self { topic, correlation }
    }

    fn answer(self, outbox: &Outbox, reply: &Reply<'_>) {
        if let Some(topic) = self.topic
            && let Ok(payload) = serde_json::to_string(reply)
        {
            outbox.answer(Answer { topic, correlation: self.correlation, payload });
        }
    }
}

impl Asked {
    /// It was done, for this trial.
    pub fn done(self, outbox: &Outbox, trial: &str) {
        let reply = Reply { done: true, trial: Some(trial), found: None, remedy: None };
        self.reply_to.answer(outbox, &reply);
    }

    /// It was not done.
    pub fn refuse(self, outbox: &Outbox, found: &str, remedy: &str) {
        let (found, remedy) = (Some(found), Some(remedy));
        self.reply_to.answer(outbox, &Reply { done: false, trial: None, found, remedy });
    }
}

impl Refused {
    pub fn answer(self, outbox: &Outbox) {
        let (found, remedy) = (Some(self.found.as_str()), Some(self.remedy.as_str()));
        self.reply_to.answer(outbox, &Reply { done: false, trial: None, found, remedy });
    }
}

/// Reads a command.
pub(crate) fn read(publish: &Publish, topics: &Topics) -> Result<Asked, Refused> {
    let reply_to = ReplyTo::of(publish, topics);
    let refused = |found: String, remedy: &str| Refused {
        found,
        remedy: remedy.to_owned(),
        reply_to: reply_to.clone(),
    };
    let topic = std::str::from_utf8(&publish.topic).ok();
    let Some(level) = topic.and_then(|topic| topics.commanded(topic)) else {
        return Err(refused("it is for no box".to_owned(), "name a box in the topic"));
    };
    if publish.retain {
        return Err(refused(
            format!("one for {level} is retained: it may be of another day"),
            "send commands without retain",
        ));
    }
    if publish.payload.len() > COMMAND_BYTES_MAX {
        return Err(refused(
            format!("one for {level} has more than {COMMAND_BYTES_MAX} bytes"),
            "send {\"do\": \"start\"} or {\"do\": \"stop\"}",
        ));
    }
    let command: Command = serde_json::from_slice(&publish.payload).map_err(|error| {
        refused(
            format!("one for {level} cannot be understood: {error}"),
            "send {\"do\": \"start\"} or {\"do\": \"stop\"}",
        )
    })?;
    if let Command::Start { name: Some(name), .. } = &command
        && !(is_level(name) && name.len() <= NAME_BYTES_MAX)
    {
        return Err(refused(
            format!("the name of a trial for {level} cannot be part of a folder's"),
            "give up to 40 letters and digits of ASCII, '.', '_' and '-'",
        ));
    }
    if let Command::Start { seconds: Some(seconds), .. } = &command
        && !(1..=SECONDS_MAX).contains(seconds)
    {
        return Err(refused(
            format!("a trial of {seconds} s for {level}"),
            "a trial lasts from 1 s to an hour",
        ));
    }
    Ok(Asked { level: level.to_owned(), command, reply_to })
}

impl Command {
    /// How long a trial lasts.
    #[must_use]
    pub fn lasts(seconds: Option<u32>, usually: Duration) -> Duration {
        seconds.map_or(usually, |it| Duration::from_secs(it.into()))
    }
}

#[cfg(test)]
mod tests {
    use rumqttc::v5::mqttbytes::QoS;
    use rumqttc::v5::mqttbytes::v5::PublishProperties;

    use super::*;

    fn publish(topic: &str, payload: &str) -> Publish {
        Publish::new(topic, QoS::AtLeastOnce, payload.to_owned(), None)
    }

    fn found(publish: &Publish) -> String {
        read(publish, &Topics::new("w")).unwrap_err().found
    }

    #[test]
    fn start_and_stop_are_understood() {
        let topics = Topics::new("w");
        let read = |payload: &str| read(&publish("plumbline/1/w/PL-1/command", payload), &topics);
        let asked = read("{\"do\":\"start\",\"name\":\"stance-1\",\"seconds\":60}").unwrap();
        let start = Command::Start { name: Some("stance-1".into()), seconds: Some(60) };
        assert_eq!((asked.level.as_str(), asked.command), ("PL-1", start));
        assert_eq!(read("{\"do\":\"stop\"}").unwrap().command, Command::Stop { trial: None });
    }

    #[test]
    fn whatever_else_comes_is_refused() {
        let topic = "plumbline/1/w/PL-1/command";
        for (payload, part) in [
            ("", "cannot be understood"),
            ("{}", "cannot be understood"),
            ("{\"do\":\"reboot\"}", "cannot be understood"),
            ("{\"do\":\"start\",\"folder\":\"/\"}", "cannot be understood"),
            ("{\"do\":\"start\",\"participant\":\"Ann\"}", "cannot be understood"),
            ("{\"do\":\"start\",\"name\":\"../x\"}", "cannot be part of a folder"),
            ("{\"do\":\"start\",\"name\":\".x\"}", "cannot be part of a folder"),
            ("{\"do\":\"start\",\"name\":\"\"}", "cannot be part of a folder"),
            ("{\"do\":\"start\",\"seconds\":0}", "a trial of 0 s"),
            ("{\"do\":\"start\",\"seconds\":3601}", "a trial of 3601 s"),
            ("{\"do\":\"start\",\"seconds\":-1}", "cannot be understood"),
        ] {
            let found = found(&publish(topic, payload));
            assert!(found.contains(part), "{payload}: {found}");
        }
        let long = format!("{{\"do\":\"start\",\"name\":\"{}\"}}", "x".repeat(2000));
        assert!(found(&publish(topic, &long)).contains("more than 1024 bytes"));
        let long = format!("{{\"do\":\"start\",\"name\":\"{}\"}}", "x".repeat(41));
        assert!(found(&publish(topic, &long)).contains("cannot be part"));
        let retained = Publish { retain: true, ..publish(topic, "{\"do\":\"start\"}") };
        assert!(found(&retained).contains("retained"));
        assert!(found(&publish("plumbline/1/other/PL-1/command", "{}")).contains("no box"));
    }

    #[test]
    fn answers_go_where_answers_belong() {
        let topics = Topics::new("w");
        let to = |topic: &str, bytes: usize| {
            let properties = PublishProperties {
                response_topic: Some(topic.to_owned()),
                correlation_data: Some(vec![7; bytes].into()),
                ..PublishProperties::default()
            };
            let asked = publish("plumbline/1/w/PL-1/command", "{\"do\":\"stop\"}");
            let asked = Publish { properties: Some(properties), ..asked };
            read(&asked, &topics).unwrap().reply_to
        };
        let good = to("plumbline/1/w/reply/me", 16);
        assert_eq!(good.topic.as_deref(), Some("plumbline/1/w/reply/me"));
        assert_eq!(good.correlation, Some(vec![7; 16]));
        assert_eq!(to("plumbline/1/w/PL-2/command", 1).topic, None);
        assert_eq!(to("plumbline/1/w/reply/me", 129).correlation, None);
    }
}
