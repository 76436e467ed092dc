//! The boxes of a ward in a terminal.

use std::io::Write as _;

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};
use crossterm::terminal;
use plumbline_files::text::printable;
use plumbline_gateway::Standing;
use plumbline_gateway::overview::{BoxNow, Doing, Hearing, Overview};

/// The notices that are shown.
const NOTICES_MAX: usize = 6;

/// The rows that the terminal has where it does not tell.
const ROWS: u16 = 24;

/// A table that is drawn over and over, or lines where there is no terminal.
pub struct Screen {
    is_screen: bool,
    notices: Vec<String>,
}

impl Screen {
    pub fn new(is_screen: bool) -> Self {
        Self { is_screen, notices: Vec::new() }
    }

    /// Something that happened.
    pub fn say(&mut self, words: &str) {
        if !self.is_screen {
            eprintln!("{words}");
            return;
        }
        if self.notices.len() == NOTICES_MAX {
            self.notices.remove(0);
        }
        self.notices.push(words.to_owned());
    }

    /// Draws it anew.
    pub fn show(&self, overview: &Overview) {
        if !self.is_screen {
            return;
        }
        let (columns, rows) = terminal::size().unwrap_or((80, ROWS));
        let text = page(overview, &self.notices, usize::from(columns), usize::from(rows));
        // From the top, and whatever stood below is erased.
        let mut drawn = String::from("\x1b[H");
        for line in text.lines() {
            drawn += &format!("{line}\x1b[K\r\n");
        }
        drawn += "\x1b[J";
        let mut out = std::io::stdout();
        let _ = out.write_all(drawn.as_bytes()).and_then(|()| out.flush());
    }

    /// What was said stays in the terminal.
    pub fn end(&mut self) {
        for notice in self.notices.drain(..) {
            eprintln!("{notice}");
        }
        self.is_screen = false;
    }
}

/// A page of so many characters and lines: what needs somebody first.
fn page(overview: &Overview, notices: &[String], columns: usize, rows: usize) -> String {
    let broker = match &overview.standing {
        Standing::Up(since) => format!("broker: up for {} s", since.elapsed().as_secs()),
        Standing::Down(since, why) => {
            format!("broker: AWAY for {} s: {why}", since.elapsed().as_secs())
        }
    };
    let mut lines = vec![
        format!(
            "{} of {} boxes heard, {} recording; {} frames, {} lost; {} of {} trials judged",
            overview.heard(),
            overview.boxes.len(),
            overview.recording(),
            overview.frames(),
            overview.lost(),
            overview.trials_judged,
            overview.trials_begun
        ),
        broker,
        format!(
            "messages: {} published, {} waiting, {} kept on the disk",
            overview.broker.published, overview.waiting.0, overview.waiting.1
        ),
    ];
    lines.extend(overview.amiss().into_iter().map(|it| format!("warning: {it}")));
    lines.push(String::new());
    let room = rows.saturating_sub(lines.len() + notices.len() + 4).max(1);
    let mut boxes: Vec<&BoxNow> = overview.boxes.iter().collect();
    boxes.sort_by_key(|it| (it.problem.is_none(), it.hearing != Hearing::Silent));
    let mut table = Table::new();
    table.load_style(NOTHING);
    table.set_header(["box", "name", "link", "doing", "Hz", "frames", "lost", "amiss"]);
    for column in 4..7 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    for it in boxes.iter().take(room) {
        table.add_row(row(it));
    }
    lines.extend(table.to_string().lines().map(str::to_owned));
    if boxes.len() > room {
        lines.push(format!("and {} more boxes", boxes.len() - room));
    }
    lines.push(String::new());
    lines.extend(notices.iter().cloned());
    let cut = |line: &String| line.chars().take(columns.saturating_sub(1)).collect::<String>();
    lines.iter().map(cut).collect::<Vec<_>>().join("\n")
}

fn row(it: &BoxNow) -> [String; 8] {
    let link = match it.hearing {
        Hearing::Searching => "searching",
        Hearing::Heard => "heard",
        Hearing::Silent => "SILENT",
        Hearing::Unknown => "unknown",
    };
    let doing = match it.doing {
        Doing::Watching => "",
        Doing::Recording => "recording",
        Doing::Ending => "ending",
    };
    let amiss = it.problem.as_ref().map_or_else(String::new, |(found, _)| found.clone());
    [
        it.level.clone(),
        printable(&it.name).into_owned(),
        link.to_owned(),
        doing.to_owned(),
        format!("{:.1}", it.rate_hz),
        it.counts.frames.to_string(),
        it.counts.lost.to_string(),
        printable(&amiss).into_owned(),
    ]
}
