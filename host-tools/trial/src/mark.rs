//! Marks: events of a trial, with a label and a source; and the queue that brings them to the
//! recording.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use plumbline::packet::Trigger;
use plumbline_files::text::printable;

/// Where a mark comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// A person at this computer.
    Key,
    /// A datagram of another program or device.
    Udp,
    /// A line from a serial device.
    Serial,
    /// A marker of a stream of the Lab Streaming Layer.
    Lsl,
    /// A modem line of a serial device.
    Line,
    /// An edge at the box's own trigger line.
    Trigger,
}

impl Source {
    const ALL: [Self; 6] =
        [Self::Key, Self::Udp, Self::Serial, Self::Lsl, Self::Line, Self::Trigger];

    /// The word for it in files and streams.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Key => "key",
            Self::Udp => "udp",
            Self::Serial => "serial",
            Self::Lsl => "lsl",
            Self::Line => "line",
            Self::Trigger => "trigger",
        }
    }
}

/// The number of characters of a label; longer ones are cut.
const LABEL_LETTERS_MAX: usize = 64;

/// The label of a mark that came without one.
const UNNAMED: &str = "mark";

/// One event.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mark {
    /// Where it comes from.
    pub source: Source,
    /// The name of the computer that sent it, if that is another one.
    pub sender: Option<String>,
    /// Its label.
    pub label: String,
    /// How much earlier or later than its time it may have been, as far as its source knows.
    pub uncertain_us: u32,
}

impl Mark {
    /// A mark whose label is made from whatever a person or a device has sent.
    #[must_use]
    pub fn new(source: Source, label: &str) -> Self {
        let cut: String = printable(label).trim().chars().take(LABEL_LETTERS_MAX).collect();
        let label = if cut.is_empty() { UNNAMED } else { cut.trim_end() }.to_owned();
        Self { source, sender: None, label, uncertain_us: 0 }
    }

    /// The same, sent by a computer of this name, which has no white space in it.
    #[must_use]
    pub fn sent_by(self, name: &str) -> Self {
        Self { sender: Some(name.to_owned()), ..self }
    }

    /// The mark of a trigger.
    #[must_use]
    pub fn of_trigger(trigger: &Trigger) -> Self {
        let label = trigger.edge.words();
        Self::new(Source::Trigger, label).uncertain_by(trigger.uncertain_ns.div_ceil(1000))
    }

    /// The same, at most this much earlier or later than its time.
    #[must_use]
    pub fn uncertain_by(self, uncertain_us: u32) -> Self {
        Self { uncertain_us, ..self }
    }

    /// The text for the journal: `SOURCE LABEL`, with `:SENDER` and `~MICROSECONDS` after the source
    /// where there are any.
    #[must_use]
    pub fn text(&self) -> String {
        let mut from = self.sender.as_ref().map_or(String::new(), |name| format!(":{name}"));
        if self.uncertain_us > 0 {
            from += &format!("~{}", self.uncertain_us);
        }
        format!("{}{from} {}", self.source.word(), self.label)
    }

    /// The mark of a text of the journal.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let (from, label) = text.split_once(' ')?;
        let (from, uncertain_us) = match from.split_once('~') {
            Some((from, uncertain_us)) => (from, uncertain_us.parse().ok()?),
            None => (from, 0),
        };
        let (word, sender) = match from.split_once(':') {
            Some((word, sender)) => (word, Some(sender)),
            None => (from, None),
        };
        let source = Source::ALL.into_iter().find(|source| source.word() == word)?;
        let mark = Self::new(source, label).uncertain_by(uncertain_us);
        Some(match sender {
            Some(name) => mark.sent_by(&printable(name)),
            None => mark,
        })
    }
}

/// The number of marks that can wait to be written. They wait for a tenth of a second: a device
/// that sends more in that time is out of order.
const WAITING_MAX: usize = 64;

/// The sending end of the queue of marks.
#[derive(Debug, Clone)]
pub struct MarkSender {
    sender: mpsc::SyncSender<(Instant, Mark)>,
    dropped: Arc<AtomicU64>,
}

/// The receiving end of the queue of marks, which the recording holds.
#[derive(Debug)]
pub struct Marks {
    receiver: mpsc::Receiver<(Instant, Mark)>,
    dropped: Arc<AtomicU64>,
}

/// A queue for marks.
#[must_use]
pub fn channel() -> (MarkSender, Marks) {
    let (sender, receiver) = mpsc::sync_channel(WAITING_MAX);
    let dropped = Arc::<AtomicU64>::default();
    (MarkSender { sender, dropped: Arc::clone(&dropped) }, Marks { receiver, dropped })
}

impl MarkSender {
    /// Sends a mark; where there is no room it is dropped and counted. False once the recording has
    /// ended.
    pub fn send(&self, at: Instant, mark: Mark) -> bool {
        match self.sender.try_send((at, mark)) {
            Ok(()) => true,
            Err(mpsc::TrySendError::Full(_)) => {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                true
            }
            Err(mpsc::TrySendError::Disconnected(_)) => false,
        }
    }
}

impl Marks {
    /// The next one, if there is one.
    pub fn next(&self) -> Option<(Instant, Mark)> {
        self.receiver.try_recv().ok()
    }

    /// The number of marks for which there was no room.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_without_room_are_counted() {
        let (sender, marks) = channel();
        for _ in 0..WAITING_MAX + 3 {
            assert!(sender.send(Instant::now(), Mark::new(Source::Udp, "stands")));
        }
        assert_eq!(marks.dropped(), 3);
        assert_eq!(std::iter::from_fn(|| marks.next()).count(), WAITING_MAX);
        drop(marks);
        assert!(!sender.send(Instant::now(), Mark::new(Source::Udp, "stands")));
    }

    #[test]
    fn a_label_is_what_can_be_read_of_it() {
        let label = |text: &str| Mark::new(Source::Udp, text).label;
        assert_eq!(label("  stands up\r\n"), "stands up");
        assert_eq!(label("\n \t"), "mark");
        assert_eq!(label("\u{1b}[2J\u{202e}up\u{200b}\n"), "?[2J?up?");
        assert_eq!(label(&"x".repeat(200)).len(), LABEL_LETTERS_MAX);
        // The space at which it is cut is no part of it: the journal's text would be read without it.
        let cut = "x".repeat(LABEL_LETTERS_MAX - 1);
        assert_eq!(label(&format!("{cut} and more")), cut);
        for source in Source::ALL {
            let mark = Mark::new(source, "eyes closed: now");
            assert_eq!(Mark::read(&mark.text()), Some(mark.clone()));
            let sent = mark.sent_by("treadmill");
            assert_eq!(Mark::read(&sent.text()), Some(sent.clone()));
            let uncertain = sent.uncertain_by(1500);
            assert_eq!(Mark::read(&uncertain.text()), Some(uncertain));
        }
        assert_eq!(Mark::read("telegraph stop"), None);
        assert_eq!(Mark::read("line~soon cts"), None);
    }
}
