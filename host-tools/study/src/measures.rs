//! The figures of a trial by their names: those that a study can compare, and that a table of all
//! figures lists.

use plumbline_analysis::sway::SwayFigures;
use plumbline_analysis::sway::density::Density;
use plumbline_analysis::sway::diffusion::Plot;
use plumbline_analysis::sway::ellipse::Ellipse;
use plumbline_analysis::sway::figure::{ByAxis, ByDirection, Figure};
use plumbline_analysis::sway::path::Path;
use plumbline_analysis::sway::spectrum::Frequencies;

/// A direction: along an axis, or in the plane that two axes span.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Anterior-posterior.
    Ap,
    /// Medial-lateral.
    Ml,
    /// Superior-inferior.
    Si,
    /// The transverse plane.
    ApMl,
    /// The sagittal plane.
    ApSi,
    /// The coronal plane.
    MlSi,
}

use Direction::{Ap, ApMl, ApSi, Ml, MlSi, Si};

impl Direction {
    /// All directions, in the order of the paper's Table II.
    pub const ALL: [Self; 6] = [Ap, Ml, Si, ApMl, ApSi, MlSi];

    /// As the paper calls it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Ap => "AP",
            Ml => "ML",
            Si => "SI",
            ApMl => "APML",
            ApSi => "APSI",
            MlSi => "MLSI",
        }
    }
}

/// A kind of figure. A trial has one of them in each of its directions; of a path, one for each
/// time as well.
#[derive(Debug)]
pub struct Measure {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty for a number without one.
    pub unit: &'static str,
    source: Source,
}

/// Where a measure's figures are.
#[derive(Debug)]
enum Source {
    Path(fn(&Path) -> &ByDirection<Figure>),
    Span(fn(&SwayFigures) -> &ByDirection<Figure>),
    Axes(fn(&SwayFigures) -> &ByAxis<Figure>),
    Ellipse(fn(&Ellipse) -> &Figure),
    Spectrum(fn(&Frequencies) -> &Figure),
    Density(fn(&Density) -> &Figure),
    Diffusion(fn(&Plot) -> &Figure),
}

/// The name of a figure that is an angle of an axis.
const ANGLE: &str = "ellipse angle";

/// Every measure, in the order of the tables.
pub static MEASURES: [Measure; 22] = [
    measure("path length", "mm", Source::Path(|it| &it.length_mm)),
    measure("mean velocity", "mm/s", Source::Path(|it| &it.mean_velocity_mm_s)),
    measure("RMS", "mm", Source::Span(|it| &it.extent.rms_mm)),
    measure("range", "mm", Source::Axes(|it| &it.extent.range_mm)),
    measure("ellipse area", "mm²", Source::Ellipse(|it| &it.area_mm2)),
    measure("ellipse long semi-axis", "mm", Source::Ellipse(|it| &it.major_mm)),
    measure("ellipse short semi-axis", "mm", Source::Ellipse(|it| &it.minor_mm)),
    measure(ANGLE, "rad", Source::Ellipse(|it| &it.angle_rad)),
    measure("mean frequency", "Hz", Source::Spectrum(|it| &it.mean_hz)),
    measure("centroidal frequency", "Hz", Source::Spectrum(|it| &it.centroidal_hz)),
    measure("median frequency", "Hz", Source::Spectrum(|it| &it.median_hz)),
    measure("F95", "Hz", Source::Spectrum(|it| &it.f95_hz)),
    measure("sway density peak", "s", Source::Density(|it| &it.peak_s)),
    measure("sway density interval", "s", Source::Density(|it| &it.interval_s)),
    measure("sway density distance", "mm", Source::Density(|it| &it.distance_mm)),
    measure("diffusion short term", "mm²/s", Source::Diffusion(|it| &it.short_mm2_s)),
    measure("diffusion long term", "mm²/s", Source::Diffusion(|it| &it.long_mm2_s)),
    measure("diffusion critical time", "s", Source::Diffusion(|it| &it.critical_s)),
    measure("diffusion critical displacement", "mm²", Source::Diffusion(|it| &it.critical_mm2)),
    measure("diffusion split", "s", Source::Diffusion(|it| &it.split_s)),
    measure("Hurst exponent short term", "", Source::Diffusion(|it| &it.hurst_short)),
    measure("Hurst exponent long term", "", Source::Diffusion(|it| &it.hurst_long)),
];

const fn measure(name: &'static str, unit: &'static str, source: Source) -> Measure {
    Measure { name, unit, source }
}

impl Measure {
    /// The directions in which it is computed.
    #[must_use]
    pub fn directions(&self) -> &'static [Direction] {
        match self.source {
            Source::Path(_) | Source::Span(_) => &Direction::ALL,
            Source::Axes(_) | Source::Spectrum(_) => &[Ap, Ml, Si],
            Source::Ellipse(_) => &[ApMl, ApSi, MlSi],
            Source::Density(_) => &[ApMl],
            Source::Diffusion(_) => &[Ap, Ml, Si, ApMl],
        }
    }

    /// Whether each time of a trial has one of its own.
    #[must_use]
    pub fn is_by_time(&self) -> bool {
        matches!(self.source, Source::Path(_))
    }

    /// Whether only the longest part without a gap is used.
    #[must_use]
    pub fn is_of_longest_part(&self) -> bool {
        matches!(self.source, Source::Spectrum(_) | Source::Density(_))
    }

    /// Whether values of several trials have a mean. An axis has no sign, and so its angles to
    /// either side of a right angle have none.
    #[must_use]
    pub fn has_mean(&self) -> bool {
        self.name != ANGLE
    }

    /// The figure of the whole span.
    ///
    /// # Panics
    /// When the measure has not this [direction](Self::directions).
    #[must_use]
    pub fn of_span<'a>(&self, figures: &'a SwayFigures, direction: Direction) -> &'a Figure {
        let planes = || {
            let ellipse = &figures.ellipse;
            [&ellipse.transverse, &ellipse.sagittal, &ellipse.coronal]
        };
        let figure = match self.source {
            Source::Path(of) => Some(in_direction(of(&figures.path), direction)),
            Source::Span(of) => Some(in_direction(of(figures), direction)),
            Source::Axes(of) => along(of(figures), direction),
            Source::Ellipse(of) => in_plane(planes(), direction).map(of),
            Source::Spectrum(of) => along(&figures.spectrum.axes, direction).map(of),
            Source::Density(of) => Some(of(&figures.density)).filter(|_| direction == ApMl),
            Source::Diffusion(of) if direction == ApMl => Some(of(&figures.diffusion.transverse)),
            Source::Diffusion(of) => along(&figures.diffusion.axes, direction).map(of),
        };
        figure.unwrap_or_else(|| panic!("{} has no {}", self.name, direction.word()))
    }

    /// The figure of each time; `None` for a measure that is only [of the span](Self::is_by_time).
    #[must_use]
    pub fn of_path<'a>(&self, path: &'a Path, direction: Direction) -> Option<&'a Figure> {
        match self.source {
            Source::Path(of) => Some(in_direction(of(path), direction)),
            _ => None,
        }
    }
}

fn in_direction<T>(all: &ByDirection<T>, direction: Direction) -> &T {
    match direction {
        Ap => &all.axes.ap,
        Ml => &all.axes.ml,
        Si => &all.axes.si,
        ApMl => &all.planes.transverse,
        ApSi => &all.planes.sagittal,
        MlSi => &all.planes.coronal,
    }
}

fn along<T>(all: &ByAxis<T>, direction: Direction) -> Option<&T> {
    match direction {
        Ap => Some(&all.ap),
        Ml => Some(&all.ml),
        Si => Some(&all.si),
        ApMl | ApSi | MlSi => None,
    }
}

fn in_plane<T>([transverse, sagittal, coronal]: [&T; 3], direction: Direction) -> Option<&T> {
    match direction {
        ApMl => Some(transverse),
        ApSi => Some(sagittal),
        MlSi => Some(coronal),
        Ap | Ml | Si => None,
    }
}

/// A measure in one direction.
#[derive(Debug, Clone, Copy)]
pub struct Chosen {
    /// The measure.
    pub measure: &'static Measure,
    /// The direction, one of the measure's.
    pub direction: Direction,
}

/// The figures that a study compares unless it names others: the paper's.
#[must_use]
pub fn default_choice() -> Vec<Chosen> {
    all().filter(|it| it.measure.name == "path length").collect()
}

/// Every figure that has a mean.
pub fn all() -> impl Iterator<Item = Chosen> {
    let in_directions = |measure: &'static Measure| {
        measure.directions().iter().map(move |direction| Chosen { measure, direction: *direction })
    };
    MEASURES.iter().filter(|it| it.has_mean()).flat_map(in_directions)
}

/// The figures that these words name, in the order of the tables. A word is the name of a measure
/// or its first words (`ellipse` for all of an ellipse), and may end with a direction (`RMS AP`);
/// upper and lower case are alike. `all` names every figure.
///
/// # Errors
/// When a word names no figure; the text says what was found and what is known.
pub fn choose<'a>(words: impl IntoIterator<Item = &'a str>) -> Result<Vec<Chosen>, String> {
    let mut named = Vec::new();
    for word in words {
        named.extend(named_by(word)?.iter().map(|it| (it.measure.name, it.direction)));
    }
    Ok(all().filter(|it| named.contains(&(it.measure.name, it.direction))).collect())
}

/// The names of all measures that have a mean, for messages.
#[must_use]
pub fn known() -> String {
    let names: Vec<&str> = MEASURES.iter().filter(|it| it.has_mean()).map(|it| it.name).collect();
    names.join(", ")
}

fn named_by(word: &str) -> Result<Vec<Chosen>, String> {
    let words: Vec<&str> = word.split_whitespace().collect();
    let whole = words.join(" ").to_lowercase();
    if whole == "all" {
        return Ok(all().collect());
    }
    let direction = words.last().and_then(|last| {
        Direction::ALL.into_iter().find(|it| it.word().eq_ignore_ascii_case(last))
    });
    let name = match direction {
        Some(_) => words[..words.len() - 1].join(" ").to_lowercase(),
        None => whole,
    };
    let is_named = |measure: &&Measure| {
        let rest = measure.name.to_lowercase();
        let rest = rest.strip_prefix(&name).map(str::to_owned);
        !name.is_empty() && rest.is_some_and(|it| it.is_empty() || it.starts_with(' '))
    };
    let measures: Vec<&'static Measure> = MEASURES.iter().filter(is_named).collect();
    if measures.is_empty() {
        return Err(format!("{word:?} is not a figure"));
    }
    if measures.iter().all(|it| !it.has_mean()) {
        return Err(format!("{word:?} has no mean: an axis has no sign"));
    }
    let chosen: Vec<Chosen> = all()
        .filter(|it| measures.iter().any(|measure| measure.name == it.measure.name))
        .filter(|it| direction.is_none_or(|direction| direction == it.direction))
        .collect();
    if chosen.is_empty() {
        let directions: Vec<&str> = measures[0].directions().iter().map(|it| it.word()).collect();
        return Err(format!("{word:?}: {} has only {}", measures[0].name, directions.join(", ")));
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(words: &[&str]) -> Result<Vec<String>, String> {
        let chosen = choose(words.iter().copied())?;
        let name = |it: &Chosen| format!("{} {}", it.measure.name, it.direction.word());
        Ok(chosen.iter().map(name).collect())
    }

    #[test]
    fn a_word_names_a_measure_its_beginning_or_one_direction_of_it() {
        assert_eq!(names(&["RMS AP"]).unwrap(), ["RMS AP"]);
        assert_eq!(names(&["rms  ap", "RMS AP"]).unwrap(), ["RMS AP"]);
        assert_eq!(names(&["range"]).unwrap(), ["range AP", "range ML", "range SI"]);
        // All of the ellipse but its angle, in the order of the tables.
        let found = names(&["ellipse APML", "path length SI"]).unwrap();
        let semi_axes = ["ellipse long semi-axis APML", "ellipse short semi-axis APML"];
        assert_eq!(found, [&["path length SI", "ellipse area APML"][..], &semi_axes].concat());
        assert_eq!(names(&["path length"]).unwrap().len(), default_choice().len());
        // Paths and RMS in six directions, the range along three axes, three figures of an ellipse
        // in three planes, four frequencies along three axes, three of the density, and seven of
        // diffusion along three axes and in a plane.
        assert_eq!(names(&["all"]).unwrap().len(), 3 * 6 + 3 + 3 * 3 + 4 * 3 + 3 + 7 * 4);
    }

    #[test]
    fn what_names_no_figure_is_said() {
        for (word, part) in [
            ("paths", "\"paths\" is not a figure"),
            ("path len", "is not a figure"),
            ("", "is not a figure"),
            ("AP", "is not a figure"),
            ("range APML", "range has only AP, ML, SI"),
            ("ellipse angle", "has no mean"),
        ] {
            let error = names(&[word]).unwrap_err();
            assert!(error.contains(part), "{word}: {error}");
        }
    }
}
