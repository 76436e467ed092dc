//! A board with and without a block of known thickness under it.

use std::ops::Range;

use maud::{Markup, html};
use plumbline_evidence::sighting::Sighting;
use plumbline_evidence::step::{FRAMES_MIN, NoStep, PlaceSeen, Step, slices, step};
use plumbline_evidence::stillness::stillness;
use plumbline_evidence::uncertainty::{Estimate, Verdict};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_report::page::{figure, table};
use serde::Serialize;

use super::live::Advice;
use super::output::{Output, Proof, millimetres};
use super::plots;
use super::recording::{Board, Recording};
use super::source::Input;
use super::words::{rounded, signed, verdict, with_u};

const NAME: &str = "step";

/// Rests that a live box waits for: three with and three without the block.
const RESTS: usize = 6;

/// The length of each, seconds.
const REST_S: f64 = 3.0;

/// A block shorter than this share of the sideways movement is measured badly.
const SIDEWAYS_MAX: f64 = 1.0;

/// A board with and without a block of known thickness under it: the error of a step.
///
/// Let the plate rest for five seconds against a firm stop, then with the block between plate and
/// stop, and so on in turn, three times each or more: how well that repeats belongs to the
/// uncertainty. Push the plate to the same place each time, so that it moves along its normal only.
/// One recording with all of it, or one for each rest.
///
/// Feeler gauges, gauge blocks or a stack of new coins serve as blocks. With two blocks, the
/// thickness is the difference of both.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  plumb prove step --seconds 120      # the box that sends to this computer
  plumb receive --out block     # without, with, without, with the block; end with Ctrl-C
  plumb prove step --thickness-mm 10 --thickness-max-error-mm 0.01 block
  plumb prove step --thickness-mm 10 --thickness-max-error-mm 0.01 --limit-mm 0.05 low high low2 high2
  plumb prove step --camera camera.toml --targets targets.toml block.y4m")]
pub struct Arguments {
    #[command(flatten)]
    input: Input,
    /// The board [default: the one that is seen most often]
    #[arg(long, value_name = "NAME")]
    board: Option<String>,
    /// The thickness of the block, as you measured it or as it says.
    #[arg(long, value_name = "MM", value_parser = millimetres, requires = "thickness_max_error_mm")]
    thickness_mm: Option<f64>,
    /// How far off that may be.
    #[arg(long, value_name = "MM", value_parser = millimetres, requires = "thickness_mm")]
    thickness_max_error_mm: Option<f64>,
    /// The largest error that is allowed.
    #[arg(long, value_name = "MM", value_parser = millimetres, requires = "thickness_mm")]
    limit_mm: Option<f64>,
    #[command(flatten)]
    output: Output,
}

/// The figures as they are written.
#[derive(Serialize)]
struct Figures<'a> {
    board: &'a str,
    #[serde(flatten)]
    step: &'a Step,
    thickness_mm: Option<Estimate>,
    error_mm: Option<Estimate>,
    limit_mm: Option<f64>,
    verdict: Option<Verdict>,
}

/// Runs the proof. Gives whether the error is within the limit.
///
/// # Errors
/// When the recordings cannot be used or show no step, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    arguments.output.check(NAME, &arguments.input)?;
    let recordings = arguments.input.read(|recording| advice(recording, arguments))?;
    let name = recordings[0].board(arguments.board.as_deref())?.name.clone();
    let boards: Vec<&Board> =
        recordings.iter().map(|it| it.board(Some(&name))).collect::<Result<_, _>>()?;
    let sightings = one_after_another(&boards);
    let parts: Vec<Range<usize>> = still_parts(&boards);
    let found =
        step(&slices(&sightings, &parts)).map_err(|why| no_step(&recordings[0], &name, &why))?;

    let thickness_mm = arguments
        .thickness_mm
        .zip(arguments.thickness_max_error_mm)
        .map(|(it, off_mm)| Estimate::of_reading(it, off_mm));
    let error_mm = thickness_mm.map(|it| found.along_normal_mm.minus(it));
    let judged = error_mm.zip(arguments.limit_mm).map(|(it, limit_mm)| Verdict::of(&it, limit_mm));
    let figures = Figures {
        board: &name,
        step: &found,
        thickness_mm,
        error_mm,
        limit_mm: arguments.limit_mm,
        verdict: judged,
    };
    let proof = Proof {
        name: NAME,
        title: "Step: a board on a block of known thickness",
        findings: findings(&found, error_mm, judged.zip(arguments.limit_mm)),
        warnings: warnings(&found, thickness_mm),
        next: next(&found, error_mm, judged),
        facts: facts(&name, &found, thickness_mm),
        body: body(&sightings, &found, thickness_mm)?,
        figures: &figures,
    };
    arguments.output.write(&recordings, &proof)?;
    Ok(judged.is_none_or(|it| it == Verdict::Within))
}

/// What to do while the box is watched.
///
/// # Errors
/// When there is no board of that name.
fn advice(recording: &Recording, arguments: &Arguments) -> Result<Advice, BadInput> {
    let board = recording.chosen(arguments.board.as_deref())?;
    let missing = recording.gone(board).map(|it| Advice::Do(it.advice(&board.name)));
    Ok(missing.unwrap_or_else(|| where_to_rest(&board.sightings())))
}

/// Where to put the board down next. A rest that was cut short does not count.
fn where_to_rest(sightings: &[Sighting]) -> Advice {
    let parts = stillness(sightings).parts;
    let is_enough = |part: &&Range<usize>| {
        sightings[part.end - 1].time_s - sightings[part.start].time_s >= REST_S
    };
    let rests_too_briefly =
        parts.last().is_some_and(|it| it.end == sightings.len() && !is_enough(&it));
    match parts.iter().filter(is_enough).count() {
        RESTS.. => Advice::Enough,
        rests if rests_too_briefly => {
            Advice::Do(format!("let the board rest ({rests} of {RESTS})"))
        }
        rests => {
            let block = if rests % 2 == 1 { "with" } else { "without" };
            Advice::Do(format!(
                "put the board down {block} the block, and let it rest ({rests} of {RESTS})"
            ))
        }
    }
}

/// The sightings of all recordings, each beginning a second after the end of the one before.
fn one_after_another(boards: &[&Board]) -> Vec<Sighting> {
    let mut all: Vec<Sighting> = Vec::new();
    for board in boards {
        let begins_s = all.last().map_or(0.0, |it| it.time_s + 1.0);
        let sightings = board.sightings();
        let first_s = sightings.first().map_or(0.0, |it| it.time_s);
        all.extend(
            sightings
                .into_iter()
                .map(|it| Sighting { time_s: it.time_s - first_s + begins_s, ..it }),
        );
    }
    all
}

/// Where the board rested: never across two recordings.
fn still_parts(boards: &[&Board]) -> Vec<Range<usize>> {
    let mut parts = Vec::new();
    let mut before = 0;
    for board in boards {
        let sightings = board.sightings();
        let found = stillness(&sightings).parts;
        parts.extend(found.into_iter().map(|it| it.start + before..it.end + before));
        before += sightings.len();
    }
    parts
}

fn no_step(recording: &Recording, name: &str, why: &NoStep) -> BadInput {
    match why {
        NoStep::TooFewPlaces(places) => BadInput::whole(
            &recording.place,
            format!(
                "the board {name:?} rested at {} for {FRAMES_MIN} frames or longer, and two are \
                 needed",
                counted(*places, "place")
            ),
            "let it rest for five seconds without the block and then with it; a step of less than a \
             few times the noise of one frame is found only between recordings: give one for each",
        ),
        NoStep::Lost(step) => BadInput::whole(
            &recording.place,
            format!(
                "the step, {} mm, is not larger than its uncertainty U = {} mm",
                rounded(step.value),
                rounded(step.expanded())
            ),
            "take a thicker block, bring the camera nearer, or put the board down more often",
        ),
    }
}

fn findings(
    found: &Step,
    error_mm: Option<Estimate>,
    judged: Option<(Verdict, f64)>,
) -> Vec<String> {
    let mut findings = vec![format!(
        "Step along the board's normal: {} mm (U, k = 2).",
        with_u(&found.along_normal_mm)
    )];
    if let Some(error_mm) = error_mm {
        let said = judged
            .map_or_else(String::new, |(it, limit_mm)| format!(", {}", verdict(it, limit_mm)));
        findings.push(format!("Error against the block: {} mm{said}.", signed(&error_mm)));
    }
    findings.push(format!(
        "In space the board moved {} mm, sideways {} mm, and tilted by {} degrees.",
        rounded(found.in_space_mm),
        rounded(found.sideways_mm),
        rounded(found.tilted_deg)
    ));
    findings
}

fn warnings(found: &Step, thickness_mm: Option<Estimate>) -> Vec<String> {
    let mut warnings = Vec::new();
    if !found.is_placing_known {
        warnings.push(format!(
            "the board rested at {} only: how well it is put down again is not in the uncertainty; \
             let it rest with and without the block three times each",
            counted(found.places.len(), "place")
        ));
    }
    if found.sideways_mm > SIDEWAYS_MAX * found.along_normal_mm.value {
        warnings.push(format!(
            "the board moved {} mm sideways, more than along its normal: push it against a stop, so \
             that it comes to the same place",
            rounded(found.sideways_mm)
        ));
    }
    if thickness_mm.is_none() {
        warnings.push(
            "the block's thickness is not known: give --thickness-mm and --thickness-max-error-mm"
                .to_owned(),
        );
    }
    warnings
}

fn next(found: &Step, error_mm: Option<Estimate>, judged: Option<Verdict>) -> String {
    match (error_mm, judged) {
        (None, _) => "measure the block, and give --thickness-mm.".to_owned(),
        (_, Some(Verdict::Undecided)) => {
            "let the board rest more often with and without the block: its uncertainty is too large \
             for the limit."
                .to_owned()
        }
        (Some(error_mm), _) if error_mm.is_beyond_chance() => {
            "the error is beyond its uncertainty: check pitch_mm with `plumb prove distance`, and \
             that nothing is between block, board and stop."
                .to_owned()
        }
        _ if !found.is_placing_known => {
            "put the board down three times each, with and without the block.".to_owned()
        }
        _ => "the step agrees with the block: publish the page.".to_owned(),
    }
}

fn facts(name: &str, found: &Step, thickness_mm: Option<Estimate>) -> Vec<(&'static str, String)> {
    let near = found.places.iter().filter(|it| it.is_near).count();
    let mut facts = vec![
        ("board", name.to_owned()),
        ("far from the camera", counted(found.places.len() - near, "place")),
        ("near to the camera", counted(near, "place")),
    ];
    if let Some(thickness_mm) = thickness_mm {
        facts.push(("known thickness", format!("{} mm", with_u(&thickness_mm))));
    }
    facts
}

fn body(
    sightings: &[Sighting],
    found: &Step,
    thickness_mm: Option<Estimate>,
) -> Result<Markup, BadInput> {
    let heights: Vec<(f64, f64)> =
        sightings.iter().map(|it| (it.time_s, found.height_mm(it))).collect();
    let svg = plots::places(found, &heights)?;
    let rows: Vec<Vec<String>> = found.places.iter().enumerate().map(place).collect();
    let header = ["place", "from (s)", "until (s)", "frames", "height (mm)", "group"];
    let mut budget: Vec<Vec<String>> = found
        .budget
        .iter()
        .map(|it| vec![it.source.to_owned(), rounded(it.standard_uncertainty_mm)])
        .collect();
    let along = &found.along_normal_mm;
    budget.push(vec!["step, combined".to_owned(), rounded(along.standard)]);
    if let Some(thickness_mm) = thickness_mm {
        let error_mm = along.minus(thickness_mm);
        budget.push(vec!["thickness of the block".to_owned(), rounded(thickness_mm.standard)]);
        budget.push(vec!["error, combined".to_owned(), rounded(error_mm.standard)]);
        budget.push(vec!["error, expanded: U, k = 2".to_owned(), rounded(error_mm.expanded())]);
    }
    let columns = ["contribution", "standard uncertainty (mm)"];
    Ok(html! {
        section {
            h2 { "Places" }
            div.over-time {
                (figure(&svg, "Height along the board's normal, towards the camera; grey where the board rested, with the means"))
            }
            (table("Where the board rested; heights with the expanded uncertainty of their noise", &header.map(str::to_owned), &rows))
        }
        section {
            h2 { "Uncertainty" }
            div.few { (table("What makes up the uncertainty", &columns.map(str::to_owned), &budget)) }
        }
        section {
            h2 { "Method" }
            p.method {
                "The board rests where the mean pose of half a second differs from that of the next by "
                "less than three times the noise of one frame. The places form two groups along the "
                "mean normal of the board, divided where the gap is largest; the step is the difference "
                "of the groups' means. Noise of a mean: by the effective number of frames (Bartlett "
                "1946, Geyer 1992). Putting the board down again: the scatter of the places within "
                "the groups, if there are three degrees of freedom or more; it contains the noise. "
                "Few values: JCGM 101:2008, 6.4.9. Direction of the normal: the angle between the groups' "
                "normals, times the sideways movement. Expanded uncertainties: k = 2 (JCGM 100:2008). Against a "
                "limit: ISO 14253-1."
            }
        }
    })
}

fn place((at, it): (usize, &PlaceSeen)) -> Vec<String> {
    vec![
        (at + 1).to_string(),
        format!("{:.1}", it.from_s),
        format!("{:.1}", it.until_s),
        it.frames.to_string(),
        signed(&it.height_mm),
        if it.is_near { "near" } else { "far" }.to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix6;
    use plumbline::pose::Pose;

    use super::*;

    /// A board that rests for these times, with and without the block in turn, seconds.
    fn rested(times_s: &[f64]) -> Vec<Sighting> {
        let frames = times_s.iter().enumerate().flat_map(|(at, time_s)| {
            let height_mm = if at % 2 == 1 { 10.0 } else { 0.0 };
            std::iter::repeat_n(900.0 - height_mm, (30.0 * time_s) as usize)
        });
        let sighting = |(at, z_mm): (usize, f64)| Sighting {
            time_s: at as f64 / 30.0,
            cam_from_board: Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, z_mm]),
            covariance: Matrix6::identity(),
        };
        frames.enumerate().map(sighting).collect()
    }

    #[test]
    fn a_board_is_to_be_moved_on_when_it_has_rested_for_long_enough() {
        for (times_s, words) in [
            (&[1.5][..], "let the board rest (0 of 6)"),
            (&[4.0], "put the board down with the block, and let it rest (1 of 6)"),
            (&[4.0, 1.5], "let the board rest (1 of 6)"),
            (&[4.0, 4.0], "put the board down without the block, and let it rest (2 of 6)"),
            // One that was cut short, once and for all.
            (&[1.5, 4.0, 4.0], "put the board down without the block, and let it rest (2 of 6)"),
        ] {
            assert_eq!(
                where_to_rest(&rested(times_s)),
                Advice::Do(words.to_owned()),
                "{times_s:?}"
            );
        }
        assert_eq!(where_to_rest(&rested(&[4.0; 6])), Advice::Enough);
    }
}
