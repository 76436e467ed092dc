//! The plots of the proofs, as SVG for a page.

use std::ops::Range;

use plotters::prelude::*;
use plumbline_evidence::repeatability::Steadiness;
use plumbline_evidence::step::Step;
use plumbline_evidence::uncertainty::Estimate;
use plumbline_files::BadInput;
use plumbline_report::drawing::{self, Chart, Drawn, chart, chart_of_decades, svg};
use plumbline_report::palette::{BLUE, GAP, GREEN, INK, ORANGE, SOFT};

const WIDE_PX: (u32, u32) = (1080, 240);
const HALF_PX: (u32, u32) = (540, 340);

/// More points than this are not seen in a plot, and make a page slow.
const POINTS_MAX: usize = 4000;

/// The colours of three coordinates.
const SERIES: [RGBColor; 3] = [BLUE, ORANGE, GREEN];

/// What lies between the smallest and the largest value, and a little more.
fn around(values: impl IntoIterator<Item = f64>) -> Range<f64> {
    let ends = values
        .into_iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), it| (low.min(it), high.max(it)));
    // What is all the same needs some room too.
    let more = (0.08 * (ends.1 - ends.0)).max(1e-6);
    ends.0 - more..ends.1 + more
}

/// One coordinate over time, with the line of its drift.
///
/// # Errors
/// When it cannot be drawn.
pub fn over_time(
    time_s: &[f64],
    values: &[f64],
    drift_in_all: &Estimate,
    name: &str,
    unit: &str,
) -> Result<String, BadInput> {
    let (first_s, last_s) = (time_s[0], time_s[time_s.len() - 1]);
    svg(WIDE_PX, |root| {
        let ranges = [first_s..last_s, around(values.iter().copied())];
        let mut chart = chart(root, "", ranges, ["time (s)", &format!("{name} ({unit})")])?;
        let step = values.len().div_ceil(POINTS_MAX);
        let points = time_s.iter().copied().zip(values.iter().copied()).step_by(step);
        chart.draw_series(LineSeries::new(points, BLUE.stroke_width(1)))?;
        let half = 0.5 * drift_in_all.value;
        line(&mut chart, [(first_s, -half), (last_s, half)], ORANGE)
    })
}

/// Allan deviations of some coordinates, both scales logarithmic; each with its noise if that
/// alone were there.
///
/// # Errors
/// When they cannot be drawn.
pub fn allan(coordinates: &[Steadiness], axis: &str) -> Result<String, BadInput> {
    let all = || coordinates.iter().flat_map(|it| &it.allan).filter(|it| it.deviation > 0.0);
    let fold = |start: f64, pick: fn(f64, f64) -> f64, of: fn(f64, f64) -> f64| {
        all().map(|it| of(it.part_s, it.deviation)).fold(start, pick)
    };
    let x = fold(f64::INFINITY, f64::min, |s, _| s)..fold(0.0, f64::max, |s, _| s);
    let y = 0.7 * fold(f64::INFINITY, f64::min, |_, it| it)..2.0 * fold(0.0, f64::max, |_, it| it);
    svg(HALF_PX, |root| {
        let mut chart = chart_of_decades(root, [x, y], ["length of the parts (s)", axis])?;
        for (it, colour) in coordinates.iter().zip(SERIES) {
            let points = it.allan.iter().filter(|it| it.deviation > 0.0);
            let points = points.map(|it| (it.part_s, it.deviation));
            chart
                .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
                .label(it.name)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2))
                });
            let frame_s = it.allan.first().map_or(1.0, |it| it.part_s);
            let white = it
                .allan
                .iter()
                .map(|point| (point.part_s, it.noise.sd * (frame_s / point.part_s).sqrt()));
            chart.draw_series(LineSeries::new(white, SOFT.stroke_width(1)))?;
        }
        drawing::key(&mut chart)
    })
}

/// A value of each position with U, over its number, and lines that bound it.
///
/// # Errors
/// When it cannot be drawn.
pub fn of_positions(values: &[Estimate], axis: &str, bounds: &[f64]) -> Result<String, BadInput> {
    let ends = values.iter().flat_map(|it| [-1.0, 1.0].map(|by| it.value + by * it.expanded()));
    svg(WIDE_PX, |root| {
        let x = 0.5..values.len() as f64 + 0.5;
        let y = around(ends.chain(bounds.iter().copied()));
        let mut chart = chart(root, "", [x.clone(), y], ["position", axis])?;
        for bound in bounds {
            line(&mut chart, [(x.start, *bound), (x.end, *bound)], ORANGE)?;
        }
        with_bars(&mut chart, values.iter().enumerate().map(|(at, it)| (at as f64 + 1.0, *it)))
    })
}

/// A value of each position with U, over an angle.
///
/// # Errors
/// When it cannot be drawn.
pub fn over_angle(points: &[(f64, Estimate)], names: [&str; 2]) -> Result<String, BadInput> {
    let ends =
        points.iter().flat_map(|(_, it)| [-1.0, 1.0].map(|by| it.value + by * it.expanded()));
    svg(HALF_PX, |root| {
        let x = around(points.iter().map(|it| it.0));
        let mut chart = chart(root, "", [x, around(ends)], names)?;
        with_bars(&mut chart, points.iter().copied())
    })
}

/// The height of the board over time, where it rested.
///
/// # Errors
/// When it cannot be drawn.
pub fn places(found: &Step, heights: &[(f64, f64)]) -> Result<String, BadInput> {
    let (first_s, last_s) = (heights[0].0, heights[heights.len() - 1].0);
    let rests =
        |time_s: f64| found.places.iter().any(|it| (it.from_s..=it.until_s).contains(&time_s));
    // Where it was carried does not matter, and may be far away.
    let rested = heights.iter().filter(|it| rests(it.0)).map(|it| it.1);
    let y = around(rested);
    svg(WIDE_PX, |root| {
        let ranges = [first_s..last_s, y.clone()];
        let mut chart = chart(root, "", ranges, ["time (s)", "height (mm)"])?;
        for place in &found.places {
            let corners = [(place.from_s, y.start), (place.until_s, y.end)];
            chart.draw_series([Rectangle::new(corners, GAP.mix(0.35).filled())])?;
        }
        let step = heights.len().div_ceil(POINTS_MAX);
        let dots = heights.iter().filter(|it| y.contains(&it.1)).step_by(step);
        chart.draw_series(dots.map(|it| Circle::new(*it, 1, BLUE.filled())))?;
        for place in &found.places {
            let mean = place.height_mm.value;
            line(&mut chart, [(place.from_s, mean), (place.until_s, mean)], ORANGE)?;
        }
        Ok(())
    })
}

fn line(chart: &mut Chart<'_, '_>, ends: [(f64, f64); 2], colour: RGBColor) -> Drawn {
    chart.draw_series([PathElement::new(ends, colour.stroke_width(2))])?;
    Ok(())
}

fn with_bars(
    chart: &mut Chart<'_, '_>,
    points: impl Iterator<Item = (f64, Estimate)> + Clone,
) -> Drawn {
    chart.draw_series(points.clone().map(|(x, it)| {
        let ends = [(x, it.value - it.expanded()), (x, it.value + it.expanded())];
        PathElement::new(ends, INK.stroke_width(1))
    }))?;
    chart.draw_series(points.map(|(x, it)| Circle::new((x, it.value), 3, BLUE.filled())))?;
    Ok(())
}
