//! A rendered person whose targets are hidden: what is reported meanwhile, and how they are found
//! again.

use plumbline::report::{NoPose, TargetState};
use recorded::{CLEAN, FRAME_NS, Recorded, place};

#[test]
fn a_half_hidden_target_goes_on_and_says_so_and_a_lost_one_comes_back() {
    let recorded = Recorded::read(CLEAN);
    let mut pipeline = recorded.pipeline();
    let mut states = Vec::new();
    for frame in 0..80 {
        let place = place(frame, CLEAN);
        let mut pixels = recorded.frames[place].clone();
        match frame {
            20..30 => recorded.cover(place, 0, true, &mut pixels),
            40..50 => recorded.cover(place, 0, false, &mut pixels),
            _ => {}
        }
        let view = recorded.view(&pixels);
        let report = pipeline.step(&view, frame as u64 * FRAME_NS);
        // The other target never notices.
        assert!(report.targets[1].measurement.is_ok(), "frame {frame}");
        states.push(report.targets[0]);
    }
    let truth_z_mm = |frame| recorded.truth(place(frame, CLEAN), 0).translation_mm.z;
    for (frame, state) in states.iter().enumerate() {
        match (frame, &state.measurement) {
            (20..30, Ok(found)) => {
                assert!(found.corners < found.corners_total, "frame {frame} is half hidden");
                let error_mm = found.cam_from_target.translation_mm.z - truth_z_mm(frame);
                assert!(error_mm.abs() < 5.0 * found.sd_mm().z, "{error_mm} in frame {frame}");
            }
            (40..50, Err(_)) => assert_eq!(state.state, TargetState::Coasting),
            // Back in the very frame in which it is seen again.
            (0..20 | 30..40 | 50..80, Ok(found)) => {
                assert!(found.corners + 1 >= found.corners_total, "frame {frame}");
            }
            other => panic!("frame {frame}: {other:?}"),
        }
    }
}

#[test]
fn a_target_is_not_found_only_where_the_whole_frame_was_searched() {
    let recorded = Recorded::read(12);
    let mut pipeline = recorded.pipeline();
    let mut rendered = recorded.frames.clone();
    let mut reasons = Vec::new();
    for (frame, pixels) in rendered.iter_mut().enumerate() {
        recorded.cover(frame, 1, false, pixels);
        if frame >= 4 {
            recorded.cover(frame, 0, false, pixels);
        }
        let view = recorded.view(pixels);
        let report = pipeline.step(&view, frame as u64 * FRAME_NS);
        if frame >= 4 {
            assert_eq!(report.targets[0].state, TargetState::Coasting);
            reasons.push(report.targets[1].measurement.unwrap_err());
        }
    }
    // Nothing is tracked, so that each frame completes a sweep: alternately one around the place
    // where the first target was, and one of the whole frame for the second.
    let searching = reasons.iter().filter(|&&reason| reason == NoPose::Searching).count();
    assert_eq!(searching, reasons.len() / 2, "{reasons:?}");
}

#[test]
fn after_a_long_loss_a_part_of_a_target_is_not_enough() {
    let recorded = Recorded::read(30);
    let mut pipeline = recorded.pipeline();
    let mut rendered = recorded.frames.clone();
    for (frame, pixels) in rendered.iter_mut().enumerate() {
        match frame {
            10..20 => recorded.cover(frame, 0, false, pixels),
            20..30 => recorded.cover(frame, 0, true, pixels),
            _ => {}
        }
        let view = recorded.view(pixels);
        let report = pipeline.step(&view, frame as u64 * FRAME_NS);
        if frame >= 20 {
            assert_eq!(report.targets[0].measurement, Err(NoPose::ExtentUnknown), "{frame}");
        }
    }
}

#[test]
fn a_target_lost_for_long_is_searched_for_in_slices_and_found_again() {
    let recorded = Recorded::read(2);
    let mut pipeline = recorded.pipeline();
    // Two frames in turn: the person holds still, as far as the search is concerned.
    let seen = &recorded.frames;
    let mut hidden = seen.clone();
    for (frame, pixels) in hidden.iter_mut().enumerate() {
        recorded.cover(frame, 0, false, pixels);
    }
    // Longer than a target coasts, so that the whole frame must be searched.
    const HIDDEN: std::ops::Range<usize> = 10..90;
    let mut searched_in_slices = 0;
    let mut found_again = None;
    for frame in 0..140 {
        let rendered = if HIDDEN.contains(&frame) { &hidden } else { seen };
        let view = recorded.view(&rendered[frame % 2]);
        let report = pipeline.step(&view, frame as u64 * FRAME_NS);
        assert!(report.targets[1].measurement.is_ok(), "frame {frame}");
        let lost = &report.targets[0];
        if lost.state == TargetState::Acquiring && lost.measurement == Err(NoPose::Searching) {
            searched_in_slices += 1;
        }
        if frame >= HIDDEN.end && lost.measurement.is_ok() {
            found_again.get_or_insert(frame);
        }
    }
    assert!(searched_in_slices > 10, "{searched_in_slices} frames");
    // A sweep of 1456 x 1088 pixels takes 13 steps; one may be half done when the target
    // comes back, and the next one finds it.
    let found_again = found_again.expect("found again");
    assert!(found_again < HIDDEN.end + 2 * 13, "found in frame {found_again}");
}
