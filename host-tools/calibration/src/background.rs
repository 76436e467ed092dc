//! Whether a camera has turned since a reference picture was taken, by what stands behind the
//! person.
//!
//! In: two small pictures of the same view (frames reduced by the mean of squares of pixels). Out:
//! how the picture moved from the first to the second: shift, roll and scale, and how much of the
//! picture says so; or why that cannot be told.
//!
//! The method is block matching with a robust fit. Both pictures are smoothed, and the first is cut
//! into overlapping blocks. A block that has structure in both directions (the smaller eigenvalue
//! of its structure tensor, Shi and Tomasi 1994) is searched for in the second by normalised
//! cross-correlation, which neither a lamp nor an exposure changes, with a quadratic through the
//! maximum. Where a person stands, blocks are not found again, or at places that do not agree with
//! each other. The largest set of blocks that agree on one motion is taken if it spreads over the
//! picture and is not a chance: a print that was carried elsewhere is too small. A similarity is
//! fitted to the set by least squares.
//!
//! A turn about the camera's x and y axes shifts the background alike at every distance; a turn
//! about z rolls it. A camera that is moved sideways by s shifts a background at distance d by
//! f s / d, as a turn by s / d would: at 2 m, 7 mm look like 0.2 degrees. Turns of more than
//! [`SHIFT_PX_MAX`] are not recognised. It takes about 0.1 s for 182 x 136 px.

use plumbline::image::{GreyImage, Pixel};
use rayon::prelude::*;

/// A camera that is turned by this since its scene was measured mixes 0.35 % of the motion along one
/// axis into another: 0.07 mm of 20. A background tells a turn to 0.03 degrees, the mean of a second
/// of a board's poses to 0.01.
pub const TURNED_FAIL_DEG: f64 = 0.2;
/// Half of it may still be used.
pub const TURNED_WARN_DEG: f64 = 0.1;

/// Pixels of the frame for one of the pictures that are compared, each way: a turn of 0.1 degrees
/// still shifts them by 0.4 px at f 1740 px, and nobody can be recognised in them.
pub const REDUCTION: u8 = 8;

/// The side of a block: 256 pixels are enough for a correlation that nothing else reaches.
const BLOCK_PX: usize = 16;

/// The samples of a block.
const SAMPLES: f32 = (BLOCK_PX * BLOCK_PX) as f32;

/// From one block to the next: they overlap by half.
const STEP_PX: usize = BLOCK_PX / 2;

/// The largest shift that is searched for: an eighth of the width of a picture of 182 px.
pub const SHIFT_PX_MAX: usize = 24;

/// The least mean square of the gradient, in its weakest direction, of a block with structure:
/// (levels / px)^2. With an error of 1.5 levels, that of JPEG, 256 pixels then locate the block to
/// 1.5 / sqrt(256 x 2) = 0.07 px.
const STRUCTURE_MIN: f32 = 2.0;

/// The least correlation of a block that is found again.
const CORRELATION_MIN: f32 = 0.75;

/// Blocks of one motion agree within this distance.
const AGREEMENT_PX: f64 = 0.5;

/// While the roll is unknown, neighbours at a distance r may differ by this times r.
const ROLL_RAD_MAX: f64 = 0.03;

/// Fewer blocks than this say nothing. Among 100 wrong matches in a field of 49 x 49 px, 12 agree
/// within a pixel by chance in fewer than one of 10^9 pictures.
const BLOCKS_MIN: usize = 12;

/// The least share of the blocks with structure that has to agree: what a person leaves free.
const SHARE_MIN: f64 = 0.1;

/// The least extent of the blocks that agree, as a share of the picture's width: more than that of
/// a board, or of a person at 1 m (0.57), so that some lie on both sides of the person.
const EXTENT_MIN: f64 = 0.6;

/// Rounds of selecting the blocks that agree with the fit, and fitting.
const ROUNDS: usize = 5;

/// A small grey picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels, row by row.
    pub samples: Vec<u8>,
}

/// How the background moved in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Of the picture's centre: to the right, down.
    pub shift_px: [f64; 2],
    /// Clockwise, as seen in the picture.
    pub roll_rad: f64,
    /// How much larger it became.
    pub scale: f64,
    /// Blocks with structure.
    pub blocks: usize,
    /// Those that agree on this motion.
    pub agreeing: usize,
}

/// Why nothing can be said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unclear {
    /// The pictures have different sizes.
    OtherSize,
    /// The reference has too few blocks with structure.
    Plain {
        /// Their number.
        blocks: usize,
    },
    /// Too few blocks agree on a motion: the camera was turned far, or something covers the
    /// background, or it is dark.
    Unrecognised {
        /// Blocks with structure.
        blocks: usize,
        /// The most that agree.
        agreeing: usize,
    },
}

impl Picture {
    /// A frame reduced to the means of squares of pixels; incomplete squares are left out.
    #[must_use]
    pub fn reduced<P: Pixel>(frame: &GreyImage<'_, P>, reduction: usize) -> Self {
        let [width, height] = [frame.width() / reduction, frame.height() / reduction];
        let white = u64::from(frame.white_level()) * (reduction * reduction) as u64;
        let sample = |index: usize| {
            let (left, top) = (index % width * reduction, index / width * reduction);
            let row = |y: usize| frame.row(y)[left..left + reduction].iter();
            let pixels = (top..top + reduction).flat_map(row);
            let sum: u64 = pixels.map(|&pixel| u64::from(Into::<u32>::into(pixel))).sum();
            ((sum * 255 + white / 2) / white).min(255) as u8
        };
        Self { width, height, samples: (0..width * height).map(sample).collect() }
    }
}

impl Motion {
    /// The angle by which the camera turned, with a focal length in pixels of these pictures.
    #[must_use]
    pub fn turned_deg(&self, focal_px: f64) -> f64 {
        let [x, y] = self.shift_px.map(|shift| (shift / focal_px).atan());
        (x * x + y * y + self.roll_rad * self.roll_rad).sqrt().to_degrees()
    }
}

/// The motion of the background from `reference` to `now`.
///
/// # Errors
/// Why it cannot be told.
pub fn motion(reference: &Picture, now: &Picture) -> Result<Motion, Unclear> {
    if (reference.width, reference.height) != (now.width, now.height) {
        return Err(Unclear::OtherSize);
    }
    let [before, after] = [reference, now].map(Smooth::of);
    let blocks = before.blocks();
    if blocks.len() < BLOCKS_MIN {
        return Err(Unclear::Plain { blocks: blocks.len() });
    }
    let matches: Vec<Match> = blocks.par_iter().filter_map(|&at| before.find(at, &after)).collect();
    let (fit, agreeing) = consensus(&matches, before.centre_px());
    let share = agreeing.len() as f64 / blocks.len() as f64;
    let columns = || agreeing.iter().map(|it| it.from_px[0]);
    let extent_px = columns().fold(f64::MIN, f64::max) - columns().fold(f64::MAX, f64::min);
    let is_narrow = extent_px < EXTENT_MIN * before.width as f64;
    if agreeing.len() < BLOCKS_MIN || share < SHARE_MIN || is_narrow {
        return Err(Unclear::Unrecognised { blocks: blocks.len(), agreeing: agreeing.len() });
    }
    Ok(Motion {
        shift_px: fit.shift_px,
        roll_rad: fit.roll,
        scale: 1.0 + fit.growth,
        blocks: blocks.len(),
        agreeing: agreeing.len(),
    })
}

/// A picture after a binomial filter of 3 x 3: the quadratic through a correlation's maximum is
/// right only where a pixel resembles its neighbours.
struct Smooth {
    width: usize,
    height: usize,
    grey: Vec<f32>,
}

impl Smooth {
    fn of(picture: &Picture) -> Self {
        let &Picture { width, height, ref samples } = picture;
        let at = |x: usize, y: usize| f32::from(samples[y * width + x]);
        let near =
            |place: usize, side: usize| [place.saturating_sub(1), place, (place + 1).min(side - 1)];
        let mean = |[a, b, c]: [f32; 3]| 0.25 * a + 0.5 * b + 0.25 * c;
        let grey = (0..width * height).map(|index| {
            let (columns, rows) = (near(index % width, width), near(index / width, height));
            mean(rows.map(|y| mean(columns.map(|x| at(x, y)))))
        });
        Self { width, height, grey: grey.collect() }
    }

    fn centre_px(&self) -> [f64; 2] {
        [self.width, self.height].map(|side| (side as f64 - 1.0) / 2.0)
    }

    /// The upper left corners of the blocks with structure.
    fn blocks(&self) -> Vec<[usize; 2]> {
        let places = |side: usize| (1..(side - 1).saturating_sub(BLOCK_PX)).step_by(STEP_PX);
        let all = places(self.height).flat_map(|y| places(self.width).map(move |x| [x, y]));
        all.filter(|&at| self.structure(at) >= STRUCTURE_MIN).collect()
    }

    /// The mean square of the gradient in its weakest direction.
    fn structure(&self, [left, top]: [usize; 2]) -> f32 {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for y in top..top + BLOCK_PX {
            for x in left..left + BLOCK_PX {
                let at = y * self.width + x;
                let along_x = 0.5 * (self.grey[at + 1] - self.grey[at - 1]);
                let along_y = 0.5 * (self.grey[at + self.width] - self.grey[at - self.width]);
                xx += along_x * along_x;
                xy += along_x * along_y;
                yy += along_y * along_y;
            }
        }
        let weakest = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
        weakest / SAMPLES
    }

    /// Rows of a block.
    fn rows(&self, [left, top]: [usize; 2]) -> impl Iterator<Item = &[f32; BLOCK_PX]> {
        let row = move |y: usize| self.grey[y * self.width + left..].first_chunk();
        (top..top + BLOCK_PX).map(move |y| row(y).expect("a block within the picture"))
    }

    /// Where a block of this picture lies in another, if it is found there.
    fn find(&self, at: [usize; 2], other: &Self) -> Option<Match> {
        let block = Block::of(self.rows(at))?;
        let range = |from: usize, side: usize| {
            from.saturating_sub(SHIFT_PX_MAX)..(from + SHIFT_PX_MAX + 1).min(side - BLOCK_PX + 1)
        };
        let (columns, rows) = (range(at[0], self.width), range(at[1], self.height));
        let width = columns.len();
        let scores: Vec<f32> = rows
            .clone()
            .flat_map(|y| columns.clone().map(move |x| [x, y]))
            .map(|to| block.correlation(other.rows(to)))
            .collect();
        let best = (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b]))?;
        let (x, y) = (best % width, best / width);
        // At the border of the field the maximum may lie beyond it.
        let is_inside = x > 0 && y > 0 && x + 1 < width && y + 1 < rows.len();
        if !is_inside || scores[best] < CORRELATION_MIN {
            return None;
        }
        let around = [best - width, best, best + width].map(|row| [row - 1, row, row + 1]);
        let [finer_x, finer_y] = vertex(around.map(|row| row.map(|at| f64::from(scores[at]))))?;
        let to = [(columns.start + x) as f64 + finer_x, (rows.start + y) as f64 + finer_y];
        let middle = (BLOCK_PX as f64 - 1.0) / 2.0;
        Some(Match {
            from_px: at.map(|side| side as f64 + middle),
            moved_px: [to[0] - at[0] as f64, to[1] - at[1] as f64],
        })
    }
}

/// The place, x and y, of the maximum of a quadratic through rows of values at -1, 0 and 1, of which
/// the middle one is the largest. The mixed term matters: most structure runs obliquely, and a
/// parabola along each axis alone would draw the place towards whole pixels.
fn vertex(values: [[f64; 3]; 3]) -> Option<[f64; 2]> {
    let [above, [left, middle, right], below] = values;
    let (x, y) = (0.5 * (right - left), 0.5 * (below[1] - above[1]));
    let (xx, yy) = (right - 2.0 * middle + left, below[1] - 2.0 * middle + above[1]);
    let xy = 0.25 * (below[2] - below[0] - above[2] + above[0]);
    let determinant = xx * yy - xy * xy;
    let place = [(xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant];
    // Beyond the next pixel it is no maximum of these values.
    let is_maximum = determinant > 0.0 && place.iter().all(|it| it.abs() <= 1.0);
    is_maximum.then_some(place)
}

/// The samples of a block without their mean, and their norm.
struct Block {
    rows: [[f32; BLOCK_PX]; BLOCK_PX],
    norm: f32,
}

impl Block {
    fn of<'a>(of_picture: impl Iterator<Item = &'a [f32; BLOCK_PX]>) -> Option<Self> {
        let mut rows = [[0.0; BLOCK_PX]; BLOCK_PX];
        rows.iter_mut().zip(of_picture).for_each(|(row, of_picture)| *row = *of_picture);
        let samples = rows.as_flattened_mut();
        let mean = samples.iter().sum::<f32>() / SAMPLES;
        samples.iter_mut().for_each(|sample| *sample -= mean);
        let norm = samples.iter().map(|sample| sample * sample).sum::<f32>().sqrt();
        (norm > 0.0).then_some(Self { rows, norm })
    }

    /// The normalised cross-correlation, -1 to 1; 0 with a uniform area.
    fn correlation<'a>(&self, others: impl Iterator<Item = &'a [f32; BLOCK_PX]>) -> f32 {
        // A sum for each column, of which the processor adds several at once.
        let [mut products, mut sums, mut squares] = [[0.0; BLOCK_PX]; 3];
        for (row, other) in self.rows.iter().zip(others) {
            for column in 0..BLOCK_PX {
                products[column] += row[column] * other[column];
                sums[column] += other[column];
                squares[column] += other[column] * other[column];
            }
        }
        let [product, sum, squares] =
            [products, sums, squares].map(|columns| columns.iter().sum::<f32>());
        let spread = squares - sum * sum / SAMPLES;
        // Less than a level of spread is noise.
        if spread < SAMPLES { 0.0 } else { product / (self.norm * spread.sqrt()) }
    }
}

/// A block that was found again.
#[derive(Debug, Clone, Copy)]
struct Match {
    /// Its centre.
    from_px: [f64; 2],
    moved_px: [f64; 2],
}

/// A small similarity about the picture's centre: `moved = shift + growth p + roll (-p_y, p_x)`.
#[derive(Debug, Clone, Copy)]
struct Similarity {
    centre_px: [f64; 2],
    shift_px: [f64; 2],
    growth: f64,
    roll: f64,
}

impl Similarity {
    /// Fitted by least squares to at least two matches.
    fn of(matches: &[Match], centre_px: [f64; 2]) -> Self {
        let count = matches.len() as f64;
        let mean = |of: fn(&Match) -> [f64; 2]| {
            [0, 1].map(|axis| matches.iter().map(|it| of(it)[axis]).sum::<f64>() / count)
        };
        let (from, moved) = (mean(|it| it.from_px), mean(|it| it.moved_px));
        let (mut along, mut across, mut squares) = (0.0, 0.0, f64::MIN_POSITIVE);
        for it in matches {
            let [x, y] = [it.from_px[0] - from[0], it.from_px[1] - from[1]];
            let [u, v] = [it.moved_px[0] - moved[0], it.moved_px[1] - moved[1]];
            along += x * u + y * v;
            across += x * v - y * u;
            squares += x * x + y * y;
        }
        let (growth, roll) = (along / squares, across / squares);
        let [x, y] = [centre_px[0] - from[0], centre_px[1] - from[1]];
        let shift_px = [moved[0] + growth * x - roll * y, moved[1] + growth * y + roll * x];
        Self { centre_px, shift_px, growth, roll }
    }

    fn agrees(&self, it: &Match) -> bool {
        let [x, y] = [it.from_px[0] - self.centre_px[0], it.from_px[1] - self.centre_px[1]];
        let u = self.shift_px[0] + self.growth * x - self.roll * y;
        let v = self.shift_px[1] + self.growth * y + self.roll * x;
        (it.moved_px[0] - u).hypot(it.moved_px[1] - v) < AGREEMENT_PX
    }
}

/// The largest set of matches that agree on one motion, and that motion.
fn consensus(matches: &[Match], centre_px: [f64; 2]) -> (Similarity, Vec<Match>) {
    let like = |one: &Match| -> Vec<Match> {
        let is_like = |other: &&Match| {
            let apart = |of: fn(&Match) -> [f64; 2]| {
                let ([ax, ay], [bx, by]) = (of(one), of(other));
                (ax - bx).hypot(ay - by)
            };
            apart(|it| it.moved_px) < 2.0 * AGREEMENT_PX + ROLL_RAD_MAX * apart(|it| it.from_px)
        };
        matches.iter().filter(is_like).copied().collect()
    };
    let mut agreeing = matches.iter().map(like).max_by_key(Vec::len).unwrap_or_default();
    let mut fit = Similarity::of(&agreeing, centre_px);
    for _ in 0..ROUNDS {
        agreeing = matches.iter().filter(|it| fit.agrees(it)).copied().collect();
        if agreeing.len() < BLOCKS_MIN {
            break;
        }
        fit = Similarity::of(&agreeing, centre_px);
    }
    (fit, agreeing)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of waves that repeat nowhere within it, moved by this much and rolled.
    fn waves([dx, dy]: [f64; 2], roll: f64, gain: f64) -> Picture {
        let (width, height) = (182, 136);
        let samples = (0..width * height).map(|index| {
            let (x, y) = ((index % width) as f64 - 90.5, (index / width) as f64 - 67.5);
            // Where this pixel was before.
            let (x, y) = (x - dx, y - dy);
            let (x, y) = (x + roll * y, y - roll * x);
            let wave = (0.31 * x + 0.002 * x * y).sin() + (0.27 * y - 0.0015 * x * x).cos();
            (gain * (110.0 + 45.0 * wave)).clamp(0.0, 255.0) as u8
        });
        Picture { width, height, samples: samples.collect() }
    }

    #[test]
    fn a_shift_and_a_roll_are_measured_to_a_twentieth_of_a_pixel() {
        let reference = waves([0.0; 2], 0.0, 1.0);
        for (shift, roll) in
            [([0.0; 2], 0.0), ([1.1, -0.4], 0.0), ([0.0; 2], 0.005), ([-17.3, 9.6], -0.01)]
        {
            let found = motion(&reference, &waves(shift, roll, 0.6)).unwrap();
            let [x, y] = [found.shift_px[0] - shift[0], found.shift_px[1] - shift[1]];
            assert!(x.hypot(y) < 0.05, "{shift:?} {roll}: {found:?}");
            // 0.03 px at half the width.
            assert!((found.roll_rad - roll).abs() < 3e-4, "{shift:?} {roll}: {found:?}");
            assert!((found.scale - 1.0).abs() < 6e-4, "{found:?}");
        }
    }

    #[test]
    fn what_cannot_be_told_is_not() {
        let reference = waves([0.0; 2], 0.0, 1.0);
        let grey = Picture { samples: vec![90; reference.samples.len()], ..reference.clone() };
        assert_eq!(motion(&grey, &reference), Err(Unclear::Plain { blocks: 0 }));
        let dark = motion(&reference, &grey);
        assert!(matches!(dark, Err(Unclear::Unrecognised { agreeing: 0, .. })), "{dark:?}");
        let other = Picture { width: 91, height: 272, ..reference.clone() };
        assert_eq!(motion(&reference, &other), Err(Unclear::OtherSize));
    }

    #[test]
    fn the_vertex_of_a_quadratic_is_exact() {
        let quadratic = |x: f64, y: f64| {
            let (x, y) = (x - 0.3, y + 0.2);
            1.0 - 0.2 * x * x - 0.1 * y * y + 0.15 * x * y
        };
        let ones = [-1.0, 0.0, 1.0];
        let [x, y] = vertex(ones.map(|y| ones.map(|x| quadratic(x, y)))).unwrap();
        assert!((x - 0.3).abs() < 1e-12 && (y + 0.2).abs() < 1e-12, "{x} {y}");
        assert_eq!(vertex([[0.5; 3]; 3]), None);
        let ridge = |x: f64, y: f64| -(x + y) * (x + y);
        assert_eq!(vertex(ones.map(|y| ones.map(|x| ridge(x, y)))), None);
    }

    /// A board that hangs before a plain wall, and was carried elsewhere.
    #[test]
    fn what_moves_in_a_small_part_of_the_picture_is_no_motion_of_the_camera() {
        let patch = |left: usize| {
            let mut picture = Picture { width: 182, height: 136, samples: vec![120; 182 * 136] };
            let waves = waves([0.0; 2], 0.0, 1.0);
            for (y, x) in (40..90).flat_map(|y| (0..50).map(move |x| (y, x))) {
                picture.samples[y * 182 + left + x] = waves.samples[y * 182 + 60 + x];
            }
            picture
        };
        let found = motion(&patch(60), &patch(66));
        assert!(matches!(found, Err(Unclear::Unrecognised { .. })), "{found:?}");
    }

    #[test]
    fn a_reduced_frame_has_the_means_of_squares() {
        let pixels: Vec<u16> = (0..70 * 64).map(|at| if at % 70 < 32 { 40 } else { 800 }).collect();
        let frame = GreyImage::with_white_level(&pixels, 70, 64, 70, 1000).unwrap();
        let reduced = Picture::reduced(&frame, 32);
        assert_eq!(reduced, Picture { width: 2, height: 2, samples: vec![10, 204, 10, 204] });
    }
}
