//! The budget: the terms of each figure, combined and expanded.

use plumbline_analysis::sway::Settings;
use plumbline_files::BadInput;
use serde::Serialize;

use crate::figures::{Correction, Listed, Quantity};
use crate::inputs::Inputs;
use crate::measured::Measured;
use crate::propagate::{Propagated, Propagation};
use crate::terms::{Group, Term, TermName, terms};

/// From the standard to the expanded uncertainty: 95 % of a normal distribution.
pub const COVERAGE_FACTOR: f64 = 2.0;

/// Below this the factor covers less than 94 %.
const FREEDOM_ENOUGH: f64 = 20.0;

/// The budget of a trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Budget {
    /// What contributes, and how well it is known.
    pub terms: Vec<Term>,
    /// The figures that the trial gives.
    pub figures: Vec<FigureBudget>,
    /// What no term stands for.
    pub not_included: Vec<&'static str>,
    /// What a user should know.
    pub warnings: Vec<String>,
}

/// The budget of one figure, all numbers in its unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FigureBudget {
    /// `lower` or `upper`; `both` for their distance.
    pub point: &'static str,
    /// What it is.
    pub quantity: Quantity,
    /// Its axis or plane.
    pub direction: &'static str,
    /// The figure as `plumb analyze` gives it.
    pub measured: f64,
    /// What noise adds to it, on average.
    pub noise_adds: f64,
    /// What the steps between samples leave out.
    pub steps_lack: f64,
    /// The figure corrected for both.
    pub estimate: f64,
    /// What each term contributes, in the order of [`Budget::terms`].
    pub contributions: Vec<Contribution>,
    /// The part of `u` that is alike in all trials of a session.
    pub u_alike: f64,
    /// The part that differs from trial to trial.
    pub u_own: f64,
    /// Combined standard uncertainty.
    pub u: f64,
    /// Effective degrees of freedom; `None` where they are infinite.
    pub freedom: Option<f64>,
    /// `u` times [`COVERAGE_FACTOR`].
    pub expanded: f64,
}

/// What one term contributes to one figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Contribution {
    /// The term.
    pub term: TermName,
    /// Its standard uncertainty times the figure's sensitivity to it.
    pub u: f64,
}

impl Budget {
    /// The budget of a trial's figures; `place` names it in errors.
    ///
    /// # Errors
    /// When the settings do not suit the trial.
    pub fn of(
        measured: &Measured,
        inputs: &Inputs,
        settings: &Settings,
        place: &str,
    ) -> Result<Self, BadInput> {
        let propagated = Propagation { measured, inputs, settings, place }.run()?;
        let Propagated { figures, corrections, contributions, copies } = propagated;
        let terms = terms(inputs, &measured.lens, measured.zero_u_s, copies);
        let figures: Vec<FigureBudget> = figures
            .iter()
            .zip(&corrections)
            .enumerate()
            .filter_map(|(at, (figure, correction))| {
                let squares = |term: &Term| -> f64 {
                    let of_term = contributions.iter().filter(|(name, _)| *name == term.name);
                    of_term.map(|(_, all)| all[at] * all[at]).sum()
                };
                FigureBudget::combine(figure, correction, &terms, squares)
            })
            .collect();
        let warnings = ruler_off(inputs).into_iter().chain(few_freedom(&figures, &terms));
        Ok(Self {
            warnings: warnings.collect(),
            terms,
            figures,
            not_included: not_included(measured, settings),
        })
    }
}

impl FigureBudget {
    /// `None` where the trial does not give the figure.
    fn combine(
        figure: &Listed,
        &Correction { noise_adds, steps_lack, .. }: &Correction,
        terms: &[Term],
        squares: impl Fn(&Term) -> f64,
    ) -> Option<Self> {
        let measured = figure.value?;
        let (mut alike, mut own, mut over_freedom) = (0.0, 0.0, 0.0);
        let contributions = terms.iter().map(|term| {
            let square = squares(term);
            *(if term.alike.shifts_all_trials() { &mut alike } else { &mut own }) += square;
            over_freedom += term.freedom.map_or(0.0, |freedom| square * square / freedom);
            Contribution { term: term.name, u: square.sqrt() }
        });
        let contributions = contributions.collect();
        let u = (alike + own).sqrt();
        Some(Self {
            point: figure.point,
            quantity: figure.quantity,
            direction: figure.direction,
            measured,
            noise_adds,
            steps_lack,
            estimate: measured - noise_adds + steps_lack,
            contributions,
            u_alike: alike.sqrt(),
            u_own: own.sqrt(),
            u,
            freedom: (over_freedom > 0.0).then(|| u.powi(4) / over_freedom),
            expanded: COVERAGE_FACTOR * u,
        })
    }

    /// What the terms of a group contribute together.
    #[must_use]
    pub fn of_group(&self, group: Group) -> f64 {
        let own = self.contributions.iter().filter(|it| it.term.group() == group);
        own.map(|it| it.u * it.u).sum::<f64>().sqrt()
    }
}

/// A ruler that does not measure what it should is no uncertainty, but an error to be corrected.
fn ruler_off(inputs: &Inputs) -> Option<String> {
    let print = &inputs.print;
    let off = print.measured_mm / print.ruler_mm - 1.0;
    ((print.measured_mm - print.ruler_mm).abs() > 2.0 * print.u_mm).then(|| {
        format!(
            "the ruler measures {} mm, where pitch_mm in targets.toml stands for {} mm: every \
             length is {:.2} % too {}, which U does not cover; multiply pitch_mm by {:.5} and \
             provision the box anew",
            print.measured_mm,
            print.ruler_mm,
            100.0 * off.abs(),
            if off > 0.0 { "short" } else { "long" },
            1.0 + off
        )
    })
}

/// The figure with the fewest degrees of freedom, if they are too few, and the cause that is most to
/// blame.
fn few_freedom(figures: &[FigureBudget], terms: &[Term]) -> Option<String> {
    let known = figures.iter().filter_map(|it| Some((it, it.freedom?)));
    let (figure, freedom) = known.min_by(|a, b| a.1.total_cmp(&b.1))?;
    if freedom >= FREEDOM_ENOUGH {
        return None;
    }
    let share = |(term, part): &(&Term, &Contribution)| {
        term.freedom.map_or(0.0, |freedom| part.u.powi(4) / freedom)
    };
    let (term, _) = terms
        .iter()
        .zip(&figure.contributions)
        .max_by(|one, other| share(one).total_cmp(&share(other)))?;
    let remedy = match term.name {
        TermName::Noise | TermName::Jitter => {
            "that of a long trial is estimated from few noisy copies of it; a shorter trial has more"
        }
        TermName::Lens => "calibrate with more photographs",
        _ => "take more readings of it",
    };
    Some(format!(
        "the {} {} ({}) has only {freedom:.0} effective degrees of freedom, so that U covers less \
         than 95 %, mostly because of the {}: {remedy}",
        figure.quantity.words().0,
        figure.direction,
        figure.point,
        term.name.words(),
    ))
}

fn not_included(measured: &Measured, settings: &Settings) -> Vec<&'static str> {
    let zero = (measured.zero_u_s.is_none() && settings.span_s.is_some())
        .then_some("the time of t = 0, found by the trunk's rise");
    [
        "a focus, zoom or mount that has changed since the calibration, and the lens model's form",
        "skin and clothes that move under the targets, and where on the body they sit",
        "what light, blur and ink do alike to the edges of every frame",
        "the exposure's length, and what is not known of a rolling shutter's readout",
        "what the filter does to the movement: it is part of each figure's definition",
    ]
    .into_iter()
    .chain(zero)
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::LensUncertainty;

    #[test]
    fn few_degrees_of_freedom_come_with_their_cause_and_its_remedy() {
        let lens = LensUncertainty { ways: Vec::new(), sd_fx_px: 1.0, freedom: Some(900.0) };
        let mut inputs = Inputs::default();
        inputs.print.freedom = Some(4.0);
        // As of an hour.
        let terms = terms(&inputs, &lens, None, 10);
        let path = Listed {
            point: "lower",
            quantity: Quantity::Path,
            direction: "AP",
            value: Some(1000.0),
            noise_sd: None,
        };
        let warning = |large: TermName| {
            let squares = |term: &Term| if term.name == large { 1.0 } else { 0.01 };
            let figure = FigureBudget::combine(&path, &Correction::default(), &terms, squares);
            few_freedom(&[figure.unwrap()], &terms)
        };
        let scale = warning(TermName::Scale).unwrap();
        assert!(scale.contains("only 5") && scale.ends_with("take more readings of it"), "{scale}");
        // Nobody takes readings of the noise.
        let noise = warning(TermName::Noise).unwrap();
        assert!(noise.contains("noise of the poses: that of a long trial"), "{noise}");
        assert_eq!(warning(TermName::Tilt), None);
    }
}
