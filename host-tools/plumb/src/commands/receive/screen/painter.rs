//! Writes to standard error from a thread of its own: a terminal that takes nothing for a while, as
//! one behind a connection that stalls, must not hold up the recording.
//!
//! What is shown is one moment: a newer one takes the place of one that waits. What is said is kept
//! line by line, [`SAID_MAX`] lines at most; how many there was no room for is said afterwards.
//!
//! On a terminal, ratatui writes what has changed, and the size is asked for each time, so that a
//! resize is followed. The latest of what was said, as many lines, is written once more when the
//! screen is left.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

use crossterm::cursor::{Hide, Show};
use crossterm::queue;
use crossterm::terminal::{
    self, BeginSynchronizedUpdate, Clear, ClearType, DisableLineWrap, EnableLineWrap,
    EndSynchronizedUpdate, EnterAlternateScreen, LeaveAlternateScreen,
};
use plumbline_files::counting::counted;

use ratatui::backend::{Backend as _, CrosstermBackend};
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use super::layout::{self, Looks};
use super::shown::Shown;

/// Lines that can wait to be written.
const SAID_MAX: usize = 256;

/// Where the terminal does not tell its size.
const SIZE: (u16, u16) = (80, 24);

/// What waits to be written.
#[derive(Debug, Default)]
struct Waiting {
    seen: Option<Shown>,
    said: VecDeque<String>,
    unsaid: u64,
    is_over: bool,
}

/// Where others leave what is to be written.
#[derive(Debug, Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

impl Shared {
    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        // Whoever has panicked has left nothing half done.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Says something to the user, without waiting.
#[derive(Debug, Clone)]
pub(in super::super) struct Voice(Arc<Shared>);

impl Voice {
    pub(in super::super) fn say(&self, text: &str) {
        let mut waiting = self.0.waiting();
        for line in text.lines() {
            if waiting.said.len() < SAID_MAX {
                waiting.said.push_back(line.to_owned());
            } else {
                waiting.unsaid += 1;
            }
        }
        self.0.changed.notify_one();
    }
}

/// The thread that writes.
pub(super) struct Painter {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Painter {
    /// Writes what is said, a line each.
    pub(super) fn lines(out: impl Write + Send + 'static) -> Self {
        Self::start(move |shared| write_lines(shared, out))
    }

    /// Takes the terminal as a screen.
    pub(super) fn screen(out: impl Write + Send + 'static, looks: Looks) -> Self {
        Self::start(move |shared| paint(shared, Canvas::new(out, looks)))
    }

    fn start(write: impl FnOnce(&Shared) -> io::Result<()> + Send + 'static) -> Self {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        // Standard error may be closed; there is nobody else to tell.
        let thread = thread::spawn(move || drop(write(&of_thread)));
        Self { shared, thread: Some(thread) }
    }

    pub(super) fn voice(&self) -> Voice {
        Voice(Arc::clone(&self.shared))
    }

    /// Shows this from now on.
    pub(super) fn show(&self, seen: Shown) {
        self.shared.waiting().seen = Some(seen);
        self.shared.changed.notify_one();
    }
}

impl Drop for Painter {
    /// Waits until all of it is written.
    fn drop(&mut self) {
        self.shared.waiting().is_over = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Takes what waits, as soon as something does.
fn next(shared: &Shared) -> Waiting {
    let is_idle = |it: &mut Waiting| it.seen.is_none() && it.said.is_empty() && !it.is_over;
    let waiting = shared.waiting();
    let mut waiting =
        shared.changed.wait_while(waiting, is_idle).unwrap_or_else(PoisonError::into_inner);
    let is_over = waiting.is_over;
    let mut taken = std::mem::take(&mut *waiting);
    waiting.is_over = is_over;
    if taken.unsaid > 0 {
        let unsaid = counted(taken.unsaid, "more message");
        taken.said.push_back(format!("{unsaid} came while nothing could be written"));
    }
    taken
}

fn write_lines(shared: &Shared, mut out: impl Write) -> io::Result<()> {
    loop {
        let Waiting { said, is_over, .. } = next(shared);
        for line in said {
            writeln!(out, "{line}")?;
        }
        out.flush()?;
        if is_over {
            return Ok(());
        }
    }
}

fn paint(shared: &Shared, mut canvas: Canvas<impl Write>) -> io::Result<()> {
    let mut said = Vec::new();
    let mut seen = None;
    let paint = || {
        canvas.open()?;
        loop {
            let waiting = next(shared);
            said.extend(waiting.said);
            seen = waiting.seen.or(seen);
            if waiting.is_over {
                return Ok(());
            }
            // Only what the terminal can hold is looked at, and what is said is said again.
            said.drain(..said.len().saturating_sub(SAID_MAX));
            if let Some(seen) = &seen {
                canvas.draw(seen, &said, terminal::size().unwrap_or(SIZE))?;
            }
        }
    };
    // Whatever happens, the terminal is left as it was.
    let painted = catch_unwind(AssertUnwindSafe(paint));
    canvas.close(&said)?;
    painted.unwrap_or_else(|panic| resume_unwind(panic))
}

/// A terminal as a screen. Its size is given with each picture, so that nothing here asks it.
struct Canvas<W> {
    out: W,
    looks: Looks,
    /// What is on the terminal.
    drawn: Buffer,
}

impl<W: Write> Canvas<W> {
    fn new(out: W, looks: Looks) -> Self {
        Self { out, looks, drawn: Buffer::empty(Rect::ZERO) }
    }

    fn open(&mut self) -> io::Result<()> {
        self.write(|bytes| queue!(bytes, EnterAlternateScreen, Hide, DisableLineWrap))
    }

    fn draw(&mut self, shown: &Shown, news: &[String], size: (u16, u16)) -> io::Result<()> {
        let mut next = Buffer::empty(Rect::new(0, 0, size.0, size.1));
        layout::draw(shown, news, &mut next, self.looks);
        let is_resized = self.drawn.area != next.area;
        if is_resized {
            self.drawn = Buffer::empty(next.area);
        }
        let before = std::mem::take(&mut self.drawn);
        self.write(|bytes| {
            queue!(bytes, BeginSynchronizedUpdate)?;
            if is_resized {
                queue!(bytes, Clear(ClearType::All))?;
            }
            CrosstermBackend::new(&mut *bytes).draw(before.diff(&next).into_iter())?;
            queue!(bytes, EndSynchronizedUpdate)
        })?;
        self.drawn = next;
        Ok(())
    }

    fn close(&mut self, said: &[String]) -> io::Result<()> {
        self.write(|bytes| {
            queue!(bytes, EnableLineWrap, Show, LeaveAlternateScreen)?;
            said.iter().try_for_each(|line| writeln!(bytes, "{line}"))
        })
    }

    /// Everything at once.
    fn write(&mut self, of: impl FnOnce(&mut Vec<u8>) -> io::Result<()>) -> io::Result<()> {
        let mut bytes = Vec::new();
        of(&mut bytes)?;
        self.out.write_all(&bytes)?;
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::time::{Duration, Instant};

    use plumbline_bedside::recording::{Judgement, NotYet, Seen, Why};

    use super::*;

    /// A terminal that takes nothing until it is told to.
    struct Stalled {
        go_on: Receiver<()>,
        is_going: bool,
        taken: Arc<Mutex<Vec<u8>>>,
    }

    impl Write for Stalled {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if !std::mem::replace(&mut self.is_going, true) {
                let _ = self.go_on.recv();
            }
            self.taken.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn stalled() -> (Stalled, Sender<()>, Arc<Mutex<Vec<u8>>>) {
        let (sender, go_on) = channel();
        let taken = Arc::default();
        (Stalled { go_on, is_going: false, taken: Arc::clone(&taken) }, sender, taken)
    }

    fn seen(elapsed_s: u64) -> Shown {
        let seen = Seen {
            judgement: Judgement { word: None, reasons: vec![Why::new("not recorded", "")] },
            elapsed: Duration::from_secs(elapsed_s),
            remaining: None,
            time: format!("{elapsed_s} s since t = 0"),
            movement: Vec::new(),
            since: "since t = 0",
            counts: Vec::new(),
            figures: vec![("upper", Err(NotYet::Settling)), ("lower", Err(NotYet::Settling))],
        };
        Shown { title: vec!["trials/p01".to_owned()], seen, typed: None }
    }

    #[test]
    fn a_terminal_that_stalls_holds_nothing_up_and_the_latest_is_shown_after_it() {
        let (out, go_on, taken) = stalled();
        let looks = Looks { glyphs: layout::ASCII, is_coloured: false };
        let painter = Painter::screen(out, looks);
        let begun = Instant::now();
        for second in 0..1000 {
            painter.show(seen(second));
            painter.voice().say(&format!("mark {second}"));
        }
        // A thousand times nothing; a write would wait for ever.
        assert!(begun.elapsed() < Duration::from_secs(5));
        {
            let waiting = painter.shared.waiting();
            assert!(waiting.said.len() <= SAID_MAX, "{}", waiting.said.len());
            assert_eq!(waiting.seen, Some(seen(999)));
        }
        go_on.send(()).unwrap();
        drop(painter);
        let text = String::from_utf8(taken.lock().unwrap().clone()).unwrap();
        assert!(text.contains("mark 1\n") && text.contains("more messages came while"), "{text:?}");
        // The terminal is left as it was.
        let [opened, closed] = ["\u{1b}[?1049h", "\u{1b}[?1049l"].map(|it| text.find(it).unwrap());
        assert!(opened < closed);
    }

    #[test]
    fn a_painter_that_panics_leaves_the_terminal_as_it_was() {
        struct Panics(Arc<Mutex<Vec<u8>>>);
        impl Write for Panics {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                assert!(!bytes.windows(3).any(|it| it == b"p01"), "as a bug would");
                self.0.lock().unwrap().extend(bytes);
                Ok(bytes.len())
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let taken = Arc::default();
        let looks = Looks { glyphs: layout::ASCII, is_coloured: false };
        let mut painter = Painter::screen(Panics(Arc::clone(&taken)), looks);
        painter.show(seen(1));
        assert!(painter.thread.take().unwrap().join().is_err());
        let text = String::from_utf8(taken.lock().unwrap().clone()).unwrap();
        assert!(text.ends_with("\u{1b}[?1049l"), "{text:?}");
    }

    #[test]
    fn lines_come_in_order_and_whole() {
        let (out, go_on, taken) = stalled();
        let painter = Painter::lines(out);
        go_on.send(()).unwrap();
        for line in ["one", "two\nthree"] {
            painter.voice().say(line);
        }
        drop(painter);
        assert_eq!(*taken.lock().unwrap(), b"one\ntwo\nthree\n");
    }

    #[test]
    fn only_what_has_changed_is_written_and_a_resize_writes_everything() {
        let looks = Looks { glyphs: layout::ASCII, is_coloured: false };
        let mut canvas = Canvas::new(Vec::new(), looks);
        let mut draw = |elapsed_s, size| {
            canvas.out.clear();
            canvas.draw(&seen(elapsed_s), &[], size).unwrap();
            String::from_utf8(canvas.out.clone()).unwrap()
        };
        let all = draw(10, (60, 15));
        assert!(all.contains("trials/p01") && all.contains("recorded"), "{all:?}");
        let same = draw(10, (60, 15));
        let second = draw(11, (60, 15));
        assert!(!same.contains("trials") && !second.contains("trials"), "{second:?}");
        assert!(second.contains('1') && second.len() < 150, "{second:?}");
        assert_eq!(draw(11, (50, 15)).matches("trials/p01").count(), 1);
    }
}
