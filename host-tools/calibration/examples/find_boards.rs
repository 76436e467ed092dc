//! Searches photographs for checkerboards, for `cargo xtask bench --boards-only`.
//!
//! `find_boards DIRECTORY` reads `DIRECTORY/list.txt`, whose lines are `file COLUMNS ROWS kind`,
//! followed by the true x and y of each inner corner in row order. It prints, for each photograph,
//! its name, whether the board was found (`right`, `wrong` where corners are not at the true ones,
//! or the reason why there is none), the number of false boards (boards of other shapes, or any
//! where there is none), the root mean square distance of the corners from the true ones in pixels,
//! and the search's milliseconds, separated by tabs.

use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use plumbline::image::GreyImage;
use plumbline::target::GridShape;
use plumbline_calibration::{Found, Search};

/// A corner is at a true one within this share of the distance to its neighbour.
const RIGHT: f64 = 0.3;

fn main() -> Result<()> {
    let directory = std::env::args().nth(1).context("find_boards DIRECTORY")?;
    let directory = Path::new(&directory);
    let list = fs::read_to_string(directory.join("list.txt")).context("list.txt")?;
    let mut search = Search::new();
    for line in list.lines() {
        let mut words = line.split_whitespace();
        let mut word = || words.next().with_context(|| format!("list.txt: {line:?} is too short"));
        let name = word()?;
        let [columns, rows] = [word()?.parse::<u8>()?, word()?.parse::<u8>()?];
        let kind = word()?;
        let numbers = words.map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let truth_px = numbers.as_chunks::<2>().0;
        let (pixels, width, height) = read_pgm(&directory.join(name))?;
        let image = GreyImage::new(&pixels, width, height, width).context("the picture's size")?;
        let wanted = GridShape { columns, rows };
        let start = Instant::now();
        let found = search.find(&image, &[wanted]).remove(0);
        let time_ms = start.elapsed().as_secs_f64() * 1e3;
        let has_board = !truth_px.is_empty();
        ensure!(!has_board || truth_px.len() == usize::from(columns) * usize::from(rows), "{line}");
        let (verdict, error_px) = match &found {
            Ok(found) if has_board => match error_px(found, truth_px) {
                Some(error_px) => ("right".to_owned(), error_px),
                None => ("wrong".to_owned(), f64::NAN),
            },
            Ok(_) => ("wrong".to_owned(), f64::NAN),
            Err(why) => (why.to_string(), f64::NAN),
        };
        let mut false_boards = usize::from(verdict == "wrong");
        for (more_columns, more_rows) in [(-1, 0), (0, -1), (1, 0), (0, 1), (-1, -1), (-2, 0)] {
            let [columns, rows] = [(columns, more_columns), (rows, more_rows)]
                .map(|(side, more)| side.saturating_add_signed(more));
            let turned = (columns, rows) == (wanted.rows, wanted.columns);
            let fits = usize::from(columns) * usize::from(rows) <= 120;
            if turned || columns.min(rows) < 3 || !fits {
                continue;
            }
            let other = search.find(&image, &[GridShape { columns, rows }]).remove(0);
            false_boards += usize::from(other.is_ok());
        }
        println!("{name}\t{kind}\t{verdict}\t{false_boards}\t{error_px:.3}\t{time_ms:.1}");
    }
    Ok(())
}

/// The root mean square distance of the corners from the true ones, in the numbering that suits
/// best, as a symmetric board has several; `None` where one is not at its true place.
fn error_px(found: &Found, truth_px: &[[f64; 2]]) -> Option<f64> {
    let [columns, rows] = [found.grid.shape.columns, found.grid.shape.rows].map(usize::from);
    let count = truth_px.len();
    let corner = |place: usize| {
        let index = found.grid.corners[place]?;
        Some(found.corners[usize::from(index)].position_px.map(f64::from))
    };
    let apart = |[x, y]: [f64; 2], [u, v]: [f64; 2]| (x - u).hypot(y - v);
    let square = columns == rows;
    let numberings: [Box<dyn Fn(usize) -> usize>; 4] = [
        Box::new(|place| place),
        Box::new(|place| count - 1 - place),
        Box::new(|place| (place % columns) * columns + columns - 1 - place / columns),
        Box::new(|place| count - 1 - ((place % columns) * columns + columns - 1 - place / columns)),
    ];
    let mut best: Option<f64> = None;
    for numbering in &numberings[..if square { 4 } else { 2 }] {
        let (mut squares, mut seen, mut right) = (0.0, 0, true);
        for place in 0..count {
            let Some(at) = corner(place) else { continue };
            let true_px = truth_px[numbering(place)];
            let beside = numbering(if place % columns > 0 { place - 1 } else { place + 1 });
            right &= apart(at, true_px) < RIGHT * apart(true_px, truth_px[beside]);
            squares += apart(at, true_px).powi(2);
            seen += 1;
        }
        if right && seen > 0 {
            let error_px = (squares / f64::from(seen)).sqrt();
            best = Some(best.map_or(error_px, |best: f64| best.min(error_px)));
        }
    }
    best
}

/// The samples, width and height of a binary PGM of 8 bits, as OpenCV writes it.
fn read_pgm(path: &Path) -> Result<(Vec<u8>, usize, usize)> {
    let bytes = fs::read(path).with_context(|| path.display().to_string())?;
    let mut place = 0;
    let mut words = Vec::new();
    while words.len() < 4 {
        let rest = bytes.get(place..).filter(|rest| !rest.is_empty()).context("a PGM's header")?;
        let end = rest.iter().position(u8::is_ascii_whitespace).context("a PGM's header")?;
        words.push(String::from_utf8_lossy(&rest[..end]).into_owned());
        place += end + 1;
    }
    ensure!(words[0] == "P5" && words[3] == "255", "{}: not a PGM of 8 bits", path.display());
    let [width, height] = [words[1].parse()?, words[2].parse()?];
    Ok((bytes[place..].to_vec(), width, height))
}
