//! Log records: to the console, and into a bounded queue from which the main
//! loop sends them to the host, a long text as several records. Logging neither
//! allocates nor waits.
//!
//! The latest texts that a person at the box should see are kept for its screen
//! until newer ones replace them.

use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use heapless::{Deque, String};
use plumbline::packet::{LOG_TARGET_BYTES_MAX, LOG_TEXT_BYTES_MAX, Log, LogLevel};

use crate::status::{self, Status};

/// Records that can wait for the main loop, which takes them at every turn.
const WAITING_MAX: usize = 16;

/// Length of the longest text that reaches the host complete.
const WHOLE_TEXT_BYTES_MAX: usize = 4 * LOG_TEXT_BYTES_MAX;

/// The target of the records that pass on the output of the network process.
pub const NETWORK: &str = "plumbline_board::boot::network";

/// The program's logger.
#[derive(Debug)]
pub struct Logger {
    waiting: Mutex<Deque<Waiting, WAITING_MAX>>,
    dropped: AtomicU32,
    latest: Mutex<Latest>,
}

/// The latest texts of the log, for a person at the box.
#[derive(Debug, Clone, Default)]
pub struct Latest {
    /// The last line of the network process.
    pub network: String<WHOLE_TEXT_BYTES_MAX>,
    /// The last text of anything else at level Warn or above.
    pub complaint: String<WHOLE_TEXT_BYTES_MAX>,
    /// When that was logged.
    pub complained_at: Option<Instant>,
}

impl Latest {
    const fn new() -> Self {
        Self { network: String::new(), complaint: String::new(), complained_at: None }
    }

    /// Takes note of a record. The reason for a final status stays: other complaints would hide
    /// what needs to be done.
    fn take(&mut self, status: Status, target: &str, level: log::Level, text: &str) {
        // Both have room for the longest text that is kept.
        if target == NETWORK {
            self.network = text.try_into().unwrap_or_default();
        } else if level <= log::Level::Warn
            && (!status.is_final() || text.starts_with(status.words()))
        {
            self.complaint = text.try_into().unwrap_or_default();
            self.complained_at = Some(Instant::now());
        }
    }
}

#[derive(Debug)]
struct Waiting {
    at: Instant,
    level: LogLevel,
    target: String<LOG_TARGET_BYTES_MAX>,
    text: String<LOG_TEXT_BYTES_MAX>,
    /// Number of bytes of target and text that did not fit.
    cut: usize,
}

/// A text of at most `N` bytes that counts the bytes for which there was no room.
#[derive(Debug, Default)]
pub(crate) struct Cut<const N: usize> {
    /// The part that fitted.
    pub(crate) text: String<N>,
    cut: usize,
}

impl<const N: usize> std::fmt::Write for Cut<N> {
    fn write_str(&mut self, piece: &str) -> std::fmt::Result {
        let room = if self.cut > 0 { 0 } else { N - self.text.len() };
        let fits =
            (0..=room.min(piece.len())).rfind(|&end| piece.is_char_boundary(end)).unwrap_or(0);
        // It fits: `fits` is at most the room.
        let _ = self.text.push_str(&piece[..fits]);
        self.cut += piece.len() - fits;
        Ok(())
    }
}

/// As much of a text as there is room for.
pub fn cut<const N: usize>(text: impl std::fmt::Display) -> String<N> {
    let mut cut = Cut::<N>::default();
    // It never fails; text that does not fit is left out.
    let _ = std::fmt::Write::write_fmt(&mut cut, format_args!("{text}"));
    cut.text
}

static LOGGER: Logger = Logger::new();

/// Makes this the program's logger; records of `level` and more severe ones are kept.
pub fn install(level: log::LevelFilter) {
    // Fails only if a logger is installed already; that one is then kept.
    if log::set_logger(&LOGGER).is_ok() {
        log::set_max_level(level);
    }
}

/// Takes the oldest queued record; its time is counted from `started`.
pub fn take(started: Instant) -> Option<Log> {
    let waiting = LOGGER.lock().pop_front()?;
    Some(Log {
        uptime_ms: waiting.at.saturating_duration_since(started).as_millis() as u64,
        level: waiting.level,
        target: waiting.target,
        text: waiting.text,
        cut: u16::try_from(waiting.cut).unwrap_or(u16::MAX),
    })
}

/// While nobody hears them, keeps the latest records, with room for more, until somebody does.
pub fn keep_latest() {
    let mut waiting = LOGGER.lock();
    while waiting.len() > WAITING_MAX / 2 {
        let _ = waiting.pop_front();
    }
}

/// Number of records for which there was no room.
pub fn dropped() -> u32 {
    LOGGER.dropped.load(Ordering::Relaxed)
}

/// Sends a record to the hosts only: the console has shown it before.
pub fn tell_hosts(record: &log::Record<'_>) {
    LOGGER.queue(record);
}

/// The latest texts, or `None` while a record is being added; try again later.
pub fn latest() -> Option<Latest> {
    LOGGER.latest.try_lock().ok().map(|latest| latest.clone())
}

/// Adds a complaint that bypassed the logger to the latest texts, unless they are locked: the
/// thread that failed may hold the lock.
pub fn keep_complaint(text: &str) {
    if let Ok(mut latest) = LOGGER.latest.try_lock() {
        let mut whole = Cut::<WHOLE_TEXT_BYTES_MAX>::default();
        // Cannot fail; text that does not fit would not fit on a screen either.
        let _ = whole.write_str(text);
        latest.take(status::current().0, module_path!(), log::Level::Error, &whole.text);
    }
}

/// The text in pieces that each fit into a record, broken at spaces where possible.
pub fn pieces(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = text.trim();
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let room = rest.len().min(LOG_TEXT_BYTES_MAX);
        let fits = (0..=room).rfind(|&end| rest.is_char_boundary(end)).unwrap_or(0);
        let end = if fits == rest.len() {
            fits
        } else {
            rest[..fits].rfind(char::is_whitespace).filter(|&at| at > 0).unwrap_or(fits)
        };
        let (piece, after) = rest.split_at(end);
        rest = after.trim_start();
        Some(piece)
    })
}

impl Logger {
    const fn new() -> Self {
        Self {
            waiting: Mutex::new(Deque::new()),
            dropped: AtomicU32::new(0),
            latest: Mutex::new(Latest::new()),
        }
    }

    /// Queues a record for the host, and keeps it for the screen.
    fn queue(&self, record: &log::Record<'_>) {
        let mut target = Cut::<LOG_TARGET_BYTES_MAX>::default();
        let mut text = Cut::<WHOLE_TEXT_BYTES_MAX>::default();
        // Neither write fails; bytes that do not fit are counted.
        let _ = target.write_str(record.target());
        let _ = text.write_fmt(*record.args());
        let level = match record.level() {
            log::Level::Error => LogLevel::Error,
            log::Level::Warn => LogLevel::Warn,
            log::Level::Info => LogLevel::Info,
            log::Level::Debug => LogLevel::Debug,
            log::Level::Trace => LogLevel::Trace,
        };
        let mut latest = self.latest.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        latest.take(status::current().0, record.target(), record.level(), &text.text);
        drop(latest);
        let at = Instant::now();
        let mut waiting = self.lock();
        let mut pieces = pieces(&text.text).peekable();
        while let Some(piece) = pieces.next() {
            let cut = target.cut + if pieces.peek().is_none() { text.cut } else { 0 };
            // It fits: no piece is longer.
            let piece = piece.try_into().unwrap_or_default();
            let next = Waiting { at, level, target: target.text.clone(), text: piece, cut };
            if waiting.push_back(next).is_err() {
                self.dropped.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Deque<Waiting, WAITING_MAX>> {
        self.waiting.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl log::Log for Logger {
    fn enabled(&self, _: &log::Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &log::Record<'_>) {
        // A console that is gone is no reason to stop measuring.
        let _ = writeln!(std::io::stderr(), "{}: {}", record.level(), record.args());
        self.queue(record);
    }

    fn flush(&self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_between_characters_and_counted() {
        let mut cut = Cut::<8>::default();
        let _ = write!(cut, "abcdefg\u{e9}x");
        assert_eq!(cut.text, "abcdefg");
        assert_eq!(cut.cut, 3);
    }

    #[test]
    fn long_texts_are_split_between_words_and_nothing_is_lost() {
        let text = "targets[0] and targets[1] have grids of the same size, and could not be told \
                    apart: change the columns or the rows of one, then provision the box again";
        let found: Vec<&str> = pieces(text).collect();
        assert_eq!(found.len(), 2);
        assert_eq!(found.join(" "), text);
        assert!(found.iter().all(|piece| piece.len() <= LOG_TEXT_BYTES_MAX));
    }

    #[test]
    fn a_text_without_spaces_is_broken_between_characters() {
        let text = "\u{e9}".repeat(LOG_TEXT_BYTES_MAX);
        let found: Vec<&str> = pieces(&text).collect();
        assert_eq!(found.concat(), text);
        assert_eq!(found.len(), 2);
        assert_eq!(pieces("  ").count(), 0);
    }

    #[test]
    fn the_host_gets_a_long_text_whole() {
        let words = "a remedy at the end of a long text ".repeat(10);
        let logger = Logger::new();
        let send = |text: &str| {
            log::Log::log(&logger, &log::Record::builder().args(format_args!("{text}")).build());
            std::iter::from_fn(|| logger.lock().pop_front()).collect::<Vec<_>>()
        };
        let sent = send(&words);
        assert_eq!(sent.len(), 3);
        assert!(sent.iter().all(|record| record.cut == 0));
        let texts: Vec<&str> = sent.iter().map(|record| record.text.as_str()).collect();
        assert_eq!(texts.join(" "), words.trim());
        // A text that exceeds even that is cut, and the rest is counted once.
        let sent = send(&"x".repeat(WHOLE_TEXT_BYTES_MAX + 7));
        assert_eq!(sent.iter().map(|record| record.cut).collect::<Vec<_>>(), [0, 0, 0, 7]);
    }

    #[test]
    fn the_latest_complaint_and_the_networks_words_are_kept_apart() {
        use log::Level::{Error, Info, Warn};
        let mut latest = Latest::new();
        let other = "plumbline_board::session";
        latest.take(Status::NoCamera, other, Warn, "camera: unplugged");
        latest.take(Status::NoCamera, other, Info, "boot: started");
        latest.take(Status::NoCamera, NETWORK, Info, "network: eth0 has 10.0.2.15/24");
        latest.take(Status::NoCamera, NETWORK, Error, "no Ethernet interface found");
        assert_eq!(latest.complaint, "camera: unplugged");
        assert_eq!(latest.network, "no Ethernet interface found");
        latest.take(Status::NoCamera, other, Error, "camera: it broke");
        assert_eq!(latest.complaint, "camera: it broke");
    }

    #[test]
    fn the_reason_of_a_final_status_stays() {
        let mut latest = Latest::new();
        let other = "plumbline_board::link";
        latest.take(Status::Starting, other, log::Level::Warn, "an early warning");
        for text in ["no line", "configuration refused: a port", "no line"] {
            latest.take(Status::Refused, other, log::Level::Error, text);
        }
        assert_eq!(latest.complaint, "configuration refused: a port");
    }
}
