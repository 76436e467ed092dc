//! The light on the targets, and how sharp they are.

use plumbline::packet::TargetView;

use super::super::check::{Check, Verdict};
use super::super::findings::{Findings, median};
use super::percent;

/// Precision goes with the contrast: at this, a third of the white level, the spread is more
/// than twice that in good light.
const CONTRAST_WARN: f64 = 0.3;

/// Edges are barely told from the noise of 8 bits.
const CONTRAST_FAIL: f64 = 0.12;

/// Paper at the white level moves the edges into the dark, by as much as it shines.
const SATURATED_WARN: f64 = 0.01;
const SATURATED_FAIL: f64 = 0.2;

/// Paper darker than this wants more light; a brighter one with little contrast is veiled.
const PAPER_DARK: f64 = 0.4;

/// A lens in focus blurs by 0.6 to 0.8 px, the pixel's extent included.
const BLUR_WARN_PX: f64 = 1.2;

/// Edges are fitted up to 4 px; the squares of a target at its smallest have lost their middle.
const BLUR_FAIL_PX: f64 = 3.0;

/// A lens out of focus blurs alike in all directions; a motion does not.
const SMEAR_RATIO: f64 = 1.5;

pub fn checks(findings: &Findings) -> Vec<Check> {
    let targets = findings.views.iter().flat_map(|view| &view.targets);
    let mut roles: Vec<_> = targets.map(|target| target.role).collect();
    roles.sort_by_key(|role| *role as u8);
    roles.dedup();
    if roles.is_empty() {
        let why = if findings.views.is_empty() { "no view came" } else { "no target is in sight" };
        return vec![Check::skipped("light", why)];
    }
    let of_one = |role| {
        let name = findings.name(role);
        let middle = |of: fn(&TargetView) -> f32| {
            let targets = findings.views.iter().flat_map(|view| &view.targets);
            let figures = targets.filter(|target| target.role == role);
            median(figures.map(|target| f64::from(of(target)))).unwrap_or_default()
        };
        let [light, dark] = [middle(|it| it.light), middle(|it| it.dark)];
        let blur_px = [middle(|it| it.blur_px[0]), middle(|it| it.blur_px[1])];
        [
            contrast(&name, light, dark),
            saturation(&name, middle(|it| it.saturated)),
            sharpness(&name, blur_px),
        ]
    };
    roles.into_iter().flat_map(of_one).collect()
}

fn contrast(name: &str, light: f64, dark: f64) -> Check {
    let contrast = light - dark;
    Check::new(
        Verdict::at_least(contrast, CONTRAST_WARN, CONTRAST_FAIL),
        format!("{name} contrast"),
        format!("{contrast:.2} (at least {CONTRAST_WARN}): {dark:.2} to {light:.2}"),
        if light < PAPER_DARK {
            "give more light, or a longer exposure, or else more gain"
        } else {
            "turn lamps and windows out of the print's reflection, clean the lens, print with a \
             deeper black on matt paper"
        },
    )
}

fn saturation(name: &str, saturated: f64) -> Check {
    Check::new(
        Verdict::at_most(saturated, SATURATED_WARN, SATURATED_FAIL),
        format!("{name} white"),
        format!("{} of it saturated (at most {})", percent(saturated), percent(SATURATED_WARN)),
        "expose for a shorter time, or lower the gain",
    )
}

fn sharpness(name: &str, blur_px: [f64; 2]) -> Check {
    let [along_x, along_y] = blur_px;
    let worst_px = along_x.max(along_y);
    let is_smeared = worst_px > SMEAR_RATIO * along_x.min(along_y);
    Check::new(
        Verdict::at_most(worst_px, BLUR_WARN_PX, BLUR_FAIL_PX),
        format!("{name} blur"),
        format!("{along_x:.2} and {along_y:.2} px (at most {BLUR_WARN_PX})"),
        if is_smeared {
            "it is smeared: expose for a shorter time in more light, and fix the camera firmly"
        } else {
            "focus the lens, then calibrate it again"
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{assert_says, check, healthy};
    use super::*;

    fn with(change: fn(&mut TargetView)) -> Findings {
        let mut findings = healthy();
        findings.views.iter_mut().flat_map(|view| &mut view.targets).for_each(change);
        findings
    }

    #[test]
    fn poor_contrast_has_two_causes() {
        let dark = with(|target| (target.light, target.dark) = (0.25, 0.02));
        let check_of = |findings| check(findings, "lumbar contrast");
        assert_says(&check_of(&dark), Verdict::Warn, &["0.23 (at least 0.3)", "more light"]);
        let veiled = with(|target| (target.light, target.dark) = (0.9, 0.65));
        assert_says(&check_of(&veiled), Verdict::Warn, &["0.65 to 0.90", "reflection"]);
        let night = with(|target| (target.light, target.dark) = (0.1, 0.02));
        assert_says(&check_of(&night), Verdict::Fail, &["0.08", "longer exposure"]);
    }

    #[test]
    fn paper_at_the_white_level_is_too_bright() {
        let some = with(|target| target.saturated = 0.05);
        let warning = check(&some, "shoulder white");
        assert_says(&warning, Verdict::Warn, &["5.0 % of it", "at most 1.0 %", "gain"]);
        let most = with(|target| target.saturated = 0.6);
        assert_says(&check(&most, "shoulder white"), Verdict::Fail, &["60.0 %", "shorter"]);
    }

    #[test]
    fn blur_is_of_the_focus_or_of_a_motion() {
        let soft = with(|target| target.blur_px = [1.5, 1.6]);
        assert_says(&check(&soft, "lumbar blur"), Verdict::Warn, &["1.50 and 1.60", "focus"]);
        let smeared = with(|target| target.blur_px = [0.8, 3.5]);
        assert_says(&check(&smeared, "lumbar blur"), Verdict::Fail, &["smeared", "firmly"]);
    }

    #[test]
    fn where_no_target_is_in_sight_there_is_no_light_to_judge() {
        let mut findings = healthy();
        findings.views[0].targets.clear();
        assert_says(&check(&findings, "light"), Verdict::Skipped, &["no target is in sight"]);
        findings.views.clear();
        assert_says(&check(&findings, "light"), Verdict::Skipped, &["no view"]);
    }
}
