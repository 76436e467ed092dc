//! Without a terminal: numbers as lines, the picture as a file, stills with their progress.

use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use plumbline_bedside::aim::{Progress, Session, SilenceLines, Stills, Taken};
use plumbline_files::BadInput;

use super::terminal::resized;
use super::{Arguments, Until, Watch, annotated, say};
use crate::ui::png;

/// The numbers come this often.
const LINES_EVERY: Duration = Duration::from_secs(1);

/// The picture is replaced at most this often.
const PICTURE_EVERY: Duration = Duration::from_millis(500);

/// A single picture is waited for this long.
const ONCE_WITHIN: Duration = Duration::from_secs(30);

/// Checks, before the box shows anything, that a picture can be written there.
///
/// # Errors
/// When the name does not end in .png, or no file can be written there.
pub fn check(path: &Path) -> Result<(), BadInput> {
    let refused = |found: String, remedy: &str| Err(BadInput::whole("--png", found, remedy));
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        let found = format!("{} does not end in .png", path.display());
        return refused(found, "give the picture a name that does");
    }
    // A device would be replaced by a picture.
    if path.metadata().is_ok_and(|it| !it.is_file()) {
        return refused(format!("{} is not a file", path.display()), "give another name");
    }
    let directory = plumbline_files::directory_of(path);
    if !directory.is_dir() {
        let found = format!("{} is not a directory", directory.display());
        return refused(found, "make the directory first, or give another name");
    }
    Ok(())
}

/// Runs until the end.
///
/// # Errors
/// When the box, a file or standard output cannot be used.
pub fn run(
    arguments: &Arguments,
    session: &mut Session,
    stills: &mut Stills,
    watch: &mut Watch,
    until: Until<'_>,
) -> Result<(), BadInput> {
    let mut plain = Plain::new(arguments, session, stills, watch);
    while !until.is_over() && !plain.stills.is_done() {
        if plain.turn()? == Next::End {
            break;
        }
    }
    Ok(())
}

/// Whether to go on.
#[derive(PartialEq, Eq)]
enum Next {
    Turn,
    End,
}

/// What the picture that is being taken is for.
enum Purpose {
    Still,
    View,
}

/// The file of --png.
struct Png<'a> {
    path: &'a Path,
    /// When it is due to be replaced.
    at: Instant,
    is_written: bool,
}

/// What the user has been told of the box, so that it is not repeated.
struct News {
    silence: SilenceLines,
    restarts: u32,
    /// Why there are no frames.
    no_frames: Option<&'static str>,
}

struct Plain<'a> {
    arguments: &'a Arguments,
    session: &'a mut Session,
    stills: &'a mut Stills,
    watch: &'a mut Watch,
    output: Output,
    png: Option<Png<'a>>,
    purpose: Purpose,
    news: News,
    /// When the numbers are due.
    numbers_at: Instant,
}

impl<'a> Plain<'a> {
    fn new(
        arguments: &'a Arguments,
        session: &'a mut Session,
        stills: &'a mut Stills,
        watch: &'a mut Watch,
    ) -> Self {
        let start = Instant::now();
        let png = arguments.png.as_deref();
        let restarts = session.restarts();
        Self {
            arguments,
            session,
            stills,
            watch,
            output: Output { start, bar: Bar::default() },
            png: png.map(|path| Png { path, at: start, is_written: false }),
            purpose: Purpose::View,
            news: News { silence: SilenceLines::default(), restarts, no_frames: None },
            numbers_at: start,
        }
    }

    fn turn(&mut self) -> Result<Next, BadInput> {
        let now = Instant::now();
        self.ask_for_picture(now);
        if let Some(taken) = self.session.turn()? {
            self.keep(&taken)?;
        }
        self.tell_news()?;
        if self.session.silence().is_some() {
            return Ok(Next::Turn);
        }
        self.show_progress();
        if self.tell_numbers(now)? == Next::End {
            return Ok(Next::End);
        }
        self.check_time()?;
        Ok(Next::Turn)
    }

    /// Asks for the next picture: a still goes before one for --png.
    fn ask_for_picture(&mut self, now: Instant) {
        if !self.session.is_free() {
            return;
        }
        if self.stills.is_due(now) {
            self.purpose = Purpose::Still;
            self.session.take(1);
            return;
        }
        self.purpose = Purpose::View;
        if let Some(png) = self.png.as_mut().filter(|png| now >= png.at) {
            png.at = now + PICTURE_EVERY;
            self.session.take(self.watch.reduction);
        }
    }

    /// Writes a picture that is complete to the files that it is for.
    fn keep(&mut self, taken: &Taken) -> Result<(), BadInput> {
        self.output.bar.end();
        if let Purpose::Still = self.purpose {
            say(&self.stills.keep(&taken.file)?.to_string())?;
        }
        if let Some(png) = &mut self.png {
            let picture = taken.decoded(self.session.place())?;
            let size_px = picture.dimensions().into();
            png::write(png.path, &annotated(resized(&picture, size_px), taken, self.session))?;
            png.is_written = true;
        }
        Ok(())
    }

    /// Tells of a box that is silent, and of one that has restarted.
    fn tell_news(&mut self) -> Result<(), BadInput> {
        if let Some(text) = self.news.silence.next(self.session.silence()) {
            self.output.tell(&text)?;
        }
        let restarts = self.session.restarts();
        if std::mem::replace(&mut self.news.restarts, restarts) != restarts {
            self.output.tell("the box has restarted")?;
        }
        Ok(())
    }

    fn show_progress(&mut self) {
        if let Purpose::Still = self.purpose
            && let Some(progress) = self.session.progress()
        {
            self.output.bar.show(&self.stills.next_name(), progress);
        }
    }

    /// Tells the numbers if they are due, or why there are none. With --once the first ones
    /// are the end, and they wait for the picture.
    fn tell_numbers(&mut self, now: Instant) -> Result<Next, BadInput> {
        let counts_stills = self.arguments.count.is_some();
        let has_picture = self.png.as_ref().is_none_or(|png| png.is_written);
        if counts_stills || !has_picture || now < self.numbers_at {
            return Ok(Next::Turn);
        }
        if let Some(reading) = self.watch.reading(self.session) {
            for line in reading.lines() {
                self.output.tell(&line)?;
            }
            if self.arguments.once {
                return Ok(Next::End);
            }
            self.numbers_at = now + LINES_EVERY;
        }
        if let Some(why) = self.session.without_frames() {
            // Whoever waits for one picture need not be told again and again.
            let is_told = self.arguments.once && self.news.no_frames == Some(why);
            if !is_told {
                self.news.no_frames = Some(why);
                self.output.tell(why)?;
                self.numbers_at = now + LINES_EVERY;
            }
        }
        Ok(Next::Turn)
    }

    /// With --once a picture is not waited for without end.
    fn check_time(&self) -> Result<(), BadInput> {
        if !self.arguments.once || self.output.start.elapsed() < ONCE_WITHIN {
            return Ok(());
        }
        Err(BadInput::whole(
            self.session.place(),
            self.session.without_frames().unwrap_or("the box sends no picture"),
            "run `plumb doctor`: it says what is wrong with the camera",
        ))
    }
}

/// Lines on standard output, each with its time, and a progress bar.
struct Output {
    start: Instant,
    bar: Bar,
}

impl Output {
    fn tell(&mut self, text: &str) -> Result<(), BadInput> {
        self.bar.end();
        say(&format!("{:6.1} s  {text}", self.start.elapsed().as_secs_f64()))
    }
}

/// How far a still has come, on standard error where that is a terminal.
#[derive(Default)]
struct Bar(Option<ProgressBar>);

impl Bar {
    fn show(&mut self, name: &str, progress: Progress) {
        let bar = self.0.get_or_insert_with(|| {
            let style = "{msg} {wide_bar} {bytes} of {total_bytes}, {eta} left";
            ProgressBar::new(progress.total as u64)
                .with_style(ProgressStyle::with_template(style).expect("a template that is right"))
                .with_message(name.to_owned())
        });
        bar.set_position(progress.there as u64);
    }

    fn end(&mut self) {
        if let Some(bar) = self.0.take() {
            bar.finish_and_clear();
        }
    }
}
