//! The steps of a descent: which are taken, how they are damped, and when they end.

use core::cell::Cell;

use super::*;

/// Counts how often the normal equations are computed, and says of the first steps, so many, that they lead
/// behind the camera.
struct Watched<'a> {
    seen: &'a [SeenCorner],
    jacobians: Cell<usize>,
    residuals: Cell<usize>,
    steps_refused: usize,
}

impl<'a> Watched<'a> {
    fn new(seen: &'a [SeenCorner], steps_refused: usize) -> Self {
        Self { seen, jacobians: Cell::new(0), residuals: Cell::new(0), steps_refused }
    }
}

impl Observations for Watched<'_> {
    fn count(&self) -> usize {
        self.seen.count()
    }

    fn are_finite(&self) -> bool {
        self.seen.are_finite()
    }

    fn residuals(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        visit: impl FnMut(usize, [f64; 2]),
    ) -> Option<()> {
        // Before the first step, those of the start are asked for.
        let steps = self.residuals.replace(self.residuals.get() + 1);
        let is_refused = (1..=self.steps_refused).contains(&steps);
        if is_refused { None } else { self.seen.residuals(cam_from_target, visit) }
    }

    fn residuals_with_jacobian(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        visit: impl FnMut(usize, &[f64; 2], &[[f64; 6]; 2]),
    ) -> Option<()> {
        self.jacobians.set(self.jacobians.get() + 1);
        self.seen.residuals_with_jacobian(cam_from_target, visit)
    }
}

fn with_sigma(seen: &SeenCorners, sigma_px: f64) -> SeenCorners {
    seen.iter().map(|seen| SeenCorner { sigma_px, ..*seen }).collect()
}

#[test]
fn a_descent_ends_when_a_step_would_be_too_short() {
    let mut random = Random::new(20);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let counted = Watched::new(&seen, 0);
    solve(&nearby(&tilted(), &mut random), &counted, 100).unwrap();
    // The scale and the weights change with each step, so that it leaves up to a tenth of the way: from some
    // ten standard deviations to a ten-thousandth of one are six or seven.
    assert!(counted.jacobians.get() <= 8, "{}", counted.jacobians.get());
}

/// All that is decided, is decided by residuals in their own scale: it makes no difference by how much
/// too small all standard deviations are.
#[test]
fn a_promise_that_is_not_believed_changes_no_step() {
    let mut random = Random::new(21);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    for iterations in 1..8 {
        let start = nearby(&tilted(), &mut random);
        let of = |sigma_px: f64| {
            let seen = with_sigma(&seen, sigma_px);
            let counted = Watched::new(&seen, 0);
            let solution = solve(&start, &counted, iterations).unwrap();
            (solution, counted.jacobians.get())
        };
        let [(one, one_count), (other, other_count)] = [0.01, 0.0001].map(of);
        assert_eq!(one_count, other_count, "{iterations}");
        assert_eq!(one.inliers, other.inliers);
        let apart_mm = one.cam_from_target.translation_mm - other.cam_from_target.translation_mm;
        // Rounding, of positions of 1 m.
        assert!(apart_mm.norm() < 1e-9, "{iterations}: {apart_mm}");
    }
}

#[test]
fn the_covariance_is_that_at_the_pose_which_was_reached() {
    let mut random = Random::new(22);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let far = tilted().moved_by(&Vector6::new(0.1, -0.1, 0.1, 5.8, -5.8, 5.8));
    let stepped = solve(&far, &seen[..], 1).unwrap();
    let there = solve(&stepped.cam_from_target, &seen[..], 0).unwrap();
    let ratio = stepped.covariance.norm() / there.covariance.norm();
    // Rounding in the inverse of a matrix whose smallest pivot is about 1e-4.
    assert!((ratio - 1.0).abs() < 1e-9, "{ratio}");
    // After a step shorter than a standard deviation, that before it serves.
    let best = solve(&far, &seen[..], 10).unwrap().cam_from_target;
    let near = best.moved_by(&Vector6::new(0.0, 0.0, 0.0, 1e-3, 0.0, 0.0));
    let counted = Watched::new(&seen, 0);
    solve(&near, &counted, 1).unwrap();
    assert_eq!(counted.jacobians.get(), 1);
}

#[test]
fn numbers_in_units_of_different_size_are_not_taken_for_degenerate() {
    let units = Vector6::new(1e-4, 1.0, 1e4, 1e3, 1e-3, 10.0);
    let of_units = |i: usize, j: usize| if i == j { 2.0 } else { 0.5 };
    let matrix = Matrix6::from_fn(|i, j| of_units(i, j) * units[i] * units[j]);
    let inverse = NormalEquations { matrix, gradient: Vector6::zeros() }.inverse().unwrap();
    let product = matrix * inverse;
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
        let one = if i == j { 1.0 } else { 0.0 };
        // Rounding, of a matrix whose largest eigenvalue is three times its smallest.
        assert!((product[(i, j)] * units[j] / units[i] - one).abs() < 1e-14, "{i} {j}");
    }
}

/// A start from which the whole step leads too far is followed with more and more damping.
#[test]
fn a_step_that_was_undone_is_tried_again_with_more_damping() {
    let mut random = Random::new(23);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let (mut undone, mut lowered) = (0, 0);
    for _ in 0..2000 {
        let spread = Vector6::new(1.5, 1.5, 1.5, 100.0, 100.0, 500.0);
        let start = tilted().moved_by(&spread.map(|spread| spread * random.normal()));
        let Ok(first) = solve(&start, &seen[..], 1) else { continue };
        let has_stayed =
            (first.cam_from_target.translation_mm - start.translation_mm).norm() == 0.0;
        if !has_stayed {
            continue;
        }
        undone += 1;
        let solution = solve(&start, &seen[..], 12).unwrap();
        let scale = first.scale;
        let [before, after] =
            [start, solution.cam_from_target].map(|it| robust_cost(&it, &seen[..], scale).unwrap());
        lowered += usize::from(after < before);
    }
    // Ten steps raise the damping to a million, under which no direction leads up.
    assert!(undone >= 20, "{undone}");
    assert_eq!(lowered, undone);
}

/// Where the corners are linear in the pose, a step leaves a share of the way that grows as the damping.
#[test]
fn each_step_that_is_undone_raises_the_damping_tenfold() {
    let mut random = Random::new(25);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.0, &mut random);
    let start = tilted().moved_by(&Vector6::new(1e-5, -1e-5, 1e-5, 1e-2, -1e-2, 1e-2));
    let left_mm = |undone: usize| {
        let found =
            solve(&start, &Watched::new(&seen, undone), undone + 1).unwrap().cam_from_target;
        (found.translation_mm - tilted().translation_mm).norm()
    };
    let [less, more] = [0, 1].map(left_mm);
    // A little less than ten: with a damping of 1e-3, already a twentieth of what is left to go is taken.
    let ratio = more / less;
    assert!((9.0..=10.0).contains(&ratio), "{less} {more}");
}

/// Each step that is taken divides the damping by ten, and with it what the next one leaves.
#[test]
fn the_damping_falls_with_each_step() {
    let mut random = Random::new(24);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.0, &mut random);
    let start = nearby(&tilted(), &mut random);
    let off_mm = |iterations: usize| {
        let found = solve(&start, &seen[..], iterations).unwrap().cam_from_target;
        (found.translation_mm - tilted().translation_mm).norm()
    };
    let (first, second) = (off_mm(1), off_mm(2));
    // The second step's damping is 1e-5. Where a turn and a displacement look alike, some sixty times
    // that is left, and with the first step's damping it would be ten times as much.
    assert!(second < 2e-3 * first, "{first} {second}");
}
