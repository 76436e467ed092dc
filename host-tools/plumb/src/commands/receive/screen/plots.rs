//! The trunks from above, and over time, on the scale of the bars.

use plumbline_bedside::recording::{Movement, Seen, TRAIL_S, TrailPoint};
use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Points};
use ratatui::widgets::{Axis, Chart, Dataset, GraphType, Widget as _};

use super::bars;
use super::layout::Glyphs;

/// Beside its name, a trunk is told by its colour.
const COLOURS: [Color; 2] = [Color::Cyan, Color::Magenta];

const AP: usize = 0;
const ML: usize = 1;

/// Both trunks in the transverse plane: forward is up, the person's right is right. Where a trunk is
/// now stands the first letter of its name.
pub(super) fn from_above(seen: &Seen, area: Rect, buffer: &mut Buffer, glyphs: Glyphs) {
    let [title, plot] = Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(area);
    if plot.is_empty() || seen.movement.iter().all(|it| it.trail.is_empty()) {
        return;
    }
    let scale_mm = bars::scale_mm(&seen.movement);
    Line::from(format!("from above, +-{scale_mm} mm")).dim().render(title, buffer);
    // A row is about as high as two columns are wide.
    let aspect = f64::from(plot.width) / (2.0 * f64::from(plot.height));
    let (x_mm, y_mm) = (scale_mm * aspect.max(1.0), scale_mm * (1.0 / aspect).max(1.0));
    let trails: Vec<(&Movement, Vec<(f64, f64)>)> = seen
        .movement
        .iter()
        .map(|it| {
            (it, it.trail.iter().map(|at| (at.position_mm[ML], at.position_mm[AP])).collect())
        })
        .collect();
    Canvas::default()
        .marker(glyphs.marker)
        .x_bounds([-x_mm, x_mm])
        .y_bounds([-y_mm, y_mm])
        .paint(|context| {
            let grey = Color::DarkGray;
            context.draw(&Stroke::new(-x_mm, 0.0, x_mm, 0.0, grey));
            context.draw(&Stroke::new(0.0, -y_mm, 0.0, y_mm, grey));
            context.layer();
            for ((_, trail), color) in trails.iter().zip(COLOURS) {
                context.draw(&Points { coords: trail, color });
            }
            for ((movement, trail), color) in trails.iter().zip(COLOURS) {
                if let (Some((x, y)), Ok(_)) = (trail.last(), &movement.along) {
                    let letter = movement.trunk[..1].to_uppercase();
                    context.print(*x, *y, Line::from(letter).fg(color).bold());
                }
            }
        })
        .render(plot, buffer);
}

/// Each trunk over the last half minute: AP as a line, ML as dots.
pub(super) fn over_time(seen: &Seen, area: Rect, buffer: &mut Buffer, glyphs: Glyphs) {
    let halves = Layout::horizontal([Constraint::Fill(1); 2]).spacing(2).split(area);
    let scale_mm = bars::scale_mm(&seen.movement);
    for ((movement, color), half) in seen.movement.iter().zip(COLOURS).zip(halves.iter()) {
        let [title, plot] =
            Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(*half);
        if plot.is_empty() || movement.trail.is_empty() {
            continue;
        }
        let name = movement.trunk;
        let dots = if glyphs.marker == Marker::Braille { Marker::Dot } else { Marker::Custom('.') };
        Line::from(format!("{name}: AP line, ML dots")).dim().render(title, buffer);
        let along = |axis: usize| -> Vec<(f64, f64)> {
            let point = |at: &TrailPoint| (-at.ago_s, at.position_mm[axis]);
            movement.trail.iter().map(point).collect()
        };
        let (ap, ml) = (along(AP), along(ML));
        let ends = |low: String, high: String| [Line::from(low), Line::from("0"), Line::from(high)];
        let datasets = vec![
            Dataset::default().marker(dots).data(&ml),
            Dataset::default()
                .marker(glyphs.marker)
                .graph_type(GraphType::Line)
                .style(Style::new().fg(color))
                .data(&ap),
        ];
        Chart::new(datasets)
            .legend_position(None)
            .x_axis(
                Axis::default()
                    .bounds([-TRAIL_S, 0.0])
                    .labels([format!("-{TRAIL_S} s"), "now".to_owned()]),
            )
            .y_axis(
                Axis::default()
                    .bounds([-scale_mm, scale_mm])
                    .labels(ends(format!("-{scale_mm}"), format!("+{scale_mm} mm"))),
            )
            .render(plot, buffer);
    }
}
