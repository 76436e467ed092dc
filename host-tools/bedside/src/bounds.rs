//! What a target has to look like for good poses: the bounds by which [`aim`](crate::aim) advises
//! and the [`doctor`](crate::doctor) judges.

/// Blur of a picture that is as sharp as it gets, raw pixels: a pixel's own extent is
/// 1 / sqrt(12) = 0.29 px, and a good lens at its aperture adds 0.5 px.
const BLUR_BEST_PX: f32 = 0.6;

/// Blur at which a frame is of no use: the smallest squares have lost their middle.
const BLUR_WORST_PX: f32 = 3.0;

/// A lens whose score is below this can be turned to something better.
pub const FOCUS_MIN: u8 = 80;

/// A blur in one direction that is larger than in the other by this factor, and matters,
/// comes from motion.
pub(crate) const MOTION_RATIO: f32 = 1.5;
pub(crate) const MOTION_BLUR_PX_MIN: f32 = 1.0;

/// Squares smaller than this leave an edge fewer pixels than its fit looks at.
pub const PITCH_PX_MIN: f32 = 15.0;

/// Contrast below which noise, and not the lens, sets the precision.
pub const CONTRAST_MIN: f32 = 0.25;

/// Light squares darker than this leave half of the camera's range unused.
pub const LIGHT_MIN: f32 = 0.4;

/// Part of the light squares' pixels that may be white: single ones are hot pixels.
pub(crate) const SATURATED_MAX: f32 = 0.001;

/// Depth is promised for so many standard deviations to either side: 95 of 100 frames.
pub(crate) const COVERAGE: f32 = 1.96;

/// 100 for a blur of [`BLUR_BEST_PX`] or less, falling evenly to 0 at [`BLUR_WORST_PX`].
pub(crate) fn focus_score(blur_px: f32) -> u8 {
    let part = (BLUR_WORST_PX - blur_px) / (BLUR_WORST_PX - BLUR_BEST_PX);
    (100.0 * part.clamp(0.0, 1.0)).round() as u8
}

#[cfg(test)]
mod tests {
    use plumbline_trial::verdict::Criteria;

    use super::*;

    #[test]
    fn the_verdict_on_a_trial_is_by_the_same_bounds() {
        let doubtful = Criteria::default().doubtful;
        for (criterion, bound) in [
            (doubtful.contrast_min, CONTRAST_MIN),
            (doubtful.light_min, LIGHT_MIN),
            (doubtful.saturated_percent_max, 100.0 * SATURATED_MAX),
        ] {
            assert!((criterion.unwrap() - f64::from(bound)).abs() < 1e-6, "{bound}");
        }
        let blur_px = doubtful.blur_px_max.unwrap() as f32;
        assert_eq!((focus_score(blur_px), focus_score(blur_px + 0.02)), (FOCUS_MIN, FOCUS_MIN - 1));
    }

    #[test]
    fn the_focus_score_is_100_for_the_best_lens_and_0_for_a_useless_frame() {
        let scores = [0.3, 0.6, 0.84, 1.8, 3.0, 9.0].map(focus_score);
        assert_eq!(scores, [100, 100, 90, 50, 0, 0]);
    }
}
