//! A board larger than a sheet, printed on several overlapping sheets, with instructions for
//! putting them together.

use super::legend::{self, Legend};
use super::page::{EDGE_MM, Font, Page, Paper, Rectangle, Shape, Stroke};
use super::piece::Piece;

/// The space for marks around the part of the board on a sheet, mm.
const FRAME_MM: f64 = EDGE_MM + 6.0;
/// The width of the part of the board that neighbouring sheets share, mm.
const OVERLAP_MM: f64 = 10.0;

const STEPS: [&str; 4] = [
    "1. Where a sheet has dashed marks at its left or upper edge, cut that edge off from mark to mark.",
    "2. Begin with A1. Lay each sheet over its neighbours' edges, up to the short black marks there,",
    "    so that the squares go on without a step. Glue all to one plate that is flat and stiff.",
    "3. Measure the pitch across several sheets.",
];

/// The part of the board on one sheet.
struct Tile {
    /// The part, from the board's top left corner, mm.
    part: Rectangle,
    /// `B3`: second row, third column.
    name: String,
    neighbours: Neighbours,
}

/// A sheet with the legend, then the parts of the board row by row.
#[must_use]
pub fn several_sheets(piece: &Piece, legend: &Legend, paper: Paper) -> Vec<Page> {
    let [upright, across] =
        paper.upright_and_across_mm().map(|page_mm| (page_mm, tiles(piece.size_mm(), page_mm)));
    let (page_mm, tiles) = if across.1.len() < upright.1.len() { across } else { upright };
    let board: Vec<Shape> = piece.shapes().into_iter().chain(piece.outline()).collect();
    let sheet = |tile: &Tile| {
        let to_page = tile.part.corner.map(|at| FRAME_MM - at);
        let part = board.iter().filter_map(|shape| shape.within(&tile.part));
        let mut shapes: Vec<Shape> = part.map(|shape| shape.moved(to_page)).collect();
        let window = Rectangle { corner: [FRAME_MM; 2], size: tile.part.size };
        shapes.extend(tile.neighbours.marks(&window));
        let base = [window.corner[0] + 6.0, window.end()[1] + 4.5];
        let text = format!("Sheet {} of {}", tile.name, legend.title);
        shapes.push(Shape::text(base, 2.3, Font::Regular, text));
        Page { size_mm: page_mm, shapes }
    };
    let first = first_sheet(legend, &tiles, paper);
    std::iter::once(first).chain(tiles.iter().map(sheet)).collect()
}

fn tiles(board_mm: [f64; 2], page_mm: [f64; 2]) -> Vec<Tile> {
    // The number of equal parts along each axis, and the distance from one to the next.
    let axis = |axis: usize| {
        let window_mm = page_mm[axis] - 2.0 * FRAME_MM;
        let count = ((board_mm[axis] - OVERLAP_MM) / (window_mm - OVERLAP_MM)).ceil().max(1.0);
        (count as usize, (board_mm[axis] - OVERLAP_MM) / count)
    };
    let ((columns, step_x), (rows, step_y)) = (axis(0), axis(1));
    let tile = |row: usize, column: usize| Tile {
        part: Rectangle {
            corner: [column as f64 * step_x, row as f64 * step_y],
            size: [step_x + OVERLAP_MM, step_y + OVERLAP_MM],
        },
        // The letters run out only beyond the number of sheets that can be printed.
        name: format!("{}{}", ('A'..='Z').nth(row).unwrap_or('Z'), column + 1),
        neighbours: Neighbours {
            left: column > 0,
            above: row > 0,
            right: column + 1 < columns,
            below: row + 1 < rows,
        },
    };
    (0..rows)
        .flat_map(|row| (0..columns).map(move |column| (row, column)))
        .map(|(row, column)| tile(row, column))
        .collect()
}

/// The legend, and instructions for putting the sheets together.
fn first_sheet(legend: &Legend, tiles: &[Tile], paper: Paper) -> Page {
    let [width, height] = paper.size_mm();
    let left = (width - legend::WIDTH_MM) / 2.0;
    let top = 2.0 * EDGE_MM;
    let mut shapes: Vec<Shape> =
        legend.shapes().into_iter().map(|shape| shape.moved([left, top])).collect();

    let left = left + legend::INDENT_MM;
    let mut base = top + legend.height_mm() + 16.0;
    shapes.push(Shape::text([left, base], 3.3, Font::Bold, "Putting the sheets together"));
    for step in STEPS {
        base += if step.starts_with(' ') { 4.4 } else { 5.2 };
        shapes.push(Shape::text([left, base], 3.0, Font::Regular, step));
    }

    let map_top = base + 8.0;
    let room_mm = [width - 2.0 * left, height - EDGE_MM - map_top];
    let end = |axis: usize| tiles.iter().map(|tile| tile.part.end()[axis]).fold(0.0, f64::max);
    let scale = (room_mm[0] / end(0)).min(room_mm[1] / end(1)).min(0.3);
    for tile in tiles {
        let [x, y] = tile.part.corner;
        let size = tile.part.size.map(|side| side * scale);
        let corner = [left + x * scale, map_top + y * scale];
        shapes.extend(Rectangle { corner, size }.border(Stroke::Fine));
        let middle = [corner[0] + size[0] / 2.0 - 2.5, corner[1] + size[1] / 2.0 + 1.3];
        shapes.push(Shape::text(middle, 3.6, Font::Bold, &tile.name));
    }
    Page { size_mm: [width, height], shapes }
}

/// On which sides of a part of the board there are more parts.
struct Neighbours {
    left: bool,
    above: bool,
    right: bool,
    below: bool,
}

impl Neighbours {
    /// Dashed lines where to cut, and short fine marks where the neighbour's cut edge is placed.
    fn marks(&self, window: &Rectangle) -> Vec<Shape> {
        let ([left, top], [right, bottom]) = (window.corner, window.end());
        // Marks end before the board's image, which must stay clean.
        let (near, far) = (0.5, FRAME_MM - EDGE_MM);
        let across = |x: f64, stroke| {
            [[top - far, top - near], [bottom + near, bottom + far]]
                .map(|[from, to]| Shape::Line { ends: [[x, from], [x, to]], stroke })
        };
        let along = |y: f64, stroke| {
            [[left - far, left - near], [right + near, right + far]]
                .map(|[from, to]| Shape::Line { ends: [[from, y], [to, y]], stroke })
        };
        let mut marks = Vec::new();
        if self.left {
            marks.extend(across(left, Stroke::Cut));
        }
        if self.above {
            marks.extend(along(top, Stroke::Cut));
        }
        if self.right {
            marks.extend(across(right - OVERLAP_MM, Stroke::Fine));
        }
        if self.below {
            marks.extend(along(bottom - OVERLAP_MM, Stroke::Fine));
        }
        marks
    }
}
