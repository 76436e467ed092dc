extern crate std;

use super::report::{GridRejection, NoPose, TargetState};
use super::view::frame_view;
use crate::model::image::GreyImage;

/// Files hold these words, and what reads them compares them.
#[test]
fn a_state_and_a_reason_without_a_pose_keep_their_words() {
    for (state, word) in [
        (TargetState::Acquiring, "acquiring"),
        (TargetState::Tracking, "tracking"),
        (TargetState::Coasting, "coasting"),
    ] {
        assert_eq!(state.word(), word);
    }
    for (reason, words) in [
        (NoPose::FrameSize, "frame size"),
        (NoPose::Searching, "searching"),
        (NoPose::NotFound(GridRejection::NoLattice), "no checkerboard"),
        (NoPose::NotFound(GridRejection::OtherDimensions), "other dimensions"),
        (NoPose::NotFound(GridRejection::Cut), "cut by the frame"),
        (NoPose::NotFound(GridRejection::Incomplete), "incomplete"),
        (NoPose::NotFound(GridRejection::GoesOn), "goes on"),
        (NoPose::NotFound(GridRejection::Ambiguous), "seen twice"),
        (NoPose::TooFewCorners, "too few corners"),
        (NoPose::ExtentUnknown, "extent unknown"),
        (NoPose::PoorFit, "poor fit"),
    ] {
        assert_eq!(reason.words(), words);
    }
}

#[test]
fn a_step_of_a_tenth_of_white_is_an_edge_wherever_it_is() {
    const WHITE: u16 = 1000;
    let (width, height) = (200, 64);
    for (column, left, right, is_edge) in [
        (100, 400, 500, true),
        (100, 500, 400, true),
        (100, 400, 499, false),
        (100, 499, 400, false),
        // What the comparison over 8 px reaches next to the borders.
        (8, 400, 500, true),
        (width - 8, 400, 500, true),
    ] {
        let pixel = |at: usize| if at % width < column { left } else { right };
        let pixels: std::vec::Vec<u16> = (0..width * height).map(pixel).collect();
        let image = GreyImage::with_white_level(&pixels, width, height, width, WHITE).unwrap();
        assert_eq!(frame_view(&image).blur_px.is_some(), is_edge, "{left}, {right} at {column}");
    }
}
