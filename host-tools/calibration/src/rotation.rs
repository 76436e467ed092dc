//! The rotation nearest to a matrix, and the mean of poses that follows from it.

use nalgebra::{Matrix3, Vector3};
use plumbline::pose::Pose;

/// The rotation nearest to a matrix with a positive determinant, by the sum of the squared
/// differences of their entries (orthogonal Procrustes problem).
#[must_use]
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let decomposed = matrix.svd(true, true);
    let (left, right) = decomposed.u.zip(decomposed.v_t).expect("both were asked for");
    left * right
}

/// The mean of poses that differ little. Its rotation is the one nearest to the mean of the
/// matrices (chordal mean).
///
/// # Panics
/// When there are no poses: a caller's bug.
#[must_use]
pub fn mean_pose<To, From>(poses: &[Pose<To, From>]) -> Pose<To, From> {
    assert!(!poses.is_empty(), "a mean needs a pose");
    let sum: Matrix3<f64> = poses.iter().map(|pose| pose.rotation).sum();
    let sum_mm: Vector3<f64> = poses.iter().map(|pose| pose.translation_mm).sum();
    Pose::new(nearest_rotation(&sum), sum_mm / poses.len() as f64)
}
