//! The window around a corner by its definition, pixel by pixel.

extern crate std;

use std::vec::Vec;

use crate::model::image::{GreyImage, Pixel};

/// A pixel of a window by the definition.
pub(crate) struct PlainPixel {
    pub(crate) offset: [i32; 2],
    pub(crate) brightness: f64,
    pub(crate) gradient: [f64; 2],
    pub(crate) magnitude: f64,
    pub(crate) weight: f64,
    pub(crate) edge_weight: f64,
}

/// All pixels of the round window: those whose squared distance exceeds that of the radius by at most 1.
pub(crate) fn plain_window<P: Pixel>(
    image: &GreyImage<'_, P>,
    [x, y]: [usize; 2],
    half: usize,
) -> Vec<PlainPixel> {
    let reach = half as i32;
    let at = |dx: i32, dy: i32| {
        let row = image.row(y.wrapping_add_signed(dy as isize));
        let value: u32 = row[x.wrapping_add_signed(dx as isize)].into();
        f64::from(value)
    };
    let mut pixels = Vec::new();
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let square = f64::from(dx * dx + dy * dy);
            if square > f64::from(reach * reach + 1) {
                continue;
            }
            let gradient = [at(dx + 1, dy) - at(dx - 1, dy), at(dx, dy + 1) - at(dx, dy - 1)];
            pixels.push(PlainPixel {
                offset: [dx, dy],
                brightness: at(dx, dy),
                gradient,
                magnitude: gradient[0].hypot(gradient[1]),
                weight: (-2.0 * square / f64::from(reach * reach)).exp(),
                edge_weight: 0.0,
            });
        }
    }
    let strongest = pixels.iter().map(|pixel| pixel.magnitude).fold(0.0, f64::max);
    for pixel in &mut pixels {
        let is_edge = pixel.magnitude > 0.15 * strongest;
        pixel.edge_weight = if is_edge { pixel.weight } else { 0.0 };
    }
    pixels
}
