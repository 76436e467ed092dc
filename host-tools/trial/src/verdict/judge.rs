//! The verdict on a trial, criterion by criterion.
//!
//! In: a [`Trial`], which is what its packets say, and the [`Criteria`]. Out: a [`Verdict`] with a
//! reason for each criterion that is not met. Counts of packets are taken as they stand in the
//! manifest. Cost: one pass over the frames per trunk; a sort where a median is needed.
//!
//! A trunk is judged if the box was told to look for its target; without a configuration, if it was
//! ever seen. Light and focus are judged by the views that the recording asks the box for, and not
//! at all where none came.

use plumbline::packet::{MarkedInstant, View};
use plumbline::view::TargetView;
use plumbline_analysis::series::{GAP_PERIODS, usual_period_s};
use plumbline_analysis::statistics::describe::median;

use super::reasons::{Figure, Judge};
use super::{Criteria, Sign, Verdict};
use crate::Trial;
use crate::frame::{Frame, Trunk};
use crate::manifest::{State, Zero};
use crate::points::stand_onset_of;

/// What is wrong with a trial, by these criteria.
#[must_use]
pub fn judge(trial: &Trial, criteria: &Criteria) -> Verdict {
    let mut judge = Judge::new(criteria);
    let is_by_onset = trial.manifest.zero == Zero::Onset;
    let onset_s = is_by_onset.then(|| stand_onset_of(trial)).flatten();
    signs(&mut judge, trial, onset_s);
    time(&mut judge, trial, onset_s);
    packets(&mut judge, trial);
    for trunk in trunks(trial) {
        sight(&mut judge, &trial.frames, trunk);
        light(&mut judge, &trial.observed.views, trunk);
    }
    order(&mut judge, &trial.frames);
    judge.verdict()
}

fn signs(judge: &mut Judge<'_>, trial: &Trial, onset_s: Option<f64>) {
    let Trial { manifest, observed, frames, .. } = trial;
    let has_point = |frame: &Frame| Trunk::ALL.into_iter().any(|it| frame.point(it).is_some());
    let is_without = !frames.iter().any(has_point);
    judge.sign(
        is_without && trial.sees_a_target(),
        Sign::NoScene,
        "no frame has a position along the body's axes: the box did not know which way is forward",
        "while the camera stands where it stood: `plumb scene --out scene.toml`, then \
         `plumb replay TRIAL --tables --scene scene.toml`",
    );
    judge.sign(
        is_without && !trial.sees_a_target(),
        Sign::NoTarget,
        "neither trunk's target was seen in any frame",
        "aim the camera with `plumb aim` until both targets are seen, and record again",
    );
    judge.sign(
        trial.config.is_none(),
        Sign::NoConfiguration,
        "the box's configuration is not in the trial: uncertainties are not known",
        "copy the box's config.plb, as `plumb provision` wrote it, into the trial's folder, then \
         `plumb replay TRIAL --tables`",
    );
    judge.sign(
        observed.config_changed,
        Sign::ConfigurationChanged,
        "the box was given another configuration during the trial",
        "record again: positions before and after are not of one calibration",
    );
    judge.sign(
        manifest.zero == Zero::Mark && manifest.zero_mark().is_none(),
        Sign::NoMark,
        "t = 0 is to be a mark, and there is none: times count from the first frame",
        "if that is what was meant, write zero = \"start\" into trial.toml, or \"onset\" for the \
         moment of standing up",
    );
    judge.sign(
        manifest.zero == Zero::Onset && onset_s.is_none(),
        Sign::NoOnset,
        "t = 0 is to be the moment of standing up, and nobody rises",
        "write zero = \"mark\" or zero = \"start\" into trial.toml",
    );
    // Frames that the box replays have times that no clock gives.
    let is_live = manifest.instant.is_some_and(|it| it != MarkedInstant::Recording);
    // One relation for each run of the box, in their order.
    let is_related = |frame: &Frame| {
        manifest.clocks.binary_search_by_key(&frame.session, |clock| clock.session).is_ok()
    };
    judge.sign(
        is_live && !frames.iter().all(is_related),
        Sign::ClockUnrelated,
        "the box's clock was not related to this computer's in every run of the box: marks in such \
         a run are uncertain by 0.1 s",
        "check that the box hears this computer: `plumb doctor`",
    );
    judge.sign(
        observed.power.undervoltage == Some(true),
        Sign::Undervoltage,
        "the voltage of the box's power supply was too low",
        "use the official supply of 5.1 V and 3 A, and a shorter cable",
    );
    judge.sign(
        observed.power.throttled == Some(true),
        Sign::Throttled,
        "the box's processor was slowed down, by heat or by its power supply",
        "give the box air; `plumb doctor` tells its temperature",
    );
    judge.sign(
        manifest.state == State::Recording,
        Sign::CutOff,
        "the recording was cut off",
        "what was on the disk until then is right; record again if it is too short",
    );
}

/// How long, and how fast.
fn time(judge: &mut Judge<'_>, trial: &Trial, onset_s: Option<f64>) {
    // Times count from the first frame.
    let zero_s = match trial.manifest.zero {
        Zero::Start => 0.0,
        Zero::Mark => trial.manifest.zero_mark().map_or(0.0, |mark| mark.time_s),
        Zero::Onset => onset_s.unwrap_or(0.0),
    };
    judge.at_least(
        Figure {
            key: "duration_s",
            name: "from t = 0 to the last frame".to_owned(),
            found: (trial.frames.last().map_or(0.0, |frame| frame.time_s) - zero_s).max(0.0),
            unit: " s",
            remedy: "record for longer: the posturography standard of the ISPGR asks for 25 s",
        },
        |it| it.duration_s_min,
    );
    let Some(rate_hz) = trial.rate_hz() else { return };
    judge.at_least(
        Figure {
            key: "rate_hz",
            name: "frames per second of the camera, on average".to_owned(),
            found: rate_hz,
            unit: "",
            remedy: "give rate_hz in the box file, more light, or a \
                     shorter exposure: the posturography standard of the ISPGR asks for 50 Hz",
        },
        |it| it.rate_hz_min,
    );
    let capture = trial.config.as_ref().and_then(|config| config.capture.as_ref());
    if let Some(capture) = capture {
        judge.at_least(
            Figure {
                key: "rate_percent",
                name: format!("frames per second, of the {} that were asked for", capture.rate_hz),
                found: 100.0 * rate_hz / f64::from(capture.rate_hz),
                unit: " %",
                remedy: "find what slowed the camera or the box down: \
                         `plumb doctor`",
            },
            |it| it.rate_percent_min,
        );
    }
}

/// What came, from whom.
fn packets(judge: &mut Judge<'_>, trial: &Trial) {
    let observed = &trial.observed;
    if let Some(packets) = &trial.manifest.packets {
        let [frames, lost, corrupt] =
            [packets.frames, packets.lost, packets.corrupt].map(|it| it as f64);
        // Of nothing, nothing is lost.
        let percent = |part: f64, rest: f64| 100.0 * part / (part + rest).max(1.0);
        judge.at_most(
            Figure {
                key: "lost_percent",
                name: "frames lost on the way".to_owned(),
                found: percent(lost, frames),
                unit: " %",
                remedy: "use a cable, or bring the box nearer to the access point: `plumb doctor`",
            },
            |it| it.lost_percent_max,
        );
        judge.at_most(
            Figure {
                key: "corrupt_percent",
                name: "packets damaged on the way".to_owned(),
                found: percent(corrupt, frames),
                unit: " %",
                remedy: "check the serial line's cable and rate, or who else sends to this port",
            },
            |it| it.corrupt_percent_max,
        );
        judge.at_most(
            Figure {
                key: "starts",
                name: "starts of the box".to_owned(),
                found: f64::from(packets.sessions),
                unit: "",
                remedy: "check the box's power; times and positions across a start do not agree",
            },
            |it| it.starts_max,
        );
        judge.at_most(
            Figure {
                key: "conflicting",
                name: "packets of a second box that called itself this one, left out".to_owned(),
                found: packets.conflicting as f64,
                unit: "",
                remedy: "check that the trial is of the right box, and find the other one: each needs \
                         a serial number of its own",
            },
            |it| it.conflicting_max,
        );
        judge.at_most(
            Figure {
                key: "unknown_start",
                name: "poses of a sender that never said which box it is, left out".to_owned(),
                found: packets.unknown_start as f64,
                unit: "",
                remedy: "find out who else sends to this port; if it was the box, check its link",
            },
            |it| it.unknown_start_max,
        );
        judge.at_most(
            Figure {
                key: "implausible",
                name: "packets that cannot be true, left out".to_owned(),
                found: packets.implausible as f64,
                unit: "",
                remedy: "find out who else sends to this port, and check the box: `plumb doctor`",
            },
            |it| it.implausible_max,
        );
    }
    judge.at_most(
        Figure {
            key: "damaged_bytes",
            name: "bytes of packets.bin that belong to no packet".to_owned(),
            found: observed.damaged_bytes as f64,
            unit: "",
            remedy: "a cut-off recording ends with some; otherwise check the disk",
        },
        |it| it.damaged_bytes_max,
    );
    judge.at_most(
        Figure {
            key: "others",
            name: format!("other boxes that sent here too ({})", observed.others.join(", ")),
            found: observed.others.len() as f64,
            unit: "",
            remedy: "check that the trial is of the right box: its name is in trial.toml; give each \
                     box a port of its own",
        },
        |it| it.others_max,
    );
}

/// The trunks that the trial was to measure.
fn trunks(trial: &Trial) -> Vec<Trunk> {
    let is_wanted = |trunk: &Trunk| match &trial.config {
        Some(config) => config.targets.iter().any(|it| it.geometry.role() == trunk.role()),
        None => trial
            .frames
            .iter()
            .any(|frame| frame.point(*trunk).is_some() || frame.cam_from_target(*trunk).is_some()),
    };
    Trunk::ALL.into_iter().filter(is_wanted).collect()
}

/// How much of a trunk was seen, and how well its target fits.
fn sight(judge: &mut Judge<'_>, frames: &[Frame], trunk: Trunk) {
    let name = trunk.word();
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else { return };
    // Where there are axes, what counts is the point along them, and not the target alone.
    let has_axes = frames.iter().any(|frame| frame.upper.is_some() || frame.lower.is_some());
    let is_seen = |frame: &&Frame| match has_axes {
        true => frame.point(trunk).is_some(),
        false => frame.cam_from_target(trunk).is_some(),
    };
    let seen = frames.iter().filter(is_seen);
    judge.at_least(
        Figure {
            key: "poses_percent",
            name: format!("{name} trunk, frames in which it is seen"),
            found: 100.0 * seen.clone().count() as f64 / frames.len() as f64,
            unit: " %",
            remedy: "keep hair, clothes and hands off the target, and the target in the frame",
        },
        |it| it.poses_percent_min,
    );
    let all_s: Vec<f64> = frames.iter().map(|frame| frame.time_s).collect();
    if let Some(period_s) = usual_period_s(&all_s).filter(|period_s| *period_s > 0.0) {
        let seen_s = seen.map(|frame| frame.time_s);
        let times_s: Vec<f64> =
            [first.time_s].into_iter().chain(seen_s).chain([last.time_s]).collect();
        let steps_s = times_s.windows(2).map(|pair| pair[1] - pair[0]);
        let gaps_s: Vec<f64> = steps_s.filter(|step_s| *step_s > GAP_PERIODS * period_s).collect();
        judge.at_most(
            Figure {
                key: "gap_s",
                name: format!("{name} trunk, longest gap"),
                found: gaps_s.iter().copied().fold(0.0, f64::max),
                unit: " s",
                remedy: "analyse the time before or after it with --span, or record again",
            },
            |it| it.gap_s_max,
        );
        judge.at_most(
            Figure {
                key: "gaps_percent",
                name: format!("{name} trunk, all gaps together"),
                found: 100.0 * gaps_s.iter().sum::<f64>() / (last.time_s - first.time_s),
                unit: " % of the time",
                remedy: "find out what covered the target or lost the frames, and record again",
            },
            |it| it.gaps_percent_max,
        );
    }
    let at = usize::from(trunk == Trunk::Lower);
    if let Some(rms_px) = median(frames.iter().filter_map(|frame| frame.rms_px[at].map(f64::from)))
    {
        judge.at_most(
            Figure {
                key: "rms_px",
                name: format!("{name} target, corners off their place"),
                found: rms_px,
                unit: " px",
                remedy: "flatten the print, check its pitch_mm, or calibrate the camera again; then \
                         `plumb replay TRIAL --tables --camera FILE --targets FILE`",
            },
            |it| it.rms_px_max,
        );
    }
}

/// How its squares looked.
fn light(judge: &mut Judge<'_>, views: &[View], trunk: Trunk) {
    let name = trunk.word();
    let middle = |of: fn(&TargetView) -> f32| {
        let targets = views.iter().flat_map(|view| &view.targets);
        median(targets.filter(|it| it.role == trunk.role()).map(|it| f64::from(of(it))))
    };
    let remedy = "give more light, or expose for longer: `plumb aim --expose`";
    if let Some(found) = middle(|it| it.light - it.dark) {
        let name = format!("{name} target, contrast");
        judge.at_least(Figure { key: "contrast", name, found, unit: "", remedy }, |it| {
            it.contrast_min
        });
    }
    if let Some(found) = middle(|it| it.light) {
        let name = format!("{name} target, light squares, of the white level");
        judge.at_least(Figure { key: "light", name, found, unit: "", remedy }, |it| it.light_min);
    }
    if let Some(saturated) = middle(|it| it.saturated) {
        judge.at_most(
            Figure {
                key: "saturated_percent",
                name: format!("{name} target, light squares at the white level"),
                found: 100.0 * saturated,
                unit: " %",
                remedy: "expose for a shorter time, or lower the gain: `plumb aim --expose`",
            },
            |it| it.saturated_percent_max,
        );
    }
    if let Some(blur_px) = middle(|it| it.blur_px[0].max(it.blur_px[1])) {
        judge.at_most(
            Figure {
                key: "blur_px",
                name: format!("{name} target, blur of its edges"),
                found: blur_px,
                unit: " px",
                remedy: "focus the lens with `plumb aim` and calibrate it again, or expose for a \
                         shorter time if the person moved",
            },
            |it| it.blur_px_max,
        );
    }
}

/// Whether the upper trunk is above the lower.
fn order(judge: &mut Judge<'_>, frames: &[Frame]) {
    let heights = frames.iter().filter_map(|frame| {
        Some(frame.upper.as_ref()?.position_mm[2] - frame.lower.as_ref()?.position_mm[2])
    });
    if let Some(height_mm) = median(heights) {
        judge.at_least(
            Figure {
                key: "upper_above_lower_mm",
                name: "upper trunk above the lower".to_owned(),
                found: height_mm,
                unit: " mm",
                remedy: "if the roles in targets.toml were exchanged, correct them and give the file \
                         to the trial: `plumb replay TRIAL --tables --targets targets.toml`",
            },
            |it| it.upper_above_lower_mm_min,
        );
    }
}
