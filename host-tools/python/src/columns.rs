//! What a trial's rows hold of one trunk, as columns for arrays: NaN where there is nothing.

use plumbline_files::poses::state_words;
use plumbline_trial::frame::Trunk;

use crate::rows::Row;

/// The columns of one trunk.
#[derive(Debug, Default, PartialEq)]
pub struct Columns {
    /// When its target was exposed, seconds from t = 0.
    pub time_s: Vec<f64>,
    /// AP, ML, SI of each row.
    pub position_mm: Vec<f64>,
    /// Their covariance: nine numbers of each row.
    pub covariance_mm2: Vec<f64>,
    /// theta1, theta2, theta3, x, y, z of each row.
    pub theta: Vec<f64>,
    /// The reprojection error.
    pub rms_px: Vec<f64>,
    /// For each row its place in [`words`](Self::words).
    pub states: Vec<usize>,
    /// The different states, the first for a frame that never came, or without the target.
    pub words: Vec<String>,
}

impl Columns {
    /// Those of this trunk; `zero_s` is t = 0 on the trial's clock.
    pub fn of(rows: &[Row<'_>], trunk: Trunk, zero_s: f64) -> Self {
        let mut columns = Self { words: vec![String::new()], ..Self::default() };
        for row in rows {
            columns.push(row, trunk, zero_s);
        }
        columns
    }

    fn push(&mut self, row: &Row<'_>, trunk: Trunk, zero_s: f64) {
        let point = row.frame.and_then(|frame| frame.point(trunk));
        self.time_s.push(point.map_or(f64::NAN, |point| point.time_s - zero_s));
        self.position_mm.extend(point.map_or([f64::NAN; 3], |point| point.position_mm));
        match point.and_then(|point| point.covariance_mm2) {
            // Symmetric: by rows as by columns.
            Some(covariance) => self.covariance_mm2.extend(covariance.iter()),
            None => self.covariance_mm2.extend([f64::NAN; 9]),
        }
        let theta = row.frame.and_then(|frame| frame.theta_of(trunk));
        self.theta.extend(theta.map_or([f64::NAN; 6], |theta| theta.map(f64::from)));
        let rms_px = row.frame.and_then(|frame| frame.rms_px(trunk));
        self.rms_px.push(rms_px.map_or(f64::NAN, f64::from));
        let seen = row.frame.and_then(|frame| frame.seen(trunk));
        let words = seen.map_or(String::new(), |seen| state_words(seen.state, seen.no_pose));
        let place = self.words.iter().position(|it| *it == words).unwrap_or_else(|| {
            self.words.push(words);
            self.words.len() - 1
        });
        self.states.push(place);
    }
}
