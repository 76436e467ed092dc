//! That lengths are true: one camera sees a large print far away as it sees a small one nearby, so
//! that a print of 13 mm that is described as one of 12 shows everything 8 % too short, and passes
//! every other check. Somebody has to tell one length: the distance to a target, by a tape.
//!
//! The tape begins at the front of the lens; the box measures from the entrance pupil behind it.
//! The bound is on the sum of what either may be wrong by. From [`TAPE_MM_MIN`] on it tells a pitch
//! of 12 mm from one of 13 in every case, and fails no scale that is right to 0.5 %. A print that was
//! scaled to the page, by 3 %, is the ruler's matter.

use plumbline::config::{Config, TargetConfig};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::Role;

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;
use crate::scale::Compared;

/// What is looked at.
pub const SUBJECT: &str = "scale";

/// The shortest distance by the tape that is compared.
pub const TAPE_MM_MIN: f64 = 850.0;

/// The longest.
pub const TAPE_MM_MAX: f64 = 10_000.0;

/// From the front of a lens to its entrance pupil: somewhere in the first 40 mm, whatever the lens.
const PUPIL_MM: f64 = 20.0;
const PUPIL_ERROR_MM: f64 = 20.0;

/// What a tape that is held by hand from a lens to a print is wrong by.
const TAPE_ERROR_MM: f64 = 10.0;

/// What a good print and a good calibration are wrong by, as a share of the distance.
const SHARE_ERROR: f64 = 0.005;

/// Fewer poses are not judged.
const POSES_MIN: usize = 10;

/// Pitches that differ by less than this share are one: they come from one file or one sheet.
const SAME_PITCH: f64 = 1e-9;

/// A distance that a person has measured.
#[derive(Debug, Clone)]
pub struct Tape {
    /// To which target; the lower one where it is not said.
    pub target: Option<String>,
    /// From the front of the lens to the target's middle.
    pub distance_mm: f64,
}

/// A target's distance, by the box and by the tape.
#[derive(Debug)]
pub struct Comparison<'a> {
    /// The target.
    pub target: &'a TargetConfig,
    /// By the tape, from the front of the lens.
    pub tape_mm: f64,
    /// By the box, from the lens's pupil.
    pub measured_mm: f64,
}

impl Comparison<'_> {
    /// By the tape, from the lens's pupil.
    fn expected_mm(&self) -> f64 {
        self.tape_mm + PUPIL_MM
    }

    /// How far both may be apart.
    fn bound_mm(&self) -> f64 {
        let error_mm = PUPIL_ERROR_MM + TAPE_ERROR_MM;
        error_mm + SHARE_ERROR * (self.expected_mm() + error_mm)
    }

    /// Whether lengths are true, as far as this tells.
    pub fn agrees(&self) -> bool {
        (self.measured_mm - self.expected_mm()).abs() <= self.bound_mm()
    }

    /// The targets of one sheet with this one: a comparison of any of them counts for all.
    pub fn sheet<'c>(&self, config: &'c Config) -> impl Iterator<Item = &'c TargetConfig> {
        trunk_targets(config).filter(|it| of_one_sheet(it, self.target))
    }

    fn check(&self) -> Check {
        let Self { target, tape_mm, measured_mm } = self;
        let name = target.name.as_str();
        let compared = format!(
            "\"{name}\" is {measured_mm:.0} mm away by the box, and {:.0} by the tape, {tape_mm:.0} and \
             {PUPIL_MM:.0} within the lens (at most {:.0} apart)",
            self.expected_mm(),
            self.bound_mm()
        );
        if self.agrees() {
            return Check::good(SUBJECT, compared);
        }
        let too_long = measured_mm / self.expected_mm() - 1.0;
        let is = if too_long > 0.0 { "long" } else { "short" };
        let pitch_mm = target.geometry.pitch_mm();
        let percent = 100.0 * too_long.abs();
        // No more digits than a tape knows.
        Check::fail(
            SUBJECT,
            format!(
                "{compared}: lengths are about {percent:.0} % too {is}; pitch_mm of \"{name}\" is {pitch_mm:.2}, \
                 and about {:.1} would fit",
                pitch_mm / (1.0 + too_long)
            ),
            "measure the print with a ruler over many squares, correct pitch_mm in targets.toml and send \
             it with `plumb provision --send`; a trial that is recorded already is put right by `plumb \
             replay FOLDER --tables --targets targets.toml`. If the ruler agrees with pitch_mm, measure \
             with the tape again, and calibrate the camera again",
        )
    }
}

/// `None` without a tape, where the box is not calibrated yet, or looks for no trunk's target.
pub fn check(findings: &Findings) -> Option<Check> {
    let config = calibrated(findings);
    let Some(tape) = &findings.tape else { return remembered(findings, config?) };
    let comparison = comparison(findings).map(|it| it.check());
    Some(comparison.unwrap_or_else(|| not_compared(config, tape)))
}

fn calibrated(findings: &Findings) -> Option<&Config> {
    findings.config().filter(|_| findings.is_calibrated())
}

/// What the box sees of the target to which the tape was held; `None` where that is too little.
pub fn comparison(findings: &Findings) -> Option<Comparison<'_>> {
    let tape = findings.tape.as_ref()?;
    let target = taped(calibrated(findings)?, tape)?;
    let seen = findings.target(target.geometry.role())?;
    if seen.poses.len() < POSES_MIN {
        return None;
    }
    let middle_mm = target.geometry.middle_mm();
    let distance_mm = |pose: &Pose<Cam, Target>| -> f64 { pose.transform(&middle_mm).norm() };
    let sum_mm: f64 = seen.poses.iter().map(|pose| distance_mm(&pose.cam_from_target())).sum();
    let measured_mm = sum_mm / seen.poses.len() as f64;
    Some(Comparison { target, tape_mm: tape.distance_mm, measured_mm })
}

/// The trunks' targets: the scene board's size moves the origin of the body's axes, and no figure.
fn trunk_targets(config: &Config) -> impl Iterator<Item = &TargetConfig> {
    config.targets.iter().filter(|target| target.geometry.role() != Role::Scene)
}

/// The target that is compared unless another is named.
fn usual(config: &Config) -> Option<&TargetConfig> {
    config.target(Role::Lower).or_else(|| trunk_targets(config).next())
}

/// Targets of one pitch are taken to be of one sheet.
fn of_one_sheet(one: &TargetConfig, other: &TargetConfig) -> bool {
    let [one_mm, other_mm] = [one, other].map(|it| it.geometry.pitch_mm());
    (one_mm - other_mm).abs() <= SAME_PITCH * one_mm
}

fn taped<'a>(config: &'a Config, tape: &Tape) -> Option<&'a TargetConfig> {
    match &tape.target {
        Some(name) => trunk_targets(config).find(|target| target.name == name.as_str()),
        None => usual(config),
    }
}

fn not_compared(config: Option<&Config>, tape: &Tape) -> Check {
    let Some(config) = config else {
        return Check::fail(
            SUBJECT,
            "not compared: the box's targets and its calibrated camera are not known",
            "calibrate the camera, and reach the box over a link on which it answers",
        );
    };
    match taped(config, tape) {
        Some(target) => Check::fail(
            SUBJECT,
            format!("\"{}\" is not seen, so that its distance cannot be compared", target.name),
            "bring it into the picture, or name another target with --distance-to",
        ),
        None => {
            let names: Vec<&str> = trunk_targets(config).map(|it| it.name.as_str()).collect();
            Check::fail(
                SUBJECT,
                "the target of --distance-to is none of the trunk's",
                format!("the box looks for: {}", names.join(", ")),
            )
        }
    }
}

/// What was compared before.
fn remembered(findings: &Findings, config: &Config) -> Option<Check> {
    let compared = |target: &TargetConfig| -> Option<&Compared> {
        let role = target.geometry.role();
        findings.compared.iter().find(|(is, _)| *is == role).map(|(_, compared)| compared)
    };
    let is_known = |target: &&TargetConfig| {
        trunk_targets(config).any(|it| compared(it).is_some() && of_one_sheet(target, it))
    };
    let mut targets = usual(config).into_iter().chain(trunk_targets(config));
    if let Some(target) = targets.find(|it| !is_known(it)) {
        let is_usual = usual(config).is_some_and(|it| it.name == target.name);
        let which =
            if is_usual { String::new() } else { format!(" --distance-to {}", target.name) };
        return Some(Check::warn(
            SUBJECT,
            format!(
                "nobody has compared the distance of \"{}\" with a tape: a wrong pitch_mm shows in \
                 nothing else",
                target.name
            ),
            format!(
                "measure from the front of the lens to its middle, {TAPE_MM_MIN:.0} mm or more, and run \
                 `plumb doctor --distance-mm MM{which}`, once for each print"
            ),
        ));
    }
    let seen = trunk_targets(config).filter_map(|target| {
        let Compared { date, tape_mm, measured_mm } = compared(target)?;
        let name = target.name.as_str();
        Some(format!(
            "\"{name}\" was compared with a tape on {date}: {measured_mm:.0} mm by the box, {:.0} by the tape",
            tape_mm + PUPIL_MM
        ))
    });
    let seen: Vec<String> = seen.collect();
    (!seen.is_empty()).then(|| Check::new(Verdict::Good, SUBJECT, seen.join("; "), ""))
}

#[cfg(test)]
mod tests {
    use plumbline::target::{Origin, TargetGeometry};

    use super::super::super::fixture::{assert_says, check, healthy};
    use super::*;

    /// A box that was told a pitch of 12 mm, and sees the lower target at this distance.
    fn at(measured_mm: f64, tape_mm: f64) -> Findings {
        let mut findings = healthy();
        let lower = findings.targets.iter_mut().find(|target| target.role == Role::Lower).unwrap();
        for pose in &mut lower.poses {
            pose.translation_mm = [0.0, 0.6 * measured_mm as f32, 0.8 * measured_mm as f32];
        }
        findings.tape = Some(Tape { target: None, distance_mm: tape_mm });
        findings
    }

    #[test]
    fn a_pitch_of_12_for_one_of_13_is_found_and_the_one_that_fits_is_named() {
        assert_says(
            &check(&at(1046.0, 1030.0), SUBJECT),
            Verdict::Good,
            &["1046 mm away by the box, and 1050 by the tape", "at most 35 apart"],
        );
        // Printed at 13 mm, 1050 mm away.
        assert_says(
            &check(&at(1050.0 * 12.0 / 13.0, 1030.0), SUBJECT),
            Verdict::Fail,
            &[
                "969 mm away by the box, and 1050 by the tape, 1030 and 20 within the lens",
                "lengths are about 8 % too short",
                "pitch_mm of \"lumbar\" is 12.00, and about 13.0 would fit",
                "plumb provision --send",
                "plumb replay FOLDER --tables --targets targets.toml",
            ],
        );
        let other = check(&at(1050.0 * 12.0 / 11.0, 1030.0), SUBJECT);
        assert_says(&other, Verdict::Fail, &["about 9 % too long", "about 11.0 would fit"]);
    }

    /// Whatever the lens, and however the tape was held.
    #[test]
    fn the_bound_finds_a_wrong_pitch_in_every_case_and_fails_no_right_one() {
        let config = healthy().config.unwrap().unwrap();
        let target = config.target(Role::Lower).unwrap();
        let agrees = |tape_mm: f64, pupil_mm: f64, tape_error_mm: f64, factor: f64| {
            let measured_mm = (tape_mm + tape_error_mm + pupil_mm) * factor;
            Comparison { target, tape_mm, measured_mm }.agrees()
        };
        for tape_mm in [TAPE_MM_MIN, 1000.0, 3000.0, TAPE_MM_MAX] {
            for (pupil_mm, tape_error_mm) in [(0.0, -10.0), (20.0, 0.0), (40.0, 10.0)] {
                for share in [-0.00499, 0.0, 0.00499] {
                    let agrees = |told, printed| {
                        agrees(tape_mm, pupil_mm, tape_error_mm, (1.0 + share) * told / printed)
                    };
                    assert!(agrees(12.0, 12.0), "{tape_mm} {pupil_mm} {share}");
                    assert!(!agrees(12.0, 13.0), "{tape_mm} {pupil_mm} {share}");
                    assert!(!agrees(13.0, 12.0), "{tape_mm} {pupil_mm} {share}");
                }
            }
        }
        // Nearer than that a wrong pitch might pass.
        assert!(agrees(TAPE_MM_MIN - 50.0, 40.0, 10.0, 1.005 * 12.0 / 13.0));
    }

    #[test]
    fn a_tape_to_a_target_that_is_not_there_is_a_failure() {
        let mut findings = at(1046.0, 1030.0);
        findings.tape.as_mut().unwrap().target = Some("elbow".to_owned());
        let parts = ["--distance-to", "the box looks for: lumbar, shoulder"];
        assert_says(&check(&findings, SUBJECT), Verdict::Fail, &parts);
        findings.tape = Some(Tape { target: Some("shoulder".to_owned()), distance_mm: 980.0 });
        assert_says(&check(&findings, SUBJECT), Verdict::Good, &["\"shoulder\" is 1000 mm away"]);
        findings.targets.retain(|target| target.role != Role::Upper);
        let parts = ["\"shoulder\" is not seen", "into the picture"];
        assert_says(&check(&findings, SUBJECT), Verdict::Fail, &parts);
    }

    #[test]
    fn without_a_tape_it_is_remembered_or_asked_for() {
        let findings = healthy();
        let parts = ["\"lumbar\" was compared with a tape on 2026-11-24: 1046 mm by the box"];
        assert_says(&check(&findings, SUBJECT), Verdict::Good, &parts);
        let never = Findings { compared: Vec::new(), ..healthy() };
        let parts = ["nobody has compared", "\"lumbar\"", "`plumb doctor --distance-mm MM`"];
        assert_says(&check(&never, SUBJECT), Verdict::Warn, &parts);

        // A print of another pitch is of another sheet.
        let mut findings = healthy();
        let config = findings.config.as_mut().unwrap().as_mut().unwrap();
        let upper = config.targets.iter_mut().find(|it| it.geometry.role() == Role::Upper).unwrap();
        let origin = Origin::Center;
        upper.geometry =
            TargetGeometry::checker(5, 4, 13.0, origin, Role::Upper, [0.0; 3]).unwrap();
        let parts =
            ["\"shoulder\" with a tape", "`plumb doctor --distance-mm MM --distance-to shoulder`"];
        assert_says(&check(&findings, SUBJECT), Verdict::Warn, &parts);
        let compared = findings.compared[0].1.clone();
        findings.compared.push((Role::Upper, compared));
        assert_says(&check(&findings, SUBJECT), Verdict::Good, &["lumbar", "; \"shoulder\" was"]);
    }

    /// Otherwise the comparison of one would go on to speak for the other, which has failed.
    #[test]
    fn a_comparison_that_fails_is_of_the_whole_sheet() {
        let mut findings = at(969.0, 1030.0);
        let names = |findings: &Findings| -> Vec<String> {
            let comparison = comparison(findings).unwrap();
            assert!(!comparison.agrees());
            let config = findings.config().unwrap();
            comparison.sheet(config).map(|it| it.name.to_string()).collect()
        };
        assert_eq!(names(&findings), ["lumbar", "shoulder"]);
        let config = findings.config.as_mut().unwrap().as_mut().unwrap();
        let upper = config.targets.iter_mut().find(|it| it.geometry.role() == Role::Upper).unwrap();
        let origin = Origin::Center;
        upper.geometry =
            TargetGeometry::checker(5, 4, 13.0, origin, Role::Upper, [0.0; 3]).unwrap();
        assert_eq!(names(&findings), ["lumbar"]);
    }

    #[test]
    fn before_the_calibration_there_is_no_distance() {
        let mut findings = healthy();
        let Some(Ok(config)) = &mut findings.config else { panic!("a healthy box tells it") };
        config.lens = plumbline_files::camera::stand_in(config.lens.width_px, 1088);
        assert_eq!(super::check(&findings), None);
        // Whoever has measured is told.
        findings.tape = Some(Tape { target: None, distance_mm: 1030.0 });
        assert_says(&check(&findings, SUBJECT), Verdict::Fail, &["not compared", "calibrate"]);
        findings.config = None;
        assert_says(&check(&findings, SUBJECT), Verdict::Fail, &["not compared", "answers"]);
    }
}
