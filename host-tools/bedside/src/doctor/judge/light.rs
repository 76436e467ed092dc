//! The light on the targets, and how sharp they are.

use plumbline::target::Role;
use plumbline::view::TargetView;
use plumbline_analysis::statistics::describe::median;

use super::super::check::{Check, Verdict};
use super::super::findings::Findings;
use super::percent;
use crate::bounds::{
    CONTRAST_MIN, FOCUS_MIN, LIGHT_MIN, MOTION_BLUR_PX_MIN, MOTION_RATIO, SATURATED_MAX,
    focus_score,
};

/// Half of what is wanted: edges can hardly be told from the noise of 8 bits.
const CONTRAST_FAIL: f64 = 0.5 * CONTRAST_MIN as f64;

/// A fifth of the paper at the white level: there the edges move into the dark.
const SATURATED_FAIL: f64 = 0.2;

pub fn checks(findings: &Findings) -> Vec<Check> {
    let roles = roles_in_view(findings);
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

/// In the order of the configuration.
fn roles_in_view(findings: &Findings) -> Vec<Role> {
    let configured = findings.hello.iter().flat_map(|hello| &hello.targets);
    let is_seen = |role: &Role| {
        let mut targets = findings.views.iter().flat_map(|view| &view.targets);
        targets.any(|target| target.role == *role)
    };
    configured.map(|target| target.role).filter(is_seen).collect()
}

fn contrast(name: &str, light: f64, dark: f64) -> Check {
    let contrast = light - dark;
    let is_dark = light < f64::from(LIGHT_MIN);
    let verdict = Verdict::at_least(contrast, CONTRAST_MIN.into(), CONTRAST_FAIL);
    Check::new(
        if verdict == Verdict::Good { Verdict::warn_if(is_dark) } else { verdict },
        format!("{name} contrast"),
        format!(
            "{contrast:.2} (at least {CONTRAST_MIN}): from {dark:.2} to {light:.2} (at least \
             {LIGHT_MIN})"
        ),
        if is_dark {
            "give more light, open the aperture, or expose for longer: `plumb aim --expose`"
        } else {
            "turn lamps and windows out of the print's reflection and the lens, clean the lens, \
             print with a deeper black on matt paper"
        },
    )
}

fn saturation(name: &str, saturated: f64) -> Check {
    let most = f64::from(SATURATED_MAX);
    Check::new(
        Verdict::at_most(saturated, most, SATURATED_FAIL),
        format!("{name} white"),
        format!("{} of it saturated (at most {})", percent(saturated), percent(most)),
        "expose for a shorter time, or lower the gain: `plumb aim --expose`",
    )
}

fn sharpness(name: &str, blur_px: [f64; 2]) -> Check {
    let [along_x, along_y] = blur_px;
    let (more, less) = (along_x.max(along_y), along_x.min(along_y));
    let is_smeared = more > f64::from(MOTION_RATIO) * less && more > f64::from(MOTION_BLUR_PX_MIN);
    let score = focus_score(more as f32);
    Check::new(
        Verdict::at_least(score.into(), FOCUS_MIN.into(), 1.0),
        format!("{name} focus"),
        format!("{score} of 100 (at least {FOCUS_MIN}): blur {along_x:.2} and {along_y:.2} px"),
        if is_smeared {
            "it is smeared: expose for a shorter time in more light, and fix the camera firmly"
        } else {
            "focus the lens with `plumb aim`, then calibrate it again"
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
        assert_says(&check_of(&dark), Verdict::Warn, &["0.23 (at least 0.25)", "more light"]);
        let dim = with(|target| (target.light, target.dark) = (0.35, 0.02));
        assert_says(&check_of(&dim), Verdict::Warn, &["to 0.35 (at least 0.4)", "aim --expose"]);
        let veiled = with(|target| (target.light, target.dark) = (0.9, 0.7));
        assert_says(&check_of(&veiled), Verdict::Warn, &["0.70 to 0.90", "reflection"]);
        let night = with(|target| (target.light, target.dark) = (0.1, 0.02));
        assert_says(&check_of(&night), Verdict::Fail, &["0.08", "expose for longer"]);
    }

    #[test]
    fn paper_at_the_white_level_is_too_bright() {
        let some = with(|target| target.saturated = 0.05);
        let warning = check(&some, "shoulder white");
        assert_says(&warning, Verdict::Warn, &["5.0 % of it", "at most 0.1 %", "gain"]);
        let most = with(|target| target.saturated = 0.6);
        assert_says(&check(&most, "shoulder white"), Verdict::Fail, &["60.0 %", "shorter"]);
    }

    #[test]
    fn blur_is_of_the_focus_or_of_a_motion() {
        let soft = with(|target| target.blur_px = [1.5, 1.6]);
        let warning = check(&soft, "lumbar focus");
        assert_says(&warning, Verdict::Warn, &["58 of 100", "1.50 and 1.60", "calibrate"]);
        // Beyond 3 px it is not to be used.
        let softer = with(|target| target.blur_px = [2.95, 2.9]);
        assert_says(&check(&softer, "lumbar focus"), Verdict::Warn, &["2 of 100"]);
        let softest = with(|target| target.blur_px = [3.05, 2.9]);
        assert_says(&check(&softest, "lumbar focus"), Verdict::Fail, &["0 of 100", "plumb aim"]);
        let smeared = with(|target| target.blur_px = [0.8, 3.5]);
        let failure = check(&smeared, "lumbar focus");
        assert_says(&failure, Verdict::Fail, &["0 of 100", "smeared", "firmly"]);
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
