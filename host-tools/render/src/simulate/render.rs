//! Draws printed targets with exact pixel integration.
//!
//! A pixel's value is the mean over its square of the scene blurred by the
//! lens. Near a pixel the map from raw pixels to the target's plane is affine
//! (matrix A, mm/px), and a Gaussian blur of `psf_sigma_px` in the image is a Gaussian of
//! covariance sigma^2 A A^T on the target. A checker is constant between lines parallel to the
//! target's axes, so its blurred value is a sum of bivariate normal CDFs at the lattice points.
//! Away from the corners these reduce to univariate ones. The mean over the pixel's square is a
//! Gauss-Legendre quadrature of that smooth function, through the lens and the perspective. There
//! is no supersampling: its jagged edges would cause errors larger than those to be measured.
//!
//! Neglected: the curvature of the map within the blur and, for the lens alone, within the pixel.
//! It moves an edge by about sigma^2/2 times the map's second derivative. The tests measure it:
//! less than 0.001 px in the corner of a wide-angle image (f 800 px, k1 -0.28, 57 degrees off
//! axis), and for the standard lens no more than 0.0001 px, the accuracy of the brute-force
//! reference. For a print seen at grazing incidence (beyond 75 degrees) the curvature is larger.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::TargetGeometry;
use rayon::prelude::*;

use super::normal::{Correlation, GaussLegendre, NormalCdf, REACH_SD};

/// The narrowest blur drawn. Narrower ones would need more quadrature points per pixel; real lenses
/// have a wider blur.
pub const PSF_SIGMA_PX_MIN: f64 = 0.3;

/// The widest blur drawn.
pub const PSF_SIGMA_PX_MAX: f64 = 20.0;

/// A grey picture of 32-bit samples, before noise and quantisation, in levels of 0 to 255.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row, without padding.
    pub grey: Vec<f32>,
}

impl Picture {
    /// A picture of uniform grey.
    #[must_use]
    pub fn uniform(width: usize, height: usize, grey: f32) -> Self {
        Self { width, height, grey: vec![grey; width * height] }
    }
}

/// Grey levels (of 255) of a print.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ink {
    /// The dark squares.
    pub black: f64,
    /// The light squares and the margin.
    pub white: f64,
}

/// A printed checker on its paper: what is drawn for a target.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// Where the grey changes along x, mm, ascending: edge of the paper, edges of each column, edge
    /// of the paper.
    x_lines_mm: Vec<f64>,
    y_lines_mm: Vec<f64>,
    ink: Ink,
}

impl Board {
    /// The print of a regular checker geometry: its squares, one more column and row of them than
    /// inner corners, and a white margin around.
    ///
    /// # Panics
    /// When the geometry's corners are not a flat regular grid, as only such grids are printed.
    #[must_use]
    pub fn new(geometry: &TargetGeometry, margin_mm: f64, ink: Ink) -> Self {
        let (columns, rows) = (geometry.columns(), geometry.rows());
        let first = geometry.corner_mm(0);
        let pitch = Vector2::new(
            geometry.corner_mm(1).x - first.x,
            geometry.corner_mm(columns).y - first.y,
        );
        for index in 0..geometry.corner_count() {
            let cell = Vector2::new((index % columns) as f64, (index / columns) as f64);
            let regular = first + pitch.component_mul(&cell).push(0.0);
            assert!(
                (geometry.corner_mm(index) - regular).norm() < 1e-9,
                "only a flat regular checker can be drawn"
            );
        }
        let lines = |count: usize, first: f64, pitch: f64| {
            let edges = (0..count + 2).map(|line| first + (line as f64 - 1.0) * pitch);
            let mut lines = vec![first - pitch - margin_mm];
            lines.extend(edges);
            lines.push(first + count as f64 * pitch + margin_mm);
            lines
        };
        Self {
            x_lines_mm: lines(columns, first.x, pitch.x),
            y_lines_mm: lines(rows, first.y, pitch.y),
            ink,
        }
    }

    /// The paper's left, top, right and bottom edge in the target frame, mm.
    #[must_use]
    pub fn paper_mm(&self) -> [f64; 4] {
        let ends = |lines: &[f64]| (lines[0], lines[lines.len() - 1]);
        let ((left, right), (top, bottom)) = (ends(&self.x_lines_mm), ends(&self.y_lines_mm));
        [left, top, right, bottom]
    }

    /// The grey of the cell with `column` lines to its left and `row` lines above it. `None` off
    /// the paper.
    fn cell(&self, column: usize, row: usize) -> Option<f64> {
        let (columns, rows) = (self.x_lines_mm.len(), self.y_lines_mm.len());
        if column == 0 || row == 0 || column == columns || row == rows {
            return None;
        }
        let margin = column == 1 || row == 1 || column == columns - 1 || row == rows - 1;
        // The first square, up and left of corner 0, is black.
        let black = !margin && (column + row).is_multiple_of(2);
        Some(if black { self.ink.black } else { self.ink.white })
    }

    /// The grey at a point of the target's plane, unblurred; `None` off the paper.
    #[must_use]
    pub fn grey_at(&self, x_mm: f64, y_mm: f64) -> Option<f64> {
        self.cell(
            self.x_lines_mm.partition_point(|line| *line <= x_mm),
            self.y_lines_mm.partition_point(|line| *line <= y_mm),
        )
    }
}

/// A board with its pose.
#[derive(Debug, Clone)]
pub struct PlacedBoard<'a> {
    /// What is printed.
    pub board: &'a Board,
    /// The pose.
    pub cam_from_target: Pose<Cam, Target>,
}

/// The map from rays to the target's plane: the inverse of the homography [x-axis, y-axis, origin].
struct PlaneMap {
    plane_by_ray: Matrix3<f64>,
}

impl PlaneMap {
    /// `None` when the plane passes through the camera or faces away from it.
    fn new(cam_from_target: &Pose<Cam, Target>) -> Option<Self> {
        let rotation = &cam_from_target.rotation;
        let origin = cam_from_target.translation_mm;
        // The target's z axis points away from the camera when its print faces it.
        if rotation.column(2).dot(&origin) <= 0.0 {
            return None;
        }
        let columns = [rotation.column(0).into(), rotation.column(1).into(), origin];
        let plane_by_ray = Matrix3::from_columns(&columns).try_inverse()?;
        Some(Self { plane_by_ray })
    }

    /// The point in homogeneous coordinates: its x and y times z, mm, and z.
    #[inline]
    fn homogeneous(&self, ray: &Vector2<f64>) -> Vector3<f64> {
        self.plane_by_ray * Vector3::new(ray.x, ray.y, 1.0)
    }

    /// The point, mm, and its Jacobian with respect to the ray.
    #[inline]
    fn point_with_jacobian(&self, ray: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let homogeneous = self.homogeneous(ray);
        let inverse = 1.0 / homogeneous.z;
        let (x, y) = (homogeneous.x * inverse, homogeneous.y * inverse);
        let map = &self.plane_by_ray;
        let jacobian = Matrix2::new(
            map.m11 - x * map.m31,
            map.m12 - x * map.m32,
            map.m21 - y * map.m31,
            map.m22 - y * map.m32,
        );
        (Vector2::new(x, y), jacobian * inverse)
    }
}

/// The factor of the print's grey at a raw pixel's column and row: uneven light. Functions take it by
/// reference, not as a generic argument: drawing is compiled with this crate, and not with each that
/// calls it, less optimised.
pub type Gain<'a> = dyn Fn(f64, f64) -> f64 + Sync + 'a;

/// Draws boards over `picture`, which holds the background, in the given order.
///
/// `gain` must be smooth over a few pixels. The parts of a board outside the frame, or outside the
/// lens's monotonic range, are not drawn; nor is a board that faces away or reaches behind the camera.
///
/// # Panics
/// When the picture's size is not that of the lens, or the blur is not within
/// [`PSF_SIGMA_PX_MIN`]`..=`[`PSF_SIGMA_PX_MAX`]: both are a caller's bug.
pub fn render_targets(
    lens: &Lens,
    psf_sigma_px: f64,
    boards: &[PlacedBoard<'_>],
    gain: &Gain<'_>,
    picture: &mut Picture,
) {
    let optics = Optics::new(lens, psf_sigma_px);
    let painters: Vec<_> = optics.painters(boards).collect();
    optics.for_each_row(picture, |y, pixels, scratch| {
        for painter in &painters {
            painter.row(y, pixels, gain, scratch);
        }
    });
}

/// The same for a rolling shutter: each row shows the boards where they are at its own time.
///
/// # Panics
/// As [`render_targets`].
pub fn render_targets_by_row<'a>(
    lens: &Lens,
    psf_sigma_px: f64,
    boards_of_row: &(dyn Fn(usize) -> &'a [PlacedBoard<'a>] + Sync),
    gain: &Gain<'_>,
    picture: &mut Picture,
) {
    let optics = Optics::new(lens, psf_sigma_px);
    optics.for_each_row(picture, |y, pixels, scratch| {
        for painter in optics.painters(boards_of_row(y)) {
            painter.row(y, pixels, gain, scratch);
        }
    });
}

/// What all boards of a picture are seen through.
struct Optics<'a> {
    lens: &'a Lens,
    psf_sigma_px: f64,
    rules: Rules,
}

impl<'a> Optics<'a> {
    fn new(lens: &'a Lens, psf_sigma_px: f64) -> Self {
        assert!(
            (PSF_SIGMA_PX_MIN..=PSF_SIGMA_PX_MAX).contains(&psf_sigma_px),
            "a blur of {psf_sigma_px} px cannot be drawn"
        );
        Self { lens, psf_sigma_px, rules: Rules::new() }
    }

    /// Those of the boards that are in view.
    fn painters<'b>(&'b self, boards: &'b [PlacedBoard<'b>]) -> impl Iterator<Item = Painter<'b>> {
        boards.iter().filter_map(|placed| {
            let map = PlaneMap::new(&placed.cam_from_target)?;
            let bounds_px = bounds_px(self.lens, self.psf_sigma_px, placed)?;
            Some(Painter { optics: self, board: placed.board, map, bounds_px })
        })
    }

    /// Calls `draw` with the number and the pixels of each row, on all processors.
    fn for_each_row(
        &self,
        picture: &mut Picture,
        draw: impl Fn(usize, &mut [f32], &mut Scratch) + Sync,
    ) {
        assert_eq!(picture.width, usize::from(self.lens.width_px), "the picture is not the lens's");
        assert_eq!(
            picture.height,
            usize::from(self.lens.height_px),
            "the picture is not the lens's"
        );
        let rows = picture.grey.par_chunks_mut(picture.width).enumerate();
        rows.for_each_init(Scratch::new, |scratch, (y, pixels)| draw(y, pixels, scratch));
    }
}

/// How far a pixel may reach along one of its sides, in standard deviations of the blur, and the number
/// of points that then suffice: the rule's error on the steepest CDF stays below 0.003 of 120 levels.
/// It is 1/24, 1/4,320 and 1/2,016,000 of the width's power 2, 4 and 6 times the CDF's derivative of
/// that order, at most 0.24, 0.55 and 2.3. The side across an edge is 1/sigma wide; that along it is
/// almost nothing.
const POINTS: [(f64, usize); 5] =
    [(0.05, 1), (0.66, 2), (1.0 / 0.599, 3), (1.0 / 0.449, 4), (f64::INFINITY, 6)];

/// The quadrature rules.
struct Rules {
    /// One for each of [`POINTS`]: offset in px and weight; the weights add up to 1.
    pixel: [Vec<[f64; 2]>; POINTS.len()],
    correlation: [GaussLegendre; Correlation::RULES],
}

impl Rules {
    fn new() -> Self {
        let pixel = POINTS.map(|(_, count)| {
            let rule = GaussLegendre::new(count);
            rule.0.iter().map(|[node, weight]| [node * 0.5, weight * 0.5]).collect()
        });
        Self { pixel, correlation: Correlation::rules() }
    }

    /// The rule for a side of a pixel that is this wide.
    #[inline]
    fn along(&self, width_sd: f64) -> &[[f64; 2]] {
        let mut index = 0;
        while index + 1 < POINTS.len() && width_sd > POINTS[index].0 {
            index += 1;
        }
        &self.pixel[index]
    }
}

/// The part of the frame that a board and its blur can reach, [left, top, right, bottom), or `None`
/// when there is none.
fn bounds_px(lens: &Lens, psf_sigma_px: f64, placed: &PlacedBoard<'_>) -> Option<[usize; 4]> {
    let [left, top, right, bottom] = placed.board.paper_mm();
    let frame = [usize::from(lens.width_px), usize::from(lens.height_px)];
    let mut low = Vector2::repeat(f64::INFINITY);
    let mut high = Vector2::repeat(f64::NEG_INFINITY);
    // The lens bends the border: the deviation from a straight line between two of these samples is
    // far less than the pixels added below.
    const SAMPLES: usize = 16;
    for sample in 0..=SAMPLES {
        let t = sample as f64 / SAMPLES as f64;
        let (x, y) = (left + t * (right - left), top + t * (bottom - top));
        for [x, y] in [[x, top], [x, bottom], [left, y], [right, y]] {
            let point = placed.cam_from_target.transform(&Vector3::new(x, y, 0.0));
            if point.z < 1.0 {
                return None;
            }
            let ray = point.xy() / point.z;
            let (raw_px, raw_by_ray) = lens.raw_from_ray_with_jacobian(&ray);
            if raw_by_ray.determinant() <= 0.0 {
                // Beyond the lens's fold the outline is meaningless, so the whole frame is drawn.
                return Some([0, 0, frame[0], frame[1]]);
            }
            low = low.inf(&raw_px);
            high = high.sup(&raw_px);
        }
    }
    let reach_px = REACH_SD * psf_sigma_px + 2.0;
    let clamp = |value: f64, side: usize| value.clamp(0.0, side as f64) as usize;
    let bounds = [
        clamp(low.x - reach_px, frame[0]),
        clamp(low.y - reach_px, frame[1]),
        clamp((high.x + reach_px).ceil() + 1.0, frame[0]),
        clamp((high.y + reach_px).ceil() + 1.0, frame[1]),
    ];
    (bounds[0] < bounds[2] && bounds[1] < bounds[3]).then_some(bounds)
}

/// One axis of the lattice around one pixel: the lines that its blur can reach.
#[derive(Clone, Copy)]
struct Lines<'a> {
    /// The number of lines before those in reach: the index of the first cell.
    before: usize,
    lines_mm: &'a [f64],
}

impl<'a> Lines<'a> {
    #[inline]
    fn near(lines_mm: &'a [f64], value_mm: f64, reach_mm: f64) -> Self {
        // There are few lines, and usually none or one is in reach.
        let mut before = 0;
        while before < lines_mm.len() && lines_mm[before] < value_mm - reach_mm {
            before += 1;
        }
        let mut end = before;
        while end < lines_mm.len() && lines_mm[end] <= value_mm + reach_mm {
            end += 1;
        }
        Self { before, lines_mm: &lines_mm[before..end] }
    }

    /// Fills the standardised distances to the lines and the probabilities of the cells.
    fn probabilities(
        &self,
        cdf: NormalCdf,
        value_mm: f64,
        inverse_sd: f64,
        distances: &mut Vec<f64>,
        probabilities: &mut Vec<f64>,
    ) {
        distances.clear();
        probabilities.clear();
        let mut beyond = 1.0;
        for line in self.lines_mm {
            let distance = (value_mm - line) * inverse_sd;
            let past = cdf.at(distance);
            distances.push(distance);
            probabilities.push(beyond - past);
            beyond = past;
        }
        probabilities.push(beyond);
    }
}

/// Reusable buffers of one thread.
struct Scratch {
    h: Vec<f64>,
    k: Vec<f64>,
    x_probabilities: Vec<f64>,
    y_probabilities: Vec<f64>,
    correlation: Correlation,
}

impl Scratch {
    fn new() -> Self {
        Self {
            h: Vec::new(),
            k: Vec::new(),
            x_probabilities: Vec::new(),
            y_probabilities: Vec::new(),
            correlation: Correlation::none(),
        }
    }

    /// Prepares for a blur of this covariance.
    fn prepare(&mut self, covariance: &Matrix2<f64>, rules: &Rules) {
        let rho = covariance.m12 / (covariance.m11 * covariance.m22).sqrt();
        self.correlation.prepare(rho, &rules.correlation);
    }
}

/// A board in view.
struct Painter<'a> {
    optics: &'a Optics<'a>,
    board: &'a Board,
    map: PlaneMap,
    /// [left, top, right, bottom).
    bounds_px: [usize; 4],
}

impl Painter<'_> {
    /// Draws over the pixels of row `y`, which the board may not reach.
    fn row(&self, y: usize, pixels: &mut [f32], gain: &Gain<'_>, scratch: &mut Scratch) {
        let [left, top, right, bottom] = self.bounds_px;
        if !(top..bottom).contains(&y) {
            return;
        }
        let mut rays = RaysOfRow::new(self.optics.lens, left, y);
        for (column, pixel) in pixels.iter_mut().enumerate().take(right).skip(left) {
            let raw_px = Vector2::new(column as f64, y as f64);
            let Some((ray, ray_by_raw)) = rays.at(column) else { continue };
            let background = f64::from(*pixel);
            let gain = gain(raw_px.x, raw_px.y);
            if let Some(grey) = self.pixel(&ray, &ray_by_raw, background, gain, scratch) {
                *pixel = grey as f32;
            }
        }
    }

    /// The value of one pixel, or `None` where the board does not reach it.
    fn pixel(
        &self,
        ray: &Vector2<f64>,
        ray_by_raw: &Matrix2<f64>,
        background: f64,
        gain: f64,
        scratch: &mut Scratch,
    ) -> Option<f64> {
        let (centre_mm, mm_by_ray) = self.map.point_with_jacobian(ray);
        let mm_by_raw = mm_by_ray * ray_by_raw;
        // The blur around every point of the pixel: its deviation is at most that of both sides together.
        let sides_mm = Vector2::new(
            mm_by_raw.m11.abs() + mm_by_raw.m12.abs(),
            mm_by_raw.m21.abs() + mm_by_raw.m22.abs(),
        );
        let reach_mm = sides_mm * (REACH_SD * self.optics.psf_sigma_px + 0.5);
        let columns = Lines::near(&self.board.x_lines_mm, centre_mm.x, reach_mm.x);
        let rows = Lines::near(&self.board.y_lines_mm, centre_mm.y, reach_mm.y);
        let cell = |column: usize, row: usize| {
            self.board
                .cell(columns.before + column, rows.before + row)
                .map_or(background, |grey| grey * gain)
        };
        if columns.lines_mm.is_empty() && rows.lines_mm.is_empty() {
            return self.board.cell(columns.before, rows.before).map(|grey| grey * gain);
        }
        let cdf = NormalCdf::new();
        let covariance = mm_by_raw * mm_by_raw.transpose() * self.optics.psf_sigma_px.powi(2);
        let inverse_sd = Vector2::new(1.0 / covariance.m11.sqrt(), 1.0 / covariance.m22.sqrt());
        // By how much a coordinate changes along a side of the pixel.
        let change_sd = |axis, side| (mm_by_raw[(axis, side)] * inverse_sd[axis]).abs();
        let rules = &self.optics.rules;
        let of_axis = |axis| [rules.along(change_sd(axis, 0)), rules.along(change_sd(axis, 1))];
        let of_side = |side| rules.along(f64::max(change_sd(0, side), change_sd(1, side)));
        let first = cell(0, 0);
        let mean = match (columns.lines_mm, rows.lines_mm) {
            // Almost all others see only one edge or one corner.
            ([line], []) => {
                let across = cell(1, 0) - first;
                let past = |x_mm: f64| cdf.at((x_mm - line) * inverse_sd.x);
                let rules = of_axis(0);
                first + self.mean(ray, ray_by_raw, rules, |point_mm| across * past(point_mm.x))
            }
            ([], [line]) => {
                let down = cell(0, 1) - first;
                let past = |y_mm: f64| cdf.at((y_mm - line) * inverse_sd.y);
                let rules = of_axis(1);
                first + self.mean(ray, ray_by_raw, rules, |point_mm| down * past(point_mm.y))
            }
            ([x_line], [y_line]) => {
                scratch.prepare(&covariance, rules);
                let correlation = &scratch.correlation;
                let (across, down) = (cell(1, 0) - first, cell(0, 1) - first);
                let twist = cell(1, 1) - first - across - down;
                let rules = [of_side(0), of_side(1)];
                let mean = self.mean(ray, ray_by_raw, rules, |point_mm| {
                    let h = (point_mm.x - x_line) * inverse_sd.x;
                    let k = (point_mm.y - y_line) * inverse_sd.y;
                    let (past_x, past_y) = (cdf.at(h), cdf.at(k));
                    let both =
                        if twist == 0.0 { 0.0 } else { past_x * past_y + correlation.added(h, k) };
                    across * past_x + down * past_y + twist * both
                });
                first + mean
            }
            _ => {
                scratch.prepare(&covariance, rules);
                let rules = [of_side(0), of_side(1)];
                self.mean(ray, ray_by_raw, rules, |point_mm| {
                    let (h, k) = (&mut scratch.h, &mut scratch.k);
                    let (across, down) =
                        (&mut scratch.x_probabilities, &mut scratch.y_probabilities);
                    columns.probabilities(cdf, point_mm.x, inverse_sd.x, h, across);
                    rows.probabilities(cdf, point_mm.y, inverse_sd.y, k, down);
                    let mut sum = 0.0;
                    for (row, down) in down.iter().enumerate() {
                        for (column, across) in across.iter().enumerate() {
                            sum += across * down * cell(column, row);
                        }
                    }
                    for (row, k) in k.iter().enumerate() {
                        for (column, h) in h.iter().enumerate() {
                            let twist = cell(column, row) + cell(column + 1, row + 1)
                                - cell(column + 1, row)
                                - cell(column, row + 1);
                            if twist != 0.0 {
                                sum += twist * scratch.correlation.added(*h, *k);
                            }
                        }
                    }
                    sum
                })
            }
        };
        Some(mean)
    }

    /// The mean of a smooth function of the target's plane, mm, over the pixel's square, through
    /// the lens and the perspective.
    #[inline(always)]
    fn mean(
        &self,
        ray: &Vector2<f64>,
        ray_by_raw: &Matrix2<f64>,
        [x_rule, y_rule]: [&[[f64; 2]]; 2],
        mut value: impl FnMut(Vector2<f64>) -> f64,
    ) -> f64 {
        let centre = self.map.homogeneous(ray);
        let map = &self.map.plane_by_ray;
        let by_side = |x: f64, y: f64| {
            Vector3::new(
                map.m11 * x + map.m12 * y,
                map.m21 * x + map.m22 * y,
                map.m31 * x + map.m32 * y,
            )
        };
        let by_x = by_side(ray_by_raw.m11, ray_by_raw.m21);
        let by_y = by_side(ray_by_raw.m12, ray_by_raw.m22);
        let mut sum = 0.0;
        for [x_px, x_weight] in x_rule {
            let column = centre + by_x * *x_px;
            for [y_px, y_weight] in y_rule {
                let there = column + by_y * *y_px;
                let inverse = 1.0 / there.z;
                sum +=
                    x_weight * y_weight * value(Vector2::new(there.x * inverse, there.y * inverse));
            }
        }
        sum
    }
}

/// A ray, and its Jacobian with respect to the raw pixel.
type Ray = (Vector2<f64>, Matrix2<f64>);

/// The rays of a row's pixels, for columns that ascend: exact at every [`Self::STEP`]th, and the cubic
/// through these and their slopes in between. Its error is the ray's fourth derivative times
/// STEP^4 / 384, less than 1e-5 px in the corner of the wide-angle image of this module's head.
struct RaysOfRow<'a> {
    walk: RayWalk<'a>,
    y: usize,
    /// The column of `start`; `end` is [`Self::STEP`] further.
    first: usize,
    start: Option<Ray>,
    end: Option<Ray>,
}

impl<'a> RaysOfRow<'a> {
    const STEP: usize = 8;

    fn new(lens: &'a Lens, first: usize, y: usize) -> Self {
        let mut rays =
            Self { walk: RayWalk { lens, last: None }, y, first, start: None, end: None };
        rays.start = rays.exact(first);
        rays.end = rays.exact(first + Self::STEP);
        rays
    }

    fn exact(&mut self, column: usize) -> Option<Ray> {
        self.walk.to(&Vector2::new(column as f64, self.y as f64))
    }

    /// The ray of a column that is not before the last one asked for. `None` outside the lens's
    /// monotonic range.
    #[inline]
    fn at(&mut self, column: usize) -> Option<Ray> {
        while column >= self.first + Self::STEP {
            self.first += Self::STEP;
            self.start = self.end;
            self.end = self.exact(self.first + Self::STEP);
        }
        let (Some((start, start_by_raw)), Some((end, end_by_raw))) = (&self.start, &self.end)
        else {
            return self.exact(column);
        };
        const STEP: f64 = RaysOfRow::STEP as f64;
        let t = (column - self.first) as f64 / STEP;
        let cubic = |start: f64, start_slope: f64, end: f64, end_slope: f64| {
            let (rise, start_slope, end_slope) =
                (end - start, start_slope * STEP, end_slope * STEP);
            let square = 3.0 * rise - 2.0 * start_slope - end_slope;
            let cube = start_slope + end_slope - 2.0 * rise;
            start + (start_slope + (square + cube * t) * t) * t
        };
        let ray = Vector2::new(
            cubic(start.x, start_by_raw.m11, end.x, end_by_raw.m11),
            cubic(start.y, start_by_raw.m21, end.y, end_by_raw.m21),
        );
        Some((ray, start_by_raw + (end_by_raw - start_by_raw) * t))
    }
}

/// The rays of pixels, each computed from the one before.
struct RayWalk<'a> {
    lens: &'a Lens,
    /// With its raw pixel.
    last: Option<(Vector2<f64>, Ray)>,
}

impl RayWalk<'_> {
    fn to(&mut self, raw_px: &Vector2<f64>) -> Option<Ray> {
        // The linear prediction from some pixels away is off by far less than a pixel, and each Newton
        // step squares that error.
        let found = self.last.and_then(|(last_px, (ray, ray_by_raw))| {
            let mut ray = ray + ray_by_raw * (raw_px - last_px);
            for _ in 0..3 {
                let (value_px, raw_by_ray) = self.lens.raw_from_ray_with_jacobian(&ray);
                if raw_by_ray.determinant() <= 0.0 {
                    return None;
                }
                let ray_by_raw = raw_by_ray.try_inverse()?;
                let error_px = raw_px - value_px;
                ray += ray_by_raw * error_px;
                // Squared, and times the lens's curvature per pixel, the error is below 1e-8 px.
                if error_px.norm_squared() < 1e-6 {
                    return Some((ray, ray_by_raw));
                }
            }
            None
        });
        let found = found.or_else(|| {
            let ray = self.lens.ray_from_raw(raw_px)?;
            let (_, raw_by_ray) = self.lens.raw_from_ray_with_jacobian(&ray);
            Some((ray, raw_by_ray.try_inverse()?))
        });
        self.last = found.map(|ray| (*raw_px, ray));
        found
    }
}

#[cfg(test)]
mod tests;
