//! Without a terminal: the numbers as lines, the picture as a file, stills with their progress.

use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use image::{ImageFormat, RgbImage};
use indicatif::{ProgressBar, ProgressStyle};

use super::session::{Progress, Session};
use super::stills::Stills;
use super::terminal::resized;
use super::{Arguments, Until, Watch, annotated, decoded, say};
use crate::error::BadInput;

/// The numbers come this often.
const LINES_EVERY: Duration = Duration::from_secs(1);

/// The picture is replaced at most this often.
const PICTURE_EVERY: Duration = Duration::from_millis(500);

/// A single picture is waited for this long.
const ONCE_WITHIN: Duration = Duration::from_secs(30);

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
            if let Some(why) = session.without_frames() {
                say(&format!("{:6.1} s  {why}", start.elapsed().as_secs_f64()))?;
                lines_at = now + LINES_EVERY;
            }
        }
        if arguments.once && start.elapsed() >= ONCE_WITHIN {
            return Err(BadInput::whole(
                session.place(),
                session.without_frames().unwrap_or("the box sends no picture"),
                "see what `plumb receive` says of its camera",
            ));
        }
    }
    Ok(())
}

/// Replaces a file as a whole: who looks at it never sees half a picture.
fn write(path: &Path, picture: &RgbImage) -> Result<(), BadInput> {
    let failed = |error: &std::io::Error| BadInput::io(path.display(), error);
    let mut file = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut file, ImageFormat::Png)
        .map_err(|error| BadInput::whole(path.display(), error, "give another --reduction"))?;
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    let mut beside = tempfile::Builder::new()
        .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666))
        .tempfile_in(directory.unwrap_or(Path::new(".")))
        .map_err(|error| failed(&error))?;
    beside.write_all(file.get_ref()).map_err(|error| failed(&error))?;
    beside.persist(path).map_err(|error| failed(&error.error))?;
    Ok(())
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
