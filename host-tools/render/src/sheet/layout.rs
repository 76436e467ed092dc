//! Where targets and legend go: on one sheet if they fit, otherwise each target on its
//! own, and a board that is larger than a sheet over several.

use plumbline_files::targets::{TargetDescription, to_toml};

use super::legend::{self, Legend};
use super::page::{EDGE_MM, Page, Paper, Rectangle, Shape};
use super::piece::{MARK_MM, Piece, mark};
use super::tiles::several_sheets;

/// Between targets, and between them and the legend, mm.
const GAP_MM: f64 = 3.0;

/// The sheets for these targets, printed with `pitch_mm`.
#[must_use]
pub fn sheets(descriptions: &[TargetDescription], pitch_mm: f64, paper: Paper) -> Vec<Page> {
    let pieces: Vec<Piece> =
        descriptions.iter().map(|description| Piece::new(description, pitch_mm)).collect();
    if pieces.len() > 1 {
        let names: Vec<&str> = descriptions.iter().map(|target| target.name.as_str()).collect();
        let title = format!("{}: pitch {pitch_mm} mm", names.join(" and "));
        let legend = Legend { title, entry: to_toml(descriptions) };
        if let Some(page) = one_sheet(&pieces, &legend, paper) {
            return vec![page];
        }
    }
    let alone = |(piece, description): (Piece, &TargetDescription)| {
        let entry = to_toml(std::slice::from_ref(description));
        let legend = Legend { title: piece.words(), entry };
        match one_sheet(std::slice::from_ref(&piece), &legend, paper) {
            Some(page) => vec![page],
            None => several_sheets(&piece, &legend, paper),
        }
    };
    pieces.into_iter().zip(descriptions).flat_map(alone).collect()
}

/// The pieces one above the other, with the legend below them or, turned, to their right.
fn one_sheet(pieces: &[Piece], legend: &Legend, paper: Paper) -> Option<Page> {
    let below = paper.upright_and_across_mm().into_iter().map(|size| below(pieces, legend, size));
    let beside = paper.upright_and_across_mm().into_iter().map(|size| beside(pieces, legend, size));
    below.chain(beside).flatten().next()
}

/// Width and height of the pieces one above the other.
fn stacked_mm(pieces: &[Piece]) -> [f64; 2] {
    let sizes = pieces.iter().map(Piece::size_mm);
    let gaps_mm = GAP_MM * (pieces.len() - 1) as f64;
    sizes.fold([0.0, gaps_mm], |[width, sum], size| [size[0].max(width), sum + size[1]])
}

/// The width that must stay free at an edge, minus the margin, which may lie there.
fn margin_edge_mm(pieces: &[Piece]) -> f64 {
    (EDGE_MM - pieces[0].pitch_mm).max(0.0)
}

/// The pieces in the middle of `room`, each with its cutting line if that line is within the
/// printable area.
fn stacked(pieces: &[Piece], room: &Rectangle, page_mm: [f64; 2]) -> Vec<Shape> {
    let [width, height] = stacked_mm(pieces);
    let x = room.corner[0] + (room.size[0] - width) / 2.0;
    let mut y = room.corner[1] + (room.size[1] - height) / 2.0;
    let printable =
        Rectangle { corner: [EDGE_MM; 2], size: page_mm.map(|side| side - 2.0 * EDGE_MM) };
    let mut shapes = Vec::new();
    for piece in pieces {
        let size = piece.size_mm();
        shapes.extend(piece.shapes().into_iter().map(|shape| shape.moved([x, y])));
        if printable.holds([x, y]) && printable.holds([x + size[0], y + size[1]]) {
            shapes.extend(piece.outline().map(|line| line.moved([x, y])));
        }
        y += size[1] + GAP_MM;
    }
    shapes
}

fn below(pieces: &[Piece], legend: &Legend, page_mm: [f64; 2]) -> Option<Page> {
    let side_mm = margin_edge_mm(pieces);
    let legend_top = page_mm[1] - EDGE_MM - legend.height_mm();
    let room = Rectangle {
        corner: [side_mm, EDGE_MM],
        size: [page_mm[0] - 2.0 * side_mm, legend_top - GAP_MM - EDGE_MM],
    };
    let [width, height] = stacked_mm(pieces);
    let legend_left = (page_mm[0] - legend::WIDTH_MM) / 2.0;
    if width > room.size[0] || height > room.size[1] || legend_left < EDGE_MM {
        return None;
    }
    let mut shapes = stacked(pieces, &room, page_mm);
    let place = |shape: Shape| shape.moved([legend_left, legend_top]);
    shapes.extend(legend.shapes().into_iter().map(place));
    Some(Page { size_mm: page_mm, shapes })
}

/// The legend reads upwards to the right of the pieces. If a strip does not fit above a piece, the
/// mark stands above the legend.
fn beside(pieces: &[Piece], legend: &Legend, page_mm: [f64; 2]) -> Option<Page> {
    let side_mm = margin_edge_mm(pieces);
    let legend_left = page_mm[0] - EDGE_MM - legend.height_mm();
    let mut pieces = pieces.to_vec();
    let mut top_mm = EDGE_MM;
    let fits = |pieces: &[Piece], top_mm: f64| {
        let [width, height] = stacked_mm(pieces);
        width <= legend_left - GAP_MM - side_mm && height <= page_mm[1] - top_mm - side_mm
    };
    let mut free_mm = page_mm[1] - 2.0 * EDGE_MM - legend::WIDTH_MM;
    if !fits(&pieces, top_mm) {
        let [piece] = &mut pieces[..] else { return None };
        piece.strip = false;
        top_mm = side_mm;
        free_mm -= MARK_MM[1] + GAP_MM;
    }
    if !fits(&pieces, top_mm) || free_mm < 0.0 {
        return None;
    }
    let room = Rectangle {
        corner: [side_mm, top_mm],
        size: [legend_left - GAP_MM - side_mm, page_mm[1] - top_mm - side_mm],
    };
    let mut shapes = stacked(&pieces, &room, page_mm);
    let place = |shape: Shape| shape.turned().moved([legend_left, page_mm[1] - EDGE_MM]);
    shapes.extend(legend.shapes().into_iter().map(place));
    if !pieces[0].strip {
        shapes.extend(mark().into_iter().map(|shape| shape.moved([legend_left, EDGE_MM])));
    }
    Some(Page { size_mm: page_mm, shapes })
}
