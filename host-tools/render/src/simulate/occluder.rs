//! A forearm that enters from the side, rests over part of a target and leaves again.

use std::str::FromStr;

use nalgebra::{Vector2, Vector3};
use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Target};

use super::background::ValueNoise;

/// One passage of the arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Occlusion {
    /// The name of the target.
    pub target: String,
    /// When the arm reaches the target, seconds.
    pub start_s: f64,
    /// When it has left the target, seconds.
    pub end_s: f64,
    /// The largest fraction of the print's width that it covers, 0 to 1.
    pub fraction: f64,
}

/// The default for that fraction: it covers about half of the corners.
const FRACTION_DEFAULT: f64 = 0.5;

impl FromStr for Occlusion {
    type Err = String;

    /// `TARGET:START_S:END_S[:FRACTION]`.
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.split(':').collect();
        let ([target, start, end], fraction) = match parts[..] {
            [target, start, end] => ([target, start, end], None),
            [target, start, end, fraction] => ([target, start, end], Some(fraction)),
            _ => {
                return Err(
                    "expected TARGET:START_S:END_S[:FRACTION], as lumbar:1.0:2.5:0.4".into()
                );
            }
        };
        let number = |name: &str, text: &str| {
            let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
            value.ok_or_else(|| format!("{name} is not a number: {text:?}"))
        };
        let (start_s, end_s) = (number("START_S", start)?, number("END_S", end)?);
        let fraction = fraction.map_or(Ok(FRACTION_DEFAULT), |text| number("FRACTION", text))?;
        if start_s < 0.0 || end_s <= start_s {
            return Err(format!(
                "START_S {start_s} must not be negative and END_S {end_s} must come after it"
            ));
        }
        if !(fraction > 0.0 && fraction <= 1.0) {
            return Err(format!("FRACTION {fraction} must be above 0 and at most 1"));
        }
        Ok(Self { target: target.into(), start_s, end_s, fraction })
    }
}

/// The arm at one instant, in raw pixels: a rod with a round end.
#[derive(Debug, Clone, Copy)]
pub struct Arm {
    tip_px: Vector2<f64>,
    /// Unit vector from the tip towards the elbow.
    along: Vector2<f64>,
    radius_px: f64,
    seed: u32,
}

/// The fraction of the passage that the arm takes to come in, and again to leave.
const MOVING_SHARE: f64 = 0.25;

/// The slant of the arm's direction: an edge parallel to the target's own lines would be too easy.
const SLANT_RAD: f64 = 0.3;

impl Occlusion {
    /// The arm at `time_s`, or `None` when it is away.
    ///
    /// It enters from the nearer side of the frame. `paper_mm` is the print's
    /// left, top, right and bottom edge.
    #[must_use]
    pub fn arm(
        &self,
        time_s: f64,
        lens: &Lens,
        cam_from_target: &Pose<Cam, Target>,
        paper_mm: [f64; 4],
    ) -> Option<Arm> {
        let passed = (time_s - self.start_s) / (self.end_s - self.start_s);
        if !(0.0..=1.0).contains(&passed) {
            return None;
        }
        let inside = (passed.min(1.0 - passed) / MOVING_SHARE).min(1.0);
        let covered = self.fraction * inside * inside * (3.0 - 2.0 * inside);
        let [left, top, right, bottom] = paper_mm;
        let at =
            |x: f64, y: f64| lens.project(&cam_from_target.transform(&Vector3::new(x, y, 0.0)));
        let middle_y = (top + bottom) / 2.0;
        let (west, east) = (at(left, middle_y)?, at(right, middle_y)?);
        let (north, south) = (at(0.0, top)?, at(0.0, bottom)?);
        let from_left = (west.x + east.x) / 2.0 < f64::from(lens.width_px) / 2.0;
        let (near, far) = if from_left { (west, east) } else { (east, west) };
        let (sin, cos) = SLANT_RAD.sin_cos();
        let along = Vector2::new(if from_left { -cos } else { cos }, sin);
        // Wide enough that even the round tip covers the print's whole height near the middle.
        let radius_px = (south - north).norm() * 0.75;
        Some(Arm { tip_px: near + (far - near) * covered, along, radius_px, seed: 77 })
    }
}

impl Arm {
    /// How far inside the arm a raw pixel lies, px; negative outside.
    #[must_use]
    pub fn depth_px(&self, raw_px: &Vector2<f64>) -> f64 {
        let from_centre = raw_px - (self.tip_px + self.along * self.radius_px);
        let along_px = from_centre.dot(&self.along);
        let across_px = from_centre.perp(&self.along);
        self.radius_px - if along_px > 0.0 { across_px.abs() } else { from_centre.norm() }
    }

    /// Draws the arm over the pixels of row `y`, its edge as soft as the lens's blur.
    pub fn draw_row(
        &self,
        blur_px: f64,
        gain: impl Fn(f64, f64) -> f64,
        y: usize,
        pixels: &mut [f32],
    ) {
        let folds = ValueNoise { seed: self.seed, cell_px: 60.0 };
        let skin = ValueNoise { seed: self.seed + 1, cell_px: 5.0 };
        let edge_px = 2.0 * blur_px + 0.5;
        for (x, pixel) in pixels.iter_mut().enumerate() {
            let raw_px = Vector2::new(x as f64, y as f64);
            let depth_px = self.depth_px(&raw_px);
            if depth_px < -edge_px {
                continue;
            }
            let local = raw_px - self.tip_px;
            let (u, v) = (local.dot(&self.along) as f32, local.perp(&self.along) as f32);
            // The arm is round, so it is darker towards its edges.
            let round = (depth_px / self.radius_px).clamp(0.0, 1.0).sqrt() as f32;
            let grey = 75.0 + 65.0 * round + 8.0 * folds.at(u, v) + 4.0 * skin.at(u, v);
            let t = ((depth_px / edge_px + 1.0) / 2.0).clamp(0.0, 1.0) as f32;
            let cover = t * t * (3.0 - 2.0 * t);
            let grey = grey * gain(raw_px.x, raw_px.y) as f32;
            *pixel += cover * (grey - *pixel);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn occlusions_are_read_and_bad_ones_named() {
        let read = |text: &str| text.parse::<Occlusion>();
        let occlusion = read("lumbar:1:2.5").unwrap();
        assert_eq!((occlusion.start_s, occlusion.end_s, occlusion.fraction), (1.0, 2.5, 0.5));
        assert_eq!(read("shoulder:0:1:0.25").unwrap().fraction, 0.25);
        assert!(read("lumbar").unwrap_err().contains("TARGET:START_S:END_S"));
        assert!(read("lumbar:x:2").unwrap_err().contains("START_S"));
        assert!(read("lumbar:2:1").unwrap_err().contains("END_S"));
        assert!(read("lumbar:nan:1").unwrap_err().contains("START_S"));
        assert!(read("lumbar:1:2:1.5").unwrap_err().contains("FRACTION"));
    }
}
