//! The pixels of one window, copied once into flat, padded, centred lanes.

use crate::image::{GreyImage, Pixel};

/// Smallest and largest half width of a window, px.
pub const RADIUS_PX_MIN: usize = 3;
/// Largest half width of a window, px.
pub const RADIUS_PX_MAX: usize = 8;

/// Numbers handled together: two SSE2 or NEON registers, so that two sums are under way.
pub(super) const LANES: usize = 8;
/// Lanes of the largest window.
pub(super) const CHUNKS_MAX: usize = (2 * RADIUS_PX_MAX + 1).pow(2).div_ceil(LANES);
/// Numbers handled together.
pub(super) type Lanes = [f32; LANES];

/// A square window of a picture, row by row without gaps.
pub(super) struct Patch {
    /// Grey levels minus their mean: the fits' sums then keep their digits.
    /// Zero past the last pixel.
    pub(super) value: [Lanes; CHUNKS_MAX],
    /// The mean that was taken out.
    pub(super) mean: f32,
    pub(super) radius: usize,
    /// The integer pixel at the window's middle.
    pub(super) centre: (usize, usize),
    pub(super) white_level: f32,
}

impl Patch {
    pub(super) const fn new() -> Self {
        Self {
            value: [[0.0; LANES]; CHUNKS_MAX],
            mean: 0.0,
            radius: 0,
            centre: (0, 0),
            white_level: 0.0,
        }
    }

    /// Copies the window around an integer pixel; the caller has checked that
    /// it lies inside the picture.
    pub(super) fn copy_from<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        centre: (usize, usize),
        radius: usize,
    ) {
        self.radius = radius;
        self.centre = centre;
        self.white_level = f32::from(image.white_level());
        let side = self.side();
        let count = self.count();
        let flat = self.value.as_flattened_mut();
        let (left, top) = (centre.0 - radius, centre.1 - radius);
        let mut sum = 0.0;
        for (y, row) in flat[..count].chunks_exact_mut(side).enumerate() {
            for (value, &pixel) in row.iter_mut().zip(&image.row(top + y)[left..][..side]) {
                *value = pixel.into();
                sum += *value;
            }
        }
        self.mean = sum / count as f32;
        for value in &mut flat[..count] {
            *value -= self.mean;
        }
        for value in &mut flat[count..] {
            *value = 0.0;
        }
    }

    /// Pixels along one side.
    pub(super) fn side(&self) -> usize {
        2 * self.radius + 1
    }

    /// Pixels in the window.
    pub(super) fn count(&self) -> usize {
        self.side() * self.side()
    }

    /// Lanes that the window fills, the last one perhaps partly.
    pub(super) fn chunks(&self) -> usize {
        self.count().div_ceil(LANES)
    }

    /// The pixels without the padding.
    pub(super) fn pixels(&self) -> &[f32] {
        &self.value.as_flattened()[..self.count()]
    }

    /// A position relative to the middle, in the picture.
    pub(super) fn position_px(&self, offset_px: [f32; 2]) -> [f64; 2] {
        [
            self.centre.0 as f64 + f64::from(offset_px[0]),
            self.centre.1 as f64 + f64::from(offset_px[1]),
        ]
    }
}

/// The coordinates of a window's pixels relative to its middle, in the order of
/// [`Patch::value`]; 0 in the padding.
pub(super) struct Coordinates {
    pub(super) x: [Lanes; CHUNKS_MAX],
    pub(super) y: [Lanes; CHUNKS_MAX],
}

impl Coordinates {
    const fn new(radius: usize) -> Self {
        let mut coordinates = Self { x: [[0.0; LANES]; CHUNKS_MAX], y: [[0.0; LANES]; CHUNKS_MAX] };
        let side = 2 * radius + 1;
        let mut index = 0;
        while index < side * side {
            coordinates.x[index / LANES][index % LANES] = (index % side) as f32 - radius as f32;
            coordinates.y[index / LANES][index % LANES] = (index / side) as f32 - radius as f32;
            index += 1;
        }
        coordinates
    }

    /// Those of a radius within [`RADIUS_PX_MIN`]`..=`[`RADIUS_PX_MAX`].
    pub(super) fn of(radius: usize) -> &'static Self {
        static ALL: [Coordinates; RADIUS_PX_MAX - RADIUS_PX_MIN + 1] = [
            Coordinates::new(3),
            Coordinates::new(4),
            Coordinates::new(5),
            Coordinates::new(6),
            Coordinates::new(7),
            Coordinates::new(8),
        ];
        &ALL[radius - RADIUS_PX_MIN]
    }
}
