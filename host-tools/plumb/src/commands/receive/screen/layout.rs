//! Where everything is on a terminal of any size.
//!
//! In: what is [`Shown`], the news, and the size. Out: as many rows as the terminal has, none wider
//! than it. A large terminal has the word and the clock in large letters and thick bars; a smaller
//! one has the same words in one line, then thin bars, then numbers instead of bars. What is still
//! too much is left out, the least important first.

use std::time::Duration;

use anstyle::{AnsiColor, Style};
use unicode_width::UnicodeWidthChar as _;

use plumbline_bedside::recording::{AXES, Along, Movement, Seen, Why, Word};

use super::big;
use super::shown::{Shown, no_minus_zero, numbers};

/// What lines are drawn with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Glyphs {
    pub(super) dot: char,
    pub(super) track: char,
    pub(super) range: char,
    pub(super) origin: char,
    pub(super) cut: char,
}

/// Of a terminal that shows Unicode.
pub(super) const BLOCKS: Glyphs =
    Glyphs { dot: '█', track: '─', range: '▒', origin: '│', cut: '…' };

/// Of any other.
pub(super) const ASCII: Glyphs = Glyphs { dot: '#', track: '-', range: '=', origin: '|', cut: '~' };

/// The ends of the bars' scale.
const SCALES_MM: [f64; 9] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0];

/// A part of a row.
#[derive(Debug, Clone, PartialEq)]
struct Span {
    style: Style,
    text: String,
}

/// A row of the terminal.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Row(Vec<Span>);

impl Row {
    fn plain(text: impl Into<String>) -> Self {
        Self::default().and(Style::new(), text)
    }

    fn and(mut self, style: Style, text: impl Into<String>) -> Self {
        self.0.push(Span { style, text: text.into() });
        self
    }

    /// The row as it is written, no wider than this.
    pub(super) fn written(&self, columns: usize, glyphs: Glyphs, is_coloured: bool) -> String {
        let whole: usize = self.0.iter().map(|span| width(&span.text)).sum();
        // What is cut ends with a sign of it.
        let room = if whole <= columns { columns } else { columns.saturating_sub(1) };
        let mut written = String::new();
        let mut used = 0;
        for Span { style, text } in &self.0 {
            let fits = |letter: &char| {
                let is_in = used + letter.width().unwrap_or(0) <= room;
                used += letter.width().unwrap_or(0);
                is_in
            };
            // A control character has no width and is no text.
            let text: String =
                text.chars().filter(|it| it.width().is_some()).take_while(fits).collect();
            if is_coloured && !text.is_empty() {
                written += &format!("{style}{text}{style:#}");
            } else {
                written += &text;
            }
        }
        if whole > columns && columns > 0 {
            written.push(glyphs.cut);
        }
        written
    }
}

fn width(text: &str) -> usize {
    text.chars().filter_map(char::width).sum()
}

/// How much there is room for, the richest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    /// Large letters, and bars of so many rows.
    Large { thick: usize },
    /// One line for word and clock, and bars.
    Bars,
    /// One line for word and clock, and numbers.
    Numbers,
}

const FORMS: [Form; 4] =
    [Form::Large { thick: 2 }, Form::Large { thick: 1 }, Form::Bars, Form::Numbers];

/// Rows that stay or go together; the higher `keep`, the longer they stay.
struct Block {
    keep: u8,
    rows: Vec<Row>,
}

/// Everything, for a terminal of this size.
pub(super) fn rows(shown: &Shown, news: &[String], size: [usize; 2], glyphs: Glyphs) -> Vec<Row> {
    let [columns, height] = size;
    let total = |blocks: &[Block]| blocks.iter().map(|block| block.rows.len()).sum::<usize>();
    let fitting = FORMS.into_iter().find_map(|form| {
        let blocks = blocks(shown, form, columns, glyphs)?;
        (total(&blocks) + news_min(form) <= height).then_some(blocks)
    });
    let mut blocks = fitting.unwrap_or_else(|| {
        let mut blocks = blocks(shown, Form::Numbers, columns, glyphs).unwrap_or_default();
        while total(&blocks) > height {
            let Some(least) = (0..blocks.len()).min_by_key(|at| blocks[*at].keep) else { break };
            blocks.remove(least);
        }
        blocks
    });
    let news = news_rows(news, height - total(&blocks), columns);
    let prompt = prompt(shown).filter(|_| blocks.iter().any(|block| block.keep == PROMPT));
    blocks.retain(|block| block.keep != PROMPT);
    blocks.into_iter().flat_map(|block| block.rows).chain(news).chain(prompt).collect()
}

/// The latest news that fit; the very latest are the ones to be noticed.
fn news_rows(news: &[String], height: usize, columns: usize) -> Vec<Row> {
    let (before, latest) = news.split_at(news.len().saturating_sub(1));
    let lines = |news: &[String], style| {
        let lines: Vec<String> = news.iter().flat_map(|line| wrapped(line, columns)).collect();
        lines.into_iter().map(move |line| Row::default().and(style, line))
    };
    // Each takes a row at least.
    let before = &before[before.len().saturating_sub(height)..];
    let rows: Vec<Row> =
        lines(before, Style::new()).chain(lines(latest, Style::new().bold())).collect();
    let mut rows = rows[rows.len().saturating_sub(height)..].to_vec();
    rows.resize(height, Row::default());
    rows
}

/// The news have at least so many rows.
fn news_min(form: Form) -> usize {
    match form {
        Form::Large { thick: 2 } => 4,
        Form::Large { .. } => 2,
        Form::Bars => 1,
        Form::Numbers => 0,
    }
}

const HEAD: u8 = 9;
const REASONS: u8 = 8;
const MOVEMENT: u8 = 7;
const COUNTS: u8 = 6;
const TITLE: u8 = 3;
const TIME: u8 = 2;
const PROMPT: u8 = 1;
const BLANK: u8 = 0;

/// All but the news; `None` where the form is too wide.
fn blocks(shown: &Shown, form: Form, columns: usize, glyphs: Glyphs) -> Option<Vec<Block>> {
    let Shown { title, seen, .. } = shown;
    let block = |keep, rows| Block { keep, rows };
    let blank = || block(BLANK, vec![Row::default()]);
    let (head, reasons, movement) = match form {
        Form::Large { thick } => (
            large(seen, columns, glyphs)?,
            if thick > 1 { advice(seen, columns) } else { reasons(seen, 3, columns) },
            bars(seen, thick, columns, glyphs)?,
        ),
        Form::Bars => {
            (vec![small(seen)], reasons(seen, 2, columns), bars(seen, 1, columns, glyphs)?)
        }
        Form::Numbers => {
            let movement = seen.movement.iter().map(|it| Row::plain(numbers(it))).collect();
            (vec![small(seen)], reasons(seen, 1, columns), movement)
        }
    };
    let title = Row::default().and(Style::new().bold(), title.join(", "));
    let mut blocks = vec![
        block(TITLE, vec![title]),
        block(HEAD, head),
        block(TIME, vec![Row::plain(&seen.time)]),
        block(REASONS, reasons),
        block(MOVEMENT, movement),
        block(COUNTS, vec![Row::plain(fitting(&seen.counts, columns))]),
    ];
    if matches!(form, Form::Large { .. }) {
        for at in [5, 4, 1] {
            blocks.insert(at, blank());
        }
    }
    blocks.extend(prompt(shown).map(|row| block(PROMPT, vec![row])));
    Some(blocks)
}

/// As many of the parts as fit, from the first on.
fn fitting(parts: &[String], columns: usize) -> String {
    let mut text = String::new();
    for part in parts {
        let longer = if text.is_empty() { part.clone() } else { format!("{text}, {part}") };
        if width(&longer) > columns && !text.is_empty() {
            break;
        }
        text = longer;
    }
    text
}

fn colour(word: Word) -> Style {
    let colour = match word {
        Word::Wait => return Style::new().bold(),
        Word::Good => AnsiColor::Green,
        Word::Look => AnsiColor::Yellow,
        Word::Stop => AnsiColor::Red,
    };
    colour.on_default().bold()
}

fn minutes(time: Duration) -> String {
    format!("{}:{:02}", time.as_secs() / 60, time.as_secs() % 60)
}

/// Minutes and seconds that are left, rounded up: 0 is the end.
fn to_go(seen: &Seen) -> Option<String> {
    seen.remaining.map(|it| minutes(it + Duration::from_millis(999)))
}

/// Word and clock in large letters, with what remains where there is room.
fn large(seen: &Seen, columns: usize, glyphs: Glyphs) -> Option<Vec<Row>> {
    const BETWEEN: usize = 4;
    let word = seen.judgement.word;
    let text = word.map_or("", Word::text);
    let elapsed = minutes(seen.elapsed);
    let both = to_go(seen).map(|to_go| format!("{elapsed} -{to_go}"));
    let room = columns.checked_sub(big::columns(text) + BETWEEN)?;
    let clock = both.into_iter().chain([elapsed]).find(|it| big::columns(it) <= room)?;
    let (word_lines, clock_lines) = (big::lines(text, glyphs.dot), big::lines(&clock, glyphs.dot));
    let row = |(word_line, clock_line)| {
        let row = Row::default().and(word.map_or(Style::new(), colour), word_line);
        row.and(Style::new(), " ".repeat(BETWEEN)).and(Style::new().bold(), clock_line)
    };
    Some(word_lines.into_iter().zip(clock_lines).map(row).collect())
}

/// Word and clock in one row.
fn small(seen: &Seen) -> Row {
    let word = seen.judgement.word;
    let row = word.map_or_else(Row::default, |word| {
        let style = colour(word).invert();
        Row::default().and(style, format!(" {} ", word.text())).and(Style::new(), "  ")
    });
    let to_go = to_go(seen).map(|it| format!("   {it} to go")).unwrap_or_default();
    row.and(Style::new().bold(), minutes(seen.elapsed) + &to_go)
}

/// Why.
fn reasons(seen: &Seen, rows: usize, columns: usize) -> Vec<Row> {
    let words = seen.judgement.reasons.iter().map(|why| why.words.clone()).collect();
    stacked(seen, words, rows, columns)
}

/// Why, and what can be done.
fn advice(seen: &Seen, columns: usize) -> Vec<Row> {
    let whole = |why: &Why| match &*why.remedy {
        "" => why.words.clone(),
        remedy => format!("{}: {remedy}", why.words),
    };
    stacked(seen, seen.judgement.reasons.iter().map(whole).collect(), ADVICE, columns)
}

/// Reasons in always as many rows, so that nothing below moves. Those for which there is no room are
/// counted.
fn stacked(seen: &Seen, reasons: Vec<String>, rows: usize, columns: usize) -> Vec<Row> {
    let style = seen.judgement.word.map_or(Style::new(), colour);
    let reasons = reasons.iter().map(|reason| wrapped(reason, columns));
    let mut shown: Vec<String> = Vec::new();
    let mut left_out = 0;
    for lines in reasons {
        // Of the worst one, at least the beginning is shown.
        if shown.is_empty() || shown.len() + lines.len() <= rows {
            shown.extend(lines);
        } else {
            left_out += 1;
        }
    }
    shown.resize(rows, String::new());
    if let Some(last) = shown.last_mut().filter(|_| left_out > 0) {
        *last = format!("(and {left_out} more) {last}");
    }
    shown.into_iter().map(|text| Row::default().and(style, text)).collect()
}

/// A text in lines that are no wider than this, but for single words that are.
fn wrapped(text: &str, columns: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => word.clone_into(line),
            Some(line) if width(line) + 1 + width(word) <= columns => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The line in which a mark's name is typed.
fn prompt(shown: &Shown) -> Option<Row> {
    let typed = shown.typed.as_ref()?;
    let row = Row::plain("mark: ").and(Style::new().bold(), typed.clone());
    let row = row.and(Style::new().invert(), " ");
    Some(row.and(Style::new().dimmed(), "  Enter marks it, Ctrl-C ends"))
}

/// Rows for reasons with their remedies.
const ADVICE: usize = 5;

/// Columns of the name of a trunk and an axis.
const NAME: usize = 9;

/// Columns of the numbers beside a bar.
const FIGURES: usize = 25;

/// A shorter bar shows nothing.
const BAR_MIN: usize = 11;

/// Where both trunks are on each axis, under a common scale; `None` where there is no room.
fn bars(seen: &Seen, thick: usize, columns: usize, glyphs: Glyphs) -> Option<Vec<Row>> {
    let room = columns.checked_sub(NAME + FIGURES)?;
    // An odd number: the origin is in the middle.
    let bar = (room + room % 2).checked_sub(1).filter(|bar| *bar >= BAR_MIN)?;
    let scale_mm = scale_mm(&seen.movement);
    let has_bars = seen.movement.iter().any(|it| it.along.is_ok());
    let scale = has_bars.then(|| scale(scale_mm, bar, seen.since));
    let mut rows = vec![scale.unwrap_or_default()];
    for movement in &seen.movement {
        for at in 0..AXES.len() {
            let axis_rows = axis_rows(movement, at, scale_mm, bar, glyphs);
            rows.extend(axis_rows.into_iter().take(thick));
        }
    }
    // Nothing below moves when a pose comes.
    rows.resize(1 + 2 * AXES.len() * thick, Row::default());
    Some(rows)
}

/// One axis of one trunk: the row with its name and its numbers, and one that makes the bar thick.
fn axis_rows(
    movement: &Movement,
    at: usize,
    scale_mm: f64,
    bar: usize,
    glyphs: Glyphs,
) -> [Row; 2] {
    let bold = Style::new().bold();
    let name = format!("{} {}", movement.trunk, AXES[at]);
    let name = Row::default().and(bold, format!("{name:NAME$}"));
    match &movement.along {
        Ok(along) => {
            let drawn = drawn(&along[at], scale_mm, bar, glyphs);
            let style = AnsiColor::Cyan.on_default();
            let below = Row::plain(" ".repeat(NAME)).and(style, drawn.clone());
            [name.and(style, drawn).and(bold, figures(&along[at])), below]
        }
        // Once for all three axes.
        Err(why) => {
            let why = if at == 0 { *why } else { "" };
            [name.and(AnsiColor::Yellow.on_default().bold(), why), Row::default()]
        }
    }
}

/// The smallest scale that holds everything that is drawn, or the largest.
fn scale_mm(movement: &[Movement]) -> f64 {
    let along = movement.iter().filter_map(|it| it.along.as_ref().ok()).flatten();
    let ends_mm =
        along.flat_map(|it| [it.now_mm].into_iter().chain(it.range_mm.into_iter().flatten()));
    let furthest_mm = ends_mm.fold(0.0, |most: f64, it| most.max(it.abs()));
    let [.., largest] = SCALES_MM;
    SCALES_MM.into_iter().find(|it| furthest_mm <= *it).unwrap_or(largest)
}

/// The scale above the bars: its ends, its middle, and from where movement counts.
fn scale(scale_mm: f64, bar: usize, since: &str) -> Row {
    let (low, high) = (format!("-{scale_mm}"), format!("+{scale_mm} mm"));
    // The sign of each end is above it.
    let half = bar / 2;
    let left = format!("{low:half$}0");
    let right = format!("{left:width$}{high}", width = bar - 1);
    Row::plain(" ".repeat(NAME) + &right).and(Style::new().dimmed(), format!("  {since}"))
}

/// A bar: the range since t = 0, the origin, and where the trunk is now.
fn drawn(along: &Along, scale_mm: f64, bar: usize, glyphs: Glyphs) -> String {
    let last = (bar - 1) as f64;
    let cell =
        |at_mm: f64| (0.5 * (at_mm / scale_mm + 1.0) * last).round().clamp(0.0, last) as usize;
    let mut cells = vec![glyphs.track; bar];
    if let Some([low_mm, high_mm]) = along.range_mm {
        cells[cell(low_mm)..=cell(high_mm)].fill(glyphs.range);
    }
    cells[bar / 2] = glyphs.origin;
    cells[cell(along.now_mm)] = glyphs.dot;
    cells.into_iter().collect()
}

/// Where it is now, and the length of its range.
fn figures(along: &Along) -> String {
    let now = format!("  {:>+7.1} mm", no_minus_zero(along.now_mm));
    match along.range_mm {
        Some([low_mm, high_mm]) => format!("{now}  range {:.1}", high_mm - low_mm),
        None => now,
    }
}

#[cfg(test)]
mod tests;
