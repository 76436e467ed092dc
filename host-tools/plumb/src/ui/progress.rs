//! A progress bar while frames are tracked, or trials analysed.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A shorter run needs no progress bar.
const PROGRESS_AFTER: Duration = Duration::from_millis(700);

/// Shown on a terminal only, and only when the work takes long.
pub struct Progress {
    bar: ProgressBar,
    started: Instant,
}

impl Progress {
    /// For this number of frames, if it is known; never shown unless `is_shown`.
    pub fn new(frames: Option<u64>, is_shown: bool) -> Self {
        let bar = match frames {
            Some(frames) => ProgressBar::new(frames)
                .with_style(style("tracking {wide_bar} {pos}/{len} frames, {eta} left")),
            None => ProgressBar::no_length()
                .with_style(style("tracking {spinner} {pos} frames, {per_sec}")),
        };
        let progress = Self::hidden(bar);
        if !is_shown {
            progress.bar.finish();
        }
        progress
    }

    /// For this number of trials; `what` is done with each, such as "analysing".
    pub fn of_trials(what: &'static str, trials: usize) -> Self {
        let bar = ProgressBar::new(trials as u64).with_prefix(what);
        let style = style("{prefix} {wide_bar} {pos}/{len} trials, {eta} left");
        Self::hidden(bar.with_style(style))
    }

    /// Whether all is done.
    pub fn is_full(&self) -> bool {
        Some(self.bar.position()) == self.bar.length()
    }

    /// A bar that is not shown yet.
    fn hidden(bar: ProgressBar) -> Self {
        bar.set_draw_target(ProgressDrawTarget::hidden());
        Self { bar, started: Instant::now() }
    }

    /// One more frame or trial is done.
    pub fn advance(&self) {
        self.bar.inc(1);
        if self.bar.is_hidden()
            && !self.bar.is_finished()
            && self.started.elapsed() > PROGRESS_AFTER
        {
            // Hides itself when standard error is no terminal.
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("a template that is right")
}
