//! Pictures of the agreement along one axis: the differences over the means, with bias and limits,
//! and the measurement over the reference, with the regression line.

use std::ops::Range;

use plotters::prelude::*;
use plumbline_analysis::agreement::AxisAgreement;
use plumbline_analysis::agreement::pairs::Pairs;
use plumbline_analysis::series::Axis;
use plumbline_files::BadInput;

use super::Validation;
use super::print::{equation, rounded};
use crate::drawing::{self, Area, Drawn};
use crate::palette::{BLUE, INK, ORANGE, for_light_and_dark};

/// Of one of the two pictures of an axis.
const SIZE_PX: (u32, u32) = (540, 380);

/// More dots would hide each other and take the viewer's memory: of more pairs each n-th is drawn.
const DOTS_MAX: usize = 2000;

/// A line by its ends, and how far it may be off upwards and downwards.
struct Rule {
    ends: [(f64, f64); 2],
    ci95: Option<[f64; 2]>,
    color: RGBColor,
}

/// All pictures in one file as SVG, a row for each axis.
///
/// # Errors
/// When the drawing library fails.
pub fn svg(validation: &Validation) -> Result<String, BadInput> {
    let rows = validation.axes.len();
    let (width, height) = (2 * SIZE_PX.0, SIZE_PX.1 * rows as u32);
    let text = drawing::svg((width, height), |root| {
        let areas = root.split_evenly((rows, 2));
        for (found, row) in validation.axes.iter().zip(areas.chunks(2)) {
            if let [left, right] = row {
                differences(left, validation, found)?;
                regression(right, validation, found)?;
            }
        }
        Ok(())
    })?;
    Ok(for_light_and_dark(&text))
}

/// The two pictures of one axis as SVG, for a page that has the colours of dark pages.
///
/// # Errors
/// When the drawing library fails.
pub(super) fn of_axis(
    validation: &Validation,
    found: &AxisAgreement,
) -> Result<[String; 2], BadInput> {
    Ok([
        drawing::svg(SIZE_PX, |root| differences(root, validation, found))?,
        drawing::svg(SIZE_PX, |root| regression(root, validation, found))?,
    ])
}

/// Reference and measurement along the axis, thinned out.
fn dots(validation: &Validation, found: &AxisAgreement) -> Vec<(f64, f64)> {
    let axis = Axis::ALL.into_iter().find(|axis| axis.word() == found.axis);
    let all = || validation.paired.iter().filter_map(|trial| trial.along(axis?));
    let count: usize = all().map(|it: &Pairs| it.reference_mm.len()).sum();
    all()
        .flat_map(|it| it.reference_mm.iter().copied().zip(it.measured_mm.iter().copied()))
        .step_by(count.div_ceil(DOTS_MAX).max(1))
        .collect()
}

fn differences(area: &Area<'_>, validation: &Validation, found: &AxisAgreement) -> Drawn {
    let dots: Vec<(f64, f64)> =
        dots(validation, found).into_iter().map(|(x, y)| (0.5 * (x + y), y - x)).collect();
    let it = &found.bland_altman;
    let across = span(dots.iter().map(|dot| dot.0));
    let (lower, upper) = (&it.lower_limit, &it.upper_limit);
    let rule = |value: f64, ci95, color| Rule {
        ends: [(across.start, value), (across.end, value)],
        ci95: Some(ci95),
        color,
    };
    let rules = [
        rule(it.bias, it.bias_ci95, INK),
        rule(lower.value, lower.ci95_exact, ORANGE),
        rule(upper.value, upper.ci95_exact, ORANGE),
    ];
    let up = span(dots.iter().map(|dot| dot.1).chain([lower.ci95_exact[0], upper.ci95_exact[1]]));
    let why = if validation.origins_aligned { " (origins aligned)" } else { "" };
    let caption = format!(
        "{}: bias {:.3} mm{why}, limits {:.3} and {:.3} mm",
        found.axis,
        rounded(it.bias, 3),
        lower.value,
        upper.value
    );
    let words = ["mean of both (mm)", "camera less reference (mm)"];
    chart(area, &caption, words, [across.clone(), up], &dots, &rules)
}

fn regression(area: &Area<'_>, validation: &Validation, found: &AxisAgreement) -> Drawn {
    let dots = dots(validation, found);
    let across = span(dots.iter().map(|dot| dot.0));
    let up = span(dots.iter().map(|dot| dot.1));
    let (caption, rules) = match &found.regression {
        Some(line) => {
            let end = |x: f64| (x, line.intercept + line.slope * x);
            let r_squared = line.correlation.map(|it| format!(", r² = {:.4}", it.r_squared));
            let r_squared = r_squared.unwrap_or_default();
            let caption = format!("{}: y = {} mm{r_squared}", found.axis, equation(line));
            let ends = [end(across.start), end(across.end)];
            (caption, vec![Rule { ends, ci95: None, color: ORANGE }])
        }
        None => (format!("{}: the reference does not move", found.axis), Vec::new()),
    };
    chart(area, &caption, ["reference (mm)", "camera (mm)"], [across, up], &dots, &rules)
}

fn chart(
    area: &Area<'_>,
    caption: &str,
    names: [&str; 2],
    ranges: [Range<f64>; 2],
    dots: &[(f64, f64)],
    rules: &[Rule],
) -> Drawn {
    let mut chart = drawing::chart(area, caption, ranges, names)?;
    chart.draw_series(dots.iter().map(|dot| Circle::new(*dot, 2, BLUE.mix(0.35).filled())))?;
    for Rule { ends: [start, end], ci95, color } in rules {
        if let Some([low, high]) = *ci95 {
            let band = Rectangle::new([(start.0, low), (end.0, high)], color.mix(0.2).filled());
            chart.draw_series([band])?;
        }
        chart.draw_series([PathElement::new([*start, *end], color.stroke_width(2))])?;
    }
    Ok(())
}

/// From the least to the largest, and some room.
fn span(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) =
        values.fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(it), high.max(it)));
    let room = (0.05 * (high - low)).max(1e-3);
    low - room..high + room
}
