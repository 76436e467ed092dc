//! Warnings about a calibration, in words.

use std::fmt;

use nalgebra::{DMatrix, DVector, Vector3};

use super::model::Shape;
use super::{Calibration, Contribution};

/// With fewer photographs, a fault in one of them weighs too much.
const PHOTOGRAPHS_ENOUGH: usize = 8;
/// The tilts of the boards should differ by at least this much.
const TILT_DEG_MIN: f64 = 25.0;
/// A focal length with a larger relative error affects every distance noticeably.
const FOCAL_SHARE_MAX: f64 = 0.003;
/// The largest bend of a flat board: a sheet on glass is within a tenth of this.
const BEND_MM_MAX: f64 = 0.2;
/// On a print that was not scaled in one direction, the pitches along both axes agree to within
/// this.
const STRETCH_MAX: f64 = 0.002;
/// A finding about the board's shape must exceed this many of its standard deviations.
const DEVIATIONS: f64 = 4.0;
/// A photograph does not fit the others if its error is this many times the median,
const OUTLIER_RATIO: f64 = 3.0;
/// and at least this much larger, raw pixels.
const OUTLIER_PX: f64 = 0.05;
/// A good camera and board give 0.05 to 0.3 px.
const RMS_PX_MAX: f64 = 0.5;

/// A fault of the calibration, with what to do about it.
#[derive(Debug, Clone, PartialEq)]
pub enum Concern {
    /// Only this many photographs show the board.
    FewPhotographs(usize),
    /// The board was seen in too small a part of the frame.
    Coverage {
        /// The fraction in which it was seen, 0 to 1.
        share: f64,
        /// The parts that no board reached, in words.
        missed: Vec<String>,
        /// Where the board should be in the next photograph.
        next: &'static str,
    },
    /// The boards are too similar in tilt.
    Tilt {
        /// The largest angle between two of them.
        deg: f64,
    },
    /// The focal length is too uncertain.
    FocalLength {
        /// The estimate.
        px: f64,
        /// Its standard deviation.
        sd_px: f64,
    },
    /// The board is not flat.
    Bent {
        /// From its lowest to its highest point above its best-fitting plane.
        mm: f64,
        /// Its standard deviation.
        sd_mm: f64,
    },
    /// The board's pitches along its two axes differ.
    Stretched {
        /// The ratio of the pitch of the rows to that of the columns, minus 1.
        share: f64,
        /// Its standard deviation.
        sd: f64,
    },
    /// A photograph does not fit the others.
    Outlier {
        /// Its file.
        place: String,
        /// Its root mean square reprojection error.
        rms_px: f64,
        /// The median of all photographs.
        median_px: f64,
    },
    /// Another lens model describes the photographs better.
    Model {
        /// The one that was asked for.
        taken: &'static str,
        /// The one that the photographs support.
        better: &'static str,
    },
    /// The reprojection error is large.
    Rms {
        /// Root mean square, over all photographs.
        px: f64,
    },
}

impl fmt::Display for Concern {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewPhotographs(count) => write!(
                formatter,
                "only {count} photographs show the board; take 10 to 20, at different places and tilts"
            ),
            Self::Coverage { share, missed, next } => {
                write!(formatter, "the board was seen in {:.0} % of the frame", share * 100.0)?;
                if !missed.is_empty() {
                    write!(formatter, ", never near {}", missed.join(", "))?;
                }
                write!(
                    formatter,
                    "; take more photographs with the board there, the next one {next}: a lens bends most at the frame's border"
                )
            }
            Self::Tilt { deg } => write!(
                formatter,
                "the boards' tilts differ by only {deg:.0} degrees; tilt the board by 20 to 40 degrees about both axes, or the focal length stays uncertain"
            ),
            Self::FocalLength { px, sd_px } => write!(
                formatter,
                "the focal length is known only to {sd_px:.1} px of {px:.0} ({:.2} %); take more photographs with tilted boards",
                sd_px / px * 100.0
            ),
            Self::Bent { mm, sd_mm } => write!(
                formatter,
                "the board is bent by {mm:.2} mm (+-{sd_mm:.2}); glue the print to glass or an aluminium plate"
            ),
            Self::Stretched { share, sd } => write!(
                formatter,
                "the board's rows are {:.2} % (+-{:.2}) {} apart than its columns; print without scaling, and measure the pitch in both directions",
                share.abs() * 100.0,
                sd * 100.0,
                if *share > 0.0 { "farther" } else { "nearer" }
            ),
            Self::Outlier { place, rms_px, median_px } => write!(
                formatter,
                "{place} does not fit the others (RMS {rms_px:.2} px, the median is {median_px:.2}); leave it out, or take it again with board and camera at rest"
            ),
            Self::Model { taken, better } => write!(
                formatter,
                "the lens model {better} describes photographs that it was not fitted to better than {taken} does; leave out --model, or give --model {better}"
            ),
            Self::Rms { px } => write!(
                formatter,
                "the reprojection error is {px:.2} px, where a good camera and board give 0.05 to 0.3; check focus, columns, rows and the board's flatness, or try --model brown5"
            ),
        }
    }
}

/// All concerns, the most serious first.
pub fn concerns(
    calibration: &Calibration,
    places: &[String],
    points_mm: &[Vector3<f64>],
) -> Vec<Concern> {
    let used: Vec<(&String, &Contribution)> = places
        .iter()
        .zip(&calibration.outcomes)
        .filter_map(|(place, outcome)| Some((place, outcome.used()?)))
        .collect();
    let mut concerns = Vec::new();
    if calibration.rms_px > RMS_PX_MAX {
        concerns.push(Concern::Rms { px: calibration.rms_px });
    }
    let mut rms_px: Vec<f64> = used.iter().map(|(_, used)| used.rms_px).collect();
    rms_px.sort_by(f64::total_cmp);
    let median_px = rms_px.get(rms_px.len() / 2).copied().unwrap_or_default();
    for (place, used) in &used {
        if used.rms_px > OUTLIER_RATIO * median_px && used.rms_px > median_px + OUTLIER_PX {
            let place = (*place).clone();
            concerns.push(Concern::Outlier { place, rms_px: used.rms_px, median_px });
        }
    }
    if let Some((shape, sd)) = &calibration.shape {
        let (mm, sd_mm) = bend_mm(shape, sd, points_mm);
        if mm > BEND_MM_MAX && mm > DEVIATIONS * sd_mm {
            concerns.push(Concern::Bent { mm, sd_mm });
        }
        let (share, sd) = (shape.stretch, sd[3]);
        if share.abs() > STRETCH_MAX && share.abs() > DEVIATIONS * sd {
            concerns.push(Concern::Stretched { share, sd });
        }
    }
    if let Some(better) = calibration.better_model {
        concerns.push(Concern::Model { taken: calibration.lens.distortion.name(), better });
    }
    if used.len() < PHOTOGRAPHS_ENOUGH {
        concerns.push(Concern::FewPhotographs(used.len()));
    }
    let deg = tilt_deg(&used);
    if deg < TILT_DEG_MIN {
        concerns.push(Concern::Tilt { deg });
    }
    let (px, sd_px) = (calibration.lens.fx_px, calibration.sd[0]);
    if sd_px > FOCAL_SHARE_MAX * px {
        concerns.push(Concern::FocalLength { px, sd_px });
    }
    let coverage = &calibration.coverage;
    if let Some(next) = coverage.next() {
        let (share, missed) = (coverage.share(), coverage.missed());
        concerns.push(Concern::Coverage { share, missed, next });
    }
    concerns
}

/// The largest angle between the normals of two boards.
fn tilt_deg(used: &[(&String, &Contribution)]) -> f64 {
    let normals: Vec<_> =
        used.iter().map(|(_, used)| used.cam_from_board.rotation.column(2).into_owned()).collect();
    let mut least = 1.0_f64;
    for (place, one) in normals.iter().enumerate() {
        for other in &normals[place + 1..] {
            least = least.min(one.dot(other));
        }
    }
    least.clamp(-1.0, 1.0).acos().to_degrees()
}

/// The height from the lowest to the highest point of the board above its best-fitting plane, and
/// its standard deviation, propagated from that of each coefficient.
pub fn bend_mm(shape: &Shape, sd: &[f64], points_mm: &[Vector3<f64>]) -> (f64, f64) {
    let range = |bend_per_mm: [f64; 3]| {
        let bent = Shape { bend_per_mm, stretch: 0.0 };
        let plane = DMatrix::from_fn(points_mm.len(), 3, |row, column| match column {
            0 => 1.0,
            axis => points_mm[row][axis - 1],
        });
        let heights = DVector::from_fn(points_mm.len(), |row, _| bent.apply(&points_mm[row]).z);
        let normal = (plane.transpose() * &plane).try_inverse();
        let Some(normal) = normal else { return 0.0 };
        let off = &heights - &plane * (normal * plane.transpose() * &heights);
        off.max() - off.min()
    };
    let squares: f64 = (0..3)
        .map(|place| {
            let mut alone = [0.0; 3];
            alone[place] = sd[place];
            let alone: f64 = range(alone);
            alone * alone
        })
        .sum();
    (range(shape.bend_per_mm), squares.sqrt())
}
