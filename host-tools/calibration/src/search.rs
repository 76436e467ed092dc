//! The search of a photograph for checkerboards of known shapes.
//!
//! The core's detector looks at windows of a fixed number of pixels, which suit a frame in which
//! squares are small and edges sharp. Photographs of phones and webcams show squares of up to 250
//! px, and edges blurred by several pixels. So a photograph is searched at its own size and reduced
//! to a half, a quarter and an eighth, by the mean over whole blocks of pixels, and corners that
//! were found in a reduced one are located again in each finer one.
//!
//! The squares around a board may be cut by the frame's border, as long as all of its corners are
//! seen: a photograph stands for itself, and the number of corners is known.

use plumbline::image::{GreyImage, Pixel};
use plumbline::limits::FRAME_SIDE_PX_MIN;
use plumbline::parts::{Corner, CornerList, Detector, FrameBorder, Grid, GridFinder, refined};
use plumbline::pipeline::{FoundTarget, Measurable, Pipeline};
use plumbline::report::{GridRejection, Report};
use plumbline::target::GridShape;

/// How often a photograph is halved.
const HALVINGS_MAX: usize = 3;

/// Two grids are the same board, and a corner is where a grid predicts it, when they are no farther
/// apart than this share of the distance between neighbouring corners.
const APART_MAX: f32 = 0.25;

/// Largest angle between edges that run along the same line (sine): 25 degrees, as in the core.
const EDGE_SINE_MAX: f32 = 0.42;

/// A board found in a photograph.
#[derive(Debug, Clone)]
pub struct Found {
    /// The numbered grid; its indices refer to `corners`.
    pub grid: Grid,
    /// Corners, in pixels of the photograph.
    pub corners: Vec<Corner>,
}

/// The buffers of a search.
pub struct Search {
    detector: Box<Detector>,
    finder: Box<GridFinder>,
    corners: Box<CornerList>,
}

/// A photograph reduced by the mean over blocks of pixels.
struct Reduced {
    samples: Vec<u16>,
    width: usize,
    height: usize,
    white_level: u16,
}

impl Default for Search {
    fn default() -> Self {
        Self::new()
    }
}

impl Search {
    /// A search with empty buffers.
    #[must_use]
    pub fn new() -> Self {
        Self {
            detector: Box::new(Detector::new()),
            finder: Box::new(GridFinder::new()),
            corners: Box::new(CornerList::new()),
        }
    }

    /// The board of each wanted shape, or why there is none.
    pub fn find<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        wanted: &[GridShape],
    ) -> Vec<Result<Found, GridRejection>> {
        let mut reduced: Vec<Reduced> = Vec::new();
        for _ in 0..HALVINGS_MAX {
            let half = match reduced.last() {
                None => Reduced::half_of(image),
                Some(finer) => Reduced::half_of(&finer.view()),
            };
            reduced.extend(half);
        }
        // What was found at each size, in its own pixels.
        let mut sizes = vec![self.find_at_one_size(image, wanted)];
        sizes.extend(reduced.iter().map(|size| self.find_at_one_size(&size.view(), wanted)));
        // The same corners in pixels of the photograph.
        let corners: Vec<Vec<Corner>> = sizes
            .iter()
            .enumerate()
            .map(|(halvings, (corners, _))| {
                corners.iter().map(|corner| enlarged(corner, halvings)).collect()
            })
            .collect();
        let located = |halvings: usize, corner: &Corner| {
            let mut corner = *corner;
            for finer in (0..halvings).rev() {
                corner = enlarged(&corner, 1);
                let again = match finer.checked_sub(1) {
                    None => refined(image, &corner),
                    Some(place) => refined(&reduced[place].view(), &corner),
                };
                corner = again.unwrap_or(corner);
            }
            corner
        };
        let board = |place: usize| {
            let mut why = GridRejection::NoLattice;
            let mut boards: Vec<Found> = Vec::new();
            for (halvings, (seen, grids)) in sizes.iter().enumerate() {
                let grid = match &grids[place] {
                    Ok(grid) => grid.clone(),
                    Err(rejection) => {
                        why = why.max(*rejection);
                        continue;
                    }
                };
                let in_photograph = Found { grid, corners: corners[halvings].clone() };
                if corners.iter().any(|seen| goes_on(&in_photograph, seen)) {
                    why = why.max(GridRejection::GoesOn);
                    continue;
                }
                let corners = seen.iter().map(|corner| located(halvings, corner)).collect();
                boards.push(Found { corners, ..in_photograph });
            }
            only(boards).unwrap_or(Err(why))
        };
        (0..wanted.len()).map(board).collect()
    }

    /// The report on a photograph that stands for itself: the boards of the wanted shapes, which are
    /// those of the pipeline's targets in their order, searched here and measured by the pipeline.
    pub fn measure<P: Measurable>(
        &mut self,
        pipeline: &mut Pipeline,
        image: &GreyImage<'_, P>,
        wanted: &[GridShape],
        time_ns: u64,
    ) -> Report {
        let boards = self.find(image, wanted);
        let found: Vec<_> = boards
            .iter()
            .map(|board| match board {
                Ok(Found { grid, corners }) => Ok(FoundTarget { grid, corners }),
                Err(rejection) => Err(*rejection),
            })
            .collect();
        pipeline.step_found(image, time_ns, &found)
    }

    /// The corners, and the grids, in a photograph as it is.
    fn find_at_one_size<P: Pixel>(
        &mut self,
        image: &GreyImage<'_, P>,
        wanted: &[GridShape],
    ) -> (Vec<Corner>, Vec<Result<Grid, GridRejection>>) {
        self.corners.clear();
        self.detector.detect(image, 0..image.width(), 0..image.height(), &mut self.corners);
        let corners = self.corners.as_slice();
        let mut grids = vec![Err(GridRejection::NoLattice); wanted.len()];
        self.finder.find(image, corners, wanted, FrameBorder::MayCutBoard, &mut grids);
        (corners.to_vec(), grids)
    }
}

impl Reduced {
    /// Half the size, by the mean over 2 x 2 pixels; `None` when that would be too small for a
    /// picture.
    fn half_of<P: Pixel>(image: &GreyImage<'_, P>) -> Option<Self> {
        let [width, height] = [image.width() / 2, image.height() / 2];
        if width.min(height) < usize::from(FRAME_SIDE_PX_MIN) {
            return None;
        }
        let level = |pixel: P| -> u32 { pixel.into() };
        let mut samples = Vec::with_capacity(width * height);
        for row in 0..height {
            let (upper, lower) = (image.row(2 * row), image.row(2 * row + 1));
            let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            samples.extend(pairs.map(|(upper, lower)| {
                let sum: u32 = upper.iter().chain(lower).copied().map(level).sum();
                // The mean of four samples of 16 bits.
                ((sum + 2) / 4) as u16
            }));
        }
        Some(Self { samples, width, height, white_level: image.white_level() })
    }

    fn view(&self) -> GreyImage<'_, u16> {
        let Self { samples, width, height, white_level } = self;
        GreyImage::with_white_level(samples, *width, *height, *width, *white_level)
            .expect("its sides were checked")
    }
}

/// A corner of a picture that was halved `halvings` times, in pixels of the original: pixel 0 of
/// the half lies between pixels 0 and 1.
fn enlarged(corner: &Corner, halvings: usize) -> Corner {
    let scale = (1 << halvings) as f32;
    let position_px = corner.position_px.map(|px| (px + 0.5) * scale - 0.5);
    Corner { position_px, ..*corner }
}

/// The board, if all of these are the same one; the one from the largest picture. A whole board is
/// preferred to those of which a part is covered.
fn only(mut boards: Vec<Found>) -> Option<Result<Found, GridRejection>> {
    let is_whole = |found: &Found| {
        6 * found.grid.corners.iter().flatten().count() >= 5 * found.grid.corners.len()
    };
    if boards.iter().any(is_whole) {
        boards.retain(is_whole);
    }
    let first = boards.first()?;
    if boards.iter().all(|other| is_same_board(first, other)) {
        Some(Ok(boards.swap_remove(0)))
    } else {
        Some(Err(GridRejection::Ambiguous))
    }
}

impl Found {
    /// The corner at a place of the grid, if it was seen.
    fn corner(&self, column: usize, row: usize) -> Option<&Corner> {
        let place = row * usize::from(self.grid.shape.columns) + column;
        self.corners.get(usize::from((*self.grid.corners.get(place)?)?))
    }
}

fn is_same_board(one: &Found, other: &Found) -> bool {
    let [columns, rows] = [one.grid.shape.columns, one.grid.shape.rows].map(usize::from);
    let (mut same, mut both) = (0, 0);
    for row in 0..rows {
        for column in 0..columns {
            let Some((here, there)) = one.corner(column, row).zip(other.corner(column, row)) else {
                continue;
            };
            let besides = [
                (column > 0).then(|| one.corner(column - 1, row)),
                one.corner(column + 1, row).filter(|_| column + 1 < columns).map(Some),
            ];
            let Some(beside) = besides.into_iter().flatten().flatten().next() else { continue };
            both += 1;
            same += usize::from(distance(here, there) < APART_MAX * distance(here, beside));
        }
    }
    // The same places of two boards do not lie on each other.
    2 * same > both
}

/// Whether corners, found at any size, continue a board beyond at least half of one of its sides.
fn goes_on(found: &Found, seen: &[Corner]) -> bool {
    let [columns, rows] = [found.grid.shape.columns, found.grid.shape.rows].map(usize::from);
    let lines: [Vec<[[usize; 2]; 2]>; 4] = [
        (0..rows).map(|row| [[0, row], [1, row]]).collect(),
        (0..rows).map(|row| [[columns - 1, row], [columns - 2, row]]).collect(),
        (0..columns).map(|column| [[column, 0], [column, 1]]).collect(),
        (0..columns).map(|column| [[column, rows - 1], [column, rows - 2]]).collect(),
    ];
    lines.iter().any(|line| {
        let next = line.iter().filter(|[border, inner]| {
            let border = found.corner(border[0], border[1]);
            border.zip(found.corner(inner[0], inner[1])).is_some_and(|(border, inner)| {
                seen.iter().any(|corner| continues(inner, border, corner))
            })
        });
        2 * next.count() >= line.len()
    })
}

/// Whether a corner lies one step beyond another one, with the roles of its edges exchanged.
fn continues(inner: &Corner, border: &Corner, corner: &Corner) -> bool {
    let expected = [0, 1].map(|axis| 2.0 * border.position_px[axis] - inner.position_px[axis]);
    let expected = Corner { position_px: expected, ..*border };
    let sine = |one: usize, other: usize| (border.edges_rad[one] - corner.edges_rad[other]).sin();
    distance(&expected, corner) < APART_MAX * distance(inner, border)
        && sine(0, 1).abs() < EDGE_SINE_MAX
        && sine(1, 0).abs() < EDGE_SINE_MAX
}

fn distance(one: &Corner, other: &Corner) -> f32 {
    let [dx, dy] = [0, 1].map(|axis| one.position_px[axis] - other.position_px[axis]);
    dx.hypot(dy)
}
