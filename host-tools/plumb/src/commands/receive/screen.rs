//! What the user sees while a reception goes on: a screen on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use anstream::{AutoStream, ColorChoice};
use plumbline_bedside::recording::{Course, Live};
use plumbline_files::text::printable;
use plumbline_stream::receiver::Receiver;
use plumbline_trial::verdict::Criteria;

use layout::Looks;
use painter::Painter;
use shown::Shown;

mod bars;
mod big;
mod layout;
mod painter;
mod plots;
mod shown;

pub(super) use painter::Voice;

/// A terminal is redrawn this often.
const REDRAW_EVERY: Duration = Duration::from_millis(100);

/// Where standard error is no terminal, a line is written this often.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Whether the terminal becomes a screen.
pub(super) fn is_screen(is_quiet: bool) -> bool {
    // One that can only append lines.
    let is_dumb = std::env::var_os("TERM").is_some_and(|name| name == "dumb");
    !is_quiet && !is_dumb && std::io::stderr().is_terminal()
}

/// The live view, on standard error.
pub(super) struct Screen {
    /// Absent where nothing is to be shown.
    painter: Option<Painter>,
    is_screen: bool,
    /// The trial, the participant and the condition.
    title: Vec<String>,
    live: Live,
    last: Option<Instant>,
}

impl Screen {
    pub(super) fn new(
        place: &str,
        title: &[String],
        criteria: Option<Criteria>,
        is_quiet: bool,
    ) -> Self {
        let is_screen = is_screen(is_quiet);
        let painter = match (is_quiet, is_screen) {
            (true, _) => None,
            (false, true) => Some(Painter::screen(std::io::stderr(), looks())),
            (false, false) => Some(Painter::lines(std::io::stderr())),
        };
        let screen = Self {
            painter,
            is_screen,
            title: title.iter().map(|part| printable(part).into_owned()).collect(),
            live: Live::new(criteria, Instant::now()),
            last: None,
        };
        if let Some(voice) = screen.voice().filter(|_| !is_screen) {
            voice.say(&format!("listening at {place}"));
        }
        screen
    }

    /// What the user is told by, if by anything.
    pub(super) fn voice(&self) -> Option<Voice> {
        self.painter.as_ref().map(Painter::voice)
    }

    /// Takes note of what came; shows it, if it is time. `typed` is what is being typed.
    pub(super) fn show<W: Write>(
        &mut self,
        receiver: &mut Receiver<W>,
        course: &mut Course,
        typed: impl FnOnce() -> Option<String>,
    ) {
        let news = receiver.take_notices().into_iter().chain(course.news());
        for notice in news {
            if let Some(voice) = self.voice() {
                voice.say(&notice);
            }
        }
        let now = Instant::now();
        self.live.take(receiver, course, now);
        let every = if self.is_screen { REDRAW_EVERY } else { LINE_EVERY };
        if now.duration_since(*self.last.get_or_insert(now)) < every {
            return;
        }
        self.last = Some(now);
        let Some(painter) = &self.painter else { return };
        let seen = self.live.seen(receiver, course, now);
        if self.is_screen {
            painter.show(Shown { title: self.title.clone(), seen, typed: typed() });
        } else {
            painter.voice().say(&shown::line(&seen));
        }
    }
}

/// Blocks and colours, where the terminal has them.
fn looks() -> Looks {
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"]
        .into_iter()
        .find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()));
    let is_utf8 = locale.is_some_and(|it| it.to_lowercase().replace('-', "").contains("utf8"));
    Looks {
        glyphs: if is_utf8 { layout::BLOCKS } else { layout::ASCII },
        is_coloured: AutoStream::choice(&std::io::stderr()) != ColorChoice::Never,
    }
}

#[cfg(test)]
mod tests;
