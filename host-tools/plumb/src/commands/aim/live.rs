//! The live view in a terminal.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use plumbline_bedside::aim::{Reading, Session, Stills, silence_words};
use plumbline_files::BadInput;

use super::terminal::{Graphics, Key, Line, Look, Screen, resized};
use super::{Arguments, Until, Watch, annotated, say};

/// A new picture is asked for at most this often.
const PICTURE_EVERY: Duration = Duration::from_millis(250);

/// The numbers are written this often.
const LINES_EVERY: Duration = Duration::from_millis(250);

/// The number of lines about stills that stay in sight.
const TOLD_MAX: usize = 2;

/// Whether there is a terminal, and lines are not asked for.
pub fn is_possible(arguments: &Arguments) -> bool {
    let is_terminal = std::io::stdout().is_terminal() && std::io::stdin().is_terminal();
    is_terminal && arguments.png.is_none() && !arguments.once
}

/// Runs until the end, and then repeats what was said of stills.
///
/// # Errors
/// When the box, the terminal or a file cannot be used.
pub fn run(
    arguments: &Arguments,
    session: &mut Session,
    stills: &mut Stills,
    watch: &mut Watch,
    until: Until<'_>,
) -> Result<(), BadInput> {
    let mut told = Vec::new();
    let outcome = show(arguments.graphics, session, stills, watch, until, &mut told);
    // The screen is the user's again.
    for text in told {
        say(&text)?;
    }
    outcome
}

fn show(
    graphics: Graphics,
    session: &mut Session,
    stills: &mut Stills,
    watch: &mut Watch,
    until: Until<'_>,
    told: &mut Vec<String>,
) -> Result<(), BadInput> {
    let failed = |error: std::io::Error| BadInput::io("the terminal", &error);
    let mut screen = Screen::open(graphics).map_err(failed)?;
    let (mut picture_at, mut lines_at) = (Instant::now(), Instant::now());
    // A still was asked for by its key; one is under way.
    let (mut wants_still, mut takes_still) = (false, false);
    let mut lines = 0;
    while !until.is_over() && !stills.is_done() {
        match screen.key().map_err(failed)? {
            Some(Key::Quit) => break,
            Some(Key::Still) => wants_still = true,
            None => {}
        }
        let now = Instant::now();
        let still_is_due = wants_still || stills.is_due(now);
        if !takes_still && still_is_due {
            // It replaces a picture for the view that is under way.
            takes_still = true;
            session.take(1);
        } else if session.is_free() && screen.has_pictures() && now >= picture_at {
            picture_at = now + PICTURE_EVERY;
            session.take(watch.reduction);
        }
        if let Some(taken) = session.turn()? {
            if std::mem::take(&mut takes_still) {
                wants_still = false;
                told.push(stills.keep(&taken.file)?.to_string());
            }
            let picture = taken.decoded(session.place())?;
            let size_px = screen.picture_px(picture.dimensions().into(), lines).map_err(failed)?;
            if let Some(size_px) = size_px {
                let picture = annotated(resized(&picture, size_px), &taken, session);
                screen.show_picture(&picture).map_err(failed)?;
            }
        }
        if now >= lines_at {
            lines_at = now + LINES_EVERY;
            let columns = screen.columns().map_err(failed)?;
            let text = text(session, stills, watch, takes_still, until, told);
            let text: Vec<Line> = text.iter().flat_map(|line| wrapped(line, columns)).collect();
            // The picture leaves room for them.
            lines = lines.max(text.len());
            screen.show_lines(&text).map_err(failed)?;
        }
    }
    Ok(())
}

fn line(look: Look, text: impl Into<String>) -> Line {
    Line { text: text.into(), look }
}

/// Breaks a line between words into lines that fit; all but the first are indented.
fn wrapped(long: &Line, columns: usize) -> Vec<Line> {
    let mut lines = vec![String::new()];
    for word in long.text.split_inclusive(' ') {
        let last = lines.last_mut().expect("never empty");
        let is_full = last.chars().count() + word.trim_end().chars().count() > columns;
        if is_full && !last.trim().is_empty() {
            lines.push(format!("    {word}"));
        } else {
            last.push_str(word);
        }
    }
    lines.into_iter().map(|text| line(long.look, text)).collect()
}

/// Everything below the picture.
fn text(
    session: &Session,
    stills: &Stills,
    watch: &mut Watch,
    takes_still: bool,
    until: Until<'_>,
    told: &[String],
) -> Vec<Line> {
    let left = until.at.saturating_duration_since(Instant::now()).as_secs();
    let mut lines = vec![line(
        Look::Bold,
        format!(
            "{}: SET-UP MODE, pictures leave the box; ends in {}:{:02}   q: end   s: take {}",
            session.config().device,
            left / 60,
            left % 60,
            stills.next_path().display()
        ),
    )];
    let latest = told.len().saturating_sub(TOLD_MAX);
    let told = told[latest..].iter().map(|text| line(Look::Plain, text.as_str()));
    if let Some(silence) = session.silence() {
        lines.push(line(Look::Advice, format!("-> {}", silence_words(silence))));
        lines.extend(told);
        return lines;
    }
    match watch.reading(session) {
        Some(reading) => lines.extend(of_reading(&reading)),
        None => lines.push(line(Look::Plain, "no numbers yet")),
    }
    if let Some(why) = session.without_frames() {
        lines.push(line(Look::Advice, format!("-> {why}")));
    }
    lines.push(line(Look::Plain, of_still(session, stills, takes_still)));
    lines.extend(told);
    lines
}

fn of_reading(reading: &Reading) -> Vec<Line> {
    let mut lines = Vec::new();
    let width = reading.targets.iter().map(|target| target.name.chars().count()).max();
    let width = width.unwrap_or(0).max("frame".len());
    let mut tell = |name: &str, text: String, advice: &[String]| {
        lines.push(line(Look::Plain, format!("{name:width$}  {text}")));
        let advice = if advice.is_empty() { String::new() } else { advice.join("; ") };
        let arrow = if advice.is_empty() { "" } else { "-> " };
        lines.push(line(Look::Advice, format!("{:width$}  {arrow}{advice}", "")));
    };
    for target in &reading.targets {
        let numbers = std::iter::once(&target.state).chain(&target.numbers);
        let text = numbers.map(String::as_str).collect::<Vec<_>>().join(", ");
        tell(&target.name, text, &target.advice);
    }
    tell("frame", reading.frame.text.clone(), &reading.frame.advice);
    lines
}

/// The progress of a still under way, or the time until the next one.
fn of_still(session: &Session, stills: &Stills, takes_still: bool) -> String {
    let name = stills.next_name();
    match (takes_still, session.progress(), stills.wait(Instant::now())) {
        (true, Some(progress), _) => {
            let [there, total] = [progress.there, progress.total].map(|bytes| bytes.div_ceil(1000));
            let left = progress.left.map(|left| format!(", {} s left", left.as_secs() + 1));
            format!("{name}: {there} of {total} kB{}", left.unwrap_or_default())
        }
        (true, None, _) => format!("{name}: being taken"),
        (false, _, Some(wait)) => format!("{name} in {} s", wait.as_secs() + 1),
        (false, _, None) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_between_words() {
        let texts = |text: &str, columns| -> Vec<String> {
            wrapped(&line(Look::Plain, text), columns).into_iter().map(|line| line.text).collect()
        };
        assert_eq!(texts("focus 97, light 0.86", 80), ["focus 97, light 0.86"]);
        assert_eq!(texts("focus 97, light 0.86", 12), ["focus 97, ", "    light ", "    0.86"]);
        assert_eq!(texts("a_word_without_end", 5), ["a_word_without_end"]);
        assert_eq!(texts("", 5), [""]);
    }
}
