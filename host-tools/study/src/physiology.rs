//! The physiology of a trial: each quantity's mean in the baseline and at each time, as in the
//! paper's Table I.

use std::ops::Range;

use plumbline_analysis::physiology::bins::{GAP_MAX_S, Seconds, Window, window_means};
use plumbline_analysis::physiology::cardiac_output::cardiac_output_l_min;
use plumbline_analysis::physiology::cycles::{Cycles, Verdict};
use plumbline_analysis::physiology::ecg::r_waves;
use plumbline_analysis::physiology::pressure::{BeatWise, pulse_cycles};
use plumbline_analysis::physiology::respiration::end_tidal_mmhg;
use plumbline_analysis::physiology::signal::Signal;
use plumbline_analysis::statistics::describe::median;
use plumbline_files::BadInput;
use plumbline_trial::points::Points;
use serde::Serialize;

use crate::manifest::{Recordings, Study};
use crate::protocol::{Clock, Kind, Physiology, SignalFile};
use crate::signals;
use crate::values::Value;

/// The fraction of a window's seconds that must have a value; otherwise the window has no mean.
const COVERED_MIN: f64 = 0.5;

/// A quantity of Table I.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Beats per minute.
    HeartRate,
    /// Mean arterial pressure of each cycle, mmHg.
    MeanPressure,
    /// Its maximum in each cycle, mmHg.
    SystolicPressure,
    /// Its minimum in each cycle, mmHg.
    DiastolicPressure,
    /// Stroke volume, mL.
    StrokeVolume,
    /// Cardiac output, L/min.
    CardiacOutput,
    /// Mean cerebral blood flow velocity of each cycle, cm/s.
    MeanVelocity,
    /// Its maximum in each cycle, cm/s.
    SystolicVelocity,
    /// Its minimum in each cycle, cm/s.
    DiastolicVelocity,
    /// Tissue saturation index, percent.
    Oxygenation,
    /// End-tidal partial pressure of CO2, mmHg.
    EndTidalCo2,
}

impl Quantity {
    /// All quantities, in the paper's order.
    pub const ALL: [Self; 11] = [
        Self::HeartRate,
        Self::MeanPressure,
        Self::SystolicPressure,
        Self::DiastolicPressure,
        Self::StrokeVolume,
        Self::CardiacOutput,
        Self::MeanVelocity,
        Self::SystolicVelocity,
        Self::DiastolicVelocity,
        Self::Oxygenation,
        Self::EndTidalCo2,
    ];

    /// Its abbreviation in the paper, and its unit.
    #[must_use]
    pub fn name_and_unit(self) -> (&'static str, &'static str) {
        match self {
            Self::HeartRate => ("HR", "bpm"),
            Self::MeanPressure => ("MAP", "mmHg"),
            Self::SystolicPressure => ("SBP", "mmHg"),
            Self::DiastolicPressure => ("DBP", "mmHg"),
            Self::StrokeVolume => ("SV", "mL"),
            Self::CardiacOutput => ("CO", "L/min"),
            Self::MeanVelocity => ("mean CBFv", "cm/s"),
            Self::SystolicVelocity => ("systolic CBFv", "cm/s"),
            Self::DiastolicVelocity => ("diastolic CBFv", "cm/s"),
            Self::Oxygenation => ("TSI", "%"),
            Self::EndTidalCo2 => ("PETCO2", "mmHg"),
        }
    }

    /// The bounds within which the median of a person's values lies if the signal has the stated
    /// unit; a median outside means that the unit is wrong.
    fn plausible(self) -> [f64; 2] {
        match self {
            Self::HeartRate => [20.0, 250.0],
            Self::MeanPressure | Self::SystolicPressure | Self::DiastolicPressure => [20.0, 350.0],
            Self::StrokeVolume => [5.0, 400.0],
            Self::CardiacOutput => [0.5, 50.0],
            // Diastolic velocity may be near 0, or reversed.
            Self::MeanVelocity | Self::SystolicVelocity => [2.0, 400.0],
            Self::DiastolicVelocity => [-100.0, 400.0],
            Self::Oxygenation => [2.0, 100.0],
            Self::EndTidalCo2 => [8.0, 120.0],
        }
    }
}

/// The values of a trial.
#[derive(Debug, Default)]
pub struct Found {
    /// Each quantity's mean in each window.
    pub responses: Vec<(Quantity, Vec<Value>)>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// A quantity over time, and how it becomes one value per second.
enum Course {
    /// One value per beat or breath.
    PerCycle(Signal),
    /// Sampled continuously.
    Sampled(Signal),
}

/// The values of one trial in these windows.
///
/// # Errors
/// When a file cannot be read or is absent (a study that leaves out incomplete participants treats
/// an absent file as nothing measured), when a signal is not sampled as required or not in its
/// unit, or when the position of the trial on the signals' clock is unknown.
pub fn of_trial(
    study: &Study,
    physiology: &Physiology,
    recordings: &Recordings,
    points: &Points,
    windows: &[Window],
) -> Result<Found, BadInput> {
    let transition_s = transition_s(study, physiology, recordings, points)?;
    let mut found = Found::default();
    let mut trial = Signals { study, recordings, points, physiology, found: &mut found };
    let courses = trial.courses()?;
    let spans = windows.iter().map(|it| it.seconds(transition_s));
    let span = spans.reduce(|all, it| all.start.min(it.start)..all.end.max(it.end));
    let span = span.unwrap_or(0..0);
    for (quantity, course) in courses {
        trial.overlaps(quantity, &course, &span)?;
        let seconds = match &course {
            Course::PerCycle(signal) => Seconds::interpolated(signal, 0.0, span.clone(), GAP_MAX_S),
            Course::Sampled(signal) => match Seconds::averaged(signal, 0.0, span.clone()) {
                Ok(seconds) => seconds,
                Err(error) => return Err(trial.unusable(Kind::Oxygenation, &error)),
            },
        };
        let means = window_means(&seconds, windows, transition_s, COVERED_MIN);
        let (name, _) = quantity.name_and_unit();
        trial.plausible(quantity, &course)?;
        let place = recordings.folder.display();
        let values: Vec<Value> = means
            .iter()
            .map(|it| {
                let (known, seconds) = (it.known, it.seconds);
                let short =
                    || format!("{place}: {known} of {seconds} s have a value, and half are needed");
                it.mean.ok_or_else(short)
            })
            .collect();
        for (window, value) in means.iter().zip(&values) {
            let short =
                value.as_ref().err().map(|short| format!("{short}: no {name} at {}", window.name));
            trial.found.warnings.extend(short);
        }
        trial.found.responses.push((quantity, values));
    }
    Ok(found)
}

/// When the person begins to rise, seconds from t = 0; irrelevant if there is no baseline.
fn transition_s(
    study: &Study,
    physiology: &Physiology,
    recordings: &Recordings,
    points: &Points,
) -> Result<f64, BadInput> {
    let mark = physiology.transition.as_ref();
    let marked = mark.and_then(|mark| points.events.iter().find(|it| it.label == *mark));
    let transition_s = recordings.transition_s.or(marked.map(|it| it.time_s));
    let wrong = |found: String| {
        Err(BadInput::new(
            &study.place,
            format!("{}, physiology.transition_s", points.place),
            found,
            "give when the person begins to rise, seconds from t = 0 (transition_s = -4.2), or \
             mark it in the trial and name the mark in [physiology] (transition = \"rises\")",
        ))
    };
    match transition_s {
        None if physiology.baseline_s.is_none() => Ok(0.0),
        None => wrong("it is not known, but the baseline is counted from it".to_owned()),
        Some(it) if !(-600.0..=0.0).contains(&it) => {
            wrong(format!("{it} s is not within the ten minutes before t = 0"))
        }
        Some(it) => Ok(it),
    }
}

/// The signals of one trial.
struct Signals<'a> {
    study: &'a Study,
    physiology: &'a Physiology,
    recordings: &'a Recordings,
    points: &'a Points,
    found: &'a mut Found,
}

impl Signals<'_> {
    /// The quantities that the signals give, in the paper's order.
    fn courses(&mut self) -> Result<Vec<(Quantity, Course)>, BadInput> {
        use Course::{PerCycle, Sampled};
        let ecg = self.read(Kind::Ecg)?;
        let pressure = self.read(Kind::Pressure)?;
        let velocity = self.read(Kind::FlowVelocity)?;
        let stroke_volume = self.read(Kind::StrokeVolume)?;
        let mut courses = Vec::new();
        if let Some(cycles) = self.cycles(ecg.as_ref(), pressure.as_ref(), velocity.as_ref())? {
            courses.push((Quantity::HeartRate, PerCycle(cycles.heart_rate_bpm())));
            if let Some(wave) = &pressure {
                let [mean, systolic, diastolic] =
                    self.beat_wise(Kind::Pressure, wave, &cycles)?.map(PerCycle);
                courses.push((Quantity::MeanPressure, mean));
                courses.push((Quantity::SystolicPressure, systolic));
                courses.push((Quantity::DiastolicPressure, diastolic));
            }
            if let Some(volume) = &stroke_volume {
                let output = cardiac_output_l_min(&cycles, volume);
                courses.push((Quantity::CardiacOutput, PerCycle(output)));
            }
            if let Some(wave) = &velocity {
                let [mean, systolic, diastolic] =
                    self.beat_wise(Kind::FlowVelocity, wave, &cycles)?.map(PerCycle);
                courses.push((Quantity::MeanVelocity, mean));
                courses.push((Quantity::SystolicVelocity, systolic));
                courses.push((Quantity::DiastolicVelocity, diastolic));
            }
        }
        courses.extend(stroke_volume.map(|it| (Quantity::StrokeVolume, PerCycle(it))));
        let oxygenation = self.read(Kind::Oxygenation)?;
        courses.extend(oxygenation.map(|it| (Quantity::Oxygenation, Sampled(it))));
        if let Some(co2) = self.read(Kind::Co2)? {
            let end_tidal = end_tidal_mmhg(&co2);
            let end_tidal = end_tidal.map_err(|error| self.unusable(Kind::Co2, &error))?;
            courses.push((Quantity::EndTidalCo2, PerCycle(end_tidal)));
        }
        courses.sort_by_key(|(quantity, _)| *quantity);
        Ok(courses)
    }

    /// The cycles from the ECG or, without one, from the wave of pressure or flow velocity.
    fn cycles(
        &mut self,
        ecg: Option<&Signal>,
        pressure: Option<&Signal>,
        velocity: Option<&Signal>,
    ) -> Result<Option<Cycles>, BadInput> {
        if let Some(ecg) = ecg {
            let waves = r_waves(ecg).map_err(|error| self.unusable(Kind::Ecg, &error))?;
            let cycles = waves.cycles();
            if cycles.count(Verdict::Normal) == 0 {
                return Err(self.unusable(Kind::Ecg, &"no two R waves follow each other in it"));
            }
            return Ok(Some(cycles));
        }
        let waves = [(Kind::Pressure, pressure), (Kind::FlowVelocity, velocity)];
        let Some((kind, wave)) = waves.into_iter().find_map(|(kind, it)| Some((kind, it?))) else {
            return Ok(None);
        };
        let cycles = pulse_cycles(wave).map_err(|error| self.unusable(kind, &error))?;
        self.found.warnings.push(format!(
            "{}: without an ECG, beats are the feet of the {} wave",
            self.recordings.folder.display(),
            kind.word()
        ));
        Ok(Some(cycles))
    }

    /// Adds mean, systolic and diastolic values.
    fn beat_wise(
        &self,
        kind: Kind,
        wave: &Signal,
        cycles: &Cycles,
    ) -> Result<[Signal; 3], BadInput> {
        let figures = BeatWise::new(wave, cycles).map_err(|error| self.unusable(kind, &error))?;
        Ok([figures.mean, figures.systolic, figures.diastolic])
    }

    fn file(&self, kind: Kind) -> Option<&SignalFile> {
        self.physiology.signals.iter().find(|it| it.kind == kind)
    }

    /// The signal of this kind, if the study has one.
    fn read(&mut self, kind: Kind) -> Result<Option<Signal>, BadInput> {
        let Some(file) = self.file(kind) else { return Ok(None) };
        let path = self.recordings.folder.join(&file.file);
        if self.study.drop_incomplete && !path.exists() {
            self.found.warnings.push(format!("{}: not recorded", path.display()));
            return Ok(None);
        }
        let zero_s = self.zero_s(file)?;
        let signals::Read { signal, warnings } = signals::read(&path, file, zero_s)?;
        self.found.warnings.extend(warnings);
        Ok(Some(signal))
    }

    /// The time of t = 0 on the file's clock, seconds.
    fn zero_s(&self, file: &SignalFile) -> Result<f64, BadInput> {
        let (found, zero_s, remedy) = match file.clock {
            Clock::Seconds => (
                "it is not known when the trial's t = 0 is on the clock of its physiology",
                self.recordings.zero_s,
                "give zero_s in the trial's physiology, or record times of day and write \
                 clock = \"utc\"",
            ),
            Clock::Utc => (
                "the time of day of its recording is not known",
                self.points.zero_utc_s,
                "give the signal's times in seconds (clock = \"seconds\"), and the trial's zero_s",
            ),
        };
        zero_s
            .filter(|it| it.is_finite())
            .ok_or_else(|| BadInput::new(&self.study.place, &self.points.place, found, remedy))
    }

    /// The error for a signal that a method cannot use.
    fn unusable(&self, kind: Kind, error: &dyn std::fmt::Display) -> BadInput {
        let file = self.file(kind);
        let name = file.map(|it| it.file.clone()).unwrap_or_default();
        BadInput::new(
            self.recordings.folder.join(name).display(),
            file.map(|it| it.column.clone()).unwrap_or_default(),
            error,
            format!("give the {} as the device samples it", kind.word()),
        )
    }

    /// Refuses a signal that does not overlap these seconds.
    fn overlaps(
        &self,
        quantity: Quantity,
        course: &Course,
        span_s: &Range<i64>,
    ) -> Result<(), BadInput> {
        let (Course::PerCycle(signal) | Course::Sampled(signal)) = course;
        let (Some(first_s), Some(last_s)) = (signal.time_s().first(), signal.time_s().last())
        else {
            return Ok(());
        };
        if *first_s < span_s.end as f64 && *last_s >= span_s.start as f64 {
            return Ok(());
        }
        Err(BadInput::new(
            self.recordings.folder.display(),
            quantity.name_and_unit().0,
            format!(
                "it lasts from {first_s:.1} to {last_s:.1} s of the trial, outside the time that is analysed"
            ),
            "correct the trial's zero_s, or the signal's clock",
        ))
    }

    /// Refuses a signal whose values do not fit its unit.
    fn plausible(&self, quantity: Quantity, course: &Course) -> Result<(), BadInput> {
        let (Course::PerCycle(signal) | Course::Sampled(signal)) = course;
        let Some(median) = median(signal.present().map(|(_, value)| value)) else {
            return Ok(());
        };
        let [low, high] = quantity.plausible();
        if (low..=high).contains(&median) {
            return Ok(());
        }
        let (name, unit) = quantity.name_and_unit();
        Err(BadInput::new(
            self.recordings.folder.display(),
            name,
            format!("its median is {median:.3} {unit}; plausible values are {low} to {high}"),
            "correct the unit or the column in study.toml: nobody has such values",
        ))
    }
}
