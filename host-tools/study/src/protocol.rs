//! The `[physiology]` section of `study.toml`: which signals were recorded, and the times from
//! which their values are taken.

use std::ops::Range;

use plumbline_analysis::physiology::bins::{Event, Window};
use plumbline_analysis::physiology::respiration::Concentration;
use plumbline_files::BadInput;
use plumbline_files::columns::Delimiter;
use serde::Deserialize;

use crate::time::{SECONDS_MAX, time_name};

/// Millimetres of mercury per kilopascal.
const KPA_MMHG: f64 = 7.500_616_8;

/// As in the paper, values are taken from this many seconds at the beginning of each time.
const STANCE_S: f64 = 10.0;

/// No device has a longer delay.
const DELAY_MAX_S: f64 = 60.0;

/// The physiology recorded along with the sway.
#[derive(Debug, Clone)]
pub struct Physiology {
    /// Seconds from the transition, negative; `None` where there is no baseline.
    pub baseline_s: Option<Range<f64>>,
    /// The seconds that are used at the beginning of each time.
    pub stance_s: f64,
    /// The trial's mark at which the person begins to rise.
    pub transition: Option<String>,
    /// The signals, at most one of each kind.
    pub signals: Vec<SignalFile>,
}

/// A signal, in a file of this name in each trial's folder.
#[derive(Debug, Clone)]
pub struct SignalFile {
    /// The kind of signal.
    pub kind: Kind,
    /// The file's name.
    pub file: String,
    /// The name of its column of times.
    pub time: String,
    /// The name of its column of values.
    pub column: String,
    /// The factor from the file's values to the [kind](Kind)'s unit.
    pub scale: f64,
    /// The clock of the times.
    pub clock: Clock,
    /// The delay between an event and its appearance in the signal, seconds.
    pub delay_s: f64,
    /// The delimiter between columns; `None`: the one with which the columns are found.
    pub delimiter: Option<Delimiter>,
}

/// The kind of a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Electrocardiogram, in any unit.
    Ecg,
    /// Arterial pressure waveform, mmHg.
    Pressure,
    /// Stroke volume, mL, for each beat.
    StrokeVolume,
    /// Cerebral blood flow velocity waveform, cm/s.
    FlowVelocity,
    /// Tissue saturation index, percent.
    Oxygenation,
    /// CO2 waveform of the breath, mmHg.
    Co2,
}

/// The clock of a file's times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Seconds; each trial states the time of its t = 0 on this clock.
    #[default]
    Seconds,
    /// Time of day, as seconds since 1970 or as 2026-11-22T10:15:00.250Z; related to the trial by
    /// the clock of the computer that recorded it.
    Utc,
}

impl Kind {
    /// Its name in the file.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Ecg => "ecg",
            Self::Pressure => "pressure",
            Self::StrokeVolume => "stroke_volume",
            Self::FlowVelocity => "flow_velocity",
            Self::Oxygenation => "oxygenation",
            Self::Co2 => "co2",
        }
    }

    /// Whether a value of zero or below counts as missing, because the sensor was off.
    #[must_use]
    pub fn is_positive(self) -> bool {
        matches!(self, Self::Pressure | Self::StrokeVolume | Self::Oxygenation)
    }

    /// The permitted units and their factors to the kind's own; those of CO2 are handled elsewhere.
    fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Ecg => &[("mV", 1.0), ("uV", 1.0), ("V", 1.0)],
            Self::Pressure => &[("mmHg", 1.0), ("kPa", KPA_MMHG)],
            Self::StrokeVolume => &[("mL", 1.0), ("L", 1000.0)],
            Self::FlowVelocity => &[("cm/s", 1.0), ("m/s", 100.0)],
            Self::Oxygenation => &[("%", 1.0), ("fraction", 100.0)],
            Self::Co2 => &[("mmHg", 1.0), ("kPa", KPA_MMHG)],
        }
    }
}

/// The section as written in the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhysiologyToml {
    baseline_s: Option<[f64; 2]>,
    #[serde(default = "stance_s")]
    stance_s: f64,
    transition: Option<String>,
    #[serde(default, rename = "signal")]
    signals: Vec<SignalToml>,
}

fn stance_s() -> f64 {
    STANCE_S
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SignalToml {
    kind: Kind,
    file: String,
    time: String,
    column: String,
    unit: String,
    barometric_mmhg: Option<f64>,
    #[serde(default)]
    clock: Clock,
    #[serde(default)]
    delay_s: f64,
    delimiter: Option<Delimiter>,
}

impl PhysiologyToml {
    /// Checks the section.
    pub fn check(self, place: &str) -> Result<Physiology, BadInput> {
        let wrong = |field: &str, found: String, remedy: &str| {
            Err(BadInput::new(place, format!("physiology.{field}"), found, remedy))
        };
        if let Some([from, to]) = self.baseline_s
            && !(-SECONDS_MAX <= from && from < to && to <= 0.0)
        {
            return wrong(
                "baseline_s",
                format!("[{from}, {to}] is not a span before the transition"),
                "give seconds from the transition: [-45, -15]",
            );
        }
        if !(1.0..=3600.0).contains(&self.stance_s) {
            return wrong(
                "stance_s",
                format!("{} s", self.stance_s),
                "give seconds, 1 to 3600: the values are means over whole seconds",
            );
        }
        if self.signals.is_empty() {
            return wrong(
                "signal",
                "there is none".to_owned(),
                "list them, each in a [[physiology.signal]] of its own",
            );
        }
        let mut signals: Vec<SignalFile> = Vec::new();
        for signal in self.signals {
            let signal = signal.check(place)?;
            if signals.iter().any(|it| it.kind == signal.kind) {
                return wrong(
                    "signal",
                    format!("two of the kind {:?}", signal.kind.word()),
                    "name each once",
                );
            }
            signals.push(signal);
        }
        Ok(Physiology {
            baseline_s: self.baseline_s.map(|[from, to]| from..to),
            stance_s: self.stance_s,
            transition: self.transition,
            signals,
        })
    }
}

impl SignalToml {
    fn check(self, place: &str) -> Result<SignalFile, BadInput> {
        let word = self.kind.word();
        let wrong = |field: &str, found: String, remedy: &str| {
            Err(BadInput::new(place, format!("physiology.signal {word}, {field}"), found, remedy))
        };
        if self.delay_s.abs().is_nan() || self.delay_s.abs() > DELAY_MAX_S {
            return wrong(
                "delay_s",
                format!("{} s", self.delay_s),
                "give the seconds by which the device shows an event late, -60 to 60",
            );
        }
        let known = self.kind.units().iter().find(|(unit, _)| *unit == self.unit);
        let scale = match (known, &*self.unit, self.barometric_mmhg) {
            (Some((_, scale)), _, None) => *scale,
            (None, "%dry" | "%moist", Some(barometric_mmhg)) if self.kind == Kind::Co2 => {
                let unit = if self.unit == "%dry" {
                    Concentration::PercentDry { barometric_mmhg }
                } else {
                    Concentration::PercentMoist { barometric_mmhg }
                };
                match unit.mmhg() {
                    Ok(scale) => scale,
                    Err(error) => {
                        return wrong("barometric_mmhg", error.to_string(), "correct it");
                    }
                }
            }
            (None, "%dry" | "%moist", None) if self.kind == Kind::Co2 => {
                return wrong(
                    "barometric_mmhg",
                    "absent".to_owned(),
                    "give the barometric pressure of that day, such as 760: percentages refer to it",
                );
            }
            (Some(_), _, Some(_)) => {
                return wrong(
                    "barometric_mmhg",
                    format!("not needed in {}", self.unit),
                    "remove it, or give CO2 in \"%dry\" or \"%moist\"",
                );
            }
            _ => {
                let mut units: Vec<&str> =
                    self.kind.units().iter().map(|(unit, _)| *unit).collect();
                if self.kind == Kind::Co2 {
                    units.extend(["%dry", "%moist"]);
                }
                return wrong(
                    "unit",
                    format!("{:?}", self.unit),
                    &format!("give one of {}", units.join(", ")),
                );
            }
        };
        Ok(SignalFile {
            kind: self.kind,
            file: self.file,
            time: self.time,
            column: self.column,
            scale,
            clock: self.clock,
            delay_s: self.delay_s,
            delimiter: self.delimiter,
        })
    }
}

impl Physiology {
    /// The time windows of the values: the baseline, if there is one, and the beginning of each of
    /// these times of the stand, which are called T1, T2 and so on.
    #[must_use]
    pub fn windows(&self, bins_s: &[Range<f64>]) -> Vec<Window> {
        let baseline = self.baseline_s.clone().map(|span_s| Window {
            name: "baseline".to_owned(),
            from: Event::Transition,
            span_s,
        });
        let stance = bins_s.iter().enumerate().map(|(at, bin)| Window {
            name: time_name(at),
            from: Event::Stance,
            span_s: bin.start..bin.end.min(bin.start + self.stance_s),
        });
        baseline.into_iter().chain(stance).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = "baseline_s = [-45, -15]\n[[signal]]\nkind = \"co2\"\nfile = \"gas.csv\"\n\
                         time = \"t\"\ncolumn = \"CO2\"\nunit = \"%dry\"\nbarometric_mmhg = 747.0\n";

    fn check(text: &str) -> Result<Physiology, String> {
        let section: PhysiologyToml = toml::from_str(text).map_err(|error| error.to_string())?;
        section.check("study.toml").map_err(|error| error.to_string())
    }

    #[test]
    fn values_are_of_the_baseline_and_of_each_times_beginning() {
        let physiology = check(WHOLE).unwrap();
        // One percent of the dry gas, at 747 - 47 mmHg.
        assert!((physiology.signals[0].scale - 7.0).abs() < 1e-12);
        let windows = physiology.windows(&[0.0..20.0, 20.0..25.0]);
        let found: Vec<(&str, Range<f64>)> =
            windows.iter().map(|it| (&*it.name, it.span_s.clone())).collect();
        assert_eq!(found, [("baseline", -45.0..-15.0), ("T1", 0.0..10.0), ("T2", 20.0..25.0)]);
        assert_eq!(windows[0].from, Event::Transition);
        let without = check(&WHOLE.replace("baseline_s = [-45, -15]", "stance_s = 2")).unwrap();
        assert_eq!(without.windows(&[0.0..20.0])[0].span_s, 0.0..2.0);
    }

    #[test]
    fn what_cannot_be_meant_is_named() {
        let cases = [
            (WHOLE.replace("-15", "15"), "physiology.baseline_s: [-45, 15] is not a span before"),
            (WHOLE.replace("-45", "-1e12"), "physiology.baseline_s: [-1000000000000, -15]"),
            (WHOLE.replace("%dry", "torr"), "co2, unit: \"torr\""),
            (WHOLE.replace("%dry", "kPa"), "barometric_mmhg: not needed in kPa"),
            (WHOLE.replace("747.0", "99.6"), "99.6 mmHg"),
            (WHOLE.replace("barometric_mmhg = 747.0", ""), "barometric_mmhg: absent"),
            (format!("{WHOLE}delay_s = 600"), "delay_s: 600 s"),
            (format!("{WHOLE}delay_s = nan"), "delay_s: NaN s"),
            (WHOLE.replace("co2", "co3"), "unknown variant `co3`"),
            (format!("stance_s = 0.5\n{WHOLE}"), "stance_s: 0.5 s"),
            ("stance_s = 5".to_owned(), "there is none"),
            (format!("{WHOLE}{}", &WHOLE[WHOLE.find("[[").unwrap()..]), "two of the kind \"co2\""),
        ];
        for (text, part) in cases {
            let error = check(&text).unwrap_err();
            assert!(error.contains(part), "no {part}: {error}");
        }
    }
}
