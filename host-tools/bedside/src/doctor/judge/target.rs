//! The targets: how often they are found, and how well.

use plumbline::packet::MeasuredPose;
use plumbline::target::Role;
use plumbline_analysis::statistics::describe::median;
use plumbline_files::counting::counted;

use super::super::check::{Check, Verdict};
use super::super::findings::{Findings, TargetSeen};
use super::percent;
use crate::bounds::{COVERAGE, PITCH_PX_MIN};
use crate::missing::{self, Missing};

/// A person at rest hides no target: below this something is amiss now and then.
const SHARE_WARN: f64 = 0.99;

/// One frame in ten is missing: gaps are too long to be filled.
const SHARE_FAIL: f64 = 0.9;

/// Photographs of a board by a camera that is calibrated for it leave 0.14 px.
const RMS_WARN_PX: f64 = 0.3;

/// No pose is given above 1 px; at half of that the print does not lie as it is described.
const RMS_FAIL_PX: f64 = 0.6;

/// Twice what the size and the distance of the standard scene's targets promise.
const DEPTH_WARN_MM: f64 = 0.1;

/// No better than the published method, which this one replaces.
const DEPTH_FAIL_MM: f64 = 0.52;

/// The search finds no smaller grid.
const PITCH_FAIL_PX: f64 = 7.0;

/// Corners that are hidden in this share of the frames are not a passing hand.
const HIDDEN_WARN: f64 = 0.5;

/// Where no search has come to its end.
const WATCH_LONGER: &str = "watch for longer with --seconds";

pub fn checks(findings: &Findings) -> Vec<Check> {
    if findings.targets.is_empty() {
        return vec![Check::skipped("poses", "no frame came")];
    }
    findings.targets.iter().flat_map(|target| of_one(findings, target)).collect()
}

fn of_one(findings: &Findings, target: &TargetSeen) -> Vec<Check> {
    let name = findings.name(target.role);
    let is_other_measured = findings.measures_another(target.role);
    let mut checks = vec![share(&name, target, is_other_measured)];
    if target.poses.is_empty() {
        return checks;
    }
    if findings.is_calibrated() {
        checks.push(corners(findings, &name, target));
        checks.extend(precision(&name, target));
    } else {
        // Corners that an unknown lens displaces are left out of the pose as if they were hidden.
        let skipped =
            |what| Check::skipped(format!("{name} {what}"), "the camera is not calibrated yet");
        checks.extend(["corners", "fit"].map(skipped));
    }
    checks.extend(size(findings, &name, target.role));
    checks
}

/// How well the corners fit the target, and the distance that they promise.
fn precision(name: &str, target: &TargetSeen) -> [Check; 2] {
    let middle = |of: fn(&MeasuredPose) -> f32| {
        median(target.poses.iter().map(|pose| f64::from(of(pose)))).unwrap_or_default()
    };
    let rms_px = middle(|pose| pose.rms_px);
    let fit = Check::new(
        Verdict::at_most(rms_px, RMS_WARN_PX, RMS_FAIL_PX),
        format!("{name} fit"),
        format!("{rms_px:.3} px (at most {RMS_WARN_PX})"),
        "flatten the print; check its pitch_mm with a ruler; calibrate the camera again if its \
         lens was touched",
    );
    let [x_mm, y_mm, z_mm] =
        [middle(|pose| pose.sd_mm[0]), middle(|pose| pose.sd_mm[1]), middle(|pose| pose.sd_mm[2])]
            .map(|sd_mm| f64::from(COVERAGE) * sd_mm);
    let distance_mm =
        middle(|pose| pose.translation_mm.map(|it| it * it).iter().sum::<f32>().sqrt());
    let depth = Check::new(
        Verdict::at_most(z_mm, DEPTH_WARN_MM, DEPTH_FAIL_MM),
        format!("{name} depth"),
        format!(
            "+-{z_mm:.3} mm promised (at most {DEPTH_WARN_MM}); x +-{x_mm:.3}, y +-{y_mm:.3}; \
             {distance_mm:.0} mm from the camera"
        ),
        "go nearer, give more light, focus, or print the target larger",
    );
    [fit, depth]
}

fn share(name: &str, target: &TargetSeen, is_other_measured: bool) -> Check {
    let subject = format!("{name} poses");
    let (poses, frames) = (target.poses.len(), target.frames());
    let share = poses as f64 / frames as f64;
    let mut seen = format!("in {poses} of {}", counted(frames, "frame"));
    let most = missing::most(target.without.iter().copied());
    let most = most.map(|(why, frames)| (Missing::new(why, is_other_measured), frames));
    if target.role == Role::Scene {
        // It is there for `plumb scene` alone, and away during trials.
        let away = if poses == 0 { "; needed for `plumb scene` only" } else { "" };
        return Check::good(subject, seen + away);
    }
    if let Some((missing, count)) = most {
        seen = format!("{seen}; {} in {count}", missing.words());
    }
    seen = format!("{seen} (at least {})", percent(SHARE_WARN));
    let remedy = most.map_or("", |(missing, _)| missing.remedy().unwrap_or(WATCH_LONGER));
    Check::new(Verdict::at_least(share, SHARE_WARN, SHARE_FAIL), subject, seen, remedy)
}

fn corners(findings: &Findings, name: &str, target: &TargetSeen) -> Check {
    let subject = format!("{name} corners");
    let told = findings.hello.iter().flat_map(|hello| &hello.targets);
    let most = target.poses.iter().map(|pose| pose.corners).max().unwrap_or_default();
    let total =
        told.into_iter().find(|told| told.role == target.role).map_or(most, |told| told.corners);
    let hidden = target.poses.iter().filter(|pose| pose.corners < total).count();
    let fewest = target.poses.iter().map(|pose| pose.corners).min().unwrap_or_default();
    let share = hidden as f64 / target.poses.len() as f64;
    let seen = if hidden == 0 {
        format!("all {total} used")
    } else {
        format!("some of {total} hidden in {} of the poses, {fewest} left", percent(share))
    };
    let verdict = Verdict::warn_if(share > HIDDEN_WARN);
    Check::new(verdict, subject, seen, "uncover the target; check that no side of it is in shadow")
}

fn size(findings: &Findings, name: &str, role: Role) -> Option<Check> {
    let targets = findings.views.iter().flat_map(|view| &view.targets);
    let pitches = targets.filter(|target| target.role == role).map(|it| f64::from(it.pitch_px));
    let pitch_px = median(pitches)?;
    Some(Check::new(
        Verdict::at_least(pitch_px, PITCH_PX_MIN.into(), PITCH_FAIL_PX),
        format!("{name} size"),
        format!("{pitch_px:.1} px from corner to corner (at least {PITCH_PX_MIN:.0})"),
        "go nearer, take a longer lens, or print the target larger",
    ))
}

#[cfg(test)]
mod tests {
    use plumbline::report::GridRejection;
    use plumbline::report::NoPose;

    use super::super::super::fixture::{assert_says, check, healthy};
    use super::*;
    use plumbline_files::camera;

    /// The lumbar target, changed.
    fn with(change: impl FnOnce(&mut TargetSeen)) -> Findings {
        let mut findings = healthy();
        let lumbar = findings.targets.iter_mut().find(|target| target.role == Role::Lower);
        change(lumbar.unwrap());
        findings
    }

    #[test]
    fn a_target_that_is_not_found_is_named_with_the_reason_and_the_remedy() {
        let rejected = NoPose::NotFound(GridRejection::Cut);
        let without = |poses: usize| {
            with(|target| {
                target.poses.truncate(poses);
                // A search takes some frames, and says why only at its end.
                target.without = vec![(NoPose::Searching, 300 - poses - 6), (rejected, 6)];
            })
        };
        let few = check(&without(280), "lumbar poses");
        assert_says(
            &few,
            Verdict::Warn,
            &["280 of 300", "cut by the frame in 6", "move the camera"],
        );
        let none = without(0);
        let failure = check(&none, "lumbar poses");
        assert_says(&failure, Verdict::Fail, &["0 of 300", "at least 99.0 %", "move the camera"]);
        assert!(!super::super::all(&none).iter().any(|check| check.subject == "lumbar depth"));
        let none = Findings { targets: Vec::new(), ..healthy() };
        assert_says(&check(&none, "poses"), Verdict::Skipped, &["no frame"]);
    }

    #[test]
    fn a_scene_board_may_be_away() {
        let mut findings = healthy();
        let without = vec![(NoPose::Searching, 300)];
        findings.targets.push(TargetSeen { role: Role::Scene, poses: Vec::new(), without });
        assert_says(&check(&findings, "scene poses"), Verdict::Good, &["0 of 300", "plumb scene"]);
    }

    #[test]
    fn every_reason_has_a_remedy() {
        for reason in [
            NoPose::FrameSize,
            NoPose::Searching,
            NoPose::NotFound(GridRejection::NoLattice),
            NoPose::NotFound(GridRejection::OtherDimensions),
            NoPose::NotFound(GridRejection::Incomplete),
            NoPose::NotFound(GridRejection::GoesOn),
            NoPose::NotFound(GridRejection::Ambiguous),
            NoPose::TooFewCorners,
            NoPose::ExtentUnknown,
            NoPose::PoorFit,
        ] {
            let mut findings = with(|target| target.without = vec![(reason, 300)]);
            findings.targets.iter_mut().for_each(|target| target.poses.clear());
            assert_says(&check(&findings, "lumbar poses"), Verdict::Fail, &[reason.words()]);
            assert!(check(&findings, "lumbar poses").remedy.len() > 20);
        }
    }

    #[test]
    fn a_target_that_is_away_while_another_is_measured_has_no_wrong_count_of_corners() {
        let away = with(|target| {
            target.poses.clear();
            target.without = vec![(NoPose::NotFound(GridRejection::OtherDimensions), 300)];
        });
        let parts = ["not in the picture in 300", "bring the target"];
        assert_says(&check(&away, "lumbar poses"), Verdict::Fail, &parts);
    }

    #[test]
    fn before_the_calibration_nothing_is_said_of_corners_fit_or_distance() {
        let mut findings = healthy();
        let Some(Ok(config)) = &mut findings.config else { panic!("a healthy box tells it") };
        config.lens = camera::stand_in(config.lens.width_px, config.lens.height_px);
        for poses in findings.targets.iter_mut().map(|target| &mut target.poses) {
            poses.iter_mut().for_each(|pose| pose.corners = 12);
        }
        for subject in ["lumbar fit", "lumbar corners"] {
            assert_says(&check(&findings, subject), Verdict::Skipped, &["not calibrated"]);
        }
        assert!(!super::super::all(&findings).iter().any(|check| check.subject == "lumbar depth"));
    }

    #[test]
    fn how_well_a_target_is_seen() {
        let all =
            |change: fn(&mut MeasuredPose)| with(|target| target.poses.iter_mut().for_each(change));
        let hidden = all(|pose| pose.corners = 24);
        let corners = check(&hidden, "lumbar corners");
        assert_says(&corners, Verdict::Warn, &["some of 30 hidden in 100.0 %", "24 left"]);
        let bent = all(|pose| pose.rms_px = 0.4);
        assert_says(&check(&bent, "lumbar fit"), Verdict::Warn, &["0.400 px", "flatten"]);
        let wrong = all(|pose| pose.rms_px = 0.8);
        assert_says(&check(&wrong, "lumbar fit"), Verdict::Fail, &["pitch_mm"]);
        let far = all(|pose| pose.sd_mm[2] = 0.1);
        let depth = check(&far, "lumbar depth");
        assert_says(&depth, Verdict::Warn, &["+-0.196 mm", "at most 0.1", "nearer"]);
        // Up to what the published method reaches, 0.52 mm.
        let farther = all(|pose| pose.sd_mm[2] = 0.26);
        assert_says(&check(&farther, "lumbar depth"), Verdict::Warn, &["+-0.510 mm"]);
        let farthest = all(|pose| pose.sd_mm[2] = 0.27);
        assert_says(&check(&farthest, "lumbar depth"), Verdict::Fail, &["+-0.529 mm", "light"]);
        let too_far = all(|pose| pose.sd_mm[2] = 0.3);
        assert_says(&check(&too_far, "lumbar depth"), Verdict::Fail, &["+-0.588 mm"]);
    }

    #[test]
    fn a_target_that_is_too_small_is_named() {
        let of = |pitch_px| {
            let mut findings = healthy();
            for target in findings.views.iter_mut().flat_map(|view| &mut view.targets) {
                target.pitch_px = pitch_px;
            }
            check(&findings, "shoulder size")
        };
        assert_says(&of(10.0), Verdict::Warn, &["10.0 px", "at least 15", "nearer"]);
        assert_says(&of(6.0), Verdict::Fail, &["6.0 px", "larger"]);
    }
}
