//! That the upper target is the upper one: two targets whose roles are exchanged are measured as
//! well as before, and every figure of the upper trunk is then one of the lower.

use nalgebra::Vector3;
use plumbline::scene::SceneFrame;
use plumbline::target::Role;
use plumbline_analysis::statistics::describe::median;

use super::super::check::{Check, Verdict};
use super::super::findings::{Findings, TargetSeen};

/// From the lower back up to the shoulder it is some 350 mm of a standing adult, and 150 of a small
/// child; a leaning or a sitting person leaves more than this.
const ABOVE_MIN_MM: f64 = 50.0;

const SUBJECT: &str = "upper above lower";

/// `None` where not both are seen.
pub fn check(findings: &Findings) -> Option<Check> {
    let seen = |role| findings.target(role).filter(|target| !target.poses.is_empty());
    let (upper, lower) = (seen(Role::Upper)?, seen(Role::Lower)?);
    let scene = findings.config().and_then(|config| config.cam_from_scene()).map(SceneFrame::new);
    let height_mm = |target: &TargetSeen| {
        let heights = target.poses.iter().map(|pose| {
            let cam_from_origin_mm = Vector3::from(pose.translation_mm.map(f64::from));
            match &scene {
                Some(scene) => scene.anatomical(&cam_from_origin_mm).si_mm,
                None => -cam_from_origin_mm.y,
            }
        });
        median(heights).unwrap_or_default()
    };
    let above_mm = height_mm(upper) - height_mm(lower);
    // Without a scene up is only what is up in the picture, and a camera may lie on its side.
    let bad = if scene.is_some() { Verdict::Fail } else { Verdict::Warn };
    let along = if scene.is_some() { "along SI" } else { "in the picture" };
    let side = if above_mm < 0.0 { "below" } else { "above" };
    let [upper, lower] = [Role::Upper, Role::Lower].map(|role| findings.name(role));
    Some(Check::new(
        if above_mm < ABOVE_MIN_MM { bad } else { Verdict::Good },
        SUBJECT,
        format!(
            "\"{upper}\" is {:.0} mm {side} \"{lower}\" {along} (at least {ABOVE_MIN_MM:.0} above)",
            above_mm.abs()
        ),
        "exchange role = \"upper\" and role = \"lower\" in the targets file and send it with `plumb \
         provision --send`, or exchange the prints on the person: \"upper\" belongs on the shoulder",
    ))
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{assert_says, check, healthy, with_config};
    use super::*;

    fn exchange(findings: &mut Findings) {
        for target in &mut findings.targets {
            target.role = match target.role {
                Role::Upper => Role::Lower,
                Role::Lower => Role::Upper,
                Role::Scene => Role::Scene,
            };
        }
    }

    #[test]
    fn exchanged_targets_are_a_failure_that_names_the_fields() {
        let mut findings = healthy();
        assert_says(&check(&findings, SUBJECT), Verdict::Good, &["300 mm above", "along SI"]);
        exchange(&mut findings);
        let parts = ["is 300 mm below", "at least 50 above", "role = \"upper\"", "targets file"];
        assert_says(&check(&findings, SUBJECT), Verdict::Fail, &parts);
    }

    #[test]
    fn without_a_scene_the_picture_alone_may_deceive() {
        let mut findings = with_config(|config| config.cam_from_scene_theta = None);
        assert_says(&check(&findings, SUBJECT), Verdict::Good, &["in the picture"]);
        exchange(&mut findings);
        assert_says(&check(&findings, SUBJECT), Verdict::Warn, &["300 mm below", "exchange"]);
    }

    /// The scene says where up is, however the camera hangs: here upside down.
    #[test]
    fn the_scene_knows_up() {
        let turn = |config: &mut plumbline::config::Config| {
            config.cam_from_scene_theta = Some([std::f64::consts::PI, 0.0, 0.0, 0.0, 0.0, 1000.0]);
        };
        assert_eq!(check(&with_config(turn), SUBJECT).verdict, Verdict::Fail);
        let mut findings = with_config(turn);
        exchange(&mut findings);
        assert_eq!(check(&findings, SUBJECT).verdict, Verdict::Good);
    }

    #[test]
    fn a_target_that_is_not_seen_is_neither_above_nor_below() {
        let mut findings = healthy();
        findings.targets[0].poses.clear();
        assert_eq!(super::check(&findings), None);
    }
}
