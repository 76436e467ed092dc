//! Simulated trials: a person sways before a camera, a print and a scene that are not quite what
//! they are believed to be. Every pose is found again by least squares through the believed lens:
//! nothing here is linearised, and only the projection and the ways of bending are the budget's.

use nalgebra::{Matrix3, Matrix6, Vector2, Vector3, Vector6};
use plumbline::lens::{Distortion, Lens, ray_by_point, ray_of};
use plumbline::pose::{Cam, Pose, Scene, Target};
use plumbline::scene::SceneFrame;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_analysis::filter::Design;
use plumbline_analysis::series::{Axis, Plane, Series};
use plumbline_analysis::sway::{Lengths, Prepared, Settings};
use plumbline_trial::frame::Trunk;
use plumbline_uncertainty::inputs::Inputs;
use plumbline_uncertainty::response::{LENS_NUMBERS, shapes};
use plumbline_uncertainty::{Body, FigureBudget, LensUncertainty, Measured, Quantity};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const RATE_HZ: f64 = 30.0;
pub const DURATION_S: f64 = 12.0;
pub const FILTER: Design = Design::PAPER;
/// Samples of the true movement for each frame.
const FINER: usize = 4;

/// Standard deviations of a pose at 1 m: turns about the target's axes (rad), then x, y, z (mm).
const POSE_SD: [f64; 6] = [1.2e-4, 1.1e-4, 3e-5, 0.001, 0.003, 0.013];

/// The lens as it is believed to be.
const LENS: Lens = Lens {
    width_px: 1456,
    height_px: 1088,
    fx_px: 1740.0,
    fy_px: 1742.0,
    cx_px: 731.0,
    cy_px: 540.0,
    skew_px: 0.2,
    distortion: Distortion::Radial2([-0.12, 0.05]),
};

/// Independent errors of a calibration, as those of 15 photographs: fx fy cx cy skew k1 k2.
const LENS_WAYS: [[f64; 7]; 7] = [
    [1.5, 1.5, 0.0, 0.0, 0.0, 0.0005, 0.0],
    [0.2, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 0.1, 0.0, 0.0],
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.002, -0.012],
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.003],
];

/// The figures of all but the first and the last second: at the ends of a trial the filter differs
/// from sample to sample, so that a finer movement does not pass through the same one.
pub fn inner() -> Settings {
    let span_s = Some(1.0..DURATION_S - 1.0);
    Settings { filter: FILTER, span_s, ..Settings::default() }
}

/// The same, with borders just before a frame and before the sample of the true movement there.
pub fn aligned() -> Settings {
    let early_s = 0.5 / (FINER as f64 * RATE_HZ);
    Settings { span_s: Some(1.0 - early_s..DURATION_S - 1.0 - early_s), ..inner() }
}

pub fn lens_uncertainty() -> LensUncertainty {
    let way = |way: [f64; 7]| {
        let mut numbers = [0.0; LENS_NUMBERS];
        numbers[..7].copy_from_slice(&way);
        numbers
    };
    LensUncertainty { ways: LENS_WAYS.map(way).to_vec(), sd_fx_px: 1.51, freedom: Some(2000.0) }
}

/// Standard normal numbers.
pub struct Random(ChaCha8Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn next(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

/// How the world differs from what is believed of it.
pub struct Errors {
    scale: f64,
    stretch: f64,
    bows_mm: [[f64; 3]; 2],
    lens: Lens,
    /// About AP, ML and SI.
    turn_rad: Vector3<f64>,
    noise: f64,
    zero_s: f64,
    zero_u_s: f64,
    clock: f64,
    /// When the first frame was taken, in periods after the start.
    phase: f64,
}

impl Errors {
    /// Drawn from what the inputs say of them. If t = 0 is uncertain, frames are also not taken at
    /// the times at which a span begins.
    pub fn draw(inputs: &Inputs, zero_u_s: f64, random: &mut Random) -> Self {
        let Inputs { print, targets, scene, timing, noise } = inputs;
        let mut lens = LENS;
        for way in LENS_WAYS {
            let size = random.next();
            lens.fx_px += size * way[0];
            lens.fy_px += size * way[1];
            lens.cx_px += size * way[2];
            lens.cy_px += size * way[3];
            lens.skew_px += size * way[4];
            for (number, by) in lens.distortion.coefficients_mut().iter_mut().zip(&way[5..]) {
                *number += size * by;
            }
        }
        let tilt_rad = scene.tilt_u_deg.to_radians();
        let turn_rad = scene.turn_u_deg.to_radians();
        Self {
            scale: random.next() * print.u_mm / print.measured_mm,
            stretch: random.next() * print.stretch_u_percent / 100.0,
            bows_mm: [(); 2].map(|()| [(); 3].map(|()| random.next() * targets.bow_u_mm)),
            lens,
            turn_rad: Vector3::new(tilt_rad, tilt_rad, turn_rad).map(|it| it * random.next()),
            noise: 1.0 + random.next() * noise.u_percent / 100.0,
            zero_s: random.next() * zero_u_s,
            zero_u_s,
            clock: random.next() * timing.clock_u_ppm * 1e-6,
            phase: if zero_u_s > 0.0 { random.next().rem_euclid(1.0) } else { 0.0 },
        }
    }
}

/// A movement: for each of six numbers of a pose, some oscillations.
pub struct Movement([Vec<[f64; 3]>; 6]);

impl Movement {
    /// Of a person who stands quietly: millimetres in the camera's frame, and degrees.
    pub fn of_person(random: &mut Random) -> Self {
        let sizes = [0.004, 0.004, 0.003, 3.0, 0.6, 6.0];
        Self(sizes.map(|size| {
            let oscillation = |at: usize| {
                let hz = 0.12 * 1.7_f64.powi(at as i32) * (1.0 + 0.1 * random.next());
                // Amplitudes fall with the frequency, as those of sway do.
                let amplitude = size * (1.0 + 0.3 * random.next()) / (1.0 + at as f64).powf(1.5);
                [amplitude, std::f64::consts::TAU * hz, 3.0 * random.next()]
            };
            (0..6).map(oscillation).collect()
        }))
    }

    fn at(&self, time_s: f64) -> Vector6<f64> {
        Vector6::from_fn(|row, _| {
            self.0[row]
                .iter()
                .map(|[size, rad_s, phase]| size * (rad_s * time_s + phase).sin())
                .sum()
        })
    }
}

/// A trial as it was measured, and its true figures in the order of the budget's.
pub struct Simulated {
    pub measured: Measured,
    pub truth: Vec<f64>,
}

const TRUNKS: [Trunk; 2] = Trunk::ALL;

fn target(trunk: Trunk) -> TargetGeometry {
    let (columns, rows, role, lever_mm) = match trunk {
        Trunk::Lower => (6, 5, Role::Lower, [0.0, 0.0, 100.0]),
        Trunk::Upper => (5, 4, Role::Upper, [0.0; 3]),
    };
    TargetGeometry::checker(columns, rows, 12.0, Origin::Center, role, lever_mm).unwrap()
}

fn rest(trunk: Trunk) -> Pose<Cam, Target> {
    match trunk {
        Trunk::Lower => Pose::from_theta([0.02, 0.1, -0.15, 30.0, 190.0, 1000.0]),
        Trunk::Upper => Pose::from_theta([-0.03, -0.2, 0.1, 140.0, -200.0, 960.0]),
    }
}

fn cam_from_scene() -> Pose<Cam, Scene> {
    Pose::from_theta([0.01, -0.03, 0.05, 0.0, 100.0, 1000.0])
}

fn lever_mm(trunk: Trunk) -> Vector3<f64> {
    target(trunk).virtual_point_mm()
}

/// A trial of these movements of the lower and the upper target.
pub fn trial(
    movements: &[Movement; 2],
    errors: &Errors,
    inputs: &Inputs,
    settings: &Settings,
    random: &mut Random,
) -> Simulated {
    let frames = (DURATION_S * RATE_HZ) as usize;
    let mut bodies = Vec::new();
    let mut truth = Vec::new();
    let mut means = Vec::new();
    for (at, trunk) in TRUNKS.into_iter().enumerate() {
        let pose = |time_s: f64| rest(trunk).moved_by(&movements[at].at(time_s));
        let times_s: Vec<f64> =
            (0..frames).map(|frame| (frame as f64 + errors.phase) / RATE_HZ).collect();
        let poses: Vec<Pose<Cam, Target>> = times_s
            .iter()
            .map(|time_s| {
                let jitter_s = inputs.timing.jitter_u_s * random.next();
                let noise = POSE_SD.map(|sd| sd * errors.noise * random.next());
                seen(trunk, at, &pose(time_s + jitter_s), errors).moved_by(&Vector6::from(noise))
            })
            .collect();
        let scene = SceneFrame::new(cam_from_scene());
        let positions_mm = |poses: &[Pose<Cam, Target>]| {
            let points =
                poses.iter().map(|pose| scene.anatomical(&pose.transform(&lever_mm(trunk))));
            points.map(|it| Vector3::new(it.ap_mm, it.ml_mm, it.si_mm)).collect::<Vec<_>>()
        };
        let measured_s =
            times_s.iter().map(|time_s| (time_s + errors.zero_s) * (1.0 + errors.clock));
        let series = series(measured_s.collect(), &positions_mm(&poses));
        let covariance_mm2 = poses.iter().map(|pose| covariance_mm2(trunk, pose, &scene)).collect();
        bodies.push(
            Body::new(trunk, series, covariance_mm2, &poses, &LENS, &scene, &target(trunk))
                .unwrap(),
        );
        // The true positions are along the true axes.
        let turn = plumbline::pose::rotation_from_vector(&errors.turn_rad);
        let true_mm = |time_s: f64| turn * positions_mm(&[pose(time_s)])[0];
        let (figures, mean_mm) = true_figures(&times_s, settings, true_mm);
        truth.extend(figures);
        means.push(mean_mm);
    }
    truth.push((means[1] - means[0]).norm());
    let measured = Measured { bodies, lens: lens_uncertainty(), zero_u_s: Some(errors.zero_u_s) };
    Simulated { measured, truth }
}

fn series(time_s: Vec<f64>, positions_mm: &[Vector3<f64>]) -> Series {
    let along = |axis: usize| positions_mm.iter().map(|it| it[axis]).collect();
    Series::new(time_s, [along(0), along(1), along(2)]).unwrap()
}

/// The pose that a tracker finds with what it believes, of a target that is at this pose.
fn seen(
    trunk: Trunk,
    at: usize,
    cam_from_target: &Pose<Cam, Target>,
    errors: &Errors,
) -> Pose<Cam, Target> {
    let target = target(trunk);
    let corners = (0..target.corner_count()).map(|corner| target.corner_mm(corner));
    let seen_px: Vec<(Vector3<f64>, Vector2<f64>)> = corners
        .map(|point_mm| {
            let [along, across, other, stretch] = shapes(&target, &point_mm);
            let [first, second, third] = errors.bows_mm[at];
            let true_mm = (point_mm + stretch * errors.stretch) * (1.0 + errors.scale)
                + along * first
                + across * second
                + other * third;
            (point_mm, errors.lens.project(&cam_from_target.transform(&true_mm)).unwrap())
        })
        .collect();
    let mut pose = *cam_from_target;
    // From the truth, each step squares an error of some thousandths.
    for _ in 0..3 {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for (point_mm, raw_px) in &seen_px {
            let point_cam_mm = pose.transform(point_mm);
            let ray = ray_of(&point_cam_mm).unwrap();
            let (believed_px, by_ray) = LENS.raw_from_ray_with_jacobian(&ray);
            let by_point = by_ray * ray_by_point(&point_cam_mm, &ray);
            let by_pose = by_point * pose.point_by_increment(point_mm);
            normal += by_pose.tr_mul(&by_pose);
            right += by_pose.tr_mul(&(raw_px - believed_px));
        }
        pose = pose.moved_by(&normal.cholesky().unwrap().solve(&right));
    }
    pose
}

/// The covariance of a point, as the box's packets give it.
fn covariance_mm2(trunk: Trunk, pose: &Pose<Cam, Target>, scene: &SceneFrame) -> Matrix3<f64> {
    let by_pose = scene.anatomical_from_cam() * pose.point_by_increment(&lever_mm(trunk));
    let covariance = by_pose
        * Matrix6::from_diagonal(&Vector6::from(POSE_SD.map(|sd| sd * sd)))
        * by_pose.transpose();
    0.5 * (covariance + covariance.transpose())
}

/// The figures of a movement that is known at every time, in the budget's order, and the mean
/// position.
///
/// The filter is the trial's: it sees the samples of one phase at a time, so that the finer movement
/// passes through the same weights at the same distances.
fn true_figures(
    times_s: &[f64],
    settings: &Settings,
    true_mm: impl Fn(f64) -> Vector3<f64>,
) -> (Vec<f64>, Vector3<f64>) {
    let filter = FILTER.at(RATE_HZ).unwrap();
    let phases: Vec<Series> = (0..FINER)
        .map(|phase| {
            let late_s = phase as f64 / (FINER as f64 * RATE_HZ);
            let times_s: Vec<f64> = times_s.iter().map(|it| it + late_s).collect();
            let positions_mm: Vec<Vector3<f64>> = times_s.iter().map(|it| true_mm(*it)).collect();
            filter.apply(&series(times_s, &positions_mm)).unwrap().series
        })
        .collect();
    let mut fine: Vec<(f64, Vector3<f64>)> = Vec::new();
    for sample in 0..times_s.len() {
        for phase in &phases {
            let at = Axis::ALL.map(|axis| phase.along(axis).unwrap()[sample]);
            fine.push((phase.time_s()[sample], Vector3::from(at)));
        }
    }
    let (fine_s, fine_mm): (Vec<f64>, Vec<Vector3<f64>>) = fine.into_iter().unzip();
    let unfiltered = Settings { filter: Design::None, ..settings.clone() };
    let of = |series: &Series| Prepared::of(series, &unfiltered).unwrap().lengths(None).unwrap().0;
    let (coarse, fine) = (of(&phases[0]), of(&series(fine_s, &fine_mm)));
    let inside_s = settings.span_s.clone().unwrap();
    let mut figures = listed(&coarse);
    // The path is that of the finer movement; an ellipse's area depends on the number of samples.
    let velocity_by_path = figures[VELOCITY] / figures[TRANSVERSE_PATH];
    figures[..PATHS].copy_from_slice(&listed(&fine)[..PATHS]);
    figures[VELOCITY] = velocity_by_path * figures[TRANSVERSE_PATH];
    let inside: Vec<Vector3<f64>> =
        times_s.iter().filter(|it| inside_s.contains(it)).map(|it| true_mm(*it)).collect();
    (figures, inside.iter().sum::<Vector3<f64>>() / inside.len() as f64)
}

/// The first figures of a point are its paths, of which one is in the transverse plane; the last is
/// its velocity there.
const PATHS: usize = 6;
const TRANSVERSE_PATH: usize = 3;
const VELOCITY: usize = 15;

/// The figures of one point, in the order of the budget.
fn listed(lengths: &Lengths) -> Vec<f64> {
    let (axes, planes) = (&lengths.path.length_mm.axes, &lengths.path.length_mm.planes);
    let (rms, range) = (&lengths.extent.rms_mm.axes, &lengths.extent.range_mm);
    let ellipse = &lengths.ellipse;
    let all = [
        &axes.ap,
        &axes.ml,
        &axes.si,
        &planes.transverse,
        &planes.sagittal,
        &planes.coronal,
        &rms.ap,
        &rms.ml,
        &rms.si,
        &range.ap,
        &range.ml,
        &range.si,
        &ellipse.transverse.area_mm2,
        &ellipse.sagittal.area_mm2,
        &ellipse.coronal.area_mm2,
        &lengths.path.mean_velocity_mm_s.planes.transverse,
    ];
    all.map(|it| it.value().unwrap()).to_vec()
}

/// The figures of a trial's points as they were measured.
pub fn figures(bodies: &[Body], settings: &Settings) -> Vec<f64> {
    let of = |body: &Body| {
        let prepared = Prepared::of(&body.series, settings).unwrap();
        listed(&prepared.lengths(None).unwrap().0)
    };
    bodies.iter().flat_map(of).collect()
}

/// A figure's name, for messages.
pub fn name(figure: &FigureBudget) -> String {
    format!("{} {} {}", figure.point, figure.quantity.words().0, figure.direction)
}

/// Checks that the truth's order is the budget's.
pub fn assert_order(figures: &[FigureBudget]) {
    let of_point: Vec<(Quantity, &str)> =
        figures.iter().take(16).map(|it| (it.quantity, it.direction)).collect();
    let [ap, ml, si] = Axis::ALL.map(Axis::word);
    let [transverse, sagittal, coronal] = Plane::ALL.map(Plane::word);
    let expected = [
        (Quantity::Path, [ap, ml, si, transverse, sagittal, coronal].to_vec()),
        (Quantity::Rms, [ap, ml, si].to_vec()),
        (Quantity::Range, [ap, ml, si].to_vec()),
        (Quantity::Area, [transverse, sagittal, coronal].to_vec()),
        (Quantity::Velocity, [transverse].to_vec()),
    ];
    let expected = expected.iter().flat_map(|(of, all)| all.iter().map(|it| (*of, *it)));
    assert_eq!(of_point, expected.collect::<Vec<_>>());
    assert_eq!((figures.len(), figures[32].quantity), (33, Quantity::Distance));
}
