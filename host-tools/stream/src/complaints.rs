//! The faults that a box reports, again and again, each kept once.

use plumbline::packet::{Log, LogLevel, Message};
use plumbline_files::counting::counted;

/// A box that runs with no configuration says so in a few records, every two seconds.
const COMPLAINTS_MAX: usize = 16;

/// The faults that a box has reported, each once.
#[derive(Debug, Default)]
pub struct Complaints(Vec<String>);

impl Complaints {
    /// Takes note of a fault; ignores other messages.
    pub fn take(&mut self, message: &Message) {
        let Message::Log(log) = message else { return };
        let text = text_of(log);
        if log.level == LogLevel::Error && self.0.len() < COMPLAINTS_MAX && !self.0.contains(&text)
        {
            self.0.push(text);
        }
    }

    /// All of them, as one text; `None` when there are none.
    #[must_use]
    pub fn text(&self) -> Option<String> {
        (!self.0.is_empty()).then(|| self.0.join(" "))
    }
}

/// A record's text, and how much of it did not fit.
#[must_use]
pub fn text_of(log: &Log) -> String {
    let text = log.text.to_string();
    if log.cut == 0 { text } else { format!("{text} (and {} more)", counted(log.cut, "byte")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(level: LogLevel, text: &str) -> Message {
        Message::Log(Log {
            uptime_ms: 7,
            level,
            target: heapless::String::new(),
            text: text.try_into().unwrap(),
            cut: 0,
        })
    }

    #[test]
    fn what_is_said_again_is_one_complaint() {
        let mut complaints = Complaints::default();
        assert_eq!(complaints.text(), None);
        for _ in 0..3 {
            complaints.take(&log(LogLevel::Info, "boot: started"));
            complaints.take(&log(LogLevel::Error, "configuration refused: links.udp:"));
            complaints.take(&log(LogLevel::Error, "neither address nor port may be 0"));
        }
        let text = "configuration refused: links.udp: neither address nor port may be 0";
        assert_eq!(complaints.text().as_deref(), Some(text));
    }
}
