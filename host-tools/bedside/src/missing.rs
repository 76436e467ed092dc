//! A target that is not found: the most frequent reason, and what to do about it.

use plumbline::report::GridRejection;
use plumbline::report::NoPose;

/// Why a target is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Missing {
    /// The box's own reason.
    Because(NoPose),
    /// The board that is seen is another of the box's targets: this one's size is not wrong.
    NotInPicture,
}

impl Missing {
    /// From the box's reason, and whether it measures another of its targets meanwhile.
    #[must_use]
    pub fn new(why: NoPose, is_other_measured: bool) -> Self {
        match why {
            NoPose::NotFound(GridRejection::OtherDimensions) if is_other_measured => {
                Self::NotInPicture
            }
            why => Self::Because(why),
        }
    }

    /// The reason in a few words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Because(why) => why.words(),
            Self::NotInPicture => "not in the picture",
        }
    }

    /// What to tell someone before the camera.
    #[must_use]
    pub fn advice(self, name: &str) -> String {
        let remedy = self.remedy().unwrap_or("bring it into the picture");
        format!("{name} is not seen ({}): {remedy}", self.words())
    }

    /// What to do; `None` while nothing is wrong yet.
    #[must_use]
    pub fn remedy(self) -> Option<&'static str> {
        let why = match self {
            Self::NotInPicture => return Some("bring the target into the picture"),
            Self::Because(why) => why,
        };
        Some(match why {
            NoPose::Searching => return None,
            NoPose::FrameSize => "calibrate the camera at the frame size at which it records",
            NoPose::NotFound(GridRejection::NoLattice) => {
                "bring the target into the picture, and check light and focus"
            }
            NoPose::NotFound(GridRejection::OtherDimensions) => {
                "another board is seen: columns and rows in the targets file count INNER corners"
            }
            NoPose::NotFound(GridRejection::Cut) => "move the camera: the frame cuts the target",
            NoPose::NotFound(GridRejection::Incomplete) => {
                "uncover all of the target, flatten it, and check light and focus"
            }
            NoPose::NotFound(GridRejection::GoesOn) => {
                "keep the target's white margin free: a pattern continues beside it"
            }
            NoPose::NotFound(GridRejection::Ambiguous) => "cover the second target of this shape",
            NoPose::TooFewCorners | NoPose::ExtentUnknown => "keep hands, hair and clothes off it",
            NoPose::PoorFit => {
                "flatten the print; check columns, rows and pitch_mm, and that the calibration is \
                 this lens's"
            }
        })
    }
}

/// The most frequent reason, with its number of frames. A search takes
/// several frames and gives its reason at the end, so any other reason says more than
/// "searching".
pub fn most(counts: impl IntoIterator<Item = (NoPose, usize)>) -> Option<(NoPose, usize)> {
    counts.into_iter().max_by_key(|(why, frames)| (*why != NoPose::Searching, *frames))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CUT: NoPose = NoPose::NotFound(GridRejection::Cut);

    #[test]
    fn a_search_that_goes_on_is_no_reason_where_there_is_one() {
        let all = [(NoPose::Searching, 280), (CUT, 15), (NoPose::PoorFit, 5)];
        assert_eq!(most(all), Some((CUT, 15)));
        assert_eq!(most(all[..1].iter().copied()), Some((NoPose::Searching, 280)));
        assert_eq!(most([]), None);
    }

    #[test]
    fn another_target_of_the_box_is_no_wrong_count_of_corners() {
        let why = NoPose::NotFound(GridRejection::OtherDimensions);
        assert_eq!(Missing::new(why, true).words(), "not in the picture");
        assert!(!Missing::new(why, true).remedy().unwrap().contains("INNER"));
        assert!(Missing::new(why, false).remedy().unwrap().contains("INNER"));
        assert_eq!(Missing::new(CUT, true), Missing::Because(CUT));
    }
}
