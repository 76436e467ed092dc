//! Two boards on one plate, moved through the volume.

use maud::{Markup, html};
use nalgebra::Vector3;
use plumbline_evidence::distance::{
    Against, Distance, FRAMES_MIN, POSITIONS_MIN, Pair, Position, Reason, Unconfirmed, distance,
    pairs,
};
use plumbline_evidence::uncertainty::{Estimate, Verdict};
use plumbline_evidence::volume::{Coverage, Direction, Next, PER_DIRECTION, Volume};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use serde::Serialize;

use super::live::Advice;
use super::output::{Output, Proof, millimetres};
use super::recording::{Board, Recording};
use super::source::Input;
use super::words::{rounded, signed, spread, verdict, with_u};
use super::{picture, plots};
use crate::ui::page::{figure, table};

const NAME: &str = "distance";

const SHOW_BOTH: &str = "hold the plate so that both boards are wholly in the picture";

/// An error of scale from which the print or the ruler is to be checked, in per cent: a printer
/// that fits the page is off by more, a good one by less.
const SCALE_PERCENT: f64 = 0.2;

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
        findings: findings(&found, &coverage, judged.zip(arguments.limit_mm)),
        warnings: warnings(&found, &coverage),
        next: next(&found, &coverage, judged),
        facts: facts(&names, &found, &coverage, first, &pairs),
        body: body(&volume, &coverage, &found, arguments.limit_mm)?,
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

fn findings(found: &Distance, coverage: &Coverage, judged: Option<(Verdict, f64)>) -> Vec<String> {
    let mut findings = Vec::new();
    if let Some(against) = &found.against {
        let said = judged
            .map_or_else(String::new, |(it, limit_mm)| format!(", {}", verdict(it, limit_mm)));
        findings.push(format!(
            "Largest error of the length in {}: {} mm{said}.",
            counted(found.positions.len(), "position"),
            signed(&against.largest_error_mm)
        ));
        findings.push(format!(
            "Mean error: {} mm, which is {} % of the length.",
            signed(&against.mean_error_mm),
            signed(&against.scale_error_percent)
        ));
    } else {
        findings.push(format!("Mean length: {} mm.", with_u(&found.mean_mm)));
    }
    findings.push(format!(
        "Scatter from one position to the next, standard deviation: {} mm; from the smallest to the \
         largest {} mm.",
        spread(&found.scatter_mm),
        rounded(found.range_mm)
    ));
    findings.push(format!("Noise of the length in one frame: {} mm.", rounded(found.noise_sd_mm)));
    if !found.unconfirmed.is_empty() {
        let frames: usize = found.unconfirmed.iter().map(|it| it.frames).sum();
        findings.push(format!(
            "Left out: {} that no others confirm; the page lists them.",
            counted(frames, "frame")
        ));
    }
    findings.push(format!(
        "Visited: {} of {} parts of the volume.",
        coverage.visited(),
        Coverage::ZONES
    ));
    findings
}

fn warnings(found: &Distance, coverage: &Coverage) -> Vec<String> {
    let mut warnings = Vec::new();
    if found.against.is_none() {
        warnings.push(
            "the length is not known: an error that is the same everywhere, as of a print that is \
             not true to scale, cannot be seen; measure it and give --length-mm"
                .to_owned(),
        );
    }
    if let Some(against) = found.against.filter(|it| found.positions[it.largest_at].frames == 1) {
        warnings.push(format!(
            "the largest error, at position {}, is that of a single frame: photograph the plate there \
             once more; a false detection does not repeat itself",
            against.largest_at + 1
        ));
    }
    if coverage.next().is_some() {
        warnings.push(format!(
            "{} of {} parts of the volume were visited: what is said holds for these",
            coverage.visited(),
            Coverage::ZONES
        ));
    }
    warnings
}

fn next(found: &Distance, coverage: &Coverage, judged: Option<Verdict>) -> String {
    if let Some(next) = coverage.next() {
        return format!("{}, and record again or add a recording.", next.words());
    }
    let scale = found.against.map(|it| it.scale_error_percent);
    if let Some(scale) = scale.filter(|it| it.value.abs() > SCALE_PERCENT && it.is_beyond_chance())
    {
        return format!(
            "all lengths are off by the same share: measure the print's squares, many at once; if \
             their side is {:.4} times what pitch_mm says, correct it in the targets file.",
            1.0 / (1.0 + scale.value / 100.0)
        );
    }
    let is_reading_coarse = |it: Against| {
        it.length_mm.standard > std::f64::consts::FRAC_1_SQRT_2 * it.largest_error_mm.standard
    };
    match judged {
        Some(Verdict::Exceeds) => "look in the page for where the errors are largest: towards the \
             corners of the picture it is the lens, so calibrate it again with more photographs there."
            .to_owned(),
        Some(Verdict::Undecided) if !found.against.is_some_and(is_reading_coarse) => {
            "hold the plate still for longer at each position: the noise is too large for the limit."
                .to_owned()
        }
        Some(Verdict::Undecided) => {
            "measure the length with a finer instrument, and give its smaller error.".to_owned()
        }
        _ => "go on with `plumb prove step`.".to_owned(),
    }
}

fn facts(
    names: &[String; 2],
    found: &Distance,
    coverage: &Coverage,
    recording: &Recording,
    pairs: &[Pair],
) -> Vec<(&'static str, String)> {
    let [near, far] = coverage.depth_mm;
    let mut facts = vec![
        ("boards", names.join(" and ")),
        ("frames with both", format!("{} of {}", pairs.len(), recording.frames)),
        ("positions", found.positions.len().to_string()),
        ("volume", format!("the whole picture, {near:.0} to {far:.0} mm deep")),
    ];
    if let Some(against) = &found.against {
        facts.push(("known length", format!("{} mm", with_u(&against.length_mm))));
    }
    facts
}

fn body(
    volume: &Volume,
    coverage: &Coverage,
    found: &Distance,
    limit_mm: Option<f64>,
) -> Result<Markup, BadInput> {
    let zones = picture::coverage(volume, coverage, &ends(&found.positions))?;
    let shown: Vec<Estimate> = found.positions.iter().map(|it| shown(it, found)).collect();
    let axis = if found.against.is_some() { "error (mm)" } else { "less the mean (mm)" };
    let bounds: Vec<f64> = limit_mm.map_or_else(|| vec![0.0], |limit_mm| vec![-limit_mm, limit_mm]);
    let errors = plots::of_positions(&shown, axis, &bounds)?;
    let over = |of: fn(&Position) -> f64| -> Vec<(f64, Estimate)> {
        found.positions.iter().map(of).zip(shown.iter().copied()).collect()
    };
    let by_tilt =
        plots::over_angle(&over(tilt_deg), ["angle to the picture's plane (degrees)", axis])?;
    let by_radius =
        plots::over_angle(&over(off_axis_deg), ["angle to the optical axis (degrees)", axis])?;
    let directions = Direction::ALL.into_iter().zip(coverage.directions);
    let directions =
        directions.map(|(it, count)| vec![direction(it).to_owned(), count.to_string()]);
    let header =
        ["position", "x (mm)", "y (mm)", "depth (mm)", "direction", "frames", "length (mm)", axis];
    let rows: Vec<Vec<String>> =
        found.positions.iter().zip(&shown).enumerate().map(|(at, it)| row(at, it)).collect();
    let left_out: Vec<Vec<String>> = found.unconfirmed.iter().map(left_out).collect();
    Ok(html! {
        section {
            h2 { "Where the plate was" }
            div.over-time {
                (figure(&zones, "Three layers of depth as the camera sees them, with both ends of each measured length; parts that were never visited say so"))
            }
            div.few { (table("Lengths by direction; three or more of each are wanted", &["direction", "positions"].map(str::to_owned), &directions.collect::<Vec<_>>())) }
        }
        section {
            h2 { "Errors" }
            div.over-time { (figure(&errors, if limit_mm.is_some() { "Each position with U (k = 2), and the limit" } else { "Each position with U (k = 2)" })) }
            div.pair {
                (figure(&by_tilt, "The same over the angle of the length to the picture's plane: a rise or a fall shows a wrong focal length, which errs in depth alone"))
                (figure(&by_radius, "The same over the plate's angle to the optical axis: a curve shows a wrong distortion"))
            }
            (table("All positions, with U (k = 2)", &header.map(str::to_owned), &rows))
            @if !found.unconfirmed.is_empty() {
                (table("Frames that were left out", &LEFT_OUT.map(str::to_owned), &left_out))
            }
        }
        section {
            h2 { "Method" }
            p.method {
                "After the idea of VDI/VDE 2634 part 1, with one length at many positions. A position "
                "is all frames in which the plate is within 3 % of its distance from the camera and 8 "
                "degrees of the same pose. Of a recording, a position counts if three frames or more "
                "show it. A lone frame that is farther from the median of its position than six "
                "standard deviations is left out, because the largest error would otherwise be that of "
                "a single false detection; of two, neither is, because an error that repeats itself "
                "counts. Noise: the scatter of single frames about their "
                "position's mean, all positions together; the standard uncertainty of a mean goes by "
                "the effective number of frames (Bartlett 1946, Geyer 1992). Errors combine it with "
                "that of the known length, whose largest error is taken as a rectangular "
                "distribution. The mean's uncertainty is that of the scatter of the positions "
                "(JCGM 101:2008, 6.4.9). Expanded uncertainties: k = 2 (JCGM 100:2008). Against a "
                "limit: ISO 14253-1."
            }
        }
    })
}

/// The error or, if that is not known, how far the position is from the mean of all.
fn shown(position: &Position, found: &Distance) -> Estimate {
    let Estimate { value, standard } = position.distance_mm;
    position.error_mm.unwrap_or(Estimate::new(value - found.mean_mm.value, standard))
}

fn middle_mm(position: &Position) -> Vector3<f64> {
    let [first, second] = position.ends_mm.map(Vector3::from);
    0.5 * (first + second)
}

fn tilt_deg(position: &Position) -> f64 {
    let [first, second] = position.ends_mm.map(Vector3::from);
    let between_mm = second - first;
    (between_mm.z.abs() / between_mm.norm()).asin().to_degrees()
}

fn off_axis_deg(position: &Position) -> f64 {
    middle_mm(position).angle(&Vector3::z()).to_degrees()
}

fn direction(direction: Direction) -> &'static str {
    match direction {
        Direction::Across => "across",
        Direction::Upright => "up and down",
        Direction::IntoDepth => "into the depth",
    }
}

fn row(at: usize, (position, shown): (&Position, &Estimate)) -> Vec<String> {
    let middle_mm = middle_mm(position);
    vec![
        (at + 1).to_string(),
        format!("{:.0}", middle_mm.x),
        format!("{:.0}", middle_mm.y),
        format!("{:.0}", middle_mm.z),
        direction(position.direction).to_owned(),
        position.frames.to_string(),
        with_u(&position.distance_mm),
        signed(shown),
    ]
}

/// The header of what was left out.
const LEFT_OUT: [&str; 6] = ["x (mm)", "y (mm)", "depth (mm)", "frames", "length (mm)", "why"];

fn left_out(unconfirmed: &Unconfirmed) -> Vec<String> {
    let Unconfirmed { middle_mm, frames, distance_mm, reason } = unconfirmed;
    let why = match reason {
        Reason::FewFrames => format!("fewer than {FRAMES_MIN} frames show the plate there"),
        Reason::Outlier => "all other frames of the position agree on another length".to_owned(),
    };
    let place = middle_mm.iter().map(|it| format!("{it:.0}"));
    place.chain([frames.to_string(), format!("{distance_mm:.3}"), why]).collect()
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
