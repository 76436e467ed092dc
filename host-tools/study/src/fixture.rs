//! Results that are made up, for tests.

use crate::reference::{Band, What};

/// The band of these values, one of each participant: calm people aged 40 to 60, the lower trunk's RMS
/// along AP over a minute.
#[must_use]
pub fn band(values: Vec<f64>) -> Band {
    Band {
        condition: "calm".to_owned(),
        age_from_years: Some(40.0),
        age_to_years: Some(60.0),
        what: What {
            trunk: "lower".to_owned(),
            segment: "whole".to_owned(),
            figure: "RMS".to_owned(),
            direction: "AP".to_owned(),
        },
        unit: "mm".to_owned(),
        filter: "none".to_owned(),
        measured_s: Some(60.0),
        participants: values.len(),
        percentiles: Band::percentiles(values),
    }
}
