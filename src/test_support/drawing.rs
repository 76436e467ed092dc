//! Targets that are drawn: dark squares on paper, seen through a lens without distortion.

extern crate std;

use std::vec::Vec;

use nalgebra::{Matrix3, Vector3, Vector6};

use crate::model::lens::Lens;
use crate::model::pose::{Cam, Pose, Target};
use crate::model::target::TargetGeometry;

/// How a target is drawn. Lengths are in squares, of which the first is at (-1, -1) from the first corner
/// and is dark.
#[derive(Clone, Copy)]
pub struct Drawing {
    /// How far it moves from one row of the picture to the next, and is at its pose in the row of its
    /// middle.
    pub per_row: Vector6<f64>,
    /// By how much the dark squares are larger, on each side.
    pub growth: f64,
    /// By how much the outermost squares are longer.
    pub longer: f64,
    /// Columns of squares beyond the last one.
    pub more_columns: f64,
}

/// At rest, and as it should be.
pub const PLAIN: Drawing = Drawing {
    per_row: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    growth: 0.0,
    longer: 0.0,
    more_columns: 0.0,
};

impl Drawing {
    /// Draws a target with the levels of ink and paper into a picture. Pixels are squares, sampled
    /// finely.
    pub fn draw(
        &self,
        lens: &Lens,
        target: &TargetGeometry,
        cam_from_target: &Pose<Cam, Target>,
        [ink, paper]: [f64; 2],
        levels: &mut [f64],
    ) {
        const FINE: usize = 7;
        let (width, height) = (usize::from(lens.width_px), usize::from(lens.height_px));
        let first_mm = target.corner_mm(0);
        let pitch_mm = (target.corner_mm(1) - first_mm).norm();
        let ends = [target.columns() as f64 + self.more_columns, target.rows() as f64];
        let project = |[u, v]: [f64; 2]| {
            let at_mm = first_mm + Vector3::new(u, v, 0.0) * pitch_mm;
            lens.project(&cam_from_target.transform(&at_mm)).expect("in front of the camera")
        };
        let outline = [[-1.0, -1.0], [ends[0], -1.0], [-1.0, ends[1]], ends].map(project);
        let span = |axis: usize, end: usize| {
            let along = outline.map(|at| at[axis]);
            let low = along.into_iter().fold(f64::MAX, f64::min);
            let high = along.into_iter().fold(f64::MIN, f64::max);
            // `as` saturates at the border.
            ((low - 8.0) as usize).min(end)..((high + 8.0) as usize).min(end)
        };
        let (columns, rows) = (span(0, width), span(1, height));
        let middle_row_px = lens
            .project(&cam_from_target.transform(&target.middle_mm()))
            .expect("in front of the camera")
            .y;
        let level = |at: [f64; 2]| if self.is_dark(at, ends) { ink } else { paper };
        for row in rows {
            let pose = cam_from_target.moved_by(&(self.per_row * (row as f64 - middle_row_px)));
            let [x, y] = [0, 1].map(|axis| pose.rotation.column(axis).into_owned());
            let origin_mm = pose.transform(&first_mm);
            let target_from_picture =
                Matrix3::from_columns(&[x * pitch_mm, y * pitch_mm, origin_mm])
                    .try_inverse()
                    .expect("a plane that is not seen edge-on");
            let at = |x: f64, y: f64| {
                let ray =
                    Vector3::new((x - lens.cx_px) / lens.fx_px, (y - lens.cy_px) / lens.fy_px, 1.0);
                let at: Vector3<f64> = target_from_picture * ray;
                [at.x / at.z, at.y / at.z]
            };
            for column in columns.clone() {
                let (x, y) = (column as f64, row as f64);
                let middle = at(x, y);
                // From its middle, a pixel reaches less than a tenth of a square.
                let clear = 0.1 + self.growth.abs() + self.longer.abs();
                let is_clear = middle.iter().all(|at| (at - libm::round(*at)).abs() > clear);
                levels[row * width + column] = if is_clear {
                    level(middle)
                } else {
                    let fine = |n: usize| (n as f64 + 0.5) / FINE as f64 - 0.5;
                    let samples =
                        (0..FINE * FINE).map(|n| level(at(x + fine(n % FINE), y + fine(n / FINE))));
                    samples.sum::<f64>() / (FINE * FINE) as f64
                };
            }
        }
    }

    fn is_dark(&self, at: [f64; 2], ends: [f64; 2]) -> bool {
        let is_square = |at: [f64; 2]| {
            let mut places = at.into_iter().zip(ends);
            let is_within =
                |(at, end): (f64, f64)| (-1.0 - self.longer..end + self.longer).contains(&at);
            let number = |axis: usize| libm::floor(at[axis]).clamp(-1.0, ends[axis] - 1.0);
            places.all(is_within) && (number(0) + number(1)) % 2.0 == 0.0
        };
        if self.growth == 0.0 {
            return is_square(at);
        }
        let around = [-self.growth, self.growth];
        around.iter().any(|du| around.iter().any(|dv| is_square([at[0] + du, at[1] + dv])))
    }
}

/// The picture blurred by a binomial of 3 x 3, whose variance is half a pixel squared.
pub fn blurred(levels: &[f64], width: usize) -> Vec<f64> {
    let height = levels.len() / width;
    let along = |levels: &[f64], step: usize, count: usize| -> Vec<f64> {
        (0..levels.len())
            .map(|n| {
                let place = n / step % count;
                let before = if place == 0 { n } else { n - step };
                let after = if place == count - 1 { n } else { n + step };
                (levels[before] + 2.0 * levels[n] + levels[after]) / 4.0
            })
            .collect()
    };
    along(&along(levels, 1, width), width, height)
}
