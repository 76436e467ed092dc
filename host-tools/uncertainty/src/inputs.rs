//! `budget.toml`: how well a trial's conditions are known.

use std::path::Path;

use plumbline_files::BadInput;
use plumbline_files::{from_toml, read_text};
use serde::{Deserialize, Serialize};

/// The text of a new file, with the values that stand for whatever is left out.
pub const EXAMPLE: &str = include_str!("budget.toml");

const REMEDY: &str = "`plumb budget --new FILE` writes a file with every setting and its meaning";

/// Standard uncertainties of what the trial itself does not tell. The defaults are those of
/// [`EXAMPLE`], which explains each.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[allow(missing_docs)]
pub struct Inputs {
    pub print: Print,
    pub targets: Targets,
    pub scene: Scene,
    pub timing: Timing,
    pub noise: PoseNoise,
}

/// The scale of the printed targets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Print {
    /// The length of the printed ruler for which the targets' pitch is right.
    pub ruler_mm: f64,
    /// Its length as measured.
    pub measured_mm: f64,
    /// Standard uncertainty of that.
    pub u_mm: f64,
    /// Degrees of freedom of `u_mm`; `None` for a judgement.
    pub freedom: Option<f64>,
    /// By how much the rows may be farther apart than the columns.
    pub stretch_u_percent: f64,
}

/// The flatness of the targets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Targets {
    /// Height of the edges over the middle, in each of three ways of bending.
    pub bow_u_mm: f64,
    /// Degrees of freedom; `None` for a judgement.
    pub freedom: Option<f64>,
}

/// The board that defines the body's axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scene {
    /// How upright it stood, about each horizontal axis.
    pub tilt_u_deg: f64,
    /// How well it faced the direction that is called forward.
    pub turn_u_deg: f64,
    /// Degrees of freedom; `None` for a judgement.
    pub freedom: Option<f64>,
}

/// The times of the frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Timing {
    /// Of a frame's time stamp, independently for each frame.
    pub jitter_u_s: f64,
    /// Of the rate of the box's clock, in millionths.
    pub clock_u_ppm: f64,
}

/// The noise that the poses come with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseNoise {
    /// How well its standard deviation is known.
    pub u_percent: f64,
}

impl Default for Print {
    fn default() -> Self {
        Self {
            ruler_mm: 100.0,
            measured_mm: 100.0,
            u_mm: 0.2,
            freedom: None,
            stretch_u_percent: 0.05,
        }
    }
}

impl Default for Targets {
    fn default() -> Self {
        Self { bow_u_mm: 0.05, freedom: None }
    }
}

impl Default for Scene {
    fn default() -> Self {
        Self { tilt_u_deg: 0.3, turn_u_deg: 1.0, freedom: None }
    }
}

impl Default for Timing {
    fn default() -> Self {
        Self { jitter_u_s: 1e-4, clock_u_ppm: 50.0 }
    }
}

impl Default for PoseNoise {
    fn default() -> Self {
        Self { u_percent: 10.0 }
    }
}

/// Reads a file.
///
/// # Errors
/// When it cannot be read, a field is unknown, or a number is none that it can be.
pub fn read(path: &Path) -> Result<Inputs, BadInput> {
    parse(&read_text(path)?, &path.display().to_string())
}

/// The inputs of a text; `place` names it in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, place: &str) -> Result<Inputs, BadInput> {
    let inputs: Inputs = from_toml(text, place, REMEDY)?;
    let Inputs { print, targets, scene, timing, noise } = &inputs;
    // With its largest sensible value: beyond it the budget's first order says nothing.
    let uncertainties = [
        ("print.u_mm", print.u_mm, 0.1 * print.ruler_mm),
        ("print.stretch_u_percent", print.stretch_u_percent, 10.0),
        ("targets.bow_u_mm", targets.bow_u_mm, 10.0),
        ("scene.tilt_u_deg", scene.tilt_u_deg, 20.0),
        ("scene.turn_u_deg", scene.turn_u_deg, 20.0),
        ("timing.jitter_u_s", timing.jitter_u_s, 1.0),
        ("timing.clock_u_ppm", timing.clock_u_ppm, 1e5),
        ("noise.u_percent", noise.u_percent, 100.0),
    ];
    for (field, value) in
        [("print.ruler_mm", print.ruler_mm), ("print.measured_mm", print.measured_mm)]
    {
        // NaN is in no range.
        if !(1.0..=10_000.0).contains(&value) {
            let remedy = "give a length of 1 to 10,000 mm";
            return Err(BadInput::new(place, field, value, remedy));
        }
    }
    for (field, value, greatest) in uncertainties {
        if !(0.0..=greatest).contains(&value) {
            let remedy = format!("a standard uncertainty is 0 to {greatest} here");
            return Err(BadInput::new(place, field, value, remedy));
        }
    }
    for (field, freedom) in [
        ("print.freedom", print.freedom),
        ("targets.freedom", targets.freedom),
        ("scene.freedom", scene.freedom),
    ] {
        if let Some(value) = freedom.filter(|it| !(1.0..=1e6).contains(it)) {
            let remedy = "give the number of readings less one, at least 1, or leave it out";
            return Err(BadInput::new(place, field, value, remedy));
        }
    }
    Ok(inputs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_has_every_default_and_its_comments_are_settings() {
        assert_eq!(parse(EXAMPLE, "budget.toml"), Ok(Inputs::default()));
        assert_eq!(parse("", "budget.toml"), Ok(Inputs::default()));
        let all = parse(&EXAMPLE.replace("#freedom", "freedom"), "budget.toml").unwrap();
        let four = Some(4.0);
        let freedoms = [all.print.freedom, all.targets.freedom, all.scene.freedom];
        assert_eq!(freedoms, [four; 3]);
        // Every field of the inputs is in the example.
        let written = toml::to_string(&all).unwrap();
        for field in
            written.lines().filter_map(|line| line.split(" = ").nth(1).and(line.split(' ').next()))
        {
            assert!(EXAMPLE.contains(&format!("{field} = ")), "{field}");
        }
    }

    #[test]
    fn what_cannot_be_an_uncertainty_is_named() {
        let cases = [
            ("[print]\nu_mm = -0.2", "print.u_mm", "-0.2"),
            ("[print]\nu_mm = nan", "print.u_mm", "NaN"),
            ("[print]\nmeasured_mm = 0", "print.measured_mm", "0"),
            ("[print]\nfreedom = 0", "print.freedom", "0"),
            ("[targets]\nbow_u_mm = -1", "targets.bow_u_mm", "-1"),
            ("[scene]\ntilt_u_deg = 90", "scene.tilt_u_deg", "90"),
            ("[timing]\njitter_u_s = inf", "timing.jitter_u_s", "inf"),
            ("[noise]\nu_percent = 200", "noise.u_percent", "200"),
            ("[print]\nruler = 100", "ruler (line 2)", "unknown field"),
            ("[print]\nu_mm = \"0.2\"", "u_mm (line 2)", "string"),
        ];
        for (text, field, found) in cases {
            let error = parse(text, "budget.toml").unwrap_err();
            assert_eq!(error.field, field, "{error}");
            assert!(error.found.contains(found) && error.place == "budget.toml", "{error}");
        }
    }
}
