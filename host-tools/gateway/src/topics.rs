//! The names of topics.
//!
//! ```text
//! plumbline/1/WARD/gateway/state        is the gateway there?                retained, last will
//! plumbline/1/WARD/gateway/health       what it hears, records and loses     retained, expires
//! plumbline/1/WARD/BOX/state            is the box heard, what is done?      retained
//! plumbline/1/WARD/BOX/health           how the box is                       retained, expires
//! plumbline/1/WARD/BOX/examination      what the doctor found amiss          retained
//! plumbline/1/WARD/BOX/verdict          what the latest trial is worth       retained, kept on the disk
//! plumbline/1/WARD/BOX/summary          what is in it, and its figures       retained, kept on the disk
//! plumbline/1/WARD/BOX/command          to the gateway: start, stop
//! plumbline/1/WARD/reply/...            its answers, wherever a command wants them
//! ```
//!
//! `1` is the version of all of these: what is published under it may get further fields, and loses
//! none. WARD is given on the command line. BOX is the box's serial number where that can stand in a
//! topic, otherwise the identity of its key.

use std::collections::BTreeSet;

use plumbline_bedside::keys::KnownBox;

/// The version of the topics and of what is published there.
pub const VERSION: u32 = 1;

/// The longest part of a topic that is made here.
const LEVEL_BYTES_MAX: usize = 64;

/// The longest topic to which an answer is sent.
pub const REPLY_BYTES_MAX: usize = 256;

/// Parts that are none of a box.
const TAKEN: [&str; 2] = ["gateway", "reply"];

/// The topics of a ward.
#[derive(Debug, Clone)]
pub struct Topics {
    prefix: String,
}

/// What is published of a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum About {
    /// Whether it is heard, and what is done with it.
    State,
    /// How it is.
    Health,
    /// What the doctor found amiss.
    Examination,
    /// What its latest trial is worth.
    Verdict,
    /// What is in its latest trial.
    Summary,
}

impl About {
    fn word(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Health => "health",
            Self::Examination => "examination",
            Self::Verdict => "verdict",
            Self::Summary => "summary",
        }
    }
}

/// Whether a text can be one part of a topic, and of a path: letters and digits of ASCII, `.`, `_` and
/// `-`, not beginning with a dot.
#[must_use]
pub fn is_level(text: &str) -> bool {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "._-".contains(letter);
    !text.is_empty()
        && text.len() <= LEVEL_BYTES_MAX
        && !text.starts_with('.')
        && text.chars().all(is_plain)
}

/// A ward's name, of an option.
///
/// # Errors
/// The text says what to give instead.
pub fn ward(text: &str) -> Result<String, String> {
    if is_level(text) {
        return Ok(text.to_owned());
    }
    Err(format!(
        "give 1 to {LEVEL_BYTES_MAX} letters and digits of ASCII, '.', '_' and '-': it is part of every \
         topic"
    ))
}

/// The parts of topics for these boxes, in their order: no two are alike.
#[must_use]
pub fn levels(boxes: &[KnownBox]) -> Vec<String> {
    let mut given: BTreeSet<String> = TAKEN.iter().map(|&it| it.to_owned()).collect();
    let level = |known: &KnownBox| {
        let number = known.serial_number.as_ref().filter(|it| is_level(it));
        let level = number.filter(|it| !given.contains(*it)).cloned();
        let level = level.unwrap_or_else(|| known.key.id().to_string());
        given.insert(level.clone());
        level
    };
    boxes.iter().map(level).collect()
}

impl Topics {
    /// The topics of this ward, whose name is a [`level`](is_level).
    #[must_use]
    pub fn new(ward: &str) -> Self {
        Self { prefix: format!("plumbline/{VERSION}/{ward}") }
    }

    /// Whether the gateway is there.
    #[must_use]
    pub fn gateway_state(&self) -> String {
        format!("{}/gateway/state", self.prefix)
    }

    /// What the gateway hears, records and loses.
    #[must_use]
    pub fn gateway_health(&self) -> String {
        format!("{}/gateway/health", self.prefix)
    }

    /// Something of a box.
    #[must_use]
    pub fn of_box(&self, level: &str, about: About) -> String {
        format!("{}/{level}/{}", self.prefix, about.word())
    }

    /// All topics with commands.
    #[must_use]
    pub fn commands(&self) -> String {
        format!("{}/+/command", self.prefix)
    }

    /// The box for which the commands of a topic are.
    #[must_use]
    pub fn commanded<'a>(&self, topic: &'a str) -> Option<&'a str> {
        let level =
            topic.strip_prefix(&self.prefix)?.strip_prefix('/')?.strip_suffix("/command")?;
        is_level(level).then_some(level)
    }

    /// Whether an answer may be sent to a topic: nobody can have the gateway write elsewhere.
    #[must_use]
    pub fn is_reply(&self, topic: &str) -> bool {
        let below = topic.strip_prefix(&self.prefix).and_then(|it| it.strip_prefix("/reply/"));
        topic.len() <= REPLY_BYTES_MAX && below.is_some_and(|it| it.split('/').all(is_level))
    }
}

#[cfg(test)]
mod tests {
    use plumbline_stream::fixture;

    use super::*;

    #[test]
    fn boxes_have_topics_of_their_own() {
        let number = |number: &str, byte| {
            let key = plumbline::seal::Key::new([byte; 32]).unwrap();
            KnownBox::new(key, None, Some(number.to_owned()))
        };
        let nameless = KnownBox::new(fixture::key(), None, None);
        let boxes = [
            number("PL-1", 1),
            number("PL/+", 2),
            number("gateway", 3),
            number("PL-1", 4),
            nameless,
        ];
        let levels = levels(&boxes);
        let ids: Vec<String> = boxes.iter().map(|it| it.key.id().to_string()).collect();
        assert_eq!(levels, ["PL-1", &ids[1], &ids[2], &ids[3], &ids[4]]);
    }

    #[test]
    fn commands_and_replies_stay_in_their_ward() {
        let topics = Topics::new("north");
        assert_eq!(topics.commanded("plumbline/1/north/PL-1/command"), Some("PL-1"));
        for other in [
            "plumbline/1/south/PL-1/command",
            "plumbline/1/north/command",
            "plumbline/1/north/a/b/command",
            "plumbline/1/north/PL-1/state",
            "plumbline/1/north/../command",
        ] {
            assert_eq!(topics.commanded(other), None, "{other}");
        }
        assert!(topics.is_reply("plumbline/1/north/reply/nurse-3/1"));
        for other in [
            "plumbline/1/north/PL-1/verdict",
            "plumbline/1/north/reply/",
            "plumbline/1/north/reply/+",
            "plumbline/1/north/reply/#",
            "plumbline/1/north/reply/a//b",
            "$SYS/x",
        ] {
            assert!(!topics.is_reply(other), "{other}");
        }
        assert!(!topics.is_reply(&format!("plumbline/1/north/reply/{}", "a/".repeat(200))));
        assert!(ward("ward-3").is_ok());
        assert!(ward("a/b").is_err() && ward("").is_err() && ward("#").is_err());
    }
}
