//! Zhang's closed form (2000): the camera from homographies of a plane, the paper's first step.
//!
//! Input: for each photograph, points of a flat board and where they are seen. Output: the camera
//! matrix K with skew, and each board's pose. Distortion is assumed to be zero; the refinement
//! ([`super::bundle`]) corrects that.

use nalgebra::{DMatrix, Matrix3, SVector, Vector2, Vector3};
use plumbline::pose::{Cam, Pose, Target};

use crate::rotation::nearest_rotation;

/// A point of the board, millimetres, and where it is seen, raw pixels.
pub type Pair = (Vector2<f64>, Vector2<f64>);

/// The camera matrix K.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    pub focal_px: [f64; 2],
    pub centre_px: [f64; 2],
    pub skew_px: f64,
}

impl Pinhole {
    fn matrix(&self) -> Matrix3<f64> {
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.centre_px);
        Matrix3::new(fx, self.skew_px, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    }
}

/// Estimates camera and boards from three or more photographs; `None` when they leave the camera
/// undetermined, for example when no board is tilted.
///
/// If the closed form of all five parameters gives absurd values, which lens distortion can cause,
/// the principal point is assumed to be the centre of the frame and the skew zero, and only the two
/// focal lengths are estimated.
pub fn camera_and_boards(
    photographs: &[Vec<Pair>],
    [width_px, height_px]: [u16; 2],
) -> Option<(Pinhole, Vec<Pose<Cam, Target>>)> {
    let homographies: Vec<Matrix3<f64>> =
        photographs.iter().map(|pairs| homography(pairs)).collect::<Option<_>>()?;
    let size = [width_px, height_px].map(f64::from);
    let is_plausible = |camera: &Pinhole| {
        let [fx, fy] = camera.focal_px;
        let near_middle =
            (0..2).all(|axis| (0.2..0.8).contains(&(camera.centre_px[axis] / size[axis])));
        near_middle && (0.8..1.25).contains(&(fx / fy)) && camera.skew_px.abs() < 0.05 * fx
    };
    let camera = pinhole(&homographies)
        .filter(is_plausible)
        .or_else(|| pinhole_about(&homographies, size.map(|side| (side - 1.0) / 2.0)))?;
    let boards = homographies.iter().map(|homography| board(homography, &camera)).collect();
    Some((camera, boards))
}

/// The homography from board to image (appendix A), with Hartley's normalisation.
fn homography(pairs: &[Pair]) -> Option<Matrix3<f64>> {
    let board = normalisation(pairs.iter().map(|pair| pair.0))?;
    let picture = normalisation(pairs.iter().map(|pair| pair.1))?;
    let mut system = DMatrix::zeros(2 * pairs.len(), 9);
    for (place, (at, seen)) in pairs.iter().enumerate() {
        let [from, to] = [board * at.push(1.0), picture * seen.push(1.0)];
        for axis in 0..2 {
            let row = 2 * place + axis;
            for column in 0..3 {
                system[(row, 3 * axis + column)] = from[column];
                system[(row, 6 + column)] = -to[axis] * from[column];
            }
        }
    }
    let null = null_vector(system)?;
    let normalised = Matrix3::from_row_slice(null.as_slice());
    Some(picture.try_inverse()? * normalised * board)
}

/// Moves points to their centroid and scales them to a mean square distance of 2.
fn normalisation(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<Matrix3<f64>> {
    let count = points.clone().count() as f64;
    let middle = points.clone().sum::<Vector2<f64>>() / count;
    let squares: f64 = points.map(|point| (point - middle).norm_squared()).sum();
    let scale = (2.0 * count / squares).sqrt();
    let [x, y] = (-middle * scale).into();
    scale.is_finite().then(|| Matrix3::new(scale, 0.0, x, 0.0, scale, y, 0.0, 0.0, 1.0))
}

/// The unit vector that minimises the norm of its product with the system.
fn null_vector(system: DMatrix<f64>) -> Option<nalgebra::DVector<f64>> {
    let columns = system.ncols();
    // Uses the square matrix, whose decomposition always has all right singular vectors.
    let square = system.transpose() * &system;
    let decomposed = nalgebra::SymmetricEigen::try_new(square, f64::EPSILON, 1000)?;
    let least = decomposed.eigenvalues.imin();
    let vector = decomposed.eigenvectors.column(least).into_owned();
    (vector.len() == columns && vector.iter().all(|value| value.is_finite())).then_some(vector)
}

/// One row of V (equation 7): h_i^T B h_j as a product with b = B11 B12 B22 B13 B23 B33.
fn row(homography: &Matrix3<f64>, i: usize, j: usize) -> SVector<f64, 6> {
    let (a, b) = (homography.column(i), homography.column(j));
    SVector::from([
        a[0] * b[0],
        a[0] * b[1] + a[1] * b[0],
        a[1] * b[1],
        a[2] * b[0] + a[0] * b[2],
        a[2] * b[1] + a[1] * b[2],
        a[2] * b[2],
    ])
}

/// The two constraints of each homography (equation 8), with unknowns in units of a thousand
/// pixels.
fn constraints(homographies: &[Matrix3<f64>]) -> impl Iterator<Item = SVector<f64, 6>> + '_ {
    homographies.iter().flat_map(|homography| {
        // The lengths of both columns vary with the distance of the board.
        let scaled =
            homography / (homography.column(0).norm() * homography.column(1).norm()).sqrt();
        [row(&scaled, 0, 1), row(&scaled, 0, 0) - row(&scaled, 1, 1)]
    })
}

const PIXELS: f64 = 1000.0;

/// K from the image of the absolute conic (appendix B).
fn pinhole(homographies: &[Matrix3<f64>]) -> Option<Pinhole> {
    let unit = Matrix3::new_nonuniform_scaling(&Vector2::repeat(1.0 / PIXELS));
    let scaled: Vec<_> = homographies.iter().map(|homography| unit * homography).collect();
    let rows: Vec<_> = constraints(&scaled).map(|row| row.transpose()).collect();
    let system = DMatrix::from_fn(rows.len(), 6, |place, column| rows[place][column]);
    let b = null_vector(system)?;
    let [b11, b12, b22, b13, b23, b33] = [0, 1, 2, 3, 4, 5].map(|place| b[place]);
    let determinant = b11 * b22 - b12 * b12;
    let cy = (b12 * b13 - b11 * b23) / determinant;
    let lambda = b33 - (b13 * b13 + cy * (b12 * b13 - b11 * b23)) / b11;
    let fx = (lambda / b11).sqrt();
    let fy = (lambda * b11 / determinant).sqrt();
    let skew = -b12 * fx * fx * fy / lambda;
    let cx = skew * cy / fy - b13 * fx * fx / lambda;
    let numbers = [fx, fy, cx, cy, skew].map(|value| value * PIXELS);
    let [fx, fy, cx, cy, skew_px] = numbers;
    let is_real = numbers.iter().all(|value| value.is_finite()) && fx > 0.0 && fy > 0.0;
    is_real.then_some(Pinhole { focal_px: [fx, fy], centre_px: [cx, cy], skew_px })
}

/// Only the focal lengths: with the principal point at the origin and no skew, B is diagonal.
fn pinhole_about(homographies: &[Matrix3<f64>], centre_px: [f64; 2]) -> Option<Pinhole> {
    let unit = Matrix3::new_nonuniform_scaling(&Vector2::repeat(1.0 / PIXELS))
        * Matrix3::new_translation(&-Vector2::from(centre_px));
    let centred: Vec<_> = homographies.iter().map(|homography| unit * homography).collect();
    let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), Vector2::zeros());
    for row in constraints(&centred) {
        // B33 is 1.
        let (at, value) = (Vector2::new(row[0], row[2]), -row[5]);
        normal += at * at.transpose();
        right += at * value;
    }
    let inverse_squares = normal.try_inverse()? * right;
    let focal_px: [f64; 2] = inverse_squares.map(|value| PIXELS / value.sqrt()).into();
    let is_real = focal_px.iter().all(|value| value.is_finite());
    is_real.then_some(Pinhole { focal_px, centre_px, skew_px: 0.0 })
}

/// The board's pose (section 3.1 and appendix C).
fn board(homography: &Matrix3<f64>, camera: &Pinhole) -> Pose<Cam, Target> {
    let inverse = camera.matrix().try_inverse().expect("positive focal lengths");
    let columns = inverse * homography;
    let scale = 2.0 / (columns.column(0).norm() + columns.column(1).norm());
    // The board stands in front of the camera.
    let columns = columns * if columns[(2, 2)] < 0.0 { -scale } else { scale };
    let [x, y, translation_mm]: [Vector3<f64>; 3] =
        [0, 1, 2].map(|column| columns.column(column).into_owned());
    let rough = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    Pose::new(nearest_rotation(&rough), translation_mm)
}
