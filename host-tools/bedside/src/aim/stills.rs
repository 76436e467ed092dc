//! Whole frames as files, to calibrate a camera with and to measure a scene.
//!
//! A file holds the frame as the camera gave it: the box sends it as PNG, and it is written as
//! it came.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nalgebra::Vector2;
use plumbline::image::GreyImage;
use plumbline::report::GridRejection;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_calibration::coverage::Coverage;
use plumbline_calibration::observe::Finder;
use plumbline_files::BadInput;

/// The stills to be taken, and those taken.
pub struct Stills {
    directory: PathBuf,
    force: bool,
    /// The number of stills that are taken automatically.
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
    /// The number of each still in which it was found, and its corners.
    seen_px: Vec<(u32, Vec<Vector2<f64>>)>,
    /// Of the stills.
    size_px: [u32; 2],
}

/// Which stills are wanted.
#[derive(Debug, Clone)]
pub struct Wanted {
    /// Where they go.
    pub directory: PathBuf,
    /// Replace those that exist.
    pub force: bool,
    /// This many automatically; otherwise when they are asked for.
    pub count: Option<u32>,
    /// The time from one automatic still to the next.
    pub every: Duration,
    /// Look for a board with these columns and rows of inner corners in each.
    pub board: Option<[u8; 2]>,
}

/// A still that was kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// Its number.
    pub number: u32,
    /// Its file.
    pub path: PathBuf,
    /// Width and height.
    pub size_px: [u32; 2],
    /// What became of the board, where it was looked for.
    pub board: Option<Looked>,
}

/// A look for the board in a still.
#[derive(Debug, Clone, PartialEq)]
pub enum Looked {
    /// The still is too small for it.
    TooSmall,
    /// The board was looked for.
    Found {
        /// Why it was not found.
        rejection: Option<GridRejection>,
        /// The share of the frame that the boards of all stills have covered, 0 to 1.
        covered: f64,
        /// The part of the picture where to hold it next; `None` when it was everywhere.
        next: Option<&'static str>,
    },
}

impl fmt::Display for Kept {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size_px;
        write!(f, "{}: {width} x {height} px", self.path.display())?;
        self.board.as_ref().map_or(Ok(()), |board| write!(f, "; {board}"))
    }
}

impl fmt::Display for Looked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::Found { rejection, covered, next } = self else {
            return write!(f, "too small to look for the board");
        };
        match rejection {
            Some(why) => write!(f, "the board is NOT found: {why}; ")?,
            None => {
                let percent = 100.0 * covered;
                write!(f, "the board is found, {percent:.0} % of the frame covered; ")?;
            }
        }
        match next {
            Some(part) => {
                write!(f, "next hold it {part} of the picture, tilted by 20 to 40 degrees")
            }
            None => write!(f, "it was everywhere: go on with other tilts and distances"),
        }
    }
}

impl Stills {
    /// Makes the directory, where there is none.
    ///
    /// # Errors
    /// When a file that would be written exists, or there can be no such directory.
    pub fn new(wanted: Wanted) -> Result<Self, BadInput> {
        let Wanted { directory, force, count, every, board } = wanted;
        let exists = |number: u32| path(&directory, number).exists();
        let number = match count {
            Some(count) => {
                if let Some(taken) = (1..=count).find(|&number| !force && exists(number)) {
                    return Err(exists_already(&path(&directory, taken)));
                }
                1
            }
            None => (1..).find(|&number| !exists(number)).expect("fewer files than numbers"),
        };
        let board = board.map(|[columns, rows]| -> Result<Board, BadInput> {
            // To find it, its squares may be of any size.
            let geometry =
                TargetGeometry::checker(columns, rows, 1.0, Origin::Center, Role::Scene, [0.0; 3])
                    .map_err(|error| {
                        BadInput::whole("--board", format!("{columns} x {rows} corners"), error)
                    })?;
            Ok(Board { geometry, finder: Finder::new(), seen_px: Vec::new(), size_px: [1; 2] })
        });
        let board = board.transpose()?;
        if directory.exists() && !directory.is_dir() {
            let found = format!("{} is not a directory", directory.display());
            return Err(BadInput::whole("--stills", found, "give another name"));
        }
        plumbline_files::make_directory(&directory)?;
        let due = Instant::now();
        Ok(Self { directory, force, count, every, board, taken: 0, number, due })
    }

    /// All stills that were asked for have been taken.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.count.is_some_and(|count| self.taken >= count)
    }

    /// A still is due.
    #[must_use]
    pub fn is_due(&self, now: Instant) -> bool {
        self.count.is_some() && !self.is_done() && now >= self.due
    }

    /// The name of the next still, for people.
    #[must_use]
    pub fn next_name(&self) -> String {
        match self.count {
            Some(count) => format!("still {} of {count}", self.taken + 1),
            None => format!("still {}", self.number),
        }
    }

    /// The path of the next still.
    #[must_use]
    pub fn next_path(&self) -> PathBuf {
        path(&self.directory, self.number)
    }

    /// How long until the next still is taken automatically.
    #[must_use]
    pub fn wait(&self, now: Instant) -> Option<Duration> {
        (self.count.is_some() && !self.is_done()).then(|| self.due.saturating_duration_since(now))
    }

    /// Writes a still of these bytes, a whole picture of the box.
    ///
    /// # Errors
    /// When it cannot be decoded or written.
    pub fn keep(&mut self, file: &[u8]) -> Result<Kept, BadInput> {
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
        plumbline_files::replace(&path, file)?;
        let number = self.number;
        self.taken += 1;
        self.number += 1;
        self.due = Instant::now() + self.every;
        let picture = picture.into_luma8();
        let board = self.board.as_mut().map(|board| board.look(number, &picture));
        Ok(Kept { number, path, size_px: picture.dimensions().into(), board })
    }

    /// Removes a still that was kept.
    ///
    /// # Errors
    /// When its file cannot be removed.
    pub fn remove(&mut self, number: u32) -> Result<(), BadInput> {
        let path = path(&self.directory, number);
        std::fs::remove_file(&path).map_err(|error| BadInput::io(path.display(), &error))?;
        if let Some(board) = &mut self.board {
            board.seen_px.retain(|(of, _)| *of != number);
        }
        Ok(())
    }

    /// Where the board has been until now, where it is looked for.
    #[must_use]
    pub fn coverage(&self) -> Option<Coverage> {
        self.board.as_ref().map(Board::coverage)
    }

    /// The path of the still with this number.
    #[must_use]
    pub fn path(&self, number: u32) -> PathBuf {
        path(&self.directory, number)
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
    /// Whether it is found, and where to hold it next.
    fn look(&mut self, number: u32, picture: &image::GrayImage) -> Looked {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let Ok(image) = GreyImage::new(picture.as_raw(), width, height, width) else {
            return Looked::TooSmall;
        };
        let found = self.finder.find(&image, &self.geometry);
        let (rejection, found) = (found.as_ref().err().copied(), found.ok());
        self.seen_px.extend(found.map(|it| (number, it.corners_px().map(|(_, px)| px).collect())));
        self.size_px = picture.dimensions().into();
        let coverage = self.coverage();
        Looked::Found { rejection, covered: coverage.share(), next: coverage.next() }
    }

    fn coverage(&self) -> Coverage {
        let seen_px = self.seen_px.iter().map(|(_, seen_px)| seen_px.as_slice());
        Coverage::new(seen_px, self.size_px.map(f64::from))
    }
}

#[cfg(test)]
mod tests {
    use plumbline::lens::{Distortion, Lens};
    use plumbline::pose::Pose;

    use super::*;
    use plumbline_render::simulate::render::{self, Ink, Picture, PlacedBoard};
    use plumbline_render::simulate::sensor::Sensor;

    const WIDTH_PX: u16 = 640;
    const HEIGHT_PX: u16 = 480;

    fn board() -> Board {
        let geometry = TargetGeometry::checker(9, 6, 12.0, Origin::Center, Role::Scene, [0.0; 3]);
        Board {
            geometry: geometry.unwrap(),
            finder: Finder::new(),
            seen_px: Vec::new(),
            size_px: [1; 2],
        }
    }

    /// The board with its middle at a place of the frame, its squares 15 px wide.
    fn still(board: &Board, at_px: [f64; 2]) -> image::GrayImage {
        let [width, height] = [WIDTH_PX, HEIGHT_PX].map(u32::from);
        let lens = Lens {
            width_px: WIDTH_PX,
            height_px: HEIGHT_PX,
            fx_px: 800.0,
            fy_px: 800.0,
            cx_px: 0.0,
            cy_px: 0.0,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        };
        let [x_mm, y_mm] = at_px.map(|px| px * 640.0 / 800.0);
        let print = render::Board::new(&board.geometry, 12.0, Ink { black: 25.0, white: 210.0 });
        let cam_from_target = Pose::from_theta([0.0, 0.0, 0.0, x_mm, y_mm, 640.0]);
        let placed = [PlacedBoard { board: &print, cam_from_target }];
        let mut picture = Picture::uniform(width as usize, height as usize, 110.0);
        render::render_targets(&lens, 0.6, &placed, &|_, _| 1.0, &mut picture);
        let mut samples = vec![0; (width * height) as usize];
        Sensor { noise_levels: 0.0, bits: 8 }.expose(&picture, 1, 0, &mut samples);
        image::GrayImage::from_raw(width, height, samples).unwrap()
    }

    #[test]
    fn where_to_hold_the_board_follows_from_where_it_was() {
        let mut board = board();
        let places = [
            ("upper right", [110.0, 80.0]),
            ("lower left", [530.0, 80.0]),
            ("lower right", [110.0, 400.0]),
        ];
        for (next, at_px) in places {
            let still = still(&board, at_px);
            let text = board.look(1, &still).to_string();
            let wanted = format!("; next hold it in the {next} corner of the picture, tilted");
            assert!(text.starts_with("the board is found, ") && text.contains(&wanted), "{text}");
        }
        let empty = image::GrayImage::new(u32::from(WIDTH_PX), u32::from(HEIGHT_PX));
        let text = board.look(2, &empty).to_string();
        assert!(text.starts_with("the board is NOT found: "), "{text}");
        assert!(text.contains("; next hold it in the lower right corner"), "{text}");
        let last = still(&board, [530.0, 400.0]);
        let text = board.look(3, &last).to_string();
        assert!(!text.contains("corner of the picture"), "{text}");
        assert!(text.contains("; next hold it "), "more than its corners counts: {text}");
    }
}
