//! Whether the frames of a video follow each other at its rate.
//!
//! A frame that was dropped, or shown twice, changes how far the board gets from one frame to the
//! next. Each step is compared with the median of the two before and the two after it, along their
//! mean direction; where the board hardly moves, or turns round, nothing can be said, and nothing
//! depends on it.

use nalgebra::Vector2;

/// Steps below this are not compared, px.
const STEP_PX_MIN: f64 = 3.0;

/// A step is irregular if it differs from its neighbours by more than this share of theirs. A
/// dropped frame doubles it; a motion of 3 Hz at 30 frames per second changes it by a tenth.
const DEVIATION_MAX: f64 = 0.4;

/// The step from each place to the next: whether it is regular; `None` where that cannot be told.
pub fn regular(places_px: &[Vector2<f64>]) -> Vec<Option<bool>> {
    let steps: Vec<Vector2<f64>> = places_px.windows(2).map(|pair| pair[1] - pair[0]).collect();
    (0..steps.len())
        .map(|place| {
            let around = [place.checked_sub(2)?, place - 1, place + 1, place + 2];
            let [first, second, third, fourth] = around.map(|other| steps.get(other));
            let around = [*first?, *second?, *third?, *fourth?];
            let direction = around.iter().sum::<Vector2<f64>>().try_normalize(0.0)?;
            let mut lengths = around.map(|step| step.dot(&direction));
            lengths.sort_by(f64::total_cmp);
            // The first may be irregular itself.
            if lengths[1] < STEP_PX_MIN {
                return None;
            }
            let usual = (lengths[1] + lengths[2]) / 2.0;
            Some((steps[place].dot(&direction) / usual - 1.0).abs() <= DEVIATION_MAX)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board that swings by 100 px, 1.5 times a second, at 30 frames per second.
    fn swing(frames: impl Iterator<Item = usize>) -> Vec<Vector2<f64>> {
        let place = |frame: usize| {
            let phase = 9.4 * frame as f64 / 30.0;
            Vector2::new(100.0 * phase.sin(), 40.0 * (phase + 0.5).sin())
        };
        frames.map(place).collect()
    }

    #[test]
    fn a_steady_video_is_regular() {
        let found = regular(&swing(0..120));
        let told: Vec<bool> = found.into_iter().flatten().collect();
        assert!(told.len() > 60 && told.iter().all(|is_regular| *is_regular), "{told:?}");
    }

    #[test]
    fn a_dropped_and_a_repeated_frame_are_found() {
        // Both where the board is fast: at zero crossings of the sine.
        let dropped = regular(&swing((0..120).filter(|frame| *frame != 40)));
        assert_eq!(dropped[39], Some(false));
        let repeated = regular(&swing((0..120).map(|frame| frame - usize::from(frame > 40))));
        assert_eq!(repeated[40], Some(false));
        // Shown twice in place of the next one, which is a long step later.
        let mut places_px = swing(0..120);
        places_px[41] = places_px[40];
        let replaced = regular(&places_px);
        assert_eq!(replaced[40..42], [Some(false); 2]);
    }

    #[test]
    fn nothing_is_said_of_a_board_at_rest() {
        assert!(regular(&[Vector2::new(3.0, 4.0); 20]).iter().all(Option::is_none));
        assert!(regular(&[]).is_empty());
    }
}
