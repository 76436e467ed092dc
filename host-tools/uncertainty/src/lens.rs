//! How well the camera's numbers are known, from `camera.toml`.

use nalgebra::{DMatrix, SymmetricEigen};
use plumbline_files::BadInput;
use plumbline_files::camera::{Camera, Deviations};

use crate::response::LENS_NUMBERS;

/// An eigenvalue of the correlations may be below zero by this: rounding where parameters are all
/// but dependent.
const ROUNDING: f64 = 1e-6;

/// The uncertainty of a lens: independent ways in which its numbers may be wrong together.
#[derive(Debug, Clone, PartialEq)]
pub struct LensUncertainty {
    /// Each is one standard deviation, as numbers in the order fx fy cx cy skew, distortion; unused
    /// ones are zero. The sum of their outer products is the covariance.
    pub ways: Vec<[f64; LENS_NUMBERS]>,
    /// Standard deviation of fx, pixels.
    pub sd_fx_px: f64,
    /// Degrees of freedom of the calibration, where they are known.
    pub freedom: Option<f64>,
}

impl LensUncertainty {
    /// That of a camera; `place` names its file in errors.
    ///
    /// # Errors
    /// When the file does not say how well its numbers are known, or says what cannot be.
    pub fn of(camera: &Camera, place: &str) -> Result<Self, BadInput> {
        let Some(details) = &camera.provenance.details else {
            return Err(unknown(
                place,
                "calibration",
                "it does not say how well its numbers are known",
            ));
        };
        if details.correlations.is_empty() {
            let found = "it has standard deviations but no correlations: an older program wrote it";
            return Err(unknown(place, "calibration.correlations", found));
        }
        let Deviations { fx_px, fy_px, cx_px, cy_px, skew_px, distortion } = &details.sd;
        let sd: Vec<f64> =
            [fx_px, fy_px, cx_px, cy_px, skew_px].into_iter().chain(distortion).copied().collect();
        let rows = &details.correlations;
        let correlations = DMatrix::from_fn(sd.len(), sd.len(), |row, column| {
            if row == column { 1.0 } else { rows[row.max(column)][row.min(column)] }
        });
        let eigen = SymmetricEigen::new(correlations);
        if eigen.eigenvalues.iter().any(|it| *it < -ROUNDING * sd.len() as f64) {
            return Err(unknown(place, "calibration.correlations", "they contradict each other"));
        }
        let way = |(column, eigenvalue): (usize, &f64)| {
            let mut way = [0.0; LENS_NUMBERS];
            for (row, number) in way.iter_mut().take(sd.len()).enumerate() {
                *number = sd[row] * eigen.eigenvectors[(row, column)] * eigenvalue.max(0.0).sqrt();
            }
            way
        };
        Ok(Self {
            ways: eigen.eigenvalues.iter().enumerate().map(way).collect(),
            sd_fx_px: *fx_px,
            freedom: details.freedom.map(f64::from),
        })
    }
}

fn unknown(place: &str, field: &str, found: &str) -> BadInput {
    let remedy = "calibrate again with `plumb calibrate`, which writes the covariance into \
                  camera.toml";
    BadInput::new(place, field, found, remedy)
}

#[cfg(test)]
mod tests {
    use plumbline_files::camera;

    use super::*;

    const HEAD: &str = "width_px = 1456\nheight_px = 1088\nfx_px = 1740\nfy_px = 1740\ncx_px = 727\n\
        cy_px = 543\nmodel = \"radial2\"\ndistortion = [-0.1, 0.02]\n";
    const SD: &str = "[calibration.sd]\nfx_px = 2\nfy_px = 3\ncx_px = 0.5\ncy_px = 0.5\n\
        skew_px = 0.1\ndistortion = [1e-3, 4e-3]\n";

    fn read(correlations: &str) -> Result<LensUncertainty, BadInput> {
        let details =
            "[calibration]\nverdict = []\ncoverage = []\nphotographs = []\nfreedom = 900\n";
        let text = format!("{HEAD}{details}{correlations}\n{SD}");
        LensUncertainty::of(&camera::parse(&text, "camera.toml").unwrap(), "camera.toml")
    }

    #[test]
    fn the_ways_make_up_the_covariance() {
        let rows = "correlations = [[], [0.9], [0, 0], [0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0, 0], \
                    [0.1, 0, 0, 0, 0, -0.8]]";
        let found = read(rows).unwrap();
        let covariance =
            |a: usize, b: usize| found.ways.iter().map(|way| way[a] * way[b]).sum::<f64>();
        let expected =
            [((0, 0), 4.0), ((0, 1), 5.4), ((5, 6), -3.2e-6), ((0, 6), 8e-4), ((2, 3), 0.0)];
        for ((a, b), expected) in expected {
            assert!((covariance(a, b) - expected).abs() < 1e-14, "{a} {b}: {}", covariance(a, b));
        }
        assert_eq!((found.sd_fx_px, found.freedom), (2.0, Some(900.0)));
    }

    #[test]
    fn a_camera_without_a_covariance_is_refused_with_what_to_do() {
        let plain = camera::parse(HEAD, "camera.toml").unwrap();
        let refused = [
            LensUncertainty::of(&plain, "camera.toml").unwrap_err(),
            read("").unwrap_err(),
            // Two numbers that go with a third cannot go against each other.
            read(
                "correlations = [[], [0.9], [0.9, -0.9], [0, 0, 0], [0, 0, 0, 0], \
                  [0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]]",
            )
            .unwrap_err(),
        ];
        let fields = ["calibration", "calibration.correlations", "calibration.correlations"];
        for (error, field) in refused.iter().zip(fields) {
            assert_eq!(error.field, field);
            assert!(
                error.to_string().contains("camera.toml") && error.remedy.contains("calibrate")
            );
        }
    }
}
