//! The two poses that explain a plane seen from afar, and the choice between them.

use nalgebra::Matrix3;

use super::measurement::MeasureFailure;
use crate::fit::edge::SeenEdges;
use crate::fit::solve::{Observations, Solution, robust_cost, robust_cost_after_step, solve};
use crate::model::pose::{Cam, Pose, Target};

/// One edge in this many is enough to rule out a mirrored pose unless the target is seen frontally.
const EDGES_STRIDE: usize = 3;

/// The pose that explains the edges, from a pose near it.
///
/// A plane seen from afar has two poses that explain it nearly equally well, one the other's mirror
/// image (Schweighofer and Pinz 2006). Both are considered in every frame, and the mirrored one is
/// taken when it is better beyond doubt: a warm start alone would stay in the wrong one for ever
/// once noise had led it there while the target was seen frontally. If a mirrored pose is not
/// better after one step, more steps do not make it better beyond doubt; nor is it if a part of the
/// edges alone speaks more against it than all of them do against the other.
pub(super) fn both_minima(
    near_cam_from_target: &Pose<Cam, Target>,
    seen: &SeenEdges<'_>,
    iterations: usize,
    doubt: f64,
) -> Result<Solution, MeasureFailure> {
    let kept = solve(near_cam_from_target, seen, iterations).ok();
    let near = kept.as_ref().map_or(near_cam_from_target, |kept| &kept.cam_from_target);
    let other = mirror_image(near);
    if let Some(kept) = kept {
        let some = seen.one_in(EDGES_STRIDE);
        let cost_of_some = robust_cost_after_step(&other, &some, kept.scale);
        if cost_of_some.is_some_and(|cost| cost > kept.cost)
            || robust_cost_after_step(&other, seen, kept.scale).is_none_or(|cost| cost > kept.cost)
        {
            return Ok(kept);
        }
    }
    let mirrored = solve(&other, seen, iterations).ok();
    better(kept, mirrored, seen, doubt).ok_or(MeasureFailure::PoorFit)
}

/// The other pose that explains a plane nearly as well: its mirror image in the
/// plane at right angles to the line of sight.
///
/// Seen along the line of sight v the target's outline stays and its depths
/// change sign: R' = (I - 2 v v^T) R diag(1, 1, -1).
#[must_use]
pub fn mirror_image(cam_from_target: &Pose<Cam, Target>) -> Pose<Cam, Target> {
    let sight = cam_from_target.translation_mm.normalize();
    let reflection = Matrix3::identity() - sight * sight.transpose() * 2.0;
    let mut rotation = reflection * cam_from_target.rotation;
    rotation.column_mut(2).neg_mut();
    Pose::new(rotation, cam_from_target.translation_mm)
}

/// The second solution when its cost is lower by more than `margin`, else the first.
pub(super) fn better<O: Observations + ?Sized>(
    first: Option<Solution>,
    second: Option<Solution>,
    observations: &O,
    margin: f64,
) -> Option<Solution> {
    let (Some(one), Some(two)) = (first, second) else { return first.or(second) };
    // One scale for both: that of the better one, which is nearer the noise.
    let scale = one.scale.min(two.scale);
    let cost = |solution: &Solution| {
        robust_cost(&solution.cam_from_target, observations, scale).unwrap_or(f64::INFINITY)
    };
    Some(if cost(&two) + margin < cost(&one) { two } else { one })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{Random, SeenCorners, bedside_lens, observe};

    /// Corners seen at a pose, and the solution there and half a millimetre beside it.
    fn seen_and_two_solutions() -> (SeenCorners, [Solution; 2]) {
        let mut random = Random::new(1);
        let pose = Pose::<Cam, Target>::from_theta([0.2, 0.3, -0.1, 80.0, -60.0, 1000.0]);
        let mut beside = pose;
        beside.translation_mm.x += 0.5;
        let seen = observe(&bedside_lens(), &pose, [6, 5], 1.0, &mut random);
        let solutions = [pose, beside].map(|pose| solve(&pose, &seen[..], 0).unwrap());
        (seen, solutions)
    }

    #[test]
    fn the_second_solution_must_be_better_by_the_margin() {
        let (seen, [good, poor]) = seen_and_two_solutions();
        // Both in the scale of the better one.
        let [low, high] =
            [good, poor].map(|it| robust_cost(&it.cam_from_target, &seen[..], good.scale).unwrap());
        let apart = high - low;
        assert!(apart > 1.0 && good.scale < poor.scale, "{apart}");
        let chosen = |one, two, margin| better(one, two, &seen[..], margin);
        assert_eq!(chosen(Some(poor), Some(good), 0.0), Some(good));
        assert_eq!(chosen(Some(poor), Some(good), 0.999 * apart), Some(good));
        assert_eq!(chosen(Some(poor), Some(good), 1.001 * apart), Some(poor));
        assert_eq!(chosen(Some(good), Some(poor), 0.0), Some(good));
        assert_eq!(chosen(Some(good), Some(poor), 1.0), Some(good));
        // One alone has nothing to be better than.
        assert_eq!(chosen(Some(poor), None, 1.0), Some(poor));
        assert_eq!(chosen(None, Some(poor), 1.0), Some(poor));
        assert_eq!(chosen(None, None, 0.0), None);
    }

    #[test]
    fn the_mirror_image_keeps_the_outline_and_turns_the_tilt() {
        let pose = Pose::<Cam, Target>::from_theta([0.2, 0.3, -0.1, 80.0, -60.0, 1000.0]);
        let mirrored = mirror_image(&pose);
        assert!((mirrored.rotation.determinant() - 1.0).abs() < 1e-12);
        let sight = pose.translation_mm.normalize();
        for axis in 0..2 {
            let (was, is) = (pose.rotation.column(axis), mirrored.rotation.column(axis));
            // Depth changes sign, and what is seen at right angles to it stays.
            assert!((was.dot(&sight) + is.dot(&sight)).abs() < 1e-12);
            assert!((was - sight * was.dot(&sight) - is + sight * is.dot(&sight)).norm() < 1e-12);
        }
        assert!((mirror_image(&mirrored).rotation - pose.rotation).norm() < 1e-12);
    }
}
