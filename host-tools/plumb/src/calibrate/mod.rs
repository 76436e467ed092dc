//! A camera from photographs of a board.
//!
//! ```text
//!  photographs ─▶ boards found ─▶ closed form ─▶ refined on corners ─▶ ┌ edges measured ┐
//!                                                                      └─▶ refined  ────┘ twice
//!  ─▶ lens, its standard deviations, residuals ─▶ what a user should know about them
//! ```
//!
//! The paper's two steps: Zhang's closed form ([`closed_form`]) and the joint refinement
//! ([`bundle`]). What is refined is first the detector's corners, then the edges themselves,
//! measured as the tracker measures them through the lens found so far.

use nalgebra::Vector2;
use plumbline::grid::GridRejection;
use plumbline::image::GreyImage;
use plumbline::lens::{Distortion, Lens};
use plumbline::nodes::points_mm;
use plumbline::target::TargetGeometry;
use rayon::prelude::*;

pub mod bundle;
pub mod closed_form;
pub mod observe;

use bundle::{Bundle, Photograph, Shape};
use observe::{Finder, Found};

/// Fewest photographs with a board: Zhang's closed form of all five numbers needs three.
pub const PHOTOGRAPHS_MIN: usize = 3;

/// Rounds of measuring the edges and refining on them: the second sees them where the first's
/// lens has them.
const ROUNDS: usize = 2;

/// A photograph in memory.
pub struct Picture {
    pub place: String,
    pub samples: Vec<u8>,
    pub width: usize,
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
    /// The board was found in so few.
    TooFew(usize),
    /// The board looks the same in all of them: tilt it.
    NoTilt,
    /// The numbers do not settle.
    Unsettled,
}

/// What one photograph contributed.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// No board.
    NotFound(GridRejection),
    /// A board whose edges do not support a pose.
    Unusable,
    Used(Contribution),
}

#[derive(Debug, Clone)]
pub struct Contribution {
    pub rms_px: f64,
    pub corners: usize,
    /// Where an edge is seen, and how far from there the calibration puts it, raw pixels.
    pub residuals: Vec<(Vector2<f64>, Vector2<f64>)>,
    /// The board's pose.
    pub cam_from_board: plumbline::pose::Pose<plumbline::pose::Cam, plumbline::pose::Target>,
}

/// A camera, how well it is known, and from what.
pub struct Calibration {
    pub lens: Lens,
    /// Of fx fy cx cy skew, then the distortion.
    pub sd: Vec<f64>,
    /// Root mean square reprojection error of all corners.
    pub rms_px: f64,
    pub outcomes: Vec<Outcome>,
    /// The board's own shape, where it can be told, and its standard deviations.
    pub shape: Option<(Shape, Vec<f64>)>,
}

/// Calibrates. `done` is told after each photograph that was searched.
pub fn calibrate(
    pictures: &[Picture],
    board: &TargetGeometry,
    no_distortion: Distortion,
    done: impl Fn() + Sync,
) -> Result<Calibration, Failure> {
    let found: Vec<Result<Found, GridRejection>> = pictures
        .par_iter()
        .map_init(Finder::new, |finder, picture| {
            let found = finder.find(&picture.view(), board);
            done();
            found
        })
        .collect();
    let usable: Vec<(usize, &Found)> =
        found.iter().enumerate().filter_map(|(place, found)| Some((place, found.as_ref().ok()?))).collect();
    if usable.len() < PHOTOGRAPHS_MIN {
        return Err(Failure::TooFew(usable.len()));
    }
    let size_px = [pictures[0].width as u16, pictures[0].height as u16];
    let points_mm: Vec<_> = points_mm(board).collect();
    let pairs: Vec<Vec<_>> = usable
        .iter()
        .map(|(_, found)| {
            let pair = |(corner, px)| (board.corner_mm(corner).xy(), px);
            found.corners_px().map(pair).collect()
        })
        .collect();
    let (pinhole, poses) =
        closed_form::camera_and_boards(&pairs, size_px).ok_or(Failure::NoTilt)?;
    let [fx_px, fy_px] = pinhole.focal_px;
    let [cx_px, cy_px] = pinhole.centre_px;
    let lens = Lens {
        width_px: size_px[0],
        height_px: size_px[1],
        fx_px,
        fy_px,
        cx_px,
        cy_px,
        skew_px: pinhole.skew_px,
        distortion: no_distortion,
    };
    let photographs = usable
        .iter()
        .zip(poses)
        .map(|((_, found), cam_from_board)| Photograph { seen: found.seen(board), cam_from_board })
        .collect();
    let mut bundle =
        Bundle::refine(&lens, &points_mm, photographs, false).ok_or(Failure::Unsettled)?;
    // Which photograph each of the bundle's is.
    let mut used: Vec<usize> = (0..usable.len()).collect();
    for _ in 0..ROUNDS {
        let measured = measure(pictures, board, &bundle.lens, &usable);
        used = (0..usable.len()).filter(|&place| measured[place].is_some()).collect();
        if used.len() < PHOTOGRAPHS_MIN {
            return Err(Failure::TooFew(used.len()));
        }
        let photographs = measured
            .into_iter()
            .flatten()
            .map(|measured| Photograph {
                seen: measured.seen,
                cam_from_board: measured.measurement.cam_from_target,
            })
            .collect();
        bundle = Bundle::refine(&bundle.lens, &points_mm, photographs, false)
            .ok_or(Failure::Unsettled)?;
    }
    if std::env::var_os("SHAPE").is_some() { let b = Bundle::refine(&bundle.lens, &points_mm, bundle.photographs.clone(), true).unwrap(); eprintln!("shaped {:?} tau {} -> {}", b.lens, bundle.tau_px, b.tau_px); }
    let shape = Bundle::refine(&bundle.lens, &points_mm, bundle.photographs.clone(), true)
        .map(|shaped| (shaped.shape, shaped.sd[bundle.sd.len()..].to_vec()));
    let mut outcomes: Vec<Outcome> = found
        .iter()
        .map(|found| match found {
            Ok(_) => Outcome::Unusable,
            Err(rejection) => Outcome::NotFound(*rejection),
        })
        .collect();
    let (mut squares, mut corners) = (0.0, 0.0);
    for (measured, &place) in measure(pictures, board, &bundle.lens, &usable).iter().zip(&usable.iter().map(|(place, _)| *place).collect::<Vec<_>>()) {
        let Some(measured) = measured else { continue };
        let measurement = &measured.measurement;
        let count = f64::from(measurement.corners);
        squares += measurement.rms_px * measurement.rms_px * count;
        corners += count;
        outcomes[place] = Outcome::Used(Contribution {
            rms_px: measurement.rms_px,
            corners: measurement.corners.into(),
            residuals: Vec::new(),
            cam_from_board: measurement.cam_from_target,
        });
    }
    let _ = used;
    Ok(Calibration {
        lens: bundle.lens,
        sd: bundle.sd,
        rms_px: (squares / corners).sqrt(),
        outcomes,
        shape,
    })
}

fn measure(
    pictures: &[Picture],
    board: &TargetGeometry,
    lens: &Lens,
    usable: &[(usize, &Found)],
) -> Vec<Option<observe::Measured>> {
    usable
        .par_iter()
        .map_init(Finder::new, |finder, (place, found)| {
            finder.measure(&pictures[*place].view(), board, lens, found)
        })
        .collect()
}
