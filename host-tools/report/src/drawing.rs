//! How plots are drawn: as SVG text, over a faint grid.

use std::ops::Range;

use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plumbline_files::BadInput;

use crate::palette::{FONT, GRID, INK};

/// Where a plot is drawn.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A plot with its axes.
pub type Chart<'a, 'b, A = RangedCoordf64> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<A, A>>;
/// What came of drawing.
pub type Drawn<T = ()> = Result<T, Box<dyn std::error::Error>>;

/// Size of the letters of an axis's values and inside a plot, px.
pub const LETTER_PX: u32 = 13;

/// Margin around a chart, px.
pub const MARGIN_PX: u32 = 10;

/// Width of the y axis's values and name, px: the plot begins this far right of the margin.
pub const LABELS_PX: u32 = 58;

/// A picture on white.
///
/// # Errors
/// When the drawing library fails.
pub fn svg(size_px: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<String, BadInput> {
    let mut text = String::new();
    let drawn = {
        let root = SVGBackend::with_string(&mut text, size_px).into_drawing_area();
        let filled = root.fill(&WHITE).map_err(Into::into);
        filled.and_then(|()| draw(&root)).and_then(|()| root.present().map_err(Into::into))
    };
    drawn.map_err(|error| BadInput::whole("a plot", error, "report it"))?;
    Ok(text)
}

/// A chart with its grid and the names of its axes; without a caption where that is empty.
///
/// # Errors
/// When the drawing library fails.
pub fn chart<'a, 'b: 'a>(
    area: &Area<'b>,
    caption: &str,
    [x, y]: [Range<f64>; 2],
    names: [&str; 2],
) -> Drawn<Chart<'a, 'b>> {
    let values = [labels(&x), labels(&y)];
    build(area, caption, check([x, y])?, names, [(7, &values[0]), (7, &values[1])])
}

/// A chart over named levels, which lie at 1, 2, 3 and so on.
///
/// # Errors
/// When the drawing library fails.
pub fn chart_of_levels<'a, 'b: 'a>(
    area: &Area<'b>,
    caption: &str,
    levels: &[String],
    y: Range<f64>,
    names: [&str; 2],
) -> Drawn<Chart<'a, 'b>> {
    let x = 0.5..levels.len() as f64 + 0.5;
    let name_of = |x: &f64| {
        let at = (1..=levels.len()).find(|at| *at as f64 == *x);
        at.map_or_else(String::new, |at| levels[at - 1].clone())
    };
    let values = labels(&y);
    // One more than there are, and the grid has no lines between them.
    build(area, caption, check([x, y])?, names, [(levels.len() + 1, &name_of), (7, &values)])
}

/// A chart whose axes are logarithmic, over ranges above 0.
///
/// # Errors
/// When the drawing library fails.
pub fn chart_of_decades<'a, 'b: 'a>(
    area: &Area<'b>,
    ranges: [Range<f64>; 2],
    names: [&str; 2],
) -> Drawn<Chart<'a, 'b, LogCoord<f64>>> {
    let ranges = check(ranges)?.map(|range| range.log_scale());
    let plain = |it: &f64| in_decade(*it).map_or_else(String::new, |(it, _)| it.to_string());
    let power = |it: &f64| in_decade(*it).map_or_else(String::new, |(_, text)| text);
    build(area, "", ranges, names, [(11, &plain), (11, &power)])
}

/// A value of a logarithmic axis, which has one digit, without its error of rounding and as a power
/// of ten. `None` but for 1, 2 and 5 of each decade: the others would stand too close together.
fn in_decade(value: f64) -> Option<(f64, String)> {
    let text = format!("{value:.0e}");
    text.starts_with(['1', '2', '5']).then(|| (text.parse().unwrap_or(value), text))
}

/// Checks that both ranges can be drawn.
fn check(ranges: [Range<f64>; 2]) -> Drawn<[Range<f64>; 2]> {
    // The library would search for the grid of such a range forever.
    let is_sound =
        |it: &Range<f64>| it.start.is_finite() && it.end.is_finite() && it.start < it.end;
    if !ranges.iter().all(is_sound) {
        return Err(format!("{:?} by {:?} is not an area to draw in", ranges[0], ranges[1]).into());
    }
    Ok(ranges)
}

/// The most values that an axis shows, and how each is written.
type Labels<'l> = (usize, &'l dyn Fn(&f64) -> String);

fn build<'a, 'b: 'a, R>(
    area: &Area<'b>,
    caption: &str,
    [x, y]: [R; 2],
    names: [&str; 2],
    [(x_labels, x_label), (y_labels, y_label)]: [Labels<'_>; 2],
) -> Drawn<Chart<'a, 'b, R::CoordDescType>>
where
    R: AsRangedCoord<Value = f64>,
    R::CoordDescType: ValueFormatter<f64>,
{
    let mut builder = ChartBuilder::on(area);
    if !caption.is_empty() {
        builder.caption(caption, (FONT, 15).into_font().color(&INK));
    }
    let mut chart = builder
        .margin(MARGIN_PX)
        .x_label_area_size(40)
        .y_label_area_size(LABELS_PX)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .max_light_lines(0)
        .bold_line_style(GRID)
        .axis_style(INK.mix(0.5))
        .label_style((FONT, LETTER_PX).into_font().color(&INK))
        .axis_desc_style((FONT, 14).into_font().color(&INK))
        .x_labels(x_labels)
        .y_labels(y_labels)
        .x_desc(names[0])
        .y_desc(names[1])
        .x_label_formatter(x_label)
        .y_label_formatter(y_label)
        .draw()?;
    Ok(chart)
}

/// The legend, in a corner of its own.
///
/// # Errors
/// When the drawing library fails.
pub fn key<'a, 'b: 'a, C: CoordTranslate>(
    chart: &mut ChartContext<'a, SVGBackend<'b>, C>,
) -> Drawn {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE)
        .border_style(GRID)
        .label_font((FONT, LETTER_PX).into_font().color(&INK))
        .draw()?;
    Ok(())
}

/// Values of an axis with as many digits as tell them apart; zero has no sign.
fn labels(range: &Range<f64>) -> impl Fn(&f64) -> String + use<> {
    // A grid has some seven lines, at round values.
    let step = (range.end - range.start) / 7.0;
    let decimals = step.log10().floor().clamp(-9.0, 0.0).abs() as i32;
    move |value| {
        let scale = 10_f64.powi(decimals + 1);
        format!("{}", (value * scale).round() / scale + 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_a_logarithmic_axis_have_one_digit_and_room() {
        assert_eq!(in_decade(0.1 + 0.1), Some((0.2, "2e-1".to_owned())));
        assert_eq!(in_decade(0.1 * 3.0), None);
        assert_eq!(in_decade(0.1 * 0.1), Some((0.01, "1e-2".to_owned())));
    }

    #[test]
    fn values_of_an_axis_are_told_apart_and_no_longer_than_that() {
        let of = |range: Range<f64>, values: [f64; 3]| values.map(|it| labels(&range)(&it));
        assert_eq!(of(0.0..150.0, [0.0, 50.0, 100.0]), ["0", "50", "100"]);
        assert_eq!(of(-1.2..1.2, [-0.4, -0.0, 0.4]), ["-0.4", "0", "0.4"]);
        assert_eq!(of(39.18..39.184, [39.18, 39.1805, 39.181]), ["39.18", "39.1805", "39.181"]);
    }
}
