//! The report of one trial.

use std::ops::Range;

use maud::{Markup, html};
use plumbline_analysis::filter::Design;
use plumbline_analysis::series::{Axis, Plane, Series};
use plumbline_analysis::statistics::describe::median;
use plumbline_analysis::sway::Settings;
use plumbline_analysis::sway::ellipse::Ellipse;
use plumbline_analysis::sway::figure::percent;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_study::analysis::{Analysis, PointFigures, tables};
use plumbline_study::grid::digits;
use plumbline_study::reference::Comparison;
use plumbline_trial::Trial;
use plumbline_trial::points::{Point, Points, point_name};

use crate::agreement::{self, Validation};
use crate::budget::{self, TrialBudget};
use crate::page::{annotated, facts, figure, key, page, table, warnings};
use crate::plots::{self, Event, Outline};
use crate::{reference, verdict};

/// More gaps make no list that is read: these are the longest.
const GAPS_MAX: usize = 20;

/// What a page can say beyond the figures.
#[derive(Debug, Default)]
pub struct Beside<'a> {
    /// How well the figures are known.
    pub budget: Option<&'a TrialBudget>,
    /// How well the trial agrees with a reference.
    pub validation: Option<&'a Validation>,
    /// Where its figures lie among those of others.
    pub comparison: Option<&'a Comparison>,
}

/// The page of a trial, or of a table (without a trial), as HTML, and all warnings.
///
/// # Errors
/// When its figures cannot be had, or a plot cannot be drawn.
pub fn report(
    trial: Option<&Trial>,
    points: &Points,
    settings: &Settings,
    beside: &Beside<'_>,
) -> Result<(String, Vec<String>), BadInput> {
    let analysis = Analysis::of(points, settings)?;
    let mut sections = Vec::new();
    for (point, figures) in points.points.iter().zip(&analysis.points) {
        sections.push(section(point, figures, points, settings)?);
    }
    let beside = [
        beside.budget.map(budget::section),
        beside.validation.map(agreement::section).transpose()?,
        beside.comparison.map(reference::section),
    ];
    let bins = settings.bins_s.iter().enumerate();
    let bins = bins.map(|(at, it)| (plots::colour(at), format!("{} to {} s", it.start, it.end)));
    let colours: Vec<_> = bins.chain([(plots::OUTSIDE, "other times".to_owned())]).collect();
    let body = html! {
        @if let Some(trial) = trial { (verdict::band(&trial.manifest.verdict())) }
        (facts(&known(trial, points, &analysis)))
        (warnings(&analysis.warnings))
        (events(points))
        (key(&colours))
        @for section in &sections { (section) }
        @for section in beside.iter().flatten() { (section) }
        section { h2 { "Data quality" } (facts(&quality(trial, &analysis))) }
        section { h2 { "Method" } p.method { (method(&analysis)) } }
    };
    let (title, subtitle) = match trial {
        Some(trial) => {
            let recorded = when(&trial.manifest.started);
            (trial.title(), format!("{}, recorded {recorded}", points.place))
        }
        None => ("Sway".to_owned(), points.place.clone()),
    };
    Ok((page(&title, &subtitle, &body), analysis.warnings))
}

fn method(analysis: &Analysis) -> Markup {
    html! {
        "Positions along the body's axes: AP (forward), ML (to the person's right), SI (up). "
        "Filter: "
        @match analysis.filter {
            Design::None => "none. ",
            Design::SavitzkyGolay { window_s } => {
                "Savitzky and Golay (1964), second order, " (window_s) " s. "
            },
            Design::Butterworth { cutoff_hz, order } => {
                "Butterworth, " (cutoff_hz) " Hz and order " (order) " in each of two passes, "
                "forwards and backwards, which together halve the amplitude at that frequency. "
            },
        }
        "Each part without a gap is filtered alone. "
        "Total path length: the sum of the steps from each sample to the next; no step "
        "over a gap, and nothing is filled in. A time bin of which less than "
        (percent(analysis.covered_min)) " % was measured has no path length. "
        @if analysis.uncertainty_contains.is_empty() {
            "Figures have no ±: the noise of these positions is not known. "
        } @else {
            (tables::NOISE) " (--camera shows them here). \"Noise alone\" is "
            "the path that this noise would give for a person who stands perfectly still. "
        }
        "95 % prediction ellipse: Schubert and Kirchner (2014). Sway density: Baratto et "
        "al. (2002). Stabilogram diffusion: Collins and De Luca (1993). Mean and "
        "median frequency and F95: of the periodogram about the mean, of the longest part "
        "without a gap of the filtered positions. The plotted spectra alone: Welch (1967), "
        "parts of 20 s, of the unfiltered positions. Rate and duration are judged after Scoppa "
        "et al. (2013)."
    }
}

/// To the minute.
fn when(started: &str) -> String {
    started
        .parse::<jiff::Timestamp>()
        .map_or_else(|_| started.to_owned(), |it| it.strftime("%Y-%m-%d %H:%M UTC").to_string())
}

/// Who, when, how long, and what the figures are of.
fn known(
    trial: Option<&Trial>,
    points: &Points,
    analysis: &Analysis,
) -> Vec<(&'static str, String)> {
    let mut facts = Vec::new();
    if let Some(Trial { manifest, .. }) = trial {
        facts.extend(manifest.participant.clone().map(|it| ("participant", it)));
        facts.extend(manifest.condition.clone().map(|it| ("condition", it)));
        facts.extend(manifest.note.clone().map(|it| ("note", it)));
    }
    facts.extend(recorded(points));
    facts.push(("t = 0", analysis.zero.clone()));
    facts.push(("figures of", analysed(analysis)));
    facts.push(("filter", analysis.filter.to_string()));
    facts.extend(trial.iter().flat_map(|it| apparatus(it)));
    facts
}

/// How long, how fast, and how much was recorded, of the point of which there is most.
fn recorded(points: &Points) -> Option<(&'static str, String)> {
    let series = points.points.iter().map(|it| &it.series).max_by_key(|it| it.samples())?;
    let time_s = series.time_s();
    let seconds = time_s[time_s.len() - 1] - time_s[0];
    let (frames, rate_hz) = (series.samples(), series.rate_hz());
    Some(("recorded", format!("{seconds:.1} s, {frames} frames at {rate_hz:.2} Hz")))
}

/// The span, in words and in seconds, where it is the same for all points.
fn analysed(analysis: &Analysis) -> String {
    let mut spans: Vec<String> =
        analysis.points.iter().map(|it| tables::analysed(&it.filtered)).collect();
    spans.dedup();
    match &spans[..] {
        [span] => format!("{}: {span}", analysis.span),
        _ => analysis.span.clone(),
    }
}

/// The box and its camera.
fn apparatus(trial: &Trial) -> Vec<(&'static str, String)> {
    let manifest = &trial.manifest;
    let mut facts = Vec::new();
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

fn quality(trial: Option<&Trial>, analysis: &Analysis) -> Vec<(String, String)> {
    let mut facts = Vec::new();
    if let Some(packets) = trial.and_then(|it| it.manifest.packets.as_ref()) {
        facts.push(("frames".to_owned(), packets.frames.to_string()));
        facts.push(("lost on the way".to_owned(), packets.lost.to_string()));
        facts.push(("damaged packets".to_owned(), packets.corrupt.to_string()));
        facts.push(("packets not of the box".to_owned(), packets.not_authentic.to_string()));
        facts.push(("starts of the box".to_owned(), packets.sessions.to_string()));
    }
    for point in &analysis.points {
        let sway = &point.filtered;
        let name = format!("{}, gaps", point_name(&point.point));
        facts.push((name, format!("{} ({:.2} s)", sway.gaps, sway.gaps_s)));
    }
    let Some(trial) = trial else { return facts };
    let manifest = &trial.manifest;
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
    settings: &Settings,
) -> Result<Markup, BadInput> {
    let name = point_name(&point.name);
    let bins = &settings.bins_s;
    let smooth = smooth(&point.series, settings.filter);
    let ellipse = outline(&smooth, settings, &figures.filtered.figures.ellipse.transverse);
    let events: Vec<Event> = points
        .events
        .iter()
        .map(|event| Event { time_s: event.time_s, label: event.label.clone() })
        .collect();
    let mut paths = Vec::new();
    for plane in Plane::ALL {
        let ellipse = ellipse.as_ref().filter(|_| plane == Plane::Transverse);
        if let Some(svg) = plots::path(&smooth, plane, bins, ellipse)? {
            let seen = match plane {
                Plane::Transverse => "from above",
                Plane::Sagittal => "from the side",
                Plane::Coronal => "from behind",
            };
            let and = if ellipse.is_some() { ", and the 95 % prediction ellipse" } else { "" };
            let caption = format!("{name}, {} plane, seen {seen}{and}", plane.word());
            paths.push(figure(&svg, &caption));
        }
    }
    let gaps: Vec<Range<f64>> = smooth.gaps_s().collect();
    let mut lines = Vec::new();
    for axis in Axis::ALL {
        if let Some(svg) = plots::over_time(&smooth, axis, bins, &events)? {
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
            (annotated(&tables::heading(figures), &tables::paths(&figures.filtered)))
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
fn smooth(series: &Series, filter: Design) -> Series {
    let filtered = filter.at(series.rate_hz()).ok().and_then(|filter| filter.apply(series));
    filtered.map_or_else(|| series.clone(), |filtered| filtered.series)
}

/// The ellipse of the span, about the mean of its positions in the transverse plane.
fn outline(smooth: &Series, settings: &Settings, ellipse: &Ellipse) -> Option<Outline> {
    let span = settings.cut(smooth)?;
    let mean = |axis: Axis| {
        let values = span.along(axis)?;
        Some(values.iter().sum::<f64>() / values.len() as f64)
    };
    let [first, second] = Plane::Transverse.axes();
    Some(Outline {
        centre_mm: [mean(first)?, mean(second)?],
        semi_axes_mm: [ellipse.major_mm.value()?, ellipse.minor_mm.value()?],
        // A circle has no direction, and needs none.
        angle_rad: ellipse.angle_rad.value().unwrap_or_default(),
    })
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
