//! How far a point moves from its mean: root mean square and range.

use serde::Serialize;

use super::figure::{Absent, ByAxis, ByDirection, Figure, Figures};
use super::path::along;
use crate::series::{Axis, Series};

/// The RMS distance from the mean, and the range. Samples on both sides of a gap count alike.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Extent {
    /// Root mean square distance from the mean position, mm: along an axis the standard deviation
    /// (over N), in a plane the square root of the sum of both variances (Prieto et al. 1996, IEEE
    /// Trans. Biomed. Eng. 43:956, RDIST).
    pub rms_mm: ByDirection<Figure>,
    /// From the smallest to the largest position, mm. It grows with the duration and with noise,
    /// because it depends on two extremes only.
    pub range_mm: ByAxis<Figure>,
}

impl Figures for Extent {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.rms_mm.each(visit);
        self.range_mm.each(visit);
    }
}

pub(super) fn extent(series: &Series) -> Extent {
    let rms = |first: Axis, second: Option<Axis>| -> Result<f64, Absent> {
        let variance = |axis| along(series, axis).map(variance);
        Ok((variance(first)? + second.map_or(Ok(0.0), variance)?).sqrt())
    };
    let range = |axis: Axis| -> Result<f64, Absent> {
        let positions_mm = along(series, axis)?;
        let greatest = positions_mm.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Ok(greatest - positions_mm.iter().copied().fold(f64::INFINITY, f64::min))
    };
    Extent {
        rms_mm: ByDirection::of(|first, second| rms(first, second).into()),
        range_mm: ByAxis::of(|axis| range(axis).into()),
    }
}

/// The variance over N.
fn variance(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / count
}
