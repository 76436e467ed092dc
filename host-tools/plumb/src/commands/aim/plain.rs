//! Without a terminal: the numbers as lines, the picture as a file, stills with their progress.

use std::path::Path;
use std::time::{Duration, Instant};

use image::{ImageFormat, RgbImage};
use indicatif::{ProgressBar, ProgressStyle};
use plumbline_files::BadInput;

use super::session::{Progress, Session};
use super::stills::Stills;
use super::terminal::resized;
use super::{Arguments, SilenceLines, Until, Watch, annotated, decoded, say};

/// The numbers come this often.
const LINES_EVERY: Duration = Duration::from_secs(1);

/// The picture is replaced at most this often.
const PICTURE_EVERY: Duration = Duration::from_millis(500);

/// A single picture is waited for this long.
const ONCE_WITHIN: Duration = Duration::from_secs(30);

/// Checks, before the box shows anything, that a picture can be put there.
///
/// # Errors
/// When it is no name of a picture, or something else than a file or its directory is there.
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
    let start = Instant::now();
    let (mut lines_at, mut picture_at) = (start, start);
    let mut takes_still = false;
    let mut bar = Bar::default();
    let mut silence_lines = SilenceLines::default();
    let mut told_why = None;
    let mut restarts = session.restarts();
    // All that is asked for once is there.
    let mut has_picture = arguments.png.is_none();
    while !until.is_over() && !stills.is_done() {
        let now = Instant::now();
        if session.is_free() {
            takes_still = stills.is_due(now);
            if takes_still {
                session.take(1);
            } else if arguments.png.is_some() && now >= picture_at {
                picture_at = now + PICTURE_EVERY;
                session.take(watch.reduction);
            }
        }
        if let Some(taken) = session.turn()? {
            bar.end();
            if takes_still {
                say(&stills.keep(&taken.file)?)?;
            }
            if let Some(path) = &arguments.png {
                let picture = decoded(&taken, session)?;
                let size_px = picture.dimensions().into();
                write(path, &annotated(resized(&picture, size_px), &taken, session))?;
                has_picture = true;
            }
        }
        if let Some(text) = silence_lines.next(session.silence()) {
            bar.end();
            say(&format!("{:6.1} s  {text}", start.elapsed().as_secs_f64()))?;
        }
        if session.restarts() != restarts {
            restarts = session.restarts();
            bar.end();
            say(&format!("{:6.1} s  the box has started anew", start.elapsed().as_secs_f64()))?;
        }
        if session.silence().is_some() {
            continue;
        }
        if takes_still && let Some(progress) = session.progress() {
            bar.show(&stills.next_name(), progress);
        }
        let counts_stills = arguments.count.is_some();
        if now >= lines_at && has_picture && !counts_stills {
            if let Some(reading) = watch.reading(session) {
                let elapsed_s = start.elapsed().as_secs_f64();
                for line in reading.lines() {
                    say(&format!("{elapsed_s:6.1} s  {line}"))?;
                }
                if arguments.once {
                    return Ok(());
                }
                lines_at = now + LINES_EVERY;
            }
            let why = session.without_frames();
            // Who waits for one picture need not be told again and again.
            let is_told = arguments.once && why == told_why;
            if let Some(why) = why.filter(|_| !is_told) {
                told_why = Some(why);
                say(&format!("{:6.1} s  {why}", start.elapsed().as_secs_f64()))?;
                lines_at = now + LINES_EVERY;
            }
        }
        if arguments.once && start.elapsed() >= ONCE_WITHIN {
            return Err(BadInput::whole(
                session.place(),
                session.without_frames().unwrap_or("the box sends no picture"),
                "run `plumb doctor`: it says what is amiss with the camera",
            ));
        }
    }
    Ok(())
}

fn write(path: &Path, picture: &RgbImage) -> Result<(), BadInput> {
    let mut file = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut file, ImageFormat::Png)
        .map_err(|error| BadInput::whole(path.display(), error, "give another --reduction"))?;
    plumbline_files::replace(path, file.get_ref())
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
