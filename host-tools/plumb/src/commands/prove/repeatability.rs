//! A board that stands still.

use std::ops::Range;

use maud::{Markup, html};
use plumbline_evidence::repeatability::{FRAMES_MIN, Repeatability, Steadiness, repeatability};
use plumbline_evidence::sighting::{Deviations, Sighting};
use plumbline_evidence::stillness::{Stillness, stillness};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_report::page::{figure, table};
use serde::Serialize;

use super::live::Advice;
use super::output::{Output, Proof};
use super::plots;
use super::recording::{Board, Recording};
use super::source::Input;
use super::words::{rounded, signed, spread};

const NAME: &str = "repeatability";

/// A covariance that is wrong by less than this is good enough to weigh measurements by.
const STATED_GOOD: Range<f64> = 0.8..1.25;

/// A board that stands still: noise, drift, and whether the poses' own uncertainty is right.
///
/// Fix the plate where nothing moves it: on a wall, or clamped to a table. Let the camera warm up
/// for half an hour, leave the room quiet, and record for a minute or longer.
///
/// If the board moved meanwhile, this says when, and which part of the recording can be used.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  plumb prove repeatability --seconds 60      # the box that sends to this computer
  plumb receive --duration 60 --out still
  plumb prove repeatability still
  plumb prove repeatability --from 12 --to 60 --board lumbar --out lumbar.html still
  plumb prove repeatability --camera camera.toml --targets targets.toml still.y4m")]
pub struct Arguments {
    #[command(flatten)]
    input: Input,
    /// The board [default: the one that is seen most often]
    #[arg(long, value_name = "NAME")]
    board: Option<String>,
    /// Use the recording from here on, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    from: f64,
    /// Use the recording up to here, seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = f64::INFINITY, hide_default_value = true)]
    to: f64,
    #[command(flatten)]
    output: Output,
}

/// The figures as they are written.
#[derive(Serialize)]
struct Figures<'a> {
    board: &'a str,
    frames_in_all: usize,
    #[serde(flatten)]
    repeatability: &'a Repeatability,
}

/// Runs the proof.
///
/// # Errors
/// When the recording cannot be used, the board moved, or the output cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    arguments.output.check(NAME, &arguments.input)?;
    let recordings = arguments.input.read(|recording| advice(recording, arguments))?;
    let [recording] = &recordings[..] else {
        return Err(BadInput::whole(
            &recordings[1].place,
            "a second recording, where one of a board that stands still is wanted",
            "give one recording at a time",
        )
        .into());
    };
    let board = recording.board(arguments.board.as_deref())?;
    let sightings = arguments.used(board);
    arguments.check_still(&recording.place, &sightings)?;
    let Some(found) = repeatability(&sightings) else {
        return Err(BadInput::whole(
            &recording.place,
            format!("the board {:?} is seen in {}", board.name, counted(sightings.len(), "frame")),
            format!("at least {FRAMES_MIN} are needed: record for a minute"),
        )
        .into());
    };
    let figures =
        Figures { board: &board.name, frames_in_all: recording.frames, repeatability: &found };
    let (findings, warnings, next) = judged(recording, board, &found);
    let proof = Proof {
        name: NAME,
        title: "Repeatability: a board that stands still",
        findings,
        warnings,
        next,
        facts: facts(recording, board, &found),
        body: body(&sightings, &found)?,
        figures: &figures,
    };
    Ok(arguments.output.write(&recordings, &proof)?)
}

/// What to do while the box is watched.
///
/// # Errors
/// As soon as the board has moved.
fn advice(recording: &Recording, arguments: &Arguments) -> Result<Advice, BadInput> {
    let board = recording.chosen(arguments.board.as_deref())?;
    arguments.check_still(&recording.place, &arguments.used(board))?;
    let words = recording.gone(board).map(|it| it.advice(&board.name));
    Ok(Advice::Do(
        words.unwrap_or_else(|| {
            "keep away from board and camera, and leave the room quiet".to_owned()
        }),
    ))
}

impl Arguments {
    /// The sightings of a board between --from and --to.
    fn used(&self, board: &Board) -> Vec<Sighting> {
        let mut sightings = board.sightings();
        sightings.retain(|it| (self.from..=self.to).contains(&it.time_s));
        sightings
    }

    /// Says when the board moved, if it did.
    fn check_still(&self, place: &str, sightings: &[Sighting]) -> Result<(), BadInput> {
        let found: Stillness = stillness(sightings);
        let Some(first) = found.movements.first() else { return Ok(()) };
        let others = match found.movements.len() - 1 {
            0 => String::new(),
            others => format!(", and {} later", counted(others, "time")),
        };
        let still = found.longest().filter(|it| it.len() >= FRAMES_MIN && !self.input.is_live());
        let part = still.map_or_else(String::new, |part| {
            let [from_s, to_s] = [part.start, part.end - 1].map(|at| sightings[at].time_s);
            // Rounded inwards, so that the movement stays outside.
            let [from_s, to_s] = [(from_s * 10.0).ceil() / 10.0, (to_s * 10.0).floor() / 10.0];
            format!(
                ", or use its longest part without a movement: --from {from_s:.1} --to {to_s:.1}"
            )
        });
        Err(BadInput::whole(
            place,
            format!(
                "the board moved at {:.1} s, by {:.2} mm and {:.2} degrees within a second{others}",
                first.time_s, first.by_mm, first.by_deg
            ),
            format!("fix board and camera, keep away from both, and record again{part}"),
        ))
    }
}

fn judged(
    recording: &Recording,
    board: &Board,
    found: &Repeatability,
) -> (Vec<String>, Vec<String>, String) {
    let mut findings = vec![format!(
        "Noise of one frame, standard deviation: {}.",
        each(found, |it| format!("{} {} mm", it.name, rounded(it.noise.sd)))
    )];
    findings.push(format!(
        "Drift per minute: {}.",
        each(found, |it| format!("{} {} mm", it.name, signed(&it.drift_per_min)))
    ));
    findings.push(format!(
        "Noise as a multiple of what the poses' own covariance says: {}.",
        each(found, |it| format!("{} {}", it.name, spread(&it.noise_over_stated)))
    ));
    findings.push(format!(
        "Spread about the line of the drift, as the same multiple: {}.",
        each(found, |it| format!("{} {:.2}", it.name, it.spread_over_stated))
    ));
    let mut warnings = Vec::new();
    let unseen = recording.frames - board.count();
    if 20 * unseen > recording.frames {
        warnings.push(format!(
            "the board is not seen in {unseen} of {}: noise that hides it is not measured",
            counted(recording.frames, "frame")
        ));
    }
    (findings, warnings, next(found))
}

fn next(found: &Repeatability) -> String {
    let names = |which: fn(&Steadiness) -> bool| {
        joined(found.coordinates[..3].iter().filter(|it| which(it)))
    };
    if let Some(names) = names(|it| it.spread_over_stated > STATED_GOOD.end) {
        return format!(
            "more than the poses' own noise is in {names}: look for what shakes the board or the \
             camera, and for lamps that flicker, and record again."
        );
    }
    if let Some(names) = joined(found.drifting().filter(|it| matters(it))) {
        return format!(
            "there is a drift in {names}: let the camera warm up for half an hour, check that board \
             and camera are fixed, and record again."
        );
    }
    if let Some(names) = names(|it| it.spread_over_stated < STATED_GOOD.start) {
        return format!(
            "there is less noise in {names} than the poses say, so that their uncertainty is on the \
             safe side: go on with `plumb prove distance`."
        );
    }
    if let Some(names) = joined(found.drifting()) {
        return format!(
            "the drift in {names} is less than the noise of one frame: go on with `plumb prove \
             distance`, or record for longer if your trials are longer."
        );
    }
    "nothing moves beyond the noise that the poses state: go on with `plumb prove distance`."
        .to_owned()
}

/// Whether a drift exceeds the noise of one frame in this recording. A smaller one adds no more than
/// 4 % to the spread: a line of length D spreads by D / sqrt(12).
fn matters(it: &Steadiness) -> bool {
    it.drift_in_all.value.abs() > it.noise.sd
}

/// The names of coordinates, if there are any.
fn joined<'s>(coordinates: impl Iterator<Item = &'s Steadiness>) -> Option<String> {
    let names: Vec<&str> = coordinates.map(|it| it.name).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// The three positions, joined.
fn each(found: &Repeatability, words: impl Fn(&Steadiness) -> String) -> String {
    found.coordinates[..3].iter().map(words).collect::<Vec<_>>().join(", ")
}

fn facts(
    recording: &Recording,
    board: &Board,
    found: &Repeatability,
) -> Vec<(&'static str, String)> {
    let [x, y, z] = found.position_mm;
    vec![
        ("board", board.name.clone()),
        ("frames used", format!("{} of {}", found.frames, recording.frames)),
        ("duration", format!("{:.1} s", found.duration_s)),
        ("position in the camera's frame", format!("x {x:.0}, y {y:.0}, z {z:.0} mm")),
    ]
}

fn body(sightings: &[Sighting], found: &Repeatability) -> Result<Markup, BadInput> {
    let Deviations { values, .. } = Deviations::of(sightings);
    let time_s: Vec<f64> = sightings.iter().map(|it| it.time_s).collect();
    let mut lines = Vec::new();
    for (it, values) in found.coordinates.iter().zip(&values).take(3) {
        let svg = plots::over_time(&time_s, values, &it.drift_in_all, it.name, it.unit)?;
        let caption = format!("{}, each frame less the mean, and the fitted drift", it.name);
        lines.push(figure(&svg, &caption));
    }
    let allan = [
        (&found.coordinates[..3], "positions (mm)", "Allan deviation of the positions"),
        (&found.coordinates[3..], "turns (deg)", "Allan deviation of the turns"),
    ];
    let mut deviations = Vec::new();
    for (coordinates, axis, caption) in allan {
        deviations.push(figure(&plots::allan(coordinates, axis)?, caption));
    }
    let header = [
        "coordinate",
        "noise of one frame",
        "noise / stated",
        "spread without drift / stated",
        "drift per minute",
        "spread",
        "averaging helps up to",
    ];
    let rows: Vec<Vec<String>> = found.coordinates.iter().map(row).collect();
    Ok(html! {
        section {
            h2 { "Over time" }
            @for line in &lines { div.over-time { (line) } }
        }
        section {
            h2 { "All coordinates" }
            (table("Standard deviations with 95 % confidence intervals; drift with its expanded uncertainty U (k = 2)", &header.map(str::to_owned), &rows))
            div.pair { @for deviation in &deviations { (deviation) } }
        }
        section {
            h2 { "Method" }
            p.method {
                "Positions x, y, z of the board's origin along the camera's axes (z is the depth), "
                "turns about the board's axes. Noise: from the differences of successive frames, "
                "which a drift does not change (von Neumann 1941). Noise / stated: the same "
                "differences divided by the standard deviation that the tracker gives with each "
                "pose; 1 if that is right. Spread without drift / stated: the residuals of the line "
                "of the drift, divided likewise; it is larger where errors last for some frames. "
                "Drift: least-squares line; its standard uncertainty goes by the effective number of "
                "residuals, which depend on each other (Bartlett 1946, Geyer 1992). Whether a drift "
                "is beyond chance is judged for all six coordinates together (Bonferroni). "
                "Spread: standard deviation of all frames, noise and drift together. "
                "Allan deviation: of the means of neighbouring parts of the recording, over their "
                "length; it falls with the root of the length where there is noise alone, and "
                "rises where there is drift. Expanded uncertainties: k = 2 (JCGM 100:2008)."
            }
        }
    })
}

fn row(it: &Steadiness) -> Vec<String> {
    let helps = it.steadiest_s().map_or("all of it".to_owned(), |it| format!("{} s", rounded(it)));
    vec![
        format!("{} ({})", it.name, it.unit),
        spread(&it.noise),
        spread(&it.noise_over_stated),
        format!("{:.2}", it.spread_over_stated),
        signed(&it.drift_per_min),
        rounded(it.spread_sd),
        helps,
    ]
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Vector6};
    use plumbline::pose::{Cam, Pose, Target};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// Standard deviations of the noise: radians, then mm.
    const NOISE: [f64; 6] = [1e-4, 1e-4, 1e-4, 0.02, 0.02, 0.02];

    /// 20 s of a board whose depth drifts by so much.
    fn drifted(by_mm: f64) -> Repeatability {
        const FRAMES: usize = 600;
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let sighting = |at: usize| {
            let z_mm = 900.0 + by_mm * at as f64 / FRAMES as f64;
            let truth = Pose::<Cam, Target>::from_theta([0.1, 0.2, -0.1, 5.0, 8.0, z_mm]);
            let noise =
                NOISE.map(|sd| sd * Distribution::<f64>::sample(&StandardNormal, &mut random));
            Sighting {
                time_s: at as f64 / 30.0,
                cam_from_board: truth.moved_by(&Vector6::from(noise)),
                covariance: Matrix6::from_diagonal(&Vector6::from(NOISE.map(|sd| sd * sd))),
            }
        };
        repeatability(&(0..FRAMES).map(sighting).collect::<Vec<_>>()).unwrap()
    }

    /// Of 600 frames a drift's uncertainty is U = 0.0057 mm.
    #[test]
    fn a_warm_camera_is_asked_for_only_where_a_drift_matters() {
        for (by_mm, words) in [
            (0.0, "nothing moves beyond the noise"),
            (0.015, "the drift in z (depth) is less than the noise of one frame"),
            (0.1, "there is a drift in z (depth): let the camera warm up"),
        ] {
            let next = next(&drifted(by_mm));
            assert!(next.starts_with(words), "{by_mm} mm: {next}");
        }
    }

    #[test]
    fn a_good_covariance_is_one_that_is_nearly_right() {
        assert!(STATED_GOOD.contains(&1.0));
        // Equally far on both sides.
        assert!((STATED_GOOD.start * STATED_GOOD.end - 1.0).abs() < 1e-12);
    }
}
