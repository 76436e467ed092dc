//! Calibrates a camera from photographs of a board.
//!
//! ```text
//!  photographs ─▶ boards found ─▶ closed form ─▶ refined on corners ─▶ ┌ edges measured ┐
//!                                                                      └─▶ refined  ────┘ twice
//!  ─▶ lens, its standard deviations, residuals ─▶ what a user should know about them
//! ```
//!
//! The paper's two steps: Zhang's closed form ([`closed_form`]) and the joint refinement
//! ([`bundle`]). The refinement first uses the detector's corners and then the edges themselves,
//! measured as the tracker measures them, through the lens found so far.
//!
//! How long a rolling shutter takes to read a frame is measured from videos: of a board that moves
//! ([`readout`]), or of a wall in flickering light ([`flicker`]). Whether a camera was moved after
//! the room's axes had been measured ([`scene`]) is seen by its background ([`background`]).

use std::mem::discriminant;

use nalgebra::{DMatrix, Vector3};
use plumbline::image::GreyImage;
use plumbline::lens::{Distortion, Lens, LensError};
use plumbline::lens_table::LensTable;
use plumbline::parts::points_mm;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::GridRejection;
use plumbline::target::TargetGeometry;
use rayon::prelude::*;

pub mod background;
mod bundle;
mod closed_form;
pub mod coverage;
pub mod flicker;
mod model;
pub mod models;
pub mod observe;
pub mod readout;
pub mod rotation;
pub mod scene;
mod search;
pub mod verdict;

use bundle::Bundle;
use coverage::Coverage;
use model::{Photograph, Shape};
use models::{Figures, MODELS, ModelFit};
use observe::{Finder, Measured};

pub use model::Residual;
pub use search::{Found, Search};

/// The fewest photographs with a board: Zhang's closed form with all five parameters needs three.
pub const PHOTOGRAPHS_MIN: usize = 3;

/// The number of rounds of measuring the edges and refining on them: the second round measures them
/// through the lens of the first.
const ROUNDS: usize = 2;

/// A photograph in memory.
pub struct Picture {
    /// Its file.
    pub place: String,
    /// Grey levels, row by row without padding.
    pub samples: Vec<u8>,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Picture {
    fn view(&self) -> GreyImage<'_, u8> {
        GreyImage::new(&self.samples, self.width, self.height, self.width).expect("a whole picture")
    }
}

/// Why there is no calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum Failure {
    /// The board was found in only this many.
    TooFew(usize),
    /// The board looks the same in all of them: tilt it.
    NoTilt,
    /// The refinement does not converge.
    Unsettled,
    /// The lens that fits the photographs best cannot be used.
    Lens(LensError),
}

/// What one photograph contributed.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// No board was found.
    NotFound(GridRejection),
    /// A board was found, but its edges do not support a pose.
    Unusable,
    /// A board was found and used for the calibration.
    Used(Contribution),
}

impl Outcome {
    /// What the photograph contributed, if anything.
    #[must_use]
    pub fn used(&self) -> Option<&Contribution> {
        match self {
            Self::Used(contribution) => Some(contribution),
            Self::NotFound(_) | Self::Unusable => None,
        }
    }
}

/// What the board in a photograph contributed.
#[derive(Debug, Clone)]
pub struct Contribution {
    /// Root mean square reprojection error of the corners.
    pub rms_px: f64,
    /// The number of corners used.
    pub corners: usize,
    /// The midpoint of each edge, and the offset across the edge from its observed to its
    /// calibrated position, raw pixels.
    pub residuals: Vec<Residual>,
    /// The board's pose.
    pub cam_from_board: Pose<Cam, Target>,
}

/// A camera with its uncertainty, and the contribution of each photograph.
pub struct Calibration {
    /// The camera.
    pub lens: Lens,
    /// Standard deviations of fx fy cx cy skew, then of the distortion.
    pub sd: Vec<f64>,
    /// The correlations of the same numbers; with `sd` they are the covariance.
    pub correlations: DMatrix<f64>,
    /// Degrees of freedom of the fit.
    pub freedom: usize,
    /// Root mean square reprojection error of all corners.
    pub rms_px: f64,
    /// One for each photograph, in their order.
    pub outcomes: Vec<Outcome>,
    /// Where in the frame the boards were.
    pub coverage: Coverage,
    /// The board's own shape, where it can be determined, and its standard deviations.
    pub shape: Option<(Shape, Vec<f64>)>,
    /// How well each model describes the photographs, the smallest first; empty where no other
    /// was fitted.
    pub models: Vec<ModelFit>,
    /// The name of the model that describes the photographs better than the one that was asked for.
    pub better_model: Option<&'static str>,
}

/// The lens model of a calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Choice {
    /// The one that the photographs support: see [`models`].
    Supported,
    /// This one; the others are fitted too, to see whether one describes the photographs better.
    Compared(Distortion),
    /// This one, and no other is fitted.
    Alone(Distortion),
}

/// Calibrates a lens. `done` is called after each photograph that was searched, and after each model
/// that was fitted.
///
/// # Errors
/// [`Failure`].
pub fn calibrate(
    pictures: &[Picture],
    board: &TargetGeometry,
    choice: Choice,
    done: impl Fn() + Sync,
) -> Result<Calibration, Failure> {
    let search = |finder: &mut Finder, picture: &Picture| {
        let found = finder.find(&picture.view(), board);
        done();
        found
    };
    let found: Vec<Result<Found, GridRejection>> =
        pictures.par_iter().map_init(Finder::new, search).collect();
    let points_mm: Vec<_> = points_mm(board).collect();
    let photographs = Photographs { pictures, found: &found, board, points_mm: &points_mm };
    if let Choice::Alone(model) = choice {
        let fitted = photographs.fit(model)?;
        done();
        return photographs.conclude(fitted, Vec::new(), None);
    }
    let fit = |model: Distortion| {
        let fitted = photographs.fit(model).and_then(|fitted| {
            let held_out_px =
                models::held_out_px(&fitted.bundle, &points_mm).ok_or(Failure::Unsettled)?;
            Ok((fitted, held_out_px))
        });
        done();
        (model, fitted)
    };
    let fits: Vec<Attempt> = MODELS.into_iter().map(fit).collect();
    let figures = fits.iter().map(|(model, fitted)| ModelFit {
        model: *model,
        figures: fitted.as_ref().map_err(Clone::clone).map(|(fitted, held_out_px)| Figures {
            rms_px: fitted.residuals_rms_px(&points_mm),
            held_out_px: models::rms(held_out_px),
        }),
    });
    let figures: Vec<_> = figures.collect();
    let supported = supported(&fits);
    let chosen = match choice {
        Choice::Compared(wanted) | Choice::Alone(wanted) => fits
            .iter()
            .position(|(model, _)| discriminant(model) == discriminant(&wanted))
            .expect("every model was fitted"),
        Choice::Supported => supported.unwrap_or(0),
    };
    let better_model = supported.and_then(|place| {
        let errors_px = |place: usize| Some(&fits[place].1.as_ref().ok()?.1);
        let is_better = models::is_better(errors_px(place)?, errors_px(chosen)?);
        is_better.then(|| fits[place].0.name())
    });
    let (_, fitted) = fits.into_iter().nth(chosen).expect("a place among them");
    let (fitted, _) = fitted?;
    photographs.conclude(fitted, figures, better_model)
}

/// A model, and the fit with the held-out error of each photograph, or why there is none.
type Attempt = (Distortion, Result<(Fitted, Vec<f64>), Failure>);

/// The place of the model that the photographs support.
fn supported(fits: &[Attempt]) -> Option<usize> {
    let mut best: Option<(usize, &Vec<f64>)> = None;
    for (place, (_, fitted)) in fits.iter().enumerate() {
        let Ok((_, held_out_px)) = fitted else { continue };
        if best.is_none_or(|(_, best_px)| models::is_better(held_out_px, best_px)) {
            best = Some((place, held_out_px));
        }
    }
    best.map(|(place, _)| place)
}

/// The photographs of a calibration, and what was found in them.
struct Photographs<'a> {
    pictures: &'a [Picture],
    found: &'a [Result<Found, GridRejection>],
    board: &'a TargetGeometry,
    points_mm: &'a [Vector3<f64>],
}

/// A model fitted to the photographs.
struct Fitted {
    bundle: Bundle,
    /// The places of the photographs that were used.
    places: Vec<usize>,
    /// What each photograph shows through the final lens.
    measured: Vec<Option<Measured>>,
}

impl Fitted {
    /// The root mean square of all residuals, raw pixels.
    fn residuals_rms_px(&self, points_mm: &[Vector3<f64>]) -> f64 {
        let of_photograph = |photograph| self.bundle.residuals(points_mm, photograph);
        let all = self.bundle.photographs.iter().filter_map(of_photograph).flatten();
        let squares: Vec<f64> = all.map(|residual| residual.off_px.norm()).collect();
        models::rms(&squares)
    }
}

impl Photographs<'_> {
    fn fit(&self, distortion: Distortion) -> Result<Fitted, Failure> {
        let Self { pictures, found, board, points_mm } = *self;
        let mut bundle = start(pictures, found, board, distortion, points_mm)?;
        let mut places = Vec::new();
        for _ in 0..ROUNDS {
            let measured = measure(pictures, found, board, &bundle.lens)?;
            places = (0..measured.len()).filter(|&place| measured[place].is_some()).collect();
            if places.len() < PHOTOGRAPHS_MIN {
                return Err(Failure::TooFew(places.len()));
            }
            let photographs = measured.into_iter().flatten().map(|measured| Photograph {
                seen: measured.seen.into(),
                cam_from_board: measured.measurement.cam_from_target,
            });
            bundle = Bundle::refine(&bundle.lens, points_mm, photographs.collect(), false)
                .ok_or(Failure::Unsettled)?;
        }
        bundle.lens.check().map_err(Failure::Lens)?;
        // Each photograph is measured on its own through the final lens, as a tracker would.
        let measured = measure(pictures, found, board, &bundle.lens)?;
        Ok(Fitted { bundle, places, measured })
    }

    fn conclude(
        &self,
        Fitted { bundle, places, measured }: Fitted,
        models: Vec<ModelFit>,
        better_model: Option<&'static str>,
    ) -> Result<Calibration, Failure> {
        let Self { found, points_mm, .. } = *self;
        let shape = Bundle::refine(&bundle.lens, points_mm, bundle.photographs.clone(), true)
            .map(|shaped| (shaped.shape, shaped.sd[bundle.sd.len()..].to_vec()));
        let mut outcomes: Vec<Outcome> = found
            .iter()
            .map(|found| {
                found.as_ref().err().map_or(Outcome::Unusable, |why| Outcome::NotFound(*why))
            })
            .collect();
        let (mut squares, mut corners) = (0.0, 0.0);
        for (&place, photograph) in places.iter().zip(&bundle.photographs) {
            let Some(measured) = &measured[place] else { continue };
            let residuals = bundle.residuals(points_mm, photograph).ok_or(Failure::Unsettled)?;
            let measurement = &measured.measurement;
            squares += measurement.rms_px.powi(2) * f64::from(measurement.corners);
            corners += f64::from(measurement.corners);
            outcomes[place] = Outcome::Used(Contribution {
                rms_px: measurement.rms_px,
                corners: measurement.corners.into(),
                residuals,
                cam_from_board: photograph.cam_from_board,
            });
        }
        // The same criterion as in `plumb aim` while the photographs are taken.
        let seen_px: Vec<Vec<_>> = outcomes
            .iter()
            .zip(found)
            .filter(|(outcome, _)| outcome.used().is_some())
            .filter_map(|(_, found)| found.as_ref().ok())
            .map(|found| found.corners_px().map(|(_, px)| px).collect())
            .collect();
        let size_px = [bundle.lens.width_px, bundle.lens.height_px].map(f64::from);
        let freedom = bundle.freedom();
        Ok(Calibration {
            lens: bundle.lens,
            sd: bundle.sd,
            correlations: bundle.correlations,
            freedom,
            rms_px: (squares / corners).sqrt(),
            outcomes,
            coverage: Coverage::new(seen_px.iter().map(Vec::as_slice), size_px),
            shape,
            models,
            better_model,
        })
    }
}

/// The closed form, refined using the detector's corners.
fn start(
    pictures: &[Picture],
    found: &[Result<Found, GridRejection>],
    board: &TargetGeometry,
    distortion: Distortion,
    points_mm: &[Vector3<f64>],
) -> Result<Bundle, Failure> {
    let found: Vec<&Found> = found.iter().flatten().collect();
    if found.len() < PHOTOGRAPHS_MIN {
        return Err(Failure::TooFew(found.len()));
    }
    let pairs = |found: &&Found| -> Vec<closed_form::Pair> {
        found.corners_px().map(|(corner, px)| (board.corner_mm(corner).xy(), px)).collect()
    };
    let pairs: Vec<_> = found.iter().map(pairs).collect();
    // The frames' size is within the core's limits.
    let [width_px, height_px] = [pictures[0].width, pictures[0].height].map(|side| side as u16);
    let (pinhole, poses) =
        closed_form::camera_and_boards(&pairs, [width_px, height_px]).ok_or(Failure::NoTilt)?;
    let [fx_px, fy_px] = pinhole.focal_px;
    let [cx_px, cy_px] = pinhole.centre_px;
    let skew_px = pinhole.skew_px;
    let lens = Lens { width_px, height_px, fx_px, fy_px, cx_px, cy_px, skew_px, distortion };
    let photographs = found
        .iter()
        .zip(poses)
        .map(|(found, cam_from_board)| Photograph {
            seen: found.seen(board).into(),
            cam_from_board,
        })
        .collect();
    Bundle::refine(&lens, points_mm, photographs, false).ok_or(Failure::Unsettled)
}

/// Measures what each photograph shows, through a lens.
fn measure(
    pictures: &[Picture],
    found: &[Result<Found, GridRejection>],
    board: &TargetGeometry,
    lens: &Lens,
) -> Result<Vec<Option<Measured>>, Failure> {
    let mut table = Box::new(LensTable::new());
    table.fill(lens).map_err(Failure::Lens)?;
    let measure = |finder: &mut Finder, (picture, found): (&Picture, &Result<Found, _>)| {
        finder.measure(&picture.view(), board, &table, found.as_ref().ok()?)
    };
    Ok(pictures.par_iter().zip(found).map_init(Finder::new, measure).collect())
}
