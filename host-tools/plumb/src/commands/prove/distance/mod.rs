//! Two boards on one plate, moved through the volume.

mod page;

use nalgebra::Vector3;
use plumbline_evidence::distance::{
    Distance, FRAMES_MIN, POSITIONS_MIN, Pair, Position, distance, pairs,
};
use plumbline_evidence::uncertainty::{Estimate, Verdict};
use plumbline_evidence::volume::{Coverage, Next, PER_DIRECTION, Volume};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use serde::Serialize;

use super::live::Advice;
use super::output::{Output, Proof, millimetres};
use super::recording::{Board, Recording};
use super::source::Input;

const NAME: &str = "distance";

const SHOW_BOTH: &str = "hold the plate so that both boards are wholly in the picture";

/// Two boards on one plate, moved through the volume: errors of a known length.
///
/// Bring the plate to every part of the picture, near and far, and turn and tilt it; hold it still
/// for a moment at each position. The length is measured between the boards' first inner corners:
/// of each board, with its arrow up, the lower right corner of the upper left black square.
/// Measure it with a caliper or a good ruler and give it with --length-mm, and with
/// --length-max-error-mm how far off the reading may be. Without it only the scatter of the length
/// is known, and no error that is the same everywhere.
///
/// Errors are judged after the idea of VDI/VDE 2634 part 1: the largest one of all positions counts.
/// Of a recording, a position counts if three frames show it, and a single frame that differs from all
/// others of its position does not; the page lists what was left out. An error that repeats itself
/// counts.
/// The page shows which parts of the volume were visited, and where to go next.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  plumb prove distance --seconds 300      # the box that sends to this computer
  plumb receive --out moved      # move the plate; end with Ctrl-C
  plumb prove distance moved
  plumb prove distance --length-mm 109.0 --length-max-error-mm 0.2 --limit-mm 0.5 moved
  plumb prove distance --camera camera.toml --targets targets.toml --independent photos/*.png")]
pub struct Arguments {
    #[command(flatten)]
    input: Input,
    /// The two boards [default: those that are seen most often]
    #[arg(long, value_name = "NAME,NAME", value_parser = two_names)]
    boards: Option<[String; 2]>,
    /// The length between the boards' first inner corners, as you measured it.
    #[arg(long, value_name = "MM", value_parser = millimetres, requires = "length_max_error_mm")]
    length_mm: Option<f64>,
    /// How far off that may be: 0.2 for a ruler, 0.05 for a caliper and a keen eye.
    #[arg(long, value_name = "MM", value_parser = millimetres, requires = "length_mm")]
    length_max_error_mm: Option<f64>,
    /// The largest error that is allowed.
    #[arg(long, value_name = "MM", value_parser = millimetres, requires = "length_mm")]
    limit_mm: Option<f64>,
    /// The depths between which you measure [default: those at which the plate was seen]
    #[arg(long, value_name = "NEAR-FAR", value_parser = depths)]
    depth_mm: Option<[f64; 2]>,
    #[command(flatten)]
    output: Output,
}

impl Arguments {
    /// How many frames make a position.
    fn frames_min(&self) -> usize {
        if self.input.is_independent() { 1 } else { FRAMES_MIN }
    }
}

/// The figures as they are written.
#[derive(Serialize)]
struct Figures<'a> {
    boards: [&'a str; 2],
    #[serde(flatten)]
    distance: &'a Distance,
    coverage: &'a Coverage,
    limit_mm: Option<f64>,
    verdict: Option<Verdict>,
}

/// Parses two names.
fn two_names(text: &str) -> Result<[String; 2], String> {
    let (first, second) = text.split_once(',').ok_or("give two names, such as lumbar,shoulder")?;
    if first == second {
        return Err("give two different names".to_owned());
    }
    Ok([first, second].map(str::to_owned))
}

/// Parses two depths.
fn depths(text: &str) -> Result<[f64; 2], String> {
    let (near, far) = text.split_once('-').ok_or("give two depths, such as 800-1200")?;
    let [near, far] = [millimetres(near)?, millimetres(far)?];
    if near < far { Ok([near, far]) } else { Err("give the nearer one first".to_owned()) }
}

/// Runs the proof. Gives whether the largest error is within the limit.
///
/// # Errors
/// When the recordings cannot be used or show too few positions, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    arguments.output.check(NAME, &arguments.input)?;
    let recordings = arguments.input.read(|recording| advice(recording, arguments))?;
    let first = &recordings[0];
    let mut pairs = Vec::new();
    let names: [String; 2] = first.pair(arguments.boards.as_ref())?.map(|board| board.name.clone());
    for recording in &recordings {
        pairs.extend(pairs_of(&recording.pair(Some(&names))?));
    }
    let length_mm = arguments
        .length_mm
        .zip(arguments.length_max_error_mm)
        .map(|(length_mm, off_mm)| Estimate::of_reading(length_mm, off_mm));
    let found = distance(&pairs, length_mm, arguments.frames_min())
        .map_err(|positions| too_few(first, &names, &pairs, positions))?;
    if let Some(against) = &found.against {
        check_length(against.length_mm.value, found.mean_mm.value)?;
    }

    let ends_mm = ends(&found.positions);
    let volume = volume(first, arguments, &ends_mm);
    let coverage = volume.coverage(&ends_mm);
    let judged = found.against.zip(arguments.limit_mm);
    let judged = judged.map(|(it, limit_mm)| Verdict::of(&it.largest_error_mm, limit_mm));
    let figures = Figures {
        boards: [&names[0], &names[1]],
        distance: &found,
        coverage: &coverage,
        limit_mm: arguments.limit_mm,
        verdict: judged,
    };
    let proof = Proof {
        name: NAME,
        title: "Distance: a known length all over the volume",
        findings: page::findings(&found, &coverage, judged.zip(arguments.limit_mm)),
        warnings: page::warnings(&found, &coverage),
        next: page::next(&found, &coverage, judged),
        facts: page::facts(&names, &found, &coverage, first, &pairs),
        body: page::body(&volume, &coverage, &found, arguments.limit_mm)?,
        figures: &figures,
    };
    arguments.output.write(&recordings, &proof)?;
    Ok(judged.is_none_or(|it| it == Verdict::Within))
}

/// Where to go while the box is watched.
///
/// # Errors
/// When there are no two such boards, or the length that was given cannot be theirs.
fn advice(recording: &Recording, arguments: &Arguments) -> Result<Advice, BadInput> {
    let boards = recording.chosen_pair(arguments.boards.as_ref())?;
    for board in boards {
        if let Some(missing) = recording.gone(board) {
            let words = format!("{} is not seen ({}): {SHOW_BOTH}", board.name, missing.words());
            return Ok(Advice::Do(words));
        }
    }
    let pairs = pairs_of(&boards);
    if let Some(length_mm) = arguments.length_mm.filter(|_| !pairs.is_empty()) {
        let sum_mm: f64 = pairs.iter().map(Pair::distance_mm).sum();
        check_length(length_mm, sum_mm / pairs.len() as f64)?;
    }
    let words = match distance(&pairs, None, arguments.frames_min()) {
        Err(positions) => format!(
            "bring the plate to another place, and hold it still for a moment ({positions} of \
             {POSITIONS_MIN})"
        ),
        Ok(found) => {
            let ends_mm = ends(&found.positions);
            let coverage = volume(recording, arguments, &ends_mm).coverage(&ends_mm);
            let Some(next) = coverage.next() else { return Ok(Advice::Enough) };
            let [visited, of] = match next {
                Next::Turn(direction) => [coverage.directions[direction as usize], PER_DIRECTION],
                Next::Visit(..) => [coverage.visited(), Coverage::ZONES],
            };
            format!("{} ({visited} of {of})", next.words())
        }
    };
    Ok(Advice::Do(words))
}

/// The volume that is to be visited.
fn volume(recording: &Recording, arguments: &Arguments, ends_mm: &[[Vector3<f64>; 2]]) -> Volume {
    match arguments.depth_mm {
        Some(depth_mm) => Volume { lens: recording.lens, depth_mm },
        None => Volume::around(recording.lens, ends_mm),
    }
}

/// The frames in which both boards are seen.
fn pairs_of([first, second]: &[&Board; 2]) -> Vec<Pair> {
    let points_mm = [first, second].map(|it| it.geometry.corner_mm(0));
    pairs([&first.seen, &second.seen], &points_mm)
}

fn too_few(
    recording: &Recording,
    names: &[String; 2],
    pairs: &[Pair],
    positions: usize,
) -> BadInput {
    let [first, second] = names;
    if pairs.is_empty() {
        return BadInput::whole(
            &recording.place,
            format!("{first} and {second} are never seen in the same frame"),
            format!("{SHOW_BOTH}, and record again"),
        );
    }
    BadInput::whole(
        &recording.place,
        format!(
            "the plate was at {}, in {} that show both boards",
            counted(positions, "position"),
            counted(pairs.len(), "frame")
        ),
        format!(
            "at least {POSITIONS_MIN} are needed: bring it to every part of the picture, near and \
             far, and turn and tilt it"
        ),
    )
}

/// A length that is off by more than a tenth is no error of measurement.
fn check_length(given_mm: f64, mean_mm: f64) -> Result<(), BadInput> {
    if (mean_mm / given_mm - 1.0).abs() <= 0.1 {
        return Ok(());
    }
    Err(BadInput::whole(
        "--length-mm",
        format!("{given_mm} mm, where the boards' first inner corners are {mean_mm:.1} mm apart"),
        "measure, with the arrows up, from the lower right corner of one board's upper left black \
         square to the same corner of the other board; and check pitch_mm in the targets file",
    ))
}

fn ends(positions: &[Position]) -> Vec<[Vector3<f64>; 2]> {
    positions.iter().map(|it| it.ends_mm.map(Vector3::from)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_two_and_in_order() {
        assert_eq!(depths("800-1200"), Ok([800.0, 1200.0]));
        for (text, part) in [("800", "two depths"), ("1200-800", "nearer"), ("0-5", "more than 0")]
        {
            assert!(depths(text).unwrap_err().contains(part), "{text}");
        }
    }
}
