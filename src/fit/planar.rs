//! Closed-form pose of a plane, with both of its minima.
//!
//! In: corners of a flat target and the rays along which they were seen. Out: one or two poses,
//! best first, good enough to start [`crate::fit::solve`]. The homography of the plane is Zhang's
//! (2000, appendix A: normalised direct linear transform, least squares). The decomposition is that
//! of Collins and Bartoli ("Infinitesimal plane-based pose estimation", 2014), which needs the
//! homography only to first order about the target's middle. Zhang's own decomposition (section 3.1
//! and appendix C) reads the tilt from the perspective terms, which for a target that is small
//! against its distance are mostly noise.
//!
//! To first order a plane and its mirror image about the line of sight look the
//! same, so that the reprojection error has two minima (Schweighofer and Pinz
//! 2006). The further and the smaller the target, the less they differ, until
//! noise alone decides which is the lower one: a caller keeps both until one is
//! ruled out, by its residuals or by where the target was before.
//!
//! Cost: a few microseconds; no iteration. It is not robust: one wrong corner
//! spoils it.

use heapless::Vec;
use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3};

use crate::fit::solve::{Observations, by_motion};
use crate::model::lens::{ray_by_point, ray_of};
use crate::model::lens_table::LensTable;
use crate::model::pose::{Cam, Pose, Target};

/// Fewest points: a homography has 8 parameters, and a point gives 2 equations.
pub const POINTS_MIN: usize = 4;

/// Width over length below which points count as collinear. The narrowest target,
/// 3 corners by 40, has 0.06 face on, and 0.005 seen at 5 degrees from its edge.
const WIDTH_OVER_LENGTH_MIN: f64 = 1e-3;

/// Smallest ratio of a pivot of a homography's normal equations to their largest: below it the
/// points leave a parameter undetermined. Rounding leaves 1e-16 for a singular system; 3 x 40
/// corners have 3e-3.
const PIVOT_RATIO_MIN: f64 = 1e-6;

/// Why a plane has no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlanarFailure {
    /// Fewer than [`POINTS_MIN`] corners.
    TooFewPoints,
    /// A coordinate is not finite.
    NotFinite,
    /// The corners, or the rays, lie (nearly) on one line, or all but one of them do.
    Degenerate,
    /// The rays show the target's back: the corners are numbered the wrong way round.
    Mirrored,
    /// Every solution puts a corner behind the camera.
    BehindCamera,
}

impl core::fmt::Display for PlanarFailure {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::TooFewPoints => "fewer than 4 corners",
            Self::NotFinite => "a coordinate is not finite",
            Self::Degenerate => "the corners lie on one line",
            Self::Mirrored => "the corners are numbered the wrong way round",
            Self::BehindCamera => "a corner would lie behind the camera",
        })
    }
}

impl core::error::Error for PlanarFailure {}

/// A corner that was seen: its position on the target, the ray along which it was seen, and how raw
/// pixels change with the ray there.
///
/// Its residual is in raw pixels although it arrives as a ray: the difference of two rays times
/// `raw_by_ray`. Noise is uniform on the sensor; a wide-angle lens makes it several times larger in
/// undistorted pixels at the frame's edge than in the middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenCorner {
    /// The corner in the target frame.
    pub point_target_mm: Vector3<f64>,
    /// The ray seen, undistorted, at z = 1.
    pub ray: Vector2<f64>,
    /// d raw pixel / d ray, there.
    pub raw_by_ray: Matrix2<f64>,
    /// Standard deviation of one raw coordinate.
    pub sigma_px: f64,
}

impl SeenCorner {
    /// A corner seen at a raw pixel; `None` when no ray reaches it.
    #[must_use]
    pub fn new(
        point_target_mm: Vector3<f64>,
        lens: &LensTable,
        raw_px: &Vector2<f64>,
        sigma_px: f64,
    ) -> Option<Self> {
        let ray = lens.ray_from_raw(raw_px)?;
        let (_, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
        Some(Self { point_target_mm, ray, raw_by_ray, sigma_px })
    }

    fn is_finite(&self) -> bool {
        // A sum is finite only if its terms are, and no usable term is near overflow.
        let sum = self.point_target_mm.sum() + self.ray.sum() + self.raw_by_ray.sum();
        sum.is_finite() && self.sigma_px > 0.0 && self.sigma_px.is_finite()
    }

    fn residual(&self, ray: &Vector2<f64>) -> [f64; 2] {
        (self.raw_by_ray * (ray - self.ray) / self.sigma_px).into()
    }
}

impl Observations for [SeenCorner] {
    fn count(&self) -> usize {
        self.len()
    }

    fn are_finite(&self) -> bool {
        self.iter().all(SeenCorner::is_finite)
    }

    fn residuals(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        mut visit: impl FnMut(usize, [f64; 2]),
    ) -> Option<()> {
        for (place, seen) in self.iter().enumerate() {
            let ray = ray_of(&cam_from_target.transform(&seen.point_target_mm))?;
            visit(place, seen.residual(&ray));
        }
        Some(())
    }

    fn residuals_with_jacobian(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        mut visit: impl FnMut(usize, &[f64; 2], &[[f64; 6]; 2]),
    ) -> Option<()> {
        for (place, seen) in self.iter().enumerate() {
            let arm_cam_mm = cam_from_target.rotation * seen.point_target_mm;
            let point_cam_mm = arm_cam_mm + cam_from_target.translation_mm;
            let ray = ray_of(&point_cam_mm)?;
            let by_point = seen.raw_by_ray / seen.sigma_px * ray_by_point(&point_cam_mm, &ray);
            let rows = [0, 1].map(|row| by_motion(&by_point.row(row).transpose(), &arm_cam_mm));
            visit(place, &seen.residual(&ray), &rows);
        }
        Some(())
    }
}

/// One of the two poses of a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// The pose, not yet refined.
    pub cam_from_target: Pose<Cam, Target>,
    /// Root mean square of the raw-pixel residuals' lengths, unweighted.
    pub rms_px: f64,
}

/// One or two poses, best first.
pub type PlanarPoses = Vec<PlanarPose, 2>;

/// Both poses of a plane, best first. One is left out only when it puts a corner
/// behind the camera.
///
/// The homography treats the target as flat and ignores the z of its points; the translation and
/// the ranking use it.
///
/// # Errors
/// [`PlanarFailure`].
pub fn planar_poses(observations: &[SeenCorner]) -> Result<PlanarPoses, PlanarFailure> {
    if observations.len() < POINTS_MIN {
        return Err(PlanarFailure::TooFewPoints);
    }
    if !observations.iter().all(SeenCorner::is_finite) {
        return Err(PlanarFailure::NotFinite);
    }
    let plane = Normalisation::of(observations.iter().map(|seen| seen.point_target_mm.xy()))
        .ok_or(PlanarFailure::Degenerate)?;
    let image = Normalisation::of(observations.iter().map(|seen| seen.ray))
        .ok_or(PlanarFailure::Degenerate)?;
    let homography = homography(observations, &plane, &image).ok_or(PlanarFailure::Degenerate)?;
    let rotations = rotations(&homography, &image)?;

    let mut poses = PlanarPoses::new();
    for rotation in rotations {
        let Some(translation_mm) = translation(observations, &rotation) else { continue };
        let cam_from_target = Pose::new(rotation, translation_mm);
        let Some(rms_px) = rms(observations, &cam_from_target) else { continue };
        // There are two rotations and room for two poses: this cannot fail.
        let _ = poses.push(PlanarPose { cam_from_target, rms_px });
    }
    if poses.is_empty() {
        return Err(PlanarFailure::BehindCamera);
    }
    if poses.len() == 2 && poses[1].rms_px < poses[0].rms_px {
        poses.swap(0, 1);
    }
    Ok(poses)
}

/// Moves points to their centroid and scales them to a mean square distance of
/// 2 from it (Hartley 1997): `normalised = (point - centre) * scale`.
struct Normalisation {
    centre: Vector2<f64>,
    scale: f64,
}

impl Normalisation {
    /// `None` when the points lie (nearly) on one line.
    fn of(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<Self> {
        let count = points.clone().count() as f64;
        let centre = points.clone().sum::<Vector2<f64>>() / count;
        let scatter: Matrix2<f64> =
            points.map(|point| (point - centre) * (point - centre).transpose()).sum();
        // Eigenvalues of a symmetric 2 x 2: the sums of squares along and across the line.
        let trace = scatter.trace();
        let gap = libm::hypot(scatter[(0, 0)] - scatter[(1, 1)], 2.0 * scatter[(0, 1)]);
        let (along, across) = ((trace + gap) * 0.5, (trace - gap) * 0.5);
        let wide = across > WIDTH_OVER_LENGTH_MIN * WIDTH_OVER_LENGTH_MIN * along;
        wide.then(|| Self { centre, scale: libm::sqrt(2.0 * count / trace) })
    }

    fn apply(&self, point: &Vector2<f64>) -> Vector2<f64> {
        (point - self.centre) * self.scale
    }
}

/// The homography from normalised target points to normalised rays, its last element 1. That
/// element is the depth of the middle of what is seen, which is in front of the camera, so that it
/// is not 0.
fn homography(
    observations: &[SeenCorner],
    plane: &Normalisation,
    image: &Normalisation,
) -> Option<Matrix3<f64>> {
    // Whether the points determine a homography depends on the target alone, and is tested with the
    // target seen face on: noise in the rays would hide a singular system.
    let mut face_on = HomographyEquations::zero();
    let mut seen_equations = HomographyEquations::zero();
    for seen in observations {
        let from = plane.apply(&seen.point_target_mm.xy());
        face_on.add(&from, &from);
        seen_equations.add(&from, &image.apply(&seen.ray));
    }
    // The factor's diagonal holds the square roots of the pivots.
    let pivots = face_on.normal.cholesky()?.l_dirty().diagonal();
    if pivots.min() < libm::sqrt(PIVOT_RATIO_MIN) * pivots.max() {
        return None;
    }
    let h = seen_equations.normal.cholesky()?.solve(&seen_equations.right);
    Some(Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0))
}

/// Normal equations of a homography's first 8 elements, row by row.
struct HomographyEquations {
    normal: SMatrix<f64, 8, 8>,
    right: SVector<f64, 8>,
}

impl HomographyEquations {
    fn zero() -> Self {
        Self { normal: SMatrix::zeros(), right: SVector::zeros() }
    }

    fn add(&mut self, from: &Vector2<f64>, to: &Vector2<f64>) {
        let (x, y) = (from.x, from.y);
        let rows = [
            ([x, y, 1.0, 0.0, 0.0, 0.0, -x * to.x, -y * to.x], to.x),
            ([0.0, 0.0, 0.0, x, y, 1.0, -x * to.y, -y * to.y], to.y),
        ];
        for (row, value) in rows {
            let row = SVector::from(row);
            self.normal += row * row.transpose();
            self.right += row * value;
        }
    }
}

/// The two rotations of a homography (Collins and Bartoli 2014, section 4).
///
/// With Q a rotation that takes the optical axis to the line of sight to the
/// target's middle, R = Q S, and d ray / d target there = B S22 / depth, where S22
/// is the upper left 2 x 2 of S and B that of the projection behind Q. The largest
/// singular value of S22 is 1, which gives the depth; the lengths of the columns
/// of S give its third row up to one sign: the two solutions.
fn rotations(
    homography: &Matrix3<f64>,
    image: &Normalisation,
) -> Result<[Matrix3<f64>; 2], PlanarFailure> {
    // The homography's value and Jacobian at the target's middle. Its scale does
    // not matter: the depth is refitted with the translation.
    let middle = homography.fixed_view::<2, 1>(0, 2).into_owned();
    let perspective = homography.fixed_view::<1, 2>(2, 0).into_owned();
    let jacobian = homography.fixed_view::<2, 2>(0, 0) - middle * perspective;
    if jacobian.determinant() <= 0.0 {
        return Err(PlanarFailure::Mirrored);
    }
    let sight = middle / image.scale + image.centre;

    // The rotation by the shortest way from (0, 0, 1) to the line of sight.
    let (x, y) = (sight.x, sight.y);
    let length = libm::sqrt(1.0 + x * x + y * y);
    let (x, y, z) = (x / length, y / length, 1.0 / length);
    let bend = 1.0 / (1.0 + z);
    let turn = Matrix3::new(
        1.0 - x * x * bend,
        -x * y * bend,
        x,
        -x * y * bend,
        1.0 - y * y * bend,
        y,
        -x,
        -y,
        z,
    );
    let projected = turn.fixed_view::<2, 2>(0, 0) - sight * turn.fixed_view::<1, 2>(2, 0);
    let scaled = projected.try_inverse().ok_or(PlanarFailure::Degenerate)? * jacobian;

    // Largest singular value of a 2 x 2.
    let square = scaled.tr_mul(&scaled);
    let gap = libm::hypot(square[(0, 0)] - square[(1, 1)], 2.0 * square[(0, 1)]);
    let largest = libm::sqrt(0.5 * (square.trace() + gap));
    let upper = scaled / largest;
    // Columns of S have length 1; what is missing is the third row's square. It has
    // rank 1; rounding may leave a small negative diagonal.
    let missing = Matrix2::identity() - upper.tr_mul(&upper);
    let first = libm::sqrt(missing[(0, 0)].max(0.0));
    let second = libm::copysign(libm::sqrt(missing[(1, 1)].max(0.0)), missing[(0, 1)]);
    Ok([1.0, -1.0].map(|sign: f64| {
        // Of length 1, and perpendicular to each other by construction.
        let x_axis = Vector3::new(upper[(0, 0)], upper[(1, 0)], sign * first);
        let y_axis = Vector3::new(upper[(0, 1)], upper[(1, 1)], sign * second);
        turn * Matrix3::from_columns(&[x_axis, y_axis, x_axis.cross(&y_axis)])
    }))
}

/// The translation that fits a rotation best: least squares on
/// `x (r_z p + t_z) = r_x p + t_x` and the same for y, linear in t.
fn translation(observations: &[SeenCorner], rotation: &Matrix3<f64>) -> Option<Vector3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for seen in observations {
        let turned_mm = rotation * seen.point_target_mm;
        let ray = seen.ray;
        // Each equation is row . t = value.
        for (row, value) in [
            (Vector3::new(1.0, 0.0, -ray.x), ray.x * turned_mm.z - turned_mm.x),
            (Vector3::new(0.0, 1.0, -ray.y), ray.y * turned_mm.z - turned_mm.y),
        ] {
            normal += row * row.transpose();
            right += row * value;
        }
    }
    Some(normal.cholesky()?.solve(&right))
}

/// RMS of the residuals' lengths in raw pixels; `None` when a corner lies behind the camera.
fn rms(observations: &[SeenCorner], cam_from_target: &Pose<Cam, Target>) -> Option<f64> {
    let mut sum = 0.0;
    for seen in observations {
        let ray = ray_of(&cam_from_target.transform(&seen.point_target_mm))?;
        sum += (seen.raw_by_ray * (ray - seen.ray)).norm_squared();
    }
    let rms_px = libm::sqrt(sum / observations.len() as f64);
    rms_px.is_finite().then_some(rms_px)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::pose::{rotation_from_vector, vector_from_rotation};
    use crate::test_support::{Random, bedside_lens, observe};

    mod steps;

    fn angle_deg(a: &Pose<Cam, Target>, b: &Pose<Cam, Target>) -> f64 {
        vector_from_rotation(&a.rotation.tr_mul(&b.rotation)).norm().to_degrees()
    }

    /// Tilts and places all over the picture.
    fn scattered(random: &mut Random) -> Pose<Cam, Target> {
        let roll = random.uniform(-3.0, 3.0);
        let (yaw, pitch) = (random.uniform(-0.9, 0.9), random.uniform(-0.9, 0.9));
        let z_mm = random.uniform(400.0, 3000.0);
        let [x_mm, y_mm] = [0.3, 0.2].map(|side| random.uniform(-side, side) * z_mm);
        Pose::from_theta([roll, yaw, pitch, x_mm, y_mm, z_mm])
    }

    #[test]
    fn exact_corners_give_the_exact_pose_first() {
        let mut random = Random::new(21);
        for _ in 0..300 {
            let wanted = scattered(&mut random);
            let seen = observe(&bedside_lens(), &wanted, [6, 5], 0.0, &mut random);
            let best = planar_poses(&seen).unwrap()[0];
            // A tilt is the root of a small difference: 1e-13 face on is 3e-7 rad.
            assert!(angle_deg(&best.cam_from_target, &wanted) < 1e-4);
            let off_mm = best.cam_from_target.translation_mm - wanted.translation_mm;
            assert!(off_mm.norm() < 1e-5, "{off_mm}");
            assert!(best.rms_px < 1e-6, "{}", best.rms_px);
        }
    }

    #[test]
    fn the_second_pose_mirrors_the_normal_about_the_line_of_sight() {
        let mut random = Random::new(22);
        for _ in 0..100 {
            let wanted = scattered(&mut random);
            let seen = observe(&bedside_lens(), &wanted, [5, 4], 0.0, &mut random);
            let poses = planar_poses(&seen).unwrap();
            let normals = [0, 1]
                .map(|place: usize| poses[place].cam_from_target.rotation.column(2).into_owned());
            let sight = wanted.translation_mm.normalize();
            let mirrored = sight * (2.0 * normals[0].dot(&sight)) - normals[0];
            // The line of sight to the corners' centroid, which differs from the target's middle to
            // second order in size over distance.
            assert!((mirrored - normals[1]).norm() < 1e-5, "{}", (mirrored - normals[1]).norm());
            assert!(poses[0].rms_px <= poses[1].rms_px);
        }
    }

    #[test]
    fn noise_leaves_the_truth_within_reach_of_one_of_the_two() {
        // 30 corners at 0.1 px and 1 m: one of the two is within 4 degrees and 5 mm, where
        // the solver converges (it does from 10 and 10).
        let mut random = Random::new(23);
        for _ in 0..500 {
            let mut wanted = scattered(&mut random);
            wanted.translation_mm *= 1000.0 / wanted.translation_mm.z;
            let seen = observe(&bedside_lens(), &wanted, [6, 5], 0.1, &mut random);
            let poses = planar_poses(&seen).unwrap();
            let near = poses.iter().any(|pose| {
                let off_mm = pose.cam_from_target.translation_mm - wanted.translation_mm;
                angle_deg(&pose.cam_from_target, &wanted) < 4.0 && off_mm.norm() < 5.0
            });
            assert!(near, "{wanted:?}");
        }
    }

    #[test]
    fn an_origin_outside_the_grid_changes_nothing() {
        let mut random = Random::new(24);
        let wanted = scattered(&mut random);
        let mut seen = observe(&bedside_lens(), &wanted, [6, 5], 0.0, &mut random);
        let shift_mm = Vector3::new(500.0, -300.0, 0.0);
        for seen in &mut seen {
            seen.point_target_mm += shift_mm;
        }
        let best = planar_poses(&seen).unwrap()[0].cam_from_target;
        let same_mm = best.transform(&shift_mm) - wanted.translation_mm;
        assert!(same_mm.norm() < 1e-4, "{same_mm}");
    }

    #[test]
    fn what_has_no_pose_has_a_reason() {
        let mut random = Random::new(25);
        let pose = Pose::from_theta([0.1, 0.3, -0.2, 50.0, -80.0, 1000.0]);
        let good = observe(&bedside_lens(), &pose, [6, 5], 0.05, &mut random);
        let refused = |seen: &[SeenCorner]| planar_poses(seen).map(|_| ()).unwrap_err();
        assert_eq!(refused(&good[..3]), PlanarFailure::TooFewPoints);
        // One row.
        assert_eq!(refused(&good[..6]), PlanarFailure::Degenerate);
        // One row and one corner more: a pencil of homographies.
        assert_eq!(refused(&good[..7]), PlanarFailure::Degenerate);
        assert_eq!(refused(&[good[3]; 5]), PlanarFailure::Degenerate);
        // Correct corners, all seen in one place.
        let mut squeezed = good.clone();
        squeezed.iter_mut().for_each(|seen| seen.ray = good[0].ray);
        assert_eq!(refused(&squeezed), PlanarFailure::Degenerate);
        let mut mirrored = good.clone();
        mirrored.iter_mut().for_each(|seen| seen.point_target_mm.x *= -1.0);
        assert_eq!(refused(&mirrored), PlanarFailure::Mirrored);
        let mut spoilt = good.clone();
        spoilt[5].ray.x = f64::NAN;
        assert_eq!(refused(&spoilt), PlanarFailure::NotFinite);
    }

    #[test]
    fn four_corners_are_enough() {
        let mut random = Random::new(26);
        let wanted = Pose::new(
            rotation_from_vector(&Vector3::new(0.3, -0.4, 0.2)),
            Vector3::new(30.0, 20.0, 800.0),
        );
        let seen = observe(&bedside_lens(), &wanted, [2, 2], 0.0, &mut random);
        let best = planar_poses(&seen).unwrap()[0].cam_from_target;
        assert!(angle_deg(&best, &wanted) < 1e-4);
    }
}
