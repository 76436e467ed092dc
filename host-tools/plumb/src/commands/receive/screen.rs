//! What the user sees while a reception goes on: a screen on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use anstream::{AutoStream, ColorChoice};
use plumbline_files::counting::counted;
use plumbline_files::text::printable;
use plumbline_stream::receiver::Receiver;
use plumbline_trial::verdict::Criteria;

use super::course::Course;
use super::words;
use judgement::{Judgement, Silence};
use painter::{Looks, Painter};
use seen::Seen;
use sway::Sway;

mod big;
mod judgement;
mod layout;
mod painter;
mod seen;
mod sway;

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
    /// By what the trial is judged; absent where nothing is recorded.
    criteria: Option<Criteria>,
    begun: Instant,
    last: Option<Instant>,
    sway: Sway,
    /// The t = 0 from which movement counts.
    zero: Option<Instant>,
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
            criteria,
            begun: Instant::now(),
            last: None,
            sway: Sway::new(),
            zero: None,
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
        if std::mem::replace(&mut self.zero, course.zero()) != course.zero() {
            self.sway.start_over();
        }
        if let Some(latest) = receiver.latest(now) {
            self.sway.take(latest, !course.awaits_mark());
        }
        let every = if self.is_screen { REDRAW_EVERY } else { LINE_EVERY };
        if now.duration_since(*self.last.get_or_insert(now)) < every {
            return;
        }
        self.last = Some(now);
        let Some(painter) = &self.painter else { return };
        let seen = Seen { typed: typed(), ..self.seen(receiver, course, now) };
        if self.is_screen {
            painter.show(seen);
        } else {
            painter.voice().say(&seen.line());
        }
    }

    fn seen<W: Write>(&self, receiver: &Receiver<W>, course: &Course, now: Instant) -> Seen {
        let movement = receiver.latest(now).map(|latest| self.sway.movement(latest));
        Seen {
            title: self.title.clone(),
            judgement: self.judgement(receiver, course, now),
            elapsed: course.elapsed(now).0,
            remaining: course
                .remaining(now)
                .map(|(to_go, _)| to_go)
                .filter(|_| !course.awaits_mark()),
            time: time(course, now),
            movement: movement.unwrap_or_default(),
            since: course.movement_since(),
            counts: counts(receiver, course, now),
            typed: None,
        }
    }

    fn judgement<W: Write>(
        &self,
        receiver: &Receiver<W>,
        course: &Course,
        now: Instant,
    ) -> Judgement {
        let lasts = receiver.silence(now);
        let silence = receiver.latest(now).is_none().then(|| Silence {
            lasts: lasts.unwrap_or(now.saturating_duration_since(self.begun)),
            had_pose: lasts.is_some(),
            words: words::silence(receiver, now),
        });
        match &self.criteria {
            Some(criteria) => judgement::of_recording(criteria, course.verdict(), silence),
            None => judgement::of_nothing(silence),
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

/// How far the recording has come.
fn time(course: &Course, now: Instant) -> String {
    let (elapsed, since) = course.elapsed(now);
    let mut words = vec![format!("{:.0} s {since}", elapsed.as_secs_f64())];
    words.extend(
        course.remaining(now).map(|(to_go, until)| format!("{} s {until}", to_go.as_secs())),
    );
    words.extend(course.note().map(str::to_owned));
    words.join(", ")
}

/// Rate, losses and so on, the most important first.
fn counts<W: Write>(receiver: &Receiver<W>, course: &Course, now: Instant) -> Vec<String> {
    let counts = receiver.counts();
    let of = course.asked_hz().map(|hz| format!(" of {hz}")).unwrap_or_default();
    let lost_percent = 100.0 * counts.lost as f64 / (counts.received + counts.lost).max(1) as f64;
    let mut words = vec![
        format!("{:.1}{of} Hz", receiver.rate_hz(now)),
        format!("{} lost ({lost_percent:.1} %)", counts.lost),
        counted(counts.received, "frame"),
    ];
    if let Some(latest) = receiver.latest(now) {
        words.push(format!("latency {:.1} ms", f64::from(latest.latency_us) / 1000.0));
    }
    words.push(format!("{} late", counts.late));
    words.push(format!("{} corrupt", receiver.bad().corrupt));
    words
}

#[cfg(test)]
mod tests;
