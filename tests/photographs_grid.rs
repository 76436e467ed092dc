//! Grids on real photographs: each board is found, and no other shape is seen in it.

use plumbline_test_support::data;
use std::path::{Path, PathBuf};

use plumbline::image::GreyImage;
use plumbline::parts::{Corner, CornerList, Detector};
use plumbline::parts::{FrameBorder, Grid, GridFinder};
use plumbline::report::GridRejection;
use plumbline::target::GridShape;

/// Shapes that none of the boards has.
const OTHER_SHAPES: [(u8, u8); 7] = [(8, 6), (9, 5), (6, 5), (5, 4), (8, 5), (7, 6), (10, 7)];

fn photographs(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "png" || ending == "jpg"))
        .collect();
    paths.sort();
    paths
}

struct Picture {
    pixels: Vec<u8>,
    width: usize,
    height: usize,
}

impl Picture {
    fn read(path: &Path) -> Self {
        let image = image::open(path).unwrap().to_luma8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        Self { pixels: image.into_raw(), width, height }
    }

    fn crop(&self, [x, y]: [usize; 2], [width, height]: [usize; 2]) -> Self {
        let rows = (y..y + height).flat_map(|row| &self.pixels[row * self.width + x..][..width]);
        Self { pixels: rows.copied().collect(), width, height }
    }
}

struct Finder {
    detector: Box<Detector>,
    finder: Box<GridFinder>,
    corners: Box<CornerList>,
}

impl Finder {
    fn new() -> Self {
        Self {
            detector: Box::new(Detector::new()),
            finder: Box::new(GridFinder::new()),
            corners: Box::new(CornerList::new()),
        }
    }

    fn find(&mut self, picture: &Picture, shapes: &[(u8, u8)]) -> Vec<Result<Grid, GridRejection>> {
        let Picture { pixels, width, height } = picture;
        let image = GreyImage::new(pixels, *width, *height, *width).unwrap();
        self.corners.clear();
        self.detector.detect(&image, 0..*width, 0..*height, &mut self.corners);
        assert_eq!(self.corners.dropped(), 0);
        let wanted: Vec<_> =
            shapes.iter().map(|&(columns, rows)| GridShape { columns, rows }).collect();
        let mut found = vec![Err(GridRejection::NoLattice); wanted.len()];
        let border = FrameBorder::OutsideBoard;
        self.finder.find(&image, self.corners.as_slice(), &wanted, border, &mut found);
        found
    }

    fn corner(&self, grid: &Grid, index: usize) -> Corner {
        self.corners.as_slice()[usize::from(grid.corners[index].unwrap())]
    }
}

/// Finds the board in each photograph of a folder, whole and with no other shape.
#[track_caller]
fn find_all(folder: &str, count: usize, shape: (u8, u8)) {
    let Some(folder) = data(folder) else { return };
    let mut finder = Finder::new();
    let paths = photographs(&folder);
    assert_eq!(paths.len(), count, "photographs in {}", folder.display());
    for path in &paths {
        let picture = Picture::read(path);
        let mut shapes = vec![shape, (shape.1, shape.0)];
        shapes.extend(OTHER_SHAPES);
        let found = finder.find(&picture, &shapes);
        let grid = found[0].as_ref().unwrap_or_else(|why| panic!("{}: {why}", path.display()));
        assert!(grid.corners.iter().all(Option::is_some), "{}", path.display());
        // Turned by a quarter it is the same board.
        let turned = found[1].as_ref().unwrap_or_else(|why| panic!("{}: {why}", path.display()));
        let sorted = |grid: &Grid| {
            let mut corners: Vec<_> = grid.corners.iter().flatten().copied().collect();
            corners.sort_unstable();
            corners
        };
        assert_eq!(sorted(grid), sorted(turned), "{}", path.display());
        for (other, found) in shapes.iter().zip(&found).skip(2) {
            assert!(found.is_err(), "{}: {other:?} found too", path.display());
        }
        // An even sum: the x axis points to the right.
        if (shape.0 + shape.1).is_multiple_of(2) {
            let [first, last] =
                [0, usize::from(shape.0) - 1].map(|index| finder.corner(grid, index));
            assert!(last.position_px[0] > first.position_px[0], "{}", path.display());
        }
        // Nothing in what is left of the board, nor in a board that is cut.
        let xs: Vec<_> = grid
            .corners
            .iter()
            .flatten()
            .map(|&index| finder.corners.as_slice()[usize::from(index)].position_px[0] as usize)
            .collect();
        let (first, last) = (*xs.iter().min().unwrap(), *xs.iter().max().unwrap());
        for [x, width] in [[0, first], [last, picture.width - last], [0, (first + last) / 2]] {
            if width < 64 {
                continue;
            }
            let part = picture.crop([x, 0], [width, picture.height]);
            for (shape, found) in shapes.iter().zip(finder.find(&part, &shapes)) {
                assert!(found.is_err(), "{}: {shape:?} in columns from {x}", path.display());
            }
        }
    }
}

#[test]
fn all_boards_of_the_robot_are_found() {
    find_all("ur3a_cam1", 40, (9, 7));
}

#[test]
fn all_boards_of_the_repeated_pose_are_found() {
    find_all("ur3a_repeatability", 10, (9, 7));
}

#[test]
fn all_boards_held_by_hand_are_found() {
    find_all("opencv_left", 13, (9, 6));
}
