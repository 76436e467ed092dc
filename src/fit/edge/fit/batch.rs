//! Pixels of an edge, the columns of its model, and their inner products.

use core::array;
use core::hint::black_box;

use super::crossing::Crossings;
use super::lanes::{LANES, Lanes};
use super::region::Region;
use super::regression::{
    ONE_ONE, ONE_SLOPE, ONE_STEP, PRODUCTS, SLOPE_SLOPE, STEP_SLOPE, STEP_STEP, Sums,
};
use crate::fit::edge::light::Levels;
use crate::fit::edge::profile::blurred_step;
use crate::model::image::{GreyImage, Pixel};

/// Quantities that vary linearly about an edge's middle, one lane each.
struct Field {
    middle: Lanes,
    by_x: Lanes,
    by_y: Lanes,
}

/// Mean of both sides' levels.
const MEAN: usize = 0;
/// Factor of a pixel's difference from the mean.
const GAIN: usize = 1;
/// Distance from the top of the lens's arc, to the right of the edge, in blurs.
const ACROSS: usize = 2;
/// Position along the edge, from its middle, in units of its length.
const PLACE: usize = 3;

impl Field {
    #[inline(always)]
    fn at(&self, x: f32, y: f32) -> Lanes {
        array::from_fn(|lane| self.middle[lane] + self.by_x[lane] * x + self.by_y[lane] * y)
    }
}

/// Pixels handled at once, more than an ordinary edge has.
pub(super) const BATCH_PX: usize = 256;

/// Pixels of a row that are written together: about as many as a row of a region has.
const SPAN: usize = 8;

/// One number per pixel. A row's last span may reach beyond its end, to be overwritten by
/// the next row.
type Column = [f32; BATCH_PX + SPAN];

/// Pixels of one edge, row after row without gaps, so that no lane is idle; a buffer that is
/// kept only because clearing it would cost as much as using it.
pub struct Batch {
    count: usize,
    grey: Column,
    across: Column,
    place: Column,
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

impl Batch {
    /// An empty batch.
    #[must_use]
    pub const fn new() -> Self {
        const EMPTY: Column = [0.0; BATCH_PX + SPAN];
        Self { count: 0, grey: EMPTY, across: EMPTY, place: EMPTY }
    }

    /// Inner products over all pixels of a region inside the frame, each weighted by its expected
    /// noise, with the slope of the light removed from them; `None` where the region's middle is
    /// outside. `sign` is 1 where the right side is light, otherwise -1.
    pub(super) fn sums<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        region: &Region,
        levels: Option<&Levels>,
        sign: f64,
    ) -> Option<Sums> {
        let [origin_x, origin_y] = region.origin;
        if origin_x >= image.width() || origin_y >= image.height() {
            return None;
        }
        let [mean_by_x, mean_by_y, gain_by_x, gain_by_y] = levels.map_or([0.0; 4], |levels| {
            // To first order: the square is neglected, 0.1 % of the contrast in the farthest pixels
            // of an edge of 20 px when it varies by 30 % in 140 px.
            let (mean, gain) = (levels.mean_per_px, -levels.contrast_per_px);
            [mean.x, mean.y, gain.x, gain.y].map(|slope| slope as f32)
        });
        let base: f32 = match levels {
            Some(levels) => (0.5 * (levels.light + levels.dark)) as f32,
            None => image.row(origin_y)[origin_x].into(),
        };
        let noise_by_step = levels.map_or(0.0, |levels| (sign * levels.noise_contrast) as f32);
        let mut products = Products::new(noise_by_step);
        self.count = 0;
        let [middle_x, middle_y] = region.middle;
        let [along_x, along_y] = region.along;
        let (per_blur, per_length) = (region.per_blur, region.per_length);
        // An arc's height in its middle, and nothing at its ends.
        let height = region.bend_px * per_blur;
        let bend = 4.0 * height;
        let field = Field {
            middle: [base, 1.0, -height, 0.0],
            by_x: [mean_by_x, gain_by_x, -along_y * per_blur, along_x * per_length],
            by_y: [mean_by_y, gain_by_y, along_x * per_blur, along_y * per_length],
        };
        region.each_row([image.width(), image.height()], |row, columns| {
            let pixels = &image.row((origin_y as i32 + row) as usize)[columns.start..];
            let count = columns.len().min(BATCH_PX);
            if self.count + count > BATCH_PX {
                products.add(self, bend, &region.crossings);
            }
            let x = (columns.start as i32 - origin_x as i32) as f32 - middle_x;
            self.push(pixels, count, &field, [x, row as f32 - middle_y]);
        });
        products.add(self, bend, &region.crossings);
        let (count, products) = products.total(&region.crossings);
        Some(Sums { count, products, base: base.into() })
    }

    /// Appends the first `count` pixels of a row, whose start is given relative to the edge's
    /// middle; there must be room for them.
    #[inline]
    fn push<P: Pixel>(&mut self, pixels: &[P], count: usize, field: &Field, [x, y]: [f32; 2]) {
        for done in (0..count).step_by(SPAN) {
            let start = field.at(x + done as f32, y);
            let pixels = &pixels[done..];
            match pixels.first_chunk() {
                Some(span) => self.write(span, self.count + done, &start, &field.by_x),
                None => {
                    // At the frame's right border.
                    let mut span = [pixels[0]; SPAN];
                    span[..pixels.len()].copy_from_slice(pixels);
                    self.write(&span, self.count + done, &start, &field.by_x);
                }
            }
        }
        self.count += count;
    }

    /// Writes a span of a row to a place in the batch; `start` is the field at its first pixel, and
    /// `step` the field's change from pixel to pixel.
    #[inline(never)]
    fn write<P: Pixel>(&mut self, pixels: &[P; SPAN], place: usize, start: &Lanes, step: &Lanes) {
        const ROOM: &str = "a batch has room for its last span";
        let grey: &mut [f32; SPAN] = self.grey[place..].first_chunk_mut().expect(ROOM);
        let across: &mut [f32; SPAN] = self.across[place..].first_chunk_mut().expect(ROOM);
        let places: &mut [f32; SPAN] = self.place[place..].first_chunk_mut().expect(ROOM);
        for pixel in 0..SPAN {
            let value: f32 = pixels[pixel].into();
            let at = |lane: usize| start[lane] + step[lane] * pixel as f32;
            grey[pixel] = (value - at(MEAN)) * at(GAIN);
            across[pixel] = at(ACROSS);
            places[pixel] = at(PLACE);
        }
    }
}

/// The weighted inner products, in lanes.
struct Products {
    sums: [Lanes; PRODUCTS],
    /// How much the noise variance grows from the middle of the step to its top, as a share of that
    /// in the middle. A pixel's weight is the inverse of its expected variance, which follows from
    /// the model and not from the pixel: noise would otherwise weigh itself.
    noise_by_step: f32,
    count: usize,
    /// How many of the lanes held none of the region's pixels.
    padding: usize,
}

impl Products {
    fn new(noise_by_step: f32) -> Self {
        Self { sums: [[0.0; LANES]; PRODUCTS], noise_by_step, count: 0, padding: 0 }
    }

    /// Adds a batch and empties it; `bend` is 4 times what is to be added at either end, in blurs.
    ///
    /// One loop without branches, in which each group of four lanes becomes one vector. A compiler
    /// might instead combine pixels of several iterations, which costs two to three times as much,
    /// because they have to be gathered and the order of the sums kept. [`black_box`] prevents
    /// that: it is opaque to the compiler, and costs no instruction.
    #[inline(never)]
    fn add(&mut self, batch: &mut Batch, bend: f32, crossings: &Crossings) {
        let count = batch.count;
        batch.count = 0;
        let chunks = count.div_ceil(LANES);
        let padding = count..chunks * LANES;
        let Batch { grey, across, place, .. } = batch;
        // Padded with black pixels in the middle of the edge, which add only what is subtracted from the total.
        grey[padding.clone()].fill(0.0);
        across[padding.clone()].fill(0.0);
        place[padding.clone()].fill(0.0);
        self.padding += padding.len();
        self.count += count;
        let noise_by_step = self.noise_by_step;
        let mut sums = self.sums;
        let [o, s, b, p, t, g, ss, sb, sp, st, sg, bb, bp, bt, bg, pp, pt, pg, tt, tg, gg] =
            &mut sums;
        let pixels = chunk(across, chunks).iter().zip(chunk(place, chunks));
        for ((across, place), grey) in pixels.zip(chunk(grey, chunks)) {
            black_box(());
            let [mut step, mut slope, mut blur, mut turn] = [[0.0; LANES]; 4];
            // Each column times the pixel's weight.
            let [mut wo, mut ws, mut wp, mut wb, mut wt, mut wg] = [[0.0; LANES]; 6];
            for lane in 0..LANES {
                let w = place[lane];
                let v = across[lane] + bend * w * w;
                (step[lane], slope[lane]) = profile(v, w, crossings);
                blur[lane] = v * slope[lane];
                turn[lane] = w * slope[lane];
                wo[lane] = 1.0 / (1.0 + noise_by_step * step[lane]);
                ws[lane] = wo[lane] * step[lane];
                wp[lane] = wo[lane] * slope[lane];
                wb[lane] = wo[lane] * blur[lane];
                wt[lane] = wo[lane] * turn[lane];
                wg[lane] = wo[lane] * grey[lane];
            }
            add(o, &wo);
            add(s, &ws);
            add(b, &wb);
            add(p, &wp);
            add(t, &wt);
            add(g, &wg);
            add_product(ss, &ws, &step);
            add_product(sb, &ws, &blur);
            add_product(sp, &ws, &slope);
            add_product(st, &ws, &turn);
            add_product(sg, &ws, grey);
            add_product(bb, &wb, &blur);
            add_product(bp, &wb, &slope);
            add_product(bt, &wb, &turn);
            add_product(bg, &wb, grey);
            add_product(pp, &wp, &slope);
            add_product(pt, &wp, &turn);
            add_product(pg, &wp, grey);
            add_product(tt, &wt, &turn);
            add_product(tg, &wt, grey);
            add_product(gg, &wg, grey);
        }
        self.sums = sums;
    }

    /// The number of pixels, and the products.
    fn total(&self, crossings: &Crossings) -> (f64, [f64; PRODUCTS]) {
        let mut products = [0.0; PRODUCTS];
        for (product, [a, b, c, d]) in products.iter_mut().zip(self.sums) {
            *product = f64::from(a) + f64::from(b) + (f64::from(c) + f64::from(d));
        }
        let (step, slope) = profile(0.0, 0.0, crossings);
        let weight = self.padding as f64 / f64::from(1.0 + self.noise_by_step * step);
        let (step, slope) = (f64::from(step), f64::from(slope));
        for (product, padded) in [
            (ONE_ONE, 1.0),
            (ONE_STEP, step),
            (ONE_SLOPE, slope),
            (STEP_STEP, step * step),
            (STEP_SLOPE, step * slope),
            (SLOPE_SLOPE, slope * slope),
        ] {
            products[product] -= weight * padded;
        }
        (self.count as f64, products)
    }
}

/// The step at `v` blurs across the edge and `w` along it, and its slope.
#[inline(always)]
fn profile(v: f32, w: f32, crossings: &Crossings) -> (f32, f32) {
    let (step, slope) = blurred_step(v);
    let (height, lift, turn) = crossings.at(v, w);
    (height * step + lift + turn * slope, height * slope)
}

fn chunk(column: &Column, count: usize) -> &[Lanes] {
    &column.as_chunks().0[..count]
}

#[inline(always)]
fn add(sum: &mut Lanes, values: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += values[lane];
    }
}

#[inline(always)]
fn add_product(sum: &mut Lanes, a: &Lanes, b: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += a[lane] * b[lane];
    }
}
