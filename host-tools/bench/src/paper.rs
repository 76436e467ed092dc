//! The paper's chain, the published baseline: corners, and a pose fitted to them.
//!
//! Corners are refined by the paper's step (section "Feature detection"; Geiger et al. 2012;
//! Foerstner and Guelch 1987): p = argmin_q sum_n (grad_n^T (n - q))^2 over the window's pixels n.
//! On an edge through q the gradient is at right angles to n - q; in the flat squares it vanishes.
//! The pose is that of the least sum of squared reprojection errors (section "Kinematic Model
//! Fitting").
//!
//! Its corners scatter three times as much as the crossing of two edges would allow: the noise of
//! every flat pixel enters squared, and blur rounds the edges where they cross.

use nalgebra::{Matrix2, Vector2};
use plumbline::image::{GreyImage, Pixel};
use plumbline::lens_table::LensTable;
use plumbline::parts::{SeenCorner, solve};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::TargetGeometry;

/// Iterations of the fit.
const ITERATIONS: usize = 6;

/// Most windows for one corner: each is centred where the last one found the corner.
const WINDOWS_MAX: usize = 4;

/// Standard deviation of a corner; the same for all, so that its value does not matter.
const SIGMA_PX: f64 = 0.1;

/// The pose of a target near an expected one, from windows of half width `radius_px`.
pub fn pose<P: Pixel>(
    image: &GreyImage<'_, P>,
    lens: &LensTable,
    target: &TargetGeometry,
    expected_cam_from_target: &Pose<Cam, Target>,
    radius_px: usize,
) -> Option<Pose<Cam, Target>> {
    let corners: Vec<SeenCorner> = (0..target.corner_count())
        .filter_map(|index| {
            let point_mm = target.corner_mm(index);
            let expected_px = lens.project(&expected_cam_from_target.transform(&point_mm))?;
            let found_px = corner(image, &expected_px, radius_px)?;
            SeenCorner::new(point_mm, lens, &found_px, SIGMA_PX)
        })
        .collect();
    Some(solve(expected_cam_from_target, &corners[..], ITERATIONS).ok()?.cam_from_target)
}

/// The corner in a window around a position, then in windows around the corners found.
fn corner<P: Pixel>(
    image: &GreyImage<'_, P>,
    expected_px: &Vector2<f64>,
    radius_px: usize,
) -> Option<Vector2<f64>> {
    let mut found_px = *expected_px;
    for window in 0..WINDOWS_MAX {
        let (x, y) = image.window_centre(found_px.into(), radius_px)?;
        let offset_px = step(image, [x, y], radius_px)?;
        found_px = Vector2::new(x as f64, y as f64) + offset_px;
        // Farther than a window's half width is another corner.
        if (found_px - expected_px).amax() > radius_px as f64 {
            return None;
        }
        // Between two pixels, noise must not move the window back and forth.
        let enough_px = if window == 0 { 0.5 } else { 0.75 };
        if offset_px.amax() <= enough_px {
            return Some(found_px);
        }
    }
    None
}

/// From the window's middle to the minimum: (sum g g^T) q = sum g g^T n.
fn step<P: Pixel>(
    image: &GreyImage<'_, P>,
    [x, y]: [usize; 2],
    radius_px: usize,
) -> Option<Vector2<f64>> {
    let (left, side) = (x - radius_px, 2 * radius_px + 1);
    let window = |row: usize| &image.row(row)[left..][..side];
    let value = |pixel: P| -> f32 { pixel.into() };
    let (mut xx, mut xy, mut yy, mut x_right, mut y_right) = (0.0_f32, 0.0, 0.0, 0.0, 0.0);
    for row in 1..side - 1 {
        let top = y - radius_px + row;
        let (above, here, below) = (window(top - 1), window(top), window(top + 1));
        let off_y = row as f32 - radius_px as f32;
        for column in 1..side - 1 {
            let off_x = column as f32 - radius_px as f32;
            let grad_x = 0.5 * (value(here[column + 1]) - value(here[column - 1]));
            let grad_y = 0.5 * (value(below[column]) - value(above[column]));
            let along = grad_x * off_x + grad_y * off_y;
            xx += grad_x * grad_x;
            xy += grad_x * grad_y;
            yy += grad_y * grad_y;
            x_right += grad_x * along;
            y_right += grad_y * along;
        }
    }
    let normal = Matrix2::new(xx, xy, xy, yy).cast::<f64>();
    Some(normal.try_inverse()? * Vector2::new(x_right, y_right).cast())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 64;

    /// Uniform in 0..1: the upper bits of a linear congruential generator (Knuth's MMIX).
    fn uniform(state: &mut u64) -> f64 {
        *state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// The sum of twelve uniform numbers has a variance of 1.
    fn normal(state: &mut u64) -> f64 {
        (0..12).map(|_| uniform(state)).sum::<f64>() - 6.0
    }

    #[test]
    fn a_corner_has_the_spread_and_the_bias_of_the_published_step() {
        // Light 180, dark 60, blur 0.7 px and the pixel's own, edges 20 degrees off the rows.
        let (true_px, angle_rad) = (Vector2::new(31.3, 31.8), 0.35_f64);
        let blur_px = f64::sqrt(0.7 * 0.7 + 1.0 / 12.0);
        let (sine, cosine) = angle_rad.sin_cos();
        let exact: Vec<f64> = (0..SIDE * SIDE)
            .map(|index| {
                let off_px = Vector2::new((index % SIDE) as f64, (index / SIDE) as f64) - true_px;
                let across =
                    [cosine * off_px.x + sine * off_px.y, cosine * off_px.y - sine * off_px.x];
                let [one, other] = across.map(|off| libm::erf(off / blur_px / f64::sqrt(2.0)));
                120.0 + 60.0 * one * other
            })
            .collect();
        let mut random = 1;
        let errors_px: Vec<Vector2<f64>> = (0..400)
            .map(|_| {
                let pixels: Vec<u8> = exact
                    .iter()
                    .map(|level| (level + 2.0 * normal(&mut random) + 0.5) as u8)
                    .collect();
                let image = GreyImage::new(&pixels, SIDE, SIDE, SIDE).unwrap();
                let off = Vector2::from_fn(|_, _| uniform(&mut random) - 0.5);
                corner(&image, &(true_px + off), 6).unwrap() - true_px
            })
            .collect();
        let count = errors_px.len() as f64;
        let bias_px = errors_px.iter().sum::<Vector2<f64>>() / count;
        let squares = errors_px.iter().map(|error| (error - bias_px).norm_squared()).sum::<f64>();
        let spread_px = f64::sqrt(squares / count / 2.0);
        // 0.024 px; 400 pictures determine it to 2.5 %.
        assert!((0.021..0.027).contains(&spread_px), "{spread_px}");
        assert!(bias_px.norm() < 0.020, "{bias_px}");
    }
}
