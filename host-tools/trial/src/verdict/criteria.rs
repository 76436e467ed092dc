//! What a trial must meet to be good: bounds and signs, in a file that a laboratory can change.
//!
//! `criteria.toml` has two sections of the same fields, `[doubtful]` and `[unusable]`. The defaults
//! are the example itself, with a reason beside each bound.

use std::path::Path;
use std::sync::LazyLock;

use plumbline_files::BadInput;
use plumbline_files::{from_toml, read_text};
use serde::{Deserialize, Serialize};

use super::Grade;

/// The criteria that hold unless others are given, as a file with comments.
pub const EXAMPLE: &str = include_str!("criteria.toml");

static DEFAULT: LazyLock<Criteria> = LazyLock::new(|| {
    Criteria::parse(EXAMPLE, "the program's own criteria").expect("a test reads them")
});

const REMEDY: &str = "`plumb replay --new-criteria FILE` writes an example with comments";

/// What a trial must meet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Criteria {
    /// A trial that misses one of these is doubtful at best.
    pub doubtful: Limits,
    /// A trial that misses one of these is unusable.
    pub unusable: Limits,
}

/// The bounds of one grade; one that is absent is not judged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Share of the frames in which each trunk is seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses_percent_min: Option<f64>,
    /// Longest time in which a trunk is not seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap_s_max: Option<f64>,
    /// Share of the trial's time in which a trunk is not seen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gaps_percent_max: Option<f64>,
    /// Time from t = 0 to the last frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duration_s_min: Option<f64>,
    /// Frames per second of the camera on average, pauses and the frames that never arrived
    /// included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_hz_min: Option<f64>,
    /// The same as a share of the rate in the box's configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_percent_min: Option<f64>,
    /// Share of the frames that never arrived.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lost_percent_max: Option<f64>,
    /// Share of the packets that arrived damaged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corrupt_percent_max: Option<f64>,
    /// Bytes of `packets.bin` that belong to no packet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damaged_bytes_max: Option<f64>,
    /// How often the box started.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub starts_max: Option<f64>,
    /// Other boxes that were heard and not listened to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub others_max: Option<f64>,
    /// Packets of a second box that said it was this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub conflicting_max: Option<f64>,
    /// Pose packets of which nobody knows the box.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unknown_start_max: Option<f64>,
    /// Packets with a number, time or position that cannot be true.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub implausible_max: Option<f64>,
    /// Median height of the upper trunk above the lower.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upper_above_lower_mm_min: Option<f64>,
    /// Light minus dark squares, fraction of the white level; median of the views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contrast_min: Option<f64>,
    /// Level of the light squares likewise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_min: Option<f64>,
    /// Share of the light squares' pixels at the white level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saturated_percent_max: Option<f64>,
    /// Blur of the squares' edges, of the direction in which it is larger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blur_px_max: Option<f64>,
    /// Median reprojection error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_px_max: Option<f64>,
    /// Signs that earn the grade wherever they are seen.
    pub when: Vec<Sign>,
}

/// Something that is so or is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sign {
    /// The targets were seen, and no frame has a trunk point: the box did not know which way is
    /// forward.
    NoScene,
    /// No frame has a trunk point, and neither target was seen.
    NoTarget,
    /// The box's configuration is not in the trial.
    NoConfiguration,
    /// The box was given another configuration during the trial.
    ConfigurationChanged,
    /// t = 0 is a mark, and there is none.
    NoMark,
    /// t = 0 is the moment of standing up, and nobody rises.
    NoOnset,
    /// The box's clock was not related to this computer's.
    ClockUnrelated,
    /// The voltage of the box's supply was too low.
    Undervoltage,
    /// The box's processor was slowed down.
    Throttled,
    /// The recording was not ended properly.
    CutOff,
}

impl Default for Criteria {
    fn default() -> Self {
        DEFAULT.clone()
    }
}

impl Criteria {
    /// Reads a criteria file.
    ///
    /// # Errors
    /// When it cannot be read, or holds a bound that makes no sense.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        Self::parse(&read_text(path)?, &path.display().to_string())
    }

    /// The criteria of a text; `place` names it in errors.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(text: &str, place: &str) -> Result<Self, BadInput> {
        let criteria: Self = from_toml(text, place, REMEDY)?;
        criteria.check(place)?;
        Ok(criteria)
    }

    /// The limits from the worst grade on.
    pub(super) fn graded(&self) -> [(Grade, &Limits); 2] {
        [(Grade::Unusable, &self.unusable), (Grade::Doubtful, &self.doubtful)]
    }

    /// Checks that every bound can be meant.
    pub(crate) fn check(&self, place: &str) -> Result<(), BadInput> {
        for (grade, limits) in self.graded() {
            for (name, bound) in limits.bounds() {
                if let Some(bound) = bound
                    && !(bound.is_finite() && bound >= 0.0)
                {
                    let field = format!("{}.{name}", grade.word());
                    return Err(BadInput::new(place, field, bound, "give a number from 0 on"));
                }
            }
        }
        let pairs = self.doubtful.bounds().into_iter().zip(self.unusable.bounds());
        for ((name, doubtful), (_, unusable)) in pairs {
            let Some((doubtful, unusable)) = doubtful.zip(unusable) else { continue };
            let is_in_order =
                if name.ends_with("_min") { unusable <= doubtful } else { unusable >= doubtful };
            if !is_in_order {
                return Err(BadInput::new(
                    place,
                    format!("unusable.{name}"),
                    format!("{unusable}, where {doubtful} is already doubtful"),
                    "an unusable trial must miss the bound of a doubtful one too",
                ));
            }
        }
        Ok(())
    }
}

impl Limits {
    fn bounds(&self) -> [(&'static str, Option<f64>); 20] {
        [
            ("poses_percent_min", self.poses_percent_min),
            ("gap_s_max", self.gap_s_max),
            ("gaps_percent_max", self.gaps_percent_max),
            ("duration_s_min", self.duration_s_min),
            ("rate_hz_min", self.rate_hz_min),
            ("rate_percent_min", self.rate_percent_min),
            ("lost_percent_max", self.lost_percent_max),
            ("corrupt_percent_max", self.corrupt_percent_max),
            ("damaged_bytes_max", self.damaged_bytes_max),
            ("starts_max", self.starts_max),
            ("others_max", self.others_max),
            ("conflicting_max", self.conflicting_max),
            ("unknown_start_max", self.unknown_start_max),
            ("implausible_max", self.implausible_max),
            ("upper_above_lower_mm_min", self.upper_above_lower_mm_min),
            ("contrast_min", self.contrast_min),
            ("light_min", self.light_min),
            ("saturated_percent_max", self.saturated_percent_max),
            ("blur_px_max", self.blur_px_max),
            ("rms_px_max", self.rms_px_max),
        ]
    }
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::standard;

    use super::*;

    fn refused(text: &str) -> String {
        Criteria::parse(text, "criteria.toml").unwrap_err().to_string()
    }

    #[test]
    fn the_example_names_every_bound_and_every_sign() {
        let criteria = Criteria::default();
        let [unusable, doubtful] = criteria.graded().map(|(_, limits)| limits.bounds());
        for ((name, doubtful), (_, unusable)) in doubtful.into_iter().zip(unusable) {
            assert!(doubtful.or(unusable).is_some(), "{name}");
        }
        // Their number; a new sign needs a line in the example.
        assert_eq!(criteria.doubtful.when.len() + criteria.unusable.when.len(), 10);
    }

    #[test]
    fn the_bounds_of_the_posturography_standard_are_the_standards() {
        let doubtful = Criteria::default().doubtful;
        assert_eq!(doubtful.duration_s_min, Some(standard::DURATION_MIN_S));
        assert_eq!(doubtful.rate_hz_min, Some(standard::RATE_ACCEPTED_HZ));
    }

    #[test]
    fn what_is_left_out_is_not_judged_and_what_is_stored_comes_back() {
        let text = "[doubtful]\nduration_s_min = 30\nwhen = [\"cut_off\"]\n[unusable]\n";
        let criteria = Criteria::parse(text, "").unwrap();
        assert_eq!(criteria.doubtful.duration_s_min, Some(30.0));
        assert_eq!((criteria.doubtful.gap_s_max, &criteria.unusable), (None, &Limits::default()));
        for criteria in [criteria, Criteria::default()] {
            let text = toml::to_string(&criteria).unwrap();
            assert_eq!(Criteria::parse(&text, "").unwrap(), criteria);
        }
    }

    #[test]
    fn what_cannot_be_meant_is_named() {
        for (text, parts) in [
            ("[doubtful]\n", &["unusable", "--new-criteria"][..]),
            ("[doubtful]\npose_percent = 3\n[unusable]\n", &["pose_percent"]),
            ("[doubtful]\nwhen = [\"tired\"]\n[unusable]\n", &["tired"]),
            ("[doubtful]\ngap_s_max = -1\n[unusable]\n", &["doubtful.gap_s_max", "-1"]),
            ("[doubtful]\ngap_s_max = nan\n[unusable]\n", &["doubtful.gap_s_max", "NaN"]),
            (
                "[doubtful]\ngap_s_max = 2\n[unusable]\ngap_s_max = 1\n",
                &["unusable.gap_s_max", "1, where 2"],
            ),
            (
                "[doubtful]\nduration_s_min = 20\n[unusable]\nduration_s_min = 30\n",
                &["unusable.duration_s_min", "30, where 20"],
            ),
        ] {
            let error = refused(text);
            assert!(error.contains("criteria.toml"), "{error}");
            for part in parts {
                assert!(error.contains(part), "no {part} in {error}");
            }
        }
    }
}
