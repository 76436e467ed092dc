//! Frames in which the targets are drawn: how they are found, followed, lost and found again.

use std::vec::Vec;

use nalgebra::Vector3;

use super::*;
use crate::find::grid::GridRejection;
use crate::limits::SEARCH_PIXELS_PER_STEP;
use crate::test_support::drawing::{PLAIN, blurred};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const PAPER: u8 = 200;
const INK: u8 = 40;
const FRAME_NS: u64 = 16_666_667;
const WHOLE: Area = Area { columns: 0..WIDTH, rows: 0..HEIGHT };

/// Where each target is: tilted, and beside each other. A square has about 13 pixels.
fn place(index: usize) -> Pose<Cam, Target> {
    Pose::from_theta([0.3, -0.4, 0.15, 210.0 * (index as f64 - 1.0), 20.0, 700.0])
}

/// The same, so many squares along the target's axes from there.
fn beside(index: usize, [columns, rows]: [f64; 2]) -> Pose<Cam, Target> {
    let mut pose = place(index);
    pose.translation_mm = pose.transform(&(Vector3::new(columns, rows, 0.0) * 12.0));
    pose
}

fn all() -> [(usize, Pose<Cam, Target>); 3] {
    [0, 1, 2].map(|index| (index, place(index)))
}

/// Paper with these targets.
fn drawn(targets: &[(usize, Pose<Cam, Target>)]) -> Vec<u8> {
    let [ink, paper] = [INK, PAPER].map(f64::from);
    let mut levels = vec![paper; WIDTH * HEIGHT];
    let config = config(0, None);
    for (index, pose) in targets {
        let target = &config.targets[*index].geometry;
        PLAIN.draw(&lens(), target, pose, [ink, paper], &mut levels);
    }
    blurred(&levels, WIDTH).into_iter().map(|level| libm::round(level) as u8).collect()
}

fn frame(pixels: &[u8]) -> GreyImage<'_, u8> {
    GreyImage::new(pixels, WIDTH, HEIGHT, WIDTH).unwrap()
}

fn step(pipeline: &mut Pipeline, pixels: &[u8], time_ns: u64) -> Report {
    pipeline.step(&frame(pixels), time_ns)
}

/// A pipeline that has seen all targets at time 0.
fn tracking() -> Box<Pipeline> {
    let mut pipeline = pipeline(0, None);
    for (index, track) in pipeline.tracks.iter_mut().enumerate() {
        track.state = State::Tracking(Motion::new(place(index), 0));
    }
    pipeline
}

fn reasons(report: &Report) -> [Option<NoPose>; 3] {
    [0, 1, 2].map(|index| report.targets[index].measurement.err())
}

fn states(report: &Report) -> [TargetState; 3] {
    [0, 1, 2].map(|index| report.targets[index].state)
}

/// Without noise: only the grey levels are rounded.
fn assert_at(found: &Measurement, pose: &Pose<Cam, Target>) {
    let off = pose.increment_to(&found.cam_from_target);
    let sd = found.covariance.diagonal().map(libm::sqrt);
    assert!(off.iter().zip(&sd).all(|(off, sd)| off.abs() < 2.0 * sd), "{off} {sd}");
    assert!(found.sd_mm().max() < 0.2, "{sd}");
}

#[test]
fn targets_are_found_in_one_frame_and_followed_without_a_search() {
    let mut pipeline = pipeline(0, None);
    for number in 0..2_u32 {
        // A twelfth of a square from frame to frame.
        let shift = f64::from(number) / 12.0;
        let truth = [0, 1, 2].map(|index| (index, beside(index, [shift, -shift])));
        let time_ns = u64::from(number) * FRAME_NS;
        if number > 0 {
            // An interrupted sweep does not go on.
            pipeline.search.begin(Goal::WholeFrame, WHOLE);
        }
        let report = step(&mut pipeline, &drawn(&truth), time_ns);
        assert_eq!((report.sequence, report.capture_time_ns), (number, time_ns));
        assert_eq!(states(&report), [TargetState::Tracking; 3]);
        for ((index, pose), target) in truth.iter().zip(&report.targets) {
            let found = target.measurement.expect("a target that is seen");
            assert_at(&found, pose);
            let motion = pipeline.tracks[*index].state.motion().unwrap();
            assert_eq!((motion.cam_from_target, motion.time_ns), (found.cam_from_target, time_ns));
        }
        assert_eq!(pipeline.search.goal(), None);
        assert_eq!(pipeline.search.corners().as_slice().is_empty(), number > 0);
    }
}

#[test]
fn a_frame_of_another_size_is_not_measured() {
    let pixels = drawn(&all());
    let mut pipeline = pipeline(0, None);
    let narrow = GreyImage::new(&pixels, WIDTH - 1, HEIGHT, WIDTH).unwrap();
    step(&mut pipeline, &pixels, 0);
    assert_eq!(pipeline.view(&frame(&pixels)).1.len(), 3);
    assert_eq!(pipeline.view(&narrow).1.len(), 0);
    let report = pipeline.step(&narrow, FRAME_NS);
    assert_eq!(reasons(&report), [Some(NoPose::FrameSize); 3]);
    assert_eq!(states(&report), [TargetState::Coasting; 3]);
    assert_eq!(pipeline.view(&frame(&pixels)).1.len(), 0);
    let report = pipeline.step_found(&narrow, 2 * FRAME_NS, &[Err(GridRejection::NoLattice)]);
    assert_eq!(reasons(&report), [Some(NoPose::FrameSize); 3]);
    assert_eq!(states(&report), [TargetState::Acquiring; 3]);
}

#[test]
fn a_hidden_target_coasts_for_a_second_and_is_then_searched_for_in_slices() {
    use TargetState::{Acquiring, Coasting, Tracking};

    let mut pipeline = tracking();
    let [left, _, right] = all();
    let hidden = drawn(&[left, right]);
    let mut time_ns = 0;
    for (now_ns, state) in [(FRAME_NS, Coasting), (1_000_000_001, Acquiring)] {
        time_ns = now_ns;
        let report = step(&mut pipeline, &hidden, time_ns);
        // What the search of the region says does not matter.
        assert_eq!(reasons(&report), [None, Some(NoPose::TooFewCorners), None]);
        assert_eq!(states(&report), [Tracking, state, Tracking]);
    }
    let rows = SEARCH_PIXELS_PER_STEP / WIDTH;
    let steps = HEIGHT.div_ceil(rows);
    let mut report = || {
        time_ns += FRAME_NS;
        let report = step(&mut pipeline, &hidden, time_ns);
        assert_eq!(states(&report), [Tracking, Acquiring, Tracking]);
        let [None, reason, None] = reasons(&report) else { panic!("two targets are seen") };
        reason
    };
    let not_found = Some(NoPose::NotFound(GridRejection::OtherDimensions));
    // A sweep of the region may have been under way.
    assert!((0..2 * steps).any(|_| report() == not_found));
    for _ in 1..steps {
        assert_eq!(report(), Some(NoPose::Searching));
    }
    assert_eq!(report(), not_found);
}

#[test]
fn a_region_tells_only_of_the_target_that_it_is_for() {
    let mut pipeline = pipeline(0, None);
    pipeline.tracks[1].state = State::Coasting(Motion::new(place(1), 0));
    pipeline.search_turn = 1;
    let blank = [PAPER; WIDTH * HEIGHT];
    let [searching, hidden, not_found] = [
        NoPose::Searching,
        // That of a coasting target is why it was not measured.
        NoPose::TooFewCorners,
        NoPose::NotFound(GridRejection::NoLattice),
    ]
    .map(Some);
    // Nothing is tracked, so that each frame completes a sweep: of the region first, and then of the whole
    // frame for the next target.
    let report = step(&mut pipeline, &blank, FRAME_NS);
    assert_eq!(reasons(&report), [searching, hidden, searching]);
    let report = step(&mut pipeline, &blank, 2 * FRAME_NS);
    assert_eq!(reasons(&report), [not_found, hidden, not_found]);
}

#[test]
fn a_target_that_jumped_is_found_in_the_region_in_the_same_frame() {
    let mut pipeline = tracking();
    pipeline.search_turn = 1;
    let there = beside(1, [2.5, 0.5]);
    let report = step(&mut pipeline, &drawn(&[(1, there)]), FRAME_NS);
    assert_at(&report.targets[1].measurement.expect("it is seen"), &there);
    let hidden = Some(NoPose::TooFewCorners);
    assert_eq!(reasons(&report), [hidden, None, hidden]);
}

/// A target that is seen again is not searched for any more.
#[test]
fn the_sweep_for_a_target_ends_when_it_is_tracked_again() {
    let mut pipeline = tracking();
    pipeline.tracks[0].state = State::Acquiring;
    let [_, middle, right] = all();
    let pixels = drawn(&[middle, right]);
    for (target, goal) in [(1, Goal::WholeFrame), (0, Goal::Region { target: 0 })] {
        pipeline.search.begin(Goal::Region { target }, WHOLE);
        step(&mut pipeline, &pixels, FRAME_NS);
        assert_eq!(pipeline.search.goal(), Some(goal));
    }
}

#[test]
fn the_whole_of_a_target_is_known_after_any_time_and_a_part_of_it_only_in_the_next_frame() {
    let mut pipeline = tracking();
    let whole = drawn(&[(2, place(2))]);
    let known = pipeline.tracks[2].state;
    // From half a square to the right of its middle on, it is hidden.
    let mut part = whole.clone();
    let cut_px = lens().project(&place(2).translation_mm).unwrap().x + 6.5;
    for row in part.chunks_mut(WIDTH) {
        row[cut_px as usize..].fill(PAPER);
    }
    for (pixels, gap_ns, expected) in [
        (&whole, FRAME_NS, Ok(36..=36)),
        (&whole, 500_000_000, Ok(36..=36)),
        // Four of nine columns, and those of the middle one that are not too near to what hides the next.
        (&part, FRAME_NS, Ok(16..=20)),
        (&part, 500_000_000, Err(NoPose::ExtentUnknown)),
    ] {
        pipeline.tracks[2].state = known;
        pipeline.measure_tracked(&frame(pixels), gap_ns);
        match (pipeline.tracks[2].outcome, expected) {
            (Ok(found), Ok(corners)) => assert!(corners.contains(&found.corners), "{gap_ns}"),
            (outcome, expected) => assert_eq!(outcome.err(), expected.err(), "{gap_ns}"),
        }
    }
}

/// A part of a grid fits as well where its colours are the same, but then the target's own squares are where
/// its margin should be.
#[test]
fn a_target_is_not_taken_for_a_part_of_itself() {
    let pixels = drawn(&[(2, place(2))]);
    let mut pipeline = pipeline(0, None);
    step(&mut pipeline, &pixels, 0);
    for shift in [[2.0, 0.0], [-2.0, 0.0], [1.0, 1.0], [-1.0, 1.0]] {
        pipeline.tracks[2].state = State::Tracking(Motion::new(beside(2, shift), 0));
        pipeline.measure_tracked(&frame(&pixels), FRAME_NS);
        assert_eq!(pipeline.tracks[2].outcome, Err(NoPose::ExtentUnknown), "{shift:?}");
    }
    // And it is found where it is.
    pipeline.search_turn = 2;
    pipeline.search_missing(&frame(&pixels), FRAME_NS);
    assert_at(&pipeline.tracks[2].outcome.expect("it is seen"), &place(2));
}

#[test]
fn what_a_callers_search_found_is_measured_as_what_the_own_search_found() {
    let pixels = drawn(&all());
    let own = step(&mut pipeline(0, None), &pixels, 5);
    let mut search = Box::new(Search::new());
    search.begin(Goal::WholeFrame, WHOLE);
    assert!(search.advance(&frame(&pixels), true));
    let shapes = [5, 7, 9].map(|columns| GridShape { columns, rows: 4 });
    let grids = search.grids(&frame(&pixels), &shapes);
    let corners = search.corners().as_slice();
    let found =
        [Ok(FoundTarget { grid: grids[0].as_ref().unwrap(), corners }), Err(GridRejection::Cut)];
    // What was known is forgotten.
    for mut pipeline in [pipeline(0, None), tracking()] {
        pipeline.search.begin(Goal::WholeFrame, WHOLE);
        let report = pipeline.step_found(&frame(&pixels), 5, &found);
        assert_eq!(report.targets[0], own.targets[0]);
        let not_found = NoPose::NotFound(GridRejection::Cut);
        assert_eq!(reasons(&report), [None, Some(not_found), Some(NoPose::Searching)]);
        assert_eq!(pipeline.search.goal(), None);
    }
}

#[test]
fn a_view_tells_how_each_measured_target_looks() {
    let mut pipeline = pipeline(0, None);
    let [left, _, right] = all();
    let pixels = drawn(&[left, right]);
    step(&mut pipeline, &pixels, 0);
    let (whole, targets) = pipeline.view(&frame(&pixels));
    assert_eq!(whole, frame_view(&frame(&pixels)));
    let roles: Vec<Role> = targets.iter().map(|target| target.role).collect();
    assert_eq!(roles, [Role::Upper, Role::Scene]);
    for target in &targets {
        // The middles of the squares are not blurred.
        let levels = [(target.light, PAPER), (target.dark, INK)];
        assert!(levels.iter().all(|(seen, level)| (seen - f32::from(*level) / 255.0).abs() < 1e-6));
        assert_eq!(target.saturated, 0.0);
        let track = pipeline.tracks.iter().find(|it| it.geometry.role() == target.role).unwrap();
        let Track { geometry, appearance, .. } = track;
        assert_ne!(*appearance, Appearance::START);
        let blur_px = [appearance.x_blur_px, appearance.y_blur_px].map(|it| it as f32);
        assert_eq!(target.blur_px, blur_px);
        let pose = &track.outcome.unwrap().cam_from_target;
        let step_px = |from: usize, to: usize| {
            let at = |corner| lens().project(&pose.transform(&geometry.corner_mm(corner))).unwrap();
            (at(to) - at(from)).norm()
        };
        let steps = (0..geometry.corner_count()).flat_map(|corner| {
            let right = (corner + 1) % geometry.columns() != 0;
            let down = corner + geometry.columns() < geometry.corner_count();
            [
                right.then(|| step_px(corner, corner + 1)),
                down.then(|| step_px(corner, corner + geometry.columns())),
            ]
        });
        let mut steps: Vec<f64> = steps.flatten().collect();
        steps.sort_by(f64::total_cmp);
        let is_between = (steps[0]..steps[steps.len() - 1]).contains(&target.pitch_px.into());
        assert!(is_between, "{steps:?} {target:?}");
    }
}

/// The middle is seen in row 319.5 of 480, and each row takes a 30,000th of a second.
#[test]
fn a_target_has_the_time_of_the_row_in_which_its_middle_is_seen() {
    let pose = Pose::from_theta([0.3, -0.4, 0.15, 0.0, 70.0, 700.0]);
    for (readout_ns, delay_ns) in [(0, 0), (16_000_000, 10_650_000), (-16_000_000, 5_316_667)] {
        let mut pipeline = pipeline(readout_ns, None);
        let (lens, shutter) = (&pipeline.lens, pipeline.shutter);
        let camera = |time_ns: u64| Camera { lens, shutter, time_ns };
        let track = &mut pipeline.tracks[0];
        assert_eq!(track.time_ns(&camera(5), &pose), 5 + delay_ns, "{readout_ns}");
        assert_eq!(track.expected_time_ns(&camera(5)), 5);
        let last = Motion::new(pose, 1_000);
        for state in [State::Tracking(last), State::Coasting(last)] {
            track.state = state;
            assert_eq!(track.expected_time_ns(&camera(5)), 5 + delay_ns);
            // The last moment at which it coasts is a second later, by its own time.
            let last_ns = 1_000 + 1_000_000_000 - delay_ns;
            track.outcome = Err(NoPose::PoorFit);
            assert_eq!(track.next_state(&camera(last_ns)), State::Coasting(last));
            assert_eq!(track.next_state(&camera(last_ns + 1)), State::Acquiring);
        }
        let found = Measurement { delay_ns: 123, ..measured(0) };
        track.outcome = Ok(found);
        let next = State::Tracking(last.continued(found.cam_from_target, 5_123));
        assert_eq!(track.next_state(&camera(5_000)), next);
    }
}

#[test]
fn a_configuration_starts_afresh() {
    let mut pipeline = tracking();
    let blank = [PAPER; WIDTH * HEIGHT];
    let report = step(&mut pipeline, &blank, FRAME_NS);
    assert_eq!((report.sequence, states(&report)), (0, [TargetState::Coasting; 3]));
    pipeline.search.begin(Goal::WholeFrame, WHOLE);
    pipeline.configure(&config(0, None)).unwrap();
    assert_eq!(pipeline.search.goal(), None);
    let report = step(&mut pipeline, &blank, 2 * FRAME_NS);
    assert_eq!((report.sequence, states(&report)), (0, [TargetState::Acquiring; 3]));
    // One that is refused leaves none.
    let refused = pipeline.configure(&config(1_000_000_001, None));
    assert_eq!(refused, Err(ConfigError::Readout));
    let report = step(&mut pipeline, &blank, 3 * FRAME_NS);
    assert!(report.targets.is_empty());
}
