//! Which parts of the volume were visited: three layers of depth, each as the camera sees it.

use nalgebra::Vector3;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plumbline_evidence::volume::{Coverage, PARTS, Volume};
use plumbline_files::BadInput;
use plumbline_report::drawing::svg;
use plumbline_report::palette::{BLUE, FONT, GREEN, GRID, INK, ORANGE};

/// Width of one layer's picture, and of what is between two.
const LAYER_PX: i32 = 340;
const BETWEEN_PX: i32 = 20;
/// Room for the title above.
const ABOVE_PX: i32 = 30;

/// The ends of each measured length, and how far each zone was visited.
///
/// # Errors
/// When it cannot be drawn.
pub fn coverage(
    volume: &Volume,
    coverage: &Coverage,
    ends_mm: &[[Vector3<f64>; 2]],
) -> Result<String, BadInput> {
    let lens = &volume.lens;
    let scale = f64::from(LAYER_PX) / f64::from(lens.width_px);
    let height_px = (scale * f64::from(lens.height_px)).round() as i32;
    let layers = PARTS as i32;
    let size = (layers * LAYER_PX + (layers + 1) * BETWEEN_PX, ABOVE_PX + height_px + BETWEEN_PX);
    let left = |layer: usize| BETWEEN_PX + layer as i32 * (LAYER_PX + BETWEEN_PX);
    svg((size.0 as u32, size.1 as u32), |root| {
        let [near, far] = volume.depth_mm;
        for layer in 0..PARTS {
            let [from, to] =
                [0, 1].map(|by| near + (far - near) * (layer + by) as f64 / PARTS as f64);
            let style = (FONT, 14).into_font().color(&INK).pos(Pos::new(HPos::Center, VPos::Top));
            let title = format!("{from:.0} to {to:.0} mm from the camera");
            root.draw(&Text::new(title, (left(layer) + LAYER_PX / 2, 8), style))?;
            for row in 0..PARTS {
                for column in 0..PARTS {
                    let x = |at: usize| left(layer) + LAYER_PX * at as i32 / layers;
                    let y = |at: usize| ABOVE_PX + height_px * at as i32 / layers;
                    let corners = [(x(column), y(row)), (x(column + 1), y(row + 1))];
                    let visits = coverage.visits[layer][row][column];
                    let (colour, share) = if visits > 0 { (GREEN, 0.25) } else { (ORANGE, 0.12) };
                    root.draw(&Rectangle::new(corners, colour.mix(share).filled()))?;
                    root.draw(&Rectangle::new(corners, GRID.stroke_width(1)))?;
                    let count = if visits > 0 { visits.to_string() } else { "none".to_owned() };
                    let place = (corners[0].0 + 6, corners[0].1 + 5);
                    root.draw(&Text::new(count, place, (FONT, 12).into_font().color(&INK)))?;
                }
            }
            let frame = [(left(layer), ABOVE_PX), (left(layer) + LAYER_PX, ABOVE_PX + height_px)];
            root.draw(&Rectangle::new(frame, INK.stroke_width(1)))?;
        }
        for end_mm in ends_mm.iter().flatten() {
            let (Some(zone), Some(pixel)) = (volume.zone(end_mm), lens.project(end_mm)) else {
                continue;
            };
            let [x, y] = [pixel.x, pixel.y].map(|px| (scale * (px + 0.5)).round() as i32);
            root.draw(&Circle::new((left(zone.layer) + x, ABOVE_PX + y), 3, BLUE.filled()))?;
        }
        Ok(())
    })
}
