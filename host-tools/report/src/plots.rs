//! The plots of a trial and of a study, as SVG for a page.

use std::ops::Range;

use plotters::prelude::*;
use plumbline_analysis::series::{Axis, Plane, Series};
use plumbline_analysis::statistics::inference::{Cell, Inference};
use plumbline_analysis::sway::spectrum::power_density;
use plumbline_files::BadInput;

use crate::drawing::{
    self, LABELS_PX, LETTER_PX, MARGIN_PX, chart, chart_of_decades, chart_of_levels, svg,
};
use crate::labels::{self, LANE_PX};
use crate::palette::{FONT, GAP, INK, SERIES, SOFT};

/// What is in no bin.
pub(crate) const OUTSIDE: RGBColor = SOFT;

/// More points than this are not seen in a plot, and make a page slow.
const POINTS_MAX: usize = 4000;

/// Parts of the spectrum that is shown, seconds.
const SPECTRUM_PART_S: f64 = 20.0;

const PLANE_PX: (u32, u32) = (360, 380);
const SERIES_PX: (u32, u32) = (1080, 240);
const SPECTRUM_PX: (u32, u32) = (540, 340);

/// A gap is drawn this wide at least: one frame of a minute would not be seen.
const GAP_PX_MIN: f64 = 2.0;

/// Height of the band of a time bin, px.
const BAND_PX: i32 = 4;

/// The outline of an ellipse is drawn with this many lines.
const ELLIPSE_LINES: u32 = 180;

/// A moment that is drawn as a line over the time.
pub(crate) struct Event {
    /// Seconds from t = 0.
    pub time_s: f64,
    /// Its name.
    pub label: String,
}

/// An ellipse in a plane.
pub(crate) struct Outline {
    /// Its centre along the plane's axes, mm.
    pub centre_mm: [f64; 2],
    /// Its longer and its shorter semi-axis, mm.
    pub semi_axes_mm: [f64; 2],
    /// From the plane's first axis to the longer semi-axis, towards the second axis.
    pub angle_rad: f64,
}

impl Outline {
    /// Points around it, the last of which is the first.
    fn points_mm(&self) -> impl Iterator<Item = [f64; 2]> {
        let [major_mm, minor_mm] = self.semi_axes_mm;
        let (sin, cos) = self.angle_rad.sin_cos();
        (0..=ELLIPSE_LINES).map(move |at| {
            let turn = std::f64::consts::TAU * f64::from(at) / f64::from(ELLIPSE_LINES);
            let (along, across) = (major_mm * turn.cos(), minor_mm * turn.sin());
            let [x, y] = self.centre_mm;
            [x + along * cos - across * sin, y + along * sin + across * cos]
        })
    }
}

/// The colour of a bin; after as many bins as there are colours they come again.
pub(crate) fn colour(bin: usize) -> RGBColor {
    SERIES[bin % SERIES.len()]
}

/// The path in a plane, about its middle, coloured by the time bins, and an ellipse around it:
/// `None` where an axis of the plane was not measured.
///
/// # Errors
/// When it cannot be drawn.
pub(crate) fn path(
    series: &Series,
    plane: Plane,
    bins_s: &[Range<f64>],
    ellipse: Option<&Outline>,
) -> Result<Option<String>, BadInput> {
    // Up is upwards and to the right is to the right; seen from the side, forward is to the right.
    let [first, second] = plane.axes();
    let is_turned = plane == Plane::Transverse;
    let (across, up) = if is_turned { (second, first) } else { (first, second) };
    let (Some(x), Some(y)) = (series.along(across), series.along(up)) else { return Ok(None) };
    let outline: Vec<(f64, f64)> = ellipse
        .iter()
        .flat_map(|it| it.points_mm())
        .map(|[first, second]| if is_turned { (second, first) } else { (first, second) })
        .collect();
    let with = |values: &[f64], more: fn(&(f64, f64)) -> f64| {
        let ends = outline.iter().map(more);
        range(&values.iter().copied().chain(ends).collect::<Vec<f64>>())
    };
    let (x_range, y_range) = (with(x, |it| it.0), with(y, |it| it.1));
    let reach = 0.54 * (x_range.end - x_range.start).max(y_range.end - y_range.start).max(0.02);
    let middle = |range: &Range<f64>| 0.5 * (range.start + range.end);
    let (x_middle, y_middle) = (middle(&x_range), middle(&y_range));
    svg(PLANE_PX, |root| {
        let names = [axis_name(across), axis_name(up)];
        let square = -reach..reach;
        let mut chart = chart(root, "", [square.clone(), square], [&names[0], &names[1]])?;
        let step = series.samples().div_ceil(POINTS_MAX);
        for segment in series.segments() {
            for (part, bin) in parts(&series.time_s()[segment.clone()], bins_s) {
                let part = segment.start + part.start..segment.start + part.end;
                let points = part.step_by(step).map(|at| (x[at] - x_middle, y[at] - y_middle));
                let colour = bin.map_or(OUTSIDE, colour);
                chart.draw_series(LineSeries::new(points, colour.stroke_width(1)))?;
            }
        }
        let outline = outline.iter().map(|(x, y)| (x - x_middle, y - y_middle));
        chart.draw_series(LineSeries::new(outline, INK.stroke_width(2)))?;
        Ok(())
    })
    .map(Some)
}

/// The runs of samples of one bin, each up to and with the first sample of the next, so that
/// lines meet.
fn parts(time_s: &[f64], bins_s: &[Range<f64>]) -> Vec<(Range<usize>, Option<usize>)> {
    let bin_of = |time_s: f64| bins_s.iter().position(|bin| bin.contains(&time_s));
    let mut parts = Vec::new();
    let mut start = 0;
    for at in 1..=time_s.len() {
        let bin = bin_of(time_s[start]);
        if at == time_s.len() || bin_of(time_s[at]) != bin {
            parts.push((start..(at + 1).min(time_s.len()), bin));
            start = at;
        }
    }
    parts
}

/// Position over time along one axis: gaps are grey, bins are coloured and have a band with their
/// times at the foot of the plot, events are lines with their labels above it, as far as there is
/// room.
///
/// # Errors
/// When it cannot be drawn.
pub(crate) fn over_time(
    series: &Series,
    axis: Axis,
    bins_s: &[Range<f64>],
    events: &[Event],
) -> Result<Option<String>, BadInput> {
    let Some(values) = series.along(axis) else { return Ok(None) };
    let time_s = series.time_s();
    let (first_s, last_s) = (time_s[0], time_s[time_s.len() - 1]);
    let values_range = range(values);
    let middle = 0.5 * (values_range.start + values_range.end);
    let reach = 0.56 * (values_range.end - values_range.start).max(0.02);
    // Below the positions there is room for the bins' times.
    let floor_mm = -1.25 * reach;
    let plot_px = (MARGIN_PX + LABELS_PX) as i32..(SERIES_PX.0 - MARGIN_PX) as i32;
    let s_per_px = (last_s - first_s) / f64::from(plot_px.end - plot_px.start);
    let events: Vec<&Event> =
        events.iter().filter(|it| (first_s..=last_s).contains(&it.time_s)).collect();
    let marks: Vec<(i32, &str)> = events
        .iter()
        .map(|it| (plot_px.start + ((it.time_s - first_s) / s_per_px) as i32, &*it.label))
        .collect();
    let labels = labels::place(&marks, plot_px);
    let above_px = LANE_PX * labels.iter().flatten().map(|it| it.lane + 1).max().unwrap_or(0);
    svg((SERIES_PX.0, SERIES_PX.1 + above_px as u32), |root| {
        let (_, below) = root.split_vertically(above_px);
        let ranges = [first_s..last_s, floor_mm..reach];
        let mut chart = chart(&below, "", ranges, ["time (s)", &axis_name(axis)])?;
        for gap in series.gaps_s() {
            let wider_s = 0.5 * (GAP_PX_MIN * s_per_px - (gap.end - gap.start)).max(0.0);
            let corners = [(gap.start - wider_s, floor_mm), (gap.end + wider_s, reach)];
            chart.draw_series([Rectangle::new(corners, GAP.filled())])?;
        }
        for segment in series.segments() {
            for (part, bin) in parts(&time_s[segment.clone()], bins_s) {
                let part = segment.start + part.start..segment.start + part.end;
                let points = envelope(&time_s[part.clone()], &values[part], series.samples());
                let points = points.into_iter().map(|(time_s, value)| (time_s, value - middle));
                let colour = bin.map_or(OUTSIDE, colour);
                chart.draw_series(LineSeries::new(points, colour.stroke_width(1)))?;
            }
        }
        let bands = bins_s.iter().enumerate().map(|(at, bin)| {
            let (start_s, end_s) = (bin.start.max(first_s), bin.end.min(last_s));
            (start_s..end_s, format!("{} to {} s", bin.start, bin.end), colour(at))
        });
        for (band_s, text, colour) in bands.filter(|(band_s, ..)| band_s.start < band_s.end) {
            let (left, floor) = chart.backend_coord(&(band_s.start, floor_mm));
            let (right, _) = chart.backend_coord(&(band_s.end, floor_mm));
            let band = [(left, floor - BAND_PX), (right, floor)];
            root.draw(&Rectangle::new(band, colour.filled()))?;
            if labels::width_px(&text) < right - left {
                let style = (FONT, LETTER_PX).into_font().color(&colour);
                let place = (left + BAND_PX, floor - BAND_PX - LANE_PX);
                root.draw(&Text::new(text, place, style))?;
            }
        }
        let style = (FONT, LETTER_PX).into_font().color(&INK);
        for ((event, (x, text)), label) in events.iter().zip(&marks).zip(&labels) {
            let (_, floor) = chart.backend_coord(&(event.time_s, floor_mm));
            let (_, ceiling) = chart.backend_coord(&(event.time_s, reach));
            let top = label.as_ref().map_or(ceiling, |it| MARGIN_PX as i32 + LANE_PX * it.lane);
            root.draw(&PathElement::new([(*x, top), (*x, floor)], INK.stroke_width(1)))?;
            if let Some(label) = label {
                root.draw(&Text::new((*text).to_owned(), (label.left_px, top), style.clone()))?;
            }
        }
        Ok(())
    })
    .map(Some)
}

/// Of many samples the lowest and the highest of each group, so that no peak is lost.
fn envelope(time_s: &[f64], values: &[f64], of: usize) -> Vec<(f64, f64)> {
    let group = (2 * of).div_ceil(POINTS_MAX).max(1);
    if group < 3 {
        return time_s.iter().copied().zip(values.iter().copied()).collect();
    }
    let mut points = Vec::new();
    for (times, values) in time_s.chunks(group).zip(values.chunks(group)) {
        let ends = values.iter().enumerate();
        let lowest = ends.clone().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |it| it.0);
        let highest = ends.max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |it| it.0);
        for at in [lowest.min(highest), lowest.max(highest)] {
            points.push((times[at], values[at]));
        }
    }
    points
}

/// Power spectral densities along the axes, both scales logarithmic; `None` for a series that is
/// too short.
///
/// # Errors
/// When it cannot be drawn.
pub(crate) fn spectrum(series: &Series) -> Result<Option<String>, BadInput> {
    let spectra: Vec<(Axis, Vec<(f64, f64)>)> = Axis::ALL
        .into_iter()
        .filter_map(|axis| {
            let density = power_density(series, axis, SPECTRUM_PART_S)?;
            let seen = density.into_iter().filter(|(_, density)| *density > 0.0).collect();
            Some((axis, seen))
        })
        .collect();
    let all = || spectra.iter().flat_map(|(_, density)| density);
    let (low, high) = all().fold((f64::MAX, 0.0_f64), |(low, high), (_, density)| {
        (low.min(*density), high.max(*density))
    });
    let last_hz = all().fold(0.0_f64, |last, (hz, _)| last.max(*hz));
    let first_hz = 1.0 / SPECTRUM_PART_S;
    if low >= high || last_hz <= first_hz {
        return Ok(None);
    }
    // What lies far below the rest is rounding.
    let ranges = [first_hz..last_hz, low.max(1e-12 * high)..2.0 * high];
    svg(SPECTRUM_PX, |root| {
        let names = ["frequency (Hz)", "density (mm²/Hz)"];
        let mut chart = chart_of_decades(root, ranges, names)?;
        for ((axis, density), colour) in spectra.iter().zip(SERIES) {
            chart
                .draw_series(LineSeries::new(density.iter().copied(), colour.stroke_width(2)))?
                .label(axis.word())
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2))
                });
        }
        drawing::key(&mut chart)
    })
    .map(Some)
}

/// Where an axis of values begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scale {
    /// At 0, for what is compared by its size.
    FromZero,
    /// Below the data, for what is never near 0.
    OfTheData,
}

/// The means of each condition over time, or of the conditions alone, with their standard errors;
/// `None` where there are none, as of one participant.
///
/// # Errors
/// When it cannot be drawn.
pub(crate) fn means(
    inference: &Inference,
    title: &str,
    axis: &str,
    scale: Scale,
) -> Result<Option<String>, BadInput> {
    // A named line for each condition over time; or one line over the conditions.
    let (names, along) = match &inference.factors[..] {
        [conditions, times] => (&conditions.levels[..], times),
        [conditions] => (&[][..], conditions),
        _ => {
            let found = "neither condition by time nor condition";
            return Err(BadInput::whole("a plot of the study", found, "report it"));
        }
    };
    let of = |cells: &[Cell]| -> Vec<(f64, f64, f64)> {
        let known = cells.iter().map(|cell| cell.normalised.known()).enumerate();
        let known = known.filter_map(|(at, it)| Some((at as f64 + 1.0, it?)));
        known.map(|(at, it)| (at, it.mean, it.sem)).collect()
    };
    let all: Vec<Vec<(f64, f64, f64)>> =
        inference.cells.chunks(along.levels.len()).map(of).collect();
    let ends = all.iter().flatten().flat_map(|(_, mean, sem)| [mean - sem, mean + sem]);
    let ends: Vec<f64> = ends.collect();
    if ends.is_empty() {
        return Ok(None);
    }
    let Range { start, end } = range(&ends);
    let start = match scale {
        Scale::FromZero => 0.0,
        Scale::OfTheData => start - 0.1 * (end - start),
    };
    // Above it is room for the key.
    let y = start..end + (0.35 * (end - start)).max(1e-3);
    svg(PLANE_PX, |root| {
        let mut chart = chart_of_levels(root, title, &along.levels, y, [&along.name, axis])?;
        // Side by side, so that no error bar covers another.
        let apart = 0.08;
        for (at, line) in all.iter().enumerate() {
            let shift = apart * (at as f64 - 0.5 * (all.len() as f64 - 1.0));
            let colour = colour(at);
            let points = line.iter().map(|(x, mean, _)| (x + shift, *mean));
            let drawn =
                chart.draw_series(LineSeries::new(points.clone(), colour.stroke_width(2)))?;
            if let Some(name) = names.get(at) {
                drawn.label(name).legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2))
                });
            }
            chart.draw_series(points.map(|point| Circle::new(point, 3, colour.filled())))?;
            chart.draw_series(line.iter().map(|(x, mean, sem)| {
                let bar = [(x + shift, mean - sem), (x + shift, mean + sem)];
                PathElement::new(bar, colour.stroke_width(2))
            }))?;
        }
        if names.is_empty() { Ok(()) } else { drawing::key(&mut chart) }
    })
    .map(Some)
}

fn axis_name(axis: Axis) -> String {
    let direction = match axis {
        Axis::Ap => "forward",
        Axis::Ml => "right",
        Axis::Si => "up",
    };
    format!("{} (mm), + {direction}", axis.word())
}

fn range(values: &[f64]) -> Range<f64> {
    let start = values.iter().copied().fold(f64::INFINITY, f64::min);
    let end = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    start..end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_meet_and_what_is_in_none_is_there_too() {
        let time_s = [-0.5, 0.0, 0.5, 1.0, 1.5, 2.0];
        let found = parts(&time_s, &[0.0..1.0, 1.0..2.0]);
        assert_eq!(found, [(0..2, None), (1..4, Some(0)), (3..6, Some(1)), (5..6, None)]);
    }

    #[test]
    fn no_peak_is_lost_of_a_long_series() {
        let time_s: Vec<f64> = (0..216_000).map(|at| f64::from(at) / 60.0).collect();
        let mut values = vec![0.0; time_s.len()];
        (values[777], values[200_001]) = (5.0, -7.0);
        let points = envelope(&time_s, &values, time_s.len());
        assert!(points.len() <= POINTS_MAX, "{}", points.len());
        for (at, value) in [(777, 5.0), (200_001, -7.0)] {
            assert!(points.contains(&(time_s[at], value)));
        }
    }
}
