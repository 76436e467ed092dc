//! The figures of a budget, as a list.

use nalgebra::{Matrix3, Vector3};
use plumbline_analysis::series::{Axis, Plane, Series};
use plumbline_analysis::sway::figure::{ByAxis, ByDirection, Figure};
use plumbline_analysis::sway::{Lengths, PathErrors, Settings};
use serde::Serialize;

use crate::measured::Body;

/// What a figure is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Total path length.
    Path,
    /// Root mean square distance from the mean.
    Rms,
    /// From the smallest to the largest position.
    Range,
    /// Area of the 95 % prediction ellipse.
    Area,
    /// Path length over time.
    Velocity,
    /// From the mean position of the lower trunk to that of the upper.
    Distance,
}

impl Quantity {
    /// Its name and its unit.
    #[must_use]
    pub fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Path => ("path length", "mm"),
            Self::Rms => ("RMS", "mm"),
            Self::Range => ("range", "mm"),
            Self::Area => ("95 % ellipse", "mm²"),
            Self::Velocity => ("mean velocity", "mm/s"),
            Self::Distance => ("distance of both points", "mm"),
        }
    }
}

/// One figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Listed {
    /// The point's name; `both` for the distance of two.
    pub point: &'static str,
    pub quantity: Quantity,
    pub direction: &'static str,
    /// `None` where the trial does not give this figure.
    pub value: Option<f64>,
    /// Its standard uncertainty from the noise that was given.
    pub noise_sd: Option<f64>,
}

impl Listed {
    fn new(quantity: Quantity, direction: &'static str, figure: &Figure) -> Self {
        let (value, noise_sd) = (figure.value(), figure.noise_sd());
        Self { point: "", quantity, direction, value, noise_sd }
    }
}

/// The figures of one point, always in the same order.
pub(crate) fn listed(point: &'static str, lengths: &Lengths) -> Vec<Listed> {
    let Lengths { path, extent, ellipse, .. } = lengths;
    let areas = [&ellipse.transverse, &ellipse.sagittal, &ellipse.coronal];
    let areas = Plane::ALL.into_iter().zip(areas);
    let velocity = &path.mean_velocity_mm_s.planes.transverse;
    by_direction(Quantity::Path, &path.length_mm)
        .into_iter()
        .chain(by_axis(Quantity::Rms, &extent.rms_mm.axes))
        .chain(by_axis(Quantity::Range, &extent.range_mm))
        .chain(areas.map(|(plane, it)| Listed::new(Quantity::Area, plane.word(), &it.area_mm2)))
        .chain([Listed::new(Quantity::Velocity, Plane::Transverse.word(), velocity)])
        .map(|it| Listed { point, ..it })
        .collect()
}

fn by_axis(quantity: Quantity, all: &ByAxis<Figure>) -> Vec<Listed> {
    let figures = Axis::ALL.into_iter().zip([&all.ap, &all.ml, &all.si]);
    figures.map(|(axis, figure)| Listed::new(quantity, axis.word(), figure)).collect()
}

fn by_direction(quantity: Quantity, all: &ByDirection<Figure>) -> Vec<Listed> {
    let ByDirection { axes, planes } = all;
    let planes = [&planes.transverse, &planes.sagittal, &planes.coronal];
    let planes = Plane::ALL.into_iter().zip(planes);
    let planes = planes.map(|(plane, figure)| Listed::new(quantity, plane.word(), figure));
    by_axis(quantity, axes).into_iter().chain(planes).collect()
}

/// What moves each path away from its true length: what noise adds, and what the steps between
/// samples leave out. In the order of [`listed`]; other figures have neither.
pub(crate) fn corrections(lengths: &Lengths, errors: &PathErrors) -> Vec<Correction> {
    let PathErrors { noise, shortfall } = errors;
    let all = [&noise.inflation_mm, &shortfall.length_mm, &shortfall.u_mm];
    let all = all.map(|it| by_direction(Quantity::Path, it));
    let of_path = |direction: &str| {
        let value = |listed: &Vec<Listed>| {
            let found = listed.iter().find(|it| it.direction == direction);
            found.and_then(|it| it.value).unwrap_or(0.0)
        };
        let [noise_adds, steps_lack, u_steps] = all.each_ref().map(value);
        Correction { noise_adds, steps_lack, u_steps }
    };
    let path_mm = lengths.path.length_mm.planes.transverse.value();
    let of = |figure: Listed| match figure.quantity {
        Quantity::Path => of_path(figure.direction),
        Quantity::Velocity => {
            let per_mm = figure.value.zip(path_mm.filter(|mm| *mm > 0.0));
            let per_mm = per_mm.map_or(0.0, |(velocity, path_mm)| velocity / path_mm);
            let Correction { noise_adds, steps_lack, u_steps } = of_path(figure.direction);
            Correction {
                noise_adds: per_mm * noise_adds,
                steps_lack: per_mm * steps_lack,
                u_steps: per_mm * u_steps,
            }
        }
        _ => Correction::default(),
    };
    listed("", lengths).into_iter().map(of).collect()
}

/// Known effects on a figure, in its unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Correction {
    pub noise_adds: f64,
    pub steps_lack: f64,
    /// Standard uncertainty of `steps_lack`.
    pub u_steps: f64,
}

/// The distance of the mean positions of two points, in the span that is analysed, and its standard
/// uncertainty from the noise of the positions: independent errors average out.
pub(crate) fn distance(bodies: [&Body; 2], series: [&Series; 2], settings: &Settings) -> Listed {
    let means = [0, 1].map(|at| mean_mm(bodies[at], series[at], settings));
    let distance = match means {
        [Some((first_mm, first_mm2)), Some((second_mm, second_mm2))] => {
            let between_mm = second_mm - first_mm;
            let along = between_mm.try_normalize(0.0).unwrap_or_default();
            let variance_mm2 = along.dot(&((first_mm2 + second_mm2) * along));
            Some((between_mm.norm(), variance_mm2.max(0.0).sqrt()))
        }
        _ => None,
    };
    Listed {
        point: "both",
        quantity: Quantity::Distance,
        direction: "3D",
        value: distance.map(|it| it.0),
        noise_sd: distance.map(|it| it.1),
    }
}

/// The mean position in the span that is analysed, and its covariance from noise.
fn mean_mm(
    body: &Body,
    series: &Series,
    settings: &Settings,
) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let [ap, ml, si] = Axis::ALL.map(|axis| series.along(axis));
    let (ap, ml, si) = (ap?, ml?, si?);
    let is_in_span =
        |time_s: f64| settings.span_s.as_ref().is_none_or(|span_s| span_s.contains(&time_s));
    let (mut sum_mm, mut sum_mm2, mut count) = (Vector3::zeros(), Matrix3::zeros(), 0.0);
    for (at, time_s) in series.time_s().iter().enumerate() {
        if is_in_span(*time_s) {
            sum_mm += Vector3::new(ap[at], ml[at], si[at]);
            sum_mm2 += body.covariance_mm2[at];
            count += 1.0;
        }
    }
    (count > 0.0).then(|| (sum_mm / count, sum_mm2 / (count * count)))
}

#[cfg(test)]
mod tests {
    use plumbline_trial::frame::Trunk;

    use super::*;

    #[test]
    fn two_points_in_one_place_are_at_a_distance_of_zero() {
        let still = || vec![900.0; 3];
        let body = |trunk| Body {
            trunk,
            series: Series::new(vec![0.0, 0.1, 0.2], [still(), still(), still()]).unwrap(),
            covariance_mm2: vec![Matrix3::identity(); 3],
            by_scale_mm: Vec::new(),
            by_numbers: Vec::new(),
        };
        let [lower, upper] = Trunk::ALL.map(body);
        let series = [&lower.series, &upper.series];
        let found = distance([&lower, &upper], series, &Settings::default());
        assert_eq!((found.value, found.noise_sd), (Some(0.0), Some(0.0)));
    }
}
