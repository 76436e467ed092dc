//! A figure: a number with its uncertainty, or the reason why there is none.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::series::{Axis, Plane};

/// A figure of a trial. In JSON it is `{"value": 1.2, "noise_sd": 0.1}` or `{"absent": "SI was not
/// measured"}`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Figure {
    /// It could be computed.
    Known {
        /// The value, in the unit given by its name or documentation.
        value: f64,
        /// The standard uncertainty due to the noise of the positions, in the same unit; `None`
        /// where that noise is unknown.
        #[serde(skip_serializing_if = "Option::is_none")]
        noise_sd: Option<f64>,
    },
    /// It could not be computed.
    Absent {
        /// The reason.
        absent: Absent,
    },
}

impl Figure {
    /// The number.
    #[must_use]
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Known { value, .. } => Some(*value),
            Self::Absent { .. } => None,
        }
    }

    /// Its standard uncertainty due to the noise of the positions.
    #[must_use]
    pub fn noise_sd(&self) -> Option<f64> {
        match self {
            Self::Known { noise_sd, .. } => *noise_sd,
            Self::Absent { .. } => None,
        }
    }
}

impl From<Result<f64, Absent>> for Figure {
    fn from(result: Result<f64, Absent>) -> Self {
        match result {
            Ok(value) if value.is_finite() => Self::Known { value, noise_sd: None },
            // Positions beyond 1e150 mm: their squares overflow.
            Ok(_) => Self::Absent { absent: Absent::Overflow },
            Err(absent) => Self::Absent { absent },
        }
    }
}

/// Why there is no figure. Displayed, it is a sentence without its full stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Absent {
    /// This axis was not measured: a force plate, for example, has no SI.
    NotMeasured(Axis),
    /// No step between consecutive samples starts in this time.
    NothingMeasured,
    /// Too little of a time bin was measured.
    TooLittleMeasured {
        /// The start of the bin.
        from_s: f64,
        /// The end of the bin.
        to_s: f64,
        /// The share that was measured, 0 to 1.
        covered: f64,
        /// The least share needed.
        needed: f64,
    },
    /// Too few samples.
    TooFewSamples {
        /// The number found.
        samples: usize,
        /// The least number needed.
        needed: usize,
    },
    /// The longest part without a gap is too short.
    TooShort {
        /// Its duration.
        longest_s: f64,
        /// The least duration needed.
        needed_s: f64,
    },
    /// Too few samples per second.
    RateTooLow {
        /// The rate found.
        rate_hz: f64,
        /// The least rate needed.
        needed_hz: f64,
    },
    /// All positions are the same.
    NoMovement,
    /// The ellipse is a circle, which has no direction.
    NoDirection,
    /// The point stays within the radius for too long: the radius does not suit this movement.
    StaysWithin {
        /// The radius.
        radius_mm: f64,
        /// The duration that was exceeded.
        limit_s: f64,
    },
    /// The sway density has too few peaks.
    TooFewPeaks(usize),
    /// The short-term and the long-term line do not cross at a positive lag.
    NoCrossing,
    /// The mean square displacement is zero at some lag, and zero has no logarithm.
    Returns,
    /// The positions are too large to be squared.
    Overflow,
}

/// A share in percent, without the rounding of 0.57, which would be 56.99999999999999 %.
#[must_use]
pub fn percent(share: f64) -> f64 {
    (1e6 * share).round() / 1e4
}

impl fmt::Display for Absent {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotMeasured(axis) => write!(formatter, "{} was not measured", axis.word()),
            Self::NothingMeasured => write!(formatter, "nothing was measured in this time"),
            // Rounded down, so that it never reads like the bound.
            Self::TooLittleMeasured { from_s, to_s, covered, needed } => write!(
                formatter,
                "{from_s} to {to_s} s: {:.1} of {} s measured ({} %); at least {} % are needed",
                covered * (to_s - from_s),
                to_s - from_s,
                (100.0 * covered).floor(),
                percent(*needed)
            ),
            Self::TooFewSamples { samples, needed } => {
                write!(formatter, "there are {samples} samples, but {needed} are needed")
            }
            Self::TooShort { longest_s, needed_s } => write!(
                formatter,
                "the longest part without a gap is {longest_s:.1} s, but {needed_s:.1} s are needed"
            ),
            Self::RateTooLow { rate_hz, needed_hz } => {
                write!(formatter, "the rate is {rate_hz:.1} Hz, but {needed_hz:.1} Hz are needed")
            }
            Self::NoMovement => write!(formatter, "all positions are the same"),
            Self::NoDirection => write!(formatter, "the ellipse is a circle"),
            Self::StaysWithin { radius_mm, limit_s } => write!(
                formatter,
                "the point stays within {radius_mm} mm for more than {limit_s:.0} s: the radius is \
                 too large for this movement"
            ),
            Self::TooFewPeaks(peaks) => {
                write!(formatter, "the sway density has {peaks} peaks, but 2 are needed")
            }
            Self::NoCrossing => {
                write!(formatter, "the short-term and long-term lines do not cross")
            }
            Self::Returns => write!(formatter, "after some lag the point is always where it was"),
            Self::Overflow => write!(formatter, "the positions are too large to be squared"),
        }
    }
}

impl Serialize for Absent {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Something made of figures, for code that needs all of them, such as [the
/// uncertainties](super::noise).
pub trait Figures {
    /// Visits each figure, always in the same order.
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure));
}

impl Figures for Figure {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        visit(self);
    }
}

impl<T: Figures> Figures for Vec<T> {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.iter_mut().for_each(|it| it.each(visit));
    }
}

/// One value for each axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ByAxis<T> {
    /// Anterior-posterior.
    pub ap: T,
    /// Medial-lateral.
    pub ml: T,
    /// Superior-inferior.
    pub si: T,
}

impl<T> ByAxis<T> {
    /// Computes a value for each axis.
    pub fn of(mut of: impl FnMut(Axis) -> T) -> Self {
        Self { ap: of(Axis::Ap), ml: of(Axis::Ml), si: of(Axis::Si) }
    }
}

impl<T: Figures> Figures for ByAxis<T> {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        [&mut self.ap, &mut self.ml, &mut self.si].into_iter().for_each(|it| it.each(visit));
    }
}

/// One value for each plane.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ByPlane<T> {
    /// AP and ML.
    pub transverse: T,
    /// AP and SI.
    pub sagittal: T,
    /// ML and SI.
    pub coronal: T,
}

impl<T> ByPlane<T> {
    /// Computes a value for each plane.
    pub fn of(mut of: impl FnMut(Plane) -> T) -> Self {
        Self {
            transverse: of(Plane::Transverse),
            sagittal: of(Plane::Sagittal),
            coronal: of(Plane::Coronal),
        }
    }
}

impl<T: Figures> Figures for ByPlane<T> {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        let all = [&mut self.transverse, &mut self.sagittal, &mut self.coronal];
        all.into_iter().for_each(|it| it.each(visit));
    }
}

/// One value for each axis and each plane, side by side as in the paper's table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ByDirection<T> {
    /// Along each axis.
    #[serde(flatten)]
    pub axes: ByAxis<T>,
    /// In each plane.
    #[serde(flatten)]
    pub planes: ByPlane<T>,
}

impl<T> ByDirection<T> {
    /// Computes a value for each direction: for an axis, or for two axes that span a plane.
    pub fn of(mut of: impl FnMut(Axis, Option<Axis>) -> T) -> Self {
        Self {
            axes: ByAxis::of(|axis| of(axis, None)),
            planes: ByPlane::of(|plane| {
                let [first, second] = plane.axes();
                of(first, Some(second))
            }),
        }
    }
}

impl<T: Figures> Figures for ByDirection<T> {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.axes.each(visit);
        self.planes.each(visit);
    }
}
