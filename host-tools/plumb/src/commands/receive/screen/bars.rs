//! Where both trunks are on each axis, as bars under a common scale.

use plumbline_bedside::recording::{AXES, Along, Movement, Seen};
use ratatui::style::{Style, Stylize as _};
use ratatui::text::{Line, Span};

use super::layout::Glyphs;
use super::shown::no_minus_zero;

/// The ends of the scale.
const SCALES_MM: [f64; 9] = [5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0];

/// Columns of the name of a trunk and an axis.
const NAME: usize = 9;

/// Columns of the numbers beside a bar.
const FIGURES: usize = 25;

/// A shorter bar shows nothing.
const BAR_MIN: usize = 11;

/// The scale and a row for each axis of each trunk; `None` where there is no room.
pub(super) fn rows(seen: &Seen, columns: usize, glyphs: Glyphs) -> Option<Vec<Line<'static>>> {
    let room = columns.checked_sub(NAME + FIGURES)?;
    // An odd number: the origin is in the middle.
    let bar = (room + room % 2).checked_sub(1).filter(|bar| *bar >= BAR_MIN)?;
    let scale_mm = scale_mm(&seen.movement);
    let has_bars = seen.movement.iter().any(|it| it.along.is_ok());
    let scale = has_bars.then(|| scale(scale_mm, bar, seen.since));
    let mut rows = vec![scale.unwrap_or_default()];
    for movement in &seen.movement {
        rows.extend((0..AXES.len()).map(|at| row(movement, at, scale_mm, bar, glyphs)));
    }
    // Nothing below moves when a pose comes.
    rows.resize(1 + 2 * AXES.len(), Line::default());
    Some(rows)
}

/// One axis of one trunk: its name, its bar and its numbers.
fn row(movement: &Movement, at: usize, scale_mm: f64, bar: usize, glyphs: Glyphs) -> Line<'static> {
    let name = format!("{} {}", movement.trunk, AXES[at]);
    let name = format!("{name:NAME$}").bold();
    match &movement.along {
        Ok(along) => {
            let drawn = drawn(&along[at], scale_mm, bar, glyphs).cyan();
            Line::from(vec![name, drawn, figures(&along[at]).bold()])
        }
        // Once for all three axes.
        Err(why) => {
            let why = if at == 0 { *why } else { "" };
            Line::from(vec![name, Span::styled(why, Style::new().yellow().bold())])
        }
    }
}

/// The smallest scale that holds everything that is drawn, or the largest.
pub(super) fn scale_mm(movement: &[Movement]) -> f64 {
    let along = movement.iter().filter_map(|it| it.along.as_ref().ok()).flatten();
    let ends_mm =
        along.flat_map(|it| [it.now_mm].into_iter().chain(it.range_mm.into_iter().flatten()));
    let furthest_mm = ends_mm.fold(0.0, |most: f64, it| most.max(it.abs()));
    let [.., largest] = SCALES_MM;
    SCALES_MM.into_iter().find(|it| furthest_mm <= *it).unwrap_or(largest)
}

/// The scale above the bars: its ends, its middle, and from where movement counts.
fn scale(scale_mm: f64, bar: usize, since: &'static str) -> Line<'static> {
    let (low, high) = (format!("-{scale_mm}"), format!("+{scale_mm} mm"));
    // The sign of each end is above it.
    let half = bar / 2;
    let left = format!("{low:half$}0");
    let right = format!("{left:width$}{high}", width = bar - 1);
    Line::from(vec![(" ".repeat(NAME) + &right).into(), format!("  {since}").dim()])
}

/// A bar: the range since t = 0, the origin, and where the trunk is now.
fn drawn(along: &Along, scale_mm: f64, bar: usize, glyphs: Glyphs) -> String {
    let last = (bar - 1) as f64;
    let cell =
        |at_mm: f64| (0.5 * (at_mm / scale_mm + 1.0) * last).round().clamp(0.0, last) as usize;
    let mut cells = vec![glyphs.track; bar];
    if let Some([low_mm, high_mm]) = along.range_mm {
        cells[cell(low_mm)..=cell(high_mm)].fill(glyphs.range);
    }
    cells[bar / 2] = glyphs.origin;
    cells[cell(along.now_mm)] = glyphs.dot;
    cells.into_iter().collect()
}

/// Where it is now, and the length of its range.
fn figures(along: &Along) -> String {
    let now = format!("  {:>+7.1} mm", no_minus_zero(along.now_mm));
    match along.range_mm {
        Some([low_mm, high_mm]) => format!("{now}  range {:.1}", high_mm - low_mm),
        None => now,
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::ASCII;
    use super::*;

    #[test]
    fn a_bar_shows_range_origin_and_place_on_its_scale() {
        let along = |now_mm, range_mm| Along { now_mm, range_mm };
        let bar = |along| drawn(&along, 10.0, 21, ASCII);
        assert_eq!(bar(along(0.0, None)), "----------#----------");
        assert_eq!(bar(along(5.0, Some([-5.0, 7.0]))), "-----=====|====#==---");
        // Beyond the scale it stays at the end.
        assert_eq!(bar(along(9e9, Some([-9e9, 9e9]))), "==========|=========#");
        let movement = |now_mm| {
            let of = along(now_mm, None);
            vec![Movement { trunk: "upper", along: Ok([of; 3]), trail: Vec::new() }]
        };
        for (furthest_mm, wanted_mm) in [(0.0, 5.0), (5.1, 10.0), (-31.0, 50.0), (9e9, 2000.0)] {
            assert_eq!(scale_mm(&movement(furthest_mm)), wanted_mm);
        }
        let scale = scale(10.0, 21, "since t = 0").to_string();
        assert_eq!(scale.trim_start(), "-10       0         +10 mm  since t = 0");
    }
}
