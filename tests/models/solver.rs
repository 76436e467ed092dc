//! The pose of a target, where only the frames change in which it is written down.
//!
//! - A scene that is turned about the optical axis has the pose that is turned with it.
//! - A target whose frame is chosen otherwise has the pose of that frame.
//! - A person before a board has the same position, wherever the camera is.
//!
//! How much may differ follows from how the numbers are rounded, and from where the solver stops; see
//! each law.

use std::cell::Cell;
use std::fmt::Debug;

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector3, Vector6};
use plumbline::lens::{Distortion, Lens};
use plumbline::parts::{Observations as _, SeenCorner, Solution, solve};
use plumbline::pose::{Cam, Pose, Scene, Target, rotation_from_vector};
use plumbline::scene::SceneFrame;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::laws::Tries;

/// The largest relative error of one rounding.
const ROUNDING: f64 = f64::EPSILON / 2.0;

/// Enough to stop by themselves but for two or three views in 100,000. Most of these have four wrong
/// corners: their first steps lead towards the mirror image, and from there they creep along a bent valley.
const STEPS: usize = 200;

/// Of so many views no more than one may not have stopped.
const VIEWS_PER_UNFINISHED: usize = 20_000;

/// The solver takes no step that is shorter than this, in standard deviations of the pose that the
/// observations promise.
const LAST_STEP_SD: f64 = 1e-4;

/// What its covariance makes of an observation's variance at least, and so of that length.
const MISFIT_MIN: f64 = 0.5;

/// The standard deviation that a corner promises.
const SIGMA_PX: f64 = 0.03;

const LENS: Lens = Lens {
    width_px: 1456,
    height_px: 1088,
    fx_px: 1740.0,
    fy_px: 1741.0,
    cx_px: 731.0,
    cy_px: 540.0,
    skew_px: 0.3,
    distortion: Distortion::Brown5([-0.12, 0.08, 0.0005, 0.0003, 0.0]),
};

/// A target that was seen, and where it is looked for at first.
#[derive(Debug, Clone)]
struct View {
    start: Pose<Cam, Target>,
    corners: Vec<SeenCorner>,
}

/// Views of both targets, up to half sideways, 0.6 to 1.5 m away, with noise of this share of what
/// the corners promise, and with up to this many wrong corners.
fn views(noise: f64, wrong: usize) -> impl Strategy<Value = View> {
    let shape = prop_oneof![Just([6_u8, 5]), Just([5, 4])];
    let theta = (-3.1..3.1, -0.6..0.6, -0.6..0.6, -0.22..0.22, -0.18..0.18, 600.0..1500.0);
    (shape, theta, 0..=wrong, any::<u64>()).prop_map(move |(shape, theta, wrong, seed)| {
        let (theta1, theta2, theta3, x, y, z_mm) = theta;
        view(noise, shape, [theta1, theta2, theta3, x, y, z_mm], wrong, seed)
    })
}

/// A view of a target at three angles, two tangents of the line of sight, and a distance.
fn view(
    noise: f64,
    shape: [u8; 2],
    [theta1, theta2, theta3, x, y, z_mm]: [f64; 6],
    wrong: usize,
    seed: u64,
) -> View {
    let pose = Pose::from_theta([theta1, theta2, theta3, x * z_mm, y * z_mm, z_mm]);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut corners = seen(&pose, shape, noise * SIGMA_PX, &mut random);
    for place in 0..wrong {
        let way = random.random_range(0.0..std::f64::consts::TAU);
        let size_px = random.random_range(3.0..30.0);
        let off_px = Vector2::new(way.cos(), way.sin()) * size_px;
        let corner = &mut corners[place * 5];
        corner.ray += corner.raw_by_ray.try_inverse().expect("a lens") * off_px;
    }
    let mut near = |size: f64| random.random_range(-size..size);
    let increment = [near(0.01), near(0.01), near(0.01), near(1.0), near(1.0), near(5.0)];
    View { start: pose.moved_by(&increment.into()), corners }
}

/// The corners of a checkerboard of 12 mm pitch seen at a pose.
fn seen(
    pose: &Pose<Cam, Target>,
    [columns, rows]: [u8; 2],
    noise_px: f64,
    random: &mut ChaCha8Rng,
) -> Vec<SeenCorner> {
    let corner = |index: u8| {
        let offset = |place: u8, count: u8| f64::from(place) - f64::from(count - 1) / 2.0;
        let (x, y) = (offset(index % columns, columns), offset(index / columns, rows));
        let point_target_mm = Vector3::new(x, y, 0.0) * 12.0;
        let true_px = LENS.project(&pose.transform(&point_target_mm)).expect("before the camera");
        // Twelve uniform numbers make a normal one, and no more than six times its deviation.
        let mut normal = || (0..12).map(|_| random.random::<f64>() - 0.5).sum::<f64>();
        let seen_px = true_px + Vector2::new(normal(), normal()) * noise_px;
        let ray = LENS.ray_from_raw(&seen_px).expect("a ray");
        let (_, raw_by_ray) = LENS.raw_from_ray_with_jacobian(&ray);
        SeenCorner { point_target_mm, ray, raw_by_ray, sigma_px: SIGMA_PX }
    };
    (0..columns * rows).map(corner).collect()
}

fn solved(view: &View) -> Solution {
    solve(&view.start, &view.corners[..], STEPS).expect("a pose")
}

/// Whether another step would change nothing.
fn has_stopped(view: &View, solution: &Solution) -> bool {
    let further = solve(&view.start, &view.corners[..], STEPS + 1).expect("a pose");
    further.cam_from_target == solution.cam_from_target
}

/// Two views in which a scale that followed every step led to and fro between two poses, 0.03 and 0.3
/// standard deviations apart, without an end.
#[test]
fn the_steps_to_a_pose_have_an_end() {
    for (theta, wrong, seed) in [
        (
            [
                -1.3403842200187785,
                -0.5027655316697793,
                -0.07107176137003401,
                -0.1531661519029613,
                0.07105450514108526,
                1095.6341631640953,
            ],
            3,
            17828521217129014853,
        ),
        (
            [
                -2.2963684126041666,
                0.43785925662490455,
                0.5755205959846754,
                -0.0995790164789609,
                -0.08444748986440787,
                1478.2700340604913,
            ],
            2,
            10347626584956510972,
        ),
    ] {
        let view = view(1.0, [5, 4], theta, wrong, seed);
        assert!(has_stopped(&view, &solved(&view)), "seed {seed}");
    }
}

/// How far a pose is from that of a solution, in standard deviations.
fn apart_sd(solution: &Solution, pose: &Pose<Cam, Target>) -> f64 {
    let increment = solution.cam_from_target.increment_to(pose);
    let inverse = solution.covariance.try_inverse().expect("a covariance");
    increment.dot(&(inverse * increment)).max(0.0).sqrt()
}

/// By how much two solutions differ at most, in standard deviations, if they were computed by the same
/// steps and only rounded otherwise.
///
/// A residual comes from a ray of at most some tenths, after some 40 roundings; the corner makes it
/// larger by `raw_by_ray / sigma`. The pose follows the residuals like a projection: no further, all
/// together, than they have moved. A step is the solution of six equations whose sums have 2 n terms,
/// after 6^3 operations; rounding moves it by that times the condition of the equations, once each
/// unknown has the scale of its own deviation. No step is longer than the whole way.
fn rounding_sd(view: &View, solution: &Solution) -> f64 {
    let count = view.corners.len() as f64;
    let gain = view.corners.iter().map(|it| it.raw_by_ray.norm() / it.sigma_px).fold(0.0, f64::max);
    let deviation = solution.covariance.diagonal().map(f64::sqrt);
    let correlation = solution
        .covariance
        .map_with_location(|row, column, value| value / (deviation[row] * deviation[column]));
    let eigenvalues = correlation.symmetric_eigenvalues();
    let condition = eigenvalues.max() / eigenvalues.min();
    let way_sd = apart_sd(solution, &view.start);
    let by_residuals = 40.0 * gain * (2.0 * count).sqrt();
    let by_steps = (2.0 * count + 216.0) * condition * way_sd;
    2.0 * ROUNDING * (by_residuals + by_steps)
}

/// By how much they differ at most where the steps are others, in standard deviations.
///
/// Each solver stops before a step that is too short. The way that is left is longer than that step where
/// the sum of squares curves less than the normal equations say; over so short a way the curvature stays
/// the same to within a hundredth. Small noise leaves the least covariance that the solver states.
fn stopping_sd(view: &View, solution: &Solution) -> f64 {
    let left_sd = LAST_STEP_SD * MISFIT_MIN.sqrt() / least_curvature(view, solution);
    2.0 * 1.01 * left_sd
}

/// Half the least second derivative of the sum of squares, over the way in standard deviations of the
/// solution. It is [`MISFIT_MIN`] where the projection is as good as linear over a standard deviation, and
/// half of that where a target faces the camera, so that its tilt shows in the perspective alone.
fn least_curvature(view: &View, solution: &Solution) -> f64 {
    // Short enough for the second derivative to be all that shows, and long enough for rounding not to.
    const WAY_SD: f64 = 0.02;
    let whitening = solution.covariance.cholesky().expect("a covariance").l();
    let cost = |way: Vector6<f64>| {
        let pose = solution.cam_from_target.moved_by(&(whitening * way * WAY_SD));
        let mut sum = 0.0;
        let seen = view.corners[..].residuals(&pose, |_, [x, y]| sum += x * x + y * y);
        seen.expect("before the camera");
        sum
    };
    let curvature = Matrix6::from_fn(|row, column| {
        let (one, other) = (Vector6::ith(row, 1.0), Vector6::ith(column, 1.0));
        let sums = cost(one + other) - cost(one - other) - cost(other - one) + cost(-one - other);
        sums / (8.0 * WAY_SD * WAY_SD)
    });
    curvature.symmetric_eigenvalues().min()
}

/// The same scene, turned about the optical axis.
fn turned(view: &View, turn: &Matrix2<f64>) -> View {
    let mut turned = view.clone();
    for corner in &mut turned.corners {
        corner.ray = turn * corner.ray;
        // The camera is turned with it: its pixels stay where they are.
        corner.raw_by_ray *= turn.transpose();
    }
    turned.start = about_axis(turn, &view.start);
    turned
}

fn about_axis(turn: &Matrix2<f64>, pose: &Pose<Cam, Target>) -> Pose<Cam, Target> {
    let mut whole = Matrix3::identity();
    whole.fixed_view_mut::<2, 2>(0, 0).copy_from(turn);
    Pose::new(whole * pose.rotation, whole * pose.translation_mm)
}

fn a_quarter_turn_turns_the_pose(tries: Tries) {
    let [tried, unfinished] = [const { Cell::new(0) }; 2];
    tries.hold(
        "the pose of a target with wrong corners, its scene turned by quarters about the optical axis",
        "turned with it, to within rounding; with the same corners believed",
        &(views(1.0, 4), 1..4_usize),
        |(view, quarters)| {
            // All of it is exact: coordinates change their place and their sign.
            let quarter = Matrix2::new(0.0, -1.0, 1.0, 0.0);
            let turn = (1..quarters).fold(quarter, |turn, _| quarter * turn);
            let turned = turned(&view, &turn);
            let (here, there) = (solved(&view), solved(&turned));
            tried.set(tried.get() + 1);
            if !has_stopped(&view, &here) || !has_stopped(&turned, &there) {
                // Rounding is the larger the longer the way, and this one has not ended.
                unfinished.set(unfinished.get() + 1);
                return;
            }
            let expected = about_axis(&turn, &here.cam_from_target);
            let (apart, most) = (apart_sd(&there, &expected), rounding_sd(&view, &here));
            assert!(apart <= most, "{apart:e} SD, not within {most:e}");
            assert_eq!(there.inliers, here.inliers);
            for (now, before) in [(there.scale, here.scale), (there.cost, here.cost)] {
                // Its square changes by twice what each residual, of at most some deviations, changes.
                assert!((now - before).abs() <= 100.0 * before * most, "{now} is not {before}");
            }
        },
    );
    let [tried, unfinished] = [tried.get(), unfinished.get()];
    assert!(unfinished <= tried / VIEWS_PER_UNFINISHED, "{unfinished} of {tried} have not stopped");
}

#[test]
fn a_scene_turned_by_a_quarter_has_a_pose_turned_by_a_quarter() {
    a_quarter_turn_turns_the_pose(Tries::few(300));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_scene_turned_by_a_quarter_has_a_pose_turned_by_a_quarter_many_times() {
    a_quarter_turn_turns_the_pose(Tries::many(500_000));
}

fn any_turn_turns_the_pose(tries: Tries) {
    tries.hold(
        "the pose of a target, its scene turned by any angle about the optical axis",
        "turned with it, as closely as the solver promises to stop",
        &(views(0.3, 0), -3.1..3.1),
        |(view, angle_rad): (View, f64)| {
            let (sin, cos) = angle_rad.sin_cos();
            let turn = Matrix2::new(cos, -sin, sin, cos);
            let (here, there) = (solved(&view), solved(&turned(&view, &turn)));
            let expected = about_axis(&turn, &here.cam_from_target);
            let most = stopping_sd(&view, &here) + rounding_sd(&view, &here);
            let apart = apart_sd(&there, &expected);
            assert!(apart <= most, "{apart:e} SD, not within {most:e}");
        },
    );
}

#[test]
fn a_turned_scene_has_a_turned_pose() {
    any_turn_turns_the_pose(Tries::few(300));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_turned_scene_has_a_turned_pose_many_times() {
    any_turn_turns_the_pose(Tries::many(500_000));
}

/// A rigid transform by up to half a turn and as many millimetres.
fn rigid<To: Debug, From: Debug>(most_mm: f64) -> impl Strategy<Value = Pose<To, From>> {
    let number = move |most: f64| -most..most;
    let turn = (number(1.8), number(1.8), number(1.8));
    let way = (number(most_mm), number(most_mm), number(most_mm));
    (turn, way).prop_map(|(turn, way)| {
        let rotation = rotation_from_vector(&Vector3::new(turn.0, turn.1, turn.2));
        Pose::new(rotation, Vector3::new(way.0, way.1, way.2))
    })
}

fn another_frame_of_the_target_is_its_own_pose(tries: Tries) {
    tries.hold(
        "the pose of a target whose points are written in another frame of it",
        "that of the other frame, as closely as the solver promises to stop",
        &(views(0.3, 0), rigid::<Target, Target>(50.0)),
        |(view, other_from_target)| {
            let target_from_other = other_from_target.inverse();
            let mut other = view.clone();
            for corner in &mut other.corners {
                corner.point_target_mm = other_from_target.transform(&corner.point_target_mm);
            }
            other.start = view.start * target_from_other;
            let (here, there) = (solved(&view), solved(&other));
            let expected = here.cam_from_target * target_from_other;
            let most = stopping_sd(&other, &there) + rounding_sd(&other, &there);
            let apart = apart_sd(&there, &expected);
            assert!(apart <= most, "{apart:e} SD, not within {most:e}");
        },
    );
}

#[test]
fn another_frame_of_a_target_has_its_own_pose() {
    another_frame_of_the_target_is_its_own_pose(Tries::few(300));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn another_frame_of_a_target_has_its_own_pose_many_times() {
    another_frame_of_the_target_is_its_own_pose(Tries::many(500_000));
}

fn the_camera_does_not_matter(tries: Tries) {
    tries.hold(
        "the trunk's position before the board, from a camera that is put elsewhere",
        "the same, to within rounding",
        &(
            rigid::<Cam, Scene>(2_000.0),
            rigid::<Cam, Target>(2_000.0),
            rigid::<Cam, Cam>(2_000.0),
            -150.0..150.0,
        ),
        |(cam_from_scene, cam_from_target, moved, depth_mm)| {
            let inside_mm = Vector3::new(0.0, 0.0, depth_mm);
            let here = SceneFrame::new(cam_from_scene);
            let there = SceneFrame::new(moved * cam_from_scene);
            // Three products, of three terms and a sum each, of lengths that add up to this.
            let length_mm = 150.0
                + [
                    cam_from_scene.translation_mm,
                    cam_from_target.translation_mm,
                    moved.translation_mm,
                ]
                .map(|it| it.norm())
                .iter()
                .sum::<f64>();
            let most_mm = 3.0 * 6.0 * 2.0 * ROUNDING * length_mm * 3.0;
            for (now, before) in [
                (there.upper_trunk(&(moved * cam_from_target)), here.upper_trunk(&cam_from_target)),
                (
                    there.lower_trunk(&(moved * cam_from_target), &inside_mm),
                    here.lower_trunk(&cam_from_target, &inside_mm),
                ),
            ] {
                let off_mm =
                    [now.ap_mm - before.ap_mm, now.ml_mm - before.ml_mm, now.si_mm - before.si_mm];
                assert!(off_mm.iter().all(|it| it.abs() <= most_mm), "{off_mm:?}, {most_mm:e}");
            }
        },
    );
}

#[test]
fn it_does_not_matter_where_the_camera_is() {
    the_camera_does_not_matter(Tries::few(1_000));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn it_does_not_matter_where_the_camera_is_many_times() {
    the_camera_does_not_matter(Tries::many(1_000_000));
}
