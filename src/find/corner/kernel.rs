//! The corner likelihood of Geiger et al.: two prototypes of four kernels.
//!
//! Prototype 1 is a corner whose edges run along x and y, prototype 2 one that is turned by 45
//! degrees. Each has four kernels, the wedges A and B (opposite each other) and C and D, weighted
//! by a Gaussian whose sigma is half the radius, and normalised to a sum of 1. With mu the mean of
//! the four responses, a corner whose A and B are bright scores
//! `min(min(a, b) - mu, mu - max(c, d))`, and one whose A and B are dark the same with the signs
//! exchanged; the likelihood is the best over both signs, both prototypes and all sizes. It is half
//! the contrast at a perfect corner.

use crate::model::image::{GreyImage, Pixel};

/// Radii of the kernels.
pub(super) const RADII_PX: [usize; 3] = [4, 8, 12];
const RADIUS_MAX: usize = 12;
const SIDE_MAX: usize = 2 * RADIUS_MAX + 1;

/// The kernels of one size. The Gaussian is separable, so one axis is enough.
#[derive(Debug, Clone, Copy)]
struct Size {
    radius: usize,
    /// Weight at each distance from the centre.
    gaussian: [f32; RADIUS_MAX + 1],
    /// 1 / sum of a kernel of prototype 1, of prototype 2.
    norm: [f32; 2],
}

/// All kernels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kernels {
    sizes: [Size; RADII_PX.len()],
}

impl Kernels {
    pub(super) fn new() -> Self {
        Self { sizes: RADII_PX.map(Size::new) }
    }

    /// The largest likelihood at a pixel, in grey levels, over the sizes that fit into the frame,
    /// and the index of its size; `None` where none fits.
    pub(super) fn best<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
    ) -> Option<(f32, usize)> {
        let mut best: Option<(f32, usize)> = None;
        for size in 0..self.sizes.len() {
            if let Some(likelihood) = self.of_size(image, x, y, size)
                && best.is_none_or(|(most, _)| likelihood > most)
            {
                best = Some((likelihood, size));
            }
        }
        best
    }

    /// Whether the likelihood at a pixel reaches `least` at any size; the first that does settles
    /// it.
    pub(super) fn reaches<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
        least: f32,
    ) -> bool {
        (0..self.sizes.len())
            .any(|size| self.of_size(image, x, y, size).is_some_and(|value| value >= least))
    }

    /// The likelihood at a pixel by the kernels of one size; `None` where they do not fit into
    /// the frame.
    pub(super) fn of_size<P: Pixel>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
        size: usize,
    ) -> Option<f32> {
        let size = &self.sizes[size];
        let radius = size.radius;
        let inside = |value: usize, side: usize| value >= radius && value + radius < side;
        if !inside(x, image.width()) || !inside(y, image.height()) {
            return None;
        }
        Some(match radius {
            4 => size.likelihood::<P, 9>(image, x, y),
            8 => size.likelihood::<P, 17>(image, x, y),
            _ => size.likelihood::<P, SIDE_MAX>(image, x, y),
        })
    }
}

impl Size {
    fn new(radius: usize) -> Self {
        let sigma = radius as f32 / 2.0;
        let mut gaussian = [0.0; RADIUS_MAX + 1];
        for (distance, weight) in gaussian.iter_mut().enumerate().take(radius + 1) {
            let ratio = distance as f32 / sigma;
            *weight = libm::expf(-0.5 * ratio * ratio);
        }
        let half: f32 = gaussian[1..=radius].iter().sum();
        // A wedge of prototype 2: at each distance d along its axis, the pixels that are nearer to
        // the axis than d.
        let mut wedge = 0.0;
        let mut across = gaussian[0];
        for weight in &gaussian[1..=radius] {
            wedge += weight * across;
            across += 2.0 * weight;
        }
        Self { radius, gaussian, norm: [1.0 / (half * half), 1.0 / wedge] }
    }

    /// `SIDE` is the side of the window, 2 radius + 1.
    fn likelihood<P: Pixel, const SIDE: usize>(
        &self,
        image: &GreyImage<'_, P>,
        x: usize,
        y: usize,
    ) -> f32 {
        let radius = SIDE / 2;
        // Sums along the columns of the window. For prototype 1: the rows above and below the
        // centre. For prototype 2: the pixels inside the upper and the lower wedge, and those
        // beside them.
        let mut above = [0.0_f32; SIDE];
        let mut below = [0.0_f32; SIDE];
        let mut upper = [0.0_f32; SIDE];
        let mut lower = [0.0_f32; SIDE];
        let mut beside = [0.0_f32; SIDE];
        for row in 0..SIDE {
            let pixels = &image.row(y + row - radius)[x - radius..][..SIDE];
            let distance = row.abs_diff(radius);
            let (inside, outside) =
                (&Wedges::<SIDE>::INSIDE[distance], &Wedges::<SIDE>::OUTSIDE[distance]);
            let weight = self.gaussian[distance];
            let mut weighted = [0.0_f32; SIDE];
            for (weighted, &pixel) in weighted.iter_mut().zip(pixels) {
                let value: f32 = pixel.into();
                *weighted = value * weight;
            }
            for column in 0..SIDE {
                beside[column] += weighted[column] * outside[column];
            }
            if distance == 0 {
                continue;
            }
            let (half, wedge) =
                if row < radius { (&mut above, &mut upper) } else { (&mut below, &mut lower) };
            for column in 0..SIDE {
                half[column] += weighted[column];
                wedge[column] += weighted[column] * inside[column];
            }
        }
        let side = |sums: &[f32; SIDE], first: usize, last: usize| {
            (first..last)
                .map(|column| sums[column] * self.gaussian[column.abs_diff(radius)])
                .sum::<f32>()
        };
        let quadrants = [
            side(&above, 0, radius),
            side(&below, radius + 1, SIDE),
            side(&above, radius + 1, SIDE),
            side(&below, 0, radius),
        ];
        let wedges = [
            side(&upper, 0, SIDE),
            side(&lower, 0, SIDE),
            side(&beside, 0, radius),
            side(&beside, radius + 1, SIDE),
        ];
        combine(quadrants, self.norm[0]).max(combine(wedges, self.norm[1]))
    }
}

/// Which columns of a window lie inside, and which outside, the upper and lower wedges of prototype
/// 2 (1 or 0), for each distance of the row from the centre. Pixels on the diagonal are neither.
struct Wedges<const SIDE: usize>;

impl<const SIDE: usize> Wedges<SIDE> {
    const INSIDE: [[f32; SIDE]; RADIUS_MAX + 1] = Self::columns(true);
    const OUTSIDE: [[f32; SIDE]; RADIUS_MAX + 1] = Self::columns(false);

    const fn columns(inside: bool) -> [[f32; SIDE]; RADIUS_MAX + 1] {
        let mut columns = [[0.0; SIDE]; RADIUS_MAX + 1];
        let mut distance = 0;
        while distance <= RADIUS_MAX {
            let mut column = 0;
            while column < SIDE {
                let across = column.abs_diff(SIDE / 2);
                if (inside && across < distance) || (!inside && across > distance) {
                    columns[distance][column] = 1.0;
                }
                column += 1;
            }
            distance += 1;
        }
        columns
    }
}

/// The better of both signs; the arguments are the responses of A, B, C and D before normalisation.
fn combine([a, b, c, d]: [f32; 4], norm: f32) -> f32 {
    let mean = 0.25 * (a + b + c + d);
    let bright = (a.min(b) - mean).min(mean - c.max(d));
    let dark = (mean - a.max(b)).min(c.min(d) - mean);
    bright.max(dark) * norm
}
