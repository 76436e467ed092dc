//! Log records: to the console, and into a bounded queue from which the main
//! loop sends them to the host. Nothing is allocated, nobody waits.

use std::fmt::Write as _;
use std::io::Write as _;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use heapless::{Deque, String};
use plumbline::packet::{LOG_TARGET_BYTES_MAX, LOG_TEXT_BYTES_MAX, Log, LogLevel};

/// Records that can wait for the main loop, which takes them at every turn.
const WAITING_MAX: usize = 16;

/// The program's logger.
#[derive(Debug)]
pub struct Logger {
    waiting: Mutex<Deque<Waiting, WAITING_MAX>>,
    dropped: AtomicU32,
}

#[derive(Debug)]
struct Waiting {
    at: Instant,
    level: LogLevel,
    target: Cut<LOG_TARGET_BYTES_MAX>,
    text: Cut<LOG_TEXT_BYTES_MAX>,
}

/// A text of at most `N` bytes that counts the bytes for which there was no room.
#[derive(Debug, Default)]
struct Cut<const N: usize> {
    text: String<N>,
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

static LOGGER: Logger = Logger { waiting: Mutex::new(Deque::new()), dropped: AtomicU32::new(0) };

/// Makes this the logger of the program; records of `level` and above are kept.
pub fn install(level: log::LevelFilter) {
    // Fails only when there is a logger already: then that one is kept.
    if log::set_logger(&LOGGER).is_ok() {
        log::set_max_level(level);
    }
}

/// Takes the oldest waiting record; its time is counted from `started`.
pub fn take(started: Instant) -> Option<Log> {
    let waiting = LOGGER.lock().pop_front()?;
    let cut = waiting.target.cut + waiting.text.cut;
    Some(Log {
        uptime_ms: waiting.at.saturating_duration_since(started).as_millis() as u64,
        level: waiting.level,
        target: waiting.target.text,
        text: waiting.text.text,
        cut: u16::try_from(cut).unwrap_or(u16::MAX),
    })
}

/// Records for which there was no room.
pub fn dropped() -> u32 {
    LOGGER.dropped.load(Ordering::Relaxed)
}

impl Logger {
    fn lock(&self) -> std::sync::MutexGuard<'_, Deque<Waiting, WAITING_MAX>> {
        self.waiting.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl log::Log for Logger {
    fn enabled(&self, _: &log::Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &log::Record<'_>) {
        // A console that has gone away is no reason to stop measuring.
        let _ = writeln!(std::io::stderr(), "{}: {}", record.level(), record.args());
        let mut target = Cut::default();
        let mut text = Cut::default();
        // Neither write fails; what does not fit is counted.
        let _ = target.write_str(record.target());
        let _ = text.write_fmt(*record.args());
        let level = match record.level() {
            log::Level::Error => LogLevel::Error,
            log::Level::Warn => LogLevel::Warn,
            log::Level::Info => LogLevel::Info,
            log::Level::Debug => LogLevel::Debug,
            log::Level::Trace => LogLevel::Trace,
        };
        let waiting = Waiting { at: Instant::now(), level, target, text };
        if self.lock().push_back(waiting).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
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
}
