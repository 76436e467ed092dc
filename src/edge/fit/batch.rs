//! Pixels of an edge, the columns of its model, and their inner products.

use super::region::Region;
use super::regression::{PRODUCTS, Sums};
use crate::edge::profile::blurred_step;
use crate::image::{GreyImage, Pixel};

/// Pixels handled together: one SSE2 or NEON register.
const LANES: usize = 4;
type Lanes = [f32; LANES];

/// A row of pixels: its grey base, and where its pixels are.
struct Line {
    base: f32,
    /// Distance of the first one from the chord, to its right, in blurs.
    across: f32,
    across_per_pixel: f32,
    /// Place along the edge of the first one, in its lengths from the middle.
    place: f32,
    place_per_pixel: f32,
}

/// Pixels handled at once, more than an ordinary edge has.
pub(super) const BATCH_PX: usize = 256;

/// One number per pixel. A row's last lanes may reach beyond its end, to be overwritten by
/// the next row.
type Column = [f32; BATCH_PX + LANES];

/// Pixels of one edge, row after row without gaps, so that no lane is idle; a buffer that is
/// kept only because clearing it would cost as much as using it.
pub struct Batch {
    count: usize,
    grey: Column,
    across: Column,
    place: Column,
    step: Column,
    blur: Column,
    slope: Column,
    turn: Column,
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

impl Batch {
    /// An empty one.
    #[must_use]
    pub const fn new() -> Self {
        const EMPTY: Column = [0.0; BATCH_PX + LANES];
        Self {
            count: 0,
            grey: EMPTY,
            across: EMPTY,
            place: EMPTY,
            step: EMPTY,
            blur: EMPTY,
            slope: EMPTY,
            turn: EMPTY,
        }
    }

    /// Inner products over all pixels of a region inside the frame; `None` where its middle is
    /// outside.
    pub(super) fn sums<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        region: &Region,
    ) -> Option<Sums> {
        let [origin_x, origin_y] = region.origin;
        if origin_x >= image.width() || origin_y >= image.height() {
            return None;
        }
        let base: f32 = image.row(origin_y)[origin_x].into();
        let mut products = Products::new();
        self.count = 0;
        let [middle_x, middle_y] = region.middle;
        let [along_x, along_y] = region.along;
        for row in region.rows(image.height()) {
            let y = row as f32 - middle_y;
            let columns = region.columns(y, image.width());
            let (start, end) = (columns.start, columns.end);
            if start >= end {
                continue;
            }
            let pixels = &image.row((origin_y as i32 + row) as usize)[start as usize..];
            let x = (start - origin_x as i32) as f32 - middle_x;
            let line = Line {
                base,
                across: (along_x * y - along_y * x) * region.per_blur,
                across_per_pixel: -along_y * region.per_blur,
                place: (along_x * x + along_y * y) * region.per_length,
                place_per_pixel: along_x * region.per_length,
            };
            let count = (end - start) as usize;
            if self.count + count > BATCH_PX {
                products.add(self, region.bend_px * region.per_blur);
            }
            self.push(pixels, count.min(BATCH_PX), &line);
        }
        products.add(self, region.bend_px * region.per_blur);
        let products = products.total();
        Some(Sums { count: products[0], products, base: base.into() })
    }

    /// Appends the first `count` pixels of a row; there must be room for them.
    #[inline]
    fn push<P: Pixel>(&mut self, pixels: &[P], count: usize, line: &Line) {
        for done in (0..count).step_by(LANES) {
            let grey = &mut self.grey[self.count + done..][..LANES];
            let across = &mut self.across[self.count + done..][..LANES];
            let place = &mut self.place[self.count + done..][..LANES];
            if let Some(pixels) = pixels[done..].first_chunk::<LANES>() {
                for lane in 0..LANES {
                    let value: f32 = pixels[lane].into();
                    grey[lane] = value - line.base;
                }
            } else {
                // At the frame's right border.
                for (grey, &pixel) in grey.iter_mut().zip(&pixels[done..]) {
                    let value: f32 = pixel.into();
                    *grey = value - line.base;
                }
            }
            for lane in 0..LANES {
                let column = done as f32 + lane as f32;
                across[lane] = line.across + line.across_per_pixel * column;
                place[lane] = line.place + line.place_per_pixel * column;
            }
        }
        self.count += count;
    }
}

/// The inner products, in lanes.
struct Products([Lanes; PRODUCTS]);

impl Products {
    fn new() -> Self {
        Self([[0.0; LANES]; PRODUCTS])
    }

    /// Adds a batch and empties it; `bend`: the lens's, in blurs.
    fn add(&mut self, batch: &mut Batch, bend: f32) {
        let count = batch.count;
        batch.count = 0;
        let end = count.next_multiple_of(LANES);
        let Batch { grey, across, place, step, blur, slope, turn, .. } = batch;
        for start in (0..end).step_by(LANES) {
            let (across, place) = (at(across, start), at(place, start));
            let (step, blur) = (at_mut(step, start), at_mut(blur, start));
            let (slope, turn) = (at_mut(slope, start), at_mut(turn, start));
            for lane in 0..LANES {
                let w = place[lane];
                let v = across[lane] - bend * (1.0 - 4.0 * w * w);
                let (value, by_v) = blurred_step(v);
                step[lane] = value;
                slope[lane] = by_v;
                blur[lane] = -v * by_v;
                turn[lane] = by_v * w;
            }
        }
        // What lies past the last pixel takes no part.
        for column in [&mut *grey, step, blur, slope, turn] {
            column[count..end].fill(0.0);
        }
        // Few enough sums at a time that they stay in registers.
        let [one, s, b, p, t, g, ss, sb, sp, st, sg, bb, bp, bt, bg, pp, pt, pg, tt, tg, gg] =
            &mut self.0;
        one[0] += count as f32;
        for start in (0..end).step_by(LANES) {
            let [step, blur, slope, turn, grey] =
                [&*step, blur, slope, turn, grey].map(|column| at(column, start));
            add(s, step);
            add(b, blur);
            add(p, slope);
            add(t, turn);
            add(g, grey);
            add_product(ss, step, step);
            add_product(sb, step, blur);
            add_product(sp, step, slope);
            add_product(st, step, turn);
            add_product(sg, step, grey);
        }
        for start in (0..end).step_by(LANES) {
            let [blur, slope, turn, grey] =
                [&*blur, slope, turn, grey].map(|column| at(column, start));
            add_product(bb, blur, blur);
            add_product(bp, blur, slope);
            add_product(bt, blur, turn);
            add_product(bg, blur, grey);
            add_product(pp, slope, slope);
            add_product(pt, slope, turn);
            add_product(pg, slope, grey);
            add_product(tt, turn, turn);
            add_product(tg, turn, grey);
            add_product(gg, grey, grey);
        }
    }

    fn total(&self) -> [f64; PRODUCTS] {
        self.0.map(|lanes| lanes.iter().map(|&value| f64::from(value)).sum())
    }
}

#[inline(always)]
fn at(column: &Column, start: usize) -> &Lanes {
    column[start..].first_chunk().expect("a batch has room for its last lanes")
}

#[inline(always)]
fn at_mut(column: &mut Column, start: usize) -> &mut Lanes {
    column[start..].first_chunk_mut().expect("a batch has room for its last lanes")
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
