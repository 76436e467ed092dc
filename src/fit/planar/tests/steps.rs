//! The steps on the way to a plane's poses, each by its definition, and what is refused on the way.

extern crate std;

use std::string::ToString as _;
use std::vec::Vec;

use nalgebra::Rotation2;

use super::*;

fn seen_at(point_mm: Vector2<f64>) -> SeenCorner {
    SeenCorner {
        point_target_mm: point_mm.push(0.0),
        ray: point_mm * 1e-3,
        raw_by_ray: Matrix2::identity() * 1000.0,
        sigma_px: 0.1,
    }
}

#[test]
fn normalised_points_lie_around_their_centre() {
    let mut random = Random::new(31);
    let points: Vec<_> = (0..20)
        .map(|_| Vector2::new(random.uniform(100.0, 300.0), random.uniform(-70.0, -20.0)))
        .collect();
    let normalisation = Normalisation::of(points.iter().copied()).unwrap();
    let applied = points.iter().map(|point| normalisation.apply(point));
    assert!(applied.clone().sum::<Vector2<f64>>().norm() < 1e-12);
    let mean_square = applied.map(|point| point.norm_squared()).sum::<f64>() / 20.0;
    assert!((mean_square - 2.0).abs() < 1e-14, "{mean_square}");
}

/// The corners of a rectangle of width w and length 1 have the width w over length in this sense.
#[test]
fn what_is_wider_than_a_thousandth_of_its_length_is_not_a_line() {
    for step in 0..16 {
        let turned = Rotation2::new(0.2 * f64::from(step));
        let is_wide = |width: f64| {
            let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, width], [1.0, width]];
            Normalisation::of(corners.into_iter().map(|at| turned * Vector2::from(at))).is_some()
        };
        // Squares: a rounding of 1e-16 in the difference of two numbers is 1e-10 of 1e-6.
        assert!(!is_wide(0.001 * (1.0 - 1e-6)) && is_wide(0.001 * (1.0 + 1e-6)), "{step}");
    }
}

/// The pivots of the normal equations of a homography from points to themselves.
fn pivot_ratio(points: &[Vector2<f64>]) -> f64 {
    let mut normal = SMatrix::<f64, 8, 8>::zeros();
    for at in points {
        let (x, y) = (at.x, at.y);
        for row in
            [[x, y, 1.0, 0.0, 0.0, 0.0, -x * x, -y * x], [0.0, 0.0, 0.0, x, y, 1.0, -x * y, -y * y]]
        {
            normal += SVector::from(row) * SVector::from(row).transpose();
        }
    }
    let lower = normal.cholesky().unwrap().l();
    let pivots = lower.diagonal().map(|root| root * root);
    pivots.min() / pivots.max()
}

/// Two rows of points fix a homography, and one row and a point do not: between them lies a second
/// point that is hardly off the row.
#[test]
fn points_that_nearly_leave_a_homography_open_are_refused() {
    let of = |off_mm: f64| -> Vec<_> {
        let row = (0..40).map(|place| Vector2::new(10.0 * f64::from(place), 0.0));
        row.chain([Vector2::new(0.0, 100.0), Vector2::new(390.0, off_mm)]).collect()
    };
    let ratio = |off_mm: f64| {
        let points = of(off_mm);
        let normalisation = Normalisation::of(points.iter().copied()).unwrap();
        pivot_ratio(&points.iter().map(|it| normalisation.apply(it)).collect::<Vec<_>>())
    };
    // Where the ratio is the least, by bisection: it grows with the square of the distance.
    let (mut refused_mm, mut good_mm) = (1e-3, 50.0);
    assert!(ratio(refused_mm) < PIVOT_RATIO_MIN && ratio(good_mm) > PIVOT_RATIO_MIN);
    while good_mm / refused_mm > 1.01 {
        let between_mm = libm::sqrt(refused_mm * good_mm);
        let is_good = ratio(between_mm) > PIVOT_RATIO_MIN;
        *(if is_good { &mut good_mm } else { &mut refused_mm }) = between_mm;
    }
    let poses = |off_mm: f64| {
        let seen: Vec<_> = of(off_mm).into_iter().map(seen_at).collect();
        planar_poses(&seen).map(|_| ())
    };
    assert_eq!(poses(refused_mm * 0.99), Err(PlanarFailure::Degenerate));
    assert_eq!(poses(good_mm * 1.01), Ok(()));
}

#[test]
fn the_error_of_a_pose_is_the_root_of_the_mean_square() {
    let mut random = Random::new(32);
    let lens = bedside_lens();
    for _ in 0..20 {
        let seen = observe(&lens, &scattered(&mut random), [6, 5], 0.3, &mut random);
        for PlanarPose { cam_from_target, rms_px } in planar_poses(&seen).unwrap() {
            let squares = seen.iter().map(|seen| {
                let point_mm = cam_from_target.transform(&seen.point_target_mm);
                let ray = point_mm.xy() / point_mm.z;
                (seen.raw_by_ray * (ray - seen.ray)).norm_squared()
            });
            let mean = squares.sum::<f64>() / 30.0;
            assert!((rms_px * rms_px / mean - 1.0).abs() < 1e-12, "{rms_px}");
        }
    }
}

#[test]
fn a_corner_without_a_usable_number_is_refused() {
    let good: Vec<_> = [[0.0, 0.0], [50.0, 0.0], [0.0, 50.0], [50.0, 60.0]]
        .map(|at| seen_at(Vector2::from(at)))
        .into();
    assert!(planar_poses(&good).is_ok());
    let spoils: [fn(&mut SeenCorner, f64); 6] = [
        |seen, value| seen.point_target_mm.x = value,
        |seen, value| seen.point_target_mm.z = value,
        |seen, value| seen.ray.y = value,
        |seen, value| seen.raw_by_ray.m11 = value,
        |seen, value| seen.raw_by_ray.m12 = value,
        |seen, value| seen.sigma_px = value,
    ];
    let refused = |change: &dyn Fn(&mut SeenCorner)| {
        let mut seen = good.clone();
        change(&mut seen[2]);
        assert_eq!(planar_poses(&seen).map(|_| ()), Err(PlanarFailure::NotFinite));
        assert!(!seen[..].are_finite());
    };
    for spoil in spoils {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            refused(&|seen| spoil(seen, value));
        }
    }
    // An observation of no uncertainty would have all the weight.
    refused(&|seen| seen.sigma_px = 0.0);
    refused(&|seen| seen.sigma_px = -0.1);
}

#[test]
fn each_failure_says_what_is_wrong() {
    for (failure, text) in [
        (PlanarFailure::TooFewPoints, "fewer than 4 corners"),
        (PlanarFailure::NotFinite, "a coordinate is not finite"),
        (PlanarFailure::Degenerate, "the corners lie on one line"),
        (PlanarFailure::Mirrored, "the corners are numbered the wrong way round"),
        (PlanarFailure::BehindCamera, "a corner would lie behind the camera"),
    ] {
        assert_eq!(failure.to_string(), text);
    }
}
