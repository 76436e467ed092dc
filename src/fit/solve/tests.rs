use super::*;
use nalgebra::Vector2;

use crate::fit::planar::{SeenCorner, planar_poses};
use crate::model::pose::vector_from_rotation;
use crate::test_support::{Random, SeenCorners, bedside_lens, observe, repetitions};

mod costs;
mod steps;

const LUMBAR: [u8; 2] = [6, 5];
const SHOULDER: [u8; 2] = [5, 4];

/// Standard deviations of the origin's x, y and z.
fn sd_mm(solution: &Solution) -> [f64; 3] {
    [3, 4, 5].map(|axis| libm::sqrt(solution.covariance[(axis, axis)]))
}

/// Root mean square length of the residuals in raw pixels.
fn rms_px(solution: &Solution, seen: &[SeenCorner]) -> f64 {
    let mut squares = 0.0;
    seen.residuals(&solution.cam_from_target, |place, residual| {
        squares += square(&residual) * seen[place].sigma_px * seen[place].sigma_px;
    })
    .unwrap();
    libm::sqrt(squares / seen.len() as f64)
}

fn tilted() -> Pose<Cam, Target> {
    Pose::from_theta([0.1, 0.3, -0.2, 50.0, -80.0, 1000.0])
}

/// A pose as a target has it one frame later: 0.5 mm and 2 mrad away.
fn nearby(pose: &Pose<Cam, Target>, random: &mut Random) -> Pose<Cam, Target> {
    let spread = Vector6::new(2e-3, 2e-3, 2e-3, 0.5, 0.5, 0.5);
    pose.moved_by(&spread.map(|spread| spread * random.normal()))
}

/// Largest difference between the Jacobian and central differences, relative to
/// the column's length, with column `spoiled` deliberately 1e-4 too large.
fn jacobian_error(spoiled: Option<usize>) -> f64 {
    let mut random = Random::new(2);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.5, &mut random);
    let mut worst = 0.0_f64;
    let axes = |index| (0..6).map(move |axis| (index, axis));
    for (index, axis) in (0..seen.len()).flat_map(axes) {
        // Points off the plane as well, so that z of a bent target counts.
        let mut seen = seen[index];
        seen.point_target_mm.z = index as f64 - 12.0;
        let step = if axis < 3 { 1e-5 } else { 1e-2 };
        // A motion along the camera's axes, as an increment about the target's.
        let mut increment = Vector6::zeros();
        if axis < 3 {
            increment.fixed_rows_mut::<3>(0).tr_copy_from(&tilted().rotation.row(axis));
        } else {
            increment[axis] = 1.0;
        }
        increment *= step;
        let residual = |increment: &Vector6<f64>| {
            let mut at = Vector2::zeros();
            [seen].residuals(&tilted().moved_by(increment), |_, residual| at = residual.into());
            at
        };
        let difference = (residual(&increment) - residual(&-increment)) / (2.0 * step);
        let scale = if spoiled == Some(axis) { 1.0001 } else { 1.0 };
        let seen = [seen].residuals_with_jacobian(&tilted(), |_, _, rows| {
            let column = Vector2::new(rows[0][axis], rows[1][axis]) * scale;
            worst = worst.max((column - difference).norm() / column.norm().max(1.0));
        });
        seen.expect("in front of the camera");
    }
    worst
}

#[test]
fn the_jacobian_matches_differences_and_a_wrong_one_does_not() {
    // Third derivatives times the squared step, and rounding over the step: 1e-9.
    assert!(jacobian_error(None) < 1e-8, "{}", jacobian_error(None));
    for axis in 0..6 {
        assert!(jacobian_error(Some(axis)) > 3e-5, "{axis}");
    }
}

#[test]
fn the_normal_equations_are_those_of_an_increment() {
    let mut random = Random::new(9);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.5, &mut random);
    let numbers = |pose: &Pose<Cam, Target>| {
        let mut numbers = Vec::<f64, OBSERVATIONS_MAX>::new();
        seen[..].residuals(pose, |_, residual| numbers.extend(residual)).unwrap();
        numbers
    };
    let here = numbers(&tilted());
    // With so large a variance, each weight is 1.
    let normal = NormalEquations::new(&tilted(), &seen[..], 100.0);
    for _ in 0..20 {
        let step = Vector6::new(1e-5, 1e-5, 1e-5, 1e-2, 1e-2, 1e-2).map(|sd| sd * random.normal());
        let [ahead, behind] = [step, -step].map(|step| numbers(&tilted().moved_by(&step)));
        let [mut square, mut slope] = [0.0; 2];
        for ((here, ahead), behind) in here.iter().zip(&ahead).zip(&behind) {
            let change = 0.5 * (ahead - behind);
            square += change * change;
            slope += here * change;
        }
        // Third derivatives times the squared step, and rounding over the step: 1e-9.
        assert!((normal.square(&step) / square - 1.0).abs() < 1e-7);
        assert!((normal.gradient.dot(&step) - slope).abs() < 1e-7 * libm::sqrt(square));
    }
}

#[test]
fn weight_is_the_slope_of_the_robust_square() {
    for square in [0.0, 3.0, 5.9, 6.1, 12.0, 24.9, 25.1, 900.0] {
        const STEP: f64 = 1e-6;
        let slope = (robust_square(square + STEP) - robust_square(square - STEP)) / 2e-6;
        assert!((slope - weight(square)).abs() < 1e-8, "{square}");
    }
    assert_eq!((weight(6.0), weight(25.0)), (1.0, 0.0));
}

#[test]
fn exact_corners_give_the_exact_pose_from_10_mm_and_10_degrees() {
    let mut random = Random::new(4);
    let seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.0, &mut random);
    for sign in [1.0, -1.0] {
        // 10 degrees about, and 10 mm along, the diagonals.
        let start = tilted().moved_by(&(Vector6::new(0.1, -0.1, 0.1, 5.8, -5.8, 5.8) * sign));
        let solution = solve(&start, &seen[..], 6).unwrap();
        let off = solution.cam_from_target.translation_mm - tilted().translation_mm;
        assert!(off.norm() < 1e-6, "{off}");
        assert!(rms_px(&solution, &seen) < 1e-7 && solution.inliers.count() == 30);
        assert_eq!(solution.scale, 1.0);
    }
    let warm = solve(&nearby(&tilted(), &mut random), &seen[..], 3).unwrap();
    let off = warm.cam_from_target.translation_mm - tilted().translation_mm;
    // A thousandth of the precision of a frame.
    assert!(off.norm() < 1e-4, "{off}");
}

/// Standard deviations of the pose's errors, relative to those of the covariance, `[omega, delta]`.
fn normalised_sd(
    pose: &Pose<Cam, Target>,
    shape: [u8; 2],
    sigma_px: f64,
    count: usize,
) -> [f64; 6] {
    let mut random = Random::new(7);
    let mut squares = [0.0; 6];
    for _ in 0..count {
        let seen = observe(&bedside_lens(), pose, shape, sigma_px, &mut random);
        let found = solve(&nearby(pose, &mut random), &seen[..], 6).unwrap();
        let turn = pose.rotation.tr_mul(&found.cam_from_target.rotation);
        let omega_rad = vector_from_rotation(&turn);
        let delta_mm = found.cam_from_target.translation_mm - pose.translation_mm;
        for axis in 0..3 {
            let variance = |axis: usize| found.covariance[(axis, axis)];
            squares[axis] += omega_rad[axis] * omega_rad[axis] / variance(axis);
            squares[axis + 3] += delta_mm[axis] * delta_mm[axis] / variance(axis + 3);
        }
    }
    squares.map(|square| libm::sqrt(square / count as f64))
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    // The SD of N normals is known to 1 / sqrt(2 N): 0.016 for 2,000. The observed variance counts
    // only beyond its chance deviation, and then as much upwards as downwards; the weights and the
    // spread of that factor add 0.02. So 0.93 to 1.07 is three standard errors from there.
    let thetas = [
        [0.1, 0.3, -0.2, 50.0, -80.0, 1000.0],
        [0.0, 0.6, 0.3, -150.0, 100.0, 700.0],
        [0.2, -0.4, 0.1, 0.0, 150.0, 1500.0],
    ];
    for theta in thetas.into_iter().take(repetitions(thetas.len())) {
        for shape in [LUMBAR, SHOULDER] {
            for sigma_px in [0.02, 0.1] {
                let pose = Pose::from_theta(theta);
                let sd = normalised_sd(&pose, shape, sigma_px, 2000);
                let honest = sd.iter().all(|sd| (0.93..1.07).contains(sd));
                assert!(honest, "{theta:?} {shape:?} {sigma_px}: {sd:?}");
            }
        }
    }
    // Face on, the tilt's effect is of second order and its errors are not normal; the position is
    // still known.
    let face_on = Pose::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, 1000.0]);
    let sd = normalised_sd(&face_on, LUMBAR, 0.02, 2000);
    assert!(sd[3..].iter().all(|sd| (0.93..1.07).contains(sd)), "{sd:?}");
}

#[test]
fn sigmas_that_promise_too_much_are_not_believed() {
    let mut random = Random::new(8);
    let mut seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let honest = solve(&tilted(), &seen[..], 6).unwrap();
    for seen in &mut seen {
        seen.sigma_px = 0.01;
    }
    let boasting = solve(&tilted(), &seen[..], 6).unwrap();
    // The observed spread decides: the same result, as uncertain as before, though not exactly,
    // because the honest variance is at least the predicted one, and the soft weights differ with
    // the scale.
    let ratio = sd_mm(&boasting)[2] / sd_mm(&honest)[2];
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
    assert_eq!(boasting.inliers.count(), 30);
    assert!((6.0..15.0).contains(&boasting.scale), "{}", boasting.scale);
}

/// Chance alone hardly takes the observed variance to half of the predicted one; less is not
/// believed.
#[test]
fn sigmas_that_promise_too_little_are_corrected_to_a_bound() {
    let mut random = Random::new(8);
    let mut seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let mut at_sigma = |sigma_px: f64| {
        for seen in &mut seen {
            seen.sigma_px = sigma_px;
        }
        solve(&tilted(), &seen[..], 6).unwrap()
    };
    let promised = sd_mm(&at_sigma(0.1))[2];
    for (too_large, believed) in [(10.0, 10.0 * MISFIT_MIN.sqrt()), (3.0, 3.0 * MISFIT_MIN.sqrt())]
    {
        let modest = at_sigma(0.1 * too_large);
        assert_eq!(modest.scale, 1.0);
        let ratio = sd_mm(&modest)[2] / promised;
        assert!((ratio / believed - 1.0).abs() < 0.1, "{too_large}: {ratio}");
    }
}

/// Moves the first `count` of the shuffled corners by `size_px`, each in a direction of its own.
fn spoil(seen: &mut SeenCorners, count: usize, size_px: f64, random: &mut Random) {
    for place in (1..seen.len()).rev() {
        seen.swap(place, (random.bits() % (place as u64 + 1)) as usize);
    }
    for seen in &mut seen[..count] {
        let way_px = random.normal2().normalize() * size_px;
        seen.ray += seen.raw_by_ray.try_inverse().unwrap() * way_px;
    }
}

/// Largest displacement along an axis caused by the wrong corners, in standard deviations, relative
/// to the pose from the correct ones alone.
fn outlier_influence(shape: [u8; 2], count: usize, size_px: f64) -> f64 {
    let mut random = Random::new(9);
    let mut worst = 0.0_f64;
    for _ in 0..500 {
        let mut seen = observe(&bedside_lens(), &tilted(), shape, 0.1, &mut random);
        spoil(&mut seen, count, size_px, &mut random);
        let start = nearby(&tilted(), &mut random);
        let found = solve(&start, &seen[..], 10).unwrap();
        let wanted = solve(&start, &seen[count..], 10).unwrap();
        assert!(
            (0..count).all(|place| !found.inliers.contains(place)),
            "a wrong corner was believed"
        );
        let moved_mm = found.cam_from_target.translation_mm - wanted.cam_from_target.translation_mm;
        for (axis, sd_mm) in sd_mm(&wanted).into_iter().enumerate() {
            worst = worst.max(moved_mm[axis].abs() / sd_mm);
        }
    }
    worst
}

#[test]
fn wrong_corners_do_not_move_the_pose() {
    // They have no weight in the end. What remains is that the median, and with it the weights of
    // correct corners between 2.4 and 5 scales, differs between n and n + 3 residuals: below one
    // standard deviation in the worst of 500.
    for size_px in [3.0, 30.0] {
        for (shape, count, sds_max) in
            [(LUMBAR, 1, 0.5), (LUMBAR, 3, 0.7), (SHOULDER, 1, 0.9), (SHOULDER, 3, 1.2)]
        {
            let sds = outlier_influence(shape, count, size_px);
            assert!(sds < sds_max, "{shape:?}, {count} by {size_px} px: {sds} SD");
        }
    }
}

#[test]
fn a_wrong_corner_would_move_an_unweighted_fit() {
    // The same corner as above with a sigma that excuses it.
    let mut random = Random::new(9);
    let mut seen = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    spoil(&mut seen, 1, 30.0, &mut random);
    let robust = solve(&tilted(), &seen[..], 10).unwrap();
    for seen in &mut seen {
        seen.sigma_px = 30.0;
    }
    let plain = solve(&tilted(), &seen[..], 10).unwrap();
    let moved_mm = plain.cam_from_target.translation_mm - robust.cam_from_target.translation_mm;
    assert!(moved_mm.norm() > 5.0, "{moved_mm}");
}

#[test]
fn each_of_a_planes_two_poses_is_a_minimum_of_its_own() {
    let far = Pose::<Cam, Target>::from_theta([0.0, 0.5, 0.3, 300.0, -200.0, 3000.0]);
    let mut random = Random::new(10);
    let seen = observe(&bedside_lens(), &far, LUMBAR, 0.0, &mut random);
    let poses = planar_poses(&seen).unwrap();
    let solutions =
        [0, 1].map(|place| solve(&poses[place].cam_from_target, &seen[..], 15).unwrap());
    let apart = |a: &Pose<Cam, Target>, b: &Pose<Cam, Target>| {
        vector_from_rotation(&a.rotation.tr_mul(&b.rotation)).norm().to_degrees()
    };
    let [best, second] = solutions.map(|solution| solution.cam_from_target);
    assert!(apart(&best, &far) < 1e-6);
    // Twice the angle between the line of sight and the normal, 26 degrees.
    assert!((45.0..60.0).contains(&apart(&second, &far)), "{}", apart(&second, &far));
    // Further steps stay there; and the start was close.
    for (place, solution) in solutions.iter().enumerate() {
        let more = solve(&solution.cam_from_target, &seen[..], 15).unwrap();
        assert!(apart(&more.cam_from_target, &solution.cam_from_target) < 1e-5);
        assert!(apart(&poses[place].cam_from_target, &solution.cam_from_target) < 0.5);
    }
    // Both look alike: what tells them apart is less than a tenth of a pixel.
    let [best_px, second_px] = solutions.map(|solution| rms_px(&solution, &seen));
    assert!(best_px < 1e-6 && (0.05..0.1).contains(&second_px), "{second_px}");
}

#[test]
fn what_cannot_be_solved_has_a_reason() {
    let mut random = Random::new(12);
    let good = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let refused = |start: &Pose<Cam, Target>, seen: &[SeenCorner]| {
        solve(start, seen, 10).map(|_| ()).unwrap_err()
    };
    assert_eq!(refused(&tilted(), &[]), SolveFailure::TooFew);
    assert_eq!(refused(&tilted(), &good[..3]), SolveFailure::TooFew);
    // One row of corners: the target may turn about it.
    assert_eq!(refused(&tilted(), &good[..6]), SolveFailure::Degenerate);
    let same = [good[0]; 8];
    assert_eq!(refused(&tilted(), &same), SolveFailure::Degenerate);

    let mut behind = tilted();
    behind.translation_mm.z = -1000.0;
    assert_eq!(refused(&behind, &good), SolveFailure::BehindCamera);
    let mut nowhere = tilted();
    nowhere.translation_mm.x = f64::NAN;
    assert_eq!(refused(&nowhere, &good), SolveFailure::NotFinite);
    let mut turned_nowhere = tilted();
    turned_nowhere.rotation[(1, 2)] = f64::INFINITY;
    assert_eq!(refused(&turned_nowhere, &good), SolveFailure::NotFinite);
    let spoilt = |spoil: fn(&mut SeenCorner)| {
        let mut seen = good.clone();
        spoil(&mut seen[7]);
        refused(&tilted(), &seen)
    };
    assert_eq!(spoilt(|seen| seen.ray.y = f64::NAN), SolveFailure::NotFinite);
    assert_eq!(spoilt(|seen| seen.point_target_mm.z = f64::INFINITY), SolveFailure::NotFinite);
    assert_eq!(spoilt(|seen| seen.raw_by_ray[(0, 1)] = f64::NAN), SolveFailure::NotFinite);
    assert_eq!(spoilt(|seen| seen.sigma_px = 0.0), SolveFailure::NotFinite);
    assert_eq!(spoilt(|seen| seen.sigma_px = f64::NAN), SolveFailure::NotFinite);
}

#[test]
fn absurd_but_finite_numbers_give_a_result_or_a_reason() {
    let mut random = Random::new(13);
    let good = observe(&bedside_lens(), &tilted(), LUMBAR, 0.1, &mut random);
    let huge = [1e-300, 1e-30, 1e30, 1e150, 1e300];
    for _ in 0..2000 {
        let mut seen = good.clone();
        let mut start = tilted();
        for _ in 0..1 + random.bits() % 40 {
            let value = huge[(random.bits() % 5) as usize];
            let place = (random.bits() % 30) as usize;
            match random.bits() % 5 {
                0 => seen[place].ray.x = value,
                1 => seen[place].raw_by_ray[(1, 0)] = value,
                2 => seen[place].sigma_px = value,
                3 => seen[place].point_target_mm.y = value,
                _ => start.translation_mm.z = value,
            }
        }
        if let Ok(solution) = solve(&start, &seen[..], 6) {
            assert!(solution.covariance.iter().all(|value| value.is_finite()));
            assert!(solution.cam_from_target.rotation.iter().all(|value| value.is_finite()));
            assert!(solution.cost.is_finite() && sd_mm(&solution).iter().all(|sd| *sd >= 0.0));
        }
    }
}

#[test]
fn a_pose_followed_for_hours_stays_a_rotation() {
    let mut random = Random::new(14);
    let seen = observe(&bedside_lens(), &tilted(), SHOULDER, 0.1, &mut random);
    // As rounding in many products would leave it.
    let mut pose = tilted();
    pose.rotation *= 1.0 + 1e-5;
    pose.rotation[(0, 1)] += 1e-5;
    for _ in 0..3 {
        pose = solve(&pose, &seen[..], 3).unwrap().cam_from_target;
    }
    let gram = pose.rotation.tr_mul(&pose.rotation);
    assert!((gram - Matrix3::identity()).norm() < 1e-14);
}
