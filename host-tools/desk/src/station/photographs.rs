//! Photographs of the board: a set of them in a folder of its own, some taken by themselves.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use plumbline::target::Role;
use plumbline_bedside::aim::{Kept, Looked, Stills, Wanted};
use plumbline_calibration::coverage::{COLUMNS, ROWS};
use plumbline_files::targets;

use super::Worker;
use super::orders::Refusal;
use crate::wire::{
    Photograph, PhotographRemove, Photographs, PhotographsAuto, PhotographsBegin, Problem,
};

/// The most photographs that are taken by themselves.
const AUTO_MAX: u32 = 60;

/// The time from one to the next, seconds.
const EVERY_S: std::ops::RangeInclusive<f64> = 1.0..=60.0;

/// The most photographs of a set.
const PHOTOGRAPHS_MAX: usize = 100;

/// Photographs of the board.
pub struct PhotoSet {
    stills: Stills,
    /// Inner corners, and from corner to corner.
    pub board: [u8; 2],
    /// From corner to corner.
    pub pitch_mm: f64,
    /// Where they are kept.
    pub folder: PathBuf,
    list: Vec<Photograph>,
    next: String,
    auto: Option<Auto>,
    /// One is wanted now.
    wanted: bool,
}

/// Photographs that are taken by themselves.
struct Auto {
    to_go: u32,
    every: Duration,
    due: Instant,
}

impl PhotoSet {
    /// None has been taken.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Those in which the board was found.
    pub fn found(&self) -> usize {
        self.list.iter().filter(|it| it.is_found).count()
    }

    /// Some are still to be taken by themselves.
    pub fn is_automatic(&self) -> bool {
        self.auto.is_some()
    }

    /// Whether one is to be taken now.
    pub fn is_due(&self, now: Instant) -> bool {
        self.list.len() < PHOTOGRAPHS_MAX
            && (self.wanted || self.auto.as_ref().is_some_and(|auto| now >= auto.due))
    }

    /// One is wanted now.
    pub fn want(&mut self) {
        self.wanted = true;
    }

    /// Several are taken by themselves.
    pub fn take_by_itself(&mut self, asked: &PhotographsAuto, now: Instant) -> Result<(), Refusal> {
        if !(1..=AUTO_MAX).contains(&asked.count) {
            let found = format!("{} photographs", asked.count);
            return Err(Refusal::bad(Problem::new("count", found, "give 1 to 60")));
        }
        if !EVERY_S.contains(&asked.every_s) {
            let found = format!("{} s", asked.every_s);
            return Err(Refusal::bad(Problem::new("every_s", found, "give 1 to 60 seconds")));
        }
        let every = Duration::from_secs_f64(asked.every_s);
        self.auto = Some(Auto { to_go: asked.count, every, due: now + every });
        Ok(())
    }

    /// None is taken by itself any more.
    pub fn pause(&mut self) {
        self.auto = None;
        self.wanted = false;
    }

    /// Keeps one.
    pub fn keep(&mut self, file: &[u8]) -> Result<(), plumbline_files::BadInput> {
        self.wanted = false;
        let kept = self.stills.keep(file)?;
        if let Some(auto) = &mut self.auto {
            auto.to_go -= 1;
            auto.due = Instant::now() + auto.every;
            if auto.to_go == 0 {
                self.auto = None;
            }
        }
        let Kept { number, path, board, .. } = kept;
        let (is_found, words) = match &board {
            Some(Looked::Found { rejection: None, .. }) => (true, "the board is found".to_owned()),
            Some(Looked::Found { rejection: Some(why), .. }) => (false, why.to_string()),
            Some(Looked::TooSmall) | None => (false, "too small to look for the board".to_owned()),
        };
        self.next = next_words(board.as_ref(), &words);
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.list.push(Photograph { number, file, is_found, words, error_px: None });
        Ok(())
    }

    /// The files of those in which the board was found, in the order of their numbers.
    pub fn files(&self) -> Vec<PathBuf> {
        let found = self.list.iter().filter(|it| it.is_found);
        found.map(|it| self.stills.path(it.number)).collect()
    }

    /// The errors that a calibration has left in them, by the names of their files.
    pub fn set_errors(&mut self, error_px: impl Fn(&str) -> Option<f64>) {
        for photograph in &mut self.list {
            photograph.error_px = error_px(&photograph.file);
        }
    }

    /// As a page has it; `arriving` is the share of the one under way that has come.
    pub fn shown(&self, ms: impl Fn(Instant) -> f64, arriving: Option<f64>) -> Photographs {
        let coverage = self.stills.coverage();
        let covered = coverage.as_ref().map(|it| {
            let row = |row: &[usize; COLUMNS]| row.iter().map(|it| *it as u32).collect();
            it.photographs().iter().map(row).collect()
        });
        Photographs {
            board: self.board,
            pitch_mm: self.pitch_mm,
            folder: self.folder.display().to_string(),
            list: self.list.clone(),
            cells: [COLUMNS, ROWS],
            covered: covered.unwrap_or_default(),
            share: coverage.map_or(0.0, |it| it.share()),
            next: self.next.clone(),
            next_at_ms: self.auto.as_ref().map(|auto| ms(auto.due).round()),
            to_go: self.auto.as_ref().map_or(0, |auto| auto.to_go),
            arriving,
        }
    }

    /// What to do next.
    pub fn next(&self) -> &str {
        &self.next
    }
}

/// Where to hold the board next.
fn next_words(looked: Option<&Looked>, words: &str) -> String {
    let Some(Looked::Found { rejection, next, .. }) = looked else { return words.to_owned() };
    let why = rejection.as_ref().map(|_| format!("The board was not found: {words}. "));
    let why = why.unwrap_or_default();
    match next {
        Some(part) => {
            format!("{why}Hold the board {part} of the picture, tilted by 20 to 40 degrees.")
        }
        None => format!("{why}It was everywhere: go on with other tilts and distances."),
    }
}

impl Worker {
    /// A new set, in a folder of its own.
    pub(super) fn begin_photographs(&mut self, asked: &PhotographsBegin) -> Result<(), Refusal> {
        let board = self
            .config
            .as_ref()
            .and_then(|config| config.targets.iter().find(|it| it.geometry.role() == Role::Scene));
        let known = board.map(|it| targets::description(&it.name, &it.geometry));
        let known = known.as_ref();
        let size = asked.board.or(known.map(|it| [it.columns, it.rows]));
        let pitch_mm = asked.pitch_mm.or(known.and_then(|it| it.pitch_mm));
        let (Some(size), Some(pitch_mm)) = (size, pitch_mm) else {
            return Err(Refusal::bad(Problem::new(
                "the board",
                "the box looks for no scene board, and none is described",
                "give its inner corners and its pitch",
            )));
        };
        // There has to be such a board.
        plumbline_bedside::calibration::board(size, pitch_mm)?;
        let serial_number = self.hello.as_ref().map(|it| it.serial_number.to_string());
        let is_letter = |it: &char| it.is_ascii_alphanumeric() || *it == '-';
        let name: String = serial_number.unwrap_or_default().chars().filter(is_letter).collect();
        let name = if name.is_empty() { self.shared.id() } else { name };
        let now = jiff::Zoned::now().strftime("%Y-%m-%d-%H%M%S").to_string();
        let parent = self.around.folder.join("photographs").join(name);
        let folder = (1..)
            .map(|at: u32| parent.join(if at == 1 { now.clone() } else { format!("{now}-{at}") }))
            .find(|it| !it.exists())
            .unwrap_or(parent);
        let stills = Stills::new(Wanted {
            directory: folder.clone(),
            force: false,
            count: None,
            every: Duration::from_secs(1),
            board: Some(size),
        })?;
        let next =
            "Hold the board in the middle of the picture, tilted by 20 to 40 degrees, and take \
                    a photograph."
                .to_owned();
        let set = PhotoSet {
            stills,
            board: size,
            pitch_mm,
            folder,
            list: Vec::new(),
            next,
            auto: None,
            wanted: false,
        };
        self.photographs = Some(set);
        self.calibrated = None;
        self.shared.update(|state| state.calibration = None);
        self.show_photographs(None);
        Ok(())
    }

    pub(super) fn remove_photograph(&mut self, asked: &PhotographRemove) -> Result<(), Refusal> {
        let Some(set) = &mut self.photographs else { return Ok(()) };
        let Some(at) = set.list.iter().position(|it| it.number == asked.number) else {
            return Err(Refusal {
                status: 404,
                problem: Problem::new(
                    "the photograph",
                    format!("there is none with the number {}", asked.number),
                    "choose one that is listed",
                ),
            });
        };
        set.stills.remove(asked.number)?;
        set.list.remove(at);
        self.show_photographs(None);
        Ok(())
    }

    /// Shows them.
    pub(super) fn show_photographs(&self, arriving: Option<f64>) {
        let shown =
            self.photographs.as_ref().map(|set| set.shown(|at| self.shared.ms(at), arriving));
        self.shared.update(|state| state.photographs = shown);
    }
}
