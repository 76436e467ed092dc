//! Which lens model the photographs support.
//!
//! A model with more coefficients always fits the photographs that it was fitted to better; whether
//! it describes the lens better shows in photographs that it has not seen. Each model is therefore
//! fitted several times, each time without a part of the photographs, and the board's pose in each
//! of these is then found with the camera held fixed: the *held-out error* of the photograph is the
//! root mean square of its residuals (cross-validation, Stone 1974).
//!
//! From the smallest model to the largest, each is compared with the best one so far, by the mean
//! over the photographs of the logarithm of the ratio of their held-out errors. It is better where
//! the mean exceeds [`STANDARD_ERRORS`] of its standard errors and [`GAIN_MIN`].

use nalgebra::Vector3;
use plumbline::lens::Distortion;
use rayon::prelude::*;

use super::bundle::Bundle;
use super::{Failure, model::Photograph};

/// A larger model must be better beyond chance,
const STANDARD_ERRORS: f64 = 2.0;

/// and by enough to matter: 1 %.
const GAIN_MIN: f64 = 0.01;

/// The photographs are left out in so many parts, or one by one where they are fewer.
const PARTS: usize = 8;

/// Every model, the smallest first.
pub const MODELS: [Distortion; 5] = [
    Distortion::Radial2([0.0; 2]),
    Distortion::Fisheye4([0.0; 4]),
    Distortion::Brown5([0.0; 5]),
    Distortion::Rational8([0.0; 8]),
    Distortion::ThinPrism12([0.0; 12]),
];

/// How well one model describes the photographs.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFit {
    /// The model; its coefficients mean nothing.
    pub model: Distortion,
    /// Its figures, or why the photographs do not determine it.
    pub figures: Result<Figures, Failure>,
}

/// The figures of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Root mean square of the residuals of the photographs that it was fitted to, raw pixels.
    pub rms_px: f64,
    /// The same in photographs that it was not fitted to.
    pub held_out_px: f64,
}

/// The held-out error of each photograph.
pub(crate) fn held_out_px(bundle: &Bundle, points_mm: &[Vector3<f64>]) -> Option<Vec<f64>> {
    let count = bundle.photographs.len();
    let parts = count.min(PARTS);
    let of_part = |part: usize| -> Option<Vec<(usize, f64)>> {
        let (out, kept): (Vec<_>, Vec<_>) = (0..count).partition(|place| place % parts == part);
        let photographs: Vec<Photograph> =
            kept.iter().map(|&place| bundle.photographs[place].clone()).collect();
        let fitted = Bundle::refine(&bundle.lens, points_mm, photographs, false)?;
        out.into_iter()
            .map(|place| {
                let photograph = &bundle.photographs[place];
                Some((place, fitted.held_out_px(points_mm, photograph)?))
            })
            .collect()
    };
    let errors_px: Option<Vec<_>> = (0..parts).into_par_iter().map(of_part).collect();
    let mut by_place: Vec<_> = errors_px?.into_iter().flatten().collect();
    by_place.sort_unstable_by_key(|&(place, _)| place);
    Some(by_place.into_iter().map(|(_, error_px)| error_px).collect())
}

/// Whether errors are smaller than others, of the same photographs, beyond chance.
pub(crate) fn is_better(errors_px: &[f64], than_px: &[f64]) -> bool {
    let gains: Vec<f64> =
        errors_px.iter().zip(than_px).map(|(error, than)| (than / error).ln()).collect();
    let count = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let squares: f64 = gains.iter().map(|gain| (gain - mean) * (gain - mean)).sum();
    let standard_error = (squares / (count - 1.0) / count).sqrt();
    // With a NaN, from a single photograph, nothing is better.
    mean > GAIN_MIN && mean > STANDARD_ERRORS * standard_error
}

/// The root mean square.
pub(crate) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}
