//! The board as one frame shows it: sheared and stretched by its motion.
//!
//! The edges of a board are measured beside where a rigid board would have them, and by several
//! pixels of skew their measurement suffers. To the first order a steady motion deforms the board's
//! image, and so the board in its own plane, by an affine map. It is found from a first measurement,
//! and the edges are measured again as those of the deformed board.

use nalgebra::{Matrix6, Vector2, Vector3, Vector6};
use plumbline::lens::Lens;
use plumbline::parts::points_mm;
use plumbline::target::{Role, TargetGeometry};

use crate::model::{Photograph, raw_by_point};

/// Each step leaves a few percent of the deformation, which itself is a few percent.
const STEPS: usize = 3;

/// The unit of the board's coordinates in the fit, so that all its unknowns are of one size.
const UNIT_MM: f64 = 100.0;

/// x' = x + a + b x + c y and y' = y + d + e x + f y.
#[derive(Default)]
struct Affine(Vector6<f64>);

impl Affine {
    fn apply(&self, point_mm: &Vector3<f64>) -> Vector3<f64> {
        let terms = terms(point_mm);
        let [across, down] = [0, 3].map(|first| self.0.fixed_rows::<3>(first).dot(&terms));
        point_mm + Vector3::new(across, down, 0.0)
    }
}

fn terms(point_mm: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(1.0, point_mm.x / UNIT_MM, point_mm.y / UNIT_MM)
}

/// The board whose rigid image, at the pose of the photograph, is closest to what was measured;
/// `None` when that does not determine it.
pub fn board(
    lens: &Lens,
    board: &TargetGeometry,
    photograph: &Photograph,
) -> Option<TargetGeometry> {
    let nodes_mm: Vec<Vector3<f64>> = points_mm(board).collect();
    let mut affine = Affine::default();
    for _ in 0..STEPS {
        affine.0 += step(lens, &nodes_mm, photograph, &affine)?;
    }
    let corners =
        (0..board.corner_count()).map(|index| affine.apply(&board.corner_mm(index)).into());
    let [columns, rows] = [board.columns(), board.rows()].map(|count| count as u8);
    TargetGeometry::from_points(columns, rows, corners, Role::Scene, [0.0; 3]).ok()
}

fn step(
    lens: &Lens,
    nodes_mm: &[Vector3<f64>],
    photograph: &Photograph,
    affine: &Affine,
) -> Option<Vector6<f64>> {
    let pose = &photograph.cam_from_board;
    let mut normal = Matrix6::zeros();
    let mut gradient = Vector6::zeros();
    for seen in photograph.seen.iter() {
        let mut residual = -seen.value_px;
        let mut by_affine = Vector6::zeros();
        for (node, by_px) in seen.points.iter().zip(&seen.by_px) {
            let node_mm = &nodes_mm[*node];
            let point_cam_mm = pose.transform(&affine.apply(node_mm));
            residual += by_px.dot(&lens.project(&point_cam_mm)?);
            let by_point = (raw_by_point(lens, &point_cam_mm)? * pose.rotation).tr_mul(by_px);
            let by_plane = Vector2::new(by_point.x, by_point.y);
            let terms = terms(node_mm);
            for (axis, by_axis) in by_plane.iter().enumerate() {
                let mut part = by_affine.fixed_rows_mut::<3>(3 * axis);
                part += terms * *by_axis;
            }
        }
        normal += by_affine * by_affine.transpose();
        gradient += by_affine * residual;
    }
    Some(-(normal.cholesky()?.solve(&gradient)))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{LENS, board as rigid, one_frame};
    use super::*;

    #[test]
    fn the_apparent_board_has_the_corners_where_they_were_seen() {
        // By 0.7 m/s at 0.7 m the board is skewed by several pixels; the affine map leaves what
        // perspective and acceleration make of it.
        let photograph = one_frame();
        let apparent = board(&LENS, &rigid(), &photograph).unwrap();
        let worst_px = |board: &TargetGeometry| {
            let nodes_mm: Vec<_> = points_mm(board).collect();
            let raw_px: Vec<_> = nodes_mm
                .iter()
                .map(|point| LENS.project(&photograph.cam_from_board.transform(point)).unwrap())
                .collect();
            let residuals = photograph.seen.iter().map(|seen| seen.residual_px(&raw_px).abs());
            residuals.fold(0.0, f64::max)
        };
        let (rigid_px, deformed_px) = (worst_px(&rigid()), worst_px(&apparent));
        assert!(rigid_px > 2.0 && deformed_px < 0.1, "{rigid_px} {deformed_px}");
    }
}
