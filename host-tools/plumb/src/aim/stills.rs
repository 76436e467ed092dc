//! Whole frames as files, for `plumb calibrate` and `plumb scene`.
//!
//! A file holds the frame as the camera gave it: the box sends it as PNG, and it is written as
//! it came.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nalgebra::Vector2;
use plumbline::image::GreyImage;
use plumbline::target::{Origin, Role, TargetGeometry};

use super::Arguments;
use crate::calibrate::coverage::Coverage;
use crate::calibrate::observe::Finder;
use crate::error::BadInput;
use crate::files;

/// Parts of the frame in which the board was seen, from which on no more is asked for.
const COVERED_MIN: f64 = 0.8;

/// Stills that are to be taken, and those that were.
pub struct Stills {
    directory: PathBuf,
    force: bool,
    /// So many are taken by themselves.
    count: Option<u32>,
    every: Duration,
    board: Option<Board>,
    taken: u32,
    /// Of the next file.
    number: u32,
    due: Instant,
}

/// Looks for the board in stills.
struct Board {
    geometry: TargetGeometry,
    finder: Finder,
    /// The corners of each still in which it was found.
    seen_px: Vec<Vec<Vector2<f64>>>,
}

impl Stills {
    /// As the command line has it.
    ///
    /// # Errors
    /// When a file that would be written exists, or there can be no such directory.
    pub fn new(arguments: &Arguments) -> Result<Self, BadInput> {
        let directory = arguments.stills.clone().unwrap_or_else(|| PathBuf::from("."));
        let force = arguments.force;
        let exists = |number: u32| path(&directory, number).exists();
        let number = match arguments.count {
            Some(count) => {
                if let Some(taken) = (1..=count).find(|&number| !force && exists(number)) {
                    return Err(exists_already(&path(&directory, taken)));
                }
                1
            }
            None => (1..).find(|&number| !exists(number)).expect("fewer files than numbers"),
        };
        let board = arguments.board.map(|[columns, rows]| -> Result<Board, BadInput> {
            // To find it, its squares may be of any size.
            let geometry =
                TargetGeometry::checker(columns, rows, 1.0, Origin::Center, Role::Scene, [0.0; 3])
                    .map_err(|error| {
                        BadInput::whole("--board", format!("{columns} x {rows} corners"), error)
                    })?;
            Ok(Board { geometry, finder: Finder::new(), seen_px: Vec::new() })
        });
        let board = board.transpose()?;
        if directory.exists() && !directory.is_dir() {
            let found = format!("{} is not a directory", directory.display());
            return Err(BadInput::whole("--stills", found, "give another name"));
        }
        std::fs::create_dir_all(&directory)
            .map_err(|error| BadInput::io(directory.display(), &error))?;
        let count = arguments.count;
        let every = arguments.every;
        let due = Instant::now();
        Ok(Self { directory, force, count, every, board, taken: 0, number, due })
    }

    /// All that were to be taken by themselves are there.
    pub fn is_done(&self) -> bool {
        self.count.is_some_and(|count| self.taken >= count)
    }

    /// One is to be taken now.
    pub fn is_due(&self, now: Instant) -> bool {
        self.count.is_some() && !self.is_done() && now >= self.due
    }

    /// Which one comes next, for people.
    pub fn next_name(&self) -> String {
        match self.count {
            Some(count) => format!("still {} of {count}", self.taken + 1),
            None => format!("still {}", self.number),
        }
    }

    /// Where the next one goes.
    pub fn next_path(&self) -> PathBuf {
        path(&self.directory, self.number)
    }

    /// How long until the next one is taken by itself.
    pub fn wait(&self, now: Instant) -> Option<Duration> {
        (self.count.is_some() && !self.is_done()).then(|| self.due.saturating_duration_since(now))
    }

    /// Keeps one; what there is to say of it.
    ///
    /// # Errors
    /// When it cannot be decoded or written.
    pub fn keep(&mut self, file: &[u8]) -> Result<String, BadInput> {
        let path = self.next_path();
        let place = path.display().to_string();
        let picture = image::load_from_memory(file).map_err(|error| {
            BadInput::whole(
                &place,
                format!("the box's picture cannot be decoded ({error})"),
                "try again",
            )
        })?;
        if !self.force && path.exists() {
            return Err(exists_already(&path));
        }
        files::replace(&path, file)?;
        self.taken += 1;
        self.number += 1;
        self.due = Instant::now() + self.every;
        let picture = picture.into_luma8();
        let mut text = format!("{place}: {} x {} px", picture.width(), picture.height());
        if let Some(board) = &mut self.board {
            text += &board.look(&picture);
        }
        Ok(text)
    }
}

fn path(directory: &Path, number: u32) -> PathBuf {
    directory.join(format!("still-{number:02}.png"))
}

fn exists_already(path: &Path) -> BadInput {
    let remedy = "give another directory, or --force to replace it";
    BadInput::whole(path.display(), "exists already", remedy)
}

impl Board {
    fn look(&mut self, picture: &image::GrayImage) -> String {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let Ok(image) = GreyImage::new(picture.as_raw(), width, height, width) else {
            return "; too small to look for the board".to_owned();
        };
        let found = match self.finder.find(&image, &self.geometry) {
            Ok(found) => found,
            Err(why) => return format!("; the board is NOT found: {why}"),
        };
        self.seen_px.push(found.corners_px().map(|(_, px)| px).collect());
        let seen_px = self.seen_px.iter().map(Vec::as_slice);
        let coverage = Coverage::new(seen_px, [width as f64, height as f64]);
        let mut text =
            format!("; the board is found, {:.0} % of the frame covered", 100.0 * coverage.share());
        let missed = coverage.missed_sides();
        // Writing to a String does not fail.
        if !missed.is_empty() {
            let _ = write!(text, "; not yet near these sides: {}", missed.join(", "));
        } else if coverage.share() < COVERED_MIN {
            text += "; show it where it was not yet, tilted by 20 to 40 degrees";
        }
        text
    }
}
