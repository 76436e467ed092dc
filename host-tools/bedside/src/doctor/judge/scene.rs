//! The scene: that it was measured, and that the camera has not been moved since.

use plumbline::config::Config;
use plumbline::pose::{Cam, Pose, Scene};
use plumbline::target::Role;
use plumbline_calibration::background::{REDUCTION, TURNED_FAIL_DEG, TURNED_WARN_DEG, Unclear};
use plumbline_calibration::scene::{Mean, between};

use super::super::check::{Check, Verdict};
use super::super::findings::{Background, Findings};

/// A camera that is moved by this is not turned yet, but was touched. The mean of a board's poses
/// is known to 0.1 mm.
const MOVED_FAIL_MM: f64 = 2.0;
const MOVED_WARN_MM: f64 = 1.0;

/// Fewer poses of the board are not judged.
const POSES_MIN: usize = 10;

const MEASURE: &str = "fix the camera, and measure the scene again with `plumb scene --store`";

pub fn checks(findings: &Findings, config: &Config) -> Vec<Check> {
    let Some(cam_from_scene) = config.cam_from_scene() else { return vec![missing(config)] };
    let mut checks = vec![Check::good("scene", "measured")];
    checks.extend(board(findings, &cam_from_scene));
    checks.extend(background(findings, config));
    checks
}

fn missing(config: &Config) -> Check {
    let has = |role| config.target(role).is_some();
    // One target alone may be there to be looked at; a person is measured along the body's axes.
    let is_trunk = has(Role::Lower) && has(Role::Upper);
    Check::new(
        if is_trunk { Verdict::Fail } else { Verdict::Warn },
        "scene",
        "not measured: there are poses, and no trunk points",
        "stand the board upright before the camera, and run `plumb scene --store`",
    )
}

/// A board that is in sight hangs where it hung, unless the camera was moved, or the board.
fn board(findings: &Findings, then: &Pose<Cam, Scene>) -> Option<Check> {
    let board = findings.target(Role::Scene)?;
    if board.poses.len() < POSES_MIN {
        return None;
    }
    let poses: Vec<_> = board.poses.iter().map(|pose| pose.cam_from_target()).collect();
    let (turned_deg, moved_mm) = between(then, &Mean::of(&poses).cam_from_scene);
    let turned = Verdict::at_most(turned_deg, TURNED_WARN_DEG, TURNED_FAIL_DEG);
    let moved = Verdict::at_most(moved_mm, MOVED_WARN_MM, MOVED_FAIL_MM);
    Some(Check::new(
        turned.max(moved),
        "scene board",
        format!(
            "{turned_deg:.2} degrees and {moved_mm:.1} mm from where it was measured (at most \
             {TURNED_WARN_DEG} and {MOVED_WARN_MM})"
        ),
        format!("{MEASURE}; if only the board was moved, take it out of sight"),
    ))
}

fn background(findings: &Findings, config: &Config) -> Option<Check> {
    const SUBJECT: &str = "background";
    let motion = match findings.background.as_ref()? {
        Background::NotCompared(why) => return Some(Check::skipped(SUBJECT, why)),
        Background::Compared(Ok(motion)) => motion,
        Background::Compared(Err(unclear)) => return Some(without(SUBJECT, *unclear)),
    };
    let focal_px = 0.5 * (config.lens.fx_px + config.lens.fy_px) / f64::from(REDUCTION);
    let turned_deg = motion.turned_deg(focal_px);
    let [x_px, y_px] = motion.shift_px.map(|shift| shift * f64::from(REDUCTION));
    Some(Check::new(
        Verdict::at_most(turned_deg, TURNED_WARN_DEG, TURNED_FAIL_DEG),
        SUBJECT,
        format!(
            "the camera is turned by {turned_deg:.2} degrees since the scene was measured (at most \
             {TURNED_WARN_DEG}): {x_px:.1} and {y_px:.1} px, by {} of {} parts of the small picture that the box sent",
            motion.agreeing, motion.blocks
        ),
        MEASURE,
    ))
}

/// Nothing can be said: that the background has changed altogether is worth a warning.
fn without(subject: &str, unclear: Unclear) -> Check {
    match unclear {
        Unclear::OtherSize => Check::skipped(subject, "its picture is of frames of another size"),
        Unclear::Plain { blocks } => Check::skipped(
            subject,
            format!("too plain to show a motion: {blocks} parts of the picture have structure"),
        ),
        Unclear::Unrecognised { blocks, agreeing } => Check::warn(
            subject,
            format!(
                "not recognised: {agreeing} of {blocks} parts of the picture are where they were"
            ),
            format!(
                "switch the light on, and uncover what stands behind the person; if the camera was \
                 moved, {MEASURE}"
            ),
        ),
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::MeasuredPose;
    use plumbline_calibration::background::Motion;

    use super::super::super::findings::TargetSeen;
    use super::super::super::fixture::{assert_says, check, healthy, pose, with_config};
    use super::*;

    #[test]
    fn a_person_without_a_scene_is_not_measured() {
        let person = with_config(|config| config.cam_from_scene_theta = None);
        let parts = ["no trunk points", "plumb scene --store"];
        assert_says(&check(&person, "scene"), Verdict::Fail, &parts);
        let one = with_config(|config| {
            config.cam_from_scene_theta = None;
            config.targets.pop();
        });
        assert_says(&check(&one, "scene"), Verdict::Warn, &parts);
    }

    /// A box that sees its scene board where it was measured, turned by this about y and moved
    /// along x.
    fn with_board(turned_deg: f64, moved_mm: f64) -> Findings {
        let theta = [0.02, -0.1, 0.03, 20.0, -80.0, 1400.0];
        let mut findings = with_config(|config| config.cam_from_scene_theta = Some(theta));
        let mut now = theta.map(|value| value as f32);
        now[1] += turned_deg.to_radians() as f32;
        now[3] += moved_mm as f32;
        let pose = MeasuredPose {
            theta_rad: [now[0], now[1], now[2]],
            translation_mm: [now[3], now[4], now[5]],
            ..pose()
        };
        let poses = vec![pose; 100];
        findings.targets.push(TargetSeen { role: Role::Scene, poses, without: Vec::new() });
        findings
    }

    #[test]
    fn a_board_that_hangs_elsewhere_shows_that_the_camera_was_moved() {
        let seen = |turned_deg, moved_mm| check(&with_board(turned_deg, moved_mm), "scene board");
        assert_says(&seen(0.0, 0.0), Verdict::Good, &["0.00 degrees and 0.0 mm"]);
        assert_says(&seen(0.15, 0.0), Verdict::Warn, &["0.15 degrees", "at most 0.1 and 1"]);
        assert_says(&seen(0.3, 0.0), Verdict::Fail, &["0.30 degrees", "plumb scene --store"]);
        assert_says(&seen(0.0, 1.5), Verdict::Warn, &["1.5 mm"]);
        assert_says(&seen(0.0, -2.5), Verdict::Fail, &["2.5 mm", "only the board was moved"]);
        assert!(!super::super::all(&healthy()).iter().any(|check| check.subject == "scene board"));
    }

    #[test]
    fn a_background_that_moved_shows_that_the_camera_was_turned() {
        let seen = |background| {
            let mut findings = healthy();
            findings.background = Some(background);
            check(&findings, "background")
        };
        let by = |x_px: f64, roll_deg: f64| {
            seen(Background::Compared(Ok(Motion {
                shift_px: [x_px / f64::from(REDUCTION), 0.0],
                roll_rad: roll_deg.to_radians(),
                scale: 1.0,
                blocks: 120,
                agreeing: 60,
            })))
        };
        // 9.11 px are 0.3 degrees at f 1740 px.
        assert_says(
            &by(9.11, 0.0),
            Verdict::Fail,
            &["0.30 degrees", "9.1 and 0.0 px", "60 of 120"],
        );
        assert_says(&by(0.0, 0.3), Verdict::Fail, &["0.30 degrees", "plumb scene --store"]);
        assert_says(&by(4.6, 0.0), Verdict::Warn, &["0.15 degrees", "at most 0.1"]);
        assert_says(&by(1.0, 0.0), Verdict::Good, &["0.03 degrees"]);
        let refused = Background::NotCompared("the box refuses set-up mode: not now".into());
        assert_says(&seen(refused), Verdict::Skipped, &["refuses set-up mode"]);
        let plain = Background::Compared(Err(Unclear::Plain { blocks: 3 }));
        assert_says(&seen(plain), Verdict::Skipped, &["too plain", "3 parts"]);
        let dark = Background::Compared(Err(Unclear::Unrecognised { blocks: 90, agreeing: 2 }));
        assert_says(&seen(dark), Verdict::Warn, &["2 of 90", "switch the light on"]);
    }
}
