//! The live figures against those of the analysis.

use nalgebra::Vector3;
use plumbline_analysis::series::Series;
use plumbline_analysis::sway::noise::Noise;
use plumbline_analysis::sway::{Settings, Sway, analyze};

use super::*;

const RATE_HZ: f64 = 60.0;

/// A minute of sway of some millimetres with noise, whose covariance slowly grows.
fn points() -> Vec<Point> {
    let mut state = 1_u64;
    let mut random = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let point = |frame: u32| {
        let time_s = f64::from(frame) / RATE_HZ;
        let wave = |hz: f64, mm: f64| mm * (std::f64::consts::TAU * hz * time_s).sin();
        let sd_mm = Vector3::new(0.1, 0.03, 0.02) * (1.0 + time_s / 60.0);
        let mut covariance = Matrix3::from_diagonal(&sd_mm.component_mul(&sd_mm));
        covariance[(0, 1)] = 0.3 * sd_mm.x * sd_mm.y;
        covariance[(1, 0)] = covariance[(0, 1)];
        Point {
            time_s: 5.0 + time_s + 2e-4 * random(),
            position_mm: [
                wave(0.31, 6.0) + wave(1.7, 0.6) + sd_mm.x * random(),
                wave(0.23, 3.0) + wave(1.1, 0.4) + sd_mm.y * random(),
                1400.0 + wave(0.4, 0.5) + sd_mm.z * random(),
            ],
            covariance_mm2: Some(covariance),
        }
    };
    (0..3600).map(point).collect()
}

/// All that has come, and nothing more: the last half window counts too.
fn live(points: &[Point], from_s: f64) -> TrunkFigures {
    let mut figures = Figures::default();
    figures.start_over(from_s);
    for point in points {
        figures.take(1, Some(point), None);
    }
    assert_eq!(figures.so_far(Trunk::Lower), Err(NotYet::Settling));
    figures.upper.end_part();
    figures.so_far(Trunk::Upper).unwrap()
}

fn analyzed(points: &[Point], from_s: f64) -> Sway {
    let along = |axis: usize| points.iter().map(|point| point.position_mm[axis]).collect();
    let times_s = points.iter().map(|point| point.time_s).collect();
    let series = Series::new(times_s, [along(0), along(1), along(2)]).unwrap();
    let covariances: Vec<_> = points.iter().filter_map(|point| point.covariance_mm2).collect();
    let noise = Noise::per_sample(&series, &covariances).unwrap();
    let span_s = Some(from_s..f64::INFINITY);
    let settings = Settings { span_s, bins_s: Vec::new(), ..Settings::default() };
    analyze(&series, Some(&noise), &settings).unwrap()
}

fn assert_same(points: &[Point], from_s: f64) {
    let (found, wanted) = (live(points, from_s), analyzed(points, from_s));
    let is_near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-9 * wanted.abs().max(1.0);
    let figures = &wanted.figures;
    let path_mm = figures.path.length_mm.planes.transverse.value().unwrap();
    assert!(is_near(found.path_mm, path_mm), "{} {path_mm}", found.path_mm);
    let noise_mm = wanted.noise.as_ref().unwrap().total.alone_mm.planes.transverse.value().unwrap();
    let found_mm = found.noise_path_mm.unwrap();
    assert!(is_near(found_mm, noise_mm), "{found_mm} {noise_mm}");
    let rms_mm = &figures.extent.rms_mm.axes;
    for (found_mm, wanted) in found.rms_mm.iter().zip([&rms_mm.ap, &rms_mm.ml, &rms_mm.si]) {
        assert!(is_near(*found_mm, wanted.value().unwrap()), "{found_mm} {wanted:?}");
    }
    assert_eq!((found.samples, found.gaps), (wanted.samples, wanted.gaps));
    assert!(is_near(found.gaps_s, wanted.gaps_s));
    // Of so few points the rate is known to a thousandth.
    assert!((found.rate_hz / wanted.rate_hz - 1.0).abs() < 1e-3, "{}", found.rate_hz);
}

#[test]
fn they_are_those_of_the_analysis() {
    let points = points();
    for from_s in [f64::MIN, 5.0 + 20.3 / RATE_HZ, 25.0] {
        assert_same(&points, from_s);
    }
}

#[test]
fn gaps_are_left_out_and_counted_as_in_the_analysis() {
    let is_missing = |frame: usize| matches!(frame, 700..705 | 1500 | 2000..2200);
    let points: Vec<Point> = points()
        .into_iter()
        .enumerate()
        .filter(|(frame, _)| !is_missing(*frame))
        .map(|(_, point)| point)
        .collect();
    for from_s in [f64::MIN, 25.0] {
        assert_same(&points, from_s);
    }
    let found = live(&points, f64::MIN);
    assert_eq!(found.gaps, 3);
    assert!((found.seconds - 3599.0 / RATE_HZ).abs() < 1e-3);
}

#[test]
fn they_come_a_quarter_of_a_second_late_and_start_over_at_t_0() {
    let points = points();
    let mut figures = Figures::default();
    for point in &points[..1200] {
        figures.take(1, Some(point), Some(point));
    }
    let before = figures.so_far(Trunk::Lower).unwrap();
    assert_eq!((before.samples, before.gaps), (1200 - 15, 0));
    // Set as the frame comes whose time it is: nothing of it has been counted yet.
    let zero_s = points[1199].time_s;
    figures.start_over(zero_s);
    assert_eq!(figures.so_far(Trunk::Lower), Err(NotYet::Settling));
    for point in &points[1200..] {
        figures.take(1, Some(point), Some(point));
    }
    figures.each(Follower::end_part);
    for trunk in Trunk::ALL {
        let (found, wanted) = (figures.so_far(trunk).unwrap(), analyzed(&points, zero_s));
        let path_mm = wanted.figures.path.length_mm.planes.transverse.value().unwrap();
        assert!((found.path_mm - path_mm).abs() < 1e-9 * path_mm, "{} {path_mm}", found.path_mm);
    }
}

#[test]
fn late_and_repeated_frames_and_a_restart_do_no_harm() {
    let points = points();
    let mut figures = Figures::default();
    for (at, point) in points[..600].iter().enumerate() {
        figures.take(1, Some(point), None);
        figures.take(1, Some(&points[at / 2]), None);
    }
    let once = live(&points[..600], f64::MIN);
    // The box has restarted: its clock begins anew, and all of its frames count.
    figures.start_over(0.0);
    for point in &points[..600] {
        figures.take(2, Some(&Point { time_s: point.time_s - 5.0, ..*point }), None);
    }
    figures.upper.end_part();
    let again = figures.so_far(Trunk::Upper).unwrap();
    // The last quarter of a second of the session before counts, too: it came after t = 0.
    assert_eq!((again.samples, again.gaps), (600 + 15, 0));
    assert!(again.path_mm > once.path_mm && again.path_mm < 1.1 * once.path_mm, "{again:?}");
}

#[test]
fn what_is_not_known_is_not_made_up() {
    let mut points = points();
    points[100].covariance_mm2 = None;
    assert_eq!(live(&points[..600], f64::MIN).noise_path_mm, None);
    // A slow camera.
    let mut figures = Figures::default();
    for point in points.iter().step_by(15) {
        figures.take(1, Some(point), None);
    }
    let Err(NotYet::Rate(why)) = figures.so_far(Trunk::Upper) else { panic!("no reason") };
    assert!(why.to_string().contains("4.0 Hz"), "{why}");
}
