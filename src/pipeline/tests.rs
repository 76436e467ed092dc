extern crate std;

use std::boxed::Box;
use std::vec;

use nalgebra::Matrix6;

use super::*;
use crate::model::config::{Links, Machine, TargetConfig};
use crate::model::lens::{Distortion, Lens};
use crate::model::motion::Motion;
use crate::model::target::Origin;

mod frames;

const ROLES: [Role; 3] = [Role::Upper, Role::Lower, Role::Scene];

const SCENE_THETA: [f64; 6] = [0.1, -0.2, 0.3, 10.0, -400.0, 1500.0];

/// In the body, from the lower target.
const VIRTUAL_POINT_MM: [f64; 3] = [1.0, 2.0, 100.0];

fn lens() -> Lens {
    Lens {
        width_px: 640,
        height_px: 480,
        fx_px: 800.0,
        fy_px: 800.0,
        cx_px: 319.5,
        cy_px: 239.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
    }
}

/// A target of each role, and their grids of 5, 7 and 9 columns.
fn config(readout_ns: i32, cam_from_scene_theta: Option<[f64; 6]>) -> Config {
    let target = |(role, columns): (Role, u8)| {
        let geometry =
            TargetGeometry::checker(columns, 4, 12.0, Origin::Center, role, VIRTUAL_POINT_MM);
        let name = ["5", "7", "9"][usize::from(columns - 5) / 2].try_into().unwrap();
        TargetConfig { name, geometry: geometry.unwrap() }
    };
    Config {
        device: "ward 3".try_into().unwrap(),
        serial_number: "PL-0001".try_into().unwrap(),
        lens: lens(),
        readout_ns,
        targets: ROLES.into_iter().zip([5, 7, 9]).map(target).collect(),
        cam_from_scene_theta,
        links: Links::default(),
        capture: None,
        machine: Machine::default(),
        trigger: None,
    }
}

/// A pipeline with this configuration.
fn pipeline(readout_ns: i32, cam_from_scene_theta: Option<[f64; 6]>) -> Box<Pipeline> {
    let mut pipeline = Box::new(Pipeline::new());
    pipeline.configure(&config(readout_ns, cam_from_scene_theta)).unwrap();
    pipeline
}

/// Where each target is: beside each other.
fn pose(index: usize) -> Pose<Cam, Target> {
    Pose::from_theta([0.1, 0.2, -0.3, 200.0 * (index as f64 - 1.0), 5.0, 1000.0])
}

fn measured(index: usize) -> Measurement {
    Measurement {
        cam_from_target: pose(index),
        delay_ns: 0,
        covariance: Matrix6::identity(),
        rms_px: 0.0,
        corners: 20,
        corners_total: 20,
    }
}

/// Whoever had the last turn: the next one is the next in order that is missing.
#[test]
fn the_missing_targets_take_turns() {
    let pixels = vec![0_u8; 640 * 480];
    let frame = GreyImage::new(&pixels, 640, 480, 640).unwrap();
    let mut pipeline = pipeline(0, None);
    for (last, missing) in (0..3).flat_map(|last| (1..8_u8).map(move |missing| (last, missing))) {
        let is_missing = |index: usize| missing >> index & 1 == 1;
        for (index, track) in pipeline.tracks.iter_mut().enumerate() {
            track.state = State::Coasting(Motion::new(pose(index), 0));
            track.outcome =
                if is_missing(index) { Err(NoPose::PoorFit) } else { Ok(measured(index)) };
        }
        // Its turn, and then the others'.
        pipeline.search_turn = last;
        let in_order = [last, last + 1, last + 2].map(|index| index % 3);
        let order = in_order.into_iter().filter(|&index| is_missing(index));
        for target in order.cycle().take(4) {
            let geometry = &pipeline.tracks[target].geometry;
            let area = region(&pipeline.lens, geometry, &pose(target)).unwrap();
            let next = pipeline.next_sweep(&frame, 1);
            assert_eq!(next, (Goal::Region { target }, area), "{last} {missing:b}");
        }
    }
}

#[test]
fn what_is_not_known_is_searched_for_in_the_whole_frame() {
    let pixels = vec![0_u8; 640 * 480];
    let frame = GreyImage::new(&pixels, 640, 480, 640).unwrap();
    let mut pipeline = pipeline(0, None);
    let whole = (Goal::WholeFrame, Area { columns: 0..640, rows: 0..480 });
    assert_eq!(pipeline.next_sweep(&frame, 0), whole);
    // Nor is one that has left the frame expected in a part of it.
    let mut outside = pose(0);
    outside.translation_mm.x = 5000.0;
    pipeline.tracks[1].state = State::Coasting(Motion::new(outside, 0));
    assert_eq!(pipeline.next_sweep(&frame, 0), whole);
}

#[test]
fn a_pipeline_that_forgets_has_no_motion_and_no_search() {
    let mut pipeline = pipeline(0, None);
    for (index, track) in pipeline.tracks.iter_mut().enumerate() {
        track.state = State::Tracking(Motion::new(pose(index), 0));
    }
    pipeline.search.begin(Goal::WholeFrame, Area { columns: 0..640, rows: 0..480 });
    pipeline.forget();
    assert!(pipeline.tracks.iter().all(|track| track.state == State::Acquiring));
    assert_eq!(pipeline.search.goal(), None);
}

/// The upper trunk is the origin of the shoulder's target, the lower trunk a point in the body
/// that is fixed to the other one.
#[test]
fn each_trunk_point_is_that_of_its_own_target() {
    let mut pipeline = pipeline(0, Some(SCENE_THETA));
    let scene = SceneFrame::new(Pose::from_theta(SCENE_THETA));
    let upper = scene.anatomical(&pose(0).translation_mm);
    let lower = scene.anatomical(&pose(1).transform(&VIRTUAL_POINT_MM.into()));
    for seen in 0..8_u8 {
        let is_seen = |index: usize| seen >> index & 1 == 1;
        for (index, track) in pipeline.tracks.iter_mut().enumerate() {
            let found = is_seen(index).then(|| measured(index));
            track.outcome = found.ok_or(NoPose::Searching);
        }
        let report = pipeline.report(7);
        assert_eq!(report.targets.iter().map(|it| it.role).collect::<vec::Vec<_>>(), ROLES);
        assert_eq!(report.upper_trunk, is_seen(0).then_some(upper), "{seen:b}");
        assert_eq!(report.lower_trunk, is_seen(1).then_some(lower), "{seen:b}");
        pipeline.scene = None;
        let report = pipeline.report(7);
        assert_eq!((report.upper_trunk, report.lower_trunk), (None, None));
        pipeline.scene = Some(scene);
    }
}

#[test]
fn rows_have_their_own_times_with_a_rolling_shutter_only() {
    let pixels = vec![0_u8; 640 * 480];
    let frame = GreyImage::new(&pixels, 640, 480, 640).unwrap();
    for readout_ns in [0, 16_000_000, -16_000_000] {
        let mut pipeline = pipeline(readout_ns, None);
        let motion = Motion::new(pose(1), 0);
        pipeline.tracks[0].state = State::Tracking(motion);
        let camera = Camera { lens: &pipeline.lens, shutter: pipeline.shutter, time_ns: 5 };
        let rolling = |index: usize| pipeline.tracks[index].view(&frame, &camera, true).rolling;
        assert_eq!(rolling(1).map(|it| it.motion), (readout_ns != 0).then_some(None));
        let known = rolling(0).map(|it| (it.time_ns, it.motion));
        assert_eq!(known, (readout_ns != 0).then_some((5, Some(&motion))), "{readout_ns}");
    }
}

#[test]
fn a_frame_fits_a_lens_of_both_its_sides() {
    let pixels = vec![0_u8; 640 * 480];
    let pipeline = pipeline(0, None);
    let fits = |[width, height]: [usize; 2]| {
        lens_fits(&pipeline.lens, &GreyImage::new(&pixels, width, height, width).unwrap())
    };
    assert!(fits([640, 480]));
    assert!(!fits([639, 480]) && !fits([640, 479]) && !fits([480, 640]));
}
