//! The sway figures of one point of the trunk in one trial.
//!
//! ```text
//! series ─▶ filter ─▶ path length, by bins and in all     path
//!              │       RMS and range                       extent
//!              │       95 % prediction ellipse             ellipse
//!              │       frequencies                         spectrum
//!              │       sway density                        density
//!              │       stabilogram diffusion               diffusion
//! noise ───────┴─────▶ uncertainties, path of noise alone  noise
//! ```
//!
//! The whole series is filtered and then cut into the span and its bins. Figures that need
//! positions without a gap (spectrum, density) use the longest such part; the others skip what a
//! gap leaves unknown. Memory and time grow only with the number of samples.

use std::fmt;
use std::ops::Range;

use realfft::RealFftPlanner;
use serde::Serialize;

use crate::filter::{Design, Filter, Filtered, Unsuitable};
use crate::series::Series;

pub mod density;
pub mod diffusion;
pub mod ellipse;
pub mod extent;
pub mod figure;
pub mod noise;
pub mod path;
pub mod spectrum;

use density::Density;
use diffusion::Diffusion;
use ellipse::Ellipse;
use extent::Extent;
use figure::{ByPlane, Figure, Figures};
use noise::{Noise, PathNoise};
use path::{Path, Shortfall, Span};
use spectrum::Spectrum;

/// The settings from which figures are computed.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The [filter](crate::filter).
    pub filter: Design,
    /// The time that is analysed; `None` for all, and up to the last sample where the end is
    /// infinite. Positions outside it are still used by the filter.
    pub span_s: Option<Range<f64>>,
    /// Intervals with their own path length, each excluding its end.
    pub bins_s: Vec<Range<f64>>,
    /// The fraction of a bin that must have been measured for its path to count, 0 to 1.
    pub covered_min: f64,
    /// The settings of the sway density.
    pub density: density::Settings,
}

impl Default for Settings {
    /// The paper's settings: half a second, and three bins of 20 s from the start of the stance.
    fn default() -> Self {
        Self {
            filter: Design::PAPER,
            span_s: None,
            bins_s: vec![0.0..20.0, 20.0..40.0, 40.0..60.0],
            covered_min: path::COVERED_MIN,
            density: density::Settings::default(),
        }
    }
}

/// Why there are no figures at all.
#[derive(Debug, Clone, PartialEq)]
pub enum SwayError {
    /// This setting is not a positive number, or a range is not in order.
    Setting(&'static str),
    /// The filter does not suit the series' rate.
    Filter(Unsuitable),
    /// All parts without a gap are too short for the filter.
    OnlyFragments {
        /// The number of samples that it needs.
        needed: usize,
    },
    /// Fewer than two samples in the span.
    EmptySpan,
    /// The noise has a different number of samples.
    NoiseLength,
}

impl fmt::Display for SwayError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setting(name) => {
                write!(formatter, "the {name} must be positive, and a range must be in order")
            }
            Self::Filter(unsuitable) => unsuitable.fmt(formatter),
            Self::OnlyFragments { needed } => write!(
                formatter,
                "no part without a gap has the {needed} samples that the filter needs"
            ),
            Self::EmptySpan => write!(formatter, "there are fewer than two samples in the span"),
            Self::NoiseLength => {
                write!(formatter, "the noise has a different number of samples")
            }
        }
    }
}

impl std::error::Error for SwayError {}

/// All figures of one trunk point, and how they were computed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sway {
    /// The number of samples per second.
    pub rate_hz: f64,
    /// The start of the time that was analysed, the span, seconds.
    pub from_s: f64,
    /// Its end, seconds.
    pub to_s: f64,
    /// The part of it that lies between consecutive samples, seconds.
    pub measured_s: f64,
    /// The number of samples in the span, after the filter.
    pub samples: usize,
    /// The number of gaps between them.
    pub gaps: usize,
    /// The total duration of the gaps, seconds.
    pub gaps_s: f64,
    /// The filter.
    pub filter: Filtering,
    /// The given noise; `None` without.
    pub noise: Option<PathNoises>,
    /// The figures.
    #[serde(flatten)]
    pub figures: SwayFigures,
}

/// The filter that was used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Filtering {
    /// The filter.
    #[serde(flatten)]
    pub design: Design,
    /// The number of samples without a gap that it needs: of Savitzky and Golay's, its window.
    pub samples_min: usize,
    /// The frequency at which both passes of a Butterworth filter together halve the power (-3 dB).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_power_hz: Option<f64>,
    /// The number of samples of the whole series that were left out because the part without a gap
    /// around them is too short for the filter.
    pub left_out_samples: usize,
}

/// The effect of noise on the path lengths, and how the uncertainties of all figures were found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathNoises {
    /// The effect on the total path.
    pub total: PathNoise,
    /// The effect on the path of each bin.
    pub bins: Vec<PathNoise>,
    /// The number of noisy copies of the trial; their spread gives the uncertainties.
    pub copies: usize,
}

/// The figures, each with its uncertainty where noise was given.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SwayFigures {
    /// The total path.
    pub path: Path,
    /// The path by bins.
    pub bins: Vec<Path>,
    /// RMS and range.
    #[serde(flatten)]
    pub extent: Extent,
    /// 95 % prediction ellipses.
    pub ellipse: ByPlane<Ellipse>,
    /// Frequencies.
    pub spectrum: Spectrum,
    /// Sway density.
    pub density: Density,
    /// Stabilogram diffusion.
    pub diffusion: Diffusion,
}

impl Figures for SwayFigures {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.path.each(visit);
        self.bins.each(visit);
        self.extent.each(visit);
        self.ellipse.each(visit);
        self.spectrum.each(visit);
        self.density.each(visit);
        self.diffusion.each(visit);
    }
}

/// The figures that are lengths, areas or velocities, each with its uncertainty where noise was
/// given.
#[derive(Debug, Clone, PartialEq)]
pub struct Lengths {
    /// The total path.
    pub path: Path,
    /// RMS and range.
    pub extent: Extent,
    /// 95 % prediction ellipses.
    pub ellipse: ByPlane<Ellipse>,
}

impl Figures for Lengths {
    fn each(&mut self, visit: &mut dyn FnMut(&mut Figure)) {
        self.path.each(visit);
        self.extent.each(visit);
        self.ellipse.each(visit);
    }
}

/// Computes all figures of a trunk point.
///
/// # Errors
/// When the settings are invalid or do not suit the series. A single figure that cannot be computed
/// is [absent](figure::Figure) instead.
pub fn analyze(
    series: &Series,
    noise: Option<&Noise>,
    settings: &Settings,
) -> Result<Sway, SwayError> {
    let prepared = Prepared::of(series, settings)?;
    let Prepared { smooth, filter, spans, span, .. } = &prepared;
    let (figures, copies) = prepared.figures(noise)?;
    let noise = noise.map(|noise| -> Result<PathNoises, SwayError> {
        let noise = prepared.kept_noise(noise)?;
        let steps = noise::step_factors(&noise, smooth, filter);
        let path_noise = |span: &Span| noise::path_noise(smooth, span, &steps);
        let (total, bins) = (path_noise(&spans.total), spans.bins.iter().map(path_noise).collect());
        Ok(PathNoises { total, bins, copies })
    });
    Ok(Sway {
        rate_hz: series.rate_hz(),
        from_s: spans.total.time_s().start,
        to_s: spans.total.time_s().end,
        measured_s: spans.total.measured_s(),
        samples: span.samples(),
        gaps: span.gaps_s().count(),
        gaps_s: span.gaps_s().fold(0.0, |sum, gap| sum + gap.end - gap.start),
        filter: Filtering {
            design: settings.filter,
            samples_min: filter.samples_min(),
            half_power_hz: match filter {
                Filter::Butterworth(filter) => Some(filter.half_power_hz()),
                Filter::None | Filter::SavitzkyGolay(_) => None,
            },
            left_out_samples: prepared.left_out_samples,
        },
        noise: noise.transpose()?,
        figures,
    })
}

/// What moves the length of the total path away from its true one.
#[derive(Debug, Clone, PartialEq)]
pub struct PathErrors {
    /// What noise adds: [`PathNoises::total`].
    pub noise: PathNoise,
    /// How far its steps fall short of the curve between the samples.
    pub shortfall: Shortfall,
}

/// A filtered series, for callers that need more than one thing of it: it is filtered once.
pub struct Prepared<'a> {
    settings: &'a Settings,
    filter: Filter,
    /// The filtered positions.
    smooth: Series,
    /// The parts of the original that the filter kept, and how many samples it has.
    kept: Vec<Range<usize>>,
    samples: usize,
    left_out_samples: usize,
    spans: Spans,
    /// The part that is analysed.
    span: Series,
}

impl<'a> Prepared<'a> {
    /// Filters a series.
    ///
    /// # Errors
    /// When the settings are invalid or do not suit the series.
    pub fn of(series: &Series, settings: &'a Settings) -> Result<Self, SwayError> {
        settings.check()?;
        let filter = settings.filter.at(series.rate_hz()).map_err(SwayError::Filter)?;
        let Filtered { series: smooth, kept, left_out_samples } = filter
            .apply(series)
            .ok_or(SwayError::OnlyFragments { needed: filter.samples_min() })?;
        let spans = Spans::of(&smooth, settings);
        let span = settings.cut(&smooth).ok_or(SwayError::EmptySpan)?;
        let samples = series.samples();
        Ok(Self { settings, filter, smooth, kept, samples, left_out_samples, spans, span })
    }

    /// Only the figures that are lengths, areas or velocities, for callers that need them many
    /// times; also returns the number of noisy copies that their uncertainties come from, 0 without
    /// noise.
    ///
    /// # Errors
    /// When the noise is not of this series, or fewer than two samples lie in the span.
    pub fn lengths(&self, noise: Option<&Noise>) -> Result<(Lengths, usize), SwayError> {
        self.with_uncertainties(
            noise,
            |smooth| Lengths::of(smooth, &self.spans, self.settings),
            |lengths| &mut lengths.ellipse,
        )
    }

    /// All figures, without the effect of noise on the path lengths, which for a minute at 60 Hz
    /// takes as long as the uncertainties of all figures. Also returns the number of noisy copies, as
    /// [`lengths`](Self::lengths).
    ///
    /// # Errors
    /// As [`lengths`](Self::lengths).
    pub fn figures(&self, noise: Option<&Noise>) -> Result<(SwayFigures, usize), SwayError> {
        // A transform is planned once for all copies.
        let mut planner = RealFftPlanner::new();
        self.with_uncertainties(
            noise,
            |smooth| SwayFigures::of(smooth, &self.spans, self.settings, &mut planner),
            |figures| &mut figures.ellipse,
        )
    }

    /// What `of` computes of the filtered positions, with uncertainties where noise is given.
    fn with_uncertainties<T: Figures>(
        &self,
        noise: Option<&Noise>,
        mut of: impl FnMut(&Series) -> Option<T>,
        ellipse: fn(&mut T) -> &mut ByPlane<Ellipse>,
    ) -> Result<(T, usize), SwayError> {
        let mut figures = of(&self.smooth).ok_or(SwayError::EmptySpan)?;
        let Some(noise) = noise else { return Ok((figures, 0)) };
        let noise = self.kept_noise(noise)?;
        let measured = ellipse(&mut figures).clone();
        let again = |noisy: &Series| {
            let mut figures = of(noisy)?;
            ellipse::turn_towards(ellipse(&mut figures), &measured);
            Some(figures)
        };
        let copies = noise::uncertainties(&mut figures, &noise, &self.smooth, &self.filter, again);
        Ok((figures, copies))
    }

    /// Only what moves the length of the total path away from its true one.
    ///
    /// # Errors
    /// When the noise is not of this series.
    pub fn path_errors(&self, noise: &Noise) -> Result<PathErrors, SwayError> {
        let noise = self.kept_noise(noise)?;
        let steps = noise::step_factors(&noise, &self.smooth, &self.filter);
        Ok(PathErrors {
            noise: noise::path_noise(&self.smooth, &self.spans.total, &steps),
            shortfall: path::shortfall(&self.span),
        })
    }

    /// The noise of the samples that the filter kept.
    fn kept_noise(&self, noise: &Noise) -> Result<Noise, SwayError> {
        if noise.fits(self.samples) {
            Ok(noise.only(&self.kept))
        } else {
            Err(SwayError::NoiseLength)
        }
    }
}

impl Lengths {
    /// The figures of filtered positions; `None` when fewer than two lie in the span.
    fn of(smooth: &Series, spans: &Spans, settings: &Settings) -> Option<Self> {
        let span = settings.cut(smooth)?;
        Some(Self {
            path: path::path(smooth, &spans.total),
            extent: extent::extent(&span),
            ellipse: ellipse::ellipses(&span),
        })
    }
}

/// The total span and the bins.
struct Spans {
    total: Span,
    bins: Vec<Span>,
}

impl Spans {
    fn of(series: &Series, settings: &Settings) -> Self {
        let between = |time_s| Span::between(series, time_s);
        let total = settings.span_s.as_ref().map_or_else(|| Span::whole(series), between);
        let bin = |time_s| Span::bin(series, time_s, settings.covered_min);
        Self { total, bins: settings.bins_s.iter().map(bin).collect() }
    }
}

impl SwayFigures {
    /// The figures of filtered positions; `None` when fewer than two lie in the span.
    fn of(
        smooth: &Series,
        spans: &Spans,
        settings: &Settings,
        planner: &mut RealFftPlanner<f64>,
    ) -> Option<Self> {
        let span = settings.cut(smooth)?;
        Some(Self {
            path: path::path(smooth, &spans.total),
            bins: spans.bins.iter().map(|bin| path::path(smooth, bin)).collect(),
            extent: extent::extent(&span),
            ellipse: ellipse::ellipses(&span),
            spectrum: spectrum::spectrum(&span, planner),
            density: density::density(&span, settings.density),
            diffusion: diffusion::diffusion(&span, planner),
        })
    }
}

impl Settings {
    /// The part of a series that is analysed; `None` when fewer than two samples lie in it.
    #[must_use]
    pub fn cut(&self, series: &Series) -> Option<Series> {
        match &self.span_s {
            Some(span_s) => series.between(span_s.clone()),
            None => Some(series.clone()),
        }
    }

    fn check(&self) -> Result<(), SwayError> {
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let ordered = |span: &Range<f64>| span.start.is_finite() && span.start < span.end;
        let bounded = |span: &Range<f64>| ordered(span) && span.end.is_finite();
        let all = [
            ("span", self.span_s.as_ref().is_none_or(ordered)),
            ("bins", self.bins_s.iter().all(bounded)),
            ("share of a bin", (0.0..=1.0).contains(&self.covered_min)),
            ("sway density's radius", positive(self.density.radius_mm)),
        ];
        match all.into_iter().find(|(_, good)| !good) {
            Some((name, _)) => Err(SwayError::Setting(name)),
            None => Ok(()),
        }
    }
}
