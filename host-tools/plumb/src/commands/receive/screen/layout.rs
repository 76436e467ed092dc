//! Where everything is on a terminal of any size.
//!
//! In: what is [`Shown`], the news, and a buffer of the terminal's size. A large terminal has the
//! word and the clock in large letters, bars, and the trunks from above and over time; a smaller one
//! has fewer of them, then the word in one line, then numbers instead of bars. What is still too much
//! is left out, the least important first.
//!
//! Everything can be told without colour: words, labels and places say it, and colour beside them.

use std::time::Duration;

use plumbline_bedside::recording::{Seen, Why, Word};
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use unicode_width::UnicodeWidthStr as _;

use super::shown::{Shown, figures_in_words, numbers};
use super::{bars, big, plots};

/// What things are drawn with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Glyphs {
    pub(super) dot: char,
    pub(super) track: char,
    pub(super) range: char,
    pub(super) origin: char,
    pub(super) cut: char,
    /// Of the plots.
    pub(super) marker: Marker,
}

/// Of a terminal that shows Unicode.
pub(super) const BLOCKS: Glyphs =
    Glyphs {
        dot: '█', track: '─', range: '▒', origin: '│', cut: '…', marker: Marker::Braille
    };

/// Of any other.
pub(super) const ASCII: Glyphs =
    Glyphs { dot: '#', track: '-', range: '=', origin: '|', cut: '~', marker: Marker::Custom('*') };

/// How things are shown.
#[derive(Debug, Clone, Copy)]
pub(super) struct Looks {
    pub(super) glyphs: Glyphs,
    pub(super) is_coloured: bool,
}

/// How much there is room for, the richest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    /// Large letters, reasons with what can be done, bars, and plots of so many rows.
    Rich { plot: usize },
    /// Large letters, bars, and where the trunks are from above beside them.
    Large,
    /// One line for word and clock, and bars.
    Bars,
    /// One line for word and clock, and numbers.
    Numbers,
}

const FORMS: [Form; 6] = [
    Form::Rich { plot: 16 },
    Form::Rich { plot: 10 },
    Form::Rich { plot: 7 },
    Form::Large,
    Form::Bars,
    Form::Numbers,
];

/// The news have at least so many rows.
fn news_min(form: Form) -> usize {
    match form {
        Form::Rich { .. } => 4,
        Form::Large => 2,
        Form::Bars => 1,
        Form::Numbers => 0,
    }
}

/// Columns of the plot beside the bars, with what is between them.
const BESIDE: usize = 28;

/// What is drawn over the rows of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Plot {
    /// Nothing.
    None,
    /// The trunks from above, in the last columns.
    Beside,
    /// The trunks over time.
    OverTime,
}

/// Rows that stay or go together; the higher `keep`, the longer they stay.
struct Block {
    keep: u8,
    rows: Vec<Line<'static>>,
    plot: Plot,
}

const HEAD: u8 = 9;
const REASONS: u8 = 8;
const MOVEMENT: u8 = 7;
const COUNTS: u8 = 6;
const FIGURES: u8 = 5;
const TITLE: u8 = 3;
const TIME: u8 = 2;
const PROMPT: u8 = 1;
const BLANK: u8 = 0;

/// Draws everything into a terminal's buffer.
pub(super) fn draw(shown: &Shown, news: &[String], buffer: &mut Buffer, looks: Looks) {
    let area = buffer.area;
    let [columns, height] = [area.width, area.height].map(usize::from);
    let Looks { glyphs, is_coloured } = looks;
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
    // The prompt is the last row, below the news.
    let prompt = blocks.iter().position(|block| block.keep == PROMPT).map(|at| blocks.remove(at));
    blocks.push(Block { keep: BLANK, rows: news, plot: Plot::None });
    blocks.extend(prompt);
    let mut top = 0;
    for Block { rows, plot, .. } in &blocks {
        let rows_area = Rect { y: area.y + top, height: rows.len() as u16, ..area };
        for (row, y) in rows.iter().zip(rows_area.y..) {
            write(row, Rect { y, height: 1, ..area }, buffer, glyphs);
        }
        match plot {
            Plot::None => {}
            Plot::Beside => {
                let left = (columns - BESIDE) as u16 + 2;
                let beside = Rect { x: area.x + left, width: area.width - left, ..rows_area };
                plots::from_above(&shown.seen, beside, buffer, glyphs);
            }
            Plot::OverTime => plots::over_time(&shown.seen, rows_area, buffer, glyphs),
        }
        top += rows.len() as u16;
    }
    if glyphs.marker != Marker::Braille {
        in_ascii(buffer);
    }
    if !is_coloured {
        for cell in &mut buffer.content {
            (cell.fg, cell.bg) = (Color::Reset, Color::Reset);
        }
    }
}

/// The lines of a plot's axes, for a terminal without Unicode.
fn in_ascii(buffer: &mut Buffer) {
    for cell in &mut buffer.content {
        match cell.symbol() {
            "│" => cell.set_char('|'),
            "─" => cell.set_char('-'),
            "└" => cell.set_char('+'),
            _ => cell,
        };
    }
}

/// A row, which ends with a sign of it where it is cut.
fn write(row: &Line<'_>, area: Rect, buffer: &mut Buffer, glyphs: Glyphs) {
    if area.width == 0 {
        return;
    }
    buffer.set_line(area.x, area.y, row, area.width);
    if row.width() > usize::from(area.width) {
        let last = &mut buffer[(area.right() - 1, area.y)];
        last.reset();
        last.set_char(glyphs.cut);
    }
}

/// The latest news that fit; the very latest are the ones to be noticed.
fn news_rows(news: &[String], height: usize, columns: usize) -> Vec<Line<'static>> {
    let (before, latest) = news.split_at(news.len().saturating_sub(1));
    let lines = |news: &[String], style: Style| {
        let lines: Vec<String> = news.iter().flat_map(|line| wrapped(line, columns)).collect();
        lines.into_iter().map(move |line| Line::styled(line, style))
    };
    // Each takes a row at least.
    let before = &before[before.len().saturating_sub(height)..];
    let rows: Vec<Line<'static>> =
        lines(before, Style::new()).chain(lines(latest, Style::new().bold())).collect();
    let mut rows = rows[rows.len().saturating_sub(height)..].to_vec();
    rows.resize(height, Line::default());
    rows
}

/// All but the news; `None` where the form is too wide.
fn blocks(shown: &Shown, form: Form, columns: usize, glyphs: Glyphs) -> Option<Vec<Block>> {
    let Shown { title, seen, .. } = shown;
    let block = |keep, rows| Block { keep, rows, plot: Plot::None };
    let blank = || block(BLANK, vec![Line::default()]);
    let title = block(TITLE, vec![Line::from(title.join(", ")).bold()]);
    let time = block(TIME, vec![Line::from(seen.time.clone())]);
    let counts = block(COUNTS, vec![Line::from(fitting(&seen.counts, columns))]);
    let figures = seen.figures.iter().map(|(trunk, so_far)| figures_in_words(trunk, so_far));
    let figures = block(FIGURES, figures.map(Line::from).collect());
    let beside = || -> Option<Block> {
        let rows = bars::rows(seen, columns.checked_sub(BESIDE)?, glyphs)?;
        Some(Block { keep: MOVEMENT, rows, plot: Plot::Beside })
    };
    let mut blocks = match form {
        Form::Rich { plot } => vec![
            title,
            blank(),
            block(HEAD, large(seen, columns, glyphs)?),
            time,
            blank(),
            block(REASONS, advice(seen, columns)),
            beside()?,
            figures,
            counts,
            Block { keep: BLANK, rows: vec![Line::default(); plot], plot: Plot::OverTime },
        ],
        Form::Large => vec![
            title,
            block(HEAD, large(seen, columns, glyphs)?),
            time,
            block(REASONS, reasons(seen, 3, columns)),
            beside()?,
            figures,
            counts,
        ],
        Form::Bars => vec![
            title,
            block(HEAD, vec![small(seen)]),
            time,
            block(REASONS, reasons(seen, 2, columns)),
            block(MOVEMENT, bars::rows(seen, columns, glyphs)?),
            counts,
        ],
        Form::Numbers => vec![
            title,
            block(HEAD, vec![small(seen)]),
            time,
            block(REASONS, reasons(seen, 1, columns)),
            block(MOVEMENT, seen.movement.iter().map(|it| Line::from(numbers(it))).collect()),
            figures,
            counts,
        ],
    };
    blocks.extend(prompt(shown).map(|row| block(PROMPT, vec![row])));
    Some(blocks)
}

/// As many of the parts as fit, from the first on.
fn fitting(parts: &[String], columns: usize) -> String {
    let mut text = String::new();
    for part in parts {
        let longer = if text.is_empty() { part.clone() } else { format!("{text}, {part}") };
        if longer.width() > columns && !text.is_empty() {
            break;
        }
        text = longer;
    }
    text
}

fn colour(word: Word) -> Style {
    match word {
        Word::Wait => Style::new().bold(),
        Word::Good => Style::new().green().bold(),
        Word::Look => Style::new().yellow().bold(),
        Word::Stop => Style::new().red().bold(),
    }
}

fn minutes(time: Duration) -> String {
    format!("{}:{:02}", time.as_secs() / 60, time.as_secs() % 60)
}

/// Minutes and seconds that are left, rounded up: 0 is the end.
fn to_go(seen: &Seen) -> Option<String> {
    seen.remaining.map(|it| minutes(it + Duration::from_millis(999)))
}

/// Word and clock in large letters, with what remains where there is room.
fn large(seen: &Seen, columns: usize, glyphs: Glyphs) -> Option<Vec<Line<'static>>> {
    const BETWEEN: usize = 4;
    let word = seen.judgement.word;
    let text = word.map_or("", Word::text);
    let elapsed = minutes(seen.elapsed);
    let both = to_go(seen).map(|to_go| format!("{elapsed} -{to_go}"));
    let room = columns.checked_sub(big::columns(text) + BETWEEN)?;
    let clock = both.into_iter().chain([elapsed]).find(|it| big::columns(it) <= room)?;
    let (word_lines, clock_lines) = (big::lines(text, glyphs.dot), big::lines(&clock, glyphs.dot));
    let row = |(word_line, clock_line): (String, String)| {
        Line::from(vec![
            Span::styled(word_line, word.map_or(Style::new(), colour)),
            " ".repeat(BETWEEN).into(),
            clock_line.bold(),
        ])
    };
    Some(word_lines.into_iter().zip(clock_lines).map(row).collect())
}

/// Word and clock in one row.
fn small(seen: &Seen) -> Line<'static> {
    let mut spans = Vec::new();
    if let Some(word) = seen.judgement.word {
        spans.push(Span::styled(format!(" {} ", word.text()), colour(word).reversed()));
        spans.push("  ".into());
    }
    let to_go = to_go(seen).map(|it| format!("   {it} to go")).unwrap_or_default();
    spans.push((minutes(seen.elapsed) + &to_go).bold());
    Line::from(spans)
}

/// Why.
fn reasons(seen: &Seen, rows: usize, columns: usize) -> Vec<Line<'static>> {
    let words = seen.judgement.reasons.iter().map(|why| why.words.clone()).collect();
    stacked(seen, words, rows, columns)
}

/// Rows for reasons with their remedies.
const ADVICE: usize = 5;

/// Why, and what can be done.
fn advice(seen: &Seen, columns: usize) -> Vec<Line<'static>> {
    let whole = |why: &Why| match &*why.remedy {
        "" => why.words.clone(),
        remedy => format!("{}: {remedy}", why.words),
    };
    stacked(seen, seen.judgement.reasons.iter().map(whole).collect(), ADVICE, columns)
}

/// Reasons in always as many rows, so that nothing below moves. Those for which there is no room are
/// counted.
fn stacked(seen: &Seen, reasons: Vec<String>, rows: usize, columns: usize) -> Vec<Line<'static>> {
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
    shown.into_iter().map(|text| Line::styled(text, style)).collect()
}

/// A text in lines that are no wider than this, but for single words that are.
fn wrapped(text: &str, columns: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if line.is_empty() => word.clone_into(line),
            Some(line) if line.width() + 1 + word.width() <= columns => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The line in which a mark's name is typed.
fn prompt(shown: &Shown) -> Option<Line<'static>> {
    let typed = shown.typed.as_ref()?;
    Some(Line::from(vec![
        "mark: ".into(),
        typed.clone().bold(),
        " ".reversed(),
        "  Enter marks it, Ctrl-C ends".dim(),
    ]))
}

#[cfg(test)]
mod tests;
