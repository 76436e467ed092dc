//! A cluttered room and a clothed back: things that a detector must not mistake for a target.
//! Procedural, from a seed; drawn once per sequence in raw pixels, because only the targets need
//! the true lens.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::render::Picture;

/// How far the back may move in the image before its edge would be seen, px.
const MARGIN_PX: usize = 96;

/// The room, and in front of it the clothed trunk, which moves.
pub struct Background {
    room: Picture,
    /// Premultiplied, and larger than the frame by [`MARGIN_PX`] on every side.
    cloth: Picture,
    cover: Picture,
}

impl Background {
    /// Draws the background from the seed.
    ///
    /// `midline_px` is where the midline of the back appears at the scene's origin, `px_per_mm` the
    /// scale there, and `blur_px` the lens's blur.
    #[must_use]
    pub fn new(
        [width, height]: [usize; 2],
        midline_px: [f64; 2],
        px_per_mm: f64,
        blur_px: f64,
        seed: u64,
    ) -> Self {
        let (room, mut random) = room([width, height], seed);
        let mut cloth = Canvas::new(width + 2 * MARGIN_PX, height + 2 * MARGIN_PX);
        let midline_px = midline_px.map(|value| value + MARGIN_PX as f64);
        let cover = cloth.draw_back(midline_px, px_per_mm, &mut random);
        let [room, cloth, cover] =
            [room.0, cloth.0, cover].map(|picture| blurred(picture, blur_px));
        let grey = cloth.grey.iter().zip(&cover.grey).map(|(grey, cover)| grey * cover).collect();
        Self { room, cloth: Picture { grey, ..cloth }, cover }
    }

    /// The background multiplied by `gain`; a row shows the trunk moved by `shift_px` of that row.
    pub fn draw(
        &self,
        shift_px: impl Fn(usize) -> [f64; 2] + Sync,
        gain: impl Fn(f64, f64) -> f64 + Sync,
        picture: &mut Picture,
    ) {
        let width = self.room.width;
        picture.width = width;
        picture.height = self.room.height;
        picture.grey.resize(self.room.grey.len(), 0.0);
        let scratch = || [vec![0.0; width], vec![0.0; width]];
        picture.grey.par_chunks_mut(width).enumerate().for_each_init(
            scratch,
            |[cloth, cover], (y, row)| {
                let shift_px = shift_px(y);
                shifted_row(&self.cloth, shift_px, y, cloth);
                shifted_row(&self.cover, shift_px, y, cover);
                let room = &self.room.grey[y * width..][..width];
                // The light changes slowly: linear between the ends of the row.
                let (first, last) = (gain(0.0, y as f64), gain(width as f64, y as f64));
                let slope = ((last - first) / width as f64) as f32;
                for x in 0..width {
                    let grey = room[x] * (1.0 - cover[x]) + cloth[x];
                    row[x] = grey * (first as f32 + slope * x as f32);
                }
            },
        );
    }
}

/// The room without anybody in it, as [`Background`] draws it from the same seed.
#[must_use]
pub fn empty_room(size_px: [usize; 2], blur_px: f64, seed: u64) -> Picture {
    blurred(room(size_px, seed).0.0, blur_px)
}

/// The room, and the generator that draws what stands in it.
fn room([width, height]: [usize; 2], seed: u64) -> (Canvas, ChaCha8Rng) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(1);
    let mut room = Canvas::new(width, height);
    room.draw_room(&mut random);
    (room, random)
}

/// Row `y` of the frame in a picture that is larger by [`MARGIN_PX`] and moved by `shift_px`.
fn shifted_row(source: &Picture, shift_px: [f64; 2], y: usize, row: &mut [f32]) {
    // The position of pixel (0, 0) on the source, and the bilinear weights there.
    let end = (2 * MARGIN_PX - 1) as f64;
    let start = shift_px.map(|shift| (MARGIN_PX as f64 - shift).clamp(0.0, end));
    let [left, top] = start.map(|start| start as usize);
    let [fx, fy] = start.map(|start| start.fract() as f32);
    let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
    let above = &source.grey[(top + y) * source.width + left..][..row.len() + 1];
    let below = &source.grey[(top + y + 1) * source.width + left..][..row.len() + 1];
    for (x, value) in row.iter_mut().enumerate() {
        *value = above[x] * weights[0]
            + above[x + 1] * weights[1]
            + below[x] * weights[2]
            + below[x + 1] * weights[3];
    }
}

/// Smooth noise of -1 to 1: random values on a lattice of `cell_px`, interpolated.
#[derive(Clone, Copy)]
pub(super) struct ValueNoise {
    pub(super) seed: u32,
    pub(super) cell_px: f32,
}

impl ValueNoise {
    pub(super) fn at(self, x: f32, y: f32) -> f32 {
        let (x, y) = (x / self.cell_px, y / self.cell_px);
        let (column, row) = (x.floor(), y.floor());
        let ease = |t: f32| t * t * (3.0 - 2.0 * t);
        let (fx, fy) = (ease(x - column), ease(y - row));
        let (column, row) = (column as i32, row as i32);
        let above = self.node(column, row) * (1.0 - fx) + self.node(column + 1, row) * fx;
        let below = self.node(column, row + 1) * (1.0 - fx) + self.node(column + 1, row + 1) * fx;
        above * (1.0 - fy) + below * fy
    }

    /// A hash of the lattice point, as -1 to 1.
    fn node(self, column: i32, row: i32) -> f32 {
        let mut bits = self.seed
            ^ (column as u32).wrapping_mul(0x9E37_79B1)
            ^ (row as u32).wrapping_mul(0x85EB_CA77);
        bits = (bits ^ (bits >> 15)).wrapping_mul(0x2C1B_3C6D);
        bits = (bits ^ (bits >> 12)).wrapping_mul(0x297A_2D39);
        bits ^= bits >> 15;
        bits as f32 / (u32::MAX as f32 / 2.0) - 1.0
    }
}

/// A rectangle, [left, top, width, height] in px.
type Area = [f64; 4];

struct Canvas(Picture);

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        Self(Picture::uniform(width, height, 0.0))
    }

    /// Sets every pixel of an area that lies on the canvas to `grey(x, y, before)`.
    fn shade(&mut self, area: Area, grey: impl Fn(f32, f32, f32) -> f32) {
        let [left, top, width, height] = area;
        let clamp = |value: f64, side: usize| value.round().clamp(0.0, side as f64) as usize;
        let columns = clamp(left, self.0.width)..clamp(left + width, self.0.width);
        for y in clamp(top, self.0.height)..clamp(top + height, self.0.height) {
            let row = &mut self.0.grey[y * self.0.width..][..self.0.width];
            for (x, pixel) in row.iter_mut().enumerate().take(columns.end).skip(columns.start) {
                *pixel = grey(x as f32, y as f32, *pixel);
            }
        }
    }

    fn fill(&mut self, area: Area, grey: f64) {
        self.shade(area, |_, _, _| grey as f32);
    }

    fn texture(&mut self, area: Area, noise: ValueNoise, contrast: f32) {
        self.shade(area, |x, y, before| before + contrast * noise.at(x, y));
    }

    /// Lines of word-like bars.
    fn text(
        &mut self,
        [left, top, width, height]: Area,
        size: f64,
        grey: f64,
        random: &mut ChaCha8Rng,
    ) {
        let mut y = top;
        while y + size <= top + height {
            let mut x = left;
            while x < left + width {
                let stroke = (size * random.random_range(0.15..0.3)).max(1.0);
                match random.random_range(0..5_u8) {
                    0 => x += size * 0.6,
                    1 => self.fill([x, y, size * 0.5, stroke], grey),
                    2 => self.fill([x, y + size * 0.4, size * 0.5, stroke], grey),
                    _ => self.fill([x, y, stroke, size * 0.8], grey),
                }
                x += size * random.random_range(0.3..0.6);
            }
            y += size * 1.5;
        }
    }

    /// Squares of two greys: like those of a target, but too few or too pale to be one.
    fn checks(&mut self, [left, top]: [f64; 2], counts: [usize; 2], side: f64, greys: [f64; 2]) {
        for row in 0..counts[1] {
            for column in 0..counts[0] {
                let (x, y) = (left + column as f64 * side, top + row as f64 * side);
                self.fill([x, y, side, side], greys[(row + column) % 2]);
            }
        }
    }

    fn draw_room(&mut self, random: &mut ChaCha8Rng) {
        let (width, height) = (self.0.width as f64, self.0.height as f64);
        let all = [0.0, 0.0, width, height];
        let noise =
            |random: &mut ChaCha8Rng, cell_px| ValueNoise { seed: random.random(), cell_px };
        let stain = noise(random, 160.0);
        self.shade(all, |x, y, _| 158.0 - 0.03 * y + 12.0 * stain.at(x, y));
        // Wallpaper stripes on the left third, a door on the right.
        for stripe in 0..12 {
            let x = f64::from(stripe) * width * 0.03;
            self.shade([x, 0.0, width * 0.012, height], |_, _, before| before * 0.93);
        }
        self.fill([width * 0.9, 0.0, 6.0, height], 70.0);
        self.shade([width * 0.905, 0.0, width * 0.1, height], |_, _, before| before * 0.7);
        // Shelves with books, with lettering on some spines.
        for shelf in 0..5 {
            let base = height * (0.12 + 0.2 * f64::from(shelf));
            self.fill([0.0, base, width, height * 0.014], 92.0);
            let mut x = random.random_range(0.0..20.0);
            while x < width {
                let thick = random.random_range(0.008..0.03) * width;
                let tall = random.random_range(0.08..0.16) * height;
                let grey = random.random_range(40.0..205.0);
                if random.random_bool(0.85) {
                    self.fill([x, base - tall, thick, tall], grey);
                    let ink = if grey > 120.0 { 50.0 } else { 190.0 };
                    if random.random_bool(0.5) {
                        let label = [x + 3.0, base - tall * 0.8, thick - 6.0, tall * 0.5];
                        self.text(label, 7.0, ink, random);
                    }
                }
                x += thick + 1.0;
            }
        }
        // A poster with text, a 3 x 3 chequered box, a chequered cloth of many pale squares.
        let poster = [width * 0.02, height * 0.35, width * 0.14, height * 0.28];
        self.fill(poster, 205.0);
        let [left, top, wide, high] = poster;
        self.text([left + 10.0, top + 10.0, wide - 20.0, high * 0.3], 16.0, 45.0, random);
        self.text([left + 10.0, top + high * 0.45, wide - 20.0, high * 0.5], 8.0, 60.0, random);
        self.checks([width * 0.24, height * 0.42], [3, 3], 24.0, [50.0, 190.0]);
        self.checks([width * 0.19, height * 0.72], [9, 8], 16.0, [118.0, 132.0]);
        let grain = noise(random, 3.0);
        self.texture(all, grain, 3.0);
    }

    /// Draws the clothed back; returns its outline as a picture of 0 and 1.
    fn draw_back(
        &mut self,
        [midline, origin]: [f64; 2],
        px_per_mm: f64,
        random: &mut ChaCha8Rng,
    ) -> Picture {
        let (width, height) = (self.0.width, self.0.height);
        let all = [0.0, 0.0, width as f64, height as f64];
        let noise = |random: &mut ChaCha8Rng, cell_mm: f64| {
            let cell_px = (cell_mm * px_per_mm) as f32;
            ValueNoise { seed: random.random(), cell_px }
        };
        let (folds, creases, knit) = (noise(random, 60.0), noise(random, 18.0), noise(random, 2.0));
        self.shade(all, |x, y, _| {
            // Folds run down the cloth: stretched along y.
            let fold = 18.0 * folds.at(x, y * 0.3) + 9.0 * creases.at(x, y * 0.5);
            92.0 + fold + 4.0 * knit.at(x, y)
        });
        let px = |mm: f64| mm * px_per_mm;
        // The spine's seam, a belt, a care label with text, a chequered patch.
        self.shade([midline - 1.5, 0.0, 3.0, height as f64], |_, _, before| before * 0.7);
        self.fill([0.0, origin + px(292.0), width as f64, px(28.0)], 48.0);
        let label = [midline - px(20.0), origin - px(292.0), px(40.0), px(24.0)];
        self.fill(label, 190.0);
        let [left, top, wide, high] = label;
        let lettering = [left + px(3.0), top + px(3.0), wide - px(6.0), high - px(6.0)];
        self.text(lettering, px(4.0).max(4.0), 60.0, random);
        let patch = [midline + px(70.0), origin - px(120.0)];
        self.checks(patch, [4, 3], px(9.0), [70.0, 130.0]);

        let mut cover = Picture::uniform(width, height, 0.0);
        for (index, cover) in cover.grey.iter_mut().enumerate() {
            let x_mm = ((index % width) as f64 - midline) / px_per_mm;
            let y_mm = ((index / width) as f64 - origin) / px_per_mm;
            *cover = f32::from(u8::from(x_mm.abs() < half_breadth_mm(y_mm)));
        }
        cover
    }
}

/// Half the breadth of the trunk with the arms, by the height below the scene's origin.
fn half_breadth_mm(y_mm: f64) -> f64 {
    // Neck, slope of the shoulders, upper arms, waist, hips.
    const OUTLINE: [[f64; 2]; 7] = [
        [-360.0, 60.0],
        [-310.0, 75.0],
        [-275.0, 195.0],
        [-215.0, 240.0],
        [60.0, 235.0],
        [200.0, 185.0],
        [330.0, 200.0],
    ];
    let after = OUTLINE.partition_point(|[y, _]| *y < y_mm).clamp(1, OUTLINE.len() - 1);
    let ([y0, b0], [y1, b1]) = (OUTLINE[after - 1], OUTLINE[after]);
    let t = ((y_mm - y0) / (y1 - y0)).clamp(0.0, 1.0);
    b0 + t * t * (3.0 - 2.0 * t) * (b1 - b0)
}

/// The picture blurred by a Gaussian, with its edge pixels repeated.
fn blurred(picture: Picture, sigma_px: f64) -> Picture {
    let radius = (3.0 * sigma_px).ceil() as isize;
    let weight = |offset: isize| (-0.5 * (offset as f64 / sigma_px).powi(2)).exp();
    let total: f64 = (-radius..=radius).map(weight).sum();
    let weights: Vec<(isize, f32)> =
        (-radius..=radius).map(|offset| (offset, (weight(offset) / total) as f32)).collect();
    let (width, height) = (picture.width, picture.height);
    let pass = |source: &[f32], along_x: bool| -> Vec<f32> {
        let mut sink = vec![0.0; source.len()];
        sink.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, value) in row.iter_mut().enumerate() {
                for (offset, weight) in &weights {
                    let index = if along_x {
                        y * width + x.saturating_add_signed(*offset).min(width - 1)
                    } else {
                        y.saturating_add_signed(*offset).min(height - 1) * width + x
                    };
                    *value += weight * source[index];
                }
            }
        });
        sink
    };
    let grey = pass(&pass(&picture.grey, true), false);
    Picture { width, height, grey }
}
