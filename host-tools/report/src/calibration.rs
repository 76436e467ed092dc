//! One picture of a calibration: residuals over the frame, which shows the coverage as well, and
//! each photograph's reprojection error.

use std::path::Path;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plumbline_analysis::statistics::describe::median;
use plumbline_calibration::{Calibration, Contribution};
use plumbline_files::BadInput;

use crate::drawing::Drawn;
use crate::palette::{BLUE, FONT, GRID, INK, ORANGE};

const WIDTH_PX: u32 = 1080;
const BARS_HEIGHT_PX: u32 = 360;
/// The photographs' names stand upright below their bars.
const NAME_HEIGHT_PX: u32 = 124;
const NAME_SIZE_PX: u32 = 13;
const NAME_GAP_PX: i32 = 6;
/// The longest name that has room there.
const NAME_LETTERS_MAX: usize = 16;
/// So many names stand side by side; of more photographs only some are named.
const NAMES_MAX: usize = 64;
const MARGIN_PX: u32 = 90;

/// The median residual is drawn this long, as a part of the frame's width.
const MEDIAN_LENGTH: f64 = 0.006;

/// The picture as SVG; `places` are the photographs' files.
///
/// # Errors
/// When the drawing library fails.
pub fn svg(calibration: &Calibration, places: &[String]) -> Result<String, BadInput> {
    let mut text = String::new();
    draw(&mut text, calibration, places).map_err(|error| {
        BadInput::whole("the plot", format!("it cannot be drawn: {error}"), "leave it out")
    })?;
    Ok(text)
}

fn draw(text: &mut String, calibration: &Calibration, places: &[String]) -> Drawn {
    let lens = &calibration.lens;
    let size_px = [lens.width_px, lens.height_px].map(f64::from);
    let frame_height = f64::from(WIDTH_PX - MARGIN_PX) * size_px[1] / size_px[0];
    let height = frame_height as u32 + MARGIN_PX;
    let root =
        SVGBackend::with_string(text, (WIDTH_PX, height + BARS_HEIGHT_PX)).into_drawing_area();
    root.fill(&WHITE)?;
    let (frame, bars) = root.split_vertically(height);
    let used: Vec<(usize, &Contribution)> = calibration
        .outcomes
        .iter()
        .enumerate()
        .filter_map(|(place, outcome)| Some((place, outcome.used()?)))
        .collect();

    let residuals = || used.iter().flat_map(|(_, used)| &used.residuals);
    let lengths_px = residuals().map(|residual| residual.off_px.norm());
    let median_px = median(lengths_px).unwrap_or(1.0).max(1e-6);
    let scale = nice(MEDIAN_LENGTH * size_px[0] / median_px);
    let caption = format!("Residuals of the edges, {scale} times as long as they are");
    let mut chart = ChartBuilder::on(&frame)
        .caption(caption, (FONT, 20).into_font().color(&INK))
        .margin(12)
        .x_label_area_size(28)
        .y_label_area_size(48)
        // Downwards, as in the picture.
        .build_cartesian_2d(0.0..size_px[0], size_px[1]..0.0)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .bold_line_style(GRID)
        .axis_style(INK)
        .x_label_formatter(&whole)
        .y_label_formatter(&whole)
        .draw()?;
    chart.draw_series(residuals().map(|residual| {
        let (start, end) = (residual.at_px, residual.at_px + residual.off_px * scale);
        PathElement::new([(start.x, start.y), (end.x, end.y)], ORANGE.mix(0.7))
    }))?;
    chart.draw_series(residuals().map(|residual| {
        Circle::new((residual.at_px.x, residual.at_px.y), 1, BLUE.mix(0.5).filled())
    }))?;

    let highest_px = used.iter().fold(0.0_f64, |highest, (_, used)| highest.max(used.rms_px));
    let mut chart = ChartBuilder::on(&bars)
        .caption("Reprojection error of each photograph (px)", (FONT, 20).into_font().color(&INK))
        .margin(12)
        .x_label_area_size(NAME_HEIGHT_PX)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..places.len() as f64, 0.0..highest_px * 1.1)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(WHITE)
        .bold_line_style(GRID)
        .axis_style(INK)
        .x_labels(0)
        .draw()?;
    chart.draw_series(used.iter().map(|(place, used)| {
        let left = *place as f64;
        Rectangle::new([(left + 0.15, 0.0), (left + 0.85, used.rms_px)], BLUE.filled())
    }))?;
    let upright = (FONT, NAME_SIZE_PX).into_font().transform(FontTransform::Rotate90);
    let upright = upright.color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
    for (index, place) in places.iter().enumerate().step_by(places.len().div_ceil(NAMES_MAX)) {
        let (x, y) = chart.backend_coord(&(index as f64 + 0.5, 0.0));
        root.draw(&Text::new(name(place), (x, y + NAME_GAP_PX), upright.clone()))?;
    }
    root.present()?;
    Ok(())
}

/// A photograph's file, short: without its directory and its ending, and of a long name the end,
/// where cameras have the number.
fn name(place: &str) -> String {
    let (file, frame) = place.split_once(", frame ").unwrap_or((place, ""));
    let stem = Path::new(file).file_stem().unwrap_or_default().to_string_lossy();
    let name = if frame.is_empty() { stem.into_owned() } else { format!("{stem} {frame}") };
    let letters = name.chars().count();
    if letters <= NAME_LETTERS_MAX {
        return name;
    }
    let end: String = name.chars().skip(letters + 1 - NAME_LETTERS_MAX).collect();
    format!("…{end}")
}

fn whole(value: &f64) -> String {
    format!("{value:.0}")
}

/// 1, 2 or 5 times a power of ten, not above.
fn nice(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [5.0, 2.0].into_iter().find(|step| step * power <= value).unwrap_or(1.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photographs_are_named_by_their_files() {
        for (place, wanted) in [
            ("photos/still-01.png", "still-01"),
            ("a.b.jpg", "a.b"),
            ("film.y4m, frame 12", "film 12"),
            ("IMG_20240229_120501.jpg", "…20240229_120501"),
            ("Größenübersicht1.png", "Größenübersicht1"),
        ] {
            assert_eq!(name(place), wanted);
            assert!(name(place).chars().count() <= NAME_LETTERS_MAX, "{place}");
        }
    }
}
