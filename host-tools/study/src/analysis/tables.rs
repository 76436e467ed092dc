//! The sway figures as tables: path lengths, and everything else.

use std::fmt::Write as _;

use plumbline_analysis::series::{Axis, Plane};
use plumbline_analysis::sway::Sway;
use plumbline_analysis::sway::diffusion::Plot;
use plumbline_analysis::sway::ellipse::Ellipse;
use plumbline_analysis::sway::figure::{ByAxis, ByDirection, ByPlane, Figure, percent};
use plumbline_analysis::sway::noise::PathNoise;

use crate::analysis::{Analysis, PointFigures};
use crate::grid::{Annotated, Footnotes, Grid, digits};

/// One figure of a diffusion plot.
type OfPlot = fn(&Plot) -> &Figure;

/// One figure of an ellipse.
type OfEllipse = fn(&Ellipse) -> &Figure;

/// What the ± of a figure contains, and what it does not.
pub const NOISE: &str = "± noise: the standard uncertainty from the noise of the poses, from frame \
                         to frame; the scale of the print, the calibration, the targets' flatness, \
                         the axes and the timing are not in it; `plumb budget` adds them";

/// All figures of a trial as text for people.
#[must_use]
pub fn text(analysis: &Analysis) -> String {
    let Analysis { source, zero, span, filter, covered_min, .. } = analysis;
    let mut text = format!("{source}, t = 0: {zero}\nspan: {span}; filter: {filter}\n");
    if let Some(verdict) = &analysis.verdict {
        text += &format!("verdict: {}\n", verdict.line());
    }
    for event in &analysis.events {
        // Writing to a String does not fail.
        let _ = writeln!(text, "  {:8.3} s  {}", event.time_s, event.label);
    }
    for point in &analysis.points {
        let (paths, others) = (paths(&point.filtered), others(&point.filtered));
        let _ = write!(text, "\n{}\n{}{}", heading(point), paths.text(), others.text());
    }
    let noise = if analysis.uncertainty_contains.is_empty() {
        "no ±: the noise of these positions is not known"
    } else {
        NOISE
    };
    let _ = write!(
        text,
        "\n{noise}\ncovered: the share of a time that was measured; a bin below {} % has no path\n",
        percent(*covered_min)
    );
    text
}

/// A description of the data behind a point's figures.
#[must_use]
pub fn heading(point: &PointFigures) -> String {
    let sway = &point.filtered;
    let gaps = match sway.gaps {
        0 => "no gap".to_owned(),
        1 => format!("1 gap of {:.2} s", sway.gaps_s),
        count => format!("{count} gaps, {:.2} s in all", sway.gaps_s),
    };
    let half_power = sway.filter.half_power_hz;
    let half_power = half_power.map_or(String::new(), |hz| format!(" (-3 dB at {hz:.2} Hz)"));
    let left_out = match sway.filter.left_out_samples {
        0 => String::new(),
        count => format!("; {count} frames left out, between gaps too close for the filter"),
    };
    format!(
        "{}: {}, {:.2} s measured, {} frames at {:.2} Hz, {gaps}; filter: {}{half_power}{left_out}",
        point.point,
        analysed(sway),
        sway.measured_s,
        sway.samples,
        sway.rate_hz,
        sway.filter.design
    )
}

/// The time that was analysed.
#[must_use]
pub fn analysed(sway: &Sway) -> String {
    format!("{:.2} to {:.2} s", sway.from_s, sway.to_s)
}

/// A name of a table's figures, with what their uncertainty contains.
fn with_noise(name: &str, sway: &Sway) -> String {
    if sway.noise.is_some() { format!("{name} ± noise") } else { name.to_owned() }
}

fn directions() -> impl Iterator<Item = String> {
    Axis::ALL.map(Axis::word).into_iter().chain(Plane::ALL.map(Plane::word)).map(str::to_owned)
}

/// Path lengths: one line for each time, one column for each direction.
#[must_use]
pub fn paths(sway: &Sway) -> Annotated {
    let name = [with_noise("path length (mm)", sway)].into_iter();
    let header = name.chain(directions()).chain(["covered".to_owned()]).collect();
    let paths = sway.figures.bins.iter().chain([&sway.figures.path]);
    let noises: Vec<&PathNoise> =
        sway.noise.iter().flat_map(|noise| noise.bins.iter().chain([&noise.total])).collect();
    let mut notes = Footnotes::default();
    let mut rows = Vec::new();
    for (at, path) in paths.enumerate() {
        let name = format!("{:.1} to {:.1} s", path.from_s, path.to_s);
        let covered = format!("{:.0} %", 100.0 * path.covered);
        rows.push([vec![name], notes.cells(&path.length_mm), vec![covered]].concat());
        if let Some(noise) = noises.get(at) {
            let name = "  noise alone".to_owned();
            rows.push([vec![name], notes.cells(&noise.alone_mm), vec![String::new()]].concat());
        }
    }
    notes.below(Grid { header, rows })
}

/// All other figures: one line for each, one column for each direction that it has.
#[must_use]
pub fn others(sway: &Sway) -> Annotated {
    let figures = &sway.figures;
    let mut notes = Footnotes::default();
    let mut rows = Vec::new();
    let mut row = |name: &str, mut values: Vec<String>| {
        values.resize(6, String::new());
        values.insert(0, name.to_owned());
        rows.push(values);
    };
    row("RMS (mm)", notes.cells(&figures.extent.rms_mm));
    row("range (mm)", notes.by_axis(&figures.extent.range_mm, |it| it));
    row("mean velocity (mm/s)", notes.cells(&figures.path.mean_velocity_mm_s));
    let ellipses: [(&str, OfEllipse); 3] = [
        ("95 % ellipse: area (mm²)", |it| &it.area_mm2),
        ("  semi-axes: long (mm)", |it| &it.major_mm),
        ("  short (mm)", |it| &it.minor_mm),
    ];
    for (name, of) in ellipses {
        row(name, notes.by_plane(&figures.ellipse, of));
    }
    row("mean frequency (Hz)", notes.by_axis(&figures.spectrum.axes, |it| &it.mean_hz));
    row("median frequency (Hz)", notes.by_axis(&figures.spectrum.axes, |it| &it.median_hz));
    row("F95 (Hz)", notes.by_axis(&figures.spectrum.axes, |it| &it.f95_hz));
    let lines: [(&str, OfPlot); 5] = [
        ("diffusion: short term (mm²/s)", |it| &it.short_mm2_s),
        ("  long term (mm²/s)", |it| &it.long_mm2_s),
        ("  critical time (s)", |it| &it.critical_s),
        ("  Hurst exponent, short", |it| &it.hurst_short),
        ("  long", |it| &it.hurst_long),
    ];
    let diffusion = &figures.diffusion;
    for (name, of) in lines {
        let mut values = notes.by_axis(&diffusion.axes, of);
        values.push(notes.cell(of(&diffusion.transverse)));
        row(name, values);
    }
    let density = &figures.density;
    let radius_mm = density.settings.radius_mm;
    for (name, figure) in [
        (format!("sway density in {radius_mm} mm: peak (s)"), &density.peak_s),
        ("  interval (s)".to_owned(), &density.interval_s),
        ("  distance (mm)".to_owned(), &density.distance_mm),
    ] {
        let none = [String::new(), String::new(), String::new()];
        row(&name, none.into_iter().chain([notes.cell(figure)]).collect());
    }
    let name = with_noise(&format!("{}: figure", analysed(sway)), sway);
    let header = [name].into_iter().chain(directions()).collect();
    notes.below(Grid { header, rows })
}

/// Cells of figures, with the reasons for absent ones.
impl Footnotes {
    fn cells(&mut self, figures: &ByDirection<Figure>) -> Vec<String> {
        let ByDirection { axes, planes } = figures;
        let planes = [&planes.transverse, &planes.sagittal, &planes.coronal];
        [&axes.ap, &axes.ml, &axes.si].into_iter().chain(planes).map(|it| self.cell(it)).collect()
    }

    fn by_axis<T>(&mut self, all: &ByAxis<T>, of: impl Fn(&T) -> &Figure) -> Vec<String> {
        [&all.ap, &all.ml, &all.si].map(|it| self.cell(of(it))).into()
    }

    fn by_plane<T>(&mut self, all: &ByPlane<T>, of: impl Fn(&T) -> &Figure) -> Vec<String> {
        let none = [String::new(), String::new(), String::new()];
        let planes = [&all.transverse, &all.sagittal, &all.coronal].map(|it| self.cell(of(it)));
        none.into_iter().chain(planes).collect()
    }

    /// A figure with its standard uncertainty from noise, where that is known.
    fn cell(&mut self, figure: &Figure) -> String {
        match figure {
            Figure::Absent { absent } => self.absent(absent),
            Figure::Known { value, noise_sd: None } => digits(*value),
            Figure::Known { value, noise_sd: Some(sd) } => {
                format!("{} ±{}", digits(*value), digits(*sd))
            }
        }
    }
}
