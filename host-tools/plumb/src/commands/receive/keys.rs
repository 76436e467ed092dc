//! The keyboard while the terminal is a screen: what is typed appears there, not wherever the cursor
//! happens to be, and Ctrl-Z cannot halt a recording. Enter makes a mark of it, Ctrl-C ends.

use std::io::{self, IsTerminal as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use crossterm::terminal;
use plumbline_bedside::recording::marks;
use plumbline_trial::mark::{Mark, MarkSender, Source};

/// The end is noticed within this time.
const WAIT: Duration = Duration::from_millis(50);

/// More letters than a mark's label has.
const TYPED_MAX: usize = 80;

/// Whether somebody can type a mark.
pub(super) fn is_there() -> bool {
    io::stdin().is_terminal()
}

/// Takes lines from the keyboard, if there is one, where the terminal is not a screen.
pub(super) fn listen_to_lines(sender: MarkSender) {
    // A script's standard input is not this program's to read.
    if is_there() {
        thread::spawn(move || marks::lines(io::stdin().lock(), Source::Key, &sender));
    }
}

/// The keyboard in use; the terminal is restored when this is dropped.
pub(super) struct Keys {
    typed: Arc<Mutex<String>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// What a key asks for.
#[derive(Debug, PartialEq, Eq)]
enum Asked {
    Nothing,
    Mark(String),
    Stop,
}

impl Keys {
    /// Takes the keyboard; what was typed before counts for nothing. Marks go to `sender`, if there
    /// is a recording that takes them; Ctrl-C sets `stop`.
    ///
    /// # Errors
    /// When the terminal cannot be set up.
    pub(super) fn open(sender: Option<MarkSender>, stop: Arc<AtomicBool>) -> io::Result<Self> {
        terminal::enable_raw_mode()?;
        // From here on the terminal is restored, whatever happens.
        let mut keys = Self { typed: Arc::default(), is_over: Arc::default(), thread: None };
        while event::poll(Duration::ZERO)? {
            event::read()?;
        }
        let (typed, is_over) = (Arc::clone(&keys.typed), Arc::clone(&keys.is_over));
        keys.thread = Some(thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                let key = match event::poll(WAIT) {
                    Ok(false) => continue,
                    Ok(true) => event::read(),
                    Err(error) => Err(error),
                };
                let at = Instant::now();
                let asked = match key {
                    Ok(Event::Key(key)) => pressed(&mut locked(&typed), key),
                    Ok(_) => Asked::Nothing,
                    // The terminal is gone.
                    Err(_) => return,
                };
                match (asked, &sender) {
                    (Asked::Mark(label), Some(sender)) => {
                        sender.send(at, Mark::new(Source::Key, &label));
                    }
                    (Asked::Stop, _) => stop.store(true, Ordering::Relaxed),
                    _ => {}
                }
            }
        }));
        Ok(keys)
    }

    /// What has been typed since the last mark.
    pub(super) fn typed(&self) -> String {
        locked(&self.typed).clone()
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It takes no longer than it waits for a key.
            let _ = thread.join();
        }
        // There is nobody to tell.
        let _ = terminal::disable_raw_mode();
    }
}

fn locked(typed: &Mutex<String>) -> std::sync::MutexGuard<'_, String> {
    // A text is whole, whoever has panicked.
    typed.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Edits the line that is being typed.
fn pressed(typed: &mut String, key: KeyEvent) -> Asked {
    if key.kind == KeyEventKind::Release {
        return Asked::Nothing;
    }
    let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('c') if is_control => return Asked::Stop,
        // A terminal that sends a line feed for Enter.
        KeyCode::Char('j') if is_control => return Asked::Mark(std::mem::take(typed)),
        KeyCode::Enter => return Asked::Mark(std::mem::take(typed)),
        KeyCode::Char('u') if is_control => typed.clear(),
        KeyCode::Esc => typed.clear(),
        KeyCode::Backspace => {
            typed.pop();
        }
        KeyCode::Char(letter) if !is_control && typed.chars().count() < TYPED_MAX => {
            typed.push(letter);
        }
        _ => {}
    }
    Asked::Nothing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_edited_and_enter_takes_it() {
        let mut typed = String::new();
        let mut press = |code, modifiers| pressed(&mut typed, KeyEvent::new(code, modifiers));
        let plain = KeyModifiers::NONE;
        for code in ['t', 'u', 'x'].map(KeyCode::Char) {
            assert_eq!(press(code, plain), Asked::Nothing);
        }
        for code in [KeyCode::Backspace, KeyCode::Left, KeyCode::Char('r'), KeyCode::Char('N')] {
            let shift =
                if code == KeyCode::Char('N') { KeyModifiers::SHIFT } else { KeyModifiers::NONE };
            assert_eq!(press(code, shift), Asked::Nothing);
        }
        assert_eq!(press(KeyCode::Enter, plain), Asked::Mark("turN".to_owned()));
        assert_eq!(press(KeyCode::Char('j'), KeyModifiers::CONTROL), Asked::Mark(String::new()));
        assert_eq!(press(KeyCode::Char('c'), KeyModifiers::CONTROL), Asked::Stop);
        // Ctrl-Z does not halt a recording.
        assert_eq!(press(KeyCode::Char('z'), KeyModifiers::CONTROL), Asked::Nothing);
        for _ in 0..200 {
            press(KeyCode::Char('x'), plain);
        }
        let Asked::Mark(long) = press(KeyCode::Enter, plain) else { panic!("no mark") };
        assert_eq!(long.len(), TYPED_MAX);
    }
}
