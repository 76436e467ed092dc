//! What the camera sees, in numbers: enough to aim, focus and expose it without a picture.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::limits::TARGETS_MAX;
use crate::tell::view::{FrameView, TargetView};

/// How one frame looks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct View {
    /// Which frame, as in its pose packet.
    pub sequence: u32,
    /// The exposure time that the camera was asked for; `None` where it was left unchanged.
    pub exposure_us: Option<u32>,
    /// The gain that it was asked for, likewise.
    pub gain: Option<f32>,
    /// The frame as a whole.
    pub frame: FrameView,
    /// Each target that was measured in it.
    pub targets: Vec<TargetView, TARGETS_MAX>,
}

impl View {
    pub(super) fn is_finite(&self) -> bool {
        let FrameView { level, saturated, blur_px } = self.frame;
        let frame = [Some(level), Some(saturated), blur_px, self.gain];
        let of_target = |target: &TargetView| {
            let TargetView {
                light, dark, saturated, blur_px: [along_x, along_y], pitch_px, ..
            } = *target;
            [light, dark, saturated, along_x, along_y, pitch_px].iter().all(|it| it.is_finite())
        };
        frame.into_iter().flatten().all(f32::is_finite) && self.targets.iter().all(of_target)
    }
}
