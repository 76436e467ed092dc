//! One picture of the demo: the sway path of both trunk points, measured over
//! true, and the depth error over time.

use std::path::Path;

use nalgebra::Vector3;
use plotters::prelude::*;
use plumbline_files::BadInput;
use plumbline_report::drawing::{Area, Drawn, chart, key, svg};
use plumbline_report::palette::{BLUE, FONT, INK, ORANGE};

use super::figures::{Figures, TargetFigures, TrunkFigures};

const SIZE_PX: (u32, u32) = (1080, 920);
const PATHS_HEIGHT_PX: u32 = 560;
const TRUTH: RGBColor = RGBColor(202, 208, 214);
const UPPER: RGBColor = BLUE;
const LOWER: RGBColor = ORANGE;

/// Draws the picture into an SVG file, in the place of the one that is there.
///
/// # Errors
/// When it cannot be drawn or written.
pub fn write(path: &Path, figures: &Figures) -> Result<(), BadInput> {
    let picture = svg(SIZE_PX, |root| {
        let (paths, depth) = root.split_vertically(PATHS_HEIGHT_PX);
        let panels = paths.split_evenly((1, 2));
        for ((panel, trunk), colour) in panels.iter().zip(&figures.trunk).zip([UPPER, LOWER]) {
            draw_path(panel, trunk, colour)?;
        }
        draw_depth(&depth, &figures.targets)
    })?;
    plumbline_files::replace(path, picture.as_bytes())
}

/// The same number of millimetres across and up, so that the shape is true.
fn draw_path(area: &Area<'_>, trunk: &TrunkFigures, colour: RGBColor) -> Drawn {
    let centre_mm = centre(trunk);
    let relative = |points: &[Vector3<f64>]| -> Vec<(f64, f64)> {
        points.iter().map(|p| (p[1] - centre_mm[1], p[0] - centre_mm[0])).collect()
    };
    let all = trunk.true_mm.iter().chain(&trunk.measured_mm).flat_map(|points| relative(points));
    let reach_mm = all.fold(1.0_f64, |reach, (x, y)| reach.max(x.abs()).max(y.abs())) * 1.08;
    let range = -reach_mm..reach_mm;
    let mut chart = chart(
        area,
        &format!("Sway of the {}", trunk.name),
        [range.clone(), range],
        ["ML (mm), + to the right", "AP (mm), + forward"],
    )?;
    let pairs = trunk.true_mm.iter().zip(&trunk.measured_mm);
    for (stretch, (true_mm, measured_mm)) in pairs.enumerate() {
        let styles = [
            (true_mm, "true", TRUTH.stroke_width(7)),
            (measured_mm, "measured", colour.stroke_width(2)),
        ];
        for (points, label, style) in styles {
            let line = chart.draw_series(LineSeries::new(relative(points), style))?;
            // One entry in the legend, however many gaps there are.
            if stretch == 0 {
                line.label(label)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], style));
            }
        }
    }
    if let Some(start) =
        trunk.measured_mm.first().and_then(|points| relative(points).first().copied())
    {
        chart.draw_series([Circle::new(start, 5, colour.filled())])?;
        let style = (FONT, 14).into_font().color(&INK);
        chart.draw_series([EmptyElement::at(start) + Text::new("start", (8, -14), style)])?;
    }
    key(&mut chart)
}

fn centre(trunk: &TrunkFigures) -> Vector3<f64> {
    let count: usize = trunk.true_mm.iter().map(Vec::len).sum();
    trunk.true_mm.iter().flatten().sum::<Vector3<f64>>() / count.max(1) as f64
}

fn draw_depth(area: &Area<'_>, targets: &[TargetFigures]) -> Drawn {
    let errors = || targets.iter().flat_map(|target| &target.depth_error);
    let end_s = errors().fold(1.0_f64, |end, (time_s, _)| end.max(*time_s));
    let reach_mm = errors().fold(0.01_f64, |reach, (_, error)| reach.max(error.abs())) * 1.15;
    let mut chart = chart(
        area,
        "Error of the depth, frame by frame, unfiltered",
        [0.0..end_s, -reach_mm..reach_mm],
        ["time (s)", "measured - true (mm)"],
    )?;
    // The larger error first, so that it does not cover the smaller one.
    let mut order: Vec<&TargetFigures> = targets.iter().collect();
    order.sort_by(|a, b| b.spread_mm.z.total_cmp(&a.spread_mm.z));
    for target in order {
        let colour = if target.name == "lumbar" { LOWER } else { UPPER };
        let label = format!("{}  \u{b1}{:.3} mm (1.96 SD)", target.name, target.spread_mm.z);
        chart
            .draw_series(LineSeries::new(
                target.depth_error.iter().copied(),
                colour.mix(0.8).stroke_width(1),
            ))?
            .label(label)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(2)));
    }
    key(&mut chart)
}
