//! Pixels of an edge, the columns of its model, and their inner products.

use core::array;
use core::hint::black_box;

use super::crossing::Crossings;
use super::lanes::{LANES, Lanes};
use super::region::{BAND_LINES_MAX, Band, Region};
use super::regression::{PRODUCTS, Sums};
use crate::fit::edge::light::Levels;
use crate::fit::edge::profile::blurred_step;
use crate::model::image::{GreyImage, Pixel};

/// Quantities that vary linearly about an edge's middle, one lane each.
struct Field {
    middle: Lanes,
    by_line: Lanes,
    by_place: Lanes,
    /// For each quantity, what neighbouring places add to it.
    steps: [Lanes; 4],
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
    fn new(middle: Lanes, by_line: Lanes, by_place: Lanes) -> Self {
        let steps = by_place.map(|step| array::from_fn(|lane| step * lane as f32));
        Self { middle, by_line, by_place, steps }
    }

    /// At a line and a place in it, from the middle.
    #[inline(always)]
    fn at(&self, line: f32, place: f32) -> Lanes {
        array::from_fn(|lane| {
            self.middle[lane] + self.by_line[lane] * line + self.by_place[lane] * place
        })
    }
}

/// Samples handled at once, more than an ordinary edge has.
pub(super) const BATCH: usize = 128;

/// One number per sample. A band's last lanes may reach beyond its end, to be overwritten by
/// the next band.
type Column = [f32; BATCH + LANES];

/// Groups of lanes in a column.
const CHUNKS: usize = BATCH / LANES + 1;

/// Samples of one edge, each the mean of neighbouring pixels along the edge or a single pixel, band
/// after band without gaps, so that no lane is idle; a buffer that is kept only because clearing it
/// would cost as much as using it.
pub struct Batch {
    count: usize,
    grey: Column,
    across: Column,
    place: Column,
    /// Blur of a single pixel over the sample's.
    sharpness: Column,
    /// The number of pixels.
    pixels: Column,
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
        const EMPTY: Column = [0.0; BATCH + LANES];
        Self { count: 0, grey: EMPTY, across: EMPTY, place: EMPTY, sharpness: EMPTY, pixels: EMPTY }
    }

    /// Inner products over all pixels of a region inside the frame, each weighted by its expected
    /// noise, with the slope of the light removed from them; there are none where the region's
    /// middle is outside. `sign` is 1 where the right side is light, otherwise -1.
    pub(super) fn sums<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        region: &Region,
        levels: Option<&Levels>,
        sign: f64,
    ) -> Sums {
        let by_lines = |[x, y]: [f32; 2]| if region.are_lines_rows { [y, x] } else { [x, y] };
        let [origin_line, origin_place] = region.origin;
        let [origin_x, origin_y] = if region.are_lines_rows {
            [origin_place, origin_line]
        } else {
            [origin_line, origin_place]
        };
        if origin_x >= image.width() || origin_y >= image.height() {
            return Sums::default();
        }
        let [mean, gain] = levels.map_or([[0.0; 2]; 2], |levels| {
            // To first order: the square is neglected, 0.1 % of the contrast in the farthest pixels
            // of an edge of 20 px when it varies by 30 % in 140 px.
            [levels.mean_per_px, -levels.contrast_per_px]
                .map(|slope| by_lines([slope.x as f32, slope.y as f32]))
        });
        let base: f32 = match levels {
            Some(levels) => (0.5 * (levels.light + levels.dark)) as f32,
            None => image.row(origin_y)[origin_x].into(),
        };
        let noise_by_step =
            levels.map_or(0.0, |levels| (sign * levels.certainty.noise_contrast) as f32);
        let mut products = Products::new(noise_by_step);
        self.count = 0;
        let [right_line, right_place] = region.right;
        let [along_line, along_place] = region.along;
        let (per_blur, per_length) = (region.per_blur, region.per_length);
        // An arc's height in its middle, and nothing at its ends.
        let height = region.bend_px * per_blur;
        let bend = 4.0 * height;
        let field = Field::new(
            [base, 1.0, -height, 0.0],
            [mean[0], gain[0], right_line * per_blur, along_line * per_length],
            [mean[1], gain[1], right_place * per_blur, along_place * per_length],
        );
        region.each_band([image.width(), image.height()], |band| {
            if self.count + band.places.len() > BATCH {
                products.add(self, bend, &region.crossings);
            }
            self.push(image, region.are_lines_rows, band, &field);
        });
        products.add(self, bend, &region.crossings);
        products.total(base.into())
    }

    /// Appends a band's samples; there must be room for them. No band has more than [`BATCH`].
    #[inline]
    fn push<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        are_lines_rows: bool,
        band: &Band,
        field: &Field,
    ) {
        let count = band.places.len().min(BATCH);
        let mut done = 0;
        while done < count {
            self.push_lanes(image, are_lines_rows, band, done, field);
            done += LANES;
        }
        self.count += count;
    }

    /// Writes a band's samples from the one at `done`, as many as there are lanes.
    ///
    /// Never inlined: most bands have no more, so that nothing is gained by preparing for a loop.
    #[inline(never)]
    fn push_lanes<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        are_lines_rows: bool,
        band: &Band,
        done: usize,
        field: &Field,
    ) {
        const { assert!(BAND_LINES_MAX == 5) };
        let first_place = band.places.start + done;
        let sums = match band.lines {
            5 => sums_of::<5, P>(image, are_lines_rows, band, first_place),
            4 => sums_of::<4, P>(image, are_lines_rows, band, first_place),
            3 => sums_of::<3, P>(image, are_lines_rows, band, first_place),
            2 => sums_of::<2, P>(image, are_lines_rows, band, first_place),
            _ => sums_of::<1, P>(image, are_lines_rows, band, first_place),
        };
        let [line, place] = band.from_middle;
        // Through 32 bits: a conversion from 64 takes several instructions.
        let first = field.at(line, place + done as u32 as f32);
        let at = |part: usize, lane: usize| first[part] + field.steps[part][lane];
        let lines = band.lines as u32 as f32;
        let per_line = 1.0 / lines;
        let grey = |lane: usize| (sums[lane] as f32 * per_line - at(MEAN, lane)) * at(GAIN, lane);
        let place = self.count + done;
        write(&mut self.grey, place, &array::from_fn(grey));
        write(&mut self.across, place, &array::from_fn(|lane| at(ACROSS, lane)));
        write(&mut self.place, place, &array::from_fn(|lane| at(PLACE, lane)));
        write(&mut self.sharpness, place, &[band.sharpness; LANES]);
        write(&mut self.pixels, place, &[lines; LANES]);
    }
}

#[inline(always)]
fn write(column: &mut Column, place: usize, values: &Lanes) {
    let room: Option<&mut Lanes> = column[place..].first_chunk_mut();
    *room.expect("a batch has room for its last lanes") = *values;
}

/// For each of the first places, the sum of a band's pixels there.
#[inline(always)]
fn sums_of<const LINES: usize, P: Pixel>(
    image: &GreyImage<'_, P>,
    are_lines_rows: bool,
    band: &Band,
    first_place: usize,
) -> [i32; LANES] {
    if are_lines_rows {
        sums_of_rows::<LINES, P>(image, band.first_line, first_place)
    } else {
        sums_of_columns::<LINES, P>(image, band.first_line, first_place)
    }
}

/// Where lines are rows.
#[inline(always)]
fn sums_of_rows<const LINES: usize, P: Pixel>(
    image: &GreyImage<'_, P>,
    first_row: usize,
    column: usize,
) -> [i32; LANES] {
    let mut sums = [0; LANES];
    for line in 0..LINES {
        let row = first_row + line;
        if let Some(pixels) = image.span::<LANES>(column, row) {
            sums = array::from_fn(|place| sums[place] + whole(pixels[place]));
        } else {
            // At the frame's right border.
            let pixels = &image.row(row)[column..];
            sums.iter_mut().zip(pixels).for_each(|(sum, &pixel)| *sum += whole(pixel));
        }
    }
    sums
}

/// Where lines are columns; also over rows beyond the band's end, because a branch that is taken
/// now and then costs more.
#[inline(always)]
fn sums_of_columns<const LINES: usize, P: Pixel>(
    image: &GreyImage<'_, P>,
    column: usize,
    first_row: usize,
) -> [i32; LANES] {
    array::from_fn(|lane| {
        let pixels = image.span::<LINES>(column, first_row + lane);
        pixels.map_or(0, |pixels| pixels.iter().map(|&pixel| whole(pixel)).sum())
    })
}

#[inline(always)]
fn whole<P: Pixel>(pixel: P) -> i32 {
    Into::<u32>::into(pixel) as i32
}

/// The weighted inner products, in lanes.
struct Products {
    sums: [Lanes; PRODUCTS],
    /// How much the noise variance grows from the middle of the step to its top, as a share of that
    /// in the middle. A pixel's weight is the inverse of its expected variance, which follows from
    /// the model and not from the pixel: noise would otherwise weigh itself.
    noise_by_step: f32,
    samples: usize,
}

impl Products {
    fn new(noise_by_step: f32) -> Self {
        Self { sums: [[0.0; LANES]; PRODUCTS], noise_by_step, samples: 0 }
    }

    /// Adds a batch and empties it; `bend` is 4 times what is to be added at either end, in blurs.
    fn add(&mut self, batch: &mut Batch, bend: f32, crossings: &Crossings) {
        if crossings.are_corners() {
            self.add_batch::<true>(batch, bend, crossings);
        } else {
            self.add_batch::<false>(batch, bend, crossings);
        }
    }

    /// One loop without branches, in which each group of four lanes becomes one vector. A compiler
    /// might instead combine samples of several iterations, which costs two to three times as much,
    /// because they have to be gathered and the order of the sums kept. [`black_box`] prevents
    /// that: it is opaque to the compiler, and costs no instruction.
    #[inline(never)]
    fn add_batch<const ARE_CORNERS: bool>(
        &mut self,
        batch: &mut Batch,
        bend: f32,
        crossings: &Crossings,
    ) {
        let count = batch.count;
        batch.count = 0;
        self.samples += count;
        let Batch { grey, across, place, sharpness, pixels, .. } = batch;
        // The last lanes hold no pixels.
        for column in [&mut *grey, &mut *across, &mut *place, &mut *sharpness, &mut *pixels] {
            write(column, count, &[0.0; LANES]);
        }
        let noise_by_step = self.noise_by_step;
        let mut sums = self.sums;
        let [o, s, b, p, t, g, ss, sb, sp, st, sg, bb, bp, bt, bg, pp, pt, pg, tt, tg, gg] =
            &mut sums;
        let columns = [grey, across, place, sharpness, pixels].map(|column| column.as_chunks().0);
        for chunk in 0..count.div_ceil(LANES).min(CHUNKS) {
            black_box(());
            let [grey, across, place, sharpness, pixels]: [&Lanes; 5] =
                columns.map(|column| &column[chunk]);
            let [mut step, mut slope, mut blur, mut turn] = [[0.0; LANES]; 4];
            // Each column times the sample's weight.
            let [mut wo, mut ws, mut wp, mut wb, mut wt, mut wg] = [[0.0; LANES]; 6];
            for lane in 0..LANES {
                let w = place[lane];
                let v = (across[lane] + bend * w * w) * sharpness[lane];
                (step[lane], slope[lane]) = profile::<ARE_CORNERS>(v, w, crossings);
                slope[lane] *= sharpness[lane];
                blur[lane] = v * slope[lane];
                turn[lane] = w * slope[lane];
                wo[lane] = pixels[lane] / (1.0 + noise_by_step * step[lane]);
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

    /// The sums over all lanes; `base` has been subtracted from all pixels.
    fn total(&self, base: f64) -> Sums {
        let products = self.sums.map(|[a, b, c, d]| f64::from((a + b) + (c + d)));
        Sums { count: self.samples as f64, products, base }
    }
}

/// The step at `v` blurs across the edge and `w` along it, and its slope.
#[inline(always)]
fn profile<const ARE_CORNERS: bool>(v: f32, w: f32, crossings: &Crossings) -> (f32, f32) {
    let (step, slope) = blurred_step(v);
    let (height, lift, turn) = crossings.at::<ARE_CORNERS>(v, w);
    (height * step + lift + turn * slope, height * slope)
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
