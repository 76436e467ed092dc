//! End-tidal CO2: the peak at the end of each exhalation, as a partial pressure.
//!
//! An exhalation begins where CO2 rises above 40 % of its usual range (from its 5 % to its 95 %
//! quantile) and ends where it falls below 20 %; a shallow one that stays below 40 % is not seen.
//! Its end-tidal value is the largest in its second half, where the gas is alveolar, and is
//! reported at that time. An exhalation counts if it began and ended within the recording, lasted
//! at least half a second, and has no missing samples.
//!
//! # Concentration and partial pressure
//! For a concentration F of dry gas, the partial pressure in the airways is F (B - 47 mmHg), where
//! B is the barometric pressure and 47 mmHg the pressure of water vapour at 37 °C. For an analyser
//! that measures moist gas as breathed, it is F B without the correction. The analyser's manual
//! says which of the two its percentages are; they differ by 6 %.

use std::fmt;

use super::signal::{SamplingError, Signal};

/// At lower rates an exhalation has too few samples.
const RATE_HZ: [f64; 2] = [5.0, 20_000.0];

/// The pressure of saturated water vapour at 37 °C.
const WATER_VAPOUR_MMHG: f64 = 47.0;

/// From the highest inhabited places to below sea level; values in kilopascals fall outside.
const BAROMETRIC_MMHG: std::ops::RangeInclusive<f64> = 350.0..=850.0;

/// The levels at which an exhalation begins and ends, as fractions of the usual range.
const BEGINS: f64 = 0.4;
const ENDS: f64 = 0.2;

/// The quantiles that bound the usual range: spikes are rarer.
const USUAL: [f64; 2] = [0.05, 0.95];

/// A shorter one is a cough or a spike.
const EXHALATION_MIN_S: f64 = 0.5;

/// Breathing changes CO2 by more than this.
const RANGE_MIN_MMHG: f64 = 5.0;

/// How a concentration of CO2 is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Concentration {
    /// Percent of dry gas.
    PercentDry {
        /// The barometric pressure.
        barometric_mmhg: f64,
    },
    /// Percent of the moist gas as breathed.
    PercentMoist {
        /// The barometric pressure.
        barometric_mmhg: f64,
    },
}

/// This is not a plausible barometric pressure in millimetres of mercury.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoBarometricPressure(pub f64);

impl fmt::Display for NoBarometricPressure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "a barometric pressure of {} mmHg is not within {} to {} (1 kPa is 7.50 mmHg)",
            self.0,
            BAROMETRIC_MMHG.start(),
            BAROMETRIC_MMHG.end()
        )
    }
}

impl std::error::Error for NoBarometricPressure {}

impl Concentration {
    /// The partial pressure that corresponds to one percent, millimetres of mercury.
    ///
    /// # Errors
    /// When the barometric pressure is implausible.
    pub fn mmhg(self) -> Result<f64, NoBarometricPressure> {
        let (barometric_mmhg, vapour_mmhg) = match self {
            Self::PercentDry { barometric_mmhg } => (barometric_mmhg, WATER_VAPOUR_MMHG),
            Self::PercentMoist { barometric_mmhg } => (barometric_mmhg, 0.0),
        };
        if BAROMETRIC_MMHG.contains(&barometric_mmhg) {
            Ok((barometric_mmhg - vapour_mmhg) / 100.0)
        } else {
            Err(NoBarometricPressure(barometric_mmhg))
        }
    }
}

/// The end-tidal partial pressure of each breath, mmHg, from the partial pressure over time, mmHg.
/// Empty if there is no breath.
///
/// # Errors
/// When the CO2 is not evenly sampled at 5 to 20 000 Hz.
pub fn end_tidal_mmhg(co2_mmhg: &Signal) -> Result<Signal, SamplingError> {
    let rate_hz = co2_mmhg.rate_hz(RATE_HZ[0], RATE_HZ[1])?;
    let mut sorted: Vec<f64> = co2_mmhg.present().map(|(_, value)| value).collect();
    sorted.sort_by(f64::total_cmp);
    let quantile = |part: f64| sorted.get((part * sorted.len() as f64) as usize);
    let [Some(&low), Some(&high)] = USUAL.map(quantile) else {
        return Ok(Signal::of([]));
    };
    if high - low < RANGE_MIN_MMHG {
        return Ok(Signal::of([]));
    }
    let [begins, ends] = [BEGINS, ENDS].map(|part| low + part * (high - low));
    let shortest = (EXHALATION_MIN_S * rate_hz).ceil() as usize;
    let mut end_tidal = Vec::new();
    for part in co2_mmhg.parts() {
        let values = &co2_mmhg.values()[part.clone()];
        // The sample since which the person exhales. The part must begin with inspired gas.
        let mut inspired = false;
        let mut since = None;
        for (at, &value) in values.iter().enumerate() {
            if value < ends {
                inspired = true;
                if let Some(start) = since.take().filter(|start| at - start >= shortest) {
                    let second_half = start + (at - start) / 2..at;
                    let largest = second_half
                        .reduce(|best, at| if values[at] > values[best] { at } else { best });
                    end_tidal
                        .extend(largest.map(|at| (co2_mmhg.time_s()[part.start + at], values[at])));
                }
            } else if value > begins && inspired && since.is_none() {
                since = Some(at);
            }
        }
    }
    Ok(Signal::of(end_tidal))
}
