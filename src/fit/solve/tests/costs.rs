//! The cost by which poses are compared, and what counts as an inlier.

extern crate std;

use std::string::ToString as _;

use super::*;

/// The cost by its definition.
fn cost_of(pose: &Pose<Cam, Target>, seen: &[SeenCorner], scale: f64) -> f64 {
    let mut cost = 0.0;
    seen.residuals(pose, |_, [x, y]| cost += robust_square((x * x + y * y) / (scale * scale)))
        .unwrap();
    cost
}

/// Corners of which two are wrong, and which promise a fifth of their standard deviation: the robust
/// scale is about 5.
fn boasting() -> SeenCorners {
    let mut random = Random::new(15);
    let mut seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    spoil(&mut seen, 2, 30.0, &mut random);
    for seen in &mut seen {
        seen.sigma_px = 0.02;
    }
    seen
}

#[test]
fn the_robust_square_is_the_square_up_to_its_cap() {
    assert_eq!(robust_square(5.0), 5.0);
    // The integral of the weight from 6 to 25 is a third of that interval.
    for beyond in [25.0, 1e6] {
        assert!((robust_square(beyond) - (6.0 + 19.0 / 3.0)).abs() < 1e-12);
    }
}

#[test]
fn the_cost_is_the_sum_of_robust_squares_in_scales() {
    let seen = boasting();
    let solution = solve(&tilted(), &seen[..], 10).unwrap();
    assert!((3.0..8.0).contains(&solution.scale), "{}", solution.scale);
    let pose = &solution.cam_from_target;
    // Rounding of 30 summands.
    let is_same = |cost: f64, expected: f64| (cost / expected - 1.0).abs() < 1e-12;
    for scale in [1.0, 2.5, solution.scale] {
        let cost = robust_cost(pose, &seen[..], scale).unwrap();
        assert!(is_same(cost, cost_of(pose, &seen, scale)), "{scale}: {cost}");
    }
    assert!(is_same(solution.cost, cost_of(pose, &seen, solution.scale)), "{}", solution.cost);
}

#[test]
fn the_cost_after_a_step_is_that_of_the_pose_to_which_it_leads() {
    let seen = boasting();
    let mut random = Random::new(16);
    let start = nearby(&tilted(), &mut random);
    let stepped = solve(&start, &seen[..], 1).unwrap().cam_from_target;
    for scale in [1.0, 5.0] {
        let after = robust_cost_after_step(&start, &seen[..], scale).unwrap();
        // The solution's rotation has been made orthogonal to rounding.
        let expected = cost_of(&stepped, &seen, scale);
        assert!((after / expected - 1.0).abs() < 1e-9, "{scale}: {after}, {expected}");
    }
    // From half a millimetre away nearly all corners are beyond the cap; after the step the 28 correct
    // ones cost 2 each in the mean, with a standard deviation of 2.
    let after = robust_cost_after_step(&start, &seen[..], 5.0).unwrap();
    assert!(after < 0.5 * cost_of(&start, &seen, 5.0), "{after}");
    let wrong = 2.0 * (6.0 + 19.0 / 3.0);
    assert!((after - wrong - 56.0).abs() < 4.0 * 2.0 * libm::sqrt(28.0), "{after}");
}

/// Six of the numbers were fitted, which makes residuals smaller than the noise.
#[test]
fn the_scale_makes_up_for_what_was_fitted() {
    let squares = Squares([8.0; 5].into_iter().collect());
    let expected = 8.0 / MEDIAN_SQUARE * (10.0 / 4.0);
    assert!((squares.robust_variance() / expected - 1.0).abs() < 1e-12);
}

#[test]
fn what_is_not_seen_has_no_cost() {
    let seen = boasting();
    let mut behind = tilted();
    behind.translation_mm.z = -1000.0;
    assert_eq!(robust_cost(&behind, &seen[..], 1.0), None);
    assert_eq!(robust_cost_after_step(&behind, &seen[..], 1.0), None);
    assert_eq!(robust_cost_after_step(&tilted(), &seen[..3], 1.0), None);
}

#[test]
fn four_observations_fix_a_pose_and_three_inliers_do_not() {
    let mut random = Random::new(17);
    let all = observe(&bedside_lens(), &tilted(), LUMBAR, 0.05, &mut random);
    let mut seen: SeenCorners = [0, 5, 24, 29].map(|place| all[place]).into_iter().collect();
    let solution = solve(&tilted(), &seen[..], 6).unwrap();
    assert_eq!(solution.inliers.count(), OBSERVATIONS_MIN);
    // With no step to follow it, a wrong one among four has no weight.
    seen[2].ray.x += 1.0;
    assert_eq!(solve(&tilted(), &seen[..], 0), Err(SolveFailure::TooFew));
}

#[test]
fn a_set_holds_what_was_put_into_it() {
    for place in [0, 1, 31, 32, 33, OBSERVATIONS_MAX - 1] {
        let mut set = Inliers::new();
        set.insert(place);
        let held = (0..OBSERVATIONS_MAX + 40).filter(|&other| set.contains(other));
        assert!(held.eq([place]), "{place}");
        assert_eq!(set.count(), 1);
    }
}

#[test]
fn each_failure_is_told_in_words() {
    for (failure, words) in [
        (SolveFailure::TooFew, "fewer than 4"),
        (SolveFailure::Degenerate, "do not fix the pose"),
        (SolveFailure::NotFinite, "not finite"),
        (SolveFailure::BehindCamera, "behind the camera"),
    ] {
        assert!(failure.to_string().contains(words), "{failure}");
    }
}
