//! The report of one trial.

use std::ops::Range;

use maud::{Markup, html};
use plumbline_analysis::filter::SavitzkyGolay;
use plumbline_analysis::series::{Axis, Plane, Series};
use plumbline_analysis::statistics::describe::median;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_study::analysis::{Analysis, PointFigures, tables};
use plumbline_study::grid::digits;
use plumbline_trial::Trial;
use plumbline_trial::points::{Point, Points, point_name};

use super::plots::{self, Event};
use super::verdict;
use crate::arguments::method::Method;
use crate::ui::page::{annotated, facts, figure, key, page, table, warnings};

/// More gaps make no list that is read: these are the longest.
const GAPS_MAX: usize = 20;

/// The page of a trial; `beside` are sections that go beyond the trial itself.
///
/// # Errors
/// When its figures cannot be had, or a plot cannot be drawn.
pub fn report(
    trial: &Trial,
    points: &Points,
    method: &Method,
    beside: &[Option<Markup>],
) -> Result<String, BadInput> {
    let analysis = Analysis::of(points, method.filter_s(), &method.settings())?;
    let mut sections = Vec::new();
    for (point, figures) in points.points.iter().zip(&analysis.points) {
        sections.push(section(point, figures, points, method)?);
    }
    let settings = method.settings();
    let bins = settings.bins_s.iter().enumerate();
    let bins = bins.map(|(at, it)| (plots::colour(at), format!("{} to {} s", it.start, it.end)));
    let colours: Vec<_> = bins.chain([(plots::OUTSIDE, "other times".to_owned())]).collect();
    let body = html! {
        (verdict::band(&trial.manifest.verdict()))
        (facts(&known(trial, &analysis)))
        (warnings(&analysis.warnings))
        (events(points))
        (key(&colours))
        @for section in &sections { (section) }
        @for section in beside.iter().flatten() { (section) }
        section { h2 { "Data quality" } (facts(&quality(trial, &analysis))) }
        section {
            h2 { "Method" }
            p.method {
                "Positions along the body's axes: AP (forward), ML (to the person's right), SI (up). "
                "Filter of Savitzky and Golay (1964), second order, " (method.filter_s()) " s. "
                "Total path length: the sum of the steps from each sample to the next; no step "
                "over a gap, and nothing is filled in. The ± of a figure is its standard "
                "uncertainty from the noise of the poses, from frame to frame; \"noise alone\" is "
                "the path that this noise would give for a person who stands perfectly still. "
                "95 % prediction ellipse: Schubert and Kirchner (2014). Sway density: Baratto et "
                "al. (2002). Stabilogram diffusion: Collins and De Luca (1993). Mean and "
                "median frequency and F95: of the periodogram about the mean, of the longest part "
                "without a gap of the filtered positions. The plotted spectra alone: Welch (1967), "
                "parts of 20 s, of the unfiltered positions."
            }
        }
    };
    let subtitle =
        format!("{}, recorded {}", trial.folder.display(), when(&trial.manifest.started));
    Ok(page(&trial.title(), &subtitle, &body))
}

/// To the minute.
fn when(started: &str) -> String {
    started
        .parse::<jiff::Timestamp>()
        .map_or_else(|_| started.to_owned(), |it| it.strftime("%Y-%m-%d %H:%M UTC").to_string())
}

fn known(trial: &Trial, analysis: &Analysis) -> Vec<(&'static str, String)> {
    let manifest = &trial.manifest;
    let mut facts = Vec::new();
    facts.extend(manifest.participant.clone().map(|it| ("participant", it)));
    facts.extend(manifest.condition.clone().map(|it| ("condition", it)));
    facts.extend(manifest.note.clone().map(|it| ("note", it)));
    facts.push(("t = 0", analysis.zero.clone()));
    if let Some(the_box) = &manifest.the_box {
        facts.push(("box", format!("{} ({})", the_box.device, the_box.serial_number)));
        facts.push(("its program", the_box.firmware.clone()));
        facts.push(("its configuration", the_box.config_crc.clone()));
    }
    if let Some(config) = &trial.config {
        let lens = &config.lens;
        let calibration =
            format!("{} x {} px, f {:.1} px", lens.width_px, lens.height_px, lens.fx_px);
        facts.push(("camera calibration", calibration));
    }
    facts
}

fn quality(trial: &Trial, analysis: &Analysis) -> Vec<(String, String)> {
    let manifest = &trial.manifest;
    let mut facts = Vec::new();
    if let Some(packets) = &manifest.packets {
        facts.push(("frames".to_owned(), packets.frames.to_string()));
        facts.push(("lost on the way".to_owned(), packets.lost.to_string()));
        facts.push(("damaged packets".to_owned(), packets.corrupt.to_string()));
        facts.push(("starts of the box".to_owned(), packets.sessions.to_string()));
    }
    for point in &analysis.points {
        let sway = &point.filtered;
        let name = format!("{}, gaps", point_name(&point.point));
        facts.push((name, format!("{} ({:.2} s)", sway.gaps, sway.gaps_s)));
    }
    for noise in &manifest.noise {
        let name = format!("{}, noise", point_name(&noise.trunk));
        let [ap, ml, si] = [noise.ap_mm, noise.ml_mm, noise.si_mm].map(digits);
        facts.push((name, format!("AP {ap}, ML {ml}, SI {si} mm per frame")));
    }
    for (at, name) in ["fit, upper target", "fit, lower target"].into_iter().enumerate() {
        let rms_px = trial.frames.iter().filter_map(|frame| frame.rms_px[at]).map(f64::from);
        if let Some(rms_px) = median(rms_px) {
            facts.push((name.to_owned(), format!("{rms_px:.3} px (median)")));
        }
    }
    for clock in &manifest.clocks {
        let drift =
            clock.drift_ppm.map_or("not measurable".to_owned(), |it| format!("{it:.1} ppm"));
        facts.push((
            "clocks".to_owned(),
            format!("related within ±{:.2} ms, drift {drift}", 1e3 * clock.uncertain_s),
        ));
    }
    facts
}

fn section(
    point: &Point,
    figures: &PointFigures,
    points: &Points,
    method: &Method,
) -> Result<Markup, BadInput> {
    let name = point_name(&point.name);
    let bins = method.settings().bins_s;
    let smooth = smooth(&point.series, method.filter_s());
    let events: Vec<Event> = points
        .events
        .iter()
        .map(|event| Event { time_s: event.time_s, label: event.label.clone() })
        .collect();
    let mut paths = Vec::new();
    for plane in Plane::ALL {
        if let Some(svg) = plots::path(&smooth, plane, &bins)? {
            let seen = match plane {
                Plane::Transverse => "from above",
                Plane::Sagittal => "from the side",
                Plane::Coronal => "from behind",
            };
            let caption = format!("{name}, {} plane, seen {seen}", plane.word());
            paths.push(figure(&svg, &caption));
        }
    }
    let gaps: Vec<Range<f64>> = smooth.gaps_s().collect();
    let mut lines = Vec::new();
    for axis in Axis::ALL {
        if let Some(svg) = plots::over_time(&smooth, axis, &bins, &events)? {
            let gaps = if gaps.is_empty() { "" } else { "; gaps are grey" };
            let caption = format!("{name}, {} over time{gaps}", axis.word());
            lines.push(figure(&svg, &caption));
        }
    }
    let spectrum = plots::spectrum(&point.series)?;
    Ok(html! {
        section {
            h2 { (name) }
            div.row { @for path in &paths { (path) } }
            @for line in &lines { div.over-time { (line) } }
            @if !gaps.is_empty() { p.method { (gap_list(&gaps)) } }
            (annotated(&tables::heading(figures, method.filter_s()), &tables::paths(&figures.filtered)))
            (annotated("Other figures of the same positions", &tables::others(&figures.filtered)))
            @match spectrum {
                Some(svg) => div.pair {
                    (figure(&svg, &format!("{name}, power spectral densities of the unfiltered positions")))
                },
                None => p.method { "No spectrum: no part without a gap is as long as 20 s." },
            }
        }
    })
}

/// What happened, and when.
fn events(points: &Points) -> Markup {
    let header = ["event", "time (s)", "uncertain by (s)"].map(str::to_owned);
    let rows: Vec<Vec<String>> = points
        .events
        .iter()
        .map(|it| {
            let label = if it.label.is_empty() { "mark" } else { &it.label };
            vec![label.to_owned(), format!("{:.3}", it.time_s), format!("±{:.3}", it.uncertain_s)]
        })
        .collect();
    html! { @if !rows.is_empty() { div.few { (table("Events", &header, &rows)) } } }
}

/// All gaps, or the longest of many, in the order of their times.
fn gap_list(gaps_s: &[Range<f64>]) -> String {
    let length = |gap: &Range<f64>| gap.end - gap.start;
    let mut gaps = gaps_s.to_vec();
    gaps.sort_by(|a, b| length(b).total_cmp(&length(a)));
    let others = gaps.split_off(gaps.len().min(GAPS_MAX));
    gaps.sort_by(|a, b| a.start.total_cmp(&b.start));
    let listed: Vec<String> = gaps
        .iter()
        .map(|gap| format!("{:.2} to {:.2} s ({:.2} s)", gap.start, gap.end, length(gap)))
        .collect();
    let others = others.first().map(|longest| {
        format!("; and {} of at most {:.2} s", counted(others.len(), "other"), length(longest))
    });
    format!("Gaps: {}{}.", listed.join(", "), others.unwrap_or_default())
}

/// What the figures are of; a series too short for the filter is shown as it is.
fn smooth(series: &Series, filter_s: f64) -> Series {
    SavitzkyGolay::lasting(filter_s, series.rate_hz())
        .and_then(|filter| filter.apply(series))
        .map_or_else(|| series.clone(), |filtered| filtered.series)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_gaps_the_longest_are_listed_in_order() {
        let gaps = [12.0..12.5, 30.0..33.25];
        assert_eq!(gap_list(&gaps), "Gaps: 12.00 to 12.50 s (0.50 s), 30.00 to 33.25 s (3.25 s).");
        let many: Vec<Range<f64>> =
            (0..30).map(|at| f64::from(at)..f64::from(at) + 0.01 * f64::from(1 + at)).collect();
        let said = gap_list(&many);
        assert!(said.starts_with("Gaps: 10.00 to 10.11 s (0.11 s), 11.00"), "{said}");
        assert!(
            said.ends_with("29.00 to 29.30 s (0.30 s); and 10 others of at most 0.10 s."),
            "{said}"
        );
    }
}
