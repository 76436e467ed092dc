//! A spinner while the box is waited for; nothing where standard error is not a
//! terminal.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use plumbline_bedside::Told;

const TURN: Duration = Duration::from_millis(100);

/// Shows what a step with a box says: a spinner, and lines on standard error.
pub fn shown() -> impl FnMut(Told) {
    let mut waiting = None;
    move |told| match told {
        Told::Waiting(what) => waiting = Some(Waiting::new(what)),
        Told::Done => drop(waiting.take()),
        Told::Note(text) => eprintln!("{text}"),
        Told::Warning(text) => eprintln!("warning: {text}"),
    }
}

/// Shown until it is dropped.
pub struct Waiting(ProgressBar);

impl Waiting {
    /// Shows `what` and the seconds that have passed.
    #[must_use]
    pub fn new(what: impl Into<String>) -> Self {
        let bar = ProgressBar::new_spinner().with_message(what.into());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(TURN);
        Self(bar)
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
