//! The figures of both trunks while a recording goes on: path, RMS, the path that noise alone would
//! have, gaps.
//!
//! They are those of [`plumbline_analysis::sway`] with the paper's filter, for the time since t = 0.
//! The filter needs as much of the future as of the past, so that they come a quarter of a second
//! late. What came before the last quarter of a second when t = 0 is set does not count; frames that
//! come late do not either: the trial itself has them.
//!
//! Cost: memory for half a second of points; for each point some ten operations per sample of the
//! filter's window, for its covariance too.

use std::collections::VecDeque;
use std::fmt;

use nalgebra::Matrix3;
use plumbline_analysis::filter::{Design, Filter, Unsuitable};
use plumbline_analysis::series::{GAP_PERIODS, Plane, usual_period_s};
use plumbline_analysis::sway::noise::mean_step_mm;
use plumbline_trial::frame::{Point, Trunk};

/// The rate is that of so many points.
const RATE_POINTS: usize = 33;

/// The figures of a trunk's point since t = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrunkFigures {
    /// Points per second, where none is missing.
    pub rate_hz: f64,
    /// From the first of the points that count to the latest, in each of the box's sessions, seconds.
    pub seconds: f64,
    /// The points that count.
    pub samples: usize,
    /// The path in the transverse plane, mm.
    pub path_mm: f64,
    /// The path that noise alone would have in that plane, mm: the noise floor. `None` where the
    /// covariance of a point is not known.
    pub noise_path_mm: Option<f64>,
    /// The RMS distance from the mean along AP, ML and SI, mm.
    pub rms_mm: [f64; 3],
    /// The gaps since t = 0.
    pub gaps: usize,
    /// Their total duration, seconds.
    pub gaps_s: f64,
}

/// Why there are no figures yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NotYet {
    /// Too few points have come since t = 0, or without a gap.
    Settling,
    /// The filter does not suit the box's rate.
    Rate(Unsuitable),
}

impl fmt::Display for NotYet {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Settling => formatter.write_str("half a second without a gap is needed"),
            Self::Rate(unsuitable) => unsuitable.fmt(formatter),
        }
    }
}

/// Follows both trunks.
#[derive(Debug)]
pub struct Figures {
    /// `None` before the first frame.
    session: Option<u32>,
    upper: Follower,
    lower: Follower,
}

impl Default for Figures {
    fn default() -> Self {
        Self { session: None, upper: Follower::new(), lower: Follower::new() }
    }
}

impl Figures {
    /// t = 0 is at this time of the points' clock: the figures count from there.
    pub fn start_over(&mut self, from_s: f64) {
        self.each(|trunk| trunk.start_over(from_s));
    }

    /// Takes a frame of the box's session with this number. Times are seconds of any one clock within
    /// a session; a point that is not later than the one before is left out. A new session is a new
    /// part, whatever its clock says, of which all counts.
    pub fn take(&mut self, session: u32, upper: Option<&Point>, lower: Option<&Point>) {
        if self.session.replace(session).is_some_and(|before| before != session) {
            self.each(Follower::begin_session);
        }
        for (trunk, point) in [(&mut self.upper, upper), (&mut self.lower, lower)] {
            if let Some(point) = point {
                trunk.take(*point);
            }
        }
    }

    /// What is known of a trunk so far.
    ///
    /// # Errors
    /// Why nothing is.
    pub fn so_far(&self, trunk: Trunk) -> Result<TrunkFigures, NotYet> {
        match trunk {
            Trunk::Upper => self.upper.so_far(),
            Trunk::Lower => self.lower.so_far(),
        }
    }

    fn each(&mut self, of: impl Fn(&mut Follower)) {
        of(&mut self.upper);
        of(&mut self.lower);
    }
}

/// The filter at the rate of the points.
#[derive(Debug)]
struct Smoother {
    period_s: f64,
    filter: Filter,
    /// The squared weights of the samples of two neighbouring windows in the step between their
    /// centres.
    step_weights: Vec<f64>,
}

impl Smoother {
    fn at(period_s: f64) -> Result<Self, Unsuitable> {
        let filter = Design::PAPER.at(period_s.recip())?;
        let window = filter.samples_min();
        // The filter is linear: the weight of a sample is what becomes of it alone.
        let weight = |at: usize| {
            let mut impulse = vec![0.0; window];
            impulse[at] = 1.0;
            filter.smooth(&impulse).map_or(0.0, |smooth| smooth[window / 2])
        };
        let weights: Vec<f64> = (0..window).map(weight).collect();
        let before = weights.iter().copied().chain([0.0]);
        let after = [0.0].into_iter().chain(weights.iter().copied());
        let step_weights = before.zip(after).map(|(before, after)| (after - before).powi(2));
        Ok(Self { period_s, step_weights: step_weights.collect(), filter })
    }

    fn window(&self) -> usize {
        self.filter.samples_min()
    }

    /// The smoothed positions of a window, by axis.
    fn positions_mm(&self, window: &[Point]) -> [Vec<f64>; 3] {
        std::array::from_fn(|axis| {
            let along: Vec<f64> = window.iter().map(|point| point.position_mm[axis]).collect();
            self.filter.smooth(&along).unwrap_or_default()
        })
    }

    /// The covariances of the steps within a window, each of which begins at the sample of its
    /// index; empty where one is not known.
    fn steps_mm2(&self, window: &[Point]) -> Vec<Matrix3<f64>> {
        let covariances: Option<Vec<_>> = window.iter().map(|point| point.covariance_mm2).collect();
        covariances.and_then(|all| self.filter.step_variances(&all)).unwrap_or_default()
    }

    /// The covariance of the step between the centres of two windows.
    fn step_mm2(&self, windows: &[Point]) -> Option<Matrix3<f64>> {
        let weighted = windows.iter().zip(&self.step_weights);
        weighted
            .map(|(point, weight)| point.covariance_mm2.map(|it| it * *weight))
            .try_fold(Matrix3::zeros(), |sum, covariance| Some(sum + covariance?))
    }
}

/// Follows one trunk.
#[derive(Debug)]
struct Follower {
    /// The points until the rate is known.
    first: Vec<Point>,
    smoother: Option<Result<Smoother, Unsuitable>>,
    /// The latest points without a gap: one more than the filter's window at most.
    part: VecDeque<Point>,
    /// Those of the part that have been seen, also those that are no longer kept.
    part_points: usize,
    from_s: f64,
    sums: Sums,
}

impl Follower {
    fn new() -> Self {
        Self {
            first: Vec::new(),
            smoother: None,
            part: VecDeque::new(),
            part_points: 0,
            from_s: f64::NEG_INFINITY,
            sums: Sums::default(),
        }
    }

    fn start_over(&mut self, from_s: f64) {
        self.from_s = from_s;
        self.sums = Sums { before: self.sums.before, ..Sums::default() };
    }

    fn begin_session(&mut self) {
        self.first.clear();
        self.end_part();
        self.from_s = f64::NEG_INFINITY;
        self.sums.earlier_s = self.sums.seconds();
        self.sums.span_s = None;
    }

    fn take(&mut self, point: Point) {
        if self.smoother.is_some() {
            return self.follow(point);
        }
        if self.first.last().is_none_or(|last| last.time_s < point.time_s) {
            self.first.push(point);
        }
        let times_s: Vec<f64> = self.first.iter().map(|point| point.time_s).collect();
        if self.first.len() == RATE_POINTS
            && let Some(period_s) = usual_period_s(&times_s)
        {
            self.smoother = Some(Smoother::at(period_s));
            for point in std::mem::take(&mut self.first) {
                self.follow(point);
            }
        }
    }

    fn follow(&mut self, point: Point) {
        let Some(Ok(smoother)) = &self.smoother else { return };
        let (period_s, window) = (smoother.period_s, smoother.window());
        if let Some(last) = self.part.back() {
            let (last_s, step_s) = (last.time_s, point.time_s - last.time_s);
            if step_s <= 0.0 {
                return;
            }
            if step_s > GAP_PERIODS * period_s {
                if last_s >= self.from_s {
                    self.sums.gaps += 1;
                    self.sums.gaps_s += step_s;
                }
                self.end_part();
            }
        }
        if point.time_s >= self.from_s {
            let [_, latest_s] = self.sums.span_s.get_or_insert([point.time_s; 2]);
            *latest_s = point.time_s;
        }
        self.part.push_back(point);
        self.part_points += 1;
        if self.part.len() > window + 1 {
            self.part.pop_front();
        }
        match self.part_points {
            few if few < window => {}
            first if first == window => self.begin_part(),
            _ => self.go_on(),
        }
    }

    /// The first whole window of a part: its first half, and its centre.
    fn begin_part(&mut self) {
        let Some(Ok(smoother)) = &self.smoother else { return };
        let window = self.part.make_contiguous();
        let (positions_mm, steps_mm2) = (smoother.positions_mm(window), smoother.steps_mm2(window));
        for (at, point) in window.iter().enumerate().take(window.len() / 2 + 1) {
            let step_mm2 = at.checked_sub(1).and_then(|before| steps_mm2.get(before));
            self.sums.take(point, &positions_mm, at, step_mm2, self.from_s);
        }
    }

    /// A further window of a part: its centre.
    fn go_on(&mut self) {
        let Some(Ok(smoother)) = &self.smoother else { return };
        let windows = self.part.make_contiguous();
        let step_mm2 = smoother.step_mm2(windows);
        let window = &windows[1..];
        let at = window.len() / 2;
        let positions_mm = smoother.positions_mm(window);
        self.sums.take(&window[at], &positions_mm, at, step_mm2.as_ref(), self.from_s);
    }

    /// The last half of the last window of a part.
    fn end_part(&mut self) {
        if let Some(Ok(smoother)) = &self.smoother
            && let points = self.part.make_contiguous()
            && let Some(first) = points.len().checked_sub(smoother.window())
        {
            let window = &points[first..];
            let positions_mm = smoother.positions_mm(window);
            let steps_mm2 = smoother.steps_mm2(window);
            for (at, point) in window.iter().enumerate().skip(window.len() / 2 + 1) {
                let step_mm2 = steps_mm2.get(at - 1);
                self.sums.take(point, &positions_mm, at, step_mm2, self.from_s);
            }
        }
        self.part.clear();
        self.part_points = 0;
        self.sums.before = None;
    }

    fn so_far(&self) -> Result<TrunkFigures, NotYet> {
        let smoother = match &self.smoother {
            Some(Ok(smoother)) => smoother,
            Some(Err(unsuitable)) => return Err(NotYet::Rate(*unsuitable)),
            None => return Err(NotYet::Settling),
        };
        let Sums { samples, squares_mm2, path_mm, noise_path_mm, gaps, gaps_s, .. } = self.sums;
        if samples == 0 {
            return Err(NotYet::Settling);
        }
        Ok(TrunkFigures {
            rate_hz: smoother.period_s.recip(),
            seconds: self.sums.seconds(),
            samples,
            path_mm,
            noise_path_mm,
            rms_mm: squares_mm2.map(|squares| (squares / samples as f64).sqrt()),
            gaps,
            gaps_s,
        })
    }
}

/// What is summed up since t = 0.
#[derive(Debug, Clone, Copy)]
struct Sums {
    samples: usize,
    /// Running means, and sums of squared distances from them (Welford 1962).
    mean_mm: [f64; 3],
    squares_mm2: [f64; 3],
    path_mm: f64,
    noise_path_mm: Option<f64>,
    /// The smoothed sample before, where no gap is between: its time, AP and ML.
    before: Option<[f64; 3]>,
    gaps: usize,
    gaps_s: f64,
    /// The times of the session's first point and of the latest.
    span_s: Option<[f64; 2]>,
    /// The duration of the sessions before.
    earlier_s: f64,
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            samples: 0,
            mean_mm: [0.0; 3],
            squares_mm2: [0.0; 3],
            path_mm: 0.0,
            noise_path_mm: Some(0.0),
            before: None,
            gaps: 0,
            gaps_s: 0.0,
            span_s: None,
            earlier_s: 0.0,
        }
    }
}

impl Sums {
    fn seconds(&self) -> f64 {
        self.earlier_s + self.span_s.map_or(0.0, |[first_s, latest_s]| latest_s - first_s)
    }

    /// Takes the smoothed sample of a point, and the covariance of the step to it.
    fn take(
        &mut self,
        point: &Point,
        positions_mm: &[Vec<f64>; 3],
        at: usize,
        step_mm2: Option<&Matrix3<f64>>,
        from_s: f64,
    ) {
        let [ap_mm, ml_mm, si_mm] = positions_mm.each_ref().map(|along| along[at]);
        let now = [point.time_s, ap_mm, ml_mm];
        // A step belongs to the time in which it starts.
        if let Some([time_s, ap_before_mm, ml_before_mm]) = self.before.replace(now)
            && time_s >= from_s
        {
            self.path_mm += (ap_mm - ap_before_mm).hypot(ml_mm - ml_before_mm);
            let noise_mm = step_mm2.map(|step| mean_step_mm(step, Plane::Transverse));
            self.noise_path_mm = self.noise_path_mm.zip(noise_mm).map(|(sum, step)| sum + step);
        }
        if point.time_s < from_s {
            return;
        }
        self.samples += 1;
        for (axis, value_mm) in [ap_mm, ml_mm, si_mm].into_iter().enumerate() {
            let change_mm = value_mm - self.mean_mm[axis];
            self.mean_mm[axis] += change_mm / self.samples as f64;
            self.squares_mm2[axis] += change_mm * (value_mm - self.mean_mm[axis]);
        }
    }
}

#[cfg(test)]
mod tests;
