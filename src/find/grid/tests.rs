//! Grids of rendered boards, and of corners that were taken away or moved.

extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::*;
use crate::find::corner::tests::{Board, detect, render, samples};
use crate::test_support::repetitions;

pub(super) mod drawn;
mod found;
mod judged;

const SIZE: [usize; 2] = [420, 300];
const SHAPES: [GridShape; 2] =
    [GridShape { columns: 6, rows: 5 }, GridShape { columns: 5, rows: 4 }];

fn lumbar(turn_rad: f64, tilt_rad: f64) -> Board {
    Board::new([6, 5], [130.0, 150.0], 22.0, turn_rad, tilt_rad, 0.02)
}

fn shoulder(turn_rad: f64, tilt_rad: f64) -> Board {
    Board::new([5, 4], [310.0, 140.0], 20.0, turn_rad, tilt_rad, 0.02)
}

struct Scene {
    bytes: Vec<u8>,
    corners: Vec<Corner>,
}

impl Scene {
    fn new(boards: &[Board], seed: u64) -> Self {
        Self::of(samples(&render(SIZE, boards, 0.5, 0.008, seed), SIZE[0], 0, 255))
    }

    fn of(bytes: Vec<u8>) -> Self {
        let corners = detect(&GreyImage::new(&bytes, SIZE[0], SIZE[1], SIZE[0]).unwrap());
        Self { bytes, corners: corners.as_slice().to_vec() }
    }

    fn image(&self) -> GreyImage<'_, u8> {
        GreyImage::new(&self.bytes, SIZE[0], SIZE[1], SIZE[0]).unwrap()
    }

    fn find(&self, wanted: &[GridShape]) -> Vec<Result<Grid, GridRejection>> {
        self.find_where(FrameBorder::OutsideBoard, wanted)
    }

    fn find_where(
        &self,
        border: FrameBorder,
        wanted: &[GridShape],
    ) -> Vec<Result<Grid, GridRejection>> {
        let mut found = std::vec![Err(GridRejection::NoLattice); wanted.len()];
        let mut finder = Box::new(GridFinder::new());
        finder.find(&self.image(), &self.corners, wanted, border, &mut found);
        found
    }

    fn index_at(&self, [x, y]: [f64; 2]) -> usize {
        let distance = |corner: &Corner| {
            let [cx, cy] = corner.position_px.map(f64::from);
            (cx - x).hypot(cy - y)
        };
        (0..self.corners.len())
            .min_by(|&a, &b| distance(&self.corners[a]).total_cmp(&distance(&self.corners[b])))
            .unwrap()
    }

    fn hide(&mut self, board: &Board, cells: &[[i32; 2]]) {
        for &[column, row] in cells {
            let index = self.index_at(board.corner_px(column, row));
            self.corners.remove(index);
        }
    }

    fn assert_is(&self, grid: &Result<Grid, GridRejection>, board: &Board) {
        let grid = grid.as_ref().unwrap();
        for row in 0..board.rows {
            for column in 0..board.columns {
                let place = (row * board.columns + column) as usize;
                let expected = self.index_at(board.corner_px(column, row));
                assert_eq!(grid.corners[place], Some(expected as u16), "{column} {row}");
            }
        }
    }
}

#[test]
fn boards_beside_each_other_on_one_sheet_are_two() {
    let at = |shape, x_px: f64| Board::new(shape, [x_px, 150.0], 22.0, 0.0, 0.0, 0.02);
    let scene = Scene::new(&[at([6, 5], 100.0), at([5, 4], 100.0 + 8.5 * 22.0)], 3);
    let found = scene.find(&SHAPES);
    assert!(found.iter().all(Result::is_ok), "{found:?}");
}

#[test]
fn both_targets_are_told_apart_and_numbered_in_any_attitude() {
    for (seed, turn_deg) in (0..360_u32).step_by(360 / repetitions(12)).enumerate() {
        let turn_rad = f64::from(turn_deg).to_radians();
        let tilt_rad = [0.0, 0.5, 0.9][seed % 3];
        let boards = [lumbar(turn_rad, tilt_rad), shoulder(turn_rad + 1.0, -tilt_rad)];
        let scene = Scene::new(&boards, seed as u64);
        let found = scene.find(&SHAPES);
        scene.assert_is(&found[0], &boards[0]);
        scene.assert_is(&found[1], &boards[1]);
    }
}

#[test]
fn other_dimensions_are_refused() {
    let scene = Scene::new(&[lumbar(0.2, 0.4)], 1);
    for columns in 3..10 {
        for rows in 3..10 {
            let found = &scene.find(&[GridShape { columns, rows }])[0];
            let same = [[6, 5], [5, 6]].contains(&[columns, rows]);
            assert_eq!(found.is_ok(), same, "{columns} x {rows}: {found:?}");
        }
    }
    let nothing = Scene::new(&[], 1);
    assert_eq!(nothing.find(&SHAPES)[0], Err(GridRejection::NoLattice));
}

#[test]
fn a_strap_may_leave_one_line_of_corners_on_each_side() {
    let pitch_px = 20.0;
    for (columns, rows) in [(5, 3), (5, 4), (6, 5)] {
        let board = Board::new([columns, rows], [210.0, 150.0], pitch_px, 0.0, 0.0, 0.0);
        let Scene { mut bytes, .. } = Scene::new(core::slice::from_ref(&board), 9);
        // From side to side of the frame, over all rows of corners but the first and the last. It
        // leaves most of the squares beside these.
        let [from, to] = [(0, 0.7), (rows - 1, -0.7)]
            .map(|(row, off)| (board.corner_px(0, row)[1] + off * pitch_px) as usize);
        bytes[from * SIZE[0]..to * SIZE[0]].fill(110);
        let scene = Scene::of(bytes);
        for other in 3..=7_u8 {
            let shape = GridShape { columns: columns as u8, rows: other };
            let found = &scene.find(&[shape])[0];
            let is_right = i32::from(other) == rows;
            assert_eq!(found.is_ok(), is_right, "{columns} x {rows}: {shape:?}, {found:?}");
            let Ok(grid) = found else { continue };
            for (place, corner) in grid.corners.iter().enumerate() {
                let (row, column) = (place as i32 / columns, place as i32 % columns);
                let is_seen = row == 0 || row == rows - 1;
                let expected = scene.index_at(board.corner_px(column, row)) as u16;
                assert_eq!(*corner, is_seen.then_some(expected), "{column} {row}");
            }
        }
    }
}

#[test]
fn something_dark_beside_the_margin_is_no_further_column() {
    let pitch_px = 22.0;
    let board = Board::new([5, 4], [210.0, 150.0], pitch_px, 0.0, 0.0, 0.0);
    let Scene { mut bytes, .. } = Scene::new(core::slice::from_ref(&board), 9);
    let [left, top] = board.corner_px(0, 0);
    let mut paint = |[u0, u1]: [f64; 2], [v0, v1]: [f64; 2], level: u8| {
        let along = |start: f64, from: f64, to: f64| {
            (start + from * pitch_px) as usize..(start + to * pitch_px) as usize
        };
        for y in along(top, v0, v1) {
            bytes[y * SIZE[0]..][along(left, u0, u1)].fill(level);
        }
    };
    // Behind the margin, half a square wide, something as bright as paper; and before that, where
    // the dark squares of a further column would end, something dark.
    paint([5.5, 8.0], [-2.0, 5.0], 191);
    for row in [-1.0, 1.0, 3.0] {
        paint([5.5, 6.0], [row, row + 1.0], 64);
    }
    let found = &Scene::of(bytes).find(&[GridShape { columns: 6, rows: 4 }])[0];
    assert!(found.is_err(), "{found:?}");
}

#[test]
fn a_symmetric_grid_points_to_the_right() {
    for turn_rad in [0.4, 0.4 + core::f64::consts::PI] {
        let board = Board::new([6, 4], [210.0, 150.0], 22.0, turn_rad, 0.0, 0.0);
        let scene = Scene::new(core::slice::from_ref(&board), 2);
        let grid = scene.find(&[GridShape { columns: 6, rows: 4 }])[0].clone().unwrap();
        let position =
            |place: usize| scene.corners[usize::from(grid.corners[place].unwrap())].position_px;
        assert!(position(5)[0] > position(0)[0], "{turn_rad}");
        assert!(position(18)[1] > position(0)[1], "{turn_rad}");
    }
}

#[test]
fn a_missing_corner_is_a_gap_and_a_missing_line_is_not_a_smaller_board() {
    let board = lumbar(0.3, 0.5);
    let whole = Scene::new(&[lumbar(0.3, 0.5)], 3);
    let with_hidden = |cells: &[[i32; 2]], wanted: GridShape| {
        let mut scene = Scene { bytes: whole.bytes.clone(), corners: whole.corners.clone() };
        scene.hide(&board, cells);
        scene.find(&[wanted])[0].clone()
    };
    let inner = with_hidden(&[[2, 2], [4, 3]], SHAPES[0]).unwrap();
    let gaps: Vec<_> = (0..30).filter(|&place| inner.corners[place].is_none()).collect();
    assert_eq!(gaps, [14, 22]);
    // A border line may lack one corner; two only because the board is seen to end at it.
    for cells in [&[[0, 0]][..], &[[1, 0], [3, 0]]] {
        let grid = with_hidden(cells, SHAPES[0]).unwrap();
        let gaps: Vec<_> = (0..30).filter(|&place| grid.corners[place].is_none()).collect();
        let hidden: Vec<_> =
            cells.iter().map(|[column, row]| (row * 6 + column) as usize).collect();
        assert_eq!(gaps, hidden);
    }
    // A line that was not detected: the squares beyond it are seen.
    let last_row: Vec<_> = (0..6).map(|column| [column, 4]).collect();
    let shorter = GridShape { columns: 6, rows: 4 };
    assert_eq!(with_hidden(&last_row, shorter), Err(GridRejection::GoesOn));
    // Nor when some of it is seen.
    assert!(with_hidden(&last_row[1..], shorter).is_err());
    assert!(with_hidden(&last_row[..4], shorter).is_err());
}

#[test]
fn a_corner_out_of_place_is_left_out() {
    let board = lumbar(0.3, 0.5);
    let mut scene = Scene::new(&[lumbar(0.3, 0.5)], 4);
    let index = scene.index_at(board.corner_px(3, 2));
    // Near enough to be taken for the lattice's, too far to be right.
    scene.corners[index].position_px[0] += 4.5;
    let grid = scene.find(&SHAPES)[0].clone().unwrap();
    assert_eq!(grid.corners[2 * 6 + 3], None);
    assert_eq!(grid.corners.iter().flatten().count(), 29);
}

#[test]
fn a_lattice_grows_from_any_corner_and_never_into_another_board() {
    // Upright and in line, so that a border corner looks straight at the other board.
    let boards = [lumbar(0.0, 0.0), shoulder(0.0, 0.0)];
    let mut scene = Scene::new(&boards, 5);
    for strongest in 0..scene.corners.len() {
        let score = scene.corners[strongest].score;
        scene.corners[strongest].score = 1.0;
        let found = scene.find(&SHAPES);
        scene.assert_is(&found[0], &boards[0]);
        scene.assert_is(&found[1], &boards[1]);
        scene.corners[strongest].score = score;
    }
}

#[test]
fn two_boards_of_one_shape_are_ambiguous() {
    let boards = [shoulder(0.1, 0.0), Board::new([5, 4], [120.0, 140.0], 20.0, 0.4, 0.3, 0.0)];
    let scene = Scene::new(&boards, 5);
    assert_eq!(scene.find(&SHAPES)[1], Err(GridRejection::Ambiguous));
    assert_eq!(scene.find(&SHAPES)[0], Err(GridRejection::OtherDimensions));
}

#[test]
fn a_board_cut_by_the_frame_is_never_a_smaller_one() {
    // A 6 x 5 board slides out over the corner: at some place 5 x 4 corners are left.
    for step in (0..14).step_by(14 / repetitions(14)) {
        let middle = [60.0 - 4.0 * f64::from(step), 50.0 - 4.0 * f64::from(step)];
        let board = Board::new([6, 5], middle, 22.0, 0.02, 0.0, 0.0);
        let scene = Scene::new(&[board], 6);
        for found in scene.find(&[
            SHAPES[1],
            GridShape { columns: 5, rows: 5 },
            GridShape { columns: 6, rows: 4 },
        ]) {
            assert!(found.is_err(), "{step}");
        }
    }
}

#[test]
fn a_frame_that_cuts_the_columns_squares_hides_no_row() {
    // The corners of column 0 can be detected; one more column to their left could not.
    let shape = GridShape { columns: 6, rows: 4 };
    let board = Board::new([6, 4], [12.0 + 2.5 * 22.0, 150.0], 22.0, 0.0, 0.0, 0.0);
    let scene = Scene::new(core::slice::from_ref(&board), 10);
    let beside = |other| scene.find_where(FrameBorder::MayCutBoard, &[shape, other]).swap_remove(0);
    scene.assert_is(&beside(GridShape { columns: 6, rows: 5 }), &board);
    let longer = beside(GridShape { columns: 7, rows: 4 });
    assert_eq!(longer, Err(GridRejection::Cut));
    assert_eq!(scene.find(&[shape])[0], Err(GridRejection::Cut));
}

#[test]
fn squares_go_on_beyond_a_line_inside_a_board_and_not_beyond_its_border() {
    for (seed, turn_deg) in (0..360_u32).step_by(360 / repetitions(12)).enumerate() {
        let (turn_rad, tilt_rad) = (f64::from(turn_deg).to_radians(), [0.0, 0.5, 0.9][seed % 3]);
        let board = Board::new([8, 6], [210.0, 150.0], 20.0, turn_rad, tilt_rad, 0.02);
        let scene = Scene::new(core::slice::from_ref(&board), seed as u64);
        let (image, corners) = (scene.image(), &scene.corners[..]);
        let mut lattice = Box::new(Lattice::new());
        lattice.start(corners);
        let middle = scene.index_at(board.corner_px(3, 3)) as u16;
        let bounds = lattice.grow(corners, middle, Least::Target).unwrap();
        for border in bounds.borders() {
            let smaller = bounds.without(&border).unwrap();
            let mut lines = smaller.borders().into_iter();
            let inner = lines.find(|line| line.outwards == border.outwards).unwrap();
            let goes_on = |line| beyond::squares_go_on(&image, &lattice, corners, line);
            let outwards = border.outwards;
            assert!(goes_on(&inner), "{turn_deg} degrees, inside, {outwards:?}");
            assert!(!goes_on(&border), "{turn_deg} degrees, at the border, {outwards:?}");
        }
    }
}

#[test]
fn hostile_corners_are_survived() {
    let scene = Scene::new(&[], 7);
    let image = scene.image();
    let mut random = crate::find::corner::tests::Random(8);
    let mut finder = Box::new(GridFinder::new());
    let corner = |position_px, angle: f32| Corner {
        position_px,
        score: 0.1,
        edges_rad: [angle, angle + 1.0],
    };
    let same: Vec<_> = (0..CORNERS_MAX + 10).map(|_| corner([50.0, 50.0], 0.5)).collect();
    let nan: Vec<_> = (0..40).map(|_| corner([f32::NAN, f32::INFINITY], f32::NAN)).collect();
    let scattered: Vec<_> = (0..CORNERS_MAX)
        .map(|_| {
            let position = [random.next() * 400.0, random.next() * 300.0].map(|value| value as f32);
            corner(position, random.next() as f32 * 2.0)
        })
        .collect();
    for corners in [&same[..], &nan, &scattered, &[]] {
        let mut found = [const { Err(GridRejection::NoLattice) }; 2];
        finder.find(&image, corners, &SHAPES, FrameBorder::OutsideBoard, &mut found);
        assert!(found.iter().all(Result::is_err));
    }
}
