//! One picture of the demo: the sway path of both trunk points, measured over
//! true, and the depth error over time.

use std::ops::Range;
use std::path::Path;

use anyhow::{Result, anyhow};
use nalgebra::Vector3;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::figures::{Figures, TargetFigures, TrunkFigures};
use crate::palette::{BLUE, FONT, GRID, INK, ORANGE};

const SIZE_PX: (u32, u32) = (1080, 920);
const PATHS_HEIGHT_PX: u32 = 560;
const TRUTH: RGBColor = RGBColor(202, 208, 214);
const UPPER: RGBColor = BLUE;
const LOWER: RGBColor = ORANGE;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Draws the picture into an SVG file.
pub fn write(path: &Path, figures: &Figures) -> Result<()> {
    let remedy = |error: &dyn std::fmt::Display| {
        anyhow!("the plot {} cannot be written: {error}", path.display())
    };
    let root = SVGBackend::new(path, SIZE_PX).into_drawing_area();
    draw(&root, figures).map_err(|error| remedy(&error))?;
    root.present().map_err(|error| remedy(&error))
}

fn draw(root: &Area<'_>, figures: &Figures) -> Result<()> {
    root.fill(&WHITE)?;
    let (paths, depth) = root.split_vertically(PATHS_HEIGHT_PX);
    let panels = paths.split_evenly((1, 2));
    for ((panel, trunk), colour) in panels.iter().zip(&figures.trunk).zip([UPPER, LOWER]) {
        draw_path(panel, trunk, colour)?;
    }
    draw_depth(&depth, &figures.targets)
}

/// The same number of millimetres across and up, so that the shape is true.
fn draw_path(area: &Area<'_>, trunk: &TrunkFigures, colour: RGBColor) -> Result<()> {
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
        range.clone(),
        range,
        ("ML (mm), + to the right", "AP (mm), + forward"),
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
    legend(&mut chart, SeriesLabelPosition::UpperRight)
}

fn centre(trunk: &TrunkFigures) -> Vector3<f64> {
    let count: usize = trunk.true_mm.iter().map(Vec::len).sum();
    trunk.true_mm.iter().flatten().sum::<Vector3<f64>>() / count.max(1) as f64
}

fn draw_depth(area: &Area<'_>, targets: &[TargetFigures]) -> Result<()> {
    let errors = || targets.iter().flat_map(|target| &target.depth_error);
    let end_s = errors().fold(1.0_f64, |end, (time_s, _)| end.max(*time_s));
    let reach_mm = errors().fold(0.01_f64, |reach, (_, error)| reach.max(error.abs())) * 1.15;
    let mut chart = chart(
        area,
        "Error of the depth, frame by frame, unfiltered",
        0.0..end_s,
        -reach_mm..reach_mm,
        ("time (s)", "measured - true (mm)"),
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
    legend(&mut chart, SeriesLabelPosition::UpperRight)
}

fn chart<'a, 'b>(
    area: &Area<'b>,
    caption: &str,
    x: Range<f64>,
    y: Range<f64>,
    (x_name, y_name): (&str, &str),
) -> Result<Chart<'a, 'b>> {
    let mut chart = ChartBuilder::on(area)
        .caption(caption, (FONT, 19).into_font().color(&INK))
        .margin(16)
        .x_label_area_size(44)
        .y_label_area_size(58)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .max_light_lines(0)
        .bold_line_style(GRID)
        .axis_style(INK.mix(0.5))
        .label_style((FONT, 14).into_font().color(&INK))
        .axis_desc_style((FONT, 15).into_font().color(&INK))
        .x_desc(x_name)
        .y_desc(y_name)
        .x_label_formatter(&label)
        .y_label_formatter(&label)
        .draw()?;
    Ok(chart)
}

/// As few digits as the grid's values need; zero has no sign.
fn label(value: &f64) -> String {
    let hundredths = (value * 100.0).round() / 100.0;
    format!("{}", if hundredths == 0.0 { 0.0 } else { hundredths })
}

fn legend<'b: 'a, 'a>(chart: &mut Chart<'a, 'b>, position: SeriesLabelPosition) -> Result<()> {
    chart
        .configure_series_labels()
        .position(position)
        .background_style(WHITE.mix(0.85))
        .border_style(GRID)
        .label_font((FONT, 14).into_font().color(&INK))
        .margin(8)
        .draw()?;
    Ok(())
}
