//! What the page and the terminal say of the distance.

use maud::{Markup, html};
use nalgebra::Vector3;
use plumbline_evidence::distance::{
    Against, Distance, FRAMES_MIN, Pair, Position, Reason, Unconfirmed,
};
use plumbline_evidence::uncertainty::{Estimate, Verdict};
use plumbline_evidence::volume::{Coverage, Direction, Volume};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_report::page::{figure, table};

use super::super::recording::Recording;
use super::super::words::{rounded, signed, spread, verdict, with_u};
use super::super::{picture, plots};
use super::ends;

/// An error of scale from which the print or the ruler is to be checked, in per cent: a printer
/// that fits the page is off by more, a good one by less.
const SCALE_PERCENT: f64 = 0.2;

pub(super) fn findings(
    found: &Distance,
    coverage: &Coverage,
    judged: Option<(Verdict, f64)>,
) -> Vec<String> {
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

pub(super) fn warnings(found: &Distance, coverage: &Coverage) -> Vec<String> {
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

pub(super) fn next(found: &Distance, coverage: &Coverage, judged: Option<Verdict>) -> String {
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

pub(super) fn facts(
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

pub(super) fn body(
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
